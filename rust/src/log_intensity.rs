//! Log intensity, the signal that an event camera's comparators see.

use multiversion::multiversion;

use crate::error::{Error, Result};
use crate::event::SensorSize;

/// Computes `L = ln(luma + log_eps)` in float64, within 1 ulp of the exact logarithm of the float64 sum.
///
/// A fixed sequence of IEEE additions, multiplications and one division, without fused operations: the same to the last
/// bit on every processor and in every vector width. The C library's logarithm is not, since it picks another at run
/// time where fused multiply-add exists.
#[must_use]
pub fn log_intensity(luma: f32, log_eps: f64) -> f64 {
    ln(f64::from(luma) + log_eps)
}

/// Computes [`log_intensity`] of many pixels, in vector registers.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn log_intensities(luma: &[f32], log_eps: f64, logs: &mut [f64]) {
    for (log, &y) in logs.iter_mut().zip(luma) {
        *log = ln(f64::from(y) + log_eps);
    }
}

/// Returns the natural logarithm of a positive normal number, below 1 ulp.
///
/// The scheme and coefficients of Sun's fdlibm (`e_log`): x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)), and
/// ln(1 + f) = f - f^2 / 2 + s (f^2 / 2 + R) with s = f / (2 + f) and R a polynomial in s^2. Without branches, so that
/// loops over it become vector code.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its callers' loops")]
#[allow(clippy::many_single_char_names, clippy::excessive_precision, reason = "as in fdlibm")]
pub(crate) fn ln(x: f64) -> f64 {
    const LN2_HIGH: f64 = 6.931_471_803_691_238_164_90e-1; // 32 bits: exact times k
    const LN2_LOW: f64 = 1.908_214_929_270_587_700_02e-10;
    const R: [f64; 7] = [
        6.666_666_666_666_735_130e-1,
        3.999_999_999_940_941_908e-1,
        2.857_142_874_366_239_149e-1,
        2.222_219_843_214_978_396e-1,
        1.818_357_216_161_805_012e-1,
        1.531_383_769_920_937_332e-1,
        1.479_819_860_511_658_591e-1,
    ];
    const SQRT_HALF: u64 = 0x3fe6_a09e_0000_0000;
    const ONE: u64 = 0x3ff0_0000_0000_0000;
    const MANTISSA: u64 = (1 << 52) - 1;
    const TWO_52: u64 = 0x4330_0000_0000_0000;

    let shifted = x.to_bits() + (ONE - SQRT_HALF);
    // The biased exponent as a float, by placing it into the mantissa of 2^52: vector units lack the conversion.
    let k = f64::from_bits(TWO_52 | (shifted >> 52)) - (4_503_599_627_370_496.0 + 1023.0);
    let f = f64::from_bits((shifted & MANTISSA) + SQRT_HALF) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w * (R[1] + w * (R[3] + w * R[5]));
    let odd = z * (R[0] + w * (R[2] + w * (R[4] + w * R[6])));
    let half_square = 0.5 * f * f;
    s * (half_square + (even + odd)) + k * LN2_LOW - half_square + f + k * LN2_HIGH
}

/// Computes [`log_intensity`] of a whole frame, checked: the frame may hold neither NaN nor infinities nor negative
/// luma.
///
/// # Errors
/// [`Error::Argument`] naming the first bad pixel, or an unusable `log_eps`.
pub fn log_intensity_frame(luma: &[f32], size: SensorSize, log_eps: f64) -> Result<Vec<f64>> {
    check_log_eps(log_eps)?;
    check_luma(luma, size, None)?;
    let mut logs = vec![0.0; luma.len()];
    log_intensities(luma, log_eps, &mut logs);
    Ok(logs)
}

/// Refuses a dark level that would make the logarithm of a black pixel infinite or inexact.
pub(crate) fn check_log_eps(log_eps: f64) -> Result<()> {
    if (1e-300..=1e300).contains(&log_eps) {
        return Ok(());
    }
    Err(Error::Argument(format!("log_eps (the dark level, in units of luma) must lie in 1e-300..1e300, got {log_eps}")))
}

/// What luma must be.
pub(crate) const LUMA_RULE: &str = "luma must be finite and >= 0";

/// Refuses luma that is NaN, infinite or negative, with time and pixel.
pub(crate) fn check_luma(luma: &[f32], size: SensorSize, t_us: Option<i64>) -> Result<()> {
    if all_luma_valid(luma) {
        return Ok(());
    }
    let bad = luma.iter().position(|y| !(0.0..=f32::MAX).contains(y));
    check_none(bad, size, t_us, |i| format!("{LUMA_RULE}, got {}", luma[i]))
}

/// Returns whether every value is finite and >= 0. Without an early exit, so that it becomes vector code.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn all_luma_valid(luma: &[f32]) -> bool {
    luma.iter().fold(true, |valid, y| valid & (0.0..=f32::MAX).contains(y))
}

/// Returns the error for a frame's first bad pixel, if there is one.
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn vectors_and_scalars_agree_to_the_bit() {
        let luma: Vec<f32> = (0..4099u16).map(|i| (f32::from(i) * 0.05 - 100.0).exp2()).collect();
        let mut logs = vec![0.0; luma.len()];
        log_intensities(&luma, 1e-3, &mut logs);
        for (y, log) in luma.iter().zip(logs) {
            assert_eq!(log.to_bits(), log_intensity(*y, 1e-3).to_bits());
        }
    }

    proptest! {
        /// The musl port in the libm crate is another writing of the same scheme.
        #[test]
        fn it_is_the_logarithm_of_the_libm_crate(x in prop::num::f64::POSITIVE | prop::num::f64::NORMAL) {
            prop_assert_eq!(ln(x.abs()).to_bits(), libm::log(x.abs()).to_bits());
        }
    }
}
