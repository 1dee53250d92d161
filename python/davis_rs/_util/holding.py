"""Locks files and folders that one writer has to itself."""

from __future__ import annotations

import errno
import os
from pathlib import Path


class Hold:
    """Locks a file or folder that exists, until it is released, is no longer referred to, or the process ends.

    The lock is the system's own (flock): nothing is left behind, whatever becomes of the process. On a file system
    without locks, and on Windows, there is none.

    Attributes:
        is_exclusive: whether there is a lock.

    Raises:
        OSError: EBUSY, if another writer has it, in this process or in another; or if it cannot be opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            import fcntl
        except ImportError:
            self.is_exclusive = False
            return
        self.is_exclusive = True
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise OSError(errno.EBUSY, "another program is writing into it", os.fspath(path)) from None
        except OSError as error:
            # EBADF: NFS, which locks no file that was opened for reading.
            if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EBADF):
                self.release()
                raise
            self.is_exclusive = False

    def release(self) -> None:
        """Let others have it; again is harmless."""
        descriptor, self._descriptor = getattr(self, "_descriptor", -1), -1
        if descriptor >= 0:
            os.close(descriptor)

    def __del__(self) -> None:
        self.release()


class FileHold:
    """Locks a file that is written, and ``NAME.part``, under which it is made: whichever of the two exist.

    Raises:
        OSError: EBUSY, if another writer has one of them.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._paths = [Path(path), Path(f"{os.fspath(path)}.part")]
        self._holds: dict[tuple[int, int], Hold] = {}
        self.extend()

    def extend(self) -> None:
        """Lock what has come to exist meanwhile."""
        for path in self._paths:
            if path.is_file():
                status = path.stat()
                key = (status.st_dev, status.st_ino)
                if key not in self._holds:
                    self._holds[key] = Hold(path)

    def release(self) -> None:
        """Let others have them."""
        for hold in self._holds.values():
            hold.release()
