"""Renders a scene by the path tracer, as the reference of what other renderers make of it, and shows the difference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

import davis_rs
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.presets import ACCURACY, DEFAULT_ACCURACY, pixel_arguments

FloatArray = npt.NDArray[np.float64]

C = 0.15
RUNS = 4
"""The fewest renderings of the reference, whose scatter is its error."""

MOST_SAMPLES = 1024
"""Samples of one rendering at most: more of them need more renderings."""

PIXELS = pixel_arguments(ACCURACY[DEFAULT_ACCURACY])
"""What a pixel of the renderers without noise is made of where nothing else is asked for."""


def with_paths(scene: davis_rs.Scene) -> davis_rs.Scene:
    """Return a scene under all bounces of light, if its file does not say itself which light it wants."""
    if scene.file is not None and scene.file.suffix == ".xml":
        return scene

    def source() -> dict[str, Any]:
        parts = scene.source()
        assert isinstance(parts, dict)
        return {**parts, "integrator": {"type": "path"}}

    return replace(scene, source=source)


def at_width(camera: Camera, width: int, zoom: float) -> Camera:
    """Return a camera of fewer or more pixels that sees the middle of the view, so many times larger."""
    by = width / camera.width
    height = max(1, round(camera.height * by))
    cx, cy = ((centre + 0.5) * by - 0.5 for centre in (camera.cx, camera.cy))
    return Camera(width=width, height=height, fx=camera.fx * by * zoom, fy=camera.fy * by * zoom, cx=cx, cy=cy)


def world_name(file: Path) -> str:
    """Return what a world is called: its file, or its folder where the file is called as many others are."""
    return file.stem if file.stem not in ("scene", "model") else file.parent.name


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
        views, count = first_view(scene), max(RUNS, -(-samples // MOST_SAMPLES))
        rays = samples // count
        runs = np.array(
            [
                luma_of(make_renderer(scene, camera, kind="integrator", rays_per_pixel=rays, seed=k, blur=False), views)
                for k in range(count)
            ]
        )
        if kept is not None:
            np.save(kept, runs)
    return runs.mean(0), runs.std(0, ddof=1) / np.sqrt(len(runs))


def shown(luma: FloatArray, white: float) -> Image.Image:
    """Return luma as a picture of twice the width and height."""
    return _doubled(255 * np.clip(luma / white, 0, 1) ** (1 / 2.2))


def difference(off: FloatArray) -> Image.Image:
    """Return a difference of log luma likewise, white and black at 3 C."""
    return _doubled(np.clip(128 + 127 * off / (3 * C), 0, 255))


def _doubled(values: FloatArray) -> Image.Image:
    return Image.fromarray(values.astype(np.uint8).repeat(2, 0).repeat(2, 1))
