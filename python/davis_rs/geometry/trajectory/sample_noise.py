"""How noisy the samples of a path are, from the samples alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray

FEWEST_SAMPLES = 40
"""Fewer samples don't tell noise from motion."""

_ORDERS = tuple(range(2, 13))
_FLAT = 0.75
"""Over two orders; motion at a third of the sampling rate falls so much."""

_MEDIAN_OF_NORMAL = 0.6744897501960817


def pose_noise(t_s: npt.ArrayLike, positions: npt.ArrayLike, quaternions: npt.ArrayLike) -> tuple[float, float]:
    """Return white noise of positions along an axis (m) and of rotations about one (rad); 0 where none is to be seen.

    Args:
        t_s: (n,), increasing. positions: (n, 3). quaternions: (n, 4), of any sign and of norm 1 but for rounding.
    """
    stamps, p, q = (np.asarray(samples, np.float64) for samples in (t_s, positions, quaternions))
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    q[1:] *= np.cumprod(np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0))[:, None]
    # A small turn by a moves the quaternion by a / 2. It moves in three directions, never along itself.
    return white_noise(stamps, p), 2 * float(np.sqrt(4 / 3)) * white_noise(stamps, q)


def white_noise(t: FloatArray, y: FloatArray) -> float:
    """Return the rms of white noise in the columns of samples y (n, m) at increasing times t (n,); 0 if none is to be
    seen.

    A divided difference of order d, taken over d + 1 neighbours with weights of unit norm, cancels every polynomial of
    a lower degree than d and keeps the rms of white noise. Over rising d, what smooth motion leaves of itself becomes
    smaller and smaller, and what noise leaves stays as it is: where it still falls at the highest order, no noise is
    to be seen. Whether there is noise is judged by medians, because corners of a path leave something in every order,
    but only in a few windows. How strong it is, is an rms, because a tracker's glitches and its unrest in fast motion
    are to be smoothed away with the rest.

    Source: difference-based estimation of variance, von Neumann, Annals of Mathematical Statistics 12 (1941), for any
    order and spacing.
    """
    if len(t) < FEWEST_SAMPLES:
        return 0.0
    steps, centred = t / float(np.median(np.diff(t))), y - y.mean(0)
    left = [_divided_differences(steps, centred, order) for order in _ORDERS]
    typical = [float(np.linalg.norm(np.median(np.abs(one), axis=0))) / _MEDIAN_OF_NORMAL for one in left]
    strength = [float(np.sqrt(np.mean(one**2))) for one in left]
    rounding = 1e-13 * float(np.abs(centred).max())
    if min(typical) <= rounding or typical[-1] < _FLAT * typical[-3]:
        return 0.0
    return min(strength)


def _divided_differences(t: FloatArray, y: FloatArray, order: int) -> FloatArray:
    """Return one of every ``order + 1`` neighbours, for each column of y, of weights whose squares add up to 1."""
    windows = np.lib.stride_tricks.sliding_window_view(t, order + 1)
    weights = np.ones(windows.shape)
    for other in range(order + 1):
        distances = windows - windows[:, other : other + 1]
        distances[:, other] = 1.0
        weights /= distances
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    differences = np.zeros((len(windows), y.shape[1]))
    for place in range(order + 1):
        differences += weights[:, place, None] * y[place : place + len(windows)]
    return differences
