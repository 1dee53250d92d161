"""Makes a dataset folder one of the formats: written part by part, and read so."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.untrusted import regular_file
from ...events.arrays import EventArray
from ...geometry.camera import Camera
from ..formats.blocks import BlockPosition, Blocks
from ..formats.destination import Destination, Limits
from ..formats.interface import EventReader, EventWriter, Format
from ..formats.parts import (
    ALL_PARTS,
    CAMERA,
    DEPTH,
    FLOW,
    IMU,
    POSES,
    Calibration,
    CameraLike,
    ImuSample,
    PoseSample,
    check_map,
)
from ..formats.parts import FRAMES as FRAMES_PART
from ..formats.reading import ReadRules
from ..formats.registry import FORMATS, format_of_content
from .files import (
    CALIBRATION,
    DEPTH_MAPS,
    EVENT_FILES,
    FLOW_MAPS,
    FRAMES,
    GROUND_TRUTH,
    INERTIAL,
    META,
    META_PART,
    EventFile,
    ImageFiles,
    append_lines,
    check_event_format,
    claim_folder,
    encode_exr,
    encode_png,
    event_file,
    remove_dataset,
    require_folder_room,
    stamped_line,
    unfinished_told,
    write_file,
)
from .reader import Dataset

_LINES = 1000
"""Samples and poses that wait until they are written."""


class FolderWriter(EventWriter):
    """Writes a dataset folder from the parts of a recording, which need not have been simulated.

    Unlike :class:`davis_rs.DatasetWriter` it takes frames as grey values, writes no luma, and each part at any time. A
    killed process leaves a folder with ``"complete": false`` in ``meta.json`` that reads up to the last :meth:`flush`,
    and to the last thousand poses and samples.

    Args:
        events: the format of the folder's events; see :class:`~davis_rs.io.dataset.files.EventFile`.

    Attributes:
        source: what is converted, for ``meta.json``.
        first_time_us: what was taken off all of the source's times, likewise.
    """

    def __init__(
        self,
        destination: Destination,
        *,
        events: str = "text",
    ) -> None:
        self._root = destination.path("a dataset folder")
        super().__init__(destination)
        check_event_format(events, self.size)
        self.source, self.first_time_us = "", 0
        self.hold = claim_folder(self._root, overwrite=destination.overwrite)
        self._file = EventFile(self._root, events, self.size)
        self._images = ImageFiles(self._root, FRAMES)
        self._depth = ImageFiles(self._root, DEPTH_MAPS)
        self._flow = ImageFiles(self._root, FLOW_MAPS)
        self._lines: dict[str, list[str]] = {GROUND_TRUTH: [], INERTIAL: []}
        self._counts = {GROUND_TRUTH: 0, INERTIAL: 0}
        self._calibrated = False
        self._end_us = 0
        self._write_meta(complete=False)

    def write_camera(self, t_us: int, camera: CameraLike) -> None:
        """Write ``calib.txt``.

        Raises:
            ValueError: for a calibration of another size than the sensor's.
        """
        if (camera.width, camera.height) != self.size:
            raise ValueError(
                f"the calibration is of {camera.width} x {camera.height} pixels, the sensor of "
                f"{self.size[0]} x {self.size[1]}"
            )
        with self._turn:
            self._refuse_if_over()
            own = Camera(*self.size, camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
            write_file(self._root / CALIBRATION, own.to_calib().encode())
            self._calibrated = True

    def write_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Write an intensity frame: uint8, shape (height, width)."""
        check_map("an image", image, self.size[::-1], np.uint8)
        self._write_map(self._images, t_us, encode_png(image))

    def write_depth(self, t_us: int, depth: npt.NDArray[np.float32]) -> None:
        """Write a depth map: float32, shape (height, width), metres along the optical axis."""
        check_map("a depth map", depth, self.size[::-1], np.float32)
        self._write_map(self._depth, t_us, encode_exr({"Z": depth}))

    def write_flow(self, t_us: int, flow: npt.NDArray[np.float32]) -> None:
        """Write a map of optical flow: float32, shape (height, width, 2), pixels per second."""
        check_map("a map of flow", flow, (*self.size[::-1], 2), np.float32)
        self._write_map(self._flow, t_us, encode_exr({"U": flow[..., 0], "V": flow[..., 1]}))

    def write_imu(self, t_us: int, acceleration: npt.ArrayLike, angular_velocity: npt.ArrayLike) -> None:
        """Write an IMU sample: specific force in m/s^2 and rate in rad/s, each of shape (3,)."""
        self._write_line(INERTIAL, t_us, acceleration, angular_velocity)

    def write_pose(self, t_us: int, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        """Write a pose, T_world_camera: metres, and (x, y, z, w)."""
        self._write_line(GROUND_TRUTH, t_us, position, quaternion)

    def _write_map(self, files: ImageFiles, t_us: int, data: bytes) -> None:
        self._note(t_us)
        with self._turn:
            self._refuse_if_over()
            files.write(t_us, data)

    def _write_line(self, name: str, t_us: int, *values: npt.ArrayLike) -> None:
        self._note(t_us)
        with self._turn:
            self._refuse_if_over()
            lines = self._lines[name]
            lines.append(stamped_line(t_us, np.concatenate([np.asarray(part, np.float64) for part in values])))
            self._counts[name] += 1
            if len(lines) >= _LINES:
                self._write_lines()

    def _note(self, t_us: int) -> None:
        if t_us < 0:
            raise ValueError(f"a dataset folder holds times from 0 on, got {t_us} us")
        self._end_us = max(self._end_us, t_us)

    def _write_lines(self) -> None:
        for name, lines in self._lines.items():
            if lines:
                append_lines(self._root / name, "".join(lines))
                lines.clear()

    def _encode(self, packet: EventArray) -> None:
        self._note(int(packet["t"][-1]))
        self._file.write(packet)

    def _flush(self) -> None:
        self._file.flush()
        self._write_lines()

    def _close(self) -> int:
        self._write_lines()
        self._file.close()
        self._write_meta(complete=True)
        return sum(file.stat().st_size for file in self._root.rglob("*") if file.is_file())

    def _abandon(self) -> None:
        with suppress(OSError):
            self._file.close()
        with suppress(OSError):
            self._write_lines()

    def _write_meta(self, *, complete: bool) -> None:
        meta = {
            "converted_from": self.source,
            "first_time_us": self.first_time_us,
            "sensor": {"width": self.size[0], "height": self.size[1]},
            "calibrated": self._calibrated,
            "counts": {
                "events": self._file.count,
                "on_events": self._file.on_count,
                "frames": self._images.count,
                "depth_maps": self._depth.count,
                "luma_maps": 0,
                **({"flow_maps": self._flow.count} if self._flow.count else {}),
                "poses": self._counts[GROUND_TRUTH],
                "imu_samples": self._counts[INERTIAL],
            },
            "duration_us": self._end_us,
            "complete": complete,
            "interrupted": False,
        }
        write_file(self._root / META_PART, (json.dumps(meta, indent=2) + "\n").encode())
        (self._root / META_PART).replace(self._root / META)


class FolderReader(EventReader):
    """Reads a dataset folder: the events of its event file, and its other parts."""

    def __init__(self, path: Path, rules: ReadRules) -> None:
        self.dataset = Dataset(path)
        file = regular_file(event_file(path))
        with unfinished_told(file):
            self._events = format_of_content(file).open_reader(file, rules)
        # As the file's own reader: what it says names the file, and sizes are as it states them.
        super().__init__(file, format=self._events.format, size=self._events.size, rules=rules)
        self.extent = self._events.extent
        self.check = self._new_check()

    @property
    def events(self) -> int | None:
        return self._events.events

    @property
    def progress(self) -> float:
        return self._events.progress

    def close(self) -> None:
        self._events.close()

    def images(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Yield intensity frames as (t_us, uint8 (height, width))."""
        for number, image in enumerate(self.dataset.frames):
            yield image.t_us, self.dataset.read_image(number)

    def depth_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield depth maps as (t_us, float32 (height, width) in metres)."""
        for number, image in enumerate(self.dataset.depth_maps):
            yield image.t_us, self.dataset.read_depth(number)

    def flow_maps(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield maps of optical flow as (t_us, float32 (height, width, 2) in pixels per second)."""
        for number, image in enumerate(self.dataset.flow_maps):
            yield image.t_us, self.dataset.read_flow(number)

    def imu(self) -> Iterator[ImuSample]:
        """Yield IMU samples."""
        for sample in self.dataset.imu:
            yield ImuSample(int(sample["t"]), sample["accel"].astype(np.float64), sample["gyro"].astype(np.float64))

    def poses(self) -> Iterator[PoseSample]:
        """Yield poses, T_world_camera."""
        truth = self.dataset.groundtruth
        for t_us, position, quaternion in zip(truth.t_us.tolist(), truth.positions, truth.quaternions, strict=True):
            yield PoseSample(t_us, position, quaternion)

    def cameras(self) -> Iterator[tuple[int, Calibration]]:
        """Yield the calibration as (0, calibration), nothing where there is none."""
        if (self.dataset.path / CALIBRATION).exists():
            camera = self.dataset.camera
            size = self.dataset.size or self.sensor or (camera.width, camera.height)
            yield 0, Calibration(*size, camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        return self._events._packets(chunk, start_us, stop_us)

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        return self._events._read(start_us, stop_us)

    def blocks(self) -> Blocks:
        return self._events.blocks()

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        return self._events.read_block(position, events)


def part_counts(dataset: Dataset) -> dict[str, int]:
    """Return how many there are of what a folder has next to its events, by what messages call them.

    Raises:
        OSError, DecodeError: if a part cannot be read.
    """
    counts = {
        FRAMES_PART.counted: len(dataset.frames),
        DEPTH.counted: len(dataset.depth_maps),
        FLOW.counted: len(dataset.flow_maps),
        POSES.counted: len(dataset.groundtruth.t_us),
        IMU.counted: len(dataset.imu),
        CAMERA.counted: int((dataset.path / CALIBRATION).exists()),
        "displacements": len(dataset.displacements),
        "masks": len(dataset.masks),
        "maps of normals": len(dataset.normal_maps),
        "luma maps": len(dataset.luma),
        "velocities": len(dataset.velocities.t_us),
        "labels of signal and noise": len(dataset.signal),
    }
    return {what: count for what, count in counts.items() if count}


class FolderFormat(Format):
    """Reads and writes dataset folders, as the public Event-Camera Dataset has them."""

    name = "folder"
    suffixes = ()
    options = ("events",)
    holds = ALL_PARTS
    limits = Limits()
    writer = FolderWriter

    def sniff(self, head: bytes, path: Path) -> bool:
        return False

    def sniff_folder(self, path: Path) -> bool:
        try:
            Dataset(path)
        except (OSError, DecodeError):
            return False
        return True

    def require_libraries(self, *, events: str = "text", **_: object) -> None:
        if events in EVENT_FILES:
            FORMATS[events].require_libraries()

    def require_room(self, path: Path, *, overwrite: bool) -> None:
        require_folder_room(path, overwrite=overwrite)

    def make_room(self, path: Path) -> None:
        if path.is_dir():
            remove_dataset(path)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> FolderReader:  # noqa: B008
        return FolderReader(Path(path), rules)
