//! `fill_events` for Python.

use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::event::Event;

/// Fill an array of events from columns, in one pass.
///
/// Args:
///     events: :data:`davis_rs.EVENT_DTYPE`, shape (n,), contiguous; it is overwritten.
///     t: int64, shape (n,), contiguous: microseconds.
///     x: uint16, shape (n,), contiguous.
///     y: uint16, shape (n,), contiguous.
///     p: uint8, shape (n,), contiguous: 0 or 1.
///
/// Raises:
///     ValueError: if the lengths differ, or for the first polarity other than 0 or 1, with its index.
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
