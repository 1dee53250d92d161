//! One ideal pixel: from its state and a new sample to the events between.

use super::curve::{Curve, Piece};
use super::level::{Level, Thresholds};

/// No event yet.
pub(crate) const NEVER: i64 = -1;

/// The state of a pixel besides its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pixel {
    /// The reference `R = B + n_on C_on - n_off C_off`.
    pub(crate) reference: Level,
    /// Time of the last event in microseconds, or [`NEVER`].
    pub(crate) last_event_us: i64,
}

impl Pixel {
    /// A pixel memorised at its first sample.
    pub(crate) fn new(log_intensity: f64) -> Self {
        Self { reference: Level { base: log_intensity, on: 0, off: 0 }, last_event_us: NEVER }
    }

    /// Follows log intensity along `curve` from `start_us` on; calls `emit(t_us, on)` for each event, in order.
    ///
    /// Whether a level was reached depends on the counters and on where a monotone piece ends, never on where it began.
    /// So no step, however small, gets over a level unseen. Returns whether there was an event.
    #[inline]
    pub(crate) fn follow(
        &mut self,
        curve: &impl Curve,
        start_us: i64,
        c: Thresholds,
        mut emit: impl FnMut(i64, bool),
    ) -> bool {
        let before = self.reference;
        for piece in curve.pieces() {
            loop {
                let (up, down) = (self.reference.up(), self.reference.down());
                // The levels lie on either side of the reference, so at most one of them is reached.
                let (level, on) = if up.sign_of_excess(piece.end(), c) >= 0 {
                    (up, true)
                } else if down.sign_of_excess(piece.end(), c) <= 0 {
                    (down, false)
                } else {
                    break;
                };
                self.last_event_us = start_us + piece.first_tick(level, on, c);
                self.reference = level;
                emit(self.last_event_us, on);
            }
        }
        self.reference != before
    }
}
