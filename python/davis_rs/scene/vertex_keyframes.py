"""Deforms meshes whose vertices are known at some instants: cloth, captured people, simulations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from ..geometry.box import box_corners
from ..geometry.pose import FloatArray
from .deformation import Deformation, DeformedMesh, MovingPoints


class VertexKeyframes(Deformation):
    """Moves each vertex on straight lines between its positions at some instants.

    >>> cloth = davis_rs.VertexKeyframes([0.0, 0.5, 1.0], positions)
    >>> scene = dataclasses.replace(scene, deformations={"cloth": cloth})

    Args:
        t_s: (k,), increasing times from 0, at least two, seconds.
        positions: (k, v, 3), metres, in the order of the shape's vertex buffer and in the object's own frame.
        normals: (k, v, 3), of the vertices, of any length; None for a mesh of flat triangles. In between they turn with
            the mean of both.

    Raises:
        ValueError: for times that do not increase from 0, another shape, or a number that is not finite.
    """

    def __init__(self, t_s: npt.ArrayLike, positions: npt.ArrayLike, normals: npt.ArrayLike | None = None) -> None:
        self._t_s, self._positions = np.array(t_s, np.float64), np.array(positions, np.float64)
        self._normals = None if normals is None else np.array(normals, np.float64)
        times, shape = self._t_s, self._positions.shape
        if times.ndim != 1 or len(times) < 2 or times[0] != 0 or not (np.diff(times) > 0).all():
            raise ArgumentError("{t_s} must be two or more times that increase from 0, got {}", times.tolist()[:5])
        if len(shape) != 3 or shape[0] != len(times) or shape[2] != 3 or shape[1] == 0:
            raise ArgumentError("{positions} must have shape ({}, vertices, 3), got {}", len(times), shape)
        if self._normals is not None and self._normals.shape != shape:
            raise ArgumentError("{normals} must have the shape {} of {positions}, got {}", shape, self._normals.shape)
        for name, values in (("t_s", times), ("positions", self._positions), ("normals", self._normals)):
            if values is not None and not np.isfinite(values).all():
                raise ValueError(f"{name} must be finite")
        self.duration_s = float(times[-1])
        span = np.diff(times)[:, None, None]
        moved = np.diff(self._positions, axis=0) / span
        self._speeds = np.linalg.norm(moved, axis=2).max(1)
        ends = np.stack([self._positions.min(1), self._positions.max(1)])
        self._corners = box_corners(ends)

    def meshes(self, t_s: FloatArray) -> Iterator[DeformedMesh]:
        """Yield the mesh at each of the times, see :meth:`Deformation.meshes`."""
        for number, fraction in zip(*self._segments(t_s), strict=True):
            normals = None
            if self._normals is not None:
                normals = _between(self._normals, number, fraction)
                length = np.linalg.norm(normals, axis=1, keepdims=True)
                normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
            yield DeformedMesh(_between(self._positions, number, fraction), normals)

    def velocities(self, t_s: FloatArray) -> Iterator[FloatArray]:
        """Yield the vertices' velocities, see :meth:`Deformation.velocities`."""
        for number, moves in zip(self._segments(t_s)[0], self.moves(t_s), strict=True):
            moved = self._positions[number + 1] - self._positions[number]
            yield moved * (moves / (self._t_s[number + 1] - self._t_s[number]))

    def hull(self, t_s: FloatArray) -> FloatArray:
        """Return the corners of boxes, see :meth:`Deformation.hull`."""
        number, fraction = self._segments(t_s)
        fraction = fraction[:, None, None]
        return np.asarray((1 - fraction) * self._corners[number] + fraction * self._corners[number + 1])

    def fastest(self, t_s: FloatArray) -> FloatArray:
        """Return the speed of the fastest vertex, or of a corner of the box if that is faster."""
        span = np.diff(self._t_s)
        of_box = np.linalg.norm(np.diff(self._corners, axis=0), axis=2).max(1) / span
        return np.asarray(np.maximum(self._speeds, of_box)[self._segments(t_s)[0]] * self.moves(t_s))

    def moving_points(self, t_s: FloatArray) -> Iterator[MovingPoints]:
        """Yield the vertices: points of a triangle move as means of them."""
        for number, fraction, velocities in zip(*self._segments(t_s), self.velocities(t_s), strict=True):
            yield MovingPoints(_between(self._positions, number, fraction), velocities, 0.0)

    def breaks_s(self) -> FloatArray:
        """Return the times at which vertices change their direction."""
        return self._t_s[1:-1]

    def describe(self) -> dict[str, object]:
        """Return how many keyframes and vertices there are."""
        return {"kind": "vertex keyframes", "keyframes": len(self._t_s), "vertices": self._positions.shape[1]}

    def _segments(self, t_s: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Return the keyframe before each of the times, and the fraction of the way to the next."""
        number = np.clip(np.searchsorted(self._t_s, t_s, side="right") - 1, 0, len(self._t_s) - 2)
        span = self._t_s[number + 1] - self._t_s[number]
        return number, np.clip((t_s - self._t_s[number]) / span, 0.0, 1.0)


def _between(values: FloatArray, number: int, fraction: float) -> FloatArray:
    return np.asarray((1 - fraction) * values[number] + fraction * values[number + 1])
