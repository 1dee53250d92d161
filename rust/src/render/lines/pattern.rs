//! The pattern of lines in a tile: where they pass, and how they are cut into the cells of pixels.
//!
//! Lines rise by `climb` distances between neighbours over a pixel's width. So at each x a pixel has the same number of
//! lines, lengths add up to its area, and an edge along the image's rows is integrated exactly too.
//!
//! What must not break: all pixels have the same pattern, so that neighbouring tiles continue each other's lines.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::{BLOCK, BLOCKS, LANES, PIXELS, TILE};

/// How many lines a pixel has, in how many cells each is cut, by how many lines' distances one rises over a pixel, and
/// what the taps' positions in their cells are made of: position i of line number n is (n * generator / lines + offset)
/// modulo 1. These were chosen by the error of waves over a pixel.
const KINDS: [(usize, usize, usize, usize, f32); 4] =
    [(4, 2, 1, 2, 0.234_375), (8, 4, 3, 2, 0.117_187_5), (16, 4, 3, 10, 0.054_687_5), (64, 4, 7, 14, 0.013_7)];

/// In how many sums the taps of a pixel are added up.
pub(crate) const SUMS: usize = 4;

/// Where a line that is left out ends: before it begins.
const NO_LENGTH: f32 = -1.0;

/// Taps of pieces that are seen from end to end: columns and rows from the tile's corner, in pixels. [`LANES`] of no
/// weight follow them, so that they can be copied as whole vectors.
#[derive(Clone, Debug, Default)]
pub(crate) struct WholeTaps {
    pub(crate) column: Vec<f32>,
    pub(crate) row: Vec<f32>,
    pub(crate) weight: Vec<f32>,
    /// By block and lane, in the lower six bits; in the upper two, which of its sums the tap is added to.
    pub(crate) pixel: Vec<u8>,
}

impl WholeTaps {
    fn pad(&mut self) {
        for _ in 0..LANES {
            self.push(0.0, 0.0, 0.0, 0);
        }
    }

    fn push(&mut self, column: f32, row: f32, weight: f32, pixel: u8) {
        self.column.push(column);
        self.row.push(row);
        self.weight.push(weight);
        self.pixel.push(pixel);
    }
}

/// Where lines enter the tile and leave it: columns. Lines that are left out have no length.
#[derive(Clone, Debug, Default)]
pub(crate) struct LineEnds {
    pub(crate) lefts: Vec<f32>,
    pub(crate) rights: Vec<f32>,
    /// The lists of [`LANES`] lines that hold all others.
    pub(crate) lists: Range<usize>,
}

impl LineEnds {
    /// Returns the lines that have a length, with their ends.
    pub(crate) fn each(&self) -> impl Iterator<Item = (usize, f32, f32)> + '_ {
        let lines = self.lists.start * LANES..self.lists.end * LANES;
        lines.map(|line| (line, self.lefts[line], self.rights[line])).filter(|(_, left, right)| right > left)
    }
}

/// The lines of a tile, y = height + slope x, from top to bottom. Lists of them end with lines of no length, so that
/// their number is a multiple of [`LANES`].
#[derive(Clone, Debug)]
pub struct LinePattern {
    pub(crate) slope: f32,
    /// The area that a line stands for, per length, in pixels.
    pub(crate) weight: f32,
    pub(crate) heights: Vec<f32>,
    /// Of all lines.
    pub(crate) ends: LineEnds,
    /// The pixels that each line passes: bits, by block and lane.
    passed: Vec<u64>,
    /// Where each piece begins: a line in one cell of one pixel. Those of a line follow each other from left to right.
    starts: Vec<f32>,
    /// Where the tap of each piece lies, as a fraction of what is seen.
    phases: Vec<f32>,
    /// Of the pieces.
    pub(crate) taps: WholeTaps,
    /// Where the pieces of each cell of each line begin; of each line its end too.
    by_cell: Vec<u16>,
    cells: f32,
    per_line: usize,
    /// The taps of a tile again, block by block, and in a block tap by tap, each of all of its pixels.
    pub(crate) blocks: WholeTaps,
    /// Where each piece's tap is in [`Self::blocks`].
    pub(crate) in_blocks: Vec<u16>,
}

impl LinePattern {
    /// Returns the pattern of so many lines a pixel.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for other numbers than 4, 8, 16 and 64.
    pub fn new(lines: usize) -> Result<Self> {
        let Some(&(count, cells, climb, generator, offset)) = KINDS.iter().find(|kind| kind.0 == lines) else {
            return Err(Error::Argument(format!("a pixel has 4, 8, 16 or 64 lines, got {lines}")));
        };
        Ok(Self::of_kind(count, cells, climb, generator, offset))
    }

    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
    #[allow(clippy::cast_sign_loss, reason = "positions in the tile are not negative")]
    fn of_kind(count: usize, cells: usize, climb: usize, generator: usize, offset: f32) -> Self {
        let (per_pixel, slope) = (count as f64, climb as f64 / count as f64);
        let side = TILE as f64;
        let mut pixels = vec![];
        let mut pattern = Self {
            slope: slope as f32,
            weight: (1.0 / per_pixel) as f32,
            heights: vec![],
            ends: LineEnds::default(),
            passed: vec![],
            starts: vec![],
            phases: vec![],
            taps: WholeTaps::default(),
            by_cell: vec![],
            cells: cells as f32,
            per_line: TILE * cells + 1,
            blocks: WholeTaps::default(),
            in_blocks: vec![],
        };
        for number in 0..TILE * (count + climb) {
            let height = (number as f64 + 0.5) / per_pixel - slope * side;
            let (first, first_cell) = (pattern.starts.len(), pattern.by_cell.len());
            let mut end = 0f32;
            for cell in 0..TILE * cells {
                pattern.by_cell.push(pattern.starts.len() as u16);
                let (left, right) = (cell as f64 / cells as f64, (cell + 1) as f64 / cells as f64);
                let (low, high) = (height + slope * left, height + slope * right);
                let border = high.floor();
                let mut cuts = vec![left, right];
                if border > low + 1e-9 && border < high - 1e-9 {
                    cuts.insert(1, (border - height) / slope);
                }
                let column = cell / cells;
                // The line's number in the pixel where it enters the column: the same in each pixel.
                let entry = ((height + slope * column as f64) * per_pixel).floor().rem_euclid(per_pixel);
                let phase = (entry as f32 * generator as f32 / count as f32 + offset).fract();
                // Neighbours on a line are added up apart: they need not wait for each other.
                let sum = (entry as usize * cells + cell % cells) % SUMS;
                for cut in cuts.windows(2) {
                    let middle = height + slope * 0.5 * (cut[0] + cut[1]);
                    if (0.0..side).contains(&middle) {
                        let row = middle as usize;
                        let block = row / BLOCK * (TILE / BLOCK) + column / BLOCK;
                        let pixel = (sum * PIXELS + block * LANES + row % BLOCK * BLOCK + column % BLOCK) as u8;
                        pattern.starts.push(cut[0] as f32);
                        pattern.phases.push(phase);
                        pixels.push(pixel);
                        end = cut[1] as f32;
                    }
                }
            }
            pattern.by_cell.push(pattern.starts.len() as u16);
            if let Some(&start) = pattern.starts.get(first) {
                pattern.heights.push(height as f32);
                pattern.ends.lefts.push(start);
                pattern.ends.rights.push(end);
                pattern.passed.push(pixels[first..].iter().fold(0, |all, &pixel| all | 1 << (pixel as usize % PIXELS)));
                let whole = Run { line: pattern.heights.len() - 1, left: start, right: end };
                for piece in first..pattern.starts.len() {
                    let (column, row, weight) = pattern.tap(piece, &whole);
                    pattern.taps.push(column, row, weight, pixels[piece]);
                }
            } else {
                pattern.by_cell.truncate(first_cell);
            }
        }
        pattern.arrange_blocks();
        pattern.taps.pad();
        let padded = pattern.heights.len().next_multiple_of(LANES);
        let LineEnds { lefts, rights, lists } = &mut pattern.ends;
        for (values, fill) in [(&mut pattern.heights, 0.0), (lefts, 0.0), (rights, NO_LENGTH)] {
            values.resize(padded, fill);
        }
        pattern.passed.resize(padded, 0);
        *lists = 0..padded / LANES;
        pattern
    }

    /// Chooses the lines that pass any of some pixels, which are bits, by block and lane.
    pub(crate) fn choose(&self, pixels: u64, chosen: &mut LineEnds) {
        let passes = |passed: &u64| passed & pixels != 0;
        let right = |(&right, passed): (&f32, &u64)| if passes(passed) { right } else { NO_LENGTH };
        chosen.lefts.clone_from(&self.ends.lefts);
        chosen.rights.clear();
        chosen.rights.extend(self.ends.rights.iter().zip(&self.passed).map(right));
        let first = self.passed.iter().position(passes).unwrap_or(0);
        let end = self.passed.iter().rposition(passes).map_or(0, |last| last + 1);
        chosen.lists = first / LANES..end.div_ceil(LANES);
    }

    /// Puts the taps of each pixel side by side with those of its block's other pixels.
    #[allow(clippy::cast_possible_truncation, reason = "small numbers")]
    fn arrange_blocks(&mut self) {
        let mut of_pixels = vec![vec![]; PIXELS];
        for (piece, &pixel) in self.taps.pixel.iter().enumerate() {
            of_pixels[pixel as usize % PIXELS].push(piece);
        }
        self.in_blocks = vec![0; self.starts.len()];
        for block in 0..BLOCKS {
            let of_block = &of_pixels[block * LANES..(block + 1) * LANES];
            for number in 0..of_block[0].len() {
                for piece in of_block.iter().map(|pieces| pieces[number]) {
                    self.in_blocks[piece] = self.blocks.pixel.len() as u16;
                    let taps = &self.taps;
                    self.blocks.push(taps.column[piece], taps.row[piece], taps.weight[piece], taps.pixel[piece]);
                }
            }
        }
    }

    /// Returns the lists of [`LANES`] lines that hold all those between two heights: the first one, and the one after the
    /// last. They are all of them where a height is not a number.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the lines")]
    #[allow(clippy::cast_precision_loss, reason = "a small number")]
    pub(crate) fn lists_between(&self, low: f64, high: f64) -> (usize, usize) {
        let per_height = 1.0 / f64::from(self.weight);
        let lists = self.heights.len() / LANES;
        let at = |height: f64| (height - f64::from(self.heights[0])) * per_height;
        // Roundings are far less than a hundredth of the distance of two lines.
        let (first, last) = ((at(low) - 0.01).ceil(), (at(high) + 0.01).floor());
        let end = if last < (lists * LANES) as f64 { (last.max(-1.0) + 1.0) as usize } else { lists * LANES };
        (lists.min(first.max(0.0) as usize / LANES), end.div_ceil(LANES))
    }

    /// Returns the pieces of a line: from the first one on, before the second one.
    pub(crate) fn pieces_of(&self, line: usize) -> (usize, usize) {
        let of_line = &self.by_cell[line * self.per_line..][..self.per_line];
        (of_line[0] as usize, of_line[self.per_line - 1] as usize)
    }

    /// Returns the piece of a line that holds a column, of those before the end of the line.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "columns of a tile")]
    fn piece_at(&self, line: usize, column: f32, end: usize) -> usize {
        let cell = ((column * self.cells) as usize).min(self.per_line - 2);
        let piece = self.by_cell[line * self.per_line + cell] as usize;
        // A cell has two pieces where the line goes from one pixel to another in it.
        self.not_before(piece, column, end).min(end - 1)
    }

    /// Returns a piece, or the next one where that begins before a column, of those before the end of their line.
    #[inline]
    fn not_before(&self, piece: usize, column: f32, end: usize) -> usize {
        piece + usize::from(piece + 1 < end && self.starts[piece + 1] <= column)
    }

    /// Returns the pieces that a run has a length in, from the first one on, before the second one; and the one that
    /// holds its end. `first` holds its beginning or the end of the run before it, `end` is that of the line.
    #[inline]
    pub(crate) fn pieces_from(&self, first: usize, run: &Run, end: usize) -> (usize, usize, usize) {
        let first = self.not_before(first, run.left, end);
        if run.right >= self.ends.rights[run.line] {
            return (first, end, end - 1);
        }
        let last = self.piece_at(run.line, run.right, end);
        (first, last + usize::from(self.starts[last] < run.right), last)
    }

    /// Returns the pieces that a run has a length in: from the first one on, before the second one.
    #[inline]
    pub(crate) fn pieces_in(&self, run: &Run) -> (usize, usize) {
        let (_, end) = self.pieces_of(run.line);
        let (first, last, _) = self.pieces_from(self.piece_at(run.line, run.left, end), run, end);
        (first, last)
    }

    /// Returns column, row and weight of the tap of a piece where a run of its line is seen.
    #[inline]
    pub(crate) fn tap(&self, piece: usize, run: &Run) -> (f32, f32, f32) {
        let (_, end) = self.pieces_of(run.line);
        let right = if piece + 1 < end { self.starts[piece + 1].min(run.right) } else { run.right };
        self.tap_between(piece, &Run { line: run.line, left: self.starts[piece].max(run.left), right })
    }

    /// Returns the same of a piece that the run lies in.
    #[inline]
    fn tap_between(&self, piece: usize, run: &Run) -> (f32, f32, f32) {
        let column = run.left + self.phases[piece] * (run.right - run.left);
        (column, self.heights[run.line] + self.slope * column, self.weight * (run.right - run.left))
    }

    /// Returns the taps of the first and of the last piece of a run, where these are seen in part.
    #[inline]
    pub(crate) fn cut_taps(&self, run: &Run, (first, end): (usize, usize)) -> [Option<(f32, f32, f32)>; 2] {
        let single = end - first == 1;
        let cut = [run.left > self.ends.lefts[run.line], run.right < self.ends.rights[run.line]];
        let right = if single { run.right } else { self.starts[first + 1] };
        let left = if single { run.left } else { self.starts[end - 1] };
        [
            cut[0].then(|| self.tap_between(first, &Run { right, ..*run })),
            cut[1].then(|| self.tap_between(end - 1, &Run { left, ..*run })),
        ]
    }
}

/// A line between two columns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) line: usize,
    pub(crate) left: f32,
    pub(crate) right: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In each pixel lengths add up to its area, also where lines are cut anywhere.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn each_pixel_has_its_area() {
        for lines in [4, 8, 16, 64] {
            let pattern = LinePattern::new(lines).unwrap();
            for cuts in 1..40 {
                let mut areas = [0.0; PIXELS];
                for (line, start, end) in pattern.ends.each() {
                    let at =
                        |cut: usize| if cut == cuts { end } else { start + (end - start) * cut as f32 / cuts as f32 };
                    for cut in 0..cuts {
                        let run = Run { line, left: at(cut), right: at(cut + 1) };
                        let (first, last) = pattern.pieces_in(&run);
                        for (tap, piece) in pattern.cut_taps(&run, (first, last)).iter().zip([first, last - 1]) {
                            assert!(tap.is_none_or(|tap| tap == pattern.tap(piece, &run)));
                        }
                        for piece in first..last {
                            let (column, row, weight) = pattern.tap(piece, &run);
                            assert!(weight > 0.0 && run.left <= column && column <= run.right);
                            let pixel = pattern.taps.pixel[piece] as usize % PIXELS;
                            let (block, lane) = (pixel / LANES, pixel % LANES);
                            let left = (block % 2 * BLOCK + lane % BLOCK) as f32;
                            let top = (block / 2 * BLOCK + lane / BLOCK) as f32;
                            assert!((left - 1e-5..=left + 1.0 + 1e-5).contains(&column), "{column} {left}");
                            assert!((top - 1e-5..=top + 1.0 + 1e-5).contains(&row), "{row} {top}");
                            areas[pixel] += weight;
                        }
                    }
                }
                assert!(areas.iter().all(|area| (area - 1.0).abs() < 1e-4), "{lines}, {cuts}: {areas:?}");
            }
        }
        assert!(LinePattern::new(5).is_err());
    }

    /// Every pixel has its taps at the same positions in it, and they are arranged by blocks without a loss.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn every_pixel_has_the_same_taps() {
        for lines in [4, 8, 16, 64] {
            let LinePattern { blocks, taps, in_blocks, .. } = LinePattern::new(lines).unwrap();
            let per_pixel = in_blocks.len() / PIXELS;
            assert_eq!(per_pixel * PIXELS, blocks.pixel.len());
            for (piece, &at) in in_blocks.iter().enumerate() {
                let at = at as usize;
                assert_eq!((taps.column[piece], taps.row[piece]), (blocks.column[at], blocks.row[at]));
                assert_eq!((taps.weight[piece], taps.pixel[piece]), (blocks.weight[at], blocks.pixel[at]));
                let first = at / LANES * LANES;
                assert_eq!(blocks.pixel[at] as usize % PIXELS, first / LANES / per_pixel * LANES + at % LANES);
                assert_eq!(blocks.pixel[at] as usize / PIXELS, blocks.pixel[first] as usize / PIXELS);
                assert!((blocks.column[at].fract() - blocks.column[first].fract()).abs() < 1e-5);
                assert!((blocks.row[at].fract() - blocks.row[first].fract()).abs() < 1e-5);
                assert!((blocks.weight[at] - blocks.weight[first]).abs() < 1e-6);
            }
        }
    }
}
