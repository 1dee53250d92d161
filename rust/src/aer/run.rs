//! The common path: runs of words that need no more than a look: times, addresses, samples.
//!
//! It does what [`Decoder`](super::Decoder) does word by word, for many words without a branch in between: which of them is a column
//! and which a time is as good as random, and a processor that guesses wrong loses more than all the work there is to do.

use multiversion::multiversion;

use super::clock::{Clock, WRAP_BITS};
use super::pixels::Pixels;
use super::readout::FrameAssembler;
use super::stats::Stats;
use super::word::{COLUMN_OFF, LOW_12, LOW_15, ON, ROW, SAMPLE, WRAP};
use crate::event::Event;

/// Words that are looked at together: a bit each.
const BLOCK: usize = u64::BITS as usize;

/// So many words between samples are worth a whole block's work.
const WORTH_A_BLOCK: usize = 20;

/// Words as they come: two bytes, low one first.
type Words = [[u8; 2]];

/// What plain words change, besides that they make events.
pub(super) struct State {
    pub(super) clock: Clock,
    pub(super) pixels: Pixels,
    pub(super) frames: FrameAssembler,
    pub(super) stats: Stats,
}

/// Carries out words for as long as they are plain ones; returns how many they were.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn run(words: &Words, state: &mut State, events: &mut Vec<Event>) -> usize {
    if state.pixels.row.is_none() || !state.clock.has_room_for(words.len()) {
        return 0;
    }
    let samples = if state.frames.takes_samples() { LOW_12 + 1 } else { 0 };
    let looked_for = Plain { rows: state.pixels.rows, columns: state.pixels.columns, samples };
    let mut done = 0;
    while done < words.len() {
        let rest = &words[done..];
        let mut padded = [[0; 2]; BLOCK];
        let block = rest.first_chunk::<BLOCK>().unwrap_or_else(|| {
            // Reserved words at the end are not plain.
            padded[..rest.len()].copy_from_slice(rest);
            &padded
        });
        let found = looked_for.look(block);
        if found.wraps && state.clock.overflows_within(block) {
            break;
        }
        carry_out_runs(block, &found, state, events);
        done += found.plain;
        if found.plain < BLOCK {
            break;
        }
    }
    done
}

/// What plain words are: those below each kind's first payload that is not.
struct Plain {
    rows: u16,
    columns: u16,
    samples: u16,
}

/// What a block holds.
struct Found {
    /// So many plain words, before another one or the end.
    plain: usize,
    /// Which of its words are samples: the lowest bit is the first word's.
    samples: u64,
    wraps: bool,
}

impl Plain {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
    fn look(&self, block: &[[u8; 2]; BLOCK]) -> Found {
        let (mut others, mut samples) = ([0; BLOCK], [0; BLOCK]);
        let (mut any_other, mut any_sample, mut any_wrap, mut all_samples) = (0, 0, 0, 1);
        for ((bytes, other), sample) in block.iter().zip(&mut others).zip(&mut samples) {
            let word = u16::from_le_bytes(*bytes);
            let time = u8::from(word >= WRAP);
            let row = u8::from(word.wrapping_sub(ROW) < self.rows);
            let column = u8::from((word & !ON).wrapping_sub(COLUMN_OFF) < self.columns);
            *sample = u8::from(word.wrapping_sub(SAMPLE) < self.samples);
            *other = 1 - (time | row | column | *sample);
            any_wrap |= u8::from(word.wrapping_sub(WRAP) <= LOW_12);
            any_other |= *other;
            any_sample |= *sample;
            all_samples &= *sample;
        }
        Found {
            plain: if any_other == 0 { BLOCK } else { bits(&others).trailing_zeros() as usize },
            samples: if all_samples != 0 {
                u64::MAX
            } else if any_sample != 0 {
                bits(&samples)
            } else {
                0
            },
            wraps: any_wrap != 0,
        }
    }
}

/// Flags, 0 or 1, as bits; the first is the lowest.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn bits(flags: &[u8; BLOCK]) -> u64 {
    let eights = flags.as_chunks::<8>().0.iter().enumerate();
    // Eight bytes of 0 or 1 to eight bits: each lands in the top byte at a place of its own.
    eights.fold(0, |bits, (i, eight)| {
        bits | u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56 << (8 * i)
    })
}

/// Carries out the plain words of a block, samples and others in turns.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn carry_out_runs(block: &[[u8; 2]; BLOCK], found: &Found, state: &mut State, events: &mut Vec<Event>) {
    let mut start = 0;
    while start < found.plain {
        let samples = found.samples >> start;
        let is_sample = samples & 1 == 1;
        let length = if is_sample { samples.trailing_ones() } else { samples.trailing_zeros() } as usize;
        let run = &block[start..found.plain.min(start + length)];
        start += run.len();
        if is_sample {
            state.frames.samples(run, &mut state.stats);
        } else if run.len() < WORTH_A_BLOCK {
            for &bytes in run {
                let word = u16::from_le_bytes(bytes);
                if word < WRAP {
                    state.pixels.address(word, state.clock.now, events, &mut state.stats);
                } else {
                    // Whether the drivers' 31 bits overflow was looked at before.
                    state.clock.advance(word, &mut state.stats);
                }
            }
        } else {
            let mut padded = [[0; 2]; BLOCK];
            let whole = run.first_chunk().unwrap_or_else(|| {
                padded[..run.len()].copy_from_slice(run);
                &padded
            });
            if found.wraps {
                carry_out::<true>(whole, run.len(), state, events);
            } else {
                carry_out_without_wraps(whole, state, events);
            }
        }
    }
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
        let is_column = |word: u16| (word & !ON).wrapping_sub(COLUMN_OFF) <= LOW_12;
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

/// Carries out the first `plain` words of a block, none of them a sample.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's code, for each kind of block")]
fn carry_out<const WRAPS: bool>(block: &[[u8; 2]; BLOCK], plain: usize, state: &mut State, events: &mut Vec<Event>) {
    let State { clock: Clock { base, now }, pixels, stats, .. } = state;
    let fields = Fields::of(block, pixels);
    let before = events.len();
    events.resize(before + BLOCK, Event::default());
    let (Some(row), Some(out)) = (pixels.row, events[before..].first_chunk_mut::<BLOCK>()) else { return };
    let (mut place, mut event_count, mut forward) = (pixels.row_bits(row), 0, 0u64);
    for i in 0..plain.min(BLOCK) {
        if WRAPS {
            *base += i64::from(fields.jump[i]);
        }
        let low = fields.low[i];
        let time = *base + i64::from(low);
        // What is no time lies beyond it, or is at least as good as forward.
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

/// Carries out a block without wraps and samples; reserved words in it do nothing.
///
/// For each word the time and the row that hold there, hence the event that it would be; then those of columns are kept.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "15 bits since the last wrap")]
fn carry_out_without_wraps(block: &[[u8; 2]; BLOCK], state: &mut State, events: &mut Vec<Event>) {
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
    let (times_before, last_time) = hold(&mut times, before);
    let (_, last_row) = hold(&mut rows, TOP | row);
    let mut any_late = 0;
    let mut late = [0; FOURS];
    for (i, late) in late.iter_mut().enumerate() {
        let time_before = times[i] << 16 | times_before[i] & u64::from(u16::MAX);
        // The difference keeps its top bit where it does not go forward.
        *late = (time_before | TOPS) - (fours[i] & !TOPS) & fours[i] & TOPS;
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
    let mut columns = bits(&each(block, |word| u8::from((word & !ON).wrapping_sub(COLUMN_OFF) <= LOW_12)));
    events.extend((0..columns.count_ones()).map(|_| {
        let place = columns.trailing_zeros() as usize;
        columns &= columns - 1;
        all[place % BLOCK]
    }));
    *now = *base + i64::from(last_time & LOW_15);
    pixels.row = Some(last_row & LOW_12);
}

/// The bit that tells a value from none, where payloads leave room for it.
const TOP: u16 = 0x8000;
const TOPS: u64 = in_each(TOP);

/// Words are taken four at a time, as one number.
const FOURS: usize = BLOCK / 4;

/// The same in each of four.
const fn in_each(value: u16) -> u64 {
    0x0001_0001_0001_0001 * value as u64
}

/// All bits of those whose top bit is set.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn whole(fours: u64) -> u64 {
    let tops = fours & TOPS;
    (tops - (tops >> 15)) | tops
}

/// The top bit of those of whose upper four bits any is set; the other bits mean nothing.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn any_of_upper_four(fours: u64) -> u64 {
    fours | fours << 1 | fours << 2 | fours << 3
}

/// Puts the last value before it in the place of each that is none (0; values have their top bits set).
///
/// `before` holds before the first. Returns what holds before each four, in all of four, and the last value.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one of four")]
fn hold(values: &mut [u64; FOURS], before: u16) -> ([u64; FOURS], u16) {
    for four in values.iter_mut() {
        *four |= *four << 16 & !whole(*four);
        *four |= *four << 32 & !whole(*four);
    }
    let (mut held, mut last) = ([0; FOURS], before);
    for (four, held) in values.iter().zip(&mut held) {
        *held = in_each(last);
        let own = (four >> 48) as u16;
        last = if own < TOP { last } else { own };
    }
    for (four, held) in values.iter_mut().zip(&held) {
        *four |= held & !whole(*four);
    }
    (held, last)
}

/// Four by four, one by one.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one of four")]
fn apart(fours: &[u64; FOURS]) -> [u16; BLOCK] {
    let mut ones = [0; BLOCK];
    for (four, ones) in fours.iter().zip(ones.as_chunks_mut::<4>().0) {
        *ones = [*four as u16, (four >> 16) as u16, (four >> 32) as u16, (four >> 48) as u16];
    }
    ones
}
