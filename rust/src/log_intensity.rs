//! Log intensity, the signal that an event camera's comparators see.

use crate::error::{Error, Result};
use crate::event::SensorSize;

/// `L = ln(luma + log_eps)` in float64.
///
/// The logarithm is a fixed sequence of IEEE operations (the `libm` crate, a port of musl's, below 1 ulp), so that it
/// is the same to the last bit on every processor; the C library's is not, since it picks another at run time where
/// fused multiply-add exists.
#[must_use]
pub fn log_intensity(luma: f32, log_eps: f64) -> f64 {
    libm::log(f64::from(luma) + log_eps)
}

/// [`log_intensity`] of a whole frame, checked: the frame may hold neither NaN nor infinities nor negative luma.
///
/// # Errors
/// [`Error::Argument`] naming the first bad pixel, or an unusable `log_eps`.
pub fn log_intensity_frame(luma: &[f32], size: SensorSize, log_eps: f64) -> Result<Vec<f64>> {
    check_log_eps(log_eps)?;
    check_luma(luma, size, None)?;
    Ok(luma.iter().map(|&y| log_intensity(y, log_eps)).collect())
}

/// Refuses a dark level that would make the logarithm of a black pixel infinite.
pub(crate) fn check_log_eps(log_eps: f64) -> Result<()> {
    if log_eps.is_finite() && log_eps > 0.0 && log_eps < 1e300 {
        return Ok(());
    }
    Err(Error::Argument(format!("log_eps (the dark level, in units of luma) must be finite and > 0, got {log_eps}")))
}

/// Refuses luma that is NaN, infinite or negative, with time and pixel.
pub(crate) fn check_luma(luma: &[f32], size: SensorSize, t_us: Option<i64>) -> Result<()> {
    let bad = luma.iter().position(|y| !(y.is_finite() && *y >= 0.0));
    check_none(bad, size, t_us, |i| format!("luma must be finite and >= 0, got {}", luma[i]))
}

/// The error for a frame's first bad pixel, if there is one.
pub(crate) fn check_none(
    bad: Option<usize>,
    size: SensorSize,
    t_us: Option<i64>,
    rule: impl FnOnce(usize) -> String,
) -> Result<()> {
    let Some(index) = bad else { return Ok(()) };
    let (x, y) = size.xy(index);
    let time = t_us.map_or(String::new(), |t| format!(" of the frame at t = {t} us"));
    Err(Error::Argument(format!("{} at pixel (x, y) = ({x}, {y}){time}", rule(index))))
}
