"""Cuts the events of a file into blocks, each of which can be read without those before it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError

UNKNOWN_US = -1
"""Stands for a time that is only known when the block is read."""

BLOCK = 1 << 14
"""Events of a block in files that have none of their own."""


@dataclass(frozen=True)
class Blocks:
    """Says where a file's events are.

    Attributes:
        starts: int64 (n + 1,): the number of the first event of each block, and last the number of all events.
        first_us: int64 (n,): the time of each block's first event, :data:`UNKNOWN_US` where it is not known.
        positions: int64 (n, k): where each block is, in terms of the format.
        last_us: the time of the last event, :data:`UNKNOWN_US` where it is not known.
    """

    starts: npt.NDArray[np.int64]
    first_us: npt.NDArray[np.int64]
    positions: npt.NDArray[np.int64]
    last_us: int = UNKNOWN_US

    def __len__(self) -> int:
        return len(self.first_us)


def blocks_of(
    counts: npt.ArrayLike, first_us: npt.ArrayLike | None, positions: npt.ArrayLike, last_us: int = UNKNOWN_US
) -> Blocks:
    """Return blocks by the number of events of each."""
    numbers = np.asarray(counts, np.int64)
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(numbers)])
    times = np.full(len(numbers), UNKNOWN_US, np.int64) if first_us is None else np.asarray(first_us, np.int64)
    rows = np.asarray(positions, np.int64)
    return Blocks(starts, times, rows if rows.ndim == 2 else rows[:, np.newaxis], last_us)


def equal_blocks(events: int, size: int) -> Blocks:
    """Return blocks of ``size`` events each, the last one shorter; their positions are their first and last events'
    numbers."""
    starts = np.append(np.arange(0, events, size, dtype=np.int64), events)
    return Blocks(starts, np.full(len(starts) - 1, UNKNOWN_US, np.int64), np.stack([starts[:-1], starts[1:]], axis=1))


def refuse(path: str | os.PathLike[str], why: str) -> NoReturn:
    """Say that a file cannot be read in blocks.

    Raises:
        DecodeError: always, with what to do about it.
    """
    raise DecodeError(
        f"{os.fspath(path)}: {why}, so that it is only read from its beginning; convert it to another format first "
        "(davis-rs convert IN OUT)"
    )


def pieces(blocks: Blocks, first: int, stop: int) -> Iterator[tuple[int, slice]]:
    """Yield the blocks that hold events ``first`` to ``stop``, and which part of each."""
    block = int(np.searchsorted(blocks.starts, first, side="right")) - 1
    while first < stop:
        start, end = int(blocks.starts[block]), int(blocks.starts[block + 1])
        yield block, slice(first - start, min(stop, end) - start)
        first = max(first, end)
        block += 1


BlockPosition = npt.NDArray[np.int64]
"""A row of :attr:`Blocks.positions`."""
