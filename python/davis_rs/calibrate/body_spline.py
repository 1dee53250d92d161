"""Orientation as a spline: a fixed curve through measured rotations, and small turns about it that are to be found."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .reprojection import cross_matrix, rotation_of
from .spline_basis import SplineBasis

FloatArray = npt.NDArray[np.float64]


class BodySpline:
    """R(t) = R_0(t) Exp(d(t)): R_0 interpolates measured rotations, d is a spline of rotation vectors.

    d only takes away the measurements' noise, so it is small, and derivatives by its coefficients may be taken to first
    order in it; values are exact.

    Args:
        t_s: (n,) times of the measured rotations, increasing.
        rotations: (n, 3, 3).
    """

    def __init__(self, t_s: FloatArray, rotations: FloatArray, knot_rate_hz: float) -> None:
        from scipy.spatial.transform import Rotation, RotationSpline

        self._course = RotationSpline(t_s, Rotation.from_matrix(rotations))
        self.basis = SplineBasis(float(t_s[0]), float(t_s[-1]), knot_rate_hz)

    def rotations(self, coefficients: FloatArray, t_s: FloatArray) -> FloatArray:
        """R at times, (n, 3, 3), for coefficients (size, 3) of d."""
        turn = rotation_of(self.basis.matrix(t_s) @ coefficients)
        return np.asarray(self._course(t_s).as_matrix() @ turn)

    def rates(self, coefficients: FloatArray, t_s: FloatArray) -> FloatArray:
        """Angular rates in the body's axes, (n, 3), rad/s: Exp(-d) w_0 + J(d) d', J the right Jacobian of SO(3)."""
        d, rate = self.basis.matrix(t_s) @ coefficients, self.basis.matrix(t_s, 1) @ coefficients
        turned = np.einsum("nji,nj->ni", rotation_of(d), self._course(t_s, 1))
        return np.asarray(turned + np.einsum("nij,nj->ni", right_jacobian(d), rate))

    def rate_derivatives(self, coefficients: FloatArray, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """d(rate)/d(d) and d(rate)/d(d'), (n, 3, 3) each, to first order in d."""
        d, rate = self.basis.matrix(t_s) @ coefficients, self.basis.matrix(t_s, 1) @ coefficients
        turned = np.einsum("nji,nj->ni", rotation_of(d), self._course(t_s, 1))
        return cross_matrix(turned) + cross_matrix(rate) / 2, right_jacobian(d)


def right_jacobian(vectors: FloatArray) -> FloatArray:
    """J, (n, 3, 3), with Exp(d + e) = Exp(d) Exp(J e) to first order in e, at rotation vectors d (n, 3).

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2, section 10.
    """
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = cross_matrix(vectors)
    small = angle < 1e-4  # there the next terms are below 1e-9
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) - first * cross + second * (cross @ cross))
