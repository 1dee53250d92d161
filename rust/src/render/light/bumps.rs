//! Normal textures on triangles as a camera sees them: turned normals, and what of a light they take, for many rays.
//!
//! What must not break: luma with and without rates has the same bits.

use multiversion::multiversion;

use super::affine::{Affine, coordinate};
use super::lookup::{BLACK, Positions, looked_up};
use super::normal_texture::{Bumps, components, fading, height};
use super::normals::Normals;
use super::texture::{Clamp, Fold, Mirror, Repeat, Sampler, Wrap};
use crate::render::geometry::vector::{Vector, single};
use crate::render::geometry::view::Pose;
use crate::render::gloss::number::{Number, RatedSingle, Triple, unit};
use crate::render::lanes::{Lanes, Rays};

/// Where a light comes from, in camera axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Source {
    /// The light's position, or the unit vector towards it.
    pub(super) position: [f32; 3],
    pub(super) rate: [f32; 3],
    pub(super) is_direction: bool,
}

/// The part along the surface of the irradiance vectors of a baked light.
pub(super) struct LightVectors<'a> {
    /// Of x, y and z in the triangle's frame.
    pub(super) samplers: [Sampler<'a>; 3],
    /// Texture coordinates.
    pub(super) maps: [&'a Affine; 2],
    /// The frame's axes in camera axes, each with its rate.
    pub(super) axes: &'a [[[f32; 3]; 2]; 3],
}

/// The normal texture of a triangle as a camera sees it.
#[derive(Debug)]
pub(super) struct SeenBumps<'a> {
    bumps: Bumps<'a>,
    u: Affine,
    v: Affine,
    /// In camera axes, each with its rate.
    axes: [[[f32; 3]; 2]; 2],
    /// The plane's normal on the front, with its rate.
    plane: [[f32; 3]; 2],
    /// 1 where the camera sees the plane's front, else -1.
    facing: f32,
}

impl<'a> SeenBumps<'a> {
    pub(super) fn new(bumps: Bumps<'a>, pose: &Pose, plane: [Vector; 2], facing: f32) -> Self {
        let [u, v] = bumps.uv.map(|map| coordinate(&map, pose, bumps.texture.wrap));
        let axes = bumps.axes.map(|axis| {
            let turned = pose.turned(axis);
            [single(turned), single(pose.turning(turned))]
        });
        Self { bumps, u, v, axes, plane: [single(plane[0]), single(plane[1])], facing }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl SeenBumps<'_> {
    /// Returns the normals that a flat triangle has without the texture.
    pub(super) fn flat(&self) -> Normals {
        let lanes = |which: usize| self.plane[which].map(|component| Lanes::all(self.facing * component));
        Normals { now: lanes(0), rate: lanes(1), facing: Lanes::all(self.facing) }
    }

    #[inline(always)]
    fn normals<const RATE: bool, const FULL: bool>(
        &self,
        under: &Normals,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> Normals {
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
                let axes = self.axes.map(|[axis, rate]| with_rates(axis, rate));
                let made = self.bumps.rule.turned(normal, axes, texel, seen);
                for k in 0..3 {
                    (turned.now[k][i], turned.rate[k][i]) = rounded(made[k]);
                }
            } else {
                let made = self.bumps.rule.turned(normal, self.axes.map(|[axis, _]| axis), texel, seen);
                for k in 0..3 {
                    turned.now[k][i] = made[k];
                }
            }
        }
        turned
    }

    /// Looks up the three components where rays hit, and their rates. Of a bump map they are how its height grows with u
    /// and with v, and 1.
    #[inline(always)]
    fn components<const RATE: bool, const FULL: bool, F: Fold>(
        &self,
        rays: &Rays<'_, FULL>,
        depth: &Lanes,
        depth_rate: &Lanes,
    ) -> ([Lanes; 3], [Lanes; 3]) {
        let n = rays.count();
        let sampler = Sampler::new(self.bumps.texture, self.bumps.texels);
        let positions = Positions::new::<RATE, FULL, F>([&self.u, &self.v], &sampler, rays, depth, depth_rate);
        let corners = sampler.four(&positions.taps, n);
        let (mut values, mut rates) = ([Lanes::ZERO; 3], [Lanes::ZERO; 3]);
        if self.bumps.rule.heights {
            for i in 0..n {
                let texels = [0, 1, 2, 3].map(|corner| height(corners[corner][i]));
                let slopes = positions.slopes::<RATE>(i, texels);
                for k in 0..2 {
                    (values[k][i], rates[k][i]) = slopes[k];
                }
                values[2][i] = 1.0;
            }
            return (values, rates);
        }
        for i in 0..n {
            let (p, q) = (components(corners[0][i]), components(corners[1][i]));
            let (r, s) = (components(corners[2][i]), components(corners[3][i]));
            for k in 0..3 {
                (values[k][i], rates[k][i]) = positions.mixed::<RATE>(i, [[p[k], q[k]], [r[k], s[k]]]);
            }
        }
        (values, rates)
    }

    #[inline(always)]
    fn take<const RATE: bool, const FULL: bool>(
        &self,
        from: &Source,
        (turned, under): (&Normals, &Normals),
        rays: &Rays<'_, FULL>,
        (depth, depth_rate): (&Lanes, &Lanes),
        (value, rate): (&mut Lanes, &mut Lanes),
    ) {
        let Source { position, rate: position_rate, is_direction } = *from;
        for i in 0..rays.count() {
            let point = if is_direction { [0.0; 3] } else { [rays.x[i] * depth[i], rays.y[i] * depth[i], depth[i]] };
            let way = [position[0] - point[0], position[1] - point[1], position[2] - point[2]];
            let (flat, bent) = (of_lane(&under.now, i, 1.0), of_lane(&turned.now, i, 1.0));
            let lit = flat[0] * way[0] + (flat[1] * way[1] + flat[2] * way[2]) > 0.0;
            if self.bumps.rule.fades && RATE {
                let moves = if is_direction { 0.0 } else { depth_rate[i] };
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

/// Turns the normals of a surface, on the side that is seen, by its normal texture.
///
/// A function of its own, as is [`take`]: few surfaces need it, and what luma needs of the stack would grow by it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn turned_normals<const RATE: bool, const FULL: bool>(
    bumps: &SeenBumps<'_>,
    under: &Normals,
    rays: &Rays<'_, FULL>,
    depth: &Lanes,
    depth_rate: &Lanes,
) -> Normals {
    bumps.normals::<RATE, FULL>(under, rays, depth, depth_rate)
}

/// Takes away light that comes from behind the surface, to which its texture would turn it, and fades it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn take<const RATE: bool, const FULL: bool>(
    bumps: &SeenBumps<'_>,
    from: &Source,
    normals: (&Normals, &Normals),
    rays: &Rays<'_, FULL>,
    depths: (&Lanes, &Lanes),
    light: (&mut Lanes, &mut Lanes),
) {
    bumps.take::<RATE, FULL>(from, normals, rays, depths, light);
}

/// Turns light that comes from all around, baked or constant, as a normal texture turns the surface.
///
/// Irradiance grows by the product of the turned normal with the irradiance vector along the surface, which is that of
/// `vectors` times a strength with its rate. Light that is the same from all sides falls less on what is turned away, by
/// a half of one less its cosine, because there it comes from the surface itself.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn lean<const RATE: bool, const FULL: bool>(
    vectors: Option<&(LightVectors<'_>, [f32; 2])>,
    (turned, under): (&Normals, &Normals),
    rays: &Rays<'_, FULL>,
    (depth, depth_rate): (&Lanes, &Lanes),
    (value, rate): (&mut Lanes, &mut Lanes),
) {
    let n = rays.count();
    let (mut grown, mut grown_rate) = (Lanes::ZERO, Lanes::ZERO);
    if let Some((vectors, [strength, strength_rate])) = vectors {
        for (sampler, [axis, axis_rate]) in vectors.samplers.iter().zip(vectors.axes) {
            let mut along = BLACK;
            looked_up::<RATE, FULL, Clamp>(vectors.maps, *sampler, rays, depth, depth_rate, &mut along);
            for i in 0..n {
                let normal = of_lane(&turned.now, i, 1.0);
                let cosine = dot_of(axis, &normal);
                grown[i] += strength * (along.0[i] * cosine);
                if RATE {
                    let turning = dot_of(axis_rate, &normal) + dot_of(axis, &of_lane(&turned.rate, i, 1.0));
                    grown_rate[i] +=
                        strength * (along.1[i] * cosine + along.0[i] * turning) + strength_rate * (along.0[i] * cosine);
                }
            }
        }
    }
    for i in 0..n {
        let (bent, flat) = (of_lane(&turned.now, i, 1.0), of_lane(&under.now, i, 1.0));
        let fraction = 0.5 + 0.5 * dot_of(&bent, &flat);
        let light = value[i] * fraction + grown[i];
        let lit = light > 0.0;
        if RATE {
            let (bending, flattening) = (of_lane(&turned.rate, i, 1.0), of_lane(&under.rate, i, 1.0));
            let fraction_rate = 0.5 * (dot_of(&bending, &flat) + dot_of(&bent, &flattening));
            let change = rate[i] * fraction + value[i] * fraction_rate + grown_rate[i];
            rate[i] = if lit { change } else { 0.0 };
        }
        value[i] = if lit { light } else { 0.0 };
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn dot_of(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + (a[1] * b[1] + a[2] * b[2])
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
