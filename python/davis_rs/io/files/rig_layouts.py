"""Converts the folder of a rig to what stereo data sets are published as: DSEC's folder, MVSEC's HDF5, one ROS bag."""

from __future__ import annotations

import heapq
import os
import shutil
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError, OverwriteError
from ..._util.close_names import names_checked
from ..._util.extras import from_extra
from ..._util.whole_file import Workplace
from ...geometry.pose import FloatArray
from ...sensor.rig import Rectification, Rig, rectify
from ..dataset.disparity_png import encode_disparity
from ..dataset.folder_format import part_counts
from ..dataset.reader import Dataset
from ..dataset.rig_folder import RigDataset
from ..formats import ros_messages as topics
from ..formats.parts import CAMERA, DEPTH
from .conversion import ConversionReport, LeftOutWarning, convert, left_out_line

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader

SIDES = ("left", "right")
LAYOUTS = ("dsec", "mvsec", "bag")
_MARK = Path("events", "left", "events.h5")
"""What marks a folder as DSEC's, which may be replaced."""

_DSEC_NUMBERS = (0, 3)
"""DSEC's numbers of its event cameras; 1 and 2 are cameras of frames."""

MVSEC_TOPICS = {
    topics.EVENTS.name: "events",
    topics.IMAGES.name: "image_raw",
    topics.CAMERA.name: "camera_info",
    topics.INERTIAL.name: "imu",
    topics.POSES.name: "pose",
    topics.DEPTH.name: "depth_image_raw",
    topics.FLOW.name: "optic_flow",
}
"""The topics of one camera's bag, and MVSEC's names of them after ``/davis/left/``; it has none of flow."""


@dataclass(frozen=True)
class RigConversionReport:
    """Says what a conversion of a rig has written.

    Attributes:
        path: the file or folder.
        layout: ``dsec``, ``mvsec`` or ``bag``.
        events: of each side, left and right.
        disparities: how many disparity maps; 0 but for ``dsec``.
        left_out: what the cameras have and the layout does not hold; empty where nothing is lost.
    """

    path: Path
    layout: str
    events: tuple[int, int]
    disparities: int
    left_out: str


@names_checked
def convert_rig(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    layout: str | None = None,
    left: int = 0,
    right: int = 1,
    overwrite: bool = False,
    progress: Callable[[float], object] | None = None,
) -> RigConversionReport:
    """Convert two cameras of a rig's folder to the layout of a published stereo data set.

    >>> convert_rig("pair", "pair_dsec")
    >>> convert_rig("pair", "pair.bag")

    - ``dsec``: a folder with ``events/left/events.h5``, ``rectify_map.h5`` next to it, the same of the right camera,
      ``disparity/event/000000.png`` (16 bits, 256 steps a pixel, 0 for none, in the rectified left camera),
      ``disparity/timestamps.txt`` (microseconds) and ``calibration/cam_to_cam.yaml``. ``ms_to_idx`` reaches one
      millisecond beyond the sequence's end, so that windows up to it can be read.
    - ``mvsec``: one HDF5 file, with ``davis/left`` and ``davis/right`` as ``io/formats/mvsec.py`` has them.
    - ``bag``: one bag of ROS 1 with MVSEC's topics: ``/davis/left/events`` and so on.

    The target gets its name when it is whole. Stamps are those of each camera's own clock.

    Args:
        source: the folder of a rig.
        target: a file, or for ``dsec`` a folder.
        layout: by the target's suffix if not given: ``.bag``, ``.hdf5`` or ``.h5`` (MVSEC's), none (DSEC's).
        left, right: numbers of the cameras.
        overwrite: whether an existing target may be replaced; of folders, one in DSEC's layout alone.
        progress: is told the fraction that is done, 0..1.

    Returns:
        what was written.

    Raises:
        ValueError: for another layout, cameras that were not simulated, and for ``dsec``: two clocks, no events, or
            cameras that cannot be rectified.
        ImportError: if a library is missing, with the extra that brings it.
        OSError, DecodeError: if the source cannot be read, or the target not be written.

    Sources: Gehrig et al., "DSEC", RA-L 2021, and uzh-rpg/DSEC (README, scripts/dataset); Zhu et al., "The
    Multivehicle Stereo Event Camera Dataset", RA-L 2018, and daniilidis-group/mvsec (data format).
    """
    target = Path(target)
    layout = _layout_of(target, layout)
    dataset = RigDataset(Path(source))
    numbers = left, right
    for number in numbers:
        dataset.rig.checked_index(number)
        if number not in dataset.cameras:
            raise ValueError(f"{dataset.path} has no cam{number}")
    if left == right:
        raise ArgumentError("{left} and {right} must be two cameras, got {} twice", left)
    folders = [dataset.cameras[number].path for number in numbers]
    told = progress or (lambda fraction: None)
    write = {"dsec": _write_dsec, "mvsec": _write_mvsec, "bag": _write_bag}[layout]
    workplace = Workplace(
        target,
        require_room=lambda: _require_room(target, layout, overwrite=overwrite),
        make_room=lambda: shutil.rmtree(target) if target.is_dir() else None,
    )
    try:
        events, disparities, left_out = write(dataset, numbers, folders, workplace.working_path, told)
        workplace.put()
    except BaseException as error:
        workplace.discard(error)
        raise
    told(1.0)
    if left_out:
        warnings.warn(left_out_line(target, layout, left_out), LeftOutWarning, 2)
    return RigConversionReport(target, layout, events, disparities, left_out)


def _layout_of(target: Path, layout: str | None) -> str:
    """Return the layout that is asked for, or that a suffix stands for."""
    if layout is None:
        layout = {"": "dsec", ".bag": "bag", ".hdf5": "mvsec", ".h5": "mvsec"}.get(target.suffix.lower())
        if layout is None:
            raise ArgumentError("no {layout} of a rig ends in {!r}: give one of {}", target.suffix, ", ".join(LAYOUTS))
    if layout not in LAYOUTS:
        raise ArgumentError("{layout} of a rig must be one of {}, got {!r}", ", ".join(LAYOUTS), layout)
    return layout


def _require_room(target: Path, layout: str, *, overwrite: bool) -> None:
    """Refuse a target where something is that may not be replaced."""
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return
    if not overwrite:
        raise OverwriteError(target, "it exists; {overwrite:True} replaces it")
    if target.is_dir() and not (layout == "dsec" and (target / _MARK).is_file()):
        raise FileExistsError(f"will not replace the folder {target}: it is not in DSEC's layout")
    if target.is_file() and layout == "dsec":
        raise FileExistsError(f"a file is in the way of the folder {target}")


Progress = Callable[[float], object]
Written = tuple[tuple[int, int], int, str]
"""Events of each side, disparity maps, what is left out."""


def _converted(source: Path, target: Path, layout: str, told: Progress, **options: Any) -> ConversionReport:
    """Convert one camera; what is left out is told with both."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LeftOutWarning)
        return convert(source, target, format=layout, progress=told, **options)


def _left_out(reports: Sequence[ConversionReport]) -> str:
    return "; ".join(f"{side} {each.left_out}" for side, each in zip(SIDES, reports, strict=True) if each.left_out)


def _part(told: Progress, first: float, last: float) -> Progress:
    return lambda fraction: told(first + (last - first) * fraction)


def _write_dsec(
    dataset: RigDataset, numbers: tuple[int, int], folders: list[Path], target: Path, told: Progress
) -> Written:
    import yaml

    with from_extra("hdf5"):
        import h5py
    rig = dataset.rig
    clocks = [rig.cameras[number].clock for number in numbers]
    if clocks[0] != clocks[1]:
        raise ValueError(f"{dataset.path}: DSEC's layout has one clock for both cameras, but those of "
                         f"cam{numbers[0]} and cam{numbers[1]} differ")  # fmt: skip
    rectified = rectify(rig, *numbers)
    events = []
    for step, (side, folder) in enumerate(zip(SIDES, folders, strict=True)):
        side_folder = target / "events" / side
        side_folder.mkdir(parents=True)
        told_side = _part(told, 0.4 * step, 0.4 * (step + 1))
        report = _converted(folder, side_folder / "events.h5", "dsec", told_side, parts=())
        if not report.events:
            raise ValueError(f"{folder} has no events: DSEC's layout cannot say when it begins")
        events.append(report.events)
        _lengthen_index(side_folder / "events.h5", Dataset(folder))
        rotation = (rectified.left_rotation, rectified.right_rotation)[step]
        lens = rig.cameras[numbers[step]].camera
        grid = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), -1)
        rays = np.concatenate([lens.rays(grid), np.ones((*grid.shape[:2], 1))], -1)
        with h5py.File(side_folder / "rectify_map.h5", "w") as file:
            file["rectify_map"] = rectified.camera.project(rays @ rotation.T).astype(np.float32)
    (target / "calibration").mkdir()
    text = yaml.safe_dump(_cam_to_cam(rig, numbers, rectified), sort_keys=False, default_flow_style=None)
    (target / "calibration" / "cam_to_cam.yaml").write_text(text)
    (target / "disparity" / "event").mkdir(parents=True)
    stamps: list[int] = []
    maps = len(dataset.cameras[numbers[0]].depth_maps)
    for index, t_us, truth in dataset.pairs(*numbers):
        png = encode_disparity(_warped(truth.disparity, rectified.left_map))
        (target / "disparity" / "event" / f"{len(stamps):06d}.png").write_bytes(png)
        stamps.append(t_us)
        told(0.8 + 0.2 * (index + 1) / maps)
    (target / "disparity" / "timestamps.txt").write_text("".join(f"{t_us}\n" for t_us in stamps))
    # Depth is in the disparity, and the calibration in cam_to_cam.yaml.
    kept = {DEPTH.counted, CAMERA.counted}
    counts = [part_counts(dataset.cameras[number]) for number in numbers]
    left_out = "; ".join(
        f"{side} " + ", ".join(f"{count:,} {what}" for what, count in of_side.items() if count and what not in kept)
        for side, of_side in zip(SIDES, counts, strict=True)
    )
    return (events[0], events[1]), len(stamps), left_out


def _lengthen_index(path: Path, camera: Dataset) -> None:
    """Give ``ms_to_idx`` entries up to the end of the sequence and one more, for windows that end after all events.

    What lies behind the last event begins at the number of events.
    """
    import h5py

    with h5py.File(path, "r+") as file:
        index, count = np.asarray(file["ms_to_idx"]), len(file["events/t"])
        offset_us = int(file["t_offset"][()])
        end_us = max(int(camera.meta.get("duration_us") or 0) - offset_us, int(file["events/t"][-1]))
        entries = max(end_us, 0) // 1000 + 2
        if entries > len(index):
            del file["ms_to_idx"]
            file["ms_to_idx"] = np.append(index, np.full(entries - len(index), count, index.dtype))


def _warped(image: npt.NDArray[np.float32], lookup: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return an image seen by a virtual camera: the nearest pixel's value, because disparities must not be mixed."""
    height, width = image.shape
    x, y = (np.rint(np.nan_to_num(lookup[..., axis], nan=-1.0)).astype(np.int64) for axis in (0, 1))
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return np.where(inside, image[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], np.float32(np.nan))


def _cam_to_cam(rig: Rig, numbers: tuple[int, int], rectified: Rectification) -> dict[str, Any]:
    """Return what DSEC's calibration file has of its event cameras."""
    virtual = rectified.camera
    intrinsics: dict[str, Any] = {}
    extrinsics: dict[str, Any] = {}
    rotations = rectified.left_rotation, rectified.right_rotation
    for number, own, rotation in zip(numbers, _DSEC_NUMBERS, rotations, strict=True):
        lens = rig.cameras[number].camera
        intrinsics[f"cam{own}"] = {
            "camera_matrix": [lens.fx, lens.fy, lens.cx, lens.cy],
            "camera_model": "pinhole",
            "distortion_coeffs": [float(value) for value in lens.distortion[:4]],
            "distortion_model": "radtan",
            "resolution": [lens.width, lens.height],
        }
        intrinsics[f"camRect{own}"] = {
            "camera_matrix": [virtual.fx, virtual.fy, virtual.cx, virtual.cy],
            "camera_model": "pinhole",
            "resolution": [virtual.width, virtual.height],
        }
        extrinsics[f"R_rect{own}"] = _rows(rotation)
    extrinsics["T_30"] = _rows(rig.relative_pose(numbers[1], numbers[0]).matrix)
    to_points = [[1, 0, 0, -virtual.cx], [0, 1, 0, -virtual.cy], [0, 0, 0, virtual.fx]]
    to_depth = {"cams_03": _rows(np.array([*to_points, [0, 0, 1 / rectified.baseline_m, 0]]))}
    return {"intrinsics": intrinsics, "extrinsics": extrinsics, "disparity_to_depth": to_depth}


def _rows(matrix: FloatArray) -> list[list[float]]:
    return [[float(value) for value in row] for row in matrix]


def _write_mvsec(
    dataset: RigDataset, numbers: tuple[int, int], folders: list[Path], target: Path, told: Progress
) -> Written:
    with from_extra("hdf5"):
        import h5py
    left = _converted(folders[0], target, "mvsec", _part(told, 0.0, 0.45))
    alone = target.with_name(f"{target.name}.right.hdf5")
    right = _converted(folders[1], alone, "mvsec", _part(told, 0.45, 0.9))
    with h5py.File(target, "r+") as file, h5py.File(alone, "r") as other:
        other.copy("davis/left", file["davis"], name="right")
    alone.unlink()
    return (left.events, right.events), 0, _left_out((left, right))


def _write_bag(
    dataset: RigDataset, numbers: tuple[int, int], folders: list[Path], target: Path, told: Progress
) -> Written:
    with from_extra("ros"):
        from rosbags.rosbag1 import Reader, Writer
    bags: list[Path] = []
    reports: list[ConversionReport] = []
    for step, (side, folder) in enumerate(zip(SIDES, folders, strict=True)):
        bags.append(target.with_name(f"{side}.bag"))
        told_side = _part(told, 0.3 * step, 0.3 * (step + 1))
        reports.append(_converted(folder, bags[-1], "bag", told_side, frame_id=f"davis_{side}"))
    with ExitStack() as stack:
        readers = [stack.enter_context(Reader(bag)) for bag in bags]
        writer = stack.enter_context(Writer(target))
        connections = {}
        for side, reader in zip(SIDES, readers, strict=True):
            for each in reader.connections:
                name = f"/davis/{side}/{MVSEC_TOPICS[each.topic]}"
                connections[side, each.topic] = writer.add_connection(
                    name, each.msgtype, msgdef=each.msgdef.data, md5sum=each.digest, callerid="/davis_rs"
                )
        total = sum(reader.message_count for reader in readers)
        merged = heapq.merge(*map(_messages, SIDES, readers), key=lambda message: message[1])
        for done, (side, t_ns, connection, data) in enumerate(merged, 1):
            writer.write(connections[side, connection.topic], t_ns, data)
            told(0.6 + 0.4 * done / total)
    for bag in bags:
        bag.unlink()
    return (reports[0].events, reports[1].events), 0, _left_out(reports)


def _messages(side: str, reader: Reader) -> Iterator[tuple[str, int, Connection, bytes]]:
    """Yield the messages of a bag, in order of time."""
    for connection, t_ns, data in reader.messages():
        yield side, t_ns, connection, bytes(data)
