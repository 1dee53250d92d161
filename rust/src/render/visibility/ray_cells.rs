//! Cells of a tile: finds which of its rays lie in a rectangle of the image, as bits.
//!
//! A small triangle is met by few of a tile's rays. To find them by its rectangle takes some operations on words, and
//! no ray has to be looked at. Rays may lie anywhere, so this holds for distorted lenses too.
//!
//! What must not break: a ray in the rectangle is always among those that are found. One too many costs only time.

use crate::render::geometry::pixel_rays::RayBlocks;

/// Rays of a word.
pub(super) const WORD: usize = u64::BITS as usize;

/// Cells along an axis, at most and at least; and for how many words of them there is room in the nearest cache.
const MOST_CELLS: usize = 64;
const FEWEST_CELLS: usize = 16;
const ROOM: usize = 1024;

/// The rays of a tile by columns and rows of cells.
#[derive(Debug, Default)]
pub(super) struct RayCells {
    /// How many words the rays take.
    pub(super) words: usize,
    cells: usize,
    low: [f32; 2],
    cells_per_unit: [f32; 2],
    /// Of each axis, cell by cell and for one more: which rays lie in a lower cell.
    below: [Vec<u64>; 2],
}

/// Some of the rays of a word, as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RayWord {
    pub(super) word: usize,
    pub(super) rays: u64,
}

/// First and last cell of a rectangle along each axis.
pub(super) type CellRange = [[usize; 2]; 2];

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl RayCells {
    /// Takes the rays of another tile; their number is a multiple of [`WORD`].
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "there are few cells")]
    pub(super) fn take(&mut self, ray_blocks: &RayBlocks) {
        self.words = ray_blocks.x.len() / WORD;
        self.cells = (ROOM / self.words).clamp(FEWEST_CELLS, MOST_CELLS);
        for (axis, values) in [ray_blocks.x, ray_blocks.y].into_iter().enumerate() {
            let size = ray_blocks.around.high[axis] - ray_blocks.around.low[axis];
            self.low[axis] = ray_blocks.around.low[axis];
            self.cells_per_unit[axis] = if size > 0.0 { self.cells as f32 / size } else { 0.0 };
            let mut below = std::mem::take(&mut self.below[axis]);
            below.clear();
            below.resize((self.cells + 1) * self.words, 0);
            for (word, values) in values.chunks_exact(WORD).enumerate() {
                for (ray, &value) in values.iter().enumerate() {
                    below[(self.cell(axis, value) + 1) * self.words + word] |= 1 << ray;
                }
            }
            for at in self.words..below.len() {
                below[at] |= below[at - self.words];
            }
            self.below[axis] = below;
        }
    }

    /// Returns the cell of a coordinate; coordinates beyond the tile are in its first or last cell.
    ///
    /// Each step is monotonic, so that what lies between two coordinates lies between their cells.
    #[inline(always)]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "what is negative or too large saturates"
    )]
    fn cell(&self, axis: usize, value: f32) -> usize {
        let cell = (value - self.low[axis]) * self.cells_per_unit[axis];
        (cell as u32 as usize).min(self.cells - 1)
    }

    /// Returns the cells of a rectangle.
    #[inline(always)]
    pub(super) fn range(&self, low: [f32; 2], high: [f32; 2]) -> CellRange {
        [0, 1].map(|axis| [self.cell(axis, low[axis]), self.cell(axis, high[axis])])
    }

    /// Finds the rays in cells, as words that have any, and puts them to the front of `found`, which has room for all;
    /// returns how many words these are.
    #[inline(always)]
    pub(super) fn rays_in(&self, range: CellRange, found: &mut [RayWord]) -> usize {
        let [columns, rows] = range;
        let row = |axis: usize, cell: usize| &self.below[axis][cell * self.words..][..self.words];
        let (left, right) = (row(0, columns[0]), row(0, columns[1] + 1));
        let (top, bottom) = (row(1, rows[0]), row(1, rows[1] + 1));
        let found = &mut found[..self.words];
        let mut count = 0;
        for word in 0..self.words {
            let rays = right[word] & !left[word] & bottom[word] & !top[word];
            // What is not wanted is overwritten by the next: that takes less time than to branch.
            found[count.min(word)] = RayWord { word, rays };
            count += usize::from(rays != 0);
        }
        count
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::render::geometry::linear::Rect;
    use proptest::prelude::*;

    /// Returns the rays of each word.
    fn words_in(cells: &RayCells, low: [f32; 2], high: [f32; 2]) -> Vec<u64> {
        let mut found = vec![RayWord { word: 7, rays: u64::MAX }; cells.words];
        let count = cells.rays_in(cells.range(low, high), &mut found);
        let mut words = vec![0; cells.words];
        for RayWord { word, rays } in &found[..count] {
            assert!(*rays != 0 && words[*word] == 0);
            words[*word] = *rays;
        }
        words
    }

    proptest! {
        /// Every ray of a rectangle is found, and none that is more than two cells away.
        #[test]
        fn rays_are_found(
            values in prop::collection::vec((-3f32..5.0, -0.1f32..0.1), 64), repeats in 1usize..20,
            corners in prop::array::uniform4(-6f32..6.0), flat in prop::bool::ANY,
        ) {
            let (mut x, mut y): (Vec<f32>, Vec<f32>) = values.iter().copied().unzip();
            if flat {
                x.fill(0.25);
            }
            (x, y) = (x.repeat(repeats), y.repeat(repeats));
            let mut around = Rect::NONE;
            x.iter().zip(&y).for_each(|(&x, &y)| around.add(x, y));
            let mut cells = RayCells::default();
            cells.take(&RayBlocks { x: &x, y: &y, around: &around, blocks: &[around] });
            let low = [corners[0].min(corners[1]), 0.02 * corners[2].min(corners[3])];
            let high = [corners[0].max(corners[1]), 0.02 * corners[2].max(corners[3])];
            let words = words_in(&cells, low, high);
            for ray in 0..x.len() {
                let is_in_words = words[ray / WORD] >> (ray % WORD) & 1 == 1;
                let inside = |axis: usize, value: f32, by: f32| low[axis] - by <= value && value <= high[axis] + by;
                if inside(0, x[ray], 0.0) && inside(1, y[ray], 0.0) {
                    prop_assert!(is_in_words);
                }
                let size = |axis: usize| 2.0 * (around.high[axis] - around.low[axis]) / cells.cells as f32;
                // What lies beyond all rays is taken to lie in the cells at the border.
                let beyond = |axis: usize| low[axis] > around.high[axis] || high[axis] < around.low[axis];
                if !beyond(0) && !beyond(1) && is_in_words {
                    prop_assert!(inside(0, x[ray], size(0)) && inside(1, y[ray], size(1)));
                }
            }
        }
    }

    /// A rectangle of everything holds all rays, and one without end does too.
    #[test]
    fn everything_is_found() {
        let x: Vec<f32> = (0..128u8).map(f32::from).collect();
        let around = Rect { low: [0.0, 0.0], high: [127.0, 127.0] };
        let mut cells = RayCells::default();
        cells.take(&RayBlocks { x: &x, y: &x, around: &around, blocks: &[around] });
        for (low, high) in [(0.0, 127.0), (f32::NEG_INFINITY, f32::INFINITY)] {
            assert_eq!(words_in(&cells, [low; 2], [high; 2]), [u64::MAX; 2]);
        }
        assert_eq!(words_in(&cells, [10.0, 50.0], [20.0, 60.0]), [0; 2]);
    }
}
