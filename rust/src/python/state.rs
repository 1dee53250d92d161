//! The engine's state as a dictionary of arrays, and back.

use numpy::{Element, IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{threshold, threshold_to_python};
use super::{effects, interpolation, start_phase};
use crate::crossing::{CrossingParameters, EffectState, EngineState};
use crate::event::{Event, SensorSize};
use crate::readout::ReadoutState;

/// Raised when the meaning of an entry changes.
const VERSION: u32 = 6;

pub(super) fn to_dict(py: Python<'_>, state: EngineState) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let size = state.size;
    let threshold = |threshold| threshold_to_python(py, threshold, size);
    dict.set_item("version", VERSION)?;
    dict.set_item("width", size.width)?;
    dict.set_item("height", size.height)?;
    dict.set_item("contrast_threshold", threshold(state.parameters.contrast_threshold)?)?;
    dict.set_item("contrast_threshold_off", threshold(state.parameters.contrast_threshold_off)?)?;
    dict.set_item("log_eps", state.parameters.log_eps)?;
    dict.set_item("interpolation", interpolation::name(state.parameters.interpolation))?;
    dict.set_item("start_phase", start_phase::name(state.parameters.start_phase))?;
    dict.set_item("effects", effects::to_dict(py, &state.effects)?)?;
    dict.set_item("seed", state.seed)?;
    dict.set_item("t_us", state.t_us)?;
    dict.set_item("luma", state.luma.into_pyarray(py))?;
    dict.set_item("log_intensity", state.log_intensity.into_pyarray(py))?;
    dict.set_item("takes_luma", state.takes_luma)?;
    dict.set_item("rate", state.rate.into_pyarray(py))?;
    dict.set_item("base", state.base.into_pyarray(py))?;
    dict.set_item("on", state.on.into_pyarray(py))?;
    dict.set_item("off", state.off.into_pyarray(py))?;
    dict.set_item("last_event_us", state.last_event_us.into_pyarray(py))?;
    dict.set_item("effect_state", state.effect_state.map(|effects| effect_state_to_dict(py, effects)).transpose()?)?;
    dict.set_item("readout", state.readout.map(|readout| readout_to_dict(py, readout)).transpose()?)?;
    Ok(dict)
}

fn effect_state_to_dict(py: Python<'_>, state: EffectState) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("started_us", state.started_us)?;
    dict.set_item("photoreceptor", state.photoreceptor.into_pyarray(py))?;
    dict.set_item("filtered", state.filtered.into_pyarray(py))?;
    dict.set_item("held_us", state.held_us.into_pyarray(py))?;
    dict.set_item("noise_cell", state.noise_cell.into_pyarray(py))?;
    dict.set_item("noise_log_light", state.noise_log_light.into_pyarray(py))?;
    dict.set_item("noise_photoreceptor", state.noise_photoreceptor.into_pyarray(py))?;
    dict.set_item("noise_filtered", state.noise_filtered.into_pyarray(py))?;
    dict.set_item("leaked", state.leaked.into_pyarray(py))?;
    dict.set_item("leak_error", state.leak_error.into_pyarray(py))?;
    dict.set_item("hot_wait_us", state.hot_wait_us.into_pyarray(py))?;
    dict.set_item("hot_index", state.hot_index.into_pyarray(py))?;
    Ok(dict)
}

fn effect_state_from_dict(dict: &Bound<'_, PyDict>) -> PyResult<EffectState> {
    Ok(EffectState {
        started_us: item(dict, "started_us")?.extract()?,
        photoreceptor: values(dict, "photoreceptor")?,
        filtered: values(dict, "filtered")?,
        held_us: values(dict, "held_us")?,
        noise_cell: values(dict, "noise_cell")?,
        noise_log_light: values(dict, "noise_log_light")?,
        noise_photoreceptor: values(dict, "noise_photoreceptor")?,
        noise_filtered: values(dict, "noise_filtered")?,
        leaked: values(dict, "leaked")?,
        leak_error: values(dict, "leak_error")?,
        hot_wait_us: values(dict, "hot_wait_us")?,
        hot_index: values(dict, "hot_index")?,
    })
}

fn readout_to_dict(py: Python<'_>, state: ReadoutState) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("started_us", state.started_us)?;
    dict.set_item("waiting", state.waiting.into_pyarray(py))?;
    dict.set_item("stamped", state.stamped.into_pyarray(py))?;
    dict.set_item("free_us", state.free_us)?;
    dict.set_item("free_share", state.free_share)?;
    dict.set_item("last_stamp_us", state.last_stamp_us)?;
    dict.set_item("bursts", state.bursts)?;
    dict.set_item("dropped", state.dropped)?;
    dict.set_item("missed", state.missed)?;
    dict.set_item("ready_us", state.ready_us.into_pyarray(py))?;
    Ok(dict)
}

fn readout_from_dict(dict: &Bound<'_, PyDict>) -> PyResult<ReadoutState> {
    Ok(ReadoutState {
        started_us: item(dict, "started_us")?.extract()?,
        waiting: values::<Event>(dict, "waiting")?,
        stamped: values::<Event>(dict, "stamped")?,
        free_us: item(dict, "free_us")?.extract()?,
        free_share: item(dict, "free_share")?.extract()?,
        last_stamp_us: item(dict, "last_stamp_us")?.extract()?,
        bursts: item(dict, "bursts")?.extract()?,
        dropped: item(dict, "dropped")?.extract()?,
        missed: item(dict, "missed")?.extract()?,
        ready_us: values(dict, "ready_us")?,
    })
}

/// Returns a dictionary within the state, or None.
fn nested<'py, T>(
    dict: &Bound<'py, PyDict>,
    name: &str,
    read: impl FnOnce(&Bound<'py, PyDict>) -> PyResult<T>,
) -> PyResult<Option<T>> {
    let nested: Option<Bound<'_, PyDict>> = item(dict, name)?.extract()?;
    nested.map(|nested| read(&nested)).transpose()
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
            interpolation: interpolation::of_name(item(dict, "interpolation")?.extract()?)?,
            start_phase: start_phase::of_name(item(dict, "start_phase")?.extract()?)?,
        },
        effects: effects::from_python(Some(&item(dict, "effects")?))?,
        seed: item(dict, "seed")?.extract()?,
        t_us: item(dict, "t_us")?.extract()?,
        luma: values(dict, "luma")?,
        log_intensity: values(dict, "log_intensity")?,
        takes_luma: item(dict, "takes_luma")?.extract()?,
        rate: values(dict, "rate")?,
        base: values(dict, "base")?,
        on: values(dict, "on")?,
        off: values(dict, "off")?,
        last_event_us: values(dict, "last_event_us")?,
        effect_state: nested(dict, "effect_state", effect_state_from_dict)?,
        readout: nested(dict, "readout", readout_from_dict)?,
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
