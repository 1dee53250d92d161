//! Paths of light to glossy surfaces, followed backwards from the camera: mirror rays, refracted ones, directions of a
//! lobe, and rays to points of the lamps.
//!
//! No path is drawn at random. A ray of the camera that hits a glossy surface follows its points of the pixel's
//! [`Pattern`]. What these rays hit is shaded by its lights and its light maps as it would be for the camera. A rough
//! surface that is seen in another one follows one direction, or counts as diffuse.
//!
//! Points and directions are in camera axes, with their rates where [`Number`] has them. Triangles are met in the frame
//! of each body.
//!
//! What must not break: a path depends on its view, its ray and the ray's number in the pixel alone. Rates are those of
//! the same surfaces and shadows.

use std::borrow::Cow;

use super::finish::{Finish, Fresnel, Under, dielectric};
use super::frame_axes::{at_map, from_frame, into_frame, point_in_frame};
use super::lamps::Shares;
use super::lookup::looked_up;
use super::microfacets::{Anisotropy, Cosines, SeenFacets, lobe_density, refracted};
use super::number::{Number, Triple, add, constant, dot, each, negated, rated, scale, sub, times, unit, values};
use super::pattern::{Pattern, PatternPoint};
use super::tables::Gloss;
use crate::render::geometry::vector::{self, Vector, largest};
use crate::render::geometry::view::Pose;
use crate::render::light::light_map::SideMap;
use crate::render::light::lights::{SeenKind, SeenLight, Surroundings};
use crate::render::light::normal_texture::fading;
use crate::render::light::texture::{Wrap, parted};
use crate::render::scene::Surface;
use crate::render::visibility::first_hit::{FirstHits, Ray, is_blocked};

/// Luma of red, green and blue (BT.601), as Python's `LUMA_WEIGHTS`.
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];

/// Paths end where they count for less than this.
const FAINT: f64 = 1e-3;

/// Paths have at most so many segments.
const LONGEST: usize = 32;

/// On paths of so many segments, surfaces of at least this roughness count as diffuse.
const AS_DIFFUSE: (usize, f64) = (3, 0.2);

/// Light along a lobe that is weaker than this, relative to the lamp, needs no shadow ray.
const NO_SHADOW: f64 = 1e-5;

/// Rays begin this far from the surface, relative to its coordinates: what is nearer lies on it.
const NEAREST: f64 = 1e-10;

/// Room for the tracer's work.
#[derive(Debug, Default)]
pub(crate) struct TracerScratch {
    rays: Vec<Ray>,
    hits: FirstHits,
    stack: Vec<u32>,
}

/// What follows paths through one view of a scene.
pub(crate) struct Tracer<'a> {
    pub(crate) lit: &'a Surroundings<'a>,
    pub(crate) gloss: &'a Gloss,
    pub(crate) pattern: &'a Pattern,
    pub(crate) scratch: &'a mut TracerScratch,
}

/// A place on a triangle that a ray meets.
#[derive(Clone, Copy, Debug)]
struct Hit<N> {
    triangle: u32,
    /// In camera axes.
    point: Triple<N>,
    /// In the triangle's frame.
    in_frame: Triple<N>,
    /// The way to it.
    distance: N,
    /// The plane's unit normal on the side that the ray meets, in camera axes.
    plane: Triple<N>,
    /// Whether the ray meets the front.
    front: bool,
}

/// What is known of a path up to a surface.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Segments so far, that of the camera among them.
    segments: usize,
    /// How much what it meets counts.
    weight: f64,
    /// The number of the camera's ray in its pixel.
    ray: usize,
    /// The number of the pattern's point that it followed on the last rough surface; None where there was none.
    point: Option<usize>,
    /// How much is absorbed of the light around it on a way of length 1, see [`Under::Solid`].
    absorption: [f64; 3],
}

/// How a surface reflects the light of a lamp in a direction, times the cosine to it.
struct ByLamp<N> {
    /// By its lobe and by that of its coat, and how densely their own directions lie there.
    lobes: [(Triple<N>, N); 2],
    /// By what is below the lobe, beyond what baked light brings.
    more: Triple<N>,
}

/// The surface at a hit, as light falls on it.
#[derive(Clone, Copy, Debug)]
struct Spot<'a, N> {
    hit: Hit<N>,
    finish: Option<&'a Finish>,
    base: Triple<N>,
    /// The shading normal on the viewer's side.
    normal: Triple<N>,
    viewer: Triple<N>,
    /// The cosine between these two.
    out: N,
    /// The shading normal without the normal texture; None where there is none.
    under: Option<Triple<N>>,
    /// Whether light fades with it.
    fades: bool,
    /// Light comes from behind the surface of a rough solid: the index there, relative to the viewer's side.
    through: Option<f64>,
    /// Of an anisotropic surface.
    anisotropy: Option<Anisotropy<N>>,
}

impl<N: Number> Spot<'_, N> {
    /// Returns the reflectance for light from all sides.
    fn evenly(&self, path: &Path) -> Triple<N> {
        match self.finish {
            None => self.base,
            Some(finish) if path.is_diffuse(finish) => {
                add(finish.below_evenly(self.base, self.out), finish.reflected(self.base, self.out))
            }
            Some(finish) => finish.below_evenly(self.base, self.out),
        }
    }

    /// Returns the luminance towards the viewer for light of strength 1 that falls along a unit vector; the lobe's where
    /// it is wanted.
    fn reflected(&self, towards: Triple<N>, with_lobe: bool) -> Triple<N> {
        if let (Some(index), Some(finish)) = (self.through, self.finish) {
            let through = finish.lobe_through(self.normal, self.viewer, towards, index, self.anisotropy.as_ref());
            return through.map_or([N::constant(0.0); 3], |(light, _)| light);
        }
        let into = dot(self.normal, towards);
        let diffuse = into.scaled(std::f64::consts::FRAC_1_PI);
        let Some(finish) = self.finish else { return scale(self.base, diffuse) };
        let cosines = Cosines::new(self.normal, self.viewer, towards, self.anisotropy.as_ref());
        let below = scale(finish.below(self.base, &cosines), diffuse);
        if !with_lobe || finish.is_mirror() { below } else { add(below, finish.lobes(self.base, &cosines)) }
    }

    /// Returns the fraction of light from a direction that bumps let through.
    fn fading(&self, towards: Triple<N>) -> N {
        match self.under {
            Some(normal) if self.fades => fading(normal, self.normal, towards),
            _ => N::constant(1.0),
        }
    }

    /// Returns the fraction that is left of light from all around where a normal texture turns the surface.
    fn even_fraction(&self) -> N {
        let cosine = self.under.map_or(N::constant(1.0), |normal| dot(normal, self.normal));
        (cosine + N::constant(1.0)).scaled(0.5)
    }

    /// Returns whether a direction leads away from the surface, on the side that light comes from.
    fn sees(&self, towards: Triple<N>) -> bool {
        let side = if self.through.is_some() { -1.0 } else { 1.0 };
        side * dot(self.normal, towards).value() > 0.0 && side * dot(self.hit.plane, towards).value() > 0.0
    }

    /// Returns the viewer's direction mirrored, above the surface.
    fn mirrored(&self) -> Triple<N> {
        let about = |normal: Triple<N>| sub(scale(normal, dot(normal, self.viewer).scaled(2.0)), self.viewer);
        let towards = about(self.normal);
        if dot(self.hit.plane, towards).value() > 0.0 { towards } else { about(self.hit.plane) }
    }
}

impl Path {
    /// Returns whether a rough surface counts as diffuse on it.
    fn is_diffuse(&self, finish: &Finish) -> bool {
        self.segments >= AS_DIFFUSE.0 && finish.least_alpha() >= AS_DIFFUSE.1
    }

    /// Returns the path behind the surface of a solid, of which it meets the front or the back. Solids that absorb nothing
    /// are in what is around them, as in Mitsuba: glass in water stays in water.
    fn behind(&self, absorption: [f64; 3], front: bool) -> Self {
        let absorption = match (absorption == [0.0; 3], front) {
            (true, _) => self.absorption,
            (false, true) => absorption,
            (false, false) => [0.0; 3],
        };
        Self { absorption, ..*self }
    }

    /// Returns the fraction of light that is left after a way through what is around the path (Beer's law).
    fn left<N: Number>(&self, way: impl Fn() -> N) -> Triple<N> {
        if self.absorption == [0.0; 3] {
            return [N::constant(1.0); 3];
        }
        let way = way();
        each(constant(self.absorption), |absorption| (-(absorption * way)).exp())
    }

    fn faded<N: Number>(&self, by: Triple<N>) -> Self {
        Self { weight: self.weight * largest(values(by)), ..*self }
    }
}

impl Tracer<'_> {
    /// Returns the luma that a ray (x, y, 1) of the camera sees on a glossy triangle; `ray` is its number in its pixel.
    pub(crate) fn luma<N: Number>(&mut self, triangle: u32, [x, y]: [f64; 2], ray: usize) -> N {
        let direction: Triple<N> = constant(unit([x, y, 1.0]));
        let hit = self.hit_on(triangle, constant([0.0; 3]), direction);
        let path = Path { segments: 1, weight: 1.0, ray, point: None, absorption: [0.0; 3] };
        let mut radiance = self.shaded(&hit, negated(direction), &path);
        radiance = add(radiance, self.emitted_by_texture(&hit));
        if hit.front {
            radiance = add(radiance, self.emitted(triangle));
        }
        dot(radiance, constant(LUMA))
    }

    /// Returns the radiance of a surface towards a viewer, without its own light.
    fn shaded<N: Number>(&mut self, hit: &Hit<N>, viewer: Triple<N>, path: &Path) -> Triple<N> {
        let gloss = self.gloss;
        let surface = &self.lit.scene.surfaces[hit.triangle as usize];
        let own = gloss.finish(hit.triangle).map(|finish| self.finish_at(finish, surface, hit));
        let finish = own.as_deref();
        let (normal, under) = self.normal(hit, surface, viewer);
        let fades = under.is_some() && self.lit.scene.bumps(surface).is_some_and(|bumps| bumps.rule.fades);
        let texture = &self.lit.scene.textures[surface.texture as usize];
        let image = gloss.texels.of(surface.texture);
        let base = looked_up(texture, texture.wrap, surface.uv().each_ref(), hit.in_frame, |at| {
            image.at(at - texture.first).map(f64::from)
        });
        let out = dot(normal, viewer);
        let anisotropy = finish.and_then(|finish| self.anisotropy(finish, surface, normal));
        let spot = Spot { hit: *hit, finish, base, normal, viewer, out, under, fades, through: None, anisotropy };
        match finish {
            Some(finish @ Finish { under: Under::Solid { index, absorption }, .. }) => {
                let behind = &path.behind(*absorption, hit.front);
                if finish.is_mirror() {
                    self.through_solid(&spot, *index, [path, behind])
                } else {
                    let [reflected, passed] = self.of_rough_solid(&spot, finish, *index, (surface, [path, behind]));
                    add(reflected, passed)
                }
            }
            Some(Finish { under: Under::Sheet(index), .. }) => self.through_sheet(&spot, *index, path),
            Some(Finish { under: Under::Blend(opacity), .. }) => self.blended(spot, surface, *opacity, path),
            Some(finish) if finish.transmission > 0.0 => self.through_mix(&spot, finish, (surface, path)),
            _ if !hit.front && !surface.two_sided => [N::constant(0.0); 3],
            None => self.lit_by_all(&spot, surface, path),
            Some(finish) => self.reflected(&spot, finish, (surface, path)),
        }
    }

    /// Returns what an opaque glossy surface reflects.
    fn reflected<N: Number>(
        &mut self,
        spot: &Spot<N>,
        finish: &Finish,
        (surface, path): (&Surface, &Path),
    ) -> Triple<N> {
        let light = self.lit_by_all(spot, surface, path);
        if path.is_diffuse(finish) { light } else { add(light, self.image(spot, finish, path)) }
    }

    /// Returns along which directions a surface is how rough; None of an isotropic one.
    fn anisotropy<N: Number>(&self, finish: &Finish, surface: &Surface, normal: Triple<N>) -> Option<Anisotropy<N>> {
        let across = finish.across?;
        // Along it v does not grow.
        let [x, y, z, _] = surface.uv()[1];
        let along = vector::cross([x, y, z], normal_of(surface));
        let pose = &self.lit.view.poses[surface.frame as usize];
        Some(Anisotropy::new(normal, from_frame(pose, constant(along)), [finish.alpha, across]))
    }

    /// Returns a finish as it is at a place.
    fn finish_at<'b, N: Number>(&self, finish: &'b Finish, surface: &Surface, hit: &Hit<N>) -> Cow<'b, Finish> {
        if finish.lobe == [None; 2] {
            return Cow::Borrowed(finish);
        }
        Cow::Owned(finish.with_lobe(finish.lobe.map(|number| {
            let (texture, texels) = self.gloss.lobe(number?);
            let maps = surface.uv().each_ref();
            let [value]: [N; 1] = looked_up(texture, texture.wrap, maps, hit.in_frame, |at| [f64::from(texels[at])]);
            Some(value.value().clamp(0.0, 1.0))
        })))
    }

    /// Returns what a surface reflects of lights that have their own terms: all but images, and lamps in lobes.
    fn lit_by_all<N: Number>(&mut self, spot: &Spot<N>, surface: &Surface, path: &Path) -> Triple<N> {
        let (lit, gloss) = (self.lit, self.gloss);
        let (mut sum, mut evenly) = ([N::constant(0.0); 3], [N::constant(0.0); 3]);
        for (number, light) in lit.lights.iter().enumerate() {
            let strength = N::new(light.strength, light.strength_rate);
            let colour = scale(constant(gloss.colours[light.group]), strength);
            match light.kind {
                SeenKind::Visible => {}
                SeenKind::Constant => evenly = add(evenly, scale(colour, spot.even_fraction())),
                SeenKind::Baked(_) if light.strength == 0.0 && light.strength_rate == 0.0 => {}
                SeenKind::Baked(texels) => {
                    if let Some([front, back]) = surface.light_maps.as_deref() {
                        let side = if spot.hit.front || !surface.two_sided { front } else { back };
                        let irradiance = &lit.scene.irradiance[texels];
                        let [value] =
                            looked_up(&side.texture, Wrap::Clamp, [&side.u, &side.v], spot.hit.in_frame, |at| {
                                [f64::from(parted(irradiance[at])[0])]
                            });
                        let mut value = value.at_least(0.0);
                        if spot.under.is_some() {
                            let grown = self.grown(spot, surface, side, texels);
                            value = (value * spot.even_fraction() + grown).at_least(0.0);
                        }
                        evenly = add(evenly, scale(colour, value));
                    }
                }
                SeenKind::Directional(towards, rate) => {
                    let towards = rated(towards, rate);
                    if spot.sees(towards) && !self.is_hidden(spot, values(towards), f64::INFINITY, Some(number)) {
                        let reflected = scale(spot.reflected(towards, true), spot.fading(towards));
                        sum = add(sum, times(colour, reflected));
                    }
                }
                SeenKind::Point(position, rate) => {
                    let reflected = self.lit_from_position(spot, (number, light), rated(position, rate), path);
                    sum = add(sum, times(colour, reflected));
                }
            }
        }
        add(sum, times(spot.evenly(path), evenly))
    }

    /// Returns how much irradiance / pi of a baked light grows where a normal texture turns the surface.
    fn grown<N: Number>(&self, spot: &Spot<N>, surface: &Surface, side: &SideMap, number: usize) -> N {
        let scene = self.lit.scene;
        let Some(texture) = &side.vectors else { return N::constant(0.0) };
        let texels = &scene.irradiance_vectors[number];
        let along = looked_up(texture, Wrap::Clamp, [&side.u, &side.v], spot.hit.in_frame, |at| {
            texels.each_ref().map(|axis| f64::from(parted(axis[at])[0]))
        });
        dot(along, into_frame(&self.lit.view.poses[surface.frame as usize], spot.normal))
    }

    /// Returns what a surface reflects of a light at a position, for a strength of 1.
    fn lit_from_position<N: Number>(
        &mut self,
        spot: &Spot<N>,
        (number, light): (usize, &SeenLight),
        position: Triple<N>,
        path: &Path,
    ) -> Triple<N> {
        let way = sub(position, spot.hit.point);
        let towards = unit(way);
        if !spot.sees(towards) {
            return [N::constant(0.0); 3];
        }
        let mut fraction = light.beam.map_or(N::constant(1.0), |beam| beam.fraction(negated(towards)));
        if let Some(seen) = &light.slide {
            let slide = &self.lit.scene.slides[seen.number];
            fraction = fraction * slide.sent(seen.plane, &seen.rows.numbers(), negated(way));
        }
        let nothing = fraction.value() == 0.0 && fraction.rate() == 0.0;
        if nothing || self.is_hidden(spot, values(way), self.to_lamps(), Some(number)) {
            return [N::constant(0.0); 3];
        }
        // In a lobe, a lamp of many places is looked at as the triangles that it is made of.
        let with_lobe = light.beam.is_none_or(|beam| beam.is_spot());
        let reflected = scale(spot.reflected(towards, with_lobe), spot.fading(towards) * fraction / dot(way, way));
        times(reflected, path.left(|| dot(way, way).sqrt()))
    }

    /// Returns the image of the surroundings in a mirror or along a lobe, and what it reflects of lamps.
    fn image<N: Number>(&mut self, spot: &Spot<N>, finish: &Finish, path: &Path) -> Triple<N> {
        let (points, each) = self.points(path);
        let mut sum = [N::constant(0.0); 3];
        if finish.is_mirror() {
            let reflected = finish.reflected(spot.base, spot.out);
            sum = self.arriving(spot, spot.mirrored(), reflected, None, path);
            if finish.under == Under::Nothing {
                return sum;
            }
        }
        let facets = (!finish.is_mirror())
            .then(|| SeenFacets::new(finish.alpha, spot.normal, spot.viewer, spot.anisotropy.as_ref()));
        let shares = self.shares(spot, finish, path);
        for number in points {
            let point = self.pattern.point(number);
            if let Some(ray) = facets.as_ref().and_then(|facets| facets.lobe_ray(point.disk)) {
                let path = &Path { point: Some(number), ..*path };
                let brought = finish.lobe_weight(spot.base, &ray.cosines);
                let density = || lobe_density(finish.alpha, &ray.cosines);
                let lobe = (brought, density);
                sum = add(sum, self.along_ray_of_lobe(spot, ray.towards, lobe, (shares.as_ref(), each), path));
            }
            if let Some(coat) = &finish.coat
                && let Some(ray) = coat.ray(spot.normal, spot.viewer, point.disk)
            {
                let path = &Path { point: Some(number), ..*path };
                let lobe = ([coat.lobe_weight(&ray.cosines); 3], || coat.density(&ray.cosines));
                sum = add(sum, self.along_ray_of_lobe(spot, ray.towards, lobe, (shares.as_ref(), each), path));
            }
            if let Some(shares) = &shares {
                sum = add(sum, scale(self.lit_by_lamp(spot, finish, point, (shares, path)), N::constant(each)));
            }
        }
        sum
    }

    /// Returns the numbers of the pattern's points that a path follows on a rough surface, and the weight of each: all of
    /// its ray's where the camera sees the surface, else one.
    fn points(&self, path: &Path) -> (impl Iterator<Item = usize> + use<>, f64) {
        let points = self.pattern.of_ray(path.ray);
        let count = if path.segments == 1 { points.len() } else { 1 };
        let next = path.point.map(|point| self.pattern.after(point));
        #[allow(clippy::cast_precision_loss, reason = "a small number")]
        let each = 1.0 / count as f64;
        (next.into_iter().chain(points).take(count), each)
    }

    /// Returns what a direction of a lobe brings, one of a few of which `each` is the weight. `weight` is what it brings of
    /// light of strength 1, and `density` how densely directions of the lobe lie there.
    fn along_ray_of_lobe<N: Number>(
        &mut self,
        spot: &Spot<N>,
        towards: Triple<N>,
        (weight, density): (Triple<N>, impl Fn() -> N),
        (shares, each): (Option<&Shares>, f64),
        path: &Path,
    ) -> Triple<N> {
        if !spot.sees(towards) {
            return [N::constant(0.0); 3];
        }
        let weight = scale(weight, spot.fading(towards).scaled(each));
        self.arriving(spot, towards, weight, Some((&density, shares)), path)
    }

    /// Returns how a path's points are dealt out to the parts of the lamps: by what the surface reflects of each at most.
    /// None where it reflects none of them.
    fn shares<N: Number>(&self, spot: &Spot<N>, finish: &Finish, path: &Path) -> Option<Shares> {
        let (view, lamps) = (self.lit.view, &self.gloss.lamps);
        if lamps.is_empty() || path.segments >= self.longest() {
            return None;
        }
        let wanted = values(match spot.through {
            Some(index) => refracted(spot.normal, spot.viewer, index).unwrap_or(negated(spot.normal)),
            None if finish.is_mirror() => spot.normal,
            None => spot.mirrored(),
        });
        lamps.shares(|group| {
            let pose = &view.poses[group.frame as usize];
            let place = pose.point(values(spot.hit.point));
            let towards = constant(pose.turned(group.towards(place, pose.vector(wanted))));
            let by_lamp = if spot.sees(towards) { self.by_lamp(spot, finish, towards) } else { None };
            let Some(ByLamp { lobes: [(lobe, _), (coat, _)], more }) = by_lamp else { return (place, 0.0) };
            let channel = |i: usize| lobe[i].value() + coat[i].value() + more[i].value().abs();
            let reflected: f64 = (0..3).map(|i| LUMA[i] * channel(i)).sum();
            (place, reflected * view.factors[group.light as usize][0])
        })
    }

    /// Returns how a surface reflects the light of a lamp in a direction; None where it does not.
    fn by_lamp<N: Number>(&self, spot: &Spot<N>, finish: &Finish, towards: Triple<N>) -> Option<ByLamp<N>> {
        let dark = [N::constant(0.0); 3];
        let nothing = (dark, N::constant(0.0));
        if let Some(index) = spot.through {
            let through = finish.lobe_through(spot.normal, spot.viewer, towards, index, spot.anisotropy.as_ref());
            return through.map(|through| ByLamp { lobes: [through, nothing], more: dark });
        }
        let cosines = Cosines::new(spot.normal, spot.viewer, towards, spot.anisotropy.as_ref());
        let own = if finish.is_mirror() {
            nothing
        } else {
            (finish.lobe(spot.base, &cosines), lobe_density(finish.alpha, &cosines))
        };
        let coat = finish.coat.map_or(nothing, |coat| ([coat.lobe(&cosines); 3], coat.density(&cosines)));
        let mut more = dark;
        if self.lamps_are_baked() {
            // Baked light counts as light from all sides, which is not what a coat lets through from one.
            more = sub(finish.below(spot.base, &cosines), finish.below_evenly(spot.base, spot.out));
            more = scale(more, cosines.into.scaled(std::f64::consts::FRAC_1_PI));
        }
        Some(ByLamp { lobes: [own, coat], more })
    }

    /// Returns what a rough surface reflects of a point on the lamps.
    fn lit_by_lamp<N: Number>(
        &mut self,
        spot: &Spot<N>,
        finish: &Finish,
        point: &PatternPoint,
        (shares, path): (&Shares, &Path),
    ) -> Triple<N> {
        let dark = [N::constant(0.0); 3];
        let (lit, lamps) = (self.lit, &self.gloss.lamps);
        let (triangle, place) = lamps.point(&lit.scene.corners, point.square, shares);
        let surface = &lit.scene.surfaces[triangle as usize];
        let pose = &lit.view.poses[surface.frame as usize];
        let seen = pose.turned(vector::sub(place, pose.position));
        let way = sub(rated(seen, vector::add(pose.turning(seen), pose.drift())), spot.hit.point);
        let towards = unit(way);
        let facing = -dot(from_frame(pose, constant(normal_of(surface))), towards);
        if triangle == spot.hit.triangle || !spot.sees(towards) || facing.value() <= 0.0 {
            return dark;
        }
        let Some(ByLamp { lobes, more }) = self.by_lamp(spot, finish, towards) else { return dark };
        let by_lamps = dot(way, way).scaled(lamps.density(triangle, shares)) / facing;
        let mut reflected = scale(more, N::constant(1.0) / by_lamps);
        for (lobe, density) in lobes {
            reflected = add(reflected, scale(lobe, N::constant(1.0) / (by_lamps + density)));
        }
        if largest(values(reflected)) < NO_SHADOW || self.is_hidden(spot, values(way), self.to_lamps(), None) {
            return dark;
        }
        let left = path.left(|| dot(way, way).sqrt());
        times(times(scale(reflected, spot.fading(towards)), self.emitted(triangle)), left)
    }

    /// Returns whether the light of all lamps is in the maps, none of them being a few places that shine.
    fn lamps_are_baked(&self) -> bool {
        self.lit.lights.iter().all(|light| light.beam.is_none_or(|beam| beam.is_spot()))
    }

    /// Returns what a glass surface reflects and lets through.
    fn through_solid<N: Number>(&mut self, spot: &Spot<N>, index: f64, [path, behind]: [&Path; 2]) -> Triple<N> {
        let Some(finish) = spot.finish else { return spot.base };
        let index = if spot.hit.front { index } else { 1.0 / index };
        let reflected = dielectric(spot.out, index);
        let image = scale(constant(finish.tint), reflected);
        let mut sum = self.arriving(spot, spot.mirrored(), image, None, path);
        if let Some(towards) = refracted(spot.normal, spot.viewer, index) {
            let passed = (N::constant(1.0) - reflected).scaled(1.0 / (index * index));
            let passed = scale(constant(finish.passing), passed);
            sum = add(sum, self.arriving(spot, towards, passed, None, behind));
        }
        sum
    }

    /// Returns what the rough surface of a solid reflects, and what it lets through.
    fn of_rough_solid<N: Number>(
        &mut self,
        spot: &Spot<N>,
        finish: &Finish,
        index: f64,
        (surface, [path, path_behind]): (&Surface, [&Path; 2]),
    ) -> [Triple<N>; 2] {
        let index = if spot.hit.front { index } else { 1.0 / index };
        let finish = &Finish { fresnel: Fresnel::Dielectric(index), ..finish.clone() };
        let spot = &Spot { finish: Some(finish), ..*spot };
        // Of lights at a position or along a direction. Others are in the image.
        let near = Path { segments: 1, ..*path };
        let reflected = add(self.lit_by_all(spot, surface, &near), self.image(spot, finish, path));
        [reflected, self.passed(spot, finish, index, (surface, path_behind))]
    }

    /// Returns what is seen of a surface that is a mix: what it reflects, and what a part of it lets through. From behind it
    /// is that part alone.
    fn through_mix<N: Number>(
        &mut self,
        spot: &Spot<N>,
        finish: &Finish,
        (surface, path): (&Surface, &Path),
    ) -> Triple<N> {
        let Some((solid, index)) = finish.solid() else {
            return if spot.hit.front { self.reflected(spot, finish, (surface, path)) } else { [N::constant(0.0); 3] };
        };
        let root = each(spot.base, |colour| if colour.value() > 0.0 { colour.sqrt() } else { N::constant(0.0) });
        let through = &Spot { finish: Some(&solid), ..*spot };
        let [reflected, passed] = if spot.hit.front {
            let reflected = self.reflected(spot, finish, (surface, path));
            [reflected, self.passed(through, &solid, index, (surface, path))]
        } else {
            self.of_rough_solid(through, &solid, index, (surface, [path; 2]))
        };
        add(reflected, times(root, passed))
    }

    /// Returns what the rough surface of a solid lets through; `index` is that behind it, relative to the viewer's side.
    fn passed<N: Number>(
        &mut self,
        spot: &Spot<N>,
        finish: &Finish,
        index: f64,
        (surface, path_behind): (&Surface, &Path),
    ) -> Triple<N> {
        let behind = &Spot { through: Some(index), ..*spot };
        let mut sum = self.lit_by_all(behind, surface, &Path { segments: 1, ..*path_behind });
        let (points, each) = self.points(path_behind);
        let facets = SeenFacets::new(finish.alpha, spot.normal, spot.viewer, spot.anisotropy.as_ref());
        let shares = self.shares(behind, finish, path_behind);
        for number in points {
            let point = self.pattern.point(number);
            if let Some(towards) = facets.refracted(point.disk, index)
                && behind.sees(towards)
                && let Some((lobe, density)) =
                    finish.lobe_through(spot.normal, spot.viewer, towards, index, spot.anisotropy.as_ref())
            {
                let weight = scale(lobe, N::constant(each) / density);
                let path = &Path { point: Some(number), ..*path_behind };
                sum = add(sum, self.arriving(spot, towards, weight, Some((&|| density, shares.as_ref())), path));
            }
            if let Some(shares) = &shares {
                sum =
                    add(sum, scale(self.lit_by_lamp(behind, finish, point, (shares, path_behind)), N::constant(each)));
            }
        }
        sum
    }

    /// Returns what a thin sheet reflects and lets through, with all reflections between its sides.
    fn through_sheet<N: Number>(&mut self, spot: &Spot<N>, index: f64, path: &Path) -> Triple<N> {
        let Some(finish) = spot.finish else { return spot.base };
        let once = dielectric(spot.out, index);
        let reflected = once.scaled(2.0) / (N::constant(1.0) + once);
        let image = scale(constant(finish.tint), reflected);
        let passed = scale(constant(finish.passing), N::constant(1.0) - reflected);
        let behind = self.arriving(spot, negated(spot.viewer), passed, None, path);
        add(self.arriving(spot, spot.mirrored(), image, None, path), behind)
    }

    /// Returns what a diffuse surface reflects that covers a fraction of its area, and what is seen through the rest.
    fn blended<N: Number>(&mut self, spot: Spot<N>, surface: &Surface, opacity: f64, path: &Path) -> Triple<N> {
        let passed = [N::constant(1.0 - opacity); 3];
        let behind = self.arriving(&spot, negated(spot.viewer), passed, None, path);
        if !spot.hit.front && !surface.two_sided {
            return behind;
        }
        let diffuse = Spot { finish: None, ..spot };
        add(scale(self.lit_by_all(&diffuse, surface, path), N::constant(opacity)), behind)
    }

    /// Returns the light that arrives at a surface from a direction, times its weight there; `lobe` gives how densely a
    /// lobe's directions lie there, and says how points on lamps are dealt out, None where there is only one direction.
    fn arriving<N: Number>(
        &mut self,
        spot: &Spot<N>,
        towards: Triple<N>,
        weight: Triple<N>,
        lobe: Option<(&dyn Fn() -> N, Option<&Shares>)>,
        path: &Path,
    ) -> Triple<N> {
        let path = Path { segments: path.segments + 1, ..path.faded(weight) };
        if path.segments > self.longest() || path.weight < FAINT {
            return [N::constant(0.0); 3];
        }
        let light = match self.nearest(spot, towards) {
            None => self.background(towards, lobe.map(|(density, _)| density)),
            Some(triangle) => {
                let hit = self.hit_on(triangle, spot.hit.point, towards);
                let left = path.left(|| hit.distance);
                let mut light = self.emitted_by_texture(&hit);
                if hit.front {
                    let mut emitted = self.emitted(triangle);
                    if let Some((density, Some(shares))) = lobe {
                        let points = self.gloss.lamps.density(triangle, shares);
                        let facing = -dot(hit.plane, towards);
                        let by_lamps = hit.distance.squared().scaled(points) / facing;
                        let density = density();
                        emitted = scale(emitted, density / (density + by_lamps));
                    }
                    light = add(light, emitted);
                }
                if path.segments < self.longest() {
                    light = add(light, self.shaded(&hit, negated(towards), &path.faded(left)));
                }
                times(light, left)
            }
        };
        times(weight, light)
    }

    /// Returns the radiance of what a ray sees that hits nothing.
    fn background<N: Number>(&self, towards: Triple<N>, density: Option<&dyn Fn() -> N>) -> Triple<N> {
        let (lit, gloss) = (self.lit, self.gloss);
        let mut sum = [N::constant(0.0); 3];
        for (number, background) in gloss.backgrounds.iter().enumerate() {
            if *background != [0.0; 3] {
                let strength = lit.scene.lights[number].strength;
                sum = add(sum, scale(constant(*background), self.factor::<N>(number).scaled(strength)));
            }
        }
        if let Some(sky) = &gloss.sky {
            #[allow(clippy::cast_precision_loss, reason = "a small number")]
            let angle = density
                .map_or(N::constant(0.0), |density| N::constant(1.0) / density().scaled(self.pattern.len() as f64));
            let towards = into_frame(&lit.view.poses[0], towards);
            sum = add(sum, scale(sky.along(towards, angle), self.factor(sky.light as usize)));
        }
        sum
    }

    fn emitted<N: Number>(&self, triangle: u32) -> Triple<N> {
        match &self.lit.scene.surfaces[triangle as usize].emission {
            None => [N::constant(0.0); 3],
            Some(emission) => scale(constant(self.gloss.emitted(triangle)), self.factor(emission.light as usize)),
        }
    }

    /// Returns the radiance that a surface emits by its emissive texture, from either side.
    fn emitted_by_texture<N: Number>(&self, hit: &Hit<N>) -> Triple<N> {
        let surface = &self.lit.scene.surfaces[hit.triangle as usize];
        match self.gloss.emissive.at(surface.texture, surface.uv().each_ref(), hit.in_frame) {
            None => [N::constant(0.0); 3],
            Some((radiance, light)) => {
                let finish = self.gloss.finish(hit.triangle).map(|finish| self.finish_at(finish, surface, hit));
                let covered = match finish.as_deref() {
                    Some(Finish { under: Under::Blend(opacity), .. }) => *opacity,
                    _ => 1.0,
                };
                scale(radiance, self.factor::<N>(light as usize).scaled(covered))
            }
        }
    }

    /// Returns the factor on the strength of a light.
    fn factor<N: Number>(&self, light: usize) -> N {
        let [factor, rate] = self.lit.view.factors[light];
        N::new(factor, rate)
    }

    fn longest(&self) -> usize {
        self.gloss.longest.min(LONGEST)
    }

    /// Returns where on the way to a light shadow rays end.
    fn to_lamps(&self) -> f64 {
        let farthest = f64::from(self.lit.scene.farthest);
        farthest / (1.0 + farthest)
    }

    fn hit_on<N: Number>(&self, triangle: u32, origin: Triple<N>, direction: Triple<N>) -> Hit<N> {
        let surface = &self.lit.scene.surfaces[triangle as usize];
        let pose = &self.lit.view.poses[surface.frame as usize];
        let normal = constant(normal_of(surface));
        let (start, along) = (point_in_frame(pose, origin), into_frame(pose, direction));
        let height = dot(normal, start) + N::constant(surface.plane[3]);
        let approach = dot(normal, along);
        let distance = -height / approach;
        let front = approach.value() < 0.0;
        let plane = from_frame(pose, normal);
        Hit {
            triangle,
            point: add(origin, scale(direction, distance)),
            in_frame: add(start, scale(along, distance)),
            distance,
            plane: if front { plane } else { negated(plane) },
            front,
        }
    }

    /// Returns the unit shading normal on the viewer's side; the plane's, where the shading normal turns away. Where there is
    /// a normal texture, also what the normal is without that.
    fn normal<N: Number>(&self, hit: &Hit<N>, surface: &Surface, viewer: Triple<N>) -> (Triple<N>, Option<Triple<N>>) {
        let bumps = self.lit.scene.bumps(surface);
        if bumps.is_none() && surface.normal.is_none() {
            return (hit.plane, None);
        }
        let pose = &self.lit.view.poses[surface.frame as usize];
        let of_front = shading_normal(surface, hit.in_frame);
        let smooth = from_frame(pose, if hit.front { of_front } else { negated(of_front) });
        let to_viewer = pose.vector(values(viewer));
        let turned = bumps.map(|bumps| from_frame(pose, bumps.turned(hit.in_frame, of_front, (hit.front, to_viewer))));
        let faces = |normal: &Triple<N>| dot(*normal, viewer).value() > 1e-6;
        let normal = turned.filter(faces).or(Some(smooth).filter(faces)).unwrap_or(hit.plane);
        (normal, bumps.map(|_| smooth))
    }

    /// Returns the triangle that a ray from a surface meets first.
    fn nearest<N: Number>(&mut self, spot: &Spot<N>, towards: Triple<N>) -> Option<u32> {
        let origin = values(spot.hit.point);
        self.set_rays(origin, values(towards));
        let TracerScratch { rays, hits, .. } = &mut *self.scratch;
        let after = NEAREST * (largest(rays[0].origin) + largest(origin));
        let from = usize::from(self.lit.scene.is_free(spot.hit.triangle, rays[0].direction));
        hits.nearest(self.lit.scene, (rays, from), after, spot.hit.triangle)
    }

    /// Returns whether anything hides a light from a surface, along a vector of which `end` is the way to it. The light's
    /// number is given where it is one of the view's.
    fn is_hidden<N: Number>(&mut self, spot: &Spot<N>, along: Vector, end: f64, light: Option<usize>) -> bool {
        let scene = self.lit.scene;
        if !scene.shadows {
            return false;
        }
        let (point, plane) = (values(spot.hit.point), values(spot.hit.plane));
        let plane = if spot.through.is_some() { vector::scale(plane, -1.0) } else { plane };
        let in_world = self.lit.view.poses[0].point(point);
        let step = scene.step * (largest(in_world) + largest(point));
        let from = usize::from(match light {
            Some(light) => scene.is_lit(spot.hit.triangle, light),
            None => scene.is_free(spot.hit.triangle, self.lit.view.poses[0].vector(along)),
        });
        if !scene.has_shadows_from(from) {
            return false;
        }
        // Aimed anew from off the surface: the ray of the old direction would end that far beside the light.
        let off = vector::scale(plane, step);
        let way = if end.is_finite() { vector::sub(along, off) } else { along };
        self.set_rays(vector::add(point, off), way);
        let TracerScratch { rays, stack, .. } = &mut *self.scratch;
        is_blocked(scene, (rays, from), end, spot.hit.triangle, stack)
    }

    /// Brings a ray into all frames.
    fn set_rays(&mut self, origin: Vector, direction: Vector) {
        let poses = self.lit.view.poses.iter();
        self.scratch.rays.clear();
        let ray = |pose: &Pose| Ray { origin: pose.point(origin), direction: pose.vector(direction) };
        self.scratch.rays.extend(poses.map(ray));
    }
}

/// Returns the unit shading normal at a point in a surface's frame, on the front.
fn shading_normal<N: Number>(surface: &Surface, point: Triple<N>) -> Triple<N> {
    match surface.normal.as_deref() {
        None => constant(normal_of(surface)),
        Some([x, y, z]) => unit([at_map(x, point), at_map(y, point), at_map(z, point)]),
    }
}

fn normal_of(surface: &Surface) -> Vector {
    [surface.plane[0], surface.plane[1], surface.plane[2]]
}
