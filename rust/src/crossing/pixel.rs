//! The crossing rule of one ideal pixel: from its reference and a curve of log intensity to its events.
//!
//! [`follow`] is the definition of the engine: slow, exact, and short enough to be read as such. Everything else in
//! this module decides the same in a faster way, or leaves the decision to it.
//!
//! A curve is taken in monotone pieces. If the end of a piece lies at or beyond the next level above or below the
//! reference, that level was reached: the reference moves there, an event is emitted, and the question is asked again.
//!
//! What must not break:
//! - Whether a level was reached depends on the counters and on where a piece ends, never on where it began. So no
//!   step, however small, passes a level unnoticed.
//! - Comparisons are exact ([`Level::sign_of_excess`]), because a rounded one could lose an event or make one twice.

use super::curve::{Curve, Piece};
use super::level::{Level, Thresholds};

/// Follows log intensity along `curve` from `start_us` on; calls `emit(t_us, on)` for each event, in order.
///
/// `reference` is the pixel's `R = B + n_on C_on - n_off C_off`. Whether a level was reached depends on the counters and
/// on where a monotone piece ends, never on where it began. So no step, however small, gets over a level unseen. Returns
/// whether there was an event.
#[inline]
pub(crate) fn follow(
    reference: &mut Level,
    curve: &impl Curve,
    start_us: i64,
    c: Thresholds,
    mut emit: impl FnMut(i64, bool),
) -> bool {
    let before = *reference;
    for piece in curve.pieces() {
        loop {
            let (up, down) = (reference.up(), reference.down());
            // The levels lie on either side of the reference, so at most one of them is reached.
            let (level, on) = if up.sign_of_excess(piece.end(), c) >= 0 {
                (up, true)
            } else if down.sign_of_excess(piece.end(), c) <= 0 {
                (down, false)
            } else {
                break;
            };
            *reference = level;
            emit(start_us + piece.first_tick(level, on, c), on);
        }
    }
    *reference != before
}
