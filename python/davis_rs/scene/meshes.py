"""Makes triangle meshes in code: quads, boxes, tubes and balls, many of one texture in one shape."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import MitsubaShape, MitsubaValue, SceneDictionary
from ..geometry.pose import FloatArray
from .mesh_part import USUAL_INDEX, Blend, Glass, MetalRoughness, NormalTexture
from .textures import Texture, bitmap, encoded_bitmap

Window = tuple[float, float, float, float]
"""Left, top, right and bottom of the part of a texture that a face shows; 0 to 1 is all of it, more repeats it."""

WHOLE: Window = (0.0, 0.0, 1.0, 1.0)


class Mesh(NamedTuple):
    """Triangles: ``vertices`` (n, 3) in metres, ``faces`` (m, 3) of their indices, ``uv`` (n, 2)."""

    vertices: FloatArray
    faces: npt.NDArray[np.int64]
    uv: FloatArray

    def moved(self, offset: npt.ArrayLike, turn_rad: float = 0.0) -> Mesh:
        """Return the mesh turned about the vertical axis through the origin, then shifted."""
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return self._replace(vertices=self.vertices @ turn.T + offset)


def merged(meshes: Iterable[Mesh]) -> Mesh:
    """Merge meshes to one, because a scene of few shapes loads and renders faster than one of many."""
    meshes = list(meshes)
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)]),
        np.concatenate([mesh.uv for mesh in meshes]),
    )


def quad(corner: npt.ArrayLike, across: npt.ArrayLike, up: npt.ArrayLike, window: Window = WHOLE) -> Mesh:
    """Make a parallelogram from its lower left corner, seen from the front; row 0 of the texture is on top."""
    start, right, rise = (np.asarray(vector, np.float64) for vector in (corner, across, up))
    left, top, end, bottom = window
    return Mesh(
        np.stack([start, start + right, start + right + rise, start + rise]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.array([[left, bottom], [end, bottom], [end, top], [left, top]]),
    )


def box(low: npt.ArrayLike, high: npt.ArrayLike, *, window: Window = WHOLE, period_m: float | None = None) -> Mesh:
    """Make an upright box between two corners; each face shows the window, or repeats the texture every
    ``period_m``."""
    start, end = np.asarray(low, np.float64), np.asarray(high, np.float64)
    x, y, z = np.diag(end - start)
    sides = [(start, x, z), (start + x, y, z), (start + x + y, -x, z), (start + y, -y, z)]
    lids = [(start + z, x, y), (start + y, x, -y)]

    def shown(across: FloatArray, up: FloatArray) -> Window:
        if period_m is None:
            return window
        return (0.0, 0.0, float(np.linalg.norm(across)) / period_m, float(np.linalg.norm(up)) / period_m)

    return merged(quad(corner, across, up, shown(across, up)) for corner, across, up in [*sides, *lids])


def tube(
    start: npt.ArrayLike, end: npt.ArrayLike, radii: tuple[float, float], *, sides: int = 8, window: Window = WHOLE
) -> Mesh:
    """Make an open tube or cone from one point to another, with a radius at each."""
    points = np.asarray([start, end], np.float64)
    axis = points[1] - points[0]
    aside = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    aside /= np.linalg.norm(aside)
    other = np.cross(axis, aside) / np.linalg.norm(axis)
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    ring = np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * other
    return _grid(points[:, None] + np.array(radii)[:, None, None] * ring, window)


def ball(
    centre: npt.ArrayLike, radii: npt.ArrayLike, *, rings: int = 5, sides: int = 8, window: Window = WHOLE
) -> Mesh:
    """Make an ellipsoid with these half-axes along x, y and z."""
    above = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[:, None]
    around = np.linspace(0.0, 2 * np.pi, sides + 1)
    unit = np.stack([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above) + 0 * around], -1)
    return _grid(np.asarray(centre, np.float64) + unit * np.asarray(radii, np.float64), window)


def _grid(points: FloatArray, window: Window) -> Mesh:
    """Make two triangles between each four neighbours of a grid of points (rows, columns, 3), its first row lowest.

    Where a row shrinks to a point, one of the two has no area and is left out.
    """
    rows, columns = points.shape[:2]
    left, top, right, bottom = window
    u, v = np.meshgrid(np.linspace(left, right, columns), np.linspace(bottom, top, rows))
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = points.reshape(-1, 3)
    first, second, third = vertices[faces].swapaxes(0, 1)
    double_area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    return Mesh(vertices, faces[double_area > 1e-12], np.stack([u.ravel(), v.ravel()], 1))


def shape(
    mesh: Mesh,
    reflectance: Texture | FloatArray | float | MitsubaValue,
    *,
    normals: FloatArray | None = None,
    wrap: str = "repeat",
    nearest: bool = False,
    metal: MetalRoughness | None = None,
    emission: Texture | FloatArray | None = None,
    blend: Blend | None = None,
    glass: Glass | None = None,
    normal_texture: NormalTexture | None = None,
) -> MitsubaShape:
    """Make a Mitsuba shape of a mesh, seen from both sides; call it under the variant that loads the scene.

    Args:
        reflectance: a texture (H, W, 3), Mitsuba's own texture, a colour (3,) in linear RGB, or grey.
        normals: (n, 3) at the vertices of a smooth surface; None where every triangle is flat.
        wrap: what lies beyond a texture's edges: repeat, clamp or mirror.
        nearest: its texels have hard edges; others are bilinear.
        metal: how it reflects besides its reflectance, which is the base colour then; None where it is diffuse.
        emission: radiance of an area light (``emitter``), a texture (H, W, 3) or a colour (3,); None for none.
        blend: how much of its area a diffuse surface covers; None where it is opaque.
        glass: what a surface of glass does to light, whatever its reflectance is; None where it is opaque.
        normal_texture: what turns the normals of a surface that is not of glass; None where nothing does.
    """
    import mitsuba as mi

    if isinstance(reflectance, mi.Texture):
        colour = reflectance
    elif isinstance(reflectance, np.ndarray) and reflectance.ndim == 3:
        colour = bitmap(mi.TensorXf(reflectance), wrap=wrap, nearest=nearest)
    else:
        colour = {"type": "rgb", "value": reflectance.tolist() if isinstance(reflectance, np.ndarray) else reflectance}
    surface = {"type": "diffuse", "reflectance": colour} if metal is None else _metallic(colour, metal)
    if normal_texture is not None:
        # As other glTF viewers: light does not fade where bumps turn from it.
        bumps: SceneDictionary = {"type": "normalmap", "use_shadowing_function": False, "nested": surface}
        surface = {**bumps, "normalmap": _directions(normal_texture)}
    properties = mi.Properties()
    material: SceneDictionary = {"type": "twosided", "nested": surface}
    if blend is not None:
        material = {"type": "mask", "opacity": _opacity(blend, wrap=wrap, nearest=nearest), "nested": material}
    if glass is not None:
        material = _clear(glass)
    properties["bsdf"] = mi.load_dict(material)
    if glass is not None and glass.absorption is not None:
        properties["interior"] = mi.load_dict(_absorbing(glass.absorption))
    if emission is not None:
        # A list of all texels of a texture takes seconds.
        radiance: SceneDictionary = (
            bitmap(mi.TensorXf(emission), wrap=wrap, nearest=nearest)
            if emission.ndim == 3
            else {"type": "rgb", "value": emission.tolist()}
        )
        properties["emitter"] = mi.load_dict({"type": "area", "id": "emitter", "radiance": radiance})
    return mitsuba_mesh(mesh, properties, normals)


def _metallic(colour: SceneDictionary, metal: MetalRoughness) -> SceneDictionary:
    """Describe a metallic-roughness material for Mitsuba."""
    import mitsuba as mi

    surface = {"type": "principled", "base_color": colour, "roughness": metal.roughness, "metallic": metal.metal}
    if metal.refraction != USUAL_INDEX:
        surface["eta"] = metal.refraction
    if metal.anisotropic != 0:
        surface["anisotropic"] = metal.anisotropic
    if metal.coat is not None:
        surface |= {"clearcoat": metal.coat.strength, "clearcoat_gloss": metal.coat.gloss}
    if metal.texels is not None:
        for name, channel, factor in (("roughness", 1, metal.roughness), ("metallic", 2, metal.metal)):
            values = metal.texels[..., channel : channel + 1] * np.float32(factor / 255)
            surface[name] = bitmap(mi.TensorXf(values), wrap=metal.wrap)
    return surface


def _directions(normals: NormalTexture) -> SceneDictionary:
    """Describe a normal texture for Mitsuba."""
    import mitsuba as mi

    if normals.texels.dtype != np.uint8:
        return bitmap(mi.TensorXf(normals.texels), wrap=normals.wrap)
    return encoded_bitmap(mi.Bitmap(normals.texels, mi.Bitmap.PixelFormat.RGB), raw=True, wrap=normals.wrap)


def _clear(glass: Glass) -> SceneDictionary:
    """Describe glass for Mitsuba."""
    passing = {"type": "rgb", "value": glass.tint.tolist()}
    same: SceneDictionary = {"int_ior": glass.refraction, "ext_ior": 1.0, "specular_transmittance": passing}
    if glass.roughness > 0:
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": glass.roughness**2, **same}
    return {"type": "dielectric" if glass.is_solid else "thindielectric", **same}


def _absorbing(absorption: FloatArray) -> SceneDictionary:
    """Describe what absorbs light and scatters none, for Mitsuba, which takes factors of at most 1."""
    largest = float(absorption.max())
    extinction = {"type": "rgb", "value": (absorption / largest).tolist()}
    return {"type": "homogeneous", "albedo": 0.0, "sigma_t": extinction, "scale": largest}


def _opacity(blend: Blend, *, wrap: str, nearest: bool) -> SceneDictionary | float:
    """Describe how much of its area a surface covers, for Mitsuba."""
    import mitsuba as mi

    if blend.alpha is None:
        return blend.opacity
    values = blend.alpha[..., None] * np.float32(blend.opacity / 255)
    return bitmap(mi.TensorXf(values), wrap=wrap, nearest=nearest)


def mitsuba_mesh(mesh: Mesh, properties: MitsubaValue, normals: FloatArray | None) -> MitsubaShape:
    """Make a Mitsuba shape of a mesh; call it under the variant that loads the scene.

    Args:
        properties: Mitsuba's own, with the material (``bsdf``) and whatever else belongs to the shape.
        normals: (n, 3) at the vertices of a smooth surface; None where every triangle is flat.
    """
    import mitsuba as mi

    made = mi.Mesh(
        "mesh",
        len(mesh.vertices),
        len(mesh.faces),
        properties,
        has_vertex_normals=normals is not None,
        has_vertex_texcoords=True,
    )
    values = {"vertex_positions": mesh.vertices, "vertex_texcoords": mesh.uv, "faces": mesh.faces}
    if normals is not None:
        values["vertex_normals"] = normals
    buffers = mi.traverse(made)
    for name, numbers in values.items():
        kind = np.uint32 if name == "faces" else np.float32
        buffer = type(buffers[name])(numbers.astype(kind, copy=False).ravel())
        # What `buffers[name] = buffer` does, but for a comparison with what is there, which takes most of its time.
        place, type_, *_ = buffers.properties[name]
        buffers.set_property(place, type_, buffer)
        buffers.set_dirty(name)
    buffers.update()
    return made
