"""Runs a twin of the pixels, which sees the same light and has no noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .._core import CrossingEngine
from ..events.arrays import EventArray, concatenate_events
from ..sampling.keyframes import SparseSamples
from ..sensor.effects import Effects


class NoiselessTwin:
    """Holds the crossing engine of a twin, and its events until they are asked for.

    The twin has the engine's thresholds, start phases, bandwidth, refractory period and readout, by the same draws, and
    lacks the effects of :data:`~davis_rs.sensor.effects.effects.NOISE`. Where there are none of these the engine is its
    own twin, and nothing is computed twice.

    Args:
        make_engine: makes a crossing engine with these effects, else as the run's engine.
        effects: of the run's engine.
        wanted: whether the twin's events are wanted at all.
    """

    def __init__(self, make_engine: Callable[[Effects], CrossingEngine], effects: Effects, *, wanted: bool) -> None:
        noisy = effects.noiseless != effects
        self._engine = make_engine(effects.noiseless) if wanted and noisy else None
        self._wanted, self._pending = wanted, list[EventArray]()

    def push(
        self,
        t_us: int,
        luma: npt.NDArray[np.float32],
        rate: npt.NDArray[np.float32] | None = None,
        *,
        sparse: SparseSamples | None = None,
    ) -> None:
        """Take a keyframe, as :meth:`~davis_rs.CrossingEngine.push`."""
        if self._engine is not None:
            self._pending.append(self._engine.push(t_us, luma, rate, sparse=sparse))

    def push_log(self, t_us: int, log_intensity: npt.NDArray[np.float64]) -> None:
        """Take a keyframe, as :meth:`~davis_rs.CrossingEngine.push_log`."""
        if self._engine is not None:
            self._pending.append(self._engine.push_log(t_us, log_intensity))

    def take(self, events: EventArray, end_us: int) -> EventArray | None:
        """Return the twin's events up to ``end_us`` that were not taken yet; None where none are wanted.

        Args:
            events: those of the engine in the same time, which are the twin's where there is no noise.
        """
        if self._engine is None:
            return events if self._wanted else None
        pending = concatenate_events(self._pending)
        count = int(np.searchsorted(pending["t"], end_us, side="right"))
        self._pending = [pending[count:]]
        return pending[:count]

    def flush(self, events: EventArray) -> EventArray | None:
        """Return all that was not taken yet, with what the readout still holds; None where none are wanted.

        Args:
            events: those that the engine's readout still held, likewise.
        """
        if self._engine is None:
            return events if self._wanted else None
        late, self._pending = concatenate_events([*self._pending, self._engine.flush()]), []
        return late


def last_time_us(events: EventArray, noiseless: EventArray | None) -> int | None:
    """Return when the last event of both streams is; None where there is none."""
    streams = (events, events[:0] if noiseless is None else noiseless)
    return max((int(each["t"][-1]) for each in streams if len(each)), default=None)
