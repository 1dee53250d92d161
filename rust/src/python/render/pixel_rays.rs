//! `PixelRays` for Python.

use pyo3::prelude::*;

use crate::python::arrays::{column, numbers};
use crate::render::PixelRays;

/// The lattice rays of a sensor's pixels, as undistorted image coordinates.
///
/// Args:
///     width, height: of the sensor, in pixels, 1..65535.
///     rays: rays of each pixel, 1..1024.
///     table: float32 (rays * height * width * 2), flat: x and y of the direction (x, y, 1) in camera axes, by ray of
///         the lattice and pixel, row by row.
///
/// Raises:
///     ValueError: for a size or number of rays out of range, or a table of another length or with numbers that are not
///         finite.
#[pyclass(name = "PixelRays", module = "davis_rs._core", frozen)]
pub(crate) struct PyPixelRays(pub(super) PixelRays);

#[pymethods]
impl PyPixelRays {
    #[new]
    fn new(width: usize, height: usize, rays: usize, table: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self(PixelRays::new(width, height, rays, column::<f32>(table, "table")?.as_slice()?)?))
    }

    /// Make the rays of a sensor from tables of a few rows each, so that no table of all of them is needed.
    ///
    /// Args:
    ///     width, height, rays: as for the class.
    ///     rows: rows of the image in a table, a multiple of 8; the last one may have fewer.
    ///     next: called with the first row of a part; returns its table, as that of the class.
    ///
    /// Raises:
    ///     ValueError: as the class does.
    #[staticmethod]
    fn from_parts(width: usize, height: usize, rays: usize, rows: usize, next: &Bound<'_, PyAny>) -> PyResult<Self> {
        let part = |first: usize| numbers::<f32>(&next.call1((first,))?, "table");
        Ok(Self(PixelRays::from_parts(width, height, rays, rows, part)?))
    }

    /// Make the rays of a sensor without distortion. They take next to no memory, and have the bits of a table.
    ///
    /// Args:
    ///     width, height, rays: as for the class.
    ///     x: float32 (rays * width), flat: x of (x, y, 1) by ray of the lattice and column.
    ///     y: float32 (rays * height), flat: y by ray of the lattice and row.
    ///
    /// Raises:
    ///     ValueError: as the class does.
    #[staticmethod]
    fn grid(width: usize, height: usize, rays: usize, x: &Bound<'_, PyAny>, y: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (x, y) = (column::<f32>(x, "x")?, column::<f32>(y, "y")?);
        Ok(Self(PixelRays::grid(width, height, rays, x.as_slice()?, y.as_slice()?)?))
    }

    fn __repr__(&self) -> String {
        format!("PixelRays({} x {}, rays={})", self.0.width(), self.0.height(), self.0.rays())
    }
}
