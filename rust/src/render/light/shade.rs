//! Shading: luma of rays whose triangle is known, and its rate of change along that triangle.
//!
//! A triangle is set up once per view ([`Shader`]). Its rays are then shaded together in float32, in vector code.
//!
//! What must not break: each step is one fixed sequence of float operations, never fused, so that bits do not depend on
//! the processor. Rates are derivatives of the same steps. docs/rendering.md lists the steps.

use super::affine::Affine;
use super::cast::Caster;
use super::normal_texture::{components, fading};
use super::shader::{Falls, LightMap, SeenBumps, Shader};
use super::texture::{Clamp, Fold, Mirror, Repeat, Sampler, Taps, Wrap, parted};
use crate::render::gloss::number::{Number, RatedSingle, Triple, unit};
use crate::render::lanes::{Lanes, Rays};

/// Luma and, where it is wanted, its rate.
pub(crate) type Reflected = (Lanes, Lanes);

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
        let (depth, depth_rate) = self.depth::<RATE, FULL>(rays);
        *luma = Lanes::ZERO;
        if RATE {
            *rate = Lanes::ZERO;
        }
        let normal = self.smooth.as_ref().map(|maps| normals::<RATE, FULL>(maps, rays, &depth, &depth_rate));
        let (normal, under) = match &self.bumpy {
            None => (normal, None),
            Some(bumpy) => {
                let both = bumpy.normals::<RATE, FULL>(normal, rays, &depth, &depth_rate);
                (Some(both.turned), Some((bumpy, both.under)))
            }
        };
        let mut at = 0;
        while at < self.lit.len() {
            let group = self.lit[at].group;
            let (mut light, mut light_rate) = (Lanes::ZERO, Lanes::ZERO);
            while at < self.lit.len() && self.lit[at].group == group {
                let lit = &self.lit[at];
                let (mut added, mut added_rate) = match (lit.falls, &self.light_map) {
                    (Falls::Baked { texels, strength, rate }, Some(map)) => {
                        self.baked::<RATE, FULL>(map, texels, (strength, rate), rays, &depth, &depth_rate)
                    }
                    (falls, _) => falling::<RATE, FULL>(&falls, rays, &depth, &depth_rate, normal.as_ref()),
                };
                if let (Some((bumpy, under)), Some(turned)) = (&under, &normal) {
                    let normals = (turned, under);
                    bumpy.take::<RATE, FULL>(
                        &lit.falls,
                        normals,
                        rays,
                        (&depth, &depth_rate),
                        (&mut added, &mut added_rate),
                    );
                }
                if let (Some(beam), Some(position)) = (&lit.beam, lit.falls.position()) {
                    beam.take::<RATE, FULL>(position, rays, (&depth, &depth_rate), (&mut added, &mut added_rate));
                }
                if caster.hides(lit.light) {
                    caster.take((receiver, lit.light), rays, &depth, (&mut added, &mut added_rate));
                }
                for i in 0..n {
                    light[i] += added[i];
                    if RATE {
                        light_rate[i] += added_rate[i];
                    }
                }
                at += 1;
            }
            let (reflectance, reflectance_rate) = self.reflectance::<RATE, FULL>(group, rays, &depth, &depth_rate);
            for i in 0..n {
                luma[i] += reflectance[i] * light[i];
                if RATE {
                    rate[i] += reflectance[i] * light_rate[i] + reflectance_rate[i] * light[i];
                }
            }
        }
        if let Some(normal) = &normal
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

    #[inline(always)]
    fn depth<const RATE: bool, const FULL: bool>(&self, rays: &Rays<'_, FULL>) -> Reflected {
        let (n, x, y) = (rays.count(), rays.x, rays.y);
        let (mut depth, mut rate) = (Lanes::ZERO, Lanes::ZERO);
        for i in 0..n {
            depth[i] = 1.0 / self.inverse_depth.now.at(x[i], y[i]);
            if RATE {
                rate[i] = -(depth[i] * depth[i]) * self.inverse_depth.rate.at(x[i], y[i]);
            }
        }
        (depth, rate)
    }

    #[inline(always)]
    fn reflectance<const RATE: bool, const FULL: bool>(
        &self,
        group: usize,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> Reflected {
        let sampler = Sampler::new(self.texture, &self.scene.texels[group]);
        if self.texture.is_constant() {
            return (Lanes::all(sampler.only()), Lanes::ZERO);
        }
        match self.texture.wrap {
            Wrap::Repeat => self.textured::<RATE, FULL, Repeat>(sampler, rays, depth, depth_rate),
            Wrap::Clamp => self.textured::<RATE, FULL, Clamp>(sampler, rays, depth, depth_rate),
            Wrap::Mirror => self.textured::<RATE, FULL, Mirror>(sampler, rays, depth, depth_rate),
        }
    }

    #[inline(always)]
    fn textured<const RATE: bool, const FULL: bool, F: Fold>(
        &self,
        sampler: Sampler,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> Reflected {
        looked_up::<RATE, FULL, F>([&self.u, &self.v], sampler, rays, depth, depth_rate)
    }

    /// Computes the irradiance / pi of a baked light, and its rate.
    #[inline(always)]
    fn baked<const RATE: bool, const FULL: bool>(
        &self,
        map: &LightMap,
        texels: usize,
        (strength, strength_rate): (f32, f32),
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> Reflected {
        let sampler = Sampler::new(map.texture, &self.scene.irradiance[texels]);
        let (mut value, mut rate) = looked_up::<RATE, FULL, Clamp>([&map.u, &map.v], sampler, rays, depth, depth_rate);
        for i in 0..rays.count() {
            // Beyond a triangle's third edge a map may fall below 0, and rounding leads there.
            let light = if value[i] > 0.0 { value[i] } else { 0.0 };
            if RATE {
                rate[i] = strength * rate[i] + strength_rate * light;
            }
            value[i] = strength * light;
        }
        (value, rate)
    }
}

/// Looks up bilinearly at the points that rays hit, by the maps to their coordinates. Returns values and their rates.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn looked_up<const RATE: bool, const FULL: bool, F: Fold>(
    [u_map, v_map]: [&Affine; 2],
    sampler: Sampler,
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    depth_rate: &Lanes,
) -> Reflected {
    let (n, x, y) = (rays.count(), rays.x, rays.y);
    let (mut taps, mut rates) = (Taps::NONE, [Lanes::ZERO; 2]);
    for i in 0..n {
        let (u, u_rate) = u_map.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
        let (v, v_rate) = v_map.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
        let [by_u, by_v] = taps.set::<F>(i, &sampler, u, v);
        if RATE {
            rates[0][i] = by_u * u_rate;
            rates[1][i] = by_v * v_rate;
        }
    }
    let corners = sampler.corners(&taps, n);
    let (mut value, mut rate) = (Lanes::ZERO, Lanes::ZERO);
    for i in 0..n {
        let [[p, q], [r, s]] = [parted(corners[0][i]), parted(corners[1][i])];
        let (upper, lower) = (q - p, s - r);
        let (a, b) = (p + upper * taps.x[i], r + lower * taps.x[i]);
        value[i] = a + (b - a) * taps.y[i];
        if RATE {
            rate[i] = (upper + (lower - upper) * taps.y[i]) * rates[0][i] + (b - a) * rates[1][i];
        }
    }
    (value, rate)
}

/// Unit normals that face the camera, their rates, and whether (1 or -1) their front does.
struct Normals {
    now: [Lanes; 3],
    rate: [Lanes; 3],
    facing: Lanes,
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn normals<const RATE: bool, const FULL: bool>(
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

/// Normals of a surface with a normal texture, on the side that is seen.
struct BumpyNormals {
    turned: Normals,
    /// Without the texture.
    under: Normals,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl SeenBumps<'_> {
    /// Turns normals: those of a smooth surface, or the plane's.
    #[inline(always)]
    fn normals<const RATE: bool, const FULL: bool>(
        &self,
        smooth: Option<Normals>,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> BumpyNormals {
        let under = smooth.unwrap_or_else(|| {
            let lanes = |which: usize| self.plane[which].map(|component| Lanes::all(self.facing * component));
            Normals { now: lanes(0), rate: lanes(1), facing: Lanes::all(self.facing) }
        });
        let (values, rates) = match self.bumps.texture.wrap {
            Wrap::Repeat => self.components::<RATE, FULL, Repeat>(rays, depth, depth_rate),
            Wrap::Clamp => self.components::<RATE, FULL, Clamp>(rays, depth, depth_rate),
            Wrap::Mirror => self.components::<RATE, FULL, Mirror>(rays, depth, depth_rate),
        };
        let mut turned = Normals { now: [Lanes::ZERO; 3], rate: [Lanes::ZERO; 3], facing: under.facing };
        for i in 0..rays.count() {
            let facing = under.facing[i];
            let viewer = [-f64::from(rays.x[i]), -f64::from(rays.y[i]), -1.0];
            let (normal, texel) = (of_lane(&under.now, i, facing), of_lane(&values, i, 1.0));
            let seen = (facing > 0.0, viewer);
            if RATE {
                let normal = with_rates(normal, of_lane(&under.rate, i, facing));
                let texel = with_rates(texel, of_lane(&rates, i, 1.0));
                let made = self.bumps.rule.turned(normal, with_rates(self.tangent[0], self.tangent[1]), texel, seen);
                for k in 0..3 {
                    (turned.now[k][i], turned.rate[k][i]) = rounded(made[k]);
                }
            } else {
                let made = self.bumps.rule.turned(normal, self.tangent[0], texel, seen);
                for k in 0..3 {
                    turned.now[k][i] = made[k];
                }
            }
        }
        BumpyNormals { turned, under }
    }

    /// Looks up the three components where rays hit, and their rates.
    #[inline(always)]
    fn components<const RATE: bool, const FULL: bool, F: Fold>(
        &self,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> ([Lanes; 3], [Lanes; 3]) {
        let (n, x, y) = (rays.count(), rays.x, rays.y);
        let sampler = Sampler::new(self.bumps.texture, self.bumps.texels);
        let (mut taps, mut per_second) = (Taps::NONE, [Lanes::ZERO; 2]);
        for i in 0..n {
            let (u, u_rate) = self.u.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
            let (v, v_rate) = self.v.at::<RATE>(x[i], y[i], depth[i], depth_rate[i]);
            let [by_u, by_v] = taps.set::<F>(i, &sampler, u, v);
            if RATE {
                per_second[0][i] = by_u * u_rate;
                per_second[1][i] = by_v * v_rate;
            }
        }
        let corners = sampler.four(&taps, n);
        let (mut values, mut rates) = ([Lanes::ZERO; 3], [Lanes::ZERO; 3]);
        for i in 0..n {
            let (p, q) = (components(corners[0][i]), components(corners[1][i]));
            let (r, s) = (components(corners[2][i]), components(corners[3][i]));
            for k in 0..3 {
                let (upper, lower) = (q[k] - p[k], s[k] - r[k]);
                let (a, b) = (p[k] + upper * taps.x[i], r[k] + lower * taps.x[i]);
                values[k][i] = a + (b - a) * taps.y[i];
                if RATE {
                    let along = (upper + (lower - upper) * taps.y[i]) * per_second[0][i];
                    rates[k][i] = along + (b - a) * per_second[1][i];
                }
            }
        }
        (values, rates)
    }

    /// Takes away light that comes from behind the surface, to which its texture would turn it, and fades it.
    #[inline(always)]
    fn take<const RATE: bool, const FULL: bool>(
        &self,
        falls: &Falls,
        (turned, under): (&Normals, &Normals),
        rays: &Rays<'_, FULL>,
        (depth, depth_rate): (&Lanes, &Lanes),
        (value, rate): (&mut Lanes, &mut Lanes),
    ) {
        let (position, position_rate, along) = match *falls {
            Falls::FromOnSmooth { position, position_rate, .. } => (position, position_rate, false),
            Falls::AlongOnSmooth { towards, towards_rate, .. } => (towards, towards_rate, true),
            Falls::From { .. } | Falls::Evenly { .. } | Falls::Baked { .. } => return,
        };
        for i in 0..rays.count() {
            let point = if along { [0.0; 3] } else { [rays.x[i] * depth[i], rays.y[i] * depth[i], depth[i]] };
            let way = [position[0] - point[0], position[1] - point[1], position[2] - point[2]];
            let (flat, bent) = (of_lane(&under.now, i, 1.0), of_lane(&turned.now, i, 1.0));
            let lit = flat[0] * way[0] + (flat[1] * way[1] + flat[2] * way[2]) > 0.0;
            if self.bumps.rule.fades && RATE {
                let moves = if along { 0.0 } else { depth_rate[i] };
                let moves = [
                    position_rate[0] - rays.x[i] * moves,
                    position_rate[1] - rays.y[i] * moves,
                    position_rate[2] - moves,
                ];
                let way = with_rates(way, moves);
                let flat = with_rates(flat, of_lane(&under.rate, i, 1.0));
                let bent = with_rates(bent, of_lane(&turned.rate, i, 1.0));
                let (fraction, fraction_rate) = rounded(fading(flat, bent, unit(way)));
                rate[i] = rate[i] * fraction + value[i] * fraction_rate;
                value[i] *= fraction;
            } else if self.bumps.rule.fades {
                value[i] *= fading(flat, bent, unit(way));
            }
            value[i] = if lit { value[i] } else { 0.0 };
            rate[i] = if lit { rate[i] } else { 0.0 };
        }
    }
}

/// Returns the vector of a ray, times a factor.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn of_lane(lanes: &[Lanes; 3], i: usize, by: f32) -> [f32; 3] {
    [by * lanes[0][i], by * lanes[1][i], by * lanes[2][i]]
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn with_rates(values: [f32; 3], rates: [f32; 3]) -> Triple<RatedSingle> {
    let number = |k: usize| RatedSingle::new(f64::from(values[k]), f64::from(rates[k]));
    [number(0), number(1), number(2)]
}

/// Returns a value and its rate.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "both are float32")]
fn rounded(number: RatedSingle) -> (f32, f32) {
    (number.value() as f32, number.rate() as f32)
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
) -> Reflected {
    let (count, x, y) = (rays.count(), rays.x, rays.y);
    let (mut value, mut rate) = (Lanes::ZERO, Lanes::ZERO);
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
            value = Lanes::all(amount);
            if RATE {
                rate = Lanes::all(amount_rate);
            }
        }
        (Falls::FromOnSmooth { .. } | Falls::AlongOnSmooth { .. }, None) | (Falls::Baked { .. }, _) => {}
    }
    (value, rate)
}
