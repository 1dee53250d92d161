"""Checks of arguments that many functions share: numbers in a range, sizes of sensors, objects of a kind."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TypeGuard

from .argument_error import ArgumentError
from .close_names import did_you_mean


def is_number(value: object, *, whole: bool = False) -> TypeGuard[float]:
    """Tell whether a value is one number, an integer where it must be ``whole``; a truth value is none."""
    single = not isinstance(value, bool) and getattr(value, "shape", ()) == ()
    return single and hasattr(value, "__index__" if whole else "__float__")


def check_number(
    argument: str,
    value: object,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above_low: bool = False,
    whole: bool = False,
    unit: str = "",
) -> None:
    """Refuse what is no finite number in ``low..high``.

    Args:
        argument: that has the value.
        above_low: ``low`` itself is not allowed.
        whole: it must be an integer.
        unit: of the number.

    Raises:
        ArgumentError: with the rule and the value.
    """
    inside = is_number(value, whole=whole) and math.isfinite(value) and low <= value <= high
    if inside and not (above_low and value == low):
        return
    single = is_number(value, whole=whole)
    least = "" if low == -math.inf else f"{'>' if above_low else '>='} {_written(low)}"
    if high < math.inf:
        range_text = f"{least} and at most {_written(high)}" if above_low else f"in {_written(low)}..{_written(high)}"
    else:
        range_text = least
    if whole:
        rule = f"be an integer {range_text}"
    elif not single:
        rule = "be a number"
    elif high < math.inf:
        rule = f"be {range_text}" if above_low else f"lie {range_text}"
    else:
        rule = f"be finite and {range_text}" if range_text else "be finite"
    ending = f" {unit}" if unit and single else ""
    got = value if single else repr(value)
    raise ArgumentError("{argument} must {}{}, got {}", rule.rstrip(), ending, got, argument=argument)


def _written(bound: float) -> str:
    """Write a bound as people do."""
    return str(int(bound)) if bound == int(bound) else f"{bound:g}"


SIZES: Mapping[str, tuple[int, int]] = {
    "davis240c": (240, 180),
    "davis346": (346, 260),
    "davis640": (640, 480),
    "dvs128": (128, 128),
    "dvxplorer": (640, 480),
    "dvxplorer-lite": (320, 240),
    "evk3": (640, 480),
    "evk4": (1280, 720),
    "genx320": (320, 320),
}
"""Sizes by camera, as (width, height) in pixels. Sources: iniVation's specifications; Prophesee's of Gen3.1 (in the
EVK3), IMX636 (in the EVK4) and GenX320."""


def parse_size(size: Sequence[int] | str | None, argument: str = "size") -> tuple[int, int] | None:
    """Return (width, height) from ``WxH``, a camera's name in :data:`SIZES` or a pair; None stays None.

    Raises:
        ArgumentError: for something else, or sides outside of 1..65535.
    """
    return None if size is None else as_size(size, argument)


def as_size(size: Sequence[int] | str, argument: str = "size") -> tuple[int, int]:
    """Return (width, height) from ``WxH``, a camera's name in :data:`SIZES` or a pair.

    Raises:
        ArgumentError: for something else, or sides outside of 1..65535.
    """
    pair: Sequence[int] | str = size
    if isinstance(size, str) and size in SIZES:
        pair = SIZES[size]
    elif isinstance(size, str):
        match = re.fullmatch(r"(\d{1,5})\s*[xX]\s*(\d{1,5})", size.strip())
        if match is None:
            raise ArgumentError(
                "{argument} must be WIDTHxHEIGHT in pixels, 1..65535 each, such as 346x260, or a camera's name, "
                "such as evk4, got {!r}{}",
                *(size, did_you_mean(size, SIZES)),
                argument=argument,
            )
        pair = (int(match[1]), int(match[2]))
    if not hasattr(pair, "__len__") or len(pair) != 2 or not all(is_number(side, whole=True) for side in pair):
        raise ArgumentError(
            "{argument} must be two integers, width and height in pixels, got {!r}", size, argument=argument
        )
    width, height = int(pair[0]), int(pair[1])
    if not (1 <= width <= 65535 and 1 <= height <= 65535):
        raise ArgumentError(
            "{argument} must lie in 1..65535 pixels each way, got {} x {}", width, height, argument=argument
        )
    return width, height


def parse_roi(roi: str) -> tuple[int, int, int, int]:
    """Return (x0, y0, x1, y1) of ``WxH+X+Y``, in pixels: x0 <= x < x1 and y0 <= y < y1 lie inside.

    Raises:
        ArgumentError: for something else, or sides outside of 1..65535.
    """
    match = re.fullmatch(r"(\d{1,5}[xX]\d{1,5})\+(\d{1,5})\+(\d{1,5})", roi.strip())
    if match is None:
        raise ArgumentError("{roi} must be WIDTHxHEIGHT+LEFT+TOP in pixels, such as 346x260+100+50, got {!r}", roi)
    width, height = as_size(match[1], "roi")
    left, top = int(match[2]), int(match[3])
    return left, top, left + width, top + height


def check_type(argument: str, value: object, kind: type | tuple[type, ...], hint: str) -> None:
    """Refuse an object of another kind.

    Args:
        hint: how one of the right kind is made.

    Raises:
        TypeError: naming the argument, what it must be and what it is.
    """
    if not isinstance(value, kind):
        kinds = " or ".join(wanted.__name__ for wanted in (kind if isinstance(kind, tuple) else (kind,)))
        raise TypeError(f"{argument} must be {kinds}, got {type(value).__name__}; {hint}")
