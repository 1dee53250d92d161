"""Finds files that a scene's file names: only in its own folder, because the names are untrusted."""

from __future__ import annotations

import os
from pathlib import Path

from .._core import DecodeError

GREY_UNKNOWN = "--grey-unknown (load_scene(..., grey_unknown=True))"
"""How a user asks for grey in place of materials that are missing or not known, for messages."""


def named_file(name: str, beside: Path, folder: Path, where: str) -> Path:
    """Return the path that a scene's file means by ``name``. The file need not exist.

    Args:
        beside: the file with the name; the name is relative to its folder.
        folder: the scene's own. The file must lie in it or below, after all links are followed.
        where: the part of the file with the name, for messages.

    Raises:
        DecodeError: if it lies elsewhere.
    """
    shown = repr(name) if len(name) <= 60 else f"{name[:57]!r}..."
    if not name or "\0" in name:
        raise DecodeError(f"{where}: must name a file in the scene's folder, got {shown}")
    try:
        file = (beside.parent / name).resolve()
        file.is_file()
    except (OSError, RuntimeError) as error:  # a name that is too long, links that go round in a circle
        raise DecodeError(f"{where}: {shown} names no file: {getattr(error, 'strerror', None) or error}") from None
    if not file.is_relative_to(folder.resolve()):
        if Path(os.path.normpath(beside.parent.absolute() / name)).is_relative_to(folder.absolute()):
            raise DecodeError(f"{where}: {shown} is a link to outside of the scene's folder: put the file itself there")
        raise DecodeError(f"{where}: names {shown}, which lies outside of the scene's folder: move it there")
    return file
