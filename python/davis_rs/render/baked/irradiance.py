"""Irradiance at places on surfaces, by Mitsuba: direct light from points on the lamps, the rest by final gathering.

Directions and points on lamps are those of a rank-1 lattice (Cranley and Patterson, 1976: shifted at random). The shift
is a smooth function of the place: neighbours err alike, so that no noise lies on a surface, and places farther apart
err independently, so that no surface as a whole is too bright or too dark.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import JitIndex, JitMask, JitVector, Mitsuba, MitsubaEmitter, MitsubaHit, MitsubaScene
from ...events.luma import LUMA_WEIGHTS
from ..rays.frame_sampler import frame_sampler
from .partial import PartialBake

FloatArray = npt.NDArray[np.float64]

_LANES = 1 << 20
_GOLDEN = 0.6180339887498949

_SHARP_SAMPLES = 16
"""Of small lamps, as many as the renderer has."""

_R2 = 0.7548776662, 0.5698402910

_ALIKE_WITHIN = 1 / 24
"""Places closer than this share of the scene's diagonal err alike."""

_MOST_BOUNCES = 64
"""Where paths may have any length. The rest is less than a thousandth below a mean reflectance of 0.9."""


class Reflected:
    """Light that surfaces reflect, to be looked up where rays hit them.

    Args:
        scene: whose shapes have as many triangles as ``counts`` says, in that order.
        normals: float64 (t, 3), on the fronts.
        layouts: (t, 2, 4): first texel, width, height of the map of each front and back.
        texels: float32 (n, 3), irradiance / pi, of maps as :class:`~.light_maps.LightMaps` has them.
    """

    def __init__(
        self,
        scene: MitsubaScene,
        mi: Mitsuba,
        counts: Sequence[int],
        normals: FloatArray,
        layouts: npt.NDArray[np.int64],
        texels: npt.NDArray[np.float32],
    ) -> None:
        import drjit as dr

        self._mi = mi
        registered = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)).numpy()[0]) for shape in scene.shapes()]
        first = np.zeros(max(registered, default=0) + 1, np.uint32)
        first[registered] = np.cumsum([0, *counts])[: len(registered)]
        self._first_of_shape = mi.UInt32(first)
        self._normals = mi.Float(normals.astype(np.float32).ravel())
        self._layouts = mi.UInt32(layouts[..., :2].astype(np.uint32).ravel())
        self._texels = mi.Float(texels.ravel())
        digest = hashlib.sha256(np.ascontiguousarray(layouts).tobytes())
        digest.update(np.ascontiguousarray(texels).tobytes())
        self.digest = digest.digest()

    def at(self, hit: MitsubaHit, barycentric: JitVector, active: JitMask) -> JitVector:
        """Irradiance / pi at hits on meshes (surface interactions); ``barycentric``: shares of the second and third
        corner."""
        import drjit as dr

        mi = self._mi
        shape = dr.reinterpret_array(mi.UInt32, hit.shape)
        triangle = dr.gather(mi.UInt32, self._first_of_shape, shape, active) + hit.prim_index
        normal = dr.gather(mi.Vector3f, self._normals, triangle, active)
        side = dr.select(dr.dot(normal, hit.to_world(hit.wi)) > 0, mi.UInt32(0), mi.UInt32(1))
        layout = dr.gather(mi.Point2u, self._layouts, 2 * triangle + side, active)
        first, stride, cells = layout[0], layout[1] + 2, mi.Float(layout[1] - 1)
        place = [dr.clip(mi.Float(b), 0, 1) * cells for b in (barycentric.x, barycentric.y)]
        column, row = (dr.minimum(mi.UInt32(one), layout[1] - 1) for one in place)
        x, y = place[0] - mi.Float(column), place[1] - mi.Float(row)
        # Each map has a frame of one texel around it.
        at = first + (row + 1) * stride + column + 1
        corner = [dr.gather(mi.Color3f, self._texels, at + off, active) for off in (0, 1, stride, stride + 1)]
        above, below = dr.lerp(corner[0], corner[1], x), dr.lerp(corner[2], corner[3], x)
        return dr.maximum(dr.lerp(above, below, y), 0)


class Irradiance:
    """Light of a scene loaded under Mitsuba's LLVM variant, which is in use wherever this is called.

    Args:
        scene: with only those lights on that are asked for.
        baked_emitters: those whose direct light counts.
        sharp_emitters: those (point, spot, directional) of which only what bounces does.
        max_depth: of paths, as Mitsuba's path tracer counts it; -1 for any. 2 is direct light alone.
        rr_depth: where paths begin to end at random.
        scale: how many times as large the scene is loaded as places are given.
        kept: what was computed before, and where more is kept.
        poses: T_world_frame (k, 4, 4) of the frames of places, the world's own first; None where nothing moves.
    """

    def __init__(
        self,
        scene: MitsubaScene,
        mi: Mitsuba,
        baked_emitters: Sequence[MitsubaEmitter],
        sharp_emitters: Sequence[MitsubaEmitter],
        *,
        max_depth: int,
        rr_depth: int,
        scale: float,
        kept: PartialBake,
        poses: FloatArray | None = None,
    ) -> None:
        self._poses = poses
        self._scene, self._scale, self._mi, self._kept = scene, scale, mi, kept
        self._lamps = [emitter for emitter in baked_emitters if not emitter.is_environment()]
        self._skies = [emitter for emitter in baked_emitters if emitter.is_environment()]
        self._sharp = list(sharp_emitters)
        self.bounces = max_depth < 0 or max_depth > 2
        self.most_bounces = max_depth - 2 if max_depth > 0 else _MOST_BOUNCES
        shorter = max_depth - 1 if max_depth > 0 else -1
        self._integrator = mi.load_dict({"type": "path", "max_depth": shorter, "rr_depth": rr_depth})
        self._endless = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
        box = scene.bbox()
        diagonal = float(np.linalg.norm(np.array(box.max, np.float64) - np.array(box.min, np.float64))) / scale
        # Three directions that are no multiples of each other's, so that no wall lies along a line of equal shifts.
        gradient = np.array([[0.743, 0.528, 0.411], [-0.467, 0.812, 0.349]])
        self._shift_gradient = gradient / (_ALIKE_WITHIN * diagonal) if diagonal > 0 else 0 * gradient

    def reflected(
        self,
        counts: Sequence[int],
        normals: FloatArray,
        layouts: npt.NDArray[np.int64],
        texels: npt.NDArray[np.float32],
    ) -> Reflected:
        """See :class:`Reflected`."""
        return Reflected(self._scene, self._mi, counts, normals, layouts, texels)

    def placed(
        self, places: FloatArray, normals: FloatArray, frames: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Places and normals (n, 3) in the world, of those in frames (n), at this light's instant."""
        if self._poses is None:
            return places, normals
        of = self._poses[frames]
        at = np.einsum("nij,nj->ni", of[:, :3, :3], places) + of[:, :3, 3]
        still = (frames == 0)[:, None]
        return np.where(still, places, at), self.turned(normals, frames)

    def turned(self, normals: FloatArray, frames: npt.NDArray[np.int64]) -> FloatArray:
        """Normals (n, 3) in the world, of those in frames (n)."""
        if self._poses is None:
            return normals
        turned = np.einsum("nij,nj->ni", self._poses[frames, :3, :3], normals)
        return np.where((frames == 0)[:, None], normals, turned)

    def glimpsed(self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """All irradiance / pi, RGB (n, 3), as far as a few samples tell."""
        glimpse = np.zeros((len(places), 3))
        if self.has_direct:
            glimpse += self.direct(places, normals, samples, shift)
        if self.bounces:
            glimpse += self.traced(places, normals, samples, shift)
        return glimpse

    @property
    def has_direct(self) -> bool:
        """Whether any light shines directly that is baked."""
        return bool(self.direct_parts)

    @property
    def direct_parts(self) -> list[Callable[..., FloatArray]]:
        """The methods :meth:`of_lamps` and :meth:`of_sky`, as far as the scene has such lights."""
        return [part for part, there in ((self.of_lamps, self._lamps), (self.of_sky, self._skies)) if there]

    def direct(self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Direct irradiance / pi, RGB (n, 3), of all that is baked, from ``samples`` samples of each kind."""
        return sum((part(places, normals, samples, shift) for part in self.direct_parts), np.zeros((len(places), 3)))

    def sharp(self, places: FloatArray, normals: FloatArray) -> FloatArray:
        """Direct irradiance / pi, RGB (n, 3), of those lights of which only what bounces is baked."""
        if not self._sharp:
            return np.zeros((len(places), 3))

        def one(surface: MitsubaHit, point: JitVector, _: JitIndex) -> JitVector:
            return sum((self._towards(emitter, surface, point) for emitter in self._sharp), self._mi.Color3f(0))

        return self._mean("sharp", places, normals, _SHARP_SAMPLES, 0, one)

    def of_lamps(self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Direct irradiance / pi, RGB (n, 3), from ``samples`` points on each lamp."""

        def one(surface: MitsubaHit, point: JitVector, _: JitIndex) -> JitVector:
            return sum((self._towards(emitter, surface, point) for emitter in self._lamps), self._mi.Color3f(0))

        return self._mean("lamps", places, normals, samples, shift, one)

    def of_sky(self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Direct irradiance / pi, RGB (n, 3), of constant light and environment maps, from ``samples`` directions.

        Directions follow the cosine. Where the sky is a map, as many more follow its radiance; both are weighted by the
        balance heuristic (Veach and Guibas, 1995).
        """

        def one(surface: MitsubaHit, point: JitVector, _: JitIndex) -> JitVector:
            import drjit as dr

            mi = self._mi
            local = mi.warp.square_to_cosine_hemisphere(point)
            ray = surface.spawn_ray(surface.to_world(local))
            open_ = ~self._scene.ray_test(ray)
            seen = dr.zeros(mi.SurfaceInteraction3f, dr.width(point))
            seen.wi = -ray.d
            sample = dr.zeros(mi.DirectionSample3f, dr.width(point))
            sample.d = ray.d
            total = mi.Color3f(0)
            for emitter in self._skies:
                light = dr.select(open_, mi.Color3f(emitter.eval(seen)), 0)
                if emitter.class_name() == "EnvironmentMapEmitter":
                    density = mi.warp.square_to_cosine_hemisphere_pdf(local)
                    light *= density / (density + emitter.pdf_direction(surface, sample))
                    light += self._towards(emitter, surface, point, both=True)
                total += light
            return total

        return self._mean("sky", places, normals, samples, shift, one)

    def _towards(
        self, emitter: MitsubaEmitter, surface: MitsubaHit, point: JitVector, *, both: bool = False
    ) -> JitVector:
        """Irradiance / pi by one sample of an emitter.

        Args:
            both: weighted, because directions that follow the cosine find the emitter too.
        """
        import drjit as dr

        sample, radiance = emitter.sample_direction(surface, point)
        cosine = dr.dot(surface.n, sample.d)
        lit = (sample.pdf > 0) & (cosine > 0)
        lit &= ~self._scene.ray_test(surface.spawn_ray_to(sample.p), lit)
        weight = sample.pdf / (sample.pdf + cosine / dr.pi) if both else 1.0
        return dr.select(lit, radiance * (cosine / dr.pi * weight), 0)

    def gathered(
        self, places: FloatArray, normals: FloatArray, samples: int, reflected: Sequence[Reflected], shift: int = 0
    ) -> FloatArray:
        """Irradiance / pi of light that other surfaces reflect, RGB (n, 3), from ``samples`` rays.

        Args:
            reflected: light that falls on the surfaces, to be added up. That of the sharp lights comes on top.
        """

        def one(surface: MitsubaHit, point: JitVector, number: JitIndex) -> JitVector:
            import drjit as dr

            mi = self._mi
            ray = surface.spawn_ray(surface.to_world(mi.warp.square_to_cosine_hemisphere(point)))
            pi = self._scene.ray_intersect_preliminary(ray, coherent=False)
            hit = pi.compute_surface_interaction(ray)
            valid = hit.is_valid()
            bsdf, context = hit.bsdf(), mi.BSDFContext()
            upright = mi.Vector3f(0, 0, dr.sign(hit.wi.z))
            # Of a diffuse surface: reflectance / pi along its normal.
            reflectance = bsdf.eval(context, hit, upright, valid) * dr.pi
            falling = sum((part.at(hit, pi.prim_uv, valid) for part in reflected), mi.Color3f(0))
            light = mi.Color3f(reflectance) * falling
            # On small lamps: another lattice than that of the directions (Roberts' R2 sequence).
            turn = [mi.Float(number) * step for step in _R2]
            elsewhere = mi.Point2f(*(one - dr.floor(one) for one in turn))
            for emitter in self._sharp:
                sample, radiance = emitter.sample_direction(hit, elsewhere, valid)
                lit = valid & dr.any(radiance > 0)
                lit &= ~self._scene.ray_test(hit.spawn_ray_to(sample.p), lit)
                light += dr.select(lit, mi.Color3f(bsdf.eval(context, hit, hit.to_local(sample.d), lit)) * radiance, 0)
            return dr.select(valid, light, 0)

        return self._mean("gathered", places, normals, samples, shift, one, b"".join(part.digest for part in reflected))

    def traced(
        self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0, *, endless: bool = False
    ) -> FloatArray:
        """The same quantity as :meth:`gathered`, RGB (n, 3), from ``samples`` paths of Mitsuba's path tracer.

        Args:
            endless: paths are as long as they like.
        """
        integrator = self._endless if endless else self._integrator

        def one(surface: MitsubaHit, point: JitVector, number: JitIndex) -> JitVector:
            import drjit as dr

            mi = self._mi
            ray = surface.spawn_ray(surface.to_world(mi.warp.square_to_cosine_hemisphere(point)))
            sampler = frame_sampler()(dr.opaque(mi.UInt32, shift), number)
            colour, *_ = integrator.sample(self._scene, sampler, mi.RayDifferential3f(ray), None, True)
            # What lamps and the sky send here directly is not part of it.
            hit = self._scene.ray_intersect(ray)
            seen = hit.emitter(self._scene).eval(hit)
            return dr.maximum(mi.Color3f(colour) - mi.Color3f(seen), 0)

        return self._mean(f"traced {endless}", places, normals, samples, shift, one)

    def is_buried(self, places: FloatArray, normals: FloatArray) -> npt.NDArray[np.bool_]:
        """Return which places (n) no light reaches, whatever the number of bounces: within a solid, or in full dark."""
        buried = np.ones(len(places), bool)
        for samples in (4, 64):  # few are enough where it is light
            dark = np.flatnonzero(buried)
            if not len(dark):
                break
            light = self.traced(places[dark], normals[dark], samples, endless=True).sum(1)
            if self.has_direct:
                light += self.direct(places[dark], normals[dark], samples).sum(1)
            buried[dark] = light == 0
        return buried

    def _mean(
        self,
        what: str,
        places: FloatArray,
        normals: FloatArray,
        samples: int,
        shift: int,
        one: Callable[[MitsubaHit, JitVector, JitIndex], JitVector],
        follows_from: bytes = b"",
    ) -> FloatArray:
        """The mean of ``one(surface, point in the unit square, number of the sample)`` at each place.

        Args:
            what: is computed, and what else it ``follows_from``: by these, and by the places, it is known again.
        """
        found = np.empty((len(places), 3))
        step = max(_LANES // samples, 1)
        for start in range(0, len(places), step):
            part = slice(start, min(start + step, len(places)))
            settings = f"{self._name()} {what} {samples} {shift}".encode() + follows_from

            def compute(part: slice = part) -> FloatArray:
                return self._mean_of_part(places[part], normals[part], samples, shift, one)

            found[part] = self._kept.known_or((settings, places[part], normals[part]), compute)
        return found

    def _name(self) -> str:
        """A key that tells this light from others of the scene."""
        return ""

    def _mean_of_part(
        self,
        places: FloatArray,
        normals: FloatArray,
        samples: int,
        shift: int,
        one: Callable[[MitsubaHit, JitVector, JitIndex], JitVector],
    ) -> FloatArray:
        import drjit as dr

        mi, count = self._mi, len(places)
        at, normal = (
            kind(*(mi.Float(np.ascontiguousarray(column, np.float32)) for column in array.T))
            for kind, array in ((mi.Point3f, places * self._scale), (mi.Normal3f, normals))
        )
        shifts = places @ (self._shift_gradient.T / np.sqrt(samples)) + np.random.RandomState(shift).uniform(size=2)
        offset = [mi.Float((column % 1.0).astype(np.float32)) for column in shifts.T]
        table = [mi.Float(column) for column in _lattice(samples)]
        lane, width = dr.arange(mi.UInt32, count * samples), dr.opaque(mi.UInt32, samples)
        place = lane // width
        number = lane - place * width
        surface = dr.zeros(mi.SurfaceInteraction3f, count * samples)
        surface.p = dr.gather(mi.Point3f, at, place)
        surface.n = dr.gather(mi.Normal3f, normal, place)
        surface.sh_frame = mi.Frame3f(surface.n)
        surface.wi = mi.Vector3f(0, 0, 1)
        point = mi.Point2f(0)
        for axis in range(2):
            sum_ = dr.gather(mi.Float, table[axis], number) + dr.gather(mi.Float, offset[axis], place)
            # Folded (the baker's transform), so that a point that leaves the square comes back where it left.
            # Float32 may round up to 1, which is not in the square.
            point[axis] = dr.minimum(1 - dr.abs(2 * (sum_ - dr.floor(sum_)) - 1), 1 - 2**-24)
        colour = one(surface, point, number)
        means = [dr.block_sum(colour[i], samples) / samples for i in range(3)]
        dr.eval(means)
        return np.stack([mean.numpy() for mean in means], 1).astype(np.float64)


def relative_error(batches: FloatArray, total: FloatArray) -> float:
    """Standard error of one batch, from batches (b, n, 3), relative to light (n, 3): three of four places err less.

    A mean would be that of the few darkest places.
    """
    luma, of_batches = total @ LUMA_WEIGHTS, batches @ LUMA_WEIGHTS
    lit = luma > 1e-3 * (np.median(luma[luma > 0]) if (luma > 0).any() else 0.0)
    if not lit.any():
        return 0.0
    return float(np.quantile(of_batches.std(0, ddof=1)[lit] / luma[lit], 0.75))


def _lattice(samples: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """A rank-1 lattice in the unit square."""
    number = np.arange(samples)
    return ((number + 0.5) / samples).astype(np.float32), (number * _GOLDEN % 1.0).astype(np.float32)
