"""Makes a task with its scene: keep a marker that moves before a wall in the middle of the image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._mitsuba.types import SceneDictionary
from .._util.argument_checks import check_number
from ..geometry.camera import Camera
from ..geometry.pose import FloatArray, Pose, PoseLike
from ..scene.parts import DIRECT, rectangle, start_looking_at, textured_rectangle
from ..scene.scene import Scene
from .bodies import BODIES, Body
from .environment import EventCameraEnv
from .tasks import Moment, Task, Verdict

MARKER = "marker"
"""The id of the object that moves."""

_CENTRE = np.array([0.0, 2.0, 1.2])
_WALL_M, _HALF_M = 2.5, 0.12
_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # x right, y up, seen from where cameras start

_SWINGS = 3


def marker_scene() -> Scene:
    """Make a textured square, 24 cm wide, before a grey wall; 2 m from where cameras start.

    The square is the movable object ``marker``. Its pose is its shift from where the task starts.
    """
    return Scene(name="marker", source=_marker, camera=_camera(96), shadows=False, contrast_threshold=0.2).with_movable(
        MARKER
    )


def _marker() -> SceneDictionary:
    wall = rectangle([0.0, _WALL_M, 1.2], _AXES, (20.0, 20.0), 0.5)
    square = textured_rectangle(
        _CENTRE.tolist(), _AXES, (_HALF_M, _HALF_M), seed=5, period=0.24, darkest=0.03, shapes=12
    )
    light = {"type": "constant", "radiance": 1.0}
    return {"type": "scene", "integrator": DIRECT, "light": light, "wall": wall, MARKER: square}


class KeepCentred(Task):
    """Wants the marker in the middle of the image.

    The marker swings about its place: each coordinate in the wall's plane is a sum of three sines, whose periods and
    phases are drawn anew for each episode. A step's reward is 1 where the marker is in the middle, and falls evenly to
    0 at the nearest edge of the image. The episode ends where its centre leaves the image. ``info`` has ``offset_px``:
    the marker's centre (x, y) from the image's middle.

    Args:
        reach_m: how far the marker goes to either side at most, metres.
        slowest_s: longest period of the sines; the shortest is half of it.

    Raises:
        ValueError: for a value out of range.
    """

    def __init__(self, *, reach_m: float = 0.8, slowest_s: float = 3.0) -> None:
        check_number("reach_m", reach_m, 0, 5, unit="m")
        check_number("slowest_s", slowest_s, 0, above_low=True, unit="s")
        self._reach_m, self._slowest_s = reach_m, slowest_s

    def start(self, random: np.random.Generator) -> Pose:
        self._rates = 2 * np.pi / (self._slowest_s * random.uniform(0.5, 1.0, (_SWINGS, 2)))
        self._phases = random.uniform(0.0, 2 * np.pi, (_SWINGS, 2))
        return start_looking_at([0.0, 0.0, 1.2], _CENTRE)

    def shift(self, t_s: float) -> FloatArray:
        """Return how far the marker is from its place, (3,) metres; nothing at t = 0, where it is in the middle."""
        swings = np.sin(self._rates * t_s + self._phases) - np.sin(self._phases)
        across, up = self._reach_m * swings.sum(0) / (2 * _SWINGS)
        return np.array([across, 0.0, up])

    def objects(self, t_s: float) -> Mapping[str, PoseLike]:
        return {MARKER: Pose(self.shift(t_s), (0.0, 0.0, 0.0, 1.0))}

    def judge(self, moment: Moment) -> Verdict:
        pose, camera = moment.state.pose, moment.camera
        seen = pose.rotation.T @ (_CENTRE + self.shift(moment.t_s) - pose.position)
        middle = np.array([camera.width - 1, camera.height - 1]) / 2
        offset = camera.project(seen) - middle
        away = float(np.linalg.norm(offset) / (min(camera.width, camera.height) / 2))
        lost = not bool((np.abs(offset) <= middle + 0.5).all())  # NaN behind the camera
        return Verdict(0.0 if lost else max(0.0, 1.0 - away), lost, {"offset_px": offset})


def marker_env(*, body: str | Body = "velocity", size: int = 96, **arguments: Any) -> EventCameraEnv:
    """Make the environment of :class:`KeepCentred` in :func:`marker_scene`.

    It is registered as ``davis_rs/Marker-v0``, and with other bodies as ``davis_rs/MarkerPose-v0``,
    ``davis_rs/MarkerPointMass-v0`` and ``davis_rs/MarkerQuadrotor-v0``.

    >>> env = gymnasium.make("davis_rs/Marker-v0", observe=["events"], duration_s=2.0)

    Args:
        body: a body, or the name of one: ``velocity``, ``pose``, ``point_mass``, ``quadrotor``.
        size: width and height of the image, pixels; the lens sees 53 degrees.
        arguments: of :class:`EventCameraEnv`. By default an episode takes 5 s, the accuracy is ``fast``, and one thread
            renders, so that several processes do not wait for each other.

    Raises:
        TypeError, ValueError: as :class:`EventCameraEnv`, and for another body or size.
    """
    check_number("size", size, 8, 4096, whole=True)
    made = BODIES[body]() if isinstance(body, str) and body in BODIES else body
    chosen: dict[str, Any] = {"duration_s": 5.0, "accuracy": "fast", "threads": 1, "camera": _camera(size)}
    return EventCameraEnv(marker_scene(), made, KeepCentred(), **{**chosen, **arguments})  # type: ignore[arg-type]


def _camera(size: int) -> Camera:
    return Camera(size, size, float(size), float(size), (size - 1) / 2, (size - 1) / 2)
