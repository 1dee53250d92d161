"""Assembles frames of AEDAT 2.0: samples of single pixels, each pixel read twice, put together to images."""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...events.decoded import Frame

_RESET, _SIGNAL = 0, 1
_WHITE, _LEAST_RESET, _PIXEL_SHIFT = 1023, 384, 6


class Samples(NamedTuple):
    """Holds columns of samples in the order of the file: time, pixel, which read (0 reset, 1 signal), value."""

    t: npt.NDArray[np.int64]
    x: npt.NDArray[np.int64]
    y: npt.NDArray[np.int64]
    read: npt.NDArray[np.uint32]
    value: npt.NDArray[np.uint32]

    def where(self, mask: npt.NDArray[np.bool_]) -> Samples:
        """Return the samples of a mask."""
        return Samples(self.t[mask], self.x[mask], self.y[mask], self.read[mask], self.value[mask])


def assemble(samples: Samples, width: int, height: int, *, samples_count_double: bool, notes: list[str]) -> list[Frame]:
    """Return the frames that were read whole, but for at most half of their samples, which are then 0.

    The file has no mark where a frame begins. A read goes through the image in one direction, so where it steps back,
    it has begun anew. A camera keeps the region of its frames for a recording: it is where most samples are.
    """
    usable = samples.where(
        (samples.read <= _SIGNAL) & (samples.x >= 0) & (samples.x < width) & (samples.y >= 0) & (samples.y < height)
    )
    if unusable := len(samples.t) - len(usable.t):
        notes.append(f"{unusable} samples of frames outside of the image or of an unknown read left out")
    if not len(usable.t):
        return []
    (left, right), (top, bottom) = _extent(usable.x), _extent(usable.y)
    shape = (bottom - top + 1, right - left + 1)
    inside = (usable.x >= left) & (usable.x <= right) & (usable.y >= top) & (usable.y <= bottom)
    left_out = len(usable.t)
    usable = usable.where(inside)
    usable = usable._replace(x=usable.x - left, y=usable.y - top)

    resets, signals = (_passes(usable, read, at_least=shape[0] * shape[1] / 2) for read in (_RESET, _SIGNAL))
    frames: list[Frame] = []
    missing = 0
    ends = [*(int(reset[0]) for reset in resets), len(usable.t)][1:]
    begins = [int(signal[0]) for signal in signals]
    for reset, end in zip(resets, ends, strict=True):
        # The first signal read that began after this reset read, and before the next.
        k = bisect_right(begins, int(reset[0]))
        if k < len(begins) and begins[k] < end:
            frame, lacking = _frame(usable, reset, signals[k], shape, samples_count_double=samples_count_double)
            frames.append(frame._replace(x=left, y=top))
            left_out -= len(reset) + len(signals[k])
            missing += lacking
    if left_out:
        notes.append(f"{left_out} samples left out, of frames of which a read is less than half there")
    if missing:
        notes.append(f"{missing} pixels of frames are 0 because a sample of theirs is missing")
    return frames


def _extent(coordinates: npt.NDArray[np.int64]) -> tuple[int, int]:
    """Return the first and the last column or row that holds more than single wrong samples."""
    counts = np.bincount(coordinates)
    held = np.flatnonzero(8 * counts >= counts.max())
    return int(held[0]), int(held[-1])


def _passes(samples: Samples, read: int, *, at_least: float) -> list[npt.NDArray[np.intp]]:
    """Return the samples of one read, split into passes over the image of at least ``at_least`` samples each."""
    indices = np.flatnonzero(samples.read == read)
    x, y = samples.x[indices], samples.y[indices]
    # Column by column or, where the wire's are swapped, row by row, and in either direction.
    slow, fast = (x, y) if np.count_nonzero(np.diff(x)) <= np.count_nonzero(np.diff(y)) else (y, x)
    slow_steps, fast_steps = np.diff(slow), np.diff(fast)
    within = fast_steps[slow_steps == 0]
    order = _way(slow_steps[slow_steps != 0]) * slow_steps * (1 << 16) + _way(within) * fast_steps
    bounds = np.concatenate([[0], np.flatnonzero(order <= 0) + 1, [len(indices)]])
    long = np.flatnonzero(np.diff(bounds) >= max(at_least, 1))
    return [indices[bounds[k] : bounds[k + 1]] for k in long]


def _way(steps: npt.NDArray[np.int64]) -> int:
    """Return whether most steps go up (1) or down (-1)."""
    return 1 if 2 * np.count_nonzero(steps > 0) >= len(steps) else -1


def _frame(
    samples: Samples,
    reset: npt.NDArray[np.int64],
    signal: npt.NDArray[np.int64],
    shape: tuple[int, int],
    *,
    samples_count_double: bool,
) -> tuple[Frame, int]:
    """Return the image of two reads, and how many of its pixels lack one. Values become intensities as the decoder's
    do."""
    reads = np.zeros((2, *shape), np.int64)
    there = np.zeros((2, *shape), np.bool_)
    for read, chosen in enumerate((reset, signal)):
        reads[read, samples.y[chosen], samples.x[chosen]] = samples.value[chosen]
        there[read, samples.y[chosen], samples.x[chosen]] = True
    if samples_count_double:
        reads *= 2
    value = np.clip(reads[_RESET] - reads[_SIGNAL], 0, _WHITE)
    value[(reads[_RESET] < _LEAST_RESET) | (reads[_SIGNAL] == 0)] = _WHITE
    both = there.all(axis=0)
    value[~both] = 0
    # A global shutter resets all pixels before it reads any signal.
    at_once = bool(reset[-1] < signal[0])
    exposed = reset[-1] if at_once else reset[0]
    t, t_exposed, t_covered, t_end = (int(samples.t[place]) for place in (reset[0], exposed, signal[0], signal[-1]))
    frame = Frame(
        t, t_exposed, t_covered, t_end, 0, 0, (value << _PIXEL_SHIFT).astype(np.uint16),
        global_shutter=at_once, exposure_us=float(t_covered - t_exposed),
    )  # fmt: skip
    return frame, int(np.count_nonzero(~both))
