//! Log intensity from events, by the paper's formula.
//!
//! What must not break: the result equals the engine's reference to the bit, because both count events in integers and
//! round once.

use super::parameters::CrossingParameters;
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// `log I(x; t) = R(x; 0) + (ON events until t) C_on - (OFF events until t) C_off`, for each pixel: the engine's
/// reference.
///
/// `R(x; 0)` is the log intensity of the first frame, less the start phase that the parameters and the seed stand for.
/// Mueggler et al., IJRR 2017, section 6. Counted in integers and rounded once, so that it is the engine's reference.
///
/// # Errors
/// [`Error::Argument`] for parameters out of range, a frame of the wrong size, or an event outside of the sensor.
pub fn reconstruct(
    events: &[Event],
    first_log_intensity: &[f64],
    size: SensorSize,
    t_us: i64,
    parameters: &CrossingParameters,
    seed: u64,
) -> Result<Vec<f64>> {
    parameters.check(size)?;
    if first_log_intensity.len() != size.pixels() {
        return Err(Error::Argument(format!(
            "first_log_intensity must have {} pixels, got {}",
            size.pixels(),
            first_log_intensity.len()
        )));
    }
    let first = first_log_intensity.iter().enumerate();
    let mut levels: Vec<_> = first.map(|(i, &log)| parameters.first_reference(log, i, seed)).collect();
    for (index, event) in events.iter().enumerate().filter(|(_, event)| event.t <= t_us) {
        if event.x >= size.width || event.y >= size.height {
            return Err(Error::Argument(format!(
                "event {index} at (x, y) = ({}, {}) lies outside of the {} x {} sensor",
                event.x, event.y, size.width, size.height
            )));
        }
        let level = &mut levels[usize::from(event.y) * usize::from(size.width) + usize::from(event.x)];
        if event.p == 0 {
            level.off += 1;
        } else {
            level.on += 1;
        }
    }
    Ok(levels.iter().enumerate().map(|(i, level)| level.exact(parameters.thresholds(i)).value()).collect())
}
