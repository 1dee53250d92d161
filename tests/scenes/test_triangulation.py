"""Polygons and strips as triangles: they cover what the polygon covers, once, and what is odd is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs.scene.files import triangulation
from davis_rs.scene.files.triangulation import cut_polygons, cut_strip
from davis_rs.scene.repairs import Repairs


def cut(polygon: npt.ArrayLike, number: int = 1) -> tuple[npt.NDArray[np.float64], str]:
    """A polygon's triangles (k, 3, 3), and what is told of it."""
    points, repairs = np.asarray(polygon, np.float64), Repairs(Path("mesh.obj"))
    row = np.arange(len(points))[None]
    places = cut_polygons(row, points, "line", np.array([number]), repairs)
    return points[row.ravel()[places]], str(repairs)


def areas(triangles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2


def flat(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Points (n, 2) in a plane of space that is aligned with nothing."""
    wide = np.asarray(points, np.float64)
    return np.c_[wide, np.zeros(len(wide))] @ Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix().T + [7, -3, 2]


UP = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()[:, 2]


def check(outline: npt.ArrayLike) -> None:
    """All triangles turn as the polygon does, and their areas add up to its own: so none lies on another."""
    triangles, said = cut(flat(outline))
    upright = areas(triangles) @ UP
    assert (upright > 0).all()
    x, y = np.asarray(outline, np.float64).T
    assert upright.sum() == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2, rel=1e-9)
    assert said == ""


def test_polygons_by_hand() -> None:
    """A dart whose first corner is blind, an L, a comb, a spiral's end, and a square with a square hole by a bridge."""
    check([[2.0, 0.0], [0.2, 0.2], [0.0, 2.0], [0.0, 0.0]])
    check([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    check([*[[x, (x % 2) * 5 + 1] for x in range(21)][::-1], [-1, 0], [21, 0]])
    check([[0, 0], [5, 0], [5, 5], [1, 5], [1, 2], [3, 2], [3, 3], [2, 3], [2, 4], [4, 4], [4, 1], [0, 1]])
    check([[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]])
    check([[0, 0], [1, 0], [2, 0], [2, 2], [1, 2], [0, 2]])  # corners in the middle of an edge


@given(st.lists(st.tuples(st.floats(0.05, 1), st.floats(0.1, 1)), min_size=4, max_size=24), st.integers(0, 23))
def test_star_shaped_polygons_are_covered_once(corners: list[tuple[float, float]], first: int) -> None:
    """Corners at any distance from a point that all of them see, begun anywhere."""
    radius, step = np.array(corners).T
    angle = np.cumsum(step) / step.sum() * 2 * np.pi
    if np.diff(angle, prepend=angle[-1] - 2 * np.pi).max() >= np.pi:
        return
    outline = np.roll(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), first, 0)
    check(outline)


def test_polygons_that_cross_themselves_are_told() -> None:
    """A bow tie, whose areas cancel, and a pentagram: both are filled, and the line says where the first is."""
    triangles, said = cut(flat([[0, 0], [1, 1], [1, 0], [0, 1]]), 12)
    assert len(triangles) == 2
    assert said == "faces cross themselves and are filled as well as triangles can: 1 (the first: line 12)"
    angle = np.arange(5) * 4 * np.pi / 5
    triangles, said = cut(flat(np.stack([np.cos(angle), np.sin(angle)], 1)))
    assert len(triangles) == 3
    assert "cross themselves" in said


def test_polygons_that_are_not_flat_are_told_where_they_are_far_from_it() -> None:
    """A square bent by a tenth of its side is what meshes are made of; by its whole side it is not."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.1]])
    triangles, said = cut(square)
    assert len(triangles) == 2
    assert said == ""
    _, said = cut(square * [1, 1, 10], 3)
    assert said == "faces are far from flat and are cut as they look from straight above: 1 (the first: line 3)"


def test_faces_without_area_are_left_out_and_counted() -> None:
    """Corners that coincide, or lie on a line; an edge through a corner of the same polygon costs nothing."""
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0.0]])
    repairs = Repairs(Path("mesh.obj"))
    triangles = cut_polygons(np.array([[0, 1, 3], [0, 1, 2], [3, 3, 1]]), points, "face", np.array([5, 6, 7]), repairs)
    np.testing.assert_array_equal(triangles, [[0, 1, 2]])
    assert str(repairs) == "faces without area are left out: 2 (the first: face 6)"
    repairs = Repairs(Path("mesh.obj"))
    quads = np.array([[0, 1, 2, 3], [0, 1, 2, 1]])
    assert cut_polygons(quads, points, "face", np.array([1, 2]), repairs).tolist() == [[0, 2, 3]]
    assert str(repairs) == "faces without area are left out: 1 (the first: face 2)"


def test_ears_are_clipped_of_so_many_corners_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of a megabyte could keep a processor busy for days; a fan may have any number."""
    monkeypatch.setattr(triangulation, "MOST_CORNERS", 8)
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    assert len(cut(flat(np.stack([np.cos(angle), np.sin(angle)], 1)))[0]) == 98
    comb = [*[[x, (x % 2) * 5 + 1] for x in range(6)][::-1], [-1, 0], [6, 0]]
    check(comb)
    with pytest.raises(ValueError, match=r"mesh\.obj: line 4 has 9 corners, and none that sees all others"):
        cut(flat(np.array([*comb, [6, 0.5]])), 4)


def test_strips_turn_every_second_triangle_round() -> None:
    """Anew after each -1; a vertex named twice turns a corner, and keeps the count."""
    assert cut_strip(np.array([0, 1, 2, 3, 4, -1, 5, 6, 7, -1, 8, 9])).tolist() == [
        [0, 1, 2],
        [1, 3, 2],
        [2, 3, 4],
        [5, 6, 7],
    ]
    assert cut_strip(np.array([0, 1, 2, 2, 3, 4])).tolist() == [[0, 1, 2], [2, 4, 3]]
    assert cut_strip(np.array([], np.int64)).shape == (0, 3)
