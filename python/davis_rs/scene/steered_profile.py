"""Holds the strength of a light that a caller changes while a simulation runs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray
from ..geometry.trajectory.steered import HALF_TICK_S
from .light_profile import LightProfile


class SteeredProfile(LightProfile):
    """Follows what a caller decides: factor after factor, linear in time between two, 1 before the first.

    Only those factors are kept that an open shutter may still see.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all changes."""
        self._t_s, self._factors = [0.0], [1.0]

    def put(self, factor: float) -> None:
        """Begin with a factor; nothing may have changed yet."""
        self._factors = [factor]

    def change(self, start_us: int, end_us: int, factor: float, *, seen_from_us: float) -> None:
        """Change to ``factor`` over (start_us, end_us], and forget what ended before ``seen_from_us``."""
        while len(self._t_s) > 1 and self._t_s[1] < seen_from_us * 1e-6:
            del self._t_s[0], self._factors[0]
        if start_us * 1e-6 > self._t_s[-1]:
            self._t_s.append(start_us * 1e-6)
            self._factors.append(self._factors[-1])
        self._t_s.append(end_us * 1e-6)
        self._factors.append(factor)

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.interp(np.asarray(t_s, np.float64), self._t_s, self._factors)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        t = np.asarray(t_s, np.float64)
        if len(self._t_s) == 1:
            return np.zeros_like(t)
        slopes = np.diff(self._factors) / np.diff(self._t_s)
        number = np.clip(np.searchsorted(self._t_s, t + HALF_TICK_S, side="right") - 1, 0, len(slopes) - 1)
        return np.where(t <= self._t_s[-1] + HALF_TICK_S, slopes[number], 0.0)

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        """Return where changes begin and end, but for the end of the last one, after which nothing is known yet."""
        t_s = np.array(self._t_s[:-1], np.float64)
        return t_s[(t_s >= start_s) & (t_s <= end_s)]

    def describe(self) -> dict[str, object]:
        return {"kind": "steered", "now": self._factors[-1]}
