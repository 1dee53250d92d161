"""Makes the light that a recording's pixels saw from its frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..calibrate.sensor import StampedFrame
from ..inspection.statistics.stream_statistics import Measured
from ..simulation.from_frames.frames_between import Auto
from ..simulation.from_frames.interpolation import SensorFrame
from ..simulation.from_frames.luma_noise import LumaNoise, luma_noise
from .clip import RecordedClip
from .still_light import still

_CERTAIN_DARK = 0.02
"""A dark current is told if its standard deviation is a smaller fraction of the brightest value."""

_LEAST_DARK = 1e-3
"""Dark level where noise of frames does not show, as that of a simulation."""


@dataclass(frozen=True, eq=False)
class ClipLight:
    """Holds how the values of a clip's frames become luma.

    Attributes:
        clip: the recording.
        region: (x0, y0, x1, y1): where all frames have values.
        black, white: the values for luma 0 and 1.
        noise: of the frames, in luma; None where it does not show.
        dark: the dark current of the pixels, in luma, where the fit tells it; None where it does not.
    """

    clip: RecordedClip
    region: tuple[int, int, int, int]
    black: float
    white: float
    noise: LumaNoise | None
    dark: Measured | None

    @classmethod
    def of(cls, clip: RecordedClip, black: Measured | None) -> ClipLight:
        """Measure the frames of a clip: which pixels have values, how bright they are, and their noise.

        Args:
            clip: the recording.
            black: the value without light, as the fit tells it. Below 0 it is the pixels' dark current, which they have
                in addition to the light. None takes 0, or the lowest value below.

        Raises:
            ValueError: if the frames have no rectangle of pixels in common, or no light.
        """
        width, height = clip.size
        known = np.ones((height, width), np.bool_)
        lowest, highest = np.inf, -np.inf
        last: StampedFrame | None = None
        noises: list[LumaNoise | None] = []
        step = _step_of(clip)
        for frame in clip.source.frames():
            inside = np.isfinite(frame.values)
            known &= inside
            if inside.any():
                lowest = min(lowest, float(frame.values[inside].min()))
                highest = max(highest, float(frame.values[inside].max()))
            if last is not None and len(noises) < _MOST_PAIRS:
                told = luma_noise(
                    last.values, frame.values, black=0.0 if black is None else max(black.value, 0.0), step=step
                )
                noises.append(told)
            last = frame
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if not len(rows) or not highest > lowest:
            raise ValueError(f"{clip.name}: the frames have no light in common")
        region = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        if not known[region[1] : region[3], region[0] : region[2]].all():
            raise ValueError(f"{clip.name}: the pixels that all frames have must be a rectangle")
        zero = min(0.0, lowest) if black is None else max(black.value, 0.0)
        scale = highest - zero
        noise = _mean([one for one in noises if one is not None], scale)
        dark = None
        if black is not None and black.sigma < _CERTAIN_DARK * scale:
            dark = Measured(max(-black.value, 0.0) / scale, black.sigma / scale)
        return cls(clip, region, zero, highest, noise, dark)

    def dark_level(self, contrast_threshold: float) -> Measured:
        """Return log_eps, in luma: the dark current where the fit tells it; else what keeps noise of the frames from
        making events."""
        if self.dark is not None:
            return Measured(max(self.dark.value, _LEAST_DARK), self.dark.sigma)
        if self.noise is None:
            return Measured(_LEAST_DARK, math.nan)
        level = self.noise.dark_level(contrast_threshold)
        return Measured(max(level, _LEAST_DARK), self.noise.dark_level_sigma(contrast_threshold))

    def luma(self, frame: StampedFrame) -> npt.NDArray[np.float32]:
        """Return the luma of a frame, in the region."""
        x0, y0, x1, y1 = self.region
        values = (frame.values[y0:y1, x0:x1] - self.black) / (self.white - self.black)
        return np.ascontiguousarray(np.maximum(values, 0), np.float32)

    def frames(self, numbers: range) -> Iterator[SensorFrame]:
        """Return the frames with these numbers as sensors see them, one by one."""
        seen = (
            SensorFrame(round(frame.t_us), self.luma(frame), f"{self.clip.name}, frame {number}")
            for number, frame in zip(numbers, self.clip.frames(numbers), strict=True)
        )
        return still(seen, self.noise)

    def contrast(self, numbers: range, log_eps: float) -> npt.NDArray[np.float32]:
        """Return how far log intensity goes, from its lowest to its highest value, in each pixel of the region, along
        the flow between these frames."""
        lowest = highest = None
        for sample in Auto(log_eps, 1.0).samples(self.frames(numbers)):
            log = np.log(sample.luma + np.float32(log_eps))
            lowest = log if lowest is None else np.minimum(lowest, log)
            highest = log if highest is None else np.maximum(highest, log)
        if lowest is None or highest is None:
            raise ValueError(f"{self.clip.name}: there are no frames")
        return np.asarray(highest - lowest)

    def compared(self) -> npt.NDArray[np.bool_]:
        """Return which pixels of the sensor, bool (H, W), have light."""
        width, height = self.clip.size
        x0, y0, x1, y1 = self.region
        inside = np.zeros((height, width), np.bool_)
        inside[y0:y1, x0:x1] = True
        return inside


_MOST_PAIRS = 16
"""Pairs of frames whose noise is measured."""


def _step_of(clip: RecordedClip) -> float:
    """Return the smallest gap between the values of the first frame."""
    for frame in clip.source.frames():
        values = np.unique(frame.values[np.isfinite(frame.values)])
        return float(np.diff(values).min()) if len(values) > 1 else 0.0
    return 0.0


def _mean(noises: list[LumaNoise], scale: float) -> LumaNoise | None:
    """Return the mean of measurements, in units of ``scale``."""
    if not noises:
        return None
    read, sigma, gain = np.mean(np.array(noises), axis=0).tolist()
    return LumaNoise(read / scale, sigma / scale, gain / scale)
