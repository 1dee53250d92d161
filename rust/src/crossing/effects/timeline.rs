//! Follows one pixel under effects in time: crossings, holds and hot pixels, in the order in which they happen.
//!
//! Along each monotone piece of the curve, [`Pixel::follow`] finds what comes first: the end of a hold, a crossing of the
//! signal with its noise, or an event of a hot pixel. It acts on that and goes on from there. The exact moment of a
//! crossing without noise is only computed if something needs it, because that costs as much as all the rest.
//!
//! What must not break:
//! - The order in time, also where a hold ends within a piece.
//! - Events of a hot pixel during a hold are drawn and dropped, so that later ones keep their numbers.

use super::hot_pixels::{Arrivals, HotPixelNoise};
use super::leak::LeakJitter;
use super::noise_path::{Levels, ShotNoisePath};
use crate::crossing::curve::{Curve, Piece, Timed};
use crate::crossing::level::{Level, Thresholds};

/// Not held.
pub(crate) const FREE: f64 = f64::NEG_INFINITY;

/// The window of a pixel that is followed all the way.
pub(crate) const WHOLE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// A pixel's state. Times are microseconds from the interval's start.
pub(crate) struct Pixel<'a> {
    pub(crate) number: u32,
    pub(crate) c: Thresholds,
    pub(crate) reference: &'a mut Level,
    /// Until when it is held in reset, or [`FREE`].
    pub(crate) held_until_us: &'a mut f64,
    pub(crate) refractory_us: f64,
    /// It is followed from the one to the other of these, in microseconds of the interval: before, nothing happens to it.
    pub(crate) window_us: (f64, f64),
    /// How uncertain it is what has leaked; None for not at all.
    pub(crate) leak_jitter: Option<LeakJitter<'a>>,
    /// What is added to the signal.
    pub(crate) shot_noise: Option<ShotNoisePath<'a>>,
    /// The events of its own, where it is hot.
    pub(crate) hot: Option<(HotPixelNoise, &'a mut Arrivals)>,
}

/// Between these a comparator sees no level of a pixel with this reference; where one lies at or beyond them, it may.
///
/// Rounded inward: the reference is within 1e-9, adding rounds by less, and what has leaked for long by its own ulp.
pub(super) fn bounds(reference: Level, c: Thresholds) -> (f64, f64) {
    let reference = reference.value(c);
    let margin = 3e-9 + 4.0 * f64::EPSILON * reference.abs();
    (reference - c.off + margin, reference + c.on - margin)
}

impl Pixel<'_> {
    /// Returns whether nothing can happen to it until `finish`, if what its comparators see stays from `least` to `most`.
    ///
    /// Then [`Self::follow`] would change nothing, and need not be called.
    pub(super) fn rests_until(&self, finish: f64, (least, most): (f64, f64)) -> bool {
        let held = *self.held_until_us > FREE;
        if held && *self.held_until_us <= finish || self.next_hot().is_some_and(|at| at <= finish) {
            return false;
        }
        let (low, high) = bounds(*self.reference, self.c);
        let reach = self.shot_noise.as_ref().map_or(0.0, |noise| noise.reach);
        held || low < least - reach && most + reach < high
    }

    /// Follows a curve that begins at `offset` of the interval; calls `emit(tick, on)` for each event, ticks counted
    /// from the interval's start.
    ///
    /// `log_light` gives ln(luma + `log_eps`) of the input at a time of the curve.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "within the interval")]
    pub(crate) fn follow<C: Curve<Piece: Timed>>(
        &mut self,
        curve: &C,
        offset: i64,
        log_light: impl Fn(f64) -> f64,
        mut emit: impl FnMut(i64, bool),
    ) {
        let start = offset as f64;
        // Light before the curve is what it begins with.
        let log_light = |t: f64| log_light((t - start).max(0.0));
        let mut now = start.max(self.window_us.0);
        for piece in curve.pieces() {
            let finish = (start + piece.finish()).min(self.window_us.1);
            if finish < now {
                continue;
            }
            let seen = |t: f64| piece.value(t - start);
            loop {
                if *self.held_until_us > FREE {
                    let until = *self.held_until_us;
                    self.skip_hot(until.min(finish));
                    if until > finish {
                        break;
                    }
                    *self.reference = memorised(seen(until) + self.noise_at(until, &log_light));
                    self.book_leak();
                    *self.held_until_us = FREE;
                    now = until;
                }
                let hot = self.next_hot().filter(|&at| at <= finish);
                let crossing = self.crossing(&piece, (now, hot.unwrap_or(finish)), &seen, &log_light);
                // When exactly it crosses matters to hot pixels and to a hold, and costs as much as the rest together.
                let moment = |crossing: &Crossing| {
                    let of_signal = || start + piece.moment(crossing.level, crossing.on, self.c);
                    crossing.noisy_us.unwrap_or_else(|| of_signal().clamp(now, finish.max(now)))
                };
                match (crossing, hot) {
                    (crossing, Some(at)) if crossing.is_none_or(|crossing| at < moment(&crossing)) => {
                        now = at;
                        self.advance_hot();
                        *self.reference = memorised(seen(at) + self.noise_at(at, &log_light));
                        emit(at.ceil() as i64, true);
                        self.reset(at.ceil() as i64, at);
                    }
                    (Some(crossing), _) => {
                        if self.refractory_us > 0.0 || crossing.noisy_us.is_some() {
                            now = moment(&crossing);
                        }
                        let tick = match crossing.noisy_us {
                            Some(at) => (at.ceil() as i64).max(1),
                            None => offset + piece.first_tick(crossing.level, crossing.on, self.c),
                        };
                        emit(tick, crossing.on);
                        *self.reference = crossing.level;
                        self.reset(tick, now);
                    }
                    (None, _) => break,
                }
            }
            if self.shot_noise.is_some() {
                now = now.max(finish);
            }
        }
    }

    /// The level that is reached first in a window of a piece, if one is.
    ///
    /// Without noise it is the one that is reached by the piece's end. With noise the reference moves to the level's float,
    /// because noise is no exact number.
    fn crossing(
        &mut self,
        piece: &impl Piece,
        window: (f64, f64),
        seen: &impl Fn(f64) -> f64,
        log_light: &impl Fn(f64) -> f64,
    ) -> Option<Crossing> {
        let (up, down) = (self.reference.up(), self.reference.down());
        if let Some(noise) = &mut self.shot_noise {
            let (above, below) = (up.approximate(self.c).0, down.approximate(self.c).0);
            let levels = Levels { above, below, least: self.c.on.min(self.c.off) };
            let (at_us, on) = noise.first_crossing(window, seen, levels, log_light)?;
            return Some(Crossing { level: memorised(if on { above } else { below }), on, noisy_us: Some(at_us) });
        }
        if up.sign_of_excess(piece.end(), self.c) >= 0 {
            Some(Crossing { level: up, on: true, noisy_us: None })
        } else if down.sign_of_excess(piece.end(), self.c) <= 0 {
            Some(Crossing { level: down, on: false, noisy_us: None })
        } else {
            None
        }
    }

    /// Shot noise at a time.
    fn noise_at(&mut self, at_us: f64, log_light: &impl Fn(f64) -> f64) -> f64 {
        let least = self.c.on.min(self.c.off);
        self.shot_noise.as_mut().map_or(0.0, |noise| noise.at(at_us, least, log_light))
    }
    /// Resets the pixel after an event at `tick`: it is held, or the reset is over at once.
    fn reset(&mut self, tick: i64, at_us: f64) {
        if let Some(jitter) = &mut self.leak_jitter {
            jitter.book(self.number, self.c, tick);
        }
        if self.refractory_us > 0.0 {
            *self.held_until_us = at_us + self.refractory_us;
        } else {
            self.book_leak();
        }
    }

    /// Adds the error of what has leaked to the reference, at the end of a reset.
    fn book_leak(&mut self) {
        if let Some(jitter) = &mut self.leak_jitter {
            self.reference.base += std::mem::take(jitter.error);
        }
    }

    /// When a hot pixel's next arrival is.
    fn next_hot(&self) -> Option<f64> {
        self.hot.as_ref().map(|hot| hot.1.wait_us)
    }

    fn advance_hot(&mut self) {
        if let Some((noise, arrivals)) = &mut self.hot {
            noise.advance(self.number, arrivals);
        }
    }

    /// Arrivals while the pixel is held make no events.
    fn skip_hot(&mut self, until_us: f64) {
        while self.next_hot().is_some_and(|at| at <= until_us) {
            self.advance_hot();
        }
    }
}

/// A level that is reached.
#[derive(Clone, Copy)]
struct Crossing {
    /// The reference after it.
    level: Level,
    on: bool,
    /// When, where noise takes part.
    noisy_us: Option<f64>,
}

/// The reference of a pixel that has just been reset.
fn memorised(log_intensity: f64) -> Level {
    Level { base: log_intensity, on: 0, off: 0 }
}
