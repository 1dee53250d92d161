//! Exact signs of sums of float64 products, where rounding must not decide.
//!
//! A sum is kept as an expansion: floats that do not overlap, smallest first, whose exact sum is the value
//! (J. R. Shewchuk, Adaptive precision floating-point arithmetic, 1997, sections 2.2 to 2.4). No operation here rounds
//! as long as nothing overflows, which the callers' ranges rule out; nothing underflows, since every factor besides
//! the given floats is an integer.

/// Enough for everything summed in this crate: each added float makes an expansion longer by at most one.
const CAPACITY: usize = 24;

/// An exact sum of floats.
#[derive(Clone, Copy)]
pub(crate) struct Expansion {
    terms: [f64; CAPACITY],
    len: usize,
}

impl Expansion {
    /// Returns the expansion of one float.
    pub(crate) fn new(value: f64) -> Self {
        Self { terms: [0.0; CAPACITY], len: 0 }.plus(value)
    }

    /// Returns `self + value`, exactly (Shewchuk's grow-expansion, with zeros left out).
    #[must_use]
    pub(crate) fn plus(mut self, value: f64) -> Self {
        self.add(value);
        self
    }

    /// Returns `self + a * b`, exactly.
    #[must_use]
    pub(crate) fn plus_product(mut self, a: f64, b: f64) -> Self {
        self.add_product(a, b);
        self
    }

    /// Returns `self * factor`, exactly.
    #[must_use]
    pub(crate) fn times(&self, factor: f64) -> Self {
        let mut product = Self { terms: [0.0; CAPACITY], len: 0 };
        for &term in &self.terms[..self.len] {
            product.add_product(term, factor);
        }
        product
    }

    fn add(&mut self, value: f64) {
        let (mut carry, mut kept) = (value, 0);
        for i in 0..self.len {
            let (high, low) = two_sum(carry, self.terms[i]);
            if low != 0.0 {
                self.terms[kept] = low;
                kept += 1;
            }
            carry = high;
        }
        if carry != 0.0 {
            self.terms[kept] = carry;
            kept += 1;
        }
        self.len = kept;
    }

    fn add_product(&mut self, a: f64, b: f64) {
        let product = a * b;
        self.add(a.mul_add(b, -product));
        self.add(product);
    }

    /// Returns the sign of the exact value: -1, 0 or 1, that of its largest part.
    pub(crate) fn sign(&self) -> i32 {
        match self.terms[..self.len].last() {
            Some(&largest) if largest > 0.0 => 1,
            Some(_) => -1,
            None => 0,
        }
    }

    /// Returns the value, rounded to a float within one ulp.
    pub(crate) fn value(&self) -> f64 {
        self.terms[..self.len].iter().sum()
    }
}

/// Returns (a + b rounded, the rounding error), exactly (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_part = sum - a;
    let a_part = sum - b_part;
    (sum, (a - a_part) + (b - b_part))
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "below 2^53")]
mod tests {
    use super::Expansion;
    use proptest::prelude::*;

    #[test]
    fn differences_far_below_an_ulp_keep_their_sign() {
        let tiny = f64::EPSILON * 2f64.powi(-60);
        assert_eq!(Expansion::new(1.0).plus(tiny).plus(-1.0).sign(), 1);
        assert_eq!(Expansion::new(1.0).plus(-tiny).plus(-1.0).sign(), -1);
        assert_eq!(Expansion::new(1.0).plus(tiny).plus(-1.0).plus(-tiny).sign(), 0);
        // 0.1 is not 1/10: ten of them miss 1 by 2^-54, which float64 arithmetic rounds away.
        assert_eq!(Expansion::new(-1.0).plus_product(10.0, 0.1).sign(), 1);
    }

    proptest! {
        /// Against integer arithmetic: floats k / 2^20 with products that need up to 106 bits.
        #[test]
        fn signs_agree_with_integers(terms in prop::collection::vec((-(1i64 << 52)..1i64 << 52, -(1i64 << 52)..1i64 << 52), 1..8), nudge in -2i64..3) {
            let unit = 2f64.powi(-20);
            let mut exact: i128 = i128::from(nudge);
            let mut sum = Expansion::new(nudge as f64 * unit * unit);
            for &(a, b) in &terms {
                exact += i128::from(a) * i128::from(b);
                sum = sum.plus_product(a as f64 * unit, b as f64 * unit);
            }
            // Take the bulk away again, so that the sign hangs on the nudge.
            for &(a, b) in &terms {
                exact -= i128::from(a) * i128::from(b);
                sum = sum.plus_product(-(a as f64) * unit, b as f64 * unit);
                prop_assert_eq!(i128::from(sum.sign()), exact.signum());
            }
            prop_assert_eq!(i128::from(sum.times(3.0).sign()), exact.signum());
        }
    }
}
