"""Luma of the pixels that edges pass: when each of their rays jumps, from the geometry, not from a search."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from .neighbours import Neighbours

IntArray = npt.NDArray[np.int64]

INSTANTS = 5
"""Each span of time is seen at its ends, its middle, and half way between these."""

SHORTEST_US = 8
"""Spans that are shorter are not tracked: their microseconds can be rendered one by one."""

Composed = Callable[[LumaFrames, IntArray], LumaFrames]
"""Luma (m,) of m pixels (m,) from the squares (2 reach + 1, 2 reach + 1, m) around them."""


class EdgeTracks(NamedTuple):
    """Luma of the pixels that edges pass in one span of time.

    Attributes:
        pixels: (p,), increasing, all of them, y W + x.
        unknown: (u,), those that do what neither edges nor their rates tell, as at a shadow's edge.
        pixel, t_us, luma: (m,) samples by pixel and time, strictly within the span; log luma is a line between them.
        rendered: how many pixels were rendered, one at several instants counted so often.
    """

    pixels: IntArray
    unknown: IntArray
    pixel: IntArray
    t_us: IntArray
    luma: LumaFrames
    rendered: int


_NO_PIXELS = np.empty(0, np.int64)
NO_TRACKS = EdgeTracks(_NO_PIXELS, _NO_PIXELS, _NO_PIXELS, _NO_PIXELS, np.empty(0, np.float32), 0)
"""Of a span in which no pixel is tracked."""


def instants_of_spans(start_us: IntArray, end_us: IntArray) -> IntArray:
    """Return the whole microseconds (n, 5) at which spans (n,) of at least :data:`SHORTEST_US` are seen."""
    return start_us[:, None] + (end_us - start_us)[:, None] * np.arange(INSTANTS) // (INSTANTS - 1)


def composed_tracks(tracks: EdgeTracks, camera: Camera, reach: int, composed: Composed) -> EdgeTracks:
    """Combine the tracks of neighbouring pixels into those of pixels that are a blur of them, ``reach`` pixels wide."""
    if len(tracks.pixels) == 0:
        return tracks
    if reach == 0:
        return tracks._replace(luma=composed(tracks.luma.reshape(1, 1, -1), tracks.pixel))
    first_us = int(tracks.t_us.min())
    span_us = int(tracks.t_us.max()) - first_us + 1
    keys = tracks.pixel * span_us + (tracks.t_us - first_us)
    ends = np.isin(tracks.t_us, (first_us, first_us + span_us - 1))
    # Each pixel has the instants of all that it takes luma from: each of these gives its own to all around it.
    inner = np.flatnonzero(~ends)
    around = Neighbours(camera, 1, np.zeros(len(inner), np.int64), tracks.pixel[inner], reach)
    near = np.isin(np.arange(camera.width * camera.height), tracks.pixels)
    wanted = around.wanted.reshape(-1, len(inner))
    pairs = np.unique((wanted * span_us + (tracks.t_us[inner] - first_us))[near[wanted]])
    pixel, since_us = np.divmod(pairs, span_us)
    squares = Neighbours(camera, 1, np.zeros(len(pixel), np.int64), pixel, reach).wanted
    # A sample at or after the instant is there, because each track ends with the span.
    asked = squares * span_us + since_us
    after = np.searchsorted(keys, asked)
    before = np.maximum(after - 1, 0)
    fraction = np.where(keys[after] == asked, 1.0, (asked - keys[before]) / np.maximum(keys[after] - keys[before], 1))
    low, high = tracks.luma[before].astype(np.float64), tracks.luma[after]
    luma = composed((low + fraction * (high - low)).astype(np.float32), pixel)
    return tracks._replace(pixel=pixel, t_us=since_us + first_us, luma=luma)
