//! Casts shadows: finds which rays of a tile see points that are hidden from a light, given what may hide them.
//!
//! Rays that are side by side are tested when they are shaded. The others are tested before that, rays of several
//! triangles together, because in a fine mesh each triangle is seen by only a few rays.
//!
//! What must not break:
//! - A triangle throws no shadow on itself.
//! - Testing rays together changes only the time, not the result.

use multiversion::multiversion;

use super::any_hit::{Points, bounds, hide as hide_any};
use super::lights::{SeenKind, Surroundings};
use super::shadows::{Occluders, Shadow, ToFrame};
use crate::render::geometry::bvh::WIDTH;
use crate::render::geometry::vector::{dot, single};
use crate::render::lanes::{Lanes, MOST, Rays, STEP};
use crate::render::visibility::bins::Seen;
use crate::render::visibility::sorted::gathered;

/// More cones than this are first tested together against a box around all points.
const FEW: usize = 12;

/// Shadows on some triangles.
///
/// Rays that lie side by side are looked at when they are shaded. The others are before, those of several triangles
/// together: many triangles are seen by few rays each.
#[derive(Debug, Default)]
pub(crate) struct Caster {
    /// What throws the shadows.
    pub(crate) shadow: Shadow,
    receivers: Vec<Receiver>,
    /// Of each receiver its normal in each of the scene's frames.
    normals: Vec<[f32; 3]>,
    /// Per receiver and light: +1 where the light is on the front side, else -1.
    sides: Vec<f32>,
    frames: usize,
    lights: usize,
    /// Numbers in the tile of the rays that are looked at together, receiver by receiver.
    numbers: Vec<u32>,
    /// Of each light, and each of the tile's rays that were looked at, 1 where it sees a point that is hidden.
    hidden: Vec<Vec<u32>>,
    /// Of each light, and each of the tile's taps, how much of it is not hidden.
    fractions: Vec<Vec<f32>>,
    /// Whether the fractions are those of what is shaded next.
    by_fractions: bool,
    stack: Vec<u32>,
}

/// A triangle that shadows fall on.
#[derive(Clone, Copy, Debug)]
struct Receiver {
    /// The end of its rays among those that are looked at together.
    end: usize,
    /// Its number in the scene: it throws no shadow on itself.
    number: u32,
    inverse_depth: [f32; 3],
}

impl Caster {
    /// Forgets all receivers.
    pub(crate) fn clear(&mut self) {
        self.numbers.clear();
        self.receivers.clear();
        self.normals.clear();
        self.sides.clear();
        self.by_fractions = false;
    }

    /// Begins to say how much of each light reaches taps, of so many: returns what throws shadows, and the fractions,
    /// by light.
    pub(crate) fn fractions(&mut self, lights: usize, taps: usize) -> (&Shadow, &mut [Vec<f32>]) {
        self.by_fractions = true;
        self.fractions.resize_with(self.fractions.len().max(lights), Vec::new);
        for of_light in &mut self.fractions {
            of_light.resize(taps.next_multiple_of(MOST) + MOST, 0.0);
        }
        (&self.shadow, &mut self.fractions)
    }

    /// Adds a triangle, and its rays that do not lie side by side.
    pub(crate) fn fall_on(&mut self, surroundings: &Surroundings, seen: &Seen, scattered: &[u32]) {
        let surface = &surroundings.scene.surfaces[seen.triangle as usize];
        let pose = &surroundings.view.poses[surface.frame as usize];
        let normal = [surface.plane[0], surface.plane[1], surface.plane[2]];
        let height = dot(normal, pose.position) + surface.plane[3];
        let normal = pose.turned(normal);
        (self.frames, self.lights) = (surroundings.view.poses.len(), surroundings.lights.len());
        self.normals.extend(surroundings.view.poses.iter().map(|pose| single(pose.vector(normal))));
        self.sides.extend(surroundings.lights.iter().map(|light| {
            let side = match light.kind {
                SeenKind::Point(position, _) => dot(normal, position) + height,
                SeenKind::Directional(towards, _) => dot(normal, towards),
                SeenKind::Constant | SeenKind::Baked(_) | SeenKind::Visible => 0.0,
            };
            if side < 0.0 { -1.0 } else { 1.0 }
        }));
        self.numbers.extend_from_slice(scattered);
        let (end, inverse_depth) = (self.numbers.len(), seen.inverse_depth.0);
        self.receivers.push(Receiver { end, number: seen.triangle, inverse_depth });
    }

    /// Finds which of the rays that were added see points that are hidden from each light.
    pub(crate) fn cast(&mut self, surroundings: &Surroundings, x: &[f32], y: &[f32]) {
        let (mut hidden, mut stack) = (std::mem::take(&mut self.hidden), std::mem::take(&mut self.stack));
        hidden.resize_with(self.lights, Vec::new);
        for of_light in &mut hidden {
            of_light.resize(x.len(), 0);
        }
        let mut receiver = 0;
        for (at, numbers) in self.numbers.chunks(MOST).enumerate() {
            let first = receiver;
            while self.receivers[receiver].end < at * MOST + numbers.len() {
                receiver += 1;
            }
            hide_scattered(
                self,
                surroundings,
                at * MOST,
                numbers,
                first..receiver + 1,
                (x, y),
                (&mut hidden, &mut stack),
            );
        }
        (self.hidden, self.stack) = (hidden, stack);
    }

    /// Returns whether anything may hide a light of this number.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn hides(&self, light: usize) -> bool {
        self.shadow.hides(light)
    }

    /// Takes away a light, and its rate, from rays that see points of a receiver which are hidden from it.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn take<const FULL: bool>(
        &self,
        (receiver, light): (usize, usize),
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        (value, rate): (&mut Lanes, &mut Lanes),
    ) {
        if self.shadow.is_dark(light) {
            (*value, *rate) = (Lanes::ZERO, Lanes::ZERO);
            return;
        }
        if self.by_fractions {
            let fractions = &self.fractions[light][rays.first..][..MOST];
            for i in 0..rays.count() {
                value[i] *= fractions[i];
                rate[i] *= fractions[i];
            }
            return;
        }
        let mut hidden = [0; MOST];
        if let Some(numbers) = rays.picked {
            let known = &self.hidden[light];
            for i in 0..rays.count() {
                let number = numbers[i] as usize;
                hidden[i] = if number < known.len() { known[number] } else { 0 };
            }
        } else {
            hide(self, (receiver, light), rays, depth, &mut hidden);
        }
        for i in 0..rays.count() {
            value[i] = if hidden[i] == 0 { value[i] } else { 0.0 };
            rate[i] = if hidden[i] == 0 { rate[i] } else { 0.0 };
        }
    }
}

/// Looks at rays of one receiver.
///
/// A function of its own: parts of it would else be worked out before it is known whether there are shadows.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn hide<const FULL: bool>(
    caster: &Caster,
    (receiver, light): (usize, usize),
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    hidden: &mut [u32; MOST],
) {
    let n = rays.count();
    let mut at = At { points: [Lanes::ZERO; 3], step: Lanes::ZERO };
    for i in 0..n {
        at.set(i, &caster.shadow, [rays.x[i] * depth[i], rays.y[i] * depth[i], depth[i]]);
    }
    let own = caster.receivers[receiver].number;
    let side = caster.sides[receiver * caster.lights + light];
    for occluders in caster.shadow.occluders(light) {
        let off = caster.normals[receiver * caster.frames + occluders.frame].map(|component| side * component);
        let points = at.off_the_surface(&occluders.to_frame, n, |_| off);
        hide_points(occluders, caster.shadow.farthest(light), (&points, n), |_| own, hidden);
    }
}

/// Looks at rays of several receivers; the last ray stands for what is missing of [`MOST`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn hide_scattered(
    caster: &Caster,
    surroundings: &Surroundings,
    first: usize,
    numbers: &[u32],
    receivers: std::ops::Range<usize>,
    (x, y): (&[f32], &[f32]),
    (hidden_of_lights, stack): (&mut [Vec<u32>], &mut Vec<u32>),
) {
    let n = numbers.len().next_multiple_of(STEP).min(MOST);
    let mut padded = [numbers.last().copied().unwrap_or_default(); MOST];
    padded[..numbers.len()].copy_from_slice(numbers);
    let (x, y) = (gathered(x, &padded, n), gathered(y, &padded, n));
    // What changes from receiver to receiver, for each of their rays.
    let (mut own, mut inverse) = ([0; MOST], [Lanes::ZERO; 3]);
    let spans = || {
        let mut start = 0;
        receivers.clone().map(move |receiver| {
            let end = caster.receivers[receiver].end.min(first + numbers.len()) - first;
            let end = if receiver + 1 == receivers.end { n } else { end };
            (receiver, std::mem::replace(&mut start, end)..end)
        })
    };
    for (receiver, span) in spans() {
        let receiver = &caster.receivers[receiver];
        own[span.clone()].fill(receiver.number);
        for k in 0..3 {
            inverse[k][span.clone()].fill(receiver.inverse_depth[k]);
        }
    }
    let mut at = At { points: [Lanes::ZERO; 3], step: Lanes::ZERO };
    for i in 0..n {
        let depth = 1.0 / (inverse[0][i] * x[i] + (inverse[1][i] * y[i] + inverse[2][i]));
        at.set(i, &caster.shadow, [x[i] * depth, y[i] * depth, depth]);
    }
    for (light, hidden_of_lights) in hidden_of_lights.iter_mut().enumerate() {
        let mut hidden = [0u32; MOST];
        let off = |frame: usize| {
            let mut off = [Lanes::ZERO; 3];
            for (receiver, span) in spans() {
                let side = caster.sides[receiver * caster.lights + light];
                let normal = &caster.normals[receiver * caster.frames + frame];
                for k in 0..3 {
                    off[k][span.clone()].fill(side * normal[k]);
                }
            }
            off
        };
        for (frame, before) in caster.shadow.before(surroundings, light) {
            let (to_frame, off) = (ToFrame::new(&surroundings.view.poses[frame]), off(frame));
            let points = at.off_the_surface(&to_frame, n, |i| [off[0][i], off[1][i], off[2][i]]);
            let mut points = Points::new(n, &points, &own, (&at.points[2], &at.step), &mut hidden);
            hide_any(&before, &mut points, stack);
        }
        for occluders in caster.shadow.occluders(light) {
            let off = off(occluders.frame);
            let points = at.off_the_surface(&occluders.to_frame, n, |i| [off[0][i], off[1][i], off[2][i]]);
            hide_points(occluders, caster.shadow.farthest(light), (&points, n), |i| own[i], &mut hidden);
        }
        for (&ray, hidden) in numbers.iter().zip(hidden) {
            hidden_of_lights[ray as usize] = hidden;
        }
    }
}

/// The points that rays see, in camera axes, and how far to step off the surface there.
struct At {
    points: [Lanes; 3],
    step: Lanes,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl At {
    #[inline(always)]
    fn set(&mut self, i: usize, shadow: &Shadow, point: [f32; 3]) {
        let q = shadow.world.point(point[0], point[1], point[2]);
        let larger = if q[0].abs() > q[1].abs() { q[0].abs() } else { q[1].abs() };
        let most = if larger > q[2].abs() { larger } else { q[2].abs() };
        (self.points[0][i], self.points[1][i], self.points[2][i]) = (point[0], point[1], point[2]);
        self.step[i] = shadow.step * (most + point[2]);
    }

    /// Returns where shadow rays begin, in a frame of the scene.
    #[inline(always)]
    fn off_the_surface(&self, to_frame: &ToFrame, n: usize, off: impl Fn(usize) -> [f32; 3]) -> [Lanes; 3] {
        let mut points = [Lanes::ZERO; 3];
        for i in 0..n {
            let q = to_frame.point(self.points[0][i], self.points[1][i], self.points[2][i]);
            for k in 0..3 {
                points[k][i] = q[k] + off(i)[k] * self.step[i];
            }
        }
        points
    }
}

/// Sets 1 for each of the first n points that occluders hide, but for what lies behind its own triangle alone.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn hide_points(
    occluders: &Occluders,
    farthest: f32,
    (points, n): (&[Lanes; 3], usize),
    own: impl Fn(usize) -> u32,
    hidden: &mut [u32; MOST],
) {
    let [x, y, z] = points;
    let cones = &occluders.cones;
    let few = cones.triangles.len() <= FEW;
    let region = if few { [[0.0; 3]; 2] } else { bounds(points, n) };
    for (packet, triangles) in cones.packets.iter().zip(cones.triangles.chunks(WIDTH)) {
        let any = if few { [true; WIDTH] } else { packet.hides(&region, farthest).any };
        for (lane, &triangle) in triangles.iter().enumerate().filter(|(lane, _)| any[*lane]) {
            let cone = packet.cone(lane);
            for i in 0..n {
                let meets = cone.hides_place(x[i], y[i], z[i], farthest);
                hidden[i] |= u32::from(meets) & u32::from(own(i) != triangle);
            }
        }
        if !few && hidden[..n].iter().fold(1, |all, one| all & one) == 1 {
            return;
        }
    }
}
