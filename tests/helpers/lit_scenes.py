"""Small scenes under lamps, whose light is baked, for a small camera that looks down."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import SCALAR
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Parts = dict[str, Any]

CAMERA = Camera(16, 12, 14.0, 14.0, 7.5, 5.5)
DOWN = Pose([0.0, 0.0, 1.4], [1.0, 0.0, 0.0, 0.0])
DIRECT, PATH = {"type": "direct"}, {"type": "path"}


def diffuse(reflectance: Any = 0.6) -> Parts:
    if not isinstance(reflectance, dict):
        reflectance = {"type": "rgb", "value": reflectance}
    return {"type": "diffuse", "reflectance": reflectance}


def plate(
    x: float, y: float, z: float, half: tuple[float, float], bsdf: Parts | None = None, *, up: bool = True
) -> Parts:
    """A level rectangle."""
    to_world = np.diag([half[0], half[1] if up else -half[1], 1.0 if up else -1.0, 1.0])
    to_world[:3, 3] = (x, y, z)
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf or diffuse()}


def lamp(z: float = 2.0, radiance: Any = 5.0, half: tuple[float, float] = (0.4, 0.3)) -> Parts:
    return plate(0.1, 0.2, z, half, up=False) | {"emitter": area(radiance)}


def noise(seed: int, low: float, high: float, shape: tuple[int, int, int]) -> npt.NDArray[np.float32]:
    return np.random.RandomState(seed).uniform(low, high, shape).astype(np.float32)


def area(radiance: Any) -> Parts:
    return {"type": "area", "radiance": {"type": "rgb", "value": radiance}}


def make_scene(integrator: Parts = PATH, /, lights: Parts | None = None, **parts: Parts) -> Scene:
    return Scene("lit", partial(dict, {"type": "scene", "integrator": integrator, **parts}), lights=lights or {})


def build(scene: Scene, error: float = 0.05, **settings: Any) -> Renderer:
    return make_renderer(scene, CAMERA, **{"kind": "baked", "rays_per_pixel": 4, "bake_error": error, **settings})


def luma_of(scene: Scene, error: float = 0.05, pose: Pose = DOWN, **settings: Any) -> npt.NDArray[np.float32]:
    return build(scene, error, **settings).luma(Views.at_rest([pose]))[0]


def shift(*offset: float) -> FloatArray:
    return np.pad(np.array(offset)[:, None], ((0, 1), (3, 0)))


def colourful() -> dict[str, Parts]:
    """Red, green and striped surfaces in an open corner, a coloured lamp, and a lamp in a point."""
    wall = {"type": "rectangle", "bsdf": diffuse([0.8, 0.2, 0.1])}
    wall["to_world"] = np.array([[0, 0, 1, -1.0], [1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 0, 1]])
    stripes = {"type": "bitmap", "raw": True, "data": noise(1, 0.2, 0.8, (4, 4, 3))}
    return {
        "floor": plate(0, 0, 0, (1, 1), diffuse(stripes)),
        "wall": wall,
        "block": {
            "type": "cube",
            "to_world": np.diag([0.2, 0.2, 0.2, 1.0]) + shift(0.3, 0.1, 0.2),
            "bsdf": diffuse(0.7),
        },
        "panel": lamp(2.0, [4.0, 5.0, 2.0]),
        "bulb": {"type": "point", "position": [0.5, -0.5, 1.0], "intensity": {"type": "rgb", "value": [0.2, 0.4, 0.8]}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}},
    }


def environment(values: npt.ArrayLike) -> Parts:
    """An environment map of radiances (height, width, 3)."""
    import mitsuba as mi

    # Its own bitmap, because Mitsuba has none before a variant is set.
    mi.set_variant(mi.variant() or SCALAR)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.asarray(values, np.float32))}
