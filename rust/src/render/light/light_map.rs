//! Light maps: irradiance that was computed beforehand, for each side of each triangle, looked up like a texture.
//!
//! They are stored as textures are, so that bilinear lookup serves for both.
//!
//! What must not break: the layout of the tables, which Python fills, and the frame of one texel around each map.

use std::borrow::Cow;

use super::super::geometry::vector::{Vector, cross, dot, scale, sub};
use super::texture::{self, Texture};
use crate::error::{Error, Result};

/// Irradiance on surfaces, as tables; empty where no light is baked. What takes most memory may be borrowed.
#[derive(Clone, Debug, Default)]
pub struct LightMapTables<'a> {
    /// For the front and the back of each triangle, one after the other: the coordinate u in its map of a point p:
    /// `map[..3] . p + map[3]`.
    pub u_maps: Cow<'a, [[f64; 4]]>,
    /// The coordinate v.
    pub v_maps: Cow<'a, [[f64; 4]]>,
    /// For the front and the back of each triangle: first texel, width, height and wrap mode, as those of textures.
    pub layouts: Cow<'a, [[i64; 4]]>,
    /// For each baked light all texels as irradiance / pi for a strength of 1, with a frame of one texel around each
    /// map.
    pub texels: Vec<Channel<'a>>,
    /// The same for maps of irradiance vectors, where normal textures turn surfaces.
    pub vectors: VectorMapTables<'a>,
}

/// The part along the surface of irradiance vectors / pi, as tables; empty where no surface needs it.
#[derive(Clone, Debug, Default)]
pub struct VectorMapTables<'a> {
    /// As [`LightMapTables::layouts`]. Of surfaces that do not need it those of another one.
    pub layouts: Cow<'a, [[i64; 4]]>,
    /// For each baked light, and of it for x, y and z in the triangle's frame, all texels for a strength of 1.
    pub texels: Vec<[Channel<'a>; 3]>,
}

/// One colour of texels, whose colours lie next to each other.
#[derive(Clone, Copy, Debug)]
pub struct Channel<'a> {
    texels: &'a [f32],
    channels: usize,
}

impl<'a> Channel<'a> {
    /// Takes texels of so many channels, and which of these it is.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for one that is not there, or texels that are not whole.
    pub fn new(texels: &'a [f32], channels: usize, channel: usize) -> Result<Self> {
        if channel >= channels || !texels.len().is_multiple_of(channels) {
            let count = texels.len();
            return Err(Error::Argument(format!("there is no channel {channel} of {channels} in {count} numbers")));
        }
        Ok(Self { texels: texels.get(channel..).unwrap_or_default(), channels })
    }

    /// Returns its texels.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &'a f32> + Clone + use<'a> {
        self.texels.iter().step_by(self.channels)
    }
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

impl SideMap {
    /// Gives it to a triangle with other corners: what was baked at a corner, and between them, stays there.
    ///
    /// The map of a side has a texel on each corner, see [`LightMapTables`].
    pub(crate) fn put_on(&mut self, corners: &[Vector; 3]) {
        let [along_u, along_v] = [1, 2].map(|corner| sub(corners[corner], corners[0]));
        let normal = cross(along_u, along_v);
        let squared = dot(normal, normal);
        let gradients = [scale(cross(along_v, normal), 1.0 / squared), scale(cross(normal, along_u), 1.0 / squared)];
        let sizes = [self.texture.width, self.texture.height].map(f64::from);
        for ((map, gradient), size) in [&mut self.u, &mut self.v].into_iter().zip(gradients).zip(sizes) {
            let [x, y, z] = scale(gradient, (size - 1.0) / size);
            *map = [x, y, z, 0.5 / size - dot([x, y, z], corners[0])];
        }
    }
}

/// Light maps whose tables are checked. The maps of a triangle are made where they are asked for.
pub(crate) struct SideMaps<'a> {
    tables: &'a LightMapTables<'a>,
    /// Of the front and the back of each triangle, one after the other; empty where no light is baked.
    textures: Vec<Texture>,
    /// Where their irradiance vectors are; empty where there are none.
    vectors: Vec<Texture>,
}

impl SideMaps<'_> {
    /// Returns the maps of the front and the back of a triangle; None where no light is baked.
    pub(crate) fn of(&self, triangle: usize) -> Option<[SideMap; 2]> {
        let textures = self.textures.get(2 * triangle..)?.first_chunk::<2>()?;
        Some(std::array::from_fn(|side| {
            let at = 2 * triangle + side;
            SideMap {
                u: self.tables.u_maps[at],
                v: self.tables.v_maps[at],
                texture: textures[side].clone(),
                vectors: self.vectors.get(at).cloned(),
            }
        }))
    }
}

impl LightMapTables<'_> {
    /// Checks that they are those of `triangles` triangles.
    pub(crate) fn checked(&self, triangles: usize) -> Result<SideMaps<'_>> {
        let (u_maps, v_maps) = (self.u_maps.len(), self.v_maps.len());
        if self.layouts.is_empty() && u_maps == 0 && v_maps == 0 && self.texels.is_empty() {
            return Ok(SideMaps { tables: self, textures: vec![], vectors: vec![] });
        }
        if [self.layouts.len(), u_maps, v_maps] != [2 * triangles; 3] {
            return Err(Error::Argument(format!(
                "{triangles} triangles need two light maps each, got {} layouts, {u_maps} u_maps and {v_maps} v_maps",
                self.layouts.len(),
            )));
        }
        let mut vectors = vec![];
        if !self.vectors.layouts.is_empty() {
            if self.vectors.layouts.len() != self.layouts.len() || self.vectors.texels.len() != self.texels.len() {
                return Err(Error::Argument(format!(
                    "irradiance vectors of {} maps under {} lights do not belong to {} maps under {}",
                    self.vectors.layouts.len(),
                    self.vectors.texels.len(),
                    self.layouts.len(),
                    self.texels.len()
                )));
            }
            vectors = texture::checked(&self.vectors.layouts, self.vectors.texels.iter().flatten().map(Channel::iter))?;
        }
        let textures = texture::checked(&self.layouts, self.texels.iter().map(Channel::iter))?;
        Ok(SideMaps { tables: self, textures, vectors })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_one_of_several() {
        let texels = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let of =
            |channels, channel| Channel::new(&texels, channels, channel).unwrap().iter().copied().collect::<Vec<_>>();
        assert_eq!([of(3, 0), of(3, 2)], [vec![1.0, 4.0], vec![3.0, 6.0]]);
        assert_eq!(of(1, 0), texels);
        assert_eq!(Channel::new(&[], 3, 2).unwrap().iter().len(), 0);
        for (channels, channel) in [(3, 3), (4, 0), (0, 0)] {
            assert!(Channel::new(&texels, channels, channel).is_err(), "{channels} {channel}");
        }
    }
}
