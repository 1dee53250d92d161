"""Finds files that a scene's file names: only in its own folder, because the names are untrusted."""

from __future__ import annotations

import os
import warnings
from pathlib import Path, PurePosixPath

from .._core import DecodeError
from .repairs import SceneFileWarning

GREY_UNKNOWN = "--grey-unknown (load_scene(..., grey_unknown=True))"
"""How a user asks for grey in place of materials that are missing or not known, for messages."""

_LONGEST_END = 8
"""How many steps of a path the end of a name has at most. Each is looked for, and a hostile name has thousands."""


def named_file(name: str, beside: Path, folder: Path, where: str) -> Path:
    """Return the path that a scene's file means by ``name``. The file need not exist.

    A name that leads out of the folder, or to no file, is often that of another computer (``C:/textures/wall.png``), or
    of another place in a collection (``../textures/wall.png``). Then the file is taken for which the longest end of the
    name leads to a file (``textures/wall.png``, or else ``wall.png``), if there is one in the folder. Ends have 8 steps
    at most.

    Args:
        beside: the file with the name; the name is relative to its folder.
        folder: the scene's own. The file must lie in it or below, after all links are followed.
        where: the part of the file with the name, for messages.

    Raises:
        DecodeError: if it lies elsewhere.

    Warns:
        SceneFileWarning: if only the end of the name leads to the file.
    """
    shown = repr(name) if len(name) <= 60 else f"{name[:57]!r}..."
    if not name or "\0" in name:
        raise DecodeError(f"{where}: must name a file in the scene's folder, got {shown}")
    root, steps = folder.resolve(), PurePosixPath(name).parts
    try:
        file = (beside.parent / name).resolve()
        if not (file.is_relative_to(root) and file.is_file()):
            for start in range(max(1, len(steps) - _LONGEST_END), len(steps)):
                end = "/".join(steps[start:])
                near = (beside.parent / end).resolve()
                if near.is_relative_to(root) and near.is_file():
                    warnings.warn(f"{where}: {shown} is taken to be {end!r} next to it", SceneFileWarning, stacklevel=2)
                    return near
    except (OSError, RuntimeError) as error:  # a name that is too long, links that go round in a circle
        raise DecodeError(f"{where}: {shown} names no file: {getattr(error, 'strerror', None) or error}") from None
    if not file.is_relative_to(root):
        if Path(os.path.normpath(beside.parent.absolute() / name)).is_relative_to(folder.absolute()):
            raise DecodeError(f"{where}: {shown} is a link to outside of the scene's folder: put the file itself there")
        raise DecodeError(
            f"{where}: names {shown}, which lies outside of the scene's folder: put a copy next to {beside.name}"
        )
    return file
