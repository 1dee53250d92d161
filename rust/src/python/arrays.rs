//! Arrays from Python as slices: checked, and copied only where their layout asks for it.

use numpy::{
    Element, IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::crossing::Threshold;
use crate::error::Error;
use crate::event::{Event, SensorSize};

/// A frame of floats as a C-contiguous array of `T`; float32 and float64 of any layout are taken, `T` without a copy.
pub(super) fn frame<'py, T: Element>(
    array: &Bound<'py, PyAny>,
    name: &str,
    size: Option<SensorSize>,
) -> PyResult<PyReadonlyArray2<'py, T>> {
    let py = array.py();
    let untyped = array
        .cast::<PyUntypedArray>()
        .map_err(|_| PyValueError::new_err(format!("{name} must be a NumPy array, got {}", array.get_type())))?;
    let dtype = untyped.dtype();
    let float = |wanted: &Bound<'py, numpy::PyArrayDescr>| numpy::PyArrayDescrMethods::is_equiv_to(&dtype, wanted);
    if !float(&numpy::dtype::<f32>(py)) && !float(&numpy::dtype::<f64>(py)) {
        return Err(PyValueError::new_err(format!("{name} must be float32 or float64, got {dtype}")));
    }
    let shape = untyped.shape();
    let expected = size.map(|s| [usize::from(s.height), usize::from(s.width)]);
    if shape.len() != 2 || expected.is_some_and(|expected| shape != expected) {
        let expected = expected.map_or("(height, width)".to_owned(), |[h, w]| format!("({h}, {w})"));
        return Err(PyValueError::new_err(format!("{name} must have shape {expected}, got {shape:?}")));
    }
    let converted = py.import("numpy")?.call_method1("require", (array, numpy::dtype::<T>(py), ("C", "ALIGNED")))?;
    Ok(converted.cast_into::<PyArray2<T>>()?.readonly())
}

/// The sensor that a frame's shape describes.
pub(super) fn size_of<T: Element>(frame: &PyReadonlyArray2<'_, T>) -> PyResult<SensorSize> {
    let side =
        |n: usize| u16::try_from(n).map_err(|_| PyValueError::new_err(format!("a side of {n} pixels exceeds 65535")));
    Ok(SensorSize { width: side(frame.shape()[1])?, height: side(frame.shape()[0])? })
}

/// An event array; anything with the fields t, x, y, p is taken, `EVENT_DTYPE` without a copy.
pub(super) fn events<'py>(array: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray1<'py, Event>> {
    let converted = array.py().import("davis_rs.events")?.call_method1("as_events", (array,))?;
    Ok(converted.cast_into::<numpy::PyArray1<Event>>()?.readonly())
}

/// A contrast threshold: a number, or a float array of the sensor's shape.
pub(super) fn threshold(value: &Bound<'_, PyAny>, name: &str, size: SensorSize) -> PyResult<Threshold> {
    if let Ok(number) = value.extract::<f64>() {
        return Ok(Threshold::Uniform(number));
    }
    Ok(Threshold::PerPixel(frame::<f64>(value, name, Some(size))?.as_slice()?.to_vec()))
}

/// Values, row by row, as an array of the sensor's shape.
pub(super) fn image<T: Element>(py: Python<'_>, pixels: Vec<T>, size: SensorSize) -> PyResult<Bound<'_, PyArray2<T>>> {
    pixels
        .into_pyarray(py)
        .reshape([usize::from(size.height), usize::from(size.width)])
        .map_err(|e| Error::Argument(e.to_string()).into())
}
