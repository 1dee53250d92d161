"""A brute-force ray caster in float64, written from the renderers' contract: what they are checked against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Hits:
    """What m rays see: the triangle (m,), -1 for nothing; its depth (m,), inf for nothing; how much farther the next
    one lies, as a share of the depth (m,)."""

    triangle: IntArray
    depth: FloatArray
    margin: FloatArray


def cast(corners: FloatArray, rays: FloatArray) -> Hits:
    """First hits of rays (m, 3) from the origin among triangles (n, 3, 3) in the same axes; depth is along the ray.

    Source: Moeller, Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
    """
    first, one, other = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(rays[:, None], other[None])
    determinant = np.einsum("mnk,nk->mn", across, one)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -np.einsum("mnk,nk->mn", across, first) / determinant
        q = np.cross(-first, one)
        v = (rays @ q.T) / determinant
        depth = np.einsum("nk,nk->n", other, q)[None] / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0)
    depth = np.where(hit, depth, np.inf)
    ordered = np.sort(np.concatenate([depth, np.full((len(rays), 2), np.inf)], 1), 1)
    nearest = depth.argmin(1) if len(corners) else np.zeros(len(rays), np.int64)
    found = np.isfinite(ordered[:, 0])
    with np.errstate(invalid="ignore"):
        margin = np.where(np.isfinite(ordered[:, 1]), (ordered[:, 1] - ordered[:, 0]) / ordered[:, 0], np.inf)
    return Hits(np.where(found, nearest, -1), ordered[:, 0], margin)


def met(corners: FloatArray, origins: FloatArray, ways: FloatArray) -> FloatArray:
    """Where rays from origins (n, k, 3) along ways (n, k, 3) meet triangles (n, 3, 3): bundles of k rays, one triangle
    each. Multiples of the ways (n, k); inf for those that miss.

    Source: Moeller, Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
    """
    one, other = (corners[:, None, i] - corners[:, None, 0] for i in (1, 2))
    across, from_first = np.cross(ways, other), origins - corners[:, None, 0]
    determinant = (across * one).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (from_first * across).sum(-1) / determinant
        q = np.cross(from_first, one)
        v = (ways * q).sum(-1) / determinant
        far = (other * q).sum(-1) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)
    return np.where(hit, far, np.inf)


def distance_to_edges(corners: FloatArray, rays: FloatArray) -> FloatArray:
    """How far rays (m, 3) with z = 1 pass in the image, in units of the focal length, from any edge of triangles
    (n, 3, 3) in camera axes, hidden ones too; what lies behind the camera has no image."""
    ends = np.stack([corners, np.roll(corners, -1, 1)], 2).reshape(-1, 2, 3)
    least = 1e-9 * np.abs(corners).max(initial=1.0)
    ends = np.where(ends[:, :1, 2:] < ends[:, 1:, 2:], ends[:, ::-1], ends)  # the end farther before the camera first
    start, end = ends[ends[:, 0, 2] > least].swapaxes(0, 1)
    rise = np.where(start[:, 2] > end[:, 2], start[:, 2] - end[:, 2], 1.0)
    cut = start + (end - start) * ((start[:, 2] - least) / rise)[:, None]
    end = np.where(end[:, 2:] < least, cut, end)
    a, along = start[:, :2] / start[:, 2:], end[:, :2] / end[:, 2:] - start[:, :2] / start[:, 2:]
    squared = np.maximum((along**2).sum(1), 1e-300)
    nearest = np.full(len(rays), np.inf)
    for i, ray in enumerate(rays[:, :2]):
        share = np.clip(((ray - a) * along).sum(1) / squared, 0.0, 1.0)
        nearest[i] = np.linalg.norm(ray - a - share[:, None] * along, axis=1).min(initial=np.inf)
    return nearest


def shadowed(corners: FloatArray, origins: FloatArray, light: FloatArray, *, end: float) -> npt.NDArray[np.bool_]:
    """Whether a triangle lies between places (m, 3) and a point light, in all but the last share of the way."""
    return np.array([_meets(corners, origin, light - origin, 1.0 - end) for origin in origins], np.bool_)


def sunless(corners: FloatArray, origins: FloatArray, towards: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether a triangle lies between places (m, 3) and a light that shines from a direction."""
    return np.array([_meets(corners, origin, towards, np.inf) for origin in origins], np.bool_)


def _meets(corners: FloatArray, origin: FloatArray, way: FloatArray, far: float) -> bool:
    depth = cast(corners - origin, way[None]).depth[0]
    return bool(np.isfinite(depth) and depth <= far)


def distance_to_shadow_edges(corners: FloatArray, places: FloatArray, light: FloatArray) -> FloatArray:
    """How far places (m, 3) lie from the planes through a point light and an edge of any triangle, as far as the edge
    throws its shadow there, metres; inf where no edge does. ``light`` (3,); for a sun (4,): (way to it, 0)."""
    sun = len(light) == 4
    a, b = corners.reshape(-1, 3), np.roll(corners, -1, 1).reshape(-1, 3)
    to_a, to_b = (np.broadcast_to(-light[:3], a.shape),) * 2 if sun else (a - light, b - light)
    normals = np.cross(to_a, b - a) if sun else np.cross(to_a, to_b)
    lengths = np.linalg.norm(normals, axis=1)
    thrown = lengths > 1e-12
    a, b, to_a, to_b, normals = (
        part[thrown] for part in (a, b, to_a, to_b, normals / np.where(thrown, lengths, 1)[:, None])
    )
    # The shadow's strip behind an edge: a place is a + share (b - a) + behind (away from the light) + distance normal.
    frames = np.linalg.inv(np.stack([b - a, to_a, normals] if sun else [to_a, to_b, normals], 2))
    nearest = np.empty(len(places))
    for i, place in enumerate(places):
        one, other, distance = np.einsum(
            "nij,nj->ni", frames, place - a if sun else np.broadcast_to(place - light, a.shape)
        ).T
        if sun:
            strip = (one > -0.01) & (one < 1.01) & (other > -1e-3)
        else:
            total = one + other
            strip = (total > 0.99) & (other > -0.01 * total) & (one > -0.01 * total)
        nearest[i] = np.abs(distance[strip]).min(initial=np.inf)
    return nearest
