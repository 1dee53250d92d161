"""Writing events to a file of any format."""

from __future__ import annotations

import os
from typing import Any

from ..argument_error import ArgumentError
from ..close_names import did_you_mean
from ..dataset.folder_format import FolderFormat
from ..formats.interface import EventWriter, Target
from ..formats.registry import format_named, format_of_suffix
from ..holding import FileHold


def open_writer(
    path: Target, size: tuple[int, int], format: str | None = None, *, overwrite: bool = False, **options: Any
) -> EventWriter:
    """Open a writer of events, streaming in constant memory; a context manager. See docs/formats.md for the formats.

        with davis_rs.open_writer("events.aedat4", size=(240, 180), compression="lz4") as writer:
            for packet in davis_rs.simulate(...):
                writer.write(packet.events)

    Args:
        path: where to write: a path, or an open binary stream, where the format needs no more than that.
        size: (width, height) of the sensor in pixels; an event outside of it is refused.
        format: the format's name; None means the one that the path's suffix stands for.
        overwrite: whether an existing file may be replaced.
        options: those of the format.

    Raises:
        ValueError: for a suffix or a name that stands for no format, or a sensor that the format cannot hold.
        TypeError: for an option that the format does not have.
        FileExistsError: if the file exists and ``overwrite`` is not set.
        OSError: if it cannot be made; EBUSY if another writer has it.
    """
    if format is not None:
        chosen = format_named(format)
    elif isinstance(path, str | os.PathLike):
        chosen = format_of_suffix(path)
    else:
        raise ArgumentError("a stream has no suffix that would tell the format: give {format}")
    for name in options:
        if name not in chosen.options:
            has = f"it has {', '.join(chosen.options)}" if chosen.options else "it has none"
            raise TypeError(
                f"the format {chosen.name} has no option {name!r}{did_you_mean(name, chosen.options)}; {has}"
            )
    if not isinstance(path, str | os.PathLike) or isinstance(chosen, FolderFormat):  # which holds its folder itself
        return chosen.open_writer(path, size, overwrite=overwrite, **options)
    hold = FileHold(path)  # before a file that is there is emptied
    writer = chosen.open_writer(path, size, overwrite=overwrite, **options)
    hold.extend()
    writer.hold = hold
    return writer
