//! What the user may set.

use crate::error::{Error, Result};
use crate::log_intensity::check_log_eps;

/// Parameters of the ideal pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrossingParameters {
    /// `C_on`, in natural-log units: brighter by this much makes an ON event.
    pub contrast_threshold: f64,
    /// `C_off`, in natural-log units: darker by this much makes an OFF event.
    pub contrast_threshold_off: f64,
    /// The dark level, in units of luma: `L = ln(luma + log_eps)`.
    pub log_eps: f64,
}

impl Default for CrossingParameters {
    fn default() -> Self {
        Self { contrast_threshold: 0.15, contrast_threshold_off: 0.15, log_eps: 1e-3 }
    }
}

impl CrossingParameters {
    /// Refuses values outside of their ranges.
    pub(crate) fn check(&self) -> Result<()> {
        check_threshold("contrast_threshold", self.contrast_threshold)?;
        check_threshold("contrast_threshold_off", self.contrast_threshold_off)?;
        check_log_eps(self.log_eps)
    }
}

/// Thresholds lie in 1e-6..=1e3: below, one step of a pixel makes more events than memory holds; above, none ever.
pub(crate) fn check_threshold(name: &str, value: f64) -> Result<()> {
    if (1e-6..=1e3).contains(&value) {
        return Ok(());
    }
    Err(Error::Argument(format!("{name} must lie in 1e-6..1e3 (natural-log units), got {value}")))
}
