//! The events of a band in one frame, as 8 bytes each, and what their pixels were before.
//!
//! An event's time since the interval's start, its polarity and its pixel fit into a [`Key`] unless the interval is
//! longer than half an hour. Next to each key stands what the event changed in its pixel's record. So a push can be
//! undone: all of these are put back, the latest first.
//!
//! What must not break: there is one change for each event, in the same order.

use super::buffer::{Allowance, Buffer, Full};
use super::decision::integer;
use super::exponential::ROUND;
use super::record::Record;
use crate::event::{Event, SensorSize};
use crate::order::Stamped;

/// Intervals of this many ticks and more are long: their events have no keys.
pub(crate) const LONG: i64 = 1 << 31;

/// An event of an interval. From the lowest bit: 16 bits of x, 16 bits of y, the polarity, 31 bits of the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub(crate) struct Key(u64);

impl Key {
    /// The lowest bit of the tick. The polarity is below it.
    pub(crate) const TICK: u32 = 33;

    /// The event at a tick below [`LONG`].
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn new(tick: i64, address: PixelAddress, on: bool) -> Self {
        Self(tick.cast_unsigned() << Self::TICK | u64::from(on) << (Self::TICK - 1) | address.0)
    }
}

impl Stamped for Key {
    const ADDRESS: u64 = (1 << Self::TICK) - 1;

    #[inline]
    fn tick(self, _: i64) -> i64 {
        (self.0 >> Self::TICK).cast_signed()
    }

    #[inline]
    fn event(self, start_us: i64, address: u64) -> Event {
        Event::from_words(start_us + self.tick(start_us), self.0 & address)
    }
}

/// x and y of a pixel, in one number.
#[derive(Clone, Copy)]
pub(crate) struct PixelAddress(u64);

/// Where the pixels of a band lie on the sensor.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    first_pixel: f64,
    width: f64,
    rows_per_pixel: f64,
}

impl Grid {
    #[allow(clippy::cast_precision_loss, reason = "no sensor has 2^32 pixels")]
    pub(crate) fn new(first_pixel: usize, size: SensorSize) -> Self {
        let width = f64::from(size.width);
        Self { first_pixel: first_pixel as f64, width, rows_per_pixel: 1.0 / width }
    }

    /// Returns what [`Self::address`] computes with: the first pixel, rows a pixel, and what an address rises by from the
    /// end of a row to the next row, beyond that of a pixel.
    pub(crate) fn parts(self) -> [f64; 3] {
        [self.first_pixel, self.rows_per_pixel, 65_536.0 - self.width]
    }

    /// Returns the address of a pixel, by its number in the band.
    ///
    /// In floats, because vector units cannot divide integers. The row's number is half a pixel or more away from where it
    /// would be rounded wrongly.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn address(self, in_band: u32) -> PixelAddress {
        let [first_pixel, rows_per_pixel, to_next_row] = self.parts();
        let pixel = first_pixel + f64::from(in_band);
        let y = ((pixel + 0.5) * rows_per_pixel - 0.5 + ROUND) - ROUND;
        PixelAddress(integer(pixel + y * to_next_row).cast_unsigned())
    }
}

/// The events of a band.
pub(crate) struct BandEvents<R: Record> {
    keys: Buffer<Key>,
    /// Of long intervals.
    long: Buffer<Event>,
    old: Buffer<R::Old>,
    is_long: bool,
}

impl<R: Record> Default for BandEvents<R> {
    fn default() -> Self {
        Self { keys: Buffer::default(), long: Buffer::default(), old: Buffer::default(), is_long: false }
    }
}

impl<R: Record> BandEvents<R> {
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

    /// What these events changed of their records.
    #[cfg(test)]
    pub(crate) fn old(&self) -> &[R::Old] {
        self.old.made()
    }

    /// Events in raster order, where the interval is long.
    pub(crate) fn long(&self) -> &[Event] {
        self.long.made()
    }

    /// Takes memory for `more` events.
    #[inline]
    pub(crate) fn reserve(&mut self, more: usize) -> Result<(), Full> {
        if self.is_long {
            self.long.reserve(more)?;
        } else {
            self.keys.reserve(more)?;
        }
        self.old.reserve(more)
    }

    /// Takes an event, for which memory was taken, at a tick after `start_us`.
    pub(crate) fn push(&mut self, start_us: i64, tick: i64, address: PixelAddress, on: bool, old: R::Old) {
        if self.is_long {
            self.long.push(Key::new(0, address, on).event(start_us + tick, Key::ADDRESS));
        } else {
            self.keys.push(Key::new(tick, address, on));
        }
        self.old.push(old);
    }

    /// The spare ones that were made for `more` events, of an interval that is not long: then [`Self::take`].
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
        let of_key = |key: &Key| key.event(0, Key::ADDRESS).pixel(size);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keys_are_the_events(
            width in 1u16..=u16::MAX, height in 1u16..=u16::MAX, pixel in 0.0f64..1.0, edge in 0u8..4, tick in 0..LONG, on: bool,
        ) {
            let size = SensorSize { width, height };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "a pixel")]
            let pixel = (pixel * size.pixels() as f64) as usize;
            let row = pixel - pixel % usize::from(width);
            let pixel = [pixel, row, row + usize::from(width) - 1, size.pixels() - 1][usize::from(edge)];
            let (x, y) = size.xy(pixel);
            for first in [0, pixel / 2, pixel] {
                let key = Key::new(tick, Grid::new(first, size).address(u32::try_from(pixel - first).unwrap()), on);
                prop_assert_eq!(key.event(9, Key::ADDRESS), Event::new(9 + tick, x, y, on));
                prop_assert_eq!(key.tick(9), tick);
            }
        }
    }
}
