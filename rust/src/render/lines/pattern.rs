//! The pattern of lines in a tile: where they pass, and how they are cut into the cells of pixels.
//!
//! Lines rise by `climb` distances between neighbours over a pixel's width. So at each x a pixel has the same number of
//! lines, lengths add up to its area, and an edge along the image's rows is integrated exactly too.
//!
//! What must not break: all pixels have the same pattern, so that neighbouring tiles continue each other's lines.

use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::{BLOCK, BLOCKS, LANES, PIXELS, TILE};

/// How many lines a pixel has, in how many cells each is cut, by how many lines' distances one rises over a pixel, and
/// what the taps' positions in their cells are made of: position i of line number n is (n * generator / lines + offset)
/// modulo 1. These were chosen by the error of waves over a pixel.
const KINDS: [(usize, usize, usize, usize, f32); 3] =
    [(4, 2, 1, 2, 0.234_375), (8, 4, 3, 2, 0.117_187_5), (16, 4, 3, 10, 0.054_687_5)];

/// A piece of a line in one cell of one pixel: columns from the tile's left edge, in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub(crate) left: f32,
    pub(crate) right: f32,
    /// Where its tap lies, as a fraction of what is seen.
    pub(crate) phase: f32,
    /// By block and lane.
    pub(crate) pixel: u32,
}

/// Taps of pieces that are seen from end to end: columns and rows from the tile's corner, in pixels.
#[derive(Clone, Debug, Default)]
pub(crate) struct WholeTaps {
    pub(crate) column: Vec<f32>,
    pub(crate) row: Vec<f32>,
    pub(crate) weight: Vec<f32>,
    pub(crate) pixel: Vec<u32>,
}

impl WholeTaps {
    fn push(&mut self, column: f32, row: f32, weight: f32, pixel: u32) {
        self.column.push(column);
        self.row.push(row);
        self.weight.push(weight);
        self.pixel.push(pixel);
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
    /// Where each line enters the tile and leaves it: columns.
    pub(crate) lefts: Vec<f32>,
    pub(crate) rights: Vec<f32>,
    /// Of all lines, one after the other from left to right.
    pub(crate) pieces: Vec<Piece>,
    /// Of the pieces.
    pub(crate) taps: WholeTaps,
    /// Where the pieces of each cell of each line begin.
    by_cell: Vec<u32>,
    cells: f32,
    per_line: usize,
    /// The taps of a tile again, block by block, and in a block tap by tap, each of all of its pixels.
    pub(crate) blocks: WholeTaps,
    /// Where each piece's tap is in [`Self::blocks`].
    pub(crate) in_blocks: Vec<u32>,
}

impl LinePattern {
    /// Returns the pattern of so many lines a pixel.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for other numbers than 4, 8 and 16.
    pub fn new(lines: usize) -> Result<Self> {
        let Some(&(count, cells, climb, generator, offset)) = KINDS.iter().find(|kind| kind.0 == lines) else {
            return Err(Error::Argument(format!("a pixel has 4, 8 or 16 lines, got {lines}")));
        };
        Ok(Self::of_kind(count, cells, climb, generator, offset))
    }

    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
    #[allow(clippy::cast_sign_loss, reason = "positions in the tile are not negative")]
    fn of_kind(count: usize, cells: usize, climb: usize, generator: usize, offset: f32) -> Self {
        let (per_pixel, slope) = (count as f64, climb as f64 / count as f64);
        let side = TILE as f64;
        let mut pattern = Self {
            slope: slope as f32,
            weight: (1.0 / per_pixel) as f32,
            heights: vec![],
            lefts: vec![],
            rights: vec![],
            pieces: vec![],
            taps: WholeTaps::default(),
            by_cell: vec![],
            cells: cells as f32,
            per_line: TILE * cells + 1,
            blocks: WholeTaps::default(),
            in_blocks: vec![],
        };
        for number in 0..TILE * (count + climb) {
            let height = (number as f64 + 0.5) / per_pixel - slope * side;
            let (first, first_cell) = (pattern.pieces.len(), pattern.by_cell.len());
            for cell in 0..TILE * cells {
                pattern.by_cell.push(pattern.pieces.len() as u32);
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
                for cut in cuts.windows(2) {
                    let middle = height + slope * 0.5 * (cut[0] + cut[1]);
                    if (0.0..side).contains(&middle) {
                        let row = middle as usize;
                        let block = row / BLOCK * (TILE / BLOCK) + column / BLOCK;
                        let pixel = (block * LANES + row % BLOCK * BLOCK + column % BLOCK) as u32;
                        pattern.pieces.push(Piece { left: cut[0] as f32, right: cut[1] as f32, phase, pixel });
                    }
                }
            }
            pattern.by_cell.push(pattern.pieces.len() as u32);
            if let (Some(start), Some(end)) = (pattern.pieces.get(first), pattern.pieces.last()) {
                pattern.heights.push(height as f32);
                pattern.lefts.push(start.left);
                pattern.rights.push(end.right);
                let whole = Run { line: pattern.heights.len() - 1, left: start.left, right: end.right };
                for piece in first..pattern.pieces.len() {
                    let (column, row, weight) = pattern.tap(piece, &whole);
                    pattern.taps.push(column, row, weight, pattern.pieces[piece].pixel);
                }
            } else {
                pattern.by_cell.truncate(first_cell);
            }
        }
        pattern.arrange_blocks();
        let padded = pattern.heights.len().next_multiple_of(LANES);
        for (values, fill) in [(&mut pattern.heights, 0.0), (&mut pattern.lefts, 0.0), (&mut pattern.rights, -1.0)] {
            values.resize(padded, fill);
        }
        pattern
    }

    /// Puts the taps of each pixel side by side with those of its block's other pixels.
    #[allow(clippy::cast_possible_truncation, reason = "small numbers")]
    fn arrange_blocks(&mut self) {
        let mut of_pixels = vec![vec![]; PIXELS];
        for (piece, &pixel) in self.taps.pixel.iter().enumerate() {
            of_pixels[pixel as usize].push(piece);
        }
        self.in_blocks = vec![0; self.pieces.len()];
        for block in 0..BLOCKS {
            let of_block = &of_pixels[block * LANES..(block + 1) * LANES];
            for number in 0..of_block[0].len() {
                for piece in of_block.iter().map(|pieces| pieces[number]) {
                    self.in_blocks[piece] = self.blocks.pixel.len() as u32;
                    let taps = &self.taps;
                    self.blocks.push(taps.column[piece], taps.row[piece], taps.weight[piece], taps.pixel[piece]);
                }
            }
        }
    }

    /// Returns how many lists of [`LANES`] lines there are.
    pub(crate) fn lists(&self) -> usize {
        self.heights.len() / LANES
    }

    /// Returns the piece of a line that holds a column, or the one after its last.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "columns of a tile")]
    pub(crate) fn piece_at(&self, line: usize, column: f32) -> usize {
        let of_line = &self.by_cell[line * self.per_line..][..self.per_line];
        let cell = ((column * self.cells) as usize).min(self.per_line - 1);
        let (piece, end) = (of_line[cell] as usize, of_line[self.per_line - 1] as usize);
        if piece < end && self.pieces[piece].right <= column { piece + 1 } else { piece }
    }

    /// Returns the pieces that a run has a length in: from the first one on, before the second one.
    #[inline]
    pub(crate) fn pieces_in(&self, run: &Run) -> (usize, usize) {
        let (first, last) = (self.piece_at(run.line, run.left), self.piece_at(run.line, run.right));
        let end_of_line = self.by_cell[(run.line + 1) * self.per_line - 1] as usize;
        let begins_before = last < end_of_line && self.pieces[last].left < run.right;
        (first, last + usize::from(begins_before))
    }

    /// Returns column, row and weight of the tap of a piece where a run of its line is seen.
    #[inline]
    pub(crate) fn tap(&self, piece: usize, run: &Run) -> (f32, f32, f32) {
        let Piece { left, right, phase, .. } = self.pieces[piece];
        let (left, right) = (left.max(run.left), right.min(run.right));
        let column = left + phase * (right - left);
        (column, self.heights[run.line] + self.slope * column, self.weight * (right - left))
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

    /// In each pixel lengths add up to its area.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn each_pixel_has_its_area() {
        for lines in [4, 8, 16] {
            let pattern = LinePattern::new(lines).unwrap();
            let mut areas = [0.0; PIXELS];
            for (line, (&left, &right)) in pattern.lefts.iter().zip(&pattern.rights).enumerate() {
                if right < left {
                    continue;
                }
                let (first, end) = pattern.pieces_in(&Run { line, left, right });
                for piece in first..end {
                    let Piece { left, right, phase, pixel } = pattern.pieces[piece];
                    areas[pixel as usize] += pattern.weight * (right - left);
                    assert_eq!(pattern.taps.weight[piece], pattern.weight * (right - left));
                    let y = pattern.heights[line] + pattern.slope * 0.5 * (left + right);
                    assert!(y > 0.0 && y < TILE as f32 && left < right);
                    assert!((0.0..1.0).contains(&phase));
                }
            }
            assert!(areas.iter().all(|area| (area - 1.0).abs() < 1e-5), "{lines}: {areas:?}");
        }
        assert!(LinePattern::new(5).is_err());
    }

    /// Every pixel has its taps at the same positions in it, and they are arranged by blocks without a loss.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn every_pixel_has_the_same_taps() {
        for lines in [4, 8, 16] {
            let LinePattern { blocks, taps, in_blocks, .. } = LinePattern::new(lines).unwrap();
            let per_pixel = taps.pixel.len() / PIXELS;
            assert_eq!(per_pixel * PIXELS, blocks.pixel.len());
            for (piece, &at) in in_blocks.iter().enumerate() {
                let at = at as usize;
                assert_eq!((taps.column[piece], taps.row[piece]), (blocks.column[at], blocks.row[at]));
                assert_eq!((taps.weight[piece], taps.pixel[piece]), (blocks.weight[at], blocks.pixel[at]));
                let first = at / LANES * LANES;
                assert_eq!(blocks.pixel[at] as usize, first / LANES / per_pixel * LANES + at % LANES);
                assert!((blocks.column[at].fract() - blocks.column[first].fract()).abs() < 1e-5);
                assert!((blocks.row[at].fract() - blocks.row[first].fract()).abs() < 1e-5);
                assert!((blocks.weight[at] - blocks.weight[first]).abs() < 1e-6);
            }
        }
    }

    /// The piece at a column is the one that holds it.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn a_column_lies_in_its_piece() {
        for lines in [4, 8, 16] {
            let pattern = LinePattern::new(lines).unwrap();
            for line in (0..pattern.heights.len()).filter(|&line| pattern.rights[line] > pattern.lefts[line]) {
                let (left, right) = (pattern.lefts[line], pattern.rights[line]);
                for step in 0..500 {
                    let column = left + (right - left) * step as f32 / 500.0;
                    let piece = pattern.pieces[pattern.piece_at(line, column)];
                    assert!(piece.left <= column && column < piece.right, "{column} in {piece:?}");
                }
                let end = pattern.piece_at(line, right);
                assert_eq!(pattern.pieces[end - 1].right, right);
            }
        }
    }
}
