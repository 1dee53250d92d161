"""Evaluates uniform B-splines as sparse matrices: values and derivatives are linear in the coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_DEGREE = 5


class SplineBasis:
    """Quintic B-splines on evenly spaced knots over [``start_s``, ``end_s``].

    Attributes:
        size: number of coefficients.
    """

    def __init__(self, start_s: float, end_s: float, rate_hz: float) -> None:
        pieces = max(1, int(np.ceil((end_s - start_s) * rate_hz)))
        inner = np.linspace(start_s, end_s, pieces + 1)
        self._knots = np.concatenate([np.full(_DEGREE, start_s), inner, np.full(_DEGREE, end_s)])
        self.size = len(self._knots) - _DEGREE - 1

    def matrix(self, t_s: FloatArray, derivative: int = 0) -> Any:
        """Return the sparse matrix (n, ``size``) from coefficients to a derivative at times (n,) inside the range."""
        from scipy.interpolate import BSpline
        from scipy.sparse import diags_array

        knots, degree, size = self._knots, _DEGREE, self.size
        down = None
        for _ in range(derivative):
            # The derivative's coefficients: k (c[i + 1] - c[i]) / (t[i + k + 1] - t[i + 1]).
            weight = degree / (knots[degree + 1 : degree + size] - knots[1:size])
            step = diags_array((-weight, weight), offsets=(0, 1), shape=(size - 1, size))
            down = step if down is None else step @ down
            knots, degree, size = knots[1:-1], degree - 1, size - 1
        values = BSpline.design_matrix(t_s, knots, degree)
        return values if down is None else (values @ down).tocsr()
