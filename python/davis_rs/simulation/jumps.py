"""Warns of steps in which the camera moves faster than any camera does."""

from __future__ import annotations

import math
import warnings

import numpy as np

from ..geometry.pose import Pose, turn_deg
from ..geometry.trajectory.views import Views
from ..render.base import Renderer

_JUMP_DEG, _FASTEST_DEG_S = 120.0, 6000.0
"""A jump is a turn by more than the first, at more than the second, or what moves the image as much. Gyroscopes of
cameras measure up to 2,000 degrees a second."""


class JumpWarning(UserWarning):
    """Warns that a step moves the camera farther than it can go in that time, so that it makes very many events."""


def warn_of_jump(renderer: Renderer, start: Pose, end: Pose, start_us: int, end_us: int, stacklevel: int) -> None:
    """Warn where a step is a jump: where it moves the image by too much, and too fast.

    Where the distance to the nearest surface does not rule it out, the median of one depth map decides.

    Args:
        renderer: of the scene as it is at the step's start.
        start, end: poses of the camera, between which it moves evenly.
        start_us, end_us: their times, microseconds.
        stacklevel: 1 for the caller, 2 for its own caller, and so on.

    Warns:
        JumpWarning: with the motion, the limit and the remedy.
    """
    duration_s = (end_us - start_us) * 1e-6
    limit_deg = max(_JUMP_DEG, _FASTEST_DEG_S * duration_s)
    travel = math.dist(start.position.tolist(), end.position.tolist())
    turned_deg = turn_deg(start, end)

    def moved_deg(depth: float) -> float:
        """Return which turn moves the image as much as the step does, of what is at a depth."""
        passed = travel / depth if depth > 0 else math.inf if travel else 0.0
        return turned_deg + math.degrees(passed)

    if moved_deg(renderer.nearest_distance(start.position)) <= limit_deg:
        return
    seen = renderer.depth(Views.at_rest([start], start_us * 1e-6))
    known = seen[np.isfinite(seen)]
    as_turn_deg = moved_deg(float(np.median(known)) if len(known) else math.inf)
    if as_turn_deg > limit_deg:
        warnings.warn(
            f"the step to {end_us} us moves the camera by {travel:.3g} m and turns it by {turned_deg:.3g} degrees in "
            f"{1e3 * duration_s:.3g} ms, which moves the image as a turn by {as_turn_deg:,.0f} degrees does. More than "
            f"{limit_deg:,.0f} is a jump ({_JUMP_DEG:g} degrees, or {_FASTEST_DEG_S:,.0f} a second): all that lies "
            "between makes events. Give poses in between or a later time; restart() begins elsewhere",
            JumpWarning,
            stacklevel=stacklevel + 1,
        )
