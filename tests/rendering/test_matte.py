"""Materials that are diffuse in fact are rendered as such; others are on the user's wish, by name."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer

CAMERA = Camera(16, 12, 16.0, 16.0, 7.5, 5.5)
POSE = Pose([0.2, -0.4, 1.8], [1.0, 0.0, 0.0, 0.0])
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": 9.0}
TEXELS = np.random.RandomState(3).random_sample((5, 8, 3)).astype(np.float32)
COLOUR = {"type": "bitmap", "raw": True, "data": TEXELS}
MATTE = {"type": "diffuse", "reflectance": COLOUR}
FLAT = {"type": "bitmap", "raw": True, "data": np.full((2, 2, 1), 0.5, np.float32)}
BUMPY = {"type": "bitmap", "raw": True, "data": TEXELS[..., :1].copy()}
FLAT_NORMALS = {"type": "bitmap", "raw": True, "data": np.tile(np.array([0.5, 0.5, 1.0], np.float32), (2, 2, 1))}


def scene_of(bsdf: dict[str, Any], **settings: Any) -> Scene:
    floor = {"type": "rectangle", "to_world": np.diag([3.0, 3.0, 1.0, 1.0]), "bsdf": bsdf}
    parts = {"type": "scene", "integrator": DIRECT, "lamp": LAMP, "floor": floor}
    return replace(Scene("matte", lambda: dict(parts)), **settings)


def luma(scene: Scene, kind: str = "auto") -> Any:
    return make_renderer(scene, CAMERA, rays_per_pixel=2, kind=kind).luma(Views.at_rest([POSE]))


DIFFUSE_IN_FACT = {
    "two-sided": {"type": "twosided", "nested": MATTE},
    "opaque mask": {"type": "mask", "opacity": 1.0, "nested": MATTE},
    "two sides in a mask": {"type": "mask", "opacity": 1.0, "nested": {"type": "twosided", "nested": MATTE}},
    "all of one": {"type": "blendbsdf", "weight": 1.0, "a": {"type": "conductor"}, "b": MATTE},
    "flat bumps": {"type": "bumpmap", "map": FLAT, "nested": MATTE},
    "flat normals": {"type": "normalmap", "normalmap": FLAT_NORMALS, "nested": MATTE},
}


@pytest.mark.parametrize("bsdf", DIFFUSE_IN_FACT.values(), ids=DIFFUSE_IN_FACT)
def test_what_is_diffuse_in_fact_is_rendered_as_such(bsdf: dict[str, Any]) -> None:
    """The native renderer takes it, with the luma of the plain material; nothing is told as replaced."""
    renderer = make_renderer(scene_of(bsdf), CAMERA, rays_per_pixel=2)
    assert "native" in renderer.name
    assert "matte" not in renderer.reason
    np.testing.assert_array_equal(renderer.luma(Views.at_rest([POSE])), luma(scene_of(MATTE)))


@pytest.mark.few(3)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("bsdf", DIFFUSE_IN_FACT.values(), ids=DIFFUSE_IN_FACT)
def test_mitsuba_agrees_that_it_is(bsdf: dict[str, Any]) -> None:
    """Mitsuba's own luma of the material as the scene has it, next to that of the native renderer."""
    with variant("llvm_ad_rgb") as (mi, _):
        from davis_rs._mitsuba.variants import load_scene_source
        from davis_rs.render.integrator.renderer import IntegratorRenderer

        loaded = load_scene_source(scene_of(bsdf).source(), mi)
    theirs = IntegratorRenderer(loaded, CAMERA, rays_per_pixel=2, blur=False, seed=0, reason="")
    np.testing.assert_allclose(theirs.luma(Views.at_rest([POSE])), luma(scene_of(bsdf)), rtol=2e-4)


WITH_A_COLOUR = {
    "principled": ({"type": "principled", "base_color": COLOUR, "roughness": 0.4, "metallic": 0.7}, "principled"),
    "varnished": ({"type": "principled", "base_color": COLOUR, "flatness": {"type": "checkerboard"}}, "principled"),
    "plastic": ({"type": "plastic", "diffuse_reflectance": COLOUR}, "plastic"),
    "roughplastic": ({"type": "roughplastic", "diffuse_reflectance": COLOUR}, "roughplastic"),
    "pplastic": ({"type": "pplastic", "diffuse_reflectance": COLOUR}, "pplastic"),
    "bumps": ({"type": "bumpmap", "map": BUMPY, "nested": MATTE}, "bumpmap"),
    "bumps on plastic": (
        {"type": "bumpmap", "map": BUMPY, "nested": {"type": "plastic", "diffuse_reflectance": COLOUR}},
        "bumpmap, plastic",
    ),
}


@pytest.mark.few(3)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(("bsdf", "plugins"), WITH_A_COLOUR.values(), ids=WITH_A_COLOUR)
def test_what_has_a_diffuse_colour_is_matte_on_wish(bsdf: dict[str, Any], plugins: str) -> None:
    """Without ``matte`` it is glossy or bumpy, or the integrator renders it and the line offers matte.

    With it the colour alone is rendered.
    """
    shiny = {"type": "twosided", "id": "varnish", "nested": bsdf}
    before = make_renderer(scene_of(shiny), CAMERA, rays_per_pixel=2)
    if "flatness" in bsdf:
        assert "Mitsuba's" in before.name
        kind = re.escape(plugins.split(", ")[0])
        ways = r"--matte \(matte=True\) takes its diffuse colour alone, or set its flatness to 0, or give it a diffuse"
        assert re.search(
            rf"material 'varnish' has a twosided\({kind}.*\) surface, not a diffuse one: {ways}", before.reason
        )
    else:
        assert before.reason.startswith("diffuse triangles" if plugins == "bumpmap" else "diffuse and glossy triangles")
    after = make_renderer(scene_of(shiny, matte=True), CAMERA, rays_per_pixel=2)
    assert "native" in after.name
    assert after.reason.endswith(f"; taken as diffuse: varnish ({plugins})")
    np.testing.assert_array_equal(after.luma(Views.at_rest([POSE])), luma(scene_of(MATTE)))
    theirs = luma(scene_of(shiny, matte=True), "integrator")
    np.testing.assert_allclose(theirs, luma(scene_of(MATTE)), rtol=2e-4)


NOT_MATTE = {
    "metal": {"type": "roughconductor"},
    "glass": {"type": "dielectric"},
    "half a mask": {"type": "mask", "opacity": 0.5, "nested": MATTE},
    "clear principled": {"type": "principled", "base_color": COLOUR, "spec_trans": 0.5},
    "two different sides, one of plastic": {
        "type": "twosided",
        "a": {"type": "plastic", "diffuse_reflectance": COLOUR},
        "b": {"type": "diffuse", "reflectance": 0.2},
    },
    "two different sides": {"type": "twosided", "a": MATTE, "b": {"type": "diffuse", "reflectance": 0.2}},
}


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("bsdf", NOT_MATTE.values(), ids=NOT_MATTE)
def test_what_has_no_diffuse_colour_stays(bsdf: dict[str, Any]) -> None:
    """Metal, glass and what light goes through are neither recognised nor replaced, and no line says so."""
    renderer = make_renderer(scene_of(bsdf, matte=True), CAMERA, rays_per_pixel=1)
    assert ("Mitsuba's" in renderer.name) == (bsdf["type"] == "twosided")
    assert "taken as diffuse: nothing" in renderer.reason


def test_principled_is_never_diffuse_by_itself() -> None:
    """Even without highlights it depends on both directions: recognising it as diffuse would be wrong by this much."""
    with variant(SCALAR) as (mi, _):
        bsdf = mi.load_dict({"type": "principled", "specular": 0.0, "metallic": 0.0, "roughness": 0.5})
        context, at = mi.BSDFContext(), mi.SurfaceInteraction3f()
        at.wi = mi.Vector3f(0.8, 0.0, 0.6)
        straight, back = (bsdf.eval(context, at, mi.Vector3f(x, 0.0, 0.6))[0] for x in (-0.8, 0.8))
    assert abs(straight / back - 1) > 0.005


def test_many_names_are_shortened() -> None:
    from davis_rs.render.obstacles import listed

    assert listed("abc") == "a, b, c"
    assert listed("abcdefgh") == "a, b, c, d, e, f and 2 more"
