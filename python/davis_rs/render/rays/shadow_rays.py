"""Defines where shadow rays begin and end: one rule for all renderers that trace their own.

Float32 places a hit only near its surface, so a ray that began right there would hit the surface itself. It begins a
step off it, along the plane's normal, to the light's side:

    step = STEP * (largest |component| of (point - centre) + depth)

with ``centre`` the middle of the box around all that stands still, and ``depth`` the point's z along the camera's
optical axis. Both grow as the scene and the rounding errors do, so a scene in other units has the same shadows: nothing
in the rule is a length. What lies in the last fraction ``END`` of the way to a point light throws no shadow, so that a
light may touch its socket. The sun's rays never end, and rays of the camera begin at the camera itself: there is no
near plane.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

STEP = 1000 * 2.0**-24
"""A thousand float32 roundings: enough for a plane, a point on it and Mitsuba's own intersection with it."""

END = 1e-3


def scene_centre(corners: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the middle of the box around points (n, 3); the origin where there are none."""
    are_finite = np.isfinite(corners).all(-1)
    finite = corners if are_finite.all() else corners[are_finite]
    return (finite.min(0) + finite.max(0)) / 2 if len(finite) else np.zeros(3)
