//! What a triangle hides from a light: a cone behind it, as bounds that are linear in the hidden place.

use super::vector::{Bounds, Vector, cross, dot, largest, scale, single, sub};

/// Seen from its side a triangle hides nothing: it is this share as wide as its corners are far from the light.
const EDGE_ON: f64 = 1e-7;

/// Where a light shines from, in the frame of what it is hidden by.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    /// A place.
    Point(Vector),
    /// The unit vector towards the light.
    Directional(Vector),
}

/// A place q is hidden where none of the three edges is negative and the height lies below 0; each is
/// a x + (b y + (c z + d)). Seen from a point light at height 1 the triangle lies at 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    edges: [[f32; 4]; 3],
    height: [f32; 4],
}

/// How much of a box a cone hides.
pub(super) enum Hides {
    Nothing,
    Part,
    Everything,
}

impl Cone {
    const NONE: Self = Self { edges: [[0.0, 0.0, 0.0, -1.0]; 3], height: [0.0, 0.0, 0.0, 1.0] };

    pub(super) fn new(corners: &[Vector; 3], source: &Source) -> Self {
        let [a, b, c] = *corners;
        let normal = cross(sub(b, a), sub(c, a));
        let area = dot(normal, normal).sqrt();
        let (edges, height) = match *source {
            Source::Point(light) => {
                let [a, b, c] = corners.map(|corner| sub(corner, light));
                let towards = -dot(normal, a);
                if towards.abs() <= EDGE_ON * area * largest(a).max(largest(b)).max(largest(c)) {
                    return Self::NONE;
                }
                // With the light behind the corners' order turns.
                let sign = -towards.signum();
                let edges = [cross(b, c), cross(c, a), cross(a, b)].map(|edge| scale(edge, sign));
                (edges.map(|edge| with(edge, -dot(edge, light))), scale(normal, 1.0 / towards))
            }
            Source::Directional(towards) => {
                let along = dot(normal, towards);
                if along.abs() <= EDGE_ON * area {
                    return Self::NONE;
                }
                let sign = along.signum();
                let edge = |from: Vector, to: Vector| {
                    let edge = scale(cross(towards, sub(to, from)), sign);
                    with(edge, -dot(edge, from))
                };
                ([edge(a, b), edge(b, c), edge(c, a)], scale(normal, 1.0 / along))
            }
        };
        Self { edges: edges.map(single), height: single(with(height, -dot(height, corners[0]))) }
    }

    /// What it hides of a box, as it is computed for each place in it.
    pub(super) fn hides(&self, part: &[[f32; 3]; 2], farthest: f32) -> Hides {
        let (low, high) = (lowest(&self.height, part), highest(&self.height, part));
        if low >= 0.0 || high < -farthest || self.edges.iter().any(|edge| highest(edge, part) < 0.0) {
            return Hides::Nothing;
        }
        let inside = self.edges.iter().all(|edge| lowest(edge, part) >= 0.0);
        if inside && high < 0.0 && low >= -farthest { Hides::Everything } else { Hides::Part }
    }

    /// Whether it hides a place.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    pub(super) fn hides_place(&self, x: f32, y: f32, z: f32, farthest: f32) -> bool {
        let height = at(&self.height, x, y, z);
        let inside = (at(&self.edges[0], x, y, z) >= 0.0)
            & (at(&self.edges[1], x, y, z) >= 0.0)
            & (at(&self.edges[2], x, y, z) >= 0.0);
        inside & (height < 0.0) & (height >= -farthest)
    }
}

fn with(vector: Vector, offset: f64) -> [f64; 4] {
    [vector[0], vector[1], vector[2], offset]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn at(c: &[f32; 4], x: f32, y: f32, z: f32) -> f32 {
    c[0] * x + (c[1] * y + (c[2] * z + c[3]))
}

fn highest(c: &[f32; 4], part: &[[f32; 3]; 2]) -> f32 {
    let [x, y, z] = std::array::from_fn(|i| part[usize::from(c[i] > 0.0)][i]);
    at(c, x, y, z)
}

fn lowest(c: &[f32; 4], part: &[[f32; 3]; 2]) -> f32 {
    let [x, y, z] = std::array::from_fn(|i| part[usize::from(c[i] <= 0.0)][i]);
    at(c, x, y, z)
}

/// All that lies between a box and a light.
pub(super) struct Shaft {
    low: Vector,
    high: Vector,
    /// One over the way from the box's lowest corner to the light, and from its highest; 0 where that is 0.
    per_way: [Vector; 2],
    end: f64,
}

impl Shaft {
    pub(super) fn new(part: &Bounds, source: &Source) -> Self {
        let (ways, end) = match *source {
            Source::Point(light) => ([sub(light, part.low), sub(light, part.high)], 1.0),
            Source::Directional(towards) => ([towards; 2], f64::INFINITY),
        };
        let per_way = ways.map(|way| way.map(|x| if x.abs() > f64::MIN_POSITIVE { 1.0 / x } else { 0.0 }));
        Self { low: part.low, high: part.high, per_way, end }
    }

    /// Whether a box may lie in it.
    #[inline]
    pub(super) fn meets(&self, bounds: &Bounds) -> bool {
        // At a share s of its way the box reaches from low + s ways[0] to high + s ways[1].
        let (mut first, mut last) = (0.0f64, self.end);
        for i in 0..3 {
            let mut side = |distance: f64, per_way: f64| {
                let share = distance * per_way;
                if per_way > 0.0 {
                    last = if share < last { share } else { last };
                } else if per_way < 0.0 {
                    first = if share > first { share } else { first };
                } else if distance < 0.0 {
                    last = -1.0;
                }
            };
            side(bounds.high[i] - self.low[i], self.per_way[0][i]);
            side(self.high[i] - bounds.low[i], -self.per_way[1][i]);
        }
        first <= last
    }
}
