//! Affine functions of the point that a ray hits, such as texture coordinates, and their rates.
//!
//! They are set up once per triangle and view in float64 ([`Map`]), and evaluated at each ray in float32 ([`Affine`]).

use super::texture::Wrap;
use crate::render::geometry::linear::Linear;
use crate::render::geometry::vector::{Vector, dot, single};
use crate::render::geometry::view::Pose;

/// A linear function of the ray, and its rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Changing {
    pub(super) now: Linear,
    pub(super) rate: Linear,
}

/// An affine function of the point that a ray hits: its part that is linear in the ray, per unit of depth, and the
/// rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Affine {
    pub(super) slope: Changing,
    pub(super) offset: f32,
    pub(super) offset_rate: f32,
}

impl Changing {
    pub(super) const ZERO: Self = Self { now: Linear([0.0; 3]), rate: Linear([0.0; 3]) };
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Affine {
    pub(super) const ZERO: Self = Self { slope: Changing::ZERO, offset: 0.0, offset_rate: 0.0 };

    #[inline(always)]
    pub(super) fn at<const RATE: bool>(&self, x: f32, y: f32, depth: f32, depth_rate: f32) -> (f32, f32) {
        let slope = self.slope.now.at(x, y);
        let value = depth * slope + self.offset;
        if !RATE {
            return (value, 0.0);
        }
        (value, depth_rate * slope + (depth * self.slope.rate.at(x, y) + self.offset_rate))
    }
}

/// An affine function of points in a frame, in camera axes and float64.
pub(super) struct Map {
    pub(super) slope: Vector,
    pub(super) slope_rate: Vector,
    pub(super) offset: f64,
    pub(super) offset_rate: f64,
}

impl Map {
    pub(super) fn new(map: &[f64; 4], pose: &Pose) -> Self {
        let slope = [map[0], map[1], map[2]];
        let turned = pose.turned(slope);
        Self {
            slope: turned,
            slope_rate: pose.turning(turned),
            offset: dot(slope, pose.position) + map[3],
            offset_rate: dot(slope, pose.velocity),
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(super) fn single(&self) -> Affine {
        Affine {
            slope: Changing { now: Linear(single(self.slope)), rate: Linear(single(self.slope_rate)) },
            offset: self.offset as f32,
            offset_rate: self.offset_rate as f32,
        }
    }
}

/// Returns a texture coordinate. Whole periods are taken from it, so that float32 is fine enough wherever the texture
/// lies.
pub(super) fn coordinate(map: &[f64; 4], pose: &Pose, wrap: Wrap) -> Affine {
    let mut map = Map::new(map, pose);
    match wrap {
        Wrap::Repeat => map.offset -= map.offset.floor(),
        Wrap::Mirror => map.offset -= 2.0 * (map.offset / 2.0).floor(),
        Wrap::Clamp => {}
    }
    map.single()
}

/// Returns component `i` in camera axes of a vector whose components in the frame's axes are affine functions.
pub(super) fn turned_map(rows: &[Map; 3], pose: &Pose, i: usize) -> Affine {
    let mut sum = Map { slope: [0.0; 3], slope_rate: [0.0; 3], offset: 0.0, offset_rate: 0.0 };
    for (k, row) in rows.iter().enumerate() {
        let mut axis = [0.0; 3];
        axis[k] = 1.0;
        let turned = pose.turned(axis);
        let (weight, weight_rate) = (turned[i], pose.turning(turned)[i]);
        for j in 0..3 {
            sum.slope[j] += weight * row.slope[j];
            sum.slope_rate[j] += weight * row.slope_rate[j] + weight_rate * row.slope[j];
        }
        sum.offset += weight * row.offset;
        sum.offset_rate += weight * row.offset_rate + weight_rate * row.offset;
    }
    sum.single()
}
