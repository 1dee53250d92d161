//! Shadows: finds what may hide points of a triangle, seen in a part of the image, from a light.
//!
//! The search is made once for each patch and light, in the BVH of each frame. [`super::cast`] then tests single
//! points against what was found.
//!
//! What must not break: everything that may hide a point of the patch is found. Where all of the patch is known to be
//! hidden or lit, single tests would give the same.

use multiversion::multiversion;

use super::any_hit::Before;
use super::cone::{FrameCones, Gathered, Packet, Shaft, Source};
use super::lights::{SeenKind, SeenLight, Surroundings};
use super::patch::Patch;
use crate::render::geometry::bvh::{Bvh, WIDTH, below};
use crate::render::geometry::vector::{Bounds, largest, single};
use crate::render::geometry::view::{Pose, View};
use crate::render::scene::{LightKind, Scene};

/// Returns the cones of all that stands still.
pub(crate) fn still_cones(scene: &Scene) -> FrameCones {
    if !scene.shadows {
        return vec![];
    }
    let mut lights: Vec<_> = scene.lights.iter().collect();
    lights.sort_by_key(|light| light.group); // as those that are seen
    let still = &scene.corners[scene.frames[0].triangles.clone()];
    let of_light = |kind: &LightKind| {
        let mut packets = vec![];
        match *kind {
            LightKind::Point(position) => Packet::behind(still, &Source::Point(position), &mut packets),
            LightKind::Directional(along) => {
                Packet::behind(still, &Source::Directional(along.map(|x| -x)), &mut packets);
            }
            LightKind::Constant | LightKind::Baked(_) | LightKind::Visible => {}
        }
        packets
    };
    lights.iter().map(|light| of_light(&light.kind)).collect()
}

/// Finds the cones of what moves, as it is in a view: by frame, without the world's.
pub(crate) fn moving_cones(scene: &Scene, view: &View, lights: &[SeenLight], cones: &mut Vec<FrameCones>) {
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

/// Returns where a light shines from, in a frame.
fn source(light: &SeenLight, pose: &Pose) -> Option<Source> {
    match light.kind {
        SeenKind::Point(position, _) => Some(Source::Point(pose.point(position))),
        SeenKind::Directional(towards, _) => Some(Source::Directional(pose.vector(towards))),
        SeenKind::Constant | SeenKind::Baked(_) | SeenKind::Visible => None,
    }
}

/// Camera axes to a frame's, in float32.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ToFrame {
    rotation: [[f32; 3]; 3],
    position: [f32; 3],
}

impl ToFrame {
    pub(crate) fn new(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.map(single), position: single(pose.position) }
    }
}

/// What may hide points from one light, in one frame.
#[derive(Debug)]
pub(crate) struct Occluders {
    pub(crate) frame: usize,
    pub(crate) to_frame: ToFrame,
    pub(crate) cones: Gathered,
}

#[derive(Debug, Default)]
struct LightShadow {
    /// Whether there is no light at all.
    dark: bool,
    /// Those that are in use come first.
    frames: Vec<Occluders>,
    used: usize,
    /// Whether the BVH is asked for single points.
    by_rays: bool,
    farthest: f32,
}

/// What throws shadows on some triangles in one part of the image.
#[derive(Debug, Default)]
pub(crate) struct Shadow {
    lights: Vec<LightShadow>,
    stack: Vec<u32>,
    /// The world's frame, by which surfaces are stepped off.
    pub(crate) world: ToFrame,
    pub(crate) step: f32,
}

impl Shadow {
    /// Finds what may hide some of the lights from a patch of one triangle, or where `alone` is None, of several.
    pub(crate) fn search(
        &mut self,
        of: &Surroundings,
        patch: &Patch,
        alone: Option<u32>,
        falls: impl Fn(usize) -> bool,
    ) {
        let (scene, view) = (of.scene, of.view);
        self.begin(of);
        let corners = patch.corners(view);
        let depth = corners.iter().fold(0.0f64, |most, corner| most.max(corner[2]));
        let part = |frame: usize| {
            if frame == patch.frame {
                patch.bounds
            } else {
                Bounds::of(&corners.map(|corner| view.poses[frame].point(corner)))
            }
        };
        let reach = |part: &Bounds| largest(part.low).max(largest(part.high));
        let step = 1.001 * scene.step * (reach(&part(0)) + depth);
        for frame in 0..scene.frames.len() {
            if scene.frames[frame].triangles.is_empty() {
                continue;
            }
            let part = part(frame);
            let around = scene.frames[frame].bvh.reach;
            let grown = part.grown(step + 1e-6 * (reach(&part) + depth + around));
            let part = [grown.low.map(below), grown.high.map(|x| -below(-x))];
            for number in (0..of.lights.len()).filter(|&number| falls(number)) {
                if !self.lights[number].dark {
                    self.search_frame(of, number, frame, &part, alone);
                }
            }
        }
    }

    /// Leaves the search for what hides points to [`Self::before`], once single points are known.
    pub(crate) fn by_rays(&mut self, of: &Surroundings, falls: impl Fn(usize) -> bool) {
        self.begin(of);
        for (number, shadow) in self.lights.iter_mut().enumerate().filter(|(number, _)| falls(*number)) {
            let source = source(&of.lights[number], &of.view.poses[0]);
            shadow.by_rays = source.is_some();
            shadow.farthest = if matches!(source, Some(Source::Point(_))) { of.scene.farthest } else { f32::INFINITY };
        }
    }

    /// Forgets what was found for another patch.
    fn begin(&mut self, of: &Surroundings) {
        self.lights.resize_with(of.lights.len(), LightShadow::default);
        for shadow in &mut self.lights {
            (shadow.dark, shadow.used, shadow.by_rays) = (false, 0, false);
        }
        self.world = ToFrame::new(&of.view.poses[0]);
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        let step = of.scene.step as f32;
        self.step = step;
    }

    /// Returns what the BVH of each frame has between points and a light, where it is to be asked for them.
    pub(crate) fn before<'a>(
        &self,
        of: &'a Surroundings,
        number: usize,
    ) -> impl Iterator<Item = (usize, Before<'a>)> + use<'a> {
        let LightShadow { by_rays, farthest, .. } = self.lights[number];
        let frames = of.scene.frames.iter().zip(&of.view.poses).enumerate();
        frames.filter(move |(_, (frame, _))| by_rays && !frame.triangles.is_empty()).filter_map(
            move |(at, (frame, pose))| {
                let source = source(&of.lights[number], pose)?;
                let packets = if at == 0 { &of.still[number] } else { &of.moving[at - 1][number] };
                let (bvh, first) = (&frame.bvh, frame.triangles.start);
                Some((at, Before { bvh, first, packets, source, farthest }))
            },
        )
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
            let to_frame = ToFrame::new(pose);
            shadow.frames.push(Occluders { frame, to_frame, cones: Gathered::default() });
        }
        let occluders = &mut shadow.frames[shadow.used];
        occluders.cones.clear();
        let packets = if frame == 0 { &of.still[number] } else { &of.moving[frame - 1][number] };
        let first = of.scene.frames[frame].triangles.start;
        let found = Found { first, part, farthest: shadow.farthest, alone };
        let bvh = &of.scene.frames[frame].bvh;
        let shaft = Shaft::new(part, &source);
        shadow.dark = search_leaves(bvh, &shaft, packets, &found, &mut self.stack, &mut occluders.cones);
        if !occluders.cones.is_empty() {
            (occluders.frame, occluders.to_frame) = (frame, ToFrame::new(pose));
            shadow.used += 1;
        }
    }

    /// Returns whether single points may be hidden from any light.
    pub(crate) fn falls(&self) -> bool {
        self.lights.iter().any(|shadow| shadow.used > 0 || shadow.by_rays)
    }

    /// Returns whether anything may hide a light of this number.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn hides(&self, light: usize) -> bool {
        self.lights.get(light).is_some_and(|shadow| shadow.dark || shadow.used > 0 || shadow.by_rays)
    }

    /// Returns whether nothing of a light reaches them.
    pub(crate) fn is_dark(&self, light: usize) -> bool {
        self.lights[light].dark
    }

    /// Returns what may hide some points from a light.
    pub(crate) fn occluders(&self, light: usize) -> &[Occluders] {
        &self.lights[light].frames[..self.lights[light].used]
    }

    /// Returns how many times farther from the surface than from the light an occluder may lie.
    pub(crate) fn farthest(&self, light: usize) -> f32 {
        self.lights[light].farthest
    }
}

/// Adds the cones of all triangles in a shaft that may hide some of a patch; says whether one of them hides it all.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn search_leaves(
    bvh: &Bvh,
    shaft: &Shaft,
    packets: &[Packet],
    found: &Found,
    stack: &mut Vec<u32>,
    cones: &mut Gathered,
) -> bool {
    let mut dark = false;
    bvh.visit(stack, shaft, |leaf| {
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
    fn add(&self, packets: &[Packet], leaf: std::ops::Range<usize>, cones: &mut Gathered) -> bool {
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
                cones.push(packet, lane, triangle);
            }
        }
        false
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl ToFrame {
    #[inline(always)]
    pub(crate) fn point(&self, x: f32, y: f32, z: f32) -> [f32; 3] {
        let row = |k: usize| {
            let r = &self.rotation[k];
            r[0] * x + (r[1] * y + (r[2] * z + self.position[k]))
        };
        [row(0), row(1), row(2)]
    }
}
