"""The native renderer against a brute-force ray caster in float64, against the table kernel, and against itself."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Scene, load_scene
from davis_rs._core import PixelRays, SceneRenderer
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.rays.camera_rays import ray_table
from davis_rs.render.rays.shadow_rays import END, STEP, scene_centre
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.scene.sequences import SEQUENCES
from ray_caster import cast, distance_to_edges, distance_to_shadow_edges, shadowed, sunless
from render_agreement import agreement, scene_named

pytestmark = pytest.mark.without_llvm

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(33, 19, 25.0, 31.0, 15.2, 9.9, k1=-0.15, p1=0.003)
RAYS = ray_table(CAMERA, 1)[0].astype(np.float32)
DIRECTIONS = np.concatenate([RAYS, np.ones((len(RAYS), 1), np.float32)], 1).astype(np.float64)
ROTATION = Rotation.from_rotvec([0.5, -0.3, 0.8]).as_matrix()


@dataclass(frozen=True)
class Soup:
    """Triangles (n, 3, 3) in camera axes, each of a reflectance of its own, under one light; where the camera is."""

    corners: FloatArray
    light: tuple[str, FloatArray] = field(default_factory=lambda: ("constant", np.zeros(3)))
    strength: float = 1.0
    position: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def reflectances(self) -> FloatArray:
        return 0.2 + 0.6 * (np.arange(len(self.corners)) + 1.0) / (len(self.corners) + 1)

    @property
    def world(self) -> FloatArray:
        return self.corners @ ROTATION.T + self.position

    @property
    def vector(self) -> FloatArray:
        """The light's place or way in the world."""
        kind, vector = self.light
        return ROTATION @ vector + (self.position if kind == "point" else 0.0)

    @property
    def centre(self) -> FloatArray:
        return scene_centre(self.world.reshape(-1, 3))

    def core(self, threads: int | None = None) -> SceneRenderer:
        count, world = len(self.corners), self.world
        normals = np.cross(world[:, 1] - world[:, 0], world[:, 2] - world[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
        planes = np.concatenate([normals, -np.einsum("ij,ij->i", normals, world[:, 0])[:, None]], 1)
        nothing = np.zeros(count * 4)
        layouts = np.array([[9 * i, 1, 1, 0] for i in range(count)], np.int64)
        kind, _ = self.light
        return SceneRenderer(
            corners=world.ravel(),
            planes=planes.ravel(),
            u_maps=nothing,
            v_maps=nothing,
            normal_maps=None,
            textures=np.arange(count, dtype=np.uint32),
            two_sided=np.ones(count, np.uint32),
            frames=np.zeros(count, np.uint32),
            frame_count=1,
            layouts=layouts.ravel(),
            texels=[np.repeat(self.reflectances, 9).astype(np.float32)],
            lights=[(kind, 0, self.strength, 0.0, self.vector.tolist(), None, None)],
            shadows=kind != "constant",
            centre=self.centre.tolist(),
            step=STEP,
            end=END,
            threads=threads,
        )

    def view(self) -> Any:
        still = np.zeros(3)
        return self.position, ROTATION.ravel(), still, still, np.ones(1), np.zeros(1)


def pixel_rays(table: npt.NDArray[np.float32] = RAYS, camera: Camera = CAMERA, rays: int = 1) -> PixelRays:
    return PixelRays(camera.width, camera.height, rays, np.ascontiguousarray(table).ravel())


def random_corners(seed: int, count: int, kind: str) -> FloatArray:
    """Triangles about the camera, or such as are hard."""
    draw = np.random.RandomState(seed)
    corners = draw.uniform(-2, 2, (count, 3, 3)) + draw.uniform(-1, 1, (count, 1, 3)) * [2, 2, 4]
    if kind == "small":
        corners = draw.uniform(-1, 1, (count, 1, 3)) * [2, 2, 1] + [0, 0, 3] + draw.uniform(-0.1, 0.1, (count, 3, 3))
    elif kind == "edge-on":
        # The plane passes through the camera, or all but does.
        corners[:, 2] = corners[:, 0] * 0.3 + corners[:, 1] * 0.6 + draw.choice([0, 1e-9, 1e-4], (count, 1))
    elif kind == "degenerate":
        corners[::2, 2] = corners[::2, 1]
        corners[1::4, 2] = (corners[1::4, 0] + corners[1::4, 1]) / 2
    elif kind == "slivers":
        corners[:, 2] = corners[:, 1] + draw.uniform(-1e-3, 1e-3, (count, 3))
    elif kind == "mesh":
        # A closed box around the camera, and a smaller one before it: edges shared, and none may let a ray through.
        box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
        faces = np.array(
            [
                [0, 1, 3],
                [0, 3, 2],
                [4, 6, 7],
                [4, 7, 5],
                [0, 4, 5],
                [0, 5, 1],
                [2, 3, 7],
                [2, 7, 6],
                [0, 2, 6],
                [0, 6, 4],
                [1, 5, 7],
                [1, 7, 3],
            ]
        )
        turned = box @ Rotation.from_rotvec(draw.uniform(-1, 1, 3)).as_matrix()
        corners = np.concatenate(
            [(turned * 3 + draw.uniform(-1, 1, 3))[faces], (turned * 0.4 + [0.2, 0.1, 1.5])[faces]]
        )
    return corners


SOUPS = st.builds(
    random_corners,
    st.integers(0, 2**31),
    st.one_of(st.integers(1, 40), st.integers(100, 400)),
    st.sampled_from(["around", "small", "edge-on", "degenerate", "slivers", "mesh"]),
)


@settings(max_examples=50)
@given(corners=SOUPS, far=st.sampled_from([0.0, 0.0, 1e5]))
def test_every_ray_sees_what_it_must(corners: FloatArray, far: float) -> None:
    """Among any triangles, behind the camera too and 100 km from the origin: of all rays but those within 1e-4 px of an
    edge, or of two surfaces at one depth, the triangle and the depth of a float64 ray caster.

    One over the depth is a sum of three float32 terms: depth errs by some roundings of the largest, which is far more
    than the sum where a plane is seen from its edge.
    """
    soup = Soup(corners, position=far * np.array([1.0, -0.7, 0.4]))
    luma, _ = soup.core().luma(pixel_rays(), soup.view())
    depth, triangles = soup.core().depth(pixel_rays(), soup.view())
    hits = cast((soup.world - soup.position) @ ROTATION, DIRECTIONS)
    # Far away the corners themselves are float64's 1e-11 m off, which an edge seen at a grazing angle makes larger.
    near_px = 1e-4 if far == 0.0 else 2e-4
    clear = (distance_to_edges(corners, DIRECTIONS) * CAMERA.fy > near_px) & (hits.margin > 1e-5)
    assert clear.mean() > 0.9
    seen = np.append(soup.reflectances, 0.0)[hits.triangle].astype(np.float32)
    wrong = clear & (luma != seen)
    assert not wrong.any(), f"{wrong.sum()} rays, the first {np.flatnonzero(wrong)[0]}"
    assert np.isinf(depth[clear & (hits.triangle < 0)]).all()
    hit = np.flatnonzero(clear & (hits.triangle >= 0))
    a, b, c = corners[hits.triangle[hit]].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    terms = np.abs(normal * DIRECTIONS[hit]).sum(1) / np.abs((normal * a).sum(1))
    assert (np.abs(depth[hit] / hits.depth[hit] - 1) <= 4e-7 * terms * hits.depth[hit]).all()
    assert (triangles[clear] == np.where(hits.triangle < 0, 2**32 - 1, hits.triangle)[clear]).all()


@settings(max_examples=30)
@given(corners=SOUPS, kind=st.sampled_from(["point", "directional"]), seed=st.integers(0, 2**31))
def test_every_ray_has_the_light_that_it_must(corners: FloatArray, kind: str, seed: int) -> None:
    """Lambert's law and shadows by the written rule, from a float64 ray caster, of all rays but those near an edge, or
    near the edge of a shadow."""
    draw = np.random.RandomState(seed)
    vector = draw.uniform(-3, 3, 3)
    vector = vector if kind == "point" else vector / np.linalg.norm(vector)
    soup = Soup(corners, (kind, vector), 7.0)
    luma, _ = soup.core().luma(pixel_rays(), soup.view())
    hits = cast(corners, DIRECTIONS)
    hit = hits.triangle >= 0
    assert (luma[~hit & (distance_to_edges(corners, DIRECTIONS) * CAMERA.fy > 1e-4)] == 0).all()
    rays, triangle, depth = DIRECTIONS[hit], hits.triangle[hit], hits.depth[hit]
    places = rays * depth[:, None]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[triangle]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign(np.einsum("ij,ij->i", normals, rays))[:, None]
    towards = vector - places if kind == "point" else np.broadcast_to(-vector, places.shape)
    distance = np.linalg.norm(towards, axis=1) if kind == "point" else np.ones(len(places))
    cosine = np.einsum("ij,ij->i", normals, towards) / np.linalg.norm(towards, axis=1)
    from_centre = np.abs(places @ ROTATION.T - (soup.centre - soup.position)).max(1)
    origins = places + normals * (STEP * (from_centre + depth))[:, None] * np.sign(cosine)[:, None]
    if kind == "point":
        dark = shadowed(corners, origins, vector, end=END)
        from_shadow = distance_to_shadow_edges(corners, origins, vector)
    else:
        dark = sunless(corners, origins, -vector)
        from_shadow = distance_to_shadow_edges(corners, origins, np.append(-vector, 0.0))
    expected = np.where(dark | (cosine <= 0), 0, 7.0 / np.pi * cosine / distance**2) * soup.reflectances[triangle]
    clear = (distance_to_edges(corners, rays) * CAMERA.fy > 1e-3) & (hits.margin[hit] > 1e-4)
    # A step off a surface is as long as a shadow's edge is uncertain: surfaces that touch there are left out.
    clear &= (from_shadow > 3e-3 * depth) & (np.abs(cosine) > 1e-3) & (distance > 0.05)
    np.testing.assert_allclose(luma[hit][clear], expected[clear], rtol=3e-4, atol=1e-6)


def test_edges_that_triangles_share_let_no_ray_through() -> None:
    """A sheet of many small triangles across the image, its corners anywhere: not one of 100,000 rays misses it."""
    draw = np.random.RandomState(5)
    size = 24
    grid = np.stack(np.meshgrid(np.linspace(-2, 2, size), np.linspace(-2, 2, size)), -1)
    grid[1:-1, 1:-1] += draw.uniform(-0.05, 0.05, (size - 2, size - 2, 2))
    points = np.concatenate([grid, 1.5 + draw.uniform(0, 0.2, (size, size, 1))], -1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    corners = np.concatenate([np.stack(t, 2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    camera = Camera(64, 50, 60.0, 60.0, 31.5, 24.5)
    table = ray_table(camera, 32).astype(np.float32)
    soup = Soup(corners)
    luma, _ = soup.core().luma(pixel_rays(table, camera, 32), soup.view())
    assert (luma > 0.19).all()


def tables(scene: Scene) -> SceneTable:
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        moving = list(scene_motion(scene, loaded, mi).objects)
        return SceneTable(loaded, mi, shadows=scene.shadows, any_integrator=False, moving=moving)


def in_other_units(table: SceneTable, scale: float) -> SceneTable:
    """The same scene in units of 1 / scale metres: lamps get stronger, so that luma stays."""
    other = copy.copy(table)
    other.corners, other.centre = table.corners * scale, table.centre * scale
    other.planes = table.planes * [1, 1, 1, scale]
    slopes = np.array([1, 1, 1, scale]) / scale
    other.u_maps, other.v_maps = table.u_maps * slopes, table.v_maps * slopes
    other.normal_maps = None if table.normal_maps is None else table.normal_maps * slopes
    other.lights = [
        replace(light, vector=light.vector * scale, strength=light.strength * scale**2)
        if light.kind == "point"
        else light
        for light in table.lights
    ]
    return other


@pytest.mark.few(1)
@pytest.mark.parametrize("scale", [1e-4, 7.0, 1e5])
def test_a_scene_in_other_units_looks_the_same(scale: float) -> None:
    """A room with lamps, shadows and textures, scaled: to float32 the same luma, but at edges of shadows; where a fixed
    length stood in a rule, shadows would move or vanish."""
    scene = SEQUENCES["boxes_6dof"].scene()
    table = tables(scene)
    assert table.shadows
    assert any(light.kind == "point" for light in table.lights)
    views = Views.along(scene.path, [1.0, 8.0])
    there = Views(views.t_s, views.positions * scale, views.rotations, views.velocities * scale, views.angular_rates)
    ours = NativeRenderer(table, scene.own_camera, rays_per_pixel=4, blur=False).luma(views)
    other = NativeRenderer(in_other_units(table, scale), scene.own_camera, rays_per_pixel=4, blur=False).luma(there)
    assert (np.abs(other - ours) > 1e-4 * ours.max()).mean() < 1e-5


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    "name", ["three_planes", "three_walls", "boxes_6dof", "office_zigzag", "dynamic_6dof", "wires", "grazing"]
)
def test_scenes_are_those_of_the_table_kernel(name: str) -> None:
    """Three views of each scene; ``python tests/helpers/render_agreement.py`` does the same for all scenes in 20 views.

    Luma is the same to 1e-4, but where a float64 ray caster finds an edge or the edge of a shadow within 1e-3 px of the
    ray, or two surfaces in one plane. Where a texture is so fine that float32 cannot place it, the native renderer is
    right more often than the table kernel."""
    found = agreement(scene_named(name), views=3)
    assert found.rms <= 1e-4
    assert found.not_explained == 0
    assert found.off <= 5e-3 * found.pixels
    assert found.native_wrong <= found.table_wrong
    assert found.rounding <= 1e-4 * found.pixels


@pytest.mark.parametrize("name", ["three_planes", pytest.param("boxes_6dof", marks=pytest.mark.long), "dynamic_6dof"])
def test_the_same_view_has_the_same_bits(name: str) -> None:
    """Luma, rates, depth and single pixels: in any batch, after others, on one, two and three threads."""
    scene = SEQUENCES[name].scene() if name in SEQUENCES else load_scene(name)
    camera = Camera(61, 43, 60.0, 55.0, 30.0, 20.0, k1=-0.1)
    table, motion = tables(scene), make_renderer(scene, camera, kind="native").motion
    make = partial(NativeRenderer, table, camera, rays_per_pixel=5, blur=False, motion=motion)
    views = Views.along(scene.path, np.linspace(0.1, 0.9 * scene.path.duration_s, 5))
    first = make(threads=1)
    luma, rate = first.luma_and_rate(views)
    depth = first.depth(views)
    assert np.array_equal(luma, first.luma(views))
    for threads in (1, 2, 3):
        renderer = make(threads=threads)
        for part in (slice(0, 5), slice(2, 3), slice(1, 4)):
            assert np.array_equal(renderer.luma(views[part]), luma[part])
            assert np.array_equal(renderer.luma_and_rate(views[part])[1], rate[part])
            assert np.array_equal(renderer.depth(views[part]), depth[part])
        view, pixel = (np.random.RandomState(threads).randint(0, n, 3000) for n in (5, 61 * 43))
        assert np.array_equal(renderer.samples(views, view, pixel), luma.reshape(5, -1)[view, pixel])


def test_threads_and_arrays_are_checked() -> None:
    """No threads, or arrays that do not belong together, are refused with the numbers."""
    soup = Soup(random_corners(0, 3, "around"))
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        soup.core(threads=0)
    with pytest.raises(ValueError, match="19 pixels of 1 rays need 1254 finite numbers, got 1252"):
        pixel_rays(RAYS[1:])
    with pytest.raises(ValueError, match="views of 1 frames and 1 lights need as many poses and factors"):
        soup.core().luma(pixel_rays(), (*soup.view()[:4], np.ones(2), np.ones(1)))
    with pytest.raises(ValueError, match="pixel 627 is outside of the view's 627"):
        soup.core().samples(pixel_rays(), soup.view(), np.array([0]), np.array([627]))
    with pytest.raises(ValueError, match="triangle hits need exactly one ray a pixel, got 2"):
        soup.core().depth(pixel_rays(np.stack([RAYS, RAYS]), rays=2), soup.view())


@pytest.mark.long
def test_no_llvm_is_needed(run_python: Callable[..., str]) -> None:
    """Without any libLLVM auto takes the native renderer too, with all of its rays; its frames have the same bits.

    Presets do not make the scalar variant slower: it takes its own number of rays.
    """
    program = """
import hashlib
import numpy as np
from davis_rs import Simulator, load_scene
from davis_rs.render.choice import make_renderer
from davis_rs.geometry.trajectory.views import Views
scene = load_scene("three_planes")
renderer = make_renderer(scene, scene.own_camera, rays_per_pixel=2)
assert renderer.name == "native renderer", renderer.name
assert renderer.rays_per_pixel == 2
assert make_renderer(scene, scene.own_camera).rays_per_pixel == 8
assert Simulator(scene).renderer.rays_per_pixel == 32
assert Simulator(scene, accuracy="fast").renderer.rays_per_pixel == 8
assert Simulator(scene, renderer="integrator").renderer.rays_per_pixel == 2
print(hashlib.sha256(renderer.luma(Views.along(scene.path, [0.1])).tobytes()).hexdigest())
"""
    scene = load_scene("three_planes")
    luma = make_renderer(scene, scene.own_camera, rays_per_pixel=2, kind="native").luma(Views.along(scene.path, [0.1]))
    found = run_python(program, DRJIT_LIBLLVM_PATH="/no/such/library", PATH="/usr/bin:/bin")
    assert found.strip() == hashlib.sha256(luma.tobytes()).hexdigest()
