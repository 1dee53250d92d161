//! How many events each pixel had.

use super::cell::cell;
use crate::error::Result;
use crate::event::{Event, SensorSize};

/// Counts events by polarity and pixel: two planes, OFF before ON, each in rows.
///
/// Counts stay at `u32::MAX` once they are there.
///
/// # Errors
/// [`crate::Error::Argument`] with the index of the first event that lies outside of the sensor or has a polarity other
/// than 0 or 1.
pub fn count_events(events: &[Event], size: SensorSize) -> Result<Vec<u32>> {
    let mut counts = vec![0u32; 2 * size.pixels()];
    for (index, event) in events.iter().enumerate() {
        let count = &mut counts[cell(index, event, size)?];
        *count = count.saturating_add(1);
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    const SIZE: SensorSize = SensorSize { width: 3, height: 2 };

    #[test]
    fn off_comes_before_on() {
        let events = [Event::new(0, 2, 0, false), Event::new(1, 0, 1, true), Event::new(1, 0, 1, true)];
        assert_eq!(count_events(&events, SIZE).unwrap(), [0, 0, 1, 0, 0, 0, 0, 0, 0, 2, 0, 0]);
    }

    #[test]
    fn strangers_are_named() {
        let mut polarity = Event::new(0, 0, 0, true);
        polarity.p = 2;
        for (event, rule) in [
            (Event::new(0, 3, 0, true), "event 1 is at (3, 0)"),
            (Event::new(0, 0, 2, true), "event 1 is at (0, 2)"),
            (polarity, "event 1 has 2"),
        ] {
            match count_events(&[Event::new(0, 0, 0, true), event], SIZE) {
                Err(Error::Argument(message)) => assert!(message.contains(rule), "{message}"),
                other => panic!("{other:?}"),
            }
        }
    }
}
