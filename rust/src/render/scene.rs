//! A diffuse scene of triangles, as the renderer keeps it: made from tables that are checked once.
//!
//! Triangles are stored in the order of the BVH, and coordinates are relative to the centre of each frame, so
//! that float32 is accurate far from the origin too.
//!
//! What must not break: everything that later code takes for granted about the tables is checked in [`Scene::new`].

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::geometry::bvh::Bvh;
use super::geometry::vector::{Bounds, Vector, add, cross, dot, largest, sub};
use super::geometry::view::View;
use super::gloss::lamp_groups::Lamp;
use super::gloss::tables::{Gloss, GlossTables, Owner};
use super::light::beam::Beam;
use super::light::cone::Source;
use super::light::light_map::{Emission, LightMapTables, SideMap, SideMaps};
use super::light::normal_texture::{Bumps, NormalTextureTables, NormalTextures};
use super::light::sky::Sky;
use super::light::slide::{SeenSlide, Slide};
use super::light::texture::{self, Texture};
use super::visibility::unoccluded::{Still, Unoccluded};
use crate::error::{Error, Result};
use crate::prefetch::prefetch;
use crate::threads::SHARED;

/// A light map of so many texels is asked for as a whole before it is read. Of a larger one few are.
const SMALL_MAP: usize = 64;

/// Scenes of so many triangles are made ready on all threads.
const MANY: usize = 1 << 13;

/// What shines: where, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// From a position in the world, metres.
    Point([f64; 3]),
    /// Along a unit vector of the world, the way the light travels.
    Directional([f64; 3]),
    /// From all sides, never shadowed.
    Constant,
    /// As the light maps have it, in whose `texels` this is the number of its own.
    Baked(u32),
    /// On no surface: how bright baked area lights and skies look themselves.
    Visible,
}

impl LightKind {
    /// Returns where it shines from; None where it throws no shadows.
    pub(crate) fn source(&self) -> Option<Source> {
        match *self {
            Self::Point(position) => Some(Source::Point(position)),
            Self::Directional(along) => Some(Source::Directional(along.map(|x| -x))),
            Self::Constant | Self::Baked(_) | Self::Visible => None,
        }
    }
}

/// A light of one colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// What shines.
    pub kind: LightKind,
    /// Which of the scene's texels, weighted to luma for its colour, it falls on.
    pub group: u32,
    /// Intensity, irradiance or radiance of its strongest channel.
    pub strength: f64,
    /// Luma of a ray that hits nothing, for a strength of 1; 0 unless the light comes from there and is seen.
    pub background: f64,
    /// To which sides a light at a position shines; None where to all alike.
    pub beam: Option<Beam>,
    /// The number of the slide before a light at a position, and which of its planes this light takes; None without.
    pub slide: Option<(u32, u32)>,
}

/// A scene's tables, one entry a triangle where nothing else is said; each triangle in its own frame: that of the
/// world, or that of the body that it belongs to. What takes most memory may be borrowed.
#[derive(Clone, Debug, Default)]
pub struct SceneTables<'a> {
    /// Corners, metres.
    pub corners: Cow<'a, [[[f64; 3]; 3]]>,
    /// Unit normal n on the front and offset d of the plane n . p + d = 0.
    pub planes: Cow<'a, [[f64; 4]]>,
    /// The texture coordinate u of a point p: `map[..3] . p + map[3]`.
    pub u_maps: Cow<'a, [[f64; 4]]>,
    /// The texture coordinate v.
    pub v_maps: Cow<'a, [[f64; 4]]>,
    /// The shading normal before it is normalised, a map for each component; empty where every triangle is flat.
    pub normal_maps: Cow<'a, [[[f64; 4]; 3]]>,
    /// The number of its texture.
    pub textures: Vec<u32>,
    /// Whether the back reflects too.
    pub two_sided: Vec<bool>,
    /// Whether the back is culled: from behind, neither a camera nor a mirror sees the triangle, and both see what lies
    /// behind it. It throws shadows all the same. Empty where no triangle is so.
    pub culled: Vec<bool>,
    /// Whether the camera sees through the triangle, from either side. Mirrors see it, and it throws shadows. Empty where
    /// no triangle is so.
    pub hidden: Vec<bool>,
    /// The frame: 0 for what stands still in the world, 1, 2, ... for bodies.
    pub frames: Vec<u32>,
    /// How many frames there are.
    pub frame_count: usize,
    /// For each texture: first texel, width, height and wrap mode (0 repeat, 1 clamp, 2 mirror).
    pub layouts: Vec<[i64; 4]>,
    /// For each light colour all texels as luma; around each texture a frame of one texel, as its wrap mode has it.
    pub texels: Vec<Cow<'a, [f32]>>,
    /// Which way the texels of surfaces face.
    pub normal_textures: NormalTextureTables,
    /// Irradiance that was computed beforehand.
    pub light_maps: LightMapTables<'a>,
    /// What triangles emit; empty where none does.
    pub emissions: Vec<Option<Emission>>,
    /// The lights.
    pub lights: Vec<Light>,
    /// What lights throw on surfaces.
    pub slides: Vec<Arc<Slide>>,
    /// What rays see that hit nothing, in addition to the lights' backgrounds.
    pub sky: Option<Sky>,
    /// Surfaces that are not diffuse.
    pub gloss: GlossTables,
    /// Whether point and directional lights throw shadows.
    pub shadows: bool,
    /// The middle of what stands still: shadows are offset by the distance from it, see `step`.
    pub centre: [f64; 3],
    /// A shadow's ray starts off the surface by this fraction of (the point's largest distance from the centre along an
    /// axis, plus its depth).
    pub step: f64,
    /// What lies in this last fraction of the way to a point light throws no shadow.
    pub end: f64,
}

/// How a triangle's surface reflects.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    /// In the tables that the scene was made of.
    pub(crate) number: u32,
    pub(crate) plane: [f64; 4],
    /// Affine maps of a point to the texture coordinates; None where its textures are the same everywhere.
    pub(crate) uv: Option<Box<[[f64; 4]; 2]>>,
    /// None where the shading normal is the plane's.
    pub(crate) normal: Option<Box<[[f64; 4]; 3]>>,
    pub(crate) texture: u32,
    pub(crate) two_sided: bool,
    /// Whether its back is not seen.
    pub(crate) culled: bool,
    /// Whether the camera sees through it.
    pub(crate) hidden: bool,
    pub(crate) frame: u32,
    /// Of the front and the back; None where no light is baked.
    pub(crate) light_maps: Option<Box<[SideMap; 2]>>,
    /// From the front.
    pub(crate) emission: Option<Box<Emission>>,
}

impl Surface {
    /// Returns whether a camera at this height above the plane cannot see the triangle: it is hidden from cameras, or the
    /// camera is at its side, or behind it where its back is culled.
    #[inline]
    pub(crate) fn is_hidden(&self, height: f64) -> bool {
        self.hidden || height == 0.0 || self.culled && height < 0.0
    }

    /// Returns the affine maps of a point to the texture coordinates u and v.
    pub(crate) fn uv(&self) -> &[[f64; 4]; 2] {
        self.uv.as_deref().unwrap_or(&[[0.0; 4]; 2])
    }
}

/// What stands still in one frame: triangles side by side, and the BVH over them.
#[derive(Debug)]
pub(crate) struct Frame {
    /// What was taken from all of its coordinates, so that they are small.
    pub(crate) centre: Vector,
    pub(crate) triangles: Range<usize>,
    pub(crate) bvh: Bvh,
}

/// A scene, ready to be rendered. Coordinates are those of each frame less its centre.
#[derive(Debug)]
pub struct Scene {
    pub(crate) frames: Vec<Frame>,
    pub(crate) corners: Vec<[Vector; 3]>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) textures: Vec<Texture>,
    /// Each with the one after it.
    pub(crate) texels: Vec<Vec<u64>>,
    pub(crate) normal_textures: NormalTextures,
    /// Of the light maps, for each baked light.
    pub(crate) irradiance: Vec<Vec<u64>>,
    /// Of the maps of irradiance vectors, likewise, for x, y and z.
    pub(crate) irradiance_vectors: Vec<[Vec<u64>; 3]>,
    pub(crate) lights: Vec<Light>,
    pub(crate) slides: Vec<Arc<Slide>>,
    pub(crate) sky: Option<Sky>,
    /// None where all surfaces are diffuse.
    pub(crate) gloss: Option<Gloss>,
    pub(crate) shadows: bool,
    pub(crate) step: f64,
    /// How many times farther from the surface than from the light an occluder may lie.
    pub(crate) farthest: f32,
    pub(super) unoccluded: Unoccluded,
}

impl Scene {
    /// Checks the tables and orders the triangles.
    ///
    /// Triangles without area, or with a corner that is not finite, are never hit, and left out.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for tables that do not belong together.
    pub fn new(tables: &SceneTables) -> Result<Self> {
        let textures = texture::checked(&tables.layouts, tables.texels.iter().map(|group| group.iter()))?;
        check(tables)?;
        let light_maps = tables.light_maps.checked(tables.corners.len())?;
        let normal_textures = NormalTextures::new(&tables.normal_textures, textures.len())?;
        let mut scene = Self {
            frames: vec![],
            corners: Vec::with_capacity(tables.corners.len()),
            surfaces: Vec::with_capacity(tables.corners.len()),
            textures,
            texels: tables.texels.iter().map(|group| texture::paired_in_a_row(group)).collect(),
            normal_textures,
            irradiance: tables.light_maps.texels.iter().map(|map| texture::paired(map.iter())).collect(),
            irradiance_vectors: {
                let vectors = tables.light_maps.vectors.texels.iter();
                vectors.map(|axes| axes.map(|map| texture::paired(map.iter()))).collect()
            },
            lights: tables.lights.clone(),
            slides: tables.slides.clone(),
            sky: tables.sky.clone(),
            gloss: None,
            shadows: tables.shadows,
            step: tables.step,
            #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
            farthest: ((1.0 - tables.end) / tables.end) as f32,
            unoccluded: Unoccluded::default(),
        };
        for light in &mut scene.lights {
            if let LightKind::Point(position) = &mut light.kind {
                *position = sub(*position, tables.centre);
            }
        }
        let mut push_frames = |parallel: bool| {
            for frame in 0..tables.frame_count {
                let members: Vec<usize> = (0..tables.corners.len())
                    .filter(|&i| tables.frames[i] as usize == frame && has_area(&tables.corners[i]))
                    .collect();
                scene.push_frame(tables, &light_maps, frame, &members, parallel);
            }
        };
        // Threads are started for no scene that is ready before they are.
        if tables.corners.len() < MANY {
            push_frames(false);
        } else {
            SHARED.pool()?.install(|| push_frames(true));
        }
        scene.gloss = Gloss::new(&tables.gloss, || scene.owner_of_gloss(tables.corners.len()))?;
        let source = |light: &Light| light.kind.source().filter(|_| scene.shadows);
        let lights = scene.lights_in_order().into_iter().map(source).collect();
        scene.unoccluded = Unoccluded::new(scene.frames[0].triangles.len(), lights, scene.gloss.is_some());
        Ok(scene)
    }

    /// Returns the lights in the order of their colours, as those that are seen.
    pub(crate) fn lights_in_order(&self) -> Vec<&Light> {
        let mut lights: Vec<_> = self.lights.iter().collect();
        lights.sort_by_key(|light| light.group);
        lights
    }

    /// Returns whether triangles of a frame, or of those after it, throw shadows.
    pub(crate) fn has_shadows_from(&self, frame: usize) -> bool {
        self.shadows && self.frames[frame..].iter().any(|frame| !frame.triangles.is_empty())
    }

    /// Returns whether nothing that stands still lies between a triangle that does, too, and a light, given its number
    /// among those that are seen; true also where the light is nowhere, so that nothing can.
    #[inline]
    pub(crate) fn is_lit(&self, triangle: u32, light: usize) -> bool {
        self.unoccluded.is_lit(self.still(), triangle as usize, light)
    }

    /// Returns whether no ray from a triangle that stands still hits another one that does in about a direction of the
    /// world.
    #[inline]
    pub(crate) fn is_free(&self, triangle: u32, direction: Vector) -> bool {
        self.unoccluded.is_free(self.still(), triangle as usize, direction)
    }

    fn still(&self) -> Still<'_> {
        Still { bvh: &self.frames[0].bvh, corners: &self.corners[self.frames[0].triangles.clone()] }
    }

    fn push_frame(
        &mut self,
        tables: &SceneTables,
        light_maps: &SideMaps<'_>,
        frame: usize,
        members: &[usize],
        parallel: bool,
    ) {
        let bounds = members.iter().map(|&i| Bounds::of(&tables.corners[i]));
        let centre = if frame == 0 {
            tables.centre
        } else if members.is_empty() {
            [0.0; 3]
        } else {
            bounds.clone().fold(Bounds::NONE, |all, b| all.with(&b)).centre()
        };
        let own = bounds.map(|b| Bounds { low: sub(b.low, centre), high: sub(b.high, centre) });
        let (bvh, order) = Bvh::new(own, parallel);
        let first = self.corners.len();
        let corners = |at: &u32| tables.corners[members[*at as usize]].map(|corner| sub(corner, centre));
        let (textures, normal_textures) = (&self.textures, &self.normal_textures);
        let surface = |at: &u32| {
            let i = members[*at as usize];
            let moved = |map: [f64; 4]| about(centre, map);
            let plane = moved(tables.planes[i]);
            let normal = tables.normal_maps.get(i).map(|maps| maps.map(moved)).filter(|maps| is_smooth(maps, &plane));
            Surface {
                #[allow(clippy::cast_possible_truncation, reason = "there are fewer triangles than 2^32")]
                number: i as u32,
                plane,
                uv: (!textures[tables.textures[i] as usize].is_constant()
                    || normal_textures.of(tables.textures[i]).is_some())
                .then(|| Box::new([moved(tables.u_maps[i]), moved(tables.v_maps[i])])),
                normal: normal.map(Box::new),
                texture: tables.textures[i],
                two_sided: tables.two_sided[i],
                culled: tables.culled.get(i).is_some_and(|culled| *culled),
                hidden: tables.hidden.get(i).is_some_and(|hidden| *hidden),
                #[allow(clippy::cast_possible_truncation, reason = "it came as u32")]
                frame: frame as u32,
                light_maps: light_maps
                    .of(i)
                    .map(|sides| Box::new(sides.map(|side| SideMap { u: moved(side.u), v: moved(side.v), ..side }))),
                emission: tables.emissions.get(i).copied().flatten().map(Box::new),
            }
        };
        if parallel {
            self.corners.par_extend(order.par_iter().map(corners));
            self.surfaces.par_extend(order.par_iter().map(surface));
        } else {
            self.corners.extend(order.iter().map(corners));
            self.surfaces.extend(order.iter().map(surface));
        }
        self.frames.push(Frame { centre, triangles: first..self.corners.len(), bvh });
    }

    fn owner_of_gloss(&self, triangles: usize) -> Owner<'_> {
        Owner {
            triangles,
            textures: &self.textures,
            groups: self.texels.len(),
            lights: self.lights.len(),
            numbers: self.surfaces.iter().map(|surface| surface.number).collect(),
            corners: &self.corners,
            lamps: self.lamps().collect(),
        }
    }

    /// Returns the triangles that emit.
    fn lamps(&self) -> impl Iterator<Item = Lamp> {
        self.surfaces.iter().zip(0..).filter_map(|(surface, triangle)| {
            let Emission { light, luma } = **surface.emission.as_ref()?;
            let [x, y, z, _] = surface.plane;
            Some(Lamp { triangle, frame: surface.frame, light, normal: [x, y, z], luma })
        })
    }

    /// Returns the slide before a light; `turned` gives a vector of the world in the axes that are wanted, and its rate.
    pub(crate) fn slide(&self, light: &Light, turned: impl Fn(Vector) -> [Vector; 2]) -> Option<SeenSlide> {
        let (number, plane) = light.slide.map(|(number, plane)| (number as usize, plane as usize))?;
        Some(SeenSlide { number, plane, rows: self.slides[number].rows(turned) })
    }

    /// Asks for the corners and planes of triangles before they are read.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn prefetch_triangles(&self, triangles: Range<usize>) {
        prefetch(&self.corners[triangles.clone()]);
        for surface in &self.surfaces[triangles] {
            prefetch(std::slice::from_ref(&surface.plane));
        }
    }

    /// Asks for what the glossy ones among some triangles are shaded by, before it is read.
    pub(crate) fn prefetch_glossy(&self, triangles: impl Iterator<Item = u32> + Clone) {
        if self.gloss.is_none() {
            return;
        }
        let glossy = triangles.filter(|&triangle| self.is_glossy(triangle));
        for triangle in glossy.clone() {
            prefetch(std::slice::from_ref(&self.surfaces[triangle as usize]));
            self.unoccluded.prefetch(triangle as usize);
        }
        for triangle in glossy.clone() {
            let Surface { normal, light_maps, .. } = &self.surfaces[triangle as usize];
            prefetch(normal.as_deref().map_or(&[], <[_; 3]>::as_slice));
            prefetch(light_maps.as_deref().map_or(&[], <[_; 2]>::as_slice));
        }
        for triangle in glossy {
            for side in self.surfaces[triangle as usize].light_maps.iter().flat_map(|sides| sides.iter()) {
                let texels = side.texture.all();
                if texels.len() <= SMALL_MAP {
                    self.irradiance.iter().for_each(|map| prefetch(&map[texels.clone()]));
                }
            }
        }
    }

    /// Returns whether a triangle of the scene is shaded by [`gloss`](super::gloss), not as a diffuse one.
    pub(crate) fn is_glossy(&self, triangle: u32) -> bool {
        self.gloss.as_ref().is_some_and(|gloss| gloss.finish(triangle).is_some())
    }

    /// Returns what turns the normals of one of its surfaces; None where nothing does.
    pub(crate) fn bumps<'a>(&'a self, surface: &'a Surface) -> Option<Bumps<'a>> {
        self.normal_textures.on(surface.texture, surface.uv(), &surface.plane)
    }

    /// Returns a view with the camera where it is in the frames less their centres.
    pub(crate) fn centred(&self, view: &View) -> View {
        let mut view = view.clone();
        for (pose, frame) in view.poses.iter_mut().zip(&self.frames) {
            pose.position = sub(pose.position, frame.centre);
        }
        view
    }

    /// Returns how many triangles can be seen.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.corners.len()
    }

    /// Returns how many frames there are: the world's, and one for each body.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Returns how many lights there are.
    #[must_use]
    pub fn lights(&self) -> usize {
        self.lights.len()
    }

    /// Returns whether point and directional lights throw shadows.
    #[must_use]
    pub fn shadows(&self) -> bool {
        self.shadows
    }
}

/// Returns whether a triangle can be hit: its corners are finite, and it has an area.
pub(crate) fn has_area(corners: &[Vector; 3]) -> bool {
    let [a, b, c] = *corners;
    let normal = cross(sub(b, a), sub(c, a));
    largest(normal) > 0.0 && largest(normal).is_finite() && corners.iter().flatten().all(|x| x.is_finite())
}

/// Returns an affine map of points for points that are given less a centre.
pub(crate) fn about(centre: Vector, map: [f64; 4]) -> [f64; 4] {
    let [x, y, z, offset] = map;
    [x, y, z, offset + dot([x, y, z], centre)]
}

/// Returns whether the shading normal is another than the plane's.
pub(crate) fn is_smooth(maps: &[[f64; 4]; 3], plane: &[f64; 4]) -> bool {
    maps.iter().zip(plane).any(|(map, n)| map[..3] != [0.0; 3] || (map[3] - n).abs() > 1e-6)
}

fn check(tables: &SceneTables) -> Result<()> {
    let n = tables.corners.len();
    let refuse = |message: String| Err(Error::Argument(message));
    for (name, length) in [
        ("planes", tables.planes.len()),
        ("u_maps", tables.u_maps.len()),
        ("v_maps", tables.v_maps.len()),
        ("textures", tables.textures.len()),
        ("two_sided", tables.two_sided.len()),
        ("culled", if tables.culled.is_empty() { n } else { tables.culled.len() }),
        ("hidden", if tables.hidden.is_empty() { n } else { tables.hidden.len() }),
        ("frames", tables.frames.len()),
        ("emissions", if tables.emissions.is_empty() { n } else { tables.emissions.len() }),
        ("normal_maps", if tables.normal_maps.is_empty() { n } else { tables.normal_maps.len() }),
    ] {
        if length != n {
            return refuse(format!("{n} triangles need as many {name}, got {length}"));
        }
    }
    if n >= 1 << 30 {
        return refuse(format!("a scene has fewer than 2^30 triangles, got {n}"));
    }
    if let Some(texture) = tables.textures.iter().find(|&&t| t as usize >= tables.layouts.len()) {
        return refuse(format!("a triangle has texture {texture} of {}", tables.layouts.len()));
    }
    if let Some(frame) = tables.frames.iter().find(|&&f| f as usize >= tables.frame_count) {
        return refuse(format!("a triangle has frame {frame} of {}", tables.frame_count));
    }
    if tables.frame_count == 0 {
        return refuse("a scene has at least the world's frame, got 0".to_owned());
    }
    for light in &tables.lights {
        let vector = match light.kind {
            LightKind::Point(vector) | LightKind::Directional(vector) => vector,
            LightKind::Constant | LightKind::Baked(_) | LightKind::Visible => [0.0; 3],
        };
        let finite = add(vector, [light.strength, light.background, 0.0]).iter().all(|x| x.is_finite());
        if light.group as usize >= tables.texels.len() || !finite {
            return refuse(format!("lights are finite and of one of {} colours, got {light:?}", tables.texels.len()));
        }
        let in_a_place = matches!(light.kind, LightKind::Point(_));
        if light.beam.is_some_and(|beam| !in_a_place || !beam.is_valid()) {
            return refuse(format!(
                "a beam is that of a light at a position, and 0 <= full < cutoff <= pi, got {light:?}"
            ));
        }
        let there = |(number, plane): (u32, u32)| {
            tables.slides.get(number as usize).is_some_and(|slide| (plane as usize) < slide.planes())
        };
        if light.slide.is_some_and(|slide| !in_a_place || !there(slide)) {
            return refuse(format!(
                "a slide is that of a light at a position, and one of {}, got {light:?}",
                tables.slides.len()
            ));
        }
    }
    if let Some(sky) = &tables.sky {
        sky.check(tables.lights.len())?;
    }
    for light in &tables.lights {
        if let LightKind::Baked(number) = light.kind
            && number as usize >= tables.light_maps.texels.len()
        {
            return refuse(format!("a light is baked map {number} of {}", tables.light_maps.texels.len()));
        }
    }
    if let Some(one) = tables.emissions.iter().flatten().find(|one| one.light as usize >= tables.lights.len()) {
        return refuse(format!("a triangle emits light {} of {}", one.light, tables.lights.len()));
    }
    if let Some(one) = tables.emissions.iter().flatten().find(|one| !(one.luma >= 0.0 && one.luma.is_finite())) {
        return refuse(format!("the emission of a triangle must be finite and not negative, got {}", one.luma));
    }
    if !(tables.step >= 0.0 && tables.end > 0.0 && tables.end < 1.0 && largest(tables.centre).is_finite()) {
        return refuse(format!(
            "shadows need step >= 0, 0 < end < 1 and a finite centre, got {}, {} and {:?}",
            tables.step, tables.end, tables.centre
        ));
    }
    Ok(())
}
