//! The tables of a scene, made from arrays and tuples.

use std::sync::Arc;

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::python::arrays::{column, grouped, groups, numbers};
use crate::render::{
    Beam, Channel, Coat, ColourImage, Distribution, Emission, EmissiveTextures, Finish, Fresnel, GlossTables, Light,
    LightKind, LightMapTables, NormalTextureTables, PASSING, Sheen, Sky, Slide, SlideTables, TextureColours, Under,
    VectorMapTables,
};

/// The unit vector in the middle of a beam, and the angles up to which a spot shines fully, and at all.
pub(super) type BeamTuple = ([f64; 3], Option<(f64, f64)>);

/// Kind, group, strength, background, vector and beam of a light, and the number of its slide and the plane of that.
pub(super) type LightTuple = (String, u32, f64, f64, [f64; 3], Option<BeamTuple>, Option<(u32, u32)>);

/// Rows, map to texture coordinates, whether it is a projector's, whether the nearest texel is taken, layout and texels
/// of a slide.
pub(super) type SlideTuple<'py> = ([[f64; 3]; 3], [[f64; 3]; 2], bool, bool, [i64; 3], Bound<'py, PyAny>);

/// `u_maps`, `v_maps`, layouts and texels of the light maps, and of those of irradiance vectors.
pub(super) type LightMapTuple<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Vec<ChannelTuple<'py>>,
    Option<(Bound<'py, PyAny>, Vec<[ChannelTuple<'py>; 3]>)>,
);

/// Texels, how many channels they have, and which of these is meant.
type ChannelTuple<'py> = (Bound<'py, PyAny>, usize, usize);

/// Luma that each triangle emits, and the number of its light.
pub(super) type EmissionTuple<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Number of the sky's light, side of its map, and texels.
pub(super) type SkyTuple<'py> = (u32, usize, Bound<'py, PyAny>);

/// A kind, and its numbers.
type KindTuple = (String, Vec<f64>);

/// Roughness, distribution, Fresnel's equations, tint, what passes, whether the base tints, what is below, and the
/// numbers of textures of roughness (or opacity) and of metal; strength and roughness of a coat;
/// strength and tint of sheen.
type FinishTuple = (
    (f64, Option<f64>),
    String,
    KindTuple,
    [f64; 3],
    [f64; 3],
    bool,
    KindTuple,
    [Option<u32>; 2],
    Option<(f64, f64)>,
    Option<(f64, f64)>,
    f64,
    f64,
);

/// For each texture the number of its emissive one, and layouts, lights and texels of these.
type EmissiveTuple<'py> = (Bound<'py, PyAny>, Vec<[i64; 4]>, Vec<u32>, Bound<'py, PyAny>);

/// Of each texture the number of its image, and of these the layouts, the texels, and what numbers of 8 bits stand for.
pub(super) type ColoursTuple<'py> = (Bound<'py, PyAny>, Vec<([i64; 3], Bound<'py, PyAny>, Option<Bound<'py, PyAny>>)>);

/// Finishes, that of each triangle, colours of textures, colours of groups, backgrounds of lights, what each triangle
/// emits, the sky, the longest path, layouts and texels of textures of roughness and metal, and emissive textures.
pub(super) type GlossTuple<'py> = (
    Vec<FinishTuple>,
    Bound<'py, PyAny>,
    ColoursTuple<'py>,
    Vec<[f64; 3]>,
    Vec<[f64; 3]>,
    Bound<'py, PyAny>,
    Option<SkyTuple<'py>>,
    usize,
    (Vec<[i64; 4]>, Bound<'py, PyAny>),
    EmissiveTuple<'py>,
);

/// For each texture the number of its normal texture, layouts and texels of these, which are bump maps, on which light
/// fades, and whether they follow glTF's rule.
pub(super) type NormalTextureTuple<'py> =
    (Bound<'py, PyAny>, Vec<[i64; 4]>, Bound<'py, PyAny>, Vec<bool>, Vec<bool>, bool);

/// Returns the normal textures.
pub(super) fn normal_texture_tables(
    (of_texture, layouts, texels, heights, fades, like_gltf): NormalTextureTuple<'_>,
) -> PyResult<NormalTextureTables> {
    Ok(NormalTextureTables {
        of_texture: numbers(&of_texture, "of_texture")?,
        layouts,
        texels: groups(&texels, "normal texels")?,
        heights,
        fades,
        like_gltf,
    })
}

/// Returns the colours of textures.
pub(super) fn texture_colours((of_texture, images): ColoursTuple<'_>) -> PyResult<TextureColours> {
    let image = |(layout, texels, values): (_, Bound<'_, PyAny>, Option<Bound<'_, PyAny>>)| {
        Ok(Arc::new(match values {
            None => ColourImage::linear(layout, grouped(&column(&texels, "colours")?, "colours")?)?,
            Some(values) => {
                let values = groups(&values, "values")?;
                ColourImage::coded(layout, grouped(&column(&texels, "colours")?, "colours")?, &values)?
            }
        }))
    };
    let of_texture = numbers(&of_texture, "of_texture")?;
    Ok(TextureColours { of_texture, images: images.into_iter().map(image).collect::<PyResult<_>>()? })
}

/// Returns the tables of glossy surfaces.
pub(super) fn gloss_tables(
    (finishes, finish_of, texels, colours, backgrounds, emitted, sky, longest, lobes, emissive): GlossTuple<'_>,
) -> PyResult<GlossTables> {
    let (lobe_layouts, lobes) = lobes;
    let (of_texture, layouts, lights, radiance) = emissive;
    Ok(GlossTables {
        finishes: finishes.into_iter().map(finish).collect::<PyResult<_>>()?,
        finish_of: numbers(&finish_of, "finish_of")?,
        texels: texture_colours(texels)?,
        colours,
        backgrounds,
        emitted: groups(&emitted, "emitted")?,
        emissive: EmissiveTextures {
            of_texture: numbers(&of_texture, "of_texture")?,
            layouts,
            lights,
            texels: groups(&radiance, "emissive texels")?,
        },
        sky: match sky {
            None => None,
            Some((light, side, texels)) => Some((light, side, groups(&texels, "sky")?)),
        },
        longest,
        lobe_layouts,
        lobes: numbers(&lobes, "lobes")?,
    })
}

fn finish(
    (
        (alpha, across),
        distribution,
        fresnel,
        tint,
        passing,
        base_tints,
        under,
        lobe,
        coat,
        sheen,
        transmission,
        flatness,
    ): FinishTuple,
) -> PyResult<Finish> {
    let distribution = match distribution.as_str() {
        "ggx" => Distribution::Ggx,
        "beckmann" => Distribution::Beckmann,
        other => return Err(PyValueError::new_err(format!("a distribution is ggx or beckmann, got {other:?}"))),
    };
    let fresnel = match (fresnel.0.as_str(), fresnel.1.as_slice()) {
        ("dielectric", &[index]) => Fresnel::Dielectric(index),
        ("conductor", &[red, green, blue, ref extinction @ ..]) if extinction.len() == 3 => {
            Fresnel::Conductor([red, green, blue], [extinction[0], extinction[1], extinction[2]])
        }
        ("mixed", &[index, metal, tint]) => Fresnel::Mixed { index, metal, tint },
        (kind, values) => return Err(unknown("dielectric (1 number), conductor (6) or mixed (3)", kind, values)),
    };
    let under = match (under.0.as_str(), under.1.as_slice()) {
        ("nothing", []) => Under::Nothing,
        ("coated", &[index, inside, entering, nonlinear, ref passing @ ..])
            if passing.is_empty() || passing.len() == PASSING =>
        {
            let passing = <[f64; PASSING]>::try_from(passing).ok().map(Box::new);
            Under::Coated { index, inside, entering, nonlinear: nonlinear != 0.0, passing }
        }
        ("rough", &[roughness, factor]) => Under::Rough(roughness, factor),
        ("solid", &[index, red, green, blue]) => Under::Solid { index, absorption: [red, green, blue] },
        ("sheet", &[index]) => Under::Sheet(index),
        ("blend", &[opacity]) => Under::Blend(opacity),
        (kind, values) => {
            return Err(unknown(
                "nothing (0 numbers), coated (4, or 37 if rough), rough (2), solid (4), sheet (1) or blend (1)",
                kind,
                values,
            ));
        }
    };
    let coat = coat.map(|(strength, alpha)| Coat { strength, alpha });
    let sheen = sheen.map(|(strength, tint)| Sheen { strength, tint });
    Ok(Finish {
        alpha,
        across,
        distribution,
        fresnel,
        tint,
        passing,
        base_tints,
        under,
        lobe,
        coat,
        sheen,
        transmission,
        flatness,
    })
}

fn unknown(kinds: &str, kind: &str, values: &[f64]) -> PyErr {
    PyValueError::new_err(format!("this part of a finish is {kinds}, got {kind:?} with {} numbers", values.len()))
}

/// Returns what rays see that hit nothing.
pub(super) fn sky_map((light, side, texels): SkyTuple<'_>) -> PyResult<Sky> {
    Ok(Sky { light, side, texels: numbers(&texels, "sky")? })
}

/// Returns the lights, of which those that are baked are numbered.
pub(super) fn numbered(lights: Vec<LightTuple>) -> PyResult<Vec<Light>> {
    let mut baked = 0..;
    lights.into_iter().map(|tuple| light(tuple, &mut baked)).collect()
}

/// The arrays of the light maps, which the tables borrow.
pub(super) struct LightMapColumns<'py> {
    u_maps: PyReadonlyArray1<'py, f64>,
    v_maps: PyReadonlyArray1<'py, f64>,
    layouts: PyReadonlyArray1<'py, i64>,
    texels: Vec<ChannelColumn<'py>>,
    vectors: Option<(PyReadonlyArray1<'py, i64>, Vec<[ChannelColumn<'py>; 3]>)>,
}

/// The array of a channel.
struct ChannelColumn<'py>(PyReadonlyArray1<'py, f32>, usize, usize);

impl<'py> ChannelColumn<'py> {
    fn new((texels, channels, channel): &ChannelTuple<'py>, name: &str) -> PyResult<Self> {
        Ok(Self(column(texels, name)?, *channels, *channel))
    }

    fn channel(&self) -> PyResult<Channel<'_>> {
        Ok(Channel::new(self.0.as_slice()?, self.1, self.2)?)
    }
}

impl<'py> LightMapColumns<'py> {
    pub(super) fn new((u_maps, v_maps, layouts, texels, vectors): LightMapTuple<'py>) -> PyResult<Self> {
        let axes = |[x, y, z]: &[ChannelTuple<'py>; 3]| -> PyResult<[ChannelColumn<'py>; 3]> {
            let read = |axis| ChannelColumn::new(axis, "irradiance vectors");
            Ok([read(x)?, read(y)?, read(z)?])
        };
        let vectors = vectors.map(|(layouts, texels)| -> PyResult<_> {
            Ok((column(&layouts, "layouts of vectors")?, texels.iter().map(axes).collect::<PyResult<_>>()?))
        });
        Ok(Self {
            u_maps: column(&u_maps, "u_maps")?,
            v_maps: column(&v_maps, "v_maps")?,
            layouts: column(&layouts, "layouts")?,
            texels: texels.iter().map(|texels| ChannelColumn::new(texels, "texels")).collect::<PyResult<_>>()?,
            vectors: vectors.transpose()?,
        })
    }

    /// Returns the tables.
    pub(super) fn tables(&self) -> PyResult<LightMapTables<'_>> {
        let vectors = match &self.vectors {
            None => VectorMapTables::default(),
            Some((layouts, texels)) => VectorMapTables {
                layouts: grouped(layouts, "layouts of vectors")?.into(),
                texels: texels
                    .iter()
                    .map(|[x, y, z]| Ok([x.channel()?, y.channel()?, z.channel()?]))
                    .collect::<PyResult<_>>()?,
            },
        };
        Ok(LightMapTables {
            u_maps: grouped(&self.u_maps, "u_maps")?.into(),
            v_maps: grouped(&self.v_maps, "v_maps")?.into(),
            layouts: grouped(&self.layouts, "layouts")?.into(),
            texels: self.texels.iter().map(ChannelColumn::channel).collect::<PyResult<_>>()?,
            vectors,
        })
    }
}

/// Returns what each triangle emits; those of luma 0 emit nothing.
pub(super) fn emission_table((lumas, lights): EmissionTuple<'_>) -> PyResult<Vec<Option<Emission>>> {
    let (lumas, lights) = (column::<f64>(&lumas, "emissions")?, column::<u32>(&lights, "emissions")?);
    let (lumas, lights) = (lumas.as_slice()?, lights.as_slice()?);
    if lumas.len() != lights.len() {
        return Err(PyValueError::new_err(format!(
            "{} emissions need as many lights, got {}",
            lumas.len(),
            lights.len()
        )));
    }
    Ok(lumas.iter().zip(lights).map(|(&luma, &light)| (luma != 0.0).then_some(Emission { light, luma })).collect())
}

fn light(
    (kind, group, strength, background, vector, beam, slide): LightTuple,
    baked: &mut impl Iterator<Item = u32>,
) -> PyResult<Light> {
    let kind = match kind.as_str() {
        "point" => LightKind::Point(vector),
        "directional" => LightKind::Directional(vector),
        "constant" => LightKind::Constant,
        "baked" => LightKind::Baked(baked.next().unwrap_or(u32::MAX)),
        "visible" => LightKind::Visible,
        _ => {
            return Err(PyValueError::new_err(format!(
                "a light is point, directional, constant, baked or visible, got {kind:?}"
            )));
        }
    };
    Ok(Light { kind, group, strength, background, beam: beam.map(beam_of), slide })
}

/// Returns the slide before a light.
pub(super) fn slide_of((rows, uv_map, projected, nearest, layout, texels): SlideTuple<'_>) -> PyResult<Arc<Slide>> {
    let texels = numbers(&texels, "texels of a slide")?;
    Ok(Arc::new(Slide::new(SlideTables { rows, uv_map, projected, nearest, layout, texels })?))
}

/// Returns the beam of a light at a position.
pub(super) fn beam_of((axis, angles): BeamTuple) -> Beam {
    match angles {
        None => Beam::Cosine(axis),
        Some((full, cutoff)) => Beam::Spot { axis, full, cutoff },
    }
}
