"""Defines what all effects have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import asdict
from numbers import Real
from typing import ClassVar, Literal

import numpy as np

from ..._core import check_effects
from ..._util.argument_checks import is_number

Where = Literal["luma", "log intensity", "pixel", "stream", "frames", "imu", "ground truth"]


class Effect(ABC):
    """An imperfection of a real sensor: a frozen dataclass whose first field is what ``--effect NAME=VALUE`` sets.

    Attributes:
        name: its name in :class:`~davis_rs.Effects` and on the command line, with its unit.
        acts_on: where in the sensor it acts.
    """

    name: ClassVar[str]
    acts_on: ClassVar[Where]

    @property
    @abstractmethod
    def neutral(self) -> bool:
        """Whether the effect changes nothing with these values; it is then off."""

    def settings(self) -> dict[str, float | None]:
        """Return the effect's parameters by name."""
        return asdict(self)  # type: ignore[call-overload]  # implementations are dataclasses

    def random(self, seed: int, *, purpose: int = 0, index: int = 0) -> np.random.Generator:
        """Return a generator that depends only on (seed, effect, purpose, index); a name's first 8 bytes stand for the
        effect.

        Source: Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011 (Philox).
        """
        effect = int.from_bytes(self.name.encode()[:8], "little")
        counter = np.array([0, 0, purpose, index], np.uint64)
        return np.random.Generator(np.random.Philox(key=np.array([seed, effect], np.uint64), counter=counter))


class EngineEffect(Effect):
    """An effect that the crossing engine simulates; the engine checks the ranges of its parameters."""

    def __post_init__(self) -> None:
        for name, value in self.settings().items():
            if value is not None and not is_number(value):
                raise ValueError(f"{self.name}: {name} must be a number, got {value!r}")
        check_effects({self.name: self.settings()})


def check_range(name: str, value: object, low: float, high: float, unit: str = "", *, finite: bool = True) -> None:
    """Refuse a number outside of low..high.

    Args:
        finite: whether infinity is refused even where ``high`` is infinite.

    Raises:
        ValueError: naming the parameter, its value and the allowed range.
    """
    if not isinstance(value, bool) and isinstance(value, Real):
        inside = not value < low and value <= high  # False for NaN
        if inside and not (finite and math.isinf(value)):
            return
    ending = f" {unit}" if unit else ""
    allowed = f"be finite and >= {low:g}" if finite and math.isinf(high) else f"lie in {low:g}..{high:g}"
    raise ValueError(f"{name} must {allowed}{ending}, got {value!r}")
