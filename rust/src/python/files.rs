//! `EventFileWriter` and `EventFileReader` for Python: events to and from the formats of the core.

use std::fs::{File, OpenOptions};
use std::path::PathBuf;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arrays::events;
use super::sink::Sink;
use crate::error::{Error, Result};
use crate::event::Event;
use crate::read::{
    Aedat4Decoder, DecoderState, EventReader, Evt2Decoder, Evt3Decoder, Evt21Decoder, MAX_PACKET_BYTES, TextDecoder,
};
use crate::write::{Aedat4Encoder, Compression, Encode, EventWriter, Evt2Encoder, Evt3Encoder, Limits, TextEncoder};

/// Encodes events in a format of the core and writes them; :func:`davis_rs.open_writer` is made of it.
///
/// Args:
///     target: a path, or an object with ``write(bytes)``.
///     format: ``text``, ``evt2``, ``evt3`` or ``aedat4``.
///     width, height: x and y must lie below.
///     overwrite: whether an existing file may be replaced.
///     size_line: text: whether a first line ``width height`` is written.
///     compression: aedat4: ``none``, ``lz4`` or ``zstd``.
///     level: aedat4: of zstd.
///     start_us: aedat4: added to all times.
///
/// Raises:
///     ValueError: for a format, compression or size that there is not.
///     OSError: for a file that cannot be made, or one that exists without ``overwrite``.
#[pyclass(name = "EventFileWriter", module = "davis_rs._core")]
pub(super) struct PyEventFileWriter {
    name: String,
    format: String,
    size: (u32, u32),
    /// None once finished.
    writer: Option<EventWriter<Sink>>,
    events: u64,
    bytes: u64,
}

#[pymethods]
impl PyEventFileWriter {
    #[new]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    #[pyo3(signature = (target, format, *, width, height, overwrite = false, size_line = false, compression = "none", level = 0, start_us = 0))]
    fn new(
        target: &Bound<'_, PyAny>,
        format: &str,
        width: u32,
        height: u32,
        overwrite: bool,
        size_line: bool,
        compression: &str,
        level: i32,
        start_us: i64,
    ) -> PyResult<Self> {
        let limits = Limits { width, height, ..Limits::NONE };
        let encoder: Box<dyn Encode> = match format {
            "text" if size_line => Box::new(TextEncoder::new(limits).with_size_line()),
            "text" => Box::new(TextEncoder::new(limits)),
            "aedat4" => {
                let compression = match compression {
                    "none" => Compression::None,
                    "lz4" => Compression::Lz4,
                    "zstd" => Compression::Zstd(level),
                    _ => {
                        let rule = format!("compression must be none, lz4 or zstd: got {compression:?}");
                        return Err(PyValueError::new_err(rule));
                    }
                };
                Box::new(Aedat4Encoder::new(width, height, compression, start_us))
            }
            "evt2" => Box::new(Evt2Encoder::new(width, height)),
            "evt3" => Box::new(Evt3Encoder::new(width, height)),
            _ => return Err(PyValueError::new_err(format!("the core has no format {format:?}"))),
        };
        let (name, sink) = Sink::open(target, overwrite)?;
        let writer = target.py().detach(|| EventWriter::boxed(sink, encoder)).map_err(|error| naming(error, &name))?;
        let (format, size, bytes) = (format.to_owned(), (width, height), writer.bytes());
        Ok(Self { name, format, size, events: 0, bytes, writer: Some(writer) })
    }

    /// Check events and write them.
    ///
    /// The operating system (or ``target``) has their bytes when this returns; the GIL is released.
    ///
    /// Args:
    ///     events: anything with the fields t, x, y, p; times must not decrease, also from one call to the next.
    ///
    /// Raises:
    ///     ValueError: for the first event that breaks the format's limits, with its index, before any is written; for
    ///         a writer that is finished.
    ///     OSError: if the file refuses.
    fn write(
        &mut self,
        py: Python<'_>,
        #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'_, Event>,
    ) -> PyResult<()> {
        let events = events.as_slice()?;
        self.with_writer(py, |writer| writer.write(events))?;
        self.events += events.len() as u64;
        Ok(())
    }

    /// Hand everything to the operating system.
    ///
    /// Raises:
    ///     ValueError: for a writer that is finished.
    ///     OSError: if the file refuses.
    fn flush(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with_writer(py, EventWriter::flush)
    }

    /// Write what is left, close the file and return its size in bytes; again, only the size.
    ///
    /// Raises:
    ///     OSError: if the file refuses; it is closed then.
    fn finish(&mut self, py: Python<'_>) -> PyResult<u64> {
        if self.writer.is_some() {
            let ended = self.with_writer(py, Sink::end);
            self.writer = None;
            ended?;
        }
        Ok(self.bytes)
    }

    /// Close the file as it is, without what is left to write.
    fn abandon(&mut self) {
        self.writer = None;
    }

    fn __repr__(&self) -> String {
        let Self { name, format, size: (width, height), events, bytes, .. } = self;
        let open = if self.writer.is_some() { "open" } else { "closed" };
        format!("EventFileWriter({name:?}, {format:?}, {width} x {height}, {events} events in {bytes} bytes, {open})")
    }
}

impl Drop for PyEventFileWriter {
    /// A writer that nobody finished loses nothing; what goes wrong now can no longer be told.
    fn drop(&mut self) {
        if let Some(writer) = self.writer.as_mut() {
            let _ = Sink::end(writer);
        }
    }
}

impl PyEventFileWriter {
    /// Runs `work` on the open writer without the GIL, and puts the path into its system errors.
    fn with_writer(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut EventWriter<Sink>) -> Result<()> + Send,
    ) -> PyResult<()> {
        let Some(writer) = self.writer.as_mut() else {
            let rule = format!("{} is finished: nothing can be written to it any more", self.name);
            return Err(PyValueError::new_err(rule));
        };
        let result = py.detach(|| work(writer));
        self.bytes = writer.bytes();
        Ok(result.map_err(|error| naming(error, &self.name))?)
    }
}

/// Adds the file's name to an error that has none.
pub(super) fn naming(error: Error, name: &str) -> Error {
    match error {
        Error::Io { context, source } => Error::Io { context: format!("{context}: {name}"), source },
        Error::Format { message, line, byte } => Error::Format { message: format!("{name}: {message}"), line, byte },
        other => other,
    }
}

/// Reads a file and decodes its events, from its beginning to its end.
///
/// Args:
///     path: the file.
///     format: as :class:`EventFileWriter`'s.
///     from_byte: text: where the first line to be read begins.
///     start_us, stop_us: aedat4: only the packets that hold events of that slice are read, where the file has a table
///         of contents. Events of these packets outside of the slice come too.
///     max_packet_bytes: aedat4: what a packet may unpack to; 64 MiB if not given.
///     in_order: text: whether times that go back are refused, with their line.
///
/// Raises:
///     ValueError: for a format that there is not.
///     OSError: for a file that cannot be read.
#[pyclass(name = "EventFileReader", module = "davis_rs._core")]
pub(super) struct PyEventFileReader {
    name: String,
    format: String,
    reader: EventReader<File>,
    events: u64,
    file_size: u64,
    over: bool,
}

#[pymethods]
impl PyEventFileReader {
    #[new]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    #[pyo3(signature = (path, format, *, from_byte = 0, start_us = None, stop_us = None, max_packet_bytes = MAX_PACKET_BYTES, in_order = true))]
    fn new(
        path: PathBuf,
        format: &str,
        from_byte: u64,
        start_us: Option<i64>,
        stop_us: Option<i64>,
        max_packet_bytes: usize,
        in_order: bool,
    ) -> PyResult<Self> {
        let name = path.display().to_string();
        let mut file = OpenOptions::new().read(true).open(&path).map_err(Error::io(&name))?;
        let file_size = file.metadata().map_err(Error::io(&name))?.len();
        let mut reader = match format {
            "text" => {
                let decoder = TextDecoder::new();
                EventReader::new(file, if in_order { decoder } else { decoder.in_any_order() })
            }
            "aedat4" if start_us.is_some() || stop_us.is_some() => {
                let times = start_us.unwrap_or(i64::MIN)..stop_us.unwrap_or(i64::MAX);
                let decoder = Aedat4Decoder::of_slice(&mut file, times, max_packet_bytes);
                let decoder = decoder.map_err(|error| naming(error, &name))?;
                EventReader::new(file, decoder)
            }
            "aedat4" => EventReader::new(file, Aedat4Decoder::new(max_packet_bytes)),
            "evt2" => EventReader::new(file, Evt2Decoder::new()),
            "evt21" => EventReader::new(file, Evt21Decoder::new()),
            "evt3" => EventReader::new(file, Evt3Decoder::new()),
            _ => return Err(PyValueError::new_err(format!("the core has no format {format:?}"))),
        };
        if from_byte > 0 {
            reader.go_to(from_byte).map_err(|error| naming(error, &name))?;
        }
        Ok(Self { name, format: format.to_owned(), reader, events: 0, file_size, over: false })
    }

    /// Read until there is an event or the size is known; for a reader that will read nothing else.
    ///
    /// Raises:
    ///     DecodeError: where the file breaks its format, with its position.
    ///     OSError: if the file refuses.
    fn look(&mut self, py: Python<'_>) -> PyResult<()> {
        Ok(py.detach(|| self.reader.look()).map_err(|error| naming(error, &self.name))?)
    }

    /// Read the next events: at least ``enough`` and not many more, fewer at the end; the GIL is released.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), in the file's order.
    ///
    /// Raises:
    ///     DecodeError: where the file breaks its format, with its position.
    ///     OSError: if the file refuses.
    fn read<'py>(&mut self, py: Python<'py>, enough: usize) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let events = py.detach(|| {
            let mut events = Vec::new();
            self.over = !self.reader.read(enough, &mut events).map_err(|error| naming(error, &self.name))?;
            Result::Ok(events)
        })?;
        self.events += events.len() as u64;
        Ok(events.into_pyarray(py))
    }

    /// Find the blocks that can be read by themselves: the next ones, from where the reader is; the GIL is released.
    ///
    /// Args:
    ///     enough: how many blocks, fewer at the end of the file.
    ///
    /// Returns:
    ///     int64, shape (blocks, 9): the byte where a block begins, the number of events, the times of the first and
    ///     last one in microseconds, and five numbers that the decoder carries.
    ///
    /// Raises:
    ///     DecodeError: where the file breaks its format, or for a time that is negative or goes back, with its
    ///         position.
    ///     OSError: if the file refuses.
    fn scan<'py>(&mut self, py: Python<'py>, enough: usize) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let blocks = py.detach(|| {
            let mut blocks = Vec::new();
            self.over = !self.reader.scan(enough, &mut blocks).map_err(|error| naming(error, &self.name))?;
            Result::Ok(blocks)
        })?;
        let mut rows = Vec::with_capacity(9 * blocks.len());
        for block in &blocks {
            let events = i64::try_from(block.events).unwrap_or(i64::MAX);
            rows.extend([block.byte.cast_signed(), events, block.first_us, block.last_us]);
            rows.extend(block.state);
        }
        rows.into_pyarray(py).reshape([blocks.len(), 9])
    }

    /// Read the events of a block that :meth:`scan` has found in this file; the GIL is released.
    ///
    /// Args:
    ///     byte: where it begins.
    ///     state: what the decoder carries there, five numbers.
    ///     end: where the next one begins, or the file ends.
    ///
    /// Returns:
    ///     Events (:data:`davis_rs.EVENT_DTYPE`), in the file's order.
    ///
    /// Raises:
    ///     DecodeError: where the file breaks its format, with its position.
    ///     OSError: if the file refuses.
    ///     ValueError: for a state that no decoder has.
    fn read_block<'py>(
        &mut self,
        py: Python<'py>,
        byte: u64,
        state: DecoderState,
        end: u64,
    ) -> PyResult<Bound<'py, PyArray1<Event>>> {
        let events = py.detach(|| {
            let end = end.min(self.file_size);
            self.reader.read_block(byte, state, end).map_err(|error| naming(error, &self.name))
        })?;
        Ok(events.into_pyarray(py))
    }

    /// Whether the end of the file was reached.
    #[getter]
    fn over(&self) -> bool {
        self.over
    }

    /// The sensor's (width, height), where the file says it and once that part was read; None otherwise.
    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.reader.size()
    }

    /// How many bytes of the file were decoded so far.
    #[getter]
    fn bytes(&self) -> u64 {
        self.reader.bytes()
    }

    /// How many bytes the file has.
    #[getter]
    fn file_size(&self) -> u64 {
        self.file_size
    }

    /// Number of bytes left at the end of the file that are no complete record.
    #[getter]
    fn left_over(&self) -> u64 {
        self.reader.left_over()
    }

    fn __repr__(&self) -> String {
        let Self { name, format, events, file_size, .. } = self;
        let size =
            self.reader.size().map_or("size unknown".to_owned(), |(width, height)| format!("{width} x {height}"));
        let bytes = self.reader.bytes();
        format!("EventFileReader({name:?}, {format:?}, {size}, {events} events in {bytes} of {file_size} bytes)")
    }
}

/// Check a packet of events before it is written.
///
/// Args:
///     events: anything with the fields t, x, y, p.
///     last_us: time of the event before the packet in microseconds, -1 for none.
///     latest_us: the latest time that the format can hold.
///     size: (width, height): x and y must lie below.
///
/// Raises:
///     ValueError: for the first event, with its index, that goes back in time, is before 0 or after ``latest_us``,
///         lies outside of ``size`` (width, height), or has a polarity above 1.
#[pyfunction]
#[pyo3(signature = (events, *, last_us, latest_us, size))]
pub(super) fn check_events(
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'_, Event>,
    last_us: i64,
    latest_us: i64,
    size: (u32, u32),
) -> PyResult<()> {
    let limits = Limits { latest_us, width: size.0, height: size.1 };
    Ok(limits.check(events.as_slice()?, last_us.max(0))?)
}

/// Decode a chunk of ECF, the compression of Metavision's HDF5 files; the GIL is released.
///
/// Args:
///     bytes: uint8, shape (n,), contiguous: the chunk.
///     most: events that it may have.
///
/// Returns:
///     :data:`davis_rs.EVENT_DTYPE`, with the times of the file.
///
/// Raises:
///     DecodeError: for more events, and for bytes that end too early, that go beyond the number of events, or that are
///         left over.
///
/// Source: `hdf5_ecf`, Prophesee's codec, HDF5's filter 0x8ECF.
#[pyfunction]
pub(super) fn decode_ecf<'py>(
    py: Python<'py>,
    bytes: PyReadonlyArray1<'_, u8>,
    most: usize,
) -> PyResult<Bound<'py, PyArray1<Event>>> {
    let bytes = bytes.as_slice()?;
    Ok(py.detach(|| crate::read::decode_ecf(bytes, most))?.into_pyarray(py))
}

/// Compute the CRC-32 of bytes that come in parts; the GIL is released.
///
/// Args:
///     bytes: uint8, shape (n,), contiguous: the next part.
///     start: CRC-32 of all parts before it, 0 for none.
///
/// Returns:
///     CRC-32 of all parts so far.
///
/// Source: CRC-32/ISO-HDLC, the one of zip (PKWARE's APPNOTE, 4.4.7).
#[pyfunction]
pub(super) fn crc32(py: Python<'_>, bytes: PyReadonlyArray1<'_, u8>, start: u32) -> PyResult<u32> {
    let bytes = bytes.as_slice()?;
    Ok(py.detach(|| {
        let mut hasher = crc32fast::Hasher::new_with_initial(start);
        hasher.update(bytes);
        hasher.finalize()
    }))
}

/// Compute the CRC-32 of two byte strings in a row from the CRC-32 of each, as :func:`crc32` gives it.
///
/// Args:
///     first: CRC-32 of the first string.
///     second: CRC-32 of the second string.
///     second_length: bytes of the second string.
#[pyfunction]
pub(super) fn crc32_combine(first: u32, second: u32, second_length: u64) -> u32 {
    let mut hasher = crc32fast::Hasher::new_with_initial(first);
    hasher.combine(&crc32fast::Hasher::new_with_initial_len(second, second_length));
    hasher.finalize()
}
