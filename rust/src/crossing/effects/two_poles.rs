//! The output of two first-order low-passes in a row (photoreceptor and source follower) whose input is a straight
//! line.
//!
//! The curve is in closed form, as [`super::filtered`] is for one low-pass. All is written for the slower and the
//! faster pole, whichever comes first. The differences are arranged so that nothing cancels where both poles are alike,
//! where one is nearly infinite, or where an interval is short.
//!
//! What must not break: the curve turns at most twice. The outputs at an interval's end are those at the start of the
//! next one, to the bit.

use super::filtered::{Smooth, SmoothPiece, between_turns, ramp_response, step_response};
use crate::crossing::curve::{Curve, FINE, bracketed_newton};

/// Time constants of both low-passes in an interval: the photoreceptor's, then the source follower's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decays {
    pub(crate) first: f64,
    pub(crate) second: f64,
}

/// What two low-passes in rest make of a step and of a ramp, and each of them of a step.
struct Responses {
    first: f64,
    second: f64,
    /// The response of both to a step, its derivative, and the response of both to a ramp.
    step: f64,
    step_slope: f64,
    ramp: f64,
}

impl Decays {
    /// Responses at the share `s` of the interval.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
    fn responses(&self, s: f64) -> Responses {
        let (slow, fast) = (self.first.min(self.second), self.first.max(self.second));
        let apart = (fast - slow) * s;
        let apart_step = step_response(apart);
        // (exp(-slow s) - exp(-fast s)) / (fast - slow) is exp(-slow s) times this.
        let lag = s * if apart < 1e-8 { 1.0 - 0.5 * apart } else { apart_step / apart };
        let slow_step = step_response(slow * s);
        let left = 1.0 - slow_step;
        let fast_step = slow_step + left * apart_step;
        let step = slow_step - slow * lag * left;
        let (first, second) = if self.first <= self.second { (slow_step, fast_step) } else { (fast_step, slow_step) };
        Responses {
            first,
            second,
            step,
            step_slope: slow * ((fast * lag) * left),
            ramp: ramp_response(slow, s, slow_step) - step / fast,
        }
    }
}

/// What two low-passes come to at an interval's end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ends {
    /// Both outputs.
    pub(crate) first: f64,
    pub(crate) second: f64,
    /// Their derivatives by the share of the interval. Not computed from differences of the outputs, which are
    /// mostly rounding error where a pole is fast.
    pub(crate) first_slope: f64,
    pub(crate) second_slope: f64,
}

/// Both low-passes at the interval's end: they start at `outputs`, the input runs from `from` to `to`.
#[inline(always)]
#[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
pub(crate) fn filter_twice(outputs: (f64, f64), from: f64, to: f64, decays: Decays) -> Ends {
    let response = decays.responses(1.0);
    let (lag, gap, change) = (outputs.0 - outputs.1, from - outputs.0, to - from);
    Ends {
        first: outputs.0 + gap * response.first + change * ramp_response(decays.first, 1.0, response.first),
        second: outputs.1 + lag * response.second + gap * response.step + change * response.ramp,
        first_slope: decays.first * gap * (1.0 - response.first) + change * response.first,
        second_slope: response.slope(decays.second, lag, gap, change),
    }
}

impl Responses {
    /// The derivative of the second output, whose own decay is `second`.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "vectorised into its caller's loop")]
    fn slope(&self, second: f64, lag: f64, gap: f64, change: f64) -> f64 {
        second * lag * (1.0 - self.second) + gap * self.step_slope + change * self.step
    }
}

/// The second low-pass's output plus a straight drift, over an interval.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FilteredTwice {
    pub(crate) start: f64,
    /// The output at the end. The next interval has the same bits as its start.
    pub(crate) end: f64,
    /// First output minus second at the start.
    pub(crate) lag: f64,
    /// Input minus first output at the start.
    pub(crate) gap: f64,
    /// The input's change over the interval.
    pub(crate) change: f64,
    /// The drift over the interval.
    pub(crate) drift: f64,
    pub(crate) decays: Decays,
    pub(crate) ticks: i64,
}

impl Smooth for FilteredTwice {
    #[inline]
    fn at_and_slope(&self, s: f64) -> (f64, f64) {
        let response = self.decays.responses(s);
        let moved = self.lag * response.second + self.gap * response.step + self.change * response.ramp;
        (self.start + moved + self.drift * s, self.slope(&response))
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn ticks(&self) -> i64 {
        self.ticks
    }
}

impl FilteredTwice {
    #[inline]
    fn slope(&self, response: &Responses) -> f64 {
        response.slope(self.decays.second, self.lag, self.gap, self.change) + self.drift
    }

    /// First and second derivative at the share `s` of the interval.
    fn slope_and_bend(&self, s: f64) -> (f64, f64) {
        let (response, Decays { first, second }) = (self.decays.responses(s), self.decays);
        let slope = self.slope(&response);
        let first_slope = first * self.gap * (1.0 - response.first) + self.change * response.first;
        (slope, second * (first_slope - (slope - self.drift)))
    }

    /// Where the second derivative is zero, inside of (0, 1): it is at one place at most.
    ///
    /// Times exp(slow s) it is linear in (1 - exp(-apart s)) / apart, `apart` being fast - slow.
    fn inflection(&self) -> Option<f64> {
        let Decays { first, second } = self.decays;
        let (slow, apart) = (first.min(second), (first - second).abs());
        let at_start = first * self.gap - second * self.lag;
        // exp(-apart s) is left / growth; `left` on its own, for the digits of one that is next to zero.
        let (growth, left) = if first <= second {
            let left = slow * (self.change - slow * self.gap);
            (left - apart * at_start, left)
        } else {
            let rest = self.change - second * self.gap;
            (first * (self.change - first * self.gap), first * rest - apart * second * self.lag)
        };
        let reached = -at_start / growth;
        let s = if (apart * reached).abs() < 1e-8 {
            reached * (1.0 + 0.5 * apart * reached)
        } else if (apart * reached).abs() < 0.5 {
            -libm::log1p(-apart * reached) / apart
        } else {
            -libm::log(left / growth) / apart
        };
        Some(s).filter(|s| 0.0 < *s && *s < 1.0)
    }

    /// Where it turns, strictly inside of (0, 1): once at most on each side of its inflection.
    fn turns(&self) -> impl Iterator<Item = f64> + use<> {
        let middle = self.inflection();
        let turn = |from: f64, to: f64| {
            let (first, last) = (self.slope_and_bend(from).0, self.slope_and_bend(to).0);
            let missing = |s| {
                let (slope, bend) = self.slope_and_bend(s);
                (-slope, bend)
            };
            let turns = (first < 0.0 && last > 0.0) || (first > 0.0 && last < 0.0);
            let at = || bracketed_newton((from, to), first / (first - last), last > first, FINE, missing);
            turns.then(at).filter(|s| 0.0 < *s && *s < 1.0)
        };
        let first = turn(0.0, middle.unwrap_or(1.0));
        let second = middle.and_then(|middle| turn(middle, 1.0));
        first.into_iter().chain(second)
    }
}

impl Curve for FilteredTwice {
    type Piece = SmoothPiece<FilteredTwice>;

    fn pieces(&self) -> impl Iterator<Item = Self::Piece> {
        between_turns(*self, self.turns())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::curve::Piece;
    use crate::crossing::effects::filtered::filter;
    use proptest::prelude::*;

    /// Both outputs by many small steps (RK4) of dy/ds = z1 (x - y), dw/ds = z2 (y - w).
    fn stepped(outputs: (f64, f64), from: f64, to: f64, decays: Decays) -> (f64, f64) {
        let steps = 8000;
        let step = 1.0 / f64::from(steps);
        let slope =
            |s: f64, at: (f64, f64)| (decays.first * (from + (to - from) * s - at.0), decays.second * (at.0 - at.1));
        let add = |at: (f64, f64), by: f64, slope: (f64, f64)| (at.0 + by * slope.0, at.1 + by * slope.1);
        (0..steps).fold(outputs, |at, i| {
            let s = f64::from(i) * step;
            let begin = slope(s, at);
            let half = slope(s + step / 2.0, add(at, step / 2.0, begin));
            let again = slope(s + step / 2.0, add(at, step / 2.0, half));
            let end = slope(s + step, add(at, step, again));
            add(at, step / 6.0, add(add(begin, 2.0, half), 1.0, add(end, 2.0, again)))
        })
    }

    /// Far apart, near each other, alike.
    fn decays() -> impl Strategy<Value = Decays> {
        let apart = prop_oneof![Just(0.0), -12.0f64..-3.0, -3.0f64..2.0];
        (-8.0f64..2.0, apart, any::<bool>()).prop_map(|(exponent, apart, swap)| {
            let first = 10f64.powf(exponent);
            let second = if apart == 0.0 { first } else { (first * (1.0 + 10f64.powf(apart))).min(200.0) };
            if swap { Decays { first: second, second: first } } else { Decays { first, second } }
        })
    }

    fn curve(outputs: (f64, f64), from: f64, change: f64, drift: f64, decays: Decays) -> FilteredTwice {
        let end = filter_twice(outputs, from, from + change, decays).second + drift;
        let (start, lag, gap) = (outputs.1, outputs.0 - outputs.1, from - outputs.0);
        FilteredTwice { start, end, lag, gap, change, drift, decays, ticks: 1000 }
    }

    proptest! {
        #[test]
        fn it_solves_the_equations(y in -3.0f64..3.0, w in -3.0f64..3.0, from in -3.0f64..3.0, to in -3.0f64..3.0, decays in decays()) {
            let (got, expected) = (filter_twice((y, w), from, to, decays), stepped((y, w), from, to, decays));
            prop_assert!((got.first - expected.0).abs() < 1e-8, "{got:?} {expected:?}");
            prop_assert!((got.second - expected.1).abs() < 1e-8, "{got:?} {expected:?}");
            let slopes = (decays.first * (to - expected.0), decays.second * (expected.0 - expected.1));
            prop_assert!((got.first_slope - slopes.0).abs() < 1e-6 * (1.0 + decays.first), "{got:?} {slopes:?}");
            prop_assert!((got.second_slope - slopes.1).abs() < 1e-6 * (1.0 + decays.second), "{got:?} {slopes:?}");
        }

        /// One that follows at once changes nothing, whichever of the two it is.
        #[test]
        fn a_fast_pole_is_none(y in -3.0f64..3.0, from in -3.0f64..3.0, to in -3.0f64..3.0, exponent in -8.0f64..2.0) {
            let z = 10f64.powf(exponent);
            let alone = filter(y, from, to, z);
            let follower = filter_twice((y, y), from, to, Decays { first: z, second: 1e300 });
            prop_assert!((follower.second - alone).abs() < 1e-14);
            let receptor = filter_twice((from, y), from, to, Decays { first: f64::MAX, second: z });
            prop_assert!((receptor.second - alone).abs() < 1e-14 && (receptor.first - to).abs() < 1e-14);
        }

        /// Two halves of an interval are the whole.
        #[test]
        fn it_does_not_depend_on_the_cut(y in -3.0f64..3.0, w in -3.0f64..3.0, from in -3.0f64..3.0, to in -3.0f64..3.0, decays in decays()) {
            let half = Decays { first: decays.first / 2.0, second: decays.second / 2.0 };
            let middle = f64::midpoint(from, to);
            let at_half = filter_twice((y, w), from, middle, half);
            let cut = filter_twice((at_half.first, at_half.second), middle, to, half);
            let whole = filter_twice((y, w), from, to, decays);
            prop_assert!((cut.first - whole.first).abs() < 1e-13 && (cut.second - whole.second).abs() < 1e-13);
        }

        /// Pieces meet, are monotone, and end where the next interval begins; their slope is the curve's derivative.
        #[test]
        fn pieces_are_monotone(lag in -3.0f64..3.0, gap in -3.0f64..3.0, change in -3.0f64..3.0, drift in -0.1f64..0.1, decays in decays()) {
            let curve = curve((lag, 0.0), lag + gap, change, drift, decays);
            prop_assert!((curve.at(1.0) - curve.end).abs() < 1e-12);
            let mut last = 0.0f64;
            for piece in curve.pieces() {
                prop_assert!(piece.from.to_bits() == last.to_bits() && piece.to > last);
                last = piece.to;
                let at = |i: u32| piece.from + (piece.to - piece.from) * f64::from(i) / 200.0;
                let values: Vec<f64> = (0..=200u32).map(|i| curve.at(at(i))).collect();
                let rises = piece.end() >= values[0];
                for pair in values.windows(2) {
                    let step = pair[1] - pair[0];
                    prop_assert!(if rises { step >= -1e-12 } else { step <= 1e-12 }, "{step}");
                }
            }
            prop_assert!(last.to_bits() == f64::to_bits(1.0));
            for s in [0.1, 0.5, 0.9] {
                let h = 1e-5 / decays.first.max(decays.second).max(1.0);
                let slope = (curve.at(s + h) - curve.at(s - h)) / (2.0 * h);
                let scale = 1.0 + curve.slope_and_bend(s).0.abs();
                prop_assert!((slope - curve.slope_and_bend(s).0).abs() < 1e-5 * scale.max(decays.second));
            }
        }
    }

    /// A curve of two turns is cut at both.
    #[test]
    fn it_may_turn_twice() {
        let curve = curve((6.0, 0.0), 0.0, 8.0, 0.0, Decays { first: 20.0, second: 10.0 });
        assert_eq!(curve.pieces().count(), 3);
    }
}
