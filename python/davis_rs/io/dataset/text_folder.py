"""Reads what the folders of a camera and of a rig have in common: ``meta.json``, stamped lines, stamped images."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.array_types import JsonObject, UncheckedArray
from ..._util.budget import Budget
from ..._util.untrusted import decoding, read_charged, read_text
from ...geometry.pose import GroundTruth
from ...sensor.imu import IMU_DTYPE, ImuArray
from .files import GROUND_TRUTH, META, ImageSeries

PIXEL_BYTES = 8
"""Of a value of an image: as it is decoded, and in an array."""


class StampedImage(NamedTuple):
    """Holds one image of a series: its time in microseconds and its file."""

    t_us: int
    path: Path


class TextFolder:
    """Reads the texts of a folder; a part that it lacks is empty."""

    path: Path

    @cached_property
    def meta(self) -> JsonObject:
        """Return the contents of ``meta.json``."""
        path = self.path / META
        if not path.exists():
            return {}
        text = read_text(path)
        try:
            meta = json.loads(text)
        except json.JSONDecodeError as error:
            raise DecodeError(f"{path}, line {error.lineno}: {error.msg}") from None
        except (RecursionError, ValueError) as error:  # nested too deeply, or a number of too many digits
            raise DecodeError(f"{path}: {error}") from None
        if not isinstance(meta, dict):
            raise DecodeError(f"{path}: expected a JSON object, found {type(meta).__name__}")
        _check_meta(path, meta)
        return meta

    @cached_property
    def groundtruth(self) -> GroundTruth:
        """Return the poses."""
        t_us, poses = self._stamped_rows(GROUND_TRUTH, "timestamp px py pz qx qy qz qw", "poses")
        return GroundTruth(t_us, poses[:, :3], poses[:, 3:])

    @property
    def _unfinished(self) -> bool:
        return self.meta.get("complete") is False

    def _imu_samples(self, name: str) -> ImuArray:
        """Return the samples of a text file of an IMU."""
        t_us, values = self._stamped_rows(name, "timestamp ax ay az gx gy gz", "IMU samples")
        samples = np.zeros(len(t_us), IMU_DTYPE)
        samples["t"], samples["accel"], samples["gyro"] = t_us, values[:, :3], values[:, 3:]
        return samples

    def _stamped_rows(
        self, name: str, layout: str, quantity: str
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Return a text file of stamps and numbers: times (n,) and numbers (n, k)."""
        path = self.path / name
        times, rows = [], []
        for number, words in self._lines(name, layout):
            times.append(parse_stamp(words[0], path, number))
            try:
                row = [float(word) for word in words[1:]]
            except ValueError as error:
                raise DecodeError(f"{path}, line {number}: {error}") from None
            if not all(map(math.isfinite, row)):
                raise DecodeError(f"{path}, line {number}: {quantity} must be finite")
            rows.append(row)
        return np.array(times, np.int64), np.array(rows, np.float64).reshape(-1, len(layout.split()) - 1)

    def _series(self, series: ImageSeries) -> list[StampedImage]:
        path = self.path / series.list_name
        images = []
        for number, words in self._lines(series.list_name, f"timestamp {series.folder}/name{series.suffix}"):
            name = PurePosixPath(words[1])
            if "\0" in words[1] or name.is_absolute() or ".." in name.parts:
                raise DecodeError(f"{path}, line {number}: expected a file of this folder, found {words[1][:60]!r}")
            images.append(StampedImage(parse_stamp(words[0], path, number), self.path / name))
        return images

    def _read_png(self, path: Path, mode: str, kind: str) -> UncheckedArray:
        """Return a grey image of a mode of Pillow."""
        from PIL import Image

        budget = Budget(path)
        data = read_charged(path, budget)
        with decoding(path), Image.open(io.BytesIO(data)) as image:
            budget.take(PIXEL_BYTES * image.width * image.height, f"an image of {image.width} x {image.height} pixels")
            actual, pixels = image.mode, np.array(image)
        if actual != mode:
            raise DecodeError(f"{path}: expected {kind} grey image, found mode {actual}")
        return pixels

    def _lines(self, name: str, layout: str) -> Iterator[tuple[int, list[str]]]:
        """Yield the numbered lines of a text file, in words; none where it is missing. '#' starts a comment line."""
        path = self.path / name
        if not path.exists():
            return
        text = read_text(path)
        if self._unfinished:
            text = text[: text.rfind("\n") + 1]
        for number, line in enumerate(text.splitlines(), 1):
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if len(words) != len(layout.split()):
                raise DecodeError(f"{path}, line {number}: expected '{layout}', found {line[:60]!r}")
            yield number, words


_META_TYPES: dict[str, tuple[type, ...]] = {
    "sensor": (dict,),
    "complete": (bool,),
    "interrupted": (bool,),
    "duration_us": (int,),
    "counts": (dict,),
    "parameters": (dict,),
    "effects": (dict,),
    "davis_rs": (str,),
    "model": (int,),
    "monte_carlo_noise": (dict,),
}
"""Of what is read from ``meta.json``; null stands for what is not known."""
_POSITIVE_PARAMETERS = ("contrast_threshold", "contrast_threshold_off", "log_eps")
_RATES = ("frame_rate_hz", "depth_rate_hz")
"""0 stands for none."""


def _check_meta(path: Path, meta: JsonObject) -> None:
    """Refuse values of types that nobody expects."""
    for key, types in _META_TYPES.items():
        value = meta.get(key)
        if value is not None and (not isinstance(value, types) or (bool not in types and isinstance(value, bool))):
            raise DecodeError(f"{path}: {key!r} must be of type {types[0].__name__}, found {value!r:.60}")
    if not -(2**63) <= (meta.get("duration_us") or 0) < 2**63:
        raise DecodeError(f"{path}: 'duration_us' must fit 64 bits, found {meta['duration_us']!r:.60}")
    share = (meta.get("monte_carlo_noise") or {}).get("share")
    if share is not None and not (_is_number(share) and 0 <= share < _LARGEST_PARAMETER):
        raise DecodeError(f"{path}: the share of 'monte_carlo_noise' must be a number >= 0, found {share!r:.60}")
    parameters = meta.get("parameters") or {}
    for key in (*_POSITIVE_PARAMETERS, *_RATES):
        value = parameters.get(key)
        number = _is_number(value)
        if value is None or (number and 0 < value < _LARGEST_PARAMETER) or (number and value == 0 and key in _RATES):
            continue
        rule = "a number >= 0" if key in _RATES else "a positive number"
        raise DecodeError(f"{path}: the parameter {key!r} must be {rule}, found {value!r:.60}")


_LARGEST_PARAMETER = 1e12


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def parse_stamp(word: str, path: Path, number: int) -> int:
    """Convert decimal seconds to microseconds in integer arithmetic, to the nearest (halves up)."""
    match = re.fullmatch(r"([0-9]{1,12})(?:\.([0-9]{1,18}))?", word)
    if match is None:
        raise DecodeError(f"{path}, line {number}: expected a time in decimal seconds, found {word[:40]!r}")
    seconds, decimals = match[1], (match[2] or "").ljust(7, "0")
    return int(seconds + decimals[:6]) + (decimals[6] >= "5")
