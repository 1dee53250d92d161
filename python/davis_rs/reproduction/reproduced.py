"""Holds how well a recording is reproduced."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .._util.array_types import JsonObject
from ..calibrate.sensor import SensorFit
from ..events.arrays import EventArray
from ..inspection.statistics.stream_statistics import Measured
from ..sensor.presets import SensorFile
from .clip import Half
from .clip_statistics import Statistic, deviation

MOST_SIGMA = 0.3
"""A statistic of the recording whose standard deviation is a larger fraction of it is not judged."""

WITHIN = 3.0
"""A statistic is reproduced if it is within so many standard deviations."""


class Row(NamedTuple):
    """Holds one statistic of the recording and of each other stream.

    Attributes:
        name, unit: of the statistic.
        real: of the recording.
        others: by the name of the stream, its value, and the difference over its standard deviation (z); z is NaN
            where nothing is judged.
        judged: whether the recording tells the statistic to 30 %.
    """

    name: str
    unit: str
    real: Measured
    others: dict[str, tuple[Measured, float]]
    judged: bool


def row_of(real: Statistic, others: dict[str, Statistic]) -> Row:
    """Compare a statistic.

    The difference's standard deviation is that of its own draws: the same tiles are drawn for both streams, so what the
    scene has in some tiles only is not taken for a difference.
    """
    value = Measured(float(real.draws[0]), deviation(real.draws))
    judged = bool(value.sigma <= MOST_SIGMA * abs(value.value))
    compared = {}
    for name, other in others.items():
        sigma = deviation(other.draws - real.draws)
        difference = float(other.draws[0] - real.draws[0])
        z = 0.0 if difference == 0 else difference / sigma if sigma > 0 else math.nan
        compared[name] = (Measured(float(other.draws[0]), deviation(other.draws)), z if judged else math.nan)
    return Row(real.name, real.unit, value, compared, judged)


@dataclass(frozen=True, eq=False)
class ReproducedHalf:
    """Holds one half of a recording, simulated with a sensor that was fitted to the other half.

    Attributes:
        half: that is compared.
        fit: of the other half.
        sensor: that came of it.
        log_eps: dark level, as a fraction of the brightest value of the frames, from their noise.
        lux_per_luma: illuminance that was taken for the brightest value.
        rows: the statistics.
        agreement: correlations with the recording; their ``real`` is what one half of the recording's own events,
            drawn at random, has with the other half.
        whole_ceiling: correlations of one such half with all events, in the order of ``agreement``.
        streams: the events that were compared, by name; ``real`` is the recording.
    """

    half: Half
    fit: SensorFit
    sensor: SensorFile
    log_eps: Measured
    lux_per_luma: float
    rows: tuple[Row, ...]
    agreement: tuple[Row, ...]
    whole_ceiling: tuple[float, ...]
    streams: dict[str, EventArray]

    def within(self, stream: str) -> tuple[int, int]:
        """Return how many statistics of a stream lie within three standard deviations, and how many are judged."""
        z = [row.others[stream][1] for row in self.rows if row.judged]
        return sum(abs(one) <= WITHIN for one in z), len(z)

    def describe(self) -> JsonObject:
        """Return all numbers in JSON's types; None where there is none."""
        return {
            "half": self.half.name,
            "frames": [self.half.frames[0], self.half.frames[-1]],
            "start_us": self.half.start_us,
            "stop_us": self.half.stop_us,
            "log_eps": _plain(self.log_eps),
            "lux_per_luma": self.lux_per_luma,
            "statistics": [_described(row) for row in self.rows],
            "agreement": [
                _described(row) | {"half_against_whole": _number(whole)}
                for row, whole in zip(self.agreement, self.whole_ceiling, strict=True)
            ],
            "within_3_sigma": {name: list(self.within(name)) for name in self.streams if name != "real"},
        }


def _described(row: Row) -> JsonObject:
    return {
        "name": row.name,
        "unit": row.unit,
        "judged": row.judged,
        "real": _plain(row.real),
        "others": {name: _plain(value) | {"z": _number(z)} for name, (value, z) in row.others.items()},
    }


def _plain(measured: Measured) -> JsonObject:
    return {"value": _number(measured.value), "sigma": _number(measured.sigma)}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
