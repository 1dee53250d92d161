//! The fast path: decodes timestamps, wraps, addresses and frame samples, many words at a time.
//!
//! Nearly all words of a stream are of these kinds, which are called plain here. They act only on [`State`]. Which kind
//! comes next is hard to predict, so a decision at each word costs a mispredicted branch at nearly every word.
//! Therefore a block of 64 words is classified at once in vector code, and then decoded in runs:
//! - A run of frame samples is copied into the open frame.
//! - A long run of other words goes to [`super::block`], which has no branch at each word.
//! - A short run between samples is decoded word by word, because preparing a block would cost more.
//!
//! Decoding stops before the first word that is not plain. [`Decoder`](super::Decoder) then decodes that word by
//! itself.
//!
//! What must not break:
//! - The result is exactly that of the decoder word by word, counters included. The decoder's tests check this on
//!   random streams.
//! - Whatever needs a decision is left to the decoder: an address outside of the array, samples that no open frame
//!   takes, columns before any row, and wraps that overflow the drivers' 31-bit time or come near the end of the clock.
//! - The code is compiled for three processor levels (`multiversion`). What is called in a loop must be inlined, or it
//!   is compiled for the lowest level only.

use multiversion::multiversion;

use super::block::{bits, is_column, with_wraps, without_wraps};
use super::lanes::BLOCK;
use super::state::State;
use super::word::{COLUMN_OFF, LOW_12, ON, ROW, SAMPLE, WRAP};
use crate::event::Event;

/// The number of words between frame samples from which on decoding them as a block pays.
const MIN_BLOCK_RUN: usize = 20;

/// Words as they come: two bytes, low one first.
type Words = [[u8; 2]];

/// Decodes words up to the first one that is not plain. Returns how many it decoded.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn decode_plain_words(words: &Words, state: &mut State, events: &mut Vec<Event>) -> usize {
    if state.addresses.row.is_none() || !state.clock.has_room_for(words.len()) {
        return 0;
    }
    let samples = if state.frames.takes_samples() { LOW_12 + 1 } else { 0 };
    let limits = PlainLimits { rows: state.addresses.rows, columns: state.addresses.columns, samples };
    let mut done = 0;
    while done < words.len() {
        let rest = &words[done..];
        let mut padded = [[0; 2]; BLOCK];
        let block = rest.first_chunk::<BLOCK>().unwrap_or_else(|| {
            // Reserved words at the end are not plain.
            padded[..rest.len()].copy_from_slice(rest);
            &padded
        });
        let kinds = limits.classify(block);
        if kinds.wraps && state.clock.overflows_within(block) {
            break;
        }
        decode_runs(block, &kinds, state, events);
        done += kinds.plain;
        if kinds.plain < BLOCK {
            break;
        }
    }
    done
}

/// Returns the number of column addresses among words: an upper bound of the events that they make.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn count_columns(words: &[[u8; 2]]) -> usize {
    let in_block =
        |block: &[[u8; 2]]| block.iter().map(|bytes| u16::from(is_column(u16::from_le_bytes(*bytes)))).sum::<u16>();
    words.chunks(BLOCK).map(|block| usize::from(in_block(block))).sum()
}

/// Which words are plain: those whose payload lies below the limit of their kind.
struct PlainLimits {
    rows: u16,
    columns: u16,
    samples: u16,
}

/// What kinds of words a block has.
struct Classified {
    /// The number of plain words before the first other one, or before the end.
    plain: usize,
    /// A bit for each word, the lowest for the first: whether it is a frame sample.
    samples: u64,
    /// Whether any word is a wrap.
    wraps: bool,
}

impl PlainLimits {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
    fn classify(&self, block: &[[u8; 2]; BLOCK]) -> Classified {
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
        Classified {
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

/// Decodes the plain words of a block: runs of samples and runs of others, one after the other.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
fn decode_runs(block: &[[u8; 2]; BLOCK], kinds: &Classified, state: &mut State, events: &mut Vec<Event>) {
    let mut start = 0;
    while start < kinds.plain {
        let samples = kinds.samples >> start;
        let is_sample = samples & 1 == 1;
        let length = if is_sample { samples.trailing_ones() } else { samples.trailing_zeros() } as usize;
        let run = &block[start..kinds.plain.min(start + length)];
        start += run.len();
        if is_sample {
            state.frames.samples(run, &mut state.stats);
        } else if run.len() < MIN_BLOCK_RUN {
            for &bytes in run {
                let word = u16::from_le_bytes(bytes);
                if word < WRAP {
                    state.addresses.address(word, state.clock.now, events, &mut state.stats);
                } else {
                    // That the drivers' 31 bits do not overflow was checked before.
                    state.clock.advance(word, &mut state.stats);
                }
            }
        } else {
            let mut padded = [[0; 2]; BLOCK];
            let block = run.first_chunk().unwrap_or_else(|| {
                padded[..run.len()].copy_from_slice(run);
                &padded
            });
            if kinds.wraps {
                with_wraps(block, run.len(), state, events);
            } else {
                without_wraps(block, state, events);
            }
        }
    }
}
