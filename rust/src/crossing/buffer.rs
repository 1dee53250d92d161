//! Buffers for the events of a push: memory is taken before events are made.
//!
//! A threshold far below what the frames call for can make more events than memory holds. That must be an error, not
//! the end of the process.
//!
//! Every band first works within an allowance that is ample for usual frames, because counting events beforehand costs
//! time. If a band needs more, it stops with [`Full`]. All pixels then go back to where they were, and the events of
//! the whole frame are counted. The push is refused, or made again without an allowance.
//!
//! What must not break: [`most_events`] is never less than the events that [`super::pixel::follow`] makes, because
//! [`Buffer::push`] takes an event without a check.

use super::curve::{Curve, Piece};
use super::level::{Level, Thresholds};
use crate::error::Error;
use crate::huge_pages;

/// The most events of one push: 2 GiB of them, and as much again while they are sorted.
pub(crate) const MOST_EVENTS: u64 = 1 << 27;

/// A band needs more memory than it is allowed, or than there is.
#[derive(Debug)]
pub(crate) struct Full;

/// Why a push stops before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// There are more events than there is memory for.
    Full,
    /// A sample has no log intensity.
    BadValue,
    /// A pixel's record cannot hold what happens to it.
    Narrow,
}

impl From<Full> for Stop {
    fn from(Full: Full) -> Self {
        Self::Full
    }
}

impl Stop {
    /// What two parts of a frame come to together: what the frame is refused for comes first.
    pub(crate) fn both(first: Result<(), Self>, second: Result<(), Self>) -> Result<(), Self> {
        for stop in [Self::BadValue, Self::Full, Self::Narrow] {
            if first == Err(stop) || second == Err(stop) {
                return Err(stop);
            }
        }
        Ok(())
    }
}

/// How many events a band may make.
#[derive(Clone, Copy)]
pub(crate) enum Allowance {
    /// Ample for usual frames.
    Usual,
    /// Limited by memory only, because the events have been counted.
    Counted,
}

impl Allowance {
    /// The most events that a band of `pixels` pixels may make.
    fn of(self, pixels: usize) -> usize {
        match self {
            Self::Usual => (1 << 20) + 16 * pixels,
            Self::Counted => usize::MAX,
        }
    }
}

/// What a band makes of each event, whose memory is kept from frame to frame.
#[derive(Default)]
pub(crate) struct Buffer<T> {
    /// Those made, then spare ones.
    items: Vec<T>,
    made: usize,
    most: usize,
}

impl<T: Copy + Default> Buffer<T> {
    /// Drops those of the last frame and sets the allowance for the next frame, of `pixels` pixels.
    pub(crate) fn begin(&mut self, allowance: Allowance, pixels: usize) {
        self.made = 0;
        self.most = allowance.of(pixels);
    }

    pub(crate) fn clear(&mut self) {
        self.made = 0;
    }

    pub(crate) fn made(&self) -> &[T] {
        &self.items[..self.made]
    }

    /// Those made, but for as many that were made first.
    pub(crate) fn made_after(&mut self, first: usize) -> &mut [T] {
        &mut self.items[first..self.made]
    }

    /// Takes memory for `more`.
    #[inline]
    pub(crate) fn reserve(&mut self, more: usize) -> Result<(), Full> {
        if more <= self.items.len() - self.made { Ok(()) } else { self.grow(more) }
    }

    #[cold]
    fn grow(&mut self, more: usize) -> Result<(), Full> {
        let needed = self.made.saturating_add(more);
        if needed > self.most {
            return Err(Full);
        }
        self.items.try_reserve(needed - self.items.len()).map_err(|_| Full)?;
        huge_pages::ask_for(&mut self.items);
        self.items.resize(self.items.capacity(), T::default());
        Ok(())
    }

    /// Takes one, for which memory was taken.
    #[inline]
    pub(crate) fn push(&mut self, item: T) {
        self.items[self.made] = item;
        self.made += 1;
    }

    /// The spare ones that were made for `more`, to be filled from its start: then [`Self::take`].
    #[inline]
    pub(crate) fn spare(&mut self, more: usize) -> &mut [T] {
        &mut self.items[self.made..self.made + more]
    }

    /// Takes what fills the start of [`Self::spare`].
    #[inline]
    pub(crate) fn take(&mut self, more: usize) {
        self.made += more;
    }
}

/// The events of one pixel, counted in floats: off by one a piece of curve at most.
#[derive(Clone, Copy)]
pub(crate) struct Tally {
    reference: f64,
    events: f64,
}

impl Tally {
    pub(crate) fn new(reference: Level, c: Thresholds) -> Self {
        Self { reference: reference.value(c), events: 0.0 }
    }

    /// Counts along a curve.
    pub(crate) fn follow(&mut self, curve: &impl Curve, c: Thresholds) {
        for piece in curve.pieces() {
            let way = piece.end() - self.reference;
            let step = if way > 0.0 { c.on } else { c.off };
            let steps = (way.abs() / step).floor();
            self.reference += (steps * step).copysign(way);
            self.events += steps;
        }
    }

    /// About how many there are.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, >= 0, saturating")]
    pub(crate) fn events(&self) -> u64 {
        self.events as u64
    }
}

/// No curve of at most two pieces makes more events of a pixel.
#[allow(clippy::cast_possible_truncation, reason = "more than memory holds, or fewer")]
pub(crate) fn most_events(reference: Level, curve: &impl Curve, c: Thresholds) -> usize {
    let mut tally = Tally::new(reference, c);
    tally.follow(curve, c);
    tally.events() as usize + 4
}

/// What is told of a push of too many events.
pub(crate) fn refuse(events: u64, most: u64, pixels: usize, least_threshold: f64, t_us: i64) -> Error {
    Error::Argument(format!(
        "the frame at {t_us} us would make about {events} events in {pixels} pixels at a least contrast threshold of \
         {least_threshold}: one push may make {most}; raise the threshold, or push frames that are closer in time"
    ))
}

/// What is told where memory does not suffice.
pub(crate) fn out_of_memory(events: u64, pixels: usize, least_threshold: f64, t_us: i64) -> Error {
    Error::Memory(format!(
        "there is not enough memory for the events that the frame at {t_us} us makes: about {events} in {pixels} pixels, at \
         a least contrast threshold of {least_threshold}"
    ))
}
