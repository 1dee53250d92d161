//! Threshold mismatch: a fixed pattern of thresholds over the pixels, drawn once when the engine is made.
//!
//! Thresholds are drawn before everything else, so the engine itself only knows thresholds for each pixel.

use super::parameters::ThresholdMismatch;
use crate::crossing::parameters::{CrossingParameters, Threshold};
use crate::event::SensorSize;
use crate::random::{Draw, Purpose};

/// The parameters with both thresholds drawn for each pixel, the nominal value being their mean.
///
/// What each pixel has of its own is drawn for ON; that for OFF has a share of it, and a draw of its own. Its column and
/// row move both alike.
#[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
pub(crate) fn mismatched(
    p: CrossingParameters,
    mismatch: ThresholdMismatch,
    seed: u64,
    size: SensorSize,
) -> CrossingParameters {
    if mismatch.is_neutral() {
        return p;
    }
    let normal = |purpose, i| Draw::at(seed, purpose, i, 0).normal();
    let factor = |sigma: f64, normal: f64| {
        let variance = libm::log1p(sigma * sigma);
        libm::exp(variance.sqrt() * normal - 0.5 * variance)
    };
    let factors =
        |n: u16, sigma, purpose| (0..n).map(|i| factor(sigma, normal(purpose, i.into()))).collect::<Vec<f64>>();
    let shared = mismatch.correlation;
    let of_pixel = |purpose, i| match purpose {
        Purpose::ThresholdOff if shared != 0.0 => {
            shared * normal(Purpose::ThresholdOn, i) + (1.0 - shared * shared).sqrt() * normal(purpose, i)
        }
        _ => normal(purpose, i),
    };
    let columns = factors(size.width, mismatch.columns, Purpose::ThresholdColumn);
    let rows = factors(size.height, mismatch.rows, Purpose::ThresholdRow);
    let parity = |x: u16| if x.is_multiple_of(2) { 1.0 - mismatch.column_parity } else { 1.0 + mismatch.column_parity };
    let draw = |nominal: &Threshold, purpose| {
        let threshold = |i: usize| {
            let (x, y) = size.xy(i);
            let common = parity(x) * columns[usize::from(x)] * rows[usize::from(y)];
            nominal.at(i) * factor(mismatch.sigma, of_pixel(purpose, i as u32)) * common
        };
        Threshold::PerPixel((0..size.pixels()).map(threshold).collect())
    };
    CrossingParameters {
        contrast_threshold: draw(&p.contrast_threshold, Purpose::ThresholdOn),
        contrast_threshold_off: draw(&p.contrast_threshold_off, Purpose::ThresholdOff),
        ..p
    }
}
