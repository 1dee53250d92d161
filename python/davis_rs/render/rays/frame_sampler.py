"""Gives Mitsuba's integrators random numbers that depend only on the seed and on a ray's number in the frame."""

from __future__ import annotations

import functools

from ..._mitsuba.types import JitArray, JitIndex, JitMask, MitsubaSampler


@functools.cache
def frame_sampler() -> MitsubaSampler:
    """Return a class like Mitsuba's independent sampler, seeded by the rays' numbers in the frame."""
    import mitsuba as mi

    class FrameSampler(mi.Sampler):  # type: ignore[misc]
        def __init__(self, seed: JitIndex, number: JitIndex) -> None:
            super().__init__(mi.Properties())
            self._generator = mi.PCG32()
            self._generator.seed(*mi.sample_tea_32(mi.UInt32(seed), number))

        def next_1d(self, active: JitMask = True) -> JitArray:
            return self._generator.next_float32(mi.Mask(active))

        def next_2d(self, active: JitMask = True) -> JitArray:
            x = self.next_1d(active)
            return mi.Point2f(x, self.next_1d(active))

    return FrameSampler
