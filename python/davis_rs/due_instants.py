"""At which instants of a run a frame, a depth map or the end of a packet falls due."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import groupby, repeat
from typing import NamedTuple

from .sampling.rules import periodic_instants

_PACKET_RATE_HZ = 40.0
"""Where no frame or depth map falls due, packets still end this often, so that memory stays bounded."""


class DueInstant(NamedTuple):
    """An instant at which a packet ends, and what else falls due there."""

    t_us: int
    frame: bool
    depth: bool


def due_instants(
    start_us: int, end_us: int, *, frame_rate_hz: float, depth_rate_hz: float, first: bool
) -> Iterator[DueInstant]:
    """All instants of (start_us, end_us] at which something falls due, in order, each once.

    Args:
        first: the run begins at ``start_us``: that instant belongs to it too.

    Raises:
        ValueError: for a rate out of range.
    """
    first_us = start_us if first else start_us + 1
    streams = [
        zip(periodic_instants(_PACKET_RATE_HZ, first_us, end_us), repeat("packet")),
        zip(periodic_instants(frame_rate_hz, first_us, end_us), repeat("frame")),
        zip(periodic_instants(depth_rate_hz, first_us, end_us), repeat("depth")),
        iter([(first_us, "packet")] if first else ()),
        iter([(end_us, "packet")]),
    ]
    for t_us, group in groupby(heapq.merge(*streams), key=lambda item: item[0]):
        kinds = {kind for _, kind in group}
        yield DueInstant(t_us, "frame" in kinds, "depth" in kinds)
