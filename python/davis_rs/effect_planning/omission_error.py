"""What becomes of a stream when an effect is left out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..event_matching import compare_events
from ..events import EventArray


@dataclass(frozen=True)
class OmissionError:
    """What becomes of a stream when an effect is left out, in percent of the larger one of both streams.

    Attributes:
        missing_percent: events that the effect makes, or moves too far to be the same.
        spurious_percent: events that the effect prevents, or moves too far.
        shifted_percent: events that it moves by more than the plan's ``shift_us``.
        event_change_percent: events without the effect minus those with it.
        median_us, p99_us: of how far it moves events that have a partner; NaN where none has.
    """

    missing_percent: float
    spurious_percent: float
    shifted_percent: float
    event_change_percent: float
    median_us: float
    p99_us: float

    @property
    def worst_percent(self) -> float:
        """The largest share of events that are missing, spurious or shifted."""
        return max(self.missing_percent, self.spurious_percent, self.shifted_percent)


NO_ERROR = OmissionError(0.0, 0.0, 0.0, 0.0, math.nan, math.nan)


def omission_error(
    without: EventArray, with_effect: EventArray, *, size: tuple[int, int], window_us: int, shift_us: float
) -> OmissionError:
    """Compare a stream in which an effect is left out with the one that it is in.

    Args:
        size, window_us: see :func:`~davis_rs.compare_events`.
        shift_us: a pair further apart than this counts as shifted.
    """
    found = compare_events(without, with_effect, size=size, window_us=window_us)
    percent = 100 / max(len(without), len(with_effect), 1)
    return OmissionError(
        percent * found.missing,
        percent * found.spurious,
        percent * float((np.abs(found.time_error_us) > shift_us).sum()),
        percent * (len(without) - len(with_effect)),
        found.median_us,
        found.p99_us,
    )


def omission_error_of_added(made: float, events: float) -> OmissionError:
    """What leaving out ``made`` events does that come on top of ``events`` of the scene, both in expectation.

    Less than one event counts as that part of an event.
    """
    percent = 100 * made / max(events + made, 1.0)
    error_us = 0.0 if events else math.nan
    return OmissionError(percent, 0.0, 0.0, -percent, error_us, error_us)
