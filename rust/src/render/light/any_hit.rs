//! Any hits: finds whether anything lies between points and a light, for a few points at a time.
//!
//! Where a part of the image sees many small triangles, what may throw shadows on all of them is a long list. Here the
//! BVH is asked for a few neighbouring points instead.
//!
//! What must not break: a point is hidden if the [`cone`](super::cone) of any triangle but its own hides it, with the
//! same bits as where the cones are listed before.

use std::ops::Range;

use multiversion::multiversion;

use super::cone::{ConePacket, Shaft, Source};
use crate::render::geometry::bvh::{Boxes, Bvh, Region, WIDTH, below, index};
use crate::render::lanes::{Lanes, STEP};

/// Points that are tested together, in the frame of what may hide them.
pub(crate) struct Points {
    coordinates: [[f32; STEP]; 3],
    /// The triangle that each lies on.
    own: [u32; STEP],
    /// Their lowest and highest coordinates.
    bounds: [[f32; 3]; 2],
    /// How far they may be off by rounding, and a step off the surface.
    slack: f32,
    hidden: [u32; STEP],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Points {
    /// Takes those from the first of some lanes on; `depth` and `step` are theirs, and those that are 1 in `hidden` are
    /// known.
    #[inline(always)]
    pub(crate) fn new(
        first: usize,
        all: &[Lanes; 3],
        own: &[u32],
        depth: &Lanes,
        step: &Lanes,
        hidden: &[u32],
    ) -> Self {
        let mut points = Self {
            coordinates: [[0.0; STEP]; 3],
            own: [0; STEP],
            bounds: [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]],
            slack: 0.0,
            hidden: [0; STEP],
        };
        points.own.copy_from_slice(&own[first..first + STEP]);
        points.hidden.copy_from_slice(&hidden[first..first + STEP]);
        let (mut farthest, mut longest) = (0f32, 0f32);
        for axis in 0..3 {
            points.coordinates[axis].copy_from_slice(&all[axis][first..first + STEP]);
            let [low, high] = &mut points.bounds;
            for value in points.coordinates[axis] {
                low[axis] = if value < low[axis] { value } else { low[axis] };
                high[axis] = if value > high[axis] { value } else { high[axis] };
            }
            farthest = farthest.max(low[axis].abs()).max(high[axis].abs());
        }
        for i in first..first + STEP {
            farthest = farthest.max(depth[i]);
            longest = longest.max(step[i]);
        }
        points.slack = 1.001 * longest + 2e-6 * farthest;
        points
    }

    pub(crate) fn hidden(&self) -> &[u32; STEP] {
        &self.hidden
    }

    fn all_hidden(&self) -> bool {
        self.hidden.iter().fold(1, |all, one| all & one) == 1
    }

    /// Tests the triangles of a leaf; says whether any point is left that none hides.
    #[inline(always)]
    fn test(&mut self, first: usize, packets: &[ConePacket], leaf: Range<usize>, farthest: f32) -> bool {
        let [x, y, z] = &self.coordinates;
        for at in leaf {
            // Leaves have few triangles: to test each takes no longer than to find out which of them matter.
            let (cone, triangle) = (packets[at / WIDTH].cone(at % WIDTH), index(first + at));
            for i in 0..STEP {
                let meets = cone.hides_place(x[i], y[i], z[i], farthest);
                self.hidden[i] |= u32::from(meets) & u32::from(self.own[i] != triangle);
            }
        }
        !self.all_hidden()
    }
}

/// Triangles that may hide points from a light: those of a frame, which begin at `first` in the scene, and their cones.
pub(crate) struct Before<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) first: usize,
    pub(crate) packets: &'a [ConePacket],
    pub(crate) source: Source,
    pub(crate) farthest: f32,
}

/// Finds which of the points triangles hide.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn hide(before: &Before, points: &mut Points, stack: &mut Vec<u32>) {
    if points.all_hidden() {
        return;
    }
    // What may hide them is rounded too, by as much as it is large.
    let slack = f64::from(points.slack) + 1e-6 * before.bvh.reach;
    let [low, high] = points.bounds;
    let around = [low.map(|x| below(f64::from(x) - slack)), high.map(|x| -below(-f64::from(x) - slack))];
    let ways = Ways::new(points, &before.source, slack, Shaft::new(&around, &before.source));
    before.bvh.visit(stack, &ways, |leaf| points.test(before.first, before.packets, leaf, before.farthest));
}

/// The ways from points to a light, and the shaft that all of them lie in.
///
/// Points lie side by side on a surface, and so do the leaves that their shaft meets. Most of these lie in no point's
/// way to the light: to find that out takes less time than to test their triangles.
struct Ways {
    shaft: Shaft,
    points: [[f32; STEP]; 3],
    /// Of each axis, one over the way to the light.
    per_way: [[f32; STEP]; 3],
    /// Where the light is, as a fraction of the way.
    end: f32,
    slack: f32,
}

impl Ways {
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn new(points: &Points, source: &Source, slack: f64, shaft: Shaft) -> Self {
        let mut per_way = [[0f32; STEP]; 3];
        for axis in 0..3 {
            for i in 0..STEP {
                let way = match source {
                    Source::Point(light) => light[axis] as f32 - points.coordinates[axis][i],
                    Source::Directional(towards) => towards[axis] as f32,
                };
                let size = if way < 0.0 { -way } else { way };
                // No way at all is a very short one.
                let size = if size > LEAST_WAY { size } else { LEAST_WAY };
                per_way[axis][i] = 1.0 / if way < 0.0 { -size } else { size };
            }
        }
        let end = match source {
            Source::Point(_) => 1.0,
            Source::Directional(_) => f32::INFINITY,
        };
        Self { shaft, points: points.coordinates, per_way, end, slack: slack as f32 }
    }
}

/// A way along an axis is no shorter than this.
const LEAST_WAY: f32 = 1e-30;

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Ways {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        self.shaft.meets(boxes)
    }

    #[inline(always)]
    fn meets_leaf(&self, boxes: &Boxes, lane: usize) -> bool {
        let (mut first, mut last) = ([0f32; STEP], [self.end; STEP]);
        for axis in 0..3 {
            let (low, high) = (boxes.low[axis][lane] - self.slack, boxes.high[axis][lane] + self.slack);
            for i in 0..STEP {
                let from = self.points[axis][i];
                let (at_low, at_high) = ((low - from) * self.per_way[axis][i], (high - from) * self.per_way[axis][i]);
                let (near, far) = if at_low < at_high { (at_low, at_high) } else { (at_high, at_low) };
                first[i] = if near > first[i] { near } else { first[i] };
                last[i] = if far < last[i] { far } else { last[i] };
            }
        }
        let mut any = 0;
        for i in 0..STEP {
            // Each fraction is off by three roundings at most, as in `Shaft`.
            any |= u32::from(first[i] <= last[i] * 1.000_002);
        }
        any != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::vector::{Bounds, Vector, add, scale, sub};
    use proptest::prelude::*;

    const SIDE: f64 = 4.0;

    fn vector(size: f64) -> impl Strategy<Value = Vector> {
        prop::array::uniform3(-size..size)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Points that lie on the edges of shadows, where rounding decides, are found to be hidden exactly where any
        /// cone hides them.
        #[test]
        fn points_are_hidden_as_by_all_cones(
            places in prop::collection::vec((vector(SIDE), vector(0.3), vector(0.3)), 1..200),
            light in vector(2.0 * SIDE), is_point in any::<bool>(),
            chosen in prop::array::uniform16((any::<prop::sample::Index>(), 0usize..3, prop_oneof![0.001f64..2.0, 10.0f64..200.0])),
        ) {
            let towards = scale(light, 1.0 / (light[0] * light[0] + light[1] * light[1] + light[2] * light[2]).sqrt());
            let source = if is_point { Source::Point(light) } else { Source::Directional(towards) };
            let corners: Vec<[Vector; 3]> = places.iter().map(|&(a, b, c)| [a, add(a, b), add(a, c)]).collect();
            let (bvh, order) = Bvh::new(corners.iter().map(|corners| Bounds::of(corners)), false);
            let corners: Vec<[Vector; 3]> = order.iter().map(|&i| corners[i as usize]).collect();
            let mut packets = vec![];
            ConePacket::behind(&corners, &source, &mut packets);
            let (mut all, mut own) = ([Lanes::ZERO; 3], [0; STEP]);
            for (i, (at, corner, way)) in chosen.iter().enumerate() {
                let triangle = at.index(corners.len());
                own[i] = index(triangle + usize::from(i % 2 == 0));
                let corner = corners[triangle][*corner];
                let point = match source {
                    Source::Point(light) => add(light, scale(sub(corner, light), 1.0 + way)),
                    Source::Directional(towards) => sub(corner, scale(towards, *way)),
                };
                for axis in 0..3 {
                    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
                    let value = point[axis] as f32;
                    all[axis][i] = value;
                }
            }
            let farthest = if is_point { 999.0 } else { f32::INFINITY };
            let before = Before { bvh: &bvh, first: 0, packets: &packets, source, farthest };
            let mut points = Points::new(0, &all, &own, &Lanes::all(1.0), &Lanes::ZERO, &[0; STEP]);
            hide(&before, &mut points, &mut vec![]);
            for i in 0..STEP {
                let hides = |triangle: &usize| {
                    let cone = packets[triangle / WIDTH].cone(triangle % WIDTH);
                    cone.hides_place(all[0][i], all[1][i], all[2][i], farthest) && own[i] != index(*triangle)
                };
                prop_assert_eq!(points.hidden()[i] == 1, (0..corners.len()).any(|triangle| hides(&triangle)), "{}", i);
            }
        }
    }
}
