"""Computes weights of the control points of a clamped, uniform B-spline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def spline_weights(t_s: npt.ArrayLike, count: int, *, duration_s: float, degree: int = 3) -> csr_array:
    """Return weights (n, ``count``) of control points at times (n,), degree + 1 in each row; they add up to 1.

    Uniform knots over 0..``duration_s``, clamped: the curve begins at the first control point and ends at the last.

    Raises:
        ValueError: for fewer than degree + 1 control points, or times that are not (n,) within 0..``duration_s``.

    Source: de Boor, A Practical Guide to Splines, 1978, chapter IX.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array

    times = np.asarray(t_s, np.float64)
    if count < degree + 1:
        raise ValueError(f"a spline of degree {degree} needs at least {degree + 1} control points, got {count}")
    if times.ndim != 1 or not ((times >= 0) & (times <= duration_s)).all():
        raise ValueError(f"times must be of shape (n,) and lie in 0..{duration_s} s, got {times.tolist()}")
    if len(times) == 0:
        return csr_array((0, count))
    knots = _knots(count, duration_s, degree)
    return csr_array(BSpline.design_matrix(times, knots, degree))


def spline_weight_rates(
    t_s: npt.ArrayLike, count: int, *, duration_s: float, degree: int = 3
) -> npt.NDArray[np.float64]:
    """Return derivatives (n, ``count``) of :func:`~davis_rs.differentiable.spline_weights` by time, per second."""
    from scipy.interpolate import BSpline

    basis = BSpline(_knots(count, duration_s, degree), np.eye(count), degree)
    return np.asarray(basis(np.asarray(t_s, np.float64), nu=1))


def _knots(count: int, duration_s: float, degree: int) -> npt.NDArray[np.float64]:
    inner = np.linspace(0, duration_s, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.full(degree, duration_s)])
