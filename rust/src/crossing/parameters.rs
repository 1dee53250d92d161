//! The parameters of the ideal pixel, and their allowed ranges.
//!
//! What must not break: the ranges. The error bounds of the engine are derived for thresholds in 1e-6..1e3.

use crate::error::{Error, Result};
use crate::event::SensorSize;
use crate::log_intensity::{check_log_eps, check_none};

use super::level::{Level, Thresholds};
use super::start_phase::StartPhase;

/// A contrast threshold in natural-log units, in 1e-6..=1e3.
///
/// Below, one step of a pixel makes more events than memory holds; above, none ever.
#[derive(Clone, Debug, PartialEq)]
pub enum Threshold {
    /// The same for all pixels.
    Uniform(f64),
    /// One for each pixel, row by row.
    PerPixel(Vec<f64>),
}

impl Threshold {
    pub(crate) fn at(&self, pixel: usize) -> f64 {
        match self {
            Self::Uniform(value) => *value,
            Self::PerPixel(values) => values[pixel],
        }
    }

    fn least(&self) -> f64 {
        match self {
            Self::Uniform(value) => *value,
            Self::PerPixel(values) => values.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }

    pub(crate) fn check(&self, name: &str, size: SensorSize) -> Result<()> {
        let allowed = |value: f64| (1e-6..=1e3).contains(&value);
        let rule = |value: f64| format!("{name} must lie in 1e-6..1e3 (natural-log units), got {value}");
        match self {
            Self::Uniform(value) if allowed(*value) => Ok(()),
            Self::Uniform(value) => Err(Error::Argument(rule(*value))),
            Self::PerPixel(values) if values.len() == size.pixels() => {
                check_none(values.iter().position(|&v| !allowed(v)), size, None, |i| rule(values[i]))
            }
            Self::PerPixel(values) => Err(Error::Argument(format!(
                "{name} must have one value for each of the {} pixels, got {}",
                size.pixels(),
                values.len()
            ))),
        }
    }
}

/// How log intensity runs between two frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Straight from sample to sample.
    #[default]
    Linear,
    /// A cubic Hermite curve, from samples and rates of change.
    Hermite,
}

/// Parameters of the ideal pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossingParameters {
    /// `C_on`: brighter by this much makes an ON event.
    pub contrast_threshold: Threshold,
    /// `C_off`: darker by this much makes an OFF event.
    pub contrast_threshold_off: Threshold,
    /// The dark level, in units of luma: `L = ln(luma + log_eps)`.
    pub log_eps: f64,
    /// How log intensity runs between two frames.
    pub interpolation: Interpolation,
    /// Where references lie at the first frame.
    pub start_phase: StartPhase,
}

impl Default for CrossingParameters {
    fn default() -> Self {
        Self {
            contrast_threshold: Threshold::Uniform(0.15),
            contrast_threshold_off: Threshold::Uniform(0.15),
            log_eps: 1e-3,
            interpolation: Interpolation::Linear,
            start_phase: StartPhase::Zero,
        }
    }
}

impl CrossingParameters {
    /// Refuses values outside of their ranges.
    pub(crate) fn check(&self, size: SensorSize) -> Result<()> {
        self.contrast_threshold.check("contrast_threshold", size)?;
        self.contrast_threshold_off.check("contrast_threshold_off", size)?;
        check_log_eps(self.log_eps)
    }

    /// The thresholds of a pixel.
    #[inline]
    pub(crate) fn thresholds(&self, pixel: usize) -> Thresholds {
        Thresholds { on: self.contrast_threshold.at(pixel), off: self.contrast_threshold_off.at(pixel) }
    }

    /// The reference of a pixel at the first frame, where its log intensity is this.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(crate) fn first_reference(&self, log_intensity: f64, pixel: usize, seed: u64) -> Level {
        let base = self.start_phase.base(log_intensity, pixel as u32, self.thresholds(pixel), seed);
        Level { base, on: 0, off: 0 }
    }

    /// Do all pixels have the same thresholds?
    pub(crate) fn is_uniform(&self) -> bool {
        matches!(
            (&self.contrast_threshold, &self.contrast_threshold_off),
            (Threshold::Uniform(_), Threshold::Uniform(_))
        )
    }

    /// The least threshold of any pixel.
    pub(crate) fn least_threshold(&self) -> f64 {
        self.contrast_threshold.least().min(self.contrast_threshold_off.least())
    }
}
