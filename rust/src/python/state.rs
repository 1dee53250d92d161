//! The engine's state as a dictionary of arrays, and back.

use numpy::{Element, IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{image, threshold};
use super::engine::interpolation_of;
use crate::crossing::{CrossingParameters, EngineState, Interpolation, Threshold};
use crate::event::SensorSize;

/// Raised when the meaning of an entry changes.
const VERSION: u32 = 1;

pub(super) fn to_dict(py: Python<'_>, state: EngineState) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let size = state.size;
    let threshold = |threshold: Threshold| match threshold {
        Threshold::Uniform(value) => Ok(value.into_pyobject(py)?.into_any()),
        Threshold::PerPixel(values) => image(py, values, size).map(Bound::into_any),
    };
    let interpolation = match state.parameters.interpolation {
        Interpolation::Linear => "linear",
        Interpolation::Hermite => "hermite",
    };
    dict.set_item("version", VERSION)?;
    dict.set_item("width", size.width)?;
    dict.set_item("height", size.height)?;
    dict.set_item("contrast_threshold", threshold(state.parameters.contrast_threshold)?)?;
    dict.set_item("contrast_threshold_off", threshold(state.parameters.contrast_threshold_off)?)?;
    dict.set_item("log_eps", state.parameters.log_eps)?;
    dict.set_item("interpolation", interpolation)?;
    dict.set_item("t_us", state.t_us)?;
    dict.set_item("luma", state.luma.into_pyarray(py))?;
    dict.set_item("log_intensity", state.log_intensity.into_pyarray(py))?;
    dict.set_item("rate", state.rate.into_pyarray(py))?;
    dict.set_item("base", state.base.into_pyarray(py))?;
    dict.set_item("on", state.on.into_pyarray(py))?;
    dict.set_item("off", state.off.into_pyarray(py))?;
    dict.set_item("last_event_us", state.last_event_us.into_pyarray(py))?;
    Ok(dict)
}

pub(super) fn from_dict(dict: &Bound<'_, PyDict>) -> PyResult<EngineState> {
    let version: u32 = item(dict, "version")?.extract()?;
    if version != VERSION {
        return Err(PyValueError::new_err(format!("this state has version {version}; this engine knows {VERSION}")));
    }
    let size = SensorSize { width: item(dict, "width")?.extract()?, height: item(dict, "height")?.extract()? };
    Ok(EngineState {
        size,
        parameters: CrossingParameters {
            contrast_threshold: threshold(&item(dict, "contrast_threshold")?, "contrast_threshold", size)?,
            contrast_threshold_off: threshold(&item(dict, "contrast_threshold_off")?, "contrast_threshold_off", size)?,
            log_eps: item(dict, "log_eps")?.extract()?,
            interpolation: interpolation_of(item(dict, "interpolation")?.extract()?)?,
        },
        t_us: item(dict, "t_us")?.extract()?,
        luma: values(dict, "luma")?,
        log_intensity: values(dict, "log_intensity")?,
        rate: values(dict, "rate")?,
        base: values(dict, "base")?,
        on: values(dict, "on")?,
        off: values(dict, "off")?,
        last_event_us: values(dict, "last_event_us")?,
    })
}

fn item<'py>(dict: &Bound<'py, PyDict>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    dict.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("a state must have an entry {name:?}")))
}

fn values<T: Element + Copy>(dict: &Bound<'_, PyDict>, name: &str) -> PyResult<Vec<T>> {
    let py = dict.py();
    let rule =
        || PyValueError::new_err(format!("entry {name:?} of a state must be an array of {}", numpy::dtype::<T>(py)));
    let array = item(dict, name)?.cast_into::<PyArray1<T>>().map_err(|_| rule())?;
    let readonly: PyReadonlyArray1<'_, T> = array.readonly();
    Ok(readonly.as_array().to_vec())
}
