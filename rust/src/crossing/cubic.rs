//! Cubic Hermite interpolation: log intensity from samples and slopes at both ends, in at most two monotone pieces.
//!
//! [`Cubic::new`] first limits the slopes, so that a cubic has no extremum that the samples do not support. If the
//! slopes differ in sign, the cubic turns once and is cut there. Newton's steps then find where a piece is likely to
//! reach a level. The stamp is the first tick at which the cubic's value in float64 has reached it, so it does not
//! depend on how the root was found.
//!
//! What must not break:
//! - Pieces are monotone, and the last one ends exactly at the end sample.
//! - [`super::cubic_candidates`] repeats the limits of the slopes in vector code. Change both.

use super::curve::{Curve, FINE, Piece, ROUGH, Search, Timed, bracketed_newton, first_tick_on};
use super::level::{Level, Thresholds};
use super::line::Line;

/// Slopes are cut to this, in log intensity over an interval. It is more than any change between two frames of luma.
pub(crate) const STEEPEST: f64 = 1000.0;

/// L(s) = from + s (a + s (b + s c)), s from 0 to 1 over the interval; ends at `to`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cubic {
    pub(crate) line: Line,
    coefficients: [f64; 3],
    /// Where it turns, strictly inside of (0, 1).
    turn: Option<f64>,
}

impl Cubic {
    /// The cubic with the given slopes (log intensity over the whole interval's length) at the ends of `line`.
    ///
    /// A slope makes no extremum that the samples don't support. Slopes of opposite sign do support one, and exactly one
    /// there is. Slopes of one sign promise a monotone curve: where that is the way that the samples go, they are cut to
    /// three times the chord's, which keeps the cubic monotone (Fritsch and Carlson, SIAM J. Numer. Anal. 1980);
    /// where it is not, the line is all that the samples support. A slope that is NaN or infinite means the line too,
    /// and one beyond [`STEEPEST`] is cut to that.
    pub(crate) fn new(line: Line, slope_from: f64, slope_to: f64) -> Self {
        let chord = line.to - line.from;
        let finite = slope_from.is_finite() && slope_to.is_finite();
        let (p, q) = if finite { (slope_from, slope_to) } else { (chord, chord) };
        let (mut p, mut q) = (p.clamp(-STEEPEST, STEEPEST), q.clamp(-STEEPEST, STEEPEST));
        if p * q >= 0.0 {
            let sign = chord.signum();
            let agree = chord != 0.0 && p * sign >= 0.0 && q * sign >= 0.0;
            let most = 3.0 * chord.abs();
            (p, q) = if agree { (p.clamp(-most, most), q.clamp(-most, most)) } else { (chord, chord) };
        }
        let coefficients = [p, 3.0 * chord - 2.0 * p - q, p + q - 2.0 * chord];
        let turn = if p * q < 0.0 { Some(turning_point(coefficients)) } else { None };
        Self { line, coefficients, turn: turn.filter(|s| 0.0 < *s && *s < 1.0) }
    }

    /// Log intensity at the fraction `s` of the interval.
    pub(crate) fn at(&self, s: f64) -> f64 {
        let [a, b, c] = self.coefficients;
        self.line.from + s * (a + s * (b + s * c))
    }
}

/// The root in (0, 1) of the derivative a + 2 b s + 3 c s^2, which has opposite signs at 0 and 1.
fn turning_point([a, b, c]: [f64; 3]) -> f64 {
    // The form without cancellation: q carries the sign of b, and the roots are q / 3c and a / q.
    let q = -(b + (b * b - 3.0 * a * c).max(0.0).sqrt().copysign(b));
    [a / q, q / (3.0 * c)].into_iter().find(|s| 0.0 < *s && *s < 1.0).unwrap_or(1.0)
}

impl Curve for Cubic {
    type Piece = CubicPiece;

    fn pieces(&self) -> impl Iterator<Item = CubicPiece> {
        let piece = |from: f64, to: f64| CubicPiece { cubic: *self, from, to };
        let first = self.turn.map(|turn| piece(0.0, turn));
        first.into_iter().chain([piece(self.turn.unwrap_or(0.0), 1.0)])
    }
}

/// A cubic between two points at most one of which is its turning point.
pub(crate) struct CubicPiece {
    cubic: Cubic,
    from: f64,
    to: f64,
}

impl Piece for CubicPiece {
    fn end(&self) -> f64 {
        if self.to < 1.0 { self.cubic.at(self.to) } else { self.cubic.line.to }
    }

    #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
    fn first_tick(&self, level: Level, up: bool, c: Thresholds) -> i64 {
        let likely = self.near(level.approximate(c).0, ROUGH);
        first_tick_on((self.from, self.to), self.cubic.line.ticks as f64, likely, up, |s| {
            level.sign_of_excess(self.cubic.at(s), c)
        })
    }
}

#[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
impl Timed for CubicPiece {
    fn finish(&self) -> f64 {
        self.to * self.cubic.line.ticks as f64
    }

    fn value(&self, at: f64) -> f64 {
        self.cubic.at(at / self.cubic.line.ticks as f64)
    }

    fn moment(&self, level: Level, _: bool, c: Thresholds) -> f64 {
        self.near(level.approximate(c).0, FINE) * self.cubic.line.ticks as f64
    }
}

impl CubicPiece {
    fn near(&self, value: f64, search: Search) -> f64 {
        let [a, b, c] = self.cubic.coefficients;
        let (first, last) = (self.cubic.at(self.from), self.end());
        let fraction = (value - first) / (last - first);
        bracketed_newton((self.from, self.to), fraction, last >= first, search, |s| {
            (value - self.cubic.at(s), a + s * (2.0 * b + 3.0 * c * s))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(from: f64, to: f64, slope_from: f64, slope_to: f64) -> Cubic {
        Cubic::new(Line { from, to, ticks: 1000 }, slope_from, slope_to)
    }

    #[test]
    fn equal_slopes_of_the_chord_are_the_line() {
        let curve = cubic(0.0, 1.0, 1.0, 1.0);
        assert_eq!(curve.pieces().count(), 1);
        for s in [0.0, 0.25, 0.5, 1.0] {
            assert!((curve.at(s) - s).abs() < 1e-15);
        }
    }

    #[test]
    fn slopes_of_opposite_sign_make_one_turn() {
        // A parabola: up by 1/4 and back.
        let curve = cubic(0.0, 0.0, 1.0, -1.0);
        let ends: Vec<f64> = curve.pieces().map(|piece| piece.end()).collect();
        assert_eq!(ends, [0.25, 0.0]);
        assert_eq!(curve.turn, Some(0.5));
    }

    #[test]
    fn slopes_that_the_samples_do_not_support_make_no_turn() {
        for (to, p, q) in
            [(1.0, 40.0, 50.0), (1.0, -2.0, -2.0), (0.0, 5.0, 5.0), (-1.0, 0.0, 7.0), (1.0, f64::NAN, 0.0)]
        {
            let curve = cubic(0.0, to, p, q);
            assert_eq!(curve.pieces().count(), 1, "{to} {p} {q}");
            let values: Vec<f64> = (0..=100u8).map(|i| curve.at(f64::from(i) / 100.0)).collect();
            assert!(values.windows(2).all(|w| (w[1] - w[0]) * to >= -1e-15), "{to} {p} {q}");
        }
    }

    #[test]
    fn slopes_beyond_belief_are_cut() {
        let top = |slope: f64| cubic(0.0, 0.0, slope, -slope).pieces().next().map(|piece| piece.end());
        assert_eq!(top(1e300), Some(STEEPEST / 4.0));
        assert_eq!(top(1e3), Some(STEEPEST / 4.0));
    }

    #[test]
    fn slopes_that_are_not_finite_are_the_line() {
        for (p, q) in [(f64::INFINITY, f64::NEG_INFINITY), (f64::NAN, 0.0), (3.0, f64::INFINITY)] {
            let curve = cubic(0.0, 1.0, p, q);
            assert_eq!(curve.pieces().count(), 1);
            assert!((curve.at(0.25) - 0.25).abs() < 1e-15);
        }
    }
}
