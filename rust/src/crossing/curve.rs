//! How log intensity runs between two samples: in monotone pieces, each of which tells when it reaches a level.
//!
//! The rule of [`super::pixel`] is written for any such curve. There are straight lines ([`super::line`]), cubics
//! ([`super::cubic`]) and the outputs of low-passes ([`super::effects`]). Cubics and low-passes have no closed form for
//! their crossings, so they share the search for roots and ticks that is here.
//!
//! What must not break: pieces are monotone and come in order, and the last one ends exactly at the interval's end
//! sample. Whether a level was reached depends on where a piece ends and on nothing else.

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

/// How closely [`bracketed_newton`] looks.
#[derive(Clone, Copy)]
pub(crate) struct Search {
    steps: u32,
    within: f64,
}

/// Enough to guess a tick, which is checked afterwards.
pub(crate) const ROUGH: Search = Search { steps: 6, within: 1e-9 };

/// Converges to the last bits.
pub(crate) const FINE: Search = Search { steps: 119, within: 1e-16 };

/// Returns about where a monotone piece has a value, by Newton's steps within a bracket that each step narrows.
///
/// `missing(s)` gives the value less the piece's value at `s`, and the piece's slope there. `fraction` is where the value lies
/// between the piece's first (0) and last (1) value; the search begins there. `rises` tells whether the piece rises.
#[inline]
pub(crate) fn bracketed_newton(
    (mut low, mut high): (f64, f64),
    fraction: f64,
    rises: bool,
    search: Search,
    missing: impl Fn(f64) -> (f64, f64),
) -> f64 {
    // A level that was passed before the piece began leaves no fraction to begin with.
    let mut s = if fraction > 0.0 && fraction < 1.0 { low + fraction * (high - low) } else { 0.5 * (low + high) };
    let mut last_move = f64::INFINITY;
    for step in 1..=search.steps {
        let (missing, slope) = missing(s);
        if (missing > 0.0) == rises {
            low = s;
        } else {
            high = s;
        }
        let next = s + missing / slope;
        let moved = (next - s).abs();
        // Near enough, or so near that rounding moves it no less than the step before did.
        if moved < search.within || (moved < 1e-9 && moved >= last_move) {
            return next.clamp(low, high);
        }
        // Where Newton creeps along a bend, the bracket is halved now and then.
        let newton = next > low && next < high && (step % 8 != 0 || moved < 1e-9);
        s = if newton { next } else { 0.5 * (low + high) };
        last_move = moved;
    }
    s
}

/// The first tick of a piece, over these fractions of an interval of `ticks`, at which its value in float64 has reached a
/// level: the one after `likely`, a fraction, else by bisection over the ticks of the piece.
///
/// `sign` is that of the value at a fraction less the level; the curve goes `up` or down.
#[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
#[allow(clippy::cast_possible_truncation, reason = "within 0..=ticks")]
pub(crate) fn first_tick_on(
    (from, to): (f64, f64),
    ticks: f64,
    likely: f64,
    up: bool,
    sign: impl Fn(f64) -> i32,
) -> i64 {
    let after = (from * ticks).floor() as i64;
    let at = ((to * ticks).ceil() as i64).max(after + 1);
    let reached = |k: i64| {
        let sign = sign(k as f64 / ticks);
        if up { sign >= 0 } else { sign <= 0 }
    };
    let likely = (likely * ticks).ceil() as i64;
    if likely > after
        && likely <= at
        && (likely == at || reached(likely))
        && (likely - 1 == after || !reached(likely - 1))
    {
        return likely;
    }
    first_true(after, at, reached)
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
