"""Reads stamps of frames from arrays, text files and frame rates, in integer nanoseconds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from itertools import count
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.argument_checks import check_number
from ..._util.argument_error import ArgumentError
from ..._util.untrusted import decoding, read_text, regular_file

IntArray = npt.NDArray[np.int64]

TIME_UNITS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1000, "ns": 1}
"""Nanoseconds in each unit that stamps may have."""

_LARGEST_NS = 2**62


def rate_stamps(fps: float) -> Iterator[int]:
    """Yield stamps of frames at a fixed rate, from 0 on.

    Raises:
        ValueError: for a rate that is not positive and finite, or so low that the second frame would have no stamp of
            64 bits; from the iterator for the first frame that would have none.
    """
    check_number("fps", fps, 0, above_low=True)
    # A rate such as 29.97 stands for 30000/1001; rounded to nanoseconds, neither drifts against the other's text.
    period_ns = Fraction(1_000_000_000) / Fraction(str(fps))
    if period_ns >= _LARGEST_NS:
        raise ArgumentError("{fps} must be above {:.3g}, so that stamps fit 64 bits of nanoseconds, got {}",
                            1e9 / _LARGEST_NS, fps)  # fmt: skip
    return (_within_64_bits(round(number * period_ns), number, fps) for number in count())


def _within_64_bits(t_ns: int, number: int, fps: float) -> int:
    if t_ns >= _LARGEST_NS:
        raise ArgumentError("frame {} at {fps:{}} has no stamp that fits 64 bits of nanoseconds", number, fps)
    return t_ns


def read_stamps(path: str | Path, unit: str | None = None) -> IntArray:
    """Read stamps of a file: one a line of text (the first word; ``#`` begins a comment), or a ``.npy`` array.

    Args:
        unit: s, ms, us or ns. By default text has decimal seconds, an array of floating point seconds, and an array of
            integers microseconds. Text without a decimal point anywhere needs the unit: 33333 may be anything.

    Returns:
        Nanoseconds, int64 (n,).

    Raises:
        OSError: if the file cannot be read.
        DecodeError: for a malformed line or array.
        ValueError: for an unknown unit, or one that is needed.
    """
    check_unit(unit)
    path = Path(path)
    if path.suffix == ".npy":
        with decoding(path):
            times = np.load(regular_file(path), mmap_mode="r", allow_pickle=False)
        return as_stamps(times, unit, f"{path}")
    lines = text_lines(read_text(path))
    if unit is None and lines and not any("." in words[0] for _, words in lines):
        raise ArgumentError(
            "{} has stamps without a decimal point, whose unit is not certain: give {time_unit} s, ms, us or ns", path
        )
    return np.array([parse_stamp(words[0], path, number, unit or "s") for number, words in lines], np.int64)


def as_stamps(times: npt.ArrayLike, unit: str | None, name: str) -> IntArray:
    """Convert numbers to nanoseconds (n,): integers are microseconds, floating point seconds, unless the unit says
    else.

    Raises:
        ValueError: for another shape or type, a value that is not finite or out of range, or an unknown unit.
    """
    check_unit(unit)
    array = np.asarray(times)
    if array.ndim != 1 or not (np.issubdtype(array.dtype, np.integer) or np.issubdtype(array.dtype, np.floating)):
        raise ValueError(f"{name}: stamps must be one row of numbers, got {array.dtype} of shape {array.shape}")
    whole = bool(np.issubdtype(array.dtype, np.integer))
    factor = TIME_UNITS[unit or ("us" if whole else "s")]
    with np.errstate(over="ignore", invalid="ignore"):
        wrong = ~(np.abs(array.astype(np.float64) * factor) < _LARGEST_NS)
    if wrong.any():
        at = int(wrong.argmax())
        raise ValueError(f"{name}: stamp {at} must be finite and fit 64 bits of nanoseconds, got {array[at]}")
    if whole:
        return np.asarray(array, np.int64) * factor
    return np.asarray(np.rint(array.astype(np.float64) * factor), np.int64)


def check_unit(unit: str | None) -> None:
    """Refuse a unit that is not known.

    Raises:
        ValueError: naming those there are.
    """
    if unit is not None and unit not in TIME_UNITS:
        raise ArgumentError("{time_unit} must be one of {}, got {!r}", ", ".join(TIME_UNITS), unit)


def parse_stamp(word: str, path: Path, line: int, unit: str) -> int:
    """Parse a decimal number as nanoseconds in integer arithmetic, to the nearest (halves up).

    Raises:
        DecodeError: for something else.
    """
    match = re.fullmatch(r"([0-9]{1,18})(?:\.([0-9]{0,30}))?(?:[eE]([+-]?[0-9]{1,2}))?", word)
    value = Fraction(word) * TIME_UNITS[unit] if match else Fraction(-1)
    if not 0 <= value < _LARGEST_NS:
        raise DecodeError(f"{path}, line {line}: expected a time in {unit}, found {word[:40]!r}")
    return math.floor(value + Fraction(1, 2))


def text_lines(text: str) -> list[tuple[int, list[str]]]:
    """Yield the numbered lines in words, without comments and empty lines; a comma separates words too."""
    split = (
        (number, line.partition("#")[0].replace(",", " ").split()) for number, line in enumerate(text.splitlines(), 1)
    )
    return [(number, words) for number, words in split if words]
