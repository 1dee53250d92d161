"""Irradiance at places on a scene's surfaces by Mitsuba's path tracer: slow, with noise, and independent of ours."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from davis_rs import Scene
from davis_rs._mitsuba.variants import FAST, load_scene_source, variant

FloatArray = npt.NDArray[np.float64]

_ABOVE_M = 1e-3


def traced_irradiance(scene: Scene, places: FloatArray, normals: FloatArray, samples: int, seed: int) -> FloatArray:
    """All irradiance / pi, RGB (n, 3), at places (n, 3) with normals (n, 3) on surfaces that reflect something.

    Each place is looked at from closely above: what is seen there, divided by the reflectance.
    """
    import drjit as dr

    with variant(FAST) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        lane = np.repeat(np.arange(len(places)), samples)
        above = (places + _ABOVE_M * normals)[lane].T.astype(np.float32)
        along = (-normals)[lane].T.astype(np.float32)
        ray = mi.Ray3f(mi.Point3f(*map(mi.Float, above.copy())), mi.Vector3f(*map(mi.Float, along.copy())))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, len(lane))
        seen, *_ = loaded.integrator().sample(loaded, sampler, mi.RayDifferential3f(ray), None, True)
        hit = loaded.ray_intersect(ray)
        reflectance = hit.bsdf().eval_diffuse_reflectance(hit)
        means = [dr.block_sum(seen[i] / reflectance[i], samples) / samples for i in range(3)]
        return np.stack([np.array(mean, np.float64) for mean in means], 1)
