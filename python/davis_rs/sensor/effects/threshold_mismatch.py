"""Defines the effect of thresholds that differ from pixel to pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .effect import EngineEffect, Where

_NODES = 24


@dataclass(frozen=True)
class ThresholdMismatch(EngineEffect):
    """C_on and C_off of each pixel, drawn once: a fixed pattern for a seed.

    They are products of factors whose mean is 1. The factor of each pixel is log-normal, so never zero or negative.
    Those for ON and OFF are independent, or have a ``correlation``: both comparators share the gain of one amplifier,
    which moves both thresholds alike, and its reset level, which moves them apart. The factors of columns and rows are
    log-normal too, and the same for ON and OFF. Neighbouring columns may differ alternately.

    Args:
        sigma: standard deviation of the pixels' own factor, 0..1. Neutral where all are 0.
        correlation: of the logarithms of a pixel's own ON and OFF factors, -1..1.
        column_parity: even columns have thresholds lower by this fraction, odd ones higher, -0.5..0.5.
        columns, rows: standard deviations of what the pixels of a column, or of a row, have in common, 0..1.

    Raises:
        ValueError: for a value out of range.

    Source: Lichtsteiner, Posch and Delbruck, IEEE JSSC 43(2), 2008, section IV (2.1 % contrast mismatch at
    thresholds of about 15 %, so sigma 0.14). Parity: two public recordings of a DAVIS240C have 2.05 and 1.79 ON events,
    2.00 and 1.70 OFF events a pixel in even and odd columns (3.95 and 3.60, 5.10 and 4.68 the other), and no difference
    between even and odd rows. If events of a moving scene go by 1 / C, an assumption, that makes 0.074 and 0.045. No
    source is known for columns, rows and the correlation.
    """

    sigma: float
    column_parity: float = 0.0
    columns: float = 0.0
    rows: float = 0.0
    correlation: float = 0.0

    name: ClassVar[str] = "threshold_mismatch"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Return whether all pixels are alike."""
        return self.sigma == self.column_parity == self.columns == self.rows == 0

    def nodes(self, count: int = _NODES) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return factors of a threshold and their weights, for means over the pixels of a sensor, by Gauss's rule.

        Args:
            count: n, how many.

        Returns:
            float64 (2, n) factors, of even and of odd columns, and float64 (n,) weights, whose sum is 1/2.
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(count)
        variance = sum(math.log1p(part**2) for part in (self.sigma, self.columns, self.rows))
        factors = np.exp(math.sqrt(variance) * nodes - variance / 2)
        parity = np.array([[1 - self.column_parity], [1 + self.column_parity]])
        return parity * factors, weights / (2 * weights.sum())
