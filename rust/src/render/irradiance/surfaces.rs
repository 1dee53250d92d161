//! What rays hit: reflectance of a surface, and the light that falls on it where that is known.
//!
//! Colours have four channels, of which the last is not used, because four fill a vector.
//!
//! What must not break: the layout of light maps, which Python makes, with a frame of one texel around each.

use std::borrow::Cow;

use crate::error::{Error, Result};
use crate::render::geometry::vector::{Vector, single};
use crate::render::light::colours::TextureColours;
use crate::render::light::texture::Wrap;

/// Red, green, blue, and nothing.
pub(crate) type Colour = [f32; 4];

/// The tables of a scene's surfaces, one entry a triangle where nothing else is said.
#[derive(Clone, Debug, Default)]
pub struct SurfaceTables<'a> {
    /// Corners in the world, metres.
    pub corners: Cow<'a, [[[f64; 3]; 3]]>,
    /// The unit normal of the front.
    pub normals: Cow<'a, [[f64; 3]]>,
    /// The unit shading normals of the front at the corners.
    pub shading_normals: Cow<'a, [[[f64; 3]; 3]]>,
    /// Texture coordinates of the corners.
    pub uv: Cow<'a, [[[f64; 2]; 3]]>,
    /// The number of its texture.
    pub textures: Vec<u32>,
    /// Whether the back reflects too.
    pub two_sided: Vec<bool>,
    /// The reflectance of all textures.
    pub colours: TextureColours,
}

/// How a triangle reflects.
#[derive(Clone, Copy, Debug)]
struct Surface {
    normal: [f32; 3],
    shading_normals: [[f32; 3]; 3],
    uv: [[f32; 2]; 3],
    texture: u32,
    two_sided: bool,
}

/// How all triangles reflect.
#[derive(Debug)]
pub(crate) struct Surfaces {
    triangles: Vec<Surface>,
    colours: TextureColours,
}

/// Light that falls on both sides of each triangle, to be looked up where rays hit them.
#[derive(Debug)]
pub struct ReflectedLight {
    /// First texel and width of the map of each front and back.
    layouts: Vec<[[u32; 2]; 2]>,
    texels: Vec<Colour>,
}

impl ReflectedLight {
    /// Takes light maps: first texel and width (texels along a side) of each triangle's front and back, and all texels
    /// as irradiance / pi.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a map that does not lie in the texels.
    pub fn new(layouts: &[[[i64; 2]; 2]], texels: &[[f32; 3]]) -> Result<Self> {
        let fits = |[first, width]: [i64; 2]| -> Option<[u32; 2]> {
            let end = width.checked_add(2)?.checked_mul(width + 2)?.checked_add(first)?;
            let inside = width >= 2 && usize::try_from(end).is_ok_and(|end| end <= texels.len());
            inside.then_some([u32::try_from(first).ok()?, u32::try_from(width).ok()?])
        };
        let layouts: Option<Vec<_>> = layouts.iter().map(|&[a, b]| Some([fits(a)?, fits(b)?])).collect();
        let Some(layouts) = layouts else {
            return Err(Error::Argument(format!(
                "a map of reflected light has 2 texels along a side or more and lies within the {} texels",
                texels.len()
            )));
        };
        Ok(Self { layouts, texels: texels.iter().map(|&texel| padded(texel)).collect() })
    }

    /// Returns how many triangles there are.
    pub(crate) fn len(&self) -> usize {
        self.layouts.len()
    }

    /// Returns irradiance / pi at a point on a side of a triangle (0 front, 1 back).
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn at(&self, triangle: u32, side: usize, [second, third]: [f32; 2]) -> Colour {
        let [first, width] = self.layouts[triangle as usize][side];
        let (column, x) = cell(second, width);
        let (row, y) = cell(third, width);
        let stride = width as usize + 2;
        let corner = first as usize + (row as usize + 1) * stride + column as usize + 1;
        let (upper, lower) = (&self.texels[corner..corner + 2], &self.texels[corner + stride..corner + stride + 2]);
        let mut light = mixed([&upper[0], &upper[1]], [&lower[0], &lower[1]], x, y);
        for value in &mut light {
            *value = if *value > 0.0 { *value } else { 0.0 };
        }
        light
    }
}

/// Returns the cell along an edge of a light map that a barycentric coordinate lies in, and how far it is past it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "in range")]
fn cell(weight: f32, width: u32) -> (u32, f32) {
    let weight = if weight > 0.0 { weight } else { 0.0 };
    let weight = if weight < 1.0 { weight } else { 1.0 };
    let along = weight * (width - 1) as f32;
    let cell = (along as i32 as u32).min(width - 2);
    (cell, along - cell as f32)
}

impl Surfaces {
    /// Checks the tables.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for tables that do not belong together.
    pub(crate) fn new(tables: &SurfaceTables) -> Result<Self> {
        let n = tables.corners.len();
        for (name, length) in [
            ("normals", tables.normals.len()),
            ("shading_normals", tables.shading_normals.len()),
            ("uv", tables.uv.len()),
            ("textures", tables.textures.len()),
            ("two_sided", tables.two_sided.len()),
        ] {
            if length != n {
                return Err(Error::Argument(format!("{n} triangles need as many {name}, got {length}")));
            }
        }
        tables.colours.check()?;
        let count = tables.colours.of_texture.len();
        if let Some(number) = tables.textures.iter().find(|&&number| number as usize >= count) {
            return Err(Error::Argument(format!("there are {count} textures, got number {number}")));
        }
        let surface = |i: usize| Surface {
            normal: single(tables.normals[i]),
            shading_normals: tables.shading_normals[i].map(single),
            uv: tables.uv[i].map(single),
            texture: tables.textures[i],
            two_sided: tables.two_sided[i],
        };
        Ok(Self { triangles: (0..n).map(surface).collect(), colours: tables.colours.clone() })
    }

    /// Returns how many triangles there are.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Returns which side a ray hits: 0 the front, 1 the back; and the unit normal on that side.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn side(&self, triangle: u32, [x, y, z]: [f32; 3]) -> (usize, [f32; 3]) {
        let normal = self.triangles[triangle as usize].normal;
        let front = normal[0] * x + normal[1] * y + normal[2] * z < 0.0;
        if front { (0, normal) } else { (1, normal.map(|component| -component)) }
    }

    /// Returns the unit shading normal on a side of a triangle.
    pub(crate) fn shading_normal(&self, triangle: u32, side: usize, [second, third]: [f32; 2]) -> [f32; 3] {
        let [a, b, c] = self.triangles[triangle as usize].shading_normals;
        let mixed = [0, 1, 2].map(|i| a[i] + second * (b[i] - a[i]) + third * (c[i] - a[i]));
        let length = (mixed[0] * mixed[0] + mixed[1] * mixed[1] + mixed[2] * mixed[2]).sqrt();
        let per_length = if length > 0.0 { 1.0 / length } else { 0.0 };
        mixed.map(|component| component * if side == 0 { per_length } else { -per_length })
    }

    /// Returns the reflectance of a side of a triangle where a ray hits it; `weights` are those of the second and third
    /// corner.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "wrapped into the texture")]
    pub(crate) fn reflectance(&self, triangle: u32, side: usize, [second, third]: [f32; 2]) -> Colour {
        let surface = &self.triangles[triangle as usize];
        if side == 1 && !surface.two_sided {
            return [0.0; 4];
        }
        let image = self.colours.of(surface.texture);
        let texture = &image.texture;
        if texture.is_constant() {
            return padded(image.at(0));
        }
        let [a, b, c] = surface.uv;
        let (columns, x) = taps(a[0] + second * (b[0] - a[0]) + third * (c[0] - a[0]), texture.width, texture.wrap);
        let (rows, y) = taps(a[1] + second * (b[1] - a[1]) + third * (c[1] - a[1]), texture.height, texture.wrap);
        // A frame of one texel lies around the image.
        let texel = |row: usize, column: usize| {
            let before = (rows[row] as usize + 1) * (texture.width as usize + 2);
            padded(image.at(before + columns[column] as usize + 1))
        };
        mixed([&texel(0, 0), &texel(0, 1)], [&texel(1, 0), &texel(1, 1)], x, y)
    }
}

/// Returns the two texels that a texture coordinate lies between along a side, and how far it is past the first.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss, reason = "wrapped")]
#[allow(clippy::cast_possible_wrap, reason = "a side has less than 2^23 texels")]
fn taps(coordinate: f32, size: u32, wrap: Wrap) -> ([u32; 2], f32) {
    let along = coordinate * size as f32 - 0.5;
    let whole = along as i32;
    let before = if (whole as f32) > along { whole - 1 } else { whole };
    let past = along - before as f32;
    let after = before.wrapping_add(1);
    if before as u32 >= size || after as u32 >= size {
        return ([wrapped(before, size as i32, wrap) as u32, wrapped(after, size as i32, wrap) as u32], past);
    }
    ([before as u32, after as u32], past)
}

/// Returns the texel that one outside of a texture stands for.
#[cold]
fn wrapped(texel: i32, size: i32, wrap: Wrap) -> i32 {
    match wrap {
        Wrap::Repeat => texel.rem_euclid(size),
        Wrap::Clamp => texel.clamp(0, size - 1),
        Wrap::Mirror => {
            let folded = texel.rem_euclid(2 * size);
            folded.min(2 * size - 1 - folded)
        }
    }
}

/// Mixes four texels bilinearly.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn mixed([a, b]: [&Colour; 2], [c, d]: [&Colour; 2], x: f32, y: f32) -> Colour {
    let mut mix = [0.0; 4];
    for i in 0..4 {
        let (upper, lower) = (a[i] + (b[i] - a[i]) * x, c[i] + (d[i] - c[i]) * x);
        mix[i] = upper + (lower - upper) * y;
    }
    mix
}

pub(crate) fn padded([red, green, blue]: [f32; 3]) -> Colour {
    [red, green, blue, 0.0]
}

/// Rounds a colour to float32.
pub(crate) fn colour(rgb: Vector) -> Colour {
    padded(single(rgb))
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::render::light::colours::ColourImage;

    /// A map of 3 x 3 texels in its frame: bilinear between them, each side its own, and never below 0.
    #[test]
    fn light_is_looked_up_between_texels() {
        let value = |column: f32, row: f32| 1.0 + column - 0.4 * row - 0.3 * column * row;
        let texels: Vec<[f32; 3]> = [1.0, 10.0]
            .iter()
            .flat_map(|&by| {
                (0..25u8).map(move |i| [by * value(f32::from(i % 5) - 1.0, f32::from(i / 5) - 1.0), 0.0, -1.0])
            })
            .collect();
        let light = ReflectedLight::new(&[[[0, 3], [25, 3]]], &texels).unwrap();
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.25, 0.6], [0.7, 0.1], [0.5, 0.5], [-0.1, 1.2]] {
            let (column, row) = (2.0 * f32::clamp(x, 0.0, 1.0), 2.0 * f32::clamp(y, 0.0, 1.0));
            for (side, by) in [(0, 1.0), (1, 10.0)] {
                let [red, green, blue, _] = light.at(0, side, [x, y]);
                assert!((red - by * value(column, row).max(0.0)).abs() < 1e-5 * by, "{x} {y}: {red}");
                assert_eq!([green, blue], [0.0; 2]);
            }
        }
    }

    /// Textures repeat, end or are mirrored at their edges; a back that does not reflect is black.
    #[test]
    fn reflectance_is_looked_up_as_the_texture_wraps() {
        let expected = |coordinate: f32, wrap: i64| {
            let along = 4.0 * coordinate - 0.5;
            let texel = |at: f32| {
                let at = match wrap {
                    0 => at.rem_euclid(4.0),
                    1 => at.clamp(0.0, 3.0),
                    _ => at.rem_euclid(8.0).min(7.0 - at.rem_euclid(8.0)),
                };
                at * at
            };
            let past = along - along.floor();
            texel(along.floor()) * (1.0 - past) + texel(along.floor() + 1.0) * past
        };
        for wrap in 0..3 {
            let tables = SurfaceTables {
                corners: vec![[[0.0; 3]; 3]].into(),
                normals: vec![[0.0, 0.0, 1.0]].into(),
                shading_normals: vec![[[0.0, 0.0, 1.0]; 3]].into(),
                uv: vec![[[-1.5, 0.5], [2.5, 0.5], [-1.5, 0.5]]].into(),
                textures: vec![0],
                two_sided: vec![false],
                colours: TextureColours {
                    of_texture: vec![0],
                    images: vec![
                        ColourImage::linear([4, 1, wrap], &[[0.0; 3], [1.0; 3], [4.0; 3], [9.0; 3]]).unwrap().into(),
                    ],
                },
            };
            let surfaces = Surfaces::new(&tables).unwrap();
            for step in 0..64u8 {
                let weight = f32::from(step) / 64.0;
                let red = surfaces.reflectance(0, 0, [weight, 0.0])[0];
                let right = expected(-1.5 + 4.0 * weight, wrap);
                assert!((red - right).abs() < 1e-4, "wrap {wrap} at {weight}: {red} {right}");
                assert_eq!(surfaces.reflectance(0, 1, [weight, 0.0]), [0.0; 4]);
            }
            assert_eq!(surfaces.side(0, [0.3, 0.0, -1.0]), (0, [0.0, 0.0, 1.0]));
            assert_eq!(surfaces.side(0, [0.3, 0.0, 1.0]), (1, [-0.0, -0.0, -1.0]));
        }
    }
}
