//! Follows one pixel under effects in time: crossings, holds and noise, in the order in which they happen.
//!
//! Along each monotone piece of the curve, [`Pixel::follow`] finds what comes first: the end of a hold, a crossing, an
//! arrival of noise or the end of an excursion. It acts on that and goes on from there. The exact moment of a crossing
//! is only computed if a hold or noise needs it, because that costs as much as all the rest.
//!
//! What must not break:
//! - The order in time, also where a hold ends within a piece.
//! - Arrivals of noise during a hold are drawn and dropped, so that later ones keep their numbers.

use super::arrivals::Arrivals;
use super::excursion::Excursion;
use super::leak::LeakJitter;
use super::noise::Noise;
use super::shot_noise::Away;
use crate::crossing::curve::{Curve, Piece, Timed};
use crate::crossing::level::{Level, Thresholds};

/// Not held.
pub(crate) const FREE: f64 = f64::NEG_INFINITY;

/// A pixel's state. Times are microseconds from the interval's start.
pub(crate) struct Pixel<'a> {
    pub(crate) number: u32,
    pub(crate) c: Thresholds,
    pub(crate) reference: &'a mut Level,
    /// Until when it is held in reset, or [`FREE`].
    pub(crate) held_until_us: &'a mut f64,
    pub(crate) refractory_us: f64,
    /// The noise that is part of what its comparators see, but not of `reference`.
    pub(crate) excursion: &'a mut Excursion,
    /// How uncertain it is what has leaked; None for not at all.
    pub(crate) leak_jitter: Option<LeakJitter<'a>>,
    /// Its processes of noise; shot noise is the first.
    pub(crate) noise: [Option<(Noise, &'a mut Arrivals)>; 2],
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
        if held && *self.held_until_us <= finish || self.excursion.is_on() && self.excursion.until_us <= finish {
            return false;
        }
        if self.next_noise().is_some_and(|(_, at)| at <= finish) {
            return false;
        }
        let (low, high) = bounds(*self.reference, self.c);
        held || low < least && most < high
    }

    /// Follows a curve that begins at `offset` of the interval; calls `emit(tick, on)` for each event, ticks counted
    /// from the interval's start.
    ///
    /// `light` gives luma + `log_eps` of the input at a time of the curve.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "within the interval")]
    pub(crate) fn follow<C: Curve<Piece: Timed>>(
        &mut self,
        curve: &C,
        offset: i64,
        light: impl Fn(f64) -> f64,
        mut emit: impl FnMut(i64, bool),
    ) {
        let start = offset as f64;
        let mut now = start;
        for piece in curve.pieces() {
            let finish = start + piece.finish();
            loop {
                if *self.held_until_us > FREE {
                    let until = *self.held_until_us;
                    self.skip_noise(until.min(finish));
                    if until > finish {
                        break;
                    }
                    *self.reference = memorised(piece.value(until - start));
                    self.book_leak();
                    *self.held_until_us = FREE;
                    now = until;
                    if self.excursion.until_us <= until {
                        *self.excursion = Excursion::NONE; // over before the reset was: nothing of it is memorised
                    }
                }
                let crossing = self.crossing(&piece);
                let noise = self.next_noise().filter(|&(_, at)| at <= finish);
                // The end of an excursion is to noise what an arrival is.
                let ends = self.excursion.until_us;
                let ends_first = self.excursion.is_on() && ends <= finish && noise.is_none_or(|(_, at)| ends <= at);
                let noise = if ends_first { Some((None, ends)) } else { noise.map(|(kind, at)| (Some(kind), at)) };
                // When exactly it crosses matters to noise and to a hold, and costs as much as the rest together.
                let moment = |(level, on)| (start + piece.moment(level, on, self.c)).clamp(now, finish.max(now));
                match (crossing, noise) {
                    (crossing, Some((kind, at))) if crossing.is_none_or(|crossing| at < moment(crossing)) => {
                        now = at;
                        let seen = piece.value(at - start);
                        let mut emit = |on| emit(at.ceil() as i64, on);
                        let fired = match kind {
                            Some(kind) => self.take_noise(kind, at, light(at - start), seen, &mut emit),
                            None => self.end_excursion(at, light(at - start), seen, &mut emit),
                        };
                        if fired {
                            self.reset(at.ceil() as i64, at);
                        }
                    }
                    (Some((level, on)), _) => {
                        if self.refractory_us > 0.0 {
                            now = moment((level, on));
                        }
                        let tick = offset + piece.first_tick(level, on, self.c);
                        emit(tick, on);
                        *self.reference = level;
                        self.reset(tick, now);
                    }
                    (None, _) => break,
                }
            }
        }
    }

    /// The level that is reached by the piece's end, if one is.
    fn crossing(&self, piece: &impl Piece) -> Option<(Level, bool)> {
        let (up, down) = (self.reference.up(), self.reference.down());
        if up.sign_of_excess(piece.end(), self.c) >= 0 {
            Some((up, true))
        } else if down.sign_of_excess(piece.end(), self.c) <= 0 {
            Some((down, false))
        } else {
            None
        }
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

    /// The process whose next arrival is the earliest, and when.
    fn next_noise(&self) -> Option<(usize, f64)> {
        let waits = self.noise.iter().enumerate().filter_map(|(kind, noise)| Some((kind, noise.as_ref()?.1.wait_us)));
        waits.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Takes the next arrival of a process, at a time at which the comparators see so much without noise; whether it
    /// made an event.
    ///
    /// Each event resets the pixel. With shot noise the comparators see the very level that the event stands for, and
    /// that is memorised.
    fn take_noise(&mut self, kind: usize, at_us: f64, light: f64, seen: f64, emit: &mut impl FnMut(bool)) -> bool {
        let Some((noise, arrivals)) = self.noise[kind].as_mut() else { return false };
        let index = arrivals.index;
        noise.advance(self.number, self.c, arrivals);
        let on = match noise {
            Noise::Hot(_) => true,
            Noise::Shot(_) if self.excursion.is_on() => return false, // noise is away already
            Noise::Shot(shot) => {
                let Some(on) = shot.event(self.number, index, self.c, light) else { return false };
                let level = if on { self.reference.up() } else { self.reference.down() };
                let away = Away { at_us, light, noise: level.exact(self.c).value() - seen };
                *self.excursion = shot.excursion(self.number, index, away, on);
                on
            }
        };
        *self.reference = memorised(seen);
        emit(on);
        true
    }

    /// Noise is gone, but not from what was memorised: where a level lies within reach, noise makes its event on the way;
    /// whether it did.
    fn end_excursion(&mut self, at_us: f64, light: f64, seen: f64, emit: &mut impl FnMut(bool)) -> bool {
        let excursion = std::mem::replace(self.excursion, Excursion::NONE);
        self.reference.base += excursion.noise;
        let (up, down) = (self.reference.up(), self.reference.down());
        let (reach_up, reach_down) = (excursion.reach(true) * self.c.on, excursion.reach(false) * self.c.off);
        let (on, level) = if up.sign_of_excess(seen + reach_up, self.c) >= 0 {
            (true, up)
        } else if down.sign_of_excess(seen - reach_down, self.c) <= 0 {
            (false, down)
        } else {
            return false;
        };
        if let Some((Noise::Shot(shot), arrivals)) = &self.noise[0] {
            let away = Away { at_us, light, noise: level.exact(self.c).value() - seen };
            *self.excursion = shot.excursion_back(self.number, arrivals.index, away);
        }
        *self.reference = memorised(seen);
        emit(on);
        true
    }

    /// Arrivals while the pixel is held make no events.
    fn skip_noise(&mut self, until_us: f64) {
        for (noise, arrivals) in self.noise.iter_mut().flatten() {
            while arrivals.wait_us <= until_us {
                noise.advance(self.number, self.c, arrivals);
            }
        }
    }
}

/// The reference of a pixel that has just been reset.
fn memorised(log_intensity: f64) -> Level {
    Level { base: log_intensity, on: 0, off: 0 }
}
