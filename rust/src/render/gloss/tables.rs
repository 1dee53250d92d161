//! What the renderer knows of glossy surfaces: tables that are checked once.
//!
//! What must not break: a scene without glossy surfaces has none of this, and is rendered as if it did not exist.

use super::emissive::{Emissive, EmissiveTextures};
use super::finish::Finish;
use super::lamp_groups::Lamp;
use super::lamps::Lamps;
use super::sky_levels::SkyLevels;
use crate::error::{Error, Result};
use crate::render::geometry::vector::Vector;
use crate::render::light::colours::TextureColours;
use crate::render::light::texture::{Texture, checked_layouts};

/// The number of its finish of a triangle that is diffuse.
pub const DIFFUSE: u32 = u32::MAX;

/// The glossy surfaces of a scene, and all of the scene in colour, because what they reflect is coloured.
#[derive(Clone, Debug, Default)]
pub struct GlossTables {
    /// How they reflect.
    pub finishes: Vec<Finish>,
    /// The finish of each triangle, [`DIFFUSE`] for none.
    pub finish_of: Vec<u32>,
    /// The texels of the scene's textures.
    pub texels: TextureColours,
    /// For each group of lights: what a strength of 1 is in red, green and blue.
    pub colours: Vec<[f64; 3]>,
    /// For each light: radiance of what a ray sees that hits nothing, for a strength of 1.
    pub backgrounds: Vec<[f64; 3]>,
    /// Radiance that each triangle emits from its front, for a factor of 1; empty where none does.
    pub emitted: Vec<[f64; 3]>,
    /// Radiance that surfaces emit by a texture.
    pub emissive: EmissiveTextures,
    /// The number of its light, the side and the texels (side^2) of an environment map on an octahedral map.
    pub sky: Option<(u32, usize, Vec<[f32; 3]>)>,
    /// How many segments a path of light has at most, from the camera on.
    pub longest: usize,
    /// Textures of roughness or metal, each in a frame of one texel, in the layout of the scene's textures.
    pub lobe_layouts: Vec<[i64; 4]>,
    /// Their texels.
    pub lobes: Vec<f32>,
}

/// The same, ready to be rendered; triangles in the order of the scene's.
#[derive(Debug)]
pub(crate) struct Gloss {
    finishes: Vec<Finish>,
    finish_of: Vec<u32>,
    pub(crate) texels: TextureColours,
    pub(crate) colours: Vec<[f64; 3]>,
    pub(crate) backgrounds: Vec<[f64; 3]>,
    emitted: Vec<[f64; 3]>,
    pub(crate) emissive: Emissive,
    pub(crate) sky: Option<SkyLevels>,
    pub(crate) lamps: Lamps,
    pub(crate) longest: usize,
    lobe_textures: Vec<Texture>,
    lobes: Vec<f32>,
}

/// What the tables are checked against: the scene that they belong to.
pub(crate) struct Owner<'a> {
    /// How many triangles its tables have.
    pub(crate) triangles: usize,
    /// Their textures, and in how many colours they have these.
    pub(crate) textures: &'a [Texture],
    pub(crate) groups: usize,
    pub(crate) lights: usize,
    /// The triangles that can be seen, in their order: their number in the tables, and corners.
    pub(crate) numbers: Vec<u32>,
    pub(crate) corners: &'a [[Vector; 3]],
    /// Those of them that emit.
    pub(crate) lamps: Vec<Lamp>,
}

impl Gloss {
    /// Checks the tables of a scene; None where they are empty.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for tables that do not belong together.
    pub(crate) fn new<'a>(tables: &GlossTables, owner: impl FnOnce() -> Owner<'a>) -> Result<Option<Self>> {
        if tables.finish_of.is_empty() {
            return Ok(None);
        }
        let owner = owner();
        for (name, expected, length) in [
            ("finish_of", owner.triangles, tables.finish_of.len()),
            ("colours", owner.groups, tables.colours.len()),
            ("backgrounds", owner.lights, tables.backgrounds.len()),
            ("emitted", if tables.emitted.is_empty() { 0 } else { owner.triangles }, tables.emitted.len()),
        ] {
            if expected != length {
                return Err(Error::Argument(format!("glossy surfaces need {expected} {name}, got {length}")));
            }
        }
        let finish = |&number: &u32| number == DIFFUSE || (number as usize) < tables.finishes.len();
        if let Some(number) = tables.finish_of.iter().find(|number| !finish(number)) {
            return Err(Error::Argument(format!("a triangle has finish {number} of {}", tables.finishes.len())));
        }
        tables.texels.check_sizes(owner.textures)?;
        tables.finishes.iter().try_for_each(Finish::check)?;
        let lobe_textures = checked_layouts(&tables.lobe_layouts, Some(tables.lobes.len()), 1)?;
        let textured = |finish: &Finish| finish.lobe.iter().flatten().all(|&n| (n as usize) < lobe_textures.len());
        if !tables.lobes.iter().all(|x| (0.0..=1.0).contains(x)) || !tables.finishes.iter().all(textured) {
            return Err(Error::Argument(format!(
                "textures of roughness and metal hold 0..1, and finishes have those of {}",
                lobe_textures.len()
            )));
        }
        let light = [&tables.colours, &tables.backgrounds, &tables.emitted];
        let wrong = light.into_iter().flatten().flatten().find(|x| !(x.is_finite() && **x >= 0.0));
        if wrong.is_some() {
            return Err(Error::Argument("colours of lights must be finite and not negative".to_owned()));
        }
        let sky = match &tables.sky {
            Some((light, ..)) if *light as usize >= owner.lights => {
                return Err(Error::Argument(format!("a sky has light {light} of {}", owner.lights)));
            }
            Some((light, side, texels)) => Some(SkyLevels::new(*light, *side, texels)?),
            None => None,
        };
        let numbers = || owner.numbers.iter().map(|&number| number as usize);
        Ok(Some(Self {
            finishes: tables.finishes.clone(),
            finish_of: numbers().map(|number| tables.finish_of[number]).collect(),
            texels: tables.texels.clone(),
            colours: tables.colours.clone(),
            backgrounds: tables.backgrounds.clone(),
            emitted: if tables.emitted.is_empty() {
                vec![]
            } else {
                numbers().map(|number| tables.emitted[number]).collect()
            },
            emissive: Emissive::new(&tables.emissive, owner.textures.len(), owner.lights)?,
            sky,
            lamps: Lamps::new(owner.corners, owner.lamps),
            longest: tables.longest,
            lobe_textures,
            lobes: tables.lobes.clone(),
        }))
    }

    /// Returns the finish of a triangle of the scene; None of a diffuse one.
    pub(crate) fn finish(&self, triangle: u32) -> Option<&Finish> {
        self.finishes.get(self.finish_of[triangle as usize] as usize)
    }

    /// Returns the number of the finish of a triangle; None of a diffuse one.
    pub(crate) fn finish_number(&self, triangle: u32) -> Option<u32> {
        Some(self.finish_of[triangle as usize]).filter(|&number| number != DIFFUSE)
    }

    /// Returns a texture of roughness or metal, and the texels of all.
    pub(crate) fn lobe(&self, number: u32) -> (&Texture, &[f32]) {
        (&self.lobe_textures[number as usize], &self.lobes)
    }

    /// Returns what a triangle emits from its front.
    pub(crate) fn emitted(&self, triangle: u32) -> [f64; 3] {
        self.emitted.get(triangle as usize).copied().unwrap_or_default()
    }
}
