//! `count_events`, `latest_times`, `voxel_grid` and `spike_tensor` for Python.

use numpy::{Element, IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arrays::{events, microseconds};
use crate::error::Error;
use crate::event::{Event, SensorSize};
use crate::represent::{self, Measurement, TimeBins};

/// Count events by polarity and pixel.
///
/// Args:
///     events: anything with the fields t, x, y, p.
///     size: (width, height) of the sensor.
///
/// Returns:
///     uint32, shape (2, height, width), OFF before ON.
///
/// Raises:
///     ValueError: for an event outside of the sensor or of a polarity other than 0 or 1, with its index.
#[pyfunction]
pub(super) fn count_events<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
) -> PyResult<Bound<'py, PyArray3<u32>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    planes(py, py.detach(|| represent::count_events(events, size))?, size)
}

/// Find the last events up to ``until_us`` by polarity and pixel: times in microseconds, -1 where there were fewer.
///
/// Args:
///     events: anything with the fields t, x, y, p, in any order.
///     size: (width, height) of the sensor.
///     until_us: later events are left out.
///     depth: how many events of a pixel and polarity, >= 1.
///
/// Returns:
///     int64, shape (2 * depth, height, width), OFF before ON, of each the latest first.
///
/// Raises:
///     ValueError: as :func:`count_events`, or for ``depth`` < 1.
#[pyfunction]
#[pyo3(signature = (events, size, until_us, depth = 1))]
pub(super) fn latest_times<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    #[pyo3(from_py_with = microseconds)] until_us: i64,
    depth: usize,
) -> PyResult<Bound<'py, PyArray3<i64>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    planes(py, py.detach(|| represent::latest_times(events, size, until_us, depth))?, size)
}

/// Sum polarities (+1 ON, -1 OFF) in planes of time; :func:`davis_rs.events.represent.voxel_grid` is made of it.
///
/// Each event is shared by the two planes around it, in proportion to how near it is to each.
///
/// Args:
///     events: anything with the fields t, x, y, p; those outside of the window are left out.
///     size: (width, height) of the sensor.
///     bins: number of planes, >= 1.
///     start_us, stop_us: the window in microseconds, start <= t < stop; the first plane is at ``start_us``.
///     include_stop: whether events at ``stop_us`` count too.
///     endpoint: whether the last plane is at ``stop_us``, or one step before it.
///
/// Returns:
///     float64, shape (bins, height, width).
///
/// Raises:
///     ValueError: as :func:`count_events`, for ``bins`` < 1, or for a window that ends before it starts.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
#[pyo3(signature = (events, size, bins, start_us, stop_us, include_stop, endpoint))]
pub(super) fn voxel_grid<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    bins: usize,
    #[pyo3(from_py_with = microseconds)] start_us: i64,
    #[pyo3(from_py_with = microseconds)] stop_us: i64,
    include_stop: bool,
    endpoint: bool,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    let bins = TimeBins { start_us, stop_us, include_stop, count: bins, endpoint };
    planes(py, py.detach(|| represent::voxel_grid(events, size, bins))?, size)
}

/// Sum measurements of events in planes of time, by polarity: :func:`davis_rs.events.represent.event_spike_tensor`.
///
/// Each event is shared by the two planes around it, in proportion to how near it is to each.
///
/// Args:
///     events: anything with the fields t, x, y, p; those outside of the window are left out.
///     size: (width, height) of the sensor.
///     bins: number of planes of each polarity, >= 1.
///     start_us, stop_us: the window in microseconds, start <= t < stop; planes go from ``start_us`` to ``stop_us``.
///     include_stop: whether events at ``stop_us`` count too.
///     times: whether an event adds its position in the window (0 at the start, 1 at the end), or one.
///
/// Returns:
///     float64, shape (2 * bins, height, width), OFF before ON.
///
/// Raises:
///     ValueError: as :func:`voxel_grid`.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
#[pyo3(signature = (events, size, bins, start_us, stop_us, include_stop, times))]
pub(super) fn spike_tensor<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    bins: usize,
    #[pyo3(from_py_with = microseconds)] start_us: i64,
    #[pyo3(from_py_with = microseconds)] stop_us: i64,
    include_stop: bool,
    times: bool,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (events, size) = (events.as_slice()?, sensor(size));
    let bins = TimeBins { start_us, stop_us, include_stop, count: bins, endpoint: true };
    let measurement = if times { Measurement::Time } else { Measurement::Count };
    planes(py, py.detach(|| represent::spike_tensor(events, size, bins, measurement))?, size)
}

fn sensor((width, height): (u16, u16)) -> SensorSize {
    SensorSize { width, height }
}

/// Returns planes, each row by row, as an array of shape (planes, height, width).
fn planes<T: Element>(py: Python<'_>, cells: Vec<T>, size: SensorSize) -> PyResult<Bound<'_, PyArray3<T>>> {
    let count = cells.len().checked_div(size.pixels()).unwrap_or(0);
    cells
        .into_pyarray(py)
        .reshape([count, usize::from(size.height), usize::from(size.width)])
        .map_err(|e| Error::Argument(e.to_string()).into())
}
