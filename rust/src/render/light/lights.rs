//! Lights in camera axes at an instant, with their rates.
//!
//! They are brought there once for each view, so that shading a ray needs no rotation.
//!
//! What must not break: the order of the lights, which is the order of their colours. Luma is added up in it, so
//! another order changes bits.

use super::beam::SeenBeam;
use super::cone::FrameCones;
use super::slide::SeenSlide;
use crate::render::geometry::vector::{Vector, add, sub};
use crate::render::geometry::view::View;
use crate::render::scene::{LightKind, Scene};

/// A light in camera axes, and how it changes there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenLight {
    pub(crate) kind: SeenKind,
    pub(crate) group: usize,
    pub(crate) strength: f64,
    pub(crate) strength_rate: f64,
    pub(crate) beam: Option<SeenBeam>,
    pub(crate) slide: Option<SeenSlide>,
}

/// Where it shines from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SeenKind {
    /// A position, and its rate.
    Point(Vector, Vector),
    /// The unit vector towards the light, and its rate.
    Directional(Vector, Vector),
    Constant,
    /// The number of its texels in the light maps.
    Baked(usize),
    Visible,
}

/// What surrounds all triangles of a view.
#[derive(Debug)]
pub(crate) struct Surroundings<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) view: &'a View,
    pub(crate) lights: &'a [SeenLight],
    /// The cones of what stands still.
    pub(crate) still: &'a FrameCones,
    /// The cones of each body.
    pub(crate) moving: &'a [FrameCones],
}

/// Returns the lights in the order of their colours, which is that in which they are added up.
pub(crate) fn seen_lights(scene: &Scene, view: &View) -> Vec<SeenLight> {
    let camera = &view.poses[0];
    let mut lights: Vec<SeenLight> = scene
        .lights
        .iter()
        .zip(&view.factors)
        .map(|(light, factor)| SeenLight {
            kind: match light.kind {
                LightKind::Point(position) => {
                    let seen = camera.turned(sub(position, camera.position));
                    SeenKind::Point(seen, add(camera.turning(seen), camera.drift()))
                }
                LightKind::Directional(along) => {
                    let towards = camera.turned(along.map(|x| -x));
                    SeenKind::Directional(towards, camera.turning(towards))
                }
                LightKind::Constant => SeenKind::Constant,
                LightKind::Baked(number) => SeenKind::Baked(number as usize),
                LightKind::Visible => SeenKind::Visible,
            },
            group: light.group as usize,
            strength: light.strength * factor[0],
            strength_rate: light.strength * factor[1],
            beam: light.beam.map(|beam| beam.seen(camera)),
            slide: scene.slide(light, |row| {
                let turned = camera.turned(row);
                [turned, camera.turning(turned)]
            }),
        })
        .collect();
    lights.sort_by_key(|light| light.group);
    lights
}

/// Returns the luma of a ray that hits nothing, and its rate.
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
pub(crate) fn background(scene: &Scene, view: &View) -> (f32, f32) {
    let total = |which: usize| -> f64 {
        scene.lights.iter().zip(&view.factors).map(|(l, f)| l.strength * l.background * f[which]).sum()
    };
    (total(0) as f32, total(1) as f32)
}
