"""A box with a lamp in its ceiling: light from a surface, and light that bounces, for Mitsuba's integrators."""

from __future__ import annotations

from typing import Any

import numpy as np

from davis_rs import Camera, Pose, Scene, SegmentTrajectory
from davis_rs.scene.parts import look_at, rectangle
from davis_rs.scene.textures import bitmap, patchwork

SIDE_M = 2.0
MOVED_M = 0.04
"""How far the camera goes in :data:`DURATION_S`."""
DURATION_S = 0.2


def lamp_box(width: int = 96, height: int = 72, *, duration_s: float = DURATION_S, **parts: Any) -> Scene:
    """The box, as a camera of a field of view of 62 degrees sees it on its way across.

    Args:
        duration_s: of the same motion's beginning.
        parts: more entries of the scene's dictionary, or others in the place of its own.
    """
    focal = width / 1.2
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    axes = look_at(np.array([0.0, -0.9, 0.9]), np.array([0.1, 1.0, 0.8]))
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = axes, (0.0, -0.9, 0.9)
    end = start.copy()
    end[:3, 3] += MOVED_M * axes[:, 0]
    path = SegmentTrajectory(Pose.from_matrix(start), Pose.from_matrix(end), DURATION_S)
    scene = Scene("lamp box", lambda: {**_source(), **parts}, camera=camera, trajectory=path)
    return scene if duration_s == DURATION_S else scene.crop(0.0, duration_s)


def _source() -> dict[str, Any]:
    half = SIDE_M / 2
    x, y, z = np.eye(3)
    walls = {
        "floor": ([0.0, 0.0, 0.0], np.stack([x, y, z], 1)),
        "ceiling": ([0.0, 0.0, SIDE_M], np.stack([x, -y, -z], 1)),
        "back": ([0.0, half, half], np.stack([x, z, -y], 1)),
        "front": ([0.0, -half, half], np.stack([-x, z, y], 1)),
        "left": ([-half, 0.0, half], np.stack([y, z, x], 1)),
        "right": ([half, 0.0, half], np.stack([-y, z, -x], 1)),
    }
    shapes = {
        name: rectangle(centre, axes, (half, half), _wallpaper(seed))
        for seed, (name, (centre, axes)) in enumerate(walls.items())
    }
    lamp = rectangle([0.1, 0.2, SIDE_M - 0.01], np.stack([x, -y, -z], 1), (0.25, 0.25), 0.5)
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        **shapes,
        "crate": rectangle([0.3, 0.4, 0.5], np.stack([x, z, -y], 1), (0.25, 0.25), _wallpaper(9)),
        "lamp": {**lamp, "emitter": {"type": "area", "radiance": 12.0}},
    }


def _wallpaper(seed: int) -> dict[str, Any]:
    return bitmap(patchwork(128, seed, low=0.15, high=0.9, grain=0.4, shapes=30, tint=(1.0, 0.95, 0.85)))
