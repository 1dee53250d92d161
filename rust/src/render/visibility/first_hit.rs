//! First hits: finds what single rays hit, in float64.
//!
//! Frames are rendered in float32, whose rounding moves an edge by some 1e-7 of the image. That is too much for
//! derivatives, which ask how fast an edge moves.
//!
//! What must not break: the candidates for a spot of the image include every triangle that one of its rays may hit
//! first.

use std::ops::Range;

use multiversion::multiversion;

use crate::render::geometry::bvh::{Ahead, Boxes, Bvh, Leaves, Region, WIDTH, Waiting, below};
use crate::render::geometry::vector::{Vector, cross, dot, scale, sub};
use crate::render::geometry::view::View;
use crate::render::scene::{Scene, Surface, is_hidden};

/// What of a distance is rounding.
const ROUNDING: f64 = 1e-12;

/// A ray from an origin, in units of its direction, in one frame of a scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) origin: Vector,
    pub(crate) direction: Vector,
}

/// The lowest and the highest x and y of some rays (x, y, 1) in camera axes.
pub(crate) type Spot = [[f64; 2]; 2];

/// A triangle as a camera sees it: linear functions of the ray.
#[derive(Clone, Copy, Debug)]
struct Seen {
    triangle: u32,
    /// None is negative where a ray meets it.
    edges: [Vector; 3],
    inverse_depth: Vector,
}

impl Seen {
    /// Returns the candidate; None where it is hidden by where the camera is, or not in the spot.
    fn new(scene: &Scene, view: &View, triangle: usize, spot: &Spot) -> Option<Self> {
        let surface = &scene.surfaces[triangle];
        let pose = &view.poses[surface.frame as usize];
        let [a, b, c] = scene.corners[triangle].map(|corner| pose.turned(sub(corner, pose.position)));
        let normal = [surface.plane[0], surface.plane[1], surface.plane[2]];
        let height = dot(normal, pose.position) + surface.plane[3];
        let volume = dot(a, cross(b, c));
        if is_hidden(surface.culled, height) || volume == 0.0 {
            return None;
        }
        // Of two triangles at an edge the function is the same but for its sign: no ray passes between them.
        let edges = [cross(a, b), cross(b, c), cross(c, a)].map(|edge| scale(edge, volume.signum()));
        let inverse_depth = scale(pose.turned(normal), -1.0 / height);
        if edges.iter().chain([&inverse_depth]).any(|function| bounds(function, spot)[1] < 0.0) {
            return None;
        }
        #[allow(clippy::cast_possible_truncation, reason = "a scene has fewer than 2^30 triangles")]
        Some(Self { triangle: triangle as u32, edges, inverse_depth })
    }

    fn covers(&self, spot: &Spot) -> bool {
        self.edges.iter().all(|edge| bounds(edge, spot)[0] >= 0.0)
    }
}

/// Returns the least and the largest value of a linear function in a spot.
fn bounds(function: &Vector, spot: &Spot) -> [f64; 2] {
    let mut bounds = [function[2]; 2];
    for axis in 0..2 {
        let ends = [function[axis] * spot[0][axis], function[axis] * spot[1][axis]];
        bounds = [bounds[0] + ends[0].min(ends[1]), bounds[1] + ends[0].max(ends[1])];
    }
    bounds
}

/// The triangles that rays in one spot may meet first.
#[derive(Debug, Default)]
pub(crate) struct Candidates(Vec<Seen>);

impl Candidates {
    /// Looks for those of another spot.
    pub(crate) fn search(&mut self, scene: &Scene, view: &View, spot: &Spot, stack: &mut Vec<u32>) {
        self.0.clear();
        // No ray sees farther than the triangle that covers the whole spot.
        let mut farthest = 0.0;
        for (number, frame) in scene.frames.iter().enumerate() {
            let pyramid = Pyramid::new(view, number, spot);
            frame.bvh.visit(stack, &pyramid, |range| {
                for triangle in frame.triangles.start + range.start..frame.triangles.start + range.end {
                    let Some(seen) = Seen::new(scene, view, triangle, spot) else { continue };
                    if seen.covers(spot) {
                        farthest = bounds(&seen.inverse_depth, spot)[0].max(farthest);
                    }
                    self.0.push(seen);
                }
                true
            });
        }
        self.0.retain(|seen| bounds(&seen.inverse_depth, spot)[1] >= farthest);
    }

    /// Returns the nearest triangle that a ray meets, and its depth.
    pub(crate) fn first(&self, [x, y, _]: Vector) -> Option<(u32, f64)> {
        let at = |function: &Vector| function[0] * x + function[1] * y + function[2];
        let (mut nearest, mut most) = (None, 0.0);
        for seen in &self.0 {
            let inverse_depth = at(&seen.inverse_depth);
            if inverse_depth > most && seen.edges.iter().all(|edge| at(edge) >= 0.0) {
                (nearest, most) = (Some(seen.triangle), inverse_depth);
            }
        }
        nearest.map(|triangle| (triangle, 1.0 / most))
    }
}

/// What a camera sees in a spot of its image, in the BVH of a frame.
struct Pyramid {
    origin: Vector,
    /// Of its sides, into it.
    normals: [Vector; 4],
}

impl Pyramid {
    fn new(view: &View, frame: usize, [low, high]: &Spot) -> Self {
        let pose = &view.poses[frame];
        let normals = [[1.0, 0.0, -low[0]], [-1.0, 0.0, high[0]], [0.0, 1.0, -low[1]], [0.0, -1.0, high[1]]];
        Self { origin: pose.position, normals: normals.map(|normal| pose.vector(normal)) }
    }
}

impl Region for Pyramid {
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        let mut meets = [true; WIDTH];
        for normal in &self.normals {
            let (mut most, mut reach) = ([0f64; WIDTH], [0f64; WIDTH]);
            for axis in 0..3 {
                let corner = if normal[axis] > 0.0 { &boxes.high[axis] } else { &boxes.low[axis] };
                for i in 0..WIDTH {
                    let along = normal[axis] * (f64::from(corner[i]) - self.origin[axis]);
                    most[i] += along;
                    reach[i] += along.abs();
                }
            }
            for i in 0..WIDTH {
                meets[i] &= most[i] >= -ROUNDING * reach[i];
            }
        }
        meets
    }
}

/// A ray and how far it goes, in the BVH of its frame.
struct Reaching {
    origin: Vector,
    per_direction: Vector,
    end: f64,
}

impl Reaching {
    fn new(ray: &Ray, end: f64) -> Self {
        // Along an axis that it does not move along, a ray is in a box all the way or never.
        let per = |along: f64| if along.abs() < 1e-200 { 1e200 } else { 1.0 / along };
        Self { origin: ray.origin, per_direction: ray.direction.map(per), end }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Reaching {
    /// Returns where the ray is first within each box, and where last before its end.
    #[inline(always)]
    fn within(&self, boxes: &Boxes) -> ([f64; WIDTH], [f64; WIDTH]) {
        let (mut first, mut last) = ([0f64; WIDTH], [self.end; WIDTH]);
        for axis in 0..3 {
            let (origin, per) = (self.origin[axis], self.per_direction[axis]);
            for i in 0..WIDTH {
                let at_low = (f64::from(boxes.low[axis][i]) - origin) * per;
                let at_high = (f64::from(boxes.high[axis][i]) - origin) * per;
                let (near, far) = if at_low < at_high { (at_low, at_high) } else { (at_high, at_low) };
                first[i] = if near > first[i] { near } else { first[i] };
                last[i] = if far < last[i] { far } else { last[i] };
            }
        }
        (first, last)
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Reaching {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        let (first, last) = self.within(boxes);
        std::array::from_fn(|i| first[i] <= last[i] * (1.0 + ROUNDING))
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Ahead for Reaching {
    #[inline(always)]
    fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH] {
        let (first, last) = self.within(boxes);
        std::array::from_fn(|i| if first[i] <= last[i] * (1.0 + ROUNDING) { below(first[i]) } else { f32::INFINITY })
    }
}

/// Looks for the triangle that a ray meets first in one frame.
struct Looking<'a> {
    scene: &'a Scene,
    /// The frame's first triangle.
    first: usize,
    ray: &'a Ray,
    but: u32,
    after: f64,
    nearest: Option<u32>,
    distance: f64,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Leaves for Looking<'_> {
    #[inline(always)]
    fn farthest(&self) -> f32 {
        -below(-self.distance)
    }

    #[inline(always)]
    fn expect(&self, _: Range<usize>) {}

    #[inline(always)]
    fn look_at(&mut self, leaf: Range<usize>) {
        for triangle in self.first + leaf.start..self.first + leaf.end {
            let Surface { plane, culled, .. } = &self.scene.surfaces[triangle];
            let Some(distance) = meets(&self.scene.corners[triangle], plane, self.ray) else { continue };
            if *culled && dot([plane[0], plane[1], plane[2]], self.ray.direction) > 0.0 {
                continue;
            }
            if triangle != self.but as usize && distance > self.after && distance < self.distance {
                #[allow(clippy::cast_possible_truncation, reason = "a scene has fewer than 2^30 triangles")]
                let number = triangle as u32;
                (self.nearest, self.distance) = (Some(number), distance);
            }
        }
    }
}

/// Finds the triangles that rays of any direction meet first.
#[derive(Debug, Default)]
pub(crate) struct FirstHits(Vec<Waiting>);

impl FirstHits {
    /// Returns the triangle that a ray meets first, but one, farther away than `after`; `rays` are the ray in each of the
    /// scene's frames.
    pub(crate) fn nearest(&mut self, scene: &Scene, rays: &[Ray], after: f64, but: u32) -> Option<u32> {
        let (mut nearest, mut distance) = (None, f64::INFINITY);
        for (frame, ray) in scene.frames.iter().zip(rays) {
            if frame.bvh.is_missed(ray.origin, ray.direction) {
                continue;
            }
            let mut looking = Looking { scene, first: frame.triangles.start, ray, but, after, nearest, distance };
            look(&mut looking, &frame.bvh, &mut self.0);
            (nearest, distance) = (looking.nearest, looking.distance);
        }
        nearest
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn look(looking: &mut Looking, bvh: &Bvh, waiting: &mut Vec<Waiting>) {
    bvh.visit_from_front(waiting, &Reaching::new(looking.ray, f64::INFINITY), looking);
}

/// Returns where a ray meets a triangle; None where it passes it.
#[inline]
fn meets(corners: &[Vector; 3], plane: &[f64; 4], ray: &Ray) -> Option<f64> {
    let (a, b, c) = (sub(corners[0], ray.origin), sub(corners[1], ray.origin), sub(corners[2], ray.origin));
    let side = |from: Vector, to: Vector| dot(cross(from, to), ray.direction);
    let sides = [side(a, b), side(b, c), side(c, a)];
    let (below, above) = (|side: f64| side < 0.0, |side: f64| side > 0.0);
    if (below(sides[0]) || below(sides[1]) || below(sides[2]))
        && (above(sides[0]) || above(sides[1]) || above(sides[2]))
    {
        return None;
    }
    let normal = [plane[0], plane[1], plane[2]];
    let distance = -(dot(normal, ray.origin) + plane[3]) / dot(normal, ray.direction);
    (distance > 0.0).then_some(distance)
}

/// Returns whether a ray meets any triangle but one before its end; `rays` are the ray in each of the scene's frames.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn is_blocked(scene: &Scene, rays: &[Ray], end: f64, but: u32, stack: &mut Vec<u32>) -> bool {
    for (frame, ray) in scene.frames.iter().zip(rays) {
        if frame.bvh.is_missed(ray.origin, ray.direction) {
            continue;
        }
        let (first, mut blocked) = (frame.triangles.start, false);
        frame.bvh.visit(stack, &Reaching::new(ray, end), |range| {
            blocked = (first + range.start..first + range.end).any(|triangle| {
                triangle != but as usize
                    && meets(&scene.corners[triangle], &scene.surfaces[triangle].plane, ray)
                        .is_some_and(|distance| distance <= end)
            });
            !blocked
        });
        if blocked {
            return true;
        }
    }
    false
}
