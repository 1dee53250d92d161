"""Images of scene files: one texture of Mitsuba for all that show one, and none for renderers that read texels."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Scene, load_scene
from davis_rs._mitsuba.types import MitsubaTexture
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render import choice
from davis_rs.render.choice import make_renderer
from davis_rs.render.diffuse_materials import children
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.scene.image_textures import stand_ins
from davis_rs.scene.load import start_pose
from gltf_files import UV, Gltf, png, quad, with_camera

CAMERA = Camera(32, 16, 20.0, 20.0, 15.5, 7.5)
TEXELS = np.random.RandomState(0).randint(0, 256, (9, 7, 3)).astype(np.uint8)
TINT = (1.0, 0.5, 0.25)
NEAREST, MIRROR, CLAMP = {"magFilter": 9728}, {"wrapS": 33648, "wrapT": 33648}, {"wrapS": 33071, "wrapT": 33071}
DULL: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
GLOSSY: dict[str, Any] = {"metallicFactor": 0.5, "roughnessFactor": 0.4}


class Look:
    """A square with the image on it."""

    def __init__(self, tint: tuple[float, ...] = (1.0, 1.0, 1.0), sampler: dict[str, Any] | None = None, **more: Any):
        self.tint, self.sampler, self.more = tint, sampler or {}, {**DULL, **more}


ALL_LOOKS = [
    Look(),
    Look(TINT),
    Look(sampler=NEAREST),
    Look(sampler=MIRROR),
    Look(TINT, sampler=CLAMP),
    Look(**GLOSSY),
    Look(TINT, **GLOSSY),
]


def world(folder: Path, *looks: Look, texels: npt.NDArray[np.uint8] = TEXELS) -> Scene:
    """Make a scene of squares side by side that show one image, from left to right, seen from above."""
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(texels)), "mimeType": "image/png"})["index"]
    source = gltf.document["textures"][image]["source"]
    for number, look in enumerate(looks):
        index = gltf.add("textures", {"source": source, "sampler": gltf.add("samplers", look.sampler)})
        paint = gltf.material(baseColorTexture={"index": index}, baseColorFactor=[*look.tint, 1.0], **look.more)
        place = [2.2 * (number - (len(looks) - 1) / 2), 0.0, 0.0]
        gltf.node(mesh=quad(gltf, uv=1.7 * UV - 0.4, material=paint), translation=place)
    with_camera(gltf, 9.0)
    return load_scene(gltf.save(folder / "scene.glb"))


def textures_of(scene: Scene) -> list[MitsubaTexture]:
    """Load a scene and return the textures of its shapes; call it under a variant."""
    import mitsuba as mi

    materials = [children(shape.bsdf())["brdf_0"] for shape in load_scene_source(scene.source(), mi).shapes()]
    return [children(material).get("reflectance") or children(material)["base_color"] for material in materials]


def test_materials_with_one_image_share_a_texture(tmp_path: Path) -> None:
    """Those that look it up alike, diffuse or not; it keeps the file's 8 bits."""
    clamped, hard, duller = Look(sampler=CLAMP), Look(sampler=NEAREST), Look(TINT, roughnessFactor=0.9)
    scene = world(tmp_path, Look(), Look(**GLOSSY), clamped, hard, Look(TINT), duller)
    with variant(SCALAR) as (mi, _):
        textures = textures_of(scene)
        same = [[first is second for second in textures] for first in textures]
        data = [np.array(mi.traverse(texture)["data"]) for texture in textures]
    pairs = {(0, 1), (4, 5)}
    for first, second in itertools.combinations(range(6), 2):
        assert same[first][second] == ((first, second) in pairs)
    for kept in data[:4]:
        assert kept.dtype == np.uint8
        np.testing.assert_array_equal(kept, TEXELS)
    np.testing.assert_allclose(data[4], from_srgb(TEXELS / 255) * TINT, rtol=1e-6)


def test_renderers_without_noise_have_no_texels_in_mitsuba(tmp_path: Path) -> None:
    scene = world(tmp_path, *ALL_LOOKS)
    with variant(SCALAR) as (mi, _):
        with stand_ins() as images:
            textures = textures_of(scene)
        # Mitsuba makes four texels of one.
        assert all(np.array(mi.traverse(texture)["data"]).size <= 12 for texture in textures)
        assert [images[texture].image.tint.tolist() for texture in textures] == [list(look.tint) for look in ALL_LOOKS]
        assert all(np.array(mi.traverse(texture)["data"]).shape == (9, 7, 3) for texture in textures_of(scene))


@pytest.mark.parametrize("kind", ["native", "baked"])
def test_texels_are_those_of_mitsuba(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Luma has the same bits where Mitsuba holds the texels; tinted ones were float32 there, and are the same."""
    scene = world(tmp_path, *ALL_LOOKS)
    views = Views.at_rest([start_pose(scene)])

    def luma() -> npt.NDArray[np.float32]:
        renderer = make_renderer(scene, CAMERA, kind=kind, rays_per_pixel=4, bake_error=0.5)
        assert isinstance(renderer, NativeRenderer)
        return renderer.luma(views)

    own = luma()
    monkeypatch.setattr(choice, "stand_ins", lambda: contextlib.nullcontext({}))
    np.testing.assert_array_equal(own, luma())
    assert len(np.unique(own)) > 50


def test_light_is_baked_with_the_reflectance_of_the_texels(tmp_path: Path) -> None:
    """Against float64: as dark as the tint makes them, and of glossy surfaces their albedo."""
    scene = world(tmp_path, Look(), Look(TINT), Look(TINT, **GLOSSY))
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=1)
    assert isinstance(renderer, NativeRenderer)
    surfaces, gloss = renderer.table.surfaces, renderer.table.gloss
    assert gloss is not None
    linear = from_srgb(TEXELS.reshape(-1, 3) / 255)
    expected = [linear, linear * TINT, gloss.finishes[0].albedo(linear * TINT)]
    of_texture, images = surfaces.reflectances()
    for number, reflectance in zip(of_texture, expected, strict=True):
        layout, texels, values = images[number]
        assert layout[:2] == (7, 9)
        assert texels.dtype == np.uint8
        assert values is not None
        stands_for = values.reshape(256, 3)[texels.reshape(-1, 3), np.arange(3)]
        np.testing.assert_allclose(stands_for, reflectance, rtol=2e-7, atol=1e-9)


def test_light_of_another_image_is_not_taken_from_the_cache(tmp_path: Path) -> None:
    """Images that Mitsuba does not hold count in the key under which light is kept; so does how they are looked up."""
    other = TEXELS.copy()
    other[4, 4, 1] ^= 1
    looks: list[tuple[Look, npt.NDArray[np.uint8]]] = [
        (Look(), TEXELS),
        (Look(), other),
        (Look(TINT), TEXELS),
        (Look(sampler=CLAMP), TEXELS),
    ]
    contents = []
    for number, (look, texels) in enumerate([*looks, looks[0]]):
        folder = tmp_path / str(number)
        folder.mkdir()
        scene = replace(world(folder, look, texels=texels), soft_light=True)
        renderer = make_renderer(scene, CAMERA, kind="baked", rays_per_pixel=1, bake_error=0.5)
        assert isinstance(renderer, NativeRenderer)
        assert renderer.baked is not None
        contents.append(renderer.baked.content)
    assert len(set(contents)) == len(looks)
    assert contents[-1] == contents[0]
