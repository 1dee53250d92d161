"""Computes irradiance at points on surfaces: direct light from points on the lamps, the rest by final gathering.

Rays are traced by the Rust core. Directions and points on lamps are those of a rank-1 lattice (Cranley and Patterson,
1976: shifted at random). The shift is a smooth function of the place: neighbours err alike, so that no noise lies on a
surface, and places farther apart err independently, so that no surface as a whole is too bright or too dark.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._core import IrradianceSampler, ReflectedLight
from ..._util.progress import doing
from ...events.luma import LUMA_WEIGHTS
from ..texels import CoreColours
from .partial import PartialBake

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_SurfacePoints = tuple[FloatArray, FloatArray, FloatArray]

_RAYS_AT_ONCE = 1 << 20
"""Rays of one call of the core: Ctrl-C waits for them, and progress is told after them."""

_TOLD = {
    "lamps": "light of lamps",
    "sky": "light of the sky",
    "sharp": "light of small lamps",
    "gathered": "light that bounces",
    "traced": "light that bounces",
}
"""What progress calls each quantity."""

_SHARP_SAMPLES = 16
"""Of small lamps, as many as the renderer has."""

_ALIKE_WITHIN = 1 / 24
"""Places closer than this share of the scene's diagonal err alike."""

_MOST_BOUNCES = 64
"""Where paths may have any length. The rest is less than a thousandth below a mean reflectance of 0.9."""

_ROULETTE_OF_LOOKS = 2
"""Paths that only look whether there is light at all may end at random after so many bounces."""


@dataclass(frozen=True)
class Surfaces:
    """Holds the surfaces whose light is baked, in the order of the scene table's records.

    Attributes:
        corners: float64 (t, 3, 3), metres; those of glass, on which no light is baked, are in one point.
        clear: bool (t), through which of them light passes as if they were not there.
        fronts: float64 (t, 3), unit normals of the front.
        normals: float64 (t, 3, 3), unit shading normals of the front, at the corners.
        two_sided: bool (t).
        counts: how many of them each of the scene's shapes has.
        frames: int64 (t), the frame that each is in: 0 for the world, 1, 2, ... for bodies that move.
        uv: float64 (t, 3, 2), texture coordinates at the corners.
        texture_of: uint32 (t), the texture of each.
        reflectances: gives that of all textures, as the core takes it; light that comes from the cache needs none.
        looks: a hash of how surfaces look that these do not tell.
        bumpy: bool (t), which of them have a normal texture or a bump map.
        any_lit: whether any of them shows light that is baked: all but glass do.
    """

    corners: FloatArray
    clear: npt.NDArray[np.bool_]
    fronts: FloatArray
    normals: FloatArray
    two_sided: npt.NDArray[np.bool_]
    counts: Sequence[int]
    frames: IntArray
    uv: FloatArray
    texture_of: npt.NDArray[np.uint32]
    reflectances: Callable[[], CoreColours]
    looks: bytes
    bumpy: npt.NDArray[np.bool_]
    any_lit: bool

    @property
    def diagonal(self) -> float:
        """Return the diagonal of the box around the surfaces, in metres."""
        corners = self.corners.reshape(-1, 3)
        corners = corners[np.isfinite(corners).all(1)]
        return float(np.linalg.norm(np.ptp(corners, axis=0))) if len(corners) else 0.0


def in_one_point(corners: FloatArray, which: npt.NDArray[np.bool_]) -> FloatArray:
    """Return corners (t, 3, 3) with those of some triangles (t) in one point, where no ray hits them.

    Where these are all triangles, there would be no scene left, and nothing changes.
    """
    if which.all() or not which.any():
        return corners
    corners = corners.copy()
    corners[which] = corners[which.argmax(), 0]
    return corners


class Reflected:
    """Holds the light that surfaces reflect, to be looked up where rays hit them.

    Args:
        layouts: (t, 2, 4): first texel, width, height of the map of each front and back.
        texels: float32 (n, 3), irradiance / pi, of maps as :class:`~.light_maps.LightMaps` has them.
    """

    def __init__(self, layouts: IntArray, texels: npt.NDArray[np.float32]) -> None:
        self.light = ReflectedLight(np.ascontiguousarray(layouts[..., :2]).ravel(), texels.ravel())
        digest = hashlib.sha256(np.ascontiguousarray(layouts).data)
        digest.update(np.ascontiguousarray(texels).data)
        self.digest = digest.digest()


@dataclass(frozen=True)
class Paths:
    """Says how long light's paths are, as Mitsuba's path tracer counts it: -1 for any length; 2 is direct light.

    Attributes:
        max_depth: of paths.
        rr_depth: where paths begin to end at random.
    """

    max_depth: int
    rr_depth: int


class Irradiance:
    """Computes the light of one of a scene's groups of lights, at one instant.

    Args:
        sampler: the scene with its lights at that instant, made when it is first asked for.
        group: the number of the group in it.
        kinds: which kinds of light the group has: ``lamps``, ``sky``, ``sharp``.
        paths: of light.
        diagonal: of the scene, metres.
        name: tells this light from others of the scene.
        kept: what was computed before, and where more is kept.
        poses: T_world_frame (k, 4, 4) of the frames of surfaces, the world's own first; None where nothing moves.

    Attributes:
        bounces: whether any light bounces that counts.
        most_bounces: how often it does at most.
    """

    def __init__(
        self,
        sampler: Callable[[], IrradianceSampler],
        group: int,
        kinds: frozenset[str],
        *,
        paths: Paths,
        diagonal: float,
        name: str,
        kept: PartialBake,
        poses: FloatArray | None = None,
    ) -> None:
        self._sampler, self._group, self._kinds, self._paths = sampler, group, kinds, paths
        self._name, self._kept, self._poses = name, kept, poses
        self._seen_dark: dict[bytes, npt.NDArray[np.int8]] = {}
        self.bounces = bool(kinds) and (paths.max_depth < 0 or paths.max_depth > 2)
        self.most_bounces = paths.max_depth - 2 if paths.max_depth > 0 else _MOST_BOUNCES
        # Three directions that are no multiples of each other's, so that no wall lies along a line of equal shifts.
        gradient = np.array([[0.743, 0.528, 0.411], [-0.467, 0.812, 0.349]])
        self._shift_gradient = gradient / (_ALIKE_WITHIN * diagonal) if diagonal > 0 else 0 * gradient

    def placed(self, positions: FloatArray, normals: FloatArray, frames: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and normals (n, 3) in the world, of those in frames (n), at this light's instant."""
        if self._poses is None:
            return positions, normals
        return moved(self._poses, positions, frames), turned(self._poses, normals, frames)

    def glimpsed(self, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Estimate all irradiance / pi, RGB (n, 3), from few samples."""
        glimpse = np.zeros((len(positions), 3))
        if self.has_direct:
            glimpse += self.direct(positions, normals, samples, shift)
        if self.bounces:
            glimpse += self.traced(positions, normals, samples, shift)
        return glimpse

    @property
    def has_direct(self) -> bool:
        """Return whether any light that is baked shines directly."""
        return bool(self.direct_parts)

    @property
    def direct_parts(self) -> list[Callable[..., FloatArray]]:
        """Return the methods :meth:`of_lamps` and :meth:`of_sky`, as far as the scene has such lights."""
        return self._of_kinds(lamps=self.of_lamps, sky=self.of_sky)

    @property
    def along_direct_parts(self) -> list[Callable[..., FloatArray]]:
        """Return the methods :meth:`along_of_lamps` and :meth:`along_of_sky`, in the order of :attr:`direct_parts`."""
        return self._of_kinds(lamps=self.along_of_lamps, sky=self.along_of_sky)

    def _of_kinds(self, **methods: Callable[..., FloatArray]) -> list[Callable[..., FloatArray]]:
        return [method for kind, method in methods.items() if kind in self._kinds]

    def direct(self, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Compute direct irradiance / pi, RGB (n, 3), of all that is baked, from ``samples`` samples of each kind."""
        return sum(
            (part(positions, normals, samples, shift) for part in self.direct_parts), np.zeros((len(positions), 3))
        )

    def sharp(self, positions: FloatArray, normals: FloatArray) -> FloatArray:
        """Compute direct irradiance / pi, RGB (n, 3), of those lights of which only what bounces is baked."""
        if "sharp" not in self._kinds:
            return np.zeros((len(positions), 3))
        return self._mean("sharp", positions, normals, _SHARP_SAMPLES, 0, IrradianceSampler.of_sharp)

    def of_lamps(self, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Compute direct irradiance / pi, RGB (n, 3), from ``samples`` points on each lamp."""
        return self._mean("lamps", positions, normals, samples, shift, IrradianceSampler.of_lamps)

    def of_sky(self, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Compute direct irradiance / pi, RGB (n, 3), of a sky, constant or a map, from ``samples`` directions.

        Directions follow the cosine. Where the sky is a map, as many more follow its radiance; both are weighted by the
        balance heuristic (Veach and Guibas, 1995).
        """
        return self._mean("sky", positions, normals, samples, shift, IrradianceSampler.of_sky)

    def gathered(
        self, positions: FloatArray, normals: FloatArray, samples: int, reflected: Reflected | None, shift: int = 0
    ) -> FloatArray:
        """Compute irradiance / pi of light that other surfaces reflect, RGB (n, 3), from ``samples`` rays.

        Args:
            reflected: light that falls on the surfaces, if any. That of the sharp lights comes on top.
        """
        light, digest = (None, b"") if reflected is None else (reflected.light, reflected.digest)
        return self._mean("gathered", positions, normals, samples, shift, IrradianceSampler.gathered, (light,), digest)

    def along_of_lamps(self, positions: FloatArray, normals: FloatArray, samples: int) -> FloatArray:
        """Compute the part along the surface of irradiance vectors / pi (n, 3 axes, 3), RGB, in the world.

        They are those of the light of :meth:`of_lamps`.
        """
        return self._along(IrradianceSampler.along_of_lamps, positions, normals, samples, ())

    def along_of_sky(self, positions: FloatArray, normals: FloatArray, samples: int) -> FloatArray:
        """Compute the same (n, 3 axes, 3) of the light of :meth:`of_sky`."""
        return self._along(IrradianceSampler.along_of_sky, positions, normals, samples, ())

    def along_gathered(
        self, positions: FloatArray, normals: FloatArray, samples: int, reflected: Reflected | None
    ) -> FloatArray:
        """Compute the same (n, 3 axes, 3) of the light of :meth:`gathered`."""
        light = None if reflected is None else reflected.light
        return self._along(IrradianceSampler.along_gathered, positions, normals, samples, (light,))

    def in_frames(self, vectors: FloatArray, frames: IntArray) -> FloatArray:
        """Return vectors (n, 3 axes, 3), RGB, in the axes of frames (n), of those in the world."""
        if self._poses is None:
            return vectors
        own = np.einsum("nij,nic->njc", self._poses[frames, :3, :3], vectors)
        return np.where((frames == 0)[:, None, None], vectors, own)

    def _along(
        self,
        method: Callable[..., FloatArray],
        positions: FloatArray,
        normals: FloatArray,
        samples: int,
        arguments: tuple[Any, ...],
    ) -> FloatArray:
        vectors = np.empty((len(positions), 3, 3))
        step = max(_RAYS_AT_ONCE // samples, 1)
        for start in range(0, len(positions), step):
            chunk = slice(start, min(start + step, len(positions)))
            light = self._computed(method, positions[chunk], normals[chunk], samples, 0, arguments)
            vectors[chunk] = light.reshape(-1, 3, 3)
            if chunk.stop < len(positions):
                doing(f"the directions of light, {chunk.stop:,} of {len(positions):,} points")
        return vectors

    def traced(self, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Compute the same quantity as :meth:`gathered`, RGB (n, 3), from ``samples`` paths."""
        rule = shift, self.most_bounces, self._paths.rr_depth
        return self._mean("traced", positions, normals, samples, shift, IrradianceSampler.traced, rule)

    def buried(
        self,
        positions: FloatArray,
        normals: FloatArray,
        dark: npt.NDArray[np.bool_],
        looks: Sequence[tuple[int, int]],
    ) -> npt.NDArray[np.bool_]:
        """Return which of the dark points (n) no light reaches at all: within a solid, or in full dark.

        Each part of the light is dark at other points. What was found out for one is known for the others.

        Args:
            looks: numbers of paths, and how often they bounce at most; points at which the first find light are not
                looked at again.
        """
        key = hashlib.sha256(positions.tobytes() + normals.tobytes()).digest()
        known = self._seen_dark.setdefault(key, np.full(len(positions), -1, np.int8))
        asked = np.flatnonzero(dark & (known < 0))
        if len(asked):
            known[asked] = self._is_buried(positions[asked], normals[asked], looks)
        return dark & (known > 0)

    def _is_buried(
        self, positions: FloatArray, normals: FloatArray, looks: Sequence[tuple[int, int]]
    ) -> npt.NDArray[np.bool_]:
        buried = np.ones(len(positions), bool)

        def is_lit(
            sampler: IrradianceSampler, group: int, points: _SurfacePoints, samples: int, bounces: int
        ) -> FloatArray:
            lit = sampler.is_lit(group, points, samples, 0, bounces, _ROULETTE_OF_LOOKS)
            return np.repeat(lit[:, None], 3, axis=1).astype(np.float64)

        for samples, bounces in looks:
            if self.has_direct:  # first, because paths take longer
                dark = np.flatnonzero(buried)
                buried[dark] = self.direct(positions[dark], normals[dark], samples).sum(1) == 0
            dark = np.flatnonzero(buried)
            if not len(dark):
                break
            lit = self._mean(f"is lit within {bounces}", positions[dark], normals[dark], samples, 0, is_lit, (bounces,))
            buried[dark] = lit.sum(1) == 0
        return buried

    def _mean(
        self,
        quantity: str,
        positions: FloatArray,
        normals: FloatArray,
        samples: int,
        shift: int,
        method: Callable[..., FloatArray],
        arguments: tuple[Any, ...] = (),
        follows_from: bytes = b"",
    ) -> FloatArray:
        """Return what a method of the sampler computes, RGB (n, 3).

        Args:
            quantity, follows_from: what is computed, and from what: by these and the positions it is known again.
        """
        light = np.empty((len(positions), 3))
        step = max(_RAYS_AT_ONCE // samples, 1)
        for start in range(0, len(positions), step):
            chunk = slice(start, min(start + step, len(positions)))
            settings = f"{self._name} {quantity} {samples} {shift}".encode() + follows_from

            def compute(chunk: slice = chunk) -> FloatArray:
                return self._computed(method, positions[chunk], normals[chunk], samples, shift, arguments)

            light[chunk] = self._kept.known_or((settings, positions[chunk], normals[chunk]), compute)
            if chunk.stop < len(positions):
                doing(f"{_TOLD.get(quantity, 'dark places')}, {chunk.stop:,} of {len(positions):,} points")
        return light

    def _computed(
        self,
        method: Callable[..., FloatArray],
        positions: FloatArray,
        normals: FloatArray,
        samples: int,
        shift: int,
        arguments: tuple[Any, ...],
    ) -> FloatArray:
        shifts = positions @ (self._shift_gradient.T / np.sqrt(samples)) + np.random.RandomState(shift).uniform(size=2)
        shifts %= 1.0
        shifts[shifts >= 1.0] = 0.0  # what lies less than a rounding below 0
        at = tuple(np.ascontiguousarray(array, np.float64).ravel() for array in (positions, normals, shifts))
        return np.asarray(method(self._sampler(), self._group, at, samples, *arguments)).reshape(-1, 3)


def moved(poses: FloatArray, points: FloatArray, frames: IntArray) -> FloatArray:
    """Return points (n, 3) in the world, of those in frames (n) with poses T_world_frame (k, 4, 4)."""
    pose = poses[frames]
    at = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
    return np.where((frames == 0)[:, None], points, at)


def turned(poses: FloatArray, vectors: FloatArray, frames: IntArray) -> FloatArray:
    """Return vectors (n, 3) in the world, of those in frames (n) with poses T_world_frame (k, 4, 4)."""
    return np.where((frames == 0)[:, None], vectors, np.einsum("nij,nj->ni", poses[frames, :3, :3], vectors))


def relative_error(batches: FloatArray, total: FloatArray) -> float:
    """Return the standard error of batches (b, n, 3), relative to light (n, 3): three of four points err less.

    A mean would be that of the few darkest points.
    """
    luma, of_batches = total @ LUMA_WEIGHTS, batches @ LUMA_WEIGHTS
    lit = luma > 1e-3 * (np.median(luma[luma > 0]) if (luma > 0).any() else 0.0)
    if not lit.any():
        return 0.0
    return float(np.quantile(of_batches.std(0, ddof=1)[lit] / luma[lit], 0.75))
