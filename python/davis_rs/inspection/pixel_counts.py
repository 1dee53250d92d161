"""Counts events in each pixel, in memory that the events need rather than the sensor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._core import count_events
from ..events.arrays import EventArray

_DENSE = 1 << 22
"""Pixels that are counted in an image, 32 MB; of more, those that have events."""


class PixelCounts:
    """Counts of events by pixel.

    Args:
        size: (width, height) of the sensor; None where the events tell.
    """

    def __init__(self, size: tuple[int, int] | None) -> None:
        self._known = size is not None
        self.size = size or (0, 0)
        """(width, height) of the sensor, or what the events so far span."""
        self._image: npt.NDArray[np.uint64] | None = np.zeros((0, 0), np.uint64)
        self._keys = np.zeros(0, np.int64)
        self._counts = np.zeros(0, np.uint64)
        if self._known:
            self._grow(*self.size)

    def add(self, events: EventArray) -> None:
        """Count a packet of at least one event.

        Raises:
            ValueError: for an event outside of a size that was given.
        """
        width, height = self.size
        if not self._known:
            width, height = max(width, int(events["x"].max()) + 1), max(height, int(events["y"].max()) + 1)
            self._grow(width, height)
        if self._image is not None:
            self._image += count_events(events, (width, height)).sum(axis=0, dtype=np.uint64)
            return
        if (events["x"] >= width).any() or (events["y"] >= height).any():
            raise ValueError(f"events must lie within the sensor's {width} x {height} pixels")
        self._merge(events["y"].astype(np.int64) << 16 | events["x"], np.ones(len(events), np.uint64))

    @property
    def with_events(self) -> int:
        """Pixels that have any."""
        return int(np.count_nonzero(self._counts if self._image is None else self._image))

    @property
    def busiest(self) -> tuple[int, int, int]:
        """The pixel with most events (the first of them, row by row): x, y, and how many."""
        if self._image is None:
            at = int(self._counts.argmax())
            return int(self._keys[at] & 0xFFFF), int(self._keys[at] >> 16), int(self._counts[at])
        y, x = np.unravel_index(int(self._image.argmax()), self._image.shape)
        return int(x), int(y), int(self._image[y, x])

    def image(self) -> npt.NDArray[np.uint64]:
        """Return all of them, uint64 (height, width).

        Raises:
            ValueError: for a sensor of more pixels than an image of them should have.
        """
        if self._image is None:
            width, height = self.size
            raise ValueError(f"an image of {width} x {height} pixels would be too large: the limit is {_DENSE} pixels")
        return self._image

    def _grow(self, width: int, height: int) -> None:
        if self._image is not None and width * height > _DENSE:
            y, x = np.nonzero(self._image)
            before, self._image = self._image, None
            self._merge(y.astype(np.int64) << 16 | x, before[y, x])
        elif self._image is not None and (height, width) != self._image.shape:
            grown = np.zeros((height, width), np.uint64)
            grown[: self._image.shape[0], : self._image.shape[1]] = self._image
            self._image = grown
        self.size = (width, height)

    def _merge(self, keys: npt.NDArray[np.int64], counts: npt.NDArray[np.uint64]) -> None:
        self._keys, position = np.unique(np.concatenate([self._keys, keys]), return_inverse=True)
        together = np.concatenate([self._counts, counts])
        self._counts = np.zeros(len(self._keys), np.uint64)
        np.add.at(self._counts, position, together)
