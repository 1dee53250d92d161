//! What shines on surfaces: lamps with a surface, the sky, and lights at a point or from one direction.
//!
//! What must not break: a sample's light divided by its density has the light itself as its mean.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use super::lattice::BELOW_ONE;
use super::surfaces::{Colour, colour, padded};
use crate::error::{Error, Result};
use crate::render::geometry::vector::{Vector, add, cross, dot, largest, single, sub};
use crate::render::light::beam::{Beam, acos};
use crate::render::light::slide::Slide;
use crate::render::visibility::ray_tracer::RayTracer;

/// How far two triangles may be from the halves of a parallelogram, as a fraction of its size.
const PARALLEL: f64 = 1e-5;

/// What lies in this last fraction of the way to a point on a light throws no shadow.
const END: f32 = 2e-4;

/// A lamp with a surface, which shines from some triangles.
#[derive(Clone, Copy, Debug)]
pub struct AreaLamp {
    /// Its first triangle.
    pub first: usize,
    /// How many triangles it has.
    pub count: usize,
    /// Red, green and blue.
    pub radiance: [f64; 3],
    /// Whether it shines from its back too.
    pub two_sided: bool,
}

/// A light that is not baked where it shines directly, because its shadows are sharp.
#[derive(Clone, Debug)]
pub enum SharpLight {
    /// At a position, metres.
    Point {
        /// Where it is.
        position: [f64; 3],
        /// Red, green and blue.
        intensity: [f64; 3],
        /// To which sides it shines; None where to all alike.
        beam: Option<Beam>,
        /// What it throws; None where that is its own colour alone.
        slide: Option<Arc<Slide>>,
    },
    /// From one direction.
    Directional {
        /// The unit vector along which it travels.
        along: [f64; 3],
        /// Red, green and blue, on a surface that faces it.
        irradiance: [f64; 3],
    },
    /// A small lamp with a surface.
    Lamp(AreaLamp),
}

/// Light from all around.
#[derive(Clone, Debug)]
pub enum SkyLight {
    /// The same radiance from all sides.
    Constant([f64; 3]),
    /// As a map has it.
    Map(EnvironmentMap),
}

/// An environment map: the middles of its columns lie around the y axis, its first and last row at the poles.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// Texels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Radiance, row by row.
    pub texels: Vec<[f32; 3]>,
    /// Takes a direction of the world to the map's axes.
    pub to_map: [[f64; 3]; 3],
}

/// Lights that are baked together.
#[derive(Clone, Debug, Default)]
pub struct GroupLight {
    /// Lamps that are baked.
    pub lamps: Vec<AreaLamp>,
    /// The sky; None where it is not of this group.
    pub sky: Option<SkyLight>,
    /// Lights of which only what bounces is baked.
    pub sharp: Vec<SharpLight>,
}

/// Light that comes to a point if nothing is in its way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arriving {
    /// From where, of any length.
    pub(crate) towards: [f32; 3],
    /// How far the way goes, in units of `towards`; 0 where no light comes.
    pub(crate) end: f32,
    /// Irradiance / pi, divided by the density of samples.
    pub(crate) light: Colour,
}

impl Arriving {
    pub(crate) const NONE: Self = Self { towards: [1.0, 0.0, 0.0], end: 0.0, light: [0.0; 4] };
}

/// A lamp, ready to be sampled, in the coordinates of the rays.
#[derive(Debug)]
pub(crate) struct Lamp {
    radiance: Colour,
    two_sided: bool,
    area: f32,
    shape: LampShape,
}

#[derive(Debug)]
enum LampShape {
    /// A corner, two edges, and the unit normal.
    Parallelogram([[f32; 3]; 2], [f32; 3], [f32; 3]),
    /// Corners and unit normal of each triangle, and the fraction of the area up to and with it.
    Triangles(Vec<LampTriangle>),
}

#[derive(Debug)]
struct LampTriangle {
    corner: [f32; 3],
    edges: [[f32; 3]; 2],
    normal: [f32; 3],
    up_to: f32,
}

fn dots(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Lamp {
    fn new(lamp: &AreaLamp, corners: &[[Vector; 3]], normals: &[Vector], tracer: &RayTracer) -> Result<Self> {
        let range = lamp.first..lamp.first.saturating_add(lamp.count);
        let (Some(corners), Some(normals)) = (corners.get(range.clone()), normals.get(range)) else {
            return Err(Error::Argument(format!(
                "a lamp of {} triangles from number {} on is not among the {} of the scene",
                lamp.count,
                lamp.first,
                corners.len()
            )));
        };
        let areas: Vec<f64> = corners
            .iter()
            .map(|&[a, b, c]| {
                let normal = cross(sub(b, a), sub(c, a));
                0.5 * dot(normal, normal).sqrt() * tracer.scale * tracer.scale
            })
            .map(|area| if area.is_finite() { area } else { 0.0 })
            .collect();
        let area: f64 = areas.iter().sum();
        let edge = |from: Vector, to: Vector| single(sub(to, from).map(|x| x * tracer.scale));
        let shape = if let Some([corner, first, second]) = parallelogram(corners, normals) {
            LampShape::Parallelogram(
                [edge([0.0; 3], first), edge([0.0; 3], second)],
                tracer.scaled(corner),
                single(normals[0]),
            )
        } else {
            let mut sum = 0.0;
            let triangles = corners.iter().zip(normals).zip(&areas).filter(|(_, area)| **area > 0.0);
            LampShape::Triangles(
                triangles
                    .map(|((&[a, b, c], &normal), own)| {
                        sum += own;
                        LampTriangle {
                            corner: tracer.scaled(a),
                            edges: [edge(a, b), edge(a, c)],
                            normal: single(normal),
                            up_to: single([sum / area])[0],
                        }
                    })
                    .collect(),
            )
        };
        Ok(Self { radiance: colour(lamp.radiance), two_sided: lamp.two_sided, area: single([area])[0], shape })
    }

    /// Returns a point on the lamp, evenly over its area, and the normal there; None where it has no area.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn point(&self, [x, y]: [f32; 2]) -> Option<([f32; 3], [f32; 3])> {
        match &self.shape {
            LampShape::Parallelogram([first, second], corner, normal) => {
                Some(([0, 1, 2].map(|i| corner[i] + x * first[i] + y * second[i]), *normal))
            }
            LampShape::Triangles(triangles) => {
                let at = triangles.partition_point(|triangle| triangle.up_to <= y).min(triangles.len().max(1) - 1);
                let triangle = triangles.get(at)?;
                let before = if at == 0 { 0.0 } else { triangles[at - 1].up_to };
                let fraction = triangle.up_to - before;
                let along = if fraction > 0.0 { ((y - before) / fraction).clamp(0.0, 1.0) } else { 0.5 };
                let far = x.sqrt();
                let (second, third) = (far * (1.0 - along), far * along);
                let [b, c] = &triangle.edges;
                Some(([0, 1, 2].map(|i| triangle.corner[i] + second * b[i] + third * c[i]), triangle.normal))
            }
        }
    }

    /// Returns the light of a point of the lamp at a point with a normal; its way begins at `origin`.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn arriving(&self, receiver: &[f32; 3], normal: &[f32; 3], origin: &[f32; 3], at: [f32; 2]) -> Arriving {
        let Some((point, facing)) = self.point(at) else { return Arriving::NONE };
        let away = [0, 1, 2].map(|i| point[i] - receiver[i]);
        let (own, along) = (dots(*normal, away), dots(facing, away));
        let its = if self.two_sided { along.abs() } else { -along };
        let squared = dots(away, away);
        let lit = own > 0.0 && its > 0.0 && squared > 0.0;
        let weight = if lit { own * its * self.area / (squared * squared * PI) } else { 0.0 };
        Arriving {
            towards: [0, 1, 2].map(|i| point[i] - origin[i]),
            end: if lit { 1.0 - END } else { 0.0 },
            light: self.radiance.map(|radiance| radiance * weight),
        }
    }
}

/// Returns a corner and the two edges from it where two triangles are the halves of a parallelogram.
fn parallelogram(corners: &[[Vector; 3]], normals: &[Vector]) -> Option<[Vector; 3]> {
    let ([triangle, other], [normal, same]) = (corners, normals) else { return None };
    let size = largest(sub(triangle[1], triangle[0])).max(largest(sub(triangle[2], triangle[0])));
    let close = |a: Vector, b: Vector| largest(sub(a, b)) <= PARALLEL * size;
    for at in 0..3 {
        let (corner, second, third) = (triangle[at], triangle[(at + 1) % 3], triangle[(at + 2) % 3]);
        let opposite = sub(add(second, third), corner);
        let has = |point: Vector| other.iter().any(|&corner| close(corner, point));
        if has(second) && has(third) && has(opposite) && largest(sub(*normal, *same)) <= PARALLEL {
            return Some([corner, sub(second, corner), sub(third, corner)]);
        }
    }
    None
}

/// A sky, ready to be sampled.
#[derive(Debug)]
pub(crate) enum Sky {
    Constant(Colour),
    Map(SkyMap),
}

/// An environment map and how likely its cells are: those between four texels each.
#[derive(Debug)]
pub(crate) struct SkyMap {
    width: usize,
    height: usize,
    texels: Vec<Colour>,
    to_map: [[f32; 3]; 3],
    /// The cosine of the angle to the pole at each row.
    cosines: Vec<f32>,
    /// The fraction of the light up to and with each row of cells.
    rows: Vec<f32>,
    /// Of each row of cells the fraction up to and with each cell.
    columns: Vec<f32>,
    /// The density of each cell, per steradian.
    densities: Vec<f32>,
}

#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss, reason = "in range")]
impl SkyMap {
    fn new(map: &EnvironmentMap) -> Result<Self> {
        let (width, height) = (map.width, map.height);
        let finite = map.texels.iter().flatten().all(|texel| texel.is_finite() && *texel >= 0.0);
        if width < 1 || height < 2 || width.checked_mul(height) != Some(map.texels.len()) || !finite {
            return Err(Error::Argument(format!(
                "an environment map has two rows or more of finite radiance that is not negative, got {width} x \
                 {height} and {} texels",
                map.texels.len()
            )));
        }
        let cosines: Vec<f64> =
            (0..height).map(|row| libm::cos(std::f64::consts::PI * row as f64 / (height - 1) as f64)).collect();
        let brightness = |row: usize, column: usize| {
            map.texels[row * width + column % width].iter().map(|&channel| f64::from(channel)).sum::<f64>()
        };
        let around = std::f64::consts::TAU / width as f64;
        let (mut rows, mut columns, mut densities) = (vec![], vec![], vec![]);
        let mut total = 0.0;
        for row in 0..height - 1 {
            let solid = around * (cosines[row] - cosines[row + 1]);
            let mut sum = 0.0;
            for column in 0..width {
                let mean = brightness(row, column)
                    + brightness(row, column + 1)
                    + brightness(row + 1, column)
                    + brightness(row + 1, column + 1);
                sum += mean * solid;
                columns.push(sum);
                densities.push(mean);
            }
            for column in &mut columns[row * width..] {
                *column = if sum > 0.0 { *column / sum } else { 0.0 };
            }
            total += sum;
            rows.push(total);
        }
        let fraction = |x: f64| if total > 0.0 { (x / total) as f32 } else { 0.0 };
        Ok(Self {
            width,
            height,
            texels: map.texels.iter().map(|&texel| padded(texel)).collect(),
            to_map: map.to_map.map(single),
            cosines: cosines.iter().map(|&x| x as f32).collect(),
            rows: rows.into_iter().map(fraction).collect(),
            columns: columns.iter().map(|&x| x as f32).collect(),
            densities: densities.into_iter().map(fraction).collect(),
        })
    }

    /// Returns the cell that a direction lies in (its row and column, and how far it is past them), and its density.
    fn cell(&self, towards: [f32; 3]) -> ([usize; 2], [f32; 2]) {
        let [x, y, z] = self.to_map.map(|row| dots(row, towards));
        let turn = libm::atan2f(x, -z) / TAU;
        let turn = turn - turn.floor();
        let down = acos(y / dots(towards, towards).sqrt()) / PI;
        let along = turn * self.width as f32 - 0.5;
        let along = if along < 0.0 { along + self.width as f32 } else { along };
        let below = down * (self.height - 1) as f32;
        let column = (along as usize).min(self.width - 1);
        let row = (below as usize).min(self.height - 2);
        ([row, column], [below - row as f32, along - column as f32])
    }

    /// Returns the radiance from a direction, and the density of samples there, per steradian.
    pub(crate) fn seen(&self, towards: [f32; 3]) -> (Colour, f32) {
        let ([row, column], [y, x]) = self.cell(towards);
        let texel = |row: usize, column: usize| &self.texels[row * self.width + column % self.width];
        let [a, b] = [texel(row, column), texel(row, column + 1)];
        let [c, d] = [texel(row + 1, column), texel(row + 1, column + 1)];
        let mut radiance = [0.0; 4];
        for i in 0..4 {
            let (upper, lower) = (a[i] + (b[i] - a[i]) * x, c[i] + (d[i] - c[i]) * x);
            radiance[i] = upper + (lower - upper) * y;
        }
        (radiance, self.densities[row * self.width + column])
    }

    /// Returns a direction that follows the radiance.
    pub(crate) fn towards(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let within = |fractions: &[f32], at: f32| {
            let cell = fractions.partition_point(|&up_to| up_to <= at).min(fractions.len() - 1);
            let before = if cell == 0 { 0.0 } else { fractions[cell - 1] };
            let fraction = fractions[cell] - before;
            (cell, if fraction > 0.0 { ((at - before) / fraction).clamp(0.0, BELOW_ONE) } else { 0.5 })
        };
        let (row, down) = within(&self.rows, y);
        let (column, across) = within(&self.columns[row * self.width..(row + 1) * self.width], x);
        let cosine = self.cosines[row] + down * (self.cosines[row + 1] - self.cosines[row]);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let turn = TAU * (column as f32 + across + 0.5) / self.width as f32;
        let own = [sine * libm::sinf(turn), cosine, -sine * libm::cosf(turn)];
        // The inverse of a rotation is its transpose.
        [0, 1, 2].map(|i| (0..3).map(|k| self.to_map[k][i] * own[k]).sum())
    }
}

/// A sharp light, in the coordinates of the rays.
#[derive(Debug)]
pub(crate) enum Sharp {
    Point { position: [f32; 3], intensity: Colour, beam: Option<Beam>, slide: Option<Arc<Slide>> },
    Directional { towards: [f32; 3], irradiance: Colour },
    Lamp(Lamp),
}

impl Sharp {
    /// Returns the light at a point with a normal, by a point of it; its way begins at `origin`.
    pub(crate) fn arriving(&self, receiver: &[f32; 3], normal: &[f32; 3], origin: &[f32; 3], at: [f32; 2]) -> Arriving {
        match self {
            Self::Lamp(lamp) => lamp.arriving(receiver, normal, origin, at),
            Self::Directional { towards, irradiance } => {
                let cosine = dots(*normal, *towards);
                let weight = if cosine > 0.0 { cosine / PI } else { 0.0 };
                let end = if cosine > 0.0 { f32::INFINITY } else { 0.0 };
                Arriving { towards: *towards, end, light: irradiance.map(|x| x * weight) }
            }
            Self::Point { position, intensity, beam, slide } => {
                let away = [0, 1, 2].map(|i| position[i] - receiver[i]);
                let squared = dots(away, away);
                let distance = squared.sqrt();
                let cosine = dots(*normal, away) / distance;
                if !(cosine > 0.0 && squared > 0.0) {
                    return Arriving::NONE;
                }
                let weight = cosine / (squared * PI) * beam.map_or(1.0, |beam| factor(&beam, away, distance));
                let towards = [0, 1, 2].map(|i| position[i] - origin[i]);
                let end = if weight > 0.0 { 1.0 - END } else { 0.0 };
                let mut light = intensity.map(|x| x * weight);
                if let Some(slide) = slide {
                    let sent = sent_by(slide, away.map(|x| -x));
                    light = std::array::from_fn(|i| light[i] * sent[i]);
                }
                Arriving { towards, end: if light == [0.0; 4] { 0.0 } else { end }, light }
            }
        }
    }
}

/// Returns what part of its light a beam sends to a point, from which the light lies in the direction `away`.
fn factor(beam: &Beam, away: [f32; 3], distance: f32) -> f32 {
    let cosine = |axis: Vector| -dots(single(axis), away) / distance;
    match *beam {
        Beam::Cosine(axis) => cosine(axis).max(0.0),
        Beam::Spot { axis, full, cutoff } => {
            let [full, cutoff] = single([full, cutoff]);
            ((cutoff - acos(cosine(axis))) / (cutoff - full)).clamp(0.0, 1.0)
        }
    }
}

/// Returns what factor of its light a slide sends to a point `away` from the light.
fn sent_by(slide: &Slide, away: [f32; 3]) -> Colour {
    let (rows, last) = (slide.rows_at_rest().numbers(), slide.planes() - 1);
    padded([0, 1, 2].map(|plane: usize| slide.sent(plane.min(last), &rows, away)))
}

/// Lights of a group, ready to be sampled.
#[derive(Debug)]
pub(crate) struct Lights {
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) sky: Option<Sky>,
    pub(crate) sharp: Vec<Sharp>,
}

impl Lights {
    /// Checks lights that shine among triangles with these corners and normals.
    pub(crate) fn new(
        lights: &GroupLight,
        corners: &[[Vector; 3]],
        normals: &[Vector],
        tracer: &RayTracer,
    ) -> Result<Self> {
        let lamp = |lamp: &AreaLamp| {
            check_colour("radiance", lamp.radiance)?;
            Lamp::new(lamp, corners, normals, tracer)
        };
        let squared = tracer.scale * tracer.scale;
        let sharp = |light: &SharpLight| {
            Ok(match light {
                SharpLight::Lamp(small) => Sharp::Lamp(lamp(small)?),
                SharpLight::Directional { along, irradiance } => {
                    check_colour("irradiance", *irradiance)?;
                    Sharp::Directional { towards: single(along.map(|x| -x)), irradiance: colour(*irradiance) }
                }
                SharpLight::Point { position, intensity, beam, slide } => {
                    check_colour("intensity", *intensity)?;
                    if !position.iter().all(|x| x.is_finite()) || !beam.is_none_or(|beam| beam.is_valid()) {
                        return Err(Error::Argument("a light has a finite position and a valid beam".to_owned()));
                    }
                    Sharp::Point {
                        position: tracer.scaled(*position),
                        intensity: colour(intensity.map(|x| x * squared)),
                        beam: *beam,
                        slide: slide.clone(),
                    }
                }
            })
        };
        Ok(Self {
            lamps: lights.lamps.iter().map(lamp).collect::<Result<_>>()?,
            sky: match &lights.sky {
                None => None,
                Some(SkyLight::Constant(radiance)) => {
                    check_colour("radiance", *radiance)?;
                    Some(Sky::Constant(colour(*radiance)))
                }
                Some(SkyLight::Map(map)) => Some(Sky::Map(SkyMap::new(map)?)),
            },
            sharp: lights.sharp.iter().map(sharp).collect::<Result<_>>()?,
        })
    }
}

fn check_colour(what: &str, rgb: [f64; 3]) -> Result<()> {
    if rgb.iter().all(|x| x.is_finite() && *x >= 0.0) {
        return Ok(());
    }
    Err(Error::Argument(format!("the {what} of a light is finite and not negative, got {rgb:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the middles of the last and the first column light goes from one to the other, and samples that follow
    /// the light have the density that is told of them.
    #[test]
    fn a_map_goes_around() {
        let to_map = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let texels = (0u8..12).map(|i| [f32::from([1u8, 0, 0, 3][usize::from(i % 4)]); 3]).collect();
        let map = SkyMap::new(&EnvironmentMap { width: 4, height: 3, texels, to_map }).unwrap();
        for (turn, expected) in [(0.0, 2.0), (0.0625, 1.5), (0.9375, 2.5), (0.125, 1.0), (0.25, 0.5), (0.5, 0.0)] {
            let angle = TAU * turn;
            let (radiance, density) = map.seen([libm::sinf(angle), 0.0, -libm::cosf(angle)]);
            assert!((radiance[0] - expected).abs() < 1e-5, "{turn}: {radiance:?}");
            assert_eq!(density > 0.0, turn != 0.5);
        }
        for at in [[0.01, 0.2], [0.3, 0.8], [0.6, 0.5], [0.99, 0.4]] {
            let (radiance, density) = map.seen(map.towards(at));
            assert!(radiance[0] > 0.0 && density > 0.0, "{at:?}");
        }
        // The whole sphere: the mean of 1 / density over samples is its solid angle, but for the dark cell.
        let mean = (0u16..10_000)
            .map(|i| [(f32::from(i) + 0.5) / 10_000.0, (f32::from(i) * 0.618_034).fract()])
            .map(|at| f64::from(map.seen(map.towards(at)).1))
            .map(|density| if density > 0.0 { 1.0 / density } else { 0.0 }) // rounded into the dark cell
            .sum::<f64>()
            / 10_000.0;
        assert!((mean / (3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{mean}");
    }
}
