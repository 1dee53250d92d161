//! Taps: where what lines see is shaded, with the pixel and the area that each counts for.
//!
//! The taps of a triangle follow each other, so that they are shaded in place. Of pieces that are seen from end to end
//! they are copied from the pattern; only those at the ends of what is seen are worked out. A tile that sees one
//! triangle alone has its taps by blocks, as rays are.
//!
//! What must not break: the taps of a pixel have its area as their weight.

use super::envelope::{Envelopes, LEAST};
use super::pattern::{LinePattern, Run};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{BLOCKS, LANES, PIXELS};
use crate::render::visibility::bins::{Entry, Seen};

/// How many sums a pixel's taps are added up in: neighbours on a line need not wait for each other.
const SUMS: usize = 4;

/// A part of a line that sees one triangle, or nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenRun {
    pub(super) run: Run,
    /// In the tile's list, or its length for nothing.
    pub(super) index: u32,
    /// Its pieces, of the pattern's.
    pieces: (u32, u32),
    /// Its first tap.
    tap: u32,
}

/// The taps of a tile.
#[derive(Debug, Default)]
pub(crate) struct Taps {
    pub(crate) x: Vec<f32>,
    pub(crate) y: Vec<f32>,
    weight: Vec<f32>,
    pixel: Vec<u8>,
    /// Where those of each triangle of the list begin and end, and then those that see nothing.
    ranges: Vec<[u32; 2]>,
    /// Whether they are those of [`LinePattern::blocks`].
    by_blocks: bool,
    runs: Vec<SeenRun>,
    envelopes: Envelopes,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 taps")]
impl Taps {
    /// Finds the taps of a tile whose pixels have a pitch, in undistorted coordinates; `part` begins at its corner.
    #[inline(always)]
    pub(crate) fn find(
        &mut self,
        pattern: &LinePattern,
        (seen, list): (&[Seen], &[Entry]),
        part: &Rect,
        pitch: [f64; 2],
    ) {
        self.by_blocks = matches!(list, [] | [Entry { covers: true, .. }]);
        let count = if self.by_blocks {
            let count = pattern.blocks.column.len();
            self.ranges.clear();
            self.ranges.resize(list.len() + 1, [count as u32; 2]);
            self.ranges[0][0] = 0;
            count
        } else {
            self.envelopes.find(pattern, (seen, list), part, pitch);
            self.split(pattern, list.len())
        };
        for values in [&mut self.x, &mut self.y, &mut self.weight] {
            values.resize(count, 0.0);
        }
        self.pixel.resize(count, 0);
        if self.by_blocks {
            place(&pattern.blocks.column, &mut self.x, pitch[0], (part.low[0], part.high[0]));
            place(&pattern.blocks.row, &mut self.y, pitch[1], (part.low[1], part.high[1]));
        } else {
            self.fill(pattern);
            place_all(&mut self.x, pitch[0], (part.low[0], part.high[0]));
            place_all(&mut self.y, pitch[1], (part.low[1], part.high[1]));
        }
    }

    /// Splits lines into what sees one triangle of the list each, and counts the taps; returns their number.
    fn split(&mut self, pattern: &LinePattern, list: usize) -> usize {
        let Self { runs, ranges, envelopes, .. } = self;
        runs.clear();
        ranges.clear();
        ranges.resize(list + 1, [0; 2]);
        let mut add = |line: usize, left: f32, right: f32, index: u32| {
            if right - left <= LEAST {
                return;
            }
            let run = Run { line, left, right };
            let (first, end) = pattern.pieces_in(&run);
            ranges[index as usize][1] += (end - first) as u32;
            runs.push(SeenRun { run, index, pieces: (first as u32, end as u32), tap: 0 });
        };
        let behind = envelopes.behind.unwrap_or(list as u32);
        for (line, (&start, &end)) in pattern.lefts.iter().zip(&pattern.rights).enumerate() {
            if end < start {
                continue;
            }
            let mut at = start;
            for segment in &envelopes.segments[line] {
                add(line, at, segment.left, behind);
                add(line, segment.left, segment.right, envelopes.candidates[segment.candidate as usize].index);
                at = segment.right;
            }
            add(line, at, end, behind);
        }
        // Each triangle's are followed by room for one vector, because they are copied as vectors.
        let mut start = 0;
        for range in ranges {
            let count = range[1];
            *range = [start; 2];
            start += count + if count > 0 { LANES as u32 } else { 0 };
        }
        start as usize
    }

    /// Fills in the taps of all runs: columns and rows in the tile.
    #[inline(always)]
    fn fill(&mut self, pattern: &LinePattern) {
        for SeenRun { run, index, pieces: (first, end), tap } in &mut self.runs {
            let (first, end) = (*first as usize, *end as usize);
            let range = &mut self.ranges[*index as usize];
            *tap = range[1];
            let to = range[1] as usize;
            range[1] += (end - first) as u32;
            let whole = &pattern.taps;
            copy(&whole.column[first..], &mut self.x[to..], end - first);
            copy(&whole.row[first..], &mut self.y[to..], end - first);
            copy(&whole.weight[first..], &mut self.weight[to..], end - first);
            copy(&whole.pixel[first..], &mut self.pixel[to..], end - first);
            if run.left > pattern.lefts[run.line] {
                (self.x[to], self.y[to], self.weight[to]) = pattern.tap(first, run);
            }
            if run.right < pattern.rights[run.line] {
                let tap = to + end - 1 - first;
                (self.x[tap], self.y[tap], self.weight[tap]) = pattern.tap(end - 1, run);
            }
        }
        for &[start, end] in &self.ranges {
            if end > start {
                self.weight[end as usize..][..LANES].fill(0.0);
            }
        }
    }

    /// Returns each pixel's luma, by that of the taps.
    #[inline(always)]
    pub(crate) fn add_up(&self, pattern: &LinePattern, luma: &[f32]) -> [f32; PIXELS] {
        let mut pixels = [0.0; PIXELS];
        if self.by_blocks {
            let length = luma.len() / BLOCKS;
            let weights = pattern.blocks.weight.chunks_exact(length);
            let of_blocks = luma.chunks_exact(length).zip(weights);
            for ((luma, weights), pixels) in of_blocks.zip(pixels.chunks_exact_mut(LANES)) {
                for (luma, weights) in luma.chunks_exact(LANES).zip(weights.chunks_exact(LANES)) {
                    for i in 0..LANES {
                        pixels[i] += weights[i] * luma[i];
                    }
                }
            }
            return pixels;
        }
        let mut sums = [[0.0; PIXELS]; SUMS];
        for (tap, ((&luma, &weight), &pixel)) in luma.iter().zip(&self.weight).zip(&self.pixel).enumerate() {
            sums[tap % SUMS][pixel as usize % PIXELS] += weight * luma;
        }
        for i in 0..PIXELS {
            pixels[i] = (sums[0][i] + sums[1][i]) + (sums[2][i] + sums[3][i]);
        }
        pixels
    }

    /// Calls `work` with each line where it sees the triangle at an index, and with what gives the tap of a piece there.
    pub(super) fn each_run(
        &self,
        pattern: &LinePattern,
        index: u32,
        mut work: impl FnMut(&Run, &dyn Fn(usize) -> usize),
    ) {
        if self.by_blocks {
            for (line, (&left, &right)) in pattern.lefts.iter().zip(&pattern.rights).enumerate() {
                if right > left {
                    work(&Run { line, left, right }, &|piece| pattern.in_blocks[piece] as usize);
                }
            }
            return;
        }
        for SeenRun { run, pieces: (first, _), tap, .. } in self.runs.iter().filter(|seen| seen.index == index) {
            work(run, &|piece| *tap as usize + piece - *first as usize);
        }
    }

    /// Returns the weight of a tap.
    pub(super) fn weight(&self, pattern: &LinePattern, tap: usize) -> f32 {
        if self.by_blocks { pattern.blocks.weight[tap] } else { self.weight[tap] }
    }

    /// Returns what a tap sees; None for nothing.
    pub(super) fn hit(&self, tap: usize) -> Option<u32> {
        let tap = tap as u32;
        let index = self.ranges.iter().position(|&[start, end]| (start..end).contains(&tap))?;
        (index + 1 < self.ranges.len()).then_some(index as u32)
    }

    pub(super) fn range(&self, index: u32) -> std::ops::Range<usize> {
        let [start, end] = self.ranges[index as usize];
        start as usize..end as usize
    }
}

/// Copies so many values, and some more, as whole vectors.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn copy<T: Copy>(from: &[T], to: &mut [T], count: usize) {
    let mut done = 0;
    while done < count {
        to[done..done + LANES].copy_from_slice(&from[done..done + LANES]);
        done += LANES;
    }
}

/// Returns undistorted coordinates of columns or rows of a tile.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn place(from: &[f32], to: &mut [f32], pitch: f64, (low, high): (f32, f32)) {
    let pitch = pitch as f32;
    for (to, from) in to.iter_mut().zip(from) {
        let coordinate = low + from * pitch;
        *to = if coordinate < high { coordinate } else { high };
    }
}

/// As [`place`], in place.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn place_all(values: &mut [f32], pitch: f64, (low, high): (f32, f32)) {
    let pitch = pitch as f32;
    for value in values {
        let coordinate = low + *value * pitch;
        let coordinate = if coordinate > low { coordinate } else { low };
        *value = if coordinate < high { coordinate } else { high };
    }
}
