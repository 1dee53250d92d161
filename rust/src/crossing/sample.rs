//! What a frame is made of: linear luma (float32) or log intensity (float64), and how far it may move without an event.
//!
//! Each pixel has a mark: its reference in the terms of its samples, as a float32. A sample within reach of its mark has
//! reached no level, so a quiet pixel costs two comparisons and no logarithm. Reaches are rounded inward. A sample
//! between its reach and its level becomes a candidate, which costs only time.
//!
//! What must not break:
//! - No sample that has reached a level is within reach of its mark. [`MARGIN`] and [`LOG_MARGIN`] cover the errors of
//!   the reference, of the exponential and of all roundings to float32.
//! - No bad sample is within reach of any mark. So the scan finds bad values among the samples that left, for nothing.

use std::fmt::Debug;

use multiversion::multiversion;

use super::exponential::exp;
use super::level::Thresholds;
use super::registers::Compress;
use crate::error::Result;
use crate::event::SensorSize;
use crate::log_intensity::{LUMA_RULE, all_luma_valid, check_luma, check_none, log_intensities};

/// How far above and below its mark a sample may lie, without doubt within its levels: factors of luma, differences of log
/// intensity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    pub(crate) up: f32,
    pub(crate) down: f32,
}

/// The dark level by which marks are compared, the same for all pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DarkLevel {
    /// What is added to luma.
    dark: f32,
    /// A pixel whose mark would be less has none.
    least_mark: f64,
}

/// A sample of a frame.
pub(crate) trait Sample: Compress + Copy + Debug + Default + PartialOrd + Send + Sync + 'static {
    /// What a valid one is, for people.
    const RULE: &'static str;

    /// Has every value a log intensity?
    fn all_valid(frame: &[Self]) -> bool;

    /// Refuses a frame with values that have no log intensity, with time and pixel.
    fn check(frame: &[Self], size: SensorSize, t_us: i64) -> Result<()>;

    /// Log intensity of each sample.
    fn logs(samples: &[Self], log_eps: f64, logs: &mut [f64]);

    /// The same, in `buffer` or wherever it is already: see [`Self::logs_of`].
    fn take_logs(samples: &[Self], log_eps: f64, buffer: &mut [f64]);

    /// Where [`Self::take_logs`] left log intensity: in `buffer`, or in the samples.
    fn logs_of<'a>(samples: &'a [Self], buffer: &'a [f64]) -> &'a [f64];

    /// What goes with this dark level, where no pixel's reach down is less than `least_down`.
    fn dark_level(log_eps: f64, least_down: f32) -> DarkLevel;

    /// How far samples may lie from their mark, where these are the thresholds.
    fn reach(c: Thresholds) -> Reach;

    /// The marks of references, which are given within 1e-9. NaN where every sample is worth a look.
    fn marks(references: &[f64], dark_level: DarkLevel, marks: &mut [f32]);

    /// Has the sample surely reached no level? False for what is no valid sample.
    fn is_within(self, mark: f32, reach: Reach, dark_level: DarkLevel) -> bool;

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

    fn take_logs(samples: &[Self], log_eps: f64, buffer: &mut [f64]) {
        log_intensities(samples, log_eps, &mut buffer[..samples.len()]);
    }

    fn logs_of<'a>(samples: &'a [Self], buffer: &'a [f64]) -> &'a [f64] {
        &buffer[..samples.len()]
    }

    fn dark_level(log_eps: f64, least_down: f32) -> DarkLevel {
        #[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
        let dark = log_eps as f32;
        // Next to a dark level like this, what underflows is too small to matter. Without one, nothing may underflow.
        let least_mark = if dark >= 1e-30 { 0.0 } else { 1e-36 / f64::from(least_down) };
        DarkLevel { dark, least_mark }
    }

    #[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
    fn reach(c: Thresholds) -> Reach {
        // Not so far that a factor is infinite or zero: that is nearer than the level.
        let up = (exp(c.on) * (1.0 - MARGIN)).min(f32::MAX.into()) as f32;
        let down = (exp(-c.off) * (1.0 + MARGIN)).max(f32::MIN_POSITIVE.into()) as f32;
        Reach { up, down }
    }

    fn marks(references: &[f64], dark_level: DarkLevel, marks: &mut [f32]) {
        luma_marks(references, dark_level.least_mark, marks);
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes the scan's vector code")]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    fn is_within(self, mark: f32, reach: Reach, dark_level: DarkLevel) -> bool {
        let light = self + dark_level.dark;
        (self >= 0.0) & (light < mark * reach.up) & (light > mark * reach.down)
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

    fn take_logs(_: &[Self], _: f64, _: &mut [f64]) {}

    fn logs_of<'a>(samples: &'a [Self], _: &'a [f64]) -> &'a [f64] {
        samples
    }

    fn dark_level(_: f64, _: f32) -> DarkLevel {
        DarkLevel { dark: 0.0, least_mark: 0.0 }
    }

    #[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
    fn reach(c: Thresholds) -> Reach {
        let inward = |c: f64| (c * (1.0 - LOG_MARGIN) - 3e-9).min(FARTHEST) as f32;
        Reach { up: inward(c.on), down: -inward(c.off) }
    }

    fn marks(references: &[f64], _: DarkLevel, marks: &mut [f32]) {
        log_marks(references, marks);
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes the scan's vector code")]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    #[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
    fn is_within(self, mark: f32, reach: Reach, _: DarkLevel) -> bool {
        let change = self as f32 - mark;
        let inward = mark.abs() * INWARD;
        (change < reach.up - inward) & (change > reach.down + inward)
    }

    fn log_rate(self, rate: Self, _: f64) -> f64 {
        rate
    }
}

/// Luma's reaches are drawn inward by this fraction of luma plus dark level.
///
/// The reference is off by less than 1e-9, the exponentials of reference and threshold by 1e-9 each, and five roundings
/// to float32 (of the mark, the reach, their product, the dark level, and the sum with it) take 2^-24 each: all together
/// less than half of it.
const MARGIN: f64 = 1.0 / 1_048_576.0;

/// Reaches in log intensity are drawn inward by this fraction of the threshold, by 3e-9 for the reference, and by
/// [`INWARD`] of the mark.
///
/// A level lies a threshold from the reference. So its rounding to float32, that of the mark and those of the differences
/// are below 2^-24 of threshold and mark together, five times: less than a half of these margins.
const LOG_MARGIN: f64 = 1e-6;

/// 2^-21: by this fraction of the mark, reaches in log intensity are drawn inward.
const INWARD: f32 = 1.0 / 2_097_152.0;

/// Log intensity beyond has no mark, and no reach is larger than that: so what is within reach lies within +-746.
const LARGEST_MARK: f64 = 600.0;
const FARTHEST: f64 = 100.0;

/// exp(reference), where neither it nor what it is multiplied by leaves float32's range; else NaN.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn luma_marks(references: &[f64], least: f64, marks: &mut [f32]) {
    for (mark, &reference) in marks.iter_mut().zip(references) {
        let light = exp(reference);
        let usable = (-80.0..=88.0).contains(&reference) & (light >= least);
        *mark = if usable { light as f32 } else { f32::NAN };
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::cast_possible_truncation, reason = "the margin allows for rounding")]
fn log_marks(references: &[f64], marks: &mut [f32]) {
    for (mark, &reference) in marks.iter_mut().zip(references) {
        *mark = if reference.abs() <= LARGEST_MARK { reference as f32 } else { f32::NAN };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log_intensity::log_intensity;
    use proptest::prelude::*;

    /// Is the sample within reach of the mark of this reference?
    fn is_within<S: Sample>(sample: S, reference: f64, c: Thresholds, log_eps: f64) -> bool {
        let (mut mark, reach) = ([0.0], S::reach(c));
        let dark_level = S::dark_level(log_eps, reach.down);
        S::marks(&[reference], dark_level, &mut mark);
        sample.is_within(mark[0], reach, dark_level)
    }

    /// Dark levels as they are, and as far as they may go.
    fn dark_levels() -> impl Strategy<Value = f64> {
        prop_oneof![4 => -12.0f64..3.0, 1 => -300.0f64..300.0, 1 => -46.0f64..-28.0].prop_map(|x| 10f64.powf(x))
    }

    /// Thresholds from a few ulp of float32 to beyond all of its range.
    fn thresholds() -> impl Strategy<Value = Thresholds> {
        let threshold = || prop_oneof![6 => 1e-6f64..3.0, 1 => 1e-6f64..1e-4, 2 => 60.0f64..110.0, 1 => 3.0f64..1e3];
        (threshold(), threshold()).prop_map(|(on, off)| Thresholds { on, off })
    }

    /// The float32 nearest to the luma of this log intensity, a few floats off.
    #[allow(clippy::cast_possible_truncation, reason = "the test wants float32")]
    fn luma_near(log: f64, log_eps: f64, nudge: i32) -> f32 {
        f32::from_bits(((log.exp() - log_eps).max(0.0) as f32).to_bits().saturating_add_signed(nudge))
    }

    /// Dark levels that float32 holds with few digits or none, and luma as small.
    #[test]
    fn luma_s_reach_is_inward_next_to_no_dark_level() {
        for k in 1..4000i32 {
            let log_eps = 1e-45 * 1.003f64.powi(k);
            let luma = f32::from_bits(k.unsigned_abs() * 7);
            let (reference, log) = (-79.5, log_intensity(luma, log_eps));
            let c = Thresholds { on: 0.5, off: reference - log };
            assert!(!is_within(luma, reference, c, log_eps), "{luma} {log_eps}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// Luma within reach has its logarithm strictly inside of the levels: as near to both as floats lie.
        #[test]
        fn luma_s_reach_is_inward(reference in prop_oneof![6 => -30.0f64..88.0, 1 => -120.0f64..130.0, 1 => -700.0f64..700.0], c in thresholds(), log_eps in dark_levels(), nudge in -40i32..40) {
            for level in [reference + c.on, reference - c.off] {
                let luma = luma_near(level, log_eps, nudge);
                let log = log_intensity(luma, log_eps);
                if luma.is_finite() && (log >= reference + c.on - 1e-9 || log <= reference - c.off + 1e-9) {
                    prop_assert!(!is_within(luma, reference, c, log_eps), "{luma} {reference} {c:?} {log_eps}");
                }
            }
        }

        /// The same, of log intensity.
        #[test]
        fn log_intensity_s_reach_is_inward(reference in prop_oneof![6 => -8.0f64..8.0, 2 => -1e-3f64..1e-3, 1 => -746.0f64..746.0, 1 => -1e30f64..1e30], c in thresholds(), inside in prop_oneof![Just(0.0), 0.0f64..2e-9]) {
            for (level, inward) in [(reference + c.on, -inside), (reference - c.off, inside)] {
                prop_assert!(!is_within(level + inward.clamp(-1e-9, 1e-9), reference, c, 1e-3));
            }
        }

        /// Luma clear of the levels lies within reach: what leads to no event costs no second look.
        #[test]
        fn luma_s_reach_is_sharp(reference in -30.0f64..87.0, on in 2e-4f64..3.0, off in 2e-4f64..3.0, fraction in 0.01f64..0.99, exponent in -12.0f64..3.0) {
            let log_eps = 10f64.powf(exponent);
            let log = reference - off + fraction * (on + off);
            let luma = luma_near(log, log_eps, 0);
            // Next to a large dark level float32 may have no luma there.
            let log = log_intensity(luma, log_eps);
            let fraction = (log - (reference - off)) / (on + off);
            if !(0.01..0.99).contains(&fraction) {
                return Ok(());
            }
            let c = Thresholds { on, off };
            prop_assert!(is_within(luma, reference, c, log_eps));
        }

        /// The same, of log intensity.
        #[test]
        fn log_intensity_s_reach_is_sharp(reference in -16.0f64..16.0, on in 1e-3f64..3.0, off in 1e-3f64..3.0, fraction in 0.01f64..0.99) {
            let c = Thresholds { on, off };
            prop_assert!(is_within(reference - off + fraction * (on + off), reference, c, 1e-3));
        }

        /// What is no valid sample is within reach of nothing.
        #[test]
        fn bad_values_are_never_within_reach(reference in prop_oneof![-30.0f64..100.0, -1000.0f64..1000.0], c in thresholds(), log_eps in dark_levels(), beyond in prop_oneof![746.000_001f64..747.0, 747.0f64..1e300]) {
            for bad in [-f32::MIN_POSITIVE, -1e-4, -1e-3, -1.0, f32::NEG_INFINITY, f32::INFINITY, f32::NAN] {
                prop_assert!(!is_within(bad, reference, c, log_eps));
            }
            for bad in [beyond, -beyond, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
                prop_assert!(!is_within(bad, reference, c, log_eps));
            }
        }
    }
}
