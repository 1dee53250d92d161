"""Keeps enough of lost data that everything after them decodes as if nothing was lost."""

from __future__ import annotations

import numpy as np

_RESET = 0x0001
_EMPTY_PARTS = np.array([0x0005, 0x0007, 0x0008, 0x000A], "<u2").tobytes()
"""An inertial sample and a frame with nothing in them."""


def gap_words(words: bytes) -> bytes:
    """Return the words to put in place of lost ones.

    Timestamps are relative to the wraps before them and columns to the row before them: so resets of the clock, wraps,
    the last timestamp and the last row stay, in their order. An empty sample and an empty frame are added: they make
    the decoder drop one that the gap cut in two, where what comes after might have completed it wrongly.

    Args:
        words: whole words of a camera's stream.
    """
    stream = np.frombuffer(words, "<u2")
    group = stream >> 12
    kept = (stream == _RESET) | (group == 7)
    for last_of in (stream >> 15 == 1, group == 1):
        positions = np.flatnonzero(last_of)
        kept[positions[-1:]] = True
    return stream[kept].tobytes() + _EMPTY_PARTS
