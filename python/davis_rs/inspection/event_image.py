"""Shows event arrays as a picture."""

from __future__ import annotations

import html
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import as_size, check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.html_table import html_picture
from .._util.quantities import time_text
from .._util.whole_file import write_whole
from ..events.arrays import EventArray, as_events
from ..events.packet import Packet
from .figure import event_picture, events_around

_EVENTS_A_PIXEL = 0.2
_LEAST_WIDTH, _MOST_WIDTH = 480, 960  # of a picture in a notebook, CSS pixels


@dataclass(frozen=True, eq=False)
class EventImage:
    """A picture of events, which a notebook shows: ON red, OFF blue, on white; the last event of a pixel counts.

    Attributes:
        image: uint8 (H, W, 3).
        events: how many are drawn.
        total: how many there are.
        t_us: the middle of the time that is drawn, in microseconds.
        window_us: its length.
    """

    image: npt.NDArray[np.uint8]
    events: int
    total: int
    t_us: int
    window_us: int

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        return f"<EventImage of {self._said()}, {width} x {height} px>"

    def _said(self) -> str:
        window = f"{time_text(self.window_us)} around t = {self.t_us / 1e6:.6g} s"
        return f"{self.events:,} of {self.total:,} events, {window}"

    def png(self) -> bytes:
        """Return the picture as a PNG file, one pixel for each of the sensor's."""
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(self.image).save(stream, "PNG")
        return stream.getvalue()

    def save(self, path: str | Path) -> None:
        """Write the picture as a PNG file.

        Raises:
            OSError: if it cannot be written.
        """
        write_whole(Path(path), self.png())

    def _repr_html_(self) -> str:
        width = self.image.shape[1]
        shown = width * max(1, round(_LEAST_WIDTH / width)) if width < _LEAST_WIDTH else min(width, _MOST_WIDTH)
        return f"<div>{html.escape(self._said())}; ON red, OFF blue</div>{html_picture(self.png(), shown)}"


@names_checked
def show(
    events: npt.ArrayLike | Packet,
    *,
    size: tuple[int, int] | None = None,
    t_s: float | None = None,
    window_s: float | None = None,
) -> EventImage:
    """Show events as a picture, in place of the numbers that an array prints: as the last line of a notebook's cell.

    >>> davis_rs.show(events)
    >>> davis_rs.show(packet)

    Args:
        events: an event array, anything that :func:`~davis_rs.as_events` takes, or a packet.
        size: (width, height) of the sensor in pixels; that of a packet's frame, or what the events just fill, if not
            given.
        t_s: the middle of what is shown, in seconds; half way between the first and the last event if not given.
        window_s: how much of the time around it is shown, in seconds; by default as much as holds 0.2 events a pixel,
            which shows edges.

    Raises:
        ValueError: for what are no events, events outside of the size, a time outside of the events' own, a window that
            is not positive.
    """
    if isinstance(events, Packet):
        if size is None and events.luma is not None:
            size = events.luma.shape[1], events.luma.shape[0]
        events = events.events
    array = as_events(events)
    if window_s is not None:
        check_number("window_s", window_s, 0, above_low=True)
    width, height = _size_of(array, size)
    first_us, last_us = (int(array["t"][0]), int(array["t"][-1])) if len(array) else (0, 0)
    t_us = (first_us + last_us) // 2 if t_s is None else round(1e6 * t_s)
    if len(array) and not first_us <= t_us <= last_us:
        raise ArgumentError(
            "{t_s} must lie between the first and the last event, {:g}..{:g} s, got {}", first_us / 1e6, last_us / 1e6,
            t_s,
        )  # fmt: skip
    limits_us = first_us, last_us
    shown, (from_us, to_us) = events_around(array, t_us, _EVENTS_A_PIXEL * width * height, window_s, limits_us)
    image = event_picture(np.full((height, width), 1.0), shown)
    return EventImage(image, len(shown), len(array), t_us, to_us - from_us)


def _size_of(events: EventArray, size: tuple[int, int] | None) -> tuple[int, int]:
    """Return the size that is given, if all events lie in it, or else what they just fill."""
    if not len(events):
        return as_size(size) if size is not None else (1, 1)
    filled = int(events["x"].max()) + 1, int(events["y"].max()) + 1
    if size is None:
        return filled
    width, height = as_size(size)
    if filled[0] > width or filled[1] > height:
        raise ArgumentError(
            "{size} is {} x {} px, but there is an event at column {}, row {}", width, height, filled[0] - 1,
            filled[1] - 1,
        )  # fmt: skip
    return width, height
