//! Beams: finds the triangle that each of a tile's rays hits first by a walk through the BVH from front to back.
//!
//! All rays of a tile walk together. Where triangles are small, that costs less than to sort all of a view's triangles
//! into its tiles ([`super::bins`]): what lies behind the first surface is never looked at. A triangle is looked at by
//! those rays alone that lie in its rectangle of the image ([`super::ray_cells`]).
//!
//! What must not break: a ray sees the same triangle, with the same bits, as by bins. So a triangle is tested by the
//! same functions as [`Seen`] has, and of equally near ones the first in the scene wins, which is the first that a
//! visit to the BVH finds.

use std::ops::Range;

use super::bins::{Entry, NEARER, Pyramid, Seen};
use super::nearest::{NOTHING, Nearest, least};
use super::ray_cells::{RayCells, RayWord, WORD};
use super::set_up::{Pending, Projected, SetUp};
use crate::render::geometry::bvh::{self, Leaves, WIDTH, Waiting};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{LANES, RayBlocks};
use crate::render::geometry::view::{Pose, View};
use crate::render::scene::Scene;

/// Where more rays of a word may meet a triangle than this, all of the word are tested in vector code.
const FEW: u32 = 6;

/// After so many batches of triangles it is found out again how far rays look.
const BETWEEN: usize = 4;

/// The triangles that the rays of one tile see.
#[derive(Debug, Default)]
pub(crate) struct Beam {
    /// Those that are seen by any ray, in the order of the scene.
    pub(crate) seen: Vec<Seen>,
    /// All that any ray saw before it saw a nearer one.
    tested: Vec<Seen>,
    cells: RayCells,
    /// Of each ray the number in the scene of what it sees so far.
    triangles: Vec<u32>,
    pending: Pending,
    /// Of the pending triangles, one after the other: the rays that may meet it; and where those of each end.
    met_by: Vec<RayWord>,
    ends: [usize; WIDTH],
    waiting: Vec<Waiting>,
    /// Of each triangle that was tested its index among those that are seen.
    indices: Vec<u32>,
    /// Those that are seen, by their numbers in the scene, and their indices among those that were tested.
    order: Vec<(u32, u32)>,
}

/// The rays of a tile, and what they see so far.
struct BeamHits<'a> {
    ray_blocks: &'a RayBlocks<'a>,
    /// Of each ray the index of what it sees among those that were tested, its number in the scene, and its inverse
    /// depth.
    index: &'a mut [u32],
    triangles: &'a mut [u32],
    inverse_depth: &'a mut [f32],
    tested: &'a mut Vec<Seen>,
    met_by: &'a mut [RayWord],
    ends: &'a mut [usize; WIDTH],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl SetUp for BeamHits<'_> {
    /// Lets a triangle be seen by the rays that meet it before what they saw so far.
    #[inline(always)]
    fn look_at(&mut self, position: usize, seen: &Seen) {
        let mut any = false;
        let first = if position == 0 { 0 } else { self.ends[position - 1] };
        for at in first..self.ends[position] {
            let RayWord { word, mut rays } = self.met_by[at];
            if rays.count_ones() > FEW {
                for first in (word * WORD..(word + 1) * WORD).step_by(LANES) {
                    any |= self.test_all(seen, first);
                }
                continue;
            }
            while rays != 0 {
                any |= self.test(seen, word * WORD + rays.trailing_zeros() as usize);
                rays &= rays - 1;
            }
        }
        if any {
            self.tested.push(*seen);
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
#[allow(clippy::cast_possible_truncation, reason = "a tile's triangles are fewer than 2^32")]
impl BeamHits<'_> {
    /// Lets a triangle be seen by a ray; says whether it is.
    #[inline(always)]
    fn test(&mut self, seen: &Seen, ray: usize) -> bool {
        let (x, y) = (self.ray_blocks.x[ray], self.ray_blocks.y[ray]);
        let [a, b, c] = seen.edges.map(|edge| edge.at(x, y));
        let inverse = seen.inverse_depth.at(x, y);
        let known = self.inverse_depth[ray];
        let meets = (a >= 0.0) & (b >= 0.0) & (c >= 0.0);
        let takes = meets & is_first(inverse, seen.triangle, known, self.triangles[ray]);
        if takes {
            self.inverse_depth[ray] = inverse;
            (self.index[ray], self.triangles[ray]) = (self.tested.len() as u32, seen.triangle);
        }
        takes
    }

    /// Does what [`Self::test`] does for [`LANES`] rays.
    #[inline(always)]
    fn test_all(&mut self, seen: &Seen, first: usize) -> bool {
        let rays = first..first + LANES;
        let (x, y) = (&self.ray_blocks.x[rays.clone()], &self.ray_blocks.y[rays.clone()]);
        let (known, triangles) = (&mut self.inverse_depth[rays.clone()], &mut self.triangles[rays.clone()]);
        let (index, next) = (&mut self.index[rays], self.tested.len() as u32);
        let [a, b, c] = seen.edges;
        let mut any = 0;
        for i in 0..LANES {
            let inverse = seen.inverse_depth.at(x[i], y[i]);
            let meets = (a.at(x[i], y[i]) >= 0.0) & (b.at(x[i], y[i]) >= 0.0) & (c.at(x[i], y[i]) >= 0.0);
            let takes = meets & is_first(inverse, seen.triangle, known[i], triangles[i]);
            known[i] = if takes { inverse } else { known[i] };
            triangles[i] = if takes { seen.triangle } else { triangles[i] };
            index[i] = if takes { next } else { index[i] };
            any |= u32::from(takes);
        }
        any != 0
    }
}

/// Returns whether a triangle lies before what a ray saw so far. Of equally near ones that is the first in the scene;
/// what sees nothing yet has an inverse depth of 0.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn is_first(inverse: f32, triangle: u32, known: f32, known_triangle: u32) -> bool {
    (inverse > known) | ((inverse == known) & (inverse > 0.0) & (triangle < known_triangle))
}

/// A walk through the BVH of one frame.
struct Walk<'a> {
    scene: &'a Scene,
    pose: &'a Pose,
    /// The first triangle of the frame.
    first: usize,
    cells: &'a mut RayCells,
    has_cells: bool,
    pending: &'a mut Pending,
    hits: BeamHits<'a>,
    /// Triangles that are projected next, and how many they are: leaves have few, and vector code takes [`WIDTH`].
    next: [u32; WIDTH],
    count: usize,
    depth: Depth,
}

/// How far the rays of a tile look.
#[derive(Clone, Copy)]
struct Depth {
    /// Rays before this one see something.
    open: usize,
    /// The inverse depth behind which nothing is seen, and the depth behind which no box is looked into.
    closed: f32,
    farthest: f32,
    /// Batches until it is looked at again.
    wait: usize,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Depth {
    /// Finds out how far rays look that have these inverse depths.
    #[inline(always)]
    fn look(&mut self, inverse_depth: &[f32]) {
        while self.open < inverse_depth.len() && inverse_depth[self.open] > 0.0 {
            self.open += 1;
        }
        if self.wait > 0 || self.open < inverse_depth.len() {
            self.wait = self.wait.saturating_sub(1);
            return;
        }
        self.wait = BETWEEN;
        self.closed = least(inverse_depth);
        // As near as a triangle may be taken to be, see `Seen`, and a rounding more.
        self.farthest = NEARER * NEARER / self.closed;
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Walk<'_> {
    /// Looks at the triangles that were gathered from leaves.
    #[inline(always)]
    fn look(&mut self) {
        if self.count == 0 {
            return;
        }
        // The last one stands for what is missing.
        let last = self.next[self.count - 1];
        self.next[self.count..].fill(last);
        let projected = Projected::new(self.scene, self.pose, &self.next);
        let Rect { low, high } = self.hits.ray_blocks.around;
        for i in 0..self.count {
            let apart = projected.low[0][i] > high[0]
                || projected.high[0][i] < low[0]
                || projected.low[1][i] > high[1]
                || projected.high[1][i] < low[1];
            if apart || projected.nearest[i] < self.depth.closed {
                continue;
            }
            if !self.has_cells {
                self.cells.take(self.hits.ray_blocks);
                self.has_cells = true;
            }
            let corner = |extent: &[[f32; WIDTH]; 2]| [extent[0][i], extent[1][i]];
            let range = self.cells.range(corner(&projected.low), corner(&projected.high));
            let first = if self.pending.count == 0 { 0 } else { self.hits.ends[self.pending.count - 1] };
            let found = self.cells.rays_in(range, &mut self.hits.met_by[first..]);
            if found > 0 {
                self.hits.ends[self.pending.count] = first + found;
                self.pending.add(&projected, i, self.next[i]);
                if self.pending.count == WIDTH {
                    self.set_up();
                }
            }
        }
        self.count = 0;
    }

    /// Looks at the triangles that rays may meet.
    #[inline(always)]
    fn set_up(&mut self) {
        self.pending.set_up(self.scene, self.pose, &mut self.hits);
        self.depth.look(self.hits.inverse_depth);
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Leaves for Walk<'_> {
    #[inline(always)]
    fn farthest(&self) -> f32 {
        self.depth.farthest
    }

    #[inline(always)]
    fn expect(&self, leaf: Range<usize>) {
        self.scene.prefetch_triangles(self.first + leaf.start..self.first + leaf.end);
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
        ray_blocks: &RayBlocks,
        nearest: &mut Nearest,
        list: &mut Vec<Entry>,
    ) {
        nearest.begin(ray_blocks);
        let rays = ray_blocks.x.len();
        self.tested.clear();
        self.triangles.clear();
        self.triangles.resize(rays, NOTHING);
        self.met_by.resize(WIDTH * rays / WORD, RayWord::default());
        let mut depth = Depth { open: 0, closed: 0.0, farthest: f32::INFINITY, wait: 0 };
        // Cells are made when the first triangle is met: many tiles have none.
        let mut has_cells = false;
        for (frame, pose) in scene.frames.iter().zip(&view.poses) {
            let pyramid = Pyramid::new(ray_blocks.around, pose, frame.bvh.reach);
            let Self { tested, waiting, cells, triangles, pending, met_by, ends, .. } = self;
            let (index, inverse_depth) = (&mut *nearest.index, &mut *nearest.inverse_depth);
            let hits = BeamHits { ray_blocks, index, triangles, inverse_depth, tested, met_by, ends };
            let (first, next, count) = (frame.triangles.start, [0; WIDTH], 0);
            let mut walk = Walk { scene, pose, first, cells, has_cells, pending, hits, next, count, depth };
            frame.bvh.visit_from_front(waiting, &pyramid, &mut walk);
            walk.look();
            walk.set_up();
            (has_cells, depth) = (walk.has_cells, walk.depth);
        }
        self.list_seen(&nearest.index, list);
        for index in nearest.index.iter_mut().filter(|index| **index != NOTHING) {
            *index = self.indices[*index as usize];
        }
        nearest.end(list.len());
    }

    /// Lists the triangles that are seen by any ray, in the order of the scene, given what each ray sees.
    fn list_seen(&mut self, rays: &[u32], list: &mut Vec<Entry>) {
        self.indices.clear();
        self.indices.resize(self.tested.len(), NOTHING);
        self.order.clear();
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
