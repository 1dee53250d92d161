//! Any hits: finds whether anything lies between points and a light, for a few points at a time.
//!
//! Where a part of the image sees many small triangles, what may throw shadows on all of them is a long list. Here the
//! BVH is asked for a few neighbouring points instead.
//!
//! What must not break: a point is hidden if the [`cone`](super::cone) of any triangle but its own hides it, with the
//! same bits as where the cones are listed before.

use std::ops::Range;

use multiversion::multiversion;

use super::cone::{Packet, Shaft, Source, height_above};
use crate::render::geometry::bvh::{Bvh, WIDTH, below, index};
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
        let mut of = Self {
            coordinates: [[0.0; STEP]; 3],
            own: [0; STEP],
            bounds: [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]],
            slack: 0.0,
            hidden: [0; STEP],
        };
        of.own.copy_from_slice(&own[first..first + STEP]);
        of.hidden.copy_from_slice(&hidden[first..first + STEP]);
        let (mut farthest, mut longest) = (0f32, 0f32);
        for axis in 0..3 {
            of.coordinates[axis].copy_from_slice(&all[axis][first..first + STEP]);
            let [low, high] = &mut of.bounds;
            for value in of.coordinates[axis] {
                low[axis] = if value < low[axis] { value } else { low[axis] };
                high[axis] = if value > high[axis] { value } else { high[axis] };
            }
            farthest = farthest.max(low[axis].abs()).max(high[axis].abs());
        }
        for i in first..first + STEP {
            farthest = farthest.max(depth[i]);
            longest = longest.max(step[i]);
        }
        of.slack = 1.001 * longest + 2e-6 * farthest;
        of
    }

    pub(crate) fn hidden(&self) -> &[u32; STEP] {
        &self.hidden
    }

    fn all_hidden(&self) -> bool {
        self.hidden.iter().fold(1, |all, one| all & one) == 1
    }

    /// Tests the triangles of a leaf; says whether any point is left that none hides.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
    fn test(&mut self, first: usize, packets: &[Packet], leaf: Range<usize>, farthest: f32) -> bool {
        let [x, y, z] = &self.coordinates;
        for at in leaf {
            // Leaves have few triangles: to test each takes no longer than to find out which of them matter.
            let (packet, triangle) = (&packets[at / WIDTH], index(first + at));
            // Most neighbours on a surface are behind no point of it, which takes a quarter of the test to find out.
            let (plane, mut behind, mut any) = (packet.plane(at % WIDTH), [0u32; STEP], 0);
            for i in 0..STEP {
                let height = height_above(&plane, x[i], y[i], z[i]);
                let is_behind = (height < 0.0) & (height >= -farthest);
                behind[i] = u32::from(is_behind) & u32::from(self.own[i] != triangle) & !self.hidden[i];
                any |= behind[i];
            }
            if any == 0 {
                continue;
            }
            let cone = packet.cone(at % WIDTH);
            for i in 0..STEP {
                self.hidden[i] |= behind[i] & u32::from(cone.holds(x[i], y[i], z[i]));
            }
        }
        !self.all_hidden()
    }
}

/// Triangles that may hide points from a light: those of a frame, which begin at `first` in the scene, and their cones.
pub(crate) struct Before<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) first: usize,
    pub(crate) packets: &'a [Packet],
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
    let shaft = Shaft::new(&around, &before.source);
    before.bvh.visit(stack, &shaft, |leaf| points.test(before.first, before.packets, leaf, before.farthest));
}
