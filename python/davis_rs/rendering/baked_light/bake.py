"""Bakes a scene's light: irradiance on its surfaces, once, as maps that the renderers look up."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from ...luma import LUMA_WEIGHTS
from .irradiance import Irradiance, relative_error
from .surface_lattice import RefinementRule, SampledLight, SurfaceLattice, refine

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Known = tuple[FloatArray, FloatArray]

BAKE_ERROR = 0.01
"""How much light may err where nothing else is said, relative."""

FEWEST_SAMPLES, MOST_SAMPLES = 64, 512
_SHIFTS = 3
_PILOTS = 128

_DIRECT_SPACING, _INDIRECT_SPACING, _DIRECT_FINEST, _INDIRECT_FINEST = 1 / 96, 1 / 16, 1 / 512, 1 / 48
"""How far apart points are at most and at least, shares of the scene's diagonal, for an error of :data:`BAKE_ERROR`."""

_MOST_POINTS = 400_000


@dataclass(frozen=True)
class Surfaces:
    """What is baked, in the order of the scene table's records.

    Attributes:
        corners: float64 (t, 3, 3), metres.
        normals: float64 (t, 3, 3), unit shading normals of the front, at the corners.
        two_sided: bool (t).
    """

    corners: FloatArray
    normals: FloatArray
    two_sided: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class LightMaps:
    """Irradiance / pi of one or several lights on both sides of each triangle.

    Attributes:
        divisions: int64 (t, 2): a map has 2 to the power of this many cells along an edge; that of a back which does
            not reflect is -1.
        texels: for each light float32 (n, 3), RGB: all maps one after the other, triangle by triangle and front before
            back, each with a frame of one texel around it, row by row.
        error: how much the light errs, relative: by the number of samples and by interpolation.
        points: at how many places light was computed.
        samples: points on each lamp, and paths, for each place.
        complete: whether the maps are as fine as the error asks for.
        seconds: how long it took.
    """

    divisions: IntArray
    texels: list[npt.NDArray[np.float32]]
    error: float
    points: int
    samples: tuple[int, int]
    complete: bool
    seconds: float

    @property
    def layouts(self) -> IntArray:
        """(t, 2, 4): first texel, width, height and wrap mode of each map; a back without one has the front's."""
        sides = 2 ** self.divisions.clip(min=0) + 1
        sizes = np.where(self.divisions >= 0, (sides + 2) ** 2, 0).ravel()
        first = np.cumsum([0, *sizes])[:-1].reshape(-1, 2)
        layouts = np.stack([first, sides, sides, np.ones_like(sides)], -1)
        none = self.divisions[:, 1] < 0
        layouts[none, 1] = layouts[none, 0]
        return layouts


def bake(
    surfaces: Surfaces,
    lights: Sequence[Irradiance],
    error: float,
    *,
    seen: Callable[[str, int, int], None] = lambda *_: None,
) -> LightMaps:
    """Compute light until it errs by no more than a share of itself.

    Args:
        lights: each is kept apart, so that its strength can change later.
        error: relative, of the sum of all lights.
        seen: is told what is computed, at how many points it is known by then, and at how many after the next step.
    """
    start = time.monotonic()
    lattice = SurfaceLattice(surfaces.corners, surfaces.normals, surfaces.two_sided)
    corners = surfaces.corners.reshape(-1, 3)
    diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
    pilots = _pilots(lattice)
    samples, sampling_error = _enough_samples(pilots, lights, error)
    sampled, points = list[list[SampledLight]](), 0
    for light in lights:
        parts = []
        typical = 0.0
        if light.bounces:

            def bounced(places: FloatArray, normals: FloatArray, light: Irradiance = light) -> Known:
                values = _unless_buried(light, places, normals, light.indirect(places, normals, samples[1]))
                return values, light.direct(places, normals, FEWEST_SAMPLES) @ LUMA_WEIGHTS

            rule = _rule(diagonal, (_INDIRECT_SPACING, _INDIRECT_FINEST), error, 4 * error)
            parts.append(refine(lattice, bounced, rule, partial(seen, "bounces")))
            luma = parts[-1].values @ LUMA_WEIGHTS
            typical = float(np.quantile(luma[luma > 0], 0.1)) if (luma > 0).any() else 0.0
        if light.has_direct:

            def shining(
                places: FloatArray, normals: FloatArray, light: Irradiance = light, typical: float = typical
            ) -> Known:
                values = _unless_buried(light, places, normals, light.direct(places, normals, samples[0]))
                return values, np.full(len(places), typical)

            rule = _rule(diagonal, (_DIRECT_SPACING, _DIRECT_FINEST), error, 2 * error)
            parts.append(refine(lattice, shining, rule, partial(seen, "direct light")))
        points += sum(len(part.values) for part in parts)
        sampled.append(parts)
    every = [part for parts in sampled for part in parts]
    divisions = np.max([part.divisions() for part in every], axis=0)
    of_sides = np.full((len(surfaces.corners), 2), -1, np.int64)
    of_sides[lattice.triangles, _side(lattice)] = divisions
    interpolation_error = float(np.sqrt(np.sum([part.error**2 for part in every])))
    maps = LightMaps(
        of_sides,
        [],
        float(np.hypot(sampling_error, interpolation_error)),
        points,
        samples,
        all(part.complete for part in every),
        0.0,
    )
    texels = [_texels(lattice, parts, divisions, maps.layouts) for parts in sampled]
    return LightMaps(of_sides, texels, maps.error, points, samples, maps.complete, time.monotonic() - start)


def _rule(diagonal: float, distances: tuple[float, float], error: float, tolerance: float) -> RefinementRule:
    # What linear interpolation errs grows with the square of the distance.
    wider = float(np.clip(np.sqrt(error / BAKE_ERROR), 0.25, 4.0))
    spacing, finest = (share * diagonal * wider for share in distances)
    # Once its middle is known, an edge errs by a quarter of what it did before.
    return RefinementRule(spacing, finest, tolerance, _MOST_POINTS)


def _side(lattice: SurfaceLattice) -> IntArray:
    """0 for fronts, 1 for backs: those after all fronts."""
    side = np.zeros(len(lattice.triangles), np.int64)
    fronts = int(lattice.triangles.max()) + 1
    side[fronts:] = 1
    return side


def _unless_buried(light: Irradiance, places: FloatArray, normals: FloatArray, values: FloatArray) -> FloatArray:
    """Light (n, 3), NaN where none can come."""
    dark = np.flatnonzero(values.sum(1) == 0)
    if len(dark):
        values[dark[light.is_buried(places[dark], normals[dark])]] = np.nan
    return values


def _pilots(lattice: SurfaceLattice) -> tuple[FloatArray, FloatArray]:
    """Places spread over the surfaces, by area."""
    corners = lattice.positions[lattice.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    random = np.random.RandomState(0)
    face = random.choice(len(area), _PILOTS, p=area / area.sum())
    weight = random.dirichlet(np.ones(3), _PILOTS)
    places = np.einsum("nk,nkd->nd", weight, corners[face])
    return places, lattice.normals[lattice.faces[face, 0]]


def _enough_samples(
    pilots: tuple[FloatArray, FloatArray], lights: Sequence[Irradiance], error: float
) -> tuple[tuple[int, int], float]:
    """How many points on lamps and how many paths a place needs, and the error with so many."""
    parts = [
        (index, compute)
        for light in lights
        for index, compute, there in ((0, light.direct, light.has_direct), (1, light.indirect, light.bounces))
        if there
    ]
    samples = [FEWEST_SAMPLES, FEWEST_SAMPLES]
    errors = [0.0, 0.0]
    open_parts = {index for index, _ in parts}
    batches: dict[int, FloatArray] = {}
    while open_parts:
        for index in open_parts:
            of_part = [compute for which, compute in parts if which == index]
            batches[index] = np.array(
                [sum(compute(*pilots, samples[index], shift) for compute in of_part) for shift in range(_SHIFTS)]
            )
        total = np.asarray(sum(of_shifts.mean(0) for of_shifts in batches.values()))
        for index in list(open_parts):
            errors[index] = relative_error(batches[index], total)
            if errors[index] <= error / np.sqrt(2) or samples[index] >= MOST_SAMPLES:
                open_parts.discard(index)
            else:
                samples[index] *= 2
    return (samples[0], samples[1]), float(np.hypot(errors[0], errors[1]))


def _texels(
    lattice: SurfaceLattice, parts: Sequence[SampledLight], divisions: IntArray, layouts: IntArray
) -> npt.NDArray[np.float32]:
    size = int((layouts[..., 0] + (layouts[..., 1] + 2) ** 2).max())
    texels = np.zeros((size, 3), np.float32)
    sides = _side(lattice)
    for part in parts:
        for faces, grids in part.grids(divisions):
            # Rows are along the second coordinate.
            framed = np.pad(grids.swapaxes(1, 2), ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
            first = layouts[lattice.triangles[faces], sides[faces], 0]
            at = first[:, None] + np.arange(framed.shape[1] ** 2)
            texels[at] += framed.reshape(len(faces), -1, 3).astype(np.float32)
    return texels


def map_coordinates(corners: FloatArray, divisions: IntArray) -> tuple[FloatArray, FloatArray]:
    """Affine maps of a place to the coordinates u and v in a triangle's light maps, (t, 2, 4) each.

    Args:
        corners: (t, 3, 3).
        divisions: (t, 2), see :class:`LightMaps`.
    """
    edges = corners[:, 1:] - corners[:, :1]
    cross = np.cross(edges[:, 0], edges[:, 1])
    squared = np.einsum("ij,ij->i", cross, cross)
    squared = np.where(squared > 0, squared, 1.0)[:, None]
    gradients = (np.cross(edges[:, 1], cross) / squared, np.cross(cross, edges[:, 0]) / squared)
    divisions = np.where(divisions < 0, divisions[:, :1], divisions)
    cells = (2.0**divisions)[..., None]
    maps = []
    for gradient in gradients:
        barycentric = np.concatenate([gradient, -np.einsum("ij,ij->i", gradient, corners[:, 0])[:, None]], 1)[:, None]
        maps.append((barycentric * cells + np.array([0, 0, 0, 0.5])) / (cells + 1))
    return maps[0], maps[1]
