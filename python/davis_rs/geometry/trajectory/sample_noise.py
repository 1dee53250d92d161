"""Estimates how noisy the samples of a path are, from the samples alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray

FEWEST_SAMPLES = 40
"""With fewer samples noise cannot be told from motion."""

_ORDERS = tuple(range(2, 13))
_FLAT = 0.75
"""If differences fall by this factor over two orders, they come from motion; at a third of the sampling rate
they do."""

_MEDIAN_OF_NORMAL = 0.6744897501960817


def pose_noise(t_s: npt.ArrayLike, positions: npt.ArrayLike, quaternions: npt.ArrayLike) -> tuple[float, float]:
    """Estimate white noise of positions along an axis (m) and of rotations about one (rad); 0 where none is seen.

    Args:
        t_s: (n,), increasing. positions: (n, 3). quaternions: (n, 4), of any sign and of norm 1 but for rounding.
    """
    stamps, p, q = (np.asarray(samples, np.float64) for samples in (t_s, positions, quaternions))
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    q[1:] *= np.cumprod(np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0))[:, None]
    # A small turn by a moves the quaternion by a / 2. It moves in three directions, never along itself.
    return white_noise(stamps, p), 2 * float(np.sqrt(4 / 3)) * white_noise(stamps, q)


def white_noise(t: FloatArray, y: FloatArray) -> float:
    """Estimate the rms of white noise in the columns of samples y (n, m) at increasing times t (n,); 0 if none is seen.

    A divided difference of order d, taken over d + 1 neighbours with weights of unit norm, cancels every polynomial of
    a lower degree than d and keeps the rms of white noise. With rising d the part of smooth motion becomes
    smaller and smaller, and the part of noise stays. So where differences still fall at the highest order, no noise is
    seen. Whether there is noise is judged by medians, because corners of a path leave something in every order,
    but only in a few windows. Its strength is an rms, because a tracker's glitches and its unrest in fast motion shall
    be smoothed away too.

    Source: difference-based estimation of variance, von Neumann, Annals of Mathematical Statistics 12 (1941), for any
    order and spacing.
    """
    if len(t) < FEWEST_SAMPLES:
        return 0.0
    steps, centred = t / float(np.median(np.diff(t))), y - y.mean(0)
    left = [_divided_differences(steps, centred, order) for order in _ORDERS]
    typical = [
        float(np.linalg.norm(np.median(np.abs(differences), axis=0))) / _MEDIAN_OF_NORMAL for differences in left
    ]
    strength = [float(np.sqrt(np.mean(differences**2))) for differences in left]
    rounding = 1e-13 * float(np.abs(centred).max())
    if min(typical) <= rounding or typical[-1] < _FLAT * typical[-3]:
        return 0.0
    return min(strength)


def _divided_differences(t: FloatArray, y: FloatArray, order: int) -> FloatArray:
    """Return a divided difference of every ``order + 1`` neighbours, for each column of y, with weights of unit
    norm."""
    windows = np.lib.stride_tricks.sliding_window_view(t, order + 1)
    weights = np.ones(windows.shape)
    for other in range(order + 1):
        distances = windows - windows[:, other : other + 1]
        distances[:, other] = 1.0
        weights /= distances
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    differences = np.zeros((len(windows), y.shape[1]))
    for k in range(order + 1):
        differences += weights[:, k, None] * y[k : k + len(windows)]
    return differences
