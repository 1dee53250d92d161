//! The output of a first-order low-pass whose input is a straight line: the curve, its monotone pieces and its
//! crossings.
//!
//! The curve is in closed form, so that the result does not depend on a step size. What [`super::two_poles`] needs as
//! well is here: responses, and the pieces of such curves.
//!
//! What must not break: the curve turns at most once and its pieces are monotone. The output at an interval's end is
//! that at the start of the next one, to the bit.

use super::parameters::PhotoreceptorBandwidth;
use crate::crossing::curve::{Curve, FINE, Piece, ROUGH, Search, Timed, bracketed_newton, first_tick_on};
use crate::crossing::exponential::{exp_m1, exp_precise};
use crate::crossing::level::{Level, Thresholds};
use crate::log_intensity::ln;

impl PhotoreceptorBandwidth {
    /// The number of time constants in an interval of `ticks` microseconds, for a single low-pass: 2 pi f T.
    ///
    /// f is the corner frequency of the source follower, or of the photoreceptor at the mean of the log intensities
    /// `from` and `to` at the interval's ends.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
    pub(crate) fn decay(&self, from: f64, to: f64, ticks: f64) -> f64 {
        // One of the two is infinite.
        let corner_hz = (self.hz * exp_precise(0.5 * (from + to))).min(self.source_follower_hz);
        time_constants(corner_hz, ticks)
    }

    /// The time constants of the photoreceptor, if the source follower is a second low-pass.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
    pub(crate) fn photoreceptor_decay(&self, from: f64, to: f64, ticks: f64) -> f64 {
        time_constants(self.hz * exp_precise(0.5 * (from + to)), ticks).min(MOST_OF_TWO)
    }

    /// The time constants of the source follower, if it is a second low-pass.
    pub(crate) fn follower_decay(&self, ticks: f64) -> f64 {
        time_constants(self.source_follower_hz, ticks).min(MOST_OF_TWO)
    }
}

/// The most time constants in an interval for each of two low-passes. A faster one is treated as this fast, which delays it
/// by 1e-12 of the interval. The limit keeps the sign of the second derivative right through all rounding.
const MOST_OF_TWO: f64 = 1e12;

/// 2 pi f T, finite.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
fn time_constants(corner_hz: f64, ticks: f64) -> f64 {
    (std::f64::consts::TAU * 1e-6 * corner_hz * ticks).min(f64::MAX)
}

/// The response to a unit step `z` time constants after it: 1 - exp(-z).
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(super) fn step_response(z: f64) -> f64 {
    -exp_m1(-z)
}

/// The response at the share `s` of an interval of `z` time constants to a ramp over that interval: s - (1 - exp(-z s)) / z,
/// `step` being the response to a step.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(super) fn ramp_response(z: f64, s: f64, step: f64) -> f64 {
    // Below, the difference cancels, and the series' next term is z^3 s^4 / 24.
    let series = z * s * s * (0.5 - z * s / 6.0);
    if z < 1e-5 { series } else { s - step / z }
}

/// The low-pass's output at the interval's end: it starts at `output`, its input runs from `from` to `to`.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(crate) fn filter(output: f64, from: f64, to: f64, z: f64) -> f64 {
    let step = step_response(z);
    output + (from - output) * step + (to - from) * ramp_response(z, 1.0, step)
}

/// The low-pass's output plus a straight drift, over an interval.
///
/// v(s) = start + gap (1 - exp(-z s)) + change (s - (1 - exp(-z s)) / z) + drift s, s from 0 to 1. It turns at most once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filtered {
    pub(crate) start: f64,
    /// The output at the end. The next interval has the same bits as its start.
    pub(crate) end: f64,
    /// Input minus output at the start.
    pub(crate) gap: f64,
    /// The input's change over the interval.
    pub(crate) change: f64,
    /// The drift over the interval.
    pub(crate) drift: f64,
    /// Time constants in the interval.
    pub(crate) decay: f64,
    pub(crate) ticks: i64,
}

/// A curve over the shares from 0 to 1 of an interval that is known with its derivative.
pub(super) trait Smooth: Copy {
    /// Its value and its derivative at the share `s` of the interval.
    fn at_and_slope(&self, s: f64) -> (f64, f64);

    /// Its value at the interval's end, as the next interval will have it as start.
    fn end(&self) -> f64;

    fn ticks(&self) -> i64;

    fn at(&self, s: f64) -> f64 {
        self.at_and_slope(s).0
    }
}

impl Smooth for Filtered {
    #[inline]
    fn at_and_slope(&self, s: f64) -> (f64, f64) {
        let step = step_response(self.decay * s);
        let value = self.start + self.gap * step + self.change * ramp_response(self.decay, s, step) + self.drift * s;
        (value, self.decay * self.gap * (1.0 - step) + self.change * step + self.drift)
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn ticks(&self) -> i64 {
        self.ticks
    }
}

impl Filtered {
    /// Where it turns, strictly inside of (0, 1).
    fn turn(&self) -> Option<f64> {
        let final_slope = self.change + self.drift; // what the slope tends to
        let rest = self.change - self.decay * self.gap; // the slope is final_slope - rest exp(-z s)
        let ratio = rest / final_slope;
        if !(ratio > 1.0 && ratio.is_finite()) {
            return None;
        }
        Some(ln(ratio) / self.decay).filter(|s| 0.0 < *s && *s < 1.0)
    }
}

impl Curve for Filtered {
    type Piece = SmoothPiece<Filtered>;

    fn pieces(&self) -> impl Iterator<Item = Self::Piece> {
        between_turns(*self, self.turn().into_iter())
    }
}

/// A monotone piece of a curve.
pub(crate) struct SmoothPiece<C> {
    pub(super) curve: C,
    pub(super) from: f64,
    pub(super) to: f64,
}

/// The pieces of a curve that turns at these shares of the interval, in their order.
pub(super) fn between_turns<C: Smooth>(
    curve: C,
    turns: impl Iterator<Item = f64>,
) -> impl Iterator<Item = SmoothPiece<C>> {
    let mut from = 0.0;
    turns.chain([1.0]).map(move |to| SmoothPiece { curve, from: std::mem::replace(&mut from, to), to })
}

#[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
impl<C: Smooth> Piece for SmoothPiece<C> {
    fn end(&self) -> f64 {
        if self.to < 1.0 { self.curve.at(self.to) } else { self.curve.end() }
    }

    fn first_tick(&self, level: Level, up: bool, c: Thresholds) -> i64 {
        let likely = self.near(level, up, c, ROUGH);
        first_tick_on((self.from, self.to), self.curve.ticks() as f64, likely, up, |s| {
            level.sign_of_excess(self.curve.at(s), c)
        })
    }
}

#[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
impl<C: Smooth> Timed for SmoothPiece<C> {
    fn finish(&self) -> f64 {
        self.to * self.curve.ticks() as f64
    }

    fn value(&self, at: f64) -> f64 {
        self.curve.at(at / self.curve.ticks() as f64)
    }

    fn moment(&self, level: Level, up: bool, c: Thresholds) -> f64 {
        self.near(level, up, c, FINE) * self.curve.ticks() as f64
    }
}

impl<C: Smooth> SmoothPiece<C> {
    fn near(&self, level: Level, up: bool, c: Thresholds, search: Search) -> f64 {
        let value = level.approximate(c).0;
        let missing = |s| {
            let (at, slope) = self.curve.at_and_slope(s);
            (value - at, slope)
        };
        let first = self.curve.at(self.from);
        let fraction = (value - first) / (self.end() - first);
        bracketed_newton((self.from, self.to), fraction, up, search, missing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against the differential equation dy/ds = z (x - y), solved in many small steps (RK4).
        #[test]
        fn it_solves_the_equation(output in -3.0f64..3.0, from in -3.0f64..3.0, to in -3.0f64..3.0, exponent in -8.0f64..2.0) {
            let z = 10f64.powf(exponent);
            let steps = 4000;
            let h = 1.0 / f64::from(steps);
            let slope = |s: f64, y: f64| z * (from + (to - from) * s - y);
            let mut y = output;
            for i in 0..steps {
                let s = f64::from(i) * h;
                let a = slope(s, y);
                let b = slope(s + h / 2.0, y + h / 2.0 * a);
                let c = slope(s + h / 2.0, y + h / 2.0 * b);
                let d = slope(s + h, y + h * c);
                y += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
            }
            prop_assert!((filter(output, from, to, z) - y).abs() < 1e-9);
        }

        /// Pieces meet, are monotone, and end where the next interval begins.
        #[test]
        fn pieces_are_monotone(gap in -3.0f64..3.0, change in -3.0f64..3.0, drift in -0.1f64..0.1, exponent in -6.0f64..2.0) {
            let z = 10f64.powf(exponent);
            let end = filter(0.0, gap, gap + change, z) + drift;
            let curve = Filtered { start: 0.0, end, gap, change, drift, decay: z, ticks: 1000 };
            prop_assert!((curve.at(1.0) - end).abs() < 1e-12);
            for piece in curve.pieces() {
                let values: Vec<f64> = (0..=50u32).map(|i| curve.at(piece.from + (piece.to - piece.from) * f64::from(i) / 50.0)).collect();
                let rises = piece.end() >= values[0];
                for pair in values.windows(2) {
                    let step = pair[1] - pair[0];
                    prop_assert!(if rises { step >= -1e-12 } else { step <= 1e-12 }, "{}", step);
                }
            }
        }
    }
}
