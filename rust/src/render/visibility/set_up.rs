//! Sets up triangles of a view a few at a time, in vector code of float64.
//!
//! First what each may be seen in is found ([`Projected`]), and then, for those that any ray may meet, its functions
//! ([`set_up`]).
//!
//! What must not break: each triangle has the bits that [`Seen::new`](super::bins) gives it alone.

use super::bins::{EDGE_ON, NEARER, Seen, extent, margin};
use crate::render::geometry::bvh::WIDTH;
use crate::render::geometry::linear::Linear;
use crate::render::geometry::vector::Vector;
use crate::render::geometry::view::Pose;
use crate::render::scene::Scene;

/// A number of each triangle.
type Numbers = [f64; WIDTH];

/// A vector of each triangle, by axis.
type Vectors = [Numbers; 3];

/// Triangles as far as it takes to know where in the image they are.
pub(super) struct Projected {
    /// In camera axes.
    corners: [Vectors; 3],
    /// The lowest and highest image coordinates, by axis, a little more; the lowest are above the highest where nothing
    /// lies before the camera.
    pub(super) low: [[f32; WIDTH]; 2],
    pub(super) high: [[f32; WIDTH]; 2],
    /// No corner is nearer, as in [`Seen`].
    pub(super) nearest: [f32; WIDTH],
}

/// Triangles that may be met by rays, gathered until they are set up together.
#[derive(Debug)]
pub(super) struct Pending {
    corners: [Vectors; 3],
    nearest: [f32; WIDTH],
    triangles: [u32; WIDTH],
    pub(super) count: usize,
}

impl Default for Pending {
    fn default() -> Self {
        let (corners, nearest) = ([[[0.0; WIDTH]; 3]; 3], [0.0; WIDTH]);
        Self { corners, nearest, triangles: [0; WIDTH], count: 0 }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Projected {
    /// Projects triangles. An edge that passes through the camera's plane goes to infinity there, see [`extent`].
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(super) fn new(scene: &Scene, pose: &Pose, triangles: &[u32; WIDTH]) -> Self {
        let mut corners = [[[0.0; WIDTH]; 3]; 3];
        for i in 0..WIDTH {
            let triangle = &scene.corners[triangles[i] as usize];
            for (vectors, corner) in corners.iter_mut().zip(triangle) {
                for axis in 0..3 {
                    vectors[axis][i] = corner[axis] - pose.position[axis];
                }
            }
        }
        let corners = [turned(pose, &corners[0]), turned(pose, &corners[1]), turned(pose, &corners[2])];
        let mut before = [true; WIDTH];
        let (mut lowest, mut highest) = ([[f64::INFINITY; WIDTH]; 2], [[f64::NEG_INFINITY; WIDTH]; 2]);
        let mut nearest = [0.0; WIDTH];
        for corner in &corners {
            for i in 0..WIDTH {
                let inverse = 1.0 / corner[2][i];
                before[i] &= corner[2][i] > 0.0;
                nearest[i] = if inverse > nearest[i] { inverse } else { nearest[i] };
                for axis in 0..2 {
                    let at = corner[axis][i] * inverse;
                    before[i] &= at.is_finite();
                    lowest[axis][i] = if at < lowest[axis][i] { at } else { lowest[axis][i] };
                    highest[axis][i] = if at > highest[axis][i] { at } else { highest[axis][i] };
                }
            }
        }
        let (mut low, mut high) = ([[0f32; WIDTH]; 2], [[0f32; WIDTH]; 2]);
        for axis in 0..2 {
            for i in 0..WIDTH {
                low[axis][i] = (lowest[axis][i] - margin(lowest[axis][i])) as f32;
                high[axis][i] = (highest[axis][i] + margin(highest[axis][i])) as f32;
            }
        }
        let mut projected = Self { corners, low, high, nearest: nearest.map(|inverse| inverse as f32 * NEARER) };
        for i in (0..WIDTH).filter(|&i| !before[i]) {
            // An edge may pass through the camera's plane, or a corner lie next to it.
            let corners: [Vector; 3] = projected.corners.each_ref().map(|corner| [0, 1, 2].map(|axis| corner[axis][i]));
            let [low, high] = extent(&corners).unwrap_or([[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]]);
            for axis in 0..2 {
                (projected.low[axis][i], projected.high[axis][i]) = (low[axis], high[axis]);
            }
            if corners.iter().any(|corner| corner[2] <= 0.0) {
                projected.nearest[i] = f32::INFINITY;
            }
        }
        projected
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Pending {
    /// Adds one of some projected triangles; there must be room.
    #[inline(always)]
    pub(super) fn add(&mut self, projected: &Projected, lane: usize, triangle: u32) {
        for (to, from) in self.corners.iter_mut().zip(&projected.corners) {
            for axis in 0..3 {
                to[axis][self.count] = from[axis][lane];
            }
        }
        self.nearest[self.count] = projected.nearest[lane];
        self.triangles[self.count] = triangle;
        self.count += 1;
    }

    /// Sets up those that were added, and forgets them. Each is handed to `work` with its position among them, but for
    /// those that are hidden by where the camera is.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(super) fn set_up(&mut self, scene: &Scene, pose: &Pose, work: &mut impl SetUp) {
        let [a, b, c] = &self.corners;
        let edges = [cross(b, c), cross(c, a), cross(a, b)];
        let (determinants, longest, widest) = (dot(a, &edges[0]), largest(a), largest(&edges[0]));
        let mut normals = [[0.0; WIDTH]; 3];
        let (mut heights, mut hidden) = ([0.0; WIDTH], [false; WIDTH]);
        for i in 0..self.count {
            let surface = &scene.surfaces[self.triangles[i] as usize];
            let plane = &surface.plane;
            for axis in 0..3 {
                normals[axis][i] = plane[axis];
            }
            let [x, y, z] = pose.position;
            heights[i] = plane[0] * x + plane[1] * y + plane[2] * z + plane[3];
            hidden[i] = surface.is_hidden(heights[i]);
        }
        let normals = turned(pose, &normals);
        let mut functions = [[[0f32; WIDTH]; 3]; 4];
        for axis in 0..3 {
            for i in 0..WIDTH {
                let sign = if determinants[i] < 0.0 { -1.0 } else { 1.0 };
                for (function, edge) in functions.iter_mut().zip(&edges) {
                    function[axis][i] = (edge[axis][i] * sign) as f32;
                }
                functions[3][axis][i] = (normals[axis][i] * (-1.0 / heights[i])) as f32;
            }
        }
        for i in 0..self.count {
            if determinants[i].abs() <= EDGE_ON * longest[i] * widest[i] || hidden[i] {
                continue;
            }
            let [a, b, c, inverse_depth] =
                functions.each_ref().map(|function| Linear([function[0][i], function[1][i], function[2][i]]));
            let (nearest, triangle) = (self.nearest[i], self.triangles[i]);
            work.look_at(i, &Seen { edges: [a, b, c], inverse_depth, nearest, triangle });
        }
        self.count = 0;
    }
}

/// What is done with triangles that are set up; a trait, because closures may not be inlined always.
pub(super) trait SetUp {
    /// Looks at a triangle, given its position among those that were set up together.
    fn look_at(&mut self, position: usize, seen: &Seen);
}

/// Returns vectors of a frame in camera axes, as [`Pose::turned`] has them.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn turned(pose: &Pose, vectors: &Vectors) -> Vectors {
    let rows = &pose.rotation;
    let mut turned = [[0.0; WIDTH]; 3];
    for axis in 0..3 {
        for i in 0..WIDTH {
            turned[axis][i] =
                rows[0][axis] * vectors[0][i] + rows[1][axis] * vectors[1][i] + rows[2][axis] * vectors[2][i];
        }
    }
    turned
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn cross(a: &Vectors, b: &Vectors) -> Vectors {
    let mut product = [[0.0; WIDTH]; 3];
    for axis in 0..3 {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        for i in 0..WIDTH {
            product[axis][i] = a[next][i] * b[last][i] - a[last][i] * b[next][i];
        }
    }
    product
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn dot(a: &Vectors, b: &Vectors) -> Numbers {
    let mut product = [0.0; WIDTH];
    for i in 0..WIDTH {
        product[i] = a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i];
    }
    product
}

/// Returns the largest of the components' magnitudes.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn largest(vectors: &Vectors) -> Numbers {
    let mut largest = [0.0; WIDTH];
    for axis in 0..3 {
        for i in 0..WIDTH {
            let magnitude = vectors[axis][i].abs();
            largest[i] = if magnitude > largest[i] { magnitude } else { largest[i] };
        }
    }
    largest
}
