//! `pack_event_message` and `unpack_event_message` for Python.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::arrays::events;
use crate::event::{Event, SensorSize};
use crate::ros;

/// Pack a ``dvs_msgs/EventArray`` as ROS 1 serializes it, stamped with the last event's time.
///
/// Args:
///     events: anything with the fields t, x, y, p.
///     size: (width, height) of the sensor.
///     seq: number of the message.
///     frame_id: name of the coordinate frame.
///
/// Raises:
///     ValueError: for a time outside of 0..2^32 s, with the event's index.
#[pyfunction]
pub(super) fn pack_event_message<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    size: (u16, u16),
    seq: u32,
    frame_id: &str,
) -> PyResult<Bound<'py, PyBytes>> {
    let (events, size, name) = (events.as_slice()?, SensorSize { width: size.0, height: size.1 }, frame_id.as_bytes());
    PyBytes::new_with(py, ros::packed_size(events.len(), name), |message| {
        Ok(ros::pack_events(message, events, size, seq, name)?)
    })
}

/// The events of a message, and the sensor's (width, height).
type Unpacked<'py> = (Bound<'py, PyArray1<Event>>, (u16, u16));

/// Return the events of a ``dvs_msgs/EventArray``, times rounded to the microsecond, and its (width, height).
///
/// Raises:
///     DecodeError: where the message breaks the definition, with the byte.
#[pyfunction]
pub(super) fn unpack_event_message<'py>(py: Python<'py>, message: &[u8]) -> PyResult<Unpacked<'py>> {
    let message = ros::unpack_events(message)?;
    Ok((message.events.into_pyarray(py), (message.size.width, message.size.height)))
}
