//! Beams: lights at a position that shine differently in different directions (spots, and pieces of an area light).
//!
//! Both change a light's irradiance by a factor of the direction, so they share one type and the renderer's steps for a
//! point light stay as they are. The inverse cosine is plain arithmetic ([`acos`]), because the C library's differs
//! between processors.
//!
//! What must not break: luma and rate are multiplied by the same factor, and the bits are the same on every processor.

use std::f32::consts::{FRAC_PI_2, PI};

use crate::render::geometry::vector::{Vector, single};
use crate::render::geometry::view::Pose;
use crate::render::gloss::number::{Number, Triple, dot, rated};
use crate::render::lanes::Lanes;
use crate::render::lanes::Rays;

/// How a light at a position shines to its sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beam {
    /// With the cosine of the angle to a unit vector, and not to the other side: a piece of an area light.
    Cosine([f64; 3]),
    /// Around a unit vector: all of it within an angle, nothing beyond another, and linear in the angle between them.
    Spot {
        /// The middle of the beam.
        axis: [f64; 3],
        /// Up to this angle from the axis all of it, radians.
        full: f64,
        /// Beyond this angle nothing, radians.
        cutoff: f64,
    },
}

impl Beam {
    /// Returns whether all numbers of it make sense.
    pub(crate) fn is_valid(&self) -> bool {
        let (axis, angles) = match *self {
            Self::Cosine(axis) => (axis, true),
            Self::Spot { axis, full, cutoff } => (axis, 0.0 <= full && full < cutoff && cutoff <= std::f64::consts::PI),
        };
        angles && axis.iter().all(|x| x.is_finite())
    }

    /// Returns the beam in camera axes.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(crate) fn seen(&self, camera: &Pose) -> SeenBeam {
        let (axis, spot) = match *self {
            Self::Cosine(axis) => (axis, None),
            Self::Spot { axis, full, cutoff } => (axis, Some([full as f32, cutoff as f32])),
        };
        let turned: Vector = camera.turned(axis);
        SeenBeam { axis: single(turned), axis_rate: single(camera.turning(turned)), spot }
    }
}

/// A beam in camera axes, and how it turns there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenBeam {
    axis: [f32; 3],
    axis_rate: [f32; 3],
    /// Full and cutoff angle of a spot.
    spot: Option<[f32; 2]>,
}

/// Returns the inverse cosine, the same bits on every processor (Abramowitz and Stegun, 4.4.46: within 2e-8).
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn acos(cosine: f32) -> f32 {
    const A: [f32; 8] = [
        FRAC_PI_2,
        -0.214_598_8,
        0.088_978_99,
        -0.050_174_305,
        0.030_891_88,
        -0.017_088_126,
        0.006_670_09,
        -0.001_262_491_1,
    ];
    let size = if cosine < 0.0 { -cosine } else { cosine };
    let rest = if size < 1.0 { (1.0 - size).sqrt() } else { 0.0 };
    let mut sum = A[7];
    for k in (0..7).rev() {
        sum = sum * size + A[k];
    }
    if cosine < 0.0 { PI - rest * sum } else { rest * sum }
}

impl SeenBeam {
    /// Takes from the light at a position, and from its rate, what the beam does not send to where rays hit.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn take<const RATE: bool, const FULL: bool>(
        &self,
        (position, position_rate): ([f32; 3], [f32; 3]),
        rays: &Rays<FULL>,
        (depth, depth_rate): (&Lanes, &Lanes),
        (value, rate): (&mut Lanes, &mut Lanes),
    ) {
        let (x, y) = (&rays.x, &rays.y);
        for i in 0..rays.count() {
            let away = [x[i] * depth[i] - position[0], y[i] * depth[i] - position[1], depth[i] - position[2]];
            let squared = away[0] * away[0] + (away[1] * away[1] + away[2] * away[2]);
            let per_length = 1.0 / squared.sqrt();
            let along = self.axis[0] * away[0] + (self.axis[1] * away[1] + self.axis[2] * away[2]);
            let cosine = along * per_length;
            let (fraction, slope) = match self.spot {
                None if cosine > 0.0 => (cosine, 1.0),
                None => (0.0, 0.0),
                Some([full, cutoff]) => {
                    let angle = acos(cosine);
                    if angle <= full {
                        (1.0, 0.0)
                    } else if angle >= cutoff {
                        (0.0, 0.0)
                    } else {
                        let sine = (1.0 - cosine * cosine).max(1e-12).sqrt();
                        ((cutoff - angle) / (cutoff - full), 1.0 / ((cutoff - full) * sine))
                    }
                }
            };
            if RATE {
                let dz = depth_rate[i];
                let change = [x[i] * dz - position_rate[0], y[i] * dz - position_rate[1], dz - position_rate[2]];
                let along_rate = self.axis[0] * change[0]
                    + (self.axis[1] * change[1] + self.axis[2] * change[2])
                    + (self.axis_rate[0] * away[0] + (self.axis_rate[1] * away[1] + self.axis_rate[2] * away[2]));
                let outwards = away[0] * change[0] + (away[1] * change[1] + away[2] * change[2]);
                let cosine_rate = (along_rate - along * outwards / squared) * per_length;
                rate[i] = rate[i] * fraction + value[i] * slope * cosine_rate;
            }
            value[i] *= fraction;
        }
    }

    /// Returns whether it is that of a spot light.
    pub(crate) fn is_spot(&self) -> bool {
        self.spot.is_some()
    }

    /// Returns the fraction of a light that it sends along a unit vector, with its rate.
    pub(crate) fn fraction<N: Number>(&self, along: Triple<N>) -> N {
        let cosine = dot(rated(self.axis.map(f64::from), self.axis_rate.map(f64::from)), along);
        let Some([full, cutoff]) = self.spot.map(|angles| angles.map(f64::from)) else {
            return cosine.at_least(0.0);
        };
        let value = cosine.value().clamp(-1.0, 1.0);
        let angle = libm::acos(value);
        if angle <= full {
            N::constant(1.0)
        } else if angle >= cutoff {
            N::constant(0.0)
        } else {
            let slope = -1.0 / (1.0 - value * value).max(1e-12).sqrt();
            (N::constant(cutoff) - N::new(angle, slope * cosine.rate())).scaled(1.0 / (cutoff - full))
        }
    }
}
