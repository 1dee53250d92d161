//! Voxel grids: polarities spread over planes in time.

use super::time_bins::{TimeBins, spread};
use crate::error::Result;
use crate::event::{Event, SensorSize};

/// Sums polarities (+1 ON, -1 OFF) into `bins.count` planes, each event shared by the two planes around it in the
/// measure of its nearness in time.
///
/// Events outside of the window count nowhere, see [`TimeBins`]. It may be an instant that includes its stop: all its
/// events are then in the first plane.
///
/// # Errors
/// [`crate::Error::Argument`] if there is no plane, the window's end lies before its start, or an event of it lies
/// outside of the sensor or has a polarity other than 0 or 1.
pub fn voxel_grid(events: &[Event], size: SensorSize, bins: TimeBins) -> Result<Vec<f64>> {
    spread(events, size, bins, 1, |_| 0, |event, _| f64::from(event.p) * 2.0 - 1.0)
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "sums of dyadic fractions are exact")]
mod tests {
    use super::*;
    use crate::error::Error;

    const SIZE: SensorSize = SensorSize { width: 1, height: 1 };

    fn grid(times: &[i64], count: usize, endpoint: bool) -> Vec<f64> {
        let events: Vec<Event> = times.iter().map(|&t| Event::new(t, 0, 0, true)).collect();
        voxel_grid(&events, SIZE, TimeBins { start_us: 0, stop_us: 8, include_stop: true, count, endpoint }).unwrap()
    }

    #[test]
    fn an_event_is_shared_by_the_planes_around_it() {
        assert_eq!(grid(&[0], 3, true), [1.0, 0.0, 0.0]);
        assert_eq!(grid(&[1], 3, true), [0.75, 0.25, 0.0]);
        assert_eq!(grid(&[8], 3, true), [0.0, 0.0, 1.0]);
        assert_eq!(grid(&[3], 2, false), [0.25, 0.75]);
        assert_eq!(grid(&[7], 2, false), [0.0, 0.25]);
        assert_eq!(grid(&[8], 2, false), [0.0, 0.0]);
        assert_eq!(grid(&[0, 3, 8], 1, true), [3.0]);
    }

    #[test]
    fn what_is_outside_of_the_window_counts_nowhere() {
        assert_eq!(grid(&[-1, 9], 4, true), [0.0; 4]);
    }

    #[test]
    fn an_event_at_the_stop_counts_only_where_the_window_includes_it() {
        let events = [Event::new(7, 0, 0, true), Event::new(8, 0, 0, true)];
        let bins = TimeBins { start_us: 0, stop_us: 8, include_stop: false, count: 3, endpoint: true };
        assert_eq!(voxel_grid(&events, SIZE, bins).unwrap(), [0.0, 0.25, 0.75]);
        assert_eq!(voxel_grid(&events, SIZE, TimeBins { include_stop: true, ..bins }).unwrap(), [0.0, 0.25, 1.75]);
        let nothing = TimeBins { start_us: 8, ..bins };
        assert_eq!(voxel_grid(&events, SIZE, nothing).unwrap(), [0.0; 3]);
    }

    #[test]
    fn an_instant_is_a_window() {
        let bins = TimeBins { start_us: 5, stop_us: 5, include_stop: true, count: 2, endpoint: true };
        assert_eq!(voxel_grid(&[Event::new(5, 0, 0, false)], SIZE, bins).unwrap(), [-1.0, 0.0]);
    }

    #[test]
    fn the_whole_of_time_is_a_window() {
        let bins = TimeBins { start_us: i64::MIN, stop_us: i64::MAX, include_stop: true, count: 2, endpoint: true };
        assert_eq!(voxel_grid(&[Event::new(i64::MAX, 0, 0, true)], SIZE, bins).unwrap(), [0.0, 1.0]);
    }

    #[test]
    fn bins_and_windows_that_are_none_are_refused() {
        for bins in [
            TimeBins { start_us: 0, stop_us: 1, include_stop: true, count: 0, endpoint: true },
            TimeBins { start_us: 1, stop_us: 0, include_stop: true, count: 1, endpoint: true },
            TimeBins { start_us: 0, stop_us: 1, include_stop: true, count: usize::MAX, endpoint: true },
        ] {
            assert!(matches!(voxel_grid(&[], SIZE, bins), Err(Error::Argument(_))));
        }
    }
}
