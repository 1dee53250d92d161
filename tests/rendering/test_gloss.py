"""Glossy surfaces: what the native renderer computes in closed form, next to what Mitsuba computes."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene, Simulator
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.motions import slider
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer, why_not_noise_free
from davis_rs.render.diffuse_materials import children, simplify_materials
from davis_rs.render.finish import Finish, dielectric
from davis_rs.render.finishes import read_finish
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.number_textures import NumberTexels
from davis_rs.render.scene_tables.gloss_table import GlossTable
from long_form import long_values

CAMERA = Camera(16, 12, 16.0, 16.0, 7.5, 5.5)
POSE = Pose([0.2, -0.4, 1.8], [1.0, 0.0, 0.0, 0.0])
VIEWS = Views.at_rest([POSE])
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
POINT = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 6.0, 3.0]}}
SUN = {"type": "directional", "direction": [0.3, 0.2, -1.0], "irradiance": 2.0}
SPOT = {
    "type": "spot",
    "to_world": np.array([[1.0, 0, 0, 0.3], [0, -1.0, 0, 0], [0, 0, -1.0, 2.0], [0, 0, 0, 1]]),
    "intensity": 8.0,
}
TEXELS = np.random.RandomState(3).random_sample((5, 8, 3)).astype(np.float32)
COLOUR = {"type": "bitmap", "raw": True, "data": TEXELS}
ROUGHNESS = {"type": "bitmap", "raw": True, "wrap_mode": "mirror", "data": 0.25 + 0.5 * TEXELS[..., :1]}
FINER = {"to_uv": np.array([[5.0, 0, 0.3], [0, 5, 0.1], [0, 0, 1]])}
BRUSHED = {"type": "bitmap", "raw": True, "data": 0.1 + 0.5 * TEXELS[:4, :7, 1:2]}
METAL = {"type": "bitmap", "raw": True, "wrap_mode": "mirror", "data": TEXELS[:3, :7, 1:2]}

ROUGH: dict[str, tuple[dict[str, Any], float]] = {
    "plastic": ({"type": "plastic", "diffuse_reflectance": COLOUR}, 2e-4),
    "nonlinear plastic": (
        {"type": "plastic", "diffuse_reflectance": COLOUR, "nonlinear": True, "int_ior": 1.8},
        2e-4,
    ),
    "roughplastic": (
        {"type": "roughplastic", "diffuse_reflectance": COLOUR, "alpha": 0.2, "specular_reflectance": 0.7},
        1e-3,
    ),
    "roughplastic, ggx": ({"type": "roughplastic", "alpha": 0.3, "distribution": "ggx", "nonlinear": True}, 1e-3),
    "pplastic": (
        {"type": "pplastic", "diffuse_reflectance": COLOUR, "alpha": 0.2, "specular_reflectance": 0.7, "int_ior": 1.7},
        2e-4,
    ),
    "pplastic, ggx": ({"type": "pplastic", "distribution": "ggx", "alpha": 0.3}, 2e-4),
    "copper, beckmann": ({"type": "roughconductor", "material": "Cu", "alpha": 0.25}, 2e-4),
    "gold, ggx": ({"type": "roughconductor", "material": "Au", "alpha": 0.15, "distribution": "ggx"}, 2e-4),
    "tinted metal": ({"type": "roughconductor", "material": "Al", "alpha": 0.4, "specular_reflectance": COLOUR}, 2e-4),
    "rough glass": ({"type": "roughdielectric", "alpha": 0.3, "specular_reflectance": 0.7}, 2e-4),
    "metal of one roughness along and across": ({"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.3}, 2e-4),
    "textured metal": (
        {"type": "roughconductor", "material": "Au", "alpha": ROUGHNESS | FINER, "distribution": "ggx"},
        2e-4,
    ),
    "textured and tinted metal, beckmann": (
        {
            "type": "roughconductor",
            "material": "Al",
            "alpha": ROUGHNESS | FINER,
            "specular_reflectance": COLOUR | FINER,
        },
        2e-4,
    ),
    "textured glass": ({"type": "roughdielectric", "alpha": ROUGHNESS | FINER}, 2e-4),
    "principled": ({"type": "principled", "base_color": COLOUR, "roughness": 0.6, "specular": 0.8}, 2e-4),
    "principled metal": ({"type": "principled", "base_color": COLOUR, "roughness": 0.4, "metallic": 0.7}, 2e-4),
    "principled, textured": (
        {
            "type": "principled",
            "base_color": COLOUR | FINER,
            "roughness": ROUGHNESS | FINER,
            "metallic": METAL | FINER | {"wrap_mode": "repeat"},
        },
        2e-4,
    ),
    "principled, textured, one colour": (
        {"type": "principled", "base_color": 0.4, "roughness": 0.5, "metallic": METAL | FINER | {"wrap_mode": "clamp"}},
        2e-4,
    ),
    "brushed metal, ggx": (
        {"type": "roughconductor", "material": "Al", "alpha_u": 0.1, "alpha_v": 0.4, "distribution": "ggx"},
        2e-4,
    ),
    "brushed metal, beckmann": ({"type": "roughconductor", "alpha_u": 0.4, "alpha_v": 0.15}, 2e-4),
    "brushed and tinted metal": (
        {"type": "roughconductor", "alpha_u": 0.2, "alpha_v": 0.5, "specular_reflectance": COLOUR | FINER},
        2e-4,
    ),
    "brushed by textures": (
        {"type": "roughconductor", "alpha_u": ROUGHNESS | FINER, "alpha_v": BRUSHED | FINER, "distribution": "ggx"},
        2e-4,
    ),
    "brushed by one texture": ({"type": "roughconductor", "alpha_u": 0.1, "alpha_v": ROUGHNESS}, 2e-4),
    "brushed glass": ({"type": "roughdielectric", "alpha_u": 0.1, "alpha_v": 0.4}, 2e-4),
    "principled, brushed": (
        {"type": "principled", "base_color": COLOUR, "roughness": 0.5, "metallic": 0.7, "anisotropic": 0.8},
        2e-4,
    ),
    "principled, coated": (
        {"type": "principled", "base_color": COLOUR, "roughness": 0.5, "clearcoat": 0.8, "clearcoat_gloss": 0.3},
        2e-4,
    ),
    "principled, textured and coated": (
        {
            "type": "principled",
            "base_color": COLOUR | FINER,
            "roughness": ROUGHNESS | FINER,
            "metallic": 0.6,
            "clearcoat": 1.0,
            "clearcoat_gloss": 0.9,
        },
        2e-4,
    ),
    "principled, sheen": ({"type": "principled", "base_color": COLOUR, "roughness": 0.6, "sheen": 0.8}, 2e-4),
    "principled, tinted sheen": (
        {
            "type": "principled",
            "base_color": COLOUR | FINER,
            "metallic": METAL | FINER,
            "roughness": 0.6,
            "sheen": 1.0,
            "sheen_tint": 0.7,
        },
        2e-4,
    ),
    "principled, flat": ({"type": "principled", "base_color": COLOUR, "roughness": 0.6, "flatness": 0.7}, 2e-4),
    "principled, sheen on what light passes": (
        {
            "type": "principled",
            "base_color": COLOUR,
            "roughness": 0.6,
            "sheen": 0.8,
            "spec_trans": 0.4,
            "flatness": 1.0,
        },
        2e-4,
    ),
    "principled, tinted": (
        {
            "type": "principled",
            "base_color": COLOUR,
            "roughness": 0.3,
            "metallic": 0.2,
            "spec_tint": 0.6,
            "specular": 0.9,
        },
        2e-4,
    ),
    "principled without highlights": (
        {"type": "principled", "base_color": COLOUR, "metallic": 0.4, "specular": 0.0, "spec_tint": 0.5},
        2e-4,
    ),
    "principled of an index": ({"type": "principled", "roughness": 0.3, "eta": 1.33}, 2e-4),
}


SHEEN = ["principled, sheen", "principled, tinted"]
BRUSHED_METALS = [name for name in ROUGH if "brushed" in name and "texture" not in name]  # their rates are not exact


def scene_of(bsdf: dict[str, Any], integrator: dict[str, Any] = DIRECT, **lights: Any) -> Scene:
    floor = {"type": "rectangle", "to_world": np.diag([3.0, 3.0, 1.0, 1.0]), "bsdf": bsdf}
    parts = {"type": "scene", "integrator": integrator, **lights, "floor": floor}
    return Scene("gloss", lambda: dict(parts))


def native(scene: Scene, rays_per_pixel: int = 2, **settings: Any) -> NativeRenderer:
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=rays_per_pixel, **settings)
    assert isinstance(renderer, NativeRenderer)
    assert "glossy" in renderer.reason
    return renderer


def mitsubas(scene: Scene, rays: int = 2) -> npt.NDArray[np.float32]:
    with variant(FAST) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
    return IntegratorRenderer(loaded, CAMERA, rays_per_pixel=rays, blur=False, seed=0, reason="").luma(VIEWS)


@pytest.mark.few(12)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("lights", [{"lamp": SPOT}, *long_values({"lamp": POINT}, {"sun": SUN})])
@pytest.mark.parametrize(("bsdf", "tolerance"), ROUGH.values(), ids=ROUGH)
def test_sharp_lights_have_mitsubas_closed_form(bsdf: dict[str, Any], tolerance: float, lights: dict[str, Any]) -> None:
    """Highlight and base, pixel by pixel: both renderers follow the same rays, and draw nothing at random."""
    theirs, ours = mitsubas(scene_of(bsdf, **lights)), native(scene_of(bsdf, **lights)).luma(VIEWS)
    np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance * theirs.max() * 0.01)


TURNED = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
SQUARES = {"type": "checkerboard", "color0": 0.15, "color1": 0.5, "to_uv": np.diag([6.0, 4.0, 1.0])}


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "roughconductor", "alpha": SQUARES},
        {"type": "roughdielectric", "alpha": SQUARES},
        {"type": "principled", "roughness": SQUARES, "metallic": 0.7},
        {
            "type": "blendbsdf",
            "weight": SQUARES,
            "first": {"type": "diffuse", "reflectance": 0.1},
            "b": {"type": "diffuse"},
        },
    ],
    ids=["metal", "glass", "principled", "blend"],
)
def test_squares_of_two_numbers_are_mitsubas(bsdf: dict[str, Any]) -> None:
    """All rays but those that meet a ramp, which is 1/128 of a square wide."""
    scene = scene_of(bsdf, lamp=POINT)
    theirs, ours = mitsubas(scene), make_renderer(scene, CAMERA, kind="native", rays_per_pixel=2).luma(VIEWS)
    assert np.mean(np.abs(ours - theirs) > 2e-4 * theirs + 2e-6 * theirs.max()) < 0.1
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize(
    "lamp",
    [{**POINT, "position": [0.4, -0.5, -1.5]}, {**SUN, "direction": [0.3, 0.2, 1.0]}],
    ids=["point", "directional"],
)
@pytest.mark.parametrize("alphas", [{"alpha": 0.3}, {"alpha_u": 0.15, "alpha_v": 0.4}], ids=["even", "brushed"])
def test_light_from_behind_rough_glass_has_mitsubas_closed_form(
    distribution: str, lamp: dict[str, Any], alphas: dict[str, float]
) -> None:
    glass = {"type": "roughdielectric", **alphas, "distribution": distribution, "specular_transmittance": 0.8}
    theirs, ours = mitsubas(scene_of(glass, lamp=lamp)), native(scene_of(glass, lamp=lamp)).luma(VIEWS)
    np.testing.assert_allclose(ours, theirs, rtol=2e-4, atol=2e-4 * theirs.max())
    assert theirs.max() > 10


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("turn", [1.0, -1.0], ids=["front", "back"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["before", "behind"])
@pytest.mark.parametrize(
    "material",
    [
        {"roughness": 0.6, "spec_trans": 0.7, "metallic": 0.3, "clearcoat": 0.8},
        {"roughness": ROUGHNESS | FINER, "metallic": METAL | FINER, "spec_trans": 0.4, "spec_tint": 0.5},
        {"roughness": 0.5, "spec_trans": 1.0, "eta": 1.3, "anisotropic": 0.8},
        {"roughness": 0.5, "spec_trans": 0.6, "metallic": 1.0},
    ],
    ids=["mixed", "textured", "brushed glass", "metal"],
)
def test_a_clear_principled_has_mitsubas_closed_form(material: dict[str, Any], side: float, turn: float) -> None:
    """A part of it lets light pass: seen from both sides, and lit from both."""
    bsdf = {"type": "principled", "base_color": COLOUR | FINER, **material}
    x, y, z = POINT["position"]
    parts = scene_of(bsdf, lamp={**POINT, "position": [x, y, side * z]}).source()
    assert isinstance(parts, dict)
    parts["floor"] = {**parts["floor"], "to_world": np.diag([3.0, 3.0 * turn, turn, 1.0])}
    scene = Scene("clear", lambda: dict(parts))
    theirs, ours = mitsubas(scene), native(scene).luma(VIEWS)
    assert theirs.mean() > 1e-3 or material.get("metallic") == 1.0
    np.testing.assert_allclose(ours, theirs, rtol=3e-4, atol=3e-6 * theirs.max())


@pytest.mark.usefixtures("llvm")
def test_rough_glass_shows_what_is_behind_it() -> None:
    """A ball of rough glass under an even sky neither adds light nor loses much; what is seen through it is blurred."""
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.9, 0.6, 0.3]}}
    glass = {"type": "roughdielectric", "alpha": 0.3, "distribution": "ggx"}
    scene = scene_of(glass, {"type": "path", "max_depth": 4}, sky=sky)
    renderer, theirs = native(scene, bake_error=0.1), mitsubas(scene, 64)
    assert renderer.luma(VIEWS).mean() == pytest.approx(theirs.mean(), rel=0.01)
    assert "solid glass shows is grainy" in renderer.reason


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("size", [0.2, 2.0])
@pytest.mark.parametrize("alpha", [0.1, 0.4])
def test_an_area_light_behind_rough_glass_is_counted_once(alpha: float, size: float) -> None:
    """What its points give and what directions of the lobe find share its light, whichever of the two is better."""
    lamp = {
        "type": "rectangle",
        "to_world": np.array([[size, 0, 0, 0.3], [0, size, 0, 0], [0, 0, 1, -1.5], [0, 0, 0, 1]]),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [4.0, 3.0, 2.0]}},
    }
    glass = {"type": "roughdielectric", "alpha": alpha, "distribution": "ggx"}
    scene = scene_of(glass, {"type": "path", "max_depth": 4}, lamp=lamp)
    ours, theirs = native(scene, rays_per_pixel=64, bake_error=0.1, blur=False).luma(VIEWS), mitsubas(scene, 1024)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.04)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "conductor", "material": "Au"},
        {"type": "conductor", "specular_reflectance": COLOUR},
        {"type": "thindielectric"},
        {"type": "polarizer", "transmittance": {"type": "rgb", "value": [0.2, 0.5, 0.9]}, "polarizing": False},
    ],
    ids=["gold", "tinted mirror", "thin glass", "polarizer"],
)
def test_even_light_is_mirrored_as_by_mitsuba(bsdf: dict[str, Any]) -> None:
    """Under light of one radiance from all sides no path tracer has noise."""
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.9, 0.6, 0.3]}}
    scene = scene_of(bsdf, {"type": "path", "max_depth": 4}, sky=sky)
    renderer = native(scene, bake_error=0.1)
    np.testing.assert_allclose(renderer.luma(VIEWS), mitsubas(scene), rtol=1e-3)
    assert "grainy" not in renderer.reason
    assert ("each polarizer takes" in renderer.reason) == (bsdf["type"] == "polarizer")


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("turned", [False, True])
def test_polarizers_pass_half_of_the_light_straight(turned: bool) -> None:
    """One over the other, from either side, as Mitsuba's path tracer shows them, which has no noise here: what is
    behind is seen there, and lamps throw shadows of them."""
    scale = -0.25 if turned else 0.25
    plates = {
        f"plate_{number}": {
            "type": "rectangle",
            "to_world": np.array([[0.25, 0, 0, at], [0, 0.25, 0, at], [0, 0, scale, 0.5 + at], [0, 0, 0, 1]]),
            "bsdf": {"type": "polarizer", "theta": 90.0 * number, "transmittance": transmittance},
        }
        for number, (at, transmittance) in enumerate([(0.0, 0.8), (0.2, {"type": "rgb", "value": [0.3, 0.6, 1.0]})])
    }
    scene = scene_of({"type": "diffuse", "reflectance": COLOUR}, {"type": "path", "max_depth": 4}, lamp=POINT, **plates)
    renderer = native(scene, bake_error=0.1)
    theirs, ours = mitsubas(scene), renderer.luma(VIEWS)
    np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-3 * theirs.max())
    assert "each polarizer takes half of it, whatever its angle, and throws no shadow" in renderer.reason
    plain = mitsubas(scene_of({"type": "diffuse", "reflectance": COLOUR}, DIRECT, lamp=POINT))
    assert len(np.unique(np.round(ours / plain, 1))) > 3


@pytest.mark.parametrize("shape", [{}, {"light": {"type": "area", "radiance": 2.0}}])
def test_polarizers_that_lamps_shine_through_stay_with_the_integrator(shape: dict[str, Any]) -> None:
    """Mitsuba's volumetric path tracers follow lamps through them, other ones do not."""
    plate = {"type": "rectangle", "bsdf": {"type": "polarizer"}, **shape}
    for integrator in ("path", "volpath"):
        parts = {"type": "scene", "integrator": {"type": integrator}, "lamp": POINT, "film": plate}
        told = "; ".join(map(str, why_not_noise_free(Scene("film", functools.partial(dict, parts)))))
        assert ("shape 'film' has a polarizer surface" in told) == (integrator == "volpath" or bool(shape)), told


RED, BLUE = (
    {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}} for value in ([0.8, 0.2, 0.1], [0, 0, 1])
)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("weight", [0.3, 1.7, METAL | FINER, {**COLOUR, "wrap_mode": "clamp"}])
@pytest.mark.parametrize("two_sided", [False, True])
def test_blends_of_two_colours_are_mitsubas(weight: Any, two_sided: bool) -> None:
    blend: dict[str, Any] = {"type": "blendbsdf", "weight": weight, "first": RED, "second": BLUE}
    scene = scene_of({"type": "twosided", "nested": blend} if two_sided else blend, lamp=POINT)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=2)
    assert "diffuse triangles" in renderer.reason
    theirs = mitsubas(scene)
    np.testing.assert_allclose(renderer.luma(VIEWS), theirs, rtol=2e-4, atol=2e-6 * theirs.max())


def test_blends_that_stay_with_mitsuba() -> None:
    squares, two_sided = {"type": "checkerboard"}, {"type": "twosided", "nested": BLUE}
    tinted = {"type": "rgb", "value": [0.2, 0.5, 0.9]}
    for weight, first, second in (
        ({**squares, "color1": tinted}, RED, {"type": "diffuse", "reflectance": squares}),
        (tinted, RED, BLUE),
        (0.5, RED, {"type": "diffuse", "reflectance": COLOUR}),
        (0.5, RED, two_sided),
        (0.5, RED, {"type": "plastic"}),
        (0.5, RED, {"type": "principled", "spec_trans": 0.3}),
        (0.5, {"type": "bumpmap", "arbitrary": METAL, "nested": RED}, BLUE),
    ):
        scene = scene_of({"type": "blendbsdf", "weight": weight, "first": first, "second": second}, lamp=POINT)
        assert "has a blendbsdf(" in str(why_not_noise_free(scene)[0]), (weight, first, second)


@pytest.mark.parametrize(
    "name", ["roughplastic", "gold, ggx", "principled metal", "principled, coated", *BRUSHED_METALS]
)
def test_rates_are_differences(name: str) -> None:
    """dY/dt along a moving camera, under a lamp and its image."""
    scene = scene_of(ROUGH[name][0], lamp=POINT, sun=SUN)
    renderer, dt = native(scene), 1e-4
    moving = replace(VIEWS, velocities=np.array([[0.3, -0.2, 0.4]]), angular_rates=np.array([[0.2, 0.1, -0.5]]))
    luma, rate = renderer.luma_and_rate(moving)
    np.testing.assert_array_equal(luma, renderer.luma(moving))
    before, after = (renderer.luma(moving.moved(np.array([t]))).astype(np.float64) for t in (-dt, dt))
    np.testing.assert_allclose(rate, (after - before) / (2 * dt), atol=0.01 * np.abs(rate).max())


def brushed_scene(shape: dict[str, Any], bsdf: dict[str, Any], **lights: Any) -> Scene:
    parts = {"type": "scene", "integrator": DIRECT, **lights, "thing": {**shape, "bsdf": bsdf}}
    return Scene("brushed", lambda: dict(parts))


BRUSHED_METAL = {"type": "roughconductor", "alpha_u": 0.08, "alpha_v": 0.4, "distribution": "ggx"}
BUMPS = 0.5 + 0.2 * (np.random.RandomState(5).random_sample((4, 4, 3)) - 0.5) + [0, 0, 0.45]
BUMPY_METAL = {
    "type": "normalmap",
    "normalmap": {"type": "bitmap", "raw": True, "data": BUMPS.astype(np.float32)},
    "nested": BRUSHED_METAL,
    "use_shadowing_function": False,
}
ROLLED = np.array([[0.77, -0.64, 0, 0.1], [0.64, 0.77, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("bsdf", [BRUSHED_METAL, BUMPY_METAL], ids=["smooth", "normal map"])
def test_metal_is_brushed_along_u(bsdf: dict[str, Any]) -> None:
    """Of a sheet that is turned in its plane, and stretched, also under a normal map."""
    scene = brushed_scene({"type": "rectangle", "to_world": ROLLED @ np.diag([3.0, 1.5, 1, 1])}, bsdf, lamp=POINT)
    theirs, ours = mitsubas(scene), native(scene).luma(VIEWS)
    np.testing.assert_allclose(ours, theirs, rtol=5e-4 if bsdf is BRUSHED_METAL else 0.01)


@pytest.mark.usefixtures("llvm")
def test_round_shapes_are_brushed_as_mitsubas() -> None:
    """Triangles stand for a ball; its poles are above and below."""
    on_its_side = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    scene = brushed_scene({"type": "sphere", "radius": 0.9, "to_world": on_its_side}, BRUSHED_METAL, lamp=POINT)
    theirs = mitsubas(scene, 64)
    ours = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=64).luma(VIEWS)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=1e-3)
    assert np.abs(ours - theirs).max() < 3e-3 * theirs.max()


COATED = {"type": "principled", "base_color": 0.02, "specular": 0.0, "clearcoat": 1.0, "clearcoat_gloss": 0.5}
PANEL = {
    "type": "rectangle",
    "to_world": np.array([[0.5, 0, 0, 0.3], [0, -0.3, 0, -0.2], [0, 0, -1, 2.5], [0, 0, 0, 1]]),
    "emitter": {"type": "area", "radiance": 4.0},
}


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("bsdf", [BRUSHED_METAL, COATED], ids=["brushed", "coated"])
def test_lobes_show_a_lamp_as_the_path_tracer_does(bsdf: dict[str, Any]) -> None:
    """Of the coated surface, most light is the coat's."""
    sky = {"type": "constant", "radiance": 0.2}
    scene = scene_of(bsdf, {"type": "path", "max_depth": 3}, panel=PANEL, sky=sky)
    theirs = mitsubas(scene, 1024)
    ours = make_renderer(scene, CAMERA, rays_per_pixel=64, bake_error=0.1).luma(VIEWS)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)
    assert np.sqrt(np.mean((ours / theirs - 1) ** 2)) < 0.04


def test_a_brushed_mesh_without_texture_coordinates_stays_with_the_integrator(tmp_path: Path) -> None:
    (file := tmp_path / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    shape = {"type": "obj", "filename": str(file)}
    (obstacle,) = why_not_noise_free(brushed_scene(shape, BRUSHED_METAL, lamp=POINT))
    assert "is anisotropic, and has no texture coordinates that say along what" in str(obstacle)
    assert not why_not_noise_free(brushed_scene(shape, {"type": "roughconductor", "alpha": 0.2}, lamp=POINT))


def test_two_sides_and_one() -> None:
    """A one-sided metal is black from behind; a two-sided one is not."""
    behind = Views.at_rest([Pose([0.2, -0.4, -1.8], [0.0, 0.0, 0.0, 1.0])])
    lamp = {**POINT, "position": [0.4, -0.5, -2.5]}
    metal = {"type": "roughconductor", "alpha": 0.5}
    assert not native(scene_of(metal, lamp=lamp)).luma(behind).any()
    assert native(scene_of({"type": "twosided", "nested": metal}, lamp=lamp)).luma(behind).all()


def test_what_finishes_do_not_have_stays_with_the_integrator() -> None:
    squares = {"type": "checkerboard"}
    unknown = [
        {"type": "principled", "spec_trans": ROUGHNESS},
        {"type": "principled", "spec_trans": 1.0, "sheen": 0.5},
        {"type": "principled", "flatness": squares},
        {"type": "principled", "flatness": 1.1},
        {"type": "principled", "eta": 0.8},
        {"type": "principled", "spec_tint": ROUGHNESS},
        {"type": "principled", "sheen": ROUGHNESS},
        {"type": "principled", "sheen": 0.5, "sheen_tint": ROUGHNESS},
        {"type": "principled", "clearcoat": ROUGHNESS},
        {"type": "principled", "clearcoat": 1.2},
        {"type": "principled", "clearcoat": 0.5, "clearcoat_gloss": ROUGHNESS},
        {"type": "principled", "roughness": {"type": "checkerboard", "color1": 1.2}},
        {"type": "principled", "roughness": {"type": "checkerboard", "color1": ROUGHNESS}},
        {"type": "principled", "base_color": COLOUR, "metallic": {**METAL, "to_uv": np.diag([2.0, 2.0, 1.0])}},
        {"type": "principled", "base_color": squares, "metallic": METAL},
        {"type": "principled", "roughness": {**ROUGHNESS, "filter_type": "nearest"}},
        {"type": "principled", "roughness": {**ROUGHNESS, "data": 1.2 * TEXELS[..., :1]}},
        {"type": "roughconductor", "alpha": {**ROUGHNESS, "filter_type": "nearest"}},
        {"type": "roughconductor", "alpha": ROUGHNESS, "specular_reflectance": COLOUR | FINER},
        {"type": "plastic", "specular_reflectance": squares},
        {"type": "dielectric", "specular_transmittance": squares},
        {"type": "roughdielectric", "alpha": {**ROUGHNESS, "data": 1.2 * TEXELS[..., :1]}},
        {"type": "roughconductor", "alpha_u": ROUGHNESS, "alpha_v": BRUSHED | FINER},
        {"type": "roughconductor", "alpha_u": 0.1, "alpha_v": ROUGHNESS | {"to_uv": TURNED}},
        {"type": "roughconductor", "alpha_u": 0.1, "alpha_v": 0.2, "specular_reflectance": COLOUR | {"to_uv": TURNED}},
        {"type": "principled", "anisotropic": 0.5, "roughness": ROUGHNESS},
        {"type": "principled", "anisotropic": ROUGHNESS},
        {"type": "principled", "anisotropic": 1.2},
        {"type": "roughdielectric", "specular_transmittance": squares},
        {"type": "polarizer", "transmittance": squares},
        {"type": "pplastic", "alpha": ROUGHNESS},
        {"type": "pplastic", "alpha_u": 0.1, "alpha_v": 0.3},
        {"type": "pplastic", "int_ior": 1.0, "ext_ior": 1.5},
        {"type": "pplastic", "specular_reflectance": squares},
    ]
    with variant(SCALAR) as (mi, _):
        for bsdf in unknown:
            scene = load_scene_source({"type": "scene", "floor": {"type": "rectangle", "bsdf": bsdf}}, mi)
            (made,) = (shape.bsdf() for shape in scene.shapes())
            assert read_finish(made, children(made), mi) is None, bsdf


def test_two_sides_of_one_finish_are_one() -> None:
    with variant(SCALAR) as (mi, _):
        same = {"type": "twosided", "a": {"type": "plastic"}, "b": {"type": "plastic"}}
        other = {"type": "twosided", "a": {"type": "plastic"}, "b": {"type": "plastic", "int_ior": 1.7}}
        for bsdf, finishes in ((same, 1), (other, 0)):
            scene = mi.load_dict({"type": "scene", "floor": {"type": "rectangle", "bsdf": bsdf}})
            assert len(simplify_materials(scene, mi, matte=False, glossy=True).finishes) == finishes


@pytest.mark.parametrize(
    ("bsdf", "name"),
    [
        ({"type": "plastic", "nonlinear": True}, "plastic"),
        ({"type": "roughplastic", "alpha": 0.05}, "roughplastic"),
        ({"type": "pplastic", "alpha": 0.3}, "pplastic"),
        ({"type": "conductor", "material": "Cu"}, "conductor"),
        ({"type": "principled", "metallic": 1.0, "roughness": 0.2}, "metal"),
        ({"type": "principled", "roughness": 0.7}, "principled"),
        ({"type": "principled", "roughness": 0.7, "flatness": 0.9}, "principled"),
        ({"type": "principled", "metallic": 1.0, "roughness": 0.8}, "metal"),
        (
            {"type": "principled", "clearcoat": 1.0, "base_color": 0.01, "clearcoat_gloss": 0.5, "specular": 0.0},
            "coat",
        ),
        ({"type": "principled", "sheen": 1.0, "base_color": 0.01, "specular": 0.0}, "sheen"),
        ({"type": "roughconductor", "material": "Au", "alpha": 0.4}, "conductor"),
    ],
)
def test_the_albedo_of_bakes_is_mitsubas(bsdf: dict[str, Any], name: str) -> None:
    """What is reflected of light from all sides, as the mean over the directions that Mitsuba samples."""
    with variant(SCALAR) as (mi, _):
        made = mi.load_dict(bsdf)
        read = read_finish(made, children(made), mi)
        assert read is not None
        base = np.full((1, 3), {"conductor": 1.0, "coat": 0.01, "sheen": 0.01}.get(name, 0.5))
        ours = read[1].albedo(base)[0]
        draws = np.random.RandomState(0).random_sample((4000, 4))
        sums = np.zeros(3)
        for first, *rest in draws.tolist():
            interaction = mi.SurfaceInteraction3f()
            cosine = np.sqrt(first)
            interaction.wi = mi.Vector3f(float(np.sqrt(1 - first)), 0.0, float(cosine))
            _, weight = made.sample(mi.BSDFContext(), interaction, rest[0], mi.Point2f(rest[1], rest[2]))
            sums += np.array(weight, np.float64)
    np.testing.assert_allclose(ours, sums / len(draws), rtol=0.03)


def test_fresnels_equations() -> None:
    """At normal incidence ((n - 1) / (n + 1))^2, at grazing incidence all, at Brewster's angle no parallel part."""
    assert dielectric(np.ones(1), 1.5)[0] == pytest.approx(0.04)
    assert dielectric(np.zeros(1), 1.5)[0] == pytest.approx(1.0)
    brewster = np.cos(np.arctan(1.5))
    assert dielectric(np.array([brewster]), 1.5)[0] == pytest.approx(0.5 * ((1.5**2 - 1) / (1.5**2 + 1)) ** 2)
    assert dielectric(np.array([0.6]), 1 / 1.5)[0] == 1.0  # total reflection
    assert not Finish(0.0, "ggx", ("dielectric", (1.5,)), under=("solid", (1.5,))).albedo(np.ones((2, 3))).any()


def test_bakes_know_textures_of_roughness_by_their_texels() -> None:
    """Light that was baked for one is not taken for another of the same size and mean."""
    digests = set()
    for values in np.array([[[0.2, 0.4]], [[0.4, 0.2]]], np.float32):
        texels = NumberTexels(1, 2, 0, values.tobytes())
        finish = Finish(0.09, "ggx", ("mixed", (1.5, 0.5, 0.0)), under=("rough", (0.3, 0.5)), lobe=(texels, None))
        digests.add(GlossTable([finish], np.zeros(1, np.uint32), 12).digest)
    assert len(digests) == 2


@pytest.mark.parametrize(
    ("bsdf", "pixel", "rays"), [({"type": "plastic"}, "rays", 128), ({"type": "diffuse"}, "lines", 32)]
)
def test_glossy_surfaces_take_more_rays_where_none_are_given(bsdf: dict[str, Any], pixel: str, rays: int) -> None:
    scene = replace(scene_of(bsdf, lamp=POINT), camera=CAMERA).with_trajectory(slider(POSE, 0.1, 0.1))
    assert (Simulator(scene).renderer.pixel, Simulator(scene).renderer.rays_per_pixel) == (pixel, rays)
    asked = Simulator(scene, rays_per_pixel=8).renderer
    assert (asked.pixel, asked.rays_per_pixel) == ("rays", 8)
