//! A node of the BVH: boxes side by side, rounded outwards to float32.

use super::vector::{Bounds, Vector};

/// Boxes side by side in a node, which are tested together.
pub(crate) const WIDTH: usize = 8;

/// What of a distance from a plane is rounding, by the sizes of its parts.
const ROUNDING: f64 = 1e-12;

/// Up to [`WIDTH`] boxes: their lowest and highest x, y and z.
#[derive(Clone, Debug)]
pub(crate) struct Boxes {
    pub(crate) low: [[f32; WIDTH]; 3],
    pub(crate) high: [[f32; WIDTH]; 3],
}

impl Boxes {
    /// Puts a box that holds these bounds into a lane.
    pub(crate) fn put(&mut self, lane: usize, bounds: &Bounds) {
        for axis in 0..3 {
            self.low[axis][lane] = below(bounds.low[axis]);
            self.high[axis][lane] = -below(-bounds.high[axis]);
        }
    }

    /// Returns which boxes may reach before a plane: as far along its normal from an origin as it lies, or farther.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn reach_before(&self, normal: &Vector, origin: &Vector, plane: f64) -> [bool; WIDTH] {
        let (mut most, mut reach, mut before) = ([0f64; WIDTH], [0f64; WIDTH], [false; WIDTH]);
        for axis in 0..3 {
            let corner = if normal[axis] > 0.0 { &self.high[axis] } else { &self.low[axis] };
            for i in 0..WIDTH {
                let along = normal[axis] * (f64::from(corner[i]) - origin[axis]);
                most[i] += along;
                reach[i] += along.abs();
            }
        }
        for i in 0..WIDTH {
            before[i] = most[i] >= plane - ROUNDING * reach[i];
        }
        before
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) boxes: Boxes,
    /// The number of a box's node, or its first triangle.
    pub(crate) first: [u32; WIDTH],
    /// How many triangles it has; 0 where it has a node of its own.
    pub(crate) count: [u32; WIDTH],
    /// How many boxes there are.
    pub(crate) used: usize,
}

/// Returns the largest float32 at or below a number.
#[allow(clippy::cast_possible_truncation, reason = "what is rounded up is taken down again")]
pub(crate) fn below(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) > x { single.next_down() } else { single }
}

#[allow(clippy::cast_possible_truncation, reason = "scenes have fewer than 2^31 triangles")]
pub(crate) fn index(n: usize) -> u32 {
    n as u32
}
