//! Numbers with or without a rate: shading of glossy and bumpy surfaces is written once, and serves for luma and its rate.
//!
//! A [`Rated`] carries its derivative by time along (forward-mode differentiation), so rates are those of the very
//! steps that compute luma, for the same surfaces and the same shadows.
//!
//! Functions of triples name each component, because the standard library's functions of arrays are often not compiled
//! into what calls them, and then nothing becomes vector code.
//!
//! What must not break: values of [`Rated`] have the bits of the same steps in float64.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::render::geometry::vector::Vector;

/// A float64, or one that carries its rate.
pub(crate) trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + std::fmt::Debug
{
    /// Whether it carries a rate.
    const RATED: bool;

    fn new(value: f64, rate: f64) -> Self;
    fn value(self) -> f64;
    fn rate(self) -> f64;
    fn sqrt(self) -> Self;
    fn exp(self) -> Self;

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn constant(value: f64) -> Self {
        Self::new(value, 0.0)
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn scaled(self, by: f64) -> Self {
        self * Self::constant(by)
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn squared(self) -> Self {
        self * self
    }

    /// Returns the larger of it and a constant, which has no rate.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn at_least(self, least: f64) -> Self {
        if self.value() > least { self } else { Self::constant(least) }
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn at_most(self, most: f64) -> Self {
        if self.value() < most { self } else { Self::constant(most) }
    }
}

/// Makes numbers of a type of float: plain ones, and ones that carry their rate.
macro_rules! numbers {
    ($float:ty, $rated:ident, $exp:path, $about:literal) => {
        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        #[allow(clippy::cast_possible_truncation, clippy::cast_lossless, reason = "rounded to the type of float")]
        impl Number for $float {
            const RATED: bool = false;

            #[inline(always)]
            fn new(value: f64, _: f64) -> Self {
                value as $float
            }

            #[inline(always)]
            fn value(self) -> f64 {
                self as f64
            }

            #[inline(always)]
            fn rate(self) -> f64 {
                0.0
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }

            fn exp(self) -> Self {
                $exp(self)
            }
        }

        #[doc = $about]
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(crate) struct $rated {
            value: $float,
            rate: $float,
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        impl Add for $rated {
            type Output = Self;

            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self { value: self.value + other.value, rate: self.rate + other.rate }
            }
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        impl Sub for $rated {
            type Output = Self;

            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self { value: self.value - other.value, rate: self.rate - other.rate }
            }
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        impl Mul for $rated {
            type Output = Self;

            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                Self { value: self.value * other.value, rate: self.rate * other.value + self.value * other.rate }
            }
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        impl Div for $rated {
            type Output = Self;

            #[inline(always)]
            fn div(self, other: Self) -> Self {
                let value = self.value / other.value;
                Self { value, rate: (self.rate - value * other.rate) / other.value }
            }
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        impl Neg for $rated {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                Self { value: -self.value, rate: -self.rate }
            }
        }

        #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
        #[allow(clippy::cast_possible_truncation, clippy::cast_lossless, reason = "rounded to the type of float")]
        impl Number for $rated {
            const RATED: bool = true;

            #[inline(always)]
            fn new(value: f64, rate: f64) -> Self {
                Self { value: value as $float, rate: rate as $float }
            }

            #[inline(always)]
            fn value(self) -> f64 {
                self.value as f64
            }

            #[inline(always)]
            fn rate(self) -> f64 {
                self.rate as f64
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                let value = self.value.sqrt();
                Self { value, rate: if value > 0.0 { 0.5 * self.rate / value } else { 0.0 } }
            }

            fn exp(self) -> Self {
                let value = $exp(self.value);
                Self { value, rate: value * self.rate }
            }
        }
    };
}

numbers!(f64, Rated, libm::exp, "A value and its rate per second.");
numbers!(f32, RatedSingle, libm::expf, "The same in float32.");

/// A vector, or a colour (red, green, blue).
pub(crate) type Triple<N> = [N; 3];

/// Returns the fifth power of a number.
pub(crate) fn fifth_power<N: Number>(x: N) -> N {
    let squared = x.squared();
    squared.squared() * x
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn constant<N: Number>(vector: Vector) -> Triple<N> {
    [N::constant(vector[0]), N::constant(vector[1]), N::constant(vector[2])]
}

/// Joins a vector and its rate.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn rated<N: Number>(vector: Vector, rate: Vector) -> Triple<N> {
    [N::new(vector[0], rate[0]), N::new(vector[1], rate[1]), N::new(vector[2], rate[2])]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn values<N: Number>(triple: Triple<N>) -> Vector {
    [triple[0].value(), triple[1].value(), triple[2].value()]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn dot<N: Number>(a: Triple<N>, b: Triple<N>) -> N {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn cross<N: Number>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn add<N: Number>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn sub<N: Number>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns a function of each channel of a colour.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn each<N: Number>(a: Triple<N>, function: impl Fn(N) -> N) -> Triple<N> {
    [function(a[0]), function(a[1]), function(a[2])]
}

/// Returns the product of two colours, channel by channel.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn times<N: Number>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn scale<N: Number>(a: Triple<N>, by: N) -> Triple<N> {
    [a[0] * by, a[1] * by, a[2] * by]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn negated<N: Number>(a: Triple<N>) -> Triple<N> {
    [-a[0], -a[1], -a[2]]
}

/// Returns a vector of length 1; one without length stays as it is.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn unit<N: Number>(a: Triple<N>) -> Triple<N> {
    let squared = dot(a, a);
    if squared.value() > 0.0 { scale(a, N::constant(1.0) / squared.sqrt()) } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes every operation through one formula.
    fn formula<N: Number>(x: N, y: N) -> N {
        let root = (x * y + x.squared()).sqrt();
        ((-x).exp() - y / root).scaled(3.0) + x.at_least(0.5) * y.at_most(0.5) + N::constant(2.0)
    }

    #[test]
    fn rates_are_derivatives_and_values_keep_their_bits() {
        for (x, y) in [(0.3, 0.2), (0.7, 0.9), (1.4, 0.1), (2.0, 3.0)] {
            let (dx, dy, h) = (0.6, -1.1, 1e-6);
            let single = formula(RatedSingle::new(x, dx), RatedSingle::new(y, dy));
            let both = formula(Rated::new(x, dx), Rated::new(y, dy));
            let close = |a: f64, b: f64| (a - b).abs() < 1e-4 * (1.0 + b.abs());
            assert!(close(single.value(), both.value()) && close(single.rate(), both.rate()), "{single:?} {both:?}");
            assert_eq!(single.value(), formula(f32::new(x, 0.0), f32::new(y, 0.0)).value());
            assert_eq!(both.value().to_bits(), formula(x, y).to_bits());
            let difference = (formula(x + h * dx, y + h * dy) - formula(x - h * dx, y - h * dy)) / (2.0 * h);
            assert!((both.rate() - difference).abs() < 1e-6 * (1.0 + difference.abs()), "{both:?} {difference}");
        }
        assert_eq!(Rated::new(0.0, 3.0).sqrt(), Rated::new(0.0, 0.0));
    }

    #[test]
    fn vectors_follow_their_definitions() {
        let (a, b) = ([1.0, 2.0, 2.0], [0.5, -1.0, 3.0]);
        assert_eq!(dot(a, b), 4.5);
        assert_eq!(cross(a, b), [8.0, -2.0, -2.0]);
        assert_eq!(unit(a).map(|x| 3.0 * x), a);
        assert_eq!(unit([0.0; 3]), [0.0; 3]);
        assert_eq!((add(a, b), sub(a, b)), ([1.5, 1.0, 5.0], [0.5, 3.0, -1.0]));
        assert_eq!((times(a, b), scale(a, 2.0), negated(b)), ([0.5, -2.0, 6.0], [2.0, 4.0, 4.0], [-0.5, 1.0, -3.0]));
    }
}
