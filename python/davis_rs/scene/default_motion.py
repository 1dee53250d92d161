"""Makes a small motion for a camera that a file gives at rest, so that there is something to simulate."""

from __future__ import annotations

import numpy as np

from .._mitsuba.types import Mitsuba, MitsubaScene
from .._mitsuba.variants import default_variant, load_scene_source, variant
from .default_paths import CAMERA, sway
from .scene import Scene, check_scene

_COLUMNS, _ROWS = 9, 7
_NEAR = 0.25
"""The quantile of the depths in view that counts: what is near moves most."""


def with_default_motion(scene: Scene) -> Scene:
    """Return a scene whose camera, at rest in its file, goes once around a small circle across its view in 2 s.

    The radius is 5 % of the distance of what is near in the image (the lower quartile of the depths of 63 rays).
    A scene that has a trajectory is returned as it is.

    Args:
        scene: whose ``start`` is where the camera begins, looks and ends.

    Raises:
        TypeError: for what is no scene.
        ValueError: for a scene that has neither a trajectory nor a start, or whose camera sees nothing.
    """
    check_scene(scene)
    if scene.trajectory is not None:
        return scene
    if scene.start is None:
        raise ValueError(f"scene {scene.name!r} has no trajectory of its own: give it one, scene.with_trajectory(...)")
    camera = scene.camera or CAMERA
    column, row = np.meshgrid(np.linspace(0, camera.width - 1, _COLUMNS), np.linspace(0, camera.height - 1, _ROWS))
    rays = camera.rays(np.stack([column.ravel(), row.ravel()], 1))
    directions = np.concatenate([rays, np.ones((len(rays), 1))], 1) @ scene.start.rotation.T
    with variant(default_variant()[0]) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        # A direction's length is its depth 1, so distances are depths.
        depths = [_distance(loaded, mi, scene.start.position.tolist(), direction.tolist()) for direction in directions]
    hits = [depth for depth in depths if np.isfinite(depth)]
    if not hits:
        raise ValueError(f"the camera of scene {scene.name!r} sees nothing, and has no trajectory: give one")
    # Rounded, because Mitsuba's variants differ in the last digits of a distance.
    return scene.with_trajectory(sway(scene.start, float(f"{np.quantile(hits, _NEAR):.2g}")))


def _distance(scene: MitsubaScene, mi: Mitsuba, origin: list[float], direction: list[float]) -> float:
    """Return how many lengths of the direction a ray goes before it hits something; infinity where it does not."""
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
    return float(np.ravel(np.asarray(hit.t))[0])
