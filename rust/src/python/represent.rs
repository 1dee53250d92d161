//! `count_events`, `latest_times` and `voxel_grid` for Python.

use numpy::{Element, IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arrays::{events, microseconds};
use crate::error::Error;
use crate::event::{Event, SensorSize};
use crate::represent::{self, TimeBins};

/// See `_core.pyi`.
#[pyfunction]
pub(super) fn count_events<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
) -> PyResult<Bound<'py, PyArray3<u32>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    planes(py, py.detach(|| represent::count_events(events, size))?, size)
}

/// See `_core.pyi`.
#[pyfunction]
pub(super) fn latest_times<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    #[pyo3(from_py_with = microseconds)] until_us: i64,
) -> PyResult<Bound<'py, PyArray3<i64>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    planes(py, py.detach(|| represent::latest_times(events, size, until_us))?, size)
}

/// See `_core.pyi`.
#[pyfunction]
#[pyo3(signature = (events, size, bins, start_us, stop_us, endpoint))]
pub(super) fn voxel_grid<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    bins: usize,
    #[pyo3(from_py_with = microseconds)] start_us: i64,
    #[pyo3(from_py_with = microseconds)] stop_us: i64,
    endpoint: bool,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    let bins = TimeBins { start_us, stop_us, count: bins, endpoint };
    planes(py, py.detach(|| represent::voxel_grid(events, size, bins))?, size)
}

fn sensor((width, height): (u16, u16)) -> SensorSize {
    SensorSize { width, height }
}

/// Planes, each row by row, as an array of shape (planes, height, width).
fn planes<T: Element>(py: Python<'_>, cells: Vec<T>, size: SensorSize) -> PyResult<Bound<'_, PyArray3<T>>> {
    let count = cells.len().checked_div(size.pixels()).unwrap_or(0);
    cells
        .into_pyarray(py)
        .reshape([count, usize::from(size.height), usize::from(size.width)])
        .map_err(|e| Error::Argument(e.to_string()).into())
}
