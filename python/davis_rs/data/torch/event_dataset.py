"""Makes windows of one or more files and folders as a map-style data set."""

from __future__ import annotations

import inspect
import os
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.utils.data import Dataset

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean
from ..windows.event_windows import IMAGE_KINDS, EventWindows
from ..windows.window import EventWindow
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
            sample |= _image_tensors(name, window)
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
        unknown = [name for name in self.images if name not in IMAGE_KINDS]
        if unknown:
            raise ArgumentError("{images} must be of {}: got {}", ", ".join(IMAGE_KINDS), ", ".join(unknown))
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


def _image_tensors(kind_name: str, window: EventWindow) -> Sample:
    """Return what a sample has of one kind of images: tensors of all of them, and their times."""
    kind = IMAGE_KINDS[kind_name]
    images = getattr(window, kind.field)
    read = images[:]
    tensors: Sample = {f"{kind_name}_us": torch.from_numpy(images.t_us.copy())}
    if kind_name == "displacement":
        tensors["occluded"] = _stacked([each.occluded for each in read], window.size, np.bool_)
        read = [each.pixels for each in read]
    # PyTorch can do hardly anything with uint16.
    dtype = np.int32 if kind.dtype == np.uint16 else kind.dtype
    return {kind_name: _stacked(read, window.size, dtype, *kind.channels), **tensors}


def _stacked(
    images: Sequence[np.ndarray], size: tuple[int, int] | None, dtype: npt.DTypeLike, *channels: int
) -> torch.Tensor:
    """Return images as one tensor; directions before rows and columns."""
    width, height = size or (0, 0)
    stack = np.stack(images) if len(images) else np.zeros((0, height, width, *channels), dtype)
    if channels:
        stack = np.moveaxis(stack, -1, 1)
    return torch.from_numpy(np.ascontiguousarray(stack, dtype))
