//! How log intensity runs between two samples, in monotone pieces.

use super::level::{Level, Thresholds};

/// Log intensity over an interval: where it goes, piece by piece, and when it reaches a level on the way.
pub(crate) trait Curve {
    /// A monotone piece of it.
    type Piece: Piece;

    /// The pieces, in order; the last one ends at the interval's end sample.
    fn pieces(&self) -> impl Iterator<Item = Self::Piece>;
}

/// A monotone piece of a curve.
pub(crate) trait Piece {
    /// Log intensity at its end.
    fn end(&self) -> f64;

    /// The first tick, counted from the interval's start, at which the piece has reached `level` from below (`up`) or
    /// above. Its end lies at or beyond the level; a level that was passed before the interval began is reached at its
    /// first tick.
    fn first_tick(&self, level: Level, up: bool, c: Thresholds) -> i64;
}

/// A piece that also knows its real times: for effects whose state goes on from the crossing itself, not from its stamp.
///
/// Times are microseconds from the curve's start.
pub(crate) trait Timed: Piece {
    /// When it ends.
    fn finish(&self) -> f64;

    /// Log intensity at a time within it.
    fn value(&self, at: f64) -> f64;

    /// When it reaches `level`, which it does, from below (`up`) or above.
    fn moment(&self, level: Level, up: bool, c: Thresholds) -> f64;
}

/// The smallest k in `after + 1..=at` that is `reached`, for a predicate that stays true once it is; `at` is taken to be.
pub(crate) fn first_true(mut after: i64, mut at: i64, mut reached: impl FnMut(i64) -> bool) -> i64 {
    while at - after > 1 {
        let middle = after + (at - after) / 2;
        if reached(middle) {
            at = middle;
        } else {
            after = middle;
        }
    }
    at
}
