//! Bilinear lookup of textures where rays hit them, for many rays at once, with rates.
//!
//! What must not break: the order of the mix, in both rows and then between them.

use super::affine::Affine;
use super::texture::{Fold, Sampler, Taps, parted};
use crate::render::lanes::{Lanes, Rays};

/// Values and, where they are wanted, their rates. Functions write into it, because to return so much is a copy.
pub(super) type Reflected = (Lanes, Lanes);

/// What nothing was written into.
pub(super) const BLACK: Reflected = (Lanes::ZERO, Lanes::ZERO);

/// Where rays hit a texture.
pub(super) struct Positions {
    pub(super) taps: Taps,
    /// Texels per unit of u and of v.
    per_unit: [Lanes; 2],
    /// Texels per second, along u and along v.
    per_second: [Lanes; 2],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Positions {
    /// Finds them by the maps to the texture's coordinates.
    #[inline(always)]
    pub(super) fn new<const RATE: bool, const FULL: bool, F: Fold>(
        [u_map, v_map]: [&Affine; 2],
        sampler: &Sampler,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> Self {
        let (x, y) = (rays.x, rays.y);
        let mut positions = Self::NONE;
        for i in 0..rays.count() {
            let u = u_map.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
            let v = v_map.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
            positions.set::<RATE, F>(i, sampler, [u, v]);
        }
        positions
    }

    /// None yet.
    pub(super) const NONE: Self = Self { taps: Taps::NONE, per_unit: [Lanes::ZERO; 2], per_second: [Lanes::ZERO; 2] };

    /// Sets that of a ray by the texture's coordinates u and v, each with its rate.
    #[inline(always)]
    pub(super) fn set<const RATE: bool, F: Fold>(
        &mut self,
        ray: usize,
        sampler: &Sampler,
        [(u, u_rate), (v, v_rate)]: [(f32, f32); 2],
    ) {
        let [by_u, by_v] = self.taps.set::<F>(ray, sampler, u, v);
        (self.per_unit[0][ray], self.per_unit[1][ray]) = (by_u, by_v);
        if RATE {
            self.per_second[0][ray] = by_u * u_rate;
            self.per_second[1][ray] = by_v * v_rate;
        }
    }

    /// Moves the first n to the middles of the nearest texels, where they stay.
    #[inline(always)]
    pub(super) fn snap(&mut self, n: usize) {
        for i in 0..n {
            self.taps.x[i] = if self.taps.x[i] < 0.5 { 0.0 } else { 1.0 };
            self.taps.y[i] = if self.taps.y[i] < 0.5 { 0.0 } else { 1.0 };
        }
        self.per_second = [Lanes::ZERO; 2];
    }

    /// Mixes the texels around a position: two next to each other, and the two below. Returns the value and its rate.
    #[inline(always)]
    pub(super) fn mixed<const RATE: bool>(&self, i: usize, [[p, q], [r, s]]: [[f32; 2]; 2]) -> (f32, f32) {
        let (upper, lower) = (q - p, s - r);
        let (a, b) = (p + upper * self.taps.x[i], r + lower * self.taps.x[i]);
        let value = a + (b - a) * self.taps.y[i];
        if !RATE {
            return (value, 0.0);
        }
        let along_u = (upper + (lower - upper) * self.taps.y[i]) * self.per_second[0][i];
        (value, along_u + (b - a) * self.per_second[1][i])
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Positions {
    /// Returns how the mix of four texels grows with u and with v at a position, each with its rate.
    #[inline(always)]
    pub(super) fn slopes<const RATE: bool>(&self, i: usize, [p, q, r, s]: [f32; 4]) -> [(f32, f32); 2] {
        let (upper, lower, left, right) = (q - p, s - r, r - p, s - q);
        let [by_u, by_v] = [self.per_unit[0][i], self.per_unit[1][i]];
        let along_u = (upper + (lower - upper) * self.taps.y[i]) * by_u;
        let along_v = (left + (right - left) * self.taps.x[i]) * by_v;
        if !RATE {
            return [(along_u, 0.0), (along_v, 0.0)];
        }
        let (u_rate, v_rate) = (self.per_second[1][i] * by_u, self.per_second[0][i] * by_v);
        [(along_u, (lower - upper) * u_rate), (along_v, (right - left) * v_rate)]
    }
}

/// Looks up a texture of single numbers at the points that rays hit.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn looked_up<const RATE: bool, const FULL: bool, F: Fold>(
    maps: [&Affine; 2],
    sampler: Sampler,
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    depth_rate: &Lanes,
    (value, rate): &mut Reflected,
) {
    let n = rays.count();
    let positions = Positions::new::<RATE, FULL, F>(maps, &sampler, rays, depth, depth_rate);
    let corners = sampler.corners(&positions.taps, n);
    for i in 0..n {
        (value[i], rate[i]) = positions.mixed::<RATE>(i, [parted(corners[0][i]), parted(corners[1][i])]);
    }
}
