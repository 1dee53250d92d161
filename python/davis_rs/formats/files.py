"""Makes files. An existing file is only replaced on request. A format that is unreadable in part is first written under
another name."""

from __future__ import annotations

import os
from pathlib import Path

from ..argument_error import OverwriteError
from ..whole_file import is_sink, require_no_file


def claim(path: str | os.PathLike[str], *, overwrite: bool) -> Path:
    """An empty file at ``path``.

    A pipe or a device has nothing to overwrite and is taken as it is.

    Raises:
        FileExistsError: if a file is there and ``overwrite`` is not set.
        OSError: if it cannot be made.
    """
    target = Path(path)
    if is_sink(target):
        return target
    try:
        target.open("wb" if overwrite else "xb").close()
    except FileExistsError:
        raise OverwriteError(target, "the file exists; {overwrite:True} replaces it") from None
    return target


def part_of(path: Path) -> Path:
    """Where a file is written until it is whole: ``NAME.part`` next to it."""
    return path.with_name(path.name + ".part")


class PartFile:
    """A file that is written next to its path, as ``NAME.part``, and takes its name when it is whole.

    Raises:
        FileExistsError: if the path exists and ``overwrite`` is not set, now or at the end.
        OSError: if ``NAME.part`` cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], *, overwrite: bool) -> None:
        self.path = Path(path)
        self.part = part_of(self.path)
        self._overwrite = overwrite
        require_no_file(self.path, overwrite=overwrite)
        claim(self.part, overwrite=True)

    def commit(self) -> None:
        """Give the file its name."""
        require_no_file(self.path, overwrite=self._overwrite)
        os.replace(self.part, self.path)
