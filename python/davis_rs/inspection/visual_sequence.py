"""Opens what a figure or a video is drawn from: events, frames and depth of a folder, an event file or a recording."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._util.quantities import percent
from .._util.terminal_text import printable
from ..events.arrays import EventArray
from ..events.colour import PATTERNS, demosaic
from ..events.decoded import IMU_DTYPE, Frame
from ..geometry.camera import Camera
from ..geometry.pose import GroundTruth
from ..io.dataset.files import CALIBRATION
from ..io.dataset.folder_format import FolderReader
from ..io.dataset.reader import Dataset
from ..io.dataset.rig_folder import RigDataset, camera_folder, is_rig_folder
from ..io.files.read import open_reader
from ..io.files.sensor_size import sensor_size
from ..io.formats.recorded import RecordedParts
from ..io.recordings import Recording, whole_recording
from .dataset_description import describe_dataset
from .path_returns import return_note

_FRAME_WHITE = 65_535  # frames of a camera have 16 bits

FrameImage = npt.NDArray[np.float64]


def _no_poses() -> GroundTruth:
    return GroundTruth(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4)))


def _no_imu() -> npt.NDArray[np.void]:
    return np.zeros(0, IMU_DTYPE)


@dataclass(frozen=True, eq=False)
class VisualSequence:
    """Holds what can be drawn of a sequence; frames and depth maps are read when they are asked for.

    Attributes:
        label: one line for the figure: name, contrast threshold and sensor, as far as the source says them.
        size: (width, height) of the sensor in pixels.
        events: all events, in the order of time.
        start_us, end_us: the first and the last instant; times are the file's own, those of a recording count from
            its first one.
        frame_times, depth_times: in microseconds.
        read_frame: the frame of a number as linear light, float64 (height, width) in 0..1; full colour, (height, width,
            3), of a folder whose sensor has colour filters.
        read_depth: the depth map of a number in metres, float32 (height, width), inf where nothing is hit.
        flow_times, read_flow: likewise maps of optical flow, pixels per second, float32 (height, width, 2).
        mask_times, read_mask: likewise maps of shapes, uint16 (height, width), by numbers from 1 on in ``shape_names``.
        normal_times, read_normals: likewise surface normals, float32 (height, width, 3), in camera axes.
        disparity_times, read_disparity: likewise disparity of the first two cameras of a rig as the first one sees it,
            pixels, float32 (height, width), NaN for none.
        read_occlusion: where the second camera does not see what such a map shows, bool (height, width).
        read_imu: the inertial samples, :data:`davis_rs.IMU_DTYPE`; empty if there are none.
        read_poses: the camera's poses; empty if there are none.
        read_camera: the lens, None if the source does not say it.
        read_note: what is to be known of the rate of events, None for nothing.
    """

    label: str
    size: tuple[int, int]
    events: EventArray
    start_us: int
    end_us: int
    frame_times: Sequence[int] = ()
    depth_times: Sequence[int] = ()
    read_frame: Callable[[int], FrameImage] = field(default=lambda _: np.ones((1, 1)))
    read_depth: Callable[[int], npt.NDArray[np.float32]] = field(default=lambda _: np.ones((1, 1), np.float32))
    flow_times: Sequence[int] = ()
    read_flow: Callable[[int], npt.NDArray[np.float32]] = field(default=lambda _: np.ones((1, 1, 2), np.float32))
    mask_times: Sequence[int] = ()
    read_mask: Callable[[int], npt.NDArray[np.uint16]] = field(default=lambda _: np.ones((1, 1), np.uint16))
    shape_names: Sequence[str] = ()
    normal_times: Sequence[int] = ()
    read_normals: Callable[[int], npt.NDArray[np.float32]] = field(default=lambda _: np.ones((1, 1, 3), np.float32))
    disparity_times: Sequence[int] = ()
    read_disparity: Callable[[int], npt.NDArray[np.float32]] = field(default=lambda _: np.ones((1, 1), np.float32))
    read_occlusion: Callable[[int], npt.NDArray[np.bool_]] = field(default=lambda _: np.zeros((1, 1), np.bool_))
    read_imu: Callable[[], npt.NDArray[np.void]] = _no_imu
    read_poses: Callable[[], GroundTruth] = _no_poses
    read_camera: Callable[[], Camera | None] = field(default=lambda: None)
    read_note: Callable[[], str | None] = field(default=lambda: None)


def open_visual_sequence(path: str | Path, *, size: tuple[int, int] | None = None) -> VisualSequence:
    """Open whatever :func:`davis_rs.open_reader` opens: a dataset folder, an event file of any format, or a camera's
    recording. All events are held in memory, and the frames of a recording.

    Args:
        size: (width, height) of the sensor in pixels, where the file does not say.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: if nothing says how large the sensor is, ``size`` contradicts the file, or an event lies outside.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"a path is needed, got {type(path).__name__}: davis_rs.show draws arrays of events")
    path = Path(path)
    with open_reader(path) as reader:
        if isinstance(reader, FolderReader):
            return _of_dataset(reader.dataset, sensor_size(reader, size))
        if isinstance(reader, RecordedParts):
            return _of_recording(whole_recording(reader.recording).from_start(), sensor_size(reader, size))
        known, events = sensor_size(reader, size), reader.read()
    return _of_events(path, f"{path.name}, sensor {known[0]} x {known[1]}", known, events)


def nearest(times_us: Sequence[int], t_us: int) -> int | None:
    """Return the index of the time that is nearest, None where there is none."""
    return min(range(len(times_us)), key=lambda i: abs(times_us[i] - t_us), default=None)


def _label(dataset: Dataset, size: tuple[int, int]) -> str:
    """Return one line: the scene or else the folder's name, C, the sensor, and the share of noise."""
    said = describe_dataset(dataset)
    sensor = f"sensor {size[0]} x {size[1]}"
    if said.effects is not None:
        sensor += f", with {', '.join(said.effects)}" if said.effects else ", ideal"
    pattern = _pattern(dataset)
    if pattern is not None:
        sensor += f", {pattern} colour filter"
    noise = f"{percent(said.noise)} Monte Carlo noise" if said.noise else None
    facts = [said.scene or dataset.path.resolve().name, said.threshold, sensor, noise]
    return printable(", ".join(fact for fact in facts if fact))


def _pattern(dataset: Dataset) -> str | None:
    """Return the Bayer pattern before the pixels, as ``meta.json`` has it."""
    parameters = dataset.meta.get("parameters")
    filters = parameters.get("colour_filter") if isinstance(parameters, dict) else None
    pattern = filters.get("pattern") if isinstance(filters, dict) else None
    return pattern if pattern in PATTERNS else None


def _of_dataset(dataset: Dataset, size: tuple[int, int]) -> VisualSequence:
    frame_times = [image.t_us for image in dataset.frames]
    depth_times = [image.t_us for image in dataset.depth_maps]
    events = dataset.events
    _check_inside(events, size, dataset.path)
    pattern = _pattern(dataset)
    ends = [*frame_times[-1:], *depth_times[-1:], dataset.meta.get("duration_us") or 0]
    sequence = VisualSequence(
        _label(dataset, size),
        size,
        events,
        0,
        max([*ends, *events["t"][-1:].tolist()]),
        frame_times,
        depth_times,
        lambda number: _linear(dataset.read_image(number), pattern),
        dataset.read_depth,
        [image.t_us for image in dataset.flow_maps],
        dataset.read_flow,
        [image.t_us for image in dataset.masks],
        dataset.read_mask,
        tuple(map(printable, dataset.shape_names)),
        [image.t_us for image in dataset.normal_maps],
        dataset.read_normals,
        read_imu=lambda: dataset.imu,
        read_poses=lambda: dataset.groundtruth,
        read_camera=lambda: dataset.camera if (dataset.path / CALIBRATION).exists() else None,
        read_note=lambda: return_note(dataset),
    )
    if (pair := _stereo_pair(dataset)) is None:
        return sequence
    # A run that was killed may have written a map without its mask.
    both = min(len(pair.disparities), len(pair.occlusions))
    return replace(
        sequence,
        disparity_times=[image.t_us for image in pair.disparities[:both]],
        read_disparity=pair.read_disparity,
        read_occlusion=pair.read_occlusion,
    )


def _stereo_pair(dataset: Dataset) -> RigDataset | None:
    """Return the folder of the rig whose first camera has this dataset; None where there is none."""
    path = dataset.path.resolve()
    return RigDataset(path.parent) if is_rig_folder(path.parent) and path == camera_folder(path.parent, 0) else None


def _linear(frame: npt.NDArray[np.uint8], pattern: str | None) -> FrameImage:
    """Return a folder's frame in 0..1, in full colour where there is a Bayer pattern."""
    return np.asarray(frame if pattern is None else demosaic(frame, pattern), np.float64) / 255.0


def _of_recording(recording: Recording, size: tuple[int, int]) -> VisualSequence:
    path, frames = recording.path, recording.frames
    label = f"{path.name}, {recording.chip or recording.format}, sensor {size[0]} x {size[1]}"
    times = [frame.t for frame in frames]
    return _of_events(
        path, label, size, recording.events, times, lambda number: _whole(frames[number], size), lambda: recording.imu
    )


def _of_events(
    path: Path,
    label: str,
    size: tuple[int, int],
    events: EventArray,
    frame_times: Sequence[int] = (),
    read_frame: Callable[[int], FrameImage] = lambda _: np.ones((1, 1)),
    read_imu: Callable[[], npt.NDArray[np.void]] = _no_imu,
) -> VisualSequence:
    _check_inside(events, size, path)
    back = events["t"][1:] < events["t"][:-1]
    if back.any():
        at = int(back.argmax()) + 1
        raise ValueError(f"{path}: event {at} is earlier than the one before it: such times cannot be drawn")
    times = [*frame_times, *events["t"][:1].tolist(), *events["t"][-1:].tolist()]
    start_us, end_us = min(times, default=0), max(times, default=0)
    return VisualSequence(
        printable(label), size, events, start_us, end_us, frame_times, (), read_frame, read_imu=read_imu
    )


def _whole(frame: Frame, size: tuple[int, int]) -> FrameImage:
    """Return a camera's frame where it lies on the sensor, white around it."""
    width, height = size
    image = np.ones((height, width))
    visible = frame.pixels[: height - frame.y, : width - frame.x] / _FRAME_WHITE
    image[frame.y : frame.y + visible.shape[0], frame.x : frame.x + visible.shape[1]] = visible
    return image


def _check_inside(events: EventArray, size: tuple[int, int], path: Path) -> None:
    outside = (events["x"] >= size[0]) | (events["y"] >= size[1])
    if outside.any():
        at = int(outside.argmax())
        _, x, y, _ = events[at].tolist()
        raise ValueError(
            f"{path}: event {at} at (x, y) = ({x}, {y}) lies outside of the {size[0]} x {size[1]} sensor: is the size "
            "that of another camera?"
        )
