//! Bins: finds the triangles that each tile of a view may see.
//!
//! Per view, every triangle is set up once in float64 and entered into the lists of the tiles that it may be seen in. A
//! tile's rays then look at few triangles. Nothing is clipped and there is no near plane: a ray hits a triangle if
//! three linear functions are not negative and 1 / depth is positive.
//!
//! What must not break:
//! - Two triangles with a common edge have functions of exactly opposite sign there, so no ray passes between them.
//! - A triangle is left out of a tile only if none of the tile's rays would see it, to the last bit
//!   ([`crate::render::geometry::linear`]).

use crate::render::geometry::bvh::{Ahead, Boxes, Region, WIDTH};
use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::pixel_rays::PixelRays;
use crate::render::geometry::vector::{Vector, cross, dot, largest, scale, single, sub};
use crate::render::geometry::view::{Pose, View};
use crate::render::scene::Scene;

/// What of the product of two lengths is rounding.
pub(super) const EDGE_ON: f64 = 1e-15;

/// By how much the inverse depth of the nearest corner is increased, so that roundings are less.
pub(super) const NEARER: f32 = 1.0 + 1e-5;

/// A triangle before the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// None of them is negative for the rays that pass through the triangle.
    pub(crate) edges: [Linear; 3],
    /// 1 / depth of the triangle's plane.
    pub(crate) inverse_depth: Linear,
    /// No corner is nearer than this; inf where the triangle reaches behind the camera.
    pub(crate) nearest: f32,
    /// Its number in the scene.
    pub(crate) triangle: u32,
}

/// A triangle in a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Entry {
    /// Its index among the triangles before the camera.
    pub(crate) seen: u32,
    /// Whether every ray of the tile passes through it.
    pub(crate) covers: bool,
}

/// Which part of a triangle a tile or block sees.
pub(crate) enum Cover {
    Nothing,
    Part,
    Everything,
}

impl Seen {
    /// Returns the triangle, if it has any extent in the image.
    ///
    /// A ray (x, y, 1) meets the triangle where its three determinants with two corners each have the sign of all
    /// three corners': corners behind the camera are as good as any, and nothing is clipped.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "float64 is rounded to float32; scenes have fewer than 2^30 triangles"
    )]
    fn new(scene: &Scene, pose: &Pose, triangle: usize, corners: &[Vector; 3]) -> Option<Self> {
        let surface = &scene.surfaces[triangle];
        let plane = &surface.plane;
        let normal = [plane[0], plane[1], plane[2]];
        let height = dot(normal, pose.position) + plane[3];
        let edges = [cross(corners[1], corners[2]), cross(corners[2], corners[0]), cross(corners[0], corners[1])];
        let determinant = dot(corners[0], edges[0]);
        // Seen from its side a triangle is no wider than float64's rounding of its corners.
        if determinant.abs() <= EDGE_ON * largest(corners[0]) * largest(edges[0]) || surface.is_hidden(height) {
            return None;
        }
        let edges = edges.map(|edge| Linear(single(if determinant < 0.0 { scale(edge, -1.0) } else { edge })));
        let inverse_depth = Linear(single(scale(pose.turned(normal), -1.0 / height)));
        let front = corners.iter().fold(f64::INFINITY, |least, corner| least.min(corner[2]));
        let nearest = if front > 0.0 { (1.0 / front) as f32 * NEARER } else { f32::INFINITY };
        Some(Self { edges, inverse_depth, nearest, triangle: triangle as u32 })
    }

    #[inline]
    pub(crate) fn covers(&self, rect: &Rect) -> Cover {
        if self.edges.iter().any(|edge| edge.highest(rect) < 0.0) {
            return Cover::Nothing;
        }
        let all = self.edges.iter().all(|edge| edge.lowest(rect) >= 0.0) && self.inverse_depth.lowest(rect) > 0.0;
        if all { Cover::Everything } else { Cover::Part }
    }

    /// Returns the largest inverse depth that it may have in a part of the image.
    #[inline]
    pub(crate) fn nearest_in(&self, rect: &Rect) -> f32 {
        let nearest = self.inverse_depth.highest(rect);
        if nearest < self.nearest { nearest } else { self.nearest }
    }
}

/// The triangles of a view, and lists of them for the tiles. It is filled anew for each view.
#[derive(Debug, Default)]
pub(crate) struct Bins {
    pub(crate) seen: Vec<Seen>,
    /// What of each of them lies before the camera lies in.
    pub(crate) around: Vec<Rect>,
    /// Of each tile the inverse depth behind which nothing is seen.
    hidden: Vec<f32>,
    /// Tiles and their entries, in the order in which they were found.
    entered: Vec<(u32, Entry)>,
    /// Where each tile's entries begin.
    starts: Vec<u32>,
    entries: Vec<Entry>,
    stack: Vec<u32>,
}

impl Bins {
    /// Sorts what the view sees into its tiles; where `wanted` is given, into those alone.
    pub(crate) fn fill(&mut self, scene: &Scene, view: &View, rays: &PixelRays, wanted: Option<&[bool]>) {
        self.clear(rays.tiles());
        self.each(scene, view, &rays.all, |bins, pose, triangle, corners, extent| {
            let columns = rays.reaching(0, extent[0][0], extent[1][0]);
            let rows = rays.reaching(1, extent[0][1], extent[1][1]);
            if columns.is_empty() || rows.is_empty() {
                return;
            }
            let Some(seen) = Seen::new(scene, pose, triangle, corners) else { return };
            let before = bins.entered.len();
            for row in rows {
                for column in columns.clone() {
                    let tile = row * rays.columns + column;
                    if wanted.is_none_or(|wanted| wanted[tile]) {
                        bins.enter(&seen, extent, tile, rays.tile(tile));
                    }
                }
            }
            if bins.entered.len() > before {
                bins.add(seen, extent);
            }
        });
        self.sort(rays.tiles());
    }

    /// Finds what one part of the image sees, as if it were the only tile, number 0.
    pub(crate) fn fill_rect(&mut self, scene: &Scene, view: &View, rect: &Rect) {
        self.clear(1);
        self.each(scene, view, rect, |bins, pose, triangle, corners, extent| {
            let Some(seen) = Seen::new(scene, pose, triangle, corners) else { return };
            if bins.enter(&seen, extent, 0, rect) {
                bins.add(seen, extent);
            }
        });
        self.sort(1);
    }

    /// Lists a tile's triangles, without those that are hidden behind one that covers it.
    pub(crate) fn of_tile(&self, tile: usize, rect: &Rect, list: &mut Vec<Entry>) {
        list.clear();
        let entries = &self.entries[self.starts[tile] as usize..self.starts[tile + 1] as usize];
        let hidden = self.hidden[tile];
        list.extend(entries.iter().filter(|e| self.seen[e.seen as usize].nearest_in(rect) >= hidden));
    }

    fn add(&mut self, seen: Seen, [low, high]: [[f32; 2]; 2]) {
        self.seen.push(seen);
        self.around.push(Rect { low, high });
    }

    fn clear(&mut self, tiles: usize) {
        self.seen.clear();
        self.around.clear();
        self.entered.clear();
        self.hidden.clear();
        self.hidden.resize(tiles, 0.0);
    }

    /// Calls `work` with each triangle that may have a part before the camera and in a part of the image, its corners
    /// in camera axes, and the lowest and highest image coordinates.
    fn each(
        &mut self,
        scene: &Scene,
        view: &View,
        rect: &Rect,
        mut work: impl FnMut(&mut Self, &Pose, usize, &[Vector; 3], [[f32; 2]; 2]),
    ) {
        let mut stack = std::mem::take(&mut self.stack);
        for (frame, pose) in scene.frames.iter().zip(&view.poses) {
            let pyramid = Pyramid::new(rect, pose, frame.bvh.reach);
            let first = frame.triangles.start;
            frame.bvh.visit(&mut stack, &pyramid, |leaf| {
                for triangle in leaf.triangles {
                    let triangle = first + triangle;
                    let corners = scene.corners[triangle].map(|corner| pose.turned(sub(corner, pose.position)));
                    if let Some(extent) = extent(&corners) {
                        work(self, pose, triangle, &corners, extent);
                    }
                }
                true
            });
        }
        self.stack = stack;
    }

    /// Enters the next triangle to be seen into a tile, unless the tile does not see it; says whether it did.
    #[allow(clippy::cast_possible_truncation, reason = "a scene has fewer than 2^30 triangles, a sensor fewer tiles")]
    fn enter(&mut self, seen: &Seen, [low, high]: [[f32; 2]; 2], tile: usize, rect: &Rect) -> bool {
        let apart = low[0] > rect.high[0] || high[0] < rect.low[0] || low[1] > rect.high[1] || high[1] < rect.low[1];
        if apart || seen.nearest_in(rect) < self.hidden[tile] {
            return false;
        }
        let covers = match seen.covers(rect) {
            Cover::Nothing => return false,
            Cover::Part => false,
            Cover::Everything => true,
        };
        if covers {
            self.hidden[tile] = self.hidden[tile].max(seen.inverse_depth.lowest(rect));
        }
        self.entered.push((tile as u32, Entry { seen: self.seen.len() as u32, covers }));
        true
    }

    /// Entries tile by tile, each tile's in the order in which they were found.
    #[allow(clippy::cast_possible_truncation, reason = "there are fewer than 2^32 entries")]
    fn sort(&mut self, tiles: usize) {
        self.starts.clear();
        self.starts.resize(tiles + 2, 0);
        for (tile, _) in &self.entered {
            self.starts[*tile as usize + 2] += 1;
        }
        for tile in 0..tiles {
            self.starts[tile + 2] += self.starts[tile + 1];
        }
        self.entries.clear();
        self.entries.resize(self.entered.len(), Entry { seen: 0, covers: false });
        for &(tile, entry) in &self.entered {
            let end = &mut self.starts[tile as usize + 1];
            self.entries[*end as usize] = entry;
            *end += 1;
        }
        self.starts.truncate(tiles + 1);
    }
}

/// Returns the lowest and highest image coordinates of what of a triangle lies before the camera, a little more; None
/// for nothing. An edge that passes through the camera's plane goes to infinity there, to the side where it passes.
pub(super) fn extent(corners: &[Vector; 3]) -> Option<[[f32; 2]; 2]> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let before = corners.map(|corner| corner[2] > 0.0);
    if before == [false; 3] {
        return None;
    }
    for i in 0..3 {
        let (corner, next) = (corners[i], corners[(i + 1) % 3]);
        let inverse = 1.0 / corner[2];
        for axis in 0..2 {
            if before[i] {
                let at = corner[axis] * inverse;
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
            if before[i] != before[(i + 1) % 3] {
                let there = corner[axis] * next[2] - next[axis] * corner[2];
                let side = if before[i] { -there } else { there };
                if side >= 0.0 {
                    high[axis] = f64::INFINITY;
                }
                if side <= 0.0 {
                    low[axis] = f64::NEG_INFINITY;
                }
            }
        }
    }
    Some([
        single(low.map(|x| if x.is_finite() { x - margin(x) } else { x })),
        single(high.map(|x| if x.is_finite() { x + margin(x) } else { x })),
    ])
}

/// Returns by how much the image coordinates of a triangle are grown.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn margin(x: f64) -> f64 {
    1e-6 * (1.0 + x.abs())
}

/// What all rays of a part of the image lie in: the half-spaces of four sides and the camera's plane, in a frame. It is
/// a little larger, so that rounding to float32 loses nothing.
pub(super) struct Pyramid {
    planes: [([f32; 3], f32); 5],
    /// What the depth of a box may be too large by.
    slack: f32,
}

impl Pyramid {
    /// Returns the pyramid for boxes none of whose coordinates is larger than `reach`.
    pub(super) fn new(rect: &Rect, pose: &Pose, reach: f64) -> Self {
        let ([left, top], [right, bottom]) = (rect.low.map(f64::from), rect.high.map(f64::from));
        let normals = [[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -top], [0.0, -1.0, bottom], [0.0, 0.0, 1.0]];
        let mut margin = 0.0;
        let planes = normals.map(|normal| {
            let turned = pose.vector(normal);
            let offset = -dot(turned, pose.position);
            margin = 1e-6 * (3.0 * largest(turned) * reach + offset.abs());
            (single(turned), single([offset + margin])[0])
        });
        // The last plane is the camera's: its offset was increased by the margin, and roundings are less than another
        // one.
        Self { planes, slack: single([2.0 * margin])[0] }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Pyramid {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        let mut least = [f32::INFINITY; WIDTH];
        for &(normal, offset) in &self.planes {
            let mut sum = [offset; WIDTH];
            for axis in 0..3 {
                let side = if normal[axis] > 0.0 { &boxes.high[axis] } else { &boxes.low[axis] };
                for i in 0..WIDTH {
                    sum[i] += normal[axis] * side[i];
                }
            }
            for i in 0..WIDTH {
                least[i] = if sum[i] < least[i] { sum[i] } else { least[i] };
            }
        }
        least.map(|least| least >= 0.0)
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Ahead for Pyramid {
    #[inline(always)]
    fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH] {
        let meets = self.meets(boxes);
        let (normal, offset) = self.planes[4];
        let mut depth = [offset - self.slack; WIDTH];
        for axis in 0..3 {
            let side = if normal[axis] > 0.0 { &boxes.low[axis] } else { &boxes.high[axis] };
            for i in 0..WIDTH {
                depth[i] += normal[axis] * side[i];
            }
        }
        std::array::from_fn(|i| if meets[i] { depth[i] } else { f32::INFINITY })
    }
}
