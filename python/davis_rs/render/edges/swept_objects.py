"""Which pixels the edges of a scene with moving objects may sweep: each object's edges in its own frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import MitsubaScene
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray, Pose
from ...geometry.trajectory.trajectory import SegmentTrajectory, Trajectory
from ...geometry.trajectory.views import Views
from ..motion.scene_motion import SceneMotion, held, seen_from
from .swept import Counts, Silhouettes

_BEND_PX = 0.05
"""Steps are so short that the camera's path in a turning object's frame is straight within this, seen in the image."""

_MOST_STEPS = 64


class MovingSilhouettes:
    """The edges of a scene's surfaces, those of its moving objects among them; see :class:`Silhouettes`.

    An object's edges are followed in its own frame, in which they stand still and the camera makes all of the motion.

    Args:
        mi_scene: a loaded Mitsuba scene, each object in its own frame, as it is loaded.
        motion: what moves in it.
    """

    def __init__(self, mi_scene: MitsubaScene, motion: SceneMotion) -> None:
        shapes = mi_scene.shapes()
        self._still = Silhouettes.of_shapes([shape for shape in shapes if shape.id() not in motion.objects])
        self._objects = [
            (Silhouettes.of_shapes([shape for shape in shapes if shape.id() == name]), trajectory)
            for name, trajectory in motion.objects.items()
        ]

    def swept(
        self,
        camera: Camera,
        poses_before: Sequence[Pose],
        poses_after: Sequence[Pose],
        *,
        t_before_s: npt.ArrayLike,
        t_after_s: npt.ArrayLike,
        margin_px: float,
    ) -> Counts:
        """How many edges may touch each pixel (n, H, W), in n intervals of the sequence's time.

        As :meth:`Silhouettes.swept`. Objects are taken to go at constant velocity and body rate through each of at most
        64 steps of an interval, the more the farther they turn; an edge of an object may count once in each step.

        Args:
            t_before_s, t_after_s: (n,) when each interval begins and ends, seconds of the sequence.

        Raises:
            ValueError: as :meth:`Silhouettes.swept`, or for another number of times than of poses.
        """
        start_s, end_s = (np.asarray(t_s, np.float64) for t_s in (t_before_s, t_after_s))
        counts = self._still.swept(camera, poses_before, poses_after, margin_px=margin_px)
        if start_s.shape != (len(counts),) or end_s.shape != (len(counts),):
            raise ValueError(f"{len(counts)} intervals need as many times, got {start_s.shape} and {end_s.shape}")
        for silhouettes, trajectory in self._objects:
            for i, (before, after) in enumerate(zip(poses_before, poses_after, strict=True)):
                poses = _relative(camera, SegmentTrajectory(before, after, 1.0), trajectory, start_s[i], end_s[i])
                steps = silhouettes.swept(camera, poses[:-1], poses[1:], margin_px=margin_px + _BEND_PX)
                counts[i] = np.minimum(counts[i] + steps.sum(0, dtype=np.int64), 255)
        return counts


def _relative(camera: Camera, path: Trajectory, trajectory: Trajectory, start_s: float, end_s: float) -> list[Pose]:
    """The camera in an object's frame at the ends of the steps of an interval, in which it follows ``path``."""
    # Seen from a frame that turns by an angle a, a straight path bends by a^2 / 8 of its distance: f a^2 / 8 pixels.
    turn = _turn(held(trajectory, np.linspace(start_s, end_s, 9)))
    steps = int(np.clip(np.ceil(turn * np.sqrt(max(camera.fx, camera.fy) / (8 * _BEND_PX))), 1, _MOST_STEPS))
    fraction = np.linspace(0.0, 1.0, steps + 1)
    own = seen_from(Views.along(path, fraction), held(trajectory, start_s + fraction * (end_s - start_s)))
    matrices = np.tile(np.eye(4), (len(own), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = own.rotations, own.positions
    return [Pose.from_matrix(matrix) for matrix in matrices]


def _turn(poses: Views) -> float:
    """The angle through which an object turns from the first of some poses to the last."""
    from scipy.spatial.transform import Rotation

    steps: FloatArray = Rotation.from_matrix(poses.rotations[:-1].swapaxes(1, 2) @ poses.rotations[1:]).magnitude()
    return float(steps.sum())
