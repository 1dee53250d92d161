//! Packets of EVT 3.0 for Python, as ROS messages hold them: words without a file around them.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::arrays::events;
use crate::event::Event;
use crate::read::{Decode, Evt3Decoder};
use crate::write::{Encode, Evt3Encoder};

/// Pack events as words of EVT 3.0 without a header, beginning with the high part of the first event's time.
///
/// Args:
///     events: anything with the fields t, x, y, p; times modulo 2^24 us are written.
///
/// Raises:
///     ValueError: for a time that goes back or is negative, and for a pixel outside of 2048 x 2048.
#[pyfunction]
pub(super) fn pack_evt3<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
) -> PyResult<Bound<'py, PyBytes>> {
    let events = events.as_slice()?;
    let mut words = Vec::new();
    if let Some(first) = events.first() {
        let mut encoder = Evt3Encoder::starting_at(first.t, 2048, 2048);
        crate::write::Limits { latest_us: i64::MAX, ..encoder.limits() }.check(events, 0)?;
        encoder.encode(events, &mut words);
    }
    Ok(PyBytes::new(py, &words))
}

/// Decodes a stream of EVT 3.0 that comes in packets, without a header; time and row go on from packet to packet.
#[pyclass(module = "davis_rs._core", name = "Evt3Stream")]
pub(super) struct PyEvt3Stream {
    decoder: Evt3Decoder,
    events: usize,
}

#[pymethods]
impl PyEvt3Stream {
    #[new]
    fn new() -> Self {
        Self { decoder: Evt3Decoder::of_words(), events: 0 }
    }

    /// Decode the next packet and return its events.
    ///
    /// Args:
    ///     packet: whole words, little-endian.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), times from the beginning of the round in which the stream began.
    ///     Events before the first time are left out.
    ///
    /// Raises:
    ///     ValueError: for an odd number of bytes.
    fn push<'py>(&mut self, py: Python<'py>, packet: &[u8]) -> PyResult<Bound<'py, PyArray1<Event>>> {
        if !packet.len().is_multiple_of(2) {
            let message = format!("EVT 3.0 has words of 2 bytes: got {} bytes", packet.len());
            return Err(crate::error::Error::Argument(message).into());
        }
        let mut events = Vec::new();
        self.decoder.decode(packet, &mut events)?;
        self.events += events.len();
        Ok(events.into_pyarray(py))
    }

    fn __repr__(&self) -> String {
        format!("<EVT 3.0 stream, {} events so far>", self.events)
    }
}
