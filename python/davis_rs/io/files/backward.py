"""Tells of times that go back in a decoded stream, and what to do about them before it is written."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..._util.argument_error import ArgumentError
from ...events.arrays import EventArray

Policy = Literal["refuse", "drop", "split"]
POLICIES: tuple[Policy, ...] = ("refuse", "drop", "split")


class TimeOrder:
    """Makes runs of events whose times never go back out of packets in the order of the wire.

    A camera's times go back at a timestamp reset, and where its stream was damaged.

    Args:
        policy: "refuse" is an error, "drop" leaves out what is older than an event before it, "split" begins a new run.

    Attributes:
        dropped: events that were left out.
        splits: runs that were begun after the first.

    Raises:
        ValueError: for another policy.
    """

    def __init__(self, policy: Policy = "refuse") -> None:
        if policy not in POLICIES:
            raise ArgumentError("{backward} must be one of {}; got {!r}", ", ".join(POLICIES), policy)
        self._policy = policy
        self._last_us: int | None = None
        self._seen = 0
        self.dropped = 0
        self.splits = 0

    def push(self, events: EventArray) -> list[EventArray]:
        """Return the packet as one or more runs; the first continues the last run of the packet before.

        It may be empty, where a new run begins with the packet.

        Raises:
            ValueError: with policy "refuse", for the first time that goes back, with the index in the stream.
        """
        if not len(events):
            return [events]
        times = events["t"]
        before = np.empty_like(times)
        before[0] = times[0] if self._last_us is None else self._last_us
        before[1:] = times[:-1]
        back = np.flatnonzero(times < before)
        if back.size and self._policy == "refuse":
            at = int(back[0])
            raise ValueError(
                f"times may not go back: event {self._seen + at} is at {times[at]} us, "
                f"the one before it at {before[at]} us"
            )
        self._seen += len(events)
        if self._policy == "drop" and back.size:
            latest = np.maximum.accumulate(np.maximum(times, before[0]))
            events = events[times >= latest]
            self.dropped += len(times) - len(events)
            self._last_us = int(latest[-1])
            return [events]
        self._last_us = int(times[-1])
        self.splits += back.size
        return np.split(events, back)
