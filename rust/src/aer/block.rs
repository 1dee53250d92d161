//! Times and addresses of a block of words, carried out without a branch between them.

use super::clock::{Clock, WRAP_BITS};
use super::fours::{FOURS, TOP, TOPS, any_of_upper_four, apart, hold, in_each, whole};
use super::pixels::Pixels;
use super::run::State;
use super::word::{COLUMN_OFF, LOW_12, LOW_15, ON, ROW, WRAP};
use crate::event::Event;

/// Words that are looked at together: a bit each.
pub(super) const BLOCK: usize = u64::BITS as usize;

/// Whether a word is the address of a column, in the array or beyond it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn is_column(word: u16) -> bool {
    (word & !ON).wrapping_sub(COLUMN_OFF) <= LOW_12
}

/// Flags, 0 or 1, as bits; the first is the lowest.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn bits(flags: &[u8; BLOCK]) -> u64 {
    let eights = flags.as_chunks::<8>().0.iter().enumerate();
    // Eight bytes of 0 or 1 to eight bits: each lands in the top byte at a place of its own.
    eights.fold(0, |bits, (i, eight)| {
        bits | u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56 << (8 * i)
    })
}

/// Carries out a block of neither wraps nor samples, many words at a time; reserved words in it do nothing.
///
/// For each word the time and the row that hold there, hence the event that it would be; then those of columns are kept.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "15 bits since the last wrap")]
pub(super) fn without_wraps(block: &[[u8; 2]; BLOCK], state: &mut State, events: &mut Vec<Event>) {
    let State { clock: Clock { base, now }, pixels, stats, .. } = state;
    let Some(row) = pixels.row else { return };
    let (mut fours, mut times, mut rows) = ([0; FOURS], [0; FOURS], [0; FOURS]);
    for (four, bytes) in fours.iter_mut().zip(block.as_flattened().as_chunks().0) {
        *four = u64::from_le_bytes(*bytes);
    }
    for ((four, time), row) in fours.iter().zip(&mut times).zip(&mut rows) {
        *time = four & whole(*four);
        *row = (four & in_each(LOW_12) | TOPS) & whole(!any_of_upper_four(four ^ in_each(ROW)));
    }
    let before = TOP | (*now - *base) as u16;
    let (held, last_time) = hold(&mut times, before);
    let (_, last_row) = hold(&mut rows, TOP | row);
    let mut any_late = 0;
    let mut late = [0; FOURS];
    for (i, late) in late.iter_mut().enumerate() {
        let earlier = times[i] << 16 | held[i] & u64::from(u16::MAX);
        // The difference keeps its top bit where it does not go forward.
        *late = ((earlier | TOPS) - (fours[i] & !TOPS)) & fours[i] & TOPS;
        any_late |= *late;
    }
    if any_late != 0 {
        stats.times_not_increasing += late.iter().map(|late| u64::from(late.count_ones())).sum::<u64>();
    }

    let (times, rows) = (apart(&times), apart(&rows));
    let mut all = [Event::default(); BLOCK];
    for (((event, bytes), time), row) in all.iter_mut().zip(block).zip(&times).zip(&rows) {
        let column = pixels.column_bits(u16::from_le_bytes(*bytes));
        *event = Event::from_words(*base + i64::from(time & LOW_15), pixels.row_bits(row & LOW_12) | column);
    }
    let mut columns = bits(&each(block, |word| u8::from(is_column(word))));
    events.extend((0..columns.count_ones()).map(|_| {
        let place = columns.trailing_zeros() as usize;
        columns &= columns - 1;
        all[place % BLOCK]
    }));
    *now = *base + i64::from(last_time & LOW_15);
    pixels.row = Some(last_row & LOW_12);
}

/// What the words of a block say, each kind apart.
struct Fields {
    /// The low part of a time; [`NO_TIME`] for what is none.
    low: [u32; BLOCK],
    /// What a wrap adds to the base.
    jump: [u32; BLOCK],
    /// What a word leaves of the fields of the event before, and what it sets.
    kept: [u64; BLOCK],
    set: [u64; BLOCK],
    is_column: [u8; BLOCK],
}

/// No time has it as its low part.
const NO_TIME: u32 = u32::MAX;

impl Fields {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
    fn of(block: &[[u8; 2]; BLOCK], pixels: &Pixels) -> Self {
        let is_wrap = |word: u16| word.wrapping_sub(WRAP) <= LOW_12;
        let is_row = |word: u16| word.wrapping_sub(ROW) <= LOW_12;
        let low = |word: u16| if is_wrap(word) { 0 } else { u32::from(word & LOW_15) };
        let (row, column) = (pixels.row_bits(LOW_12), pixels.column_bits(ON | LOW_12));
        Self {
            low: each(block, |word| if word >= WRAP { low(word) } else { NO_TIME }),
            jump: each(block, |word| if is_wrap(word) { u32::from(word & LOW_12) << WRAP_BITS } else { 0 }),
            kept: each(block, |word| {
                if is_row(word) {
                    !row
                } else if is_column(word) {
                    !column
                } else {
                    u64::MAX
                }
            }),
            set: each(block, |word| {
                let (row, column) = (pixels.row_bits(word & LOW_12), pixels.column_bits(word));
                if is_row(word) {
                    row
                } else if is_column(word) {
                    column
                } else {
                    0
                }
            }),
            is_column: each(block, |word| u8::from(is_column(word))),
        }
    }
}

/// A value of each word.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn each<T>(block: &[[u8; 2]; BLOCK], of: impl Fn(u16) -> T) -> [T; BLOCK] {
    block.map(|bytes| of(u16::from_le_bytes(bytes)))
}

/// Carries out the first `plain` words of a block, none of them a sample: one after the other, what they say being ready.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn with_wraps(block: &[[u8; 2]; BLOCK], plain: usize, state: &mut State, events: &mut Vec<Event>) {
    let State { clock: Clock { base, now }, pixels, stats, .. } = state;
    let Some(row) = pixels.row else { return };
    let fields = Fields::of(block, pixels);
    let before = events.len();
    events.resize(before + BLOCK, Event::default());
    // Its length is known to the compiler, so that no place needs a check.
    let Some(out) = events[before..].first_chunk_mut::<BLOCK>() else { return };
    let (mut place, mut event_count, mut forward) = (pixels.row_bits(row), 0, 0u64);
    for i in 0..plain.min(BLOCK) {
        *base += i64::from(fields.jump[i]);
        let low = fields.low[i];
        let time = *base + i64::from(low);
        // What is no time lies beyond all of them, and so counts as forward.
        forward += u64::from(now.cast_unsigned() < time.cast_unsigned());
        *now = if low == NO_TIME { *now } else { time };
        place = place & fields.kept[i] | fields.set[i];
        // Each word writes an event, and only columns keep theirs.
        out[event_count % BLOCK] = Event::from_words(*now, place);
        event_count += usize::from(fields.is_column[i]);
    }
    events.truncate(before + event_count);
    stats.times_not_increasing += plain as u64 - forward;
    pixels.row = Some(pixels.row_of(place));
}
