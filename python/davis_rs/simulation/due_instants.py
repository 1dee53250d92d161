"""Finds the instants of a run at which a frame, a map of the ground truth or the end of a packet falls due."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping
from itertools import groupby, repeat
from typing import NamedTuple

from ..sampling.rules import periodic_instants

_PACKET_RATE_HZ = 40.0
"""Where nothing else falls due, packets still end this often, so that memory stays bounded."""


class DueInstant(NamedTuple):
    """Says at which instant a packet ends, and what else falls due there: names of the rates."""

    t_us: int
    due: frozenset[str]


def due_instants(start_us: int, end_us: int, rates_hz: Mapping[str, float], *, first: bool) -> Iterator[DueInstant]:
    """Yield all instants of (start_us, end_us] at which something falls due, in order, each once.

    Args:
        rates_hz: how often what is named falls due; 0 for never.
        first: the run begins at ``start_us``: that instant belongs to it too.

    Raises:
        ValueError: for a rate out of range.
    """
    first_us = start_us if first else start_us + 1
    streams = [
        zip(periodic_instants(_PACKET_RATE_HZ, first_us, end_us), repeat("")),
        *(
            zip(periodic_instants(rate_hz, first_us, end_us), repeat(name))
            for name, rate_hz in rates_hz.items()
            if rate_hz
        ),
        iter([(first_us, "")] if first else ()),
        iter([(end_us, "")]),
    ]
    for t_us, group in groupby(heapq.merge(*streams), key=lambda item: item[0]):
        yield DueInstant(t_us, frozenset(name for _, name in group if name))
