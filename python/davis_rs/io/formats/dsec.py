"""Writes and reads DSEC's HDF5: events/{t, x, y, p}, ms_to_idx, t_offset; what DSEC has in other files, in groups."""

from __future__ import annotations

import os

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, check_events
from ..._util.array_types import UncheckedArray
from ..._util.untrusted import decoding
from ...events.arrays import EventArray
from .destination import Limits
from .hdf5 import Hdf5Format
from .hdf5_parts import Hdf5PartsReader, Hdf5PartsWriter, Series
from .parts import ALL_PARTS, DEPTH, FLOW, FRAMES, IMU, POSES
from .reading import ReadRules

_SPAN_US = 2**32
"""Times are stored as uint32 after ``t_offset``."""
_LATEST_US = 2**62


SERIES = {
    FRAMES.name: Series("images/data", "images/t", "u1"),
    DEPTH.name: Series("depth/data", "depth/t", "<f4"),
    FLOW.name: Series("flow/data", "flow/t", "<f4"),
    IMU.name: Series("imu/data", "imu/t", "<f8"),
    POSES.name: Series("poses/data", "poses/t", "<f8"),
}
"""Ours: DSEC's HDF5 holds events alone. Times are those of ``t + t_offset``."""


class DsecWriter(Hdf5PartsWriter):
    """Writes events in DSEC's layout, and the other parts next to them.

    ``t_offset`` is 0 where the first event comes within 2^32 us (71 minutes), else that event's millisecond; a later
    event 2^32 us or more after it is refused. ``ms_to_idx`` has an entry for each millisecond up to the last event's.

    Source: Gehrig et al., "DSEC", RA-L 2021; https://dsec.ifi.uzh.ch/data-format.
    """

    series = SERIES
    seconds = False

    def _create(self) -> None:
        super()._create()
        for name, dtype, bits in (("t", "<u4", True), ("x", "<u2", False), ("y", "<u2", False), ("p", "u1", True)):
            self._columns[name] = self._column(f"events/{name}", dtype, bits=bits)
        self._milliseconds = self._column("ms_to_idx", "<u8", chunk=1 << 12)
        self._offset_us: int | None = None
        self._hdf5.file["t_offset"] = np.int64(0)

    def _check(self, packet: EventArray) -> None:
        super()._check(packet)
        latest_us = self._offset_of(packet) + _SPAN_US - 1
        if packet["t"][-1] > latest_us:
            check_events(packet, last_us=0, latest_us=latest_us, size=self.size)

    def _offset_of(self, packet: EventArray) -> int:
        if self._offset_us is not None:
            return self._offset_us
        first_us = int(packet["t"][0])
        return 0 if first_us < _SPAN_US else first_us - first_us % 1000

    def _append(self, packet: EventArray) -> None:
        if self._offset_us is None:
            self._offset_us = self._offset_of(packet)
            self._hdf5.file["t_offset"][()] = self._offset_us
        t_us = (packet["t"] - self._offset_us).astype(np.uint32)
        due = np.arange(len(self._milliseconds), int(t_us[-1]) // 1000 + 1, dtype=np.int64) * 1000
        self._milliseconds.append(np.searchsorted(t_us, due) + len(self._columns["t"]))
        self._columns["t"].append(t_us)
        for name in ("x", "y", "p"):
            self._columns[name].append(packet[name])

    def _settle(self) -> None:
        super()._settle()
        for column in (*self._columns.values(), self._milliseconds):
            column.settle()


class DsecReader(Hdf5PartsReader):
    """Reads DSEC's layout; ``t_offset`` is added to the times, and may be missing."""

    series = SERIES
    names = ("events/t", "events/x", "events/y", "events/p")

    def __init__(self, path: str | os.PathLike[str], *, format: str, rules: ReadRules) -> None:
        super().__init__(path, format=format, rules=rules)
        try:
            with decoding(path, "t_offset"):
                self._offset_us = self._offset()
                if not -_LATEST_US < self._offset_us < _LATEST_US:
                    raise ValueError(f"it must lie within +-2^62 us: found {self._offset_us}")
        except BaseException:
            self.close()
            raise

    def _offset(self) -> int:
        dataset = self._find("t_offset")
        if dataset is None:
            return 0
        if dataset.shape == ():
            return int(dataset[()])
        if dataset.shape != (1,):
            raise ValueError(f"it must be one number: found an array of {dataset.shape}")
        with self._rows_of(dataset, 1) as rows:
            return int(rows.read(0, 1)[0])

    def _times(self, values: UncheckedArray) -> npt.NDArray[np.int64]:
        if values.dtype.kind not in "iu":
            raise DecodeError(f"{self.path}: t must hold integers, found {values.dtype}")
        if len(values) and (int(values.max()) >= _LATEST_US or int(values.min()) <= -_LATEST_US):
            raise DecodeError(f"{self.path}: times must lie within +-2^62 us of t_offset")
        return values.astype(np.int64) + self._offset_us


class DsecFormat(Hdf5Format):
    """Describes DSEC's HDF5."""

    name = "dsec"
    holds = ALL_PARTS
    limits = Limits()
    marks = ("events/t",)
    default_compression = "zstd"
    writer = DsecWriter
    reader = DsecReader
