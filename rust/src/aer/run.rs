//! The common path: runs of words that need no more than a look: times, addresses, samples.
//!
//! It does what [`Decoder`](super::Decoder) does word by word, for many words without a branch in between: which of
//! them is a column and which a time is as good as random, and a processor that guesses wrong loses more than all the
//! work there is to do.

use multiversion::multiversion;

use super::clock::{Clock, WRAP_BITS};
use super::readout::FrameAssembler;
use super::stats::Stats;
use super::word::{COLUMN_OFF, LOW_12, LOW_15, ON, ROW, SAMPLE, TIMESTAMP, WRAP};
use crate::event::Event;

/// Words that are looked at together.
const BLOCK: usize = 64;

/// So many samples that follow upon each other are worth being copied as such.
const ENOUGH_SAMPLES: usize = 8;

/// The array of the sensor's event pixels, and the row that was addressed last.
pub(super) struct Pixels {
    pub(super) columns: u16,
    pub(super) rows: u16,
    /// Whether columns of the wire are rows of the image.
    pub(super) swapped: bool,
    pub(super) row: Option<u16>,
}

impl Pixels {
    /// The event of a column's word in a row.
    #[inline]
    pub(super) fn event(&self, t: i64, row: u16, word: u16) -> Event {
        let column = word & LOW_12;
        let (x, y) = if self.swapped { (row, column) } else { (column, row) };
        Event::new(t, x, y, word & ON != 0)
    }
}

/// Carries out words for as long as they are plain ones; returns how many they were.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn run(
    words: &[[u8; 2]],
    pixels: &mut Pixels,
    clock: &mut Clock,
    frames: &mut FrameAssembler,
    events: &mut Vec<Event>,
    stats: &mut Stats,
) -> usize {
    let Some(mut row) = pixels.row else { return 0 };
    if !clock.has_room_for(words.len()) {
        return 0;
    }
    let samples = if frames.takes_samples() { LOW_12 + 1 } else { 0 };
    let looked_for = Plain { rows: pixels.rows, columns: pixels.columns, samples };
    let mut done = 0;
    while done < words.len() {
        let (block, loaded) = load(&words[done..]);
        let found = looked_for.look(&block);
        let plain = found.plain.min(loaded);
        if found.leading_samples >= ENOUGH_SAMPLES {
            let leading = found.leading_samples.min(plain);
            frames.samples(&block[..leading], stats);
            done += leading;
            continue;
        }
        let words = &block[..plain];
        row = match (found.wraps, found.samples) {
            (false, false) => carry_out::<false, false>(words, row, pixels, clock, frames, events, stats),
            (false, true) => carry_out::<false, true>(words, row, pixels, clock, frames, events, stats),
            _ if clock.overflows_within(words) => break,
            _ => carry_out::<true, true>(words, row, pixels, clock, frames, events, stats),
        };
        done += plain;
        if plain < BLOCK {
            break;
        }
    }
    pixels.row = Some(row);
    done
}

/// The next words, up to a block of them, and how many they are; what lacks is reserved words, which are not plain.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn load(words: &[[u8; 2]]) -> ([u16; BLOCK], usize) {
    if let Some(whole) = words.first_chunk::<BLOCK>() {
        return (whole.map(u16::from_le_bytes), BLOCK);
    }
    let mut block = [0; BLOCK];
    for (word, bytes) in block.iter_mut().zip(words) {
        *word = u16::from_le_bytes(*bytes);
    }
    (block, words.len())
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
    /// So many samples before anything else.
    leading_samples: usize,
    samples: bool,
    wraps: bool,
}

impl Plain {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
    fn look(&self, block: &[u16; BLOCK]) -> Found {
        let (mut others, mut no_samples) = ([0; BLOCK], [0; BLOCK]);
        let (mut any_other, mut any_sample, mut any_wrap) = (0, 0, 0);
        for ((word, other), no_sample) in block.iter().zip(&mut others).zip(&mut no_samples) {
            let sample = u8::from(word.wrapping_sub(SAMPLE) < self.samples);
            let wrap = u8::from(word.wrapping_sub(WRAP) <= LOW_12);
            let time = u8::from(*word >= WRAP);
            let row = u8::from(word.wrapping_sub(ROW) < self.rows);
            let column = u8::from((word & !ON).wrapping_sub(COLUMN_OFF) < self.columns);
            *other = 1 - (time | row | column | sample);
            *no_sample = 1 - sample;
            any_other |= *other;
            any_sample |= sample;
            any_wrap |= wrap;
        }
        Found {
            plain: if any_other == 0 { BLOCK } else { first_set(&others) },
            leading_samples: if any_sample == 0 { 0 } else { first_set(&no_samples) },
            samples: any_sample != 0,
            wraps: any_wrap != 0,
        }
    }
}

/// The place of the first flag that is set.
fn first_set(flags: &[u8; BLOCK]) -> usize {
    let groups = flags.as_chunks::<8>().0.iter().map(|flags| u64::from_le_bytes(*flags));
    groups
        .enumerate()
        .find(|(_, group)| *group != 0)
        .map_or(BLOCK, |(i, group)| 8 * i + group.trailing_zeros() as usize / 8)
}

/// Carries plain words out; returns the row that was addressed last.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's code, for each kind of block")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch")]
fn carry_out<const WRAPS: bool, const SAMPLES: bool>(
    words: &[u16],
    mut row: u16,
    pixels: &Pixels,
    clock: &mut Clock,
    frames: &mut FrameAssembler,
    events: &mut Vec<Event>,
    stats: &mut Stats,
) -> u16 {
    let Clock { mut base, mut now } = *clock;
    let (mut event_count, mut sample_count, mut not_increasing) = (0, 0, 0);
    let mut samples = [0; BLOCK];
    let before = events.len();
    events.resize(before + BLOCK, Event::default());
    let Some(out) = events[before..].first_chunk_mut::<BLOCK>() else { return row };
    for &word in words {
        if WRAPS && word.wrapping_sub(WRAP) <= LOW_12 {
            base += i64::from(word & LOW_12) << WRAP_BITS;
        }
        let low = if WRAPS && word < TIMESTAMP { 0 } else { word & LOW_15 };
        let (is_time, time) = (word >= WRAP, base + i64::from(low));
        not_increasing += u64::from(is_time & (time <= now));
        now = if is_time { time } else { now };
        row = if word.wrapping_sub(ROW) <= LOW_12 { word & LOW_12 } else { row };
        // Each word writes an event, and only columns keep theirs.
        out[event_count % BLOCK] = pixels.event(now, row, word);
        event_count += usize::from((word & !ON).wrapping_sub(COLUMN_OFF) <= LOW_12);
        if SAMPLES {
            samples[sample_count % BLOCK] = word;
            sample_count += usize::from(word.wrapping_sub(SAMPLE) <= LOW_12);
        }
    }
    events.truncate(before + event_count);
    *clock = Clock { base, now };
    stats.times_not_increasing += not_increasing;
    if SAMPLES && sample_count > 0 {
        frames.samples(&samples[..sample_count], stats);
    }
    row
}
