"""Makes scenes of random moving images and meshes before a background, as training data.

The idea is that of FlyingChairs (Dosovitskiy et al., "FlowNet", ICCV 2015) and MultiFlow (Gehrig et al., "Dense
Continuous-Time Optical Flow from Events and Frames", 2022): images that move over other images. Here they are planes in
space that move rigidly, so depth, poses and occlusion belong to them too.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import MitsubaShape, SceneDictionary
from ..._util.argument_error import ArgumentError
from ..._util.budget import Budget
from ..._util.random_words import Words
from ...geometry.camera import PRESETS
from ...geometry.pose import FloatArray, Pose, hamilton, rotation_matrices
from ...geometry.trajectory.trajectory import CallableTrajectory
from ..files.mesh_scene import READERS as MESH_READERS
from ..files.texture_folder import check_image, image_files, mesh_files, read_image_texture
from ..meshes import Mesh, shape
from ..parts import DIRECT, look_at, rectangle
from ..scene import Scene
from ..textures import Texture, bitmap, patchwork

Files = str | Path | Sequence[Path]

_Image = Path | int
"""A file, or the number of a built-in texture."""

_Reader = Callable[[_Image], Texture]

_Item = TypeVar("_Item")

CAMERA = PRESETS["ideal"]

_TILES = 9
"""How often the image of the background is repeated each way, every other time mirrored: the view never leaves it."""

_BUILT_IN = range(48)
"""The numbers of the built-in textures."""

_BUILT_IN_SIDES = 32, 512
"""The fewest and the most texels on a side of a built-in texture, powers of two."""

_INNER = 0.8
"""Fraction of the image, from its middle to its edges, in which the middles of objects lie."""


@dataclass(frozen=True)
class _ObjectRanges:
    """Holds the ranges from which the values of each object are drawn."""

    depth_m: tuple[float, float]
    size: tuple[float, float]
    top_speed_m_s: float
    top_rate_rad_s: float
    tilt_rad: float


def random_textured_planes(
    textures: Files | None = None,
    *,
    seed: int = 0,
    planes: int = 4,
    meshes: Files | None = None,
    mesh_objects: int | None = None,
    duration_s: float = 1.0,
    nearest_m: float = 1.0,
    farthest_m: float = 3.0,
    background_m: float = 4.0,
    smallest: float = 0.2,
    largest: float = 0.6,
    top_speed_m_s: float = 2.0,
    top_rate_rad_s: float = 2.0,
    tilt_rad: float = 0.5,
    camera_speed_m_s: float = 0.5,
    camera_rate_rad_s: float = 0.5,
    texture_px: int = 512,
) -> Scene:
    """Make a scene of random images on planes that move, before an image that covers the view.

    Every object has a random position in the image, depth, size, pose and motion of its own, and so has the camera.
    Speeds change linearly from one drawn value to another over the scene's time. Objects are where they were drawn at
    half of it. Light comes evenly from all sides, so luma is what the images reflect: there are no shadows and no
    shading. Objects may pass through each other. Shapes are called ``background``, ``plane_1``, ..., ``mesh_1``, ...

    Args:
        textures: a folder with images (PNG, JPEG, TIFF, BMP, TGA, of 8 bits a channel, subfolders too), or its files;
            built-in textures (noise under rectangles, discs and stripes) if not given.
        seed: of all random draws; those of one object depend only on the seed and its number.
        planes: how many, >= 0.
        meshes: a folder with OBJ and PLY meshes, or its files: they move as planes do, each with a random image on it
            in place of its own materials.
        mesh_objects: how many of them, >= 0; None for 1 where there are meshes.
        duration_s: of the motion, > 0.
        nearest_m, farthest_m: between which depths objects are, 0 < nearest < farthest. background_m: the
            background's, farther than that.
        smallest, largest: between which fractions of the image's width the size of an object lies,
            0 < smallest <= largest.
        top_speed_m_s, top_rate_rad_s: of objects, >= 0.
        tilt_rad: by how much planes are turned away from the camera at most, 0 to pi / 2.
        camera_speed_m_s, camera_rate_rad_s: the top speeds of the camera's own path, >= 0.
        texture_px: the most texels on a side, >= 16; larger images are scaled down. Built-in textures have a power of
            two, 32 to 512.

    Raises:
        OSError: if a folder or a file cannot be read.
        ImportError: without OpenCV, if an image has to be scaled down.
        ValueError: for a number out of range, a folder without images, or an image that cannot be read or is smaller
            than 16 pixels, naming it.
    """
    _check_numbers(planes, mesh_objects, meshes is not None, texture_px)
    if not 0 < nearest_m < farthest_m < background_m < math.inf:
        raise ValueError(
            "depths must be 0 < nearest_m < farthest_m < background_m, "
            f"got {nearest_m}, {farthest_m} and {background_m}"
        )
    if not 0 < smallest <= largest < math.inf:
        raise ValueError(f"sizes must be 0 < smallest <= largest, got {smallest} and {largest}")
    if not 0 <= tilt_rad <= math.pi / 2:
        raise ArgumentError("{tilt_rad} must lie in 0..pi/2, got {}", tilt_rad)
    if not 0 < duration_s < math.inf:
        raise ArgumentError("{duration_s} must be finite and > 0, got {}", duration_s)
    speeds = (top_speed_m_s, top_rate_rad_s, camera_speed_m_s, camera_rate_rad_s)
    if not all(0 <= speed < math.inf for speed in speeds):
        raise ValueError(f"top speeds and rates must be finite and >= 0, got {speeds}")
    images: Sequence[_Image] = _BUILT_IN if textures is None else _listed(textures, image_files, "textures")
    ranges = _ObjectRanges((nearest_m, farthest_m), (smallest, largest), top_speed_m_s, top_rate_rad_s, tilt_rad)
    centre = np.eye(3), np.zeros(3)
    camera = _ObjectMotion(seed, "camera", duration_s, camera_speed_m_s, camera_rate_rad_s, *centre)
    background = _drawn(images, seed, "background")
    drawn = [_SceneObject(seed, f"plane_{k + 1}", images, None, duration_s, ranges) for k in range(planes)]
    if meshes is not None:
        files = _listed(meshes, mesh_files, "meshes")
        count = 1 if mesh_objects is None else mesh_objects
        drawn += [_SceneObject(seed, f"mesh_{k + 1}", images, files, duration_s, ranges) for k in range(count)]
    for image in {background, *(item.image for item in drawn)}:
        if isinstance(image, Path):
            check_image(image, texture_px)
    read = functools.cache(lambda image: _read(image, texture_px))  # sources are asked for more than once
    return Scene(
        name="random_planes",
        source=lambda: _source(background, background_m, drawn, read),
        camera=CAMERA,
        trajectory=camera.trajectory,
        shadows=False,
        objects={item.name: item.trajectory for item in drawn},
        ambient=True,
        note="; ".join(f"{item}" for item in (f"background: {_name(background)}", *drawn)),
    )


class _ObjectMotion:
    """Describes a path whose velocity, and rate about one axis, change linearly from one drawn value to another.

    Args:
        axes, position: its pose at half of its time, in camera axes.

    Attributes:
        trajectory: in world axes (z up; the camera looks along y).
    """

    def __init__(
        self, seed: int, name: str, duration_s: float, top_speed: float, top_rate: float, axes: FloatArray,
        position: FloatArray,
    ) -> None:  # fmt: skip
        world = look_at(np.zeros(3), np.array([0.0, 1.0, 0.0]))
        v0, v1 = (world @ _in_ball(Words(seed, 0, f"{name}.velocity.{k}")) * top_speed for k in (0, 1))
        axis = _unit(_in_ball(Words(seed, 0, f"{name}.axis")))
        w0, w1 = (Words(seed, 0, f"{name}.rate.{k}").uniform(-1, 1) * top_rate for k in (0, 1))
        rotation = np.eye(4)
        rotation[:3, :3] = world @ axes
        middle = Pose.from_matrix(rotation).quaternion
        body_axis = rotation[:3, :3].T @ axis
        at, half = world @ position, duration_s / 2

        def travelled(t: FloatArray, first: FloatArray | float, last: FloatArray | float) -> FloatArray:
            """Integrate a value that changes linearly from the first to the last, from half of the time on."""
            return first * (t - half) + (last - first) * (t * t - half * half) / (2 * duration_s)

        def quaternions(t: FloatArray) -> FloatArray:
            angle = travelled(t, w0, w1)[:, None] / 2
            turn = np.concatenate([axis * np.sin(angle), np.cos(angle)], 1)
            return hamilton(turn, np.broadcast_to(middle, turn.shape))

        self.trajectory = CallableTrajectory(
            duration_s=duration_s,
            position=lambda t: at + travelled(t[:, None], v0, v1),
            velocity=lambda t: v0 + (v1 - v0) * t[:, None] / duration_s,
            acceleration=lambda t: np.tile((v1 - v0) / duration_s, (len(t), 1)),
            quaternion=quaternions,
            angular_rate=lambda t: (w0 + (w1 - w0) * t[:, None] / duration_s) * body_axis,
            angular_acceleration=lambda t: np.tile((w1 - w0) / duration_s * body_axis, (len(t), 1)),
            description={
                "path": "velocity, and rate about an axis, go evenly from one value to another",
                "velocities_m_s": [v0.tolist(), v1.tolist()],
                "rates_rad_s": [w0, w1],
                "axis": axis.tolist(),
            },
        )


class _SceneObject:
    """Describes a plane or mesh of a scene: its files, size and path."""

    def __init__(
        self, seed: int, name: str, images: Sequence[_Image], meshes: Sequence[Path] | None, duration_s: float,
        ranges: _ObjectRanges,
    ) -> None:  # fmt: skip
        def words(purpose: str) -> Words:
            return Words(seed, 0, f"{name}.{purpose}")

        self.name, self.image = name, _drawn(images, seed, f"{name}.image")
        self.mesh = None if meshes is None else _drawn(meshes, seed, f"{name}.mesh")
        depth = words("depth").uniform(*ranges.depth_m)
        half = np.array([CAMERA.width / CAMERA.fx, CAMERA.height / CAMERA.fy]) / 2 * depth
        at = words("place")
        offset = half * [at.uniform(-_INNER, _INNER), at.uniform(-_INNER, _INNER)]
        self.half_m = half[0] * words("size").uniform(*ranges.size)
        if meshes is None:
            turned = words("tilt")
            around, tilt = turned.uniform(-math.pi, math.pi), turned.uniform(0, ranges.tilt_rad)
            roll = turned.uniform(-math.pi, math.pi)
            tilted = _about([math.cos(around), math.sin(around), 0.0], tilt)
            axes = tilted @ _about([0.0, 0.0, 1.0], roll)
        else:
            turned = words("turn")
            axes = _about(_in_ball(turned), turned.uniform(-math.pi, math.pi))
        position = np.array([*offset, depth])
        top = ranges.top_speed_m_s, ranges.top_rate_rad_s
        self.trajectory = _ObjectMotion(seed, name, duration_s, *top, axes, position).trajectory

    def __str__(self) -> str:
        mesh = "" if self.mesh is None else f"{self.mesh.name} with "
        return f"{self.name}: {mesh}{_name(self.image)}"

    def shape(self, read: _Reader) -> SceneDictionary | MitsubaShape:
        """Make its Mitsuba shape, in its own frame."""
        texture = read(self.image)
        if self.mesh is not None:
            return shape(_fitted(self.mesh, self.half_m), texture)
        stretched = math.sqrt(texture.shape[1] / texture.shape[0])
        half = self.half_m * stretched, self.half_m / stretched
        return rectangle([0.0, 0.0, 0.0], np.eye(3), half, bitmap(texture, wrap="clamp"))


def _source(background: _Image, background_m: float, objects: Sequence[_SceneObject], read: _Reader) -> SceneDictionary:
    texture = read(background)
    aspect = texture.shape[1] / texture.shape[0]
    width = max(CAMERA.width / CAMERA.fx, CAMERA.height / CAMERA.fy * aspect) * background_m
    half = _TILES / 2 * width, _TILES / 2 * width / aspect
    axes = look_at(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    tiled = bitmap(texture, repeats=(_TILES, _TILES), wrap="mirror")
    return {
        "type": "scene",
        "integrator": DIRECT,
        "light": {"type": "constant", "radiance": 1.0},
        "background": rectangle([0.0, background_m, 0.0], axes, half, tiled),
        **{item.name: item.shape(read) for item in objects},
    }


def _fitted(path: Path, radius: float) -> Mesh:
    """Read a mesh file, centred and scaled into a ball of this radius; v runs downwards, as rows of images do.

    Parts without texture coordinates get those of the box around the mesh, seen along its thinnest side.
    """
    parts = MESH_READERS[path.suffix.lower()](path, Budget(path))
    corners = np.concatenate([part.corners for part in parts])
    low, high = corners.min((0, 1)), corners.max((0, 1))
    corners = corners - (low + high) / 2
    reach = float(np.linalg.norm(corners, axis=-1).max())
    wide = np.sort(np.argsort(low - high, kind="stable")[:2])
    spanned = corners[..., wide] / np.maximum((high - low)[wide], 1e-9 * reach) + 0.5
    firsts = np.cumsum([0, *(len(part.corners) for part in parts)])
    own = [
        spanned[a : a + len(part.corners)] if part.uv is None else part.uv
        for a, part in zip(firsts, parts, strict=False)
    ]
    uv = np.concatenate(own) * [1, -1] + [0, 1]
    count = 3 * len(corners)
    return Mesh((corners * (radius / reach)).reshape(-1, 3), np.arange(count).reshape(-1, 3), uv.reshape(-1, 2))


def _listed(files: Files, of_folder: Callable[[str | Path], tuple[Path, ...]], name: str) -> tuple[Path, ...]:
    if isinstance(files, str | Path):
        return of_folder(files)
    if not files:
        raise ValueError(f"{name} must be a folder, or some files: got none")
    return tuple(map(Path, files))


def _drawn(items: Sequence[_Item], seed: int, path: str) -> _Item:
    return items[Words(seed, 0, path).below(len(items))]


def _name(image: _Image) -> str:
    return image.name if isinstance(image, Path) else f"built-in texture {image}"


def _read(image: _Image, texture_px: int) -> Texture:
    """Read an image of a file, or make a built-in texture: its range of reflectance and tint follow from its number."""
    if isinstance(image, Path):
        return read_image_texture(image, texture_px)
    least, most = _BUILT_IN_SIDES
    side = max(least, min(most, 1 << (texture_px.bit_length() - 1)))
    low, high, grain, *tint = np.random.RandomState(image).uniform(
        [0.03, 0.6, 0.2, 0.7, 0.7, 0.7], [0.15, 0.95, 0.7, 1.0, 1.0, 1.0]
    )
    red, green, blue = tint
    shapes = 20 + 10 * (image % 8)
    return patchwork(side, image, low=low, high=high, grain=grain, shapes=shapes, tint=(red, green, blue))


def _in_ball(words: Words) -> FloatArray:
    """Draw a point uniformly in the unit ball, but not at its very middle."""
    while True:
        point = np.array([words.uniform(-1, 1) for _ in range(3)])
        if 1e-6 < point @ point <= 1:
            return point


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def _about(axis: npt.ArrayLike, angle: float) -> FloatArray:
    """Return the rotation (3, 3) about an axis."""
    return rotation_matrices(np.array([*_unit(np.asarray(axis)) * math.sin(angle / 2), math.cos(angle / 2)]))


def _check_numbers(planes: int, mesh_objects: int | None, meshes: bool, texture_px: int) -> None:
    if not 0 <= planes <= 1000:
        raise ArgumentError("{planes} must lie in 0..1000, got {}", planes)
    if not 0 <= (mesh_objects or 0) <= 1000:
        raise ArgumentError("{mesh_objects} must lie in 0..1000, got {}", mesh_objects)
    if mesh_objects and not meshes:
        raise ArgumentError("{mesh_objects} is {}, but no folder of meshes is given", mesh_objects)
    if not 16 <= texture_px <= 8192:
        raise ArgumentError("{texture_px} must lie in 16..8192, got {}", texture_px)
