//! The events that a band has made of a frame, as 8 bytes each, and what their pixels were before.
//!
//! An event's time since the interval's start, its polarity and its pixel fit into a [`Key`] unless the interval is
//! longer than half an hour. Next to each key stands what the event changed in its pixel's record. So a push can be
//! undone: all of these are put back, the latest first.
//!
//! What must not break: there is one change for each event, in the same order.

use super::record::Record;
use super::room::{Allowance, Full, Room};
use crate::event::{Event, SensorSize};
use crate::order::Stamped;

/// Intervals of this many ticks and more are long: their events have no keys.
pub(crate) const LONG: i64 = 1 << 31;

/// An event of an interval. From the lowest bit: 16 bits of x, 16 bits of y, the polarity, 31 bits of the tick.
#[derive(Clone, Copy, Default)]
pub(crate) struct Key(u64);

const TICK: u32 = 33;
const PLACE: u64 = (1 << TICK) - 1;

impl Key {
    /// The event at a tick below [`LONG`].
    #[inline]
    pub(crate) fn new(tick: i64, place: Place, on: bool) -> Self {
        Self(tick.cast_unsigned() << TICK | u64::from(on) << (TICK - 1) | u64::from(place.0))
    }
}

impl Stamped for Key {
    #[inline]
    fn tick(self, _: i64) -> i64 {
        (self.0 >> TICK).cast_signed()
    }

    #[inline]
    fn event(self, start_us: i64) -> Event {
        Event::from_words(start_us + self.tick(start_us), self.0 & PLACE)
    }
}

/// x and y, in one number.
#[derive(Clone, Copy)]
pub(crate) struct Place(u32);

impl Place {
    #[inline]
    pub(crate) fn new(x: u16, y: u16) -> Self {
        Self(u32::from(y) << 16 | u32::from(x))
    }
}

/// The events of a band.
pub(crate) struct Made<R: Record> {
    keys: Room<Key>,
    /// Of long intervals.
    long: Room<Event>,
    old: Room<R::Old>,
    is_long: bool,
}

impl<R: Record> Default for Made<R> {
    fn default() -> Self {
        Self { keys: Room::default(), long: Room::default(), old: Room::default(), is_long: false }
    }
}

impl<R: Record> Made<R> {
    /// Drops the last frame's events and sets the allowance for the next frame, of `pixels` pixels.
    pub(crate) fn begin(&mut self, allowance: Allowance, pixels: usize, ticks: i64) {
        self.keys.begin(allowance, pixels);
        self.long.begin(allowance, pixels);
        self.old.begin(allowance, pixels);
        self.is_long = ticks >= LONG;
    }

    pub(crate) fn is_long(&self) -> bool {
        self.is_long
    }

    pub(crate) fn count(&self) -> usize {
        self.old.made().len()
    }

    /// Events in raster order, where the interval is not long.
    pub(crate) fn keys(&self) -> &[Key] {
        self.keys.made()
    }

    /// Events in raster order, where the interval is long.
    pub(crate) fn long(&self) -> &[Event] {
        self.long.made()
    }

    /// Makes room for `more` events.
    #[inline]
    pub(crate) fn reserve(&mut self, more: usize) -> Result<(), Full> {
        if self.is_long {
            self.long.reserve(more)?;
        } else {
            self.keys.reserve(more)?;
        }
        self.old.reserve(more)
    }

    /// Takes an event, for which room was made, at a tick after `start_us`.
    pub(crate) fn push(&mut self, start_us: i64, tick: i64, place: Place, on: bool, old: R::Old) {
        if self.is_long {
            let [x, y] = [place.0, place.0 >> 16].map(|side| (side & 0xffff) as u16);
            self.long.push(Event::new(start_us + tick, x, y, on));
        } else {
            self.keys.push(Key::new(tick, place, on));
        }
        self.old.push(old);
    }

    /// The room that was made for `more` events, of an interval that is not long: then [`Self::take`].
    #[inline]
    pub(crate) fn spare(&mut self, more: usize) -> (&mut [Key], &mut [R::Old]) {
        (self.keys.spare(more), self.old.spare(more))
    }

    /// Takes what fills the start of [`Self::spare`].
    #[inline]
    pub(crate) fn take(&mut self, more: usize) {
        self.keys.take(more);
        self.old.take(more);
    }

    /// Puts back what all these events changed, and drops them. The records begin at pixel `first_pixel`.
    #[cold]
    pub(crate) fn undo(&mut self, records: &mut [R], first_pixel: usize, size: SensorSize) {
        let of_key = |key: &Key| key.event(0).pixel(size);
        let pixels: Box<dyn Iterator<Item = usize>> = if self.is_long {
            Box::new(self.long.made().iter().rev().map(|event| event.pixel(size)))
        } else {
            Box::new(self.keys.made().iter().rev().map(of_key))
        };
        for (pixel, &old) in pixels.zip(self.old.made().iter().rev()) {
            records[pixel - first_pixel].restore(old);
        }
        self.keys.clear();
        self.long.clear();
        self.old.clear();
    }
}
