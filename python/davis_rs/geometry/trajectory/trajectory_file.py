"""Reads trajectory files: the public dataset's ``groundtruth.txt`` (TUM), and ESIM's CSV."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from ..._core import DecodeError
from ..._util.close_names import names_checked
from ..._util.untrusted import read_text
from .sampled_trajectory import SampledTrajectory, SampleError

MAX_STAMP_NS = 2**62
"""The largest stamp, in the year 2116 of Unix time, so that the difference of any two stamps fits an int64."""

FARTHEST_M = 1e9
"""The largest coordinate: splines through larger numbers have no digits left for a camera's motion."""

_LONGEST_NUMBER = 400


@names_checked
def read_trajectory(
    path: str | Path,
    *,
    position_sigma_m: float | None = None,
    rotation_sigma_rad: float | None = None,
    max_gap_s: float = 0.1,
) -> SampledTrajectory:
    """Read a trajectory file, told apart by its content, as a smooth path whose first sample is t = 0.

    - ``timestamp px py pz qx qy qz qw``, separated by blanks, in seconds: the public dataset's ``groundtruth.txt`` and
      TUM's format. Stamps may be Unix time: they are read as decimals, exact to the nanosecond.
    - ``timestamp, x, y, z, qx, qy, qz, qw``, separated by commas, in integer nanoseconds: ESIM's CSV.

    Lines that are empty or begin with ``#`` are skipped, and so is a CSV's header. A header that puts qw before qx
    (EuRoC's order) is refused; without a header that order cannot be told.

    Noise that is not given is estimated from the samples (``davis_rs.geometry.trajectory.sample_noise.pose_noise``).
    It is 0, so that the path goes through every sample, where nothing is to be seen beyond the rounding to the file's
    digits, where noise cannot be told from motion, and with fewer than 40 samples.
    :meth:`SampledTrajectory.smoothing` says what was done, and by how much it moved the path.

    On the public dataset's hand-held poster_6dof (200 Hz) the estimates are 0.58 mm and 3.9 mrad. The path then has
    tops of 2.78 m/s, 1,158 deg/s and 54 m/s^2, where a spline through every sample has 3.5 m/s, 1,690 deg/s (in a
    glitch) and 1,400 m/s^2. The paper's tops, 2.51 m/s and 937 deg/s (Mueggler et al., IJRR 2017, table of sequences),
    are within 2 % those of the mean motion over 100 ms (:meth:`Trajectory.top_speeds`); the momentary rate must be
    higher, since the raw poses turn at 1,076 deg/s over eight samples.

    Args:
        path: the file.
        position_sigma_m, rotation_sigma_rad: as for :class:`SampledTrajectory`; None estimates them. Give 0 for poses
            that are exact, such as a simulator's, should the estimate say otherwise.
        max_gap_s: as for :class:`SampledTrajectory`.

    Returns:
        The trajectory. Its ``describe()`` holds the file's name, ``sha256`` and ``start_time_ns``, the first stamp.

    Raises:
        OSError: if the file cannot be read.
        DecodeError: where the file breaks a rule, naming file, line, rule and text: columns, numbers, unit quaternions,
            increasing times, gaps (see :class:`SampledTrajectory`).
        ValueError: for a sigma or ``max_gap_s`` out of range.
    """
    text = read_text(path)

    names: list[str] = []
    stamps_ns: list[int] = []
    words: list[list[str]] = []
    values: list[list[float]] = []
    for name, stamp_ns, seven, numbers in _samples(path, text):
        names.append(name)
        stamps_ns.append(stamp_ns)
        words.append(seven)
        values.append(numbers)
    if len(names) < 2:
        raise DecodeError(f"{path}: a trajectory needs at least 2 samples, found {len(names)}")

    samples = np.array(values)
    try:
        return SampledTrajectory(
            # Integers first: float64 seconds of Unix time are only good to 0.2 us.
            np.array([stamp - stamps_ns[0] for stamp in stamps_ns]) / 1e9,
            samples[:, :3],
            samples[:, 3:],
            position_sigma_m=position_sigma_m,
            rotation_sigma_rad=rotation_sigma_rad,
            position_step_m=_last_digit(word for seven in words for word in seven[:3]),
            quaternion_step=_last_digit(word for seven in words for word in seven[3:]),
            max_gap_s=max_gap_s,
            start_time_ns=stamps_ns[0],
            sample_name=names.__getitem__,
            description={
                "file": Path(path).name,
                "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest(),
            },
        )
    except SampleError as error:
        raise DecodeError(str(error)) from None


def _samples(path: str | Path, text: str) -> Iterator[tuple[str, int, list[str], list[float]]]:
    """Yield for each sample its name in messages, its stamp in nanoseconds, and its seven numbers as text and as
    floats."""
    separator: str | None = None
    started = False
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        where = f"{path}, line {number}"
        if not started and line[:1].isalpha() and "," in line:
            line = "#" + line  # a CSV's header
        if not line or line.startswith("#"):
            if not started:
                _check_header(where, line)
            continue
        if not started:
            started, separator = True, "," if "," in line else None
        words = [word.strip() for word in line.split(separator)]
        if len(words) != 8:
            raise DecodeError(f"{where}: expected 8 columns (timestamp and pose), found {len(words)}: {line!r}")
        stamp_ns = _seconds_to_ns(where, words[0]) if separator is None else _integer_ns(where, words[0])
        yield f"{where} (stamp {words[0]})", stamp_ns, words[1:], [_number(where, word) for word in words[1:]]


def _check_header(where: str, line: str) -> None:
    names = [name for name in re.split(r"[#,\s]+", line) if re.fullmatch(r"q\w*[xyzw]", name, re.IGNORECASE)]
    if [name[-1].lower() for name in names[:2]] == ["w", "x"]:
        raise DecodeError(f"{where}: the quaternion must be in the order qx qy qz qw, but the header is {line!r}")


def _last_digit(words: Iterable[str]) -> float:
    """Return the place value of the last digit of the number that has most of them: 0.001 for 1.5 and 2.125."""
    finest = min(int(Decimal(word).as_tuple().exponent) for word in words)
    return 10.0**finest


def _number(where: str, word: str) -> float:
    if len(word) > _LONGEST_NUMBER:
        raise DecodeError(f"{where}: a number may have {_LONGEST_NUMBER} characters, found {len(word)}")
    try:
        value = float(word)
    except ValueError:
        raise DecodeError(f"{where}: {word!r} is not a number") from None
    if not np.isfinite(value):
        raise DecodeError(f"{where}: every number must be finite, found {word!r}")
    if abs(value) > FARTHEST_M:
        raise DecodeError(f"{where}: positions must lie within +-1e9 m, found {word!r}")
    return value


def _seconds_to_ns(where: str, word: str) -> int:
    if len(word) > _LONGEST_NUMBER:
        raise DecodeError(f"{where}: a number may have {_LONGEST_NUMBER} characters, found {len(word)}")
    try:
        seconds = Decimal(word)
    except InvalidOperation:
        raise DecodeError(f"{where}: {word!r} is not a number") from None
    if not seconds.is_finite():
        raise DecodeError(f"{where}: every number must be finite, found {word!r}")
    # Not abs(), which rounds, and overflows where the exponent is large.
    if seconds.copy_abs() > MAX_STAMP_NS // 10**9:
        raise DecodeError(f"{where}: a stamp must be in seconds, below 4.6e9, found {word!r}")
    return round(seconds * 10**9)


def _integer_ns(where: str, word: str) -> int:
    if not re.fullmatch(r"[+-]?[0-9]{1,19}", word) or abs(int(word)) > MAX_STAMP_NS:
        raise DecodeError(
            f"{where}: a comma-separated file's stamps must be integer nanoseconds, below 4.6e18, found {word!r}"
        )
    return int(word)
