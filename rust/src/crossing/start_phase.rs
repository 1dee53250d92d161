//! Start phases: how far each pixel's log intensity lies from its reference when the first frame comes.
//!
//! An ideal pixel memorises the first frame. A camera that has run for long has memorised something before, so its first
//! frame lies anywhere between the levels of each pixel.
//!
//! What must not break:
//! - A phase is a function of (seed, pixel) and the pixel's thresholds. No effect has a say in it, so an effect that
//!   comes to nothing changes nothing.
//! - `-C_off < L - R < C_on` holds at the first frame, exactly.

use super::level::{Level, Thresholds};
use crate::random::{Draw, Purpose};

/// Where the first references lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartPhase {
    /// At the log intensity of the first frame.
    #[default]
    Zero,
    /// At a distance from it that is drawn for each pixel: `L - R` is uniform in `(-C_off, C_on)`.
    Stationary,
}

impl StartPhase {
    /// `B` of a pixel's first reference, at this log intensity.
    pub(crate) fn base(self, log_intensity: f64, pixel: u32, c: Thresholds, seed: u64) -> f64 {
        match self {
            Self::Zero => log_intensity,
            Self::Stationary => base_at(Draw::at(seed, Purpose::StartPhase, pixel, 0).uniform(), log_intensity, c),
        }
    }
}

/// The base of which log intensity lies this fraction of the way from the OFF level to the ON level.
///
/// Where that rounds to a level, it is log intensity itself.
fn base_at(fraction: f64, log_intensity: f64, c: Thresholds) -> f64 {
    let base = log_intensity - (fraction * (c.on + c.off) - c.off);
    let reference = Level { base, on: 0, off: 0 };
    let between =
        reference.up().sign_of_excess(log_intensity, c) < 0 && reference.down().sign_of_excess(log_intensity, c) > 0;
    if between { base } else { log_intensity }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Also with shares next to both ends, and thresholds that are a few ulp of log intensity.
        #[test]
        fn the_first_reference_is_within_both_thresholds(
            fraction in prop_oneof![0.0..=1.0, Just(0.0), Just(1.0), Just(f64::EPSILON), Just(1.0 - f64::EPSILON / 2.0)],
            log_intensity in -746.0..746.0,
            on in prop_oneof![1e-6..1e-3, 1e-3..1e3],
            off in prop_oneof![1e-6..1e-3, 1e-3..1e3],
        ) {
            let c = Thresholds { on, off };
            let reference = Level { base: base_at(fraction, log_intensity, c), on: 0, off: 0 };
            prop_assert!(reference.up().sign_of_excess(log_intensity, c) < 0);
            prop_assert!(reference.down().sign_of_excess(log_intensity, c) > 0);
        }

        #[test]
        fn a_share_is_the_way_from_the_off_level_to_the_on_level(
            fraction in 0.01..0.99, log_intensity in -5.0..5.0, on in 0.01..1.0, off in 0.01..1.0,
        ) {
            let distance = log_intensity - base_at(fraction, log_intensity, Thresholds { on, off });
            prop_assert!(((distance + off) / (on + off) - fraction).abs() < 1e-12);
        }
    }
}
