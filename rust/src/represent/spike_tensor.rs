//! Event spike tensors: measurements of events spread over planes in time, by polarity.

use super::time_bins::{TimeBins, spread};
use crate::error::Result;
use crate::event::{Event, SensorSize};

/// What an event adds to a spike tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measurement {
    /// Its position in the window: 0 at the start, 1 at the end.
    Time,
    /// One.
    Count,
}

/// Sums measurements into `bins.count` planes of OFF events and as many of ON events, each event shared by the two
/// planes around it in the measure of its nearness in time (the kernel that Gehrig et al. call trilinear).
///
/// # Errors
/// As [`super::voxel_grid`].
pub fn spike_tensor(events: &[Event], size: SensorSize, bins: TimeBins, measurement: Measurement) -> Result<Vec<f64>> {
    let by_polarity = |event: &Event| usize::from(event.p);
    match measurement {
        Measurement::Time => spread(events, size, bins, 2, by_polarity, |_, position| position),
        Measurement::Count => spread(events, size, bins, 2, by_polarity, |_, _| 1.0),
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "sums of dyadic fractions are exact")]
mod tests {
    use super::*;

    #[test]
    fn each_polarity_has_planes_of_its_own() {
        let size = SensorSize { width: 2, height: 1 };
        let bins = TimeBins { start_us: 0, stop_us: 8, include_stop: true, count: 3, endpoint: true };
        let events = [Event::new(2, 0, 0, false), Event::new(5, 1, 0, true), Event::new(8, 1, 0, true)];
        let counts = spike_tensor(&events, size, bins, Measurement::Count).unwrap();
        assert_eq!(counts, [0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.75, 0.0, 1.25]);
        let times = spike_tensor(&events, size, bins, Measurement::Time).unwrap();
        assert_eq!(times[..4], [0.125, 0.0, 0.125, 0.0]);
        assert_eq!(times[8..], [0.0, 0.75 * 0.625, 0.0, 0.25 * 0.625 + 1.0]);
    }
}
