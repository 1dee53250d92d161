//! Light maps: irradiance that was computed beforehand, for each side of each triangle, looked up like a texture.
//!
//! They are stored as textures are, so that bilinear lookup serves for both.
//!
//! What must not break: the layout of the tables, which Python fills, and the frame of one texel around each map.

use super::texture::{self, Texture};
use crate::error::{Error, Result};

/// Irradiance on surfaces, as tables; empty where no light is baked.
#[derive(Clone, Debug, Default)]
pub struct LightMapTables {
    /// For the front and the back of each triangle, one after the other: coordinates u and v in its map of a point p:
    /// `map[..3] . p + map[3]`.
    pub uv_maps: Vec<[[f64; 4]; 2]>,
    /// For the front and the back of each triangle: first texel, width, height and wrap mode, as those of textures.
    pub layouts: Vec<[i64; 4]>,
    /// For each baked light all texels as irradiance / pi for a strength of 1, with a frame of one texel around each
    /// map.
    pub texels: Vec<Vec<f32>>,
}

/// What a triangle emits from its front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Which of the scene's lights it belongs to.
    pub light: u32,
    /// Luma for a factor of 1 on that light.
    pub luma: f64,
}

/// The map of one side of a triangle.
#[derive(Clone, Debug)]
pub(crate) struct SideMap {
    pub(crate) u: [f64; 4],
    pub(crate) v: [f64; 4],
    pub(crate) texture: Texture,
}

impl LightMapTables {
    /// Returns the maps of the front and the back of each of `triangles` triangles; none where there are no tables.
    pub(crate) fn checked(&self, triangles: usize) -> Result<Vec<[SideMap; 2]>> {
        if self.layouts.is_empty() && self.uv_maps.is_empty() && self.texels.is_empty() {
            return Ok(vec![]);
        }
        if self.layouts.len() != 2 * triangles || self.uv_maps.len() != 2 * triangles {
            return Err(Error::Argument(format!(
                "{triangles} triangles need two light maps each, got {} layouts and {} uv_maps",
                self.layouts.len(),
                self.uv_maps.len()
            )));
        }
        let maps: Vec<SideMap> = texture::checked(&self.layouts, &self.texels)?
            .into_iter()
            .zip(&self.uv_maps)
            .map(|(texture, &[u, v])| SideMap { u, v, texture })
            .collect();
        Ok(maps.as_chunks::<2>().0.to_vec())
    }
}
