"""Camera paths of a plan: the motions of davis_rs.trajectory.motions by name, or a file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ..scene.scene import Scene
from ..scenes import start_pose
from ..trajectory import motions
from ..trajectory.trajectory import Trajectory, align
from ..trajectory.trajectory_file import read_trajectory

MOTIONS: dict[str, Callable[..., Trajectory]] = {
    "slider": motions.slider,
    "hand_held": motions.hand_held,
    "zigzag": motions.zigzag,
    "spiral": motions.spiral,
    "walking": motions.walking,
    "running": motions.running,
    "file": read_trajectory,
}
"""What ``kind`` may be; other keys of a motion are the function's own arguments, but for those of :func:`arguments`."""

_RENAMED = {"degrees_of_freedom": "kind", "file": "path"}
_DEGREES = {"_deg": "_rad", "_deg_s": "_rad_s"}


@cache
def arguments(kind: str) -> Mapping[str, tuple[str, bool]]:
    """The keys of a motion, for each the type (as the function's annotation) and whether it must be given.

    They are the function's arguments without ``start``, which is where the scene's camera starts. ``kind`` of
    ``hand_held`` is called ``degrees_of_freedom``, ``path`` of a file ``file``; beside each angle in ``_rad`` or
    ``_rad_s`` there is one in ``_deg`` or ``_deg_s``; a file may say ``align``.
    """
    parameters = inspect.signature(MOTIONS[kind]).parameters
    back = {name: key for key, name in _RENAMED.items()}
    found: dict[str, tuple[str, bool]] = {}
    for name, parameter in parameters.items():
        if name == "start":
            continue
        # The sequence's own end is that of a motion for which nothing else is said; a seed is drawn.
        needed = parameter.default is inspect.Parameter.empty and name != "duration_s"
        found[back.get(name, name)] = (str(parameter.annotation), needed)
        for degrees, radians in _DEGREES.items():
            if name.endswith(radians):
                found[name.removesuffix(radians) + degrees] = (str(parameter.annotation), False)
    if kind == "file":
        found["align"] = ("bool", False)
    return found


def in_radians(kind: str, key: str) -> str:
    """The argument that a key sets: of an angle in degrees, that in radians."""
    for degrees, radians in _DEGREES.items():
        name = key.removesuffix(degrees) + radians
        if key.endswith(degrees) and name in arguments(kind):
            return name
    return key


def make_motion(motion: Mapping[str, Any], scene: Scene, end_s: float | None, base: Path) -> Trajectory:
    """The path that a drawn motion stands for.

    Args:
        motion: ``kind`` and what belongs to it.
        scene: whose camera's start it starts at.
        end_s: where on the path the sequence ends: the length of motions that have no end of their own.
        base: the folder that a file is relative to.

    Raises:
        ValueError: for what the motion refuses, or a motion without an end.
        OSError: if a file cannot be read.
    """
    given = dict(motion)
    kind = given.pop("kind")
    called: dict[str, Any] = {}
    for key, value in given.items():
        name = in_radians(kind, key)
        called[_RENAMED.get(name, name)] = value if name == key else math.radians(value)
    if kind == "file":
        # A scene that has a path shares no world with a file's, one without may.
        moved = called.pop("align", scene.trajectory is not None)
        trajectory = read_trajectory(base / called.pop("path"), **called)
        return align(trajectory, start_pose(scene)) if moved else trajectory
    if "duration_s" in arguments(kind) and "duration_s" not in called:
        if end_s is None:
            raise ValueError(
                f"a motion of kind {kind} has no end of its own: duration or motion.duration_s must be given"
            )
        called["duration_s"] = end_s
    return MOTIONS[kind](start_pose(scene), **called)
