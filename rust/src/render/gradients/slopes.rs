//! Slopes: luma of single rays in float64, and its derivatives by the point that they hit.
//!
//! Light on a diffuse surface depends only on the point. So this one derivative gives those by the camera's position,
//! its rotation, and time.
//!
//! What must not break: luma is that of [`crate::render::light::shade`] up to rounding, and shadows follow the rule of
//! all renderers.

use std::f64::consts::FRAC_1_PI;

use super::framed_lights::{FramedKind, FramedLight};
use crate::render::geometry::vector::{Vector, add, dot, largest, scale, sub};
use crate::render::geometry::view::View;
use crate::render::gloss::number::{Number, Rated, rated};
use crate::render::light::beam::Beam;
use crate::render::light::light_map::SideMap;
use crate::render::light::slide::{SeenSlide, Slide};
use crate::render::light::texture::{Texture, Wrap, parted};
use crate::render::scene::{Scene, Surface};
use crate::render::visibility::first_hit::{Ray, is_blocked};

/// A number, and its derivative by a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sloped {
    pub(crate) value: f64,
    pub(crate) slope: Vector,
}

impl Sloped {
    const fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; 3] }
    }

    fn times(&self, other: &Self) -> Self {
        let slope = add(scale(self.slope, other.value), scale(other.slope, self.value));
        Self { value: self.value * other.value, slope }
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) triangle: u32,
    /// In camera axes.
    pub(crate) seen: Vector,
    /// In the frame of the triangle.
    pub(crate) point: Vector,
    /// In the same frame.
    pub(crate) direction: Vector,
    /// Whether the camera is on the side that the plane's normal points to.
    pub(crate) in_front: bool,
}

/// What a ray sees: luma by the point that it hits, its rate where nothing moves but the lights, and the part of each
/// light in it.
#[derive(Debug, Default)]
pub(crate) struct Shaded {
    pub(crate) luma: f64,
    pub(crate) slope: Vector,
    pub(crate) rate: f64,
    pub(crate) by_light: Vec<f64>,
    /// What falls of each light on the surface, irradiance / pi under its strength.
    pub(crate) falls: Vec<f64>,
    /// Bit n mod 64 is turned over for each light n that something hides.
    pub(crate) hidden: u64,
}

/// Finds what a ray sees of the triangle that it hits.
pub(crate) fn shade(
    scene: &Scene,
    view: &View,
    lights: &[FramedLight],
    hit: &Hit,
    stack: &mut Vec<u32>,
    irradiance: &mut Shaded,
) {
    let surface = hit.surface;
    (irradiance.luma, irradiance.slope, irradiance.rate, irradiance.hidden) = (0.0, [0.0; 3], 0.0, 0);
    for parts in [&mut irradiance.by_light, &mut irradiance.falls] {
        parts.clear();
        parts.resize(lights.len(), 0.0);
    }
    if let (Some(emission), true) = (&surface.emission, hit.in_front) {
        let [factor, rate] = view.factors[emission.light as usize];
        irradiance.luma += emission.luma * factor;
        irradiance.rate += emission.luma * rate;
        irradiance.by_light[emission.light as usize] += emission.luma * factor;
    }
    let normal = Normal::of(hit);
    if !normal.in_front && !surface.two_sided {
        return;
    }
    let texture = &scene.textures[surface.texture as usize];
    let mut reflectance: Option<(usize, Sloped)> = None;
    for (number, light) in lights.iter().enumerate() {
        let [strength, strength_rate] = light.strength;
        if strength == 0.0 && strength_rate == 0.0 {
            continue;
        }
        let Some((falls, falls_rate)) = falling(scene, light, hit, &normal) else { continue };
        if is_hidden(scene, view, light, hit, stack) {
            irradiance.hidden ^= 1 << (number % 64);
            continue;
        }
        let reflected = match reflectance {
            Some((group, known)) if group == light.group => known,
            _ => looked_up(texture, &scene.texels[light.group], surface.uv().each_ref(), hit.point),
        };
        reflectance = Some((light.group, reflected));
        let seen = falls.times(&reflected);
        irradiance.luma += strength * seen.value;
        irradiance.slope = add(irradiance.slope, scale(seen.slope, strength));
        irradiance.rate += strength_rate * seen.value + strength * reflected.value * falls_rate;
        irradiance.by_light[number] += strength * seen.value;
        irradiance.falls[number] = strength * falls.value;
    }
}

/// The unit normal that light is reckoned by, on the side that is seen.
struct Normal {
    unit: Vector,
    /// How the unit normal changes with the point, row by row; None where it does not.
    slopes: Option<[Vector; 3]>,
    in_front: bool,
}

impl Normal {
    fn of(hit: &Hit) -> Self {
        let plane = &hit.surface.plane;
        let Some(maps) = &hit.surface.normal else {
            let sign = if hit.in_front { 1.0 } else { -1.0 };
            return Self { unit: [0, 1, 2].map(|i| sign * plane[i]), slopes: None, in_front: hit.in_front };
        };
        let bent = [0, 1, 2].map(|i| dot([maps[i][0], maps[i][1], maps[i][2]], hit.point) + maps[i][3]);
        let in_front = dot(bent, hit.direction) <= 0.0;
        let per_length = if in_front { 1.0 } else { -1.0 } / dot(bent, bent).sqrt();
        let unit = scale(bent, per_length);
        let rows = [0, 1, 2].map(|i| scale([maps[i][0], maps[i][1], maps[i][2]], per_length));
        let along: Vector = std::array::from_fn(|k| (0..3).map(|i| unit[i] * rows[i][k]).sum());
        let slopes = [0, 1, 2].map(|i| sub(rows[i], scale(along, unit[i])));
        Self { unit, slopes: Some(slopes), in_front }
    }

    /// Returns the component of a vector along it, and how that changes with the point while the vector stays.
    fn along(&self, vector: Vector) -> Sloped {
        let slope =
            self.slopes.map_or([0.0; 3], |rows| std::array::from_fn(|k| (0..3).map(|i| vector[i] * rows[i][k]).sum()));
        Sloped { value: dot(self.unit, vector), slope }
    }
}

/// Returns the irradiance / pi of a light of strength 1, and its rate by the light's own motion; None where it does not
/// fall.
fn falling(scene: &Scene, light: &FramedLight, hit: &Hit, normal: &Normal) -> Option<(Sloped, f64)> {
    match light.kind {
        FramedKind::Constant => Some((Sloped::constant(1.0), 0.0)),
        FramedKind::Visible => None,
        FramedKind::Baked(texels) => {
            let [front, back] = hit.surface.light_maps.as_deref()?;
            let SideMap { u, v, texture, .. } = if hit.in_front || !hit.surface.two_sided { front } else { back };
            let irradiance = looked_up(texture, &scene.irradiance[texels], [u, v], hit.point);
            // Beyond a triangle's third edge a map may fall below 0, and rounding leads there.
            (irradiance.value > 0.0).then_some((irradiance, 0.0))
        }
        FramedKind::Directional(towards, rate) => {
            let cosine = normal.along(towards);
            let slope = scale(cosine.slope, FRAC_1_PI);
            let rate = FRAC_1_PI * dot(normal.unit, rate);
            (cosine.value > 0.0).then_some((Sloped { value: FRAC_1_PI * cosine.value, slope }, rate))
        }
        FramedKind::Point(position, rate) => {
            let to = sub(position, hit.point);
            let above = normal.along(to);
            if above.value <= 0.0 {
                return None;
            }
            let squared = dot(to, to);
            let per_cube = FRAC_1_PI / (squared * squared.sqrt());
            let nearer = 3.0 * above.value / squared;
            let by_place = sub(scale(to, nearer), normal.unit);
            let value = Sloped { value: per_cube * above.value, slope: scale(add(by_place, above.slope), per_cube) };
            let (mut value, mut value_rate) = (value, -per_cube * dot(by_place, rate));
            let away = scale(to, -1.0);
            let beam = light.beam.as_ref().map(|(beam, axis_rate)| in_beam(beam, *axis_rate, away, rate));
            let slide = light.slide.as_ref().map(|seen| through_slide(&scene.slides[seen.number], seen, away, rate));
            for (fraction, fraction_rate) in beam.into_iter().chain(slide) {
                if fraction.value <= 0.0 {
                    return None;
                }
                value_rate = value_rate * fraction.value + value.value * fraction_rate;
                value = value.times(&fraction);
            }
            Some((value, value_rate))
        }
    }
}

/// Returns the fraction of a light that its beam sends to a point `away` from it, and its rate by the light's own
/// motion.
fn in_beam(beam: &Beam, axis_rate: Vector, away: Vector, position_rate: Vector) -> (Sloped, f64) {
    let (Beam::Cosine(axis) | Beam::Spot { axis, .. }) = *beam;
    let per_length = 1.0 / dot(away, away).sqrt();
    let unit = scale(away, per_length);
    let cosine = dot(axis, unit);
    let slope = scale(sub(axis, scale(unit, cosine)), per_length);
    let rate = dot(axis_rate, unit) - dot(slope, position_rate);
    let (fraction, by_cosine) = match *beam {
        Beam::Cosine(_) => (cosine.max(0.0), 1.0),
        Beam::Spot { full, cutoff, .. } => {
            let angle = cosine.clamp(-1.0, 1.0).acos();
            if angle <= full {
                (1.0, 0.0)
            } else {
                let sine = (1.0 - cosine * cosine).max(1e-24).sqrt();
                (((cutoff - angle) / (cutoff - full)).max(0.0), 1.0 / ((cutoff - full) * sine))
            }
        }
    };
    (Sloped { value: fraction, slope: scale(slope, by_cosine) }, by_cosine * rate)
}

/// Returns the factor of a light that its slide sends to a point `away` from it, and its rate by the light's own motion.
fn through_slide(slide: &Slide, seen: &SeenSlide, away: Vector, position_rate: Vector) -> (Sloped, f64) {
    let at_rest = seen.rows.numbers::<f64>().map(|row| rated(row, [0.0; 3]));
    let sent = |rows, change| slide.sent::<Rated>(seen.plane, rows, rated(away, change));
    let along = |axis: usize| sent(&at_rest, std::array::from_fn(|k| if k == axis { 1.0 } else { 0.0 })).rate();
    let rows = seen.rows.numbers();
    let moving = sent(&rows, scale(position_rate, -1.0));
    (Sloped { value: moving.value(), slope: std::array::from_fn(along) }, moving.rate())
}

/// Returns whether something lies between a point and a light, by the rule of all renderers: a shadow's ray begins a
/// step off the surface, ends a little before the light, and does not meet the surface that it begins on.
fn is_hidden(scene: &Scene, view: &View, light: &FramedLight, hit: &Hit, stack: &mut Vec<u32>) -> bool {
    let frame = hit.surface.frame as usize;
    let (own, plane) = (&view.poses[frame], &hit.surface.plane);
    let farthest = f64::from(scene.farthest);
    let (to_light, end) = match light.kind {
        FramedKind::Point(position, _) => (sub(position, hit.point), farthest / (1.0 + farthest)),
        FramedKind::Directional(towards, _) => (towards, f64::INFINITY),
        FramedKind::Constant | FramedKind::Baked(_) | FramedKind::Visible => return false,
    };
    if !scene.shadows {
        return false;
    }
    let normal = [plane[0], plane[1], plane[2]];
    let step = scene.step * (largest(view.poses[0].point(hit.seen)) + hit.seen[2]);
    let off = scale(normal, step.copysign(dot(normal, to_light)));
    let rest = if end.is_finite() { sub(to_light, off) } else { to_light };
    let [off, rest] = [off, rest].map(|vector| own.turned(vector));
    let rays: Vec<Ray> = view
        .poses
        .iter()
        .map(|pose| Ray { origin: pose.point(add(hit.seen, off)), direction: pose.vector(rest) })
        .collect();
    is_blocked(scene, (&rays, 0), end, hit.triangle, stack)
}

/// Looks up bilinearly. Returns the value, and how it changes with the point.
fn looked_up(texture: &Texture, texels: &[u64], maps: [&[f64; 4]; 2], point: Vector) -> Sloped {
    if texture.is_constant() {
        return Sloped::constant(f64::from(parted(texels[texture.first])[0]));
    }
    let Cell { first, stride, past, per_unit } = cell_of(texture, maps, point);
    let [[p, q], [r, s]] = [first, first + stride].map(|at| parted(texels[at]).map(f64::from));
    let (upper, lower) = (q - p, s - r);
    let (a, b) = (p + upper * past[0], r + lower * past[0]);
    let by_u = (upper + (lower - upper) * past[1]) * per_unit[0];
    let by_v = (b - a) * per_unit[1];
    let [u, v] = maps;
    Sloped { value: a + (b - a) * past[1], slope: std::array::from_fn(|i| by_u * u[i] + by_v * v[i]) }
}

/// Returns the texels that a lookup at a point mixes, by their numbers in the buffer, and their weights; several may be
/// the same.
pub(crate) fn taps(texture: &Texture, maps: [&[f64; 4]; 2], point: Vector) -> [(usize, f64); 4] {
    if texture.is_constant() {
        return [(texture.first, 1.0), (texture.first, 0.0), (texture.first, 0.0), (texture.first, 0.0)];
    }
    let Cell { first, stride, past: [x, y], .. } = cell_of(texture, maps, point);
    [
        (first, (1.0 - x) * (1.0 - y)),
        (first + 1, x * (1.0 - y)),
        (first + stride, (1.0 - x) * y),
        (first + stride + 1, x * y),
    ]
}

/// Four texels with a point between them.
struct Cell {
    /// The first texel, and how many there are to the one below it.
    first: usize,
    stride: usize,
    /// How far the point is past the first one, in texels, and texels per unit of u and of v.
    past: [f64; 2],
    per_unit: [f64; 2],
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the texture")]
fn cell_of(texture: &Texture, maps: [&[f64; 4]; 2], point: Vector) -> Cell {
    let (mut cell, mut past, mut per_unit) = ([0usize; 2], [0.0; 2], [0.0; 2]);
    for (k, (map, side)) in maps.into_iter().zip([texture.width, texture.height]).enumerate() {
        let coordinate = dot([map[0], map[1], map[2]], point) + map[3];
        let (inside, direction) = folded(texture.wrap, coordinate);
        let at = inside * f64::from(side) - 0.5;
        let whole = at.floor();
        cell[k] = (whole + 1.0).clamp(0.0, f64::from(side)) as usize;
        (past[k], per_unit[k]) = (at - whole, direction * f64::from(side));
    }
    let stride = texture.width as usize + 2;
    Cell { first: texture.first + cell[1] * stride + cell[0], stride, past, per_unit }
}

/// Returns where a wrap mode folds a coordinate to, and in which direction it goes on there.
fn folded(wrap: Wrap, coordinate: f64) -> (f64, f64) {
    match wrap {
        Wrap::Repeat => (coordinate - coordinate.floor(), 1.0),
        Wrap::Clamp => {
            let inside = coordinate.clamp(0.0, 1.0);
            (inside, if (0.0..=1.0).contains(&coordinate) { 1.0 } else { 0.0 })
        }
        Wrap::Mirror => {
            let period = coordinate - 2.0 * (coordinate * 0.5).floor();
            if period < 1.0 { (period, 1.0) } else { (2.0 - period, -1.0) }
        }
    }
}

/// Returns how luma changes where the ray that hits a point is shifted by a vector: the point stays on the plane, and
/// goes along the ray's direction as far as that takes.
pub(crate) fn on_plane(slope: Vector, plane: &[f64; 4], direction: Vector) -> Vector {
    let normal = [plane[0], plane[1], plane[2]];
    sub(slope, scale(normal, dot(slope, direction) / dot(normal, direction)))
}
