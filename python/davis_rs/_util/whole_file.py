"""Writes files and folders that get their name when they are whole."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from .argument_error import OverwriteError
from .holding import FileHold, Hold


class Workplace:
    """Makes a file or folder next to its path, and gives it that path when it is whole.

    It is a hidden folder ``.NAME.HEX.part``, in which the file or folder has its own name already, because libraries
    choose a format by the suffix. :meth:`put` gives it its path, :meth:`discard` removes what is left. What a killed
    process has left is removed by the next one that makes the same file.

    Args:
        path: what is to be made. A link stays, and what it leads to is replaced.
        require_room: raises an OSError if something is there that may not be replaced; called now and at the end.
        make_room: removes what may be replaced; called at the end. A file need not be removed.
        parents: whether folders on the way to the path are made, too.

    Attributes:
        path: what is to be made.
        working_path: where to make it.

    Raises:
        OSError: if there is no room, or the folder cannot be made; EBUSY if another process writes the same file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        require_room: Callable[[], object] = lambda: None,
        make_room: Callable[[], object] = lambda: None,
        parents: bool = False,
    ) -> None:
        self.path = Path(path)
        self._require_room, self._make_room = require_room, make_room
        self._final = Path(os.path.realpath(path))
        folder, name = self._final.parent, self._final.name
        self._working = folder / f".{name}.{uuid4().hex}.part"
        self.working_path = self._working / name
        self._holds: list[Hold | FileHold] = []
        self._parents = [above for above in (folder, *folder.parents) if not above.exists()] if parents else []
        try:
            self._holds.append(Hold(self._final) if self._final.is_dir() else FileHold(self._final))
            require_room()
            if parents:
                folder.mkdir(parents=True, exist_ok=True)
            self._working.mkdir()
            self._holds.append(Hold(self._working))
            self._discard_left_over()
        except BaseException as error:
            self.discard(error)
            raise

    def put(self) -> None:
        """Give what was made its path. It takes the place of a file; into a folder that is there it is moved.

        Raises:
            OSError: if that cannot be done.
        """
        self._require_room()
        self._make_room()
        _move(self.working_path, self._final)
        self._parents.clear()
        self.discard()

    def discard(self, error: BaseException | None = None) -> None:
        """Remove what is left; an error of the system will be about the path that the caller knows."""
        shutil.rmtree(self._working, ignore_errors=True)
        for above in self._parents:
            with suppress(OSError):
                above.rmdir()
        for hold in self._holds:
            hold.release()
        if isinstance(error, OSError):
            if str(error.filename).startswith(str(self._working.parent / f".{self._final.name}.")):
                error.filename = str(self.path)
            if isinstance(error.strerror, str):
                error.strerror = error.strerror.replace(str(self.working_path), str(self.path))

    def _discard_left_over(self) -> None:
        """Remove what killed processes have left.

        Raises:
            OSError: EBUSY, if a process still works there.
        """
        hidden = re.compile(rf"\.{re.escape(self._final.name)}\.[0-9a-f]{{32}}\.part")
        for other in self._final.parent.iterdir():
            if hidden.fullmatch(other.name) and other != self._working:
                with suppress(FileNotFoundError):  # its process has just removed it
                    hold = Hold(other)
                    if hold.is_exclusive:
                        shutil.rmtree(other, ignore_errors=True)
                    hold.release()


@contextmanager
def whole_file(path: str | os.PathLike[str], *, overwrite: bool = True) -> Iterator[Path]:
    """Give a path to write a file to, which becomes ``path`` when the block ends; after an error there is nothing.

    A pipe or a device is written to as it is.

    Raises:
        FileExistsError: if the file exists and ``overwrite`` is not set, now or at the end.
        IsADirectoryError: if a folder is there.
        OSError: if it cannot be made; EBUSY if another process writes it.
    """
    target = Path(path)
    if is_sink(target):
        yield target
        return
    workplace = Workplace(target, require_room=lambda: require_no_file(target, overwrite=overwrite))
    try:
        yield workplace.working_path
        workplace.put()
    except BaseException as error:
        workplace.discard(error)
        raise


def write_whole(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Write a file at once, in UTF-8 if it is text; see :func:`whole_file`."""
    with whole_file(path) as working:
        working.write_bytes(content.encode() if isinstance(content, str) else content)


def is_sink(path: Path) -> bool:
    """Tell whether a path is a pipe or a device: nothing is there to be replaced."""
    return path.exists() and not (path.is_file() or path.is_dir())


def require_no_file(path: Path, *, overwrite: bool) -> None:
    """Refuse a path where a file is, unless it may be replaced, or a folder.

    Raises:
        FileExistsError, IsADirectoryError: naming the path.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not overwrite and os.path.lexists(path):
        raise OverwriteError(path, "the file exists; {overwrite:True} replaces it")


def _move(source: Path, target: Path) -> None:
    """Rename; what is in a folder goes into one that is there, which may be somebody's current one."""
    if not (source.is_dir() and target.is_dir()):
        source.replace(target)
        return
    for entry in sorted(source.iterdir()):
        _move(entry, target / entry.name)
