//! Shaders: triangles as a camera sees them, set up once per view in float64.
//!
//! [`super::shade`] then computes the luma of their rays in float32.

use std::f64::consts::FRAC_1_PI;

use super::affine::{Affine, Changing, Map, coordinate, turned_map};
use super::beam::SeenBeam;
use super::bumps::{SeenBumps, Source};
use super::light_map::SideMap;
use super::lights::{SeenKind, SeenLight, Surroundings};
use super::slide::SeenSlide;
use super::texture::{Texture, Wrap};
use crate::render::geometry::linear::Linear;
use crate::render::geometry::vector::{Vector, dot, single};
use crate::render::geometry::view::Pose;
use crate::render::scene::Scene;
use crate::render::visibility::bins::Seen;

/// How a light falls on a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) enum Falls {
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
    pub(super) fn position(&self) -> Option<([f32; 3], [f32; 3])> {
        match *self {
            Self::From { position, position_rate, .. } | Self::FromOnSmooth { position, position_rate, .. } => {
                Some((position, position_rate))
            }
            _ => None,
        }
    }

    /// Returns where it comes from, on a surface whose normal changes.
    pub(super) fn source(&self) -> Option<Source> {
        match *self {
            Self::FromOnSmooth { position, position_rate: rate, .. } => {
                Some(Source { position, rate, is_direction: false })
            }
            Self::AlongOnSmooth { towards: position, towards_rate: rate, .. } => {
                Some(Source { position, rate, is_direction: true })
            }
            Self::Evenly { .. } | Self::From { .. } | Self::Baked { .. } => None,
        }
    }
}

/// A light on a triangle: its colour, its number among the view's lights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lit<'a> {
    pub(super) falls: Falls,
    pub(super) group: usize,
    pub(super) light: usize,
    pub(super) beam: Option<SeenBeam>,
    pub(super) slide: Option<&'a SeenSlide>,
}

/// A triangle as a camera sees it.
#[derive(Debug)]
pub(crate) struct Shader<'a> {
    /// The triangle's number in the scene.
    pub(crate) triangle: u32,
    pub(super) scene: &'a Scene,
    pub(super) texture: &'a Texture,
    pub(super) inverse_depth: Changing,
    pub(super) u: Affine,
    pub(super) v: Affine,
    pub(super) smooth: Option<[Affine; 3]>,
    /// What turns the normal; None where nothing does.
    pub(super) bumpy: Option<Box<SeenBumps<'a>>>,
    /// Of the side that is seen.
    pub(super) light_map: Option<LightMap<'a>>,
    /// Luma that the side emits, and its rate.
    pub(super) emitted: (f32, f32),
    pub(super) two_sided: bool,
    pub(super) lit: Vec<Lit<'a>>,
    /// Whether all of it is black.
    pub(crate) dark: bool,
}

impl<'a> Shader<'a> {
    /// Returns a diffuse triangle as a view sees it.
    fn new(surroundings: &Surroundings<'a>, seen: &Seen) -> Self {
        let scene = surroundings.scene;
        let mut shader = Self {
            triangle: seen.triangle,
            scene,
            texture: &scene.textures[0],
            inverse_depth: Changing::ZERO,
            u: Affine::ZERO,
            v: Affine::ZERO,
            smooth: None,
            bumpy: None,
            light_map: None,
            emitted: (0.0, 0.0),
            two_sided: false,
            lit: vec![],
            dark: true,
        };
        shader.become_of(surroundings, seen);
        shader
    }

    /// Becomes that of another triangle, in place: to make a new one and to move it here takes longer.
    fn become_of(&mut self, surroundings: &Surroundings<'a>, seen: &Seen) {
        let Surroundings { scene, view, lights, .. } = *surroundings;
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
        self.smooth = surface.normal.as_ref().map(|maps| {
            // The map's components along the frame's axes, turned into camera axes.
            let rows = maps.map(|map| Map::new(&map, pose));
            std::array::from_fn(|i| turned_map(&rows, pose, i))
        });
        [self.u, self.v] = if texture.is_constant() {
            [Affine::ZERO; 2]
        } else {
            surface.uv().map(|map| coordinate(&map, pose, texture.wrap))
        };
        // The normal n points at the camera where n . p + d > 0 at its position p.
        let facing = if plane.height < 0.0 { -1.0 } else { 1.0 };
        self.bumpy = scene.bumps(surface).map(|bumps| {
            let towards = if facing > 0.0 { 1.0 } else { -1.0 };
            Box::new(SeenBumps::new(bumps, pose, [plane.normal, plane.normal_rate], towards))
        });
        self.triangle = seen.triangle;
        self.texture = texture;
        self.inverse_depth = Changing {
            now: seen.inverse_depth,
            rate: Linear(single(std::array::from_fn(|i| {
                (plane.normal[i] * plane.height_rate / plane.height - plane.normal_rate[i]) / plane.height
            }))),
        };
        self.light_map = surface
            .light_maps
            .as_deref()
            .map(|[front, back]| LightMap::new(if facing > 0.0 || !surface.two_sided { front } else { back }, pose));
        self.two_sided = surface.two_sided;
        // Glossy triangles are shaded elsewhere.
        let glossy = scene.is_glossy(seen.triangle);
        self.emitted = match &surface.emission {
            Some(emission) if facing > 0.0 && !glossy => emitted(emission.luma, view.factors[emission.light as usize]),
            _ => (0.0, 0.0),
        };
        self.lit.clear();
        let one_normal = self.smooth.is_none() && self.bumpy.is_none();
        self.dark = one_normal && facing < 0.0 && !surface.two_sided;
        if !self.dark {
            self.lit.extend(lights.iter().enumerate().filter_map(|(number, light)| {
                let falls = if one_normal { plane.lit_by(light, facing) } else { on_smooth(light) };
                let (beam, slide) = (light.beam, light.slide.as_ref());
                Some(Lit { falls: falls?, group: light.group, light: number, beam, slide })
            }));
            self.dark = self.lit.is_empty() && surface.emission.is_none();
        }
    }

    /// Returns whether a light of this number falls on it.
    pub(crate) fn lit_by(&self, light: usize) -> bool {
        self.lit.iter().any(|lit| lit.light == light)
    }

    /// Returns whether nothing that stands still lies between it and any light that falls on it.
    pub(crate) fn is_unoccluded(&self) -> bool {
        self.lit.iter().all(|lit| self.scene.is_lit(self.triangle, lit.light))
    }
}

/// The triangles that a tile sees, ready to be shaded, in the order of its list.
///
/// A tile mostly sees what its neighbour saw, so those of the tile before are taken where they are known. The others are
/// overwritten, because to give memory back and to ask for it again for each takes longer than to set it up.
#[derive(Debug, Default)]
pub(crate) struct Shaders<'a> {
    /// Those of the tile, and then others that are known or may be overwritten.
    all: Vec<Shader<'a>>,
    used: usize,
}

/// Among more triangles than this none is looked for.
const FEW: usize = 8;

impl<'a> Shaders<'a> {
    /// Sets up the triangles of a tile, which is of the same view as the one before.
    pub(crate) fn set_up<'s>(
        &mut self,
        surroundings: &Surroundings<'a>,
        triangles: impl ExactSizeIterator<Item = &'s Seen>,
    ) {
        self.used = triangles.len();
        let few = self.used <= FEW;
        for (at, seen) in triangles.enumerate() {
            let mut known = self.all.iter().skip(at).take(if few { FEW } else { 0 });
            if let Some(ahead) = known.position(|shader| shader.triangle == seen.triangle) {
                self.all.swap(at, at + ahead);
                continue;
            }
            // What stands here may be seen by this tile, too, so the last of those that are known goes.
            let place = if few { at + FEW - 1 } else { at }.min(self.all.len());
            if let Some(shader) = self.all.get_mut(place) {
                shader.become_of(surroundings, seen);
            } else {
                self.all.push(Shader::new(surroundings, seen));
            }
            if place != at {
                self.all.swap(at, place);
            }
        }
    }
}

impl<'a> std::ops::Deref for Shaders<'a> {
    type Target = [Shader<'a>];

    fn deref(&self) -> &[Shader<'a>] {
        &self.all[..self.used]
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
pub(super) struct LightMap<'a> {
    pub(super) texture: &'a Texture,
    /// That of irradiance vectors.
    pub(super) vectors: Option<&'a Texture>,
    pub(super) u: Affine,
    pub(super) v: Affine,
    /// The axes of the triangle's frame in camera axes, each with its rate.
    pub(super) axes: [[[f32; 3]; 2]; 3],
}

impl<'a> LightMap<'a> {
    fn new(side: &'a SideMap, pose: &Pose) -> Self {
        let (u, v) = (coordinate(&side.u, pose, Wrap::Clamp), coordinate(&side.v, pose, Wrap::Clamp));
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| {
            let turned = pose.turned(axis);
            [single(turned), single(pose.turning(turned))]
        });
        Self { texture: &side.texture, vectors: side.vectors.as_ref(), u, v, axes }
    }
}
