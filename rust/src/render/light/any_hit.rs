//! Any hits: finds whether anything lies between points and a light, for some points at a time.
//!
//! Where a part of the image sees many small triangles, what may throw shadows on all of them is a long list. Here the
//! BVH is asked for a few neighbouring points instead.
//!
//! What must not break: a point is hidden if the [`cone`](super::cone) of any triangle but its own hides it, with the
//! same bits as where the cones are listed before.

use multiversion::multiversion;

use super::cone::{ConePacket, Shaft, Source};
use crate::render::geometry::bvh::{Boxes, Bvh, Leaf, WIDTH, below, index};
use crate::render::lanes::{Lanes, MOST, STEP};

/// Points that are tested together, in the frame of what may hide them.
pub(crate) struct Points<'a> {
    /// How many, a multiple of [`STEP`].
    count: usize,
    coordinates: &'a [Lanes; 3],
    /// The triangle that each lies on.
    own: &'a [u32; MOST],
    hidden: &'a mut [u32; MOST],
    /// Their lowest and highest coordinates.
    bounds: [[f32; 3]; 2],
    /// How far they may be off by rounding, and a step off the surface.
    slack: f32,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<'a> Points<'a> {
    /// Takes the first of some lanes; `depth` and `step` are theirs, and those that are 1 in `hidden` are known.
    #[inline(always)]
    pub(crate) fn new(
        count: usize,
        coordinates: &'a [Lanes; 3],
        own: &'a [u32; MOST],
        (depth, step): (&Lanes, &Lanes),
        hidden: &'a mut [u32; MOST],
    ) -> Self {
        let bounds = bounds(coordinates, count);
        let mut farthest = bounds.as_flattened().iter().fold(0f32, |most, value| most.max(value.abs()));
        let mut longest = 0f32;
        for i in 0..count {
            farthest = farthest.max(depth[i]);
            longest = longest.max(step[i]);
        }
        Self { count, coordinates, own, hidden, bounds, slack: 1.001 * longest + 2e-6 * farthest }
    }

    fn is_hidden(&self, group: usize) -> bool {
        self.hidden[group * STEP..][..STEP].iter().fold(1, |all, one| all & one) == 1
    }

    /// Tests the triangles of a leaf for a group of [`STEP`] points.
    #[inline(always)]
    fn test(&mut self, group: usize, before: &Before, leaf: &Leaf) {
        let lanes = group * STEP..(group + 1) * STEP;
        let [x, y, z] = self.coordinates.each_ref().map(|axis| &axis[lanes.clone()]);
        let (own, hidden) = (&self.own[lanes.clone()], &mut self.hidden[lanes]);
        for at in leaf.triangles.clone() {
            // Leaves have few triangles: to test each takes no longer than to find out which of them matter.
            let (cone, triangle) = (before.packets[at / WIDTH].cone(at % WIDTH), index(before.first + at));
            for i in 0..STEP {
                let meets = cone.hides_place(x[i], y[i], z[i], before.farthest);
                hidden[i] |= u32::from(meets) & u32::from(own[i] != triangle);
            }
        }
    }
}

/// Returns the lowest and highest coordinates of the first n points.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn bounds(points: &[Lanes; 3], n: usize) -> [[f32; 3]; 2] {
    let mut region = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for k in 0..3 {
        let (mut low, mut high) = ([f32::INFINITY; STEP], [f32::NEG_INFINITY; STEP]);
        for some in points[k][..n].chunks_exact(STEP) {
            for i in 0..STEP {
                low[i] = if some[i] < low[i] { some[i] } else { low[i] };
                high[i] = if some[i] > high[i] { some[i] } else { high[i] };
            }
        }
        for i in 0..STEP {
            region[0][k] = if low[i] < region[0][k] { low[i] } else { region[0][k] };
            region[1][k] = if high[i] > region[1][k] { high[i] } else { region[1][k] };
        }
    }
    region
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
///
/// The BVH is walked through once for all points. At a leaf, each group of [`STEP`] points looks for itself whether the
/// leaf lies in its way.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn hide(before: &Before, points: &mut Points, stack: &mut Vec<u32>) {
    // The groups that have points which nothing hides so far, as bits.
    let mut open = 0u32;
    for group in 0..points.count / STEP {
        open |= u32::from(!points.is_hidden(group)) << group;
    }
    if open == 0 {
        return;
    }
    // What may hide them is rounded too, by as much as it is large.
    let slack = f64::from(points.slack) + 1e-6 * before.bvh.reach;
    let [low, high] = points.bounds;
    let around = [low.map(|x| below(f64::from(x) - slack)), high.map(|x| -below(-f64::from(x) - slack))];
    let ways = Ways::new(points, &before.source, slack);
    before.bvh.visit(stack, &Shaft::new(&around, &before.source), |leaf| {
        let mut groups = open;
        while groups != 0 {
            let group = groups.trailing_zeros() as usize;
            groups &= groups - 1;
            if ways.meet(points, group, leaf.boxes, leaf.lane) {
                points.test(group, before, &leaf);
                open &= !(u32::from(points.is_hidden(group)) << group);
            }
        }
        open != 0
    });
}

/// The ways from points to a light.
///
/// Points lie side by side on a surface, and so do the leaves that the shaft meets in which all ways lie. Most of these
/// lie in no point's way: to find that out takes less time than to test their triangles.
struct Ways {
    /// Of each axis, one over the way to the light.
    per_way: [Lanes; 3],
    /// Where the light is, as a fraction of the way.
    end: f32,
    slack: f32,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Ways {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn new(points: &Points, source: &Source, slack: f64) -> Self {
        let mut per_way = [Lanes::ZERO; 3];
        for axis in 0..3 {
            for i in 0..points.count.min(MOST) {
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
        Self { per_way, end, slack: slack as f32 }
    }

    /// Returns whether the way of any point of a group may meet a box.
    #[inline(always)]
    fn meet(&self, points: &Points, group: usize, boxes: &Boxes, lane: usize) -> bool {
        let lanes = group * STEP..(group + 1) * STEP;
        let (mut first, mut last) = ([0f32; STEP], [self.end; STEP]);
        for axis in 0..3 {
            let (low, high) = (boxes.low[axis][lane] - self.slack, boxes.high[axis][lane] + self.slack);
            let (from, per_way) = (&points.coordinates[axis][lanes.clone()], &self.per_way[axis][lanes.clone()]);
            for i in 0..STEP {
                let (at_low, at_high) = ((low - from[i]) * per_way[i], (high - from[i]) * per_way[i]);
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

/// A way along an axis is no shorter than this.
const LEAST_WAY: f32 = 1e-30;

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
            chosen in prop::collection::vec((any::<prop::sample::Index>(), 0usize..3, prop_oneof![0.001f64..2.0, 10.0f64..200.0]), MOST),
            groups in 1..=MOST / STEP,
        ) {
            let towards = scale(light, 1.0 / (light[0] * light[0] + light[1] * light[1] + light[2] * light[2]).sqrt());
            let source = if is_point { Source::Point(light) } else { Source::Directional(towards) };
            let corners: Vec<[Vector; 3]> = places.iter().map(|&(a, b, c)| [a, add(a, b), add(a, c)]).collect();
            let (bvh, order) = Bvh::new(corners.iter().map(|corners| Bounds::of(corners)), false);
            let corners: Vec<[Vector; 3]> = order.iter().map(|&i| corners[i as usize]).collect();
            let mut packets = vec![];
            ConePacket::behind(&corners, &source, &mut packets);
            let (mut all, mut own) = ([Lanes::ZERO; 3], [0; MOST]);
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
            let mut hidden = [0; MOST];
            let sizes = (&Lanes::all(1.0), &Lanes::ZERO);
            hide(&before, &mut Points::new(groups * STEP, &all, &own, sizes, &mut hidden), &mut vec![]);
            prop_assert!(hidden[groups * STEP..].iter().all(|&one| one == 0));
            for i in 0..groups * STEP {
                let hides = |triangle: &usize| {
                    let cone = packets[triangle / WIDTH].cone(triangle % WIDTH);
                    cone.hides_place(all[0][i], all[1][i], all[2][i], farthest) && own[i] != index(*triangle)
                };
                prop_assert_eq!(hidden[i] == 1, (0..corners.len()).any(|triangle| hides(&triangle)), "{}", i);
            }
        }
    }
}
