"""The formats there are, by name, by suffix and by content."""

from __future__ import annotations

import os
from pathlib import Path

from .._core import DecodeError
from ..argument_error import ArgumentError
from .interface import Format

HEAD = 4096

FORMATS: dict[str, Format] = {}
"""All formats by name. Where two share a suffix, the first one is meant by it."""


def register(*formats: Format) -> None:
    """Add formats, to be looked up in this order."""
    FORMATS.update((format.name, format) for format in formats)


def format_named(name: str) -> Format:
    """The format of that name.

    Raises:
        ValueError: if there is none; the message lists those there are.
    """
    try:
        return FORMATS[name]
    except KeyError:
        raise ArgumentError("{format} must be one of {}: got {!r}", ", ".join(FORMATS), name) from None


def format_of_suffix(path: str | os.PathLike[str]) -> Format:
    """The format that a path's suffix stands for.

    Raises:
        ValueError: if it stands for none; the message lists those that do.
    """
    suffix = Path(path).suffix.lower()
    for format in FORMATS.values():
        if suffix in format.suffixes:
            return format
    known = ", ".join(dict.fromkeys(suffix for format in FORMATS.values() for suffix in format.suffixes))
    raise ArgumentError("the suffix of {!r} is no event format ({}): give {format}", os.fspath(path), known)


def format_of_content(path: str | os.PathLike[str]) -> Format:
    """The format of an existing file, by its first bytes, or of a folder; an empty file is that of its suffix.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if no format knows it.
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
        return format_of_suffix(file)
    for format in FORMATS.values():
        if format.sniff(head, file):
            return format
    raise DecodeError(f"{file} is in no known event format (byte 0: {head[:16]!r}); known are {', '.join(FORMATS)}")
