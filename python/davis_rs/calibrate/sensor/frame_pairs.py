"""Pairs a pixel's samples: how much log intensity changed between two frames, and which events came in between."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .signal_samples import SignalSamples

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GROUPS = 32
"""Tiles of pixels are divided into this many groups. Errors come from leaving out one group at a time."""

_TILE = 8
_ENOUGH_STRAIGHT = 3000


class FramePairs:
    """Two samples of one pixel that follow each other; columns of both have the shape (2, n).

    Samples whose value is the lowest or the highest of all frames are left out, because they may be clipped. Where
    there are enough of them, only samples are taken around which the signal does not turn: the others err by some
    per cent.

    Args:
        found: samples, by pixel and time.
        width: of the sensor in pixels.
        left_out: bool (H, W): pixels that are not used.

    Attributes:
        value: float64 (2, n): of the frames.
        rate: float64 (2, n): events a second at both, negative for OFF.
        t_s: float64 (2, n).
        on, off: float64 (n,): events in between, with fractions.
        pixel: int64 (m,): the pixels that have pairs.
        own: int64 (n,): which of them a pair belongs to.
        odd, group: int64 (m,): whether a pixel's column is odd, and its group of tiles.
        half: int64 (n,): 0 or 1, the first or second half of the pixel's pairs; -1 for one that shares frames with
        both.
    """

    def __init__(self, found: SignalSamples, width: int, left_out: npt.NDArray[np.bool_] | None = None) -> None:
        samples = found.samples
        usable = (samples["value"] > found.lowest) & (samples["value"] < found.highest)
        if left_out is not None:
            usable &= ~left_out.ravel()[samples["pixel"]]
        samples = samples[usable]
        straight = samples[samples["turns"] == 0]
        self.straight = np.count_nonzero(straight["pixel"][1:] == straight["pixel"][:-1]) >= _ENOUGH_STRAIGHT
        self.straight_share = len(straight) / max(len(samples), 1)
        if self.straight:
            samples = straight
        first = np.flatnonzero(samples["pixel"][1:] == samples["pixel"][:-1])
        both = samples[np.stack([first, first + 1])]
        self.value = both["value"].astype(np.float64)
        self.rate = both["rate"].astype(np.float64)
        self.t_s = both["t_s"]
        self.on, self.off = np.diff(both["on"], axis=0)[0], np.diff(both["off"], axis=0)[0]
        self.pixel, self.own = np.unique(both["pixel"][0].astype(np.int64), return_inverse=True)
        y, x = self.pixel // width, self.pixel % width
        self.odd = x & 1
        _, tile = np.unique((y // _TILE) * (width // _TILE + 1) + x // _TILE, return_inverse=True)
        self.group = tile % GROUPS
        self._place, self._shape = (y, x), (int(y.max(initial=0)) + 1, int(x.max(initial=0)) + 1)
        count = np.bincount(self.own, minlength=len(self.pixel))
        rank = np.arange(len(self.own)) - (np.cumsum(count) - count)[self.own]
        middle = count[self.own] // 2
        self.half = np.where(rank == middle, -1, (rank > middle).astype(np.int64))

    def __len__(self) -> int:
        return len(self.own)

    def sum(self, values: FloatArray) -> FloatArray:
        """Return the sum of each pixel's values."""
        return np.asarray(np.bincount(self.own, values, len(self.pixel)), np.float64)

    def around(self, values: FloatArray) -> FloatArray:
        """Return the mean of values (k, m) over the 5 x 5 pixels around each, without itself; 0 where there is none."""
        from scipy.ndimage import uniform_filter

        y, x = self._place
        image = np.zeros((len(values), *self._shape))
        image[:, y, x] = values
        mean = uniform_filter(image, (0, 5, 5), mode="nearest")[:, y, x]
        return np.asarray((25 * mean - values) / 24)
