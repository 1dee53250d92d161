//! Levels of a pixel: points of the grid `B + n_on C_on - n_off C_off`, compared without rounding error.

use crate::exact::Expansion;

/// The two contrast thresholds, in natural-log units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Thresholds {
    pub(crate) on: f64,
    pub(crate) off: f64,
}

/// A point of the grid, kept as what defines it (never as a float), so that no path through the levels drifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Level {
    /// `B`: the log intensity at which the pixel was memorised.
    pub(crate) base: f64,
    /// `n_on`: steps up.
    pub(crate) on: u64,
    /// `n_off`: steps down.
    pub(crate) off: u64,
}

/// Counters stay below 2^53, so that they are exact as floats; at a million events a second that is 285 years.
#[allow(clippy::cast_precision_loss, reason = "below 2^53")]
fn count(n: u64) -> f64 {
    debug_assert!(n < 1 << 53);
    n as f64
}

impl Level {
    /// The exact value.
    pub(crate) fn exact(self, c: Thresholds) -> Expansion {
        Expansion::new(self.base).plus_product(count(self.on), c.on).plus_product(-count(self.off), c.off)
    }

    /// (value, bound of its error): enough to decide all but near-ties.
    pub(crate) fn approximate(self, c: Thresholds) -> (f64, f64) {
        let up = count(self.on) * c.on;
        let down = count(self.off) * c.off;
        // Two products, a difference and a sum, each within half an ulp of a result no larger than the magnitude.
        let magnitude = self.base.abs() + up + down;
        (self.base + (up - down), 4.0 * f64::EPSILON * magnitude)
    }

    /// The sign of `log_intensity - level`, exactly.
    pub(crate) fn sign_of_excess(self, log_intensity: f64, c: Thresholds) -> i32 {
        let (value, error) = self.approximate(c);
        let excess = log_intensity - value;
        // The subtraction itself rounds by at most half an ulp of its result, which cannot change its sign.
        if excess > error {
            1
        } else if excess < -error {
            -1
        } else {
            -self.exact(c).plus(-log_intensity).sign()
        }
    }
}
