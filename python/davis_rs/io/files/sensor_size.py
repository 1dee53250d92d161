"""Finds how large the sensor of an event file is: by the file, by what lies next to it, or by the caller."""

from __future__ import annotations

import warnings

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError
from ..dataset.folder_format import FolderReader
from ..dataset.reader import Dataset
from ..formats.interface import EventReader


class SensorSizeWarning(UserWarning):
    """A file does not say the sensor's size, and the size that its folder tells was taken; the message says where."""


def sensor_size(reader: EventReader, given: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return width and height of a reader's sensor in pixels; see :func:`find_sensor_size`.

    Raises:
        ValueError: if nothing tells, or if the caller contradicts the file.
    """
    size = find_sensor_size(reader, given)
    if size is None:
        who = "neither meta.json nor frames say the sensor's size"
        if not isinstance(reader, FolderReader):
            who = f"the file ({reader.format}) does not say the sensor's size, nor does a meta.json or frame next to it"
        raise ArgumentError("{}: {}: give {size} WxH", _name(reader), who)
    return size


def find_sensor_size(reader: EventReader, given: tuple[int, int] | None = None) -> tuple[int, int] | None:
    """Return width and height of a reader's sensor in pixels, None where nothing tells.

    What a file says comes first, then what the caller gives, then a ``meta.json`` or frames next to the file.

    Args:
        given: what the caller says.

    Raises:
        ValueError: if the caller contradicts the file or the dataset folder that was opened.
        DecodeError, OSError: if the ``meta.json`` or the frame of the dataset folder that was opened cannot be read.

    Warns:
        SensorSizeWarning: if the size is that of what lies next to a file.
    """
    is_folder = isinstance(reader, FolderReader)
    stated = reader.size or (reader.dataset.size if isinstance(reader, FolderReader) else None)
    if stated is not None and given is not None and tuple(given) != tuple(stated):
        raise ArgumentError(
            "{} says that the sensor has {} x {} pixels: {size} {} x {} contradicts it",
            _name(reader), *stated, *given,
        )  # fmt: skip
    size = stated or given
    if size is not None or is_folder:
        return size
    try:
        folder = Dataset(reader.path.parent)
        size = folder.size
    except (OSError, DecodeError):  # it is not a dataset, or a broken one, which nobody has asked for
        return None
    if size is not None:
        warnings.warn(
            f"{reader.path} does not say the sensor's size: {size[0]} x {size[1]} is taken from {folder.size_source}",
            SensorSizeWarning,
            stacklevel=3,
        )
    return size


def _name(reader: EventReader) -> str:
    return str(reader.dataset.path if isinstance(reader, FolderReader) else reader.path)
