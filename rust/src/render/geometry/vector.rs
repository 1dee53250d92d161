//! Vectors of three float64.
//!
//! Geometry is set up in them once per triangle and view; rays then use float32.
//!
//! The operations name each component, because the standard library's functions of arrays are often not compiled into
//! what calls them.
//!
//! What must not break: operations are in a fixed order, because results reach every pixel.

/// A vector or a point.
pub(crate) type Vector = [f64; 3];

#[inline]
pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub(crate) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub(crate) fn scale(a: Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// Returns the largest of the components' magnitudes.
#[inline]
pub(crate) fn largest(a: Vector) -> f64 {
    a[0].abs().max(a[1].abs()).max(a[2].abs())
}

#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
pub(crate) fn single<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) low: Vector,
    pub(crate) high: Vector,
}

impl Bounds {
    pub(crate) const NONE: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    pub(crate) fn of(points: &[Vector]) -> Self {
        points.iter().fold(Self::NONE, |bounds, &point| bounds.with(&Self { low: point, high: point }))
    }

    pub(crate) fn with(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|i| self.low[i].min(other.low[i])),
            high: std::array::from_fn(|i| self.high[i].max(other.high[i])),
        }
    }

    pub(crate) fn within(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|i| self.low[i].max(other.low[i])),
            high: std::array::from_fn(|i| self.high[i].min(other.high[i])),
        }
    }

    pub(crate) fn grown(&self, by: f64) -> Self {
        Self { low: self.low.map(|x| x - by), high: self.high.map(|x| x + by) }
    }

    pub(crate) fn centre(&self) -> Vector {
        std::array::from_fn(|i| f64::midpoint(self.low[i], self.high[i]))
    }

    pub(crate) fn corners(&self) -> [Vector; 8] {
        std::array::from_fn(|k| std::array::from_fn(|i| if k >> i & 1 == 0 { self.low[i] } else { self.high[i] }))
    }

    /// Returns half of the surface's area.
    pub(crate) fn half_area(&self) -> f64 {
        let [x, y, z] = sub(self.high, self.low);
        x * y + y * z + z * x
    }
}
