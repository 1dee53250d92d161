"""Estimates what a readout bus does to a sequence of which a few pixels are known."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray
from ...sensor.effects import Readout
from .luma_sample import LumaSample
from .omission_error import NO_ERROR, OmissionError, TimeScale

_PEAK_EVENTS = 50
"""A peak rate is taken over this many consecutive events of the sampled pixels, which is accurate to a seventh."""


def through_bus(sample: LumaSample, effect: Readout, scale: TimeScale, rows: int) -> tuple[OmissionError, str]:
    """Estimate what leaving out the bus does to the events of ideal pixels, and say what was seen of them."""
    waits = [_waits_us(events, effect, sample.sensor_share, rows) for events in sample.ideal_segments]
    wait_us = np.concatenate(waits)
    carried = wait_us[~np.isnan(wait_us)]
    peak = _peak_rate(sample)
    rate = "too few events for a peak rate" if math.isnan(peak) else f"events come at up to {peak / 1e6:.3g} Mev/s"
    seen = (
        f"{rate}, the bus takes {effect.events_per_s / 1e6:.3g} Mev/s and "
        f"{effect.row_us:.3g} us a row; longest wait "
        f"{carried.max(initial=0.0):.3g} us, latency {effect.latency_us:.3g} us, jitter {effect.jitter_us:.3g} us"
    )
    if not len(wait_us):
        return NO_ERROR, seen
    error_us = _delays_us(carried, effect, sample.seed)
    dropped = 100 * float(np.isnan(wait_us).mean())
    error = OmissionError(
        dropped,
        dropped,
        scale.error_percent(error_us, 0, len(wait_us)),
        0.0,
        dropped,
        float(np.median(error_us)) if len(carried) else math.nan,
        float(np.percentile(error_us, 99)) if len(carried) else math.nan,
    )
    return error, seen


def carried_events(
    events: EventArray, effect: Readout, sensor_share: float, rows: int, seed: int, *, refractory_us: float
) -> EventArray:
    """Return a segment's events with the stamps that the bus gives them, without those that are dropped or missed."""
    wait_us = _waits_us(events, effect, sensor_share, rows, refractory_us)
    carried, kept = events[~np.isnan(wait_us)].copy(), wait_us[~np.isnan(wait_us)]
    carried["t"] += np.rint(_delays_us(kept, effect, seed)).astype(np.int64)
    return carried[np.argsort(carried["t"], kind="stable")]


def _delays_us(wait_us: npt.NDArray[np.float64], effect: Readout, seed: int) -> npt.NDArray[np.float64]:
    """Waits with latency and jitter."""
    random = np.random.Generator(np.random.Philox(seed))
    return wait_us + effect.latency_us + np.abs(effect.jitter_us * random.standard_normal(len(wait_us)))


def _waits_us(
    events: EventArray, effect: Readout, sensor_share: float, rows: int, refractory_us: float = 0.0
) -> npt.NDArray[np.float64]:
    """Return how long events wait for the bus, NaN for those dropped or missed, if each one seen stands for others.

    A pixel misses what comes before its last event was read out and its reset is over. The others are taken to come
    evenly since the event before, so that a few pixels tell of a queue of all: it grows where the rate exceeds the
    bus's, and shrinks where it does not. Events that wait lie in as many rows as there can be: few of them in a row
    each, many in all rows.
    """
    column_us, longest = 1e6 / effect.events_per_s, math.inf if effect.drop_after_us is None else effect.drop_after_us
    service_us, all_rows_us = column_us + effect.row_us, rows * effect.row_us

    def queue_us(events: float) -> float:
        return events * column_us + min(events, rows) * effect.row_us

    def queued(wait_us: float) -> float:
        if wait_us <= rows * service_us:
            return wait_us / service_us if service_us else 0.0
        return (wait_us - all_rows_us) / column_us

    t_us, reset_us = events["t"].astype(np.int64), max(refractory_us, 1.0)
    pixels = (events["y"].astype(np.int64) << 16 | events["x"]).tolist()
    ready_us: dict[int, float] = {}
    waits = np.empty(len(t_us))
    wait = 0.0
    for i, (at_us, gap) in enumerate(zip(t_us.tolist(), np.diff(t_us, prepend=t_us[:1]).tolist(), strict=True)):
        ahead = max(queue_us(queued(wait) + 1 / sensor_share) - gap, 0.0) if i else 0.0
        if ahead > longest or at_us < ready_us.get(pixels[i], 0.0):
            waits[i], wait = math.nan, max(wait - gap, 0.0)
        else:
            waits[i] = wait = ahead
            ready_us[pixels[i]] = at_us + ahead + effect.latency_us + reset_us
    return waits + service_us


def _peak_rate(sample: LumaSample) -> float:
    """Return the events a second of the whole sensor where they are densest; NaN where there are few."""
    t = sample.ideal["t"]
    if len(t) <= _PEAK_EVENTS:
        return math.nan
    shortest_us = max(int((t[_PEAK_EVENTS:] - t[:-_PEAK_EVENTS]).min()), 1)
    return _PEAK_EVENTS / sample.sensor_share / (shortest_us * 1e-6)
