"""Makes windows of one or more files and folders as a map-style data set."""

from __future__ import annotations

import inspect
import os
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean
from ..windows.event_windows import EventWindows
from ..windows.window import EventWindow, WindowImages
from .event_tensors import GRIDS, RAW, raw_tensors

Source = str | os.PathLike[str] | EventWindows
Sample = dict[str, Any]


class EventDataset(Dataset):  # type: ignore[misc]
    """Windows of event files and dataset folders as samples for training.

    A sample is a dict:

    - ``"events"``: the representation, float32 (channels, height, width); of ``"raw"`` a dict of the tensors t (int64,
      microseconds), x, y (int16) and p (uint8), which share the window's memory;
    - ``"start_us"``, ``"end_us"``, ``"source"``: the window's ends, and the number of the file or folder it is from;
    - of ``images``: ``"frames"`` uint8 (n, H, W), ``"depth"`` float32 (n, H, W) in metres, ``"flow"`` float32
      (n, 2, H, W) in pixels per second, ``"displacement"`` float32 (n, 2, H, W) in pixels with ``"occluded"`` bool
      (n, H, W), ``"masks"`` int32 (n, H, W), and of each the times, ``"frames_us"`` and so on, int64 (n,).

    It is pickled small and opens its files again, so ``DataLoader`` takes it with any ``num_workers`` and start method;
    :func:`davis_rs.data.torch.collate` makes batches of samples.

    Args:
        sources: a file, a folder or :class:`davis_rs.EventWindows`, or a sequence of them.
        representation: ``"voxel_grid"`` (``bins=5, endpoint=True``), ``"count"``, ``"time_surface"``
            (``tau_us=30000``), ``"est"`` (``bins=9, measurement="time"``), ``"last_times"`` (``count=1``), each over
            the window's own time; ``"raw"``; or a function of an :class:`davis_rs.EventWindow` that returns an array or
            a tensor, for example of tonic's transforms.
        parameters: those of the representation.
        images: which images a sample has; not all of them need to be in every folder.
        complete: leave out windows without one of each of these images, such as those between two frames.
        transform: a function of the sample that returns another one, called last.
        options: those of :class:`davis_rs.EventWindows` (``by``, ``duration_us``, ...), for sources that are paths.

    Raises:
        ValueError: for an unknown representation or parameter, images that there are not, a grid of a source whose
            sensor's size is not known, or no source.
        OSError, DecodeError: if a file cannot be read.
    """

    def __init__(
        self,
        sources: Source | Sequence[Source],
        *,
        representation: str | Callable[[EventWindow], Any] = "voxel_grid",
        parameters: Mapping[str, object] | None = None,
        images: Sequence[str] = (),
        complete: bool = False,
        transform: Callable[[Sample], Any] | None = None,
        **options: Any,
    ) -> None:
        several = [sources] if isinstance(sources, str | os.PathLike | EventWindows) else list(sources)
        if not several:
            raise ValueError("a data set needs at least one file or folder")
        if options and all(isinstance(source, EventWindows) for source in several):
            raise ValueError(f"the sources are windows already: {', '.join(options)} would have no effect")
        self.windows = [
            source if isinstance(source, EventWindows) else EventWindows(source, **options) for source in several
        ]
        self.representation, self.parameters = representation, dict(parameters or {})
        self.images, self.transform = tuple(images), transform
        self._check()
        if complete:
            if not self.images:
                raise ArgumentError("{complete:True} leaves out windows without {images}: name some")
            self.windows = [windows.with_images(*self.images) for windows in self.windows]
        self._ends = list(accumulate(map(len, self.windows)))

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> Any:
        number = range(len(self))[index]
        source = bisect_right(self._ends, number)
        window = self.windows[source][number - self._ends[source] + len(self.windows[source])]
        sample: Sample = {
            "events": self._represent(window),
            "start_us": window.start_us,
            "end_us": window.end_us,
            "source": source,
        }
        for name in self.images:
            sample |= _IMAGES[name](window)
        return sample if self.transform is None else self.transform(sample)

    def __repr__(self) -> str:
        return f"<EventDataset of {len(self.windows)} sources, {len(self):,} windows, {self.representation}>"

    def _represent(self, window: EventWindow) -> Any:
        if callable(self.representation):
            made = self.representation(window)
            return torch.from_numpy(made) if isinstance(made, np.ndarray) else made
        if self.representation == RAW:
            return raw_tensors(window.events)
        return torch.from_numpy(GRIDS[self.representation](window, window.size, **self.parameters))

    def _check(self) -> None:
        """Refuse what would fail, or be ignored, at the first sample."""
        unknown = [name for name in self.images if name not in _IMAGES]
        if unknown:
            raise ArgumentError("{images} must be of {}: got {}", ", ".join(_IMAGES), ", ".join(unknown))
        known: set[str] = set()
        if isinstance(self.representation, str):
            if self.representation not in (*GRIDS, RAW):
                names = ", ".join((*GRIDS, RAW))
                raise ArgumentError(
                    "{representation} must be one of {}, or a function: got {!r}", names, self.representation
                )
            if self.representation != RAW:
                known = {*list(inspect.signature(GRIDS[self.representation]).parameters)[2:]}
                for windows in self.windows:
                    if windows.size is None:
                        raise ArgumentError("{} does not say the sensor's size: give {size}", windows.path)
        strange = [name for name in self.parameters if name not in known]
        if strange:
            said = f"{self.representation} takes no parameter {', '.join(strange)}"
            raise ValueError(said + did_you_mean(strange[0], sorted(known)))


def _stacked(name: str, images: WindowImages[Any], size: tuple[int, int] | None, dtype: Any, *last: int) -> Sample:
    """Return images as one tensor, and their times; colours or directions before rows and columns."""
    width, height = size or (0, 0)
    stack = np.stack(images[:]) if len(images) else np.zeros((0, height, width, *last), dtype)
    if last:
        stack = np.moveaxis(stack, -1, 1)
    stack = np.ascontiguousarray(stack, dtype)
    return {name: torch.from_numpy(stack), f"{name}_us": torch.from_numpy(images.t_us.copy())}


def _displacement(window: EventWindow) -> Sample:
    maps = window.displacements
    read = maps[:]
    vectors = WindowImages(maps.t_us, 0, lambda k: read[k].pixels)
    hidden = WindowImages(maps.t_us, 0, lambda k: read[k].occluded)
    sample = _stacked("displacement", vectors, window.size, np.float32, 2)
    return sample | {"occluded": _stacked("occluded", hidden, window.size, np.bool_)["occluded"]}


_IMAGES: Mapping[str, Callable[[EventWindow], Sample]] = {
    "frames": lambda window: _stacked("frames", window.frames, window.size, np.uint8),
    "depth": lambda window: _stacked("depth", window.depth_maps, window.size, np.float32),
    "flow": lambda window: _stacked("flow", window.flow_maps, window.size, np.float32, 2),
    "displacement": _displacement,
    "masks": lambda window: _stacked("masks", window.masks, window.size, np.int32),
}
"""What a sample has of each kind of images."""
