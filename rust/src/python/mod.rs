//! The Python module `davis_rs._core`: thin classes over the crate, arrays, and the mapping of errors.
//!
//! The doc comments of what Python sees are its docstrings: plain text, written for users of Python. `.ci/stub`
//! writes them into the stub `_core.pyi`, which keeps the types.

#![allow(clippy::needless_pass_by_value, reason = "PyO3 hands arguments over by value")]
#![allow(clippy::doc_markdown, reason = "doc comments are docstrings of Python")]

mod aer;
mod arrays;
mod columns;
mod dtype;
mod effects;
mod engine;
mod evt3;
mod files;
mod filter;
mod functions;
mod interpolation;
mod ktx2;
mod meshopt;
mod recordings;
mod render;
mod represent;
mod ros;
mod sink;
mod start_phase;
mod state;

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

create_exception!(
    davis_rs,
    DecodeError,
    PyValueError,
    "Contents of a file or stream that do not follow the format they claim; the message says where."
);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            // With errno in its arguments Python picks the right subclass (FileNotFoundError, PermissionError, ...).
            Error::Io { context, source } => match source.raw_os_error() {
                Some(errno) => PyOSError::new_err((errno, format!("{context}: {source}"))),
                // What a Python stream raised is raised as it was.
                None => source.downcast::<Self>().unwrap_or_else(|_| PyOSError::new_err(message)),
            },
            Error::Format { .. } => DecodeError::new_err(message),
            Error::Argument(_) | Error::Order(_) => PyValueError::new_err(message),
            Error::Memory(_) => PyMemoryError::new_err(message),
        }
    }
}

/// The module that maturin builds.
#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    // NumPy's functions are looked up here, where Ctrl-C waits for the import: where an array is made, it would panic.
    m.py().import("numpy")?;
    numpy::dtype::<f64>(m.py());
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("RUST_SYSROOT", env!("DAVIS_RS_RUST_SYSROOT"))?;
    m.add("DecodeError", m.py().get_type::<DecodeError>())?;
    m.add_class::<aer::PyDecoder>()?;
    m.add_class::<aer::PyDevice>()?;
    m.add_class::<aer::PyEncoder>()?;
    m.add_class::<engine::PyCrossingEngine>()?;
    m.add_function(wrap_pyfunction!(effects::check_effects, m)?)?;
    m.add_class::<files::PyEventFileWriter>()?;
    m.add_class::<files::PyEventFileReader>()?;
    m.add_class::<filter::PyEventFilter>()?;
    m.add_class::<recordings::PyAedat4Recording>()?;
    m.add_function(wrap_pyfunction!(functions::blur_3x3, m)?)?;
    m.add_function(wrap_pyfunction!(functions::log_intensity, m)?)?;
    m.add_function(wrap_pyfunction!(functions::reconstruct, m)?)?;
    m.add_function(wrap_pyfunction!(columns::fill_events, m)?)?;
    m.add_class::<render::PyIrradianceSampler>()?;
    m.add_class::<render::PyPixelRays>()?;
    m.add_class::<render::PyReflectedLight>()?;
    m.add_class::<render::PySceneRenderer>()?;
    m.add_function(wrap_pyfunction!(represent::count_events, m)?)?;
    m.add_function(wrap_pyfunction!(represent::latest_times, m)?)?;
    m.add_function(wrap_pyfunction!(represent::voxel_grid, m)?)?;
    m.add_function(wrap_pyfunction!(represent::spike_tensor, m)?)?;
    m.add_function(wrap_pyfunction!(ros::pack_event_message, m)?)?;
    m.add_function(wrap_pyfunction!(ros::unpack_event_message, m)?)?;
    m.add_function(wrap_pyfunction!(evt3::pack_evt3, m)?)?;
    m.add_class::<evt3::PyEvt3Stream>()?;
    m.add_function(wrap_pyfunction!(files::check_events, m)?)?;
    m.add_function(wrap_pyfunction!(files::decode_ecf, m)?)?;
    m.add_function(wrap_pyfunction!(ktx2::decode_ktx2, m)?)?;
    m.add_function(wrap_pyfunction!(ktx2::inspect_ktx2, m)?)?;
    m.add_function(wrap_pyfunction!(meshopt::decode_meshopt, m)?)?;
    m.add_function(wrap_pyfunction!(files::crc32, m)?)?;
    m.add_function(wrap_pyfunction!(files::crc32_combine, m)?)?;
    Ok(())
}
