"""Makes camera paths of a plan: the motions of davis_rs.geometry.trajectory.motions by name, or a file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from inspect import signature
from pathlib import Path

import numpy as np

from .._util.argument_error import ArgumentError
from .._util.array_types import JsonValue
from ..geometry.pose import Pose, hamilton
from ..geometry.trajectory import motions
from ..geometry.trajectory.trajectory import Trajectory, align
from ..geometry.trajectory.trajectory_file import read_trajectory
from ..scene.load import moves_paths, start_pose
from ..scene.scene import Scene
from .kinds import Key, called_with, keys_of

MOTIONS: dict[str, Callable[..., Trajectory]] = {
    "slider": motions.slider,
    "hand_held": motions.hand_held,
    "zigzag": motions.zigzag,
    "spiral": motions.spiral,
    "walking": motions.walking,
    "running": motions.running,
    "file": read_trajectory,
}
"""What ``kind`` may be; its other keys are those of :func:`motion_keys`."""

_RENAMED = {"degrees_of_freedom": "kind", "file": "path"}


@cache
def motion_keys(kind: str) -> Mapping[str, Key]:
    """Return the keys of a motion.

    They are the function's arguments without ``start``, which is where the camera starts. The argument ``kind`` of
    ``hand_held`` has the key ``degrees_of_freedom``, and ``path`` of a file has the key ``file``. A file may have
    ``align``.
    """
    # The sequence's own end is that of a motion for which nothing else is said.
    renamed = {key: name for key, name in _RENAMED.items() if name in signature(MOTIONS[kind]).parameters}
    keys = keys_of(MOTIONS[kind], left_out=("start",), renamed=renamed, optional=("duration_s",))
    return {**keys, "align": Key("align", "bool")} if kind == "file" else keys


def make_motion(
    motion: Mapping[str, JsonValue], scene: Scene, end_s: float | None, base: Path, start: Pose | None = None
) -> Trajectory:
    """Make the path that a drawn motion stands for.

    Args:
        motion: ``kind`` and what belongs to it.
        scene: whose camera's start it starts at.
        end_s: where on the path the sequence ends: the length of motions that have no end of their own.
        base: the folder that a file is relative to.
        start: where the path starts; None for the start of the scene's camera.

    Raises:
        ValueError: for what the motion refuses, or a motion without an end.
        OSError: if a file cannot be read.
    """
    given = dict(motion)
    kind = given.pop("kind")
    called = called_with(motion_keys(kind), given)
    if kind == "file":
        moved = called.pop("align", moves_paths(scene) or start is not None)
        if start is not None and not moved:
            raise ArgumentError("{start_pose} moves the path, and align: false would not")
        trajectory = read_trajectory(base / called.pop("path"), **called)
        return align(trajectory, start or start_pose(scene)) if moved else trajectory
    if "duration_s" in motion_keys(kind) and "duration_s" not in called:
        if end_s is None:
            raise ValueError(
                f"a motion of kind {kind} has no end of its own: duration or motion.duration_s must be given"
            )
        called["duration_s"] = end_s
    return MOTIONS[kind](start or start_pose(scene), **called)


def moved(pose: Pose, offset: Mapping[str, JsonValue]) -> Pose:
    """Move a pose in its own axes: by ``position_m`` (3,), and by the rotation vector ``rotation_deg`` (3,)."""
    turn = np.radians(offset.get("rotation_deg", (0.0, 0.0, 0.0)))
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0 else turn
    quaternion = np.array([*(axis * math.sin(angle / 2)), math.cos(angle / 2)])
    position = pose.position + pose.rotation @ np.array(offset.get("position_m", (0.0, 0.0, 0.0)))
    return Pose(position, hamilton(pose.quaternion, quaternion))
