"""Finds formats by name, by suffix and by content."""

from __future__ import annotations

import os
from pathlib import Path

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError
from .interface import Format

HEAD = 4096

FORMATS: dict[str, Format] = {}
"""All formats by name. Where two share a suffix, the first one is meant by it."""


def register(*formats: Format) -> None:
    """Add formats, to be looked up in this order."""
    FORMATS.update((format.name, format) for format in formats)


def written_formats() -> dict[str, Format]:
    """Return those that can be written."""
    return {name: format for name, format in FORMATS.items() if format.writable}


def format_named(name: str) -> Format:
    """Return the format of that name, which can be written.

    Raises:
        ValueError: if there is none; the message lists those there are.
    """
    formats = written_formats()
    if name not in formats:
        only = f"{name} is only read; " if name in FORMATS else ""
        raise ArgumentError("{}{format} must be one of {}: got {!r}", only, ", ".join(formats), name)
    return formats[name]


def format_of_suffix(path: str | os.PathLike[str]) -> Format:
    """Return the format that a path's suffix stands for.

    Raises:
        ValueError: if it stands for none, or for one that is only read; the message lists those that can be written.
    """
    suffix = Path(path).suffix.lower()
    formats = [format for format in FORMATS.values() if suffix in format.suffixes]
    if formats and formats[0].writable:
        return formats[0]
    known = ", ".join(dict.fromkeys(suffix for format in written_formats().values() for suffix in format.suffixes))
    reason = "stands for recordings, which are only read" if formats else "is no event format"
    raise ArgumentError("the suffix of {!r} {} ({}): give {format}", os.fspath(path), reason, known)


def format_of_content(path: str | os.PathLike[str]) -> Format:
    """Return the format of an existing file, by its first bytes, or of a folder; an empty file is one of its suffix.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if no format knows it, or it is empty and its suffix does not tell.
    """
    file = Path(path)
    if file.is_dir():
        for format in FORMATS.values():
            if format.sniff_folder(file):
                return format
        raise DecodeError(f"{file} is a folder of no known format: neither a dataset nor a rosbag2")
    with file.open("rb") as stream:
        head = stream.read(HEAD)
    if not head:
        for format in written_formats().values():
            if file.suffix.lower() in format.suffixes:
                return format
        raise DecodeError(f"{file} is empty")
    for format in FORMATS.values():
        if format.sniff(head, file):
            return format
    raise DecodeError(f"{file} is in no known event format (byte 0: {head[:16]!r}); known are {', '.join(FORMATS)}")
