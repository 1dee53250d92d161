"""Makes frames between frames: along optical flow, by a user's interpolator, or only where the image moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._util.named_entry import load_entry
from .interpolation import Interpolation, Sample, SensorFrame, with_rates
from .light import LumaFrame
from .optical_flow import FlowFinder, FlowPair, displacement

Interpolator = Callable[[LumaFrame, LumaFrame, npt.NDArray[np.float64]], Iterable[npt.ArrayLike]]
"""interpolator(before, after, shares) -> frames: linear luma (H, W), float32, at each share of the way from one to the
other, in (0, 1) and increasing. Behind colour filters it is asked for the light of each of them."""


def load_interpolator(entry: str) -> Interpolator:
    """Load the interpolator that ``MODULE:FUNCTION`` or ``FILE.py:FUNCTION`` stands for.

    A class is called without arguments, and its object is the interpolator: so a network is loaded once.

    Raises:
        ValueError: if there is none, or it cannot be called.
        OSError: if there is no such file.
    """
    entity: Any = load_entry(entry, "interpolator")
    if isinstance(entity, type):
        entity = entity()
    if not callable(entity):
        raise ValueError(f"interpolator {entry!r} must be a function or a class of callables, got {entity!r}")
    loaded: Interpolator = entity
    return loaded


CUBIC_UP_TO_PX = 1.0
"""Up to this displacement between two frames ``auto`` takes cubics: flow adds errors of its own there, and gains little
(measured in docs/events_from_video.md)."""

MOST_FRAMES = 512
"""Between two frames, however far the image moves."""

_BATCH = 16
"""Frames that an interpolator is asked for at a time, so that memory stays bounded."""

_FAR = 0.1
"""Share of the frame's width: where the image moves farther, or"""

_HIDDEN = 0.25
"""so large a share of the pixels is not found again, what lies between two frames is a guess."""


class Motion:
    """Counts what was seen of the image's motion, for people and for meta.json.

    Attributes:
        by_cubics, by_frames: how many intervals were taken by cubics, and with frames made between.
        made: how many frames were made.
        largest_px: how far the image moved from a frame to the next, at the most.
        unsure: how many intervals had too much motion for flow to be trusted.
    """

    def __init__(self) -> None:
        self.by_cubics = self.by_frames = self.made = self.unsure = 0
        self.largest_px = 0.0

    def add(self, moved_px: float, made: int, *, unsure: bool) -> None:
        """Count an interval in which ``made`` frames were made."""
        self.by_cubics += made == 0
        self.by_frames += made > 0
        self.made += made
        self.unsure += unsure
        self.largest_px = max(self.largest_px, moved_px)

    def describe(self) -> dict[str, object]:
        """Return the counts in JSON's types."""
        return {
            "intervals_without_frames_between": self.by_cubics,
            "intervals_with_frames_between": self.by_frames,
            "frames_between": self.made,
            "largest_displacement_px": round(self.largest_px, 3),
            "unsure_intervals": self.unsure,
        }

    def warnings(self) -> Iterator[str]:
        """Say what cannot be known, a line each."""
        if self.unsure:
            yield (
                f"in {self.unsure} of {self.by_cubics + self.by_frames} intervals the image moves too far from a frame "
                f"to the next (95 % of what changes by up to {self.largest_px:.0f} px), or too much is hidden, to know "
                "what lies between: events there are a guess, and a higher frame rate is the only cure"
            )


class FramesBetween(Interpolation):
    """Makes frames between every two frames, and lets log intensity run straight between all of them.

    Args:
        max_displacement_px: they are no further apart than the image moves by so much.
        interpolator: makes them; None makes them along optical flow.

    Raises:
        ImportError: without OpenCV, which measures how far the image moves.
    """

    engine = "linear"

    def __init__(self, max_displacement_px: float, interpolator: Interpolator | None = None) -> None:
        self._step_px, self._interpolator = max_displacement_px, interpolator
        self._finder = FlowFinder()
        self.motion = Motion()

    def samples(self, frames: Iterator[SensorFrame]) -> Iterator[Sample]:
        first = next(frames, None)
        if first is None:
            return
        yield Sample(first.t_us, first.luma, None, first)
        last = first
        for frame in frames:
            yield from self._between(last, frame)
            yield Sample(frame.t_us, frame.luma, None, frame)
            last = frame

    def _between(self, last: SensorFrame, frame: SensorFrame) -> Iterator[Sample]:
        pair = self._finder.between(last.grey, frame.grey)
        times = instants(last.t_us, frame.t_us, pair.displacement_px, self._step_px)
        self.motion.add(pair.displacement_px, len(times), unsure=_unsure(pair))
        fractions = (times - last.t_us) / (frame.t_us - last.t_us)
        if self._interpolator is None:
            made: Iterator[Sequence[LumaFrame]] = pair.frames(fractions, last.planes, frame.planes)
        else:
            where = f"the interpolator, between {last.where} and {frame.where}"
            between = zip(last.planes, frame.planes, strict=True)
            made = zip(*(self._asked(before, after, fractions, where) for before, after in between), strict=True)
        for t_us, planes in zip(times.tolist(), made, strict=True):
            yield Sample(t_us, frame.seen(planes), None, None)

    def _asked(
        self, before: LumaFrame, after: LumaFrame, fractions: npt.NDArray[np.float64], where: str
    ) -> Iterator[LumaFrame]:
        """Return what the user's interpolator makes between two planes, checked."""
        assert self._interpolator is not None
        for start in range(0, len(fractions), _BATCH):
            asked = fractions[start : start + _BATCH]
            given = 0
            # Copies: what it writes into them must not change the frames that the events come from.
            images = self._interpolator(before.copy(), after.copy(), asked.copy())
            if not isinstance(images, Iterable):
                raise ValueError(f"{where}: it must give {len(asked)} frames, got {type(images).__name__}")
            for image in images:
                luma = _as_luma(image, after.shape, where)
                bad = ~(np.isfinite(luma) & (luma >= 0))
                if bad.any():
                    y, x = np.argwhere(bad)[0].tolist()
                    raise ValueError(f"{where}: luma must be finite and >= 0, got {luma[y, x]} at pixel ({x}, {y})")
                given += 1
                if given <= len(asked):
                    yield luma
            if given != len(asked):
                raise ValueError(f"{where}: it was asked for {len(asked)} frames, and gave {given}")

    def describe(self) -> dict[str, object]:
        rule = "flow" if self._interpolator is None else "interpolator"
        name = {} if self._interpolator is None else {"interpolator": repr(self._interpolator)}
        return {"rule": rule, **name, **self.motion.describe()}

    def findings(self) -> Iterator[str]:
        moved = f"95 % of what changes moves by less than {self.motion.largest_px:.3g} px from a frame to the next"
        yield f"{self.motion.made:,} frames were made between frames; {moved}"
        yield from self.motion.warnings()


class Auto(Interpolation):
    """Takes cubics where the image moves by less than :data:`CUBIC_UP_TO_PX` between two frames, flow where it moves
    more.

    Args:
        log_eps: as of the crossing engine.
        max_displacement_px: as of :class:`FramesBetween`.

    Raises:
        ImportError: without OpenCV.
    """

    engine = "hermite"

    def __init__(self, log_eps: float, max_displacement_px: float) -> None:
        self._log_eps, self._step_px = np.float32(log_eps), max_displacement_px
        self._finder = FlowFinder()
        self.motion = Motion()

    def samples(self, frames: Iterator[SensorFrame]) -> Iterator[Sample]:
        rated = with_rates(frames, self._log_eps)
        first = next(rated, None)
        if first is None:
            return
        yield Sample(first[0].t_us, first[0].luma, first[1], first[0])
        straight = np.full_like(first[1], np.nan)
        last = first[0]
        for frame, rate in rated:
            before, after = last.grey, frame.grey
            forward = self._finder.flow(before, after)
            moved_px = displacement(before, forward, after)
            if moved_px <= CUBIC_UP_TO_PX:
                self.motion.add(moved_px, 0, unsure=False)
            else:
                pair = FlowPair.of(before, after, forward, self._finder.flow(after, before))
                times = instants(last.t_us, frame.t_us, pair.displacement_px, self._step_px)
                self.motion.add(pair.displacement_px, len(times), unsure=_unsure(pair))
                fractions = (times - last.t_us) / (frame.t_us - last.t_us)
                made = pair.frames(fractions, last.planes, frame.planes)
                for t_us, planes in zip(times.tolist(), made, strict=True):
                    yield Sample(t_us, frame.seen(planes), straight, None)
            yield Sample(frame.t_us, frame.luma, rate, frame)
            last = frame

    def describe(self) -> dict[str, object]:
        return {"rule": "auto", **self.motion.describe()}

    def findings(self) -> Iterator[str]:
        motion = self.motion
        yield (
            f"interpolation auto: {motion.by_cubics} of {motion.by_cubics + motion.by_frames} intervals by cubics, "
            f"where the image moves by {CUBIC_UP_TO_PX:g} px at most; {motion.by_frames} along optical flow, where "
            f"95 % of what changes moves by less than {motion.largest_px:.3g} px"
        )
        yield from motion.warnings()


def _as_luma(image: npt.ArrayLike, shape: tuple[int, ...], where: str) -> LumaFrame:
    """Copy what an interpolator gave for a frame: it may use one array for all."""
    array = np.asarray(image)
    if array.shape != shape:
        raise ValueError(f"{where}: frames must have the shape {shape}, got {'None' if image is None else array.shape}")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{where}: frames must be real numbers, got dtype {array.dtype}")
    with np.errstate(over="ignore"):  # told as not finite
        return np.array(array, np.float32, order="C")


def instants(start_us: int, end_us: int, moved_px: float, step_px: float) -> npt.NDArray[np.int64]:
    """Choose whole microseconds strictly between start and end; between two the image moves by ``step_px`` at most."""
    steps = min(max(math.ceil(moved_px / step_px - 1e-6), 1), MOST_FRAMES + 1, end_us - start_us)
    return start_us + np.arange(1, steps, dtype=np.int64) * (end_us - start_us) // steps


def _unsure(pair: FlowPair) -> bool:
    return pair.displacement_px > _FAR * pair.before.shape[1] or pair.occluded > _HIDDEN
