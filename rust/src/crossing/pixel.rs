//! The crossing rule of one ideal pixel: from its state and a curve to the events between.
//!
//! It is the reference for everything else in this module: slow, exact, and short enough to be read as the definition.
//! What must not break: whether a level was reached depends on counters and on where pieces end, never on where they
//! began.

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
