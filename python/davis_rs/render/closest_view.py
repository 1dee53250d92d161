"""Finds how large a camera's path shows the parts of a scene, so that they are made as fine as the image asks for."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.camera import Camera
from ..scene.scene import Scene
from .motion.scene_motion import SceneMotion, held

FloatArray = npt.NDArray[np.float64]

_INSTANTS = 129
"""At how many instants of the path the camera is looked at."""


class ClosestView:
    """A bound on how many pixels a metre on a surface covers, anywhere along a camera's path.

    The bound holds wherever the camera looks, and up to the corners of the image. Parts that are hidden, or behind the
    camera, get finer than they need to be; nothing gets too coarse.

    Args:
        scene: its trajectory is the path; without one, its start.
        camera: its lens.
        motion: of the scene's objects, in whose frames the camera is closest to them.

    Attributes:
        known: whether there is a path or a start; without either, no distance is known.
    """

    def __init__(self, scene: Scene, camera: Camera, motion: SceneMotion) -> None:
        times, positions = np.zeros(0), np.zeros((0, 3))
        if scene.trajectory is not None:
            times = np.linspace(0.0, scene.trajectory.duration_s, _INSTANTS)
            positions = scene.trajectory.positions(times)
        elif scene.start is not None:
            times, positions = np.zeros(1), np.array([scene.start.position], np.float64)
        self.known = len(times) > 0
        self._boxes = {
            name: box for name, box in zip(motion.objects, motion.boxes, strict=True) if name in motion.deformations
        }
        self._positions = {"": positions}
        for name, path in motion.objects.items():
            poses = held(path, times)
            self._positions[name] = np.einsum("nji,nj->ni", poses.rotations, positions - poses.positions)
        # Between two instants the camera may come closer by half of the way between them.
        self._slack = {
            name: np.linalg.norm(np.diff(at, axis=0), axis=1).max(initial=0.0) / 2
            for name, at in self._positions.items()
        }
        corners = np.array([[x, y] for x in (-0.5, camera.width - 0.5) for y in (-0.5, camera.height - 0.5)])
        # A pinhole stretches what lies aside, along the radius most of all.
        stretch = 1 + (camera.rays(corners) ** 2).sum(1).max()
        self._pixels_per_radian = max(camera.fx, camera.fy) * float(stretch)

    def __eq__(self, other: object) -> bool:
        """Return whether both bound the same path through the same lens."""
        return (
            isinstance(other, ClosestView)
            and self._pixels_per_radian == other._pixels_per_radian
            and self._positions.keys() == other._positions.keys()
            and all(np.array_equal(at, other._positions[name]) for name, at in self._positions.items())
        )

    __hash__ = None  # type: ignore[assignment]

    def pixels_per_metre(self, corners: FloatArray, name: str) -> FloatArray:
        """Return the bound for parts of a shape, (n,); infinite where the path touches one.

        Args:
            corners: float64 (n, k, 3), points whose convex hull holds each part, metres.
            name: the shape's id, by which it may be an object that moves.
        """
        positions = self._positions.get(name, self._positions[""])
        slack = self._slack.get(name, self._slack[""])
        low, high = corners.min(1), corners.max(1)
        deforms = name in self._boxes
        if deforms:
            # A part may get anywhere in the box of the mesh.
            low, high = (np.broadcast_to(end, low.shape) for end in self._boxes[name])
        closest = np.full(len(corners), np.inf)
        for position in positions:
            # A box around a slanted triangle comes closer than the triangle does, and so may its plane: both are
            # bounds, so the farther counts.
            outside = np.maximum(np.maximum(low - position, position - high), 0.0)
            distance = np.linalg.norm(outside, axis=1)
            if corners.shape[1] == 3 and not deforms:
                distance = np.maximum(distance, _to_planes(corners, position))
            closest = np.minimum(closest, distance)
        with np.errstate(divide="ignore"):
            return np.asarray(self._pixels_per_radian / np.maximum(closest - slack, 0.0))


def _to_planes(corners: FloatArray, position: FloatArray) -> FloatArray:
    """Return the distances (n,) of a point to the planes of triangles; 0 for triangles without area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    offsets = np.abs(np.einsum("ij,ij->i", position - corners[:, 0], normals))
    return np.divide(offsets, length, out=np.zeros_like(offsets), where=length > 0)
