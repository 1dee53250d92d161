"""Outlines with fewer corners, against one line at a time."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs.scene.files.outlines import simplified

FloatArray = npt.NDArray[np.float64]
LOW, HIGH, CELLS = np.zeros(2), np.ones(2), np.array([40.0, 20.0])


def ring(random: np.random.Generator, count: int) -> FloatArray:
    """A rough circle, which is cut off at the ends of the texture where it reaches them."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = random.uniform(0.1, 0.6) * (1 + 0.1 * random.standard_normal(count))
    centre = random.uniform(0.2, 0.8, 2)
    return np.clip(centre + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), 0, 1)


def one_by_one(corners: FloatArray, tolerance: float) -> FloatArray:
    """Douglas and Peucker's rule, by recursion, between the corners that must stay."""
    count = len(corners)
    points = np.concatenate([corners, corners[:1]]) * CELLS
    stays = {0, int(np.linalg.norm(points[:-1] - points[0], axis=1).argmax())}
    for number, end in itertools.product(range(count), range(4)):
        on = [bool(corners[(number + step) % count, end % 2] == (LOW, HIGH)[end // 2][end % 2]) for step in (-1, 0, 1)]
        if on[1] and not (on[0] and on[2]):
            stays.add(number)

    def divide(begin: int, end: int) -> None:
        if end - begin < 2:
            return
        along = points[end] - points[begin]
        length2 = along @ along
        off = []
        for point in points[begin + 1 : end]:
            place = float(np.clip((point - points[begin]) @ along / length2, 0, 1)) if length2 > 0 else 0.0
            off.append(float(np.linalg.norm(point - points[begin] - place * along)))
        if max(off) > tolerance:
            middle = begin + 1 + int(np.argmax(off))
            stays.add(middle)
            divide(begin, middle)
            divide(middle, end)

    for begin, end in itertools.pairwise([*sorted(stays), count]):
        divide(begin, end)
    return corners[sorted(stays)]


@pytest.mark.parametrize("tolerance", [0.0, 0.0625, 1.0, 100.0])
def test_all_rings_at_once_are_as_one_by_one(tolerance: float) -> None:
    """Of many sizes, of which some lie on the texture's ends."""
    random = np.random.default_rng(1)
    rings = [ring(random, count) for count in (1, 2, 3, 4, 7, 50, 400, 33)]
    square: Any = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.25, 1.0], [0.0, 1.0]]
    rings += [np.array(square), np.full((5, 2), 0.3)]
    found = simplified(rings, LOW, HIGH, CELLS, tolerance)
    for one, given in zip(found, rings, strict=True):
        np.testing.assert_array_equal(one, one_by_one(given, tolerance))


def test_no_rings() -> None:
    assert simplified([], LOW, HIGH, CELLS, 1.0) == []
