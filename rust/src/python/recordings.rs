//! `read_aedat4` for Python.

use std::fs::File;
use std::path::PathBuf;

use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::arrays::image;
use super::files::naming;
use crate::aer::{ImuSample, STANDARD_GRAVITY, Trigger, TriggerKind};
use crate::error::Error;
use crate::event::SensorSize;
use crate::read::{Aedat4Frame, Aedat4Imu, Aedat4Recording, Aedat4Trigger};

/// Read what a file of AEDAT 4.0 holds: of each kind the first stream, in the order of the file.
///
/// Args:
///     path: the file.
///     max_packet_bytes: what a packet may unpack to.
///
/// Returns:
///     events: :data:`davis_rs.EVENT_DTYPE`; negative coordinates are 32,768 and more.
///     imu, triggers: :data:`davis_rs.IMU_DTYPE`, :data:`davis_rs.TRIGGER_DTYPE`.
///     size: (width, height), where the header says.
///     source: the camera that the header names, or "".
///     other_packets: of other streams, passed over.
///     cut: what the end of the file cuts off, and where.
///
/// Raises:
///     OSError: if it cannot be read.
///     DecodeError: for the first packet that does not follow the format, with its byte.
#[pyfunction]
pub(super) fn read_aedat4(py: Python<'_>, path: PathBuf, max_packet_bytes: usize) -> PyResult<Bound<'_, PyDict>> {
    let name = path.display().to_string();
    let recording = py.detach(|| {
        let file = File::open(&path).map_err(Error::io(&name))?;
        Aedat4Recording::read(file, max_packet_bytes).map_err(|error| naming(error, &name))
    })?;
    let imu: Vec<ImuSample> = recording.imu.iter().map(sample).collect();
    let triggers: Vec<Trigger> = recording.triggers.iter().filter_map(trigger).collect();
    let frames = recording.frames.into_iter().map(|frame| python_frame(py, frame)).collect::<PyResult<Vec<_>>>()?;
    let parts = PyDict::new(py);
    parts.set_item("events", recording.events.into_pyarray(py))?;
    parts.set_item("imu", imu.into_pyarray(py))?;
    parts.set_item("frames", PyList::new(py, frames)?)?;
    parts.set_item("triggers", triggers.into_pyarray(py))?;
    parts.set_item("size", recording.size)?;
    parts.set_item("source", recording.source)?;
    parts.set_item("other_packets", recording.other_packets)?;
    parts.set_item("cut", recording.cut)?;
    Ok(parts)
}

/// In SI units.
fn sample(imu: &Aedat4Imu) -> ImuSample {
    let scaled = |values: [f32; 3], unit: f64| values.map(|value| f64::from(value) * unit);
    ImuSample {
        t: imu.t,
        accel: scaled(imu.accel, STANDARD_GRAVITY),
        gyro: scaled(imu.gyro, std::f64::consts::PI / 180.0),
        temperature: f64::from(imu.temperature),
    }
}

/// By the numbers of the camera's wire; None for what tells of frames.
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
    py.import("davis_rs.decoded")?.call_method1("Frame", fields)
}
