//! The pattern of lines in a tile: where they pass, and how they are cut into the cells of pixels.
//!
//! Lines rise by `climb` distances between neighbours over a pixel's width. So at each x a pixel has the same number of
//! lines, lengths add up to its area, and an edge along the image's rows is integrated exactly too.
//!
//! What must not break: all pixels have the same pattern, so that neighbouring tiles continue each other's lines.

use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::{BLOCK, LANES, TILE};

/// How many lines a pixel has, in how many cells each is cut, by how many lines' distances one rises over a pixel, and
/// what the taps' positions in their cells are made of: position i of line number n is (n * generator / lines + offset)
/// modulo 1. These were chosen by the error of waves over a pixel.
const KINDS: [(usize, usize, usize, usize, f32); 3] =
    [(4, 2, 1, 2, 0.234_375), (8, 4, 3, 2, 0.117_187_5), (16, 4, 3, 10, 0.054_687_5)];

/// A part of a line in one cell of one pixel: columns from the tile's left edge, in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub(crate) left: f32,
    pub(crate) right: f32,
    /// Where its tap lies, as a fraction of what is seen.
    pub(crate) phase: f32,
    /// By block and lane.
    pub(crate) pixel: u32,
}

/// A line through the tile, y = height + slope x, with its pieces from left to right.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) height: f32,
    pub(crate) pieces: Vec<Piece>,
}

/// The lines of a tile.
#[derive(Clone, Debug)]
pub struct LinePattern {
    pub(crate) slope: f32,
    /// The area that a line stands for, per length, in pixels.
    pub(crate) weight: f32,
    pub(crate) lines: Vec<Line>,
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
        Ok(Self::of(count, cells, climb, generator, offset))
    }

    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
    #[allow(clippy::cast_sign_loss, reason = "positions in the tile are not negative")]
    fn of(count: usize, cells: usize, climb: usize, generator: usize, offset: f32) -> Self {
        let (per_pixel, slope) = (count as f64, climb as f64 / count as f64);
        let side = TILE as f64;
        let mut lines = vec![];
        for number in 0..TILE * (count + climb) {
            let height = (number as f64 + 0.5) / per_pixel - slope * side;
            let mut pieces = vec![];
            for cell in 0..TILE * cells {
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
                        let pixel = block * LANES + row % BLOCK * BLOCK + column % BLOCK;
                        pieces.push(Piece { left: cut[0] as f32, right: cut[1] as f32, phase, pixel: pixel as u32 });
                    }
                }
            }
            if !pieces.is_empty() {
                lines.push(Line { height: height as f32, pieces });
            }
        }
        Self { slope: slope as f32, weight: (1.0 / per_pixel) as f32, lines }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::pixel_rays::PIXELS;

    /// In each pixel lengths add up to its area.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn each_pixel_has_its_area() {
        for lines in [4, 8, 16] {
            let pattern = LinePattern::new(lines).unwrap();
            let mut areas = [0.0; PIXELS];
            for line in &pattern.lines {
                for piece in &line.pieces {
                    areas[piece.pixel as usize] += pattern.weight * (piece.right - piece.left);
                    let y = line.height + pattern.slope * 0.5 * (piece.left + piece.right);
                    assert!(y > 0.0 && y < TILE as f32 && piece.left < piece.right);
                    assert!((0.0..1.0).contains(&piece.phase));
                }
            }
            assert!(areas.iter().all(|area| (area - 1.0).abs() < 1e-5), "{lines}: {areas:?}");
        }
        assert!(LinePattern::new(5).is_err());
    }
}
