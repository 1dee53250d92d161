"""Holds what is known of a sensor when one of its parameters is fitted: what was found before, and the base."""

from __future__ import annotations

from collections.abc import Iterable

from ...inspection.statistics.stream_statistics import Measured
from ...sensor.parameters import SensorParameters
from ...sensor.presets.sensor_file import SensorFile
from .finding import Finding


class KnownParameters:
    """Parameters with their standard deviations.

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
        """The sensor that all else comes from."""
        return self._base.parameters

    def get(self, name: str) -> Measured | None:
        """Return what was found of a parameter, or what the base has, with its error or 0; None if neither knows."""
        return self._found.get(name) or self.of_base(name)

    def of_base(self, name: str) -> Measured | None:
        """Return what the base has."""
        value = getattr(self.base, name)
        return None if value is None else Measured(float(value), self._base.uncertainties.get(name, 0.0))
