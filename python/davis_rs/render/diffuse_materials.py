"""Finds materials that are diffuse or glossy in fact; others become their diffuse colour where the user wishes it.

Mitsuba wraps materials (two sides, opacity, bumps). Where a wrapper changes nothing, the material inside is taken, so
that the renderers of diffuse scenes know it. Materials with a diffuse colour and more (highlights, a coat) may be
replaced by that colour: ``Scene.matte``. Mitsuba's ``principled`` is never diffuse by itself, whatever its parameters
are: its diffuse part depends on both directions (Burley, Physically-based shading at Disney, 2012, section 5.3), and so
does that of ``plastic``, behind its coat.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import (
    Mitsuba,
    MitsubaBsdf,
    MitsubaObject,
    MitsubaScene,
    MitsubaShape,
    MitsubaTexture,
    MitsubaValue,
)
from .finish import Finish
from .finishes import finish_remedy, mixed_colour, read_blend, read_finish
from .obstacles import plugin_name, shape_name
from .texels import uv_map_of

_COLOURS = {
    "Principled": ("principled", "base_color"),
    "PrincipledThin": ("principledthin", "base_color"),
    "SmoothPlastic": ("plastic", "diffuse_reflectance"),
    "RoughPlastic": ("roughplastic", "diffuse_reflectance"),
    "PolarizedPlastic": ("pplastic", "diffuse_reflectance"),
}
"""For the classes of materials that have more than a diffuse colour: their plugin, and the name of that colour."""

_TRANSMITTED = ("spec_trans", "diff_trans")
"""Parameters of materials that let light through; where one is not 0, no diffuse material can stand for it."""

_NULL = "Null"
_BUMPS = {"BumpMap": "bumpmap", "NormalMap": "normalmap"}
_FLAT_NORMAL = (0.5, 0.5, 1.0)
_FLAT = 0.51 / 255
"""How far texels of 8 bits may be from it: they cannot say 0.5."""
_AZIMUTHS = 8
"""Directions of grazing light under which two materials are compared."""


class NormalTexture(NamedTuple):
    """Holds what turns a surface's normal, as Mitsuba's ``normalmap`` or ``bumpmap`` has it.

    Attributes:
        texture: Mitsuba's own object.
        fades: light fades where a turned normal faces it and the surface hardly does (``use_shadowing_function``).
        height: of a bump map, the metres that its values are multiplied by; None of a normal map.
    """

    texture: MitsubaTexture
    fades: bool
    height: float | None = None


class _DiffuseMaterial(NamedTuple):
    """Holds the diffuse material that another one is or contains.

    Attributes:
        colour: its reflectance, Mitsuba's own object.
        two_sided: seen from both sides.
        lost: the plugins whose effect it leaves out; empty where it looks the same.
        finish: how it reflects besides that colour; None where it is diffuse.
        normal_texture: what turns its normal; None where nothing does.
    """

    colour: MitsubaTexture
    two_sided: bool
    lost: tuple[str, ...]
    finish: Finish | None = None
    normal_texture: NormalTexture | None = None


class Simplified(NamedTuple):
    """Tells what became of a scene's materials.

    Attributes:
        replaced: the names of the materials that ``matte`` replaced, each with its plugin.
        finishes: for those that stand for glossy materials, how they reflect; their reflectance is the base colour.
        normal_textures: for those that stand for materials with a normal texture, that texture.
    """

    replaced: tuple[str, ...]
    finishes: dict[MitsubaBsdf, Finish]
    normal_textures: dict[MitsubaBsdf, NormalTexture]


def simplify_materials(
    scene: MitsubaScene,
    mi: Mitsuba,
    *,
    matte: bool,
    glossy: bool = False,
    may_blend: Callable[[MitsubaShape], bool] = lambda _: True,
) -> Simplified:
    """Give a loaded scene's shapes diffuse materials where theirs are diffuse in fact, or where it is asked for.

    Args:
        scene: loaded under the variant in force; it is changed.
        matte: replace materials that have a diffuse colour by that colour alone.
        glossy: replace glossy materials that have a finish by their base colours, and tell the finishes; replace
            those with a normal texture by what is inside, and tell the textures; make lamps without a surface black.
        may_blend: says of a shape whether a part of what lies behind it may be seen through it.
    """
    replaced = dict[str, None]()
    known: dict[MitsubaBsdf, _DiffuseMaterial | None] = {}
    made: dict[MitsubaBsdf, MitsubaBsdf] = {}
    finishes: dict[MitsubaBsdf, Finish] = {}
    normal_textures: dict[MitsubaBsdf, NormalTexture] = {}
    for shape in scene.shapes():
        bsdf = shape.bsdf()
        if bsdf is None or is_plain(bsdf):
            continue
        if glossy and is_null_lamp(shape):
            shape.set_bsdf(mi.load_dict({"type": "diffuse", "reflectance": 0.0}))
            continue
        if bsdf not in known:
            known[bsdf] = _diffuse_within(bsdf, mi, glossy=glossy and not matte)
            if known[bsdf] is None and glossy and matte:  # metal and glass have no diffuse colour
                known[bsdf] = _diffuse_within(bsdf, mi, glossy=True)
        diffuse = known[bsdf]
        if diffuse is None or (diffuse.lost and not matte):
            continue
        if diffuse.finish is not None and diffuse.finish.is_null and not may_blend(shape):
            continue
        if diffuse.lost:
            replaced[f"{material_id(bsdf) or shape.id() or shape_name(shape)} ({', '.join(diffuse.lost)})"] = None
        if bsdf not in made:
            plain = {"type": "diffuse", "reflectance": diffuse.colour}
            made[bsdf] = mi.load_dict({"type": "twosided", "nested": plain} if diffuse.two_sided else plain)
            if diffuse.finish is not None:
                finishes[made[bsdf]] = diffuse.finish
            if diffuse.normal_texture is not None:
                normal_textures[made[bsdf]] = diffuse.normal_texture
        shape.set_bsdf(made[bsdf])
    return Simplified(tuple(replaced), finishes, normal_textures)


def is_null_lamp(shape: MitsubaShape) -> bool:
    """Return whether a shape is light without a surface: it emits, and lets light pass (``null``) within one medium."""
    alone = shape.is_emitter() and not shape.is_medium_transition()
    return bool(alone and shape.bsdf() is not None and shape.bsdf().class_name() == _NULL)


def surface_remedy(bsdf: MitsubaBsdf, mi: Mitsuba) -> str:
    """Return what a user can do to make a surface one that is rendered without noise, for a message."""
    diffuse = _diffuse_within(bsdf, mi)
    ways = ["--matte (matte=True) takes its diffuse colour alone"] if diffuse is not None and diffuse.lost else []
    glossy = _diffuse_within(bsdf, mi, glossy=True)
    if glossy is None or glossy.lost:
        ways += _finish_remedies(bsdf, mi)
    return ", or ".join([*ways, "give it a diffuse material"])


def _finish_remedies(bsdf: MitsubaBsdf, mi: Mitsuba) -> list[str]:
    """Return what would help a glossy material, or those inside a wrapper."""
    inside = children(bsdf)
    own = finish_remedy(bsdf, inside, mi)
    nested = (_finish_remedies(child, mi) for child in inside.values() if isinstance(child, mi.BSDF))
    return list(dict.fromkeys([*([own] if own else []), *itertools.chain.from_iterable(nested)]))


def surface_kind(bsdf: MitsubaBsdf) -> str:
    """Return the plugin name of a material, with those inside it: ``twosided(conductor)``."""
    import mitsuba as mi

    nested = (child for child in children(bsdf).values() if isinstance(child, mi.BSDF))
    inside = ", ".join(dict.fromkeys(map(surface_kind, nested)))
    return f"{plugin_name(bsdf)}({inside})" if inside else plugin_name(bsdf)


def reflectance_of(bsdf: MitsubaBsdf) -> MitsubaTexture:
    """Return the texture or colour of a diffuse material, that of its front."""
    return children(children(bsdf).get("brdf_0", bsdf))["reflectance"]


def surface_name(bsdf: MitsubaBsdf, shape: MitsubaShape) -> str:
    """Return how messages name a surface: by its material's id, or by its shape where the material has none."""
    return f"material {material_id(bsdf)!r}" if material_id(bsdf) else shape_name(shape)


def is_two_sided(bsdf: MitsubaBsdf) -> bool:
    """Return whether a material reflects on both sides."""
    return bool(bsdf.class_name() == "TwoSidedBRDF")


def is_plain(bsdf: MitsubaBsdf) -> bool:
    """Return whether a material is diffuse, on one side or both, as the renderers without noise know it."""
    if is_two_sided(bsdf):
        return all(child.class_name() == "SmoothDiffuse" for child in children(bsdf).values())
    return bool(bsdf.class_name() == "SmoothDiffuse")


def _diffuse_within(bsdf: MitsubaBsdf, mi: Mitsuba, *, glossy: bool = False) -> _DiffuseMaterial | None:
    """Return the diffuse material that a material is or contains; None where there is none.

    Args:
        glossy: a glossy material that has a finish is its base colour with it.
    """
    kind, inside = bsdf.class_name(), children(bsdf)
    if kind == "SmoothDiffuse":
        return _DiffuseMaterial(inside["reflectance"], False, ())
    if glossy and (finished := read_finish(bsdf, inside, mi)) is not None:
        return _DiffuseMaterial(finished[0], False, (), finished[1])
    if kind in _COLOURS:
        plugin, colour = _COLOURS[kind]
        passing = (_constant(inside[name], mi) for name in _TRANSMITTED if name in inside)
        opaque = all(value is not None and not value.any() for value in passing)
        return _DiffuseMaterial(inside[colour], kind == "PrincipledThin", (plugin,)) if opaque else None
    if kind == "TwoSidedBRDF":
        front = _diffuse_within(inside["brdf_0"], mi, glossy=glossy)
        back = front if inside["brdf_1"] is inside["brdf_0"] else _diffuse_within(inside["brdf_1"], mi, glossy=glossy)
        if front is None or back is None or front.finish != back.finish:
            return None
        if not (_same(front.colour, back.colour, mi) and _turned_alike(front.normal_texture, back.normal_texture, mi)):
            return None
        return front._replace(two_sided=True, lost=tuple(dict.fromkeys(front.lost + back.lost)))
    if kind == "MaskBSDF":
        value, nested = _constant(inside["opacity"], mi), _diffuse_within(inside["nested_bsdf"], mi, glossy=glossy)
        if value is not None and (value == 1).all():
            return nested
        if not glossy or nested is None or nested.lost or nested.finish is not None:
            return None
        blend = read_blend(nested.colour, inside["opacity"], mi)
        return None if blend is None else nested._replace(colour=blend[0], finish=blend[1])
    if kind == "BlendBSDF":
        value = _constant(inside["weight"], mi)
        first, second = (_diffuse_within(inside[f"bsdf_{number}"], mi, glossy=glossy) for number in (0, 1))
        if value is not None and ((value == 0).all() or (value == 1).all()):
            return second if value.all() else first
        if first is None or second is None or not (_is_only_diffuse(first) and _is_only_diffuse(second)):
            return None
        mixed = mixed_colour((first.colour, second.colour), inside["weight"], mi)
        alike = first.two_sided == second.two_sided
        return first._replace(colour=mixed) if alike and mixed is not None else None
    if kind in _BUMPS:
        nested = _diffuse_within(inside["nested_bsdf"], mi, glossy=glossy)
        if nested is None or _is_flat(kind, inside, mi):
            return nested
        opaque = nested.finish is None or not nested.finish.is_clear
        if glossy and opaque and nested.normal_texture is None:
            texture = inside["normalmap"] if kind == "NormalMap" else inside["nested_texture"]
            height = None if kind == "NormalMap" else float(mi.traverse(bsdf)["scale"])
            if height is None or "data" in mi.traverse(texture):
                fades = _light_fades(bsdf, texture, height, inside["nested_bsdf"], mi)
                return nested._replace(normal_texture=NormalTexture(texture, fades, height))
        return nested._replace(lost=(_BUMPS[kind], *nested.lost))
    return None


def _is_only_diffuse(material: _DiffuseMaterial) -> bool:
    return not material.lost and material.finish is None and material.normal_texture is None


def _is_flat(kind: str, inside: dict[str, MitsubaObject], mi: Mitsuba) -> bool:
    """Return whether a bump map or normal map changes nothing."""
    texture = inside.get("nested_texture", inside.get("normalmap"))
    values = _values(texture, mi)
    if values is None:
        return False
    if kind == "BumpMap":
        return bool(np.ptp(values) == 0)
    return values.ndim == 3 and values.shape[2] >= 3 and bool((np.abs(values[..., :3] - _FLAT_NORMAL) < _FLAT).all())


def _light_fades(
    bsdf: MitsubaBsdf, texture: MitsubaTexture, height: float | None, nested: MitsubaBsdf, mi: Mitsuba
) -> bool:
    """Return whether a material with a normal texture is darker under grazing light than without a shadowing function.

    Mitsuba does not tell its setting. So it is compared with a material that has none, where the texture is steepest.

    Args:
        height: of a bump map, the factor on its values; None of a normal map.
    """
    same: dict[str, object] = {"type": "normalmap", "normalmap": texture}
    if height is not None:
        same = {"type": "bumpmap", "nested_texture": texture, "scale": height}
    without = {**same, "use_shadowing_function": False, "nested_bsdf": nested}
    materials, context = (bsdf, mi.load_dict(without)), mi.BSDFContext()
    values, uv, slope = _values(texture, mi), np.zeros(2), 1.0
    if values is not None and values.ndim == 3 and (height is not None or values.shape[2] >= 3):
        at, slope = _steepest_normal(values) if height is None else _steepest_height(height * values.mean(2))
        uv_map = uv_map_of(mi.traverse(texture))
        uv = np.linalg.pinv(uv_map[:2, :2]) @ (at - uv_map[:2, 2])
        slope *= float(np.abs(np.linalg.det(uv_map[:2, :2]))) ** 0.5
    for angle in np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS):
        interaction = mi.SurfaceInteraction3f()
        interaction.uv, interaction.wi, interaction.n = mi.Point2f(uv), mi.Vector3f(0, 0, 1), mi.Normal3f(0, 0, 1)
        # So large that a bump map turns the normal there by half a right angle.
        interaction.dp_du, interaction.dp_dv = mi.Vector3f(slope, 0, 0), mi.Vector3f(0, slope, 0)
        interaction.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
        towards = mi.Vector3f(0.9 * np.cos(angle), 0.9 * np.sin(angle), np.sqrt(1 - 0.9**2))
        own, other = (np.array(material.eval(context, interaction, towards)).ravel() for material in materials)
        if (own < other * (1 - 1e-5)).any():
            return True
    return False


def _steepest_normal(values: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], float]:
    """Return where texels (H, W, 3) of a normal map turn the normal most, and 1."""
    row, column = np.unravel_index(values[..., 2].argmin(), values.shape[:2])
    return np.array([(column + 0.5) / values.shape[1], (row + 0.5) / values.shape[0]]), 1.0


def _steepest_height(heights: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], float]:
    """Return where heights (H, W) of a bump map are steepest, and how steep, per unit of texture coordinates."""
    height, width = heights.shape
    if min(height, width) < 2:
        return np.zeros(2), 1.0
    across, down = width * np.diff(heights, axis=1), height * np.diff(heights, axis=0)
    slopes = np.hypot(across[1:] + across[:-1], down[:, 1:] + down[:, :-1]) / 2
    row, column = np.unravel_index(slopes.argmax(), slopes.shape)
    return np.array([(column + 1) / width, (row + 1) / height]), float(slopes.max()) or 1.0


def _turned_alike(first: NormalTexture | None, second: NormalTexture | None, mi: Mitsuba) -> bool:
    if first is None or second is None:
        return first is second
    alike = (first.fades, first.height) == (second.fades, second.height)
    return alike and _same(first.texture, second.texture, mi)


def _same(first: MitsubaTexture, second: MitsubaTexture, mi: Mitsuba) -> bool:
    """Return whether two textures look the same."""
    if first is second:
        return True
    ours, theirs = (dict(mi.traverse(texture)) for texture in (first, second))
    return ours.keys() == theirs.keys() and all(
        np.array_equal(np.array(getattr(ours[key], "matrix", ours[key])), np.array(getattr(value, "matrix", value)))
        for key, value in theirs.items()
    )


def _constant(texture: MitsubaTexture, mi: Mitsuba) -> npt.NDArray[np.float64] | None:
    """Return the value of a texture that is the same everywhere; None of any other texture."""
    values = _values(texture, mi)
    return None if values is None or np.ptp(values) > 0 else values


def _values(texture: MitsubaTexture, mi: Mitsuba) -> npt.NDArray[np.float64] | None:
    """Return the texels or the value of a texture; None of one that has neither."""
    parameters = mi.traverse(texture)
    for key in ("value", "data"):
        if key in parameters:
            return np.array(parameters[key], np.float64)
    return None


def children(node: MitsubaObject) -> dict[str, MitsubaObject]:
    """Return the objects inside a Mitsuba object, by their names; of several with one name, the last."""
    return dict(_traversed(node))


def nested_objects(node: MitsubaObject) -> list[MitsubaObject]:
    """Return all objects inside a Mitsuba object, in its order."""
    return [nested for _, nested in _traversed(node)]


def _traversed(node: MitsubaObject) -> list[tuple[str, MitsubaObject]]:
    traversal = _traversal()()
    node.traverse(traversal)
    objects: list[tuple[str, MitsubaObject]] = traversal.objects
    return objects


@functools.cache
def _traversal() -> type[MitsubaObject]:
    """Return the class of a callback that collects the objects inside another."""
    import mitsuba as mi

    class Traversal(mi.TraversalCallback):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.objects: list[tuple[str, MitsubaObject]] = []

        def put(self, name: str, value: MitsubaValue, *_: object) -> None:
            if isinstance(value, mi.Object):
                self.objects.append((name, value))

    return Traversal


def material_id(bsdf: MitsubaBsdf) -> str:
    """Return the id of a material in the scene; "" where it has none."""
    name = str(bsdf.id())
    return "" if name == "bsdf" or name.startswith("_") else name
