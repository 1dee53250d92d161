//! One ideal pixel: from its state and a new sample to the events between.

use super::level::{Level, Thresholds};
use super::tick::Interval;

/// No event yet.
pub(crate) const NEVER: i64 = -1;

/// The state of a pixel, 40 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pixel {
    /// The reference `R = B + n_on C_on - n_off C_off`.
    pub(crate) reference: Level,
    /// Log intensity at the last sample.
    pub(crate) log_intensity: f64,
    /// Time of the last event in microseconds, or [`NEVER`].
    pub(crate) last_event_us: i64,
}

impl Pixel {
    /// A pixel memorised at its first sample.
    pub(crate) fn new(log_intensity: f64) -> Self {
        Self { reference: Level { base: log_intensity, on: 0, off: 0 }, log_intensity, last_event_us: NEVER }
    }

    /// Takes the sample at the end of `(start_us, start_us + ticks]`; calls `emit(t_us, on)` for each event, in order.
    ///
    /// Whether a level was reached depends on the counters and on the new sample alone; the previous sample only says
    /// when. So no step, however small, gets over a level unseen.
    pub(crate) fn advance(
        &mut self,
        sample: f64,
        start_us: i64,
        ticks: i64,
        c: Thresholds,
        mut emit: impl FnMut(i64, bool),
    ) {
        let line = Interval { from: self.log_intensity, to: sample, ticks };
        self.log_intensity = sample;
        loop {
            let up = Level { on: self.reference.on + 1, ..self.reference };
            let down = Level { off: self.reference.off + 1, ..self.reference };
            // The levels lie on either side of the reference, so at most one of them is reached.
            let (level, on) = if up.sign_of_excess(sample, c) >= 0 {
                (up, true)
            } else if down.sign_of_excess(sample, c) <= 0 {
                (down, false)
            } else {
                return;
            };
            self.last_event_us = start_us + line.first_tick(level, on, c);
            self.reference = level;
            emit(self.last_event_us, on);
        }
    }
}
