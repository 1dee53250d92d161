"""Reads any event file, or a dataset folder, as a sequence of windows."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean, names_checked
from ..._util.untrusted import MAX_PACKET_BYTES
from ...geometry.pose import GroundTruth, Pose
from ...io.dataset.files import LATEST_START_US
from ...io.dataset.reader import Dataset
from ...io.dataset.text_folder import StampedImage
from ...io.files.random_access import RandomAccess
from ...sensor.imu import IMU_DTYPE
from .cuts import CountCuts, Cuts, FrameCuts, TimeCuts, positive, windows_that_fit
from .window import EventWindow, WindowImages

By = Literal["time", "count", "frames"]


@names_checked
class EventWindows(Sequence[EventWindow]):
    """Windows of an event file or a dataset folder, read when they are asked for, in any order.

    ``windows[i]`` is an :class:`EventWindow`, whose events are a slice of the file's; ``windows[a:b:c]`` are the same
    windows, fewer of them. Of a folder, frames, depth, flow, displacements, masks, inertial samples and poses of the
    same stretch come with it. Where events are is found once: see docs/training.md for what that costs in each format.
    A window is read in bounded memory. Pickled windows are small and open the file again, so that worker processes can
    have them; threads may share them.

    Args:
        path: an event file or recording that can be read in parts (not: compressed .npz, bags without an index,
            rosbag2, a camera's bytes), or a dataset folder.
        by: ``"time"``: windows of ``duration_us``; ``"count"``: windows of ``count`` events; ``"frames"``: from each
            frame of a folder to the next one.
        duration_us: by time: how long a window is.
        stride_us: by time: from the start of one window to that of the next; ``duration_us`` if not given.
        count: by count: how many events a window has.
        stride: by count: from the first event of a window to that of the next, in events; ``count`` if not given.
        start_us, stop_us: only windows that lie within start_us <= t < stop_us. Where not given: from 0 in a folder
            whose events begin within an hour, to the end that its meta.json states; else from the first event to the
            last one.
        size: (width, height) of the sensor in pixels, where neither the file nor what lies next to it says.
        max_packet_bytes: see :func:`davis_rs.open_reader`.

    Attributes:
        size: (width, height) of the sensor in pixels, None where it is not known.
        dataset: the folder, None for a file.

    Only whole windows are made: what is left over at the end of a stream is in none. A window by count ends 1 us after
    its last event; events of equal time may lie in two of them. A window between frames has both frames, and depth,
    flow and masks of both instants; of displacements it has only those that begin before its end.

    Raises:
        OSError: if the file cannot be read.
        DecodeError: if it is malformed, its times go back, or it can only be read from its beginning.
        ValueError: for options that do not belong together, or a size that contradicts the file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        by: By = "time",
        *,
        duration_us: int | None = None,
        stride_us: int | None = None,
        count: int | None = None,
        stride: int | None = None,
        start_us: int | None = None,
        stop_us: int | None = None,
        size: tuple[int, int] | None = None,
        max_packet_bytes: int = MAX_PACKET_BYTES,
    ) -> None:
        given = {"duration_us": duration_us, "stride_us": stride_us, "count": count, "stride": stride}
        belong = {"time": {"duration_us", "stride_us"}, "count": {"count", "stride"}, "frames": set[str]()}
        if by not in belong:
            raise ArgumentError(
                "{by} must be one of {}: got {!r}{}", ", ".join(belong), by, did_you_mean(str(by), belong)
            )
        strange = [name for name, value in given.items() if value is not None and name not in belong[by]]
        if strange:
            raise ValueError(f"windows by {by} take no {', '.join(strange)}")
        self.path = Path(path)
        self.by = by
        if by == "frames" and not self.path.is_dir():
            raise ValueError(f"windows between frames need a dataset folder: {self.path} is a file")
        self._access = RandomAccess(path, size=size, max_packet_bytes=max_packet_bytes)
        self.dataset, self.size = self._access.dataset, self._access.size
        self._first_us, self._stop_us = self._limits(start_us, stop_us)
        if by == "frames" and stop_us is None:
            self._stop_us = 2**62  # frames tell where the last window ends
        if by == "time":
            duration_us = positive("duration_us", duration_us)
            stride_us = duration_us if stride_us is None else positive("stride_us", stride_us)
            number = windows_that_fit(self._stop_us - self._first_us, duration_us, stride_us)
            self._cuts: Cuts = TimeCuts(self._first_us, duration_us, stride_us, number)
        elif by == "count":
            count = positive("count", count)
            stride = count if stride is None else positive("stride", stride)
            first, stop = self._access.number_at(self._first_us), self._access.number_at(self._stop_us)
            self._cuts = CountCuts(first, count, stride, windows_that_fit(stop - first, count, stride))
        else:
            self._cuts = self._frame_cuts()
        self._numbers: Sequence[int] = range(len(self._cuts))

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, index: int) -> EventWindow: ...
    @overload
    def __getitem__(self, index: slice) -> EventWindows: ...
    def __getitem__(self, index: int | slice) -> EventWindow | EventWindows:
        if isinstance(index, slice):
            chosen = copy.copy(self)
            chosen._numbers = self._numbers[index]
            return chosen
        try:
            number = self._numbers[index]
        except IndexError:
            raise IndexError(f"{self.path} has {len(self)} windows: there is none {index}") from None
        start_us, end_us, events = self._cuts.window(self._access, number)
        return EventWindow(start_us, end_us, events, self.size, **self._of_folder(start_us, end_us))

    def __repr__(self) -> str:
        return f"<EventWindows of {self.path} by {self.by}, {len(self):,} windows, {self._access.events:,} events>"

    def with_images(self, *kinds: str) -> EventWindows:
        """Return the windows that have at least one image of each kind.

        Args:
            kinds: ``frames``, ``depth``, ``flow``, ``displacement`` or ``masks``.

        Raises:
            ValueError: for another kind, or windows of a file, which has no images.
        """
        strange = [kind for kind in kinds if kind not in IMAGE_KINDS]
        if strange:
            raise ValueError(f"images are {', '.join(IMAGE_KINDS)}, got {', '.join(strange)}")
        if self.dataset is None:
            raise ValueError(f"{self.path} is a file, which has no images: windows of a dataset folder may have some")
        of_kinds = [IMAGE_KINDS[kind] for kind in kinds]
        times = [(kind, _times(kind.of_folder(self.dataset))) for kind in of_kinds]

        def has_all(number: int) -> bool:
            bounds_us = self._cuts.bounds(self._access, number)
            return all(len(t_us[self._inside(kind, t_us, *bounds_us)]) for kind, t_us in times)

        chosen = copy.copy(self)
        chosen._numbers = [number for number in self._numbers if has_all(number)]
        return chosen

    def close(self) -> None:
        """Let go of the file; it is opened again when a window is asked for."""
        self._access.close()

    def _limits(self, start_us: int | None, stop_us: int | None) -> tuple[int, int]:
        """Return where the first window may begin, and the last one end."""
        first_us, last_us = self._access.first_us or 0, self._access.last_us
        end_us = first_us if last_us is None else last_us + 1
        if self.dataset is not None and first_us <= LATEST_START_US:
            first_us = 0
            duration_us = self.dataset.meta.get("duration_us")
            end_us = max(end_us, duration_us if isinstance(duration_us, int) else 0)
        return first_us if start_us is None else start_us, end_us if stop_us is None else stop_us

    def _frame_cuts(self) -> FrameCuts:
        assert self.dataset is not None
        t_us = _times(self.dataset.frames)
        if (np.diff(t_us) <= 0).any():
            raise ValueError(f"{self.path}: frames must follow each other in time, without two at one instant")
        return FrameCuts(t_us[(t_us >= self._first_us) & (t_us <= self._stop_us)])

    def _inside(self, kind: ImageKind, t_us: npt.NDArray[np.int64], start_us: int, end_us: int) -> slice:
        """Return which of a folder's images of a kind belong to a window.

        A window between frames has the images at its end as well, but no displacement that begins there: that one is
        the next window's.
        """
        until_us = end_us + 1 if self.by == "frames" and not kind.begins else end_us
        return slice(*np.searchsorted(t_us, (start_us, until_us)).tolist())

    def _images(self, folder: Dataset, kind: ImageKind, start_us: int, end_us: int) -> WindowImages[Any]:
        t_us = _times(kind.of_folder(folder))
        inside = self._inside(kind, t_us, start_us, end_us)
        return WindowImages(t_us[inside], inside.start, kind.reader(folder))

    def _of_folder(self, start_us: int, end_us: int) -> dict[str, Any]:
        """Return what a folder has of a window."""
        if (folder := self.dataset) is None:
            return {}
        imu, poses = folder.imu, folder.groundtruth
        samples = slice(*np.searchsorted(imu["t"], (start_us, end_us)))
        return {
            **{kind.field: self._images(folder, kind, start_us, end_us) for kind in IMAGE_KINDS.values()},
            "imu": imu[samples].copy() if len(imu) else np.zeros(0, IMU_DTYPE),
            "start_pose": _pose_at(poses, start_us),
            "end_pose": _pose_at(poses, end_us),
        }


class ImageKind(NamedTuple):
    """Describes one kind of a folder's images.

    Attributes:
        field: of :class:`EventWindow`, which has them.
        of_folder: returns all of a folder.
        reader: returns what reads the image of a number in a folder.
        dtype: of an image's values.
        channels: (2,) for images (H, W, 2); () for (H, W).
        begins: whether an image is of the time that begins at its instant, not of the instant.
    """

    field: str
    of_folder: Callable[[Dataset], list[StampedImage]]
    reader: Callable[[Dataset], Callable[[int], Any]]
    dtype: npt.DTypeLike
    channels: tuple[int, ...] = ()
    begins: bool = False


IMAGE_KINDS = {
    "frames": ImageKind("frames", lambda folder: folder.frames, lambda folder: folder.read_image, np.uint8),
    "depth": ImageKind("depth_maps", lambda folder: folder.depth_maps, lambda folder: folder.read_depth, np.float32),
    "flow": ImageKind("flow_maps", lambda folder: folder.flow_maps, lambda folder: folder.read_flow, np.float32, (2,)),
    "displacement": ImageKind(
        "displacements",
        lambda folder: folder.displacements,
        lambda folder: folder.read_displacement,
        np.float32,
        (2,),
        begins=True,
    ),
    "masks": ImageKind("masks", lambda folder: folder.masks, lambda folder: folder.read_mask, np.uint16),
}
"""The images that windows of a folder have, by what users call them."""


def _times(images: list[StampedImage]) -> npt.NDArray[np.int64]:
    return np.array([image.t_us for image in images], np.int64)


def _pose_at(poses: GroundTruth, t_us: int) -> Pose | None:
    """Return the pose at an instant between the first and the last one."""
    after = int(np.searchsorted(poses.t_us, t_us))
    if after == len(poses.t_us):
        return None
    if poses.t_us[after] == t_us:
        return Pose(poses.positions[after], poses.quaternions[after])
    if after == 0:
        return None
    from scipy.spatial.transform import Rotation, Slerp

    span_us = poses.t_us[after - 1 : after + 1]
    fraction = float(t_us - span_us[0]) / float(span_us[1] - span_us[0])
    position = poses.positions[after - 1] * (1 - fraction) + poses.positions[after] * fraction
    arc = Slerp([0.0, 1.0], Rotation.from_quat(poses.quaternions[after - 1 : after + 1]))
    return Pose(position, arc(fraction).as_quat())
