//! Sets up triangles of a view a few at a time, in vector code of float64.
//!
//! What must not break: each triangle has the bits that [`Seen::new`](super::bins) gives it alone.

use super::bins::{EDGE_ON, NEARER, Seen, extent, margin};
use crate::render::geometry::bvh::WIDTH;
use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::vector::Vector;
use crate::render::geometry::view::Pose;
use crate::render::scene::Scene;

/// A number of each triangle.
type Numbers = [f64; WIDTH];

/// A vector of each triangle, by axis.
type Vectors = [Numbers; 3];

/// Adds those of some triangles, at most [`WIDTH`], that may have a part before the camera and in a part of the image.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
pub(super) fn set_up(scene: &Scene, pose: &Pose, triangles: &[u32], part: &Rect, found: &mut Vec<Seen>) {
    let (Some(&last), count) = (triangles.last(), triangles.len()) else { return };
    // The last one stands for what is missing.
    let numbers: [u32; WIDTH] = std::array::from_fn(|i| triangles.get(i).copied().unwrap_or(last));
    let mut corners = [[[0.0; WIDTH]; 3]; 3];
    for i in 0..WIDTH {
        let triangle = &scene.corners[numbers[i] as usize];
        for (vectors, corner) in corners.iter_mut().zip(triangle) {
            for axis in 0..3 {
                vectors[axis][i] = corner[axis] - pose.position[axis];
            }
        }
    }
    let corners = [turned(pose, &corners[0]), turned(pose, &corners[1]), turned(pose, &corners[2])];
    let meets = meets(&corners, part);
    if meets[..count].iter().all(|&meets| !meets) {
        return;
    }
    let [a, b, c] = &corners;
    let edges = [cross(b, c), cross(c, a), cross(a, b)];
    let (determinants, longest, widest) = (dot(a, &edges[0]), largest(a), largest(&edges[0]));
    let mut normals = [[0.0; WIDTH]; 3];
    let mut heights = [0.0; WIDTH];
    for i in 0..WIDTH {
        let plane = &scene.surfaces[numbers[i] as usize].plane;
        for axis in 0..3 {
            normals[axis][i] = plane[axis];
        }
        let [x, y, z] = pose.position;
        heights[i] = plane[0] * x + plane[1] * y + plane[2] * z + plane[3];
    }
    let normals = turned(pose, &normals);
    for i in (0..count).filter(|&i| meets[i]) {
        if determinants[i].abs() <= EDGE_ON * longest[i] * widest[i] || heights[i] == 0.0 {
            continue;
        }
        let sign = if determinants[i] < 0.0 { -1.0 } else { 1.0 };
        let edges = edges.each_ref().map(|edge| Linear([0, 1, 2].map(|axis| (edge[axis][i] * sign) as f32)));
        let inverse = -1.0 / heights[i];
        let inverse_depth = Linear([0, 1, 2].map(|axis| (normals[axis][i] * inverse) as f32));
        let front = corners.iter().fold(f64::INFINITY, |least, corner| least.min(corner[2][i]));
        let nearest = if front > 0.0 { (1.0 / front) as f32 * NEARER } else { f32::INFINITY };
        found.push(Seen { edges, inverse_depth, nearest, triangle: numbers[i] });
    }
}

/// Returns which triangles may have a part before the camera and in a part of the image, by their corners in camera
/// axes.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn meets(corners: &[Vectors; 3], part: &Rect) -> [bool; WIDTH] {
    let mut before = [true; WIDTH];
    let (mut low, mut high) = ([[f64::INFINITY; WIDTH]; 2], [[f64::NEG_INFINITY; WIDTH]; 2]);
    for corner in corners {
        for i in 0..WIDTH {
            let inverse = 1.0 / corner[2][i];
            before[i] &= corner[2][i] > 0.0;
            for axis in 0..2 {
                let at = corner[axis][i] * inverse;
                before[i] &= at.is_finite();
                low[axis][i] = if at < low[axis][i] { at } else { low[axis][i] };
                high[axis][i] = if at > high[axis][i] { at } else { high[axis][i] };
            }
        }
    }
    let mut meets = [true; WIDTH];
    for axis in 0..2 {
        for i in 0..WIDTH {
            let lowest = (low[axis][i] - margin(low[axis][i])) as f32;
            let highest = (high[axis][i] + margin(high[axis][i])) as f32;
            meets[i] &= lowest <= part.high[axis] && highest >= part.low[axis];
        }
    }
    for i in (0..WIDTH).filter(|&i| !before[i]) {
        // An edge may pass through the camera's plane, or a corner lie next to it.
        let corners: [Vector; 3] = corners.each_ref().map(|corner| [0, 1, 2].map(|axis| corner[axis][i]));
        meets[i] = extent(&corners)
            .is_some_and(|[low, high]| (0..2).all(|axis| low[axis] <= part.high[axis] && high[axis] >= part.low[axis]));
    }
    meets
}

/// Returns vectors of a frame in camera axes, as [`Pose::turned`] has them.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn turned(pose: &Pose, vectors: &Vectors) -> Vectors {
    let rows = &pose.rotation;
    let mut found = [[0.0; WIDTH]; 3];
    for axis in 0..3 {
        for i in 0..WIDTH {
            found[axis][i] =
                rows[0][axis] * vectors[0][i] + rows[1][axis] * vectors[1][i] + rows[2][axis] * vectors[2][i];
        }
    }
    found
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn cross(a: &Vectors, b: &Vectors) -> Vectors {
    let mut found = [[0.0; WIDTH]; 3];
    for axis in 0..3 {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        for i in 0..WIDTH {
            found[axis][i] = a[next][i] * b[last][i] - a[last][i] * b[next][i];
        }
    }
    found
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn dot(a: &Vectors, b: &Vectors) -> Numbers {
    let mut found = [0.0; WIDTH];
    for i in 0..WIDTH {
        found[i] = a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i];
    }
    found
}

/// Returns the largest of the components' magnitudes.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn largest(vectors: &Vectors) -> Numbers {
    let mut found = [0.0; WIDTH];
    for axis in 0..3 {
        for i in 0..WIDTH {
            let one = vectors[axis][i].abs();
            found[i] = if one > found[i] { one } else { found[i] };
        }
    }
    found
}
