"""Writes and reads the folder of a rig: a dataset for each camera, and what belongs to the body."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..._util.array_types import JsonObject
from ..._util.close_names import names_checked
from ..._util.html_table import html_table
from ...geometry.pose import GroundTruth, Pose
from ...sensor.imu import ImuArray, kalibr_imu
from ...sensor.rig import Rig, StereoTruth, kalibr_rig_chain, read_rig_file, rig_yaml, stereo_truth
from .disparity_png import decode_disparity, encode_disparity, encode_grey
from .files import (
    DISPARITIES,
    GROUND_TRUTH,
    KALIBR_CAMERA_CHAIN,
    META,
    META_PART,
    OCCLUSIONS,
    RIG,
    append_lines,
    as_json,
    claim_folder,
    pose_line,
    stamp,
    stamped_line,
    write_file,
)
from .reader import Dataset
from .text_folder import StampedImage, TextFolder

if TYPE_CHECKING:
    from typing_extensions import Self


def camera_folder(path: Path, camera: int) -> Path:
    """Return the folder of a rig's camera."""
    return path / f"cam{camera}"


def is_rig_folder(path: str | Path) -> bool:
    """Return whether a path is the folder of a rig."""
    return (Path(path) / RIG).is_file()


class RigFolder:
    """Writes what a rig's folder has next to the datasets of its cameras; a context manager.

    These are ``rig.yaml``, Kalibr's ``camchain.yaml``, the body's ``groundtruth.txt``, for each IMU ``imu0.txt`` with
    Kalibr's ``imu0.yaml``, and ``meta.json``. A process that is killed leaves files that can be read up to what was
    written last, with ``"complete": false``.

    Args:
        path, overwrite: see :class:`~davis_rs.DatasetWriter`. Of a rig that is replaced, all cameras go.
        rig: the rig.
        truth: the body's poses, by the rig's clock.
        samples: of each IMU, by the rig's clock.
        meta: for ``meta.json``.

    Raises:
        OSError: as :class:`~davis_rs.DatasetWriter`.
        ValueError: for a camera with k3, for which Kalibr has no model.
    """

    def __init__(
        self,
        path: Path,
        rig: Rig,
        truth: GroundTruth,
        samples: Sequence[ImuArray],
        *,
        overwrite: bool = False,
        meta: Mapping[str, object] | None = None,
    ) -> None:
        texts = {RIG: rig_yaml(rig), KALIBR_CAMERA_CHAIN: kalibr_rig_chain(rig)}
        texts |= {f"imu{number}.yaml": kalibr_imu(each.imu, topic=each.topic or f"/imu{number}")
                  for number, each in enumerate(rig.imus)}  # fmt: skip
        self.path, self._truth, self._samples = path, truth, samples
        self._meta = as_json(meta or {})
        self._posed, self._sampled, self._pairs = 0, [0] * len(samples), 0
        self._hold = claim_folder(path, overwrite=overwrite)
        self._open = True
        for name, text in texts.items():
            write_file(path / name, text.encode())
        self._write_meta({}, complete=False)

    def write_until(self, t_us: int) -> None:
        """Append poses and samples that fall due until a time of the rig's clock."""
        truth = self._truth
        posed = int(np.searchsorted(truth.t_us, t_us, "right"))
        if posed > self._posed:
            poses = (
                (int(truth.t_us[i]), Pose(truth.positions[i], truth.quaternions[i])) for i in range(self._posed, posed)
            )
            append_lines(self.path / GROUND_TRUTH, "".join(pose_line(at, pose) for at, pose in poses))
            self._posed = posed
        for number, samples in enumerate(self._samples):
            sampled = int(np.searchsorted(samples["t"], t_us, "right"))
            new = samples[self._sampled[number] : sampled]
            if len(new):
                values = np.concatenate([new["accel"], new["gyro"]], axis=1)
                lines = map(stamped_line, new["t"].tolist(), values)
                append_lines(self.path / f"imu{number}.txt", "".join(lines))
                self._sampled[number] = sampled

    def write_stereo(self, index: int, t_us: int, truth: StereoTruth) -> None:
        """Write disparity and occlusion of the first two cameras at their depth map ``index``, at ``t_us`` of cam0's
        clock."""
        occluded = np.where(truth.occluded, np.uint8(255), np.uint8(0))
        for series, png in ((DISPARITIES, encode_disparity(truth.disparity)), (OCCLUSIONS, encode_grey(occluded))):
            name = series.image_name(index)
            (self.path / series.folder).mkdir(exist_ok=True)
            write_file(self.path / name, png)
            append_lines(self.path / series.list_name, f"{stamp(t_us)} {name}\n")
        self._pairs += 1

    def finish(self, meta: Mapping[str, object], *, interrupted: bool) -> None:
        """Write ``meta.json`` for the last time.

        Args:
            meta: what is known at the end, such as ``counts`` and ``duration_us``.
            interrupted: the rig ends before its time.
        """
        counts = {"poses": self._posed, "imu_samples": sum(self._sampled), "disparities": self._pairs}
        known: JsonObject = as_json(meta)
        known["counts"] = {**known.get("counts", {}), **counts}
        self._open = False
        self._write_meta(known, complete=not interrupted, interrupted=interrupted)
        self._hold.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave what was written, marked as unfinished where an exception leaves the block."""
        if self._open:
            self._open = False
            self._write_meta({}, complete=False, interrupted=kind is not None and issubclass(kind, KeyboardInterrupt))
            self._hold.release()

    def _write_meta(self, more: JsonObject, *, complete: bool, interrupted: bool = False) -> None:
        meta = {**self._meta, **more, "complete": complete, "interrupted": interrupted}
        write_file(self.path / META_PART, (json.dumps(meta, indent=2) + "\n").encode())
        (self.path / META_PART).replace(self.path / META)


@names_checked
class RigDataset(TextFolder):
    """Reads the folder of a rig, each part of it read when it is first asked for.

    Attributes:
        path: of the folder.

    Raises:
        FileNotFoundError: if the path is not the folder of a rig.
        DecodeError: from any attribute, for a malformed file, naming it.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not is_rig_folder(self.path):
            raise FileNotFoundError(f"{self.path} is not the folder of a rig: there is no {RIG} in it")

    def __repr__(self) -> str:
        return f"<RigDataset {self.path}, {len(self.cameras)} cameras>"

    def _repr_html_(self) -> str:
        rows = []
        for number, camera in self.cameras.items():
            size, counts = camera.size, camera.meta.get("counts")
            events = counts.get("events") if isinstance(counts, dict) else None
            facts = ["sensor unknown" if size is None else f"{size[0]} x {size[1]} px"]
            facts += [f"{events:,} events"] if isinstance(events, int) else []
            facts += [f"{len(camera.frames):,} frames", f"{len(camera.depth_maps):,} depth maps"]
            rows.append((f"cam{number}", ", ".join(facts)))
        rows += [(f"imu{number}", f"{len(samples):,} samples") for number, samples in enumerate(self.imus)]
        if self.disparities:
            rows.append(("disparity", f"{len(self.disparities):,} maps of cam0 with cam1"))
        return html_table(f"RigDataset {self.path}", rows)

    @cached_property
    def rig(self) -> Rig:
        """Return the rig."""
        return read_rig_file(self.path / RIG)

    @cached_property
    def cameras(self) -> dict[int, Dataset]:
        """Return the cameras' datasets by number; a run of one camera of the rig has that one alone."""
        numbers = range(len(self.rig.cameras))
        folders = {number: camera_folder(self.path, number) for number in numbers}
        return {number: Dataset(folder) for number, folder in folders.items() if folder.is_dir()}

    @cached_property
    def imus(self) -> list[ImuArray]:
        """Return the samples of each IMU by the rig's clock, ``IMU_DTYPE``."""
        return [self._imu_samples(f"imu{number}.txt") for number in range(len(self.rig.imus))]

    @cached_property
    def disparities(self) -> list[StampedImage]:
        """Return the disparity maps of cam0 with cam1, stamped by cam0's clock."""
        return self._series(DISPARITIES)

    @cached_property
    def occlusions(self) -> list[StampedImage]:
        """Return the masks of what cam0 sees and cam1 does not, stamped by cam0's clock."""
        return self._series(OCCLUSIONS)

    def read_disparity(self, index: int) -> npt.NDArray[np.float32]:
        """Return disparity map ``index``: pixels of the rectified pair, to 1/256, float32 (H, W), NaN for none."""
        return decode_disparity(self._read_png(self.disparities[index].path, "I;16", "a 16-bit").astype(np.uint16))

    def read_occlusion(self, index: int) -> npt.NDArray[np.bool_]:
        """Return occlusion mask ``index``: (H, W), True where cam1 does not see the point."""
        return self._read_png(self.occlusions[index].path, "L", "an 8-bit") > 0

    def pairs(self, left: int = 0, right: int = 1) -> Iterator[tuple[int, int, StereoTruth]]:
        """Yield (index, t_us, truth) of each depth map of the left camera for which the right one has its own.

        ``t_us`` is by the left camera's clock.

        Raises:
            ValueError: as :meth:`stereo_truth`.
        """
        for index, depth_map in enumerate(self.cameras[left].depth_maps):
            if self._depth_of_instant(depth_map.t_us, left, right) is not None:
                yield index, depth_map.t_us, self.stereo_truth(index, left, right)

    def _depth_of_instant(self, t_us: int, left: int, right: int) -> int | None:
        """Return which depth map the right camera has of an instant of the left one's clock."""
        stamps = [each.t_us for each in self.cameras[right].depth_maps]
        stamp_us = self._stamp_of_right(t_us, left, right)
        return stamps.index(stamp_us) if stamp_us in stamps else None

    def _stamp_of_right(self, t_us: int, left: int, right: int) -> int:
        """Return what the right camera's clock shows when the left one's shows ``t_us``."""
        clocks = [self.rig.cameras[number].clock for number in (left, right)]
        at_us = round((t_us - clocks[0].offset_s * 1e6) / clocks[0].pace)
        return int(clocks[1].stamps_us([at_us])[0])

    def stereo_truth(self, index: int, left: int = 0, right: int = 1) -> StereoTruth:
        """Return disparity, occlusion and consistency of a pair at depth map ``index`` of the left camera.

        Args:
            index: of the left camera's depth maps.
            left, right: numbers of the cameras.

        Raises:
            ValueError: if a camera was not simulated, or the right one has no depth map of that instant.
        """
        for number in (left, right):
            if number not in self.cameras:
                raise ValueError(f"{self.path} has no cam{number}")
        t_us = self.cameras[left].depth_maps[index].t_us
        other = self._depth_of_instant(t_us, left, right)
        if other is None:
            stamp_us = self._stamp_of_right(t_us, left, right)
            raise ValueError(f"cam{right} has no depth map of the instant at which cam{left} has one, {stamp_us} us by "
                             "its clock: a disparity needs both")  # fmt: skip
        depths = self.cameras[left].read_depth(index), self.cameras[right].read_depth(other)
        return stereo_truth(self.rig, *depths, left, right)
