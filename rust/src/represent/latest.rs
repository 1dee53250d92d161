//! When each pixel fired last: the surface of active events, and the few events before the last one.

use super::cell::cell;
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// Returns the times of the last `depth` events up to `until_us` by polarity and pixel, the latest first: `depth`
/// planes of OFF events and as many of ON events, each in rows; -1 where there were fewer.
///
/// # Errors
/// As [`super::count_events`], and [`Error::Argument`] for a depth of 0 or one that memory does not hold.
pub fn latest_times(events: &[Event], size: SensorSize, until_us: i64, depth: usize) -> Result<Vec<i64>> {
    let pixels = size.pixels();
    let length = depth.checked_mul(2 * pixels).filter(|&n| depth > 0 && n <= isize::MAX as usize / 8);
    let mut times = vec![
        -1;
        length.ok_or_else(|| {
            Error::Argument(format!("the last times of a pixel must be at least 1, and fit into memory: got {depth}"))
        })?
    ];
    for (index, event) in events.iter().enumerate() {
        let mut slot = cell(index, event, size)? + usize::from(event.p) * (depth - 1) * pixels;
        if event.t > until_us {
            continue;
        }
        // A later time is put in place of an earlier one, which goes one plane on.
        let mut t = event.t;
        for _ in 0..depth {
            if t > times[slot] {
                std::mem::swap(&mut t, &mut times[slot]);
            }
            slot += pixels;
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
        assert_eq!(latest_times(&events, size, 7, 1).unwrap(), [-1, -1, 7, -1]);
        assert_eq!(latest_times(&events, size, 6, 1).unwrap(), [-1, -1, 0, -1]);
        assert_eq!(latest_times(&events, size, 8, 1).unwrap(), [-1, 8, 7, -1]);
        assert_eq!(latest_times(&events, size, 8, 2).unwrap(), [-1, 8, -1, -1, 7, -1, 0, -1]);
    }

    #[test]
    fn ties_and_events_out_of_order_are_kept_in_order() {
        let size = SensorSize { width: 1, height: 1 };
        let events = [5, 3, 5, 9, 1].map(|t| Event::new(t, 0, 0, true));
        assert_eq!(latest_times(&events, size, 9, 4).unwrap()[4..], [9, 5, 5, 3]);
        assert!(matches!(latest_times(&events, size, 9, 0), Err(Error::Argument(_))));
    }
}
