"""Single pixels of single views: the bits of the frames that they are taken from."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer

Indices = npt.NDArray[np.integer[Any]]

CAMERA = Camera(33, 17, 28.0, 28.0, 14.2, 8.9, k1=-0.1)
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
BITMAP = {"type": "bitmap", "raw": True, "data": TEXELS}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": 20.0}
FLOOR = {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": BITMAP}}
RAISED = np.diag([0.3, 0.3, 0.3, 1.0]) + np.pad([[0.2], [0.1], [0.3]], ((0, 1), (3, 0)))
CUBE = {"type": "cube", "to_world": RAISED, "bsdf": {"type": "diffuse", "reflectance": BITMAP}}
POSES = [Pose([0.5, -0.9, 1.8 - 0.02 * i], [0.965061, 0.0517277, -0.1125492, -0.2308985]) for i in range(20)]
VIEWS = Views.at_rest(POSES)


every_renderer = pytest.mark.parametrize("kind", ["native", "table"])


def build(kind: str, *, rays_per_pixel: int = 3, blur: bool = False, camera: Camera = CAMERA) -> Renderer:
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    parts = {"type": "scene", "by": direct, "lamp": LAMP, "floor": FLOOR, "cube": CUBE}
    return make_renderer(
        Scene("test", partial(dict, parts)), camera, rays_per_pixel=rays_per_pixel, kind=kind, blur=blur
    )


def picked(frames: LumaFrames, view: npt.ArrayLike, pixel: npt.ArrayLike) -> LumaFrames:
    return frames.reshape(len(frames), -1)[np.asarray(view), np.asarray(pixel)]


@pytest.fixture(
    scope="module", params=[(kind, blur) for kind in ("native", "table") for blur in (False, True)], ids=str
)
def rendered(request: pytest.FixtureRequest) -> tuple[Renderer, LumaFrames]:
    kind, blur = request.param
    if kind == "table":
        request.getfixturevalue("llvm")
    renderer = build(kind, blur=blur)
    return renderer, renderer.luma(VIEWS)


@settings(max_examples=40)
@given(
    pairs=st.lists(st.tuples(st.integers(0, 19), st.integers(0, 33 * 17 - 1)), max_size=60),
    twice=st.booleans(),
)
def test_samples_are_pixels_of_the_frames(
    rendered: tuple[Renderer, LumaFrames], pairs: list[tuple[int, int]], twice: bool
) -> None:
    """Any pairs in any order, doubled or none at all: bit by bit what luma() gives there."""
    renderer, frames = rendered
    view, pixel = (np.array([pair[i] for pair in pairs * (1 + twice)], np.int64) for i in (0, 1))
    samples = renderer.samples(VIEWS, view, pixel)
    assert samples.dtype == np.float32
    assert samples.shape == view.shape
    assert np.array_equal(samples, picked(frames, view, pixel))


def test_all_pixels_of_views_backwards(rendered: tuple[Renderer, LumaFrames]) -> None:
    """Whole frames as pairs, borders and corners included, in the opposite order: the same bits, from one view too."""
    renderer, frames = rendered
    pixel = np.tile(np.arange(33 * 17)[::-1], 3)
    view = np.repeat([17, 4, 4], 33 * 17)
    assert np.array_equal(renderer.samples(VIEWS, view, pixel), picked(frames, view, pixel))
    alone = renderer.samples(VIEWS[4:5], np.zeros(33 * 17, np.uint16), np.arange(33 * 17, dtype=np.uint32))
    assert np.array_equal(alone, frames[4].ravel())


def test_each_pair_has_its_own_view(rendered: tuple[Renderer, LumaFrames]) -> None:
    """A view for every pair, in the middle of the frame, at its borders and in its corners."""
    renderer, frames = rendered
    y, x = (i.ravel() for i in np.meshgrid([0, 1, 7, 15, 16], [0, 1, 20, 32], indexing="ij"))
    view = np.random.RandomState(1).permutation(20)
    assert np.array_equal(renderer.samples(VIEWS, view, y * 33 + x), frames[view, y, x])


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (2, 2), (3, 2)])
@every_renderer
def test_neighbourhoods_of_the_smallest_frames(kind: str, size: tuple[int, int]) -> None:
    """Frames of a row, a column or a few pixels are blurred alike as frames and as samples."""
    renderer = build(kind, blur=True, camera=Camera(*size, 9.0, 9.0, 1.0, 1.0))
    frames = renderer.luma(VIEWS)
    view, pixel = np.divmod(np.arange(20 * size[0] * size[1]), size[0] * size[1])
    for pick in (slice(None), slice(0, 1), slice(3, 4)):
        assert np.array_equal(renderer.samples(VIEWS, view[pick], pixel[pick]), picked(frames, view[pick], pixel[pick]))


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("blur", [False, True])
@every_renderer
def test_more_rays_are_those_of_a_finer_renderer(kind: str, blur: bool) -> None:
    """Asked for 16 rays a pixel, a renderer of 3 gives the bits of one of 16; and its own again afterwards."""
    coarse, fine = build(kind, rays_per_pixel=3, blur=blur), build(kind, rays_per_pixel=16, blur=blur)
    view, pixel = np.divmod(np.arange(0, 20 * 33 * 17, 7), 33 * 17)
    expected = picked(fine.luma(VIEWS), view, pixel)
    assert np.array_equal(coarse.samples(VIEWS, view, pixel, rays=16), expected)
    own = picked(coarse.luma(VIEWS), view, pixel)
    assert not np.array_equal(own, expected)
    assert np.array_equal(coarse.samples(VIEWS, view, pixel), own)
    assert np.array_equal(
        fine.samples(VIEWS, view, pixel, rays=1),
        picked(build(kind, rays_per_pixel=1, blur=blur).luma(VIEWS), view, pixel),
    )


@pytest.mark.parametrize("name", [FAST, SCALAR])
@pytest.mark.parametrize("blur", [False, True])
def test_noisy_samples_have_the_frames_random_numbers(name: str, blur: bool, request: pytest.FixtureRequest) -> None:
    """A path tracer's pixel has the same noise alone as in its frame, for its own and for another number of rays."""
    if name == FAST:
        request.getfixturevalue("llvm")
    camera = Camera(9, 7, 7.0, 7.0, 4.0, 3.0)
    ball = {"type": "sphere", "center": [0.2, 0.1, 0.6], "radius": 0.3}
    sky = {"type": "constant", "radiance": 0.7}
    with variant(name) as (mi, _):
        scene = load_scene_source(
            {"type": "scene", "by": {"type": "path"}, "sky": sky, "floor": FLOOR, "ball": ball}, mi
        )
    kind = IntegratorRenderer if name == FAST else ScalarRenderer
    renderer, other = (kind(scene, camera, rays_per_pixel=n, blur=blur, seed=7, reason="") for n in (2, 3))
    views = VIEWS[:3]
    frames = renderer.luma(views)
    assert frames.std() > 0.01
    view, pixel = (np.random.RandomState(0).randint(0, n, 25) for n in (3, 63))
    assert np.array_equal(renderer.samples(views, view, pixel), picked(frames, view, pixel))
    assert np.array_equal(renderer.samples(views, view, pixel, rays=3), picked(other.luma(views), view, pixel))


@pytest.mark.usefixtures("llvm")
@every_renderer
def test_no_views_and_no_pairs(kind: str) -> None:
    """Nothing asked for gives empty arrays."""
    renderer = build(kind, blur=True)
    assert renderer.samples(VIEWS, [], []).shape == (0,)
    assert renderer.luma(VIEWS[:0]).shape == (0, 17, 33)
    assert renderer.depth(VIEWS[:0]).shape == (0, 17, 33)
    assert renderer.flow(VIEWS[:0]).shape == (0, 17, 33, 2)
    assert [part.shape for part in renderer.luma_and_rate(VIEWS[:0])] == [(0, 17, 33)] * 2


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    ("view", "pixel", "rays", "message"),
    [
        ([0, 20], [0, 0], None, r"view must lie in 0\.\.19, got 20"),
        ([-1], [0], None, r"view must lie in 0\.\.19, got -1"),
        ([0], [33 * 17], None, r"pixel must lie in 0\.\.560, got 561"),
        ([0], [-2], None, r"pixel must lie in 0\.\.560, got -2"),
        ([0, 1], [0], None, "of one length, got 2 and 1"),
        ([0.5], [0], None, r"view must be whole numbers of shape \(m,\), got float64 of shape \(1,\)"),
        ([0], [[0]], None, r"pixel must be whole numbers of shape \(m,\), got int64 of shape \(1, 1\)"),
        ([0], [0], 0, r"1\.\.1024, got 0"),
        ([0], [0], 1025, r"1\.\.1024, got 1025"),
    ],
)
@every_renderer
def test_bad_pairs_are_refused(kind: str, view: Any, pixel: Any, rays: int | None, message: str) -> None:
    """Indices out of range, of another kind or shape, and ray counts out of range name the rule and the value."""
    with pytest.raises(ValueError, match=message):
        build(kind).samples(VIEWS, view, pixel, rays=rays)


def test_views_are_those_of_their_trajectory_or_poses() -> None:
    """Views hold what the trajectory says at its times, at the sequence's time; slices and index arrays keep order."""
    from davis_rs import SegmentTrajectory

    start, end = POSES[0], Pose([0.7, -0.8, 1.5], [0.0, 0.6, 0.0, 0.8])
    path = SegmentTrajectory(start, end, 2.0)
    t_s = np.array([0.25, 1.5, 0.5])
    views = Views.along(path, t_s, start_s=10.0)
    assert len(views) == 3
    assert np.array_equal(views.t_s, 10.0 + t_s)
    for i, t in enumerate(t_s):
        pose = path.pose(float(t))
        np.testing.assert_allclose(views.positions[i], pose.position, rtol=0, atol=1e-15)
        np.testing.assert_allclose(views.rotations[i], pose.rotation, rtol=0, atol=1e-15)
    assert np.array_equal(views.velocities, path.velocities(t_s))
    assert np.array_equal(views.angular_rates, path.angular_rates(t_s))
    assert np.array_equal(views[np.array([2, 0])].t_s, [10.5, 10.25])
    # A segment has a constant twist: moving on along it is being later on it.
    later = views[:1].moved([0.3])
    expected = Views.along(path, [0.55], start_s=10.0)
    for name in vars(views):
        np.testing.assert_allclose(getattr(later, name), getattr(expected, name), rtol=0, atol=1e-12)
    rest = Views.at_rest(POSES[:2], [3.0, 4.0])
    assert np.array_equal(rest.t_s, [3.0, 4.0])
    assert np.array_equal(rest.rotations[1], POSES[1].rotation)
    assert not rest.velocities.any()
    assert not rest.angular_rates.any()


def test_bad_views_are_refused() -> None:
    """Arrays of another shape or not finite raise ValueError that names the array."""
    good = {name: getattr(VIEWS, name) for name in vars(VIEWS)}
    with pytest.raises(ValueError, match=r"velocities of 20 views must have shape \(20, 3\), got \(19, 3\)"):
        Views(**{**good, "velocities": good["velocities"][1:]})
    with pytest.raises(ValueError, match="positions of views must be finite, got nan"):
        Views(**{**good, "positions": good["positions"] * np.nan})
