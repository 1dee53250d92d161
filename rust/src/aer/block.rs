//! Decodes the timestamps, wraps and addresses of a block of 64 words without a branch at each word.
//!
//! Whether a word is a time, a row or a column is hard to predict, and a mispredicted branch costs more than all the
//! work on a word. So what each word would do is computed for all words at once, in plain loops that the compiler turns
//! into vector code. The events that words would make are then kept or dropped by a mask.
//!
//! [`without_wraps`] is the common case. It fills times and rows forward across the block ([`super::lanes`]), so no
//! word has to wait for the one before. [`with_wraps`] goes word by word, because a wrap moves the base of all times
//! after it. Its loop has no branches either.
//!
//! What must not break:
//! - Both do exactly what [`Clock::advance`] and [`Addresses::address`] do word by word. The decoder's tests compare
//!   them on random streams.
//! - The caller has made sure that all words are plain (see [`super::fast_path`]), that a row is known, and that the
//!   clock does not overflow. Nothing is checked again here.

use super::addresses::Addresses;
use super::clock::{Clock, WRAP_BITS};
use super::lanes::{BLOCK, LANES, TOP, TOPS, any_of_upper_four, forward_fill, mask, splat, unpack};
use super::state::State;
use super::word::{COLUMN_OFF, LOW_12, LOW_15, ON, ROW, WRAP};
use crate::event::Event;

/// Returns whether a word is the address of a column, in the array or beyond it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn is_column(word: u16) -> bool {
    (word & !ON).wrapping_sub(COLUMN_OFF) <= LOW_12
}

/// Flags of 0 or 1 as the bits of one number, the first one lowest.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn bits(flags: &[u8; BLOCK]) -> u64 {
    let eights = flags.as_chunks::<8>().0.iter().enumerate();
    // Eight bytes of 0 or 1 to eight bits: each lands in the top byte at a position of its own.
    eights.fold(0, |bits, (i, eight)| {
        bits | u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56 << (8 * i)
    })
}

/// Decodes a block that has neither wraps nor samples. Reserved words in it (padding) do nothing.
///
/// Finds the time and the row that hold at each word, makes the event that each word would be, and keeps those of
/// columns.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "15 bits since the last wrap")]
pub(super) fn without_wraps(block: &[[u8; 2]; BLOCK], state: &mut State, events: &mut Vec<Event>) {
    let State { clock: Clock { base, now }, addresses, stats, .. } = state;
    let Some(row) = addresses.row else { return };
    let (mut packed, mut times, mut rows) = ([0; LANES], [0; LANES], [0; LANES]);
    for (lanes, bytes) in packed.iter_mut().zip(block.as_flattened().as_chunks().0) {
        *lanes = u64::from_le_bytes(*bytes);
    }
    for ((lanes, time), row) in packed.iter().zip(&mut times).zip(&mut rows) {
        *time = lanes & mask(*lanes);
        *row = (lanes & splat(LOW_12) | TOPS) & mask(!any_of_upper_four(lanes ^ splat(ROW)));
    }
    let before = TOP | (*now - *base) as u16;
    let (held, last_time) = forward_fill(&mut times, before);
    let (_, last_row) = forward_fill(&mut rows, TOP | row);
    let mut any_late = 0;
    let mut late = [0; LANES];
    for (i, late) in late.iter_mut().enumerate() {
        let earlier = times[i] << 16 | held[i] & u64::from(u16::MAX);
        // The difference keeps its top bit where time does not go forward.
        *late = ((earlier | TOPS) - (packed[i] & !TOPS)) & packed[i] & TOPS;
        any_late |= *late;
    }
    if any_late != 0 {
        stats.times_not_increasing += late.iter().map(|late| u64::from(late.count_ones())).sum::<u64>();
    }

    let (times, rows) = (unpack(&times), unpack(&rows));
    let mut all = [Event::default(); BLOCK];
    for (((event, bytes), time), row) in all.iter_mut().zip(block).zip(&times).zip(&rows) {
        let column = addresses.column_bits(u16::from_le_bytes(*bytes));
        *event = Event::from_words(*base + i64::from(time & LOW_15), addresses.row_bits(row & LOW_12) | column);
    }
    let mut columns = bits(&map_words(block, |word| u8::from(is_column(word))));
    events.extend((0..columns.count_ones()).map(|_| {
        let index = columns.trailing_zeros() as usize;
        columns &= columns - 1;
        all[index % BLOCK]
    }));
    *now = *base + i64::from(last_time & LOW_15);
    addresses.row = Some(last_row & LOW_12);
}

/// What each word of a block does to the time and to the fields of the next event.
struct Fields {
    /// The low 15 bits of a time; [`NO_TIME`] for words that are no time.
    low: [u32; BLOCK],
    /// What a wrap adds to the base.
    jump: [u32; BLOCK],
    /// The bits of the event before that stay, and those that the word sets.
    kept: [u64; BLOCK],
    set: [u64; BLOCK],
    is_column: [u8; BLOCK],
}

/// More than 15 bits, so no time has it.
const NO_TIME: u32 = u32::MAX;

impl Fields {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
    fn of(block: &[[u8; 2]; BLOCK], addresses: &Addresses) -> Self {
        let is_wrap = |word: u16| word.wrapping_sub(WRAP) <= LOW_12;
        let is_row = |word: u16| word.wrapping_sub(ROW) <= LOW_12;
        let low = |word: u16| if is_wrap(word) { 0 } else { u32::from(word & LOW_15) };
        let (row, column) = (addresses.row_bits(LOW_12), addresses.column_bits(ON | LOW_12));
        Self {
            low: map_words(block, |word| if word >= WRAP { low(word) } else { NO_TIME }),
            jump: map_words(block, |word| if is_wrap(word) { u32::from(word & LOW_12) << WRAP_BITS } else { 0 }),
            kept: map_words(block, |word| {
                if is_row(word) {
                    !row
                } else if is_column(word) {
                    !column
                } else {
                    u64::MAX
                }
            }),
            set: map_words(block, |word| {
                let (row, column) = (addresses.row_bits(word & LOW_12), addresses.column_bits(word));
                if is_row(word) {
                    row
                } else if is_column(word) {
                    column
                } else {
                    0
                }
            }),
            is_column: map_words(block, |word| u8::from(is_column(word))),
        }
    }
}

/// Returns a value computed from each word.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn map_words<T>(block: &[[u8; 2]; BLOCK], value: impl Fn(u16) -> T) -> [T; BLOCK] {
    block.map(|bytes| value(u16::from_le_bytes(bytes)))
}

/// Decodes the first `plain` words of a block, none of them a sample, one after the other from their [`Fields`].
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn with_wraps(block: &[[u8; 2]; BLOCK], plain: usize, state: &mut State, events: &mut Vec<Event>) {
    let State { clock: Clock { base, now }, addresses, stats, .. } = state;
    let Some(row) = addresses.row else { return };
    let fields = Fields::of(block, addresses);
    let before = events.len();
    events.resize(before + BLOCK, Event::default());
    // Its length is known to the compiler, so that no index needs a check.
    let Some(out) = events[before..].first_chunk_mut::<BLOCK>() else { return };
    let (mut event_bits, mut event_count, mut forward) = (addresses.row_bits(row), 0, 0u64);
    for i in 0..plain.min(BLOCK) {
        *base += i64::from(fields.jump[i]);
        let low = fields.low[i];
        let time = *base + i64::from(low);
        // A word that is no time counts as forward, because NO_TIME is later than any time.
        forward += u64::from(now.cast_unsigned() < time.cast_unsigned());
        *now = if low == NO_TIME { *now } else { time };
        event_bits = event_bits & fields.kept[i] | fields.set[i];
        // Each word writes an event, and only columns keep theirs.
        out[event_count % BLOCK] = Event::from_words(*now, event_bits);
        event_count += usize::from(fields.is_column[i]);
    }
    events.truncate(before + event_count);
    stats.times_not_increasing += plain as u64 - forward;
    addresses.row = Some(addresses.row_of(event_bits));
}
