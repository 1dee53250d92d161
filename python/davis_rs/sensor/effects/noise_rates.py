"""Approximates how often Gaussian noise behind two poles takes a pixel over its levels.

The engine follows noise in time (``rust/src/crossing/effects/noise_path.rs``). Who wants rates, to find the noise that
makes so many events or to forecast them, takes them from here.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

LEAST_RATIO, MOST_RATIO = 2.0**-16, 2.0**6.65
"""Limits of the ratio of the pole that is proportional to light to the other one. The engine has the same."""

_DISTANCES = np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
_RATIO_POWERS = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
_SHARES = np.array(
    [
        (2.401, 0.950, 0.837, 0.851, 0.885, 0.914, 0.945, 0.957),  # 2^0
        (2.218, 0.850, 0.741, 0.775, 0.830, 0.882, 0.907, 0.931),  # 2^-2
        (1.696, 0.612, 0.535, 0.580, 0.656, 0.734, 0.790, 0.849),  # 2^-4
        (1.132, 0.381, 0.330, 0.372, 0.440, 0.520, 0.587, 0.663),  # 2^-6
        (0.667, 0.214, 0.183, 0.213, 0.259, 0.314, 0.358, 0.408),  # 2^-8
        (0.367, 0.114, 0.098, 0.114, 0.138, 0.172, 0.214, 0.267),  # 2^-10
    ]
)
"""Passages over Rice's rate of upward crossings, by the power of two of the ratio of poles and by distance.

``python benches/noise_rates.py`` measures it. It is below 1 because crossings come in clusters, of which a pixel that
resets makes one event, the more so the further the poles lie apart. Which pole is the faster one does not matter.
"""

_LEVELS = np.arange(-2, 3)
"""References that noise takes a pixel to, in thresholds from where it began."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def log_passage_rates(distance: npt.ArrayLike, ratio: npt.ArrayLike) -> FloatArray:
    """Return how often noise that is about zero reaches a distance for the first time: the logarithm of that rate over
    the source follower's corner frequency.

    It is Rice's rate of upward crossings, sqrt(f1 f2) exp(-distance^2 / 2), times a share that was measured.

    Args:
        distance: in standard deviations; below 1/4 it counts as 1/4.
        ratio: of the photoreceptor's pole to the source follower's.
    """
    ratio = np.clip(np.asarray(ratio, np.float64), LEAST_RATIO, MOST_RATIO)
    distance = np.maximum(np.asarray(distance, np.float64), 0.25)
    power, distance = np.broadcast_arrays(np.abs(np.log2(ratio)), distance)
    # Bilinear in the logarithm of the share. Beyond the table's largest distance it stays, else it goes on.
    row = np.clip(np.searchsorted(_RATIO_POWERS, power) - 1, 0, len(_RATIO_POWERS) - 2)
    column = np.clip(np.searchsorted(_DISTANCES, distance) - 1, 0, len(_DISTANCES) - 2)
    up = (power - _RATIO_POWERS[row]) / np.diff(_RATIO_POWERS)[row]
    right = (np.minimum(distance, _DISTANCES[-1]) - _DISTANCES[column]) / np.diff(_DISTANCES)[column]
    logs = np.log(_SHARES)
    low = logs[row, column] * (1 - right) + logs[row, column + 1] * right
    high = logs[row + 1, column] * (1 - right) + logs[row + 1, column + 1] * right
    rice = np.log(ratio) / 2 - distance**2 / 2
    return np.asarray(rice + low * (1 - up) + high * up)


def event_rates_hz(
    on: npt.ArrayLike,
    off: npt.ArrayLike,
    sigma: npt.ArrayLike,
    ratio: npt.ArrayLike,
    follower_hz: float,
    phase: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the events of noise of a pixel that stands still, ON and OFF together, per second.

    A pixel goes from one reference to the next one up or down at the rates of passages to its two levels. References
    are then in balance: where noise rarely reaches the level ahead and soon the one behind, nearly all the time is
    spent at the first. References of thresholds that differ are taken to lie apart by the mean of both.

    Args:
        on, off: thresholds in natural-log units.
        sigma: standard deviation of the noise, likewise.
        ratio: of the photoreceptor's pole to the source follower's.
        follower_hz: corner frequency of the source follower.
        phase: signal less reference, in units of the threshold ahead: 0.5 is half way to the ON level, -0.5 half way to
            the OFF level. None takes the mean over all phases, as in a scene that moves.

    Returns:
        float64, the arguments broadcast.
    """
    on, off, sigma, ratio = (np.asarray(value, np.float64)[..., None, None] for value in (on, off, sigma, ratio))
    if phase is None:
        nodes = (_NODES + 1) / 2
        signal = (nodes * (on + off)[..., 0] - off[..., 0])[..., None]
        weights = _WEIGHTS / 2
    else:
        given = np.asarray(phase, np.float64)[..., None, None]
        signal = np.where(given >= 0, given * on, given * off)
        weights = np.ones(1)
    behind = signal - _LEVELS * (on + off) / 2
    up = log_passage_rates((on - behind) / sigma, ratio)
    down = log_passage_rates((off + behind) / sigma, ratio)
    # How long it stays at each reference: as many steps up as down between any two.
    odds = np.concatenate([np.zeros_like(up[..., :1]), np.cumsum(up[..., :-1] - down[..., 1:], axis=-1)], -1)
    time = np.exp(odds - odds.max(axis=-1, keepdims=True))
    rates = ((np.exp(up) + np.exp(down)) * time).sum(-1) / time.sum(-1)
    return np.asarray(follower_hz * (rates * weights).sum(-1))


_CELLS = 80
"""Cells that the place of a signal between its levels is cut into."""

_QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / 16) for k in range(16)])
"""Of the normal distribution, which stand for a leak's jitter."""


def drifting_rates_hz(
    on: npt.ArrayLike,
    off: npt.ArrayLike,
    sigma: npt.ArrayLike,
    ratio: npt.ArrayLike,
    follower_hz: float,
    leak_hz: float,
    jitter: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return ON and OFF events per second of a pixel whose reference drifts below a signal that stands still.

    A leak brings the signal near to the ON level, noise makes events there, and each moves the reference. If C_off is
    less than C_on, an ON and an OFF event together take the signal away from the level, so that noise makes the more
    pairs the faster it leaks: in the end ON C_on - OFF C_off is what leaks. After an event the leak's jitter moves the
    reference, at times to where noise reaches the OFF level. This is the stationary state of a process that drifts and
    jumps, on a grid.

    Args:
        on, off, sigma, ratio, follower_hz: as of :func:`event_rates_hz`.
        leak_hz: events a second that the leak alone makes, > 0.
        jitter: of the leak, a fraction of the time between its events.

    Returns:
        Two float64, the arguments broadcast.
    """
    on, off, sigma, ratio = (
        value[..., None]
        for value in np.broadcast_arrays(*(np.asarray(value, np.float64) for value in (on, off, sigma, ratio)))
    )
    width, cells = (on + off) / _CELLS, np.arange(_CELLS)
    position = -off + width * (cells + 0.5)
    up = follower_hz * np.exp(log_passage_rates((on - position) / sigma, ratio))
    down = follower_hz * np.exp(log_passage_rates((off + position) / sigma, ratio))
    drift = leak_hz * on / width
    # What leaves a cell, and where it goes: rows are to, columns are from.
    flow = np.zeros((*position.shape, _CELLS))
    flow[..., cells, cells] = -(up + down + drift)
    flow[..., cells[1:], cells[:-1]] = drift
    # What drifts beyond the last cell makes an event.
    up[..., -1] += drift[..., 0]
    quantiles = jitter * _QUANTILES if jitter else np.zeros(1)
    lead = np.arange(flow[..., 0, 0].size)[:, None]
    flat = flow.reshape(-1, _CELLS, _CELLS)
    for jumps, rate in ((on * (quantiles - 1), up), (off, down)):
        for k in range(jumps.shape[-1]):
            target = np.clip((position + jumps[..., k, None] + off) / width - 0.5, 0, _CELLS - 1).reshape(-1, _CELLS)
            below = np.minimum(target.astype(np.int64), _CELLS - 2)
            into = rate.reshape(-1, _CELLS) / jumps.shape[-1]
            flat[lead, below, cells] += into * (1 - (target - below))
            flat[lead, below + 1, cells] += into * (target - below)
    flat[:, 0, :] = 1.0  # the times in all cells add up to 1
    whole = np.zeros((len(flat), _CELLS, 1))
    whole[:, 0] = 1.0
    time = np.linalg.solve(flat, whole).reshape(position.shape)
    return np.asarray((time * up).sum(-1)), np.asarray((time * down).sum(-1))
