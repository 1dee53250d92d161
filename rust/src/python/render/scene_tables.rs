//! The tables of a scene, made from arrays and tuples.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::python::arrays::{column, groups, lists, numbers};
use crate::render::{Beam, Emission, Light, LightKind, LightMapTables, Sky};

/// The unit vector in the middle of a beam, and the angles up to which a spot shines fully, and at all.
pub(super) type BeamTuple = ([f64; 3], Option<(f64, f64)>);

/// Kind, group, strength, background, vector and beam of a light.
pub(super) type LightTuple = (String, u32, f64, f64, [f64; 3], Option<BeamTuple>);

/// `u_maps`, `v_maps`, layouts and texels of the light maps.
pub(super) type LightMapTuple<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Vec<Bound<'py, PyAny>>);

/// Luma that each triangle emits, and the number of its light.
pub(super) type EmissionTuple<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Number of the sky's light, side of its map, and texels.
pub(super) type SkyTuple<'py> = (u32, usize, Bound<'py, PyAny>);

/// Returns what rays see that hit nothing.
pub(super) fn sky_map((light, side, texels): SkyTuple<'_>) -> PyResult<Sky> {
    Ok(Sky { light, side, texels: numbers(&texels, "sky")? })
}

/// Pairs the maps to both texture coordinates.
fn uv_maps(u_maps: &Bound<'_, PyAny>, v_maps: &Bound<'_, PyAny>) -> PyResult<Vec<[[f64; 4]; 2]>> {
    let (u_maps, v_maps) = (groups::<f64, 4>(u_maps, "u_maps")?, groups::<f64, 4>(v_maps, "v_maps")?);
    if u_maps.len() != v_maps.len() {
        return Err(PyValueError::new_err(format!(
            "{} u_maps need as many v_maps, got {}",
            u_maps.len(),
            v_maps.len()
        )));
    }
    Ok(u_maps.into_iter().zip(v_maps).map(|(u, v)| [u, v]).collect())
}

/// Returns the lights, of which those that are baked are numbered.
pub(super) fn numbered(lights: Vec<LightTuple>) -> PyResult<Vec<Light>> {
    let mut baked = 0..;
    lights.into_iter().map(|tuple| light(tuple, &mut baked)).collect()
}

/// Returns the tables of the light maps.
pub(super) fn light_map_tables((u_maps, v_maps, layouts, texels): LightMapTuple<'_>) -> PyResult<LightMapTables> {
    Ok(LightMapTables {
        uv_maps: uv_maps(&u_maps, &v_maps)?,
        layouts: groups(&layouts, "layouts")?,
        texels: lists(&texels, "texels")?,
    })
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
    (kind, group, strength, background, vector, beam): LightTuple,
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
    Ok(Light { kind, group, strength, background, beam: beam.map(beam_of) })
}

/// Returns the beam of a light at a position.
pub(super) fn beam_of((axis, angles): BeamTuple) -> Beam {
    match angles {
        None => Beam::Cosine(axis),
        Some((full, cutoff)) => Beam::Spot { axis, full, cutoff },
    }
}
