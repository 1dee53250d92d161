//! The common path: runs of words that need no more than a look: times, addresses, samples.
//!
//! It does what [`Decoder`](super::Decoder) does word by word, for many words without a branch in between: which of them is a column
//! and which a time is as good as random, and a processor that guesses wrong loses more than all the work there is to do.

use multiversion::multiversion;

use super::block::{BLOCK, bits, is_column, with_wraps, without_wraps};
use super::clock::Clock;
use super::pixels::Pixels;
use super::readout::FrameAssembler;
use super::stats::Stats;
use super::word::{COLUMN_OFF, LOW_12, ON, ROW, SAMPLE, WRAP};
use crate::event::Event;

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

/// The number of columns among words: no more events come of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn count_columns(words: &[[u8; 2]]) -> usize {
    let in_block =
        |block: &[[u8; 2]]| block.iter().map(|bytes| u16::from(is_column(u16::from_le_bytes(*bytes)))).sum::<u16>();
    words.chunks(BLOCK).map(|block| usize::from(in_block(block))).sum()
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
                with_wraps(whole, run.len(), state, events);
            } else {
                without_wraps(whole, state, events);
            }
        }
    }
}
