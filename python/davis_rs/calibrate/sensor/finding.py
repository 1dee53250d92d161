"""Holds what was found of a sensor's quantities, and what is known when the next one is fitted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ...inspection.statistics.stream_statistics import Measured
from ...sensor.parameters import SensorParameters
from ...sensor.presets.sensor_file import SensorFile, unit_of


class Finding(NamedTuple):
    """Holds what was found of one quantity, or why it was not.

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


def combined(values: Sequence[Measured]) -> Measured:
    """Return the mean of measurements of one quantity, weighted by their variances."""
    weights = np.array([1 / max(one.sigma, 1e-150) ** 2 for one in values])
    value = float(np.average([one.value for one in values], weights=weights))
    return Measured(value, float(1 / math.sqrt(weights.sum())))


class KnownParameters:
    """Holds what is known of a sensor when one of its parameters is fitted: what was found before, and the base.

    Args:
        findings: what was found.
        base: all else.
    """

    def __init__(self, findings: Iterable[Finding], base: SensorFile) -> None:
        self._found = {
            one.parameter: one.value for one in findings if one.parameter is not None and one.value is not None
        }
        self._base = base

    @property
    def base(self) -> SensorParameters:
        """Return the sensor that all else comes from."""
        return self._base.parameters

    def get(self, name: str) -> Measured | None:
        """Return what was found of a parameter, or what the base has, with its error or 0; None if neither knows."""
        return self._found.get(name) or self.of_base(name)

    def of_base(self, name: str) -> Measured | None:
        """Return what the base has."""
        value = getattr(self.base, name)
        return None if value is None else Measured(float(value), self._base.uncertainties.get(name, 0.0))
