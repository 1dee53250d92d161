//! Views of a scene, made from arrays.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::python::arrays::{column, groups, rows};
use crate::render::{Pose, View};

/// Where cameras are, and what surrounds them: positions, rotations, velocities and rates of each view in each frame;
/// factors and their rates of each view and light.
pub(super) type Views<'py> =
    (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Returns the views that arrays describe, in all frames and under all lights of a scene, of which there are so many.
pub(super) fn views_of(frames: usize, lights: usize, views: &Views<'_>) -> PyResult<Vec<View>> {
    let positions = groups::<f64, 3>(&views.0, "positions")?;
    let rotations = groups::<f64, 9>(&views.1, "rotations")?;
    let velocities = groups::<f64, 3>(&views.2, "velocities")?;
    let rates = groups::<f64, 3>(&views.3, "angular_rates")?;
    let (factors, factor_rates) = (column::<f64>(&views.4, "factors")?, column::<f64>(&views.5, "factor_rates")?);
    let count = positions.len() / frames;
    let lengths = [positions.len(), rotations.len(), velocities.len(), rates.len()];
    let of_lights = [factors.as_slice()?.len(), factor_rates.as_slice()?.len()];
    if lengths != [count * frames; 4] || of_lights != [count * lights; 2] {
        return Err(PyValueError::new_err(format!(
            "views of {frames} frames and {lights} lights need as many poses and factors, got {lengths:?}, {of_lights:?}"
        )));
    }
    let of_light = |i: usize| PyResult::Ok([factors.as_slice()?[i], factor_rates.as_slice()?[i]]);
    (0..count)
        .map(|view| {
            Ok(View {
                poses: (view * frames..(view + 1) * frames)
                    .map(|i| Pose {
                        position: positions[i],
                        rotation: rows(rotations[i]),
                        velocity: velocities[i],
                        angular_rate: rates[i],
                    })
                    .collect(),
                factors: (view * lights..(view + 1) * lights).map(of_light).collect::<PyResult<_>>()?,
            })
        })
        .collect()
}

/// Returns pixels, each as its view and its index there.
pub(super) fn view_pixels(view: &Bound<'_, PyAny>, pixel: &Bound<'_, PyAny>) -> PyResult<Vec<(u32, u32)>> {
    let (view, pixel) = (column::<u32>(view, "view")?, column::<u32>(pixel, "pixel")?);
    let (view, pixel) = (view.as_slice()?, pixel.as_slice()?);
    if view.len() != pixel.len() {
        return Err(PyValueError::new_err(format!(
            "view and pixel must be of one length, got {} and {}",
            view.len(),
            pixel.len()
        )));
    }
    Ok(view.iter().copied().zip(pixel.iter().copied()).collect())
}
