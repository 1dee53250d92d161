"""Quick bakes are finest where the camera's path looks: which places it sees, and what follows from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import Pose, Scene, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.baked import bake, baked_scene, cache
from davis_rs.render.baked.irradiance import Irradiance
from davis_rs.render.baked.seen_places import SeenPlaces
from davis_rs.render.baked.surface_lattice import INWARDS, CellHits, RefinementRule, SurfaceLattice, refine
from davis_rs.render.choice import make_renderer
from davis_rs.render.native import seen_places as native_places
from davis_rs.render.native.renderer import NativeRenderer

pytestmark = pytest.mark.without_llvm

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(width=8, height=6, fx=8.0, fy=8.0, cx=3.5, cy=2.5)
DOWN = Pose([0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])


@given(st.integers(0, 2**32 - 1))
def test_hits_stay_where_they_are_while_cells_are_divided(seed: int) -> None:
    random = np.random.RandomState(seed)
    corners, hits = (
        random.normal(size=(5, 3, 2)),
        CellHits(random.randint(5, size=40), random.dirichlet(np.ones(3), 40)),
    )
    at = np.einsum("hk,hkd->hd", hits.weights, corners[hits.cells])
    for _ in range(3):
        kept = random.rand(len(corners)) < 0.8
        at, hits, corners = at[kept[hits.cells]], hits.among(kept), corners[kept]
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(part, 1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        hits = hits.divided(len(kept.nonzero()[0]))
        assert (hits.weights > -1e-12).all()
        np.testing.assert_allclose(np.einsum("hk,hkd->hd", hits.weights, corners[hits.cells]), at, atol=1e-12)
        assert hits.counts(len(corners)).sum() == len(at)


def two_spots(seen_from: float) -> tuple[SurfaceLattice, CellHits]:
    """Two triangles of one size, under one spot of light each, and hits on that which begins at an x."""
    corners = np.array([[[x, 0, 0], [x + 4, 0, 0], [x, 4, 0]] for x in (0.0, 10.0)])
    lattice = SurfaceLattice(corners, np.tile([0, 0, 1.0], (2, 3, 1)), np.zeros(2, bool), np.zeros(2, int))
    weights = np.random.RandomState(0).dirichlet(np.ones(3), 2000)
    return lattice, CellHits(np.full(len(weights), seen_from // 10, int), weights)


@pytest.mark.parametrize("seen_from", [0.0, 10.0])
def test_most_places_are_where_a_camera_looks(seen_from: float) -> None:
    lattice, hits = two_spots(seen_from)
    flags = list[tuple[FloatArray, npt.NDArray[np.bool_]]]()

    def light(places: FloatArray, _: Any, __: Any, seen: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        flags.append((places, seen))
        spot = np.exp(-((places[:, 0] % 10 - 1) ** 2 + (places[:, 1] - 1) ** 2) / 0.1)
        return np.repeat((1 + spot)[:, None], 3, 1), np.zeros(len(places))

    sampled = refine(lattice, light, RefinementRule(2.0, 0.01, 0.002, 600), hits=hits)
    known = len(lattice.positions)
    on_it = np.abs(sampled.positions[known:, 0] - seen_from) < 5
    assert not sampled.complete
    assert 0.65 < on_it.mean() < 1.0
    places, seen = (np.concatenate(columns) for columns in zip(*flags, strict=True))
    assert not seen[np.abs(places[:, 0] - seen_from) > 5].any()
    assert seen[np.abs(places[:, 0] - seen_from) < 5].mean() > 0.9


def test_corners_that_are_seen_do_not_share_their_light() -> None:
    """Two pairs of corners are close to each other; those of the triangle that is seen stay apart."""
    near, far = (np.array([[x, 0, 0], [x + 0.4, 0, 0], [x, 5, 0]]) for x in (0.0, 10.0))
    normals = np.tile([0, 0, 1.0], (2, 3, 1))
    arguments = np.array([near, far]), normals, np.zeros(2, bool), np.zeros(2, int)
    assert len(SurfaceLattice(*arguments).positions) == 6
    assert len(SurfaceLattice(*arguments, shared=1.0).positions) == 4
    lattice = SurfaceLattice(*arguments, shared=1.0, apart=np.array([True, False]))
    assert len(lattice.positions) == 5
    assert len(set(lattice.faces[0])) == 3


def test_places_moved_inwards_keep_the_mean_and_leave_nooks() -> None:
    """Light that is linear keeps its mean on a triangle; dark corners do not darken what is between them."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)
    lattice = SurfaceLattice(corners, np.tile([0, 0, 1.0], (1, 3, 1)), np.zeros(1, bool), np.zeros(1, int))

    def values(light: Any) -> FloatArray:
        def lit(places: FloatArray, *_: Any) -> tuple[FloatArray, FloatArray]:
            return np.repeat(light(places)[:, None], 3, 1), np.zeros(len(places))

        return refine(lattice, lit, RefinementRule(9.0, 9.0, 1.0, 0, inwards=0.3)).values[:, 0]

    np.testing.assert_allclose(values(lambda at: 1 + at[:, 0] + 2 * at[:, 1]).mean(), 2.0)
    nook = 0.1
    assert (
        values(lambda at: np.where(np.linalg.norm(at[:, None] - corners[0], axis=2).min(1) < nook, 0, 1.0)) == 1
    ).all()


OBJ = """
v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0
v 0 -9 0.5\nv 9 -9 0.5\nv 9 9 0.5\nv 0 9 0.5
f 1 2 3\nf 1 3 4\nf 5 7 6\nf 5 8 7
"""


def floor_and_table(folder: Path) -> Scene:
    """A floor, half of which a table hides from above; the table's corners run clockwise."""
    (folder / "table.obj").write_text(OBJ)
    return load_scene(folder / "table.obj", up="z")


def places_seen(scene: Scene, views: Views) -> tuple[SeenPlaces, FloatArray]:
    """What a camera sees, and where that is."""
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=1, blur=False)
    assert isinstance(renderer, NativeRenderer)
    seen = native_places.seen_places(renderer.table, renderer.motion, CAMERA, views)
    return seen, np.einsum("hk,hkd->hd", seen.weights, renderer.table.corners[seen.triangles])


def test_places_lie_where_rays_hit(tmp_path: Path) -> None:
    """From above: half of the pixels see the floor, and half the table's back."""
    seen, at = places_seen(floor_and_table(tmp_path), Views.at_rest([DOWN, DOWN]))
    assert len(at) == 2 * CAMERA.width * CAMERA.height
    on_table = at[:, 0] > 0
    np.testing.assert_allclose(at[:, 2], np.where(on_table, 0.5, 0.0), atol=1e-6)
    column = np.tile(np.arange(CAMERA.width), 2 * CAMERA.height)
    np.testing.assert_allclose(at[:, 0], (column - 3.5) / 8 * np.where(on_table, 0.5, 1.0), atol=1e-6)
    np.testing.assert_array_equal(seen.backs, on_table)
    np.testing.assert_array_equal(seen.triangles >= 2, on_table)


def test_sides_that_do_not_reflect_are_not_looked_at() -> None:
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[2, 2, 2]] * 3], float)
    normals = np.tile([0, 0, 1.0], (3, 3, 1))
    lattice = SurfaceLattice(corners, normals, np.array([False, True, False]), np.zeros(3, int))
    seen = SeenPlaces(np.array([0, 0, 1, 1, 2]), np.array([False, True, False, True, False]), np.full((5, 3), 1 / 3))
    hits = seen.on(lattice, corners)
    assert hits is not None
    np.testing.assert_array_equal(hits.cells, [0, 1, 3])
    nothing = SeenPlaces(np.array([2]), np.array([False]), np.full((1, 3), 1 / 3))
    assert nothing.on(lattice, corners) is None


@pytest.mark.usefixtures("light_cache")
def test_parts_of_a_path_have_one_bake_and_another_path_has_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = floor_and_table(tmp_path)
    asked = list[str]()
    monkeypatch.setattr(cache, "store", lambda key, maps: asked.append(key))

    def bakes(world: Scene, kind: str = "auto") -> int:
        before = len(asked)
        make_renderer(world, CAMERA, kind=kind, rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False, bake_error=0.5)
        return len(asked) - before

    assert bakes(scene) == 1
    assert bakes(scene.crop(0.5, 0.1)) == 0
    assert bakes(scene.crop(0.5, 0.1).paced(1.01)) == 0
    other = scene.with_trajectory(scene.path.crop(0.0, 0.2))
    assert bakes(other) == 1
    assert [bakes(scene, "baked"), bakes(other, "baked")] == [1, 0]
    assert replace(scene, trajectory=None).path_of_bake is None


@pytest.fixture(autouse=True)
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baked_scene, "QUICK_EFFORT", replace(bake.QUICK_EFFORT, most_points=300))


def baked_renderer(folder: Path) -> None:
    make_renderer(floor_and_table(folder), CAMERA, rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False)


@pytest.mark.usefixtures("light_cache")
def test_places_that_are_seen_take_more_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the sky; and the error that is told is that of what is seen."""
    monkeypatch.setattr(baked_scene, "QUICK_EFFORT", replace(bake.QUICK_EFFORT, most_points=300, most_samples=10))
    counts = dict[int, list[FloatArray]]()
    of_sky = Irradiance.of_sky

    def kept(self: Irradiance, positions: FloatArray, normals: FloatArray, samples: int, shift: int = 0) -> FloatArray:
        if len(positions) != bake._PILOTS:  # those say how many samples are enough
            counts.setdefault(samples, []).append(positions)
        return of_sky(self, positions, normals, samples, shift)

    def nowhere(*_: Any) -> None:
        raise AssertionError("points are drawn from what is seen")

    monkeypatch.setattr(Irradiance, "of_sky", kept)
    monkeypatch.setattr(bake._BakeJob, "_spread", nowhere)
    baked_renderer(tmp_path)
    assert len(np.concatenate(counts[10])) > 0
    assert len(np.concatenate(counts[64])) > 100


@pytest.mark.usefixtures("light_cache")
def test_only_the_last_bounce_follows_what_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light that bounces again comes from everywhere. Its places are moved away from corners."""
    asked = list[tuple[bool, float]]()

    def kept(lattice: Any, light_at: Any, rule: RefinementRule, told: Any, hits: CellHits | None) -> Any:
        asked.append((hits is not None, rule.inwards))
        return refine(lattice, light_at, rule, told, hits)

    monkeypatch.setattr(bake, "refine", kept)
    baked_renderer(tmp_path)
    assert asked == [(True, INWARDS), (False, 0.3), (True, INWARDS)]


def test_a_lattice_of_many_corners_keeps_those_that_are_seen_apart() -> None:
    corners = np.array([[[x, 0, 0], [x + 0.4, 0, 0], [x, 5, 0]] for x in (0.0, 10.0)])
    normals, none = np.tile([0, 0, 1.0], (2, 3, 1)), np.zeros(2, bool)
    surfaces = SimpleNamespace(
        corners=corners, normals=normals, two_sided=none, frames=np.zeros(2, int), diagonal=128.0
    )
    seen = SeenPlaces(np.array([1]), np.array([False]), np.full((1, 3), 1 / 3))
    effort = replace(bake.QUICK_EFFORT, most_corners=5)
    lattice = bake._lattice(surfaces, effort, seen)  # type: ignore[arg-type]
    assert len(lattice.positions) == 5
    assert len(set(lattice.faces[1])) == 3
