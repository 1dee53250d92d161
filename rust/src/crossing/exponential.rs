//! Exponentials in plain arithmetic that give the same bits on every processor: one within 1e-9 for bounds, two within
//! 2 ulp.
//!
//! The C library's exponentials differ between processors and cannot become vector code.
//!
//! What must not break: there are no branches, and the stated accuracy holds. The margin of bounds (`sample`) rests on
//! it.

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

/// exp(x) within 2 ulp, for x from -700 to 700 and clamped to that beyond, without branches.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(crate) fn exp_precise(x: f64) -> f64 {
    let (beyond_one, power) = reduced(x);
    (1.0 + beyond_one) * power
}

/// exp(x) - 1 within 2 ulp of the larger of itself and 2^n (n the nearest power), likewise. Near zero it loses no digits.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(crate) fn exp_m1(x: f64) -> f64 {
    let (beyond_one, power) = reduced(x);
    beyond_one * power + (power - 1.0)
}

/// exp(x) as (e, 2^n): exp(x) = (1 + e) 2^n with n the nearest power.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
fn reduced(x: f64) -> (f64, f64) {
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1; // 32 bits: exact times n
    const LN_2_LOW: f64 = 1.908_214_929_270_588e-10;
    // 1 / n!, n = 14 to 2; the next term is 0.35^15 / 15! = 1e-19.
    const INVERSE_FACTORIALS: [f64; 13] = [
        1.0 / 87_178_291_200.0,
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
    ];
    let x = x.clamp(-700.0, 700.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let mut sum = 0.0;
    for coefficient in INVERSE_FACTORIALS {
        sum = (sum + coefficient) * r;
    }
    (r + sum * r, f64::from_bits((shifted.to_bits() << 52).wrapping_add(0x3ff0_0000_0000_0000)))
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

    #[test]
    fn the_precise_ones_keep_all_digits() {
        for i in -70_000..70_000i32 {
            for x in [f64::from(i) * 0.01, f64::from(i) * 1e-7, f64::from(i) * 1e-17] {
                let (got, expected) = (exp_precise(x), libm::exp(x));
                assert!((got / expected - 1.0).abs() <= 4.0 * f64::EPSILON, "{x}: {got} {expected}");
                let (got, expected) = (exp_m1(x), libm::expm1(x));
                assert!(
                    (got - expected).abs() <= 4.0 * f64::EPSILON * expected.abs().max(1e-290),
                    "{x}: {got} {expected}"
                );
            }
        }
    }
}
