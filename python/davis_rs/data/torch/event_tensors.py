"""Makes tensors of the events of a window."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
import torch

from ..._util.array_types import FloatingArray
from ...events.arrays import EventArray
from ...events.represent import count_image, event_spike_tensor, last_event_times, time_surface, voxel_grid
from ..windows.window import EventWindow

Image = FloatingArray
Representation = Callable[..., Image]


def _count(window: EventWindow, size: tuple[int, int]) -> Image:
    return count_image(window.events, size).astype(np.float32)


def _voxel_grid(window: EventWindow, size: tuple[int, int], *, bins: int = 5, endpoint: bool = True) -> Image:
    return voxel_grid(window.events, size, bins, start_us=window.start_us, stop_us=window.end_us, endpoint=endpoint)


def _time_surface(window: EventWindow, size: tuple[int, int], *, tau_us: float = 30_000.0) -> Image:
    return time_surface(window.events, size, tau_us, t_us=window.end_us)


def _est(
    window: EventWindow, size: tuple[int, int], *, bins: int = 9, measurement: Literal["time", "count"] = "time"
) -> Image:
    return event_spike_tensor(
        window.events, size, bins, start_us=window.start_us, stop_us=window.end_us, measurement=measurement
    )


def _last_times(window: EventWindow, size: tuple[int, int], *, count: int = 1) -> Image:
    return last_event_times(window.events, size, count, start_us=window.start_us, stop_us=window.end_us)


GRIDS: Mapping[str, Representation] = {
    "count": _count,
    "est": _est,
    "last_times": _last_times,
    "time_surface": _time_surface,
    "voxel_grid": _voxel_grid,
}
"""Representations of the shape (channels, height, width), by name."""

RAW = "raw"


def raw_tensors(events: EventArray) -> dict[str, torch.Tensor]:
    """Return the fields of events as tensors of shape (n,) without a copy: t int64, x and y int16, p uint8.

    Coordinates above 32,767, which int16 does not hold, are copied to int32.
    """
    tensors = {"t": torch.from_numpy(events["t"])}
    for name in ("x", "y"):
        column = events[name]
        fits = not len(column) or int(column.max()) < 2**15
        tensors[name] = torch.from_numpy(column.view(np.int16) if fits else column.astype(np.int32))
    tensors["p"] = torch.from_numpy(events["p"])
    return tensors
