"""Random numbers for Mitsuba's integrators that depend on the seed and on each lane's own number alone."""

from __future__ import annotations

import functools
from typing import Any


@functools.cache
def frame_sampler() -> Any:
    """The class of Mitsuba's independent sampler numbered by the rays' places in the frame, not in the launch."""
    import mitsuba as mi

    class FrameSampler(mi.Sampler):  # type: ignore[misc]
        def __init__(self, seed: Any, place: Any) -> None:
            super().__init__(mi.Properties())
            self._generator = mi.PCG32()
            self._generator.seed(*mi.sample_tea_32(mi.UInt32(seed), place))

        def next_1d(self, active: Any = True) -> Any:
            return self._generator.next_float32(mi.Mask(active))

        def next_2d(self, active: Any = True) -> Any:
            x = self.next_1d(active)
            return mi.Point2f(x, self.next_1d(active))

    return FrameSampler
