//! Lights in the axes of each frame (the world's, or a body's) at an instant, in float64.
//!
//! Derivatives ([`super::slopes`]) are computed in the frame of the triangle that is hit, so lights are brought there
//! first.
//!
//! What must not break: lights and their rates agree with those that frames are rendered with
//! ([`crate::render::light::lights`]).

use crate::render::geometry::vector::{Vector, add, cross, scale, sub};
use crate::render::geometry::view::{Pose, View};
use crate::render::light::beam::Beam;
use crate::render::light::slide::SeenSlide;
use crate::render::scene::{Light, LightKind, Scene};

/// A light in the axes of a frame, and how it changes there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FramedLight {
    pub(crate) kind: FramedKind,
    pub(crate) group: usize,
    /// Strength under its factor, and its rate.
    pub(crate) strength: [f64; 2],
    /// The beam, its axis turned into the frame, and the axis's rate.
    pub(crate) beam: Option<(Beam, Vector)>,
    pub(crate) slide: Option<SeenSlide>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum FramedKind {
    /// A position, and its rate.
    Point(Vector, Vector),
    /// The unit vector towards the light, and its rate.
    Directional(Vector, Vector),
    Constant,
    /// The number of its texels in the light maps.
    Baked(usize),
    Visible,
}

/// Returns the lights of a view in one of its frames.
pub(crate) fn framed_lights(scene: &Scene, view: &View, frame: usize) -> Vec<FramedLight> {
    let (camera, own) = (&view.poses[0], &view.poses[frame]);
    let of_light = |(light, factor): (&Light, &[f64; 2])| FramedLight {
        kind: match light.kind {
            LightKind::Point(position) => {
                let seen = camera.turned(sub(position, camera.position));
                let change = add(camera.turning(seen), camera.drift());
                let rate = add(own.vector(add(cross(own.angular_rate, seen), change)), own.velocity);
                FramedKind::Point(own.point(seen), rate)
            }
            LightKind::Directional(along) => {
                let [towards, rate] = turned(camera, own, scale(along, -1.0));
                FramedKind::Directional(towards, rate)
            }
            LightKind::Constant => FramedKind::Constant,
            LightKind::Baked(number) => FramedKind::Baked(number as usize),
            LightKind::Visible => FramedKind::Visible,
        },
        group: light.group as usize,
        strength: factor.map(|factor| factor * light.strength),
        beam: light.beam.map(|beam| match beam {
            Beam::Cosine(axis) => {
                let [axis, rate] = turned(camera, own, axis);
                (Beam::Cosine(axis), rate)
            }
            Beam::Spot { axis, full, cutoff } => {
                let [axis, rate] = turned(camera, own, axis);
                (Beam::Spot { axis, full, cutoff }, rate)
            }
        }),
        slide: scene.slide(light, |row| turned(camera, own, row)),
    };
    scene.lights.iter().zip(&view.factors).map(of_light).collect()
}

/// Returns a vector that stands still in the world, in a frame, and its rate there.
fn turned(camera: &Pose, own: &Pose, vector: Vector) -> [Vector; 2] {
    let seen = camera.turned(vector);
    [own.vector(seen), own.vector(add(cross(own.angular_rate, seen), camera.turning(seen)))]
}
