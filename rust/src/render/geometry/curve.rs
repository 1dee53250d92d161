//! How a tile lies in undistorted coordinates behind a lens with distortion: cubic polynomials of column and row.
//!
//! They are fitted to the corners of the tile's pixels. A cubic over 8 x 8 pixels errs by less than 1e-3 pixels for the
//! lenses of event cameras; a quadratic by several times that.
//!
//! What must not break: columns and rows are counted from the tile's middle, because sums are rounded least there.

use std::array::from_fn;

/// How many terms a cubic of two variables has.
pub(crate) const TERMS: usize = 10;

/// The powers of both variables in each term.
const POWERS: [[usize; 2]; TERMS] = [[0, 0], [0, 1], [0, 2], [0, 3], [1, 0], [1, 1], [1, 2], [2, 0], [2, 1], [3, 0]];

/// Columns and rows are divided by this while a cubic is fitted, so that powers have about one size.
const SIZE: f64 = 4.0;

const SIZES: [f64; 4] = [1.0, SIZE, SIZE * SIZE, SIZE * SIZE * SIZE];

/// What is added to the normal equations' diagonal: of an image a few pixels wide it makes unknown terms zero.
const RIDGE: f64 = 1e-12;

/// A cubic polynomial of two variables, by its terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cubic(pub(crate) [f64; TERMS]);

/// Undistorted x and y of a tile's columns and rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileCurve(pub(crate) [Cubic; 2]);

impl Cubic {
    /// Returns the cubic of column and height whose value is this one's at row = height + slope x column.
    pub(crate) fn along(&self, slope: f64) -> Self {
        let s = slope;
        let [f00, f01, f02, f03, f10, f11, f12, f20, f21, f30] = self.0;
        Self([
            f00,
            f01,
            f02,
            f03,
            f10 + s * f01,
            f11 + 2.0 * s * f02,
            f12 + 3.0 * s * f03,
            f20 + s * (f11 + s * f02),
            f21 + s * (2.0 * f12 + 3.0 * s * f03),
            f30 + s * (f21 + s * (f12 + s * f03)),
        ])
    }

    /// Returns the value at a column and row.
    pub(crate) fn at(&self, column: f64, row: f64) -> f64 {
        let [f00, f01, f02, f03, f10, f11, f12, f20, f21, f30] = self.0;
        let constant = f00 + row * (f01 + row * (f02 + row * f03));
        let linear = f10 + row * (f11 + row * f12);
        constant + column * (linear + column * (f20 + row * f21 + column * f30))
    }

    /// Returns how far values may lie from what the constant and linear terms give, for columns and rows up to `reach`.
    pub(crate) fn bend(&self, reach: f64) -> f64 {
        let [_, _, f02, f03, _, f11, f12, f20, f21, f30] = self.0.map(f64::abs);
        reach * reach * (f02 + f11 + f20 + reach * (f03 + f12 + f21 + f30))
    }

    /// Returns how far values in a box of a tile may lie beyond those at the box's corners: a function's second
    /// derivatives bound its distance from what is linear between them.
    pub(crate) fn bulge(&self, [width, height]: [f64; 2], reach: f64) -> f64 {
        let [_, _, f02, f03, _, _, f12, f20, f21, f30] = self.0.map(f64::abs);
        let across = 2.0 * f20 + reach * (2.0 * f21 + 6.0 * f30);
        let down = 2.0 * f02 + reach * (2.0 * f12 + 6.0 * f03);
        (across * width * width + down * height * height) / 8.0
    }
}

impl TileCurve {
    /// Returns the curve nearest to some points, by least squares: column, row and undistorted coordinates of each.
    pub(crate) fn fit(points: impl Iterator<Item = [f64; 4]>) -> Self {
        let mut normal = [[0.0; TERMS]; TERMS];
        let mut sides = [[0.0; 2]; TERMS];
        for [column, row, x, y] in points {
            let [columns, rows] = [column / SIZE, row / SIZE].map(|at| [1.0, at, at * at, at * at * at]);
            let terms = POWERS.map(|[i, j]| columns[i] * rows[j]);
            for i in 0..TERMS {
                for j in 0..TERMS {
                    normal[i][j] += terms[i] * terms[j];
                }
                sides[i] = [sides[i][0] + terms[i] * x, sides[i][1] + terms[i] * y];
            }
        }
        let trace: f64 = (0..TERMS).map(|i| normal[i][i]).sum();
        for i in 0..TERMS {
            normal[i][i] += RIDGE * trace;
        }
        let solved = solve(normal, sides);
        Self(from_fn(|axis| {
            Cubic(from_fn(|term| {
                let [i, j] = POWERS[term];
                solved[term][axis] / SIZES[i + j]
            }))
        }))
    }
}

/// Solves a positive definite system by elimination.
fn solve(mut matrix: [[f64; TERMS]; TERMS], mut sides: [[f64; 2]; TERMS]) -> [[f64; 2]; TERMS] {
    for pivot in 0..TERMS {
        for row in pivot + 1..TERMS {
            let factor = matrix[row][pivot] / matrix[pivot][pivot];
            for column in pivot..TERMS {
                matrix[row][column] -= factor * matrix[pivot][column];
            }
            sides[row] = from_fn(|axis| sides[row][axis] - factor * sides[pivot][axis]);
        }
    }
    for row in (0..TERMS).rev() {
        let known: [f64; 2] =
            from_fn(|axis| (row + 1..TERMS).map(|column| matrix[row][column] * sides[column][axis]).sum());
        sides[row] = from_fn(|axis| (sides[row][axis] - known[axis]) / matrix[row][row]);
    }
    sides
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: Cubic = Cubic([0.1, 0.2, -0.03, 0.004, 1.1, -0.06, 0.007, 0.05, -0.009, 0.01]);
    const Y: Cubic = Cubic([-0.3, 0.9, 0.02, 0.005, 0.1, 0.04, -0.003, -0.02, 0.001, -0.002]);

    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn corners(width: usize, height: usize) -> impl Iterator<Item = [f64; 2]> {
        (0..=width).flat_map(move |i| (0..=height).map(move |j| [i as f64 - 4.0, j as f64 - 4.0]))
    }

    #[test]
    fn a_cubic_is_found_from_its_values() {
        let points = corners(8, 8).map(|[u, v]| [u, v, X.at(u, v), Y.at(u, v)]);
        let TileCurve(fitted) = TileCurve::fit(points);
        for (fitted, truth) in fitted.iter().zip([X, Y]) {
            for i in 0..TERMS {
                assert!((fitted.0[i] - truth.0[i]).abs() < 1e-9, "{fitted:?}");
            }
        }
    }

    /// Also where there are too few columns or rows to know all terms.
    #[test]
    fn a_narrow_image_has_a_curve() {
        for (width, height) in [(1, 1), (1, 8), (8, 2), (2, 1)] {
            let points = corners(width, height).map(|[u, v]| [u, v, X.at(u, v), Y.at(u, v)]);
            let TileCurve(fitted) = TileCurve::fit(points);
            for [u, v] in corners(width, height) {
                assert!(
                    (fitted[0].at(u, v) - X.at(u, v)).abs() < 1e-6 && (fitted[1].at(u, v) - Y.at(u, v)).abs() < 1e-6
                );
            }
        }
    }

    #[test]
    fn a_slanted_line_has_the_values_of_its_points() {
        for slope in [0.0, 0.375, -1.5] {
            let along = X.along(slope);
            for [column, height] in corners(8, 8) {
                assert!((along.at(column, height) - X.at(column, height + slope * column)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn no_value_lies_beyond_the_bulge() {
        for cubic in [X, Y] {
            for (low, high) in [([-4.0, -4.0], [4.0, 4.0]), ([1.0, -3.0], [3.0, 2.5]), ([-4.0, 2.0], [-3.5, 4.0])] {
                let size = [high[0] - low[0], high[1] - low[1]];
                let at_corners = [low[0], high[0]].map(|u| [low[1], high[1]].map(|v| cubic.at(u, v)));
                let at_corners = at_corners.as_flattened();
                let bulge = cubic.bulge(size, 4.0);
                let least = at_corners.iter().copied().fold(f64::INFINITY, f64::min) - bulge;
                let most = at_corners.iter().copied().fold(f64::NEG_INFINITY, f64::max) + bulge;
                for [i, j] in corners(16, 16) {
                    let at = |axis: usize, i: f64| low[axis] + size[axis] * (i + 4.0) / 16.0;
                    let value = cubic.at(at(0, i), at(1, j));
                    assert!((least..=most).contains(&value));
                }
            }
        }
    }
}
