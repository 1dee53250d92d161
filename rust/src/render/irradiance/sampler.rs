//! Samples light at points of surfaces: direct light of lamps and the sky, and light that surfaces reflect.
//!
//! Points are shared among threads. The rays of a point share their origin, so they are traced together.
//!
//! What must not break: the samples of a point are added up in the order of the [`Lattice`].

use multiversion::multiversion;
use rayon::prelude::*;

use super::emitters::{Arriving, GroupLight, Lights, Sky};
use super::lattice::{BELOW_ONE, Lattice, across, cosine_direction, in_frame};
use super::surfaces::{Colour, ReflectedLight, SurfaceTables, Surfaces};
use crate::error::{Error, Result};
use crate::random::{Draw, Purpose};
use crate::render::geometry::vector::{Vector, dot, single};
use crate::render::gloss::number::unit;
use crate::render::visibility::ray_tracer::{Fan, NOTHING, RayTracer};
use crate::threads::SHARED;

/// Scenes of so many triangles are made ready on all threads.
const MANY: usize = 1 << 13;

/// A ray from a surface starts off it by this fraction of the scene's diagonal: a thousand roundings.
const STEP: f32 = 1000.0 / 16_777_216.0;

/// Steps of the sequence by which lights are sampled where the lattice's directions end (Roberts, "The unreasonable
/// effectiveness of quasirandom sequences", 2018).
const R2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

/// Paths that may end at random go on with this probability at most.
const MOST_LIKELY_ON: f32 = 0.95;

/// Where light is asked for.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Metres.
    pub position: [f64; 3],
    /// The unit normal.
    pub normal: [f64; 3],
    /// By how much the lattice is shifted, 0..1.
    pub shift: [f64; 2],
}

/// How long paths are.
#[derive(Clone, Copy, Debug)]
pub struct PathRule {
    /// How often light bounces at most.
    pub bounces: u32,
    /// After so many bounces a path may end at random.
    pub roulette: u32,
}

/// A scene whose light can be asked for anywhere.
#[derive(Debug)]
pub struct IrradianceSampler {
    tracer: RayTracer,
    surfaces: Surfaces,
    groups: Vec<Lights>,
}

/// Room for what is computed at a point.
#[derive(Debug, Default)]
struct Scratch {
    fan: Fan,
    shadow: Fan,
    light: Vec<Colour>,
    /// Of single rays along a path.
    path: Fan,
}

/// A point that rays begin at: where it is, its normal with two vectors across it, and where its rays begin.
#[derive(Clone, Copy, Debug)]
struct Start {
    position: [f32; 3],
    normal: [f32; 3],
    across: [[f32; 3]; 2],
    origin: [f32; 3],
}

impl Start {
    fn new(position: [f32; 3], normal: [f32; 3], off: [f32; 3], step: f32) -> Self {
        Self { position, normal, across: across(normal), origin: [0, 1, 2].map(|i| position[i] + step * off[i]) }
    }
}

/// What is added up of the light that arrives at a point.
trait Sum: Default {
    /// What a point has in the end.
    type Light: Send;

    /// Adds light that arrives from a direction.
    fn add(&mut self, start: &Start, towards: [f32; 3], light: Colour);

    /// Returns the mean of so many samples.
    fn mean(&self, samples: usize) -> Self::Light;
}

/// Irradiance / pi.
#[derive(Default)]
struct Irradiance([f64; 3]);

impl Sum for Irradiance {
    type Light = [f64; 3];

    #[inline]
    fn add(&mut self, _: &Start, _: [f32; 3], light: Colour) {
        add_up(&mut self.0, [0, 1, 2].map(|i| f64::from(light[i])));
    }

    fn mean(&self, samples: usize) -> [f64; 3] {
        self.0.map(|x| x / float(samples))
    }
}

/// The part along the surface of the irradiance vector / pi (Arvo, "The irradiance Jacobian for partially occluded
/// polyhedral sources", 1994): how irradiance grows when the surface is turned. x, y and z, each in red, green and blue.
#[derive(Default)]
struct AlongSurface([[f64; 3]; 3]);

impl Sum for AlongSurface {
    type Light = [[f64; 3]; 3];

    fn add(&mut self, start: &Start, towards: [f32; 3], light: Colour) {
        // The way to a lamp is not of unit length.
        let (towards, normal) = (unit(towards.map(f64::from)), start.normal.map(f64::from));
        let cosine = dot(towards, normal);
        let per_cosine = 1.0 / cosine.max(LEAST_COSINE);
        for axis in 0..3 {
            let along = (towards[axis] - cosine * normal[axis]) * per_cosine;
            add_up(&mut self.0[axis], [0, 1, 2].map(|i| along * f64::from(light[i])));
        }
    }

    fn mean(&self, samples: usize) -> [[f64; 3]; 3] {
        self.0.map(|axis| axis.map(|x| x / float(samples)))
    }
}

/// Light that comes from lower counts as if it came from here, where irradiance vectors are added up. Else single samples
/// would decide them.
const LEAST_COSINE: f64 = 0.02;

/// Draws of one path: a function of its seed, its number, and how many were drawn before.
struct Draws {
    seed: u64,
    path: u32,
    next: u64,
}

impl Draws {
    /// Returns a point in the unit square.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn point(&mut self) -> [f32; 2] {
        let draw = Draw::at(self.seed, Purpose::LightPath, self.path, self.next);
        self.next += 1;
        [draw.uniform(), draw.second_uniform()].map(|x| (x as f32).min(BELOW_ONE))
    }
}

impl IrradianceSampler {
    /// Checks the tables, and makes them ready for rays.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for tables that do not belong together, or lights that are none.
    pub fn new(tables: &SurfaceTables, groups: &[GroupLight]) -> Result<Self> {
        let surfaces = Surfaces::new(tables)?;
        let tracer = if surfaces.len() < MANY {
            RayTracer::new(&tables.corners, false)
        } else {
            SHARED.pool()?.install(|| RayTracer::new(&tables.corners, true))
        };
        let lights = |group| Lights::new(group, &tables.corners, &tables.normals, &tracer);
        Ok(Self { groups: groups.iter().map(lights).collect::<Result<_>>()?, surfaces, tracer })
    }

    /// Returns irradiance / pi (red, green, blue) at each point from so many points on each lamp of a group.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a group that is not there, or no samples.
    pub fn of_lamps(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<[f64; 3]>> {
        self.lamps::<Irradiance>(group, points, samples)
    }

    /// Returns the part along the surface of the irradiance vector / pi of the light of [`IrradianceSampler::of_lamps`].
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn along_of_lamps(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<[[f64; 3]; 3]>> {
        self.lamps::<AlongSurface>(group, points, samples)
    }

    fn lamps<S: Sum>(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<S::Light>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        self.summed::<S, _>(&lattice, points, &lights.lamps, |lamp, start, at| {
            lamp.arriving(&start.position, &start.normal, &start.origin, at)
        })
    }

    /// Returns irradiance / pi at each point from the group's sky, by so many directions that follow the cosine, and as
    /// many that follow the sky's radiance if it is a map. Both are weighted by the balance heuristic (Veach and Guibas,
    /// "Optimally combining sampling techniques for Monte Carlo rendering", 1995).
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn of_sky(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<[f64; 3]>> {
        self.sky::<Irradiance>(group, points, samples)
    }

    /// Returns the part along the surface of the irradiance vector / pi of the light of [`IrradianceSampler::of_sky`].
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn along_of_sky(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<[[f64; 3]; 3]>> {
        self.sky::<AlongSurface>(group, points, samples)
    }

    fn sky<S: Sum>(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<S::Light>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        each(points, |point, scratch| {
            let (start, shift) = (self.start(point), shift_of(point));
            let mut sum = S::default();
            if let Some(sky) = &lights.sky {
                let arriving = |at| along_cosine(sky, &start, at);
                direct(&self.tracer, &start, &lattice, shift, scratch, arriving, &mut sum);
                if matches!(sky, Sky::Map(_)) {
                    let arriving = |at| along_radiance(sky, &start, at);
                    direct(&self.tracer, &start, &lattice, shift, scratch, arriving, &mut sum);
                }
            }
            sum.mean(samples)
        })
    }

    /// Returns irradiance / pi at each point from the group's sharp lights.
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn of_sharp(&self, group: usize, points: &[SurfacePoint], samples: usize) -> Result<Vec<[f64; 3]>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        self.summed::<Irradiance, _>(&lattice, points, &lights.sharp, |light, start, at| {
            light.arriving(&start.position, &start.normal, &start.origin, at)
        })
    }

    /// Returns irradiance / pi at each point of light that other surfaces reflect, by so many rays: of all that
    /// `reflected` says falls on them, and of the group's sharp lights.
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`], and for reflected light of another number of triangles.
    pub fn gathered(
        &self,
        group: usize,
        points: &[SurfacePoint],
        samples: usize,
        reflected: Option<&ReflectedLight>,
    ) -> Result<Vec<[f64; 3]>> {
        self.reflected::<Irradiance>(group, points, samples, reflected)
    }

    /// Returns the part along the surface of the irradiance vector / pi of the light of [`IrradianceSampler::gathered`].
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::gathered`].
    pub fn along_gathered(
        &self,
        group: usize,
        points: &[SurfacePoint],
        samples: usize,
        reflected: Option<&ReflectedLight>,
    ) -> Result<Vec<[[f64; 3]; 3]>> {
        self.reflected::<AlongSurface>(group, points, samples, reflected)
    }

    fn reflected<S: Sum>(
        &self,
        group: usize,
        points: &[SurfacePoint],
        samples: usize,
        reflected: Option<&ReflectedLight>,
    ) -> Result<Vec<S::Light>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        if let Some(light) = reflected.filter(|light| light.len() != self.surfaces.len()) {
            let (triangles, got) = (self.surfaces.len(), light.len());
            return Err(Error::Argument(format!("reflected light is that of {triangles} triangles, got {got}")));
        }
        each(points, |point, scratch| {
            let start = self.start(point);
            let shift = shift_of(point);
            let mut sum = S::default();
            gather(self, lights, &start, &lattice, shift, reflected, scratch, &mut sum);
            sum.mean(samples)
        })
    }

    /// Returns the quantity of [`IrradianceSampler::gathered`] by so many paths. All lights of the group count.
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn traced(
        &self,
        group: usize,
        points: &[SurfacePoint],
        samples: usize,
        seed: u64,
        rule: PathRule,
    ) -> Result<Vec<[f64; 3]>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        each(points, |point, scratch| {
            let start = self.start(point);
            let mut sum = [0.0; 3];
            for at in 0..lattice.len() {
                let first = cosine_direction(lattice.shifted(at, shift_of(point)));
                let mut draws = draws(seed, point, lattice.numbers[at]);
                trace(self, lights, &start, first, rule, &mut draws, scratch, |light| {
                    add_up(&mut sum, [0, 1, 2].map(|i| f64::from(light[i])));
                    true
                });
            }
            sum.map(|x| x / float(samples))
        })
    }

    /// Returns whether any of so many paths finds light on its way, however little; they end as those of
    /// [`IrradianceSampler::traced`].
    ///
    /// # Errors
    ///
    /// As [`IrradianceSampler::of_lamps`].
    pub fn is_lit(
        &self,
        group: usize,
        points: &[SurfacePoint],
        samples: usize,
        seed: u64,
        rule: PathRule,
    ) -> Result<Vec<bool>> {
        let (lights, lattice) = (self.group(group)?, lattice(samples)?);
        each(points, |point, scratch| {
            let start = self.start(point);
            let mut lit = false;
            for at in 0..lattice.len() {
                let first = cosine_direction(lattice.shifted(at, shift_of(point)));
                let mut draws = draws(seed, point, lattice.numbers[at]);
                trace(self, lights, &start, first, rule, &mut draws, scratch, |light| {
                    lit = light.iter().any(|&x| x > 0.0);
                    !lit
                });
                if lit {
                    break;
                }
            }
            lit
        })
    }

    fn group(&self, group: usize) -> Result<&Lights> {
        self.groups.get(group).ok_or_else(|| {
            Error::Argument(format!("there are {} groups of lights, got number {group}", self.groups.len()))
        })
    }

    /// Adds up at each point the light of several lights, each by all points of a lattice.
    fn summed<S: Sum, L: Sync>(
        &self,
        lattice: &Lattice,
        points: &[SurfacePoint],
        lights: &[L],
        arriving: impl Fn(&L, &Start, [f32; 2]) -> Arriving + Sync,
    ) -> Result<Vec<S::Light>> {
        each(points, |point, scratch| {
            let start = self.start(point);
            let mut sum = S::default();
            for light in lights {
                let arriving = |at| arriving(light, &start, at);
                direct(&self.tracer, &start, lattice, shift_of(point), scratch, arriving, &mut sum);
            }
            sum.mean(lattice.len())
        })
    }

    fn start(&self, point: &SurfacePoint) -> Start {
        let normal = single(point.normal);
        Start::new(self.tracer.scaled(point.position), normal, normal, self.step())
    }

    fn step(&self) -> f32 {
        STEP * self.tracer.diagonal
    }
}

/// Computes something at each point, on all threads.
fn each<T: Send>(points: &[SurfacePoint], compute: impl Fn(&SurfacePoint, &mut Scratch) -> T + Sync) -> Result<Vec<T>> {
    let wrong = |point: &&SurfacePoint| {
        let numbers = point.position.iter().chain(&point.normal).chain(&point.shift);
        !numbers.clone().all(|x| x.is_finite()) || point.shift.iter().any(|x| !(0.0..1.0).contains(x))
    };
    if let Some(point) = points.iter().find(wrong) {
        return Err(Error::Argument(format!("points are finite, and their shifts lie in 0..1, got {point:?}")));
    }
    Ok(SHARED.pool()?.install(|| {
        points.par_iter().with_min_len(4).map_init(Scratch::default, |scratch, point| compute(point, scratch)).collect()
    }))
}

#[allow(clippy::cast_precision_loss, reason = "few samples")]
fn float(samples: usize) -> f64 {
    samples as f64
}

fn lattice(samples: usize) -> Result<Lattice> {
    if (1..=1 << 20).contains(&samples) {
        return Ok(Lattice::new(samples));
    }
    Err(Error::Argument(format!("samples lie in 1..=2^20, got {samples}")))
}

fn shift_of(point: &SurfacePoint) -> [f32; 2] {
    single(point.shift).map(|x| x.min(BELOW_ONE))
}

/// Returns the draws of a path from a point.
fn draws(seed: u64, point: &SurfacePoint, path: u32) -> Draws {
    let own = point.shift[0].to_bits() ^ point.shift[1].to_bits().rotate_left(32);
    Draws { seed: seed ^ own, path, next: 0 }
}

fn add_up(sum: &mut [f64; 3], more: Vector) {
    for (channel, value) in sum.iter_mut().zip(more) {
        *channel += value;
    }
}

/// Returns the light of a sky from a direction that follows the cosine.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn along_cosine(sky: &Sky, start: &Start, at: [f32; 2]) -> Arriving {
    let local = cosine_direction(at);
    let towards = in_frame(&start.across, &start.normal, local);
    let light = match sky {
        Sky::Constant(radiance) => *radiance,
        Sky::Map(map) => {
            let (radiance, density) = map.seen(towards);
            let own = local[2] / std::f32::consts::PI;
            let weight = if own > 0.0 { own / (own + density) } else { 0.0 };
            radiance.map(|x| x * weight)
        }
    };
    Arriving { towards, end: f32::INFINITY, light }
}

/// Returns the light of a sky from a direction that follows its radiance.
fn along_radiance(sky: &Sky, start: &Start, at: [f32; 2]) -> Arriving {
    let Sky::Map(map) = sky else { return Arriving::NONE };
    let towards = map.towards(at);
    let cosine = towards[0] * start.normal[0] + towards[1] * start.normal[1] + towards[2] * start.normal[2];
    let (radiance, density) = map.seen(towards);
    if !(cosine > 0.0 && density > 0.0) {
        return Arriving::NONE;
    }
    let own = cosine / std::f32::consts::PI;
    Arriving { towards, end: f32::INFINITY, light: radiance.map(|x| x * (own / (own + density))) }
}

/// Adds up the light that arrives along the points of a lattice, where nothing is in its way.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn direct(
    tracer: &RayTracer,
    start: &Start,
    lattice: &Lattice,
    shift: [f32; 2],
    scratch: &mut Scratch,
    arriving: impl Fn([f32; 2]) -> Arriving,
    sum: &mut impl Sum,
) {
    let Scratch { fan, light, .. } = scratch;
    light.clear();
    fan.origin = start.origin;
    fan.resize(lattice.len());
    for at in 0..lattice.len() {
        let sample = arriving(lattice.shifted(at, shift));
        for axis in 0..3 {
            fan.directions[axis][at] = sample.towards[axis];
        }
        fan.ends[at] = sample.end;
        light.push(sample.light);
    }
    any(tracer, fan);
    for at in 0..lattice.len() {
        if fan.ends[at] > 0.0 && !fan.blocked[at] {
            sum.add(start, [0, 1, 2].map(|axis| fan.directions[axis][at]), light[at]);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn any(tracer: &RayTracer, fan: &mut Fan) {
    tracer.any(fan);
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn closest(tracer: &RayTracer, fan: &mut Fan) {
    tracer.closest(fan);
}

/// Adds up what the rays of a point gather.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::too_many_arguments, reason = "a point, its rays, and what they find")]
fn gather<S: Sum>(
    scene: &IrradianceSampler,
    lights: &Lights,
    start: &Start,
    lattice: &Lattice,
    shift: [f32; 2],
    reflected: Option<&ReflectedLight>,
    scratch: &mut Scratch,
    sum: &mut S,
) {
    let Scratch { fan, shadow, light, .. } = scratch;
    fan.origin = start.origin;
    fan.ends.clear();
    fan.resize(lattice.len());
    lattice.directions(shift, &start.across, &start.normal, &mut fan.directions);
    scene.tracer.closest(fan);
    for at in 0..lattice.len() {
        let hit = fan.hits[at];
        if hit.triangle == NOTHING {
            continue;
        }
        let along = [0, 1, 2].map(|axis| fan.directions[axis][at]);
        let (side, normal) = scene.surfaces.side(hit.triangle, along);
        let reflectance = scene.surfaces.reflectance(hit.triangle, side, hit.weights);
        let mut falling = [0f32; 4];
        if let Some(light) = reflected {
            falling = light.at(hit.triangle, side, hit.weights);
        }
        if !lights.sharp.is_empty() && reflectance != [0.0; 4] {
            let position = [0, 1, 2].map(|i| start.origin[i] + hit.distance * along[i]);
            let facing = scene.surfaces.shading_normal(hit.triangle, side, hit.weights);
            let there = Start::new(position, facing, normal, scene.step());
            let turn = R2.map(|step| (f64::from(lattice.numbers[at]) * step).fract());
            let more = sharp_light(&scene.tracer, lights, &there, single(turn), shadow, light);
            for i in 0..4 {
                falling[i] += more[i];
            }
        }
        sum.add(start, along, [0, 1, 2, 3].map(|i| reflectance[i] * falling[i]));
    }
}

/// Returns irradiance / pi of the sharp lights at a hit, by one point of each.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn sharp_light(
    tracer: &RayTracer,
    lights: &Lights,
    there: &Start,
    at: [f32; 2],
    shadow: &mut Fan,
    light: &mut Vec<Colour>,
) -> Colour {
    begin(shadow, light, there);
    for sharp in &lights.sharp {
        push(shadow, light, &sharp.arriving(&there.position, &there.normal, &there.origin, at));
    }
    tracer.any(shadow);
    end(shadow, light)
}

/// Begins to collect light that arrives at a point.
fn begin(shadow: &mut Fan, light: &mut Vec<Colour>, there: &Start) {
    shadow.origin = there.origin;
    shadow.resize(0);
    light.clear();
}

/// Adds light that arrives, if there is any.
fn push(shadow: &mut Fan, light: &mut Vec<Colour>, arriving: &Arriving) {
    if arriving.end > 0.0 {
        for axis in 0..3 {
            shadow.directions[axis].push(arriving.towards[axis]);
        }
        shadow.ends.push(arriving.end);
        light.push(arriving.light);
    }
}

/// Returns the sum of what was collected and has nothing in its way.
fn end(shadow: &Fan, light: &[Colour]) -> Colour {
    let mut sum = [0.0; 4];
    for (blocked, light) in shadow.blocked.iter().zip(light) {
        if !blocked {
            for i in 0..4 {
                sum[i] += light[i];
            }
        }
    }
    sum
}

/// Follows a path from a point, and hands over the light that it finds at each of its hits, weighted by what the
/// surfaces on its way reflect, until it ends or `go_on` says that this is enough by `false`.
#[allow(clippy::too_many_arguments, reason = "a path, and where it begins")]
fn trace(
    scene: &IrradianceSampler,
    lights: &Lights,
    start: &Start,
    first: [f32; 3],
    rule: PathRule,
    draws: &mut Draws,
    scratch: &mut Scratch,
    mut go_on: impl FnMut(Colour) -> bool,
) {
    let Scratch { path, shadow, light, .. } = scratch;
    let (mut from, mut local) = (*start, first);
    let mut weight = [1f32; 4];
    for bounce in 1..=rule.bounces {
        let along = in_frame(&from.across, &from.normal, local);
        path.origin = from.origin;
        path.resize(1);
        for axis in 0..3 {
            path.directions[axis][0] = along[axis];
        }
        path.ends[0] = f32::INFINITY;
        closest(&scene.tracer, path);
        let hit = path.hits[0];
        if hit.triangle == NOTHING {
            return;
        }
        let (side, normal) = scene.surfaces.side(hit.triangle, along);
        let reflectance = scene.surfaces.reflectance(hit.triangle, side, hit.weights);
        let position = [0, 1, 2].map(|i| from.origin[i] + hit.distance * along[i]);
        let facing = scene.surfaces.shading_normal(hit.triangle, side, hit.weights);
        from = Start::new(position, facing, normal, scene.step());
        for i in 0..4 {
            weight[i] *= reflectance[i];
        }
        if weight == [0.0; 4] {
            return;
        }
        begin(shadow, light, &from);
        for lamp in &lights.lamps {
            push(shadow, light, &lamp.arriving(&from.position, &from.normal, &from.origin, draws.point()));
        }
        if let Some(sky) = &lights.sky {
            push(shadow, light, &along_cosine(sky, &from, draws.point()));
            push(shadow, light, &along_radiance(sky, &from, draws.point()));
        }
        for sharp in &lights.sharp {
            push(shadow, light, &sharp.arriving(&from.position, &from.normal, &from.origin, draws.point()));
        }
        any(&scene.tracer, shadow);
        let arrived = end(shadow, light);
        if !go_on([0, 1, 2, 3].map(|i| weight[i] * arrived[i])) {
            return;
        }
        if bounce >= rule.roulette {
            let on = weight.iter().fold(0f32, |a, &b| a.max(b)).min(MOST_LIKELY_ON);
            if draws.point()[0] >= on {
                return;
            }
            weight = weight.map(|x| x / on);
        }
        local = cosine_direction(draws.point());
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::render::Beam;
    use crate::render::geometry::vector::{cross, dot, sub};
    use crate::render::irradiance::emitters::{AreaLamp, EnvironmentMap, SharpLight, SkyLight};
    use crate::render::light::colours::{ColourImage, TextureColours};
    use crate::render::light::slide::{Slide, SlideTables};

    const ONE: [f64; 3] = [1.0, 0.5, 0.25];

    /// Where a point is turned a little, its light grows by the product of what is along the surface with the turn.
    #[test]
    fn light_grows_where_a_surface_is_turned() {
        let (mut squares, area) = ceiling(0);
        squares.push([[-60.0, -60.0, -0.5], [120.0, 0.0, 0.0], [0.0, 120.0, 0.0]]);
        squares.push([[3.0, -4.0, -0.5], [0.0, 0.0, 4.0], [0.0, 8.0, 0.0]]);
        let texels = (0..64 * 32).map(|i| [1.0 + (i % 64) as f32 / 16.0, 1.0, 0.5]).collect();
        let map = EnvironmentMap {
            width: 64,
            height: 32,
            texels,
            to_map: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
        };
        let sky = Some(SkyLight::Map(map));
        let groups =
            [GroupLight { lamps: vec![area], ..GroupLight::default() }, GroupLight { sky, ..GroupLight::default() }];
        let sampler = scene(&squares, 0.6, &groups);
        let turned = |x: f64, y: f64| {
            let length = (1.0 + x * x + y * y).sqrt();
            point([0.7, -0.4, 0.0], [x / length, y / length, 1.0 / length])
        };
        let step = 0.04;
        let here = [turned(0.0, 0.0)];
        let around = [turned(step, 0.0), turned(-step, 0.0), turned(0.0, step), turned(0.0, -step)];
        let count = 1 << 14;
        let reflected =
            ReflectedLight::new(&(0..6).map(|_| [[0, 2], [0, 2]]).collect::<Vec<_>>(), &[[1.0, 0.5, 0.2]; 16]).unwrap();
        let of = |points: &[SurfacePoint]| {
            [
                sampler.of_lamps(0, points, count).unwrap(),
                sampler.of_sky(1, points, count).unwrap(),
                sampler.gathered(0, points, count, Some(&reflected)).unwrap(),
            ]
        };
        let along = [
            sampler.along_of_lamps(0, &here, count).unwrap()[0],
            sampler.along_of_sky(1, &here, count).unwrap()[0],
            sampler.along_gathered(0, &here, count, Some(&reflected)).unwrap()[0],
        ];
        for ((light, along), centre) in of(&around).iter().zip(along).zip(of(&here)) {
            for channel in 0..3 {
                let grown = [0, 2].map(|i| (light[i][channel] - light[i + 1][channel]) / (2.0 * step));
                let tolerance = 0.02 * centre[0][channel];
                assert!((grown[0] - along[0][channel]).abs() < tolerance, "{grown:?} {along:?} {tolerance}");
                assert!((grown[1] - along[1][channel]).abs() < tolerance, "{grown:?} {along:?} {tolerance}");
                assert!(along[2][channel].abs() < 1e-5);
            }
        }
        // Some of it is large.
        assert!(along[0][0][0].abs() > 0.1 && along[2][0][0].abs() > 0.1, "{along:?}");
    }

    /// Squares, two triangles each, by a corner and two edges; the front is where the edges turn left.
    fn scene(squares: &[[Vector; 3]], reflectance: f32, groups: &[GroupLight]) -> IrradianceSampler {
        let mut corners = vec![];
        for &[at, first, second] in squares {
            let point = |x: f64, y: f64| [0, 1, 2].map(|i| at[i] + x * first[i] + y * second[i]);
            corners.push([point(0.0, 0.0), point(1.0, 0.0), point(0.0, 1.0)]);
            corners.push([point(1.0, 0.0), point(1.0, 1.0), point(0.0, 1.0)]);
        }
        let normals: Vec<Vector> = corners
            .iter()
            .map(|&[a, b, c]| {
                let normal = cross(sub(b, a), sub(c, a));
                normal.map(|x| x / dot(normal, normal).sqrt())
            })
            .collect();
        let n = corners.len();
        let tables = SurfaceTables {
            shading_normals: normals.iter().map(|&normal| [normal; 3]).collect::<Vec<_>>().into(),
            normals: normals.into(),
            corners: corners.into(),
            uv: vec![[[0.0; 2]; 3]; n].into(),
            textures: vec![0; n],
            two_sided: vec![false; n],
            colours: TextureColours {
                of_texture: vec![0],
                images: vec![ColourImage::linear([1, 1, 0], &[[reflectance; 3]]).unwrap().into()],
            },
        };
        IrradianceSampler::new(&tables, groups).unwrap()
    }

    fn point(position: Vector, normal: Vector) -> SurfacePoint {
        SurfacePoint { position, normal, shift: [0.3, 0.7] }
    }

    fn close(light: Vector, expected: Vector, tolerance: f64) {
        for i in 0..3 {
            assert!((light[i] - expected[i]).abs() <= tolerance * expected[i].abs(), "{light:?} {expected:?}");
        }
    }

    const UP: Vector = [0.0, 0.0, 1.0];
    const TURNED: [Vector; 3] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];

    /// A lamp of 2 x 2 that faces down, 1 above the origin, by its form factor (Howell, B-4): 4 x 0.13853.
    fn ceiling(first: usize) -> (Vec<[Vector; 3]>, AreaLamp) {
        let squares = vec![[[-1.0, -1.0, 1.0], [0.0, 2.0, 0.0], [2.0, 0.0, 0.0]]];
        (squares, AreaLamp { first, count: 2, radiance: ONE, two_sided: false })
    }

    #[test]
    fn a_lamp_has_its_form_factor() {
        let p = 2f64.sqrt();
        let corner = (1.0 / p * (1.0 / p).atan() * 2.0) / std::f64::consts::TAU;
        let (mut squares, lamp) = ceiling(0);
        let light = GroupLight { lamps: vec![lamp], ..GroupLight::default() };
        let sampler = scene(&squares, 0.0, std::slice::from_ref(&light));
        let down = [0.0, 0.0, -1.0];
        let there =
            [point([0.0; 3], UP), point([0.0; 3], down), point([0.0, 0.0, 1.5], UP), point([0.0, 0.0, 1.5], down)];
        let irradiance = sampler.of_lamps(0, &there, 4096).unwrap();
        close(irradiance[0], ONE.map(|x| 4.0 * corner * x), 1e-3);
        assert_eq!(irradiance[1..], [[0.0; 3]; 3]); // it faces away, or lies behind the lamp
        // A lamp that shines from its back too lights both sides alike.
        let lamps = vec![AreaLamp { two_sided: true, ..lamp }];
        let both = scene(&squares, 0.0, &[GroupLight { lamps, ..GroupLight::default() }]);
        let irradiance = both.of_lamps(0, &[there[0], point([0.0, 0.0, 2.0], down)], 4096).unwrap();
        close(irradiance[0], ONE.map(|x| 4.0 * corner * x), 1e-3);
        close(irradiance[1], ONE.map(|x| 4.0 * corner * x), 1e-3);
        // Half of it is hidden.
        squares.push([[0.0, -9.0, 0.5], [9.0, 0.0, 0.0], [0.0, 18.0, 0.0]]);
        let sampler = scene(&squares, 0.0, std::slice::from_ref(&light));
        close(sampler.of_lamps(0, &there[..1], 4096).unwrap()[0], ONE.map(|x| 2.0 * corner * x), 5e-3);
        // The same lamp by triangles that are no parallelogram: one of them comes from elsewhere, without area there.
        let lamps = vec![AreaLamp { first: 0, count: 1, ..lamp }, AreaLamp { first: 1, count: 1, ..lamp }];
        let sampler = scene(&squares[..1], 0.0, &[GroupLight { lamps, ..GroupLight::default() }]);
        close(sampler.of_lamps(0, &there[..1], 4096).unwrap()[0], ONE.map(|x| 4.0 * corner * x), 5e-3);
    }

    /// A lamp of four triangles of different sizes has the light of the rectangle that they fill.
    #[test]
    fn points_lie_evenly_on_a_lamp() {
        let strip = |x: f64, width: f64| [[x, -1.0, 1.0], [0.0, 2.0, 0.0], [width, 0.0, 0.0]];
        let squares = [strip(-1.0, 0.3), strip(-0.7, 1.7)];
        let lamp = |first, count| AreaLamp { first, count, radiance: ONE, two_sided: false };
        let groups = [vec![lamp(0, 4)], vec![lamp(0, 2), lamp(2, 2)]];
        let groups = groups.map(|lamps| GroupLight { lamps, ..GroupLight::default() });
        let sampler = scene(&squares, 0.0, &groups);
        let there = [point([0.6, 0.0, 0.0], UP), point([-0.9, 0.5, 0.7], UP)];
        let by_channel = sampler.of_lamps(1, &there, 4096).unwrap();
        for (all, by_channel) in sampler.of_lamps(0, &there, 4096).unwrap().into_iter().zip(by_channel) {
            close(all, by_channel, 0.01);
        }
    }

    /// A sky of one radiance, as such and as a map: all of it without a wall, half of it beside one. A map that is
    /// bright at one end of an axis only has its closed form, and both its ways of sampling count once.
    #[test]
    fn skies_have_their_closed_forms() {
        let wall = [[[0.0, -1e3, -1e3], [0.0, 2e3, 0.0], [0.0, 0.0, 2e3]]];
        let map =
            |texels: Vec<[f32; 3]>, to_map| SkyLight::Map(EnvironmentMap { width: 8, height: 65, texels, to_map });
        let same = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let turned = TURNED; // its pole is the world's z
        let row = |y: usize| [0.5 * (1.0 + libm::cosf(std::f32::consts::PI * y as f32 / 64.0)); 3];
        let graded: Vec<[f32; 3]> = (0..65 * 8).map(|i| row(i / 8)).collect();
        let sky = |sky| GroupLight { sky: Some(sky), ..GroupLight::default() };
        let groups = [
            sky(SkyLight::Constant(ONE)),
            sky(map(vec![[1.0, 0.5, 0.25]; 65 * 8], same)),
            sky(map(graded, turned)),
            GroupLight::default(),
        ];
        let sampler = scene(&wall, 0.0, &groups);
        let there = [point([5.0, 0.0, 0.0], [1.0, 0.0, 0.0]), point([1.0, 0.0, 0.0], UP)];
        for (group, samples) in [(0, 4096), (1, 4096)] {
            let irradiance = sampler.of_sky(group, &there, samples).unwrap();
            close(irradiance[0], ONE, 2e-3);
            close(irradiance[1], ONE.map(|x| 0.5 * x), 5e-3);
        }
        // Radiance (1 + cos) / 2 around z: (1 + 2/3) / 2 for a point that looks up, and 1/2 for one on the wall.
        let irradiance = sampler.of_sky(2, &[point([5.0, 0.0, 0.0], UP), there[0]], 4096).unwrap();
        close(irradiance[1], [0.5; 3], 5e-3);
        let blocked = (0.5 * (1.0 + 2.0 / 3.0)) / 2.0;
        close(irradiance[0], [blocked; 3], 1e-2);
        assert_eq!(sampler.of_sky(3, &there, 16).unwrap(), [[0.0; 3]; 2]);
    }

    #[test]
    fn sharp_lights_have_their_closed_forms() {
        let (squares, _) = ceiling(0);
        let at = [0.0, 0.0, -2.0];
        let spot = |full, cutoff| Some(Beam::Spot { axis: UP.map(|x| -x), full, cutoff });
        let lamp_at = |beam| SharpLight::Point { position: [0.0, 0.0, 0.5], intensity: ONE, beam, slide: None };
        let group = |light| GroupLight { sharp: vec![light], ..GroupLight::default() };
        let slanted = [0.0, -0.6, -0.8];
        let groups = [
            group(lamp_at(None)),
            group(lamp_at(Some(Beam::Cosine([0.0, 0.6, -0.8])))),
            group(lamp_at(spot(0.5, 1.0))),
            group(SharpLight::Directional { along: slanted, irradiance: ONE }),
            group(SharpLight::Directional { along: UP, irradiance: ONE }),
        ];
        let sampler = scene(&squares, 0.0, &groups);
        let irradiance_of = |group| sampler.of_sharp(group, &[point(at, UP)], 16).unwrap()[0];
        let full = ONE.map(|x| x / 6.25 / std::f64::consts::PI);
        close(irradiance_of(0), full, 1e-5);
        close(irradiance_of(1), full.map(|x| 0.8 * x), 1e-5);
        close(irradiance_of(2), full, 1e-5);
        // The sun passes by the ceiling; from below it lights no front.
        close(irradiance_of(3), ONE.map(|x| 0.8 * x / std::f64::consts::PI), 1e-5);
        assert_eq!(irradiance_of(4), [0.0; 3]);
        // In a scene of another size a metre is still a metre.
        let wide = scene(&[squares[0], [[0.0, 0.0, 50.0], UP, [0.0, 1.0, 0.0]]], 0.0, &groups);
        close(wide.of_sharp(0, &[point(at, UP)], 16).unwrap()[0], full, 1e-4);
        let aside = [point([0.0, 1.875, -2.0], UP), point([0.0, 9.0, -2.0], UP), point([0.0, 0.0, 2.0], UP)];
        let beams = sampler.of_sharp(2, &aside, 16).unwrap();
        let (angle, distance_squared) = ((0.75f64).atan(), 6.25 + 1.875f64.powi(2));
        let factor = (1.0 - angle) / 0.5 * 0.8 / distance_squared / std::f64::consts::PI;
        close(beams[0], ONE.map(|x| x * factor), 1e-4);
        assert_eq!(beams[1..], [[0.0; 3]; 2]); // out of the beam, and behind
    }

    /// A slide of three colours before a light that looks down, in a scene of another size than a metre too.
    #[test]
    fn slides_are_thrown_in_colour() {
        let texels = [0.5f32, 1.0, 2.0].iter().flat_map(|&value| [value; 9]).collect();
        let slide = SlideTables {
            rows: [[1.0, 0.0, -0.5], [0.0, -1.0, -0.5], [0.0, 0.0, -1.0]],
            uv_map: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            projected: true,
            nearest: false,
            layout: [1, 1, 0],
            texels,
        };
        let slide = Some(Arc::new(Slide::new(slide).unwrap()));
        let light = SharpLight::Point { position: [0.0, 0.0, 0.5], intensity: [1.0; 3], beam: None, slide };
        let groups = [GroupLight { sharp: vec![light], ..GroupLight::default() }];
        let there = [point([0.5, 0.9, -2.0], UP), point([1.3, 0.0, -2.0], UP), point([0.0, 0.0, 1.0], UP)];
        let far = [[0.0, 0.0, 50.0], UP, [0.0, 1.0, 0.0]];
        for squares in [vec![ceiling(0).0[0]], vec![ceiling(0).0[0], far]] {
            let light = scene(&squares, 0.0, &groups).of_sharp(0, &there, 16).unwrap();
            // As strong at the edge as in the middle: the slant of the surface and of the way cancel the cube.
            close(light[0], [0.5, 1.0, 2.0].map(|x| x / 6.25 / std::f64::consts::PI), 1e-4);
            assert_eq!(light[1..], [[0.0; 3]; 2]); // beyond the slide's edge, and behind
        }
    }

    /// A closed box whose walls reflect a half: light that falls on them evenly is gathered, and paths find the sum of
    /// all bounces of a lamp that is all of the ceiling.
    #[test]
    fn light_that_bounces_adds_up() {
        let [x, y, z] = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
        let low = [-1.0; 3];
        let high = [1.0; 3];
        let back = |edge: Vector| edge.map(|x| -x);
        let squares = [
            [low, x, y],
            [low, y, z],
            [low, z, x],
            [high, back(y), back(x)],
            [high, back(z), back(y)],
            [high, back(x), back(z)],
        ];
        let lamps = (0..6).map(|i| AreaLamp { first: 2 * i, count: 2, radiance: ONE, two_sided: false }).collect();
        let groups = [GroupLight { lamps, ..GroupLight::default() }];
        let sampler = scene(&squares, 0.5, &groups);
        let there: Vec<SurfacePoint> = (0..5).map(|i| point([0.3, f64::from(i) * 0.1, -1.0], UP)).collect();
        let layouts: Vec<[[i64; 2]; 2]> = (0..12).map(|i| [[16 * i, 2]; 2]).collect();
        let light = ReflectedLight::new(&layouts, &vec![[1.0, 0.5, 0.25]; 16 * 12]).unwrap();
        for irradiance in sampler.gathered(0, &there, 64, Some(&light)).unwrap() {
            close(irradiance, ONE.map(|x| 0.5 * x), 1e-5);
        }
        assert_eq!(sampler.gathered(0, &there, 64, None).unwrap(), [[0.0; 3]; 5]);
        // What falls on each wall directly is ONE; of it, 1/2 + 1/4 + ... bounces.
        for (bounces, fraction) in [(1, 0.5), (3, 0.875), (1000, 1.0)] {
            let rule = PathRule { bounces, roulette: 2 };
            let all = sampler.traced(0, &there, 1024, 7, rule).unwrap();
            let mean = [0, 1, 2].map(|i| all.iter().map(|one| one[i]).sum::<f64>() / 5.0);
            close(mean, ONE.map(|x| fraction * x), 0.04);
        }
        // The same point has the same bits alone; another seed has other paths.
        let rule = PathRule { bounces: 5, roulette: 2 };
        let all = sampler.traced(0, &there, 64, 7, rule).unwrap();
        assert_eq!(sampler.traced(0, &there[3..4], 64, 7, rule).unwrap()[0], all[3]);
        assert_ne!(sampler.traced(0, &there, 64, 8, rule).unwrap(), all);
        assert_eq!(sampler.is_lit(0, &there, 4, 0, rule).unwrap(), [true; 5]);
        let lampless = scene(&squares, 0.5, &[GroupLight::default()]);
        assert_eq!(lampless.is_lit(0, &there, 64, 0, rule).unwrap(), [false; 5]);
        let unlit = scene(&squares, 0.0, &groups);
        assert_eq!(unlit.is_lit(0, &there, 64, 0, rule).unwrap(), [false; 5]);
    }

    /// A room of squares that lie across each other, a lamp, a sharp light and a sky with a pattern.
    fn cluttered_room() -> IrradianceSampler {
        let mut squares = vec![[[-2.0, -2.0, 1.9], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]];
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        };
        for _ in 0..300 {
            let mut vector = |scale: f64| [0, 1, 2].map(|_| scale * random());
            squares.push([vector(2.0), vector(0.5), vector(0.5)]);
        }
        let lamps = vec![AreaLamp { first: 0, count: 2, radiance: ONE, two_sided: false }];
        let sharp = vec![SharpLight::Point { position: [0.4, -0.3, 1.5], intensity: ONE, beam: None, slide: None }];
        let (texels, to_map) = ((0..32).map(|texel| [0.1 + (texel % 7) as f32; 3]).collect(), TURNED);
        let sky = Some(SkyLight::Map(EnvironmentMap { width: 8, height: 4, texels, to_map }));
        scene(&squares, 0.5, &[GroupLight { lamps, sky, sharp }])
    }

    /// FNV-1a of the bits.
    fn hash(values: &[[f64; 3]]) -> u64 {
        let bytes = values.iter().flatten().flat_map(|value| value.to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    }

    /// All kinds of light have the bits that they had on another processor: they were found in a build without AVX, and
    /// each processor runs the best level that it has.
    #[test]
    fn bits_are_those_of_other_processors() {
        let sampler = cluttered_room();
        let there: Vec<SurfacePoint> = (0..24)
            .map(|i| {
                let at = [0, 1, 2].map(|axis| ((i * [5, 7, 11][axis]) % 24) as f64 / 8.0 - 1.5);
                SurfacePoint {
                    position: at,
                    normal: [[0.0, 0.0, 1.0], [0.6, 0.0, -0.8]][i % 2],
                    shift: [0.3, 0.01 * i as f64],
                }
            })
            .collect();
        let layouts: Vec<[[i64; 2]; 2]> = (0..602).map(|i| [[16 * i, 2]; 2]).collect();
        let texels: Vec<[f32; 3]> = (0..16 * 602).map(|i| [(i % 13) as f32, (i % 5) as f32, 1.0]).collect();
        let reflected = ReflectedLight::new(&layouts, &texels).unwrap();
        let rule = PathRule { bounces: 5, roulette: 2 };
        let seen = [
            hash(&sampler.of_lamps(0, &there, 100).unwrap()),
            hash(&sampler.of_sky(0, &there, 100).unwrap()),
            hash(&sampler.of_sharp(0, &there, 100).unwrap()),
            hash(&sampler.gathered(0, &there, 100, Some(&reflected)).unwrap()),
            hash(&sampler.traced(0, &there, 100, 7, rule).unwrap()),
        ];
        let elsewhere = [
            1_029_810_448_443_279_153,
            4_018_263_268_532_376_628,
            14_828_673_998_964_427_446,
            12_502_042_131_120_385_360,
            2_210_635_048_684_572_390,
        ];
        assert_eq!(seen, elsewhere);
    }

    /// Rays hit the same, with the same bits, in code of the lowest processor level, which is what the compiler makes of
    /// the tracer itself, and of the highest one.
    #[test]
    fn rays_hit_the_same_at_every_processor_level() {
        let sampler = cluttered_room();
        let (lattice, mut blocked) = (Lattice::new(1000), vec![]);
        for origin in [[0.0; 3], [0.1, -0.2, 0.3], [-0.9, 0.9, 0.5]] {
            let mut fans: [Fan; 2] = std::array::from_fn(|_| {
                let mut fan = Fan::default();
                fan.origin = origin;
                fan.resize(lattice.len());
                for at in 0..lattice.len() {
                    let local = cosine_direction(lattice.shifted(at, [0.2, 0.4]));
                    for axis in 0..3 {
                        fan.directions[axis][at] = local[axis];
                    }
                    fan.ends[at] = if at % 2 == 0 { f32::INFINITY } else { 0.3 };
                }
                fan
            });
            let [plain, best] = &mut fans;
            sampler.tracer.closest(plain);
            sampler.tracer.any(plain);
            closest(&sampler.tracer, best);
            any(&sampler.tracer, best);
            blocked.extend_from_slice(&plain.blocked);
            assert_eq!(plain.blocked, best.blocked);
            let bits = |fan: &Fan| -> Vec<_> {
                fan.hits
                    .iter()
                    .map(|hit| (hit.triangle, hit.distance.to_bits(), hit.weights.map(f32::to_bits)))
                    .collect()
            };
            assert_eq!(bits(plain), bits(best));
        }
        let hits = blocked.iter().filter(|&&blocked| blocked).count();
        assert!((500..2500).contains(&hits), "{hits}");
    }

    #[test]
    fn what_is_wrong_is_refused() {
        let (squares, lamp) = ceiling(0);
        let sampler = scene(&squares, 0.5, &[GroupLight { lamps: vec![lamp], ..GroupLight::default() }]);
        let there = [point([0.0; 3], UP)];
        for (group, samples, shift, message) in [
            (1, 16, 0.5, "there are 1 groups of lights, got number 1"),
            (0, 0, 0.5, "samples lie in 1..=2^20, got 0"),
            (0, (1 << 20) + 1, 0.5, "samples lie in"),
            (0, 16, 1.0, "shifts lie in 0..1"),
            (0, 16, f64::NAN, "points are finite"),
        ] {
            let wrong = [SurfacePoint { shift: [shift, 0.0], ..there[0] }];
            let error = sampler.of_lamps(group, &wrong, samples).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        let few = ReflectedLight::new(&[[[0, 2]; 2]], &[[1.0; 3]; 16]).unwrap();
        assert!(sampler.gathered(0, &there, 16, Some(&few)).is_err());
        for layout in [[0, 1], [1, 2], [-1, 2], [0, 1 << 40], [i64::MAX, 2]] {
            assert!(ReflectedLight::new(&[[layout; 2]], &[[1.0; 3]; 16]).is_err(), "{layout:?}");
        }
    }
}
