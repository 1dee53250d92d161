//! Cones: the part of space that a triangle hides from a light, as linear functions of the hidden point.
//!
//! A shadow test is then four linear functions instead of a ray. [`WIDTH`] cones are tested together ([`Packet`]), for
//! single points and for whole boxes.
//!
//! What must not break: what is found for a box is true for each point in it as float32 computes it.

use crate::render::geometry::bvh::{Boxes, Region, WIDTH};
use crate::render::geometry::vector::{Vector, cross, dot, largest, scale, single, sub};

/// Seen from its side a triangle hides nothing: it is this fraction as wide as its corners are far from the light.
const EDGE_ON: f64 = 1e-7;

/// Where a light shines from, in the frame of what it is hidden by.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source {
    /// A point.
    Point(Vector),
    /// The unit vector towards the light.
    Directional(Vector),
}

/// A point q is hidden where none of the three edges is negative and the height lies below 0; each is
/// a x + (b y + (c z + d)). Seen from a point light at height 1 the triangle lies at 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    edges: [[f32; 4]; 3],
    height: [f32; 4],
}

impl Cone {
    const NONE: Self = Self { edges: [[0.0, 0.0, 0.0, -1.0]; 3], height: [0.0, 0.0, 0.0, 1.0] };

    pub(crate) fn new(corners: &[Vector; 3], source: &Source) -> Self {
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

    /// Returns whether it hides a point.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    pub(crate) fn hides_place(&self, x: f32, y: f32, z: f32, farthest: f32) -> bool {
        let height = at(&self.height, x, y, z);
        let inside = (at(&self.edges[0], x, y, z) >= 0.0)
            & (at(&self.edges[1], x, y, z) >= 0.0)
            & (at(&self.edges[2], x, y, z) >= 0.0);
        inside & (height < 0.0) & (height >= -farthest)
    }
}

impl Cone {
    /// Returns functions as [`Self::hides_place`] has them, a x + b y + c z + d, of which none is negative where it hides
    /// a point.
    pub(crate) fn limits(&self, farthest: f32) -> [[f64; 4]; 5] {
        let [a, b, c] = self.edges.map(|edge| edge.map(f64::from));
        let height = self.height.map(f64::from);
        // Nothing is too far from the sun.
        let reach = if farthest.is_finite() { height } else { [0.0; 4] };
        let offset = if farthest.is_finite() { f64::from(farthest) } else { 1.0 };
        [a, b, c, height.map(|value| -value), [reach[0], reach[1], reach[2], reach[3] + offset]]
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

/// The cones of [`WIDTH`] triangles: what of a box each of them hides is found for all together.
#[derive(Clone, Debug)]
pub(crate) struct ConePacket {
    /// The coefficients of the three edges and of the height.
    functions: [[[f32; WIDTH]; 4]; 4],
}

/// The cones of one frame's triangles behind each light, in the order of the seen lights; none for light from all
/// sides.
pub(crate) type FrameCones = Vec<Vec<ConePacket>>;

/// Cones that were picked out of packets, in packets again; and the triangles that they lie behind.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    pub(crate) packets: Vec<ConePacket>,
    pub(crate) triangles: Vec<u32>,
}

impl Gathered {
    pub(crate) fn clear(&mut self) {
        self.packets.clear();
        self.triangles.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Returns the cone behind the triangle at an index.
    pub(crate) fn cone(&self, at: usize) -> Cone {
        self.packets[at / WIDTH].cone(at % WIDTH)
    }

    /// Adds the cone in one lane of a packet.
    #[inline]
    pub(crate) fn push(&mut self, from: &ConePacket, lane: usize, triangle: u32) {
        let to = self.triangles.len() % WIDTH;
        if to == 0 {
            self.packets.push(ConePacket::NONE);
        }
        self.triangles.push(triangle);
        if let Some(packet) = self.packets.last_mut() {
            for (function, source) in packet.functions.iter_mut().zip(&from.functions) {
                for k in 0..4 {
                    function[k][to] = source[k][lane];
                }
            }
        }
    }
}

/// What cones hide of a box: by cone, whether it may hide any of it, and whether it hides all.
pub(crate) struct Hides {
    pub(crate) any: [bool; WIDTH],
    pub(crate) all: [bool; WIDTH],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
impl ConePacket {
    /// Hides nothing.
    const NONE: Self = Self {
        functions: [
            [[0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [-1.0; WIDTH]],
            [[0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [-1.0; WIDTH]],
            [[0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [-1.0; WIDTH]],
            [[0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [1.0; WIDTH]],
        ],
    };

    /// Adds the cones behind some triangles; the last packet is filled up with what hides nothing.
    pub(crate) fn behind(triangles: &[[Vector; 3]], source: &Source, packets: &mut Vec<Self>) {
        packets.clear();
        packets.extend(triangles.chunks(WIDTH).map(|some| {
            let mut packet = Self::NONE;
            for (lane, corners) in some.iter().enumerate() {
                let cone = Cone::new(corners, source);
                for (function, of_cone) in packet.functions.iter_mut().zip(cone.edges.iter().chain([&cone.height])) {
                    for k in 0..4 {
                        function[k][lane] = of_cone[k];
                    }
                }
            }
            packet
        }));
    }

    pub(crate) fn cone(&self, lane: usize) -> Cone {
        let [a, b, c, height] = self.functions.map(|function| function.map(|lanes| lanes[lane]));
        Cone { edges: [a, b, c], height }
    }

    /// Returns what they hide of a box, as it is computed for each point in it.
    #[inline(always)]
    pub(crate) fn hides(&self, [low, high]: &[[f32; 3]; 2], farthest: f32) -> Hides {
        let [a, b, c, height] = &self.functions;
        let (a, b, c) = (bounds(a, low, high), bounds(b, low, high), bounds(c, low, high));
        let height = bounds(height, low, high);
        let mut hides = Hides { any: [false; WIDTH], all: [false; WIDTH] };
        for i in 0..WIDTH {
            let reached = (a[1][i] >= 0.0) & (b[1][i] >= 0.0) & (c[1][i] >= 0.0);
            hides.any[i] = reached & (height[0][i] < 0.0) & (height[1][i] >= -farthest);
            let inside = (a[0][i] >= 0.0) & (b[0][i] >= 0.0) & (c[0][i] >= 0.0);
            hides.all[i] = inside & (height[1][i] < 0.0) & (height[0][i] >= -farthest);
        }
        hides
    }
}

/// Returns the least and the largest values of functions in a box.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn bounds(function: &[[f32; WIDTH]; 4], low: &[f32; 3], high: &[f32; 3]) -> [[f32; WIDTH]; 2] {
    let (mut least, mut most) = (function[3], function[3]);
    for axis in [2, 1, 0] {
        let (mut at_low, mut at_high) = ([0f32; WIDTH], [0f32; WIDTH]);
        for i in 0..WIDTH {
            (at_low[i], at_high[i]) = (function[axis][i] * low[axis], function[axis][i] * high[axis]);
        }
        // The value at the lower and at the higher corner, in whichever order they are.
        for i in 0..WIDTH {
            least[i] += if at_low[i] < at_high[i] { at_low[i] } else { at_high[i] };
        }
        for i in 0..WIDTH {
            most[i] += if at_low[i] > at_high[i] { at_low[i] } else { at_high[i] };
        }
    }
    [least, most]
}

/// All that lies between a box and a light, a little more.
pub(crate) struct Shaft {
    end: f32,
    /// Of each axis the box's lowest coordinate and one over the way from there to the light; and the same of its
    /// highest, turned round.
    sides: [[[f32; 2]; 2]; 3],
}

impl Shaft {
    pub(crate) fn new([low, high]: &[[f32; 3]; 2], source: &Source) -> Self {
        let end = match source {
            Source::Point(_) => 1.0,
            Source::Directional(_) => f32::INFINITY,
        };
        let way = |from: f32, axis: usize| match *source {
            Source::Point(light) => light[axis] - f64::from(from),
            Source::Directional(towards) => towards[axis],
        };
        // No way at all is a very short one.
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        let per = |way: f64| if way.abs() < 1e-30 { 1e30 } else { (1.0 / way) as f32 };
        let sides = std::array::from_fn(|axis| {
            [[low[axis], per(way(low[axis], axis))], [high[axis], per(-way(high[axis], axis))]]
        });
        Self { end, sides }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Shaft {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        // At a fraction s of its way the box reaches from low + s (light - low) to high + s (light - high).
        let (mut first, mut last) = ([0f32; WIDTH], [self.end; WIDTH]);
        for axis in 0..3 {
            let [[low, per_low], [high, per_high]] = self.sides[axis];
            let mut fractions = [[0f32; WIDTH]; 2];
            for i in 0..WIDTH {
                fractions[0][i] = (boxes.high[axis][i] - low) * per_low;
                fractions[1][i] = (high - boxes.low[axis][i]) * per_high;
            }
            for (fractions, per) in fractions.iter().zip([per_low, per_high]) {
                if per > 0.0 {
                    for i in 0..WIDTH {
                        last[i] = if fractions[i] < last[i] { fractions[i] } else { last[i] };
                    }
                } else {
                    for i in 0..WIDTH {
                        first[i] = if fractions[i] > first[i] { fractions[i] } else { first[i] };
                    }
                }
            }
        }
        // Each fraction is off by three roundings at most.
        std::array::from_fn(|i| first[i] <= last[i] * 1.000_002)
    }
}
