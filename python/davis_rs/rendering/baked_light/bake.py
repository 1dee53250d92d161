"""Bakes a scene's light: irradiance on its surfaces, once, as maps that the renderers look up."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from ...luma import LUMA_WEIGHTS
from .irradiance import Irradiance, Reflected, relative_error
from .surface_lattice import RefinementRule, SampledLight, SurfaceLattice, refine

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Known = tuple[FloatArray, FloatArray]
Gathered = Callable[..., FloatArray]

BAKE_ERROR = 0.01
"""How much light may err where nothing else is said, relative."""

FEWEST_SAMPLES, MOST_SAMPLES, COARSE_SAMPLES, TRUE_SAMPLES = 64, 1024, 128, 4096
_SHIFTS = 3
_TRUE_SHIFT = 1000
_PILOTS = 128
_MEASURED = 256

_DIRECT_SPACING, _INDIRECT_SPACING, _DIRECT_FINEST, _INDIRECT_FINEST = 1 / 96, 1 / 16, 1 / 512, 1 / 256
"""How far apart points are at most and at least, shares of the scene's diagonal, for an error of :data:`BAKE_ERROR`."""

_TWO_OF_THREE = 0.68
_SETTLED = 0.1
"""Light has bounced often enough when the last time added less than this share of the error."""

_GLIMPSE_SAMPLES = 256

_COARSE_ERROR = 0.04
"""Of light that bounces again before it is gathered: what it errs averages out."""

_MOST_POINTS = 400_000


@dataclass(frozen=True)
class Surfaces:
    """What is baked, in the order of the scene table's records.

    Attributes:
        corners: float64 (t, 3, 3), metres.
        normals: float64 (t, 3, 3), unit shading normals of the front, at the corners.
        two_sided: bool (t).
        counts: how many of them each of the scene's shapes has.
    """

    corners: FloatArray
    normals: FloatArray
    two_sided: npt.NDArray[np.bool_]
    counts: Sequence[int]


@dataclass(frozen=True)
class LightMaps:
    """Irradiance / pi of one or several lights on both sides of each triangle.

    Attributes:
        divisions: int64 (t, 2): a map has 2 to the power of this many cells along an edge; that of a back which does
            not reflect is -1.
        texels: for each light float32 (n, 3), RGB: all maps one after the other, triangle by triangle and front before
            back, each with a frame of one texel around it, row by row.
        error: how much the light errs, relative: measured, of three places two err less.
        points: at how many places light was computed.
        samples: points on each lamp, and rays that gather what bounces, for each place.
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
        return _layouts(self.divisions)


def bake(
    surfaces: Surfaces,
    lights: Sequence[Irradiance],
    error: float,
    *,
    seen: Callable[[str, int, int], None] = lambda *_: None,
) -> LightMaps:
    """Compute light until it errs by no more than a share of itself.

    Direct light is sampled first. It is then gathered as often as light bounces, coarsely but for the last time.

    Args:
        lights: each is kept apart, so that its strength can change later.
        error: relative, of the sum of all lights.
        seen: is told what is computed, at how many points it is known by then, and at how many after the next step.
    """
    start = time.monotonic()
    lattice = SurfaceLattice(surfaces.corners, surfaces.normals, surfaces.two_sided)
    job = _Job(surfaces, lattice, error, seen)
    pilots = job.places(_PILOTS, 0)
    total = sum((_glimpse(light, pilots) for light in lights), np.zeros((_PILOTS, 3)))
    most = [0, 0]
    sampled = list[list[SampledLight]]()
    gathered = list[Gathered | None]()
    for light in lights:
        parts = list[SampledLight]()
        for shining in light.direct_parts:
            samples, off = _enough_samples(shining, pilots, total, error)
            most[0] = max(most[0], samples)
            parts.append(job.direct(light, partial(shining, samples=samples), off, total))
        gathered.append(None)
        if light.bounces:
            of_light = job.reflected(light, parts)
            gathered[-1] = of_light
        sampled.append(parts)
    for light, parts, gather in zip(lights, sampled, gathered, strict=True):
        if gather is not None:
            samples, off = _enough_samples(gather, pilots, total, error)
            most[1] = max(most[1], samples)
            parts.append(job.bounced(light, gather, samples, error, off))
    every = [part for parts in sampled for part in parts]
    divisions = np.max([np.zeros(len(lattice.faces), np.int64), *(part.divisions() for part in every)], axis=0)
    of_sides = job.of_sides(divisions)
    layouts = _layouts(of_sides)
    texels = [_texels(lattice, parts, divisions, layouts) for parts in sampled]
    seen("what it errs", job.points, job.points + _MEASURED)
    return LightMaps(
        of_sides,
        texels,
        job.measured(lights, gathered, layouts, texels),
        job.points,
        (most[0], most[1]),
        all(part.complete for part in every),
        time.monotonic() - start,
    )


class _Job:
    """What all lights of a bake share."""

    def __init__(
        self, surfaces: Surfaces, lattice: SurfaceLattice, error: float, seen: Callable[[str, int, int], None]
    ) -> None:
        self._surfaces, self._lattice, self._error, self._seen = surfaces, lattice, error, seen
        self._diagonal = float(np.linalg.norm(np.ptp(surfaces.corners.reshape(-1, 3), axis=0)))
        self.points = 0

    def _told(self, what: str) -> Callable[[int, int], None]:
        return lambda done, expected: self._seen(what, self.points + done, self.points + expected)

    def _refined(
        self, what: str, light_at: Callable[[FloatArray, FloatArray], Known], rule: RefinementRule
    ) -> SampledLight:
        sampled = refine(self._lattice, light_at, rule, self._told(what))
        self.points += len(sampled.values)
        return sampled

    def direct(self, light: Irradiance, shining: Gathered, off: float, total: FloatArray) -> SampledLight:
        """Direct light.

        Args:
            off: what it errs at each place.
            total: all light at some places. Direct light that is weak next to it need not be known so well.
        """
        luma = total @ LUMA_WEIGHTS
        typical = float(np.quantile(luma[luma > 0], 0.1)) if (luma > 0).any() else 0.0

        def lit(places: FloatArray, normals: FloatArray) -> Known:
            values = _unless_buried(light, places, normals, shining(places, normals))
            return values, np.full(len(places), typical)

        error = self._error
        rule = _rule(self._diagonal, (_DIRECT_SPACING, _DIRECT_FINEST), error, 2 * error + off)
        return self._refined("direct light", lit, rule)

    def bounced(self, light: Irradiance, gather: Gathered, rays: int, error: float, off: float = 0.0) -> SampledLight:
        """What surfaces reflect; ``off``: what it errs at each place."""

        def bounced(places: FloatArray, normals: FloatArray) -> Known:
            values = _unless_buried(light, places, normals, gather(places, normals, samples=rays))
            return values, light.direct(places, normals, FEWEST_SAMPLES) @ LUMA_WEIGHTS

        rule = _rule(self._diagonal, (_INDIRECT_SPACING, _INDIRECT_FINEST), error, 4 * error + off)
        return self._refined("bounces", bounced, rule)

    def reflected(self, light: Irradiance, direct: list[SampledLight]) -> Gathered:
        """A function that gathers what surfaces reflect of direct light and of all bounces but the last."""
        of_direct = [self._reflected(light, part) for part in direct]
        gather = partial(light.gathered, reflected=of_direct)
        bounced: SampledLight | None = None
        for bounce in range(1, light.most_bounces):
            if bounced is None:
                bounced, change = self.bounced(light, gather, COARSE_SAMPLES, max(self._error, _COARSE_ERROR)), np.inf
            else:
                told = self._told(f"bounce {bounce}")
                told(0, len(bounced.values))
                more = bounced.with_light(partial(gather, samples=COARSE_SAMPLES))
                was, now = (part.values.sum() for part in (bounced, more))
                bounced, change = more, (now - was) / now if now > 0 else 0.0
            gather = partial(light.gathered, reflected=[*of_direct, self._reflected(light, bounced)])
            if change < _SETTLED * self._error:
                break
        return gather

    def _reflected(self, light: Irradiance, part: SampledLight) -> Reflected:
        divisions = part.divisions()
        layouts = _layouts(self.of_sides(divisions))
        texels = _texels(self._lattice, [part], divisions, layouts)
        return light.reflected(self._surfaces.counts, self._surfaces.normals.mean(1), layouts, texels)

    def of_sides(self, divisions: IntArray) -> IntArray:
        """Divisions (t, 2) of fronts and backs, -1 for backs that do not reflect, from those of the lattice's sides."""
        of_sides = np.full((len(self._surfaces.corners), 2), -1, np.int64)
        of_sides[self._lattice.triangles, _side(self._lattice)] = divisions
        return of_sides

    def places(self, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
        """Places spread over the surfaces, by area, and their normals."""
        places, face, _ = self._spread(count, seed)
        return places, self._lattice.normals[self._lattice.faces[face, 0]]

    def _spread(self, count: int, seed: int) -> tuple[FloatArray, IntArray, FloatArray]:
        corners = self._lattice.positions[self._lattice.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        random = np.random.RandomState(seed)
        face = random.choice(len(area), count, p=area / area.sum())
        weight = random.dirichlet(np.ones(3), count)
        return np.einsum("nk,nkd->nd", weight, corners[face]), face, weight

    def measured(
        self,
        lights: Sequence[Irradiance],
        gathered: Sequence[Gathered | None],
        layouts: IntArray,
        texels: Sequence[npt.NDArray[np.float32]],
    ) -> float:
        """How much maps err: at places between their points, against light from many more samples.

        The error, relative, than which two of three places err less. Those without light do not count.
        """
        places, face, weight = self._spread(_MEASURED, 1)
        lattice = self._lattice
        normals = np.einsum("nk,nkd->nd", weight, lattice.normals[lattice.faces[face]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        truth, found = np.zeros((_MEASURED, 3)), np.zeros((_MEASURED, 3))
        of_face = layouts[lattice.triangles[face], _side(lattice)[face]]
        for light, gather, maps in zip(lights, gathered, texels, strict=True):
            if light.has_direct:
                truth += light.direct(places, normals, samples=TRUE_SAMPLES, shift=_TRUE_SHIFT)
            if gather is not None:
                truth += gather(places, normals, samples=TRUE_SAMPLES, shift=_TRUE_SHIFT)
            found += looked_up(maps, of_face, weight)
        luma = truth @ LUMA_WEIGHTS
        lit = luma > 1e-3 * (np.median(luma[luma > 0]) if (luma > 0).any() else 0.0)
        if not lit.any():
            return 0.0
        return float(np.quantile(np.abs((found @ LUMA_WEIGHTS)[lit] / luma[lit] - 1), _TWO_OF_THREE))


def looked_up(texels: npt.NDArray[np.float32], layouts: IntArray, weight: FloatArray) -> FloatArray:
    """Light (n, 3) of maps with layouts (n, 4), at places with these shares (n, 3) of their triangles' corners."""
    first, side = layouts[:, 0], layouts[:, 1]
    place = weight[:, 1:] * (side - 1)[:, None]
    cell = np.minimum(place.astype(np.int64), (side - 2).clip(min=0)[:, None])
    x, y = (place - cell).T[..., None]
    stride = side + 2
    at = first + (cell[:, 1] + 1) * stride + cell[:, 0] + 1
    above = (1 - x) * texels[at] + x * texels[at + 1]
    below = (1 - x) * texels[at + stride] + x * texels[at + stride + 1]
    return np.asarray((1 - y) * above + y * below, np.float64)


def _rule(diagonal: float, distances: tuple[float, float], error: float, tolerance: float) -> RefinementRule:
    # What linear interpolation errs grows with the square of the distance.
    wider = float(np.clip(np.sqrt(error / BAKE_ERROR), 0.25, 4.0))
    spacing, finest = (share * diagonal * wider for share in distances)
    # Once its middle is known, an edge errs by a quarter of what it did before.
    return RefinementRule(spacing, finest, tolerance, _MOST_POINTS)


def _layouts(divisions: IntArray) -> IntArray:
    sides = 2 ** divisions.clip(min=0) + 1
    sizes = np.where(divisions >= 0, (sides + 2) ** 2, 0).ravel()
    first = np.cumsum([0, *sizes])[:-1].reshape(-1, 2)
    layouts = np.stack([first, sides, sides, np.ones_like(sides)], -1)
    none = divisions[:, 1] < 0
    layouts[none, 1] = layouts[none, 0]
    return np.asarray(layouts)


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


def _glimpse(light: Irradiance, pilots: tuple[FloatArray, FloatArray]) -> FloatArray:
    """A first idea of a light."""
    glimpse = np.zeros((len(pilots[0]), 3))
    if light.has_direct:
        glimpse += light.direct(*pilots, _GLIMPSE_SAMPLES)
    if light.bounces:
        glimpse += light.traced(*pilots, _GLIMPSE_SAMPLES)
    return glimpse


def _enough_samples(
    light: Gathered, pilots: tuple[FloatArray, FloatArray], total: FloatArray, error: float
) -> tuple[int, float]:
    """How many samples a place needs, and what it errs with so many, as a share of all light."""
    samples = FEWEST_SAMPLES
    while True:
        batches = np.array([light(*pilots, samples=samples, shift=shift) for shift in range(_SHIFTS)])
        off = relative_error(batches, total)
        if off <= error / 2 or samples >= MOST_SAMPLES:
            return samples, off
        samples *= 2


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
