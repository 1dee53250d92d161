"""Solves least squares over what is no vector: states that small steps move (poses, say).

scipy's own solver wants a vector space.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
State = TypeVar("State")

_LARGEST_DAMPING = 1e8


def levenberg_marquardt(
    start: State,
    residuals: Callable[[State], FloatArray],
    jacobian: Callable[[State], Any],
    move: Callable[[State, FloatArray], State],
    *,
    iterations: int = 50,
    tolerance: float = 1e-10,
) -> State:
    """Return the state near ``start`` of the least sum of squared residuals.

    Args:
        residuals: of a state, (m,); not finite where a state makes no sense.
        jacobian: d(residuals)/d(step) at a state for steps of zero, (m, n), an array or a SciPy sparse matrix.
        move: a state after a step (n,).
        iterations: the most steps that are taken.
        tolerance: done when a step promises to lower the sum by less than this share of it.

    Raises:
        ValueError: if the residuals of ``start`` are not finite, or it does not converge: then the measurements do not
            fit the model.

    Source: Marquardt, SIAM J. Appl. Math. 1963: damping in proportion to each parameter's own curvature.
    """
    state, r = start, residuals(start)
    cost, damping = float(r @ r), 1e-6
    if not np.isfinite(cost):
        raise ValueError("least squares must start where all residuals are finite")
    for _ in range(iterations):
        derivative = jacobian(state)
        normal, gradient = derivative.T @ derivative, derivative.T @ r
        diagonal = np.maximum(normal.diagonal(), 1e-12 * normal.diagonal().max())
        while True:
            step = -solve(_plus_diagonal(normal, damping * diagonal), gradient)
            promised = -float(step @ (2 * gradient + normal @ step))
            if promised <= tolerance * cost:
                return state
            moved = move(state, step)
            moved_r = residuals(moved)
            moved_cost = float(moved_r @ moved_r)
            if moved_cost < cost:  # False, too, where it is not finite
                break
            damping = max(10 * damping, 1e-6)
            if damping > _LARGEST_DAMPING:
                return state  # no step helps: this is as low as floats go
        state, r, cost, damping = moved, moved_r, moved_cost, damping / 10
    raise ValueError(
        f"least squares has not converged in {iterations} iterations: the measurements do not fit together"
    )


def solve(matrix: Any, right: FloatArray) -> FloatArray:
    """Return the solution of a linear system, dense or sparse."""
    if isinstance(matrix, np.ndarray):
        return np.asarray(np.linalg.solve(matrix, right))
    from scipy.sparse.linalg import splu

    return np.asarray(splu(matrix.tocsc()).solve(right))


def _plus_diagonal(matrix: Any, diagonal: FloatArray) -> Any:
    if isinstance(matrix, np.ndarray):
        return matrix + np.diag(diagonal)
    from scipy.sparse import diags_array

    return matrix + diags_array(diagonal)
