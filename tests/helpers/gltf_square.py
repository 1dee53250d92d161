"""A glTF file of one square of one material, and what becomes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from davis_rs import Scene, load_scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from gltf_files import UV, Gltf, quad


def world(folder: Path, *, gltf: Gltf | None = None, more: Any = None, extensions: Any = None, **surface: Any) -> Scene:
    """A square of one material, smooth if nothing else is said."""
    gltf = Gltf() if gltf is None else gltf
    more = {"extensions": extensions or {}, **(more or {})}
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(**({"roughnessFactor": 0.3} | surface), more=more)))
    return load_scene(gltf.save(folder / "scene.glb"))


def numbers_of(scene: Scene) -> dict[str, float]:
    """The numbers of the one shape's material, as Mitsuba has them."""
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        given = dict(mi.traverse(shape.bsdf()))
    named = {name.removeprefix("brdf_0.").removesuffix(".value"): value for name, value in given.items()}
    return {name: float(value) for name, value in named.items() if isinstance(value, (int, float))}


def looks_of(scene: Scene) -> list[str]:
    """What is lost, without the reasons."""
    return [look.what.split(" (")[0] for look in scene.lost_looks]
