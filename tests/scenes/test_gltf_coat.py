"""Coats of opaque glTF materials, as Mitsuba's material has them, and what that does not show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import Camera, DecodeError, start_pose
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from gltf_files import Gltf, png
from gltf_square import looks_of, numbers_of, world

CAMERA = Camera(width=32, height=24, fx=30.0, fy=30.0, cx=15.5, cy=11.5)
SLANT = "coats seen at a slant"
MEANS = "coats that differ from place to place"
ROUGH = "roughness of coats above 0.32"
NORMALS = "normals of coats"


def coat(**given: Any) -> dict[str, Any]:
    return {"KHR_materials_clearcoat": {f"clearcoat{name}": value for name, value in given.items()}}


@pytest.mark.parametrize(
    ("roughness", "gloss", "told"), [(0.0, 1.0, []), (0.2, (0.1 - 0.04) / 0.099, []), (0.5, 0.0, [ROUGH])]
)
def test_a_coat_is_that_of_mitsuba(roughness: float, gloss: float, told: list[str], tmp_path: Path) -> None:
    """Also over what is too rough for highlights of its own, and over what has none."""
    extensions = coat(Factor=0.75, RoughnessFactor=roughness)
    dull = {"KHR_materials_specular": {"specularFactor": 0}}
    for surface in ({}, {"roughnessFactor": 1.0}, {"extensions": extensions | dull}, {"metallicFactor": 1.0}):
        scene = world(tmp_path, **({"extensions": extensions} | surface))
        numbers = numbers_of(scene)
        assert numbers["clearcoat"] == 0.75
        assert numbers["clearcoat_gloss"] == pytest.approx(gloss, abs=1e-6)
        assert looks_of(scene) == [SLANT, *told]


def test_no_coat_is_none(tmp_path: Path) -> None:
    """Where its factor is 0, as it is where nothing is said."""
    scene = world(tmp_path, extensions=coat(RoughnessFactor=0.5))
    assert "clearcoat" not in numbers_of(scene) or numbers_of(scene)["clearcoat"] == 0
    assert scene.lost_looks == ()


def test_textures_of_a_coat_are_their_means(tmp_path: Path) -> None:
    """Red is the strength, green the roughness, not in sRGB."""
    gltf = Gltf()
    texels = np.zeros((2, 2, 3))
    texels[..., 0], texels[..., 1] = [[0, 255], [255, 255]], 51
    image = gltf.texture({"bufferView": gltf.view(png(texels))})
    given = coat(Factor=0.5, Texture=image, RoughnessFactor=0.5, RoughnessTexture=image)
    scene = world(tmp_path, gltf=gltf, extensions=given)
    numbers = numbers_of(scene)
    assert numbers["clearcoat"] == pytest.approx(0.375)
    assert numbers["clearcoat_gloss"] == pytest.approx((0.1 - 0.01) / 0.099)
    assert looks_of(scene) == [MEANS, SLANT]


@pytest.mark.parametrize(("own", "below", "told"), [(0, 0, []), (None, 0, [NORMALS]), (0, None, [NORMALS])])
def test_normals_of_a_coat_are_those_below(own: int | None, below: int | None, told: list[str], tmp_path: Path) -> None:
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), [100, 128, 255])))})
    given = coat(Factor=1.0, **({} if own is None else {"NormalTexture": image}))
    more = {} if below is None else {"normalTexture": image}
    assert looks_of(world(tmp_path, gltf=gltf, extensions=given, more=more)) == [SLANT, *told]


def test_what_has_no_coat_loses_it(tmp_path: Path) -> None:
    """Glass and materials of specular and glossiness."""
    for other in (
        {"KHR_materials_transmission": {"transmissionFactor": 1}},
        {"KHR_materials_pbrSpecularGlossiness": {}},
    ):
        scene = world(tmp_path, extensions=coat(Factor=1.0) | other, roughnessFactor=0.0)
        assert "KHR_materials_clearcoat" in looks_of(scene)


def test_wrong_numbers_of_a_coat_are_named(tmp_path: Path) -> None:
    with pytest.raises(DecodeError, match=r"materials\[0\]: KHR_materials_clearcoat\.clearcoatFactor"):
        world(tmp_path, extensions=coat(Factor=1.5))


def test_a_coat_is_rendered_without_noise(tmp_path: Path) -> None:
    """It mirrors the sky: a black surface with a coat is not black."""
    black = {"baseColorFactor": [0, 0, 0, 1], "roughnessFactor": 1.0}
    lumas = []
    for factor in (0.5, 1.0):
        scene = world(tmp_path, extensions=coat(Factor=factor), **black)
        renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind="native", blur=False)
        lumas.append(renderer.luma(Views.at_rest([start_pose(scene)])).mean())
    assert lumas[0] > 1e-3
    assert lumas[1] > lumas[0]
