//! Turns row and column addresses into events.
//!
//! The camera sends a row, then the columns of that row that fired. Each column is an event at the present time. Which
//! of row and column is x and which is y depends on the chip's orientation. [`Addresses::new`] settles this once, as
//! positions of bits in an event, so that no word needs a branch for it.
//!
//! What must not break: addresses outside of the array make no event and are counted, and so are columns before any
//! row. [`super::block`] makes the same events from the same bits.

use super::device::Device;
use super::stats::Stats;
use super::word::{LOW_12, ON, ROW};
use crate::event::Event;

/// The first bit of each field of an event, as [`Event::from_words`] takes them.
const X: u32 = 0;
const Y: u32 = 16;
const P: u32 = 32;

/// The sizes of the event array on the wire, and the row that was addressed last.
pub(super) struct Addresses {
    pub(super) columns: u16,
    pub(super) rows: u16,
    pub(super) row: Option<u16>,
    /// The first bit of the field that rows of the wire go to, and of that for columns: y and x, or swapped.
    row_field: u32,
    column_field: u32,
}

impl Addresses {
    pub(super) fn new(device: &Device) -> Self {
        let (row_field, column_field) = if device.dvs_swapped { (X, Y) } else { (Y, X) };
        Self { columns: device.dvs_columns, rows: device.dvs_rows, row: None, row_field, column_field }
    }

    /// Takes a row or a column.
    #[inline]
    pub(super) fn address(&mut self, word: u16, now: i64, events: &mut Vec<Event>, stats: &mut Stats) {
        let (address, is_row) = (word & LOW_12, word & !LOW_12 == ROW);
        if address >= if is_row { self.rows } else { self.columns } {
            stats.addresses_out_of_range += 1;
        } else if is_row {
            self.row = Some(address);
        } else if let Some(row) = self.row {
            events.push(Event::from_words(now, self.row_bits(row) | self.column_bits(word)));
        } else {
            stats.columns_without_row += 1;
        }
    }

    /// Returns a row as bits of an event.
    #[inline]
    pub(super) fn row_bits(&self, row: u16) -> u64 {
        u64::from(row) << self.row_field
    }

    /// Returns column and polarity of a word as bits of an event.
    #[inline]
    pub(super) fn column_bits(&self, word: u16) -> u64 {
        u64::from(word & LOW_12) << self.column_field | u64::from(word & ON) << (P - ON.trailing_zeros())
    }

    /// Returns the row in the bits of an event: the inverse of [`Self::row_bits`].
    #[inline]
    #[allow(clippy::cast_possible_truncation, reason = "the field's bits")]
    pub(super) fn row_of(&self, fields: u64) -> u16 {
        (fields >> self.row_field) as u16
    }
}
