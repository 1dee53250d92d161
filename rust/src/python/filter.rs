//! `EventFilter` for Python.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arrays::events;
use crate::event::{Event, SensorSize};
use crate::filter::{EventFilter, FilterRule};

/// Tell which events of a stream pass a rule; :mod:`davis_rs.filters` is made of it.
#[pyclass(name = "EventFilter", module = "davis_rs._core")]
pub(super) struct PyEventFilter(EventFilter);

#[pymethods]
impl PyEventFilter {
    /// Make a filter that passes events near which others came shortly before.
    ///
    /// Args:
    ///     size: (width, height) of the sensor.
    ///     window_us: how long before, in microseconds.
    ///     neighbours: how many of the eight pixels around must have had one.
    #[staticmethod]
    fn background_activity(size: (u16, u16), window_us: i64, neighbours: u8) -> Self {
        Self::of(size, FilterRule::BackgroundActivity { window_us, neighbours })
    }

    /// Make a filter that holds a pixel for a time after each event that passed.
    ///
    /// Args:
    ///     size: (width, height) of the sensor.
    ///     period_us: in microseconds.
    #[staticmethod]
    fn refractory(size: (u16, u16), period_us: i64) -> Self {
        Self::of(size, FilterRule::Refractory { period_us })
    }

    /// Make a filter that drops the events of pixels that flicker.
    ///
    /// Args:
    ///     size: (width, height) of the sensor.
    ///     shortest_us, longest_us: the periods that are flicker, in microseconds.
    ///     tolerance_us: by how much two periods in a row may differ.
    ///     periods: after so many even periods a pixel flickers.
    #[staticmethod]
    fn flicker(size: (u16, u16), shortest_us: i64, longest_us: i64, tolerance_us: i64, periods: u8) -> Self {
        Self::of(size, FilterRule::Flicker { shortest_us, longest_us, tolerance_us, periods })
    }

    /// Tell for each event whether it passes; the stream goes on from the call before.
    ///
    /// Args:
    ///     events: anything with the fields t, x, y, p, in the order of time.
    ///
    /// Returns:
    ///     bool, shape (n,).
    ///
    /// Raises:
    ///     ValueError: for an event outside of the sensor, of another polarity than 0 and 1, or earlier than the one
    ///         before it, with its index; then the filter has not changed.
    fn passes<'py>(
        &mut self,
        py: Python<'py>,
        #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let (filter, events) = (&mut self.0, events.as_slice()?);
        Ok(py.detach(|| filter.passes(events))?.into_pyarray(py))
    }
}

impl PyEventFilter {
    fn of((width, height): (u16, u16), rule: FilterRule) -> Self {
        Self(EventFilter::new(SensorSize { width, height }, rule))
    }
}
