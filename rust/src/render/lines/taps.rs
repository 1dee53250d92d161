//! Taps: where what lines see is shaded, with the pixel and the area that each counts for.
//!
//! The taps of a triangle follow each other, so that they are shaded in place. Of pieces that are seen from end to end
//! they are copied from the pattern; only those at the ends of what is seen are worked out. A tile that sees one
//! triangle alone has its taps by blocks, as rays are.
//!
//! What must not break:
//! - The taps of a pixel have its area as their weight.
//! - A pixel's taps are added up in an order that does not depend on those of other pixels.

use std::ops::Range;

use super::envelope::{Envelopes, Segment};
use super::intervals::LEAST;
use super::pattern::{LineEnds, LinePattern, Run, SUMS};
use super::warp::Warp;
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{BLOCKS, LANES, PIXELS};
use crate::render::visibility::bins::{Bins, Entry};

/// A stretch of a line that sees one triangle, or nothing.
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
    /// In undistorted coordinates.
    pub(crate) x: Vec<f32>,
    pub(crate) y: Vec<f32>,
    /// In the tile's pixels, where they are not those of [`LinePattern::blocks`].
    column: Vec<f32>,
    row: Vec<f32>,
    weight: Vec<f32>,
    pixel: Vec<u8>,
    /// Where those of each triangle of the list begin and end, and then those that see nothing.
    ranges: Vec<[u32; 2]>,
    /// Whether they are those of [`LinePattern::blocks`].
    by_blocks: bool,
    /// As they are found, line by line.
    by_line: Vec<SeenRun>,
    /// Triangle by triangle, those of each line by line.
    runs: Vec<SeenRun>,
    /// Where the runs of each triangle of the list begin and end, and then those that see nothing.
    run_ranges: Vec<[u32; 2]>,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 taps")]
impl Taps {
    /// Finds the taps of a tile on lines with these ends, in undistorted coordinates; `all` says whether these are all
    /// lines.
    #[inline(always)]
    pub(crate) fn find<TileWarp: Warp>(
        &mut self,
        (pattern, ends, all): (&LinePattern, &LineEnds, bool),
        (bins, list): (&Bins, &[Entry]),
        warp: &TileWarp,
        envelopes: &mut Envelopes<TileWarp::Depth>,
    ) {
        self.by_blocks = all && matches!(list, [] | [Entry { covers: true, .. }]);
        let count = if self.by_blocks {
            let count = pattern.blocks.column.len();
            self.ranges.clear();
            self.ranges.resize(list.len() + 1, [count as u32; 2]);
            self.ranges[0][0] = 0;
            count
        } else {
            envelopes.find((pattern, ends), (bins, list), warp);
            self.split((pattern, ends), envelopes, list.len())
        };
        self.x.resize(count, 0.0);
        self.y.resize(count, 0.0);
        if self.by_blocks {
            warp.undistort((&pattern.blocks.column, &pattern.blocks.row), (&mut self.x, &mut self.y));
            return;
        }
        for values in [&mut self.column, &mut self.row, &mut self.weight] {
            values.resize(count, 0.0);
        }
        self.pixel.resize(count, 0);
        self.fill(pattern);
        warp.undistort((&self.column, &self.row), (&mut self.x, &mut self.y));
    }

    /// Splits lines into what sees one triangle of the list each, and counts the taps; returns their number.
    fn split<Depth>(
        &mut self,
        (pattern, ends): (&LinePattern, &LineEnds),
        envelopes: &Envelopes<Depth>,
        list: usize,
    ) -> usize {
        let Self { by_line, runs, ranges, run_ranges, .. } = self;
        by_line.clear();
        run_ranges.clear();
        run_ranges.resize(list + 1, [0; 2]);
        ranges.clear();
        ranges.resize(list + 1, [0; 2]);
        let mut add = |run: Run, index: u32, (piece, end_of_line): (&mut usize, usize)| {
            if run.right - run.left <= LEAST {
                return;
            }
            let (first, end, holds_end) = pattern.pieces_from(*piece, &run, end_of_line);
            *piece = holds_end;
            ranges[index as usize][1] += (end - first) as u32;
            run_ranges[index as usize][1] += 1;
            by_line.push(SeenRun { run, index, pieces: (first as u32, end as u32), tap: 0 });
        };
        let behind = envelopes.behind.unwrap_or(list as u32);
        for (line, start, end) in ends.each() {
            let (mut piece, end_of_line) = pattern.pieces_of(line);
            let mut at = start;
            for &Segment { left, right, candidate } in &envelopes.segments[line] {
                let index = envelopes.candidates[candidate as usize].index;
                add(Run { line, left: at, right: left }, behind, (&mut piece, end_of_line));
                add(Run { line, left, right }, index, (&mut piece, end_of_line));
                at = right;
            }
            add(Run { line, left: at, right: end }, behind, (&mut piece, end_of_line));
        }
        // Each triangle's are followed by room for one vector, because they are copied as vectors.
        let mut start = 0;
        for range in ranges {
            let count = range[1];
            *range = [start; 2];
            start += count + if count > 0 { LANES as u32 } else { 0 };
        }
        let mut first = 0;
        for range in run_ranges {
            let count = range[1];
            *range = [first; 2];
            first += count;
        }
        if let Some(&any) = by_line.first() {
            runs.resize(by_line.len(), any);
        }
        start as usize
    }

    /// Fills in the taps of all runs: columns and rows in the tile.
    #[inline(always)]
    fn fill(&mut self, pattern: &LinePattern) {
        for seen in &self.by_line {
            let SeenRun { run, index, pieces: (first, end), .. } = seen;
            let (first, end) = (*first as usize, *end as usize);
            let range = &mut self.ranges[*index as usize];
            let number = &mut self.run_ranges[*index as usize][1];
            self.runs[*number as usize] = SeenRun { tap: range[1], ..*seen };
            *number += 1;
            let to = range[1] as usize;
            range[1] += (end - first) as u32;
            let whole = &pattern.taps;
            copy(&whole.column[first..], &mut self.column[to..], end - first);
            copy(&whole.row[first..], &mut self.row[to..], end - first);
            copy(&whole.weight[first..], &mut self.weight[to..], end - first);
            copy(&whole.pixel[first..], &mut self.pixel[to..], end - first);
            for (tap, piece) in pattern.cut_taps(run, (first, end)).into_iter().zip([first, end - 1]) {
                if let Some(values) = tap {
                    let at = to + piece - first;
                    (self.column[at], self.row[at], self.weight[at]) = values;
                }
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
            let of_pixels = pattern.blocks.pixel.chunks_exact(length);
            let of_blocks = luma.chunks_exact(length).zip(weights).zip(of_pixels);
            for (((luma, weights), of), pixels) in of_blocks.zip(pixels.chunks_exact_mut(LANES)) {
                let mut sums = [[0.0; LANES]; SUMS];
                let taps = luma.chunks_exact(LANES).zip(weights.chunks_exact(LANES)).zip(of.chunks_exact(LANES));
                for ((luma, weights), of) in taps {
                    // The same of all pixels of the block.
                    let sums = &mut sums[of[0] as usize / PIXELS];
                    for i in 0..LANES {
                        sums[i] += weights[i] * luma[i];
                    }
                }
                for i in 0..LANES {
                    pixels[i] = (sums[0][i] + sums[1][i]) + (sums[2][i] + sums[3][i]);
                }
            }
            return pixels;
        }
        let mut sums = [[0.0; PIXELS]; SUMS];
        for ((&luma, &weight), &pixel) in luma.iter().zip(&self.weight).zip(&self.pixel) {
            sums[pixel as usize / PIXELS][pixel as usize % PIXELS] += weight * luma;
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
            for (line, left, right) in pattern.ends.each() {
                work(&Run { line, left, right }, &|piece| pattern.in_blocks[piece] as usize);
            }
            return;
        }
        for SeenRun { run, pieces: (first, _), tap, .. } in self.runs_of(index) {
            work(run, &|piece| *tap as usize + piece - *first as usize);
        }
    }

    fn runs_of(&self, index: u32) -> &[SeenRun] {
        let [start, end] = self.run_ranges[index as usize];
        &self.runs[start as usize..end as usize]
    }

    /// Returns what the lines that see the triangle at an index lie in there, in undistorted coordinates, and the lists of
    /// [`LANES`] lines that they are in.
    pub(super) fn around(&self, pattern: &LinePattern, index: u32, warp: &impl Warp) -> (Rect, Range<usize>) {
        let runs = if self.by_blocks { &[] } else { self.runs_of(index) };
        let (Some(first), Some(last)) = (runs.first(), runs.last()) else {
            return (*warp.rect(), pattern.ends.lists.clone());
        };
        let mut around = Rect::NONE;
        for SeenRun { run: Run { line, left, right }, .. } in runs {
            let row = |column: f32| pattern.heights[*line] + pattern.slope * column;
            around.add(*left, row(*left));
            around.add(*right, row(*right));
        }
        (warp.around(&around), first.run.line / LANES..last.run.line / LANES + 1)
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

    pub(super) fn range(&self, index: u32) -> Range<usize> {
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
