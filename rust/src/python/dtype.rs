//! The crate's records as NumPy elements, so that their arrays pass between the languages without a copy.
#![allow(
    unsafe_code,
    reason = "numpy::Element is an unsafe trait; the layouts are pinned by repr(C) and a Python test"
)]

use numpy::{Element, PyArrayDescr};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::aer::{ImuReading, ImuSample, Trigger};
use crate::event::Event;

/// Makes a record a NumPy element, of the dtype that a Python module defines.
macro_rules! element {
    ($record:ty, $module:literal, $dtype:literal) => {
        // SAFETY: the record is plain old data (repr(C), padding written out), and the dtype describes its layout. Where
        // a field takes not every bit pattern (the kind of a trigger), arrays of it are only ever handed out, not taken.
        unsafe impl Element for $record {
            const IS_COPY: bool = true;

            fn get_dtype(py: Python<'_>) -> Bound<'_, PyArrayDescr> {
                static DTYPE: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
                DTYPE
                    .get_or_try_init(py, || {
                        let dtype = py.import($module)?.getattr($dtype)?;
                        PyResult::Ok(dtype.cast_into::<PyArrayDescr>()?.unbind())
                    })
                    .expect(concat!($module, " defines ", $dtype))
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
    };
}

element!(Event, "davis_rs.events.arrays", "EVENT_DTYPE");
element!(ImuReading, "davis_rs.events.decoded", "IMU_COUNTS_DTYPE");
element!(ImuSample, "davis_rs.events.decoded", "IMU_DTYPE");
element!(Trigger, "davis_rs.events.decoded", "TRIGGER_DTYPE");
