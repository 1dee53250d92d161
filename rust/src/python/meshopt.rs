//! `decode_meshopt` for Python.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::meshopt::{self, MeshoptFilter, MeshoptMode};

/// So many characters of a name are shown.
const SHOWN: usize = 40;

/// Decode a buffer view that a glTF file compresses by ``EXT_meshopt_compression`` or ``KHR_meshopt_compression``;
/// the GIL is released.
///
/// Args:
///     data: uint8, shape (n,), contiguous: the compressed bytes.
///     mode: ``ATTRIBUTES``, ``TRIANGLES`` or ``INDICES``.
///     filter: ``NONE``, or of attributes ``OCTAHEDRAL``, ``QUATERNION``, ``EXPONENTIAL`` or ``COLOR``.
///     count: elements that there must be.
///     stride: bytes of an element.
///
/// Returns:
///     uint8, shape (count stride,).
///
/// Raises:
///     ValueError: for a mode, filter or stride that there is not.
///     DecodeError: for data that break a rule of the stream, with the byte.
///     MemoryError: if there is not enough.
///
/// Source: Khronos Group, KHR_meshopt_compression, appendices A (bitstream) and B (filters).
#[pyfunction]
pub(super) fn decode_meshopt<'py>(
    py: Python<'py>,
    data: PyReadonlyArray1<'_, u8>,
    mode: &str,
    filter: &str,
    count: usize,
    stride: usize,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let (data, mode) = (data.as_slice()?, mode_of(mode, filter)?);
    Ok(py.detach(|| meshopt::decode_meshopt(data, mode, count, stride))?.into_pyarray(py))
}

/// Returns the mode of two names.
fn mode_of(mode: &str, filter: &str) -> Result<MeshoptMode> {
    match (mode, filter) {
        ("ATTRIBUTES", "NONE") => Ok(MeshoptMode::Attributes(MeshoptFilter::None)),
        ("ATTRIBUTES", "OCTAHEDRAL") => Ok(MeshoptMode::Attributes(MeshoptFilter::Octahedral)),
        ("ATTRIBUTES", "QUATERNION") => Ok(MeshoptMode::Attributes(MeshoptFilter::Quaternion)),
        ("ATTRIBUTES", "EXPONENTIAL") => Ok(MeshoptMode::Attributes(MeshoptFilter::Exponential)),
        ("ATTRIBUTES", "COLOR") => Ok(MeshoptMode::Attributes(MeshoptFilter::Colour)),
        ("TRIANGLES", "NONE") => Ok(MeshoptMode::Triangles),
        ("INDICES", "NONE") => Ok(MeshoptMode::Indices),
        (_, "NONE") => Err(Error::Argument(format!("there is no mode {}", quoted(mode)))),
        _ => Err(Error::Argument(format!("there is no filter {} of {}", quoted(filter), quoted(mode)))),
    }
}

fn quoted(name: &str) -> String {
    format!("'{}'", name.chars().take(SHOWN).collect::<String>().escape_debug())
}
