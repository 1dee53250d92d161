//! Beams: finds the triangle that each of a tile's rays hits first by a walk through the BVH from front to back.
//!
//! All rays of a tile walk together. Where triangles are small, that costs less than to sort all of a view's triangles
//! into its tiles ([`super::bins`]): what lies behind the first surface is never looked at. A triangle is decided at
//! the corners of blocks, then at those of pixels, and then at the rays of the pixels that are left.
//!
//! What must not break: a ray sees the same triangle, with the same bits, as by bins. So a triangle is tested by the
//! same [`Seen`], and of equally near ones the first in the scene wins, which is the first that a visit to the BVH
//! finds.

use std::ops::Range;

use super::bins::{Cover, Entry, NEARER, Pyramid, Seen};
use super::nearest::{NOTHING, Nearest, least};
use super::set_up::set_up;
use crate::prefetch::prefetch;
use crate::render::geometry::bvh::{self, Leaves, WIDTH, Waiting};
use crate::render::geometry::linear::Linear;
use crate::render::geometry::pixel_rays::{BLOCKS, LANES, Part};
use crate::render::geometry::view::{Pose, View};
use crate::render::scene::Scene;

/// Rays of a pixel that are tested together.
const TOGETHER: usize = 8;

/// The triangles that the rays of one tile see.
#[derive(Debug, Default)]
pub(crate) struct Beam {
    /// Those that are seen by any ray, in the order of the scene.
    pub(crate) seen: Vec<Seen>,
    /// All that any ray saw before it saw a nearer one.
    tested: Vec<Seen>,
    pixels: Pixels,
    /// Buffers of the walk.
    set_up: Vec<Seen>,
    waiting: Vec<Waiting>,
    /// Of each triangle that was tested its index among those that are seen.
    indices: Vec<u32>,
    /// Those that are seen, by their numbers in the scene, and their indices among those that were tested.
    order: Vec<(u32, u32)>,
}

/// The rays of a tile pixel by pixel, and what they see so far.
#[derive(Debug, Default)]
struct Pixels {
    /// Whether the tile's rays are here: they are brought when the first triangle is.
    taken: bool,
    /// Rays of a pixel; the last one stands for what is missing of a multiple of [`TOGETHER`].
    rays: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    /// The index of what each ray sees among those that were tested, and its inverse depth.
    index: Vec<u32>,
    inverse_depth: Vec<f32>,
    /// What the rays of each pixel lie in, by block: lowest and highest x, lowest and highest y.
    around: Vec<[[f32; LANES]; 4]>,
    /// Of each block the inverse depth behind which nothing is seen.
    closed: [f32; BLOCKS],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Pixels {
    /// Takes the rays of another tile.
    #[inline(always)]
    fn take(&mut self, part: &Part) {
        self.taken = true;
        let rays = part.x.len() / (part.blocks.len() * LANES);
        self.rays = rays.next_multiple_of(TOGETHER);
        let count = part.blocks.len() * LANES * self.rays;
        for values in [&mut self.x, &mut self.y, &mut self.inverse_depth] {
            values.resize(count, 0.0);
        }
        self.inverse_depth.fill(0.0);
        self.index.clear();
        self.index.resize(count, NOTHING);
        self.around.clear();
        for block in 0..part.blocks.len() {
            let mut around = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]].repeat(2);
            for (which, (from, to)) in [(part.x, &mut self.x), (part.y, &mut self.y)].into_iter().enumerate() {
                for ray in 0..self.rays {
                    let group = &from[(block * rays + ray.min(rays - 1)) * LANES..][..LANES];
                    for pixel in 0..LANES {
                        let value = group[pixel];
                        to[(block * LANES + pixel) * self.rays + ray] = value;
                        let (low, high) = (around[2 * which][pixel], around[2 * which + 1][pixel]);
                        around[2 * which][pixel] = if value < low { value } else { low };
                        around[2 * which + 1][pixel] = if value > high { value } else { high };
                    }
                }
            }
            self.around.push([around[0], around[1], around[2], around[3]]);
        }
    }

    /// Lets a triangle be seen by the rays of a block that meet it before what they saw so far; says whether any does.
    #[inline(always)]
    fn look_at(&mut self, seen: &Seen, block: usize, tested: &[Seen]) -> bool {
        let mut any = false;
        let mut left = may_meet(seen, &self.around[block]);
        while left != 0 {
            let pixel = left.trailing_zeros() as usize;
            left &= left - 1;
            let first = (block * LANES + pixel) * self.rays;
            for first in (first..first + self.rays).step_by(TOGETHER) {
                any |= self.look_at_rays(seen, first, tested);
            }
        }
        if any {
            let rays = block * LANES * self.rays..(block + 1) * LANES * self.rays;
            self.closed[block] = least(&self.inverse_depth[rays]);
        }
        any
    }

    /// Does what [`Self::look_at`] does for [`TOGETHER`] rays. Of equally near triangles the first in the scene is
    /// seen.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    #[allow(clippy::cast_possible_truncation, reason = "a tile's triangles are fewer than 2^32")]
    fn look_at_rays(&mut self, seen: &Seen, first: usize, tested: &[Seen]) -> bool {
        let (x, y) = (&self.x[first..first + TOGETHER], &self.y[first..first + TOGETHER]);
        let depths = &mut self.inverse_depth[first..first + TOGETHER];
        let indices = &mut self.index[first..first + TOGETHER];
        let [a, b, c] = seen.edges;
        let (mut inverse, mut reached) = ([0f32; TOGETHER], [0u32; TOGETHER]);
        for i in 0..TOGETHER {
            inverse[i] = seen.inverse_depth.at(x[i], y[i]);
            let meets = (a.at(x[i], y[i]) >= 0.0) & (b.at(x[i], y[i]) >= 0.0) & (c.at(x[i], y[i]) >= 0.0);
            reached[i] = u32::from(meets & (inverse[i] >= depths[i]) & (inverse[i] > 0.0));
        }
        let mut any = false;
        for i in (0..TOGETHER).filter(|&i| reached[i] != 0) {
            if inverse[i] > depths[i] || seen.triangle < tested[indices[i] as usize].triangle {
                (indices[i], depths[i]) = (tested.len() as u32, inverse[i]);
                any = true;
            }
        }
        any
    }
}

/// Returns which pixels of a block a triangle may be seen by, as bits.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn may_meet(seen: &Seen, [left, right, top, bottom]: &[[f32; LANES]; 4]) -> u32 {
    let [a, b, c] = seen.edges;
    let highest = |function: Linear| {
        let x = if function.0[0] > 0.0 { right } else { left };
        let y = if function.0[1] > 0.0 { bottom } else { top };
        let mut found = [0f32; LANES];
        for i in 0..LANES {
            found[i] = function.at(x[i], y[i]);
        }
        found
    };
    let (a, b, c) = (highest(a), highest(b), highest(c));
    let mut meets = [0u32; LANES];
    for i in 0..LANES {
        meets[i] = u32::from((a[i] >= 0.0) & (b[i] >= 0.0) & (c[i] >= 0.0)) << i;
    }
    meets.iter().fold(0, |all, bit| all | bit)
}

/// A walk through the BVH of one frame.
struct Walk<'a> {
    scene: &'a Scene,
    pose: &'a Pose,
    /// The first triangle of the frame.
    first: usize,
    part: &'a Part<'a>,
    pixels: &'a mut Pixels,
    set_up: &'a mut Vec<Seen>,
    tested: &'a mut Vec<Seen>,
    /// Triangles that are set up next, and how many they are: leaves have few, and vector code takes [`WIDTH`].
    next: [u32; WIDTH],
    count: usize,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Walk<'_> {
    /// Looks at the triangles that were gathered.
    #[inline(always)]
    fn look(&mut self) {
        self.set_up.clear();
        set_up(self.scene, self.pose, &self.next[..self.count], self.part.around, self.set_up);
        self.count = 0;
        if self.set_up.is_empty() {
            return;
        }
        if !self.pixels.taken {
            self.pixels.take(self.part);
        }
        for seen in &*self.set_up {
            let mut any = false;
            for (block, part) in self.part.blocks.iter().enumerate() {
                let hidden = seen.nearest_in(part) < self.pixels.closed[block];
                if !hidden && !matches!(seen.covers(part), Cover::Nothing) {
                    any |= self.pixels.look_at(seen, block, self.tested);
                }
            }
            if any {
                self.tested.push(*seen);
            }
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Leaves for Walk<'_> {
    #[inline(always)]
    fn farthest(&self) -> f32 {
        let closed = self.pixels.closed[..self.part.blocks.len()].iter().fold(f32::INFINITY, |a, &b| a.min(b));
        // As near as a triangle may be taken to be, see `Seen`, and a rounding more.
        NEARER * NEARER / closed
    }

    #[inline(always)]
    fn expect(&self, leaf: Range<usize>) {
        let leaf = self.first + leaf.start..self.first + leaf.end;
        prefetch(&self.scene.corners[leaf.clone()]);
        for surface in &self.scene.surfaces[leaf] {
            prefetch(std::slice::from_ref(&surface.plane));
        }
    }

    #[inline(always)]
    fn look_at(&mut self, leaf: Range<usize>) {
        for triangle in self.first + leaf.start..self.first + leaf.end {
            self.next[self.count] = bvh::index(triangle);
            self.count += 1;
            if self.count == WIDTH {
                self.look();
            }
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Beam {
    /// Finds what each ray sees, and makes a list of it.
    #[inline(always)]
    pub(crate) fn find(
        &mut self,
        scene: &Scene,
        view: &View,
        part: &Part,
        nearest: &mut Nearest,
        list: &mut Vec<Entry>,
    ) {
        (self.pixels.taken, self.pixels.closed) = (false, [0.0; BLOCKS]);
        self.tested.clear();
        let Self { tested, waiting, pixels, set_up, .. } = self;
        for (frame, pose) in scene.frames.iter().zip(&view.poses) {
            let pyramid = Pyramid::new(part.around, pose, frame.bvh.reach);
            let first = frame.triangles.start;
            let (next, count) = ([0; WIDTH], 0);
            let mut walk = Walk { scene, pose, first, part, pixels, set_up, tested, next, count };
            frame.bvh.visit_from_front(waiting, &pyramid, &mut walk);
            walk.look();
        }
        nearest.begin(part);
        self.list_seen(list);
        if list.is_empty() {
            nearest.end(0);
            return;
        }
        let Self { pixels, indices, .. } = self;
        let rays = nearest.length / LANES;
        for (group, (to, depths)) in
            nearest.index.chunks_exact_mut(LANES).zip(nearest.inverse_depth.chunks_exact_mut(LANES)).enumerate()
        {
            let (block, ray) = (group / rays, group % rays);
            for pixel in 0..LANES {
                let from = (block * LANES + pixel) * pixels.rays + ray;
                let index = pixels.index[from];
                to[pixel] = if index == NOTHING { NOTHING } else { indices[index as usize] };
                depths[pixel] = pixels.inverse_depth[from];
            }
        }
        nearest.end(list.len());
    }

    /// Lists the triangles that are seen by any ray, in the order of the scene.
    fn list_seen(&mut self, list: &mut Vec<Entry>) {
        self.indices.clear();
        self.indices.resize(self.tested.len(), NOTHING);
        self.order.clear();
        // Where nothing was tested, the rays are those of another tile.
        let rays = if self.tested.is_empty() { &[] } else { self.pixels.index.as_slice() };
        for &index in rays.iter().filter(|&&index| index != NOTHING) {
            if self.indices[index as usize] == NOTHING {
                self.indices[index as usize] = 0;
                self.order.push((self.tested[index as usize].triangle, index));
            }
        }
        self.order.sort_unstable();
        self.seen.clear();
        list.clear();
        for (at, &(_, index)) in (0..).zip(&self.order) {
            self.indices[index as usize] = at;
            self.seen.push(self.tested[index as usize]);
            list.push(Entry { seen: at, covers: false });
        }
    }
}
