//! The sky: luma of rays that hit nothing, from an environment map.
//!
//! Directions are mapped to a square by the octahedral map (Meyer et al. 2010, On Floating-Point Normal Vectors). It
//! needs no trigonometry.
//!
//! What must not break: the bits are the same on every processor.

use crate::error::{Error, Result};
use crate::render::geometry::vector::{Vector, cross};
use crate::render::geometry::view::Pose;

const LARGEST_SIDE: usize = 1 << 13;

/// The luma of a sky.
#[derive(Clone, Debug, Default)]
pub struct Sky {
    /// The number of its light, by whose factor it is multiplied.
    pub light: u32,
    /// Texels along a side of the square.
    pub side: usize,
    /// Luma, (side + 2)^2 texels row by row: around the square lies a frame of one texel.
    pub texels: Vec<f32>,
}

impl Sky {
    pub(crate) fn check(&self, lights: usize) -> Result<()> {
        let fits = (1..=LARGEST_SIDE).contains(&self.side) && self.texels.len() == (self.side + 2) * (self.side + 2);
        if fits && (self.light as usize) < lights && self.texels.iter().all(|t| t.is_finite() && *t >= 0.0) {
            return Ok(());
        }
        Err(Error::Argument(format!(
            "a sky has a side of 1..={LARGEST_SIDE}, (side + 2)^2 texels of finite luma that is not negative, and one of \
             {lights} lights, got a side of {}, {} texels and light {}",
            self.side,
            self.texels.len(),
            self.light
        )))
    }

    /// Returns the luma along the ray (x, y, 1) in camera axes, and its rate.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(crate) fn luma(&self, pose: &Pose, x: f32, y: f32) -> (f32, f32) {
        let (luma, rate) = self.along(pose, f64::from(x), f64::from(y));
        (luma as f32, rate as f32)
    }

    /// Returns the same in float64.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "in range")]
    pub(crate) fn along(&self, pose: &Pose, x: f64, y: f64) -> (f64, f64) {
        let ray: Vector = [x, y, 1.0];
        let (at, at_rate) = octahedral(pose.vector(ray), pose.vector(cross(pose.angular_rate, ray)));
        let (mut cell, mut past) = ([0; 2], [0.0; 2]);
        let side = self.side as f64;
        for k in 0..2 {
            let along = (at[k] * side + 0.5).clamp(0.0, side);
            cell[k] = (along.floor() as usize).min(self.side);
            past[k] = along - cell[k] as f64;
        }
        let first = cell[1] * (self.side + 2) + cell[0];
        let texel = |offset: usize| f64::from(self.texels[first + offset]);
        let [p, q, r, s] = [texel(0), texel(1), texel(self.side + 2), texel(self.side + 3)];
        let (upper, lower) = (q - p, s - r);
        let (a, b) = (p + upper * past[0], r + lower * past[0]);
        let rate = side * ((upper + (lower - upper) * past[1]) * at_rate[0] + (b - a) * at_rate[1]);
        (a + (b - a) * past[1], rate)
    }
}

/// Returns where a direction lies in the unit square, and its rate.
fn octahedral(along: Vector, rate: Vector) -> ([f64; 2], [f64; 2]) {
    let size = along[0].abs() + along[1].abs() + along[2].abs();
    let size_rate = sign(along[0]) * rate[0] + sign(along[1]) * rate[1] + sign(along[2]) * rate[2];
    let (mut at, mut at_rate) = ([along[0] / size, along[1] / size], [0.0; 2]);
    for k in 0..2 {
        at_rate[k] = (rate[k] - at[k] * size_rate) / size;
    }
    if along[2] < 0.0 {
        let signs = at.map(sign);
        at_rate = [-signs[0] * signs[1] * at_rate[1], -signs[0] * signs[1] * at_rate[0]];
        at = [(1.0 - at[1].abs()) * signs[0], (1.0 - at[0].abs()) * signs[1]];
    }
    (at.map(|x| 0.5 * (x + 1.0)), at_rate.map(|x| 0.5 * x))
}

fn sign(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}
