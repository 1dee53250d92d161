"""Several effects at once: what a chosen set makes of a sequence, and what those that it leaves out would change."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..effects import Effects, HotPixels, LensBlur, Vignetting, with_optics
from ..events import EventArray, concatenate_events
from .bus import carried_events
from .cost import Costs, most_noise_hz
from .luma_sample import LumaSample
from .omission_error import OmissionError, omission_error
from .omission_estimator import FLOOD, NO_LEAK, OmissionEstimator

_NOT_IN_PIXELS = ("vignetting", "lens_blur_px", "hot_pixels", "readout", "aps")


@dataclass(frozen=True)
class SetForecast:
    """What a chosen set of effects does together, and what the other candidates would add to it.

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


def forecast_set(
    estimator: OmissionEstimator, costs: Costs, *, kept: Effects, chosen: Effects, candidates: Effects
) -> SetForecast | None:
    """Run the engine with all of a set on, with all candidates, and with none of them.

    Hot pixels are so few that a sample says nothing of them: their known rate is added.

    Args:
        kept: effects that are on in each.
        chosen: the set, a part of ``candidates``.

    Returns:
        None where no candidate acts on events, or where noise would make more events than are worth simulating.
    """
    kept, chosen, candidates = (effects.without(["aps"]) for effects in (kept, chosen, candidates))
    sequence = estimator.sequence
    everything = candidates.with_defaults(kept)
    sample = sequence.pixels
    noise_hz = sum(most_noise_hz(effect, sample) for effect in everything if not isinstance(effect, HotPixels))
    if not candidates or noise_hz * sample.pixels * sequence.duration_us * 1e-6 > FLOOD:
        return None
    with_set = chosen.with_defaults(kept)
    seen = _Pixels(estimator, sequence.pixel, everything)
    other = _Pixels(estimator, sequence.held_out if len(sequence.held_out) else sequence.pixel, everything)
    omission, left_us = other.omission(with_set, everything)
    _, all_us = other.omission(kept, everything)
    return SetForecast(
        events=estimator.whole(len(seen.events(with_set))) + estimator.of_rate(_hot_hz(with_set)),
        omission=omission,
        explained_percent=100 * (1 - left_us / all_us) if all_us else np.nan,
        cost_percent=costs.share_percent(with_set, everything, kept),
        held_out=len(sequence.held_out),
        chosen=sum(1 for _ in chosen),
        candidates=sum(1 for _ in candidates),
    )


class _Pixels:
    """Some pixels under sets of effects.

    Without a leak, one that comes to nothing takes its place where any set leaks: so the levels at the start are the
    same.
    """

    def __init__(
        self, estimator: OmissionEstimator, pixel: np.ndarray[tuple[int], np.dtype[np.int64]], everything: Effects
    ) -> None:
        self._estimator, self._pixel = estimator, pixel
        duration_s = estimator.sequence.duration_us * 1e-6
        leaks = everything.leak_rate_hz is not None
        self._floor = Effects(leak_rate_hz=NO_LEAK / duration_s) if leaks else Effects()
        self._through = lru_cache(self._sample)

    def events(self, effects: Effects) -> EventArray:
        """All events but those of hot pixels."""
        sample = self._through(effects.vignetting, effects.lens_blur_px)
        in_pixels = Effects.of(effect for effect in effects if effect.name not in _NOT_IN_PIXELS)
        in_pixels = in_pixels.with_defaults(self._floor)
        parts = [sample.part_events(part, in_pixels or None) for part in sample.parts]
        bus = effects.readout
        if bus is not None:
            rows = self._estimator.sequence.camera.height
            parts = [carried_events(events, bus, sample.sensor_share, rows, sample.seed) for events in parts]
        events = concatenate_events(parts)
        return events[np.argsort(events["t"], kind="stable")]  # the bus may delay one part's into the next part

    def omission(self, without: Effects, everything: Effects) -> tuple[OmissionError, float]:
        """What it does to have only some effects, and the distance between the streams in us."""
        fewer, full = self.events(without), self.events(everything)
        scale, sequence = self._estimator.scale, self._estimator.sequence
        error, distance_us = omission_error(fewer, full, size=(len(self._pixel), 1), scale=scale)
        hot = (_hot_hz(everything) - _hot_hz(without)) * len(self._pixel) * sequence.duration_us * 1e-6
        return error.with_added(hot, max(len(fewer), len(full))), distance_us + scale.price_us * hot

    def _sample(self, vignetting: Vignetting | None, blur: LensBlur | None) -> LumaSample:
        sequence = self._estimator.sequence
        if vignetting is None and blur is None and self._pixel is sequence.pixel:
            return sequence.pixels
        return sequence.sample(self._pixel, with_optics(sequence.renderer, vignetting, blur))


def _hot_hz(effects: Effects) -> float:
    """Events of hot pixels, a pixel and second."""
    hot = effects.hot_pixels
    return 0.0 if hot is None else hot.fraction * float(hot.mean_rate_hz())
