//! What is shaded in a tile: rays or taps, sorted by the triangle that they see.
//!
//! [`tile`](super::tile) shades both in the same way; they differ in how they are sorted, and in how shadows fall on
//! them.
//!
//! What must not break: each ray or tap is in the rows or the scattered ones of exactly one triangle.

use super::geometry::linear::Rect;
use super::geometry::pixel_rays::BLOCKS;
use super::light::cast::Caster;
use super::light::lights::Surroundings;
use super::visibility::bins::Seen;
use super::visibility::nearest::{NOTHING, Nearest};
use super::visibility::sorted::Sorted;

/// What the rays of a tile hit, as indices in the tile's list of triangles.
pub(crate) trait TileHits {
    /// Whether what throws shadows is searched for each triangle alone, around what is seen of it; else for several
    /// together.
    const ALONE: bool;

    /// Returns what the rays that see the triangle at an index lie in, where it is alone; else [`Rect::NONE`].
    fn around(&self, index: u32) -> Rect;

    /// Returns whether any ray sees the triangle at an index.
    fn sees(&self, index: u32) -> bool;

    /// Returns what a ray sees; None for nothing.
    fn hit(&self, ray: usize) -> Option<u32>;

    /// Finds the rays that see the triangle at an index; without `rows` all of them are scattered.
    fn sort(&self, index: u32, rows: bool, sorted: &mut Sorted);

    /// Returns what each ray sees, where some rays of a row see another triangle.
    fn indices(&self) -> &[u32];

    /// Finds how much of each light reaches the rays that see the triangle at an index, from what was found to throw
    /// shadows on it; says whether it did: else single rays are to be looked at.
    fn cast(&mut self, lit: &Surroundings, caster: &mut Caster, seen: &Seen, index: u32) -> bool;
}

impl TileHits for Nearest {
    const ALONE: bool = false;

    fn around(&self, _: u32) -> Rect {
        Rect::NONE
    }

    fn sees(&self, index: u32) -> bool {
        self.only.contains(&index) || self.counts[index as usize] != [0; BLOCKS]
    }

    fn hit(&self, ray: usize) -> Option<u32> {
        let index = match self.only[ray / self.length] {
            NOTHING => self.index[ray],
            only => only,
        };
        (index != NOTHING).then_some(index)
    }

    fn sort(&self, index: u32, rows: bool, sorted: &mut Sorted) {
        sorted.of_triangle(self, index, rows);
    }

    fn indices(&self) -> &[u32] {
        &self.index
    }

    fn cast(&mut self, _: &Surroundings, _: &mut Caster, _: &Seen, _: u32) -> bool {
        false
    }
}
