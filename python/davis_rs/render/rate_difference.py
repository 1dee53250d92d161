"""Computes rates of luma by differences, for renderers that have no derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..events.luma import LumaFrames
from ..geometry.pose import FloatArray

_STEP_PIXELS = 0.02
"""How far the image moves to either side, where it is fastest: far for float32, and short enough to be straight."""

_LONGEST_STEP_S = 1e-3


def rate_by_differences(
    luma_after: Callable[[FloatArray], LumaFrames], speeds: FloatArray
) -> tuple[LumaFrames, LumaFrames]:
    """Return luma (n, H, W) and its rate per second, from renders at and to either side of each of n instants.

    The rate is the central difference. Where the two one-sided differences disagree, something appeared or vanished in
    one of them; there it is the smaller one. So changes of visibility are left out, as they are from derivatives.

    Args:
        luma_after: takes delays in seconds (n,) and renders each instant that much later, always with the same random
            numbers.
        speeds: (n,) the fastest optical flow of each instant, pixels per second.
    """
    fastest = np.maximum(speeds, _STEP_PIXELS / _LONGEST_STEP_S)
    step_s = _STEP_PIXELS / fastest
    now = luma_after(np.zeros_like(step_s))
    per_step = 1 / step_s[:, None, None]
    before = (now.astype(np.float64) - luma_after(-step_s)) * per_step
    after = (luma_after(step_s).astype(np.float64) - now) * per_step
    smaller = np.where(np.abs(after) < np.abs(before), after, before)
    disagree = np.abs(after - before) > 0.5 * (np.abs(after) + np.abs(before))
    return now, np.where(disagree, smaller, (after + before) / 2).astype(np.float32)
