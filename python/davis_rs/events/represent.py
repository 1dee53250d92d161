"""Makes images of events for networks: counts, time surfaces, last times, voxel grids and spike tensors.

All take events as :func:`~davis_rs.as_events` does and the sensor's ``size`` as (width, height), and never change it.
An event that lies outside of the sensor is a ValueError with its index.

A window that is given is half-open: only events with ``start_us`` <= t < ``stop_us`` count. A limit that is not given
leaves nothing out: without ``start_us`` the window begins at the first event, and without ``stop_us`` it ends at the
last one, which counts. So the usual call, without a window, has all events, with the first plane of a grid at the first
event and the last plane at the last one, as the papers have it.

Events need not be sorted: the first event is the earliest one, wherever it stands.

Counts, voxel grids and spike tensors of a window that is given are sums over its events, so a stream can be taken
packet by packet, and the results added. Time surfaces and last times of packets are joined by their maximum, if each is
made for the same moment and window.

Sources: Gallego et al., "Event-based Vision: A Survey", TPAMI 2022, section 3.1 (what each is good for); each function
names its own.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .._core import count_events, latest_times, spike_tensor
from .._core import voxel_grid as _voxel_grid
from .._util.argument_checks import as_size, check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .arrays import EventArray, as_events


def event_frame(events: EventArray, size: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Return the sum of polarities in each pixel, ON as +1 and OFF as -1: int32, shape (height, width).

    Source: Rebecq et al., "EVO", RA-L 2017, section III-B ("event image").
    """
    off, on = count_image(events, size)
    return on.astype(np.int32) - off.astype(np.int32)


def count_image(events: EventArray, size: tuple[int, int]) -> npt.NDArray[np.uint32]:
    """Return the number of events in each pixel by polarity: uint32, shape (2, height, width), OFF before ON.

    A frame of tonic's ``ToFrame`` has the same layout (in int16, which overflows).

    Source: Maqueda et al., "Event-based Vision meets Deep Learning on Steering Prediction", CVPR 2018, section 3.1.
    """
    return count_events(events, as_size(size))


@names_checked
def time_surface(
    events: EventArray,
    size: tuple[int, int],
    tau_us: float,
    *,
    t_us: int | None = None,
    dtype: npt.DTypeLike = np.float32,
) -> npt.NDArray[Any]:
    """Return how recently each pixel fired, by polarity: exp(-(t - t_last) / tau), 0 where it never did.

    Args:
        tau_us: time constant of the decay in microseconds, > 0.
        t_us: the moment of the surface; events at it count, later ones are left out. The last event's time if not
            given.
        dtype: a floating type; computed in float64.

    Returns:
        shape (2, height, width), OFF before ON, values in 0..1. tonic's ``ToTimesurface`` has the same layout.

    Source: Lagorce et al., "HOTS", TPAMI 2017, section 3.1, equation 3.
    """
    check_number("tau_us", tau_us, 0, above_low=True, unit="us")
    dtype = _floating(dtype)
    events = as_events(events)
    if t_us is None:
        t_us = int(events["t"].max()) if len(events) else 0
    latest = latest_times(events, as_size(size), t_us)
    # The difference of integers first: a Unix time in microseconds has no digits left for an exponential.
    surface = np.exp((latest - t_us) / tau_us)
    surface[latest < 0] = 0
    return surface.astype(dtype, copy=False)


@names_checked
def voxel_grid(
    events: EventArray,
    size: tuple[int, int],
    bins: int,
    *,
    start_us: int | None = None,
    stop_us: int | None = None,
    endpoint: bool = True,
    dtype: npt.DTypeLike = np.float32,
) -> npt.NDArray[Any]:
    """Return polarities spread over ``bins`` planes in time, each event shared linearly by the planes around it.

    The planes are at ``np.linspace(start_us, stop_us, bins, endpoint=endpoint)``. An event at t gives plane k its
    polarity (+1 ON, -1 OFF) times max(0, 1 - \\|t - t_k\\| / step).

    Args:
        bins: number of planes, at least 1.
        start_us, stop_us: only events with start_us <= t < stop_us count. From the first event to the last one, which
            counts, if not given, as in the paper.
        endpoint: whether the last plane is at ``stop_us`` (the paper) or one step before it (tonic's ``ToVoxelGrid``,
            where events after the last plane fade out).
        dtype: a floating type; summed in float64.

    Returns:
        shape (bins, height, width).

    Raises:
        ValueError: for less than 1 bin, a window that ends before it starts, an event outside of the sensor.

    Source: Zhu et al., "Unsupervised Event-based Learning of Optical Flow, Depth, and Egomotion", CVPR 2019, section
    3.1, equations 1 to 3.
    """
    check_number("bins", bins, 1, whole=True)
    dtype = _floating(dtype)
    events = as_events(events)
    window = _window(events, start_us, stop_us)
    return _voxel_grid(events, as_size(size), bins, *window, endpoint).astype(dtype, copy=False)


@names_checked
def event_spike_tensor(
    events: EventArray,
    size: tuple[int, int],
    bins: int,
    *,
    start_us: int | None = None,
    stop_us: int | None = None,
    measurement: Literal["time", "count"] = "time",
    dtype: npt.DTypeLike = np.float32,
) -> npt.NDArray[Any]:
    """Return the event spike tensor (EST) with its trilinear kernel: measurements over planes in time, by polarity.

    The planes of each polarity are at ``np.linspace(start_us, stop_us, bins)``. An event at t gives plane k its
    measurement times max(0, 1 - \\|t - t_k\\| / step). The paper also learns the kernel; this is the one that it starts
    from.

    Args:
        bins: number of planes of each polarity, at least 1.
        start_us, stop_us: only events with start_us <= t < stop_us count. From the first event to the last one, which
            counts, if not given.
        measurement: ``"time"``, the event's position in the window (0 at the start, 1 at the end), which the paper
            found best, or ``"count"``, 1.
        dtype: a floating type; summed in float64.

    Returns:
        shape (2 * bins, height, width), OFF before ON.

    Raises:
        ValueError: for less than 1 bin, a window that ends before it starts, another measurement, an event outside of
            the sensor.

    Source: Gehrig et al., "End-to-End Learning of Representations for Asynchronous Event-Based Data", ICCV 2019,
        section 3.
    """
    check_number("bins", bins, 1, whole=True)
    dtype = _floating(dtype)
    if measurement not in ("time", "count"):
        raise ArgumentError("{measurement} must be time or count, got {!r}", measurement)
    events = as_events(events)
    window = _window(events, start_us, stop_us)
    grid = spike_tensor(events, as_size(size), bins, *window, measurement == "time")
    return grid.astype(dtype, copy=False)


@names_checked
def last_event_times(
    events: EventArray,
    size: tuple[int, int],
    count: int = 1,
    *,
    start_us: int | None = None,
    stop_us: int | None = None,
    dtype: npt.DTypeLike = np.float32,
) -> npt.NDArray[Any]:
    """Return when each pixel last fired, by polarity, as a position in the window: 0 at the start, 1 at the end.

    Args:
        count: how many events of each pixel and polarity, at least 1: the last one, the one before it, and so on.
        start_us, stop_us: only events with start_us <= t < stop_us count. From the first event to the last one, which
            counts, if not given.
        dtype: a floating type; computed in float64.

    Returns:
        shape (2 * count, height, width), OFF before ON, of each the last event first; 0 where there were fewer.

    Raises:
        ValueError: for a count below 1, a window that ends before it starts, an event outside of the sensor.

    Source: Zhu et al., "EV-FlowNet", RSS 2018, section III-A (the last one); Baldwin et al., "Time-Ordered Recent Event
    (TORE) Volumes for Event Cameras", TPAMI 2022 (the last few, there on a logarithmic scale).
    """
    check_number("count", count, 1, whole=True)
    dtype = _floating(dtype)
    events = as_events(events)
    start, stop, include_stop = _window(events, start_us, stop_us)
    if stop < start:
        raise ValueError(f"a window must not end before it starts: got {start}..{stop} us")
    latest = latest_times(events, as_size(size), stop if include_stop else stop - 1, count)
    position = (latest - start) / max(stop - start, 1)
    position[latest < max(start, 0)] = 0
    return position.astype(dtype, copy=False)


def _window(events: EventArray, start_us: int | None, stop_us: int | None) -> tuple[int, int, bool]:
    """Return the start and stop of the window that is given, or that of the events, and whether the stop belongs to it.

    It belongs to the window that ends at the last event, because that one would be left out of it otherwise.
    """
    for name, given in (("start_us", start_us), ("stop_us", stop_us)):
        if given is not None:
            check_number(name, given, whole=True)
    t_us = events["t"] if len(events) else np.zeros(1, np.int64)
    start = int(t_us.min()) if start_us is None else start_us
    return (start, max(start, int(t_us.max())), True) if stop_us is None else (start, stop_us, False)


def _floating(dtype: npt.DTypeLike) -> np.dtype[np.generic]:
    """Return a floating type, and refuse others: integers would cut what is shared between planes or decays."""
    if not np.issubdtype(np.dtype(dtype), np.floating):
        raise ArgumentError("{dtype} must be a floating type, got {!r}", dtype)
    return np.dtype(dtype)
