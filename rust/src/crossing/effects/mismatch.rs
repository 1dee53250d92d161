//! Threshold mismatch: a fixed pattern of thresholds over the pixels, drawn once when the engine is made.

use crate::crossing::parameters::{CrossingParameters, Threshold};
use crate::event::SensorSize;
use crate::random::{Draw, Purpose};

/// The parameters with both thresholds drawn for each pixel: log-normal, so never zero or negative, with the nominal
/// value as mean and `sigma` times it as standard deviation; ON and OFF independently.
#[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
pub(crate) fn mismatched(p: CrossingParameters, sigma: f64, seed: u64, size: SensorSize) -> CrossingParameters {
    if sigma == 0.0 {
        return p;
    }
    let variance = libm::log1p(sigma * sigma);
    let draw = |nominal: &Threshold, purpose| {
        let factor = |i| libm::exp(variance.sqrt() * Draw::at(seed, purpose, i as u32, 0).normal() - 0.5 * variance);
        Threshold::PerPixel((0..size.pixels()).map(|i| nominal.at(i) * factor(i)).collect())
    };
    CrossingParameters {
        contrast_threshold: draw(&p.contrast_threshold, Purpose::ThresholdOn),
        contrast_threshold_off: draw(&p.contrast_threshold_off, Purpose::ThresholdOff),
        ..p
    }
}
