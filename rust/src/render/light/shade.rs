//! Shading: luma of rays whose triangle is known, and its rate of change along that triangle.
//!
//! A triangle is set up once per view in float64 ([`Shader`]). Its rays are then shaded together in float32, in vector
//! code.
//!
//! What must not break: each step is one fixed sequence of float operations, never fused, so that bits do not depend on
//! the processor. Rates are derivatives of the same steps. docs/rendering.md lists the steps.

use std::f64::consts::FRAC_1_PI;

use super::beam::SeenBeam;
use super::cast::Caster;
use super::light_map::SideMap;
use super::lights::{SeenKind, SeenLight, Surroundings};
use super::texture::{Clamp, Fold, Mirror, Repeat, Sampler, Taps, Texture, Wrap, parted};
use crate::render::geometry::linear::Linear;
use crate::render::geometry::vector::{Vector, dot, single};
use crate::render::geometry::view::Pose;
use crate::render::lanes::{Lanes, Rays};
use crate::render::scene::Scene;
use crate::render::visibility::bins::Seen;

/// A linear function of the ray, and its rate.
#[derive(Clone, Copy, Debug)]
struct Changing {
    now: Linear,
    rate: Linear,
}

/// An affine function of the point that a ray hits: its part that is linear in the ray, per unit of depth, and the
/// rest.
#[derive(Clone, Copy, Debug)]
struct Affine {
    slope: Changing,
    offset: f32,
    offset_rate: f32,
}

/// How a light falls on a triangle.
#[derive(Clone, Copy, Debug)]
enum Falls {
    /// The same everywhere on it.
    Evenly { amount: f32, rate: f32 },
    /// From a position: by the plane's distance from it.
    From { position: [f32; 3], position_rate: [f32; 3], amount: f32, rate: f32 },
    /// From a position, on a surface whose normal changes.
    FromOnSmooth { position: [f32; 3], position_rate: [f32; 3], strength: f32, rate: f32 },
    /// Along a direction, on a surface whose normal changes.
    AlongOnSmooth { towards: [f32; 3], towards_rate: [f32; 3], strength: f32, rate: f32 },
    /// As these texels of the triangle's light map have it.
    Baked { texels: usize, strength: f32, rate: f32 },
}

impl Falls {
    /// Returns the position that it falls from, and its rate.
    fn position(&self) -> Option<([f32; 3], [f32; 3])> {
        match *self {
            Self::From { position, position_rate, .. } | Self::FromOnSmooth { position, position_rate, .. } => {
                Some((position, position_rate))
            }
            _ => None,
        }
    }
}

/// A light on a triangle: its colour, its number among the view's lights.
#[derive(Clone, Copy, Debug)]
struct Lit {
    falls: Falls,
    group: usize,
    light: usize,
    beam: Option<SeenBeam>,
}

/// A triangle as a camera sees it.
#[derive(Debug)]
pub(crate) struct Shader<'a> {
    /// The triangle's number in the scene.
    pub(crate) triangle: u32,
    scene: &'a Scene,
    texture: &'a Texture,
    inverse_depth: Changing,
    u: Affine,
    v: Affine,
    smooth: Option<[Affine; 3]>,
    /// Of the side that is seen.
    light_map: Option<LightMap<'a>>,
    /// Luma that the side emits, and its rate.
    emitted: (f32, f32),
    two_sided: bool,
    lit: Vec<Lit>,
    /// Whether all of it is black.
    pub(crate) dark: bool,
}

impl<'a> Shader<'a> {
    pub(crate) fn new(of: &Surroundings<'a>, seen: &Seen) -> Self {
        let Surroundings { scene, view, lights, .. } = *of;
        let surface = &scene.surfaces[seen.triangle as usize];
        let pose = &view.poses[surface.frame as usize];
        let texture = &scene.textures[surface.texture as usize];
        let normal = pose.turned([surface.plane[0], surface.plane[1], surface.plane[2]]);
        let normal_rate = pose.turning(normal);
        let plane = Plane {
            normal,
            normal_rate,
            height: dot([surface.plane[0], surface.plane[1], surface.plane[2]], pose.position) + surface.plane[3],
            height_rate: -dot(normal, pose.drift()),
        };
        let smooth = surface.normal.as_ref().map(|maps| {
            // The map's components along the frame's axes, turned into camera axes.
            let rows = maps.map(|map| Map::new(&map, pose));
            std::array::from_fn(|i| turned_map(&rows, pose, i))
        });
        // The normal n points at the camera where n . p + d > 0 at its position p.
        let facing = if plane.height < 0.0 { -1.0 } else { 1.0 };
        let dark = smooth.is_none() && facing < 0.0 && !surface.two_sided;
        let mut shader = Self {
            triangle: seen.triangle,
            scene,
            texture,
            inverse_depth: Changing {
                now: seen.inverse_depth,
                rate: Linear(single(std::array::from_fn(|i| {
                    (plane.normal[i] * plane.height_rate / plane.height - plane.normal_rate[i]) / plane.height
                }))),
            },
            u: coordinate(&surface.u, pose, texture.wrap),
            v: coordinate(&surface.v, pose, texture.wrap),
            smooth,
            light_map: surface.light_maps.as_deref().map(|[front, back]| {
                LightMap::new(if facing > 0.0 || !surface.two_sided { front } else { back }, pose)
            }),
            emitted: (0.0, 0.0),
            two_sided: surface.two_sided,
            lit: vec![],
            dark,
        };
        if let (Some(emission), true) = (surface.emission, facing > 0.0) {
            shader.emitted = emitted(emission.luma, view.factors[emission.light as usize]);
        }
        if !dark {
            let is_smooth = shader.smooth.is_some();
            shader.lit.extend(lights.iter().enumerate().filter_map(|(number, light)| {
                let falls = if is_smooth { on_smooth(light) } else { plane.lit_by(light, facing) };
                Some(Lit { falls: falls?, group: light.group, light: number, beam: light.beam })
            }));
            shader.dark = shader.lit.is_empty() && surface.emission.is_none();
        }
        shader
    }

    /// Returns whether a light of this number falls on it.
    pub(crate) fn lit_by(&self, light: usize) -> bool {
        self.lit.iter().any(|lit| lit.light == light)
    }
}

struct Plane {
    normal: Vector,
    normal_rate: Vector,
    /// n . p + d at the camera's position p.
    height: f64,
    height_rate: f64,
}

#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
impl Plane {
    /// Returns how a light falls on the side that faces the camera; None where it does not.
    fn lit_by(&self, light: &SeenLight, facing: f64) -> Option<Falls> {
        match light.kind {
            SeenKind::Constant => {
                Some(Falls::Evenly { amount: light.strength as f32, rate: light.strength_rate as f32 })
            }
            SeenKind::Baked(texels) => baked(texels, light),
            SeenKind::Visible => None,
            SeenKind::Directional(towards, towards_rate) => {
                let cosine = facing * dot(self.normal, towards);
                let rate = facing * (dot(self.normal_rate, towards) + dot(self.normal, towards_rate));
                (cosine > 0.0).then_some(Falls::Evenly {
                    amount: (cosine * light.strength * FRAC_1_PI) as f32,
                    rate: ((rate * light.strength + cosine * light.strength_rate) * FRAC_1_PI) as f32,
                })
            }
            SeenKind::Point(position, position_rate) => {
                let above = facing * (dot(self.normal, position) + self.height);
                let rate =
                    facing * (dot(self.normal_rate, position) + dot(self.normal, position_rate) + self.height_rate);
                (above > 0.0).then(|| Falls::From {
                    position: single(position),
                    position_rate: single(position_rate),
                    amount: (above * light.strength * FRAC_1_PI) as f32,
                    rate: ((rate * light.strength + above * light.strength_rate) * FRAC_1_PI) as f32,
                })
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn on_smooth(light: &SeenLight) -> Option<Falls> {
    let (strength, rate) = ((light.strength * FRAC_1_PI) as f32, (light.strength_rate * FRAC_1_PI) as f32);
    Some(match light.kind {
        SeenKind::Constant => Falls::Evenly { amount: light.strength as f32, rate: light.strength_rate as f32 },
        SeenKind::Baked(texels) => return baked(texels, light),
        SeenKind::Visible => return None,
        SeenKind::Directional(towards, towards_rate) => {
            Falls::AlongOnSmooth { towards: single(towards), towards_rate: single(towards_rate), strength, rate }
        }
        SeenKind::Point(position, position_rate) => {
            Falls::FromOnSmooth { position: single(position), position_rate: single(position_rate), strength, rate }
        }
    })
}

/// Returns the luma that is emitted under a light's factor, and its rate.
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn emitted(luma: f64, [factor, rate]: [f64; 2]) -> (f32, f32) {
    ((luma * factor) as f32, (luma * rate) as f32)
}

#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn baked(texels: usize, light: &SeenLight) -> Option<Falls> {
    // Of the light at all instants of a motion, few count at a time.
    let counts = light.strength != 0.0 || light.strength_rate != 0.0;
    counts.then_some(Falls::Baked { texels, strength: light.strength as f32, rate: light.strength_rate as f32 })
}

/// The map of irradiance on the side of a triangle that is seen.
#[derive(Debug)]
struct LightMap<'a> {
    texture: &'a Texture,
    u: Affine,
    v: Affine,
}

impl<'a> LightMap<'a> {
    fn new(side: &'a SideMap, pose: &Pose) -> Self {
        let (u, v) = (coordinate(&side.u, pose, Wrap::Clamp), coordinate(&side.v, pose, Wrap::Clamp));
        Self { texture: &side.texture, u, v }
    }
}

/// An affine function of points in a frame, in camera axes and float64.
struct Map {
    slope: Vector,
    slope_rate: Vector,
    offset: f64,
    offset_rate: f64,
}

impl Map {
    fn new(map: &[f64; 4], pose: &Pose) -> Self {
        let slope = [map[0], map[1], map[2]];
        let turned = pose.turned(slope);
        Self {
            slope: turned,
            slope_rate: pose.turning(turned),
            offset: dot(slope, pose.position) + map[3],
            offset_rate: dot(slope, pose.velocity),
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn single(&self) -> Affine {
        Affine {
            slope: Changing { now: Linear(single(self.slope)), rate: Linear(single(self.slope_rate)) },
            offset: self.offset as f32,
            offset_rate: self.offset_rate as f32,
        }
    }
}

/// Returns a texture coordinate. Whole periods are taken from it, so that float32 is fine enough wherever the texture
/// lies.
fn coordinate(map: &[f64; 4], pose: &Pose, wrap: Wrap) -> Affine {
    let mut map = Map::new(map, pose);
    match wrap {
        Wrap::Repeat => map.offset -= map.offset.floor(),
        Wrap::Mirror => map.offset -= 2.0 * (map.offset / 2.0).floor(),
        Wrap::Clamp => {}
    }
    map.single()
}

/// Returns component `i` in camera axes of a vector whose components in the frame's axes are affine functions.
fn turned_map(rows: &[Map; 3], pose: &Pose, i: usize) -> Affine {
    let mut sum = Map { slope: [0.0; 3], slope_rate: [0.0; 3], offset: 0.0, offset_rate: 0.0 };
    for (k, row) in rows.iter().enumerate() {
        let mut axis = [0.0; 3];
        axis[k] = 1.0;
        let turned = pose.turned(axis);
        let (weight, weight_rate) = (turned[i], pose.turning(turned)[i]);
        for j in 0..3 {
            sum.slope[j] += weight * row.slope[j];
            sum.slope_rate[j] += weight * row.slope_rate[j] + weight_rate * row.slope[j];
        }
        sum.offset += weight * row.offset;
        sum.offset_rate += weight * row.offset_rate + weight_rate * row.offset;
    }
    sum.single()
}

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
        let mut at = 0;
        while at < self.lit.len() {
            let group = self.lit[at].group;
            let (mut light, mut light_rate) = (Lanes::ZERO, Lanes::ZERO);
            while at < self.lit.len() && self.lit[at].group == group {
                let lit = &self.lit[at];
                let (mut one, mut one_rate) = match (lit.falls, &self.light_map) {
                    (Falls::Baked { texels, strength, rate }, Some(map)) => {
                        self.baked::<RATE, FULL>(map, texels, (strength, rate), rays, &depth, &depth_rate)
                    }
                    (falls, _) => falling::<RATE, FULL>(&falls, rays, &depth, &depth_rate, normal.as_ref()),
                };
                if let (Some(beam), Some(position)) = (&lit.beam, lit.falls.position()) {
                    beam.take::<RATE, FULL>(position, rays, (&depth, &depth_rate), (&mut one, &mut one_rate));
                }
                if caster.hides(lit.light) {
                    caster.take((receiver, lit.light), rays, &depth, (&mut one, &mut one_rate));
                }
                for i in 0..n {
                    light[i] += one[i];
                    if RATE {
                        light_rate[i] += one_rate[i];
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

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Affine {
    #[inline(always)]
    fn at<const RATE: bool>(&self, x: f32, y: f32, depth: f32, depth_rate: f32) -> (f32, f32) {
        let slope = self.slope.now.at(x, y);
        let value = depth * slope + self.offset;
        if !RATE {
            return (value, 0.0);
        }
        (value, depth_rate * slope + (depth * self.slope.rate.at(x, y) + self.offset_rate))
    }
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
