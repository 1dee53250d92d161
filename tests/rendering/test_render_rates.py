"""Rates of luma and optical flow: what a renderer knows about the motion at an instant."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.events.luma import blur_3x3
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer
from long_form import long_values

FloatArray = npt.NDArray[np.float64]

PLAIN = Camera(32, 24, 28.0, 28.0, 14.2, 12.9)
LENS = Camera(32, 24, 28.0, 33.0, 14.2, 12.9, k1=-0.2, k2=0.05, p1=0.004, p2=-0.006)
# Looks at the origin, rolled by 0.4 rad: a skew rotation, unlike its transpose.
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SUN = {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": 3.0}
SKY = {"type": "constant", "radiance": 0.7}

MOTIONS = {
    "translation": ((0.3, 0.2, -0.15), (0.0, 0.0, 0.0)),
    "rotation": ((0.0, 0.0, 0.0), (0.2, -0.3, 0.4)),
    "both": ((0.2, -0.25, 0.1), (-0.3, 0.1, 0.2)),
}


def moving(velocity: npt.ArrayLike, angular_rate: npt.ArrayLike, pose: Pose = POSE, n: int = 1) -> Views:
    """Cameras at one pose with one twist."""
    still = Views.at_rest([pose] * n)
    twist = [np.tile(np.asarray(part, np.float64), (n, 1)) for part in (velocity, angular_rate)]
    return Views(still.t_s, still.positions, still.rotations, *twist)


def diffuse(texels: Any = TEXELS, scale: float = 1.0, **settings: Any) -> dict[str, Any]:
    to_uv = np.diag([scale, scale, 1.0])
    bitmap = {"type": "bitmap", "raw": True, "data": texels, "to_uv": to_uv, **settings}
    return {"type": "twosided", "inner": {"type": "diffuse", "reflectance": bitmap}}


def floor(half: float = 4.0, **settings: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": np.diag([half, half, 1.0, 1.0]), "bsdf": diffuse(**settings)}


def box(size: float, centre: tuple[float, float, float], bsdf: dict[str, Any]) -> dict[str, Any]:
    to_world = np.diag([size, size, size, 1.0])
    to_world[:3, 3] = centre
    return {"type": "cube", "to_world": to_world, "bsdf": bsdf}


def write_ball(path: Path) -> None:
    """A coarse sphere about the origin with vertex normals, as OBJ."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 13))
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    number = np.arange(1, polar.size + 1).reshape(polar.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    lines = [f"{kind} {x} {y} {z}" for kind in ("v", "vn") for x, y, z in points.reshape(-1, 3).tolist()]
    lines += [f"vt {u} {v}" for u, v in np.stack([around, polar], -1).reshape(-1, 2).tolist()]
    lines += [f"f {i}/{i}/{i} {j}/{j}/{j} {k}/{k}/{k}" for i, j, k in np.concatenate(faces).tolist()]
    path.write_text("\n".join(lines) + "\n")


SCENES: dict[str, dict[str, dict[str, Any]]] = {
    "point light": {"lamp": LAMP, "floor": floor()},
    "directional and constant light": {"sun": SUN, "sky": SKY, "floor": floor()},
    "textures of three wrap modes": {
        "lamp": LAMP,
        "sun": SUN,
        "floor": floor(wrap_mode="mirror", scale=3.0),
        "box": box(0.3, (0.2, 0.1, 0.3), diffuse(scale=-1.3)),
        "other": box(0.2, (-0.4, -0.2, 0.4), diffuse(TEXELS[::-1].copy(), wrap_mode="clamp", scale=0.7)),
    },
    "smooth normals": {"lamp": LAMP, "sun": SUN, "sky": SKY, "ball": {"type": "obj", "bsdf": diffuse()}},
}


TABLES = pytest.mark.parametrize("kind", ["native", *long_values("table")])


def build(name: str, tmp_path: Path, *, camera: Camera = PLAIN, **settings: Any) -> Renderer:
    parts = {key: dict(part) for key, part in SCENES[name].items()}
    if "ball" in parts:
        write_ball(tmp_path / "ball.obj")
        parts["ball"]["filename"] = str(tmp_path / "ball.obj")
    scene = Scene("test", partial(dict, {"type": "scene", "by": DIRECT, **parts}))
    return make_renderer(scene, camera, **{"rays_per_pixel": 1, "kind": "table", **settings})


def differences(renderer: Renderer, views: Views, step_s: float) -> tuple[FloatArray, FloatArray]:
    """(central difference of luma, where the differences to both sides agree: no edge passes within the step)."""
    before, now, after = (
        renderer.luma(views.moved(np.full(len(views), t))).astype(np.float64) for t in (-step_s, 0, step_s)
    )
    central = (after - before) / (2 * step_s)
    return central, np.abs(after - 2 * now + before) / step_s < 0.05 * np.abs(central).std()


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("camera", [PLAIN, LENS])
@pytest.mark.parametrize("motion", MOTIONS)
@TABLES
def test_rate_of_a_textured_floor_by_hand(kind: str, motion: str, camera: Camera, tmp_path: Path) -> None:
    """The rate is the derivative of Lambert's law on a bilinear texture, worked out in float64 for each pixel's ray."""
    views = moving(*MOTIONS[motion])
    rays = camera.rays(np.stack(np.meshgrid(np.arange(32), np.arange(24)), -1))
    rays = np.concatenate([rays, np.ones((24, 32, 1))], -1)
    texels = np.pad(TEXELS.astype(np.float64), ((1, 1), (1, 1), (0, 0)), mode="wrap") @ (
        np.array([0.299, 0.587, 0.114]) * (9.0, 20.0, 4.0) / np.pi
    )

    def luma(t_s: float) -> tuple[FloatArray, FloatArray]:
        view = views.moved([t_s])
        directions = rays @ view.rotations[0].T
        ground = view.positions[0] - directions * (view.positions[0][2] / directions[..., 2:])
        x, y = ((ground[..., i] / 8 + 0.5) * n - 0.5 for i, n in ((0, 16), (1, 9)))
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = x - i, y - j
        corner = [[texels[j + 1 + dj, i + 1 + di] for di in (0, 1)] for dj in (0, 1)]
        top, below = (left * (1 - fx) + right * fx for left, right in corner)
        to_lamp = np.array(LAMP["position"]) - ground
        reflected = top * (1 - fy) + below * fy
        return reflected * to_lamp[..., 2] / np.linalg.norm(to_lamp, axis=-1) ** 3, np.minimum(
            fx * (1 - fx), fy * (1 - fy)
        )

    now, from_texel = luma(0.0)
    expected = (luma(1e-6)[0] - luma(-1e-6)[0]) / 2e-6
    frames, rates = build("point light", tmp_path, camera=camera, kind=kind).luma_and_rate(views)
    np.testing.assert_allclose(frames[0], now, rtol=2e-5)
    # At a texel's centre line the slope of a bilinear texture jumps, and float32 may see either side.
    inside = from_texel > 1e-4
    assert inside.mean() > 0.95
    assert np.abs(expected).std() > 0.01
    np.testing.assert_allclose(rates[0][inside], expected[inside], atol=1e-4 * np.abs(expected).max())


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("rays_per_pixel", "blur"), [(1, False), (4, True)])
@TABLES
def test_rate_is_the_slope_of_luma(
    kind: str, name: str, motion: str, rays_per_pixel: int, blur: bool, tmp_path: Path
) -> None:
    """Inside surfaces the rate is the central difference of what luma() renders, for every light, texture and blur."""
    renderer = build(name, tmp_path, camera=LENS, rays_per_pixel=rays_per_pixel, blur=blur, kind=kind)
    views = moving(*MOTIONS[motion])
    frames, rates = renderer.luma_and_rate(views)
    assert np.array_equal(frames, renderer.luma(views))
    expected, smooth = differences(renderer, views, 1e-3)
    assert smooth.mean() > 0.5
    scale = np.abs(expected).std()
    assert scale > 1e-3
    error = np.abs(rates - expected)[smooth] / scale
    # Some rays cross a texel's centre line or a dim edge within the step, where the slope changes.
    median, most, nearly_all = np.quantile(error, [0.5, 0.9, 0.98])
    assert median < 2e-3
    assert most < 0.03
    assert nearly_all < 0.1


@pytest.mark.usefixtures("llvm")
@TABLES
def test_rates_have_the_same_bits_in_any_batch(kind: str, tmp_path: Path) -> None:
    """A view's luma and rate do not depend on the other views; blur acts on rates as on frames."""
    sharp, soft = (
        build("textures of three wrap modes", tmp_path, rays_per_pixel=3, blur=blur, kind=kind)
        for blur in (False, True)
    )
    twists = [moving(v, w) for v, w in MOTIONS.values()]
    views = Views(*(np.concatenate([getattr(v, name) for v in twists]) for name in vars(twists[0])))
    frames, rates = sharp.luma_and_rate(views)
    assert rates.dtype == np.float32
    assert rates.shape == frames.shape == (3, 24, 32)
    for i in range(3):
        alone = sharp.luma_and_rate(views[i : i + 1])
        assert np.array_equal(alone[0][0], frames[i])
        assert np.array_equal(alone[1][0], rates[i])
    softened = soft.luma_and_rate(views)
    assert np.array_equal(softened[0], blur_3x3(frames))
    assert np.array_equal(softened[1], blur_3x3(rates))


def integrator(name: str, request: pytest.FixtureRequest, *, camera: Camera, **parts: dict[str, Any]) -> Renderer:
    """Mitsuba's path tracer, few bounces, in a variant."""
    if name == FAST:
        request.getfixturevalue("llvm")
    source = {"type": "scene", "by": {"type": "path", "max_depth": 3}, **parts}
    with variant(name) as (mi, _):
        loaded = load_scene_source(source, mi)
    kind = IntegratorRenderer if name == FAST else ScalarRenderer
    return kind(loaded, camera, rays_per_pixel=2, blur=False, seed=3, reason="")


SMALL = Camera(12, 9, 10.0, 11.0, 5.3, 4.2, k1=-0.1)
BALL = {"type": "sphere", "center": [0.2, 0.1, 0.6], "radius": 0.3, "bsdf": diffuse()}


@pytest.mark.few(2)
@pytest.mark.parametrize("name", [FAST, SCALAR])
@pytest.mark.parametrize("motion", MOTIONS)
def test_integrators_rates_are_differences(name: str, motion: str, request: pytest.FixtureRequest) -> None:
    """Under noisy light the rate is the slope of the very luma that is rendered, noise and all, without jumps."""
    renderer = integrator(name, request, camera=SMALL, lamp=LAMP, sky=SKY, floor=floor(), ball=BALL)
    views = moving(*MOTIONS[motion])
    frames, rates = renderer.luma_and_rate(views)
    assert np.array_equal(frames, renderer.luma(views))
    expected, smooth = differences(renderer, views, 5e-4)
    scale = np.abs(expected[smooth]).std()
    assert smooth.mean() > 0.3
    error = np.abs(rates - expected)[smooth] / scale
    assert np.quantile(error, 0.9) < 0.05
    assert np.abs(rates).max() < 30 * scale


@pytest.mark.parametrize("name", ["native", "table", FAST, SCALAR])
def test_rate_at_rest_is_exactly_zero(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """A camera at rest has rate 0 in every pixel, and no flow; so has one that moves in the dark or past nothing."""
    if name in ("native", "table"):
        request.getfixturevalue("llvm")
        renderer = build("textures of three wrap modes", tmp_path, rays_per_pixel=3, kind=name)
    else:
        renderer = integrator(name, request, camera=SMALL, lamp=LAMP, floor=floor(), ball=BALL)
    rest = Views.at_rest([POSE, POSE])
    frames, rates = renderer.luma_and_rate(rest)
    assert np.array_equal(frames, renderer.luma(rest))
    assert frames.max() > 0
    assert (rates == 0).all()
    flow = renderer.flow(rest)
    assert (flow[np.isfinite(flow)] == 0).all()
    up = moving([0.3, 0.1, 0.2], [0.1, 0.2, 0.3], Pose([0.0, 0.0, 9.0], [0.0, 0.0, 0.0, 1.0]))
    frames, rates = renderer.luma_and_rate(up)
    assert (frames == 0).all()
    assert (rates == 0).all()


@pytest.mark.parametrize("name", ["native", "table", FAST, SCALAR])
@pytest.mark.parametrize("motion", MOTIONS)
def test_flow_is_where_the_surface_point_goes(
    name: str, motion: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Flow is the speed of the image, through the lens, of the point that a pixel's centre sees; NaN where none is."""
    camera = LENS if name in ("native", "table") else SMALL
    if name in ("native", "table"):
        request.getfixturevalue("llvm")
        renderer = build("smooth normals", tmp_path, camera=camera, kind=name)
    else:
        renderer = integrator(name, request, camera=camera, lamp=LAMP, ball=BALL)
    views = moving(*MOTIONS[motion], n=2)
    flow, depth = renderer.flow(views), renderer.depth(views)
    assert flow.dtype == np.float32
    assert flow.shape == (*depth.shape, 2)
    missed = np.isinf(depth)
    assert 0 < missed.mean() < 1
    assert np.array_equal(np.isnan(flow), np.stack([missed, missed], -1))
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
    rays = np.concatenate([camera.rays(pixels), np.ones((*pixels.shape[:2], 1))], -1)
    hit = ~missed[0]
    points = views.positions[0] + (depth[0].astype(np.float64)[..., None] * rays)[hit] @ views.rotations[0].T
    step_s = 1e-5
    images = []
    for t_s in (-step_s, step_s):
        view = views[:1].moved([t_s])
        images.append(camera.project((points - view.positions[0]) @ view.rotations[0]))
    expected = (images[1] - images[0]) / (2 * step_s)
    assert np.abs(expected).max() > 1
    for i in range(2):
        np.testing.assert_allclose(flow[i][hit], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
