"""Writes and reads MVSEC's HDF5: davis/left/{events, image_raw, imu, depth_image_raw, pose, flow_dist}."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.array_types import UncheckedArray
from ..._util.untrusted import decoding
from ...events.arrays import EventArray
from .destination import Limits
from .hdf5 import Hdf5Format
from .hdf5_dataset import GrowingDataset
from .hdf5_parts import Hdf5PartsReader, Hdf5PartsWriter, Series
from .parts import ALL_PARTS, DEPTH, FLOW, FRAMES, IMU, POSES, PoseSample

_LEFT = "davis/left/"
SERIES = {
    FRAMES.name: Series(f"{_LEFT}image_raw", f"{_LEFT}image_raw_ts", "u1"),
    DEPTH.name: Series(f"{_LEFT}depth_image_raw", f"{_LEFT}depth_image_raw_ts", "<f4"),
    FLOW.name: Series(f"{_LEFT}flow_dist", f"{_LEFT}flow_dist_ts", "<f4"),
    IMU.name: Series(f"{_LEFT}imu", f"{_LEFT}imu_ts", "<f8"),
    POSES.name: Series(f"{_LEFT}pose", f"{_LEFT}pose_ts", "<f8"),
}
_INTERVALS = f"{_LEFT}flow_dist_dt"
"""Ours: the seconds over which each displacement goes."""
_ONE_MAP_US = 50_000
"""The interval of a flow map that stands alone: MVSEC's 20 Hz."""


class MvsecWriter(Hdf5PartsWriter):
    """Writes what MVSEC has in the ``_data.hdf5`` and ``_gt.hdf5`` of a sequence, of the left camera, into one file.

    Events are rows (x, y, t in seconds, polarity -1 or 1); ``image_raw_event_inds`` is the last event before an image.
    Depth is NaN where nothing is hit. ``flow_dist`` is how far pixels go until the next map (the last one: as long as
    the one before), which is flow times that interval; the interval stands in ``flow_dist_dt``. Poses are
    T_world_camera.

    Source: Zhu et al., "The Multivehicle Stereo Event Camera Dataset", RA-L 2018; daniilidis-group/mvsec,
    tools/mvsec_simple_reader.
    """

    series = SERIES
    seconds = True

    def _create(self) -> None:
        super()._create()
        self._table = self._dataset(f"{_LEFT}events", "<f8", row=(4,), chunk=1 << 13)
        self._images: GrowingDataset | None = None
        self._intervals: GrowingDataset | None = None
        self._last_times = np.zeros(0, np.int64)
        self._flow: tuple[int, UncheckedArray] | None = None
        self._interval_us = _ONE_MAP_US

    def _dataset(self, name: str, dtype: str, **more: Any) -> GrowingDataset:
        return GrowingDataset(self._hdf5, name, dtype, compression=self._compression, level=self._level, **more)

    def _append(self, packet: EventArray) -> None:
        # Correctly rounded quotients, so that rint(1e6 t) gives the microseconds back.
        polarity = packet["p"] * 2.0 - 1.0
        self._table.append(np.stack([packet["x"], packet["y"], packet["t"] / 1e6, polarity], axis=1))
        self._last_times = packet["t"].copy()

    def _append_row(self, series: Series, t_us: int, values: UncheckedArray) -> None:
        if series is SERIES[FRAMES.name]:
            if self._images is None:
                self._images = self._dataset(f"{_LEFT}image_raw_event_inds", "<i8", chunk=1 << 12)
            not_before = len(self._last_times) - int(np.searchsorted(self._last_times, t_us))
            self._images.append(np.array([len(self._table) - not_before - 1]))
        elif series is SERIES[DEPTH.name]:
            values = np.where(np.isinf(values), np.float32(np.nan), values)
        elif series is SERIES[POSES.name]:
            values = _matrix(values)
        elif series is SERIES[FLOW.name]:
            if self._flow is not None:
                self._interval_us = max(1, t_us - self._flow[0])
                self._append_flow()
            self._flow = t_us, values.copy()
            return
        super()._append_row(series, t_us, values)

    def _append_flow(self) -> None:
        """Write the map of flow that has waited for its interval."""
        if self._flow is None:
            return
        (t_us, flow), self._flow = self._flow, None
        if self._intervals is None:
            self._intervals = self._dataset(_INTERVALS, "<f8", chunk=1 << 12)
        interval_s = self._interval_us / 1e6
        self._intervals.append(np.array([interval_s]))
        displacement = np.moveaxis(flow.astype(np.float64) * interval_s, -1, 0).astype(np.float32)
        super()._append_row(SERIES[FLOW.name], t_us, displacement)

    def _close(self) -> int:
        with self._telling():
            self._append_flow()
        return super()._close()

    def _settle(self) -> None:
        for dataset in (self._table, self._images, self._intervals):
            if dataset is not None:
                dataset.settle()
        super()._settle()


class MvsecReader(Hdf5PartsReader):
    """Reads the left camera of MVSEC's layout: of files of ours, and of MVSEC's own ``_data.hdf5``."""

    series = SERIES
    names = (f"{_LEFT}events",)
    row = (4,)

    def depth_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield depth maps as (t_us, float32 (height, width) in metres), inf where there is none."""
        for t_us, depth in super().depth_maps():
            yield t_us, np.where(np.isnan(depth), np.float32(np.inf), depth)

    def flow_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield maps of optical flow as (t_us, float32 (height, width, 2) in pixels per second)."""
        series = SERIES[FLOW.name]
        with decoding(self.path, series.times):
            times, dataset = self._find(series.times), self._find(_INTERVALS)
            if times is None:
                return
            given = dataset is not None
            dataset = dataset if given else times
            self._budget.take(8 * len(dataset), "the intervals of flow_dist")
            with self._rows_of(dataset, len(dataset)) as rows:
                intervals = np.asarray(rows.read(0, len(dataset)), np.float64)
            intervals = intervals if given else np.diff(intervals)
            if not len(intervals):
                raise DecodeError(f"{self.path}: one map of flow_dist alone has no interval")
        for number, (t_us, displacement) in enumerate(self._rows(FLOW, (2, None, None))):
            interval_s = float(intervals[min(number, len(intervals) - 1)])
            if not interval_s > 0:
                raise DecodeError(f"{self.path}: flow_dist {number} has an interval of {interval_s} s, not above 0")
            yield t_us, np.moveaxis(displacement / interval_s, 0, -1).astype(np.float32)

    def poses(self) -> Iterator[PoseSample]:
        """Yield poses; the sign of a quaternion is free."""
        from scipy.spatial.transform import Rotation

        for t_us, matrix in self._rows(POSES, (4, 4)):
            with decoding(self.path, f"the pose at {t_us} us"):
                yield PoseSample(t_us, matrix[:3, 3].astype(np.float64), Rotation.from_matrix(matrix[:3, :3]).as_quat())

    def _size(self) -> tuple[int, int] | None:
        size = super()._size()
        images = self._find(SERIES[FRAMES.name].values)
        if size is None and images is not None and images.ndim == 3 and min(images.shape[1:]) > 0:
            size = (images.shape[2], images.shape[1])
        return size

    def _times(self, values: UncheckedArray) -> npt.NDArray[np.int64]:
        seconds = values[:, 2] if values.ndim == 2 else values
        microseconds = np.rint(np.asarray(seconds, np.float64) * 1e6)
        if not (np.abs(microseconds) < 2.0**62).all():  # NaN is not, either
            raise DecodeError(f"{self.path}: times must be finite, and below 2^62 us")
        return microseconds.astype(np.int64)

    def _columns(self, start: int, end: int) -> tuple[UncheckedArray, ...]:
        rows = self._datasets[0].read(start, end)
        x, y = rows[:, 0], rows[:, 1]
        wrong = ~((np.floor(x) == x) & (np.floor(y) == y) & (np.abs(x) < 2**31) & (np.abs(y) < 2**31))
        if wrong.any():
            at = int(wrong.argmax())
            raise DecodeError(f"{self.path}: event {start + at} is at ({x[at]}, {y[at]}), which is no pixel")
        return rows[:, 2].copy(), x.astype(np.int64), y.astype(np.int64), rows[:, 3]


def _matrix(pose: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the matrix (4, 4) of a position and a quaternion."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return matrix


class MvsecFormat(Hdf5Format):
    """Describes MVSEC's HDF5. It holds what float64 seconds do."""

    name = "mvsec"
    holds = ALL_PARTS
    limits = Limits(latest_us=2**31 * 1_000_000 - 1)
    marks = (f"{_LEFT}events",)
    default_compression = "none"
    writer = MvsecWriter
    reader = MvsecReader
