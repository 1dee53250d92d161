//! Normals of smooth surfaces where rays hit them, and their rates.

use super::affine::Affine;
use crate::render::lanes::{Lanes, Rays};

/// Unit normals that face the camera, their rates, and whether (1 or -1) their front does.
pub(super) struct Normals {
    pub(super) now: [Lanes; 3],
    pub(super) rate: [Lanes; 3],
    pub(super) facing: Lanes,
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn normals<const RATE: bool, const FULL: bool>(
    maps: &[Affine; 3],
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    depth_rate: &Lanes,
) -> Normals {
    let (n, x, y) = (rays.count(), rays.x, rays.y);
    let mut normals = Normals { now: [Lanes::ZERO; 3], rate: [Lanes::ZERO; 3], facing: Lanes::ZERO };
    for i in 0..n {
        let [a, b, c] = [0, 1, 2].map(|k| maps[k].at::<RATE>(x[i], y[i], depth[i], depth_rate[i]));
        let m = [a.0, b.0, c.0];
        let along = m[0] * x[i] + (m[1] * y[i] + m[2]);
        let facing = if along > 0.0 { -1.0 } else { 1.0 };
        let per_length = facing / (m[0] * m[0] + (m[1] * m[1] + m[2] * m[2])).sqrt();
        let unit = m.map(|component| component * per_length);
        normals.facing[i] = facing;
        for k in 0..3 {
            normals.now[k][i] = unit[k];
        }
        if RATE {
            let r = [a.1 * per_length, b.1 * per_length, c.1 * per_length];
            let along = unit[0] * r[0] + (unit[1] * r[1] + unit[2] * r[2]);
            for k in 0..3 {
                normals.rate[k][i] = r[k] - unit[k] * along;
            }
        }
    }
    normals
}
