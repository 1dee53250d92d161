"""Glass of glTF files: what is seen through it, against Fresnel's equations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import DecodeError, Scene, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from gltf_files import CORNERS, FACES, UV, Gltf, png, quad

CAMERA = Camera(width=32, height=24, fx=160.0, fy=160.0, cx=15.5, cy=11.5)
"""So long a lens that all rays meet the glass nearly at right angles."""

TINT = np.array([0.9, 0.5, 0.2])
LUMA = np.array([0.299, 0.587, 0.114])
SMOOTH = {"metallicFactor": 0.0, "roughnessFactor": 0.0}


def glass(gltf: Gltf, fraction: float = 1.0, *, more: Any = None, extensions: Any = None, **surface: Any) -> int:
    given = {"KHR_materials_transmission": {"transmissionFactor": fraction}, **(extensions or {})}
    base: dict[str, Any] = {"baseColorFactor": [*TINT, 1.0], **SMOOTH}
    return gltf.material("pane", more={"extensions": given, **(more or {})}, **(base | surface))


def world(gltf: Gltf, folder: Path, material: int, *, box: bool = False) -> Scene:
    """Glass before a wall of luma 1, in the dark: a sheet, or a slab 1 m thick."""
    unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
    wall = gltf.material("wall", more=unlit, baseColorFactor=[1, 1, 1, 1])
    gltf.node(mesh=gltf.mesh(CORNERS * [9, 9, 1], FACES, material=wall), translation=[0, 0, -4])
    if box:
        x, y = CORNERS[:, 0] * 5, CORNERS[:, 1] * 5
        corners = np.concatenate([np.stack([x, y, 0 * x + z], 1) for z in (0.5, -0.5)])
        sides = [[0, 1, 2, 3], [5, 4, 7, 6], [1, 5, 6, 2], [4, 0, 3, 7], [3, 2, 6, 7], [4, 5, 1, 0]]
        faces = [triangle for a, b, c, d in sides for triangle in ([a, b, c], [a, c, d])]
        gltf.node(mesh=gltf.mesh(corners, np.array(faces), material=material))
    else:
        gltf.node(mesh=quad(gltf, uv=UV, material=material))
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.15, "aspectRatio": 4 / 3}})
    gltf.node(camera=camera, translation=[0, 0, 3])
    gltf.light({"type": "point", "intensity": 1e-12})
    return load_scene(gltf.save(folder / "scene.glb"))


def luma(scene: Scene, rays: int = 1) -> float:
    assert scene.start is not None
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=rays, lattice_rays_per_pixel=rays, kind="native", blur=False)
    return float(renderer.luma(Views.at_rest([scene.start]))[0, 12, 16])


def reflected(index: float) -> float:
    return float(((index - 1) / (index + 1)) ** 2)


@pytest.mark.without_llvm
@pytest.mark.parametrize("index", [None, 1.2, 2.4])
@pytest.mark.parametrize("alpha", [1.0, 0.25])
def test_a_sheet(index: float | None, alpha: float, tmp_path: Path) -> None:
    """Light is reflected to and fro inside, and tinted once; exporters add an alpha for what does not know glass."""
    gltf = Gltf()
    extensions = {} if index is None else {"KHR_materials_ior": {"ior": index}}
    looks = {"alphaMode": "BLEND"} if alpha < 1 else {}
    scene = world(gltf, tmp_path, glass(gltf, extensions=extensions, more=looks, baseColorFactor=[*TINT, alpha]))
    assert scene.lost_looks == ()
    once = reflected(index or 1.5)
    assert luma(scene) == pytest.approx(TINT @ LUMA * (1 - 2 * once / (1 + once)), rel=1e-3)


def test_a_solid(tmp_path: Path) -> None:
    """Two surfaces, each of which lets its part through; light that goes to and fro inside adds a little."""
    gltf = Gltf()
    volume = {"KHR_materials_volume": {"thicknessFactor": 0.5}}
    scene = world(gltf, tmp_path, glass(gltf, extensions=volume, baseColorFactor=[1, 1, 1, 1]), box=True)
    assert scene.lost_looks == ()
    once = reflected(1.5)
    assert (1 - once) ** 2 - 1e-4 < luma(scene) < (1 - once) / (1 + once) + 1e-3


def test_a_rough_solid(tmp_path: Path) -> None:
    """What is seen through frosted glass is blurred, but under even light as bright but for what microfacets lose."""
    gltf = Gltf()
    volume = {"KHR_materials_volume": {"thicknessFactor": 0.5}}
    scene = world(
        gltf, tmp_path, glass(gltf, extensions=volume, roughnessFactor=0.4, baseColorFactor=[1, 1, 1, 1]), box=True
    )
    assert scene.lost_looks == ()
    assert 0.75 < luma(scene, rays=64) < 0.9


@pytest.mark.parametrize("scale", [1.0, 0.01])
@pytest.mark.parametrize("thickness", [0.5, 0.0])
def test_a_solid_absorbs_along_the_way_through_it(thickness: float, scale: float, tmp_path: Path) -> None:
    """By the way between its surfaces, whatever thickness the file gives, and in its unit; a sheet absorbs none."""
    colour = np.array([0.9, 0.3, 0.0])
    volume = {"thicknessFactor": thickness, "attenuationDistance": 2.0, "attenuationColor": colour.tolist()}
    extensions = {"KHR_materials_volume": volume, "KHR_materials_ior": {"ior": 1.0}}
    gltf = Gltf()
    material = glass(gltf, extensions=extensions, baseColorFactor=[1, 1, 1, 1])
    made = world(gltf, tmp_path, material, box=thickness > 0)
    scene = load_scene(tmp_path / "scene.glb", scale=scale)
    assert made.lost_looks == scene.lost_looks == ()
    expected = LUMA @ np.sqrt(np.maximum(colour, 1e-6)) if thickness else 1.0
    assert luma(scene) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("volume", "rule"),
    [
        ({"attenuationDistance": 0}, r"attenuationDistance: must be more than 0"),
        ({"attenuationDistance": -1}, r"attenuationDistance: must be a number from 0"),
        ({"attenuationDistance": 1, "attenuationColor": [1, 2, 1]}, r"attenuationColor: must be 3 numbers from 0 to 1"),
    ],
)
def test_volumes_that_break_a_rule(volume: dict[str, Any], rule: str, tmp_path: Path) -> None:
    gltf = Gltf()
    extensions = {"KHR_materials_volume": {"thicknessFactor": 1, "attenuationColor": [0.5, 0.5, 0.5], **volume}}
    with pytest.raises(DecodeError, match=rf"materials\[0\]: KHR_materials_volume.{rule}"):
        world(gltf, tmp_path, glass(gltf, extensions=extensions), box=True)


def test_what_is_lost_of_glass_is_told(tmp_path: Path) -> None:
    texture: dict[str, Any] = {}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"fraction": 0.7}, "what glass does not let through (it is clear)"),
        ({"metallicFactor": 0.5}, "what glass does not let through (it is clear)"),
        ({"roughnessFactor": 0.4}, "roughness of sheets of glass (they are clear)"),
        ({"extensions": {"KHR_materials_specular": {"specularFactor": 0.5}}}, "KHR_materials_specular of glass"),
        ({"baseColorTexture": texture}, "colours of glass that differ from place to place (their mean is taken)"),
    ]
    for changes, told in cases:
        gltf = Gltf()
        if "baseColorTexture" in changes:
            texture |= gltf.texture({"bufferView": gltf.view(png(np.full((4, 4, 3), 188)))})
        scene = world(gltf, tmp_path, glass(gltf, **changes))
        assert [look.what for look in scene.lost_looks] == [told]
        once = reflected(1.5)
        of_texture = ((188 / 255 + 0.055) / 1.055) ** 2.4 if "baseColorTexture" in changes else 1.0
        assert luma(scene) == pytest.approx(of_texture * TINT @ LUMA * (1 - 2 * once / (1 + once)), rel=1e-3)


def test_what_is_hardly_clear_is_opaque(tmp_path: Path) -> None:
    """Also where a texture says how clear it is; nothing is told of a factor of 0."""
    cases: list[tuple[float, dict[str, Any], list[str]]] = [
        (0.4, {}, ["KHR_materials_transmission"]),
        (1.0, {"transmissionTexture": {"index": 0}}, ["KHR_materials_transmission"]),
        (0.0, {}, []),
    ]
    for fraction, given, told in cases:
        gltf = Gltf()
        own = {"KHR_materials_transmission": {"transmissionFactor": fraction, **given}}
        scene = world(gltf, tmp_path, glass(gltf, extensions=own))
        assert [look.what for look in scene.lost_looks] == told
        assert luma(scene) < 1e-6
    gltf = Gltf()
    with pytest.raises(DecodeError, match="transmissionFactor"):
        world(gltf, tmp_path, glass(gltf, fraction=2.0))


def test_what_is_unlit_is_no_glass(tmp_path: Path) -> None:
    gltf = Gltf()
    scene = world(gltf, tmp_path, glass(gltf, extensions={"KHR_materials_unlit": {}}))
    assert scene.lost_looks == ()
    assert luma(scene) == pytest.approx(TINT @ LUMA, rel=1e-5)


def test_an_index_of_1_is_hardly_there(tmp_path: Path) -> None:
    for index in (1.0, 0.0):
        gltf = Gltf()
        scene = world(gltf, tmp_path, glass(gltf, extensions={"KHR_materials_ior": {"ior": index}}))
        assert luma(scene) == pytest.approx(TINT @ LUMA, rel=1e-4)


def test_glass_with_a_soft_alpha_blends(tmp_path: Path) -> None:
    gltf = Gltf()
    texture = gltf.texture({"bufferView": gltf.view(png(np.full((4, 4, 4), [255, 255, 255, 51])))})
    scene = world(gltf, tmp_path, glass(gltf, baseColorTexture=texture, more={"alphaMode": "BLEND"}))
    assert luma(scene) == pytest.approx(0.8, rel=1e-3)
