//! `EventTextWriter` and `read_events_text` for Python.

use std::fs::File;
use std::path::PathBuf;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arrays::events;
use crate::error::{Error, Result};
use crate::event::Event;
use crate::text;

/// See `_core.pyi`.
#[pyclass(name = "EventTextWriter", module = "davis_rs._core")]
pub(super) struct PyEventTextWriter {
    path: PathBuf,
    /// None once finished.
    writer: Option<text::EventTextWriter<File>>,
    events: u64,
}

#[pymethods]
impl PyEventTextWriter {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let file = File::create_new(&path).map_err(Error::io(path.display().to_string()))?;
        Ok(Self { path, writer: Some(text::EventTextWriter::new(file)), events: 0 })
    }

    fn write(
        &mut self,
        py: Python<'_>,
        #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'_, Event>,
    ) -> PyResult<()> {
        let events = events.as_slice()?;
        self.with_writer(py, |writer| writer.write(events))
    }

    fn flush(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with_writer(py, text::EventTextWriter::flush)
    }

    /// Finishing twice is harmless: the second call only tells the count again.
    fn finish(&mut self, py: Python<'_>) -> PyResult<u64> {
        if self.writer.is_some() {
            let flushed = self.flush(py);
            self.writer = None;
            flushed?;
        }
        Ok(self.events)
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&mut self, py: Python<'_>, _exception: &Bound<'_, PyAny>) -> PyResult<()> {
        self.finish(py).map(drop)
    }
}

impl Drop for PyEventTextWriter {
    /// A writer that nobody finished loses nothing; what goes wrong now can no longer be told.
    fn drop(&mut self) {
        if let Some(writer) = self.writer.as_mut() {
            let _ = writer.flush();
        }
    }
}

impl PyEventTextWriter {
    /// Runs `work` on the open writer without the GIL, and puts the path into its system errors.
    fn with_writer(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut text::EventTextWriter<File>) -> Result<()> + Send,
    ) -> PyResult<()> {
        let path = self.path.display();
        let Some(writer) = self.writer.as_mut() else {
            return Err(PyValueError::new_err(format!("{path} is finished: nothing can be written to it any more")));
        };
        let result = py.detach(|| work(writer));
        self.events = writer.events();
        Ok(result.map_err(|error| match error {
            Error::Io { context, source } => Error::Io { context: format!("{context} to {path}"), source },
            other => other,
        })?)
    }
}

/// See `_core.pyi`.
#[pyfunction]
pub(super) fn read_events_text(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray1<Event>>> {
    let events = py.detach(|| {
        let bytes = std::fs::read(&path).map_err(Error::io(path.display().to_string()))?;
        text::read_events_text(&bytes).map_err(|error| match error {
            Error::Format { message, line, byte } => {
                Error::Format { message: format!("{}: {message}", path.display()), line, byte }
            }
            other => other,
        })
    })?;
    Ok(events.into_pyarray(py))
}
