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
    /// The same for maps of irradiance vectors, where normal textures turn surfaces.
    pub vectors: VectorMapTables,
}

/// The part along the surface of irradiance vectors / pi, as tables; empty where no surface needs it.
#[derive(Clone, Debug, Default)]
pub struct VectorMapTables {
    /// As [`LightMapTables::layouts`]. Of surfaces that do not need it those of another one.
    pub layouts: Vec<[i64; 4]>,
    /// For each baked light, and of it for x, y and z in the triangle's frame, all texels for a strength of 1.
    pub texels: Vec<[Vec<f32>; 3]>,
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
    /// Where its irradiance vectors are; None where there are none.
    pub(crate) vectors: Option<Texture>,
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
        let mut vectors = vec![None; self.layouts.len()];
        if !self.vectors.layouts.is_empty() {
            let texels: Vec<&[f32]> = self.vectors.texels.iter().flatten().map(Vec::as_slice).collect();
            if self.vectors.layouts.len() != self.layouts.len() || self.vectors.texels.len() != self.texels.len() {
                return Err(Error::Argument(format!(
                    "irradiance vectors of {} maps under {} lights do not belong to {} maps under {}",
                    self.vectors.layouts.len(),
                    self.vectors.texels.len(),
                    self.layouts.len(),
                    self.texels.len()
                )));
            }
            vectors = texture::checked(&self.vectors.layouts, &texels)?.into_iter().map(Some).collect();
        }
        let maps: Vec<SideMap> = texture::checked(&self.layouts, &self.texels)?
            .into_iter()
            .zip(vectors)
            .zip(&self.uv_maps)
            .map(|((texture, vectors), &[u, v])| SideMap { u, v, texture, vectors })
            .collect();
        Ok(maps.as_chunks::<2>().0.to_vec())
    }
}
