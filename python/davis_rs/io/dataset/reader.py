"""Reads a dataset folder: one of ours, or one of the public Event-Camera Dataset."""

from __future__ import annotations

import io
import json
import warnings
from functools import cached_property
from importlib import import_module
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.html_table import html_table
from ..._util.untrusted import decoding, read_charged, read_text
from ...events.arrays import EventArray
from ...events.packet import Displacement
from ...geometry.camera import Camera
from ...geometry.pose import Velocities
from ...sensor.imu import ImuArray
from ..formats.interface import TruncatedFileWarning
from ..formats.registry import format_of_content
from .files import (
    CALIBRATION,
    DEPTH_MAPS,
    DISPLACEMENTS,
    EVENT_FILES,
    EVENTS,
    FLOW_MAPS,
    FRAMES,
    GROUND_TRUTH,
    INERTIAL,
    LUMA_MAPS,
    MASKS,
    META,
    NORMAL_MAPS,
    RIG,
    SHAPE_NAMES,
    SIGNAL,
    VELOCITY,
    event_file,
    unfinished_told,
)
from .signal_file import read_signal
from .text_folder import PIXEL_BYTES, StampedImage, TextFolder


class Dataset(TextFolder):
    """Reads a dataset folder, each part of it read when it is first asked for.

    A part that the folder lacks is empty (``meta`` is then ``{}``), but for ``events`` and ``camera``, which raise
    FileNotFoundError. Times are parsed from text to integer microseconds without a float between; where a file of
    the public dataset has nanoseconds, to the nearest microsecond. In a dataset that was not completed, a last line
    without its newline is left out: its writer was killed in the middle of it.

    Raises:
        FileNotFoundError: if the path does not exist, or is a folder without any of a dataset's files.
        NotADirectoryError: if it is a file.
        DecodeError: from any attribute or method, for the first malformed line of a file or a malformed image, naming
            the file and the line.

    Source: Mueggler et al., IJRR 2017, section 5 (file formats).
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.is_file():
            raise NotADirectoryError(f"{self.path} is a file: a dataset is a folder with {EVENTS}, {META} and others")
        names = {entry.name for entry in self.path.iterdir()}
        if RIG in names:
            raise FileNotFoundError(
                f"{self.path} is the folder of a rig, each of whose cameras is a dataset, such as {self.path / 'cam0'}"
            )
        if names.isdisjoint({*EVENT_FILES.values(), META, CALIBRATION, GROUND_TRUTH, FRAMES.list_name}):
            said = f"{self.path} is not a dataset: none of {EVENTS}, {META}, {CALIBRATION}, ... in it"
            inside = next((name for name in sorted(names) if (self.path / name / META).is_file()), None)
            hint = "" if inside is None else f"; its folders are datasets, such as {self.path / inside}"
            raise FileNotFoundError(said + hint)

    @property
    def image_gain(self) -> float | None:
        """Return a frame's grey value over 255 x luma, from ``meta.json``; older ones call it ``exposure``. None: not
        known."""
        gain = self.meta.get("image_gain", self.meta.get("exposure"))
        return None if gain is None else float(gain)

    def __repr__(self) -> str:
        duration_us = self.meta.get("duration_us")
        facts = [str(self.path), "sensor unknown" if self.size is None else "{} x {} px".format(*self.size)]
        if isinstance(duration_us, int):
            facts.append(f"{duration_us / 1e6:.6g} s")
        return f"<Dataset {', '.join(facts)}>"

    def _repr_html_(self) -> str:
        duration_us, counts = self.meta.get("duration_us"), self.meta.get("counts")
        rows = [("sensor", "unknown" if self.size is None else "{} x {} px".format(*self.size))]
        if isinstance(duration_us, int):
            rows.append(("duration", f"{duration_us / 1e6:.6g} s"))
        if isinstance(counts, dict) and isinstance(counts.get("events"), int):
            rows.append(("events", f"{counts['events']:,}"))
        series = {
            "frames": self.frames,
            "depth maps": self.depth_maps,
            "flow maps": self.flow_maps,
            "masks": self.masks,
            "normal maps": self.normal_maps,
        }
        rows += [(name, f"{len(images):,}") for name, images in series.items() if images]
        return html_table(f"Dataset {self.path}", rows, below=self._html_pictures)

    @cached_property
    def _html_pictures(self) -> str:
        """Return the middle frame and the events around it, as HTML."""
        # What draws lies above files, so that it is not imported before a notebook shows a dataset.
        return str(import_module("davis_rs.inspection.dataset_picture").dataset_picture(self))

    @property
    def size(self) -> tuple[int, int] | None:
        """Return the sensor's (width, height): of ``meta.json``, else of the first frame; None if neither says."""
        return self._size_and_source[0]

    @property
    def size_source(self) -> Path | None:
        """Return the file that says :attr:`size`."""
        return self._size_and_source[1]

    @cached_property
    def _size_and_source(self) -> tuple[tuple[int, int], Path] | tuple[None, None]:
        if "sensor" in self.meta:
            path = self.path / META
            try:
                width, height = (int(self.meta["sensor"][name]) for name in ("width", "height"))
            except (KeyError, TypeError, ValueError, OverflowError):
                raise DecodeError(f'{path}: "sensor" must hold the numbers width and height') from None
            if not (1 <= width <= 65535 and 1 <= height <= 65535):
                raise DecodeError(f"{path}: 'sensor' must be 1..65535 pixels each way, found {width} x {height}")
            return (width, height), path
        listed = self.frames[0].path if self.frames else None
        frame = listed or next(iter(sorted((self.path / FRAMES.folder).glob(f"*{FRAMES.suffix}"))), None)
        if frame is not None and frame.exists():
            height, width = self._read_png(frame, "L", "an 8-bit").shape
            return (width, height), frame
        return None, None

    @cached_property
    def camera(self) -> Camera:
        """Return the calibration; its size is :attr:`size`, or 240 x 180 (the public dataset's) where nothing says
        it."""
        width, height = self.size or (240, 180)
        return Camera.from_calib(self.path / CALIBRATION, width=width, height=height)

    @cached_property
    def events(self) -> EventArray:
        """Return all events, ``EVENT_DTYPE``."""
        path = event_file(self.path)
        with unfinished_told(path):
            reader = format_of_content(path).open_reader(path)
        with warnings.catch_warnings(), reader:
            warnings.simplefilter("ignore" if self._unfinished else "error", TruncatedFileWarning)
            try:
                return reader.read()
            except TruncatedFileWarning as warning:
                raise DecodeError(str(warning)) from None

    @cached_property
    def signal(self) -> npt.NDArray[np.bool_]:
        """Return a label for each event, bool (n,): True for signal, False for noise; empty in a folder without labels.

        In a dataset that was not completed, the last events have none.
        """
        path = self.path / SIGNAL
        return read_signal(path) if path.exists() else np.zeros(0, np.bool_)

    @cached_property
    def frames(self) -> list[StampedImage]:
        """Return the intensity frames."""
        return self._series(FRAMES)

    @cached_property
    def depth_maps(self) -> list[StampedImage]:
        """Return the depth maps."""
        return self._series(DEPTH_MAPS)

    @cached_property
    def flow_maps(self) -> list[StampedImage]:
        """Return the maps of optical flow (the public dataset has none)."""
        return self._series(FLOW_MAPS)

    @cached_property
    def displacements(self) -> list[StampedImage]:
        """Return the maps of how far points go in the image (likewise)."""
        return self._series(DISPLACEMENTS)

    @cached_property
    def masks(self) -> list[StampedImage]:
        """Return the maps of shapes (likewise)."""
        return self._series(MASKS)

    @cached_property
    def normal_maps(self) -> list[StampedImage]:
        """Return the maps of surface normals (likewise)."""
        return self._series(NORMAL_MAPS)

    @cached_property
    def shape_names(self) -> tuple[str, ...]:
        """Return the names of the shapes in :attr:`masks`: number 1 is the first."""
        path = self.path / SHAPE_NAMES
        if not path.exists():
            return ()
        with decoding(path):
            names = json.loads(read_text(path))
        if not isinstance(names, dict) or list(names) != [str(k + 1) for k in range(len(names))]:
            raise DecodeError(f"{path}: expected names by the numbers 1, 2, ...")
        return tuple(map(str, names.values()))

    @cached_property
    def velocities(self) -> Velocities:
        """Return how the camera moves, in its own axes (the public dataset does not say)."""
        layout = "timestamp vx vy vz wx wy wz ax ay az dwx dwy dwz"
        t_us, values = self._stamped_rows(VELOCITY, layout, "velocities")
        return Velocities(t_us, *np.split(values, 4, axis=1))

    @cached_property
    def luma(self) -> list[StampedImage]:
        """Return the maps of exact linear luma (the public dataset has none)."""
        return self._series(LUMA_MAPS)

    @cached_property
    def imu(self) -> ImuArray:
        """Return the samples of the IMU, ``IMU_DTYPE``: m/s^2 and rad/s."""
        return self._imu_samples(INERTIAL)

    def _path_of(self, series: list[StampedImage], index: int, what: str) -> Path:
        try:
            return series[index].path
        except IndexError:
            raise IndexError(f"{self.path} has {len(series)} {what}s: there is none {index}") from None

    def read_image(self, index: int) -> npt.NDArray[np.uint8]:
        """Return intensity frame ``index``: uint8 (H, W)."""
        return self._read_png(self._path_of(self.frames, index, "frame"), "L", "an 8-bit")

    def read_depth(self, index: int) -> npt.NDArray[np.float32]:
        """Return depth map ``index``: z along the optical axis in metres, float32 (H, W), inf where nothing is hit."""
        return _read_exr(self._path_of(self.depth_maps, index, "depth map"), "Z")

    def read_flow(self, index: int) -> npt.NDArray[np.float32]:
        """Return flow map ``index``: pixels/s (x right, y down), float32 (H, W, 2), NaN where nothing is hit."""
        return _read_exr(self._path_of(self.flow_maps, index, "flow map"), "U", "V")

    def read_displacement(self, index: int) -> Displacement:
        """Return displacement map ``index``."""
        path = self._path_of(self.displacements, index, "displacement map")
        channels = _read_exr(path, "U", "V", "occluded")
        return Displacement(channels[..., :2], channels[..., 2] > 0)

    def read_mask(self, index: int) -> npt.NDArray[np.uint16]:
        """Return mask ``index``: the number of the shape that each pixel sees, uint16 (H, W), 0 for nothing."""
        return self._read_png(self._path_of(self.masks, index, "mask"), "I;16", "a 16-bit").astype(np.uint16)

    def read_normals(self, index: int) -> npt.NDArray[np.float32]:
        """Return normals ``index``: unit vectors in camera axes, float32 (H, W, 3), NaN where nothing is hit."""
        return _read_exr(self._path_of(self.normal_maps, index, "normal map"), "X", "Y", "Z")

    def read_luma(self, index: int) -> npt.NDArray[np.float32]:
        """Return luma map ``index``: linear luma, float32 (H, W)."""
        path = self._path_of(self.luma, index, "luma map")
        luma = _read_exr(path, "Y")
        wrong = ~((luma >= 0) & (luma < np.inf))
        if wrong.any():
            y, x = divmod(int(wrong.argmax()), luma.shape[1])
            raise DecodeError(f"{path}: luma must be finite and >= 0, found {luma[y, x]} at pixel ({x}, {y})")
        return luma


def _read_exr(path: Path, *names: str) -> npt.NDArray[np.float32]:
    """Return channels of an image, float32: (H, W) of one, (H, W, k) of several."""
    import OpenEXR

    budget = Budget(path)
    data = read_charged(path, budget)
    with decoding(path):
        # Its size before its pixels, for which it would take the memory.
        with OpenEXR.File(io.BytesIO(data), header_only=True) as file:
            low, high = (np.asarray(corner, np.int64) for corner in file.header()["dataWindow"])
            count = len(file.header()["channels"])
        if (high < low).any():
            raise DecodeError(f"{path}: an image must have pixels, found a window of {low} to {high}")
        width, height = (high - low + 1).tolist()
        budget.take(PIXEL_BYTES * width * height * count, f"{count} channels of {width} x {height} pixels")
        with OpenEXR.File(io.BytesIO(data)) as file:
            channels = dict(file.channels())
            pixels = [np.asarray(channels[name].pixels) for name in names if name in channels]
    if len(pixels) != len(names) or any(found.dtype != np.float32 for found in pixels):
        asked = f"a float32 channel {names[0]!r}" if len(names) == 1 else f"float32 channels {', '.join(names)}"
        raise DecodeError(f"{path}: expected {asked}, found {sorted(channels)}")
    return pixels[0] if len(names) == 1 else np.stack(pixels, -1)
