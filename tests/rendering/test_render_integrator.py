"""Mitsuba's integrators on our rays, in the LLVM and in the scalar variant."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer

OTHER = "llvm_ad_spectral"
"""A variant that differentiates, too."""

BT601 = np.array([0.299, 0.587, 0.114])
CAMERA = Camera(21, 15, 20.0, 23.0, 9.2, 7.9, k1=-0.2, k2=0.05, p1=0.004, p2=-0.006)
# Looks at the origin, rolled by 0.4 rad: a skew rotation, unlike its transpose.
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 0.9, 0.2]}}
ALBEDO = (0.8, 0.5, 0.1)
WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(ALBEDO)}}
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
TEXTURED = {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "data": TEXELS}}
FLOOR = {"type": "rectangle", "to_world": np.diag([4.0, 4.0, 1.0, 1.0]), "bsdf": WHITE}
BALL = {"type": "sphere", "center": [0.2, 0.1, 0.6], "radius": 0.3, "bsdf": TEXTURED}

VARIANTS = pytest.mark.parametrize("name", [FAST, SCALAR])


def make_scene(integrator: dict[str, Any] | None = DIRECT, /, **parts: dict[str, Any]) -> Scene:
    asked = {} if integrator is None else {"integrator": integrator}
    return Scene("test", partial(dict, {"type": "scene", **asked, **parts}))


def build(
    name: str,
    scene: Scene,
    request: pytest.FixtureRequest,
    *,
    rays_per_pixel: int = 1,
    seed: int = 0,
    camera: Camera = CAMERA,
) -> Renderer:
    """The integrator renderer of a variant, whichever variant this machine would choose."""
    if name == FAST:
        request.getfixturevalue("llvm")
    with variant(name) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
    kind = IntegratorRenderer if name == FAST else ScalarRenderer
    return kind(loaded, camera, rays_per_pixel=rays_per_pixel, blur=False, seed=seed, reason="")


@VARIANTS
def test_lamberts_law_by_hand(name: str, request: pytest.FixtureRequest) -> None:
    """BT.601 luma of a coloured light on a coloured floor, for each pixel's own distorted ray, worked out by hand."""
    luma = build(name, make_scene(lamp=LAMP, floor=FLOOR), request).luma(Views.at_rest([POSE]))[0]
    rows, columns = np.indices((15, 21))
    rays = np.concatenate([CAMERA.rays(np.stack([columns, rows], -1)), np.ones((15, 21, 1))], -1) @ POSE.rotation.T
    ground = POSE.position - rays * (POSE.position[2] / rays[..., 2:])
    assert (np.abs(ground) < 4).all()
    to_lamp = np.array(LAMP["position"]) - ground
    distance = np.linalg.norm(to_lamp, axis=-1)
    colour = BT601 @ (np.array([9.0, 20.0, 4.0]) * ALBEDO)
    assert luma.dtype == np.float32
    np.testing.assert_allclose(luma, colour / np.pi * to_lamp[..., 2] / distance**3, rtol=1e-5)


@VARIANTS
def test_rays_that_hit_nothing_see_the_background(name: str, request: pytest.FixtureRequest) -> None:
    """A pixel off all surfaces has the luma of the constant light; without one it is black; its depth is inf."""
    up = Pose([0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0])
    lit = build(name, make_scene(sky=SKY, floor=FLOOR), request)
    np.testing.assert_allclose(lit.luma(Views.at_rest([up])), BT601 @ (0.5, 0.9, 0.2), rtol=1e-6)
    assert (build(name, make_scene(lamp=LAMP, floor=FLOOR), request).luma(Views.at_rest([up])) == 0).all()
    assert np.isposinf(lit.depth(Views.at_rest([up]))).all()


@pytest.mark.usefixtures("llvm")
def test_all_renderers_agree_without_noise(request: pytest.FixtureRequest) -> None:
    """Table kernel, LLVM and scalar integrator average the same lattice rays of the same lens: equal to 1e-5."""
    parts = {"lamp": LAMP, "floor": {**FLOOR, "bsdf": TEXTURED}}
    scene = make_scene(**parts)
    poses = [POSE, Pose(np.add(POSE.position, (0.2, 0.1, 0.0)), POSE.quaternion)]
    fast, scalar = (build(name, scene, request, rays_per_pixel=3).luma(Views.at_rest(poses)) for name in (FAST, SCALAR))
    table = make_renderer(scene, CAMERA, rays_per_pixel=3, kind="table").luma(Views.at_rest(poses))
    assert fast.shape == (2, 15, 21)
    assert fast.std() > 0.1 * fast.max()
    np.testing.assert_allclose(scalar, fast, rtol=0, atol=1e-5 * fast.max())
    np.testing.assert_allclose(table, fast, rtol=0, atol=1e-5 * fast.max())


@VARIANTS
def test_depth_of_a_sphere_is_z(name: str, request: pytest.FixtureRequest) -> None:
    """Depth along the optical axis of a sphere's near side from the quadratic formula, inf around it."""
    depth = build(name, make_scene(lamp=LAMP, ball=BALL), request).depth(Views.at_rest([POSE, POSE]))
    rows, columns = np.indices((15, 21))
    rays = np.concatenate([CAMERA.rays(np.stack([columns, rows], -1)), np.ones((15, 21, 1))], -1) @ POSE.rotation.T
    offset = POSE.position - np.array([0.2, 0.1, 0.6])
    a, b, c = (rays**2).sum(-1), rays @ offset, offset @ offset - 0.3**2
    with np.errstate(invalid="ignore"):
        expected = np.nan_to_num((-b - np.sqrt(b**2 - a * c)) / a, nan=np.inf)
    assert 0.05 < np.isfinite(expected).mean() < 0.5
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, np.stack([expected] * 2), rtol=2e-5)


@VARIANTS
def test_a_still_camera_sees_the_same_bits(name: str, request: pytest.FixtureRequest) -> None:
    """Under noisy light a pose has the same bits in every frame, batch and renderer of one seed; others differ."""
    scene = make_scene({"type": "path", "max_depth": 3}, sky=SKY, floor=FLOOR, ball=BALL)
    renderer = build(name, scene, request, rays_per_pixel=2)
    other_pose = Pose(np.add(POSE.position, (0.1, 0.0, 0.0)), POSE.quaternion)
    frames = renderer.luma(Views.at_rest([POSE, other_pose, POSE]))
    assert np.array_equal(frames[0], frames[2])
    assert not np.array_equal(frames[0], frames[1])
    assert np.array_equal(renderer.luma(Views.at_rest([POSE]))[0], frames[0])
    assert np.array_equal(build(name, scene, request, rays_per_pixel=2).luma(Views.at_rest([POSE]))[0], frames[0])
    reseeded = build(name, scene, request, rays_per_pixel=2, seed=1000).luma(Views.at_rest([POSE]))[0]
    assert not np.array_equal(reseeded, frames[0])
    assert reseeded.mean() == pytest.approx(frames[0].mean(), rel=0.1)


@VARIANTS
def test_the_scenes_own_integrator_renders(name: str, request: pytest.FixtureRequest) -> None:
    """A mirror shows the ceiling only to an integrator that follows paths; one that is not named is path tracing."""
    mirror = {**FLOOR, "bsdf": {"type": "conductor"}}
    ceiling = {**FLOOR, "to_world": np.array([[9.0, 0, 0, 0], [0, -9.0, 0, 0], [0, 0, -1, 4.0], [0, 0, 0, 1]])}
    parts = {"lamp": LAMP, "mirror": mirror, "ceiling": ceiling}
    direct, path = (build(name, make_scene({"type": kind}, **parts), request) for kind in ("direct", "path"))
    unnamed = build(name, make_scene(None, **parts), request)
    assert "DirectIntegrator" in direct.name
    assert "PathIntegrator" in path.name
    assert unnamed.name == path.name
    # Direct light alone: the mirror reflects no lamp, and shows no ceiling.
    assert (direct.luma(Views.at_rest([POSE])) == 0).all()
    assert (path.luma(Views.at_rest([POSE])) > 0).all()


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("integrator", ["ptracer", "prb", "direct_projective"])
def test_integrators_that_follow_no_single_ray_are_refused(integrator: str) -> None:
    """A particle tracer, or an integrator made for derivatives, raises ValueError that names one that works."""
    scene = make_scene({"type": integrator}, lamp=LAMP, floor=FLOOR)
    with pytest.raises(ValueError, match=r"cannot follow single rays; name one that can .*path"):
        make_renderer(scene, CAMERA)


@pytest.mark.usefixtures("llvm")
def test_the_callers_variant_stays_in_force() -> None:
    """Building, rendering and failing under our variant leaves the caller's own set_variant as it was."""
    import mitsuba as mi

    scene = make_scene(lamp=LAMP, floor=FLOOR)
    for own in ("scalar_spectral", "llvm_ad_rgb"):
        mi.set_variant(own)
        for kind in ("table", "integrator"):
            renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind=kind)
            assert mi.variant() == own
            renderer.luma(Views.at_rest([POSE]))
            assert mi.variant() == own
        with pytest.raises(ValueError, match="table kernel"):
            make_renderer(make_scene(lamp=LAMP, ball={**BALL, "bsdf": {"type": "conductor"}}), CAMERA, kind="table")
        assert mi.variant() == own


@pytest.mark.usefixtures("llvm")
def test_a_change_of_the_variant_warns_of_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """However often it is changed: Dr.Jit counts what Mitsuba decorates anew where it is one that differentiates."""
    from drjit import ast

    monkeypatch.setattr(ast, "_syntax_counter", 10_000)
    with variant(OTHER), variant(FAST):
        pass
    assert ast._syntax_counter > 10_000


@pytest.mark.usefixtures("llvm")
def test_integrators_are_loaded_again_only_for_another_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    """That takes 0.2 s: after the scalar variant the fast one's are still there, after another one's they are not."""
    from drjit import ast

    def integrator() -> type:
        return type(mi.load_dict({"type": "prb"}))

    with variant(FAST) as (mi, _):
        fast = integrator()
        monkeypatch.setattr(ast, "_syntax_counter", 0)
        with variant(SCALAR):
            pass
        assert integrator() is fast
        assert ast._syntax_counter == 0
        monkeypatch.undo()
        with variant(OTHER):
            other = integrator()
            assert issubclass(other, sys.modules[f"mitsuba.{OTHER}"].CppADIntegrator)
        assert issubclass(integrator(), sys.modules[f"mitsuba.{FAST}"].CppADIntegrator)
        assert integrator() is not fast
        assert mi.ad.integrators.common.ADIntegrator


WITHOUT_LLVM = """
import numpy as np
from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import versions
from davis_rs.render.choice import make_renderer
from davis_rs.geometry.trajectory.views import Views

# Grey like diffuse 0.5, of a material that the integrator alone renders.
grey = {
    "type": "principled",
    "base_color": {"type": "rgb", "value": 0.5},
    "specular": 0.0,
    "roughness": 1.0,
    "flatness": {"type": "checkerboard", "color0": 1e-6, "color1": 1e-6},
}
floor = {"type": "rectangle", "bsdf": grey}
light = {"type": "point", "position": [0.0, 0.0, 2.0], "intensity": 1.0}
scene = Scene("floor", lambda: {"type": "scene", "light": light, "floor": floor})
renderer = make_renderer(scene, Camera(9, 7, 9.0, 9.0, 4.0, 3.0))
pose = Pose([0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])
luma, depth = renderer.luma(Views.at_rest([pose])), renderer.depth(Views.at_rest([pose]))
assert abs(luma[0, 3, 4] - 0.5 / np.pi / 4) < 1e-3, luma
assert np.allclose(depth, 1.0), depth
try:
    make_renderer(scene, Camera(9, 7, 9.0, 9.0, 4.0, 3.0), kind="table")
except ValueError as error:
    print(error)
print(renderer.name, renderer.variant, renderer.rays_per_pixel, versions(renderer.variant)["variant"], sep="|")
print(renderer.reason)
"""


def test_without_llvm_it_renders_and_says_how_to_get_it(run_python: Callable[..., str]) -> None:
    """With no LLVM the scalar variant renders 2 rays a pixel; the reason says what to install; table is refused."""
    refusal, chosen, reason = run_python(WITHOUT_LLVM, DRJIT_LIBLLVM_PATH="/nonexistent").splitlines()
    assert chosen == "Mitsuba's PathIntegrator, scalar|scalar_rgb|2|scalar_rgb"
    assert refusal.startswith("the table kernel needs Mitsuba's llvm_ad_rgb variant: no usable LLVM (>= 17) was found")
    for text in (refusal, reason):
        assert "slow scalar variant" in text
        assert "apt-get install libllvm19" in text
        assert "DRJIT_LIBLLVM_PATH" in text
