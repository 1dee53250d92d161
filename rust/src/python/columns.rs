//! `fill_events` for Python.

use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::event::Event;

/// See `_core.pyi`.
#[pyfunction]
pub(super) fn fill_events(
    mut events: PyReadwriteArray1<'_, Event>,
    t: PyReadonlyArray1<'_, i64>,
    x: PyReadonlyArray1<'_, u16>,
    y: PyReadonlyArray1<'_, u16>,
    p: PyReadonlyArray1<'_, u8>,
) -> PyResult<()> {
    let (t, x, y, p) = (t.as_slice()?, x.as_slice()?, y.as_slice()?, p.as_slice()?);
    Ok(crate::columns::fill_events(events.as_slice_mut()?, t, x, y, p)?)
}
