"""What makes short steps cheap changes no result: the same instants, bits and tiles as the plain ways."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs import CallableTrajectory, Camera, Pose, Scene, SegmentTrajectory, Simulator, load_scene
from davis_rs._util.few_numbers import all_finite, all_within
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.pose import hamilton, rotation_matrices
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.flow import OpticalFlow
from davis_rs.render.mosaic import MosaicRenderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.rays.camera_rays import pixel_centres
from davis_rs.sampling import rules, tolerance
from davis_rs.sampling.displacement import DisplacementClock, _least_of_rows, path_bound
from davis_rs.sampling.keyframes import Stretch
from davis_rs.sampling.rules import periodic_instants
from davis_rs.simulation import simulator
from moving_scene import BOX, DIRECT, FLOOR, LAMP, diffuse, placed


@pytest.mark.parametrize("rate_hz", [1.0, 24.0, 30.0, 1000 / 3, 123.456, 1e6, 7.0])
@pytest.mark.parametrize(("start_us", "end_us"), [(0, 100_000), (99_999, 140_001), (10**12, 10**12 + 50_000)])
def test_periodic_instants_are_rounded_exactly(rate_hz: float, start_us: int, end_us: int) -> None:
    """Half up, in exact arithmetic."""
    period = 1_000_000 / Fraction(rate_hz)
    if rate_hz == 1e6:
        end_us = start_us + 100
    first = max(0, int(start_us / period) - 2)
    rounded = (int(k * period + Fraction(1, 2)) for k in range(first, int(end_us / period) + 3))
    assert list(periodic_instants(rate_hz, start_us, end_us)) == [t for t in rounded if start_us <= t <= end_us]


def test_few_rotations_have_the_bits_of_many() -> None:
    """Plain floats for one or two, SciPy for more; quaternions need not be of norm 1."""
    quaternions = np.random.default_rng(1).normal(size=(2000, 4))
    expected = Rotation.from_quat(quaternions).as_matrix()
    for count in (1, 2, 5):
        blocks = [rotation_matrices(quaternions[i : i + count]) for i in range(0, 1000, count)]
        assert np.array_equal(np.concatenate(blocks), expected[: 1000 // count * count])
    assert rotation_matrices(quaternions[:0]).shape == (0, 3, 3)
    assert np.array_equal(rotation_matrices(quaternions[0]), expected[0])


def test_products_of_quaternions_have_the_bits_of_cross_products() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 500, 4))
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    expected = np.concatenate([aw * bv + bw * av + np.cross(av, bv), aw * bw - (av * bv).sum(-1, keepdims=True)], -1)
    assert np.array_equal(hamilton(a, b), expected)
    assert np.array_equal(hamilton(a[0], b), np.stack([hamilton(a[0], each) for each in b]))
    assert np.array_equal(hamilton(a, b), np.stack([hamilton(one, each) for one, each in zip(a, b, strict=True)]))


@pytest.mark.parametrize("rows", [1, 3, 4, 5, 8, 47])
def test_the_least_of_rows(rows: int) -> None:
    """Four rows each; the last tile has what is left."""
    values = np.random.default_rng(rows).uniform(size=(2, rows, 7)).astype(np.float32)
    expected = np.minimum.reduceat(values, np.arange(0, rows, 4), 1)
    assert np.array_equal(_least_of_rows(values), expected)


class Unsteady(SegmentTrajectory):
    """The same motion, about which nothing is known."""

    steady = False


@pytest.mark.parametrize("moves", [False, True])
def test_a_steady_camera_has_the_same_clock(moves: bool) -> None:
    """Its own motion does not bend, but that of objects may."""
    start = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
    end = Pose([0.52, -0.9, 1.8], start.quaternion)
    rest = np.array([0.0, 0.0, 0.4])
    swing = CallableTrajectory(
        duration_s=1.0,
        position=lambda t: rest + 0.002 * np.sin(4000 * t)[:, None] * [1.0, 0.0, 0.0],
        velocity=lambda t: 8.0 * np.cos(4000 * t)[:, None] * [1.0, 0.0, 0.0],
        quaternion=lambda t: np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={},
    )
    source: partial[dict[str, object]] = partial(
        dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}
    )
    scene = Scene("swing", source, objects={"box": swing} if moves else {})
    renderer = make_renderer(scene, Camera(40, 30, 33.0, 33.0, 19.5, 14.5), rays_per_pixel=1)
    clocks = [DisplacementClock(renderer, path(start, end, 0.003), 3000) for path in (SegmentTrajectory, Unsteady)]
    paths = [[clock.path_at(t_us) for t_us in range(0, 3001, 50)] for clock in clocks]
    assert paths[0] == paths[1]
    assert paths[0][-1] > (0.5 if moves else 0.05)


LENS = Camera(64, 48, 60.0, 62.0, 30.0, 25.0, k1=-0.3, k2=0.1)


@given(
    seed=st.integers(0, 2**32 - 1),
    step_us=st.integers(1, 1000),
    metres=st.sampled_from([0.0, 1e-3, 0.1, 0.4]),
    radians=st.sampled_from([0.0, 1e-3, 0.1]),
)
def test_no_step_is_longer_than_its_bound(seed: int, step_us: int, metres: float, radians: float) -> None:
    """From anywhere before a plane, whichever way it moves and turns, behind a lens: the clock's path is
    not longer, nor is the bound four times as long."""
    random = np.random.default_rng(seed)
    renderer = _before_a_plane()
    position = random.uniform((-1, -1, -1), (1, 1, 0.5))
    # Towards the plane, off by up to the image's corner, so that the nearest point may lie in it anywhere.
    turn = Rotation.from_rotvec([*random.uniform(-0.6, 0.6, 2), random.uniform(-3, 3)])
    way, axis = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
    start = Pose(position, turn.as_quat())
    end = Pose(position + metres * way, (turn * Rotation.from_rotvec(radians * axis)).as_quat())
    path = SegmentTrajectory(start, end, step_us * 1e-6)
    clock = DisplacementClock(renderer, path, step_us)
    moved = clock.path_at(step_us)
    assert clock.span_end(0, 1.000001 * moved + 1e-9, moved / 8) is None
    assert path_bound(renderer, path, step_us) >= moved
    if metres < 0.1:
        assert path_bound(renderer, path, step_us) < 4 * moved + 1e-9


@pytest.mark.parametrize("corner", [(0, 0), (63, 0), (0, 47), (63, 47)])
@pytest.mark.parametrize("towards", [0.0, 0.9])
def test_the_bound_of_a_step_counts_what_lies_in_the_corner(corner: tuple[int, int], towards: float) -> None:
    """The nearest point of the plane is seen in a corner, where depth is smallest compared with the distance."""
    renderer = _before_a_plane()
    ray = np.array([*LENS.rays([corner])[0], 1.0])
    ray /= np.linalg.norm(ray)
    turn, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [ray])
    position = np.array([0.1, 0.2, 0.9])
    way = 1e-3 * turn.apply([1.0, 1.0, 0.0])
    end = position + (100 * way + [0.0, 0.0, 0.1 * towards] if towards else way)
    path = SegmentTrajectory(Pose(position, turn.as_quat()), Pose(end, turn.as_quat()), 1e-3)
    moved = DisplacementClock(renderer, path, 1000).path_at(1000)
    assert path_bound(renderer, path, 1000) >= moved


def test_no_flow_is_faster_than_the_fastest() -> None:
    """Of cameras that move by 1 m/s, or turn by 1 rad/s, in any direction; some come close."""
    flow = OpticalFlow(LENS, pixel_centres(LENS))
    ways = np.random.default_rng(1).normal(size=(2000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    still, eyes = np.zeros_like(ways), np.tile(np.eye(3), (len(ways), 1, 1))
    times = np.zeros(len(ways))
    for views, bound in zip(
        (Views(times, still, eyes, ways, still), Views(times, still, eyes, still, ways)), flow.fastest(), strict=True
    ):
        fastest = np.linalg.norm(flow(views, np.ones(64 * 48)), axis=-1).max()
        assert 0.99 * bound < fastest <= bound * (1 + 1e-12)


def _before_a_plane() -> NativeRenderer:
    """Return the renderer of a wide plane 1 m above the origin."""
    wall = placed("rectangle", [0, 0, 1], [80, 80, 1], diffuse())
    scene = Scene("wall", lambda: {"type": "scene", "by": DIRECT, "lamp": LAMP, "wall": wall})
    renderer = make_renderer(scene, LENS, rays_per_pixel=1)
    assert isinstance(renderer, NativeRenderer)
    return renderer


@pytest.mark.parametrize("accuracy", ["fast", "balanced"])
def test_steps_have_the_same_keyframes_with_and_without_the_clock(
    monkeypatch: pytest.MonkeyPatch, accuracy: str
) -> None:
    """Slow steps ask no clock, fast and long ones do; events and frames are the same bits."""
    scene = load_scene("three_planes")
    path, times = scene.path, [0, 400, 1400, 2400, 12_400, 12_900, 13_900]

    def events() -> list[np.ndarray]:
        simulator = Simulator(scene, accuracy=accuracy, camera=LENS)
        return [packet.events for t in times for packet in simulator.step(t, path.pose(min(20 * t * 1e-6, 1.9)))]

    clocks: list[int] = []

    class CountedClock(DisplacementClock):
        def __init__(self, *args: object, **named: object) -> None:
            clocks.append(1)
            super().__init__(*args, **named)  # type: ignore[arg-type]

    for module in (rules, tolerance):
        monkeypatch.setattr(module, "DisplacementClock", CountedClock)
    quick = events()
    assert 0 < len(clocks) < len(times)
    for module in (rules, tolerance):
        monkeypatch.setattr(module, "path_bound", lambda *args: np.inf)
    slow = events()
    assert sum(map(len, slow)) > 1000
    assert all(np.array_equal(a, b) for a, b in zip(quick, slow, strict=True))


def test_a_step_begins_with_the_luma_that_the_last_one_ended_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step renders one keyframe; the events are those of steps that render their start, too."""
    scene = load_scene("three_planes")
    times = range(0, 8000, 1000)

    def steps() -> tuple[np.ndarray, list[int]]:
        made = Simulator(scene, accuracy="balanced", camera=LENS)
        rendered, luma = [], made.renderer.luma

        def counted(views: Views) -> LumaFrames:
            rendered.append(len(views))
            return luma(views)

        monkeypatch.setattr(made.renderer, "luma", counted)
        packets = [packet for t in times for packet in made.step(t, scene.path.pose(5 * t * 1e-6))]
        return np.concatenate([packet.events for packet in packets]), rendered

    events, rendered = steps()
    monkeypatch.setattr(simulator, "Stretch", lambda **named: Stretch(**{**named, "start_luma": None}))
    again, twice = steps()
    assert sum(twice) == sum(rendered) + len(times) - 1
    assert len(events) == len(again) > 1000
    pixel = np.lexsort((events["x"], events["y"])), np.lexsort((again["x"], again["y"]))
    assert np.abs(events["t"][pixel[0]] - again["t"][pixel[1]]).max() <= 1


def test_what_moves_or_bends_needs_the_clock() -> None:
    """A bound by the camera's own motion would leave out a body, a light, or light that is baked for instants."""
    scene = load_scene("three_planes")
    renderer = make_renderer(scene, LENS, rays_per_pixel=1)
    pose = scene.path.pose(0.0)
    rest = SegmentTrajectory(pose, pose, 1e-3)
    assert path_bound(renderer, rest, 1000) == 0
    assert path_bound(renderer, SegmentTrajectory(pose, pose, 1.001e-3), 1001) == np.inf
    assert path_bound(renderer, Unsteady(pose, pose, 1e-3), 1000) == np.inf
    renderer.motion = renderer.motion.with_bends([1e-4, 2e-4])
    assert path_bound(renderer, rest, 1000) == np.inf
    source: partial[dict[str, object]] = partial(
        dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}
    )
    moving = Scene("moving", source, objects={"box": scene.path})
    assert path_bound(make_renderer(moving, LENS, rays_per_pixel=1), rest, 1000) == np.inf


def test_the_nearest_surface_is_as_far_as_depth_says() -> None:
    """A plane ahead: its distance, from whichever way the camera looks; other renderers do not know."""
    scene = load_scene("three_planes")
    renderer = make_renderer(scene, LENS, rays_per_pixel=1)
    for t_s in (0.0, 0.7):
        pose = scene.path.pose(t_s)
        views = SegmentTrajectory(pose, pose, 1.0)
        depth = renderer.depth(Views.along(views, [0.0]))[0]
        rays = LENS.rays(pixel_centres(LENS)).reshape(48, 64, 2)
        along = depth * np.sqrt(1 + (rays**2).sum(-1))
        nearest = renderer.nearest_distance(pose.position)
        assert 0.5 < nearest <= along.min() * (1 + 1e-6)
    mosaic = MosaicRenderer([renderer] * 3, np.zeros((48, 64), np.uint8))
    assert mosaic.nearest_distance(pose.position) == nearest
    table = make_renderer(scene, LENS, rays_per_pixel=1, kind="table")
    assert table.nearest_distance(pose.position) == 0


@pytest.mark.parametrize("size", [0, 1, 3, 16, 17, 40])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -0.1, 1.1])
def test_few_numbers_are_checked_as_many(size: int, bad: float) -> None:
    """Wherever the bad one stands."""
    good = np.linspace(0, 1, size)
    assert all_finite(good)
    assert all_within(good, 0.0, 1.0)
    for at in range(size):
        numbers = good.copy()
        numbers[at] = bad
        assert all_finite(numbers) == np.isfinite(bad)
        assert not all_within(numbers, 0.0, 1.0)
