//! What a frame is made of: linear luma (float32) or log intensity (float64), and bounds in the same terms.
//!
//! A sample strictly between its pixel's bounds has reached no level, so a quiet pixel costs two comparisons and no
//! logarithm. Bounds are rounded inward. A sample between a bound and its level becomes a candidate, which costs only
//! time.
//!
//! What must not break: no sample that has reached a level lies within its bounds. [`MARGIN`] covers the errors of the
//! reference, of the exponential and of rounding to float32.

use std::fmt::Debug;

use multiversion::multiversion;

use super::exponential::exp;
use super::steps::Steps;
use crate::error::Result;
use crate::event::SensorSize;
use crate::log_intensity::{LUMA_RULE, all_luma_valid, check_luma, check_none, log_intensities};

/// A sample of a frame.
pub(crate) trait Sample: Copy + Debug + Default + PartialOrd + Send + Sync + 'static {
    /// What a valid one is, for people.
    const RULE: &'static str;

    /// Has every value a log intensity?
    fn all_valid(frame: &[Self]) -> bool;

    /// Refuses a frame with values that have no log intensity, with time and pixel.
    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()>;

    /// Log intensity of each sample.
    fn logs(samples: &[Self], log_eps: f64, logs: &mut [f64]);

    /// The bounds (below, above) of samples whose log intensity lies strictly between the levels around a reference,
    /// which is given within 1e-9.
    fn bounds(references: &[f64], steps: Steps<&[f64]>, log_eps: f64, bounds: (&mut [Self], &mut [Self]));

    /// Change of log intensity per second, from the sample and its own rate of change.
    fn log_rate(self, rate: Self, log_eps: f64) -> f64;

    /// Do the rates at both ends of an interval have opposite signs, so that there is an extremum between?
    #[inline]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    fn signs_differ(from: Self, to: Self) -> bool {
        let zero = Self::default();
        ((from > zero) & (to < zero)) | ((from < zero) & (to > zero))
    }
}

impl Sample for f32 {
    const RULE: &'static str = LUMA_RULE;

    fn all_valid(frame: &[Self]) -> bool {
        all_luma_valid(frame)
    }

    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()> {
        check_luma(frame, size, Some(t_us))
    }

    fn logs(samples: &[Self], log_eps: f64, logs: &mut [f64]) {
        log_intensities(samples, log_eps, logs);
    }

    fn bounds(references: &[f64], steps: Steps<&[f64]>, log_eps: f64, bounds: (&mut [Self], &mut [Self])) {
        luma_bounds(references, steps, log_eps, bounds);
    }

    fn log_rate(self, rate: Self, log_eps: f64) -> f64 {
        f64::from(rate) / (f64::from(self) + log_eps)
    }
}

/// No logarithm of a positive finite float64 lies outside of +-745.2.
const MAX_LOG_INTENSITY: f64 = 746.0;

impl Sample for f64 {
    const RULE: &'static str = "log intensity must lie within +-746";

    fn all_valid(frame: &[Self]) -> bool {
        frame.iter().fold(true, |valid, log| valid & (log.abs() <= MAX_LOG_INTENSITY))
    }

    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()> {
        let bad = frame.iter().position(|l| l.is_nan() || l.abs() > MAX_LOG_INTENSITY);
        check_none(bad, size, Some(t_us), |i| format!("{}, got {}", Self::RULE, frame[i]))
    }

    fn logs(samples: &[Self], _: f64, logs: &mut [f64]) {
        logs.copy_from_slice(samples);
    }

    fn bounds(references: &[f64], steps: Steps<&[f64]>, _: f64, bounds: (&mut [Self], &mut [Self])) {
        // References are within 1e-9, and adding rounds by less.
        for (i, reference) in references.iter().enumerate() {
            bounds.0[i] = reference - steps.off[i] + 3e-9;
            bounds.1[i] = reference + steps.on[i] - 3e-9;
        }
    }

    fn log_rate(self, rate: Self, _: f64) -> f64 {
        rate
    }
}

/// Bounds are drawn inward by this share of luma plus dark level: a reference is off by less than 1e-9, the exponential
/// and the step by 1e-9 each, and rounding to float32 takes 2^-24, all together less than half of it.
const MARGIN: f64 = 1.0 / 2_097_152.0;

/// exp(reference) * step * `margin` - `log_eps`; too large for float32 is infinity.
///
/// A reference that no luma can lead to (float32 ends at 89) makes every sample worth a look.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
fn luma_bounds(references: &[f64], steps: Steps<&[f64]>, log_eps: f64, bounds: (&mut [f32], &mut [f32])) {
    let n = references.len();
    let (rise, fall) = (&steps.rise[..n], &steps.fall[..n]);
    let (below, above) = (&mut bounds.0[..n], &mut bounds.1[..n]);
    for i in 0..n {
        let usable = (-700.0..=100.0).contains(&references[i]);
        let luma = exp(references[i]);
        let (low, high) = (luma * (fall[i] * (1.0 + MARGIN)) - log_eps, luma * (rise[i] * (1.0 - MARGIN)) - log_eps);
        below[i] = if usable { low as f32 } else { f32::INFINITY };
        above[i] = if usable { high as f32 } else { f32::NEG_INFINITY };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::level::Thresholds;
    use crate::log_intensity::log_intensity;
    use proptest::prelude::*;

    proptest! {
        /// Luma strictly inside of the bounds has its logarithm strictly inside of the levels.
        #[test]
        fn bounds_are_inward(reference in -30.0f64..88.0, gap in 1e-6f64..3.0, share in 0.1f64..10.0, exponent in -12.0f64..3.0, nudge in -3i32..4) {
            let log_eps = 10f64.powf(exponent);
            let (mut low, mut high) = ([0.0], [0.0]);
            let Steps { on, off, rise, fall } = Steps::new(Thresholds { on: gap, off: share * gap });
            let steps = Steps { on: &[on][..], off: &[off], rise: &[rise], fall: &[fall] };
            f32::bounds(&[reference], steps, log_eps, (&mut low, &mut high));
            let ([low], [high]) = (low, high);
            for bound in [low, high] {
                let luma = f32::from_bits(bound.max(0.0).to_bits().saturating_add_signed(nudge));
                if luma.is_finite() && low < luma && luma < high {
                    let log = log_intensity(luma, log_eps);
                    prop_assert!(reference - off < log && log < reference + on);
                }
            }
        }


        /// Luma clear of the levels lies strictly between its bounds: what leads to no event costs no second look.
        #[test]
        fn bounds_are_sharp(reference in -30.0f64..88.0, on in 1e-4f64..3.0, off in 1e-4f64..3.0, place in 0.01f64..0.99, exponent in -12.0f64..3.0) {
            let log_eps = 10f64.powf(exponent);
            let log = reference - off + place * (on + off);
            #[allow(clippy::cast_possible_truncation, reason = "the test wants float32")]
            let luma = (log.exp() - log_eps) as f32;
            prop_assume!(luma.is_normal() && luma > 0.0);
            let (mut low, mut high) = ([0.0], [0.0]);
            let Steps { on, off, rise, fall } = Steps::new(Thresholds { on, off });
            let steps = Steps { on: &[on][..], off: &[off], rise: &[rise], fall: &[fall] };
            f32::bounds(&[reference], steps, log_eps, (&mut low, &mut high));
            prop_assert!(low[0] < luma && luma < high[0]);
        }
    }
}
