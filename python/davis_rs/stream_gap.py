"""What is kept of data that cannot be kept: enough that everything after them decodes as if nothing was lost."""

from __future__ import annotations

import numpy as np

_IMU_END, _FRAME_END = 0x0007, 0x000A
_RESET = 0x0001


def gap_words(words: bytes) -> bytes:
    """The words to put in place of lost ones.

    Timestamps are relative to the wraps before them and columns to the row before them: so resets of the clock, wraps,
    the last timestamp and the last row stay, in their order. The ends of a frame and of an IMU sample are added, so
    that one cut in two by the gap is dropped by the decoder, not completed by what comes after.

    Args:
        words: whole words of a camera's stream.
    """
    stream = np.frombuffer(words, "<u2")
    group = stream >> 12
    clock = (stream == _RESET) | (group == 7)
    kept = clock.copy()
    stamps = np.flatnonzero(stream >> 15)
    # A timestamp from before the last wrap or reset says nothing of what follows.
    if stamps.size and not clock[stamps[-1] :].any():
        kept[stamps[-1]] = True
    rows = np.flatnonzero(group == 1)
    if rows.size:
        kept[rows[-1]] = True
    return stream[kept].tobytes() + np.array([_IMU_END, _FRAME_END], "<u2").tobytes()
