"""Bakes a scene's light: irradiance on its surfaces, once, as maps that the renderers look up."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...events.luma import LUMA_WEIGHTS
from .instants import MOTION_TOLERANCE, MotionTimes, chosen
from .irradiance import Irradiance, Reflected, Surfaces, relative_error
from .light_maps import LightMaps, layouts_of, looked_up, side_of, texels_of, vector_layouts_of
from .seen_places import SeenPlaces
from .surface_lattice import INWARDS, CellHits, RefinementRule, SampledLight, SurfaceLattice, refine

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Known = tuple[FloatArray, FloatArray]
SurfacePoints = tuple[FloatArray, FloatArray, IntArray]
Gathered = Callable[..., FloatArray]

BAKE_ERROR = 0.01
"""How much light may err where nothing else is said, relative."""

FEWEST_SAMPLES, TRUE_SAMPLES = 64, 4096
_SHIFTS = 3
_TRUE_SHIFT = 1000
_PILOTS = 128
_MEASURED = 256

_DIRECT_SPACING, _INDIRECT_SPACING, _DIRECT_FINEST, _INDIRECT_FINEST = 1 / 96, 1 / 16, 1 / 512, 1 / 256
"""How far apart points are at most and at least, shares of the scene's diagonal, for an error of :data:`BAKE_ERROR`."""

_TWO_OF_THREE = 0.68
_GLIMPSE_SAMPLES = 256

_MOTION_PILOTS, _CANDIDATES, _MOTION_SAMPLES = 384, 4096, 256
"""Where, and from how many samples, it is seen how light changes while bodies move."""

_COARSE_ERROR = 0.04
"""Of light that bounces again before it is gathered: what it errs averages out."""

_COARSE_INWARDS = 0.3
"""How far its places are moved to the middle of triangles. Corners lie in nooks, which are darker than what is between
them. If light is linear on a triangle, its mean stays the same."""

_MOST_KEPT = 0.98
"""No more of what a bounce adds comes back the next time, so that errors do not grow without end."""

_SHARED_SPACINGS = (1 / 1024, 1 / 512, 1 / 256, 1 / 128)
"""How large places are within which corners share their light, shares of the scene's diagonal."""


@dataclass(frozen=True)
class Effort:
    """Says how much a bake may cost.

    Attributes:
        least_error: a smaller error is not asked for.
        most_points: of each part of the light besides the corners of triangles, where nothing moves; fewer at each of
            several instants.
        most_corners: where triangles have more of them, those that are close to each other and have similar normals
            share their light. None: they never do.
        most_samples: of each place, at least ``FEWEST_SAMPLES``.
        most_seen_samples: the same of places that a camera sees, if it is known what it sees.
        other_samples: of each place, to know other light there, which says what is a small error.
        coarse_samples: of each place for light that bounces again.
        vector_samples: of each place for the directions of light, where normal textures turn surfaces.
        looks: numbers of paths, and how often they bounce, until a place counts as one that no light reaches.
        settled: light has bounced often enough when the last time added less than this share of the error.
    """

    least_error: float
    most_points: int
    most_corners: int | None
    most_samples: int
    most_seen_samples: int
    other_samples: int
    coarse_samples: int
    vector_samples: int
    looks: tuple[tuple[int, int], ...]
    settled: float


_ENDLESS = 1 << 10

FULL_EFFORT = Effort(
    least_error=0.0,
    most_points=400_000,
    most_corners=None,
    most_samples=1024,
    most_seen_samples=1024,
    other_samples=64,
    coarse_samples=128,
    vector_samples=256,
    looks=((4, _ENDLESS), (64, _ENDLESS)),
    settled=0.1,
)
"""Of a bake that was asked for, or that a scene file's light needs."""

QUICK_EFFORT = Effort(
    least_error=0.05,
    most_points=60_000,
    most_corners=100_000,
    most_samples=FEWEST_SAMPLES,
    most_seen_samples=1024,
    other_samples=16,
    coarse_samples=8,
    vector_samples=32,
    looks=((4, 2), (8, 3)),
    settled=0.5,
)
"""Of the light that a world gets that has none of its own."""


def bake(
    surfaces: Surfaces,
    times: MotionTimes,
    lights_at: Callable[[float], Sequence[Irradiance]],
    error: float,
    *,
    effort: Effort = FULL_EFFORT,
    seen: SeenPlaces | None = None,
    told: Callable[[str, int, int], None] = lambda *_: None,
) -> LightMaps:
    """Compute light until it errs by no more than a share of itself.

    Where bodies move this is done at several instants. At each, direct light is sampled first. It is then gathered as
    often as light bounces, coarsely but for the last time.

    Args:
        times: at which of these light may be baked.
        lights_at: the lights, while bodies are where they are at that time, in seconds. Each is kept apart, so that its
            strength can change later.
        error: relative, of the sum of all lights, at least that of the effort.
        effort: what the bake may cost.
        seen: what a camera sees: light is finest there. None: it is as fine everywhere.
        told: is told what is computed, at how many points it is known by then, and at how many after the next step.
    """
    start = time.monotonic()
    lattice = _lattice(surfaces, effort, seen)
    job = _BakeJob(surfaces, lattice, error, effort, seen, told)
    taken, motion_error = job.instants(times, lights_at)
    job.count = len(taken)
    states = []
    for number, which in enumerate(taken):
        job.state = "" if len(taken) == 1 else f"instant {number + 1} of {len(taken)}: "
        lights = lights_at(float(times.tests[which]))
        states.append((lights, *job.sampled(lights)))
    every = [component for _, sampled, _ in states for components in sampled for component in components]
    divisions = np.max(
        [np.zeros(len(lattice.faces), np.int64), *(component.divisions() for component in every)], axis=0
    )
    of_sides = job.of_sides(divisions)
    layouts = layouts_of(of_sides)
    texels = [
        [texels_of(lattice, components, divisions, layouts) for components in sampled] for _, sampled, _ in states
    ]
    vectors = []
    if surfaces.bumpy.any():
        for number, (lights, sampled, gathered) in enumerate(states):
            job.state = "" if len(taken) == 1 else f"instant {number + 1} of {len(taken)}: "
            for light, components, gather in zip(lights, sampled, gathered, strict=True):
                vectors.append(job.vector_maps(light, components, gather, divisions, of_sides))
    if job.points == 0 and any(light.bounces or light.direct_parts for lights, *_ in states for light in lights):
        raise RuntimeError("light was baked at no point, although it falls on surfaces: this is a fault of davis_rs")
    job.state = ""
    told("what it errs", job.points, job.points + _MEASURED)
    mapped_states = [(lights, gathered, maps) for (lights, _, gathered), maps in zip(states, texels, strict=True)]
    follows = len(taken) == 1 or (times.fine and motion_error <= MOTION_TOLERANCE * error)
    return LightMaps(
        of_sides,
        [texels_of_light for maps in texels for texels_of_light in maps],
        surfaces.bumpy,
        vectors,
        times.tests[taken],
        job.measured(mapped_states, layouts),
        motion_error,
        job.points,
        job.most_samples,
        all(component.complete for component in every) and follows,
        time.monotonic() - start,
    )


class _BakeJob:
    """Bakes the lights of one scene: holds what all of them share, and counts points and samples."""

    def __init__(
        self,
        surfaces: Surfaces,
        lattice: SurfaceLattice,
        error: float,
        effort: Effort,
        seen: SeenPlaces | None,
        told: Callable[[str, int, int], None],
    ) -> None:
        self._surfaces, self._lattice, self._error, self._effort, self._tell = surfaces, lattice, error, effort, told
        self._hits = None if seen is None else seen.on(lattice, surfaces.corners)
        self._diagonal = surfaces.diagonal
        self.points, self.count, self.state = 0, 1, ""
        self.most_samples = (0, 0)
        self._pilots = self._with_normals(*self._drawn(_PILOTS, 0))
        self._least = dict[tuple[int, int], int]()

    def _told(self, task: str) -> Callable[[int, int], None]:
        task = self.state + task
        return lambda done, expected: self._tell(task, self.points + done, self.points + expected)

    def instants(
        self, times: MotionTimes, lights_at: Callable[[float], Sequence[Irradiance]]
    ) -> tuple[list[int], float]:
        """Choose at which of ``times.tests`` light is baked, and return the error between them too."""
        tests = len(times.tests)
        if tests == 1:
            return [0], 0.0
        points = self._near_bodies(times, lights_at)

        def luma_at(number: int) -> FloatArray:
            self._tell("light while bodies move", number, tests)
            luma = np.zeros((2, _MOTION_PILOTS))
            for light in lights_at(float(times.tests[number])):
                at = light.placed(*points)
                for shift in (0, 1):
                    luma[shift] += light.glimpsed(*at, _MOTION_SAMPLES, shift) @ LUMA_WEIGHTS
            return luma

        return chosen(luma_at, tests, MOTION_TOLERANCE * self._error)

    def sampled(self, lights: Sequence[Irradiance]) -> tuple[list[list[SampledLight]], list[Gathered | None]]:
        """Return all components of each light at one instant, and what gathers its bounces."""
        error = self._error
        total = sum((_glimpse(light, *self._pilots) for light in lights), np.zeros((_PILOTS, 3)))
        sampled = list[list[SampledLight]]()
        gathered = list[Gathered | None]()
        for number, light in enumerate(lights):
            components = list[SampledLight]()
            for kind, shining in enumerate(light.direct_parts):
                samples, off = self._enough((number, kind), light, shining, total)
                components.append(self.direct(light, shining, samples, off, total))
            gathered.append(self.reflected(light, components) if light.bounces else None)
            sampled.append(components)
        for number, (light, components, gather) in enumerate(zip(lights, sampled, gathered, strict=True)):
            if gather is not None:
                samples, off = self._enough((number, -1), light, gather, total)
                components.append(self.bounced(light, gather, samples, error, off, self._hits))
        return sampled, gathered

    def _enough(self, key: tuple[int, int], light: Irradiance, lit: Gathered, total: FloatArray) -> tuple[int, float]:
        """Return how many samples a point needs; not fewer than at the instant before, so that errors stay alike."""
        least = self._least.get(key, FEWEST_SAMPLES)
        most = self._effort.most_samples if self._hits is None else self._effort.most_seen_samples
        samples, off = _enough_samples(lit, light.placed(*self._pilots), total, self._error, least, most)
        self._least[key] = samples
        direct, bounced = self.most_samples
        self.most_samples = (direct, max(bounced, samples)) if key[1] < 0 else (max(direct, samples), bounced)
        return samples, off

    def _refined(
        self,
        task: str,
        light_at: Callable[[FloatArray, FloatArray, IntArray, BoolArray], Known],
        rule: RefinementRule,
        hits: CellHits | None,
    ) -> SampledLight:
        sampled = refine(self._lattice, light_at, rule, self._told(task), hits)
        self.points += len(sampled.values)
        return sampled

    def _sampled_at(self, lit: Gathered, at: Known, samples: int, seen: BoolArray) -> FloatArray:
        """Return light (n, 3) at positions and normals (n, 3), of fewer samples where no camera sees them."""
        light = np.empty((len(seen), 3))
        for some, count in ((seen, samples), (~seen, min(samples, self._effort.most_samples))):
            if some.any():
                light[some] = lit(at[0][some], at[1][some], samples=count)
        return light

    def direct(self, light: Irradiance, shining: Gathered, samples: int, off: float, total: FloatArray) -> SampledLight:
        """Sample direct light.

        Args:
            samples: of each place that is seen, or of all.
            off: what it errs at each place.
            total: all light at some points. Direct light that is weak next to it need not be known so well.
        """
        luma = total @ LUMA_WEIGHTS
        typical = float(np.quantile(luma[luma > 0], 0.1)) if (luma > 0).any() else 0.0

        def lit(positions: FloatArray, normals: FloatArray, frames: IntArray, seen: BoolArray) -> Known:
            at = light.placed(positions, normals, frames)
            values = _unless_buried(light, *at, self._sampled_at(shining, at, samples, seen), self._effort)
            return values, np.full(len(values), typical)

        error = self._error
        rule = self._rule((_DIRECT_SPACING, _DIRECT_FINEST), error, 2 * error + off)
        return self._refined("direct light", lit, rule, self._hits)

    def bounced(
        self,
        light: Irradiance,
        gather: Gathered,
        samples: int,
        error: float,
        off: float = 0.0,
        hits: CellHits | None = None,
        inwards: float = INWARDS,
    ) -> SampledLight:
        """Sample what surfaces reflect; ``off`` is what it errs at each point, and ``hits`` is what is seen of it."""

        def bounced(positions: FloatArray, normals: FloatArray, frames: IntArray, seen: BoolArray) -> Known:
            at = light.placed(positions, normals, frames)
            values = _unless_buried(light, *at, self._sampled_at(gather, at, samples, seen), self._effort)
            return values, light.direct(*at, self._effort.other_samples) @ LUMA_WEIGHTS

        rule = self._rule((_INDIRECT_SPACING, _INDIRECT_FINEST), error, 4 * error + off, inwards)
        return self._refined("bounces", bounced, rule, hits)

    def vector_maps(
        self,
        light: Irradiance,
        components: list[SampledLight],
        gather: Gathered | None,
        divisions: IntArray,
        of_sides: IntArray,
    ) -> npt.NDArray[np.float32]:
        """Return the maps of irradiance vectors of a light, float32 (n, 9), see :class:`~.light_maps.LightMaps`.

        Args:
            divisions, of_sides: of its maps of irradiance, for the lattice's sides, and for fronts and backs.
        """
        self._told("the directions of light")(0, 0)
        parts = light.along_direct_parts
        if gather is not None:
            parts.append(partial(light.along_gathered, reflected=gather.keywords["reflected"]))  # type: ignore[attr-defined]
        bumpy = self._surfaces.bumpy
        layouts, sides = vector_layouts_of(of_sides, bumpy), bumpy[self._lattice.triangles]
        samples = self._effort.vector_samples
        of_parts = [
            component.with_vectors(sides, partial(_vectors_at, light, partial(part, samples=samples)))
            for component, part in zip(components, parts, strict=True)
        ]
        axes = (
            texels_of(self._lattice, [axes[axis] for axes in of_parts], divisions, layouts, chosen=sides)
            for axis in range(3)
        )
        return np.concatenate(list(axes), axis=1)

    def reflected(self, light: Irradiance, direct: list[SampledLight]) -> Gathered:
        """Return a function that gathers what surfaces reflect of direct light and of all bounces but the last."""
        reflected = None
        if direct:
            maps = self._direct_maps(direct, direct)
            reflected = Reflected(maps.layouts, maps.texels)
        gather = partial(light.gathered, reflected=reflected)
        if light.most_bounces < 2:
            return gather
        error = max(self._error, _COARSE_ERROR)
        bounced = self.bounced(light, gather, self._effort.coarse_samples, error, inwards=_COARSE_INWARDS)
        maps, before = self._direct_maps(direct, [*direct, bounced]), bounced.values.sum(0)
        gather = partial(light.gathered, reflected=maps.with_bounces(self._lattice, bounced))
        for bounce in range(2, light.most_bounces):
            told = self._told(f"bounce {bounce}")
            told(0, len(bounced.values))
            more = bounced.with_light(partial(_light_at, light, partial(gather, samples=self._effort.coarse_samples)))
            added, bounced = more.values - bounced.values, more
            settled = float(added.sum()) <= self._effort.settled * self._error * float(more.values.sum())
            if settled:
                later = _later_bounces(added.sum(0), before, light.most_bounces - 1 - bounce)
                bounced = replace(more, values=more.values + added * later)
            before = added.sum(0)
            gather = partial(light.gathered, reflected=maps.with_bounces(self._lattice, bounced))
            if settled:
                break
        return gather

    def _direct_maps(self, direct: list[SampledLight], divided: list[SampledLight]) -> _DirectMaps:
        """Make maps of direct light, as finely divided as any of ``divided``."""
        divisions = np.max([component.divisions() for component in divided], axis=0)
        layouts = layouts_of(self.of_sides(divisions))
        return _DirectMaps(divisions, layouts, texels_of(self._lattice, direct, divisions, layouts))

    def of_sides(self, divisions: IntArray) -> IntArray:
        """Return divisions (t, 2) of fronts and backs, from those of the lattice's sides.

        Backs that do not reflect have -1.
        """
        of_sides = np.full((len(self._surfaces.corners), 2), -1, np.int64)
        of_sides[self._lattice.triangles, side_of(self._lattice)] = divisions
        return of_sides

    def _near_bodies(self, times: MotionTimes, lights_at: Callable[[float], Sequence[Irradiance]]) -> SurfacePoints:
        """Draw points as :meth:`_spread` does. Half of them are on bodies that move; most of the others are near
        these bodies."""
        half, moving = _MOTION_PILOTS // 2, self._lattice.frames[self._lattice.faces[:, 0]] > 0
        own = self._with_normals(*self._spread(half, 2, moving))
        still = self._with_normals(*self._spread(_CANDIDATES, 3, ~moving))
        passed = [lights_at(float(t_s))[0].placed(*own)[0] for t_s in times.tests[:: max(len(times.tests) // 8, 1)]]
        size = float(np.linalg.norm(np.ptp(passed[0], axis=0)))
        away = np.min([np.linalg.norm(still[0][:, None] - at[None, ::8], axis=-1).min(1) for at in passed], axis=0)
        weight = 1 / (away**2 + size**2)
        near = np.random.RandomState(4).choice(_CANDIDATES, half, replace=False, p=weight / weight.sum())
        positions, normals, frames = (
            np.concatenate([mine, other[near]]) for mine, other in zip(own, still, strict=True)
        )
        return positions, normals, frames

    def _with_normals(self, positions: FloatArray, face: IntArray, weight: FloatArray) -> SurfacePoints:
        vertex = self._lattice.faces[face]
        normals = np.einsum("nk,nkd->nd", weight, self._lattice.normals[vertex])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return positions, normals, self._lattice.frames[vertex[:, 0]]

    def _drawn(self, count: int, seed: int) -> tuple[FloatArray, IntArray, FloatArray]:
        """Draw points as :meth:`_spread` does, from what a camera sees where that is known."""
        if self._hits is None:
            return self._spread(count, seed)
        chosen = np.random.RandomState(seed).choice(len(self._hits.cells), count)
        face, weight = self._hits.cells[chosen], self._hits.weights[chosen]
        corners = self._surfaces.corners[self._lattice.triangles[face]]
        return np.einsum("nk,nkd->nd", weight, corners), face, weight

    def _spread(
        self, count: int, seed: int, among: npt.NDArray[np.bool_] | None = None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Draw points by area; return them, the sides they are on, and their barycentric coordinates."""
        corners = self._surfaces.corners[self._lattice.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        if among is not None and area[among].any():
            area = np.where(among, area, 0.0)
        random = np.random.RandomState(seed)
        face = random.choice(len(area), count, p=area / area.sum())
        weight = random.dirichlet(np.ones(3), count)
        return np.einsum("nk,nkd->nd", weight, corners[face]), face, weight

    def measured(
        self,
        states: Sequence[tuple[Sequence[Irradiance], Sequence[Gathered | None], Sequence[npt.NDArray[np.float32]]]],
        layouts: IntArray,
    ) -> float:
        """Measure how much maps err between their points, against light from many more samples.

        Two of three points err less than this error, which is relative to all light. Those without light do not count,
        and where no surface shows it there is none.
        The points are on what a camera sees, where that is known.

        Args:
            states: lights, what gathers their bounces, and their maps, at each instant, which has its share of the
                points.
        """
        if not self._surfaces.any_lit:
            return 0.0
        positions, face, weight = self._drawn(_MEASURED, 1)
        lattice = self._lattice
        points = self._with_normals(positions, face, weight)
        of_face = layouts[lattice.triangles[face], side_of(lattice)[face]]
        truth, from_maps, others = (np.zeros((_MEASURED, 3)) for _ in range(3))
        for number, (lights, gathered, texels) in enumerate(states):
            mine = slice(number, None, len(states))
            for light, gather, maps in zip(lights, gathered, texels, strict=True):
                at = light.placed(points[0][mine], points[1][mine], points[2][mine])
                if light.has_direct:
                    truth[mine] += light.direct(*at, samples=TRUE_SAMPLES, shift=_TRUE_SHIFT)
                if gather is not None:
                    truth[mine] += gather(*at, samples=TRUE_SAMPLES, shift=_TRUE_SHIFT)
                from_maps[mine] += looked_up(maps, of_face[mine], weight[mine])
                others[mine] += light.sharp(*at)
        luma = (truth + others) @ LUMA_WEIGHTS
        lit = luma > 1e-3 * (np.median(luma[luma > 0]) if (luma > 0).any() else 0.0)
        if not lit.any():
            return 0.0
        off = (from_maps - truth) @ LUMA_WEIGHTS
        return float(np.quantile(np.abs(off)[lit] / luma[lit], _TWO_OF_THREE))

    def _rule(
        self, distances: tuple[float, float], error: float, tolerance: float, inwards: float = INWARDS
    ) -> RefinementRule:
        # What linear interpolation errs grows with the square of the distance.
        wider = float(np.clip(np.sqrt(error / BAKE_ERROR), 0.25, 4.0))
        # Without a surface to look light up on, the corners do.
        unit = self._diagonal * wider if self._surfaces.any_lit else np.inf
        spacing, finest = (fraction * unit for fraction in distances)
        # Once its middle is known, an edge errs by a quarter of what it did before.
        most = 4 * self._effort.most_points // (3 + self.count)
        return RefinementRule(spacing, finest, tolerance, most, inwards)


@dataclass(frozen=True)
class _DirectMaps:
    """Holds maps of direct light, to which light that bounces is added as often as it does, at the same points.

    Attributes:
        divisions: of the lattice's sides, for both.
        layouts: of the maps.
        texels: of direct light.
    """

    divisions: IntArray
    layouts: IntArray
    texels: npt.NDArray[np.float32]

    def with_bounces(self, lattice: SurfaceLattice, bounced: SampledLight) -> Reflected:
        return Reflected(self.layouts, texels_of(lattice, [bounced], self.divisions, self.layouts, self.texels))


def _lattice(surfaces: Surfaces, effort: Effort, seen: SeenPlaces | None) -> SurfaceLattice:
    """Make the lattice of all surfaces. Where that has too many corners, they share places, as small as is enough.

    Those of triangles that a camera sees do not.
    """
    whole = surfaces.corners, surfaces.normals, surfaces.two_sided, surfaces.frames
    apart = np.zeros(len(surfaces.corners), bool)
    if seen is not None:
        apart[seen.triangles] = True
    lattice = SurfaceLattice(*whole)
    for share in _SHARED_SPACINGS:
        if effort.most_corners is None or len(lattice.positions) <= effort.most_corners:
            break
        lattice = SurfaceLattice(*whole, shared=share * surfaces.diagonal, apart=apart)
    return lattice


def _later_bounces(added: FloatArray, before: FloatArray, left: int) -> FloatArray:
    """Return how many times what the last bounce added (3) the ones after it add together, ``left`` of them.

    Each adds about the same fraction of what the one before it added, because by then light has spread (the power
    method). Where much is reflected, as in white rooms, this is a large part of all light.
    """
    kept = np.clip(np.divide(added, before, out=np.zeros(3), where=before > 0), 0.0, _MOST_KEPT)
    return np.asarray(kept * (1 - kept**left) / (1 - kept))


def _unless_buried(
    light: Irradiance, positions: FloatArray, normals: FloatArray, values: FloatArray, effort: Effort
) -> FloatArray:
    """Return light (n, 3), with NaN where none can come."""
    values[light.buried(positions, normals, values.sum(1) == 0, effort.looks)] = np.nan
    return values


def _light_at(light: Irradiance, lit: Gathered, *points: Any) -> FloatArray:
    """Return the light at points in their own frames."""
    return lit(*light.placed(*points))


def _vectors_at(light: Irradiance, along: Gathered, *points: Any) -> FloatArray:
    """Return irradiance vectors at points in their own frames, and in the axes of these."""
    return light.in_frames(along(*light.placed(*points)), points[2])


def _glimpse(light: Irradiance, *points: Any) -> FloatArray:
    """Estimate a light, from few samples, at points in their own frames."""
    return light.glimpsed(*light.placed(*points), _GLIMPSE_SAMPLES)


def _enough_samples(
    light: Gathered, pilots: tuple[FloatArray, FloatArray], total: FloatArray, error: float, samples: int, most: int
) -> tuple[int, float]:
    """Return how many samples a point needs, at least ``samples``, and its error with them: a fraction of all light."""
    while True:
        batches = np.array([light(*pilots, samples=samples, shift=shift) for shift in range(_SHIFTS)])
        off = relative_error(batches, total)
        if off <= error / 2 or samples >= most:
            return samples, off
        samples *= 2
