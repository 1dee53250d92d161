//! `Aedat4Recording` for Python.

use std::fs::File;
use std::path::PathBuf;

use numpy::IntoPyArray;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::image;
use super::files::naming;
use crate::aer::{ImuSample, STANDARD_GRAVITY, Trigger, TriggerKind};
use crate::error::Error;
use crate::event::SensorSize;
use crate::read::{Aedat4Frame, Aedat4Imu, Aedat4Kind, Aedat4Recording, Aedat4Trigger};

/// Reads what a file of AEDAT 4.0 holds: of each kind the first stream, in the order of the file.
///
/// Args:
///     path: the file.
///     kinds: what is unpacked of ``events``, ``imu``, ``frames`` and ``triggers``; the rest is passed over.
///     max_packet_bytes: what a packet may unpack to.
///
/// Raises:
///     ValueError: for a kind that there is not.
///     OSError: if it cannot be read.
///     DecodeError: if its header does not follow the format.
#[pyclass(name = "Aedat4Recording", module = "davis_rs._core")]
pub(super) struct PyAedat4Recording {
    name: String,
    recording: Aedat4Recording<File>,
}

#[pymethods]
impl PyAedat4Recording {
    #[new]
    #[allow(clippy::needless_pass_by_value, reason = "a list of Python's")]
    fn new(path: PathBuf, kinds: Vec<String>, max_packet_bytes: usize) -> PyResult<Self> {
        let name = path.display().to_string();
        let wanted = kinds.iter().map(|kind| kind_named(kind)).collect::<PyResult<Vec<_>>>()?;
        let file = File::open(&path).map_err(Error::io(&name))?;
        let recording = Aedat4Recording::new(file, wanted, max_packet_bytes).map_err(|error| naming(error, &name))?;
        Ok(Self { name, recording })
    }

    /// Read the next packets, some hundred kilobytes of the file; the GIL is released.
    ///
    /// Returns:
    ///     None at the end of the file, else
    ///
    ///     events: :data:`davis_rs.EVENT_DTYPE`; negative coordinates are 32,768 and more.
    ///     imu, triggers: :data:`davis_rs.IMU_DTYPE`, :data:`davis_rs.TRIGGER_DTYPE`.
    ///     frames: a list of :class:`davis_rs.Frame`.
    ///     other_packets: how many were passed over.
    ///
    /// Raises:
    ///     OSError: if it cannot be read.
    ///     DecodeError: for the first packet that does not follow the format, with its byte.
    fn read<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let piece = py.detach(|| self.recording.next_piece().map_err(|error| naming(error, &self.name)))?;
        let Some(piece) = piece else { return Ok(None) };
        let imu: Vec<ImuSample> = piece.imu.iter().map(sample).collect();
        let triggers: Vec<Trigger> = piece.triggers.iter().filter_map(trigger).collect();
        let frames = piece.frames.into_iter().map(|frame| python_frame(py, frame)).collect::<PyResult<Vec<_>>>()?;
        let piece_dict = PyDict::new(py);
        piece_dict.set_item("events", piece.events.into_pyarray(py))?;
        piece_dict.set_item("imu", imu.into_pyarray(py))?;
        piece_dict.set_item("frames", PyList::new(py, frames)?)?;
        piece_dict.set_item("triggers", triggers.into_pyarray(py))?;
        piece_dict.set_item("other_packets", piece.other_packets)?;
        Ok(Some(piece_dict))
    }

    /// The sensor's (width, height), where the header says.
    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.recording.size()
    }

    /// The camera that the header names, or "".
    #[getter]
    fn source(&self) -> &str {
        self.recording.source()
    }

    /// Whether the header announces a stream of events.
    #[getter]
    fn has_events(&self) -> bool {
        self.recording.has(Aedat4Kind::Events)
    }

    /// Bytes of the file that were read.
    #[getter]
    fn bytes(&self) -> usize {
        self.recording.bytes()
    }

    /// What the end of the file cuts off, and where; known once it was read to its end.
    #[getter]
    fn cut(&self) -> Option<String> {
        self.recording.cut()
    }
}

fn kind_named(name: &str) -> PyResult<Aedat4Kind> {
    Ok(match name {
        "events" => Aedat4Kind::Events,
        "imu" => Aedat4Kind::Imu,
        "frames" => Aedat4Kind::Frames,
        "triggers" => Aedat4Kind::Triggers,
        _ => return Err(PyValueError::new_err(format!("a recording has no {name:?}"))),
    })
}

/// Converts a sample to SI units.
fn sample(imu: &Aedat4Imu) -> ImuSample {
    let scaled = |values: [f32; 3], unit: f64| values.map(|value| f64::from(value) * unit);
    ImuSample {
        t: imu.t,
        accel: scaled(imu.accel, STANDARD_GRAVITY),
        gyro: scaled(imu.gyro, std::f64::consts::PI / 180.0),
        temperature: f64::from(imu.temperature),
    }
}

/// Converts a trigger to the numbers of the camera's wire; None for what tells of frames.
fn trigger(trigger: &Aedat4Trigger) -> Option<Trigger> {
    let kind = match trigger.kind {
        0 => TriggerKind::TimestampReset,
        1 => TriggerKind::InputRising,
        2 => TriggerKind::InputFalling,
        3 => TriggerKind::InputPulse,
        4 => TriggerKind::GeneratorRising,
        5 => TriggerKind::GeneratorFalling,
        _ => return None,
    };
    Some(Trigger::new(trigger.t, kind))
}

#[allow(clippy::cast_precision_loss, reason = "an exposure has few digits")]
fn python_frame(py: Python<'_>, frame: Aedat4Frame) -> PyResult<Bound<'_, PyAny>> {
    let exposure_us = (i128::from(frame.t_exposure_end) - i128::from(frame.t_exposure_start)) as f64;
    let pixels = image(py, frame.pixels, SensorSize { width: frame.width, height: frame.height })?;
    let times = (frame.t_start, frame.t_exposure_start, frame.t_exposure_end, frame.t_end);
    let fields = (times.0, times.1, times.2, times.3, frame.x, frame.y, pixels, true, exposure_us);
    py.import("davis_rs.events.decoded")?.call_method1("Frame", fields)
}
