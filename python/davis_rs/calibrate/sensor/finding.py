"""Holds what was found of one quantity, or why it was not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...inspection.statistics.stream_statistics import Measured
from ...sensor.presets.sensor_file import unit_of


class Finding(NamedTuple):
    """What was found of one quantity.

    Attributes:
        what: in words.
        parameter: of :class:`~davis_rs.SensorParameters` that it gives; None for none.
        value: with its standard deviation; None where the recordings do not tell it.
        note: what else there is to say: a bound, why it cannot be told, or by how much the law fails.
    """

    what: str
    parameter: str | None
    value: Measured | None
    note: str = ""

    def __str__(self) -> str:
        said = "not identifiable from these recordings"
        if self.value is not None:
            unit = "" if self.parameter is None or unit_of(self.parameter) == "1" else f" {unit_of(self.parameter)}"
            said = f"{self.value}{unit}"
        return f"{self.what:<22} {said}{f'; {self.note}' if self.note else ''}"


def combined(found: Sequence[Measured]) -> Measured:
    """Return the mean of measurements of one quantity, weighted by their variances."""
    weights = np.array([1 / max(one.sigma, 1e-150) ** 2 for one in found])
    value = float(np.average([one.value for one in found], weights=weights))
    return Measured(value, float(1 / math.sqrt(weights.sum())))
