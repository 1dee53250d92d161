//! Single pixels: which of a view's are rendered together, and their rays.
//!
//! Event times are found by asking for a few pixels of very many views. So nothing here may cost what a whole tile costs:
//! the rays of the pixels alone are gathered, and a view of which only one spot is wanted looks for triangles there and
//! nowhere else. A pixel keeps the bits that it has in a frame.

use super::linear::Rect;
use super::pixel_rays::{LANES, Part, PixelRays};

/// A single pixel: by view and tile first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sample {
    pub(super) view: u32,
    pub(super) tile: usize,
    pub(super) place: usize,
    /// Where its luma belongs.
    pub(super) index: usize,
}

/// Whether pixels lie in one spot: in tiles that touch each other.
pub(super) fn in_one_spot(rays: &PixelRays, samples: &[Sample]) -> bool {
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    for sample in samples {
        let at = [sample.tile % rays.columns, sample.tile / rays.columns];
        for axis in 0..2 {
            low[axis] = low[axis].min(at[axis]);
            high[axis] = high[axis].max(at[axis]);
        }
    }
    (0..2).all(|axis| high[axis] <= low[axis] + 1)
}

/// The rays of some pixels, one pixel after the other, as one block.
#[derive(Debug)]
pub(super) struct Pixels {
    x: Vec<f32>,
    y: Vec<f32>,
    around: Rect,
    count: usize,
}

impl Default for Pixels {
    fn default() -> Self {
        Self { x: vec![], y: vec![], around: Rect::NONE, count: 0 }
    }
}

impl Pixels {
    /// Takes the rays of other pixels.
    pub(super) fn gather(&mut self, rays: &PixelRays, samples: &[Sample]) {
        self.x.clear();
        self.y.clear();
        self.around = Rect::NONE;
        self.count = samples.len();
        for sample in samples {
            for (x, y) in rays.of_pixel(sample.tile, sample.place) {
                self.x.push(x);
                self.y.push(y);
                self.around.add(x, y);
            }
        }
        // Blocks have whole lanes: the last ray stands for what is missing.
        for values in [&mut self.x, &mut self.y] {
            let last = values.last().copied().unwrap_or_default();
            values.resize(values.len().next_multiple_of(LANES), last);
        }
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// What the rays lie in.
    pub(super) fn around(&self) -> &Rect {
        &self.around
    }

    pub(super) fn part(&self) -> Part<'_> {
        Part { x: &self.x, y: &self.y, around: &self.around, blocks: std::slice::from_ref(&self.around) }
    }
}
