//! Views: the camera's pose and motion in each frame at an instant, and the strength of the lights.
//!
//! In its own frame a body does not move; its motion is part of the camera's. So the renderer has no special case for
//! bodies.
//!
//! What must not break: matrices, velocities and rates are in the axes that each field names.

use super::vector::{Vector, add, cross, dot, scale};

/// The camera's pose and motion in a frame: the world's, or that of a body that moves through it.
///
/// In the frame everything stands still: its own motion is part of the camera's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The camera's centre, metres.
    pub position: [f64; 3],
    /// Takes camera axes (x right, y down, z forward) to the frame's, row by row.
    pub rotation: [[f64; 3]; 3],
    /// In the frame's axes, metres per second.
    pub velocity: [f64; 3],
    /// In camera axes, radians per second.
    pub angular_rate: [f64; 3],
}

impl Pose {
    /// Returns a vector of the frame in camera axes.
    #[inline]
    pub(crate) fn turned(&self, vector: Vector) -> Vector {
        let rows = &self.rotation;
        [
            rows[0][0] * vector[0] + rows[1][0] * vector[1] + rows[2][0] * vector[2],
            rows[0][1] * vector[0] + rows[1][1] * vector[1] + rows[2][1] * vector[2],
            rows[0][2] * vector[0] + rows[1][2] * vector[1] + rows[2][2] * vector[2],
        ]
    }

    /// Returns how a vector that stands still in the frame changes in camera axes, there given in these.
    pub(crate) fn turning(&self, turned: Vector) -> Vector {
        cross(turned, self.angular_rate)
    }

    /// Returns a point given in camera axes, in the frame.
    #[inline]
    pub(crate) fn point(&self, point: Vector) -> Vector {
        add(self.vector(point), self.position)
    }

    /// Returns a vector given in camera axes, in the frame's.
    #[inline]
    pub(crate) fn vector(&self, vector: Vector) -> Vector {
        [dot(self.rotation[0], vector), dot(self.rotation[1], vector), dot(self.rotation[2], vector)]
    }

    /// Returns the frame's velocity in camera axes.
    pub(crate) fn drift(&self) -> Vector {
        scale(self.turned(self.velocity), -1.0)
    }
}

/// An instant: the camera in each frame, and how strong the lights are.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera in the world's frame and, in the scene's order, in those of the bodies.
    pub poses: Vec<Pose>,
    /// For each light a factor on its strength, and the factor's rate per second.
    pub factors: Vec<[f64; 2]>,
}
