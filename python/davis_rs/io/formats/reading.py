"""Checks the rules that events of every file keep, and does what is asked for where they do not."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, check_events
from ..._util.argument_error import ArgumentError
from ..._util.untrusted import MAX_PACKET_BYTES, check_max_packet_bytes
from ...events.arrays import EVENT_DTYPE, EventArray

Breach = Literal["refuse", "drop", "keep"]
"""What is done with events that break a rule: an error, they are left out, or they are handed out as they are."""

ANY_SIZE = (65_536, 65_536)
"""What coordinates of 16 bits span."""

_LATEST_US = 2**63 - 1


def possible_size(width: int, height: int) -> tuple[int, int] | None:
    """Return a size that a file states; None where no sensor has it, so that the file is taken to state none."""
    return (width, height) if 0 < width <= ANY_SIZE[0] and 0 < height <= ANY_SIZE[1] else None


@dataclass(frozen=True)
class ReadRules:
    """Says how a file is read.

    Attributes:
        backward: what is done with events that are earlier than one before them.
        outside: what is done with events outside of the sensor's size that the file itself states, or of what its
            format can hold.
        max_packet_bytes: what a packet, chunk, page or message of a compressed file may unpack to.

    Raises:
        ValueError: for another policy, or a limit below 1.
    """

    backward: Breach = "refuse"
    outside: Breach = "refuse"
    max_packet_bytes: int = MAX_PACKET_BYTES

    def __post_init__(self) -> None:
        for name in ("backward", "outside"):
            if getattr(self, name) not in get_args(Breach):
                known = ", ".join(get_args(Breach))
                raise ArgumentError("{argument} must be one of {}: got {!r}", known, getattr(self, name), argument=name)
        check_max_packet_bytes(self.max_packet_bytes)

    @property
    def in_order(self) -> bool:
        """Return whether the file's times never decrease."""
        return self.backward == "refuse"


class EventCheck:
    """Checks packet after packet of one file.

    A time below 0 and a polarity above 1 are always an error. Times that go back and pixels outside are what
    :class:`ReadRules` say.

    Args:
        first: the number of the first event that comes.

    Attributes:
        dropped_backward, dropped_outside: events that were left out.
    """

    def __init__(
        self, path: str | os.PathLike[str], rules: ReadRules, size: tuple[int, int], *, first: int = 0
    ) -> None:
        self._path = os.fspath(path)
        self._rules, self._size = rules, size
        self._last_us = 0
        self._seen = first
        self.dropped_backward = 0
        self.dropped_outside = 0

    def take(self, events: EventArray) -> EventArray:
        """Return the events that are handed out.

        Raises:
            DecodeError: for the first one that breaks a rule, with its number, counted from 0 among those read.
        """
        if not len(events):
            return events
        first, last_us = self._seen, self._last_us
        self._seen += len(events)
        if "keep" not in (self._rules.backward, self._rules.outside):
            try:
                check_events(events, last_us=last_us, latest_us=_LATEST_US, size=self._size)
            except ValueError:
                pass
            else:
                self._last_us = int(events["t"][-1])
                return events
        self._refuse(events["t"] < 0, events, first, "times may not lie before 0")
        self._refuse(events["p"] > 1, events, first, "polarity must be 0 or 1")
        width, height = self._size
        outside = (events["x"] >= width) | (events["y"] >= height)
        rule = f"pixels must lie within the {width} x {height} of the file's sensor"
        kept = self._apply(self._rules.outside, "outside", outside, events, first, rule)
        self.dropped_outside += len(events) - len(kept)
        if not len(kept) or self._rules.backward == "keep":
            return kept
        latest = np.maximum.accumulate(np.maximum(kept["t"], last_us))
        self._last_us = int(latest[-1])
        rule = "times may not go back"
        in_order = self._apply(self._rules.backward, "backward", kept["t"] < latest, kept, first, rule)
        self.dropped_backward += len(kept) - len(in_order)
        return in_order

    def _apply(
        self, policy: Breach, option: str, wrong: npt.NDArray[np.bool_], events: EventArray, first: int, rule: str
    ) -> EventArray:
        if policy == "keep" or not wrong.any():
            return events
        if policy == "refuse":
            self._refuse(wrong, events, first, f"{rule} ({option}='drop' leaves such events out, 'keep' takes them)")
        return np.ascontiguousarray(events.view("V16")[~wrong]).view(EVENT_DTYPE)

    def _refuse(self, wrong: npt.NDArray[np.bool_], events: EventArray, first: int, rule: str) -> None:
        if wrong.any():
            at = int(wrong.argmax())
            t, x, y, p = events[at].tolist()
            before = "" if at == 0 else f", after {events['t'][at - 1]} us"
            raise DecodeError(f"{self._path}: {rule}: event {first + at} is at {t} us{before}, x {x}, y {y}, p {p}")
