"""Keeps the file under an HDF5 writer such that it can be read at any moment, up to the last flush.

HDF5 changes its metadata in place, and neither says in which order nor stops at an error. So between two flushes only
new bytes go to the disk (the file never reuses space, and its cache keeps metadata until a flush), and those of a flush
are put in order: what is new, then the superblock, then what leads to it, the lengths of the datasets last. Once the
system refuses, nothing more is written.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._util.extras import from_extra
from .destination import naming

if TYPE_CHECKING:
    import h5py


class Disk:
    """Presents an open file as h5py's ``fileobj`` driver takes it.

    ``error`` is the system's refusal, after which writes go nowhere.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error: OSError | None = None
        with naming(path):
            self._descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        self._position = 0
        self._size = 0  # what HDF5 believes
        self._flushed = 0  # bytes that a reader may be looking at
        self._held: list[tuple[int, bytes]] | None = None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        return self._position

    def tell(self) -> int:
        return self._position

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        if self._held is None:
            self._put(self._position, data)
        else:
            self._held.append((self._position, bytes(data)))
        self._position += size
        self._size = max(self._size, self._position)
        return size

    def read(self, size: int) -> bytes:
        # Not pread, which Windows lacks; calls come one at a time.
        os.lseek(self._descriptor, self._position, os.SEEK_SET)
        data = os.read(self._descriptor, size)
        self._position += len(data)
        return data

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        data = self.read(len(view))
        view[: len(data)] = data
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        self._size = self._position if size is None else size
        return self._size

    def flush(self) -> None:
        pass

    @contextmanager
    def in_order(self, last: Callable[[int, int], bool]) -> Iterator[None]:
        """Within it writes wait, and are then made in an order that keeps the file readable.

        Args:
            last: whether the bytes from ... to ... are to be written after all others.
        """
        self._held = []
        try:
            yield
            held = self._held
        finally:
            self._held = None

        def order(write: tuple[int, bytes]) -> tuple[bool, bool, bool, int]:
            offset, data = write
            return offset < self._flushed, offset > 0, last(offset, offset + len(data)), offset

        # A reader refuses a file that is shorter than its superblock says.
        self._do(lambda: os.ftruncate(self._descriptor, max(self._size, os.fstat(self._descriptor).st_size)))
        for offset, data in sorted(held, key=order):
            self._put(offset, data)
        self._flushed = self._size

    def close(self) -> int:
        """Cut what is not the file's, close it and return its size."""
        size = self._flushed
        try:
            self._do(lambda: os.ftruncate(self._descriptor, size))
        finally:
            os.close(self._descriptor)
        return size

    def _put(self, offset: int, data: Any) -> None:
        rest = memoryview(data).cast("B")
        while len(rest) and self.error is None:
            count = 0

            def put(rest: memoryview = rest, offset: int = offset) -> None:
                nonlocal count
                os.lseek(self._descriptor, offset, os.SEEK_SET)
                count = os.write(self._descriptor, rest)

            self._do(put)
            rest, offset = rest[count:], offset + count

    def _do(self, act: Callable[[], object]) -> None:
        if self.error is None:
            try:
                with naming(self.path):
                    act()
            except OSError as error:
                self.error = error


class Hdf5File:
    """Holds an HDF5 file that is written: ``file`` is h5py's, to be flushed and closed here alone.

    Raises:
        ImportError: if a library is missing, with the extra that brings it.
        OSError: if the system refuses.
    """

    def __init__(self, path: Path) -> None:
        with from_extra("hdf5"):
            import h5py
        self._disk = Disk(path)
        self._headers: list[int] = []
        self.file: h5py.File = h5py.File(self._disk, "w", fs_strategy="none")
        cache = self.file.id.get_mdc_config()
        cache.evictions_enabled, cache.incr_mode, cache.flash_incr_mode, cache.decr_mode = False, 0, 0, 0
        self.file.id.set_mdc_config(cache)

    def watch(self, dataset: h5py.Dataset) -> None:
        """Take a dataset's length as what tells readers of new rows."""
        import h5py

        self._headers.append(h5py.h5o.get_info(dataset.id).addr)

    def check(self) -> None:
        """Raise what the system refused meanwhile."""
        if self._disk.error is not None:
            raise self._disk.error

    def flush(self) -> None:
        self.check()
        with self._disk.in_order(lambda start, end: any(start <= header < end for header in self._headers)):
            self.file.flush()
        self.check()

    def close(self) -> int:
        """Flush, close and return the size in bytes; after a failure, leave what is there."""
        with self._disk.in_order(lambda start, end: any(start <= header < end for header in self._headers)):
            self.file.close()
        size = self._disk.close()
        self.check()
        return size
