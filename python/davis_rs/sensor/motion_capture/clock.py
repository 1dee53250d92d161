"""The clock of the motion capture, which is not the camera's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class MocapClock(Effect):
    """The motion capture's clock: at the camera's time t it shows (1 + ``drift``) t + ``offset_s``.

    Args:
        offset_s: -10..10 s.
        drift: seconds a second, -0.1..0.1.

    The default drift is the paper's, 2 ms in a minute.

    Raises:
        ValueError: for values out of range.

    Source: Mueggler et al., IJRR 2017, known issues: clock drift and offset.
    """

    offset_s: float = 0.0
    drift: float = 2e-3 / 60

    name: ClassVar[str] = "mocap_clock_offset_s"
    acts_on: ClassVar[Where] = "ground truth"

    def __post_init__(self) -> None:
        check_range("mocap_clock_offset_s offset_s", self.offset_s, -10.0, 10.0, "s")
        check_range("mocap_clock_offset_s drift", self.drift, -0.1, 0.1)

    @property
    def neutral(self) -> bool:
        """Whether it is the camera's clock."""
        return self.offset_s == 0 and self.drift == 0
