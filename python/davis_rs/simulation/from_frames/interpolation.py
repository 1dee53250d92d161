"""Interpolates light from one frame to the next, as samples for the crossing engine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from .colour_light import ColourLight
from .light import LumaFrame


class SensorFrame(NamedTuple):
    """Holds a frame as the sensor sees it.

    Attributes:
        t_us: microseconds.
        luma: linear luma (H, W), float32, that the pixels see, each through its own filter.
        where: the file and the frame, for messages.
        colours: what all pixels would see through each filter; None for a sensor without colour.
    """

    t_us: int
    luma: LumaFrame
    where: str
    colours: ColourLight | None = None

    @property
    def grey(self) -> LumaFrame:
        """Return light in which the image's motion can be seen, without the pattern of filters (H, W)."""
        return self.luma if self.colours is None else self.colours.grey

    @property
    def planes(self) -> Sequence[LumaFrame]:
        """Return what moves with the image: luma, or that through each filter, (H, W) each."""
        return (self.luma,) if self.colours is None else self.colours.light

    def seen(self, planes: Sequence[LumaFrame]) -> LumaFrame:
        """Return luma (H, W) that the pixels see of such planes."""
        return planes[0] if self.colours is None else self.colours.seen(planes)


class Sample(NamedTuple):
    """Holds light at an instant.

    Attributes:
        t_us: microseconds.
        luma: linear luma (H, W), float32.
        rate: dY/dt in luma per second (H, W), float32, where log intensity runs along cubics; NaN for a line.
        frame: the frame whose instant this is; None between two frames.
    """

    t_us: int
    luma: LumaFrame
    rate: LumaFrame | None
    frame: SensorFrame | None


class Interpolation(ABC):
    """Decides what lies between frames.

    Attributes:
        engine: what the crossing engine does between two samples: ``linear`` or ``hermite``.
    """

    engine: ClassVar[str]

    @abstractmethod
    def samples(self, frames: Iterator[SensorFrame]) -> Iterator[Sample]:
        """Samples in the order of time: one at each frame, and any between two."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Return the rule and what it has found so far, for meta.json."""

    def findings(self) -> Iterator[str]:
        """Say what it found, a line each, for people."""
        return iter(())


class Linear(Interpolation):
    """Log intensity runs straight from frame to frame: what the engine does by itself."""

    engine = "linear"

    def samples(self, frames: Iterator[SensorFrame]) -> Iterator[Sample]:
        return (Sample(frame.t_us, frame.luma, None, frame) for frame in frames)

    def describe(self) -> dict[str, object]:
        return {"rule": "linear"}


class Cubic(Interpolation):
    """Log intensity runs along monotone cubics: as Hermite's, with slopes from the frame before and the one after.

    The slope at a frame is the weighted harmonic mean of those of the lines on either side, and 0 at an extremum, so
    that nothing rises above or falls below what the frames show. At the first and the last frame it is the line's.

    Source: Fritsch and Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM J. Sci.
    Stat. Comput. 5(2), 1984.
    """

    engine = "hermite"

    def __init__(self, log_eps: float) -> None:
        self._log_eps = np.float32(log_eps)

    def samples(self, frames: Iterator[SensorFrame]) -> Iterator[Sample]:
        return (Sample(frame.t_us, frame.luma, rate, frame) for frame, rate in with_rates(frames, self._log_eps))

    def describe(self) -> dict[str, object]:
        return {"rule": "cubic"}


def with_rates(frames: Iterator[SensorFrame], log_eps: np.float32) -> Iterator[tuple[SensorFrame, LumaFrame]]:
    """Yield each frame with its rate dY/dt (H, W), in luma per second; one frame is looked ahead.

    Where the next frame cannot be had, the frame before it still comes, as the last one does; then the error is raised.
    """
    last: SensorFrame | None = None
    chord: LumaFrame | None = None  # dL/dt of the line before the last frame
    length = 0.0
    log = np.zeros(0, np.float32)
    failed: Exception | None = None
    try:
        for frame in frames:
            new_log = np.log(frame.luma + log_eps)
            if last is not None:
                new_length = (frame.t_us - last.t_us) * 1e-6
                new_chord = (new_log - log) / np.float32(new_length)
                slope = new_chord if chord is None else _monotone(chord, length, new_chord, new_length)
                yield last, slope * (last.luma + log_eps)
                chord, length = new_chord, new_length
            last, log = frame, new_log
    except Exception as error:
        failed = error
    if last is not None:
        yield last, np.zeros_like(last.luma) if chord is None else chord * (last.luma + log_eps)
    if failed is not None:
        raise failed


def _monotone(before: LumaFrame, before_s: float, after: LumaFrame, after_s: float) -> LumaFrame:
    """Return Fritsch and Butland's slope between two lines of these slopes and lengths."""
    w, v = 2 * after_s + before_s, after_s + 2 * before_s
    p, q = np.float32(w / (w + v)), np.float32(v / (w + v))
    product = before * after
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = product / (p * after + q * before)
    return np.where(product > 0, slope, np.float32(0))
