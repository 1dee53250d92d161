//! Shadows on lines: the fraction of each light that reaches a tap's length.
//!
//! On one receiver the shadow of a triangle under a light at a point, or far away, is bounded by linear functions of the
//! image, as a triangle itself is. So on a line it is an interval, and the lengths of what intervals cover together are
//! taken from the taps. Each light is looked at alone: a tap is not split, however many lights there are.
//!
//! What must not break: shadows begin a step off the surface, as those of rays do ([`cast`](crate::render::light::cast)).
//! What throws them was searched for one triangle alone, which is left out itself.

use std::ops::Range;

use super::intervals::Intervals;
use super::pattern::{LinePattern, Run};
use super::taps::Taps;
use super::warp::{TileFunction, Warp};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::LANES;
use crate::render::geometry::vector::{add, dot, largest, scale};
use crate::render::light::cast::Caster;
use crate::render::light::lights::{SeenKind, SeenLight, Surroundings};
use crate::render::light::shadows::Shadow;
use crate::render::tile_hits::TileHits;
use crate::render::visibility::bins::Seen;
use crate::render::visibility::sorted::Sorted;

/// A smaller fraction of a light is none.
const LEAST_LIGHT: f32 = 1e-5;

/// The taps of a tile, ready to be shaded.
pub(crate) struct TileTaps<'a, TileWarp> {
    pub(crate) taps: &'a Taps,
    pub(crate) pattern: &'a LinePattern,
    pub(crate) warp: &'a TileWarp,
    pub(crate) scratch: &'a mut HiddenLengths,
}

/// Room to find what shadows cover of lines.
#[derive(Debug, Default)]
pub(crate) struct HiddenLengths {
    intervals: Intervals,
    /// Of each line where something hides it from a light: intervals, which may overlap.
    lines: Vec<Vec<[f32; 2]>>,
}

/// A triangle that shadows fall on, in camera axes.
struct Receiver {
    /// 1 / depth by the ray.
    inverse_depth: [f64; 3],
    /// Of its plane.
    normal: [f64; 3],
    height: f64,
    /// How far rays of shadows begin off the surface, by depth.
    step: f64,
}

impl Receiver {
    fn new(lit: &Surroundings, seen: &Seen, tile_rect: &Rect) -> Self {
        let surface = &lit.scene.surfaces[seen.triangle as usize];
        let pose = &lit.view.poses[surface.frame as usize];
        let plane_normal = [surface.plane[0], surface.plane[1], surface.plane[2]];
        let inverse_depth = seen.inverse_depth.0.map(f64::from);
        // The step grows with the point's coordinates in the world and with its depth; it is small, so that those in the
        // tile's middle do for all of it.
        let [x, y] = [0, 1].map(|axis| 0.5 * f64::from(tile_rect.low[axis] + tile_rect.high[axis]));
        let world = &lit.view.poses[0];
        let per_depth = inverse_depth[0] * x + inverse_depth[1] * y + inverse_depth[2];
        let coordinates = add(world.vector([x, y, 1.0]), scale(world.position, per_depth.max(0.0)));
        Self {
            inverse_depth,
            normal: pose.turned(plane_normal),
            height: dot(plane_normal, pose.position) + surface.plane[3],
            step: lit.scene.step * (largest(coordinates) + 1.0),
        }
    }

    /// Returns on which side of it a light is.
    fn side_of(&self, light: &SeenLight) -> f64 {
        let along = match light.kind {
            SeenKind::Point(position, _) => dot(self.normal, position) + self.height,
            SeenKind::Directional(towards, _) => dot(self.normal, towards),
            SeenKind::Constant | SeenKind::Baked(_) | SeenKind::Visible => 0.0,
        };
        if along < 0.0 { -1.0 } else { 1.0 }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<TileWarp: Warp> TileTaps<'_, TileWarp> {
    /// Finds for each line where cones hide a receiver from a light.
    #[inline(always)]
    fn find_hidden(
        &mut self,
        lit: &Surroundings,
        (shadow, number): (&Shadow, usize),
        receiver: &Receiver,
        lists: &Range<usize>,
    ) {
        let side = receiver.side_of(&lit.lights[number]);
        let HiddenLengths { intervals, lines } = &mut *self.scratch;
        lines.resize_with(lines.len().max(self.pattern.heights.len()), Vec::new);
        lines.iter_mut().for_each(Vec::clear);
        for occluders in shadow.occluders(number) {
            let pose = &lit.view.poses[occluders.frame];
            for at in 0..occluders.cones.triangles.len() {
                let cone = occluders.cones.cone(at);
                let limits = cone.limits(shadow.farthest(number)).map(|[a, b, c, offset]| {
                    // The value at the point that a ray sees, by inverse depth: linear in the ray.
                    let vector = [a, b, c];
                    let along = pose.turned(vector);
                    let at_camera = dot(vector, pose.position) + offset;
                    let step = receiver.step * side * dot(along, receiver.normal);
                    let mut by_ray: [f64; 3] =
                        std::array::from_fn(|k| along[k] + at_camera * receiver.inverse_depth[k]);
                    by_ray[2] += step;
                    self.warp.function(by_ray)
                });
                let signs = limits.map(|limit| limit.sign(self.pattern));
                if signs.iter().any(|&sign| sign < 0.0) {
                    continue;
                }
                intervals.begin(&self.pattern.ends, lists.clone());
                for (limit, sign) in limits.into_iter().zip(signs) {
                    if sign == 0.0 {
                        limit.clip(intervals, self.pattern);
                    }
                }
                for list in lists.clone().filter(|&list| intervals.any(list)) {
                    for line in list * LANES..(list + 1) * LANES {
                        intervals.each(line, |left, right| lines[line].push([left, right]));
                    }
                }
            }
        }
        for of_line in lines.iter_mut().filter(|of_line| of_line.len() > 1) {
            of_line.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<TileWarp: Warp> TileHits for TileTaps<'_, TileWarp> {
    const ALONE: bool = true;

    fn around(&self, index: u32) -> Rect {
        self.taps.around(self.pattern, index, self.warp).0
    }

    fn sees(&self, index: u32) -> bool {
        !self.taps.range(index).is_empty()
    }

    fn hit(&self, tap: usize) -> Option<u32> {
        self.taps.hit(tap)
    }

    fn sort(&self, index: u32, rows: bool, sorted: &mut Sorted) {
        sorted.of_range(self.taps.range(index), rows);
    }

    fn indices(&self) -> &[u32] {
        &[]
    }

    #[inline(always)]
    fn cast(&mut self, lit: &Surroundings, caster: &mut Caster, seen: &Seen, index: u32) -> bool {
        let receiver = Receiver::new(lit, seen, self.warp.rect());
        let (_, lists) = self.taps.around(self.pattern, index, self.warp);
        let (shadow, fractions) = caster.fractions(lit.lights.len(), self.taps.x.len());
        for (number, fractions) in fractions.iter_mut().enumerate().take(lit.lights.len()) {
            if !shadow.hides(number) || shadow.is_dark(number) {
                continue;
            }
            fractions[self.taps.range(index)].fill(1.0);
            self.find_hidden(lit, (shadow, number), &receiver, &lists);
            let hidden = &self.scratch.lines;
            self.taps.each_run(self.pattern, index, |run, tap_of| {
                let mut reached = run.left;
                for &[left, right] in &hidden[run.line] {
                    let covered = Run { line: run.line, left: left.max(reached), right: right.min(run.right) };
                    if covered.right <= covered.left {
                        continue;
                    }
                    reached = covered.right;
                    let (first, end) = self.pattern.pieces_in(&covered);
                    for piece in first..end {
                        let tap = tap_of(piece);
                        let fraction = self.pattern.tap(piece, &covered).2 / self.taps.weight(self.pattern, tap);
                        let left = fractions[tap] - fraction;
                        // Roundings of intervals that cover the tap together are no light.
                        fractions[tap] = if left < LEAST_LIGHT { 0.0 } else { left };
                    }
                }
            });
        }
        true
    }
}
