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
use crate::render::geometry::vector::{Vector, cross, dot, scale, single, sub};
use crate::render::geometry::view::View;
use crate::render::scene::{Scene, Surface};

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
        if surface.is_hidden(height) || volume == 0.0 {
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

    /// Returns bounds on its depth in a spot: by its plane there, and by its corners.
    fn depths(&self, scene: &Scene, view: &View, spot: &Spot) -> [f64; 2] {
        let pose = &view.poses[scene.surfaces[self.triangle as usize].frame as usize];
        let corners = scene.corners[self.triangle as usize].map(|corner| pose.turned(sub(corner, pose.position))[2]);
        let [low, high] = bounds(&self.inverse_depth, spot);
        let farthest = if low > 0.0 { 1.0 / low } else { f64::INFINITY };
        let [least, most] =
            [corners.into_iter().fold(f64::INFINITY, f64::min), corners.into_iter().fold(0.0, f64::max)];
        [least.max(1.0 / high), most.min(farthest)]
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
        each_seen(scene, view, spot, stack, |seen| {
            if seen.covers(spot) {
                farthest = bounds(&seen.inverse_depth, spot)[0].max(farthest);
            }
            self.0.push(seen);
        });
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

/// Returns the least and the largest depth of triangles that a camera may see in a spot of its image, whatever hides them;
/// None where there is surely none.
pub(crate) fn depths_in(scene: &Scene, view: &View, spot: &Spot, stack: &mut Vec<u32>) -> Option<[f64; 2]> {
    let mut depths = None;
    each_seen(scene, view, spot, stack, |seen| {
        let [nearest, farthest] = depths.unwrap_or([f64::INFINITY, 0.0]);
        let [near, far] = seen.depths(scene, view, spot);
        depths = Some([near.min(nearest), far.max(farthest)]);
    });
    depths
}

/// Calls `work` with each triangle that a camera may see in a spot of its image, whatever hides it.
fn each_seen(scene: &Scene, view: &View, spot: &Spot, stack: &mut Vec<u32>, mut work: impl FnMut(Seen)) {
    for (number, frame) in scene.frames.iter().enumerate() {
        frame.bvh.visit(stack, &Pyramid::new(view, number, spot), |leaf| {
            let triangles = leaf.triangles.map(|triangle| frame.triangles.start + triangle);
            triangles.filter_map(|triangle| Seen::new(scene, view, triangle, spot)).for_each(&mut work);
            true
        });
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
            let before = boxes.reach_before(normal, &self.origin, 0.0);
            for i in 0..WIDTH {
                meets[i] &= before[i];
            }
        }
        meets
    }
}

/// A ray and how far it goes, in the BVH of its frame.
///
/// Boxes are tested in float32, eight at once. What rounding may do is added to where the ray enters and leaves each pair
/// of sides.
struct Reaching {
    origin: [f32; 3],
    /// Distance for a step along each axis.
    per_step: [f32; 3],
    /// By how much distances to sides may be wrong besides: an origin that is rounded is off by a fraction of its way to
    /// a side, and of the side's own coordinate. It also makes a ray along a side of a box be in it.
    slack: [f32; 3],
    end: f32,
}

/// Along an axis that it hardly moves along, a ray is in a box all the way or never.
const MOST_PER_STEP: f64 = 1e30;

/// 2^-23: twice what rounding to float32 changes, as a fraction.
const SINGLE: f64 = 1.0 / 8_388_608.0;

/// 2^-20: distances to two sides are off by less than this fraction together, by five roundings each: of the origin, the
/// difference, the distance per step, their product, and the sum with the slack.
const DISTANCE: f32 = 1.0 / 1_048_576.0;

impl Reaching {
    /// Prepares a ray for boxes none of whose coordinates is larger than `reach`.
    #[allow(clippy::cast_possible_truncation, reason = "margins allow for rounding")]
    fn new(ray: &Ray, end: f64, reach: f64) -> Self {
        let (mut per_step, mut slack) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let per = 1.0 / ray.direction[axis];
            let per = if per.abs() < MOST_PER_STEP { per } else { MOST_PER_STEP };
            (per_step[axis], slack[axis]) = (per as f32, (SINGLE * reach * per.abs()) as f32);
        }
        Self { origin: single(ray.origin), per_step, slack, end: -below(-end) }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Reaching {
    /// Returns where the ray is first within each box, and where last before its end; rounding may only make it longer.
    #[inline(always)]
    fn within(&self, boxes: &Boxes) -> ([f32; WIDTH], [f32; WIDTH]) {
        let (mut first, mut last) = ([0f32; WIDTH], [self.end; WIDTH]);
        for axis in 0..3 {
            let (origin, per, slack) = (self.origin[axis], self.per_step[axis], self.slack[axis]);
            let (low, high) = (&boxes.low[axis], &boxes.high[axis]);
            let (near, far) = if per > 0.0 { (low, high) } else { (high, low) };
            for i in 0..WIDTH {
                let enters = (near[i] - origin) * per - slack;
                let leaves = (far[i] - origin) * per + slack;
                first[i] = if enters > first[i] { enters } else { first[i] };
                last[i] = if leaves < last[i] { leaves } else { last[i] };
            }
        }
        for at in &mut first {
            *at *= 1.0 - DISTANCE;
        }
        (first, last)
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Reaching {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        let ((first, last), mut meets) = (self.within(boxes), [false; WIDTH]);
        for i in 0..WIDTH {
            meets[i] = first[i] <= last[i];
        }
        meets
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Ahead for Reaching {
    #[inline(always)]
    fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH] {
        let ((first, last), mut nearness) = (self.within(boxes), [f32::INFINITY; WIDTH]);
        for i in 0..WIDTH {
            nearness[i] = if first[i] <= last[i] { first[i] } else { f32::INFINITY };
        }
        nearness
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
    fn expect(&self, leaf: Range<usize>) {
        self.scene.prefetch_triangles(self.first + leaf.start..self.first + leaf.end);
    }

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
    /// scene's frames, of which those before `from` have nothing that it meets.
    pub(crate) fn nearest(
        &mut self,
        scene: &Scene,
        (rays, from): (&[Ray], usize),
        after: f64,
        but: u32,
    ) -> Option<u32> {
        let (mut nearest, mut distance) = (None, f64::INFINITY);
        for (frame, ray) in scene.frames.iter().zip(rays).skip(from) {
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
    bvh.visit_from_front(waiting, &Reaching::new(looking.ray, f64::INFINITY, bvh.reach), looking);
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

/// Returns whether a ray meets any triangle but one before its end; `rays` are the ray in each of the scene's frames, of
/// which those before `from` have nothing that it meets.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn is_blocked(
    scene: &Scene,
    (rays, from): (&[Ray], usize),
    end: f64,
    but: u32,
    stack: &mut Vec<u32>,
) -> bool {
    for (frame, ray) in scene.frames.iter().zip(rays).skip(from) {
        if frame.bvh.is_missed(ray.origin, ray.direction) {
            continue;
        }
        let (first, mut blocked) = (frame.triangles.start, false);
        frame.bvh.visit(stack, &Reaching::new(ray, end, frame.bvh.reach), |leaf| {
            blocked = leaf.triangles.map(|triangle| first + triangle).any(|triangle| {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::vector::{Bounds, add, largest};
    use proptest::prelude::*;

    /// Coordinates: whole numbers, so that rays run along sides, and others of any size.
    fn coordinate() -> impl Strategy<Value = f64> {
        let of_any_size = (-1.0f64..1.0, -6i32..7).prop_map(|(x, size)| x * 10f64.powi(size));
        prop_oneof![(-3i8..4).prop_map(f64::from), of_any_size]
    }

    fn vector(coordinate: impl Strategy<Value = f64>) -> impl Strategy<Value = Vector> {
        prop::array::uniform3(coordinate)
    }

    /// A node with one box.
    fn only(lane: usize, bounds: &Bounds) -> Boxes {
        let mut boxes = Boxes { low: [[f32::INFINITY; WIDTH]; 3], high: [[f32::NEG_INFINITY; WIDTH]; 3] };
        boxes.put(lane, bounds);
        boxes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// A box that holds a point of the ray is met, and no farther away than that point.
        #[test]
        fn boxes_that_a_ray_meets_are_found(
            near in vector(coordinate()), direction in vector(coordinate()), at in 0.0f64..10.0,
            beyond in prop_oneof![Just(0.0), 0.0f64..9.0],
            before in vector(prop_oneof![Just(0.0), 0.0f64..2.0]), behind in vector(prop_oneof![Just(0.0), 0.0f64..2.0]),
        ) {
            let origin = sub(near, scale(direction, at));
            let point = add(origin, scale(direction, at));
            let bounds = Bounds { low: sub(point, before), high: add(point, behind) };
            let reach = largest(bounds.low).max(largest(bounds.high));
            // Where all of a scene lies at one point, nothing is seen.
            prop_assume!(reach > 0.0);
            let boxes = only(3, &bounds);
            let ray = Ray { origin, direction };
            let mut meets = Reaching::new(&ray, at + beyond, reach).meets(&boxes);
            prop_assert!(meets[3]);
            meets[3] = false;
            prop_assert_eq!(meets, [false; WIDTH]);
            let nearness = Reaching::new(&ray, f64::INFINITY, reach).nearness(&boxes)[3];
            prop_assert!(f64::from(nearness) <= at, "{nearness}");
        }

        /// A box is not met that a ray passes at a distance of far more than roundings.
        #[test]
        fn boxes_that_a_ray_passes_are_not_met(
            origin in vector(-9.0f64..9.0), direction in vector(-1.0f64..1.0), at in -10.0f64..10.0, axis in 0usize..3,
            aside in 0.01f64..3.0, size in vector(0.0f64..2.0),
        ) {
            // A corner lies beside the ray, and the box at right angles to it, farther away.
            let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut across = [0.0; 3];
            (across[axis], across[second]) = (direction[second], -direction[axis]);
            let length = dot(across, across).sqrt();
            prop_assume!(length > 0.1);
            let corner = add(add(origin, scale(direction, at)), scale(across, aside / length));
            let mut other = add(corner, [0, 1, 2].map(|k| size[k].copysign(across[k])));
            other[third] = corner[third];
            let low = [0, 1, 2].map(|k| corner[k].min(other[k]));
            let high = [0, 1, 2].map(|k| corner[k].max(other[k]));
            let boxes = only(0, &Bounds { low, high });
            let ray = Ray { origin, direction };
            prop_assert!(!Reaching::new(&ray, f64::INFINITY, 30.0).meets(&boxes)[0]);
        }
    }
}
