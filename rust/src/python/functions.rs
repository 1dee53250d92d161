//! `blur_3x3`, `log_intensity` and `reconstruct` for Python.

use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arrays::{self, events, frame, image, size_of, threshold};
use super::start_phase;
use crate::crossing::CrossingParameters;
use crate::event::Event;

/// Convolve each frame of (n, height, width) luma with the kernel [1 2 1] x [1 2 1] / 16, edges mirrored.
///
/// Args:
///     luma: float32, C-contiguous.
///
/// Returns:
///     float32 of the same shape.
///
/// Raises:
///     TypeError: for an array of another type or number of axes.
///     ValueError: for one that is not C-contiguous.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "PyO3 hands it over")]
pub(super) fn blur_3x3<'py>(py: Python<'py>, luma: PyReadonlyArray3<'py, f32>) -> PyResult<Bound<'py, PyArray3<f32>>> {
    if !luma.is_c_contiguous() {
        return Err(PyValueError::new_err("luma must be C-contiguous"));
    }
    let (shape, luma) = (luma.dims(), luma.as_slice()?);
    let mut blurred = vec![0.0; luma.len()];
    py.detach(|| crate::blur::blur_3x3(luma, (shape[2], shape[1]), &mut blurred));
    blurred.into_pyarray(py).reshape(shape)
}

/// Compute L = ln(luma + log_eps) in float64, shape (height, width), as :class:`CrossingEngine` does.
///
/// The same bits on every processor, within 1 ulp of the exact logarithm.
///
/// Args:
///     luma: linear luma, shape (height, width), finite and >= 0; float32, or float64, which is rounded to it.
///     log_eps: dark level in units of luma, > 0.
///
/// Raises:
///     ValueError: for luma that is NaN, infinite or negative (with the pixel), or log_eps <= 0.
#[pyfunction]
pub(super) fn log_intensity<'py>(luma: &Bound<'py, PyAny>, log_eps: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let luma = frame::<f32>(luma, "luma", None)?;
    let size = size_of(&luma)?;
    let logs = crate::log_intensity::log_intensity_frame(luma.as_slice()?, size, log_eps)?;
    image(luma.py(), logs, size)
}

/// Compute log intensity at ``t_us`` from that of the first frame and the events until then (t <= t_us).
///
/// log I(x; t) = log I(x; 0) - d(x) + n_on C_on - n_off C_off with each pixel's counts and start phase d: the engine's
/// reference to the bit.
///
/// Args:
///     events: events of the sensor, in any order.
///     first_log_intensity: float64, shape (height, width).
///     t_us: time in microseconds; later events are left out.
///     contrast_threshold, contrast_threshold_off: C_on and C_off as :class:`CrossingEngine` takes them; without C_off
///         it is C_on.
///     start_phase, seed: as of the :class:`CrossingEngine` that made the events; with ``zero`` all d are 0.
///
/// Returns:
///     float64, shape (height, width).
///
/// Raises:
///     ValueError: for thresholds out of range, a start phase that does not exist, or an event outside of the frame.
///
/// Source: Mueggler et al., IJRR 2017, section 6.
#[pyfunction]
#[pyo3(signature = (
    events,
    first_log_intensity,
    t_us,
    contrast_threshold,
    contrast_threshold_off=None,
    *,
    start_phase="zero",
    seed=None,
))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn reconstruct<'py>(
    #[pyo3(from_py_with = events)] events: PyReadonlyArray1<'py, Event>,
    first_log_intensity: &Bound<'py, PyAny>,
    t_us: i64,
    contrast_threshold: &Bound<'py, PyAny>,
    contrast_threshold_off: Option<&Bound<'py, PyAny>>,
    start_phase: &str,
    seed: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let first = frame::<f64>(first_log_intensity, "first_log_intensity", None)?;
    let size = size_of(&first)?;
    let on = threshold(contrast_threshold, "contrast_threshold", size)?;
    let off = contrast_threshold_off.map(|c| threshold(c, "contrast_threshold_off", size)).transpose()?;
    let parameters = CrossingParameters {
        contrast_threshold_off: off.unwrap_or_else(|| on.clone()),
        contrast_threshold: on,
        start_phase: start_phase::of_name(start_phase)?,
        ..CrossingParameters::default()
    };
    let seed = seed.map_or(Ok(0), arrays::seed)?;
    let logs = crate::crossing::reconstruct(events.as_slice()?, first.as_slice()?, size, t_us, &parameters, seed)?;
    image(first.py(), logs, size)
}
