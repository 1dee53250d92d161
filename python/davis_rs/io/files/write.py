"""Writes events to a file of any format."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean
from ..._util.holding import FileHold
from ..._util.whole_file import Workplace, is_sink
from ..dataset.folder_format import FolderFormat
from ..formats.destination import Target
from ..formats.interface import EventWriter, Format
from ..formats.registry import format_named, format_of_suffix


def open_writer(
    path: Target,
    size: tuple[int, int],
    format: str | None = None,
    *,
    overwrite: bool = False,
    whole: bool = False,
    **options: Any,
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
        whole: whether the file gets its name when it is finished (a stream or a pipe gets its bytes at once). After an
            error, or in a process that was killed, there is then none, and what was there before is as it was. If not
            given, what was written can be read at any time, also after a kill.
        options: those of the format.

    Raises:
        ValueError: for a suffix or a name that stands for no format, or a sensor that the format cannot hold.
        TypeError: for an option that the format does not have.
        ImportError: if a library is missing, with the extra that brings it.
        FileExistsError: if the file exists and ``overwrite`` is not set.
        OSError: if it cannot be made; EBUSY if another writer has it.
    """
    chosen = format_for(path, format, options)
    if not isinstance(path, str | os.PathLike):
        return chosen.open_writer(path, size, overwrite=overwrite, **options)
    if whole and not is_sink(Path(path)):
        return _whole_writer(chosen, Path(path), size, overwrite, options)
    if isinstance(chosen, FolderFormat):  # which holds its folder itself
        return chosen.open_writer(path, size, overwrite=overwrite, **options)
    hold = FileHold(path)  # before a file that is there is emptied
    writer = chosen.open_writer(path, size, overwrite=overwrite, **options)
    hold.extend()
    writer.hold = hold
    return writer


def _whole_writer(
    format: Format, path: Path, size: tuple[int, int], overwrite: bool, options: Mapping[str, object]
) -> EventWriter:
    """Return a writer into a hidden place next to the path."""
    workplace = Workplace(
        path,
        require_room=lambda: format.require_room(path, overwrite=overwrite),
        make_room=lambda: format.make_room(path),
        parents=isinstance(format, FolderFormat),
    )
    try:
        writer = format.open_writer(workplace.working_path, size, overwrite=False, **options)
    except BaseException as error:
        workplace.discard(error)
        raise
    writer.workplace = workplace
    return writer


def format_for(path: Target, format: str | None, options: Mapping[str, object]) -> Format:
    """Return the format that is asked for, if it has these options and its libraries are there.

    Raises:
        ValueError, TypeError, ImportError: as :func:`open_writer`.
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
    chosen.require_libraries(**options)
    return chosen
