"""Defines the pose of a camera, and the quaternion algebra that it needs: (x, y, z, w), Hamilton."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from .._util.few_numbers import all_finite

FloatArray = npt.NDArray[np.float64]

UNIT_NORM_TOLERANCE = 1e-3
_ROTATION_TOLERANCE = 1e-6

_Component = TypeVar("_Component", float, FloatArray)
"""Of a quaternion, or of many."""


@dataclass(frozen=True, eq=False, init=False)
class Pose:
    """Holds T_world_camera, which maps points in camera axes (x right, y down, z forward) to the world.

    Args:
        position: the camera's centre in the world, metres, shape (3,).
        quaternion: rotation R_world_camera as (x, y, z, w), Hamilton, of norm 1 within 1e-3; it is then normalised.

    Both are held as read-only float64 arrays.

    Raises:
        ValueError: for another shape, a value that is not finite, or a quaternion that is not of norm 1.
    """

    position: FloatArray
    quaternion: FloatArray

    def __init__(self, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        for name, size, values in (("position", 3, position), ("quaternion", 4, quaternion)):
            array = _numbers(values, f"pose {name}")
            if array.shape != (size,):
                raise ValueError(f"pose {name} must have shape ({size},), got {array.shape}")
            if not all_finite(array):
                raise ValueError(f"pose {name} must be finite, got {array.tolist()}")
            if name == "quaternion":
                norm = float(np.linalg.norm(array))
                if abs(norm - 1.0) > UNIT_NORM_TOLERANCE:
                    raise ValueError(
                        f"pose quaternion must have norm 1 within {UNIT_NORM_TOLERANCE}, got norm {norm:.9g}"
                    )
                array /= norm
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def rotation(self) -> FloatArray:
        """Return R_world_camera, shape (3, 3)."""
        return rotation_matrices(self.quaternion)

    @property
    def matrix(self) -> FloatArray:
        """Return T_world_camera, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.position
        return matrix

    def __matmul__(self, other: Pose) -> Pose:
        """Return T_world_b of T_world_a (this pose) and T_a_b (the other): the pose of what is mounted on this one."""
        if not isinstance(other, Pose):
            return NotImplemented
        position = self.position + self.rotation @ other.position
        return Pose(position, hamilton(self.quaternion, other.quaternion))

    @property
    def inverse(self) -> Pose:
        """Return T_camera_world: the world as the camera sees it."""
        return Pose(-self.rotation.T @ self.position, conjugate(self.quaternion))

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose:
        """Return the pose of a T_world_camera (4, 4); the sign of its quaternion is free.

        Raises:
            ValueError: if it is not a rigid transform (rotation within 1e-6, last row 0 0 0 1).
        """
        m = _numbers(matrix, "a pose matrix")
        if m.shape != (4, 4) or not np.isfinite(m).all() or not np.array_equal(m[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(f"a pose matrix must be finite, of shape (4, 4), with last row 0 0 0 1, got {m.tolist()}")
        r = m[:3, :3]
        off = float(np.abs(r @ r.T - np.eye(3)).max())
        if off > _ROTATION_TOLERANCE or np.linalg.det(r) < 0:
            fault = f"is off by {off:.3g}" if off > _ROTATION_TOLERANCE else "is mirrored"
            raise ValueError(
                f"a pose matrix must hold a rotation (orthonormal within {_ROTATION_TOLERANCE:g}, right-handed), "
                f"got {r.tolist()}, which {fault}"
            )
        return cls(m[:3, 3], _quaternion(r))


PoseLike: TypeAlias = Pose | npt.ArrayLike | tuple[npt.ArrayLike, npt.ArrayLike]
"""All that may be given as a pose, see :func:`as_pose`."""


def as_pose(given: PoseLike, argument: str = "pose") -> Pose:
    """Make a pose of all that may be given as one.

    >>> as_pose(np.eye(4))
    >>> as_pose(((0, 0, -1), (0, 0, 0, 1)))

    Args:
        given: a :class:`Pose`; a matrix T_world_camera (4, 4); or a pair of position (3,) in metres and quaternion (4,)
            of R_world_camera as (x, y, z, w).
        argument: the name of the argument, for messages.

    Raises:
        ArgumentError: for anything else, for what is no rigid, right-handed transform, a quaternion that is not of norm
            1, or a value that is not finite; with the rule and the value.
    """
    if isinstance(given, Pose):
        return given
    pair = given if isinstance(given, tuple | list) and len(given) == 2 else None
    try:
        return Pose.from_matrix(given) if pair is None else Pose(*pair)  # type: ignore[arg-type]
    except ValueError as error:
        raise ArgumentError(
            "{argument} must be a Pose, a 4 x 4 matrix T_world_camera, or (position, quaternion (x, y, z, w)): {}",
            error,
            argument=argument,
        ) from None


def _numbers(values: npt.ArrayLike | None, name: str) -> FloatArray:
    """Copy numbers to a new array, or refuse what is not numbers."""
    try:
        if values is None:
            raise TypeError
        return np.array(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers, got {values!r}") from None


class GroundTruth(NamedTuple):
    """Holds poses of the camera, T_world_camera, as a motion-capture system stamps them.

    ``t_us`` int64 (n,); ``positions`` float64 (n, 3) in metres; ``quaternions`` float64 (n, 4) as (x, y, z, w).
    """

    t_us: npt.NDArray[np.int64]
    positions: FloatArray
    quaternions: FloatArray


class Velocities(NamedTuple):
    """Holds velocities and accelerations of the camera, in its own axes (x right, y down, z ahead).

    ``t_us`` int64 (n,); the others float64 (n, 3): ``linear`` velocity of its centre (m/s), ``angular`` rate (rad/s),
    and their rates of change in the world, turned into camera axes: ``linear_acceleration`` (m/s^2, without gravity)
    and ``angular_acceleration`` (rad/s^2).
    """

    t_us: npt.NDArray[np.int64]
    linear: FloatArray
    angular: FloatArray
    linear_acceleration: FloatArray
    angular_acceleration: FloatArray

    def select(self, which: slice) -> Velocities:
        """Return the values of a slice of instants."""
        return Velocities(self.t_us[which], *(values[which] for values in self[1:]))


NO_VELOCITIES = Velocities(np.empty(0, np.int64), *[np.empty((0, 3))] * 4)
"""Velocities at no instants."""


def turn_deg(first: Pose, second: Pose) -> float:
    """Return the angle of the least rotation from one pose to another, degrees, 0 to 180."""
    return math.degrees(2 * math.acos(min(1.0, abs(float(first.quaternion @ second.quaternion)))))


def describe_pose(pose: Pose) -> dict[str, object]:
    """Return position and quaternion in JSON's types."""
    return {"position": pose.position.tolist(), "quaternion": pose.quaternion.tolist()}


def _product(
    ax: float, ay: float, az: float, aw: float, bx: float, by: float, bz: float, bw: float
) -> tuple[float, float, float, float]:
    """Return the product of two quaternions: the bits of those of arrays, in a fraction of the time."""
    return (
        aw * bx + bw * ax + (ay * bz - az * by),
        aw * by + bw * ay + (az * bx - ax * bz),
        aw * bz + bw * az + (ax * by - ay * bx),
        aw * bw - (ax * bx + ay * by + az * bz),
    )


_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])
"""For each of x, y, z the next two axes."""


def hamilton(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the Hamilton product a * b of quaternions (..., 4) in the order (x, y, z, w).

    Unlike a product of scipy's Rotations it is linear in both, so that the sign stays continuous.
    """
    if a.ndim == b.ndim == 1:
        return np.array(_product(*a.tolist(), *b.tolist()))
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    # np.cross has the same bits, but takes several times as long for a few vectors.
    cross = a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]
    return np.concatenate([aw * bv + bw * av + cross, aw * bw - (av * bv).sum(-1, keepdims=True)], -1)


def conjugate(q: FloatArray) -> FloatArray:
    """Return the conjugates of quaternions (..., 4)."""
    return q * _CONJUGATE


def body_rates(q: FloatArray, dq_dt: FloatArray) -> FloatArray:
    """Return the angular rate (..., 3) in body axes, rad/s, of unit quaternions: q' = q * (omega, 0) / 2 (Hamilton)."""
    return 2.0 * hamilton(conjugate(q), dq_dt)[..., :3]


def _quaternion(matrix: FloatArray) -> list[float]:
    """Return the quaternion of a rotation matrix (3, 3) with the bits that SciPy gives.

    Source: Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1, 1978.
    """
    if not np.isclose(matrix @ matrix.T, np.eye(3), atol=1e-12).all():
        left, _, right = np.linalg.svd(matrix, full_matrices=False)
        matrix = left @ right
    m = matrix.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    sizes = [m[0][0], m[1][1], m[2][2], trace]
    i = sizes.index(max(sizes))
    if i == 3:
        quaternion = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + trace]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        quaternion = [0.0, 0.0, 0.0, m[k][j] - m[j][k]]
        quaternion[i], quaternion[j], quaternion[k] = 1 - trace + 2 * m[i][i], m[j][i] + m[i][j], m[k][i] + m[i][k]
    x, y, z, w = quaternion
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return [component / norm for component in quaternion]


_FEW = 16
"""For so few quaternions plain floats are faster than arrays; a step of a closed loop has one or two."""


def _rotation_matrix(
    x: _Component, y: _Component, z: _Component, w: _Component, norm: _Component
) -> list[list[_Component]]:
    """Return the rotation matrix of a quaternion, or of many, with the bits that SciPy gives."""
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    return [
        [xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)],
        [2 * (xy + zw), -xx + yy - zz + ww, 2 * (yz - xw)],
        [2 * (xz - yw), 2 * (yz + xw), -xx - yy + zz + ww],
    ]


def rotation_matrices(q: FloatArray) -> FloatArray:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), or (3, 3) of one."""
    if len(q) <= _FEW and q.ndim == 2:
        few = [_rotation_matrix(x, y, z, w, math.sqrt(x * x + y * y + z * z + w * w)) for x, y, z, w in q.tolist()]
        return np.array(few).reshape(-1, 3, 3)
    x, y, z, w = np.moveaxis(q, -1, 0)
    norm = np.sqrt(x * x + y * y + z * z + w * w)
    return np.moveaxis(np.array(_rotation_matrix(x, y, z, w, norm)), (0, 1), (-2, -1)).copy()


IDENTITY = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""The pose of the world's own axes, or of what is mounted where its carrier is."""
