"""Looks at triangles from candidate places by rays of the core, and says how much there is to see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._core import PixelRays, SceneRenderer
from ...geometry.pose import FloatArray
from ..default_paths import CAMERA

_WIDTH, _HEIGHT = 48, 36
"""Rays of a look, over the image of the default camera."""
_TILES = (4, 4)
"""Rows and columns of parts of the image. What is seen in one of them cannot make up for the others."""
_CREASE = float(np.cos(np.radians(20.0)))
"""Surfaces that meet at a larger angle make an edge."""
_STEP = 0.03
"""So does a surface that lies behind another by more than this fraction of the distance."""
_ENOUGH = 0.3
"""Fraction of a tile's rays at an edge that counts as full of things."""
_DEPTH = 0.3
"""How much the depth of a look counts, compared with that of the deepest look."""
_MANY, _FINE = 150_000, 1 / 1500
"""The vertices of more triangles than this are moved to a lattice first, so fine by the world's longest side."""
_NOTHING = np.uint32(2**32 - 1)


class Sight:
    """Casts rays at triangles in the world.

    Args:
        corners: (n, 3, 3), metres.
        shapes: (n,) the number of each triangle's shape: an edge between two shapes is seen.
        one_sided: (n,) whether the back of each is seen through.
    """

    def __init__(self, corners: FloatArray, shapes: npt.NDArray[np.int64], one_sided: npt.NDArray[np.bool_]) -> None:
        if len(corners) > _MANY:
            corners, kept = _coarse(corners)
            shapes, one_sided = shapes[kept], one_sided[kept]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        self._shapes, self._normals = shapes, normals
        count, zeros = len(corners), np.zeros(len(corners), np.uint32)
        maps = np.zeros(4 * count)
        points = corners.reshape(-1, 3)
        self._core = SceneRenderer(
            corners=np.ascontiguousarray(corners, np.float64).ravel(),
            planes=np.c_[normals, -np.einsum("nk,nk->n", normals, corners[:, 0])].ravel(),
            u_maps=maps,
            v_maps=maps,
            normal_maps=None,
            textures=zeros,
            two_sided=zeros + np.uint32(1),
            culled=one_sided.astype(np.uint32),
            frames=zeros,
            frame_count=1,
            layouts=np.array([0, 1, 1, 0], np.int64),
            texels=[np.zeros(9, np.float32)],
            lights=[("constant", 0, 1.0, 0.0, [0.0, 0.0, 0.0], None, None)],
            shadows=False,
            centre=((points.min(0) + points.max(0)) / 2).tolist(),
            step=1e-4,
            end=1e-3,
        )
        column = (np.arange(_WIDTH) + 0.5) * CAMERA.width / _WIDTH
        row = (np.arange(_HEIGHT) + 0.5) * CAMERA.height / _HEIGHT
        self._x = ((column - CAMERA.width / 2) / CAMERA.fx).astype(np.float32)
        self._y = ((row - CAMERA.height / 2) / CAMERA.fy).astype(np.float32)
        self._rays = PixelRays.grid(_WIDTH, _HEIGHT, 1, self._x, self._y)

    def interest(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Return how much cameras see (n,), 0 to 1: in how many parts of the image there are edges of surfaces.

        Of all these looks, those that go far count more, because a near surface hides what lies behind it.

        Args:
            positions: (n, 3), metres.
            rotations: (n, 3, 3), from camera axes (x right, y down, z forward) to the world's.
        """
        depth, triangle = self._look(positions, rotations)
        hit = triangle != _NOTHING
        which = np.where(hit, triangle, 0).astype(np.int64)
        rays = np.stack(np.broadcast_arrays(self._x, self._y[:, None], np.float32(1)), -1).astype(np.float64)
        away = np.einsum("nij,hwj->nhwi", rotations, rays)
        points = away * np.where(hit, depth, 0.0)[..., None]
        normals = self._normals[which]
        normals *= np.where(np.einsum("nhwi,nhwi->nhw", normals, away) > 0, -1.0, 1.0)[..., None]
        edges = np.zeros(hit.shape, np.bool_)
        for axis in (1, 2):
            one = tuple(slice(None, -1) if i == axis else slice(None) for i in range(3))
            next_ = tuple(slice(1, None) if i == axis else slice(None) for i in range(3))
            nearest = np.minimum(depth[one], depth[next_])
            off = points[next_] - points[one]
            step = np.minimum(
                np.abs(np.einsum("nhwi,nhwi->nhw", off, normals[one])),
                np.abs(np.einsum("nhwi,nhwi->nhw", off, normals[next_])),
            )
            crease = np.einsum("nhwi,nhwi->nhw", normals[one], normals[next_]) < _CREASE
            both = hit[one] & hit[next_]
            other = self._shapes[which[one]] != self._shapes[which[next_]]
            edges[one] |= both & (crease | other | (step > _STEP * np.where(both, nearest, 1.0)))
            edges[one] |= hit[one] != hit[next_]
        rows, columns = _TILES
        tiles = edges.reshape(-1, rows, _HEIGHT // rows, columns, _WIDTH // columns).mean((2, 4))
        seen = np.minimum(tiles / _ENOUGH, 1.0).mean((1, 2))
        depths = np.where(hit, depth, np.nan).reshape(len(hit), -1)
        depths[~hit.any((1, 2))] = 0.0
        typical = np.nanmedian(depths, axis=1)
        return np.round(seen * (1 - _DEPTH + _DEPTH * typical / max(float(typical.max()), 1e-300)), 3)

    def shapes_seen(self, positions: FloatArray, rotations: FloatArray, count: int) -> FloatArray:
        """Return which fraction of the image (n, count) each shape has in each look, by the shapes' numbers."""
        _, triangle = self._look(positions, rotations)
        looks, hit = len(positions), triangle != _NOTHING
        look = np.broadcast_to(np.arange(looks)[:, None, None], triangle.shape)[hit]
        shape = self._shapes[triangle[hit].astype(np.int64)]
        seen = np.bincount(look * count + shape, minlength=looks * count).reshape(looks, count)
        return np.asarray(seen / triangle[0].size)

    def _look(
        self, positions: FloatArray, rotations: FloatArray
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
        """Return the depths of what the rays of n looks hit (n, H, W), and the triangles' numbers."""
        count = len(positions)
        still = np.zeros(3 * count)
        views = (
            np.ascontiguousarray(positions, np.float64).ravel(),
            np.ascontiguousarray(rotations, np.float64).ravel(),
            still,
            still,
            np.ones(count),
            np.zeros(count),
        )
        depth, triangle = self._core.depth(self._rays, views)
        return depth.reshape(count, _HEIGHT, _WIDTH), triangle.reshape(count, _HEIGHT, _WIDTH)


def _coarse(corners: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Move vertices to a lattice, which leaves no holes, and return the triangles (m, 3, 3) that are still there, and
    their numbers."""
    points = corners.reshape(-1, 3)
    step = _FINE * float(np.ptp(points, axis=0).max())
    places = np.rint(corners / step)
    a, b, c = places.swapaxes(0, 1)
    kept = np.flatnonzero(np.any(np.cross(b - a, c - a) != 0, axis=1))
    return (places[kept] * step, kept) if len(kept) else (corners, np.arange(len(corners)))
