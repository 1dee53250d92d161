"""Files that a scene's file names: only those of its own folder, because the names are untrusted too."""

from __future__ import annotations

from pathlib import Path

from .._core import DecodeError


def named_file(name: str, beside: Path, folder: Path, place: str) -> Path:
    """Return the file that a scene's file means by ``name``. It need not be there.

    Args:
        beside: the file that names it; the name counts from that file's folder.
        folder: the scene's own. The file must lie in it or below, also where links lead.
        place: how messages call what names it.

    Raises:
        DecodeError: if it lies elsewhere.
    """
    shown = repr(name) if len(name) <= 60 else f"{name[:57]!r}..."
    if not name or "\0" in name:
        raise DecodeError(f"{place}: must name a file in the scene's folder, got {shown}")
    try:
        file = (beside.parent / name).resolve()
        file.is_file()
    except (OSError, RuntimeError) as error:  # a name that is too long, links that go round in a circle
        raise DecodeError(f"{place}: {shown} names no file: {getattr(error, 'strerror', None) or error}") from None
    if not file.is_relative_to(folder.resolve()):
        raise DecodeError(f"{place}: names {shown}, which lies outside of the scene's folder: move it there")
    return file
