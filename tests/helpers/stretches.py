"""Stretches of small scenes, for the tests of what is rendered of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import Camera, FixedRate, Pose, Scene, SegmentTrajectory, Trajectory, load_scene
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.keyframes import Keyframe, Stretch
from davis_rs.sampling.rules import TimeSampling

CAMERA = Camera(40, 30, 33.0, 33.0, 19.5, 14.5)
NARROW = Camera(40, 30, 120.0, 120.0, 19.5, 14.5)
"""Resolves the built-in textures about as a DAVIS does."""

TINY = Camera(12, 9, 10.0, 10.0, 5.5, 4.0)
LOG_EPS = 1e-3
DOWN = Pose([0.3, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
"""Looks down from above the origin."""

GREY = {"type": "diffuse", "reflectance": 0.5}
LAMP = {"type": "point", "position": [0.4, -0.5, 6.0], "intensity": 90.0}


@lru_cache(maxsize=4)
def built_in(name: str = "three_planes", camera: Camera = CAMERA) -> tuple[Renderer, Trajectory]:
    """A renderer of a built-in scene, and 0.3 s of its trajectory from 0.5 s on."""
    scene = load_scene(name)
    assert scene.trajectory is not None
    return make_renderer(scene, camera, rays_per_pixel=8), scene.trajectory.crop(0.5, 0.3)


def wall(left: float = -30.0) -> Scene:
    """A wide floor without texture, from x = ``left`` on, under a lamp."""
    wide = np.diag([30.0, 30.0, 1.0, 1.0])
    wide[0, 3] = left + 30.0
    parts = {"type": "scene", "lamp": LAMP, "floor": {"type": "rectangle", "to_world": wide, "bsdf": GREY}}
    return Scene("wall", partial(dict, parts))


def mirror() -> Scene:
    """A mirror that shows a ball and what is behind: for Mitsuba's own integrator."""
    back = np.diag([4.0, 4.0, -1.0, 1.0])
    back[:3, 3] = (0.0, 0.0, 5.0)
    texels = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
    textured = {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "data": texels}}
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "lamp": LAMP | {"position": [0.4, -0.5, 2.5]},
        "mirror": {"type": "rectangle", "bsdf": {"type": "conductor"}},
        "ceiling": {"type": "rectangle", "to_world": back, "bsdf": textured},
        "ball": {"type": "sphere", "center": [0.0, 0.0, 0.8], "radius": 0.3, "bsdf": GREY},
    }
    return Scene("mirror", partial(dict, parts))


def shift(by: Sequence[float], duration_s: float, start: Pose = DOWN) -> SegmentTrajectory:
    """A straight path from ``start``."""
    return SegmentTrajectory(start, Pose(np.add(start.position, by), start.quaternion), duration_s)


def stretch(
    renderer: Renderer,
    trajectory: Trajectory,
    due: Sequence[int] | None = None,
    *,
    start_us: int = 0,
    first: bool = True,
    contrast_threshold: float = 0.15,
    batch: int = 16,
) -> Stretch:
    """The whole of a trajectory; by default its start and its end are due."""
    end_us = start_us + round(trajectory.duration_s * 1e6)
    return Stretch(
        renderer=renderer,
        trajectory=trajectory,
        start_us=start_us,
        end_us=end_us,
        first=first,
        due=[start_us, end_us] if due is None else due,
        contrast_threshold=contrast_threshold,
        log_eps=LOG_EPS,
        batch=batch,
    )


def times_of(keyframes: Sequence[Keyframe]) -> npt.NDArray[np.int64]:
    return np.array([keyframe.t_us for keyframe in keyframes], np.int64)


def sparse_count(keyframes: Sequence[Keyframe]) -> int:
    return sum(len(keyframe.sparse.pixel) for keyframe in keyframes if keyframe.sparse is not None)


def dense(part: Stretch, rate_hz: float = 20_000.0) -> list[Keyframe]:
    """Keyframes so close that lines between them do for the truth."""
    sampling: TimeSampling = FixedRate(rate_hz)
    return list(sampling.keyframes(part))
