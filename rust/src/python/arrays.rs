//! Arrays from Python as slices: checked, and copied only where their layout asks for it.

use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOverflowError, PyValueError};
use pyo3::prelude::*;

use crate::crossing::MOST_THREADS;
use crate::crossing::Threshold;
use crate::error::Error;
use crate::event::{Event, SensorSize};

/// A sample as NumPy has it.
pub(super) trait Float: Element {
    /// Converts a float64; where that is impossible, it becomes a value that is refused like it.
    fn of(value: f64) -> Self;
}

impl Float for f32 {
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn of(value: f64) -> Self {
        let rounded = value as Self;
        // Rounding takes the sign's meaning from a negative number smaller than all float32.
        if value < 0.0 && rounded == 0.0 { -Self::from_bits(1) } else { rounded }
    }
}

impl Float for f64 {
    fn of(value: f64) -> Self {
        value
    }
}

/// Returns a frame of floats as a C-contiguous array of `T`; float32 and float64 of any layout are taken, `T` without a
/// copy.
pub(super) fn frame<'py, T: Float>(
    array: &Bound<'py, PyAny>,
    name: &str,
    size: Option<SensorSize>,
) -> PyResult<PyReadonlyArray2<'py, T>> {
    let untyped = array
        .cast::<PyUntypedArray>()
        .map_err(|_| PyValueError::new_err(format!("{name} must be a NumPy array, got {}", array.get_type())))?;
    let dtype = untyped.dtype();
    if dtype.kind() != b'f' || ![4, 8].contains(&dtype.itemsize()) {
        return Err(PyValueError::new_err(format!("{name} must be float32 or float64, got {dtype}")));
    }
    let shape = untyped.shape();
    let expected = size.map(|s| [usize::from(s.height), usize::from(s.width)]);
    if shape.len() != 2 || expected.is_some_and(|expected| shape != expected) {
        let expected = expected.map_or("(height, width)".to_owned(), |[h, w]| format!("({h}, {w})"));
        return Err(PyValueError::new_err(format!("{name} must have shape {expected}, got {shape:?}")));
    }
    if let Some(frame) = plain::<T>(array) {
        return Ok(frame);
    }
    // Every layout and byte order: NumPy makes it plain, and widens what is narrower.
    let py = array.py();
    let width = if dtype.itemsize() == 4 { numpy::dtype::<f32>(py) } else { numpy::dtype::<f64>(py) };
    let native = py.import("numpy")?.call_method1("require", (array, width, ("C", "ALIGNED")))?;
    if let Some(frame) = plain::<T>(&native) {
        return Ok(frame);
    }
    let wide = native.call_method1("astype", (numpy::dtype::<f64>(py),))?.cast_into::<PyArray2<f64>>()?;
    Ok(PyArray2::from_owned_array(py, wide.readonly().as_array().mapv(T::of)).readonly())
}

/// Returns the array itself, where its memory is already what is wanted.
fn plain<'py, T: Element>(array: &Bound<'py, PyAny>) -> Option<PyReadonlyArray2<'py, T>> {
    let array = array.cast::<PyArray2<T>>().ok()?;
    (array.is_c_contiguous() && array.is_aligned()).then(|| array.readonly())
}

/// Returns a one-dimensional array of numbers, converted where nothing is lost by it (float64 to float32 is rounded).
pub(super) fn column<'py, T: Element>(array: &Bound<'py, PyAny>, name: &str) -> PyResult<PyReadonlyArray1<'py, T>> {
    if let Some(column) = array.cast::<PyArray1<T>>().ok().filter(|array| array.is_contiguous() && array.is_aligned()) {
        return Ok(column.readonly());
    }
    let py = array.py();
    let numpy = py.import("numpy")?;
    let array = numpy.call_method1("asarray", (array,))?;
    let dtype = numpy::dtype::<T>(py);
    let (given, kind) = (array.getattr("dtype")?, dtype.kind());
    let same_kind: bool = numpy.call_method1("can_cast", (&given, &dtype, "same_kind"))?.extract()?;
    // Integers of any width are taken; one that does not fit is seen by its value, not by its type.
    let integers = matches!(kind, b'u' | b'i') && matches!(given.getattr("kind")?.extract::<char>()?, 'u' | 'i');
    if !(same_kind || integers) || array.getattr("ndim")?.extract::<usize>()? != 1 {
        return Err(PyValueError::new_err(format!("{name} must be a one-dimensional array of {dtype}, got {array:?}")));
    }
    let converted = numpy.call_method1("require", (&array, &dtype, ("C", "ALIGNED")))?;
    if integers && !numpy.call_method1("array_equal", (&array, &converted))?.extract::<bool>()? {
        return Err(PyValueError::new_err(format!("{name} must fit {dtype}")));
    }
    Ok(converted.cast_into::<PyArray1<T>>()?.readonly())
}

/// Returns the numbers of a [`column`].
pub(super) fn numbers<T: Element + Copy>(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<T>> {
    Ok(column(array, name)?.as_slice()?.to_vec())
}

/// Returns which of an array's numbers are not 0.
pub(super) fn flags(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<bool>> {
    Ok(column::<u32>(array, name)?.as_slice()?.iter().map(|&flag| flag != 0).collect())
}

/// Splits a flat array into groups of N numbers.
pub(super) fn groups<T: Element + Copy, const N: usize>(array: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[T; N]>> {
    Ok(grouped(&column(array, name)?, name)?.to_vec())
}

/// Splits a [`column`] into groups of N numbers, without a copy.
pub(super) fn grouped<'a, T: Element, const N: usize>(
    array: &'a PyReadonlyArray1<'_, T>,
    name: &str,
) -> PyResult<&'a [[T; N]]> {
    match array.as_slice()?.as_chunks::<N>() {
        (groups, []) => Ok(groups),
        _ => Err(no_groups(N, array.len(), name)),
    }
}

/// Splits a [`column`] into matrices of K rows of M numbers, without a copy.
pub(super) fn matrices<'a, const M: usize, const K: usize>(
    array: &'a PyReadonlyArray1<'_, f64>,
    name: &str,
) -> PyResult<&'a [[[f64; M]; K]]> {
    let (rows, rest) = array.as_slice()?.as_chunks::<M>();
    match (rows.as_chunks::<K>(), rest) {
        ((matrices, []), []) => Ok(matrices),
        _ => Err(no_groups(K * M, array.len(), name)),
    }
}

/// Returns the error for numbers that are no whole groups.
fn no_groups(size: usize, got: usize, name: &str) -> PyErr {
    PyValueError::new_err(format!("{name} must be groups of {size}, got {got} numbers"))
}

/// Splits a flat matrix into its rows.
pub(super) fn rows<const N: usize, const M: usize, const K: usize>(flat: [f64; N]) -> [[f64; M]; K] {
    std::array::from_fn(|i| std::array::from_fn(|j| flat[i * M + j]))
}

/// Reads a time in microseconds.
pub(super) fn microseconds(t_us: &Bound<'_, PyAny>) -> PyResult<i64> {
    whole(t_us, || format!("a time must lie in 0..2^63 us, got {t_us}"))
}

/// Reads a seed of random draws.
pub(super) fn seed(seed: &Bound<'_, PyAny>) -> PyResult<u64> {
    whole(seed, || format!("a seed must lie in 0..2^64 - 1, got {seed}"))
}

/// Reads a number of threads, if one is given.
pub(super) fn threads(threads: Option<&Bound<'_, PyAny>>) -> PyResult<Option<usize>> {
    threads.map(|n| whole(n, || format!("threads must lie in 1..{MOST_THREADS}, got {n}"))).transpose()
}

/// Reads a whole number; `rule` says what was broken by one that does not fit.
fn whole<'py, T: FromPyObjectOwned<'py, Error = PyErr>>(
    value: &Bound<'py, PyAny>,
    rule: impl FnOnce() -> String,
) -> PyResult<T> {
    value.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<PyOverflowError>(value.py()) { PyValueError::new_err(rule()) } else { error }
    })
}

/// Returns the sensor that a frame's shape describes.
pub(super) fn size_of<T: Element>(frame: &PyReadonlyArray2<'_, T>) -> PyResult<SensorSize> {
    let side =
        |n: usize| u16::try_from(n).map_err(|_| PyValueError::new_err(format!("a side of {n} pixels exceeds 65535")));
    Ok(SensorSize { width: side(frame.shape()[1])?, height: side(frame.shape()[0])? })
}

/// Reads an event array; anything with the fields t, x, y, p is taken, `EVENT_DTYPE` without a copy.
pub(super) fn events<'py>(array: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray1<'py, Event>> {
    let converted = array.py().import("davis_rs.events.arrays")?.call_method1("as_events", (array,))?;
    Ok(converted.cast_into::<PyArray1<Event>>()?.readonly())
}

/// Reads a contrast threshold: a number, or a float array of the sensor's shape.
pub(super) fn threshold(value: &Bound<'_, PyAny>, name: &str, size: SensorSize) -> PyResult<Threshold> {
    if let Ok(number) = value.extract::<f64>() {
        return Ok(Threshold::Uniform(number));
    }
    Ok(Threshold::PerPixel(frame::<f64>(value, name, Some(size))?.as_slice()?.to_vec()))
}

/// Returns a contrast threshold as it was given.
pub(super) fn threshold_to_python(py: Python<'_>, value: Threshold, size: SensorSize) -> PyResult<Bound<'_, PyAny>> {
    match value {
        Threshold::Uniform(value) => Ok(value.into_pyobject(py)?.into_any()),
        Threshold::PerPixel(values) => image(py, values, size).map(Bound::into_any),
    }
}

/// Returns values, row by row, as an array of the sensor's shape.
pub(super) fn image<T: Element>(py: Python<'_>, pixels: Vec<T>, size: SensorSize) -> PyResult<Bound<'_, PyArray2<T>>> {
    pixels
        .into_pyarray(py)
        .reshape([usize::from(size.height), usize::from(size.width)])
        .map_err(|e| Error::Argument(e.to_string()).into())
}
