//! When each pixel fired last: the surface of active events.

use super::cell::cell;
use crate::error::Result;
use crate::event::{Event, SensorSize};

/// The time of the last event up to `until_us` by polarity and pixel: two planes, OFF before ON, each in rows; -1 where
/// there was none.
///
/// # Errors
/// As [`super::count_events`].
pub fn latest_times(events: &[Event], size: SensorSize, until_us: i64) -> Result<Vec<i64>> {
    let mut times = vec![-1; 2 * size.pixels()];
    for (index, event) in events.iter().enumerate() {
        let time = &mut times[cell(index, event, size)?];
        if event.t <= until_us {
            *time = event.t.max(*time);
        }
    }
    Ok(times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_events_replace_earlier_ones_until_the_moment_asked_for() {
        let size = SensorSize { width: 2, height: 1 };
        let events = [Event::new(0, 0, 0, true), Event::new(7, 0, 0, true), Event::new(8, 1, 0, false)];
        assert_eq!(latest_times(&events, size, 7).unwrap(), [-1, -1, 7, -1]);
        assert_eq!(latest_times(&events, size, 6).unwrap(), [-1, -1, 0, -1]);
        assert_eq!(latest_times(&events, size, 8).unwrap(), [-1, 8, 7, -1]);
    }
}
