//! `inspect_ktx2` and `decode_ktx2` for Python.

use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::ktx2::{Ktx2, Transfer};

/// Read what a KTX2 file says of its image, before anything is decoded.
///
/// Args:
///     data: uint8, shape (n,), contiguous: the file.
///
/// Returns:
///     Width, height, and what the numbers of texels stand for: ``linear``, ``srgb``, or an empty text where the file
///     does not say.
///
/// Raises:
///     DecodeError: for a file that breaks a rule, or whose texels are in a format that is not read.
///
/// Source: Khronos Group, KTX File Format Specification 2.0.
#[pyfunction]
pub(super) fn inspect_ktx2(data: PyReadonlyArray1<'_, u8>) -> PyResult<(u32, u32, &'static str)> {
    let file = Ktx2::read(data.as_slice()?)?;
    let ((width, height), transfer) = (file.size(), file.transfer());
    let transfer = match transfer {
        Transfer::Unsaid => "",
        Transfer::Linear => "linear",
        Transfer::Srgb => "srgb",
    };
    Ok((width, height, transfer))
}

/// Decode the finest level of a KTX2 file: Basis Universal (ETC1S or UASTC), or plain bytes; the GIL is released.
///
/// Args:
///     data: uint8, shape (n,), contiguous: the file.
///
/// Returns:
///     uint8, shape (height, width, 4): red, green, blue and opacity as the file has them; row 0 is the upper edge.
///
/// Raises:
///     DecodeError: for a file that breaks a rule, or whose texels are in a format that is not read.
///     MemoryError: if there is not enough.
///
/// Source: Khronos Group, KTX File Format Specification 2.0.
#[pyfunction]
pub(super) fn decode_ktx2<'py>(py: Python<'py>, data: PyReadonlyArray1<'_, u8>) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let file = Ktx2::read(data.as_slice()?)?;
    let (width, height) = file.size();
    let texels = py.detach(|| file.rgba())?;
    texels.into_pyarray(py).reshape([height as usize, width as usize, 4])
}
