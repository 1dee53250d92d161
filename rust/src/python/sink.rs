//! Where bytes go: a file by its path, or any Python object that takes bytes.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::error::{Error, Result};
use crate::write::EventWriter;

pub(super) enum Sink {
    /// A file; whether it is a regular one, so that one can go back in it.
    File(File, bool),
    Object(Py<PyAny>),
}

impl Sink {
    /// Returns the sink that `target` stands for, and its name; a file is made, over an existing one only on demand.
    pub(super) fn open(target: &Bound<'_, PyAny>, overwrite: bool) -> PyResult<(String, Self)> {
        if target.hasattr("write")? {
            let name = target.getattr("name").unwrap_or_else(|_| target.clone()).str()?.to_string();
            return Ok((name, Self::Object(target.clone().unbind())));
        }
        let path: PathBuf = target.extract()?;
        let name = path.display().to_string();
        let py = target.py();
        let options = PyDict::new(py);
        options.set_item("overwrite", overwrite)?;
        py.import("davis_rs.io.formats.destination")?.call_method("claim", (target,), Some(&options))?;
        // Opening a pipe waits for its reader.
        let file = py.detach(|| OpenOptions::new().write(true).open(&path)).map_err(Error::io(&name))?;
        let regular = file.metadata().map_err(Error::io(&name))?.is_file();
        Ok((name, Self::File(file, regular)))
    }

    /// Ends what a writer writes, with a table of contents where its position can be noted at the beginning.
    pub(super) fn end(writer: &mut EventWriter<Self>) -> Result<()> {
        if matches!(writer.sink(), Self::File(_, true)) { writer.write_contents() } else { writer.flush() }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file, _) => file.write(bytes),
            Self::Object(object) => Python::attach(|py| {
                let taken = object.bind(py).call_method1("write", (PyBytes::new(py, bytes),))?;
                // A stream that would block takes None, which is nothing.
                Ok(taken.extract::<Option<usize>>()?.ok_or(io::ErrorKind::WouldBlock)?)
            }),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(..) => Ok(()),
            Self::Object(object) => Python::attach(|py| {
                if object.bind(py).hasattr("flush")? {
                    object.bind(py).call_method0("flush")?;
                }
                Ok(())
            }),
        }
    }
}

impl Seek for Sink {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file, _) => file.seek(position),
            Self::Object(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
