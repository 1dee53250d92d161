//! Radiance that surfaces emit by a texture, in colour.
//!
//! A camera sees it as luma of constant light, in [`light`](crate::render::light); this is what mirrors and metal show
//! of it, and what these emit themselves.
//!
//! What must not break: it is emitted from both sides, and looked up where the surface's own texture is.

use super::lookup::looked_up;
use super::number::{Number, Triple};
use crate::error::{Error, Result};
use crate::render::light::texture::{Texture, checked_layouts};

/// The number of its emissive texture of a texture whose surfaces emit nothing.
pub const DARK: u32 = u32::MAX;

/// The emissive textures of a scene.
#[derive(Clone, Debug, Default)]
pub struct EmissiveTextures {
    /// For each texture of the scene the number of the emissive one on the same surfaces, [`DARK`] for none; empty
    /// where there are none.
    pub of_texture: Vec<u32>,
    /// Where each lies among the texels, as textures of the scene do.
    pub layouts: Vec<[i64; 4]>,
    /// The number of the light whose factor each has.
    pub lights: Vec<u32>,
    /// Radiance, each texture in a frame of one texel.
    pub texels: Vec<[f32; 3]>,
}

/// The same, checked.
#[derive(Debug)]
pub(crate) struct Emissive {
    of_texture: Vec<u32>,
    textures: Vec<Texture>,
    lights: Vec<u32>,
    texels: Vec<[f32; 3]>,
}

impl Emissive {
    /// Checks the emissive textures of a scene of so many textures and lights.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for what does not belong together, and for radiance that is not finite. Texels may be negative
    /// where a bilinear lookup is not, as those beyond the edge of a triangle.
    pub(crate) fn new(tables: &EmissiveTextures, scene_textures: usize, scene_lights: usize) -> Result<Self> {
        let textures = checked_layouts(&tables.layouts, Some(tables.texels.len()), 1)?;
        let known = |&number: &u32| number == DARK || (number as usize) < textures.len();
        let light_is_known = |&light: &u32| (light as usize) < scene_lights;
        if ![0, scene_textures].contains(&tables.of_texture.len())
            || !tables.of_texture.iter().all(known)
            || tables.lights.len() != textures.len()
            || !tables.lights.iter().all(light_is_known)
        {
            return Err(Error::Argument(format!(
                "{} emissive textures of {} lights do not belong to a scene of {scene_textures} textures and \
                 {scene_lights} lights",
                textures.len(),
                tables.lights.len()
            )));
        }
        if tables.texels.iter().flatten().any(|x| !(x.is_finite())) {
            return Err(Error::Argument("radiance of emissive textures must be finite".to_owned()));
        }
        Ok(Self {
            of_texture: tables.of_texture.clone(),
            textures,
            lights: tables.lights.clone(),
            texels: tables.texels.clone(),
        })
    }

    /// Returns the radiance that a surface with a texture of the scene emits at a point, and the number of its light.
    pub(crate) fn at<N: Number>(&self, texture: u32, uv: [&[f64; 4]; 2], point: Triple<N>) -> Option<(Triple<N>, u32)> {
        let number = *self.of_texture.get(texture as usize)? as usize;
        let own = self.textures.get(number)?;
        let radiance = looked_up(own, own.wrap, uv, point, |at| self.texels[at].map(f64::from));
        Some((radiance, self.lights[number]))
    }
}
