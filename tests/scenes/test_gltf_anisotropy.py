"""Brushed glTF materials: rougher along one texture coordinate, as Mitsuba's material has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import DecodeError, load_scene
from davis_rs.render.choice import why_not_noise_free
from gltf_files import CORNERS, FACES, UV, Gltf, png
from gltf_square import looks_of, numbers_of, world

ROUGHNESS = 0.4


def brushed(**given: Any) -> dict[str, Any]:
    return {"KHR_materials_anisotropy": {f"anisotropy{name}": value for name, value in given.items()}}


@pytest.mark.parametrize("turns", [0, 1, 2, -1])
@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_brushed_metal_is_rougher_along_its_direction(turns: int, strength: float, tmp_path: Path) -> None:
    """By the file's law: the square of the strength mixes alpha along the direction with 1."""
    extensions = brushed(Strength=strength, Rotation=turns * np.pi / 2)
    scene = world(tmp_path, extensions=extensions, metallicFactor=1.0, roughnessFactor=ROUGHNESS)
    numbers = numbers_of(scene)
    aspect = np.sqrt(1 - 0.9 * numbers["anisotropic"])
    along, across = numbers["roughness"] ** 2 / aspect, numbers["roughness"] ** 2 * aspect
    least = ROUGHNESS**2
    expected = [least + (1 - least) * strength**2, least]
    assert [along, across] == pytest.approx(expected if turns % 2 == 0 else expected[::-1], rel=1e-5)
    assert scene.lost_looks == ()
    assert not why_not_noise_free(scene)


def test_other_anisotropy_is_told(tmp_path: Path) -> None:
    """Along other directions, by a texture, or next to textures of roughness; the surface is as rough as is said."""
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 200)))})
    turned = image | {"extensions": {"KHR_texture_transform": {"rotation": 0.5}}}
    cases: list[dict[str, Any]] = [
        {"extensions": brushed(Strength=0.5, Rotation=0.3)},
        {"extensions": brushed(Strength=0.5, Texture=image)},
        {"extensions": brushed(Strength=0.5), "baseColorTexture": turned},
        {"extensions": brushed(Strength=0.5), "baseColorTexture": image, "metallicRoughnessTexture": image},
    ]
    for case in cases:
        gltf = Gltf()
        gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 200)))})
        scene = world(tmp_path, gltf=gltf, **({"metallicFactor": 1.0, "roughnessFactor": ROUGHNESS} | case))
        assert looks_of(scene) == ["anisotropy"], case
        assert numbers_of(scene).get("anisotropic", 0.0) == 0, case


def test_what_has_no_texture_coordinates_is_not_brushed(tmp_path: Path) -> None:
    """Nor is what has different colours at its vertices, which take texture coordinates of their own."""
    colours = np.linspace(0.1, 0.9, 12).reshape(4, 3)
    for more in ({}, {"uv": UV, "colours": colours}):
        gltf = Gltf()
        material = gltf.material(
            metallicFactor=1.0, roughnessFactor=ROUGHNESS, more={"extensions": brushed(Strength=0.5)}
        )
        gltf.node(mesh=gltf.mesh(CORNERS, FACES, material=material, **more))
        scene = load_scene(gltf.save(tmp_path / "scene.glb"))
        assert looks_of(scene) == ["anisotropy"]
        assert not why_not_noise_free(scene)


def test_nothing_is_told_where_nothing_is_brushed(tmp_path: Path) -> None:
    """Without strength, or without highlights; glass loses it."""
    assert world(tmp_path, extensions=brushed(Strength=0.0), metallicFactor=1.0).lost_looks == ()
    assert world(tmp_path, extensions=brushed(Strength=0.5), roughnessFactor=1.0).lost_looks == ()
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    assert looks_of(world(tmp_path, extensions=brushed(Strength=0.5) | glass, roughnessFactor=0.0)) == [
        "KHR_materials_anisotropy"
    ]
    with pytest.raises(DecodeError, match=r"materials\[0\]: KHR_materials_anisotropy\.anisotropyStrength"):
        world(tmp_path, extensions=brushed(Strength=1.5), metallicFactor=1.0)
