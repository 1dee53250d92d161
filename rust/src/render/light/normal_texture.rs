//! Normal textures: which way each texel of a surface faces, in the tangent space of its texture coordinates; and bump
//! maps, whose texels are heights above the surface, so that it faces away from where they rise.
//!
//! They turn the shading normal. Lights at a position or along a direction and glossy lobes see it turned. Baked light
//! sees it by its irradiance vectors along the surface; constant light falls less on what is turned away.
//!
//! The tangent points where u grows, at right angles to the shading normal. The second tangent is at right angles to
//! both (glTF 2.0, section 3.7.2.1; Mikkelsen, "Simulation of wrinkled surfaces revisited", 2008).
//!
//! What must not break: a surface whose texture coordinates have no direction keeps its shading normal.

use super::texture::{Texture, checked_layouts};
use crate::error::{Error, Result};
use crate::render::geometry::vector::Vector;
use crate::render::gloss::lookup::{looked_up, slopes};
use crate::render::gloss::number::{Number, Triple, add, constant, cross, dot, scale, sub, unit};

/// The number of its normal texture of a texture whose surfaces have none.
pub const NO_NORMAL_TEXTURE: u32 = u32::MAX;

/// What stands for a component of 1; 0 stands for -1.
const ONE: f32 = u16::MAX as f32;

/// The least square of a cosine that anything is divided by.
const LEAST_SQUARE: f64 = 1e-30;

/// The normal textures of a scene.
#[derive(Clone, Debug, Default)]
pub struct NormalTextureTables {
    /// For each texture of the scene the number of the normal texture on the same surfaces, [`NO_NORMAL_TEXTURE`] for
    /// none; empty where there are none.
    pub of_texture: Vec<u32>,
    /// Where each lies among the texels, as textures of the scene do.
    pub layouts: Vec<[i64; 4]>,
    /// Components along the tangent, the second tangent and the normal, each from -1 (0) to 1 (65,535). Of a bump map a
    /// height in metres: the lower and the upper half of the bits of a float32, and 0. Each texture in a frame of one texel.
    pub texels: Vec<[u16; 3]>,
    /// For each whether it is a bump map.
    pub heights: Vec<bool>,
    /// For each normal texture whether light fades where a turned normal faces it but the surface hardly does, see
    /// [`fading`].
    pub fades: Vec<bool>,
    /// Whether they follow glTF. There, the second tangent follows texture coordinates that are mirrored, and the whole
    /// normal turns round on the back. In Mitsuba neither is so: on the back only the component along the normal turns.
    /// And a normal that is turned away from a viewer is turned the other way.
    pub like_gltf: bool,
}

/// The same, checked.
#[derive(Debug)]
pub(crate) struct NormalTextures {
    of_texture: Vec<u32>,
    textures: Vec<Texture>,
    /// Each the three components, in its lowest 48 bits.
    texels: Vec<u64>,
    heights: Vec<bool>,
    fades: Vec<bool>,
    like_gltf: bool,
}

impl NormalTextures {
    /// Checks the normal textures of a scene of so many textures.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for what does not belong together.
    pub(crate) fn new(tables: &NormalTextureTables, scene_textures: usize) -> Result<Self> {
        let textures = checked_layouts(&tables.layouts, Some(tables.texels.len()), 1)?;
        let known = |&number: &u32| number == NO_NORMAL_TEXTURE || (number as usize) < textures.len();
        if ![0, scene_textures].contains(&tables.of_texture.len())
            || !tables.of_texture.iter().all(known)
            || tables.fades.len() != textures.len()
            || tables.heights.len() != textures.len()
        {
            return Err(Error::Argument(format!(
                "{} normal textures do not belong to a scene of {scene_textures} textures",
                textures.len()
            )));
        }
        let texels: Vec<u64> = tables.texels.iter().copied().map(packed).collect();
        for (number, texture) in textures.iter().enumerate().filter(|(number, _)| tables.heights[*number]) {
            let end = texture.first + (texture.width as usize + 2) * (texture.height as usize + 2);
            if texels[texture.first..end].iter().any(|&texel| !height(texel).is_finite()) {
                return Err(Error::Argument(format!("heights must be finite, and those of bump map {number} are not")));
            }
        }
        Ok(Self {
            of_texture: tables.of_texture.clone(),
            textures,
            texels,
            heights: tables.heights.clone(),
            fades: tables.fades.clone(),
            like_gltf: tables.like_gltf,
        })
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.textures.is_empty()
    }

    /// Returns the normal texture of the surfaces that have a texture of the scene.
    pub(crate) fn of(&self, texture: u32) -> Option<&Texture> {
        self.textures.get(*self.of_texture.get(texture as usize)? as usize)
    }

    /// Returns what turns the normals of a surface; None where nothing does.
    ///
    /// `texture` is the number of its texture, `uv` are the maps to its texture coordinates, `plane` its normal and offset.
    pub(crate) fn on<'a>(&'a self, texture: u32, uv: &'a [[f64; 4]; 2], plane: &[f64; 4]) -> Option<Bumps<'a>> {
        let number = *self.of_texture.get(texture as usize)? as usize;
        let texture = self.textures.get(number)?;
        let (tangent, side) = tangent_of(uv, plane)?;
        let heights = self.heights[number];
        let axes = if heights { uv.map(|map| [map[0], map[1], map[2]]) } else { [tangent, [0.0; 3]] };
        let rule = Rule {
            side: if self.like_gltf { side } else { 1.0 },
            like_gltf: self.like_gltf,
            fades: self.fades[number],
            heights,
        };
        Some(Bumps { texture, texels: &self.texels, uv, axes, rule })
    }
}

/// The normal texture on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bumps<'a> {
    pub(crate) texture: &'a Texture,
    /// Each the three components, in its lowest 48 bits.
    pub(crate) texels: &'a [u64],
    pub(crate) uv: &'a [[f64; 4]; 2],
    /// The tangent, of unit length; of a bump map how u and v grow, per metre. In the surface's frame.
    pub(crate) axes: [Vector; 2],
    pub(crate) rule: Rule,
}

/// How a texture turns normals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    /// Of the second tangent: 1 where it lies to the left of the tangent, seen from the front, else -1.
    side: f64,
    like_gltf: bool,
    /// Whether light fades, see [`fading`].
    pub(crate) fades: bool,
    /// Whether it is a bump map.
    pub(crate) heights: bool,
}

impl Bumps<'_> {
    /// Returns the normal at a point in the frame of the surface, see [`Rule::turned`].
    pub(crate) fn turned<N: Number>(
        &self,
        point: Triple<N>,
        normal: Triple<N>,
        (front, viewer): (bool, Vector),
    ) -> Triple<N> {
        let (wrap, maps) = (self.texture.wrap, self.uv.each_ref());
        let components = if self.rule.heights {
            let [along_u, along_v] = slopes(self.texture, wrap, maps, point, |at| f64::from(height(self.texels[at])));
            [along_u, along_v, N::constant(1.0)]
        } else {
            looked_up(self.texture, wrap, maps, point, |at| components(self.texels[at]).map(f64::from))
        };
        self.rule.turned(normal, self.axes.map(constant), components, (front, viewer))
    }
}

/// Puts the components of a texel into one number.
fn packed(texel: [u16; 3]) -> u64 {
    let [x, y, z] = texel.map(u64::from);
    x | y << 16 | z << 32
}

/// Returns the components of a texel, from -1 to 1.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "a third each")]
pub(super) fn components(texel: u64) -> [f32; 3] {
    let (x, y, z) = (texel as u16, (texel >> 16) as u16, (texel >> 32) as u16);
    let per = 2.0 / ONE;
    [f32::from(x) * per - 1.0, f32::from(y) * per - 1.0, f32::from(z) * per - 1.0]
}

/// Returns the height of a texel of a bump map.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "its lower half")]
pub(super) fn height(texel: u64) -> f32 {
    f32::from_bits(texel as u32)
}

impl Rule {
    /// Returns a normal turned by the components of a texture along the tangent, the second tangent and the normal; of a
    /// bump map, by how its height grows with u and with v (Blinn, "Simulation of wrinkled surfaces", 1978).
    ///
    /// `normal` is the unit normal on the front, `axes` are those of [`Bumps`], and `viewer` leads to the viewer, all in the
    /// same axes. What is returned is of length 1, on the side that is seen.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(super) fn turned<N: Number>(
        &self,
        normal: Triple<N>,
        axes: [Triple<N>; 2],
        [x, y, z]: [N; 3],
        (front, viewer): (bool, Vector),
    ) -> Triple<N> {
        let level = |vector: Triple<N>| sub(vector, scale(normal, dot(normal, vector)));
        let along = if self.heights {
            let rises = level(add(scale(axes[0], x), scale(axes[1], y)));
            scale(rises, N::constant(-1.0))
        } else {
            let first = unit(level(axes[0]));
            add(scale(first, x), scale(scale(cross(normal, first), N::constant(self.side)), y))
        };
        let seen = scale(normal, N::constant(if front { 1.0 } else { -1.0 }));
        let outwards = scale(seen, z);
        let facing = dot(add(along, outwards), constant(viewer)).value();
        let round = if self.like_gltf { !front } else { facing <= 0.0 };
        unit(add(scale(along, N::constant(if round { -1.0 } else { 1.0 })), outwards))
    }
}

/// Returns the fraction of light from a direction that the bumps let through which a turned normal stands for.
///
/// Without it, light would end all at once where the surface turns away from it. Source: Conty Estevez, Lecocq and Stein,
/// "A microfacet-based shadowing function to solve the bump terminator problem", Ray Tracing Gems, 2019.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn fading<N: Number>(normal: Triple<N>, turned: Triple<N>, towards: Triple<N>) -> N {
    let one = N::constant(1.0);
    let slope = |cosine: N| one / cosine.squared().at_least(LEAST_SQUARE) - one;
    let roughness = slope(dot(normal, turned)).scaled(0.125).at_least(0.0).at_most(1.0);
    N::constant(2.0) / (one + (one + roughness * slope(dot(normal, towards))).sqrt())
}

/// Returns the unit vector along which u grows while v stays, and 1 where v grows to the right of it, seen from the front,
/// as in a picture, or -1 where the picture is mirrored.
fn tangent_of(uv: &[[f64; 4]; 2], plane: &[f64; 4]) -> Option<(Vector, f64)> {
    let [u, v] = uv.map(|map| [map[0], map[1], map[2]]);
    let normal = [plane[0], plane[1], plane[2]];
    let area = dot(normal, cross(u, v));
    let along = scale(cross(v, normal), area.signum());
    let length = dot(along, along).sqrt();
    let known = area != 0.0 && length > 0.0 && length.is_finite();
    known.then(|| (scale(along, 1.0 / length), -area.signum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However flat light falls, and whether a texel turns the normal or not.
    #[test]
    fn light_fades_to_a_fraction() {
        for tilt in [0.0, 0.3, 0.999_999] {
            let turned = [tilt, 0.0, f64::sqrt(1.0 - tilt * tilt)];
            let mut last = 0.0;
            for along in [1e-200, 1e-25, 1e-12, 1e-6, 1e-3, 0.1, 1.0] {
                let towards = [f64::sqrt(1.0 - along * along), 0.0, along];
                let fraction = fading([0.0, 0.0, 1.0], turned, towards);
                let single = |vector: Vector| vector.map(|component| <f32 as Number>::new(component, 0.0));
                let rounded = fading(single([0.0, 0.0, 1.0]), single(turned), single(towards));
                assert!((f64::from(rounded) - fraction).abs() < 1e-4, "{tilt} {along}: {rounded} {fraction}");
                assert!(fraction >= last && fraction <= 1.0, "{tilt} {along}: {fraction}");
                last = fraction;
            }
            assert!((last - 1.0).abs() < 1e-12);
        }
    }

    /// In a picture u grows to the right and v downwards; of texture coordinates without an area there is no tangent.
    #[test]
    fn tangents_follow_the_picture() {
        let (u, v, plane) = ([2.0, 0.0, 0.0, 0.3], [0.0, -3.0, 0.0, 0.1], [0.0, 0.0, 1.0, 0.0]);
        assert_eq!(tangent_of(&[u, v], &plane), Some(([1.0, 0.0, 0.0], 1.0)));
        let [x, y, z, w] = u.map(|x| -x);
        assert_eq!(tangent_of(&[[x, y, z, w], v], &plane), Some(([-1.0, 0.0, 0.0], -1.0)));
        assert_eq!(tangent_of(&[u, [1.0, 0.0, 0.0, 0.0]], &plane), None);
        assert_eq!(tangent_of(&[[0.0; 4]; 2], &plane), None);
    }

    #[test]
    fn texels_are_from_minus_one_to_one() {
        assert_eq!(components(packed([0, u16::MAX, 0])), [-1.0, 1.0, -1.0]);
        assert!(
            components(packed([32_768, 32_767, u16::MAX]))
                .iter()
                .zip([0.0, 0.0, 1.0])
                .all(|(a, b)| (a - b).abs() < 2e-5)
        );
    }
}
