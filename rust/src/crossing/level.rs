//! Levels of a pixel: points of the grid `B + n_on C_on - n_off C_off`, compared without rounding error.
//!
//! A level is kept as the numbers that define it, `B` and two counters, never as its value. So nothing drifts, however
//! long a pixel runs. A comparison is made in floats first, with a bound of their error. Exact expansions
//! ([`crate::exact`]) are slower, so they are used only where the bound cannot tell.
//!
//! What must not break:
//! - The bound of [`Level::approximate`] covers all of its roundings. If it were too small, some decisions would be
//!   wrong.
//! - A return to the first value has no error at all. It is a tie that real signals meet.

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
    pub(crate) on: u32,
    /// `n_off`: steps down.
    pub(crate) off: u32,
}

impl Level {
    /// The next level above.
    pub(crate) fn up(self) -> Self {
        Self { on: self.on + 1, ..self }
    }

    /// The next level below.
    pub(crate) fn down(self) -> Self {
        Self { off: self.off + 1, ..self }
    }

    /// The exact value.
    pub(crate) fn exact(self, c: Thresholds) -> Expansion {
        Expansion::new(self.base).plus_product(f64::from(self.on), c.on).plus_product(-f64::from(self.off), c.off)
    }

    /// (value, bound of its error): enough to decide all but near-ties.
    #[inline]
    pub(crate) fn approximate(self, c: Thresholds) -> (f64, f64) {
        if self.on == self.off && c.on.total_cmp(&c.off).is_eq() {
            return (self.base, 0.0); // back at the first value, a tie that real signals do meet
        }
        let up = f64::from(self.on) * c.on;
        let down = f64::from(self.off) * c.off;
        // Two products, a difference and a sum, each within half an ulp of a result no larger than the magnitude.
        let magnitude = self.base.abs() + up + down;
        (self.base + (up - down), 4.0 * f64::EPSILON * magnitude)
    }

    /// The value within 1e-9.
    pub(crate) fn value(self, c: Thresholds) -> f64 {
        match self.approximate(c) {
            (value, error) if error < 1e-9 => value,
            _ => self.exact(c).value(),
        }
    }

    /// The sign of `log_intensity - level`, exactly.
    #[inline]
    pub(crate) fn sign_of_excess(self, log_intensity: f64, c: Thresholds) -> i32 {
        let (value, error) = self.approximate(c);
        let excess = log_intensity - value;
        // The subtraction rounds monotonically, so it cannot carry a smaller excess past the bound.
        if excess > error {
            1
        } else if excess < -error {
            -1
        } else if error > 0.0 {
            -self.exact(c).plus(-log_intensity).sign()
        } else {
            0
        }
    }
}
