"""Irradiance at places on surfaces, by Mitsuba: direct light from points on the lamps, the rest by path tracing.

All places use the same numbers: what they err is then alike for neighbours, a smooth error of brightness instead of
noise on the surface. Directions and points on lamps are those of a rank-1 lattice that is shifted at random; how much
the result differs between shifts says how much it errs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ...luma import LUMA_WEIGHTS
from ..frame_sampler import frame_sampler

FloatArray = npt.NDArray[np.float64]

_LANES = 1 << 20
_GOLDEN = 0.6180339887498949


class Irradiance:
    """Light of a scene loaded under Mitsuba's LLVM variant, which is in use wherever this is called.

    Args:
        scene: with only those lights on that are asked for.
        baked_emitters: those whose direct light counts; of the others (point, directional) only what bounces does.
        max_depth: of paths, as Mitsuba's path tracer counts it; -1 for any. 2 is direct light alone.
        rr_depth: where paths begin to end at random.
        scale: how many times as large the scene is loaded as places are given.
    """

    def __init__(
        self, scene: Any, mi: Any, baked_emitters: Sequence[Any], *, max_depth: int, rr_depth: int, scale: float
    ) -> None:
        self._scene, self._emitters, self._scale, self._mi = scene, list(baked_emitters), scale, mi
        self.bounces = max_depth < 0 or max_depth > 2
        shorter = max_depth - 1 if max_depth > 0 else -1
        self._integrator = mi.load_dict({"type": "path", "max_depth": shorter, "rr_depth": rr_depth})
        self._endless = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})

    @property
    def has_direct(self) -> bool:
        """Whether any light shines directly that is baked."""
        return bool(self._emitters)

    def direct(self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        """Direct irradiance / pi, RGB (n, 3), from so many points on each lamp."""

        def one(surface: Any, number: Any) -> Any:
            import drjit as dr

            mi = self._mi
            table = _lattice(samples, shift)
            total = mi.Color3f(0)
            for emitter in self._emitters:
                point = mi.Point2f(*(dr.gather(mi.Float, mi.Float(column), number) for column in table))
                sample, radiance = emitter.sample_direction(surface, point)
                cosine = dr.dot(surface.n, sample.d)
                lit = (sample.pdf > 0) & (cosine > 0)
                ray = surface.spawn_ray_to(sample.p)
                lit &= ~self._scene.ray_test(ray, lit)
                total += dr.select(lit, radiance * cosine / dr.pi, 0)
            return total

        return self._mean(places, normals, samples, one)

    def indirect(
        self, places: FloatArray, normals: FloatArray, samples: int, shift: int = 0, *, endless: bool = False
    ) -> FloatArray:
        """Irradiance / pi by what other surfaces reflect, RGB (n, 3), from so many paths.

        Args:
            endless: paths are as long as they like.
        """
        integrator = self._endless if endless else self._integrator

        def one(surface: Any, number: Any) -> Any:
            import drjit as dr

            mi = self._mi
            table = _lattice(samples, shift)
            point = mi.Point2f(*(dr.gather(mi.Float, mi.Float(column), number) for column in table))
            ray = surface.spawn_ray(surface.to_world(mi.warp.square_to_cosine_hemisphere(point)))
            sampler = frame_sampler()(dr.opaque(mi.UInt32, shift), number)
            colour, *_ = integrator.sample(self._scene, sampler, mi.RayDifferential3f(ray), None, True)
            # What lamps and the sky send here directly is not part of it.
            hit = self._scene.ray_intersect(ray)
            seen = hit.emitter(self._scene).eval(hit)
            return dr.maximum(mi.Color3f(colour) - mi.Color3f(seen), 0)

        return self._mean(places, normals, samples, one)

    def is_buried(self, places: FloatArray, normals: FloatArray) -> npt.NDArray[np.bool_]:
        """(n): places where no light comes by however many bounces: they lie within a solid, or all is dark."""
        buried = np.ones(len(places), bool)
        for samples in (4, 64):  # few are enough where it is light
            dark = np.flatnonzero(buried)
            if not len(dark):
                break
            light = self.indirect(places[dark], normals[dark], samples, endless=True).sum(1)
            if self.has_direct:
                light += self.direct(places[dark], normals[dark], samples).sum(1)
            buried[dark] = light == 0
        return buried

    def _mean(self, places: FloatArray, normals: FloatArray, samples: int, one: Any) -> FloatArray:
        """The mean of ``one(surface, number of the sample)`` at each place."""
        import drjit as dr

        mi = self._mi
        found = np.empty((len(places), 3))
        step = max(_LANES // samples, 1)
        for start in range(0, len(places), step):
            part = slice(start, min(start + step, len(places)))
            count = part.stop - part.start
            at, normal = (
                kind(*(mi.Float(np.ascontiguousarray(column, np.float32)) for column in array[part].T))
                for kind, array in ((mi.Point3f, places * self._scale), (mi.Normal3f, normals))
            )
            lane, width = dr.arange(mi.UInt32, count * samples), dr.opaque(mi.UInt32, samples)
            place = lane // width
            number = lane - place * width
            surface = dr.zeros(mi.SurfaceInteraction3f, count * samples)
            surface.p = dr.gather(mi.Point3f, at, place)
            surface.n = dr.gather(mi.Normal3f, normal, place)
            surface.sh_frame = mi.Frame3f(surface.n)
            surface.wi = mi.Vector3f(0, 0, 1)
            colour = one(surface, number)
            means = [dr.block_sum(colour[i], samples) / samples for i in range(3)]
            dr.eval(means)
            found[part] = np.stack([mean.numpy() for mean in means], 1)
        return found


def relative_error(batches: FloatArray, total: FloatArray) -> float:
    """Standard error of one batch, from batches (b, n, 3), relative to light (n, 3): three of four places err less.

    A mean would be that of the few darkest places.
    """
    luma, of_batches = total @ LUMA_WEIGHTS, batches @ LUMA_WEIGHTS
    lit = luma > 1e-3 * (np.median(luma[luma > 0]) if (luma > 0).any() else 0.0)
    if not lit.any():
        return 0.0
    return float(np.quantile(of_batches.std(0, ddof=1)[lit] / luma[lit], 0.75))


def _lattice(samples: int, shift: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """A rank-1 lattice in the unit square, shifted at random."""
    number = np.arange(samples)
    offset = np.random.RandomState(shift).uniform(size=2)
    x, y = (number + 0.5) / samples + offset[0], number * _GOLDEN + offset[1]
    # Float32 may round up to 1, which is not in the square.
    most = np.float32(1 - 2**-24)
    return np.minimum((x % 1.0).astype(np.float32), most), np.minimum((y % 1.0).astype(np.float32), most)
