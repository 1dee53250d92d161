//! `CrossingEngine`, `log_intensity` and `reconstruct` for Python.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use super::arrays::{events, frame, size_of};
use crate::crossing::{self, CrossingEngine, CrossingParameters};
use crate::error::Error;
use crate::event::{Event, SensorSize};

/// See `_core.pyi`.
#[pyclass(name = "CrossingEngine", module = "davis_rs._core")]
pub(super) struct PyCrossingEngine(CrossingEngine);

#[pymethods]
impl PyCrossingEngine {
    #[new]
    #[pyo3(signature = (width, height, *, contrast_threshold=0.15, contrast_threshold_off=None, log_eps=1e-3, threads=None))]
    fn new(
        width: u16,
        height: u16,
        contrast_threshold: f64,
        contrast_threshold_off: Option<f64>,
        log_eps: f64,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let parameters = CrossingParameters {
            contrast_threshold,
            contrast_threshold_off: contrast_threshold_off.unwrap_or(contrast_threshold),
            log_eps,
        };
        Ok(Self(CrossingEngine::new(SensorSize { width, height }, parameters, threads)?))
    }

    fn push<'py>(
        &mut self,
        py: Python<'py>,
        t_us: i64,
        luma: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let luma = frame::<f32>(luma, "luma", Some(self.0.size()))?;
        let luma = luma.as_slice()?;
        Ok(py.detach(|| self.0.push(t_us, luma))?.into_pyarray(py))
    }

    fn push_log<'py>(
        &mut self,
        py: Python<'py>,
        t_us: i64,
        log_intensity: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let log_intensity = frame::<f64>(log_intensity, "log_intensity", Some(self.0.size()))?;
        let log_intensity = log_intensity.as_slice()?;
        Ok(py.detach(|| self.0.push_log(t_us, log_intensity))?.into_pyarray(py))
    }

    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        image(py, self.0.reference(), self.0.size())
    }

    #[getter]
    fn last_event_us<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        image(py, self.0.last_event_us(), self.0.size())
    }
}

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
    #[pyo3(from_py_with = events)] events: numpy::PyReadonlyArray1<'py, Event>,
    first_log_intensity: &Bound<'py, PyAny>,
    t_us: i64,
    contrast_threshold: f64,
    contrast_threshold_off: Option<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let first = frame::<f64>(first_log_intensity, "first_log_intensity", None)?;
    let size = size_of(&first)?;
    let off = contrast_threshold_off.unwrap_or(contrast_threshold);
    let logs = crossing::reconstruct(events.as_slice()?, first.as_slice()?, size, t_us, contrast_threshold, off)?;
    image(first.py(), logs, size)
}

fn image<T: numpy::Element>(py: Python<'_>, pixels: Vec<T>, size: SensorSize) -> PyResult<Bound<'_, PyArray2<T>>> {
    pixels
        .into_pyarray(py)
        .reshape([usize::from(size.height), usize::from(size.width)])
        .map_err(|e| Error::Argument(e.to_string()).into())
}
