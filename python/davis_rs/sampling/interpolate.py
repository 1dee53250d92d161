"""Interpolates log luma between keyframes as the crossing engine does, to measure its error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from .._core import log_intensity
from ..geometry.pose import FloatArray
from .keyframes import Keyframe

_STEEPEST = 3.0
"""Slopes are limited to this many times the chord's slope (Fritsch and Carlson, SIAM J. Numer. Anal. 1980)."""


def interpolated(
    keyframes: Iterable[Keyframe], instants_us: npt.ArrayLike, log_eps: float
) -> Iterator[tuple[Keyframe, list[FloatArray]]]:
    """Yield each keyframe, with the log luma (H, W), float64, at the instants since the one before it.

    It is linear, or cubic where keyframes have rates; between the sparse samples of a pixel it is linear.
    docs/crossing.md describes it.

    Args:
        instants_us: increasing.
    """
    instants = np.asarray(instants_us, np.int64)
    last: Keyframe | None = None
    for new in keyframes:
        if last is None:
            yield new, [log_intensity(new.luma, log_eps)] * int(np.isin(new.t_us, instants))
        else:
            within = instants[(instants > last.t_us) & (instants <= new.t_us)].tolist()
            yield new, [_between(last, new, t_us, log_eps) for t_us in within]
        last = new


def _between(last: Keyframe, new: Keyframe, t_us: int, log_eps: float) -> FloatArray:
    start, stop = (log_intensity(keyframe.luma, log_eps) for keyframe in (last, new))
    interval_us = new.t_us - last.t_us
    fraction = (t_us - last.t_us) / interval_us
    chord = stop - start
    log = start + fraction * chord
    if last.rate is not None and new.rate is not None:
        p, q = end_slopes(last.rate, new.rate, start, stop, interval_us)
        log += fraction * (1 - fraction) * ((p - chord) * (1 - fraction) - (q - chord) * fraction)
    if new.sparse is not None and len(new.sparse.pixel):
        _take_sparse(log.reshape(-1), start.reshape(-1), stop.reshape(-1), last, new, t_us, log_eps)
    return log


def end_slopes(
    rate_before: npt.NDArray[np.float32],
    rate_after: npt.NDArray[np.float32],
    start: FloatArray,
    stop: FloatArray,
    interval_us: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the slopes of the engine's cubics at both ends of an interval, over its length.

    They make no extremum that the samples do not support.

    Args:
        rate_before, rate_after: dY/dt, luma per second.
        start, stop: log luma.
    """
    chord = stop - start
    p, q = (rate * (interval_us * 1e-6 / np.exp(log)) for rate, log in ((rate_before, start), (rate_after, stop)))
    one_way = p * q >= 0
    agree = (chord != 0) & (p * chord >= 0) & (q * chord >= 0)
    most = _STEEPEST * np.abs(chord)
    usable = np.isfinite(p) & np.isfinite(q) & (agree | ~one_way)
    cut = [np.where(one_way, np.clip(slope, -most, most), slope) for slope in (p, q)]
    return np.where(usable, cut[0], chord), np.where(usable, cut[1], chord)


def _take_sparse(
    log: FloatArray, start: FloatArray, stop: FloatArray, last: Keyframe, new: Keyframe, t_us: int, log_eps: float
) -> None:
    """Replace ``log`` at pixels with sparse samples by the lines between these samples."""
    assert new.sparse is not None
    pixels = np.unique(new.sparse.pixel).astype(np.int64)
    values = np.log(new.sparse.luma.astype(np.float64) + log_eps)
    at_or_before, past = new.sparse.neighbours(pixels, np.full(len(pixels), t_us), after="past")
    ends = []
    for (sample, own), frame, frame_us in ((at_or_before, start, last.t_us), (past, stop, new.t_us)):
        ends.append((np.where(own, new.sparse.t_us[sample], frame_us), np.where(own, values[sample], frame[pixels])))
    (before_us, before), (after_us, later) = ends
    log[pixels] = before + (t_us - before_us) / (after_us - before_us) * (later - before)
