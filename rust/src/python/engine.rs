//! `CrossingEngine` for Python.

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Float, column, frame, image, microseconds, threshold, threshold_to_python};
use super::{arrays, effects, state};
use crate::crossing::{CrossingEngine, CrossingParameters, Frame, Interpolation, SparseSamples};
use crate::error::Error;
use crate::event::{Event, SensorSize};

/// See `_core.pyi`.
#[pyclass(name = "CrossingEngine", module = "davis_rs._core")]
pub(super) struct PyCrossingEngine(CrossingEngine);

#[pymethods]
impl PyCrossingEngine {
    #[new]
    #[pyo3(signature = (
        width,
        height,
        *,
        contrast_threshold=None,
        contrast_threshold_off=None,
        log_eps=1e-3,
        interpolation="linear",
        effects=None,
        seed=None,
        threads=None,
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        width: i64,
        height: i64,
        contrast_threshold: Option<&Bound<'_, PyAny>>,
        contrast_threshold_off: Option<&Bound<'_, PyAny>>,
        log_eps: f64,
        interpolation: &str,
        effects: Option<&Bound<'_, PyAny>>,
        seed: Option<&Bound<'_, PyAny>>,
        threads: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let pixels = |name, n: i64| {
            let rule = || Error::Argument(format!("{name} must lie in 1..65535, got {n}"));
            u16::try_from(n).map_err(|_| rule())
        };
        let size = SensorSize { width: pixels("width", width)?, height: pixels("height", height)? };
        let default = CrossingParameters::default();
        let on = contrast_threshold.map(|c| threshold(c, "contrast_threshold", size)).transpose()?;
        let on = on.unwrap_or(default.contrast_threshold);
        let off = contrast_threshold_off.map(|c| threshold(c, "contrast_threshold_off", size)).transpose()?;
        let parameters = CrossingParameters {
            contrast_threshold_off: off.unwrap_or_else(|| on.clone()),
            contrast_threshold: on,
            log_eps,
            interpolation: interpolation_of(interpolation)?,
        };
        let effects = effects::from_python(effects)?;
        let seed = seed.map_or(Ok(0), arrays::seed)?;
        Ok(Self(CrossingEngine::with_effects(size, parameters, &effects, seed, arrays::threads(threads)?)?))
    }

    #[pyo3(signature = (t_us, luma, dluma_dt=None, *, sparse=None))]
    fn push<'py>(
        &mut self,
        t_us: &Bound<'py, PyAny>,
        luma: &Bound<'py, PyAny>,
        dluma_dt: Option<&Bound<'py, PyAny>>,
        sparse: Option<SparseArrays<'py>>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let names = ("luma", "dluma_dt");
        take(&mut self.0, CrossingEngine::push, t_us, (luma, dluma_dt, sparse), names)
    }

    #[pyo3(signature = (t_us, log_intensity, slope=None, *, sparse=None))]
    fn push_log<'py>(
        &mut self,
        t_us: &Bound<'py, PyAny>,
        log_intensity: &Bound<'py, PyAny>,
        slope: Option<&Bound<'py, PyAny>>,
        sparse: Option<SparseArrays<'py>>,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let names = ("log_intensity", "slope");
        take(&mut self.0, CrossingEngine::push_log, t_us, (log_intensity, slope, sparse), names)
    }

    fn flush<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<Event>> {
        self.0.flush().into_pyarray(py)
    }

    #[getter]
    fn dropped_events(&self) -> u64 {
        self.0.dropped_events()
    }

    #[getter]
    fn contrast_threshold<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        threshold_to_python(py, self.0.parameters().contrast_threshold.clone(), self.0.size())
    }

    #[getter]
    fn contrast_threshold_off<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        threshold_to_python(py, self.0.parameters().contrast_threshold_off.clone(), self.0.size())
    }

    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        image(py, self.0.reference(), self.0.size())
    }

    #[getter]
    fn last_event_us<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        image(py, self.0.last_event_us(), self.0.size())
    }

    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        state::to_dict(py, self.0.state())
    }

    #[staticmethod]
    #[pyo3(signature = (state, *, threads=None))]
    fn from_state(state: &Bound<'_, PyDict>, threads: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        Ok(Self(CrossingEngine::from_state(&state::from_dict(state)?, arrays::threads(threads)?)?))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        Ok((py.get_type::<Self>().getattr("from_state")?, (self.state(py)?,)))
    }
}

/// Pixel, time and value of sparse samples, as a user gives them.
type SparseArrays<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Feeds an engine by one of its two ways, without the GIL.
fn take<'py, S: Float + Sync>(
    engine: &mut CrossingEngine,
    push: impl Fn(&mut CrossingEngine, Frame<'_, S>, &mut Vec<Event>) -> Result<(), Error> + Send + Sync,
    t_us: &Bound<'py, PyAny>,
    (samples, rate, sparse): (&Bound<'py, PyAny>, Option<&Bound<'py, PyAny>>, Option<SparseArrays<'py>>),
    names: (&str, &str),
) -> PyResult<Bound<'py, PyArray1<Event>>> {
    let py = t_us.py();
    let size = Some(engine.size());
    let samples = frame::<S>(samples, names.0, size)?;
    let rate = rate.map(|rate| frame::<S>(rate, names.1, size)).transpose()?;
    let sparse = sparse
        .map(|(pixel, t_us, value)| {
            let pixel = column::<u32>(&pixel, "the pixels of sparse samples")?;
            let t_us = column::<i64>(&t_us, "the times of sparse samples")?;
            PyResult::Ok((pixel, t_us, column::<S>(&value, "the values of sparse samples")?))
        })
        .transpose()?;
    let mut input = Frame::new(microseconds(t_us)?, samples.as_slice()?);
    input.rate = rate.as_ref().map(|rate| rate.as_slice()).transpose()?;
    if let Some((pixel, t_us, samples)) = &sparse {
        input.sparse = SparseSamples { pixel: pixel.as_slice()?, t_us: t_us.as_slice()?, samples: samples.as_slice()? };
    }
    let mut events = Vec::new();
    py.detach(|| push(engine, input, &mut events))?;
    Ok(events.into_pyarray(py))
}

/// The interpolation by its name.
pub(super) fn interpolation_of(name: &str) -> Result<Interpolation, Error> {
    match name {
        "linear" => Ok(Interpolation::Linear),
        "hermite" => Ok(Interpolation::Hermite),
        _ => Err(Error::Argument(format!("interpolation must be 'linear' or 'hermite', got {name:?}"))),
    }
}
