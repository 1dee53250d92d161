//! An exponential for bounds, which need no more than nine digits.

/// 1.5 * 2^52: adding it rounds to an integer, in the low bits; subtracting it again gives that as a float.
pub(crate) const ROUND: f64 = 6_755_399_441_055_744.0;

/// The exponential within 1e-9, for levels from -700 to 700 and clamped to that beyond, without branches.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(crate) fn exp(x: f64) -> f64 {
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

    #[test]
    fn the_exponential_is_good_enough_for_the_margin() {
        for i in -70_000..70_000i32 {
            let x = f64::from(i) * 0.01;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-9, "{x}");
        }
    }
}
