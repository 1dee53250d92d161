"""Highlights of opaque glTF materials: their strength, and what an index of refraction does not say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import DecodeError
from gltf_files import Gltf, png
from gltf_square import numbers_of, world

LUMA = np.array([0.299, 0.587, 0.114])
BELOW = "what strong highlights take from the light below them"
WEAK = "how specularFactor weakens highlights at a grazing angle (there they are whole)"
COLOURS = "colours of highlights (they are white, and as bright)"
MEAN = "highlights that differ from place to place (their mean is taken)"


def reflected(index: float) -> float:
    return ((index - 1) / (index + 1)) ** 2


@pytest.mark.parametrize(
    ("extensions", "strength", "told"),
    [
        ({"KHR_materials_ior": {"ior": 1.8}}, reflected(1.8), ()),
        ({"KHR_materials_specular": {"specularFactor": 0.5}}, 0.02, (WEAK,)),
        ({"KHR_materials_specular": {"specularColorFactor": [2.0, 2.0, 2.0]}}, 0.08, ()),
        (
            {"KHR_materials_specular": {"specularColorFactor": [0.5, 1.0, 2.0], "specularFactor": 0.7}},
            0.04 * 0.7 * LUMA @ [0.5, 1.0, 2.0],
            (COLOURS, WEAK),
        ),
        (
            {"KHR_materials_specular": {"specularColorFactor": [0.25, 0.25, 0.25]}, "KHR_materials_ior": {"ior": 0}},
            0.25,
            (BELOW,),
        ),
        ({"KHR_materials_ior": {"ior": 0}}, 0.99, (BELOW,)),
    ],
)
def test_highlights_are_as_strong_as_the_file_says(
    extensions: dict[str, Any], strength: float, told: tuple[str, ...], tmp_path: Path
) -> None:
    """At normal incidence, by an index of refraction."""
    scene = world(tmp_path, extensions=extensions)
    assert reflected(numbers_of(scene)["eta"]) == pytest.approx(strength, rel=1e-5)
    assert tuple(look.what for look in scene.lost_looks) == told


@pytest.mark.parametrize(
    "extensions",
    [
        {"KHR_materials_ior": {"ior": 1}},
        {"KHR_materials_specular": {"specularFactor": 0}},
        {"KHR_materials_specular": {"specularColorFactor": [0, 0, 0]}, "KHR_materials_ior": {"ior": 1000}},
    ],
)
def test_what_has_no_highlights_is_diffuse_or_metal(extensions: dict[str, Any], tmp_path: Path) -> None:
    """Nothing of it is lost, and metal keeps its own."""
    plain, metal = (world(tmp_path, extensions=extensions, metallicFactor=fraction) for fraction in (0.0, 0.5))
    assert (plain.lost_looks, metal.lost_looks) == ((), ())
    assert "metallic" not in numbers_of(plain)
    assert numbers_of(metal)["eta"] == pytest.approx(1.001)


def test_strong_highlights_are_seen_on_rough_surfaces(tmp_path: Path) -> None:
    rough: dict[str, Any] = {"roughnessFactor": 0.9}
    assert "roughness" not in numbers_of(world(tmp_path, extensions={"KHR_materials_ior": {"ior": 1.5}}, **rough))
    assert "roughness" in numbers_of(world(tmp_path, extensions={"KHR_materials_ior": {"ior": 3.0}}, **rough))


def test_metal_has_no_highlights_of_other_matter(tmp_path: Path) -> None:
    extensions = {"KHR_materials_specular": {"specularFactor": 0.5}}
    assert world(tmp_path, extensions=extensions, metallicFactor=1.0).lost_looks == ()


def test_textures_of_highlights_are_their_means(tmp_path: Path) -> None:
    """The factor is alpha, and the colour is in sRGB."""
    texels = np.full((2, 2, 4), 188)
    texels[..., 3] = [[0, 255], [255, 255]]
    for name, mean in (("specularTexture", 0.75), ("specularColorTexture", ((188 / 255 + 0.055) / 1.055) ** 2.4)):
        gltf = Gltf()
        image = gltf.texture({"bufferView": gltf.view(png(texels))})
        scene = world(tmp_path, gltf=gltf, extensions={"KHR_materials_specular": {name: image}})
        assert reflected(numbers_of(scene)["eta"]) == pytest.approx(0.04 * mean, rel=1e-3)
        assert MEAN in [look.what for look in scene.lost_looks]


def test_wrong_numbers_of_highlights_are_named(tmp_path: Path) -> None:
    for extension, given in (
        ("KHR_materials_specular", {"specularFactor": 1.5}),
        ("KHR_materials_specular", {"specularColorFactor": [1, -1, 1]}),
        ("KHR_materials_ior", {"ior": "high"}),
    ):
        (name,) = given
        with pytest.raises(DecodeError, match=rf"materials\[0\]: {extension}\.{name}"):
            world(tmp_path, extensions={extension: given})
