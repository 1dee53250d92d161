"""Reads events from a file of any format, which is recognised by its content."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from ..._util.close_names import names_checked
from ..._util.untrusted import MAX_PACKET_BYTES, decoding, regular_file
from ...events.arrays import EventArray
from ..formats.interface import CHUNK, EventReader, Roi
from ..formats.reading import Breach, ReadRules
from ..formats.registry import format_of_content


@names_checked
def open_reader(
    path: str | os.PathLike[str],
    *,
    backward: Breach = "refuse",
    outside: Breach = "refuse",
    max_packet_bytes: int = MAX_PACKET_BYTES,
) -> EventReader:
    """Open a reader of an event file, of a camera's recording, of a dataset folder or of a rosbag2.

    Args:
        path: a file of any format in docs/formats.md, recognised by its content, or a dataset folder.
        backward: what is done with events that are earlier than one before them: ``"refuse"`` is an error, ``"drop"``
            leaves them out, ``"keep"`` hands them out. A slice of time is then no longer found without reading the
            whole file.
        outside: likewise with events outside of the sensor's size that the file itself states.
        max_packet_bytes: what a packet, chunk, page or message of a compressed file may unpack to.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is in no known format, or malformed.
        ValueError: for another policy, or a limit below 1.
    """
    rules = ReadRules(backward, outside, max_packet_bytes)
    file = Path(path)
    if not file.is_dir():
        regular_file(file)
    with decoding(file):
        return format_of_content(file).open_reader(file, rules)


@names_checked
def read_events(
    path: str | os.PathLike[str],
    *,
    start_us: int | None = None,
    stop_us: int | None = None,
    roi: Roi | None = None,
    backward: Breach = "refuse",
    outside: Breach = "refuse",
    max_packet_bytes: int = MAX_PACKET_BYTES,
) -> EventArray:
    """Return the events of a file as one array of :data:`davis_rs.EVENT_DTYPE`, in the file's order.

    Args:
        path: a file of any format in docs/formats.md, recognised by its content, or a dataset folder.
        start_us, stop_us: only events with start_us <= t < stop_us; what lies outside is not read where the format
            allows it.
        roi: only events with x0 <= x < x1 and y0 <= y < y1, as (x0, y0, x1, y1).
        backward, outside, max_packet_bytes: see :func:`open_reader`.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is in no known format, or malformed; the message says where.

    Warns:
        TruncatedFileWarning: if the file ends in the middle of a record or was never finished; what is whole is
            returned.
    """
    with open_reader(path, backward=backward, outside=outside, max_packet_bytes=max_packet_bytes) as reader:
        return reader.read(start_us=start_us, stop_us=stop_us, roi=roi)


@names_checked
def iter_events(
    path: str | os.PathLike[str],
    *,
    chunk: int = CHUNK,
    start_us: int | None = None,
    stop_us: int | None = None,
    roi: Roi | None = None,
    backward: Breach = "refuse",
    outside: Breach = "refuse",
    max_packet_bytes: int = MAX_PACKET_BYTES,
) -> Iterator[EventArray]:
    """Yield :func:`read_events`'s events in arrays of ``chunk``, the last one shorter, in constant memory."""
    with open_reader(path, backward=backward, outside=outside, max_packet_bytes=max_packet_bytes) as reader:
        yield from reader.iter(chunk, start_us=start_us, stop_us=stop_us, roi=roi)
