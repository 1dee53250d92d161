"""Probes a few pixels where nothing is rendered for long, to find causes of change that nobody declared."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .keyframes import Stretch, exact_log_luma

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LONG_US = 5_000
"""Spans longer than this are probed."""

_PIXELS = 64
_MOST_INSTANTS = 64
"""The most instants in one span: enough to find the microsecond of three jumps in a second."""

_FRACTION = 1 / 3
"""At the middle of a span a pixel may be off the line by this fraction of its change, or by half a threshold. A pixel
that jumps is off by half of its change; one that sees a drifting texture seldom is."""

_FEWEST = 2


def probed(stretch: Stretch, start_us: int, end_us: int) -> Iterator[int]:
    """Yield increasing instants within a span that need keyframes, because luma changes unexpectedly.

    In the middle of the span some pixels, spread over the image, must lie on the line between its ends. If
    half of those that change do not, the span is halved there, and each half is probed in turn, down to a microsecond.
    Spans of up to :data:`LONG_US` have none.
    """
    if end_us - start_us <= LONG_US:
        return
    instants: list[int] = []
    spans = np.array([[start_us, end_us]], np.int64)
    while len(spans) and len(instants) < _MOST_INSTANTS:
        spans = spans[_implausible(stretch, spans)]
        middle = spans.sum(1) // 2
        instants += middle.tolist()
        halves = np.concatenate([np.stack([spans[:, 0], middle], 1), np.stack([middle, spans[:, 1]], 1)])
        spans = halves[halves[:, 1] - halves[:, 0] > 1]
    yield from sorted(instants)


def _implausible(stretch: Stretch, spans: IntArray) -> BoolArray:
    """Return whether luma in the middle of each of n spans (n, 2) is off the line between its ends."""
    camera = stretch.renderer.camera
    pixel = _spread(camera.width * camera.height)
    times = np.stack([spans[:, 0], spans.sum(1) // 2, spans[:, 1]], 1).ravel()
    view, pixels = np.repeat(np.arange(len(times)), len(pixel)), np.tile(pixel, len(times))
    luma = stretch.renderer.samples(stretch.views(times), view, pixels)
    before, middle, after = exact_log_luma(luma, stretch.log_eps).reshape(len(spans), 3, -1).swapaxes(0, 1)
    half = stretch.contrast_threshold / 2
    off = np.abs(middle - (before + after) / 2) > np.maximum(half, _FRACTION * np.abs(after - before))
    changed = off | (np.abs(after - before) > half)
    return np.asarray((off.sum(1) >= _FEWEST) & (2 * off.sum(1) >= changed.sum(1)))


def _spread(size: int) -> IntArray:
    """Return some of the pixels 0..size - 1, at even distances that share no factor with the size of usual images."""
    count = min(_PIXELS, size)
    return ((2 * np.arange(count) + 1) * size // (2 * count)).astype(np.int64)
