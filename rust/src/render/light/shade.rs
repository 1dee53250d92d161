//! Shading: luma of rays whose triangle is known, and its rate of change along that triangle.
//!
//! A triangle is set up once per view ([`Shader`]). Its rays are then shaded together in float32, in vector code.
//!
//! What must not break: each step is one fixed sequence of float operations, never fused, so that bits do not depend on
//! the processor. Rates are derivatives of the same steps. docs/rendering.md lists the steps.

use super::bumps::{self, LightVectors, turned_normals};
use super::cast::Caster;
use super::lookup::{BLACK, Reflected, looked_up};
use super::normals::{Normals, normals};
use super::shader::{Falls, LightMap, Shader};
use super::slide;
use super::texture::{Clamp, Fold, Mirror, Repeat, Sampler, Wrap};
use crate::render::lanes::{Lanes, Rays};

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Shader<'_> {
    /// Computes what rays see of the triangle.
    #[inline(always)]
    pub(crate) fn luma<const RATE: bool, const FULL: bool>(
        &self,
        rays: &Rays<'_, FULL>,
        caster: &Caster,
        receiver: usize,
        (luma, rate): (&mut Lanes, &mut Lanes),
    ) {
        let n = rays.count();
        let mut depths = BLACK;
        self.depth::<RATE, FULL>(rays, &mut depths);
        let (depth, depth_rate) = &depths;
        *luma = Lanes::ZERO;
        if RATE {
            *rate = Lanes::ZERO;
        }
        // Each stays where it is made: to move it takes as long as to shade a few rays.
        let plain = match (&self.smooth, &self.bumpy) {
            (Some(maps), _) => Some(normals::<RATE, FULL>(maps, rays, depth, depth_rate)),
            (None, Some(bumpy)) => Some(bumpy.flat()),
            (None, None) => None,
        };
        let turned = match (&self.bumpy, &plain) {
            (Some(bumpy), Some(under)) => Some(turned_normals::<RATE, FULL>(bumpy, under, rays, depth, depth_rate)),
            _ => None,
        };
        let normal = turned.as_ref().or(plain.as_ref());
        let mut at = 0;
        while at < self.lit.len() {
            let group = self.lit[at].group;
            let (mut light, mut light_rate) = (Lanes::ZERO, Lanes::ZERO);
            while at < self.lit.len() && self.lit[at].group == group {
                let lit = &self.lit[at];
                let mut fallen = BLACK;
                match (lit.falls, &self.light_map) {
                    (Falls::Baked { texels, strength, rate }, Some(map)) => {
                        let depths = (depth, depth_rate);
                        self.baked::<RATE, FULL>(map, texels, (strength, rate), rays, depths, &mut fallen);
                    }
                    (falls, _) => {
                        falling::<RATE, FULL>(&falls, rays, depth, depth_rate, normal, &mut fallen);
                    }
                }
                let (added, added_rate) = &mut fallen;
                if let (Some(bumpy), Some(turned), Some(under)) = (&self.bumpy, &turned, &plain) {
                    let (normals, depths) = ((turned, under), (depth, depth_rate));
                    let added = (&mut *added, &mut *added_rate);
                    match (lit.falls, lit.falls.source()) {
                        (_, Some(from)) => bumps::take::<RATE, FULL>(bumpy, &from, normals, rays, depths, added),
                        (Falls::Baked { texels, strength, rate }, None) => {
                            let vectors = self.vectors(texels).map(|vectors| (vectors, [strength, rate]));
                            bumps::lean::<RATE, FULL>(vectors.as_ref(), normals, rays, depths, added);
                        }
                        _ => bumps::lean::<RATE, FULL>(None, normals, rays, depths, added),
                    }
                }
                if let (Some(beam), Some(position)) = (&lit.beam, lit.falls.position()) {
                    beam.take::<RATE, FULL>(position, rays, (depth, depth_rate), (added, added_rate));
                }
                if let (Some(seen), Some(position)) = (lit.slide, lit.falls.position()) {
                    let (thrown, depths) = ((self.scene.slides[seen.number].as_ref(), seen), (depth, depth_rate));
                    slide::take::<RATE, FULL>(thrown, position, rays, depths, (&mut *added, &mut *added_rate));
                }
                if caster.hides(lit.light) {
                    caster.take((receiver, lit.light), rays, depth, (added, added_rate));
                }
                for i in 0..n {
                    light[i] += added[i];
                    if RATE {
                        light_rate[i] += added_rate[i];
                    }
                }
                at += 1;
            }
            let mut reflected = BLACK;
            self.reflectance::<RATE, FULL>(group, rays, depth, depth_rate, &mut reflected);
            let (reflectance, reflectance_rate) = &reflected;
            for i in 0..n {
                luma[i] += reflectance[i] * light[i];
                if RATE {
                    rate[i] += reflectance[i] * light_rate[i] + reflectance_rate[i] * light[i];
                }
            }
        }
        if let Some(normal) = normal
            && !self.two_sided
        {
            for i in 0..n {
                let front = normal.facing[i] > 0.0;
                luma[i] = if front { luma[i] } else { 0.0 };
                if RATE {
                    rate[i] = if front { rate[i] } else { 0.0 };
                }
            }
        }
        if self.emitted != (0.0, 0.0) {
            for i in 0..n {
                luma[i] += self.emitted.0;
                if RATE {
                    rate[i] += self.emitted.1;
                }
            }
        }
    }

    /// Returns where the irradiance vectors of a baked light are.
    fn vectors(&self, texels: usize) -> Option<LightVectors<'_>> {
        let map = self.light_map.as_ref()?;
        let texture = map.vectors?;
        let samplers = self.scene.irradiance_vectors[texels].each_ref().map(|axis| Sampler::new(texture, axis));
        Some(LightVectors { samplers, maps: [&map.u, &map.v], axes: &map.axes })
    }

    #[inline(always)]
    fn depth<const RATE: bool, const FULL: bool>(&self, rays: &Rays<'_, FULL>, (depth, rate): &mut Reflected) {
        let (n, x, y) = (rays.count(), rays.x, rays.y);
        for i in 0..n {
            depth[i] = 1.0 / self.inverse_depth.now.at(x[i], y[i]);
            if RATE {
                rate[i] = -(depth[i] * depth[i]) * self.inverse_depth.rate.at(x[i], y[i]);
            }
        }
    }

    #[inline(always)]
    fn reflectance<const RATE: bool, const FULL: bool>(
        &self,
        group: usize,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
        out: &mut Reflected,
    ) {
        let sampler = Sampler::new(self.texture, &self.scene.texels[group]);
        if self.texture.is_constant() {
            out.0 = Lanes::all(sampler.only());
            return;
        }
        match self.texture.wrap {
            Wrap::Repeat => self.textured::<RATE, FULL, Repeat>(sampler, rays, depth, depth_rate, out),
            Wrap::Clamp => self.textured::<RATE, FULL, Clamp>(sampler, rays, depth, depth_rate, out),
            Wrap::Mirror => self.textured::<RATE, FULL, Mirror>(sampler, rays, depth, depth_rate, out),
        }
    }

    #[inline(always)]
    fn textured<const RATE: bool, const FULL: bool, F: Fold>(
        &self,
        sampler: Sampler,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
        out: &mut Reflected,
    ) {
        looked_up::<RATE, FULL, F>([&self.u, &self.v], sampler, rays, depth, depth_rate, out);
    }

    /// Computes the irradiance / pi of a baked light, and its rate.
    #[inline(always)]
    fn baked<const RATE: bool, const FULL: bool>(
        &self,
        map: &LightMap,
        texels: usize,
        (strength, strength_rate): (f32, f32),
        rays: &Rays<'_, FULL>,
        (depth, depth_rate): (&Lanes, &Lanes),
        out: &mut Reflected,
    ) {
        let sampler = Sampler::new(map.texture, &self.scene.irradiance[texels]);
        looked_up::<RATE, FULL, Clamp>([&map.u, &map.v], sampler, rays, depth, depth_rate, out);
        let (value, rate) = out;
        for i in 0..rays.count() {
            // Beyond a triangle's third edge a map may fall below 0, and rounding leads there.
            let light = if value[i] > 0.0 { value[i] } else { 0.0 };
            if RATE {
                rate[i] = strength * rate[i] + strength_rate * light;
            }
            value[i] = strength * light;
        }
    }
}

/// Computes the irradiance / pi of a light that nothing shadows, and its rate.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn falling<const RATE: bool, const FULL: bool>(
    falls: &Falls,
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    depth_rate: &Lanes,
    normals: Option<&Normals>,
    (value, rate): &mut Reflected,
) {
    let (count, x, y) = (rays.count(), rays.x, rays.y);
    match (*falls, normals) {
        (Falls::From { position, position_rate, amount, rate: amount_rate }, _) => {
            for i in 0..count {
                let to = [position[0] - x[i] * depth[i], position[1] - y[i] * depth[i], position[2] - depth[i]];
                let squared = to[0] * to[0] + (to[1] * to[1] + to[2] * to[2]);
                let cube = squared * squared.sqrt();
                value[i] = amount / cube;
                if RATE {
                    let dz = depth_rate[i];
                    let change = [position_rate[0] - x[i] * dz, position_rate[1] - y[i] * dz, position_rate[2] - dz];
                    let along = to[0] * change[0] + (to[1] * change[1] + to[2] * change[2]);
                    rate[i] = amount_rate / cube - 3.0 * value[i] * along / squared;
                }
            }
        }
        (Falls::FromOnSmooth { position, position_rate, strength, rate: strength_rate }, Some(normals)) => {
            for i in 0..count {
                let to = [position[0] - x[i] * depth[i], position[1] - y[i] * depth[i], position[2] - depth[i]];
                let squared = to[0] * to[0] + (to[1] * to[1] + to[2] * to[2]);
                let cube = squared * squared.sqrt();
                let n = [normals.now[0][i], normals.now[1][i], normals.now[2][i]];
                let above = n[0] * to[0] + (n[1] * to[1] + n[2] * to[2]);
                let lit = above > 0.0;
                value[i] = if lit { strength * above / cube } else { 0.0 };
                if RATE {
                    let dz = depth_rate[i];
                    let change = [position_rate[0] - x[i] * dz, position_rate[1] - y[i] * dz, position_rate[2] - dz];
                    let along = to[0] * change[0] + (to[1] * change[1] + to[2] * change[2]);
                    let dn = [normals.rate[0][i], normals.rate[1][i], normals.rate[2][i]];
                    let above_rate = n[0] * change[0]
                        + (n[1] * change[1] + n[2] * change[2])
                        + (dn[0] * to[0] + (dn[1] * to[1] + dn[2] * to[2]));
                    let slope =
                        (strength_rate * above + strength * above_rate) / cube - 3.0 * value[i] * along / squared;
                    rate[i] = if lit { slope } else { 0.0 };
                }
            }
        }
        (Falls::AlongOnSmooth { towards, towards_rate, strength, rate: strength_rate }, Some(normals)) => {
            for i in 0..count {
                let n = [normals.now[0][i], normals.now[1][i], normals.now[2][i]];
                let cosine = n[0] * towards[0] + (n[1] * towards[1] + n[2] * towards[2]);
                let lit = cosine > 0.0;
                value[i] = if lit { strength * cosine } else { 0.0 };
                if RATE {
                    let dn = [normals.rate[0][i], normals.rate[1][i], normals.rate[2][i]];
                    let cosine_rate = n[0] * towards_rate[0]
                        + (n[1] * towards_rate[1] + n[2] * towards_rate[2])
                        + (dn[0] * towards[0] + (dn[1] * towards[1] + dn[2] * towards[2]));
                    rate[i] = if lit { strength_rate * cosine + strength * cosine_rate } else { 0.0 };
                }
            }
        }
        (Falls::Evenly { amount, rate: amount_rate }, _) => {
            *value = Lanes::all(amount);
            if RATE {
                *rate = Lanes::all(amount_rate);
            }
        }
        (Falls::FromOnSmooth { .. } | Falls::AlongOnSmooth { .. }, None) | (Falls::Baked { .. }, _) => {}
    }
}
