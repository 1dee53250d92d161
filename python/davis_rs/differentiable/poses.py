"""Holds camera poses as Dr.Jit arrays, through which derivatives flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, JitIndex, JitMatrix, JitTensor, JitVector, TensorLike
from .._mitsuba.variants import FAST, variant
from ..geometry.pose import PoseLike
from ..geometry.trajectory.views import Views
from .spline_weights import spline_weights


@dataclass(frozen=True, eq=False)
class CameraPoses:
    """n poses T_world_camera, float32, of Mitsuba's ``llvm_ad_rgb`` types.

    Attributes:
        positions: ``mi.Point3f`` of width n: the cameras' centres in the world, metres.
        rotations: ``mi.Matrix3f`` of width n: R_world_camera.
    """

    positions: JitVector
    rotations: JitMatrix

    @classmethod
    def at(cls, poses: Sequence[PoseLike]) -> CameraPoses:
        """Make poses as constants, to start from with :meth:`perturbed`."""
        views = Views.at_rest(poses)
        with variant(FAST) as (mi, _):
            positions, rotations = (
                [mi.Float(np.array(column, np.float32)) for column in table.reshape(len(views), -1).T]
                for table in (views.positions, views.rotations)
            )
            return cls(mi.Point3f(positions), mi.Matrix3f(*rotations))

    @classmethod
    def from_quaternions(cls, poses: TensorLike) -> CameraPoses:
        """Make poses from a tensor (n, 7): position in metres, then the rotation (x, y, z, w), Hamilton, normalised
        here.

        Raises:
            ValueError: for another shape.
        """
        with variant(FAST) as (mi, dr):
            px, py, pz, *q = _columns("poses", poses, 7)
            x, y, z, w = dr.normalize(mi.Vector4f(q))
            rotations = mi.Matrix3f(
                *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
            )
            return cls(mi.Point3f(px, py, pz), rotations)

    def perturbed(self, increments: TensorLike) -> CameraPoses:
        """Return these poses, moved by ``increments`` (n, 6), a tensor: one row for each pose, or several rows for one.

        A row is a translation in world axes, metres, then a rotation vector in camera axes, radians:
        position + row[:3], R_world_camera exp(row[3:]). Where a row is zero the pose keeps its bits.

        Raises:
            ValueError: for another shape.
        """
        with variant(FAST) as (mi, dr):
            dx, dy, dz, *vector = _columns("increments", increments, 6)
            if len(self) not in (1, dr.width(dx)):
                raise ValueError(f"increments of {len(self)} poses must be as many rows, got {dr.width(dx)}")
            return CameraPoses(self.positions + mi.Vector3f(dx, dy, dz), self.rotations @ exponential_map(*vector))

    def gather(self, index: JitIndex) -> CameraPoses:
        """Return the poses at an index array; a value that is the same for all poses keeps the width 1."""
        import drjit as dr
        import mitsuba as mi

        def each(values: JitVector) -> list[JitFloat]:
            return [value if dr.width(value) == 1 else dr.gather(mi.Float, value, index) for value in values]

        rows = [each(row) for row in self.rotations]
        return CameraPoses(mi.Point3f(each(self.positions)), mi.Matrix3f(*rows[0], *rows[1], *rows[2]))

    def __len__(self) -> int:
        import drjit as dr

        return int(dr.width(self.positions, self.rotations))


def exponential_map(x: JitFloat, y: JitFloat, z: JitFloat) -> JitMatrix:
    """Compute the rotation of a rotation vector (Rodrigues' formula), smooth through zero, as a ``mi.Matrix3f``."""
    import drjit as dr
    import mitsuba as mi

    squared = x * x + y * y + z * z
    small = squared < 1e-3
    angle = dr.sqrt(dr.select(small, 1, squared))
    # sin(angle) / angle and (1 - cos(angle)) / angle^2; the series leave out less than 1e-12.
    half = dr.sin(angle / 2) / angle
    a = dr.select(small, 1 - squared / 6 + dr.square(squared) / 120, dr.sin(angle) / angle)
    b = dr.select(small, 0.5 - squared / 24 + dr.square(squared) / 720, 2 * dr.square(half))
    cosine = 1 - b * squared
    return mi.Matrix3f(
        *(cosine + b * x * x, b * x * y - a * z, b * x * z + a * y),
        *(b * x * y + a * z, cosine + b * y * y, b * y * z - a * x),
        *(b * x * z - a * y, b * y * z + a * x, cosine + b * z * z),
    )


def spline(control_points: TensorLike, t_s: npt.ArrayLike, *, duration_s: float, degree: int = 3) -> JitTensor:
    """Evaluate (n, k) at the times ``t_s`` (n,) of the B-spline with ``control_points`` (m, k), both tensors.

    Uniform knots over 0..``duration_s``, clamped: the curve begins at the first control point and ends at the last.
    Degree 3 is the cubic B-spline, degree 1 is linear from point to point. As ``increments`` of
    :meth:`CameraPoses.perturbed` it makes control points (m, 6) of a trajectory: position and rotation vector about
    one pose, which serves for rotations below half a turn, or about each pose of a known trajectory.

    Raises:
        ValueError: for fewer than degree + 1 control points, another shape, or times outside of 0..``duration_s``.

    Source: de Boor, A Practical Guide to Splines, 1978, chapter IX.
    """
    with variant(FAST) as (mi, dr):
        points, times = tensor(control_points), np.asarray(t_s, np.float64)
        if len(points.shape) != 2 or points.shape[0] < degree + 1:
            raise ValueError(f"control points must have shape (m >= {degree + 1}, k), got {points.shape}")
        count, width = points.shape
        basis = spline_weights(times, count, duration_s=duration_s, degree=degree)
        value = dr.arange(mi.UInt32, len(times) * width)
        row, total = value // width, dr.zeros(mi.Float, len(times) * width)
        # Each row has the weights of degree + 1 neighbouring points.
        for k in range(degree + 1):
            weights, points_of = (part.reshape(len(times), -1)[:, k] for part in (basis.data, basis.indices))
            weight = dr.gather(mi.Float, mi.Float(np.array(weights, np.float32)), row)
            first = dr.gather(mi.UInt32, mi.UInt32(np.array(points_of, np.uint32)), row) * width
            total = dr.fma(weight, dr.gather(mi.Float, points.array, first + value % width), total)
        return mi.TensorXf(total, (len(times), width))


def tensor(values: TensorLike) -> JitTensor:
    """Make a ``mi.TensorXf`` of a Dr.Jit array, which stays attached, or of anything that NumPy takes."""
    import drjit as dr
    import mitsuba as mi

    if dr.is_tensor_v(values):
        return mi.TensorXf(values)
    # A copy, because Dr.Jit may keep using the memory that it is given.
    return mi.TensorXf(dr.ravel(values) if dr.is_array_v(values) else np.array(values, np.float32, order="C"))


def _columns(name: str, rows: TensorLike, width: int) -> list[JitFloat]:
    import drjit as dr
    import mitsuba as mi

    table = tensor(rows)
    if len(table.shape) != 2 or table.shape[1] != width or table.shape[0] == 0:
        raise ValueError(f"{name} must have shape (n, {width}), got {table.shape}")
    row = dr.arange(mi.UInt32, table.shape[0])
    return [dr.gather(mi.Float, table.array, row * width + column) for column in range(width)]
