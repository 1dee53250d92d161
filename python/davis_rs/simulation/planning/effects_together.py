"""Runs several effects at once: what a chosen set makes of a sequence, and what those that it leaves out would
change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..._util.progress import doing
from ...events.arrays import EventArray, concatenate_events
from ...sensor.effects import Effect, Effects, with_optics
from .bus import carried_events
from .cost import Costs, most_noise_hz
from .luma_sample import LumaSample
from .omission_error import OmissionError, omission_error
from .omission_estimator import FLOOD, OmissionEstimator

_ADDED_OR_BEHIND = ("hot_pixels", "readout", "aps")
"""What the engine's runs of the pixels leave out: hot pixels are added, the others act behind the pixels."""


@dataclass(frozen=True)
class SetForecast:
    """Says what a chosen set of effects does together, and what the other candidates would add to it.

    Attributes:
        events: with the set, estimated for the whole sequence.
        omission: the set compared with all candidates, on pixels that the choice was not made on.
        explained_percent: of the distance (Victor and Purpura's) between the streams with no candidate and with all,
            the share that is gone with the set, on the same pixels; NaN where there is no distance.
        cost_percent: what the set takes more than no candidate, in percent of what all take; NaN if not measurable.
        held_out: how many pixels were held out; 0 where the sensor is too small, and the same were taken.
        chosen, candidates: how many effects act on events, of the set and of all.
    """

    events: float
    omission: OmissionError
    explained_percent: float
    cost_percent: float
    held_out: int
    chosen: int
    candidates: int


class EffectsTogether:
    """Runs the engine with several effects on at once: sets of candidates, and all of them.

    Hot pixels are so few that a sample says nothing of them: their known rate is added.

    Args:
        kept: effects that are on in each run.
        candidates: of the plan.
    """

    def __init__(self, estimator: OmissionEstimator, *, kept: Effects, candidates: Effects) -> None:
        self._estimator, sequence = estimator, estimator.sequence
        self._kept, self._candidates = (Effects.of(e for e in of if e.name != "aps") for of in (kept, candidates))
        self._everything = self._candidates.with_defaults(self._kept)
        self._seen = _PixelRuns(estimator, sequence.pixel)

    @property
    def worth_running(self) -> bool:
        """Tell whether a candidate acts on events, and noise does not make more events than are worth simulating."""
        sample, in_pixels = self._estimator.sequence.pixels, [e for e in self._everything if e.name != "hot_pixels"]
        pixel_s = sample.pixels * self._estimator.sequence.duration_us * 1e-6
        return bool(self._candidates) and sum(most_noise_hz(e, sample) for e in in_pixels) * pixel_s <= FLOOD

    def called_for(self, chosen: Effects, tolerance_percent: float) -> set[str]:
        """Choose what must join a set so that it errs by no more than the tolerance, compared with all candidates.

        Some effects matter only with others: a mismatch of thresholds changes the rate of noise, but nothing in a
        scene without noise and motion. The next to join is the one that errs most when it alone is left out of all.
        """
        out = [effect for effect in self._candidates if getattr(chosen, effect.name) is None]
        joined: set[str] = set()
        if not out or self._error(self._seen, out) <= tolerance_percent:
            return joined
        out.sort(key=lambda effect: self._error(self._seen, [effect]))
        while out and self._error(self._seen, out) > tolerance_percent:
            joined.add(out.pop().name)
        return joined

    def forecast(self, costs: Costs, chosen: Effects) -> SetForecast:
        """Say what a set does on the pixels of the sample, and how it compares with all candidates on held-out ones."""
        doing("the effects together, on other pixels")
        estimator, sequence = self._estimator, self._estimator.sequence
        chosen = Effects.of(effect for effect in chosen if effect.name != "aps")
        with_set = chosen.with_defaults(self._kept)
        other = self._seen
        if len(sequence.held_out):
            other = _PixelRuns(estimator, sequence.held_out)
        omission, left_us = other.omission(with_set, self._everything)
        _, all_us = other.omission(self._kept, self._everything)
        return SetForecast(
            events=estimator.whole(len(self._seen.events(with_set))) + estimator.of_rate(_hot_hz(with_set)),
            omission=omission,
            explained_percent=100 * (1 - left_us / all_us) if all_us else np.nan,
            cost_percent=costs.share_percent(with_set, self._everything, self._kept),
            held_out=len(sequence.held_out),
            chosen=len(list(chosen)),
            candidates=len(list(self._candidates)),
        )

    def _error(self, pixels: _PixelRuns, out: Sequence[Effect]) -> float:
        """Return the error of leaving these out of everything."""
        names = {effect.name for effect in out}
        doing(f"the effects together, without {', '.join(sorted(names))}")
        rest = Effects.of(effect for effect in self._everything if effect.name not in names)
        return pixels.omission(rest, self._everything)[0].worst_percent


class _PixelRuns:
    """Runs some pixels under sets of effects."""

    def __init__(self, estimator: OmissionEstimator, pixel: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        self._estimator, self._pixel = estimator, pixel
        self._through = lru_cache(self._sample)
        self.events = lru_cache(maxsize=4)(self._events)

    def _events(self, effects: Effects) -> EventArray:
        """Return all events but those of hot pixels."""
        sample = self._through(effects.optical)
        in_pixels = Effects.of(e for e in effects if e.acts_on != "luma" and e.name not in _ADDED_OR_BEHIND)
        streams = [sample.segment_events(segment, in_pixels or None) for segment in sample.segments]
        bus = effects.readout
        if bus is not None:
            camera, held = self._estimator.sequence.camera, effects.refractory_period_us
            rows = bus.rows(camera.width, camera.height)
            refractory_us = 0.0 if held is None else held.period_us
            streams = [
                carried_events(events, bus, sample.sensor_share, rows, sample.seed, refractory_us=refractory_us)
                for events in streams
            ]
        events = concatenate_events(streams)
        return events[np.argsort(events["t"], kind="stable")]  # the bus may delay one part's into the next part

    def omission(self, without: Effects, everything: Effects) -> tuple[OmissionError, float]:
        """Return what it does to have only some effects, and the distance between the streams in us."""
        fewer, full = self.events(without), self.events(everything)
        scale, sequence = self._estimator.scale, self._estimator.sequence
        error, distance_us = omission_error(fewer, full, size=(len(self._pixel), 1), scale=scale)
        hot = (_hot_hz(everything) - _hot_hz(without)) * len(self._pixel) * sequence.duration_us * 1e-6
        return error.with_added(hot, max(len(fewer), len(full))), distance_us + scale.price_us * hot

    def _sample(self, optical: Effects) -> LumaSample:
        sequence = self._estimator.sequence
        if not optical and self._pixel is sequence.pixel:
            return sequence.pixels
        return sequence.sample(self._pixel, with_optics(sequence.renderer, optical))


def _hot_hz(effects: Effects) -> float:
    """Return the events of hot pixels, a pixel and second."""
    hot = effects.hot_pixels
    return 0.0 if hot is None else hot.fraction * float(hot.mean_rate_hz())
