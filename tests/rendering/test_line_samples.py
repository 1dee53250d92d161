"""Luma by lines: the integral over each pixel's area, without jumps at edges."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pixel_estimators import before_a_wall, edge
from test_render_native import Soup, random_corners

import davis_rs
from davis_rs._core import PixelRays
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.lattice import rank1_lattice
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.rays.camera_rays import pixel_centres, pixel_corners
from davis_rs.scene import meshes
from davis_rs.scene.scene import Scene
from lit_scenes import environment
from long_form import long_values

C = 0.15


BENT = Camera(45, 37, 110.0, 112.0, -3.0, 1.0, k1=-0.4, p1=0.002)
"""A part of a sensor behind a lens that distorts much: its edges are bent by 0.1 pixels in a tile."""


def scene_of(name: str, camera: Camera | None = None) -> Scene:
    """A scene seen by 45 x 37 pixels, without distortion if no camera is given: tiles reach beyond the image."""
    scene = davis_rs.load_scene(name)
    own = scene.own_camera
    straight = replace(own, width=45, height=37, cx=22.0, cy=18.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
    return replace(scene, camera=camera or straight)


def renderer_of(scene: Scene, rays: int, pixel: str = "lines", threads: int | None = None) -> Renderer:
    return make_renderer(scene, scene.own_camera, rays_per_pixel=rays, pixel=pixel, blur=False, threads=threads)


def views_of(scene: Scene, *fractions: float) -> Views:
    return Views.along(scene.path, scene.path.duration_s * np.array(fractions))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "camera", "factor"),
    [("three_planes", None, 0.8), ("fence", None, 0.3), ("urban", None, 0.9), ("fence", BENT, 0.3)],
)
def test_lines_come_nearer_to_the_area_than_rays(name: str, camera: Camera | None, factor: float) -> None:
    """Against 1024 rays, 8 lines err at most a fraction of the 32 rays whose place they take, and 16 lines less than 8.
    Of urban's errors most are the textures', which both see at points."""
    scene = scene_of(name, camera)
    views = views_of(scene, 0.3, 0.7)
    truth = np.log(renderer_of(scene, 1024, "rays").luma(views).astype(np.float64) + 1e-3)

    def error(rays: int, pixel: str) -> float:
        luma = renderer_of(scene, rays, pixel).luma(views)
        return float(np.sqrt(np.mean((np.log(luma + 1e-3) - truth) ** 2))) / C

    rays, few, many = error(32, "rays"), error(32, "lines"), error(64, "lines")
    assert few < factor * rays
    assert many < 0.7 * few
    assert error(8, "lines") < 1.1 * error(8, "rays")


@pytest.mark.parametrize("camera", [None, BENT])
def test_luma_does_not_jump(camera: Camera | None) -> None:
    """While the camera moves by 0.005 pixels at a time, no second difference of log luma on the fence exceeds 0.05 C
    where those of 32 rays do in many pixels."""
    scene = scene_of("fence", camera)
    view = views_of(scene, 0.4)
    flow = np.nanmax(np.linalg.norm(renderer_of(scene, 32).flow(view), axis=-1))
    times = 0.4 * scene.path.duration_s + 0.005 / flow * np.arange(12)

    def jumping(pixel: str) -> float:
        logs = np.log(renderer_of(scene, 32, pixel).luma(Views.along(scene.path, times)).astype(np.float64) + 1e-3)
        return float((np.abs(np.diff(logs, 2, axis=0)).max(0) > 0.05 * C).mean())

    assert jumping("rays") > 0.1
    assert jumping("lines") < 0.005


@pytest.mark.parametrize(
    "camera", [Camera(30, 20, 60.0, 60.0, 40.0, 9.5), Camera(30, 20, 60.0, 60.0, 40.0, 9.5, k1=-0.2)]
)
def test_shadows_do_not_jump(camera: Camera) -> None:
    """The shadow of a wire that the camera does not see, under a lamp, moves over a wall: no second difference of log
    luma exceeds 0.05 C, where those of 32 rays do; and luma is that of 1024 rays."""
    wire = meshes.quad([0.0, 1.5, -1.5], [0.006, 0.0, 0.0], [0.1, 0.0, 3.0])
    scene = before_a_wall("shadow", wire, 0.5, shadows=True)
    scene = replace(scene, camera=camera)
    renderers = {pixel: renderer_of(scene, 32, pixel) for pixel in ("rays", "lines")}
    view = views_of(scene, 0.3)
    flow = np.nanmax(np.linalg.norm(renderers["rays"].flow(view), axis=-1))
    views = Views.along(scene.path, 0.3 * scene.path.duration_s + 0.005 / flow * np.arange(30))

    def jumping(pixel: str) -> float:
        return float((np.abs(np.diff(np.log(renderers[pixel].luma(views)), 2, axis=0)).max(0) > 0.05 * C).mean())

    assert jumping("rays") > 0.01
    assert jumping("lines") == 0.0
    dark = renderer_of(replace(scene, shadows=False), 32).luma(view) > 1.2 * renderers["lines"].luma(view)
    assert dark.any()
    truth = renderer_of(scene, 1024, "rays").luma(view)
    errors = {pixel: np.abs(renderer.luma(view) - truth)[dark].mean() for pixel, renderer in renderers.items()}
    assert errors["lines"] < 0.3 * errors["rays"]


@pytest.mark.parametrize("degrees", [0.0, 45.0, 90.0, 150.0])
def test_an_edge_at_an_angle_does_not_jump(degrees: float) -> None:
    """An edge of contrast 5:1, along rows, columns and between, moves by 0.005 pixels a step: log luma changes by no
    more than where the whole of a dark pixel's longest section is passed."""
    scene = edge(degrees)
    views = Views.along(scene.path, np.linspace(0.0, 0.5, 101))
    change = np.abs(np.diff(np.log(renderer_of(scene, 32).luma(views)), axis=0)).max() / C
    assert change < np.log1p(4 * np.sqrt(2) * 0.005) / C


@pytest.mark.parametrize("height", [0.0, 1 / 512, 1 / 64, -5 / 1024])
def test_an_edge_along_the_lines_errs_by_one_line(height: float) -> None:
    """Where an edge lies exactly along the 8 lines of a pixel, each line is on one side of it or on the other."""

    def source() -> dict[str, object]:
        # All of these numbers and their products are exact, so that the edge meets no line at any distance.
        half = meshes.quad([-0.5, height - 3 / 16, 1.0], [1.0, 3 / 8, 0.0], [0.0, 1.0, 0.0])
        wall = meshes.quad([-9.0, -9.0, 2.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0])
        light = {"type": "constant", "radiance": 1.0}
        shapes = {"half": meshes.shape(half, 0.16), "wall": meshes.shape(wall, 0.8)}
        return {"type": "scene", "integrator": {"type": "direct"}, "light": light, **shapes}

    scene = Scene("edge", source, camera=Camera(48, 40, 64.0, 64.0, 23.5, 19.5), shadows=False)
    view = Views.at_rest([davis_rs.Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])])
    luma, truth = (renderer_of(scene, rays, pixel).luma(view) for rays, pixel in ((32, "lines"), (1024, "rays")))
    assert np.ptp(truth) > 0.7 * truth.max()
    assert np.abs(luma - truth).max() < 1.1 / 8 * np.ptp(truth)


@pytest.mark.parametrize("camera", [None, BENT])
def test_a_view_has_the_same_bits_in_any_batch_and_on_any_number_of_threads(camera: Camera | None) -> None:
    """A view alone, among others, on one thread and on three; and single pixels."""
    scene = scene_of("fence", camera)
    views = views_of(scene, 0.2, 0.5, 0.8, 0.9, 0.95)
    renderer = renderer_of(scene, 32, threads=1)
    luma = renderer.luma(views)
    for number in range(len(views)):
        assert np.array_equal(renderer.luma(views[number : number + 1])[0], luma[number])
    assert np.array_equal(renderer_of(scene, 32, threads=3).luma(views), luma)
    rng = np.random.default_rng(2)
    view, pixel = rng.integers(0, len(views), 300), rng.integers(0, 45 * 37, 300)
    assert np.array_equal(renderer.samples(views, view, pixel), luma.reshape(len(views), -1)[view, pixel])


@pytest.mark.without_llvm
def test_lines_see_the_sky_where_there_is_nothing_else() -> None:
    """Before an environment map, and over a part of a pixel."""

    def source() -> dict[str, object]:
        sky = environment(np.linspace(0.2, 2.0, 8 * 16 * 3).reshape(8, 16, 3))
        card = meshes.shape(meshes.quad([-0.1, -0.2, 1.0], [0.4, 0.1, 0.0], [0.0, 0.3, 0.0]), 0.5)
        return {"type": "scene", "integrator": {"type": "direct"}, "sky": sky, "card": card}

    scene = Scene("sky", source, camera=Camera(48, 40, 64.0, 64.0, 23.5, 19.5))
    view = Views.at_rest([davis_rs.Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])])
    luma, truth = (
        make_renderer(
            scene, scene.own_camera, rays_per_pixel=rays, pixel=pixel, blur=False, kind="baked", bake_error=0.1
        ).luma(view)
        for rays, pixel in ((32, "lines"), (1024, "rays"))
    )
    assert truth.min() > 0.1
    np.testing.assert_allclose(luma, truth, rtol=0.02)


def test_rates_hold_at_edges() -> None:
    """Luma a short time later is luma plus its rate, where geometry's edges pass too; rays' rates leave these out."""
    scene = scene_of("fence")
    view = views_of(scene, 0.4)
    renderer = renderer_of(scene, 64)
    luma, rate = renderer.luma_and_rate(view)
    assert np.array_equal(luma, renderer.luma(view))
    step_s = 0.02 / np.nanmax(np.linalg.norm(renderer.flow(view), axis=-1))
    later, before = (renderer.luma(view.moved(np.array([step]))) for step in (step_s, -step_s))
    change = (later - before) / 2
    wrong = np.quantile(np.abs(change - rate * step_s), 0.99)
    assert wrong < 0.2 * np.quantile(np.abs(change), 0.9)
    assert wrong < 0.1 * np.quantile(
        np.abs(change - renderer_of(scene, 64, "rays").luma_and_rate(view)[1] * step_s), 0.99
    )


def test_a_preset_takes_lines_where_they_are_possible() -> None:
    """In diffuse scenes of the native renderer, unless rays are asked for; else the rays that these stand for, and on
    glossy surfaces more."""

    def made_by(scene: Scene, **settings: Any) -> tuple[str, int]:
        renderer = davis_rs.Simulator(scene.crop(0, 0.01), accuracy="exact", **settings).renderer
        return renderer.pixel, renderer.rays_per_pixel

    scene = scene_of("three_planes")
    assert made_by(scene) == ("lines", 64)
    assert made_by(scene, rays_per_pixel=32) == ("rays", 32)
    assert made_by(scene, pixel="rays") == ("rays", 64)
    assert made_by(scene, renderer="integrator")[0] == "rays"
    parts = scene.source()
    assert isinstance(parts, dict)
    plastic = {"type": "twosided", "bsdf": {"type": "plastic"}}
    glossy = {
        name: part | {"bsdf": plastic} if "bsdf" in part else part for name, part in parts.items() if name != "type"
    }
    assert made_by(replace(scene, source=lambda: {"type": "scene", **glossy})) == ("rays", 256)


def test_what_lines_cannot_do_is_an_error() -> None:
    """Other renderers, other numbers of rays, single rays' derivatives: nothing falls back to rays."""
    scene = scene_of("three_planes")
    with pytest.raises(ValueError, match="takes rays_per_pixel 8, 32, 64, 256, got 13"):
        renderer_of(scene, 13)
    with pytest.raises(ValueError, match="needs the native renderer, not the"):
        make_renderer(scene, scene.own_camera, kind="integrator", pixel="lines")
    with pytest.raises(ValueError, match="pixel must be one of rays, lines, got 'cubes'"):
        renderer_of(scene, 32, "cubes")
    renderer = renderer_of(scene, 32)
    views, number = views_of(scene, 0.5), np.zeros(1, np.uint32)
    with pytest.raises(ValueError, match="need pixel='rays'"):
        renderer.ray_hits(views, number, number)  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="lines take the place of 32 rays"):
        renderer.samples(views, number, number, rays=8)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["large", "small", "slivers", "mesh"])
@pytest.mark.parametrize(
    ("seed", "camera"),
    [
        *long_values((1, Camera(33, 19, 25.0, 31.0, 15.2, 9.9))),
        (2, Camera(33, 19, 60.0, 65.0, 15.2, 9.9, k1=-0.4, k2=0.05, p2=-0.003)),
    ],
)
def test_the_area_of_any_triangles_is_that_of_many_rays(kind: str, seed: int, camera: Camera) -> None:
    """Triangles that pass through each other, the camera's plane or the camera itself: luma by 16 lines is that of
    100,352 rays a pixel, but for the ends of edges between lines; of 99 % of the pixels within 0.01."""
    soup = Soup(random_corners(seed, 60, kind))
    core, view = soup.core(), soup.view()
    lines = core.line_luma(pixel_corners(camera), 16, view)
    lattice = rank1_lattice(1024) + 0.5
    truth = np.zeros(len(lines))
    for shift in range(98):
        points = (lattice + np.array([shift * 0.7548776662, shift * 0.5698402910])) % 1 - 0.5
        table = camera.rays(pixel_centres(camera)[None] + points[:, None]).astype(np.float32)
        truth += core.luma(PixelRays(camera.width, camera.height, 1024, table.ravel()), view)[0] / 98
    assert truth.max() > 1e-4
    wrong = np.abs(lines - truth)
    assert np.quantile(wrong, 0.99) < 0.01
    assert wrong.max() < 0.04
