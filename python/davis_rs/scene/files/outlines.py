"""Leaves out corners of outlines that hardly matter, of many outlines at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray

IntArray = npt.NDArray[np.int64]


def simplified(
    rings: list[FloatArray], low: FloatArray, high: FloatArray, cells: FloatArray, tolerance: float
) -> list[FloatArray]:
    """Return rings (n, 2), n >= 1, with fewer corners, none of which moves; lines move by at most ``tolerance`` cells.

    Along the texture's ends no line moves: there would be cracks between a repeated texture's tiles.

    Source: Douglas and Peucker, Algorithms for the Reduction of the Number of Points Required to Represent a Digitized
    Line, 1973. All lines are divided at the same time, because a texture of leaves has thousands of short ones.

    Args:
        low, high: (2,), the ends of the texture.
        cells: (2,), in a unit of length along u and v.
    """
    if not rings:
        return []
    sizes = np.array([len(ring) for ring in rings])
    # Each ring is closed: its first corner comes again at its end.
    starts = np.cumsum([0, *(sizes + 1)[:-1]])
    ends = starts + sizes
    corners = np.concatenate([np.concatenate([ring, ring[:1]]) for ring in rings])
    points = corners * cells
    kept = _turns_at_ends(corners, starts, ends, low, high)
    away = np.linalg.norm(points - np.repeat(points[starts], sizes + 1, axis=0), axis=1)
    kept[starts] = kept[_first_largest(away, starts)] = kept[ends] = True
    begin = np.flatnonzero(kept)
    begin, end = begin[:-1], begin[1:]
    long = (end - begin > 1) & ~np.isin(begin, ends)
    while long.any():
        begin, end = begin[long], end[long]
        middle, off = _farthest(points, begin, end)
        split = off > tolerance
        kept[middle[split]] = True
        begin, end = (
            np.concatenate([begin[split], middle[split]]),
            np.concatenate([middle[split], end[split]]),
        )
        long = end - begin > 1
    kept[ends] = False
    return [corners[start:end][kept[start:end]] for start, end in zip(starts.tolist(), ends.tolist(), strict=True)]


def _turns_at_ends(
    corners: FloatArray, starts: IntArray, ends: IntArray, low: FloatArray, high: FloatArray
) -> npt.NDArray[np.bool_]:
    """Return at which corners a ring meets an end of the texture, or leaves it."""
    at_end = np.concatenate([corners == low, corners == high], 1)
    number = np.arange(len(corners))
    before, after = number - 1, number + 1
    before[starts], after[ends] = ends - 1, starts + 1
    return np.asarray((at_end & ~(at_end[before] & at_end[after])).any(1))


def _farthest(points: FloatArray, begin: IntArray, end: IntArray) -> tuple[IntArray, FloatArray]:
    """Return for each line from one point to another which point in between is farthest from it, and how far."""
    count = end - begin - 1
    line = np.repeat(np.arange(len(begin)), count)
    first = np.cumsum(count) - count
    number = np.arange(len(line)) - first[line] + begin[line] + 1
    between, along = points[number] - points[begin][line], (points[end] - points[begin])[line]
    square = (along**2).sum(1)
    place = np.clip((between * along).sum(1) / np.where(square > 0, square, np.inf), 0, 1)
    off = np.linalg.norm(between - place[:, None] * along, axis=1)
    farthest = _first_largest(off, first)
    return number[farthest], off[farthest]


def _first_largest(values: FloatArray, starts: IntArray) -> IntArray:
    """Return the number of the first largest value of each group, by the numbers of the groups' first values."""
    largest = np.maximum.reduceat(values, starts)
    where = np.flatnonzero(values == np.repeat(largest, np.diff([*starts, len(values)])))
    group = np.searchsorted(starts, where, "right") - 1
    return np.asarray(where[np.unique(group, return_index=True)[1]])
