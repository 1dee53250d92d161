"""Cuts polygons and strips of a file into triangles, and notes what a user should know of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from ..repairs import Repairs

Indices = npt.NDArray[np.int64]

MOST_CORNERS = 8192
"""The most corners of a polygon whose ears are clipped: the time grows with the square of their number."""

_NO_AREA = 1e-12
"""A triangle has no area if it has less than this fraction of that of a square on its longest side."""
_BENT = 0.15
"""A polygon is far from flat where a corner lies off its plane by more than this fraction of its radius."""
_STRAIGHT = 1e-14
"""A corner of a polygon of size 1 is straight if its triangle is smaller than this."""
_FANS = 8
"""How many corners are tried as the centre of a fan."""


def cut_polygons(
    polygons: Indices, positions: FloatArray, name: str, numbers: npt.NDArray[np.integer], repairs: Repairs
) -> Indices:
    """Cut polygons into triangles, turned as the polygons are.

    A polygon with a corner that sees all others is cut into a fan there, any other one by clipping ears in its plane.
    One that crosses itself is covered as well as triangles can. Those without area are left out.

    Args:
        polygons: (m, n), the vertices of m polygons of n corners each.
        positions: (v, 3) of all vertices.
        name, numbers: the name of a polygon in messages: what is numbered, and the (m,) numbers.
        repairs: gets a note of what is left out, crosses itself or is far from flat.

    Returns:
        (k, 3), the triangles' corners as indices into ``polygons.ravel()``.

    Raises:
        ValueError: for a polygon whose ears are to be clipped and that has more than :data:`MOST_CORNERS`.
    """
    count, corners = polygons.shape
    points = positions[polygons]
    cut = np.zeros((count, 1, 3), np.int64) + np.arange(3)
    crossed = bent = np.zeros(count, bool)
    if corners > 3:
        around = points - points.mean(1, keepdims=True)
        size = np.sqrt((around**2).sum(2).max(1, initial=0.0))
        # Twice the vector area, which is the sum over any fan; 0 where the areas to the left and to the right cancel.
        normals = np.cross(around, np.roll(around, -1, 1)).sum(1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        upright = np.divide(normals, length, out=np.zeros_like(normals), where=length > 1e-9 * size[:, None] ** 2)
        bent = np.abs(np.einsum("mij,mj->mi", around, upright)).max(1, initial=0.0) > _BENT * size
        cut, blind = _fans(points, upright)
        crossed = np.zeros(count, bool)
        if len(blind) and corners > MOST_CORNERS:
            raise ValueError(
                f"{repairs.path}: {name} {numbers[blind[0]]} has {corners} corners, and none that sees all others: "
                f"such a polygon may have {MOST_CORNERS}; export triangles"
            )
        for number in blind:
            cut[number], crossed[number] = _ears(_flat(around[number], upright[number]))
    rows = np.arange(count)[:, None, None]
    whole = has_area(points[rows, cut])
    empty = ~whole.any(1)
    for which, kind in (
        (empty, "faces without area are left out"),
        (crossed & ~empty, "faces cross themselves and are filled as well as triangles can"),
        (bent & ~crossed & ~empty, "faces are far from flat and are cut as they look from straight above"),
    ):
        if which.any():
            repairs.add(kind, int(which.sum()), f"{name} {numbers[which.argmax()]}")
    return (rows * corners + cut)[whole]


def cut_strip(strip: Indices) -> Indices:
    """Cut a strip of triangles, or several with -1 between them.

    Every second triangle of a strip is turned round. Triangles that name a vertex twice only turn corners: they are
    left out.

    Args:
        strip: (n,), vertices.

    Returns:
        (k, 3), the triangles' vertices, turned as the strip's first.
    """
    index = np.arange(max(0, len(strip) - 2))
    begin = np.maximum.accumulate(np.where(strip < 0, np.arange(len(strip)) + 1, 0))[: len(index)]
    odd = (index - begin) % 2
    triangles = strip[np.stack([index, index + 1 + odd, index + 2 - odd], 1)]
    return distinct(triangles[(triangles >= 0).all(1)])


def distinct(triangles: Indices) -> Indices:
    """Return the triangles (k, 3) that have three different vertices."""
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def has_area(corners: FloatArray) -> npt.NDArray[np.bool_]:
    """Return whether triangles (..., 3, 3) have an area."""
    first, second = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    longer = np.maximum((first**2).sum(-1), (second**2).sum(-1))
    area: npt.NDArray[np.bool_] = np.linalg.norm(np.cross(first, second), axis=-1) > _NO_AREA * longer
    return area


def doubled_area(triangles: FloatArray) -> FloatArray:
    """Return twice the signed area of triangles (k, 3, 2) in a plane."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _fans(points: FloatArray, upright: FloatArray) -> tuple[Indices, Indices]:
    """Cut polygons into fans from a corner that sees all others.

    Args:
        points: (m, n, 3).
        upright: (m, 3), the unit normals; 0 where they are not known.

    Returns:
        The corners (m, n - 2, 3) of the triangles, and the numbers of the polygons that have no such corner, or one
        that is not tried. Those without area count as cut.
    """
    corners = points.shape[1]
    first = np.stack([np.zeros(corners - 2, np.int64), np.arange(1, corners - 1), np.arange(2, corners)], 1)
    cut = np.tile(first, (len(points), 1, 1))
    left = np.flatnonzero(has_area(points[:, first]).any(1))
    for turn in range(min(corners, _FANS)):
        indices = (first + turn) % corners
        a, b, c = np.moveaxis(points[left][:, indices], 2, 0)
        areas = np.cross(b - a, c - a)
        along = np.einsum("mij,mj->mi", areas, upright[left])
        good = (along >= -1e-9 * np.linalg.norm(areas, axis=2)).all(1) & upright[left].any(1)
        cut[left[good]] = indices
        left = left[~good]
    return cut, left


def _flat(points: FloatArray, upright: FloatArray) -> FloatArray:
    """Project a polygon's corners (n, 3) onto its plane, (n, 2), counterclockwise and scaled to size 1.

    Args:
        upright: (3,), unit; 0 for the plane that is nearest to the corners.
    """
    if upright.any():
        aside = np.cross(upright, np.eye(3)[np.abs(upright).argmin()])
        axes = np.stack([aside, np.cross(upright, aside)]) / np.linalg.norm(aside)
    else:
        axes = np.linalg.svd(points, full_matrices=False)[2][:2]
    flat: FloatArray = points @ axes.T
    return flat / max(np.abs(flat).max(), np.finfo(float).tiny)


def _ears(points: FloatArray) -> tuple[Indices, bool]:
    """Clip the ears of a polygon (n, 2) that turns left: triangles (n - 2, 3), and whether it crosses itself.

    An ear is a corner whose neighbours see each other: it turns left, and no corner that turns right lies in its
    triangle (Meisters, Polygons have ears, 1975).
    """
    ring = np.arange(len(points))
    triangles: list[Indices] = []
    crossed = False
    start = 0
    while len(ring) > 3:
        turns = _turns(points[ring])
        inward = points[ring[turns <= 0]]
        corners = np.stack([np.roll(ring, 1), ring, np.roll(ring, -1)], 1)
        # The search starts where the last ear was, so that not all triangles meet in one corner.
        order = np.roll(np.arange(len(ring)), -start)
        ears = (i for i in order[turns[order] > _STRAIGHT] if not _inside(inward, points[corners[i]]))
        ear = next(ears, None)
        if ear is None:
            ear = int(turns.argmax())
            crossed = crossed or bool(turns.min() < -_STRAIGHT)
        triangles.append(corners[ear])
        ring = np.delete(ring, ear)
        start = int(ear)
    crossed = crossed or bool(_turns(points[ring]).min() < -_STRAIGHT)
    return np.array([*triangles, ring]), crossed


def _turns(ring: FloatArray) -> FloatArray:
    """Return twice the signed area of each corner (n, 2) with its neighbours: > 0 where the ring turns left."""
    before, after = ring - np.roll(ring, 1, 0), np.roll(ring, -1, 0) - ring
    turns: FloatArray = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return turns


def _inside(points: FloatArray, triangle: FloatArray) -> bool:
    """Return whether any point (k, 2) lies in a counterclockwise triangle (3, 2), or on its rim but not at a corner."""
    to = points[:, None] - triangle
    side = np.roll(triangle, -1, 0) - triangle
    within = (side[:, 0] * to[..., 1] - side[:, 1] * to[..., 0] >= 0).all(1)
    return bool((within & (to != 0).any(2).all(1)).any())
