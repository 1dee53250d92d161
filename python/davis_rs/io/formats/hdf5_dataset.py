"""Grows one column of events in an HDF5 file, by chunks that are compressed here and handed over whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._util.array_types import AnyArray
from ..._util.extras import from_extra
from .hdf5_flushed_file import Hdf5File

CHUNK = 1 << 16
"""Rows of a chunk of events."""

COMPRESSIONS = ("none", "lz4", "zstd")
"""Compressions on offer; those of Blosc need hdf5plugin to be read."""


def check_compression(compression: str, level: int) -> None:
    """Refuse what is no compression, and a level that it does not have.

    Raises:
        ValueError: with what there is.
    """
    if compression not in COMPRESSIONS:
        raise ValueError(f"compression must be one of {', '.join(COMPRESSIONS)}: got {compression!r}")
    if not 1 <= level <= 9:
        raise ValueError(f"the level of a compression must be 1..9, got {level}")


class GrowingDataset:
    """Holds a dataset that rows are appended to: numbers, or arrays of one shape.

    Rows wait until a chunk is full; :meth:`settle` writes those that wait as well, as a chunk that will be replaced.

    Args:
        compression: one of :data:`COMPRESSIONS`, as Blosc with byte or, for ``bits``, bit shuffle before it.
        level: of the compression, 1..9.
        row: the shape of a row, () for numbers.
        bits: whether single bits of the rows vary slowly, as those of times and polarities do.

    Source: HDF5 direct chunk write, https://docs.h5py.org/en/stable/high/dataset.html; the registered filter 32001
    (Blosc), chosen by DSEC.
    """

    def __init__(
        self,
        hdf5: Hdf5File,
        name: str,
        dtype: npt.DTypeLike,
        *,
        compression: str = "zstd",
        level: int = 1,
        row: tuple[int, ...] = (),
        bits: bool = False,
        chunk: int = CHUNK,
    ) -> None:
        self._hdf5 = hdf5
        self._codec: Any = None
        filters: Mapping[str, object] = {}
        if compression != "none":
            with from_extra("hdf5"):
                import hdf5plugin
                from numcodecs import Blosc
            shuffle = Blosc.BITSHUFFLE if bits else Blosc.SHUFFLE
            self._codec = Blosc(compression, level, shuffle)
            filters = hdf5plugin.Blosc(compression, level, shuffle)
        self.dataset = hdf5.file.create_dataset(
            name, (0, *row), dtype, maxshape=(None, *row), chunks=(chunk, *row), **filters
        )
        hdf5.watch(self.dataset)
        self._rows: AnyArray = np.zeros((chunk, *row), dtype)
        self._start = self._filled = 0

    def __len__(self) -> int:
        return self._start + self._filled

    def append(self, values: AnyArray) -> None:
        """Append rows; their values fit the dataset's type."""
        done = 0
        while done < len(values):
            count = min(len(values) - done, len(self._rows) - self._filled)
            target = self._rows[self._filled : self._filled + count]
            np.copyto(target, values[done : done + count], casting="unsafe")
            self._filled += count
            done += count
            if self._filled == len(self._rows):
                self._write()
                self._start += self._filled
                self._filled = 0

    def settle(self) -> None:
        """Write the rows that wait, and let the dataset's length be that of all rows."""
        if self._filled:
            self._rows[self._filled :] = 0
            self._write()
        self.dataset.resize(len(self), axis=0)

    def _write(self) -> None:
        self.dataset.resize(self._start + len(self._rows), axis=0)
        data = self._rows if self._codec is None else self._codec.encode(self._rows)
        position = (self._start, *[0] * (self._rows.ndim - 1))
        self.dataset.id.write_direct_chunk(position, bytes(data) if self._codec is None else data)
        self._hdf5.check()
