"""Renders a scene by the path tracer, as the reference of what other renderers make of it, and shows the difference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

import davis_rs
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer

FloatArray = npt.NDArray[np.float64]

C = 0.15
RUNS = 4
"""Renderings of the reference, whose scatter is its error."""


def first_view(scene: davis_rs.Scene) -> Views:
    """Return the view at which a scene's path begins, or that of its camera at rest."""
    if scene.trajectory is None:
        return Views.at_rest([davis_rs.start_pose(scene)])
    return Views.along(scene.trajectory, np.zeros(1))


def luma_of(renderer: Renderer, views: Views) -> FloatArray:
    """Return the luma (h, w) of the first view."""
    return renderer.luma(views)[0].astype(np.float64)


def reference(scene: davis_rs.Scene, camera: Camera, samples: int, kept: Path | None) -> tuple[FloatArray, FloatArray]:
    """Return the path tracer's mean luma (h, w) and its standard error; ``kept`` is a file for them."""
    if kept is not None and kept.exists():
        runs = np.load(kept)
    else:
        views, rays = first_view(scene), samples // RUNS
        runs = np.array(
            [
                luma_of(make_renderer(scene, camera, kind="integrator", rays_per_pixel=rays, seed=k, blur=False), views)
                for k in range(RUNS)
            ]
        )
        if kept is not None:
            np.save(kept, runs)
    return runs.mean(0), runs.std(0, ddof=1) / np.sqrt(RUNS)


def shown(luma: FloatArray, white: float) -> Image.Image:
    """Return luma as a picture of twice the width and height."""
    return _doubled(255 * np.clip(luma / white, 0, 1) ** (1 / 2.2))


def difference(off: FloatArray) -> Image.Image:
    """Return a difference of log luma likewise, white and black at 3 C."""
    return _doubled(np.clip(128 + 127 * off / (3 * C), 0, 255))


def _doubled(values: FloatArray) -> Image.Image:
    return Image.fromarray(values.astype(np.uint8).repeat(2, 0).repeat(2, 1))
