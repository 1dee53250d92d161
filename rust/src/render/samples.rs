//! Single pixels: groups those of a view that are rendered together, and gathers their rays.
//!
//! Event times are found by asking for a few pixels of very many views. So the cost of a whole tile must be avoided:
//! only the rays of the pixels are gathered, and if all pixels of a view are close together, triangles are searched for
//! only there.
//!
//! What must not break: a pixel has the same bits as in a frame.

use super::geometry::linear::Rect;
use super::geometry::pixel_rays::{LANES, PixelRays, RayBlocks};

/// A single pixel: by view and tile first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Sample {
    pub(crate) view: u32,
    pub(crate) tile: usize,
    pub(crate) in_tile: usize,
    /// Where its luma belongs.
    pub(crate) index: usize,
}

/// Sorts pixels, each of a view, by view and then by tile.
///
/// Many views are asked for few pixels each: they are counted into their positions, and only those of a view are
/// compared.
pub(crate) fn sorted(rays: &PixelRays, views: usize, pixels: &[(u32, u32)]) -> Vec<Sample> {
    let mut starts = vec![0; views + 1];
    for (view, _) in pixels {
        starts[*view as usize + 1] += 1;
    }
    for view in 0..views {
        starts[view + 1] += starts[view];
    }
    let mut order = vec![Sample { view: 0, tile: 0, in_tile: 0, index: 0 }; pixels.len()];
    for (index, &(view, pixel)) in pixels.iter().enumerate() {
        let (tile, in_tile) = rays.tile_of(pixel as usize);
        order[starts[view as usize]] = Sample { view, tile, in_tile, index };
        starts[view as usize] += 1;
    }
    for samples in order.chunk_by_mut(|a, b| a.view == b.view) {
        samples.sort_unstable();
    }
    order
}

/// Returns whether pixels lie in one spot: in tiles that touch each other.
pub(crate) fn in_one_spot(rays: &PixelRays, samples: &[Sample]) -> bool {
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
pub(crate) struct Pixels {
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
    pub(crate) fn gather(&mut self, rays: &PixelRays, samples: &[Sample]) {
        let rays_of_pixel = rays.rays();
        let count = samples.len() * rays_of_pixel;
        self.count = samples.len();
        for values in [&mut self.x, &mut self.y] {
            values.resize(count.next_multiple_of(LANES), 0.0);
        }
        let pixels = self.x.chunks_exact_mut(rays_of_pixel).zip(self.y.chunks_exact_mut(rays_of_pixel));
        for (sample, (x, y)) in samples.iter().zip(pixels) {
            rays.copy_pixel(sample.tile, sample.in_tile, x, y);
        }
        // Blocks have whole lanes: the last ray stands for what is missing.
        for values in [&mut self.x, &mut self.y] {
            let last = count.checked_sub(1).map_or(0.0, |last| values[last]);
            values[count..].fill(last);
        }
        self.around = Rect::around::<LANES>(&self.x, &self.y);
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Returns what the rays lie in.
    pub(crate) fn around(&self) -> &Rect {
        &self.around
    }

    pub(crate) fn ray_blocks(&self) -> RayBlocks<'_> {
        RayBlocks { x: &self.x, y: &self.y, around: &self.around, blocks: std::slice::from_ref(&self.around) }
    }
}
