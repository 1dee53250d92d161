"""Writes series of stamped arrays next to the events in an HDF5 file as they come, and reads them one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.array_types import UncheckedArray
from ..._util.untrusted import decoding
from .hdf5 import Hdf5Reader, Hdf5Writer
from .hdf5_dataset import GrowingDataset
from .interface import Failing
from .parts import (
    DEPTH,
    FLOW,
    FRAMES,
    IMU,
    POSES,
    Calibration,
    CameraLike,
    ImuSample,
    Part,
    PoseSample,
    check_map,
)

if TYPE_CHECKING:
    from .hdf5_flushed_file import Hdf5File

CALIBRATION = "calib"
"""The group of the calibration, named as M3ED names it."""
LATEST_US = 2**53
"""Of what stands next to the events."""

_NUMBERS = 1 << 12
"""Rows of a chunk of stamps, samples and poses."""


class Series(NamedTuple):
    """Says where a series lies: the dataset of its arrays, and that of their times."""

    values: str
    times: str
    dtype: str


class SeriesWriter:
    """Writes one series; images have a chunk each, smaller rows share one.

    Args:
        seconds: times are float64 seconds, else int64 microseconds.
    """

    def __init__(
        self, hdf5: Hdf5File, series: Series, row: tuple[int, ...], *, seconds: bool, compression: str, level: int
    ) -> None:
        self._seconds = seconds
        chunk = 1 if len(row) > 1 and row != (4, 4) else _NUMBERS
        self._values = GrowingDataset(
            hdf5, series.values, series.dtype, row=row, chunk=chunk, compression=compression, level=level
        )
        times = "<f8" if seconds else "<i8"
        self._times = GrowingDataset(
            hdf5, series.times, times, bits=True, chunk=_NUMBERS, compression=compression, level=level
        )

    def __len__(self) -> int:
        return len(self._times)

    def append(self, t_us: int, values: npt.ArrayLike) -> None:
        """Write one row and its time."""
        self._values.append(np.asarray(values)[np.newaxis])
        self._times.append(np.array([t_us / 1e6 if self._seconds else t_us]))

    def settle(self) -> None:
        """Let the datasets have all rows so far; the times last, so that there is an array to each."""
        self._values.settle()
        self._times.settle()


class Hdf5PartsWriter(Hdf5Writer):
    """Writes events and the other parts of a recording; each series is made when its first row comes.

    Rows come in order of time, those of one part.
    """

    series: ClassVar[Mapping[str, Series]]
    """Where each part lies."""
    seconds: ClassVar[bool]
    """Whether times are float64 seconds, else int64 microseconds."""

    def write_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Write an intensity frame: uint8, shape (height, width)."""
        check_map("an image", image, self.size[::-1], np.uint8)
        self._add(FRAMES, t_us, image)

    def write_depth(self, t_us: int, depth: npt.NDArray[np.float32]) -> None:
        """Write a depth map: float32, shape (height, width), metres along the optical axis."""
        check_map("a depth map", depth, self.size[::-1], np.float32)
        self._add(DEPTH, t_us, depth)

    def write_flow(self, t_us: int, flow: npt.NDArray[np.float32]) -> None:
        """Write a map of optical flow: float32, shape (height, width, 2), pixels per second (x right, y down)."""
        check_map("a map of flow", flow, (*self.size[::-1], 2), np.float32)
        self._add(FLOW, t_us, flow)

    def write_imu(self, t_us: int, acceleration: npt.ArrayLike, angular_velocity: npt.ArrayLike) -> None:
        """Write an IMU sample: specific force in m/s^2 and rate in rad/s, each of shape (3,)."""
        self._add(IMU, t_us, np.concatenate([np.asarray(acceleration, "f8"), np.asarray(angular_velocity, "f8")]))

    def write_pose(self, t_us: int, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        """Write a pose of the camera, T_world_camera: metres, and (x, y, z, w)."""
        self._add(POSES, t_us, np.concatenate([np.asarray(position, "f8"), np.asarray(quaternion, "f8")]))

    def write_camera(self, t_us: int, camera: CameraLike) -> None:
        """Write the calibration, which replaces the one before."""
        values = {
            "resolution": np.array([camera.width, camera.height], np.int64),
            "intrinsics": np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            "distortion_coeffs": np.array(camera.distortion),
        }
        with self._turn:
            self._refuse_if_over()
            with Failing(self), self._telling():
                group = self._hdf5.file.require_group(CALIBRATION)
                for name, value in values.items():
                    if name in group:
                        del group[name]
                    group[name] = value
                self._hdf5.check()

    def _add(self, part: Part, t_us: int, values: UncheckedArray) -> None:
        """Append a row to the series of a part."""
        if not 0 <= t_us <= LATEST_US:
            raise ValueError(f"times must lie in 0..{LATEST_US} us: got {t_us}")
        with self._turn:
            self._refuse_if_over()
            with Failing(self), self._telling():
                self._append_row(self.series[part.name], t_us, values)
                self._hdf5.check()

    def _append_row(self, series: Series, t_us: int, values: UncheckedArray) -> None:
        if series not in self._written:
            self._written[series] = SeriesWriter(
                self._hdf5,
                series,
                values.shape,
                seconds=self.seconds,
                compression=self._compression,
                level=self._level,
            )
        self._written[series].append(t_us, values)

    def _create(self) -> None:
        self._written: dict[Series, SeriesWriter] = {}

    def _settle(self) -> None:
        for series in self._written.values():
            series.settle()


class Hdf5PartsReader(Hdf5Reader):
    """Reads events and the other parts of a recording."""

    series: ClassVar[Mapping[str, Series]]

    def images(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Yield intensity frames as (t_us, uint8 (height, width))."""
        for t_us, image in self._rows(FRAMES, (None, None)):
            if image.dtype != np.uint8:
                raise DecodeError(f"{self.path}: images must be uint8, found {image.dtype}")
            yield t_us, image

    def depth_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield depth maps as (t_us, float32 (height, width) in metres)."""
        for t_us, depth in self._rows(DEPTH, (None, None)):
            yield t_us, depth.astype(np.float32)

    def flow_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield maps of optical flow as (t_us, float32 (height, width, 2) in pixels per second)."""
        for t_us, flow in self._rows(FLOW, (None, None, 2)):
            yield t_us, flow.astype(np.float32)

    def imu(self) -> Iterator[ImuSample]:
        """Yield IMU samples."""
        for t_us, sample in self._rows(IMU, (6,)):
            yield ImuSample(t_us, sample[:3].astype(np.float64), sample[3:].astype(np.float64))

    def poses(self) -> Iterator[PoseSample]:
        """Yield poses, T_world_camera."""
        for t_us, pose in self._rows(POSES, (7,)):
            yield PoseSample(t_us, pose[:3].astype(np.float64), pose[3:].astype(np.float64))

    def cameras(self) -> Iterator[tuple[int, Calibration]]:
        """Yield the calibration as (0, calibration), nothing where there is none."""
        values = []
        with decoding(self.path, CALIBRATION):
            if self._find(CALIBRATION) is None:
                return
            for name, count in (("resolution", 2), ("intrinsics", 4), ("distortion_coeffs", 5)):
                dataset = self._find(f"{CALIBRATION}/{name}")
                if dataset is None or dataset.shape != (count,):
                    raise DecodeError(f"{self.path}: {CALIBRATION}/{name} must have {count} values")
                with self._rows_of(dataset, count) as rows:
                    values += rows.read(0, count).tolist()
            calibration = Calibration(int(values[0]), int(values[1]), *values[2:])
        yield 0, calibration

    def _rows(self, part: Part, row: tuple[int | None, ...]) -> Iterator[tuple[int, UncheckedArray]]:
        """Yield (t_us, array) of a part, nothing where the file has none; times that are floats are seconds.

        Raises:
            DecodeError: for other shapes than ``row``, datasets of different lengths, times that are not finite, and
                chunks that unpack to more than the limit.
        """
        series = self.series[part.name]
        with decoding(self.path, series.values):
            values, times = self._find(series.values), self._find(series.times)
            if values is None:
                return
            if times is None:
                raise DecodeError(f"{self.path}: {series.values} has no times: no dataset {series.times}")
            count = len(times)
            if len(values) < count:
                raise DecodeError(f"{self.path}: {series.values} has {len(values)} rows, {series.times} has {count}")
            value_rows, time_rows = self._rows_of(values, count, row), self._rows_of(times, count)
        step = _NUMBERS if len(row) < 2 else 1
        with value_rows, time_rows:
            for first in range(0, count, _NUMBERS):
                stamps = self._microseconds(series, time_rows.read(first, min(count, first + _NUMBERS)))
                for start in range(0, len(stamps), step):
                    end = min(len(stamps), start + step)
                    yield from zip(stamps[start:end], value_rows.read(first + start, first + end), strict=True)

    def _microseconds(self, series: Series, times: UncheckedArray) -> list[int]:
        if times.dtype.kind == "f":
            times = np.rint(np.asarray(times, np.float64) * 1e6)
            if not (np.abs(times) < 2.0**62).all():  # NaN is not, either
                raise DecodeError(f"{self.path}: {series.times}: times must be finite, and below 2^62 us")
        return [int(t_us) for t_us in times]
