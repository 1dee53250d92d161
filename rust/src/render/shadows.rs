//! Shadows: which places of a triangle, seen in a part of the image, something hides from a light.

use super::bins::Seen;
use super::cone::{Cone, Hides, Shaft, Source};
use super::lights::{SeenKind, SeenLight};
use super::linear::Rect;
use super::scene::{LightKind, Scene};
use super::vector::{Bounds, Vector, add, dot, largest, scale, single, sub};
use super::view::{Pose, View};

/// The cones of all that stands still behind lights that stand still; empty for light from all sides.
#[derive(Debug)]
pub(super) struct StillCones(Vec<Vec<Cone>>);

impl StillCones {
    pub(super) fn new(scene: &Scene) -> Self {
        let still = &scene.corners[scene.frames[0].triangles.clone()];
        let behind = |source: &Source| still.iter().map(|corners| Cone::new(corners, source)).collect();
        let of_light = |kind: &LightKind| match *kind {
            LightKind::Point(place) => behind(&Source::Point(place)),
            LightKind::Directional(along) => behind(&Source::Directional(along.map(|x| -x))),
            LightKind::Constant => vec![],
        };
        if !scene.shadows {
            return Self(vec![]);
        }
        let mut lights: Vec<_> = scene.lights.iter().collect();
        lights.sort_by_key(|light| light.group); // as those that are seen
        Self(lights.iter().map(|light| of_light(&light.kind)).collect())
    }
}

/// Camera axes to a frame's, in float32.
#[derive(Clone, Copy, Debug)]
struct Placing {
    rotation: [[f32; 3]; 3],
    position: [f32; 3],
}

impl Placing {
    fn new(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.map(single), position: single(pose.position) }
    }
}

/// What may hide places from one light, in one frame.
#[derive(Debug, Default)]
struct Occluders {
    cones: Vec<Cone>,
    placing: Option<Placing>,
    /// The unit vector off the surface to the light's side.
    off: [f32; 3],
}

#[derive(Debug, Default)]
struct LightShadow {
    /// Whether there is no light at all.
    dark: bool,
    frames: Vec<Occluders>,
    farthest: f32,
}

/// Shadows on one triangle in one part of the image. It is prepared anew for each.
#[derive(Debug, Default)]
pub(super) struct Shadow {
    lights: Vec<LightShadow>,
    stack: Vec<u32>,
    /// The world's frame, by which surfaces are stepped off.
    world: Option<Placing>,
    step: f32,
}

impl Shadow {
    /// Finds what may hide some of the lights from a triangle where it is seen in a part of the image.
    #[allow(clippy::too_many_arguments, reason = "what hides, when, from what, and what is hidden")]
    pub(super) fn prepare(
        &mut self,
        scene: &Scene,
        still: &StillCones,
        view: &View,
        lights: &[SeenLight],
        falling: impl Iterator<Item = usize>,
        seen: &Seen,
        part: &Rect,
    ) {
        self.lights.resize_with(lights.len(), LightShadow::default);
        for shadow in &mut self.lights {
            shadow.dark = false;
            shadow.frames.resize_with(scene.frames.len(), Occluders::default);
            shadow.frames.iter_mut().for_each(|occluders| occluders.cones.clear());
        }
        if !scene.shadows {
            return;
        }
        self.world = Some(Placing::new(&view.poses[0]));
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        let step = scene.step as f32;
        self.step = step;
        let surface = &scene.surfaces[seen.triangle as usize];
        let pose = &view.poses[surface.frame as usize];
        let normal = pose.turned([surface.plane[0], surface.plane[1], surface.plane[2]]);
        let height = dot([surface.plane[0], surface.plane[1], surface.plane[2]], pose.position) + surface.plane[3];
        let patch = patch(&scene.corners[seen.triangle as usize], pose, seen, part);
        let corners = patch.corners().map(|corner| pose.turned(sub(corner, pose.position)));
        let farthest_depth = corners.iter().fold(0.0f64, |most, corner| most.max(corner[2]));
        let parts: Vec<Bounds> = (0..scene.frames.len())
            .map(|frame| {
                if frame == surface.frame as usize {
                    patch
                } else {
                    Bounds::of(&corners.map(|corner| view.poses[frame].place(corner)))
                }
            })
            .collect();
        let reach = |part: &Bounds| largest(part.low).max(largest(part.high));
        let step = 1.001 * scene.step * (reach(&parts[0]) + farthest_depth);
        for number in falling {
            let light = &lights[number];
            let side = match light.kind {
                SeenKind::Point(place, _) => dot(normal, place) + height,
                SeenKind::Directional(towards, _) => dot(normal, towards),
                SeenKind::Constant => continue,
            };
            let off = scale(normal, if side < 0.0 { -1.0 } else { 1.0 });
            for (frame, part) in parts.iter().enumerate() {
                let grown = part.grown(step + 1e-6 * (reach(part) + farthest_depth));
                self.search(scene, still, view, (number, light), (frame, &grown), off, seen.triangle);
                if self.lights[number].dark {
                    break;
                }
            }
        }
    }

    #[allow(clippy::too_many_arguments, reason = "one search: in what, for what, where, from what")]
    fn search(
        &mut self,
        scene: &Scene,
        still: &StillCones,
        view: &View,
        (number, light): (usize, &SeenLight),
        (frame, part): (usize, &Bounds),
        off: Vector,
        own: u32,
    ) {
        let pose = &view.poses[frame];
        let (source, farthest) = match light.kind {
            SeenKind::Point(place, _) => (Source::Point(pose.place(place)), scene.farthest),
            SeenKind::Directional(towards, _) => (Source::Directional(pose.vector(towards)), f32::INFINITY),
            SeenKind::Constant => return,
        };
        let shaft = Shaft::new(part, &source);
        let corners: [[f32; 3]; 2] = [single(part.low), single(part.high)];
        let first = scene.frames[frame].triangles.start;
        let shadow = &mut self.lights[number];
        shadow.farthest = farthest;
        let occluders = &mut shadow.frames[frame];
        occluders.off = single(pose.vector(off));
        occluders.placing = Some(Placing::new(pose));
        let dark = &mut shadow.dark;
        scene.frames[frame].hierarchy.visit(
            &mut self.stack,
            |bounds| shaft.meets(bounds),
            |leaf| {
                for triangle in leaf {
                    let triangle = first + triangle;
                    if triangle == own as usize {
                        continue;
                    }
                    let cone = if frame == 0 {
                        still.0[number][triangle]
                    } else {
                        Cone::new(&scene.corners[triangle], &source)
                    };
                    match cone.hides(&corners, farthest) {
                        Hides::Nothing => {}
                        Hides::Part => occluders.cones.push(cone),
                        Hides::Everything => {
                            *dark = true;
                            return false;
                        }
                    }
                }
                true
            },
        );
    }

    /// Takes away the light of places that are hidden from it.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(super) fn cast<const L: usize>(
        &self,
        light: usize,
        x: &[f32; L],
        y: &[f32; L],
        depth: &[f32; L],
        value: &mut [f32; L],
        rate: &mut [f32; L],
    ) {
        let (Some(shadow), Some(world)) = (self.lights.get(light), &self.world) else { return };
        if shadow.dark {
            *value = [0.0; L];
            *rate = [0.0; L];
            return;
        }
        if shadow.frames.iter().all(|occluders| occluders.cones.is_empty()) {
            return;
        }
        let mut step = [0f32; L];
        for i in 0..L {
            let q = world.place(x[i] * depth[i], y[i] * depth[i], depth[i]);
            let one = if q[0].abs() > q[1].abs() { q[0].abs() } else { q[1].abs() };
            let most = if one > q[2].abs() { one } else { q[2].abs() };
            step[i] = self.step * (most + depth[i]);
        }
        let mut hidden = [0u32; L];
        for occluders in &shadow.frames {
            let Some(placing) = &occluders.placing else { continue };
            if occluders.cones.is_empty() {
                continue;
            }
            let mut places = [[0f32; L]; 3];
            for i in 0..L {
                let q = placing.place(x[i] * depth[i], y[i] * depth[i], depth[i]);
                for k in 0..3 {
                    places[k][i] = q[k] + occluders.off[k] * step[i];
                }
            }
            for cone in &occluders.cones {
                for i in 0..L {
                    hidden[i] |= u32::from(cone.hides_place(places[0][i], places[1][i], places[2][i], shadow.farthest));
                }
            }
        }
        for i in 0..L {
            value[i] = if hidden[i] == 0 { value[i] } else { 0.0 };
            rate[i] = if hidden[i] == 0 { rate[i] } else { 0.0 };
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Placing {
    #[inline(always)]
    fn place(&self, x: f32, y: f32, z: f32) -> [f32; 3] {
        let row = |k: usize| {
            let r = &self.rotation[k];
            r[0] * x + (r[1] * y + (r[2] * z + self.position[k]))
        };
        [row(0), row(1), row(2)]
    }
}

/// A box in the triangle's frame around what of it is seen in a part of the image.
fn patch(corners: &[Vector; 3], pose: &Pose, seen: &Seen, part: &Rect) -> Bounds {
    let whole = Bounds::of(corners);
    let mut points = [[0.0; 3]; 4];
    for (point, [x, y]) in points.iter_mut().zip(part.corners()) {
        let inverse = f64::from(seen.inverse_depth.at(x, y));
        if inverse <= 0.0 {
            return whole;
        }
        let depth = 1.0 / inverse;
        let ray = [f64::from(x) * depth, f64::from(y) * depth, depth];
        *point = add(pose.vector(ray), pose.position);
    }
    let seen = Bounds::of(&points);
    // Rounding may part them by a little where they touch.
    let slack = 1e-6 * (largest(whole.low).max(largest(whole.high)) + largest(seen.low).max(largest(seen.high)));
    let both = seen.grown(slack).within(&whole.grown(slack));
    if (0..3).all(|i| both.low[i] <= both.high[i]) { both } else { whole }
}
