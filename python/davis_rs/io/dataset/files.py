"""Names the files of a dataset folder, and writes them so that what is there can always be read."""

from __future__ import annotations

import errno
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError, OverwriteError
from ..._util.array_types import JsonObject
from ..._util.holding import Hold
from ...events.arrays import EventArray
from ...geometry.pose import Pose
from ..formats import FORMATS
from ..formats.destination import naming, part_of


def is_plan_folder(path: str | Path) -> bool:
    """Return whether a path is the folder of a plan's sequences, and no dataset itself."""
    return (Path(path) / PLAN).is_file() and not (Path(path) / META).exists()


@dataclass(frozen=True)
class ImageSeries:
    """Holds a time-stamped series of images in a dataset folder: a text list and a folder of numbered files."""

    list_name: str
    folder: str
    suffix: str

    def image_name(self, number: int) -> str:
        """Return the path inside the dataset folder of image ``number``, as the list names it."""
        return f"{self.folder}/frame_{number:08d}{self.suffix}"


FRAMES = ImageSeries("images.txt", "images", ".png")
DEPTH_MAPS = ImageSeries("depthmaps.txt", "depthmaps", ".exr")
LUMA_MAPS = ImageSeries("luma.txt", "luma", ".exr")
FLOW_MAPS = ImageSeries("flow.txt", "flow", ".exr")
DISPLACEMENTS = ImageSeries("displacement.txt", "displacement", ".exr")
DISPLACEMENT_PNGS = ImageSeries("displacement_png.txt", "displacement_png", ".png")
MASKS = ImageSeries("masks.txt", "masks", ".png")
NORMAL_MAPS = ImageSeries("normals.txt", "normals", ".exr")
DISPARITIES = ImageSeries("disparity.txt", "disparity", ".png")
OCCLUSIONS = ImageSeries("occlusion.txt", "occlusion", ".png")
"""The last two belong to a rig's folder."""
IMAGE_SERIES = (
    *(FRAMES, DEPTH_MAPS, LUMA_MAPS, FLOW_MAPS, DISPLACEMENTS, DISPLACEMENT_PNGS, MASKS, NORMAL_MAPS),
    *(DISPARITIES, OCCLUSIONS),
)
VELOCITY, SHAPE_NAMES = "velocity.txt", "shapes.json"
EVENT_TRUTH = {"h5": "event_truth.h5", "npz": "event_truth.npz"}
SIGNAL = "signal.npy"
EVENTS, GROUND_TRUTH, INERTIAL = "events.txt", "groundtruth.txt", "imu.txt"
CALIBRATION, META = "calib.txt", "meta.json"
KALIBR_IMU, KALIBR_CAMERA_CHAIN = "imu.yaml", "camchain.yaml"
RIG = "rig.yaml"
"""Marks the folder of a rig, whose cameras are datasets in ``cam0``, ``cam1``, ..."""

PLAN = "plan.json"
"""Marks the folder of a plan's sequences, each of which is a dataset."""

_CAMERA_FOLDER = re.compile(r"cam(0|[1-9][0-9]*)")
_RIG_IMU_FILES = re.compile(r"imu(0|[1-9][0-9]*)\.(txt|yaml)")
META_PART = META + ".part"

LATEST_START_US = 3_600_000_000
"""A folder whose times begin later has those of a clock, such as Unix times, in place of times from its start."""


EVENT_FILES = {
    "text": EVENTS,
    "npy": "events.npy",
    "npz": "events.npz",
    "evt2": "events.evt2.raw",
    "evt3": "events.raw",
    "aedat4": "events.aedat4",
    "dsec": "events.h5",
    "e2vid": "events.e2vid.h5",
    "parquet": "events.parquet",
    "aedat2": "events.aedat",
}
"""The event file of a folder, by its format; the first one that is there is read."""

CLAIMED = b'{"complete": false}\n'
"""The ``meta.json`` of a folder whose writer has not said more yet."""


def check_event_format(format: str, size: tuple[int, int]) -> None:
    """Refuse what is no format of a folder's event file, one that cannot hold the sensor, and one whose library is not
    there.

    Raises:
        ValueError, ImportError: saying what there is, or what to install.
    """
    if format not in EVENT_FILES:
        raise ArgumentError("{events_format} must be one of {}: got {!r}", ", ".join(EVENT_FILES), format)
    FORMATS[format].limits.check_size(format, size)
    FORMATS[format].require_libraries()


def event_file(folder: Path) -> Path:
    """Return the folder's event file; where there is none, the one that a killed writer left unfinished, as NAME.part;
    ``events.txt`` where there is nothing at all."""
    whole = [folder / name for name in EVENT_FILES.values()]
    unfinished = [part_of(path) for path in whole]
    return next((path for path in (*whole, *unfinished) if path.is_file()), folder / EVENTS)


@contextmanager
def unfinished_told(path: Path) -> Iterator[None]:
    """Say, where an event file that a killed writer left cannot be opened, why, and what can be done.

    Raises:
        DecodeError: for a file that is in no format that can be read in part.
    """
    try:
        yield
    except DecodeError as error:
        if path.suffix != part_of(path).suffix:
            raise
        advice = "its other files can be read; make the dataset again, with overwrite (--overwrite)"
        raise DecodeError(f"{error}. The writer of this folder was killed: {advice}") from None


class EventFile:
    """Holds the events of a folder: a file of one format, ``events.txt`` for text.

    Text is cut back on closing to the last packet that was written whole. The other formats keep their own promises
    (docs/formats.md): a packet that is refused leaves nothing.
    """

    def __init__(self, folder: Path, format: str, size: tuple[int, int]) -> None:
        self.count = self.on_count = self._size = 0
        self.path = folder / EVENT_FILES[format]
        self._is_text = format == "text"
        self._writer = FORMATS[format].open_writer(
            self.path, (65_535, 65_535) if self._is_text else size, overwrite=False
        )

    def write(self, events: EventArray) -> None:
        self._writer.write(events)
        size = self.path.stat().st_size if self._is_text else 0
        # One assignment, so that an interrupt finds the three numbers of one packet.
        self.count, self.on_count, self._size = (
            self.count + len(events),
            self.on_count + int(np.count_nonzero(events["p"])),
            size,
        )

    def flush(self) -> None:
        self._writer.flush()

    def close(self) -> None:
        try:
            self._writer.finish()
        finally:
            if self._is_text:
                os.truncate(self.path, self._size)


class ImageFiles:
    """Writes the files of one image series; an image is listed once it is whole."""

    def __init__(self, root: Path, series: ImageSeries) -> None:
        self.count = 0
        self._root = root
        self._series = series

    def write(self, t_us: int, data: bytes) -> None:
        name = self._series.image_name(self.count)
        if self.count == 0:
            (self._root / self._series.folder).mkdir(exist_ok=True)
        write_file(self._root / name, data)
        append_lines(self._root / self._series.list_name, f"{stamp(t_us)} {name}\n")
        self.count += 1


def stamp(t_us: int) -> str:
    """Return a time in microseconds as the text formats write it: seconds with nine decimals, by integer arithmetic."""
    return f"{t_us // 1_000_000}.{t_us % 1_000_000:06d}000"


def pose_line(t_us: int, pose: Pose) -> str:
    return " ".join([stamp(t_us), *(repr(float(v)) for v in (*pose.position, *pose.quaternion))]) + "\n"


def stamped_line(t_us: int, values: npt.NDArray[np.float64]) -> str:
    """Return a time and values (n,), written exactly."""
    return " ".join([stamp(t_us), *map(repr, values.tolist())]) + "\n"


def as_grey(frame: npt.NDArray[np.float32], image_gain: float) -> npt.NDArray[np.uint8]:
    """Return linear luma as an 8-bit frame: round(255 x image_gain x luma), clipped."""
    return np.rint(np.minimum(255 * image_gain * frame.astype(np.float64), 255)).astype(np.uint8)


def encode_png(grey: npt.NDArray[np.uint8 | np.uint16]) -> bytes:
    """Return a grey image (H, W) of 8 or 16 bits."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(grey).save(stream, "PNG")
    return stream.getvalue()


def encode_exr(channels: Mapping[str, npt.NDArray[np.float32]]) -> bytes:
    """Return images (H, W) by the names of their channels."""
    import OpenEXR

    # Into memory: OpenEXR's own file errors have no errno.
    stream = io.BytesIO()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(image) for name, image in channels.items()}).write(stream)
    return stream.getvalue()


def write_file(path: Path, data: bytes) -> None:
    try:
        with naming(path):
            path.write_bytes(data)
    except OSError:
        with suppress(OSError):
            path.unlink()
        raise


def append_lines(path: Path, lines: str) -> None:
    """Append whole lines to a text file, or none of them."""
    size = path.stat().st_size if path.exists() else 0
    try:
        with naming(path), path.open("ab") as file:
            file.write(lines.encode())
    except BaseException:
        with suppress(OSError):
            os.truncate(path, size)
        raise


def as_json(meta: Mapping[str, object]) -> JsonObject:
    """Return ``meta`` as it will read back from JSON."""
    loaded: JsonObject = json.loads(json.dumps(meta, default=_plain, allow_nan=False))
    return loaded


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"meta.json cannot hold {value!r} ({type(value).__name__})")


def claim_folder(path: Path, *, overwrite: bool) -> Hold:
    """Make ``path`` a dataset folder for one writer alone, empty but for a ``meta.json`` that says so, or refuse.

    A ``meta.json`` is there from the first moment to the last. So whenever the writer is killed, the next one finds a
    dataset that may be replaced.
    """
    if not path.is_dir():
        require_folder_room(path, overwrite=overwrite)
    path.mkdir(parents=True, exist_ok=True)
    hold = Hold(path)
    require_folder_room(path, overwrite=overwrite)
    write_file(path / META_PART, CLAIMED)
    (path / META_PART).replace(path / META)
    _remove_parts(path)
    return hold


def require_folder_room(path: Path, *, overwrite: bool) -> None:
    """Refuse a path where something is, but for an empty folder, or one with a dataset that may be replaced.

    Raises:
        FileExistsError: naming the path.
    """
    if not path.exists():
        return
    if not path.is_dir():
        raise FileExistsError(errno.EEXIST, "a file is in the way of the dataset folder", str(path))
    if not any(path.iterdir()):
        return
    if not ((path / META).is_file() and (event_file(path).is_file() or (path / RIG).is_file() or _is_claimed(path))):
        raise FileExistsError(
            errno.EEXIST,
            f"the folder is not empty, and there is no dataset in it (no {EVENTS} and {META}): choose another",
            str(path),
        )
    if not overwrite:
        raise OverwriteError(path, "the folder is not empty; {overwrite:True} replaces a dataset in it")


def _is_claimed(path: Path) -> bool:
    """Return whether a writer was killed before it had an event file."""
    meta = path / META
    return meta.stat().st_size == len(CLAIMED) and meta.read_bytes() == CLAIMED


def remove_dataset(path: Path) -> None:
    """Remove the files that a dataset consists of, and nothing else."""
    _remove_parts(path)
    # What marks the folder as a dataset goes last, so that an overwrite that was cut short can be repeated.
    (path / META).unlink(missing_ok=True)


def _remove_parts(path: Path) -> None:
    """Remove all of a dataset, or of a rig's datasets, but its ``meta.json``."""
    if (path / RIG).is_file():
        _remove_rig_parts(path)
    for series in IMAGE_SERIES:
        folder = path / series.folder
        if folder.is_symlink():  # the link is the dataset's, what it leads to is not
            folder.unlink()
        elif folder.is_dir():
            for image in folder.iterdir():
                if re.fullmatch(rf"frame_\d{{8,}}{re.escape(series.suffix)}", image.name):
                    image.unlink()
            with suppress(OSError):  # other files in it: it stays, with them
                folder.rmdir()
        (path / series.list_name).unlink(missing_ok=True)
    for leftover in path.glob(f"{EVENT_TRUTH['npz']}.part*"):  # of a run that was killed
        leftover.unlink()
    for name in EVENT_FILES.values():
        part_of(path / name).unlink(missing_ok=True)
    # The events go last: together with what describes them they mark the folder as a dataset.
    texts = (GROUND_TRUTH, INERTIAL, VELOCITY, SHAPE_NAMES, KALIBR_IMU, KALIBR_CAMERA_CHAIN, CALIBRATION)
    for name in (*texts, SIGNAL, *EVENT_TRUTH.values(), META_PART, *EVENT_FILES.values()):
        (path / name).unlink(missing_ok=True)


def _remove_rig_parts(path: Path) -> None:
    """Remove what a rig's folder has in addition to a dataset's: its cameras' datasets, and its IMUs' files."""
    for entry in list(path.iterdir()):
        if _CAMERA_FOLDER.fullmatch(entry.name) and (entry / META).is_file():
            if entry.is_symlink():  # the link is the rig's, what it leads to is not
                entry.unlink()
                continue
            remove_dataset(entry)
            with suppress(OSError):  # other files in it: it stays, with them
                entry.rmdir()
        elif _RIG_IMU_FILES.fullmatch(entry.name):
            entry.unlink()
    (path / RIG).unlink(missing_ok=True)
