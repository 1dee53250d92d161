"""Materials that are diffuse in fact, and those that are taken as diffuse on the user's wish.

Mitsuba wraps materials (two sides, opacity, bumps). Where the wrapping changes nothing, what is inside is taken, so
that the renderers of diffuse scenes know it. Materials with a diffuse colour and more (highlights, a coat) may be
replaced by that colour: ``Scene.matte``. Mitsuba's ``principled`` is never diffuse by itself, whatever its parameters
are: its diffuse part depends on both directions (Burley, Physically-based shading at Disney, 2012, section 5.3), and so
does that of ``plastic``, behind its coat.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .obstacles import plugin_name, shape_name

_COLOURS = {
    "Principled": ("principled", "base_color"),
    "PrincipledThin": ("principledthin", "base_color"),
    "SmoothPlastic": ("plastic", "diffuse_reflectance"),
    "RoughPlastic": ("roughplastic", "diffuse_reflectance"),
}
"""Plugin and diffuse colour of materials that have more than that, by their class."""

_TRANSMITTED = ("spec_trans", "diff_trans")
"""A material through which light goes has no matte counterpart where these are not 0."""

_BUMPS = {"BumpMap": "bumpmap", "NormalMap": "normalmap"}
_FLAT_NORMAL = (0.5, 0.5, 1.0)


class _Diffuse(NamedTuple):
    """The diffuse material that another one is or has within.

    Attributes:
        colour: its reflectance, Mitsuba's own object.
        two_sided: seen from both sides.
        lost: the plugins whose effect is not in it; empty where it is the same.
    """

    colour: Any
    two_sided: bool
    lost: tuple[str, ...]


def simplify_materials(scene: Any, mi: Any, *, matte: bool) -> tuple[str, ...]:
    """Give a loaded scene's shapes diffuse materials where theirs are so in fact, or where that is wished.

    Args:
        scene: Mitsuba's, loaded under the variant in force; it is changed.
        matte: replace materials that have a diffuse colour by that colour alone.

    Returns:
        The names of materials that were replaced so, each with the plugin that it is.
    """
    replaced = dict[str, None]()
    known: dict[Any, _Diffuse | None] = {}
    made: dict[Any, Any] = {}
    for shape in scene.shapes():
        bsdf = shape.bsdf()
        if bsdf is None or is_plain(bsdf):
            continue
        if bsdf not in known:
            known[bsdf] = _diffuse_within(bsdf, mi)
        found = known[bsdf]
        if found is None:
            continue
        if found.lost and not matte:
            continue
        if found.lost:
            replaced[f"{material_id(bsdf) or shape.id() or shape_name(shape)} ({', '.join(found.lost)})"] = None
        if bsdf not in made:
            diffuse = {"type": "diffuse", "reflectance": found.colour}
            made[bsdf] = mi.load_dict({"type": "twosided", "nested": diffuse} if found.two_sided else diffuse)
        shape.set_bsdf(made[bsdf])
    return tuple(replaced)


def surface_remedy(bsdf: Any, mi: Any) -> str:
    """What makes a surface diffuse that is not."""
    found = _diffuse_within(bsdf, mi)
    by_wish = "" if found is None or not found.lost else "--matte (matte=True) takes its diffuse colour alone, or "
    return f"{by_wish}give it a diffuse material"


def surface_kind(bsdf: Any) -> str:
    """The plugin that a material is, with those within: ``twosided(conductor)``."""
    import mitsuba as mi

    nested = (child for child in _children(bsdf).values() if isinstance(child, mi.BSDF))
    inside = ", ".join(dict.fromkeys(map(surface_kind, nested)))
    return f"{plugin_name(bsdf)}({inside})" if inside else plugin_name(bsdf)


def reflectance_kind(bsdf: Any) -> str:
    """The plugin that gives a diffuse material's colour: ``checkerboard``."""
    return plugin_name(_children(_children(bsdf).get("brdf_0", bsdf))["reflectance"])


def surface_name(bsdf: Any, shape: Any) -> str:
    """How a line calls a surface: by its material's id, or by the shape where it has none of its own."""
    return f"material {material_id(bsdf)!r}" if material_id(bsdf) else shape_name(shape)


def is_two_sided(bsdf: Any) -> bool:
    """Whether a material reflects on both sides."""
    return bool(bsdf.class_name() == "TwoSidedBRDF")


def is_plain(bsdf: Any) -> bool:
    """Whether it is diffuse, or diffuse and seen from both sides, as the direct renderers know it."""
    if is_two_sided(bsdf):
        return all(child.class_name() == "SmoothDiffuse" for child in _children(bsdf).values())
    return bool(bsdf.class_name() == "SmoothDiffuse")


def _diffuse_within(bsdf: Any, mi: Any) -> _Diffuse | None:
    """The diffuse material that this one is or has within; None where there is none."""
    kind, inside = bsdf.class_name(), _children(bsdf)
    if kind == "SmoothDiffuse":
        return _Diffuse(inside["reflectance"], False, ())
    if kind in _COLOURS:
        plugin, colour = _COLOURS[kind]
        passing = (_constant(inside[name], mi) for name in _TRANSMITTED if name in inside)
        opaque = all(value is not None and not value.any() for value in passing)
        return _Diffuse(inside[colour], kind == "PrincipledThin", (plugin,)) if opaque else None
    if kind == "TwoSidedBRDF":
        front, back = (_diffuse_within(inside[side], mi) for side in ("brdf_0", "brdf_1"))
        if front is None or back is None or not _same_colour(front.colour, back.colour, mi):
            return None
        return front._replace(two_sided=True, lost=tuple(dict.fromkeys(front.lost + back.lost)))
    if kind == "MaskBSDF":
        value = _constant(inside["opacity"], mi)
        return _diffuse_within(inside["nested_bsdf"], mi) if value is not None and (value == 1).all() else None
    if kind == "BlendBSDF":
        value = _constant(inside["weight"], mi)
        if value is None or not ((value == 0).all() or (value == 1).all()):
            return None
        return _diffuse_within(inside[f"bsdf_{int(value.flat[0])}"], mi)
    if kind in _BUMPS:
        nested = _diffuse_within(inside["nested_bsdf"], mi)
        if nested is None or _is_flat(kind, inside, mi):
            return nested
        return nested._replace(lost=(_BUMPS[kind], *nested.lost))
    return None


def _is_flat(kind: str, inside: dict[str, Any], mi: Any) -> bool:
    """Whether a map of bumps or normals has none."""
    texture = inside.get("nested_texture", inside.get("normalmap"))
    values = _values(texture, mi)
    if values is None:
        return False
    if kind == "BumpMap":
        return bool(np.ptp(values) == 0)
    return values.ndim == 3 and values.shape[2] >= 3 and bool((np.abs(values[..., :3] - _FLAT_NORMAL) < 1e-6).all())


def _same_colour(first: Any, second: Any, mi: Any) -> bool:
    if first is second:
        return True
    ours, theirs = (dict(mi.traverse(texture)) for texture in (first, second))
    return ours.keys() == theirs.keys() and all(
        np.array_equal(np.array(getattr(ours[key], "matrix", ours[key])), np.array(getattr(value, "matrix", value)))
        for key, value in theirs.items()
    )


def _constant(texture: Any, mi: Any) -> npt.NDArray[Any] | None:
    """The value of a texture that is the same everywhere."""
    values = _values(texture, mi)
    return None if values is None or np.ptp(values) > 0 else values


def _values(texture: Any, mi: Any) -> npt.NDArray[Any] | None:
    """The texels or the value of a texture; None of one that has neither."""
    parameters = mi.traverse(texture)
    for key in ("value", "data"):
        if key in parameters:
            return np.array(parameters[key], np.float64)
    return None


def _children(node: Any) -> dict[str, Any]:
    """The objects that one of Mitsuba's is made of, by their names."""
    found = _traversal()()
    node.traverse(found)
    children: dict[str, Any] = found.objects
    return children


@functools.cache
def _traversal() -> Any:
    """The class of a callback that takes the objects within another."""
    import mitsuba as mi

    class Traversal(mi.TraversalCallback):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.objects: dict[str, Any] = {}

        def put(self, name: str, value: Any, *_: Any) -> None:
            if isinstance(value, mi.Object):
                self.objects[name] = value

    return Traversal


def material_id(bsdf: Any) -> str:
    """The id that the scene gives a material; "" where it gives none."""
    name = str(bsdf.id())
    return "" if name == "bsdf" or name.startswith("_") else name
