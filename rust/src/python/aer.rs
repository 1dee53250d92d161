//! `Device`, `Decoder` and `Encoder` for Python.

use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyMemoryView};

use super::arrays::{self, column, image};
use crate::aer::{
    Chip, Decoded, Decoder, Device, Encoder, Frame, ImuGroups, ImuReading, ImuSample, ImuType, Region, Trigger,
    TriggerKind,
};
use crate::error::Error;
use crate::event::SensorSize;

/// The bits of the orientation registers.
const SWAPPED: u32 = 4;
const FLIP_X: u32 = 2;
const FLIP_Y: u32 = 1;

/// What a decoder has to know of a camera: its chip, sizes, orientation, inertial sensor and converter clock.
///
/// Only the chip is needed; what is not given is as the chip has it by default. For a live camera, pass what its
/// registers say, unchanged. Numbers in parentheses are (module, parameter) of the camera's configuration.
///
/// On some chips (the DAVIS346) x and y are swapped on the wire: a row there is a column of the image. ``width`` and
/// ``height`` are always those of the image.
///
/// Args:
///     chip: ``DAVIS240A``, ``DAVIS240B``, ``DAVIS240C``, ``DAVIS128``, ``DAVIS346A``, ``DAVIS346B``, ``DAVIS346C`` or
///         ``DAVIS640``; or the number by which the camera names it (module 6, parameter 1).
///     dvs_columns, dvs_rows: sizes of the event array on the wire (1, 0) and (1, 1), 1..4096.
///     dvs_orientation: (1, 2): bit 2 = x and y swapped.
///     aps_columns, aps_rows: sizes of the frame array on the wire (2, 0) and (2, 1), 1..4096.
///     aps_orientation: (2, 2): bits 2 = x and y swapped, 1 = columns from the last on, 0 = rows from the last on.
///     imu_type: (3, 0): 2 = MPU-9250, otherwise the MPU-6050's family; they count temperature differently.
///     imu_flips: (3, 1): axes to be negated, bits 2 = x, 1 = y, 0 = z.
///     adc_mhz: clock of the frame converter in MHz, in which exposures are counted; 30 if not given.
///
/// Raises:
///     ValueError: for a chip whose stream is not understood, or a size out of range.
#[pyclass(name = "Device", module = "davis_rs._core", frozen)]
pub(super) struct PyDevice(Device);

#[pymethods]
impl PyDevice {
    #[new]
    #[pyo3(signature = (
        chip,
        *,
        dvs_columns=None,
        dvs_rows=None,
        dvs_orientation=None,
        aps_columns=None,
        aps_rows=None,
        aps_orientation=None,
        imu_type=None,
        imu_flips=None,
        adc_mhz=None,
    ))]
    #[allow(clippy::too_many_arguments, reason = "one for each register")]
    fn new(
        chip: &Bound<'_, PyAny>,
        dvs_columns: Option<i64>,
        dvs_rows: Option<i64>,
        dvs_orientation: Option<u32>,
        aps_columns: Option<i64>,
        aps_rows: Option<i64>,
        aps_orientation: Option<u32>,
        imu_type: Option<u32>,
        imu_flips: Option<u32>,
        adc_mhz: Option<f64>,
    ) -> PyResult<Self> {
        let chip = match chip.extract::<u32>() {
            Ok(id) => Chip::from_id(id)?,
            Err(_) => Chip::from_name(chip.extract()?)?,
        };
        let mut device = Device::new(chip);
        let set = |name: &str, to: &mut u16, from: Option<i64>| {
            let Some(n) = from else { return Ok(()) };
            let rule = |_| Error::Argument(format!("{name} must lie in 1..4096, got {n}"));
            u16::try_from(n).map_err(rule).map(|n| *to = n)
        };
        set("dvs_columns", &mut device.dvs_columns, dvs_columns)?;
        set("dvs_rows", &mut device.dvs_rows, dvs_rows)?;
        set("aps_columns", &mut device.aps_columns, aps_columns)?;
        set("aps_rows", &mut device.aps_rows, aps_rows)?;
        if let Some(bits) = dvs_orientation {
            device.dvs_swapped = bits & SWAPPED != 0;
        }
        if let Some(bits) = aps_orientation {
            device.aps_swapped = bits & SWAPPED != 0;
            device.aps_flip_x = bits & FLIP_X != 0;
            device.aps_flip_y = bits & FLIP_Y != 0;
        }
        if let Some(number) = imu_type {
            device.imu_type = ImuType::of(number);
        }
        if let Some(bits) = imu_flips {
            device.imu_flips = [4, 2, 1].map(|bit| bits & bit != 0);
        }
        device.adc_mhz = adc_mhz.unwrap_or(device.adc_mhz);
        device.check()?;
        Ok(Self(device))
    }

    /// The chip's name.
    #[getter]
    fn chip(&self) -> &str {
        self.0.chip.name()
    }

    /// Number of columns of the events' image: x is less than this.
    #[getter]
    fn width(&self) -> u16 {
        self.0.size().width
    }

    /// Number of rows of the events' image: y is less than this.
    #[getter]
    fn height(&self) -> u16 {
        self.0.size().height
    }

    /// Columns of a full frame.
    #[getter]
    fn frame_width(&self) -> u16 {
        self.0.frame_size().width
    }

    /// Rows of a full frame.
    #[getter]
    fn frame_height(&self) -> u16 {
        self.0.frame_size().height
    }

    /// Clock of the frame converter in MHz, in which exposures are counted.
    #[getter]
    fn adc_mhz(&self) -> f64 {
        self.0.adc_mhz
    }

    fn __repr__(&self) -> String {
        device_repr(&self.0)
    }
}

fn device_repr(device: &Device) -> String {
    let SensorSize { width, height } = device.size();
    format!("Device({:?}, {width} x {height})", device.chip.name())
}

/// Reads a device, or the name of a chip.
fn device(device: &Bound<'_, PyAny>) -> PyResult<Device> {
    if let Ok(device) = device.cast::<PyDevice>() {
        return Ok(device.get().0.clone());
    }
    Ok(Device::new(Chip::from_name(device.extract()?)?))
}

/// Decodes the USB stream of a DAVIS (logic version 18), piece by piece.
///
/// Any split of the stream into pieces decodes alike; an odd byte at the end of a piece waits for the next one. No
/// input makes it fail: what a malformed stream makes unusable is dropped and counted in :attr:`stats`. Between two
/// pieces it keeps at most one frame and one inertial sample.
///
/// Times are microseconds since the stream began or the camera's clock was last reset, int64, without overflow. Where a
/// malformed stream goes back in time, so do they.
///
/// Args:
///     device: the name of a chip, or a :class:`Device` where sizes or orientation differ from the chip's own.
///     imu_counts: inertial samples in counts of the sensor (:data:`davis_rs.IMU_COUNTS_DTYPE`) instead of SI units.
///
/// Raises:
///     ValueError: for a chip whose stream is not understood.
///
/// Source: the public drivers libcaer 3.3 and jAER, and the logic's VHDL.
#[pyclass(name = "Decoder", module = "davis_rs._core")]
pub(super) struct PyDecoder {
    decoder: Decoder,
    imu_counts: bool,
}

#[pymethods]
impl PyDecoder {
    #[new]
    #[pyo3(signature = (device, *, imu_counts=false))]
    fn new(#[pyo3(from_py_with = device)] device: Device, imu_counts: bool) -> PyResult<Self> {
        Ok(Self { decoder: Decoder::new(device)?, imu_counts })
    }

    /// Decode the next bytes of the stream; the GIL is released.
    ///
    /// Args:
    ///     data: contiguous bytes, or 16-bit words in the machine's order. They are taken without a copy, so do not
    ///         change them while this runs.
    ///
    /// Returns:
    ///     What these bytes complete, ``(events, imu, frames, triggers)``: arrays of :data:`davis_rs.EVENT_DTYPE`,
    ///     :data:`davis_rs.IMU_DTYPE` (or :data:`davis_rs.IMU_COUNTS_DTYPE`) and :data:`davis_rs.TRIGGER_DTYPE`, and
    ///     a list of :class:`davis_rs.Frame`. Events keep the order of the wire. A frame that lacks its samples takes
    ///     some 200 times the memory of the words that make it: push a stream that you do not trust in pieces.
    ///
    /// Raises:
    ///     ValueError: for data of another kind.
    fn push<'py>(&mut self, data: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let py = data.py();
        let bytes = bytes(data)?;
        let bytes = bytes.as_slice()?;
        let mut decoded = Decoded::default();
        py.detach(|| self.decoder.push(bytes, &mut decoded));
        let Decoded { events, imu, frames, triggers } = decoded;
        let imu_type = self.decoder.device().imu_type;
        let imu = if self.imu_counts {
            imu.into_pyarray(py).into_any()
        } else {
            let samples: Vec<ImuSample> = imu.iter().map(|reading| reading.sample(imu_type)).collect();
            samples.into_pyarray(py).into_any()
        };
        let frames = frames.into_iter().map(|frame| self.frame(py, frame)).collect::<PyResult<Vec<_>>>()?;
        let (events, triggers) = (events.into_pyarray(py), triggers.into_pyarray(py));
        py.import("davis_rs.events.decoded")?.call_method1("Decoded", (events, imu, PyList::new(py, frames)?, triggers))
    }

    /// The camera whose stream is decoded.
    #[getter]
    fn device(&self) -> PyDevice {
        PyDevice(self.decoder.device().clone())
    }

    /// Counts of faults in the stream, by kind; all zero for one without a fault.
    ///
    /// - ``unknown_words``: words that mean nothing, the reserved 0x0000 among them; ignored
    /// - ``times_not_increasing``: timestamps and wraps that do not go forward; obeyed
    /// - ``addresses_out_of_range``: rows and columns outside of the array; dropped
    /// - ``columns_without_row``: columns before any row; dropped
    /// - ``imu_malformed``: inertial samples too short, too long or without a scale; dropped
    /// - ``imu_unended``: inertial samples whose end never came; dropped
    /// - ``imu_stray_words``: words of inertial samples where none had begun, a second end among them; ignored
    /// - ``imu_repeated_scales``: scales that came again within a sample, which then begins anew
    /// - ``frame_stray_words``: words of frames where none had begun; ignored
    /// - ``samples_missing``: samples that their column lacked; 0 instead
    /// - ``samples_extra``: samples beyond the end of their column or of the region; ignored
    /// - ``exposure_words_extra``: exposure words beyond the third of a frame; ignored
    /// - ``exposure_marks_missing``: frames without start or end of exposure; that time is then the one before it
    /// - ``frames_wrong_columns``: frames of which a read did not see every column once; dropped
    /// - ``frames_bad_region``: frames without one whole region on the sensor before the samples; dropped
    /// - ``frames_unended``: frames whose end never came; dropped
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = PyDict::new(py);
        self.decoder.stats().iter().try_for_each(|(name, count)| stats.set_item(name, count))?;
        Ok(stats)
    }

    fn __repr__(&self) -> String {
        let imu_counts = if self.imu_counts { "True" } else { "False" };
        let seen = self.decoder.stats().iter().filter(|(_, count)| *count > 0);
        let stats = seen.map(|(name, count)| format!("{name}={count}")).collect::<Vec<_>>().join(", ");
        let stats = if stats.is_empty() { "all zero".to_owned() } else { stats };
        format!("Decoder({}, imu_counts={imu_counts}, stats: {stats})", device_repr(self.decoder.device()))
    }
}

impl PyDecoder {
    fn frame<'py>(&self, py: Python<'py>, frame: Frame) -> PyResult<Bound<'py, PyAny>> {
        let Region { x, y, width, height } = frame.region;
        let times = (frame.t_start, frame.t_exposure_start, frame.t_exposure_end, frame.t_end);
        let exposure_us = f64::from(frame.exposure_cycles) / self.decoder.device().adc_mhz;
        let pixels = image(py, frame.pixels, SensorSize { width, height })?;
        let fields = (times.0, times.1, times.2, times.3, x, y, pixels, frame.global_shutter, exposure_us);
        py.import("davis_rs.events.decoded")?.call_method1("Frame", fields)
    }
}

/// Returns the bytes of a buffer of bytes or of 16-bit words, without a copy.
fn bytes<'py>(data: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray1<'py, u8>> {
    let py = data.py();
    let rule = |given: String| {
        PyValueError::new_err(format!(
            "data must be contiguous bytes or 16-bit words in the machine's order (bytes, bytearray, memoryview, or a \
             uint8 or uint16 array), got {given}"
        ))
    };
    let view = PyMemoryView::from(data).map_err(|_| rule(data.get_type().to_string()))?;
    let format: String = view.getattr("format")?.extract()?;
    if !matches!(format.as_str(), "B" | "b" | "c" | "H" | "<H") || !view.getattr("c_contiguous")?.extract()? {
        return Err(rule(format!("a buffer of format {format:?} and strides {}", view.getattr("strides")?)));
    }
    if view.getattr("nbytes")?.extract::<usize>()? == 0 {
        return Ok(PyArray1::zeros(py, 0, false).readonly());
    }
    let array = py.import("numpy")?.call_method1("frombuffer", (view, numpy::dtype::<u8>(py)))?;
    Ok(array.cast_into::<PyArray1<u8>>()?.readonly())
}

/// Encodes what a DAVIS would send: the inverse of :class:`Decoder`.
///
/// As the camera's logic does, it sends a timestamp only when time changed, wraps in one word where nothing happened
/// between them, and a row once for the columns that share its time. Decoding gives back what was encoded, but for what
/// the wire does not carry: of a pixel the upper ten bits (on a DAVIS240 nine, and white); and a frame or an inertial
/// sample that lies across a multiple of 2^31 us, which decoders lose.
///
/// Args:
///     device: the name of a chip, or a :class:`Device`.
///     accel_range, gyro_range: full scales for inertial samples in SI units, 0..3: 2, 4, 8, 16 g and 250, 500, 1000,
///         2000 deg/s. Samples in counts bring their own.
///
/// Raises:
///     ValueError: for a chip whose stream is not understood, or a range out of range.
#[pyclass(name = "Encoder", module = "davis_rs._core")]
pub(super) struct PyEncoder {
    encoder: Encoder,
    accel_range: u8,
    gyro_range: u8,
}

#[pymethods]
impl PyEncoder {
    #[new]
    #[pyo3(signature = (device, *, accel_range=1, gyro_range=1))]
    fn new(#[pyo3(from_py_with = device)] device: Device, accel_range: u8, gyro_range: u8) -> PyResult<Self> {
        let range = |name, n| match n {
            0..=3 => Ok(n),
            _ => Err(Error::Argument(format!("{name} must lie in 0..3, got {n}"))),
        };
        let (accel_range, gyro_range) = (range("accel_range", accel_range)?, range("gyro_range", gyro_range)?);
        Ok(Self { encoder: Encoder::new(device)?, accel_range, gyro_range })
    }

    /// Encode the next packet and return its bytes; the GIL is released.
    ///
    /// Times must lie in 0..2^48 us, may not decrease within a kind, nor lie before the last time encoded; frames may
    /// not overlap. A trigger that resets the clock comes first, at time 0; what follows counts from there.
    ///
    /// Args:
    ///     events: anything with the fields t, x, y, p.
    ///     imu: :data:`davis_rs.IMU_DTYPE` (rounded to counts, which saturate) or :data:`davis_rs.IMU_COUNTS_DTYPE`.
    ///     frames: :class:`davis_rs.Frame`, full ones or parts of the image.
    ///     triggers: :data:`davis_rs.TRIGGER_DTYPE`.
    ///
    /// Returns:
    ///     Little-endian 16-bit words.
    ///
    /// Raises:
    ///     ValueError: for times that go back, or what does not fit the camera, with the index; nothing is encoded
    ///         then.
    #[pyo3(signature = (events=None, imu=None, frames=None, triggers=None))]
    fn encode<'py>(
        &mut self,
        py: Python<'py>,
        events: Option<&Bound<'py, PyAny>>,
        imu: Option<&Bound<'py, PyAny>>,
        frames: Option<&Bound<'py, PyAny>>,
        triggers: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let events = events.map(|array| PyResult::Ok(arrays::events(array)?.as_slice()?.to_vec())).transpose()?;
        let packet = Decoded {
            events: events.unwrap_or_default(),
            imu: imu.map(|array| self.readings(array)).transpose()?.unwrap_or_default(),
            frames: match frames {
                Some(frames) => frames.try_iter()?.map(|frame| self.frame(&frame?)).collect::<PyResult<_>>()?,
                None => Vec::new(),
            },
            triggers: triggers.map(read_triggers).transpose()?.unwrap_or_default(),
        };
        let words = py.detach(|| self.encoder.encode(&packet))?;
        Ok(PyBytes::new(py, &words))
    }

    /// The camera whose stream is made.
    #[getter]
    fn device(&self) -> PyDevice {
        PyDevice(self.encoder.device().clone())
    }

    fn __repr__(&self) -> String {
        let (device, t_us) = (device_repr(self.encoder.device()), self.encoder.t_us());
        format!("Encoder({device}, accel_range={}, gyro_range={}, t_us={t_us})", self.accel_range, self.gyro_range)
    }
}

impl PyEncoder {
    /// Returns inertial samples of either dtype.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "read back as what they are")]
    fn readings(&self, array: &Bound<'_, PyAny>) -> PyResult<Vec<ImuReading>> {
        let t = field::<i64>(array, "t")?;
        if !array.getattr("dtype")?.getattr("names")?.contains("groups")? {
            let (accel, gyro) = (field::<f64>(array, "accel")?, field::<f64>(array, "gyro")?);
            let temperature = field::<f64>(array, "temperature")?;
            let samples = t.iter().zip(accel.as_chunks().0).zip(gyro.as_chunks().0).zip(temperature);
            let imu_type = self.encoder.device().imu_type;
            return Ok(samples
                .map(|(((&t, &accel), &gyro), temperature)| {
                    let sample = ImuSample { t, accel, gyro, temperature };
                    ImuReading::nearest(&sample, imu_type, self.accel_range, self.gyro_range)
                })
                .collect());
        }
        let (accel, gyro) = (field::<i16>(array, "accel")?, field::<i16>(array, "gyro")?);
        let temperature = field::<i16>(array, "temperature")?;
        let [groups, accel_range, gyro_range] =
            ["groups", "accel_range", "gyro_range"].map(|name| field::<u8>(array, name));
        let vectors = t.iter().zip(accel.as_chunks().0).zip(gyro.as_chunks().0).zip(temperature);
        let scales = groups?.into_iter().zip(accel_range?).zip(gyro_range?);
        Ok(vectors
            .zip(scales)
            .map(|((((&t, &accel), &gyro), temperature), ((groups, accel_range), gyro_range))| ImuReading {
                accel,
                gyro,
                temperature,
                ..ImuReading::new(t, ImuGroups(groups), accel_range, gyro_range)
            })
            .collect())
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, and is then refused")]
    fn frame(&self, frame: &Bound<'_, PyAny>) -> PyResult<Frame> {
        let pixels: PyReadonlyArray2<'_, u16> = frame
            .getattr("pixels")?
            .cast_into::<PyArray2<u16>>()
            .map_err(|_| PyValueError::new_err("pixels of a frame must be a uint16 array of shape (height, width)"))?
            .readonly();
        let [height, width] = [0, 1].map(|axis| u16::try_from(pixels.shape()[axis]).unwrap_or(u16::MAX));
        let exposure_us: f64 = frame.getattr("exposure_us")?.extract()?;
        Ok(Frame {
            t_start: frame.getattr("t")?.extract()?,
            t_exposure_start: frame.getattr("t_exposure_start")?.extract()?,
            t_exposure_end: frame.getattr("t_exposure_end")?.extract()?,
            t_end: frame.getattr("t_end")?.extract()?,
            region: Region { x: frame.getattr("x")?.extract()?, y: frame.getattr("y")?.extract()?, width, height },
            global_shutter: frame.getattr("global_shutter")?.extract()?,
            exposure_cycles: (exposure_us * self.encoder.device().adc_mhz).round() as u32,
            pixels: pixels.as_array().iter().copied().collect(),
        })
    }
}

fn read_triggers(array: &Bound<'_, PyAny>) -> PyResult<Vec<Trigger>> {
    let kinds = field::<u8>(array, "kind")?;
    let triggers = field::<i64>(array, "t")?.into_iter().zip(kinds).enumerate().map(|(index, (t, kind))| {
        let rule = || Error::Argument(format!("trigger {index}: there is no kind {kind}"));
        Ok(Trigger::new(t, TriggerKind::of(kind.into()).ok_or_else(rule)?))
    });
    Ok(triggers.collect::<Result<_, Error>>()?)
}

/// Returns a field of a structured array, flat.
fn field<T: Element + Copy>(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<T>> {
    let rule = |_| PyValueError::new_err(format!("a structured array with a field {name:?} is needed, got {array:?}"));
    let values = array.get_item(name).map_err(rule)?.call_method0("ravel")?;
    Ok(column::<T>(&values, name)?.as_slice()?.to_vec())
}
