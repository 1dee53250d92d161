//! Shadows: which places of a triangle, seen in a part of the image, something hides from a light.

use multiversion::multiversion;

use super::bins::Seen;
use super::cone::{Cone, FrameCones, Packet, Shaft, Source};
use super::hierarchy::{Hierarchy, WIDTH, below};
use super::lanes::{Lanes, MOST, Rays};
use super::lights::{SeenKind, SeenLight, Surroundings};
use super::patch::Patch;
use super::scene::{LightKind, Scene};
use super::vector::{Bounds, Vector, dot, largest, scale, single};
use super::view::{Pose, View};

/// The cones of all that stands still.
pub(super) fn still_cones(scene: &Scene) -> FrameCones {
    if !scene.shadows {
        return vec![];
    }
    let mut lights: Vec<_> = scene.lights.iter().collect();
    lights.sort_by_key(|light| light.group); // as those that are seen
    let still = &scene.corners[scene.frames[0].triangles.clone()];
    let of_light = |kind: &LightKind| {
        let mut packets = vec![];
        match *kind {
            LightKind::Point(place) => Packet::behind(still, &Source::Point(place), &mut packets),
            LightKind::Directional(along) => {
                Packet::behind(still, &Source::Directional(along.map(|x| -x)), &mut packets);
            }
            LightKind::Constant | LightKind::Baked(_) => {}
        }
        packets
    };
    lights.iter().map(|light| of_light(&light.kind)).collect()
}

/// The cones of what moves, as it is in a view: by frame, without the world's.
pub(super) fn moving_cones(scene: &Scene, view: &View, lights: &[SeenLight], cones: &mut Vec<FrameCones>) {
    if !scene.shadows {
        return;
    }
    cones.resize_with(scene.frames.len() - 1, Vec::new);
    for ((frame, pose), cones) in scene.frames.iter().zip(&view.poses).skip(1).zip(cones) {
        cones.resize_with(lights.len(), Vec::new);
        for (light, cones) in lights.iter().zip(cones) {
            if let Some(source) = source(light, pose) {
                Packet::behind(&scene.corners[frame.triangles.clone()], &source, cones);
            }
        }
    }
}

/// Where a light shines from, in a frame.
fn source(light: &SeenLight, pose: &Pose) -> Option<Source> {
    match light.kind {
        SeenKind::Point(place, _) => Some(Source::Point(pose.place(place))),
        SeenKind::Directional(towards, _) => Some(Source::Directional(pose.vector(towards))),
        SeenKind::Constant | SeenKind::Baked(_) => None,
    }
}

/// Camera axes to a frame's, in float32.
#[derive(Clone, Copy, Debug, Default)]
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
#[derive(Debug)]
struct Occluders {
    frame: usize,
    placing: Placing,
    /// Cones, and the triangles that they lie behind.
    cones: Vec<(Cone, u32)>,
    /// The unit vector off the surface to the light's side.
    off: [f32; 3],
}

#[derive(Debug, Default)]
struct LightShadow {
    /// Whether there is no light at all.
    dark: bool,
    /// Those that are in use come first.
    frames: Vec<Occluders>,
    used: usize,
    farthest: f32,
}

/// Shadows on triangles in one part of the image.
#[derive(Debug, Default)]
pub(super) struct Shadow {
    lights: Vec<LightShadow>,
    stack: Vec<u32>,
    /// The world's frame, by which surfaces are stepped off.
    world: Placing,
    step: f32,
    /// The triangle on which shadows fall: it throws none on itself.
    own: u32,
}

impl Shadow {
    /// Finds what may hide some of the lights from a patch of one triangle, or where `alone` is None, of several.
    pub(super) fn search(
        &mut self,
        of: &Surroundings,
        patch: &Patch,
        alone: Option<u32>,
        falls: impl Fn(usize) -> bool,
    ) {
        let (scene, view) = (of.scene, of.view);
        self.lights.resize_with(of.lights.len(), LightShadow::default);
        for shadow in &mut self.lights {
            (shadow.dark, shadow.used) = (false, 0);
        }
        if !scene.shadows {
            return;
        }
        self.world = Placing::new(&view.poses[0]);
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        let step = scene.step as f32;
        self.step = step;
        let corners = patch.corners(view);
        let depth = corners.iter().fold(0.0f64, |most, corner| most.max(corner[2]));
        let part = |frame: usize| {
            if frame == patch.frame {
                patch.bounds
            } else {
                Bounds::of(&corners.map(|corner| view.poses[frame].place(corner)))
            }
        };
        let reach = |part: &Bounds| largest(part.low).max(largest(part.high));
        let step = 1.001 * scene.step * (reach(&part(0)) + depth);
        for frame in 0..scene.frames.len() {
            if scene.frames[frame].triangles.is_empty() {
                continue;
            }
            let part = part(frame);
            let grown = part.grown(step + 1e-6 * (reach(&part) + depth));
            let part = [grown.low.map(below), grown.high.map(|x| -below(-x))];
            for number in (0..of.lights.len()).filter(|&number| falls(number)) {
                if !self.lights[number].dark {
                    self.search_frame(of, number, frame, &part, alone);
                }
            }
        }
    }

    fn search_frame(
        &mut self,
        of: &Surroundings,
        number: usize,
        frame: usize,
        part: &[[f32; 3]; 2],
        alone: Option<u32>,
    ) {
        let pose = &of.view.poses[frame];
        let Some(source) = source(&of.lights[number], pose) else { return };
        let shadow = &mut self.lights[number];
        shadow.farthest = if matches!(source, Source::Point(_)) { of.scene.farthest } else { f32::INFINITY };
        if shadow.used == shadow.frames.len() {
            let placing = Placing::new(pose);
            shadow.frames.push(Occluders { frame, placing, cones: vec![], off: [0.0; 3] });
        }
        let occluders = &mut shadow.frames[shadow.used];
        occluders.cones.clear();
        let packets = if frame == 0 { &of.still[number] } else { &of.moving[frame - 1][number] };
        let first = of.scene.frames[frame].triangles.start;
        let found = Found { first, part, farthest: shadow.farthest, alone };
        let hierarchy = &of.scene.frames[frame].hierarchy;
        let shaft = Shaft::new(part, &source);
        shadow.dark = search_leaves(hierarchy, &shaft, packets, &found, &mut self.stack, &mut occluders.cones);
        if !occluders.cones.is_empty() {
            (occluders.frame, occluders.placing) = (frame, Placing::new(pose));
            shadow.used += 1;
        }
    }

    /// Makes shadows those on one of the triangles that were searched for.
    pub(super) fn fall_on(&mut self, of: &Surroundings, seen: &Seen) {
        self.own = seen.triangle;
        if self.lights.iter().all(|shadow| shadow.used == 0) {
            return;
        }
        let surface = &of.scene.surfaces[seen.triangle as usize];
        let pose = &of.view.poses[surface.frame as usize];
        let normal = [surface.plane[0], surface.plane[1], surface.plane[2]];
        let height = dot(normal, pose.position) + surface.plane[3];
        let normal = pose.turned(normal);
        for (shadow, light) in self.lights.iter_mut().zip(of.lights) {
            let side = match light.kind {
                SeenKind::Point(place, _) => dot(normal, place) + height,
                SeenKind::Directional(towards, _) => dot(normal, towards),
                SeenKind::Constant | SeenKind::Baked(_) => continue,
            };
            let off: Vector = scale(normal, if side < 0.0 { -1.0 } else { 1.0 });
            for occluders in &mut shadow.frames[..shadow.used] {
                occluders.off = single(of.view.poses[occluders.frame].vector(off));
            }
        }
    }

    /// Whether anything may hide a light of this number.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(super) fn hides(&self, light: usize) -> bool {
        self.lights.get(light).is_some_and(|shadow| shadow.dark || shadow.used > 0)
    }
}

/// Takes away the light of places that are hidden from it.
///
/// A function of its own: parts of it would else be worked out before it is known whether there are shadows.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn cast<const FULL: bool>(
    shadow: &Shadow,
    light: usize,
    rays: &Rays<FULL>,
    depth: &Lanes,
    value: &mut Lanes,
    rate: &mut Lanes,
) {
    let (world, own, step_share) = (&shadow.world, shadow.own, shadow.step);
    let shadow = &shadow.lights[light];
    if shadow.dark {
        (*value, *rate) = (Lanes::ZERO, Lanes::ZERO);
        return;
    }
    let n = rays.count();
    let (x, y) = (&rays.x, &rays.y);
    let mut step = Lanes::ZERO;
    for i in 0..n {
        let q = world.place(x[i] * depth[i], y[i] * depth[i], depth[i]);
        let one = if q[0].abs() > q[1].abs() { q[0].abs() } else { q[1].abs() };
        let most = if one > q[2].abs() { one } else { q[2].abs() };
        step[i] = step_share * (most + depth[i]);
    }
    let mut hidden = [0u32; MOST];
    for occluders in &shadow.frames[..shadow.used] {
        let mut places = [Lanes::ZERO; 3];
        for i in 0..n {
            let q = occluders.placing.place(x[i] * depth[i], y[i] * depth[i], depth[i]);
            for k in 0..3 {
                places[k][i] = q[k] + occluders.off[k] * step[i];
            }
        }
        for (cone, _) in occluders.cones.iter().filter(|(_, triangle)| *triangle != own) {
            for i in 0..n {
                hidden[i] |= u32::from(cone.hides_place(places[0][i], places[1][i], places[2][i], shadow.farthest));
            }
        }
    }
    for i in 0..n {
        value[i] = if hidden[i] == 0 { value[i] } else { 0.0 };
        rate[i] = if hidden[i] == 0 { rate[i] } else { 0.0 };
    }
}

/// Adds the cones of all triangles in a shaft that may hide some of a patch; says whether one of them hides it all.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn search_leaves(
    hierarchy: &Hierarchy,
    shaft: &Shaft,
    packets: &[Packet],
    found: &Found,
    stack: &mut Vec<u32>,
    cones: &mut Vec<(Cone, u32)>,
) -> bool {
    let mut dark = false;
    hierarchy.visit(stack, shaft, |leaf| {
        dark = found.add(packets, leaf, cones);
        !dark
    });
    dark
}

/// Finds a patch's occluders in leaves.
struct Found<'a> {
    /// The first triangle of the frame.
    first: usize,
    part: &'a [[f32; 3]; 2],
    farthest: f32,
    /// The patch's triangle, if it is of one.
    alone: Option<u32>,
}

impl Found<'_> {
    /// Adds the cones of a leaf that may hide some of the patch; says whether one of them hides it all.
    ///
    /// Several triangles may hide each other but not themselves, so there none is said to hide all.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::cast_possible_truncation, reason = "scenes have fewer than 2^30 triangles")]
    fn add(&self, packets: &[Packet], leaf: std::ops::Range<usize>, cones: &mut Vec<(Cone, u32)>) -> bool {
        for number in leaf.start / WIDTH..leaf.end.div_ceil(WIDTH) {
            let packet = &packets[number];
            let hides = packet.hides(self.part, self.farthest);
            let lanes =
                leaf.start.max(number * WIDTH) - number * WIDTH..leaf.end.min((number + 1) * WIDTH) - number * WIDTH;
            for lane in lanes {
                let triangle = (self.first + number * WIDTH + lane) as u32;
                if !hides.any[lane] || self.alone == Some(triangle) {
                    continue;
                }
                if hides.all[lane] && self.alone.is_some() {
                    return true;
                }
                cones.push((packet.cone(lane), triangle));
            }
        }
        false
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
