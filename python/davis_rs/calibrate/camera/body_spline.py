"""Models orientation as a spline: a fixed curve through measured rotations, and small unknown turns about it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .reprojection import cross_matrix, rotation_of
from .spline_basis import SplineBasis

FloatArray = npt.NDArray[np.float64]


_KNOTS_BETWEEN = 3


class BodySpline:
    """R(t) = R_0(t) Exp(d(t)): R_0 interpolates measured rotations, d is a spline of rotation vectors.

    R_0 goes through measurements three knots of d apart, and not through all of them: d can then take away whatever
    noise R_0 has.

    Args:
        t_s: (n,) times of the measured rotations, increasing.
        rotations: (n, 3, 3).
    """

    def __init__(self, t_s: FloatArray, rotations: FloatArray, knot_rate_hz: float) -> None:
        from scipy.spatial.transform import Rotation, RotationSpline

        chosen = [0]
        for i, t in enumerate(t_s):
            if t - t_s[chosen[-1]] >= _KNOTS_BETWEEN / knot_rate_hz or (i == len(t_s) - 1 and i != chosen[-1]):
                chosen.append(i)
        self._course = RotationSpline(t_s[chosen], Rotation.from_matrix(rotations[chosen]))
        self.basis = SplineBasis(float(t_s[0]), float(t_s[-1]), knot_rate_hz)

    def rotations(self, coefficients: FloatArray, t_s: FloatArray) -> FloatArray:
        """Return R at times, (n, 3, 3), for coefficients (size, 3) of d."""
        turn = rotation_of(self.basis.matrix(t_s) @ coefficients)
        return np.asarray(self._course(t_s).as_matrix() @ turn)

    def rates(self, coefficients: FloatArray, t_s: FloatArray) -> FloatArray:
        """Return rates in the body's axes, (n, 3), rad/s: Exp(-d) w_0 + J(d) d', J the right Jacobian of SO(3)."""
        d, rate = self.basis.matrix(t_s) @ coefficients, self.basis.matrix(t_s, 1) @ coefficients
        turned = np.einsum("nji,nj->ni", rotation_of(d), self._course(t_s, 1))
        return np.asarray(turned + np.einsum("nij,nj->ni", right_jacobian(d), rate))

    def motions(self, coefficients: FloatArray, t_s: FloatArray) -> FloatArray:
        """Return J(d), (n, 3, 3): a small change e of d turns R by J(d) e in the body's axes."""
        return right_jacobian(self.basis.matrix(t_s) @ coefficients)

    def rate_derivatives(self, coefficients: FloatArray, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return d(rate)/d(d), to first order in d, and d(rate)/d(d'), (n, 3, 3) each."""
        d, rate = self.basis.matrix(t_s) @ coefficients, self.basis.matrix(t_s, 1) @ coefficients
        turned = np.einsum("nji,nj->ni", rotation_of(d), self._course(t_s, 1))
        jacobian = right_jacobian(d)
        return cross_matrix(turned) @ jacobian + cross_matrix(rate) / 2, jacobian


def right_jacobian(vectors: FloatArray) -> FloatArray:
    """Return J, (n, 3, 3), with Exp(d + e) = Exp(d) Exp(J e) to first order in e, at rotation vectors d (n, 3).

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2, section 10.
    """
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = cross_matrix(vectors)
    small = angle < 1e-4  # there the next terms are below 1e-9
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) - first * cross + second * (cross @ cross))
