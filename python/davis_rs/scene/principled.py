"""Says how rough the microfacets of Mitsuba's ``principled`` are, for those who write such materials and who read them.

Source: Burley, Physically Based Shading at Disney, 2012, section 5.4; plug-in ``principled`` of Mitsuba 3.
"""

from __future__ import annotations

import numpy as np

LEAST_ALPHA = 1e-3
"""It is never smoother."""
COAT_ALPHAS = (0.1, 0.001)
"""Roughness of the microfacets of its coat without any gloss, and with all of it."""
_STRETCH = 0.9
"""Of whole anisotropy, the square of the ratio of both roughnesses is 1 less this."""
MOST_ANISOTROPIC = 1 / _STRETCH
"""From here on it has no roughness."""


def alphas_of(roughness: float, anisotropic: float) -> tuple[float, float]:
    """Return the roughness of its microfacets along u and across it."""
    aspect = float(np.sqrt(1 - _STRETCH * anisotropic))
    return max(roughness**2 / aspect, LEAST_ALPHA), max(roughness**2 * aspect, LEAST_ALPHA)


def parameters_of(along: float, across: float) -> tuple[float, float]:
    """Return ``roughness`` and ``anisotropic`` of microfacets that are this rough along u and across it."""
    return (along * across) ** 0.25, (1 - across / along) / _STRETCH
