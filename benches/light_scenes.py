"""Scenes under lamps and skies, for benches/light.py: boxes, a room, a yard and the office of the sequences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene, SegmentTrajectory
from davis_rs.scene import meshes
from davis_rs.scene.parts import look_at
from davis_rs.scene.sequences import SEQUENCES
from davis_rs.scene.textures import patchwork

FloatArray = npt.NDArray[np.float64]
SWEEP_S = 0.2


def box() -> Scene:
    """A closed box of 2 m with a lamp below its ceiling and two blocks; the camera moves 4 cm in 0.2 s."""

    def source() -> dict[str, Any]:
        walls = [
            meshes.quad([-1, -1, 0], [2, 0, 0], [0, 2, 0]),
            meshes.quad([-1, 1, 2], [2, 0, 0], [0, -2, 0]),
            meshes.quad([-1, 1, 0], [2, 0, 0], [0, 0, 2]),
            meshes.quad([1, -1, 0], [-2, 0, 0], [0, 0, 2]),
            meshes.quad([-1, -1, 0], [0, 2, 0], [0, 0, 2]),
            meshes.quad([1, 1, 0], [0, -2, 0], [0, 0, 2]),
        ]
        blocks = [
            meshes.box([-0.3, -0.3, 0], [0.3, 0.3, 0.6]).moved([0.35, 0.1, 0], 0.5),
            meshes.box([-0.25, -0.25, 0], [0.25, 0.25, 1.2]).moved([-0.4, 0.4, 0], -0.35),
        ]
        lamp = meshes.quad([-0.3, 0.3, 1.98], [0.6, 0, 0], [0, -0.6, 0])
        return {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            **{f"wall_{i}": meshes.shape(wall, _texture(i)) for i, wall in enumerate(walls)},
            "blocks": meshes.shape(meshes.merged(blocks), _texture(7)),
            "lamp": _lamp(lamp, 12.0),
        }

    return _scene(
        "box", source, [0.0, -0.85, 1.1], [0.05, 0.4, 0.75], [0.04, 0.0, 0.0], Camera(96, 72, 70, 70, 47.5, 35.5)
    )


def moving() -> Scene:
    """The box, in which the lower block goes 30 cm to the side and turns by 30 degrees in 0.2 s."""
    still = box()

    def source() -> dict[str, Any]:
        low = meshes.box([-0.3, -0.3, 0], [0.3, 0.3, 0.6])
        tall = meshes.box([-0.25, -0.25, 0], [0.25, 0.25, 1.2]).moved([-0.4, 0.4, 0], -0.35)
        blocks = {"blocks": meshes.shape(tall, _texture(7)), "low": meshes.shape(low, _texture(8))}
        return {**dict(still.source()), **blocks}  # type: ignore[arg-type]

    first, last = ([x, 0.1, 0.0] for x in (0.45, 0.15))
    turns = [Rotation.from_rotvec([0, 0, angle]).as_quat() for angle in (0.5, 0.5 + np.pi / 6)]
    path = SegmentTrajectory(Pose(first, turns[0]), Pose(last, turns[1]), SWEEP_S)
    return replace(still, name="moving", source=source, objects={"low": path})


def office() -> Scene:
    """office_zigzag under four lamps below the ceiling and light that bounces, instead of light from all sides."""
    ambient = SEQUENCES["office_zigzag"].scene()

    def source() -> dict[str, Any]:
        room = dict(ambient.source())  # type: ignore[arg-type]
        for light in ("general", "lamp"):
            del room[light]
        for number, (x, y) in enumerate([(-1.2, 0.6), (1.2, 0.6), (-1.2, -1.5), (1.2, -1.5)]):
            lamp = meshes.quad([x - 0.6, y + 0.15, 2.98], [1.2, 0, 0], [0, -0.3, 0])
            room[f"ceiling_lamp_{number}"] = _lamp(lamp, 30.0)
        return {**room, "integrator": {"type": "path", "max_depth": 5}}

    return replace(ambient, name="office", source=source, ambient=False)


def room() -> Scene:
    """A room with a window to a white sky, a lamp and furniture: 2 x 10^4 triangles."""

    def source() -> dict[str, Any]:
        wide, deep, high = 4.0, 5.0, 2.6
        shell = [
            meshes.quad([0, 0, 0], [wide, 0, 0], [0, deep, 0]),
            meshes.quad([0, deep, high], [wide, 0, 0], [0, -deep, 0]),
            meshes.quad([0, deep, 0], [wide, 0, 0], [0, 0, high]),
            meshes.quad([wide, 0, 0], [-wide, 0, 0], [0, 0, high]),
            meshes.quad([0, 0, 0], [0, deep, 0], [0, 0, high]),
            # The wall with the window, around an opening of 1.6 x 1.2 m.
            meshes.quad([wide, deep, 0], [0, -deep, 0], [0, 0, 0.9]),
            meshes.quad([wide, deep, 2.1], [0, -deep, 0], [0, 0, high - 2.1]),
            meshes.quad([wide, deep, 0.9], [0, 2.6 - deep, 0], [0, 0, 1.2]),
            meshes.quad([wide, 1.0, 0.9], [0, -1.0, 0], [0, 0, 1.2]),
        ]
        table = [meshes.box([-0.8, -0.45, 0.70], [0.8, 0.45, 0.74])]
        table += [
            meshes.box([x - 0.03, y - 0.03, 0], [x + 0.03, y + 0.03, 0.70])
            for x in (-0.74, 0.74)
            for y in (-0.39, 0.39)
        ]
        shelf = [meshes.box([0, 0, z], [0.3, 1.6, z + 0.03]) for z in (0.1, 0.5, 0.9, 1.3, 1.7)]
        random = np.random.RandomState(1)
        books = []
        for z in (0.13, 0.53, 0.93, 1.33):
            y = 0.02
            while y < 1.5:
                thick, tall, depth = random.uniform([0.02, 0.18, 0.14], [0.06, 0.32, 0.24])
                books.append(meshes.box([0.02, y, z], [0.02 + depth, y + thick, z + tall]))
                y += thick + 0.003
        bowls = [
            meshes.ball([2.0 + 0.35 * i, 3.0 + 0.1 * i, 0.74 + r], [r, r, r], rings=48, sides=64)
            for i, r in enumerate((0.14, 0.10, 0.12))
        ]
        return {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [4.0, 4.0, 4.0]}},
            **{f"wall_{i}": meshes.shape(wall, _texture(i)) for i, wall in enumerate(shell)},
            "table": meshes.shape(meshes.merged(table).moved([2.2, 3.0, 0], 0.2), _texture(20)),
            "shelf": meshes.shape(meshes.merged(shelf).moved([0.02, 2.4, 0]), 0.6),
            "books": meshes.shape(meshes.merged(books).moved([0.02, 2.4, 0]), _texture(21)),
            "bowls": meshes.shape(meshes.merged(bowls), _texture(22)),
            "lamp": _lamp(meshes.quad([1.6, 3.0, 2.55], [0.5, 0, 0], [0, -0.5, 0]), 6.0),
        }

    camera = Camera(1280, 720, 960, 960, 639.5, 359.5)
    return _scene("room", source, [1.8, 0.4, 1.5], [1.9, 3.2, 0.9], [0.1, 0.0, 0.0], camera)


def yard() -> Scene:
    """Blocks and balls on a ground under the sun, and a sky with clouds as an environment map."""

    def source() -> dict[str, Any]:
        import mitsuba as mi

        random = np.random.RandomState(2)
        blocks = [
            meshes.box([-s, -s, 0], [s, s, 2 * s]).moved([x, y, 0], turn)
            for x, y, s, turn in random.uniform([-3, 1, 0.15, 0], [3, 7, 0.6, 1.5], (12, 4))
        ]
        balls = [
            meshes.ball([x, y, r], [r, r, r], rings=16, sides=24)
            for x, y, r in random.uniform([-2, 0, 0.15], [2, 3, 0.3], (4, 3))
        ]
        return {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 6},
            "sky": {"type": "envmap", "bitmap": mi.Bitmap(_clouds()), "to_world": _UPRIGHT},
            "sun": {"type": "directional", "direction": [0.4, 0.5, -0.7], "irradiance": {"type": "rgb", "value": 2.0}},
            "ground": meshes.shape(meshes.quad([-8, -4, 0], [16, 0, 0], [0, 16, 0]), _texture(30)),
            "blocks": meshes.shape(meshes.merged(blocks), _texture(31)),
            "balls": meshes.shape(meshes.merged(balls), _texture(32)),
        }

    camera = Camera(240, 180, 200, 200, 119.5, 89.5)
    return _scene("yard", source, [0.0, -2.5, 1.6], [0.0, 3.0, 0.4], [0.2, 0.0, 0.0], camera)


_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Environment maps have y upwards, the yard z."""


def _clouds() -> npt.NDArray[np.float32]:
    """Radiance (128, 256, 3) of a sky that is brighter near the horizon, with soft clouds; below, of far ground."""
    random, (height, width) = np.random.RandomState(3), (128, 256)
    waves = random.normal(size=(height, width))
    across, down = np.fft.fftfreq(width) * width, np.fft.fftfreq(height) * height
    slow = 1.0 / (1.0 + (np.add.outer(down**2, across**2) / 16.0) ** 1.1)
    cover = np.real(np.fft.ifft2(np.fft.fft2(waves) * slow))
    cover = np.clip(0.5 + cover / (2 * cover.std()), 0.0, 1.0)[..., None]
    up = np.cos(np.pi * (np.arange(height) + 0.5) / height)[:, None, None]
    blue = np.array([0.25, 0.4, 0.75]) + (1.0 - np.maximum(up, 0.0)) ** 4 * np.array([0.45, 0.4, 0.2])
    sky = 0.7 * (blue * (1.0 - cover) + cover * 0.9)
    return np.where(up > 0, sky, 0.15).astype(np.float32)


SCENES = {"box": box, "moving": moving, "office": office, "room": room, "yard": yard}


def _texture(seed: int) -> npt.NDArray[np.float32]:
    return patchwork(256, seed, low=0.15, high=0.9, grain=0.4, shapes=60, tint=(1.0, 1.0, 1.0))


def _lamp(mesh: meshes.Mesh, radiance: float) -> dict[str, Any]:
    """A rectangle that shines to its front."""
    corner, right, far, up = mesh.vertices
    to_world = np.eye(4)
    to_world[:3, 0], to_world[:3, 1] = (right - corner) / 2, (up - corner) / 2
    to_world[:3, 2] = np.cross(to_world[:3, 0], to_world[:3, 1])
    to_world[:3, 2] /= np.linalg.norm(to_world[:3, 2])
    to_world[:3, 3] = (corner + far) / 2
    return {
        "type": "rectangle",
        "to_world": to_world,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
    }


def _scene(name: str, source: Any, place: list[float], target: list[float], way: list[float], camera: Camera) -> Scene:
    axes = look_at(np.array(place), np.array(target))
    quaternion = Rotation.from_matrix(axes).as_quat()
    start, end = Pose(place, quaternion), Pose(np.add(place, way), quaternion)
    return Scene(name, source, camera=camera, trajectory=SegmentTrajectory(start, end, SWEEP_S))
