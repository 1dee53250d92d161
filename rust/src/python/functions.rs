//! `log_intensity` and `reconstruct` for Python.

use numpy::{PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arrays::{events, frame, image, size_of, threshold};
use crate::event::Event;

/// See `_core.pyi`.
#[pyfunction]
pub(super) fn log_intensity<'py>(luma: &Bound<'py, PyAny>, log_eps: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let luma = frame::<f32>(luma, "luma", None)?;
    let size = size_of(&luma)?;
    let logs = crate::log_intensity::log_intensity_frame(luma.as_slice()?, size, log_eps)?;
    image(luma.py(), logs, size)
}

/// See `_core.pyi`.
#[pyfunction]
#[pyo3(signature = (events, first_log_intensity, t_us, contrast_threshold, contrast_threshold_off=None))]
pub(super) fn reconstruct<'py>(
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    first_log_intensity: &Bound<'py, PyAny>,
    t_us: i64,
    contrast_threshold: &Bound<'py, PyAny>,
    contrast_threshold_off: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let first = frame::<f64>(first_log_intensity, "first_log_intensity", None)?;
    let size = size_of(&first)?;
    let on = threshold(contrast_threshold, "contrast_threshold", size)?;
    let off = contrast_threshold_off.map(|c| threshold(c, "contrast_threshold_off", size)).transpose()?;
    let off = off.as_ref().unwrap_or(&on);
    let logs = crate::crossing::reconstruct(events.as_slice()?, first.as_slice()?, size, t_us, &on, off)?;
    image(first.py(), logs, size)
}
