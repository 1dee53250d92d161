//! [`Event`] as a NumPy element, so that event arrays pass between the languages without a copy.
#![allow(unsafe_code, reason = "numpy::Element is an unsafe trait; the layout is pinned by repr(C) and a Python test")]

use numpy::{Element, PyArrayDescr};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::event::Event;

static EVENT_DTYPE: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();

// SAFETY: `Event` is plain old data (integers without invalid bit patterns, padding written out), and
// `davis_rs.events.EVENT_DTYPE` describes its repr(C) layout: 16 bytes, t i64 at 0, x u16 at 8, y u16 at 10, p u8 at 12.
unsafe impl Element for Event {
    const IS_COPY: bool = true;

    fn get_dtype(py: Python<'_>) -> Bound<'_, PyArrayDescr> {
        EVENT_DTYPE
            .get_or_try_init(py, || {
                let dtype = py.import("davis_rs.events")?.getattr("EVENT_DTYPE")?;
                PyResult::Ok(dtype.cast_into::<PyArrayDescr>()?.unbind())
            })
            .expect("davis_rs.events defines EVENT_DTYPE")
            .clone_ref(py)
            .into_bound(py)
    }

    fn clone_ref(&self, _py: Python<'_>) -> Self {
        *self
    }

    fn vec_from_slice(_py: Python<'_>, slice: &[Self]) -> Vec<Self> {
        slice.to_vec()
    }

    fn array_from_view<D: numpy::ndarray::Dimension>(
        _py: Python<'_>,
        view: numpy::ndarray::ArrayView<'_, Self, D>,
    ) -> numpy::ndarray::Array<Self, D> {
        view.to_owned()
    }
}
