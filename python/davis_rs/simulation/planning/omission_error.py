"""Compares a stream with what is left of it when effects are left out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray
from ...events.matching import EventComparison, compare_events


@dataclass(frozen=True)
class TimeScale:
    """Holds what times of events are compared with.

    Attributes:
        window_us: how far apart two events may be that count as the same.
        interval_us: between consecutive events of a pixel, the median, without effects.
        sampling_error_us: of the stream, by the sampling in time; a smaller shift counts as none.
    """

    window_us: int
    interval_us: float
    sampling_error_us: float

    def error_percent(self, shifts_us: npt.NDArray[np.float64], moved_too_far: int, events: int) -> float:
        """Return the mean shift of all ``events``, in percent of the interval; each counts for one interval at most."""
        shifts_us = np.abs(shifts_us)
        counted = np.minimum(shifts_us[shifts_us > self.sampling_error_us], self.interval_us)
        return 100 * (float(counted.sum()) / self.interval_us + moved_too_far) / max(events, 1)

    def distance_us(self, comparison: EventComparison) -> float:
        """Return Victor and Purpura's distance, by :func:`compare_events`' price of an event without a partner."""
        shifts_us = np.abs(comparison.time_error_us)
        return float(shifts_us[shifts_us > self.sampling_error_us].sum()) + self.price_us * (
            comparison.missing + comparison.spurious
        )

    @property
    def price_us(self) -> float:
        """Return what an event without a partner adds to the distance."""
        return (self.window_us + 0.5) / 2


@dataclass(frozen=True)
class OmissionError:
    """Says how a stream changes when effects are left out, in percent of the larger of the two streams.

    Attributes:
        count_percent: events without the effects minus those with them.
        rate_percent: the same of each pixel and polarity, added up without signs: so it is at least the count's.
        time_percent: mean shift of an event, in percent of the median interval between events of a pixel. An event
            that is moved further than an interval, or so far that it has no partner, counts as one interval. Shifts
            below the stream's sampling error count as 0.
        missing_percent: events that the effects make, or move too far to be the same.
        spurious_percent: events that the effects prevent, or move too far.
        median_us, p99_us: of how far events move that have a partner; NaN where none has.
    """

    count_percent: float
    rate_percent: float
    time_percent: float
    missing_percent: float
    spurious_percent: float
    median_us: float
    p99_us: float

    @property
    def worst_percent(self) -> float:
        """Return the largest of the errors in count, rate and time, which a tolerance limits."""
        return max(abs(self.count_percent), self.rate_percent, self.time_percent)

    def with_added(self, made: float, events: float) -> OmissionError:
        """Return the same where leaving out takes ``made`` more events than the larger stream's ``events`` have."""
        fraction = made / max(events + made, 1.0)
        return replace(
            self,
            count_percent=self.count_percent * (1 - fraction) - 100 * fraction,
            rate_percent=self.rate_percent * (1 - fraction) + 100 * fraction,
            time_percent=self.time_percent * (1 - fraction),
            missing_percent=self.missing_percent * (1 - fraction) + 100 * fraction,
            spurious_percent=self.spurious_percent * (1 - fraction),
        )


NO_ERROR = OmissionError(0.0, 0.0, 0.0, 0.0, 0.0, math.nan, math.nan)


def omission_error(
    without: EventArray, with_effects: EventArray, *, size: tuple[int, int], scale: TimeScale
) -> tuple[OmissionError, float]:
    """Compare a stream in which effects are left out with the one that they are in.

    Args:
        size: width and height.

    Returns:
        The error, and the distance between the streams in microseconds (:meth:`TimeScale.distance_us`).
    """
    comparison = compare_events(without, with_effects, size=size, window_us=scale.window_us)
    events = max(len(without), len(with_effects))
    percent = 100 / max(events, 1)
    change = _counts(without, size) - _counts(with_effects, size)
    error = OmissionError(
        percent * float(change.sum()),
        percent * float(np.abs(change).sum()),
        scale.error_percent(comparison.time_error_us, min(comparison.missing, comparison.spurious), events),
        percent * comparison.missing,
        percent * comparison.spurious,
        comparison.median_us,
        comparison.p99_us,
    )
    return error, scale.distance_us(comparison)


def omission_error_of_added(made: float, events: float) -> OmissionError:
    """Compute the error of leaving out an effect that adds ``made`` events to the scene's own ``events``.

    Both numbers are expectations, so they may be fractions.
    """
    error_us = 0.0 if events else math.nan
    return replace(NO_ERROR, median_us=error_us, p99_us=error_us).with_added(made, events)


def _counts(events: EventArray, size: tuple[int, int]) -> npt.NDArray[np.int64]:
    """Return events of each pixel and polarity."""
    width, height = size
    index = (events["y"].astype(np.int64) * width + events["x"]) * 2 + (events["p"] != 0)
    return np.bincount(index, minlength=2 * width * height)
