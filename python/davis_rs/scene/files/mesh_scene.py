"""Makes a scene of a mesh file: default light, a plain background, and a camera path around the mesh."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Literal

import numpy as np

from ..._mitsuba.types import MitsubaShape, MitsubaValue, SceneDictionary
from ..._util.argument_error import ArgumentError
from ..._util.budget import Budget
from ..._util.quantities import metres
from ...geometry.pose import FloatArray
from ..default_paths import CAMERA, DEFAULT_DURATION_S, direction
from ..image_textures import ImageTexture, ImageTextures
from ..lost_looks import lost_looks
from ..mesh_part import MeshPart
from ..meshes import Mesh, shape
from ..parts import DIRECT, look_at
from ..scene import Scene
from ..texture_file import EncodedTexture
from ..textures import Texture
from .default_view import DefaultView, default_view
from .obj_file import read_obj
from .painted_texture import painted
from .ply_file import read_ply

Axis = Literal["y", "z"]

READERS = {".obj": read_obj, ".ply": read_ply}
"""The readers of mesh files, by suffix."""

USUAL_UP: dict[str, Axis] = {".obj": "y", ".ply": "z"}
"""The axis that points up by default, as Blender exports them."""

_SUN, _SKY = 2.0, 0.3
"""Irradiance of the sun; radiance of the light from all sides, which is the background's luma too."""
_LAMP_ABOVE, _LAMP_LUMA = 0.5, 0.5
"""Of the lamp in a room: how far it hangs above the camera, as a fraction of the free distance there, to the sides or
to the ceiling, whichever is less; and the luma of a white wall at twice the free distance to the sides."""


def mesh_scene(path: str | Path, *, up: Axis | None = None, scale: float = 1.0, grey_unknown: bool = False) -> Scene:
    """Make a scene of an OBJ or PLY mesh in the light of a sun and an even sky, before a plain background, seen from
    all around, or from within if it is a room.

    Surfaces are diffuse and seen from both sides; where an alpha masks them, they are cut along its outline. Materials
    of an OBJ file blend by ``d``, ``Tr`` and ``map_d``, and emit ``Ke`` or ``map_Ke``. A shape's id is ``mesh``, or
    ``mesh_MATERIAL`` where faces use several materials. The camera (``ideal``) goes once around the mesh in 10 s, 30
    degrees above its middle, so near that the mesh fills 90 % of the image's width or height at most. Surfaces that
    lie far off and wide flat ground do not decide. The sun stands behind the camera's start, to its left and above. In
    a room the camera turns for 10 s at eye height, where there is most to see, and a lamp hangs above it in place of
    the sun.

    Args:
        up: the file's axis that points up, ``"y"`` or ``"z"``; None: y for OBJ, z for PLY, as Blender exports them.
        scale: metres in the file's unit, > 0: 0.001 for millimetres.
        grey_unknown: materials and textures that are missing are grey; else the file is refused.

    Raises:
        OSError: if the mesh, its materials or a texture cannot be read.
        ValueError: for a file that breaks its format's rules, a mesh without a surface, or another axis or scale.

    Warns:
        SceneFileWarning: in one line, of what is left out or repaired.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise ValueError(f"a mesh must be one of {', '.join(READERS)}, got {path}")
    check_axis_and_scale(up, scale)
    up = USUAL_UP[suffix] if up is None else up
    parts = [_in_world(part, up, scale) for part in READERS[suffix](path, Budget(path), grey_unknown=grey_unknown)]
    corners = np.concatenate([part.corners.reshape(-1, 3) for part in parts])
    low, high = corners.min(0), corners.max(0)
    view = default_view(
        np.concatenate([_facing_as_normals(part) for part in parts]),
        np.repeat(np.arange(len(parts)), [len(part.corners) for part in parts]),
    )
    shapes = {name: part.rounded() for name, part in zip(_shape_ids(parts), parts, strict=True)}
    x, y, z = map(metres, high - low)
    return Scene(
        name=path.stem,
        source=lambda: _source(shapes, usual_light(view)),
        file=path,
        files=tuple(dict.fromkeys(file for part in parts for file in part.files)),
        camera=CAMERA,
        trajectory=view.trajectory,
        default_duration_s=DEFAULT_DURATION_S,
        soft_light=True,
        note=f"{path.name} is {x} x {y} wide and {z} high, at {scale:g} m to a unit and with axis {up} up"
        f"{view.unit_question(path.stem, scale)}{view.up_question(up)}; the camera: {view.note}",
        lost_looks=lost_looks(shapes),
    )


def check_axis_and_scale(up: str | None, scale: float) -> None:
    """Refuse another axis than y or z, and a scale that is not positive and finite.

    Raises:
        ValueError: naming the one that is wrong.
    """
    if up not in (None, "y", "z"):
        raise ArgumentError("{up} must be y or z, got {!r}", up)
    if not 0 < scale < np.inf:
        raise ArgumentError("{scale} must be finite and larger than 0, got {}", scale)


def to_z_up(up: Axis) -> FloatArray:
    """Return the rotation (3, 3) of a file's axes into the world's."""
    return np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if up == "y" else np.eye(3)


def _in_world(part: MeshPart, up: Axis, scale: float) -> MeshPart:
    """Convert a part to metres, with z up."""
    turn = to_z_up(up)
    normals = None if part.normals is None else part.normals @ turn.T
    return part._replace(corners=part.corners @ turn.T * scale, normals=normals)


def _facing_as_normals(part: MeshPart) -> FloatArray:
    """Return a part's triangles (n, 3, 3), turned over where its normals face the other way.

    Some programs mirror a mesh and its normals, but not the order of its corners.
    """
    if part.normals is None:
        return part.corners
    first, second, third = part.corners.swapaxes(0, 1)
    away = np.einsum("nk,nk->n", np.cross(second - first, third - first), part.normals.sum(1)) < 0
    return np.where(away[:, None, None], part.corners[:, ::-1], part.corners)


def _shape_ids(parts: list[MeshPart]) -> list[str]:
    """Return the ids of all parts. Names that would have the same id get the index of their part too."""
    if len(parts) == 1:
        return ["mesh"]
    names = [re.sub(r"\W", "_", part.material) for part in parts]
    alike = Counter(names)
    return [f"mesh_{name}" if alike[name] == 1 else f"mesh_{name}_{index}" for index, name in enumerate(names)]


def _source(parts: dict[str, MeshPart], light: SceneDictionary) -> SceneDictionary:
    textures = ImageTextures()
    return {
        "type": "scene",
        "integrator": DIRECT,
        **light,
        **{name: mitsuba_shape(part, textures) for name, part in parts.items()},
    }


def usual_light(view: DefaultView | None) -> SceneDictionary:
    """Return a sun behind the start of the path around, to its left and above, and light from all sides; in a room,
    into which no sun shines, a lamp above the camera in its place.

    Args:
        view: of a camera in the world that the file did not give; None where it did.
    """
    if view is not None and view.room is not None:
        sky: SceneDictionary = {"type": "constant", "radiance": _SKY}
        above = _LAMP_ABOVE * min(view.room.free_m, view.room.above_m)
        position = view.room.centre + np.array([0.0, 0.0, above])
        intensity = np.pi * _LAMP_LUMA * (2 * view.room.free_m) ** 2
        return {"lamp": {"type": "point", "position": position.tolist(), "intensity": float(intensity)}, "sky": sky}
    return sun_behind(look_at(direction(0.0 if view is None else view.start_rad), np.zeros(3)))


def sun_behind(camera: FloatArray) -> SceneDictionary:
    """Return a sun behind a camera, to its left and above, and light from all sides.

    Args:
        camera: (3, 3), its axes as columns: right, down, forward.
    """
    right, down, forward = camera.T
    towards = (forward + 0.6 * down + 0.6 * right).tolist()
    sky: SceneDictionary = {"type": "constant", "radiance": _SKY}
    return {"sun": {"type": "directional", "direction": towards, "irradiance": _SUN}, "sky": sky}


def mitsuba_shape(part: MeshPart, textures: ImageTextures) -> MitsubaShape:
    """Make a shape of a part in world axes; call it under the variant that loads the scene.

    Args:
        textures: of the scene.
    """
    if part.patches is not None:
        part = painted(part)
    uv, emission = part.uv, _linear(part.emission)
    reflectance: Texture | FloatArray | MitsubaValue = part.reflectance
    if part.colours is not None:
        reflectance, uv = colours_as_texture(part.colours)
    if part.unlit:
        emission, reflectance = _linear(reflectance), np.zeros(3)
    if isinstance(reflectance, EncodedTexture):
        reflectance = textures.of(ImageTexture(reflectance, part.wrap, part.nearest))
    flipped = np.zeros((*part.corners.shape[:2], 2)) if uv is None else uv * [1, -1] + [0, 1]  # row 0 lies at v = 0
    count = 3 * len(part.corners)
    mesh = Mesh(part.corners.reshape(-1, 3), np.arange(count).reshape(-1, 3), flipped.reshape(-1, 2))
    normals = None if part.normals is None else part.normals.reshape(-1, 3)
    return shape(
        mesh,
        reflectance,
        normals=normals,
        wrap=part.wrap,
        nearest=part.nearest,
        metal=part.metal,
        emission=emission,
        blend=part.blend,
        glass=part.glass,
        normal_texture=part.normal_texture,
    )


def _linear(light: EncodedTexture | Texture | FloatArray | None) -> Texture | FloatArray | None:
    return light.linear() if isinstance(light, EncodedTexture) else light


def colours_as_texture(colours: FloatArray) -> tuple[Texture, FloatArray]:
    """Make a texture that shows colours at corners, linear in between, of 2 x 2 texels for each triangle.

    Corners lie at the centres of three of the four texels. The fourth continues the plane through their colours, so
    that the bilinear lookup between them is linear. It may lie outside of 0 to 1, but no point of the triangle does.

    Args:
        colours: (m, 3, 3), linear RGB at the three corners of m triangles.

    Returns:
        The texture, and the corners' texture coordinates (m, 3, 2), v upwards.
    """
    columns = int(np.ceil(np.sqrt(len(colours))))
    rows = -(-len(colours) // columns)
    row, column = np.divmod(np.arange(len(colours)), columns)
    texels = np.zeros((rows, 2, columns, 2, 3), np.float32)
    first, second, third = colours.swapaxes(0, 1)
    for below, right, colour in ((0, 0, first), (0, 1, second), (1, 0, third), (1, 1, second + third - first)):
        texels[row, below, column, right] = colour
    x = (column[:, None] * 2 + [0.5, 1.5, 0.5]) / (2 * columns)
    y = (row[:, None] * 2 + [0.5, 0.5, 1.5]) / (2 * rows)
    return texels.reshape(2 * rows, 2 * columns, 3), np.stack([x, 1 - y], 2)
