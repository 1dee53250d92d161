"""Keeps noise of frames from becoming a change of light: what does not change by more than noise stays as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..simulation.from_frames.interpolation import SensorFrame
from ..simulation.from_frames.light import LumaFrame
from ..simulation.from_frames.luma_noise import LumaNoise

_SIDE = 5
_AS_NOISE, _AS_CHANGE = 2.0, 4.0
"""The mean square change over 5 x 5 pixels, in units of that of noise: 1 +- 0.28 where nothing changes. Up to the first
value light stays, from the second on it is that of the new frame, in between it goes a part of the way."""


def still(frames: Iterable[SensorFrame], noise: LumaNoise | None) -> Iterator[SensorFrame]:
    """Yield the frames, in which only what changes by more than noise has changed.

    The pixels that make events have no part in the noise of frames, and their references lie anywhere between two
    levels. So any noise of a frame that reaches the light makes events in some of them, however low it is. Slow changes
    are not lost: a pixel is compared with the light that it was left at, so they add up until they are seen.

    Args:
        frames: in the order of time.
        noise: of their luma; None leaves them as they are.
    """
    from scipy.ndimage import uniform_filter

    held: LumaFrame | None = None
    for frame in frames:
        if noise is None or held is None:
            held = frame.luma
        else:
            change = frame.luma - held
            variance = np.maximum(2 * (noise.read**2 + noise.gain * np.maximum(held, 0)), np.float32(1e-20))
            size = uniform_filter((change**2 / variance).astype(np.float32), _SIDE, mode="nearest")
            fraction = np.clip((size - _AS_NOISE) / (_AS_CHANGE - _AS_NOISE), 0, 1)
            held = np.asarray(held + fraction * change, np.float32)
        yield frame._replace(luma=held)
