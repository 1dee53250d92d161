//! What a frame is made of: linear luma (float32) or log intensity itself (float64), and bounds in the same terms.
//!
//! A sample strictly between its pixel's bounds has reached no level. Bounds are rounded inward, so that nothing that
//! has reached one is missed; the few samples that are on a bound's wrong side without need are decided exactly.

use multiversion::multiversion;

use crate::error::Result;
use crate::event::SensorSize;
use crate::log_intensity::{all_luma_valid, check_luma, check_none, log_intensities};

/// What lies around a pixel's reference: one array for below, one for above.
pub(crate) struct Around<T> {
    pub(crate) below: T,
    pub(crate) above: T,
}

/// A sample of a frame.
pub(crate) trait Sample: Copy + Default + PartialOrd + Send + Sync + 'static {
    /// Has every value a log intensity?
    fn all_valid(frame: &[Self]) -> bool;

    /// Refuses a frame with values that have no log intensity, with time and pixel.
    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()>;

    /// Log intensity of each sample.
    fn logs(samples: &[Self], log_eps: f64, logs: &mut [f64]);

    /// Bounds of samples whose log intensity lies strictly between two levels, which are given within 1e-9.
    fn bounds(levels: Around<&[f64]>, log_eps: f64, bounds: Around<&mut [Self]>);

    /// Change of log intensity per second, from the sample and its own rate of change.
    fn log_rate(self, rate: Self, log_eps: f64) -> f64;

    /// Do the rates at both ends of an interval have opposite signs, so that there is an extremum between?
    fn turns(from: Self, to: Self) -> bool {
        let zero = Self::default();
        (from > zero && to < zero) || (from < zero && to > zero)
    }
}

impl Sample for f32 {
    fn all_valid(frame: &[Self]) -> bool {
        all_luma_valid(frame)
    }

    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()> {
        check_luma(frame, size, Some(t_us))
    }

    fn logs(samples: &[Self], log_eps: f64, logs: &mut [f64]) {
        log_intensities(samples, log_eps, logs);
    }

    fn bounds(levels: Around<&[f64]>, log_eps: f64, bounds: Around<&mut [Self]>) {
        luma_bounds(levels.below, 1.0 + MARGIN, log_eps, bounds.below);
        luma_bounds(levels.above, 1.0 - MARGIN, log_eps, bounds.above);
    }

    fn log_rate(self, rate: Self, log_eps: f64) -> f64 {
        f64::from(rate) / (f64::from(self) + log_eps)
    }
}

/// No logarithm of a positive finite float64 lies outside of +-745.2.
const MAX_LOG_INTENSITY: f64 = 746.0;

impl Sample for f64 {
    fn all_valid(frame: &[Self]) -> bool {
        frame.iter().fold(true, |valid, log| valid & (log.abs() <= MAX_LOG_INTENSITY))
    }

    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()> {
        let bad = frame.iter().position(|l| l.is_nan() || l.abs() > MAX_LOG_INTENSITY);
        check_none(bad, size, Some(t_us), |i| format!("log intensity must lie within +-746, got {}", frame[i]))
    }

    fn logs(samples: &[Self], _: f64, logs: &mut [f64]) {
        logs.copy_from_slice(samples);
    }

    fn bounds(levels: Around<&[f64]>, _: f64, bounds: Around<&mut [Self]>) {
        // Levels are within 1e-9, and adding rounds by less.
        for (bound, below) in bounds.below.iter_mut().zip(levels.below) {
            *bound = below + 3e-9;
        }
        for (bound, above) in bounds.above.iter_mut().zip(levels.above) {
            *bound = above - 3e-9;
        }
    }

    fn log_rate(self, rate: Self, _: f64) -> f64 {
        rate
    }
}

/// Bounds are drawn inward by this share of luma plus dark level: a level is off by less than 1e-9, the exponential by
/// 1e-9, and rounding to float32 takes 2^-24, all together less than half of it.
const MARGIN: f64 = 1.0 / 2_097_152.0;

/// exp(level) * `margin` - `log_eps`; too large for float32 is infinity.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
fn luma_bounds(levels: &[f64], margin: f64, log_eps: f64, bounds: &mut [f32]) {
    for (bound, level) in bounds.iter_mut().zip(levels) {
        *bound = (exp(*level) * margin - log_eps) as f32;
    }
}

/// 1.5 * 2^52: adding it rounds to an integer, in the low bits; subtracting it again gives that as a float.
pub(crate) const ROUND: f64 = 6_755_399_441_055_744.0;

/// The exponential within 1e-9, for levels from -700 to 700 and clamped to that beyond, without branches.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
fn exp(x: f64) -> f64 {
    // Taylor's series: 1 / n!, n = 8 to 1; the next term is 0.35^9 / 9! = 2e-10.
    const INVERSE_FACTORIALS: [f64; 8] =
        [1.0 / 40_320.0, 1.0 / 5_040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let x = x.clamp(-700.0, 700.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * std::f64::consts::LN_2;
    let mut sum = 0.0;
    for coefficient in INVERSE_FACTORIALS {
        sum = (sum + coefficient) * r;
    }
    (1.0 + sum) * f64::from_bits((shifted.to_bits() << 52).wrapping_add(0x3ff0_0000_0000_0000))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log_intensity::log_intensity;
    use proptest::prelude::*;

    #[test]
    fn the_exponential_is_good_enough_for_the_margin() {
        for i in -70_000..70_000i32 {
            let x = f64::from(i) * 0.01;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-9, "{x}");
        }
    }

    proptest! {
        /// Luma strictly inside of the bounds has its logarithm strictly inside of the levels.
        #[test]
        fn bounds_are_inward(level in -30.0f64..88.0, gap in 1e-6f64..3.0, exponent in -12.0f64..3.0, nudge in -3i32..4) {
            let log_eps = 10f64.powf(exponent);
            let (mut low, mut high) = ([0.0], [0.0]);
            let levels = Around { below: &[level - gap][..], above: &[level][..] };
            f32::bounds(levels, log_eps, Around { below: &mut low[..], above: &mut high[..] });
            let ([low], [high]) = (low, high);
            for bound in [low, high] {
                let luma = f32::from_bits(bound.max(0.0).to_bits().saturating_add_signed(nudge));
                if luma.is_finite() && low < luma && luma < high {
                    let log = log_intensity(luma, log_eps);
                    prop_assert!(level - gap < log && log < level);
                }
            }
        }
    }
}
