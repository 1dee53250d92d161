"""Makes intensity frames at a rate of their own, from the light between two samples: slow motion next to the events."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .interpolation import Sample
from .light import LumaFrame


class Image(NamedTuple):
    """Holds an intensity frame: microseconds, and linear luma (H, W), float32."""

    t_us: int
    luma: LumaFrame


class ImagesBetween:
    """Makes images of the same light that the crossing engine sees, at even instants.

    The light between two samples is not sampled anew, because more samples would change the events. It is what the
    engine takes it for: log intensity along a line, or along a cubic where both samples have a rate.

    Args:
        rate_hz: images a second; the first one is at the first sample.
        log_eps: as of the crossing engine.
    """

    def __init__(self, rate_hz: float, log_eps: float) -> None:
        self._step_us, self._log_eps = 1e6 / rate_hz, log_eps
        self._start_us, self._count = 0, 0
        self._last: Sample | None = None

    def until(self, sample: Sample) -> Iterator[Image]:
        """Yield the images after the sample before and until this one."""
        last, self._last = self._last, sample
        if last is None:
            self._start_us, self._count = sample.t_us, 1
            yield Image(sample.t_us, sample.luma)
            return
        while (due_us := self._start_us + round(self._count * self._step_us)) <= sample.t_us:
            self._count += 1
            yield Image(due_us, sample.luma if due_us == sample.t_us else self._between(last, sample, due_us))

    def _between(self, a: Sample, b: Sample, t_us: int) -> LumaFrame:
        seconds, s = (b.t_us - a.t_us) * 1e-6, (t_us - a.t_us) / (b.t_us - a.t_us)
        lit = [np.add(sample.luma, self._log_eps, dtype=np.float64) for sample in (a, b)]
        logs = [np.log(light) for light in lit]
        line = (1 - s) * logs[0] + s * logs[1]
        if a.rate is not None and b.rate is not None:
            # Hermite's cubic, as what its slopes add to the line; NaN asks for the line.
            chord = logs[1] - logs[0]
            first, second = (seconds * rate / light - chord for rate, light in zip((a.rate, b.rate), lit, strict=True))
            bend = s * (1 - s) * ((1 - s) * first - s * second)
            line += np.where(np.isnan(bend), 0.0, bend)
        luma: LumaFrame = np.maximum(np.exp(line) - self._log_eps, 0).astype(np.float32)
        return luma
