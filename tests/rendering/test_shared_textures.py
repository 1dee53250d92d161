"""Large textures that are alike: their texels are stored once, and nothing else changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene, VertexKeyframes
from davis_rs._core import SceneRenderer
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native import renderer as native_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.scene_tables import scene_texture
from davis_rs.render.texels import Texels
from davis_rs.scene.meshes import Mesh, shape

CAMERA = Camera(24, 8, 16.0, 16.0, 11.5, 3.5)
VIEWS = Views.at_rest([Pose([0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0])])
TEXELS = np.random.RandomState(0).random_sample((300, 300, 3)).astype(np.float32)
COUNT = TEXELS.shape[0] * TEXELS.shape[1]
POINT = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": 9.0}


def colour(texels: npt.NDArray[np.float32] = TEXELS, **options: Any) -> dict[str, Any]:
    return {"type": "bitmap", "raw": True, "data": texels, **options}


def diffuse(**options: Any) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": colour(**options)}


def renderer_of(*materials: dict[str, Any], kind: str = "native") -> NativeRenderer:
    """Make a renderer of squares side by side, from left to right."""
    parts: dict[str, Any] = {"type": "scene", "integrator": {"type": "direct"}, "lamp": POINT}
    for number, material in enumerate(materials):
        place = np.diag([0.45, 0.45, 1.0, 1.0])
        place[0, 3] = number - (len(materials) - 1) / 2
        parts[f"square_{number}"] = {"type": "rectangle", "to_world": place, "bsdf": material}
    renderer = make_renderer(Scene("squares", lambda: dict(parts)), CAMERA, kind=kind, rays_per_pixel=2)
    assert isinstance(renderer, NativeRenderer)
    return renderer


def test_alike_textures_are_stored_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same texels with the same wrap mode there is one copy, and luma has the same bits."""
    other = TEXELS.copy()
    other[0, 0, 0] += 0.1
    materials = [diffuse(texels=other), diffuse(), diffuse(), diffuse(wrap_mode="clamp")]
    renderer = renderer_of(*materials)
    textures = renderer.table.textures
    shared = textures.shared()
    assert textures.has_alike
    assert len(textures.texels(0)) == 4 * COUNT
    assert len(shared.texels(0)) == 3 * COUNT
    assert shared.framed(0).shape == (3 * 302**2,)
    of_texture, images = shared.colours()
    assert of_texture.tolist() == [0, 1, 1, 2]
    assert [layout for layout, _, _ in images] == [(300, 300, 0), (300, 300, 0), (300, 300, 1)]
    assert [(texels.shape, values) for _, texels, values in images] == 3 * [((3 * COUNT,), None)]
    for image, (_, texels, _) in zip(of_texture, textures.colours()[1], strict=True):
        np.testing.assert_array_equal(images[image][1], texels)
    assert shared.sizes[:, 0].tolist() == [0, COUNT, COUNT, 2 * COUNT]
    np.testing.assert_array_equal(shared.sizes[:, 1:], textures.sizes[:, 1:])
    luma = renderer.luma(VIEWS)
    monkeypatch.setattr(scene_texture, "_LARGE", 1 << 40)
    apart = renderer_of(*materials)
    assert not apart.table.textures.has_alike
    np.testing.assert_array_equal(luma, apart.luma(VIEWS))
    assert len(np.unique(luma)) > 50


def test_a_world_that_deforms_has_alike_textures_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two squares, of which one bends; the core gets one copy, and luma has the same bits as without sharing."""
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    bent = corners + np.array([[0, 0, 0], [0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), (corners[:, :2] + 1) / 2
    taken: list[int] = []

    def counted(**given: Any) -> Any:
        taken.append(len(given["texels"][0]))
        return SceneRenderer(**given)

    def source() -> dict[str, Any]:
        parts: dict[str, Any] = {"type": "scene", "integrator": {"type": "direct"}, "lamp": POINT}
        for name, x in (("still", -1.0), ("bending", 1.0)):
            parts[name] = shape(Mesh(corners * 0.5 + [x, 0, 0], faces, uv), TEXELS)
        return parts

    monkeypatch.setattr(native_renderer, "SceneRenderer", counted)
    forms = VertexKeyframes([0.0, 1.0], np.stack([corners, bent]) * 0.5 + [1.0, 0, 0])
    scene = Scene("squares", source, deformations={"bending": forms})
    luma = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=2).luma(VIEWS)
    monkeypatch.setattr(scene_texture, "_LARGE", 1 << 40)
    np.testing.assert_array_equal(luma, make_renderer(scene, CAMERA, kind="native", rays_per_pixel=2).luma(VIEWS))
    assert taken == [302**2, 2 * 302**2]


def test_small_textures_are_not_looked_for() -> None:
    few = TEXELS[:4, :4]
    assert not renderer_of(diffuse(texels=few), diffuse(texels=few)).table.textures.has_alike


def test_each_shape_has_derivatives_by_its_own_texels() -> None:
    """Also where the texels of two shapes are stored once."""
    renderer = renderer_of(diffuse(), diffuse())
    width = CAMERA.width
    pixel = np.array([[4 * width + 8], [4 * width + 16]], np.uint32)
    counts, texels, _ = renderer.texel_gradients(VIEWS, np.zeros(2, np.uint32), pixel, np.ones(1))
    left, right = np.split(texels, counts[:1])
    assert len(left) > 0
    assert len(right) > 0
    assert (left < COUNT).all()
    assert (right >= COUNT).all()


def test_albedos_are_those_of_each_finish() -> None:
    """Textures that are alike share texels where light is baked, too, but not with another finish."""
    plastic = {"type": "plastic", "diffuse_reflectance": colour()}
    other = {"type": "plastic", "diffuse_reflectance": colour(), "int_ior": 2.2}
    renderer = renderer_of(diffuse(), plastic, other, plastic)
    surfaces, finishes = renderer.table.surfaces, renderer.table.gloss
    assert finishes is not None
    of_texture, images = surfaces.reflectances()
    assert of_texture.tolist() == [0, 1, 2, 1]
    base = TEXELS.reshape(-1, 3).astype(np.float64)
    kinds = finishes.finishes_of_textures(surfaces.texture_of)
    for number in (1, 2):
        albedo = finishes.finishes[kinds[number]].albedo(base).astype(np.float32)
        np.testing.assert_array_equal(images[number][1], albedo.ravel())
    np.testing.assert_array_equal(images[0][1], TEXELS.ravel())
    assert np.abs(np.subtract(images[1][1], images[2][1])).max() > 0.01


def test_what_emits_shares_no_texels() -> None:
    """Its texels are in a group of their own, in which those of others are 0."""
    square = {"type": "rectangle", "bsdf": diffuse()}
    lamp = {**square, "emitter": {"type": "area", "radiance": 0.5}}
    aside = {"to_world": np.array([[1.0, 0, 0, 3.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])}
    parts = {"type": "scene", "integrator": {"type": "direct"}, "left": square, "right": lamp | aside}
    scene = Scene("lamp", lambda: dict(parts), soft_light=True)
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=2)
    assert isinstance(renderer, NativeRenderer)
    textures = renderer.table.textures
    assert not textures.has_alike
    dark, emitting = np.split(textures.shared().framed(len(textures.group_weights) - 1), 2)
    assert (dark == 0).all()
    np.testing.assert_allclose(emitting, 0.5, rtol=1e-6)


def test_texels_are_told_apart() -> None:
    """By their values, by what integers stand for, and by how they lie."""
    values = np.arange(12, dtype=np.uint8)
    square = values.reshape(2, 2, 3)
    light = np.arange(256) / 255
    different = [
        Texels(square, light),
        Texels(square, light**2),
        Texels(square),
        Texels(square.astype(np.float32)),
        Texels(values.reshape(4, 1, 3), light),
        Texels(square[::-1], light),
    ]
    assert len({texels.digest for texels in different}) == len(different)
    assert Texels(square.copy(), light.copy()).digest == different[0].digest


@pytest.mark.parametrize("raw", [False, True])
def test_glossy_surfaces_see_8_bits_as_the_values_that_they_stand_for(raw: bool) -> None:
    """A texture of 8 bits on a glossy surface gives the same bits as its values in float32.

    Luma of a diffuse surface next to it is worked out in float64 before it is rounded.
    """
    with variant(SCALAR) as (mi, _):
        numbers = np.random.RandomState(1).randint(0, 256, (12, 9, 3)).astype(np.uint8)
        encoded = np.arange(256) / 255
        values = (encoded if raw else from_srgb(encoded)).astype(np.float32)[numbers]

        def texture(coded: bool) -> dict[str, Any]:
            if coded:
                return {"type": "bitmap", "raw": raw, "bitmap": mi.Bitmap(numbers)}
            return {"type": "bitmap", "raw": True, "data": mi.TensorXf(values)}

        def renderer(coded: bool) -> NativeRenderer:
            plastic = {"type": "roughplastic", "diffuse_reflectance": texture(coded), "alpha": 0.2}
            return renderer_of(plastic, {"type": "conductor"}, {"type": "diffuse", "reflectance": texture(coded)})

        made = [renderer(coded) for coded in (True, False)]
    tables = [renderer.table for renderer in made]
    stored = [[values is not None for _, _, values in table.textures.colours()[1]] for table in tables]
    assert (sum(stored[0]), sum(stored[1])) == (2, 0)
    unseen, seen = tables[0].core_texels(tables[0].textures)[0], tables[0].textures.framed(0)
    assert np.count_nonzero(unseen) < np.count_nonzero(seen)
    luma, same = (renderer.luma(VIEWS) for renderer in made)
    np.testing.assert_array_equal(luma[..., :16], same[..., :16])
    np.testing.assert_allclose(luma, same, rtol=3e-7)
    assert len(np.unique(luma)) > 50
