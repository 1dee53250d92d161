//! Shadows: finds what may hide points of a triangle, seen in a part of the image, from a light.
//!
//! The search is made once for each patch and light, in the BVH of each frame. [`super::cast`] then tests single
//! points against what was found.
//!
//! What must not break: everything that may hide a point of the patch is found. Where all of the patch is known to be
//! hidden or lit, single tests would give the same.

use multiversion::multiversion;

use super::any_hit::Before;
use super::cone::{ConePacket, FrameCones, Gathered, Shaft, Source};
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
    let still = &scene.corners[scene.frames[0].triangles.clone()];
    let of_light = |kind: &LightKind| {
        let mut packets = vec![];
        if let Some(source) = kind.source() {
            ConePacket::behind(still, &source, &mut packets);
        }
        packets
    };
    scene.lights_in_order().iter().map(|light| of_light(&light.kind)).collect()
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
                ConePacket::behind(&scene.corners[frame.triangles.clone()], &source, cones);
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
    /// Of what stands still in the frames before this one nothing hides a light.
    from: usize,
    /// The world's frame, by which surfaces are stepped off.
    pub(crate) world: ToFrame,
    pub(crate) step: f32,
}

impl Shadow {
    /// Finds what may hide some of the lights from a patch of one triangle, or where `alone` is None, of several, in the
    /// frames `from` this one on.
    pub(crate) fn search(
        &mut self,
        surroundings: &Surroundings,
        (patch, from): (&Patch, usize),
        alone: Option<u32>,
        falls: impl Fn(usize) -> bool,
    ) {
        let (scene, view) = (surroundings.scene, surroundings.view);
        self.begin(surroundings, from);
        let corners = patch.corners(view);
        let depth = corners.iter().fold(0.0f64, |most, corner| most.max(corner[2]));
        let region = |frame: usize| {
            if frame == patch.frame {
                patch.bounds
            } else {
                Bounds::of(&corners.map(|corner| view.poses[frame].point(corner)))
            }
        };
        let reach = |region: &Bounds| largest(region.low).max(largest(region.high));
        let step = 1.001 * scene.step * (reach(&region(0)) + depth);
        for frame in from..scene.frames.len() {
            if scene.frames[frame].triangles.is_empty() {
                continue;
            }
            let region = region(frame);
            let around = scene.frames[frame].bvh.reach;
            let grown = region.grown(step + 1e-6 * (reach(&region) + depth + around));
            let region = [grown.low.map(below), grown.high.map(|x| -below(-x))];
            for number in (0..surroundings.lights.len()).filter(|&number| falls(number)) {
                if !self.lights[number].dark {
                    self.search_frame(surroundings, number, frame, &region, alone);
                }
            }
        }
    }

    /// Leaves the search for what hides points to [`Self::before`], once single points are known.
    pub(crate) fn by_rays(&mut self, surroundings: &Surroundings, from: usize, falls: impl Fn(usize) -> bool) {
        self.begin(surroundings, from);
        for (number, shadow) in self.lights.iter_mut().enumerate().filter(|(number, _)| falls(*number)) {
            let source = source(&surroundings.lights[number], &surroundings.view.poses[0]);
            shadow.by_rays = source.is_some();
            shadow.farthest =
                if matches!(source, Some(Source::Point(_))) { surroundings.scene.farthest } else { f32::INFINITY };
        }
    }

    /// Forgets what was found for another patch. Nothing hides a light until it is searched for.
    pub(crate) fn begin(&mut self, surroundings: &Surroundings, from: usize) {
        self.from = from;
        self.lights.resize_with(surroundings.lights.len(), LightShadow::default);
        for shadow in &mut self.lights {
            (shadow.dark, shadow.used, shadow.by_rays) = (false, 0, false);
        }
        self.world = ToFrame::new(&surroundings.view.poses[0]);
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        let step = surroundings.scene.step as f32;
        self.step = step;
    }

    /// Returns what the BVH of each frame has between points and a light, where it is to be asked for them.
    pub(crate) fn before<'a>(
        &self,
        surroundings: &'a Surroundings,
        number: usize,
    ) -> impl Iterator<Item = (usize, Before<'a>)> + use<'a> {
        let LightShadow { by_rays, farthest, .. } = self.lights[number];
        let frames = surroundings.scene.frames.iter().zip(&surroundings.view.poses).enumerate().skip(self.from);
        frames.filter(move |(_, (frame, _))| by_rays && !frame.triangles.is_empty()).filter_map(
            move |(at, (frame, pose))| {
                let source = source(&surroundings.lights[number], pose)?;
                let packets = if at == 0 { &surroundings.still[number] } else { &surroundings.moving[at - 1][number] };
                let (bvh, first) = (&frame.bvh, frame.triangles.start);
                Some((at, Before { bvh, first, packets, source, farthest }))
            },
        )
    }

    fn search_frame(
        &mut self,
        surroundings: &Surroundings,
        number: usize,
        frame: usize,
        region: &[[f32; 3]; 2],
        alone: Option<u32>,
    ) {
        let pose = &surroundings.view.poses[frame];
        let Some(source) = source(&surroundings.lights[number], pose) else { return };
        let shadow = &mut self.lights[number];
        shadow.farthest = if matches!(source, Source::Point(_)) { surroundings.scene.farthest } else { f32::INFINITY };
        if shadow.used == shadow.frames.len() {
            let to_frame = ToFrame::new(pose);
            shadow.frames.push(Occluders { frame, to_frame, cones: Gathered::default() });
        }
        let occluders = &mut shadow.frames[shadow.used];
        occluders.cones.clear();
        let packets = if frame == 0 { &surroundings.still[number] } else { &surroundings.moving[frame - 1][number] };
        let first = surroundings.scene.frames[frame].triangles.start;
        let test = LeafTest { first, region, farthest: shadow.farthest, alone };
        let bvh = &surroundings.scene.frames[frame].bvh;
        let shaft = Shaft::new(region, &source);
        shadow.dark = search_leaves(bvh, &shaft, packets, &test, &mut self.stack, &mut occluders.cones);
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
    packets: &[ConePacket],
    test: &LeafTest,
    stack: &mut Vec<u32>,
    cones: &mut Gathered,
) -> bool {
    let mut dark = false;
    bvh.visit(stack, shaft, |leaf| {
        dark = test.add(packets, leaf.triangles, cones);
        !dark
    });
    dark
}

/// Finds a patch's occluders in leaves.
struct LeafTest<'a> {
    /// The first triangle of the frame.
    first: usize,
    region: &'a [[f32; 3]; 2],
    farthest: f32,
    /// The patch's triangle, if it is of one.
    alone: Option<u32>,
}

impl LeafTest<'_> {
    /// Adds the cones of a leaf that may hide some of the patch; says whether one of them hides it all.
    ///
    /// Several triangles may hide each other but not themselves, so there none is said to hide all.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::cast_possible_truncation, reason = "scenes have fewer than 2^30 triangles")]
    fn add(&self, packets: &[ConePacket], leaf: std::ops::Range<usize>, cones: &mut Gathered) -> bool {
        for number in leaf.start / WIDTH..leaf.end.div_ceil(WIDTH) {
            let packet = &packets[number];
            let hides = packet.hides(self.region, self.farthest);
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
