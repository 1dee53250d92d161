"""The instants of rendering: periodic ones exact, those by displacement neither too rare nor too many."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from math import floor

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs import CallableTrajectory, Camera, FixedRate, MaxDisplacement, Pose, Scene, SegmentTrajectory, Trajectory
from davis_rs.geometry.camera import PRESETS
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.sampling.displacement import DisplacementClock
from davis_rs.sampling.rules import ManyRendersWarning, periodic_instants
from lit_scenes import Parts, environment

FloatArray = npt.NDArray[np.float64]

PLAIN = Camera(60, 45, 50.0, 50.0, 29.5, 22.0)
LENS = PRESETS["davis240c"]


@pytest.mark.parametrize(
    ("rate_hz", "first"),
    [
        (40.0, [0, 25_000, 50_000, 75_000]),
        (1000.0, [0, 1000, 2000, 3000]),
        (30.0, [0, 33_333, 66_667, 100_000]),
        (3.0, [0, 333_333, 666_667, 1_000_000]),
        (1e6, [0, 1, 2, 3]),
        (400_000.0, [0, 3, 5, 8]),  # 2.5 us and 7.5 us: halves are rounded up
        (29.97, [0, 33_367, 66_733, 100_100]),
        (0.5, [0, 2_000_000, 4_000_000, 6_000_000]),
        (1e-3, [0, 1_000_000_000, 2_000_000_000, 3_000_000_000]),
    ],
)
def test_periodic_instants_of_common_rates(rate_hz: float, first: list[int]) -> None:
    """The first instants of a rate, by hand, and that both ends of the range belong to it."""
    assert list(periodic_instants(rate_hz, 0, first[-1])) == first
    assert list(periodic_instants(rate_hz, first[1], first[2])) == first[1:3]
    assert list(periodic_instants(rate_hz, first[1] + 1, first[2] - 1)) == []


@given(
    rate_hz=st.floats(0.01, 1e6),
    start_us=st.integers(0, 10**13),
    count=st.integers(0, 30),
)
def test_periodic_instants_are_exact_anywhere(rate_hz: float, start_us: int, count: int) -> None:
    """From any start on: the whole numbers floor(k 1e6 / rate + 1/2) of exact arithmetic, none left out or doubled."""
    period = 1_000_000 / Fraction(rate_hz)
    end_us = start_us + floor(count * period)
    first = max(0, floor(Fraction(start_us) / period) - 2)
    candidates = (floor(k * period + Fraction(1, 2)) for k in range(first, first + count + 6))
    expected = [t for t in candidates if start_us <= t <= end_us]
    assert list(periodic_instants(rate_hz, start_us, end_us)) == expected


@given(rate_hz=st.floats(1e3, 1e6), start_us=st.integers(0, 2_000))
def test_a_later_start_filters(rate_hz: float, start_us: int) -> None:
    """Starting later gives what starting at 0 gives from there on: the grid does not move with the start."""
    whole = periodic_instants(rate_hz, 0, 2_000)
    assert list(periodic_instants(rate_hz, start_us, 2_000)) == [t for t in whole if t >= start_us]


def test_rate_zero_and_impossible_rates() -> None:
    """Rate 0 means none; a rate that is negative, NaN or above one a microsecond is refused before anything runs."""
    assert list(periodic_instants(0.0, 0, 10**9)) == []
    for rate_hz in (-1.0, float("nan"), float("inf"), 1_000_001.0):
        with pytest.raises(ValueError, match=rf"0\.\.1000000 Hz, got {rate_hz}"):
            periodic_instants(rate_hz, 0, 1)


def tilted_floor(camera: Camera, kind: str = "auto") -> Renderer:
    """A tilted floor with a box on it, seen from some two metres by cameras near POSE."""
    tilt, box = np.eye(4), np.diag([0.3, 0.3, 0.3, 1.0])
    tilt[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.0]).as_matrix() * (30.0, 30.0, 1.0)
    box[:3, 3] = (0.3, 0.2, 0.6)
    diffuse = {"type": "diffuse", "reflectance": 0.5}
    source = {
        "type": "scene",
        "light": {"type": "point", "position": [0.0, 0.0, 3.0], "intensity": 1.0},
        "floor": {"type": "rectangle", "to_world": tilt, "bsdf": {"type": "twosided", "inner": diffuse}},
        "box": {"type": "cube", "to_world": box, "bsdf": diffuse},
    }
    return make_renderer(Scene("floor", partial(dict, source)), camera, kind=kind, rays_per_pixel=1)


# Looks down, turned about its axis and tilted: its rotation is not its own transpose.
START = Pose(
    [0.1, -0.3, 2.2],
    (Rotation.from_rotvec([np.pi, 0.0, 0.0]) * Rotation.from_rotvec([0.15, -0.1, 0.9])).as_quat(),
)


def translation() -> Trajectory:
    return SegmentTrajectory(START, Pose(np.add(START.position, [0.25, 0.1, 0.15]), START.quaternion), 0.12)


def approach() -> Trajectory:
    """So fast towards the floor that it comes nearer by a tenth in the time between two depth maps."""
    return SegmentTrajectory(START, Pose(np.add(START.position, [0.1, 0.05, -0.8]), START.quaternion), 0.05)


def rotation() -> Trajectory:
    turned = Rotation.from_quat(START.quaternion) * Rotation.from_rotvec([0.12, -0.1, 0.25])
    return SegmentTrajectory(START, Pose(START.position, turned.as_quat()), 0.12)


def shaken() -> Trajectory:
    """Accelerating and turning at once: the speed changes from one instant to the next."""
    base = Rotation.from_quat(START.quaternion)

    def turn(t: FloatArray) -> FloatArray:
        return np.outer(np.sin(30 * t), [0.0, 0.08, 0.0])

    return CallableTrajectory(
        0.2,
        position=lambda t: START.position + np.outer(np.sin(40 * t), [0.05, -0.03, 0.02]),
        quaternion=lambda t: (base * Rotation.from_rotvec(turn(t))).as_quat(),
        velocity=lambda t: np.outer(40 * np.cos(40 * t), [0.05, -0.03, 0.02]),
        angular_rate=lambda t: np.outer(30 * np.cos(30 * t), [0.0, 0.08, 0.0]),
        description={},
    )


def largest_displacements(renderer: Renderer, trajectory: Trajectory, instants: list[int]) -> FloatArray:
    """How far the fastest pixel moves from each instant to the next: its scene point, from the depth map, projected
    again from the next pose."""
    camera = renderer.camera
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([x, y], -1)
    rays = np.concatenate([camera.rays(pixels), np.ones((*x.shape, 1))], -1)
    largest = []
    for start_us, stop_us in zip([0, *instants], instants, strict=False):
        start, stop = (trajectory.pose(t * 1e-6) for t in (start_us, stop_us))
        points = start.position + renderer.depth(Views.at_rest([start]))[0][..., None] * rays @ start.rotation.T
        moved = camera.project((points - stop.position) @ stop.rotation)
        inside = ((moved >= 0) & (moved <= (camera.width - 1, camera.height - 1))).all(-1)
        largest.append(np.linalg.norm(moved - pixels, axis=-1)[inside].max())
    return np.array(largest)


@pytest.mark.few(3)
@pytest.mark.parametrize(("camera", "pixels"), [(PLAIN, 1 / 3), (PLAIN, 1.0), (LENS, 1.0)])
@pytest.mark.parametrize("path", [translation, approach, rotation, shaken])
@pytest.mark.usefixtures("llvm")
def test_no_pixel_moves_farther_than_asked(path: Callable[[], Trajectory], camera: Camera, pixels: float) -> None:
    """Between two instants the fastest pixel moves by at most the displacement (+ 5 %), on average by 0.8 at least."""
    renderer, trajectory = tilted_floor(camera), path()
    end_us = round(trajectory.duration_s * 1e6)
    instants = list(MaxDisplacement(pixels).instants(renderer, trajectory, end_us))
    assert len(instants) > 5
    assert all(a < b for a, b in zip([0, *instants], instants, strict=False))
    assert instants[-1] <= end_us
    displacements = largest_displacements(renderer, trajectory, instants)
    assert displacements.max() <= 1.05 * pixels
    # On an approach the nearest depth of each 10 ms counts; where a path turns back its end is nearer than it went far.
    assert displacements.mean() > (0.95 if path in (translation, rotation) else 0.8) * pixels
    # What is left over after the last instant is less than one more displacement.
    rest = largest_displacements(renderer, trajectory, [instants[-1], end_us])
    assert rest[-1] <= 1.05 * pixels


def test_a_camera_at_rest_asks_for_nothing() -> None:
    """A still camera gives no instants, whatever it sees; so does a translation past nothing at all."""
    renderer = tilted_floor(PLAIN)
    assert list(MaxDisplacement().instants(renderer, SegmentTrajectory(START, START, 0.1), 100_000)) == []
    up = Pose([0.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    away = SegmentTrajectory(up, Pose([0.5, 0.2, 3.0], up.quaternion), 0.05)
    assert np.isinf(renderer.depth(Views.at_rest([up]))).all()
    assert list(MaxDisplacement().instants(renderer, away, 50_000)) == []


def test_a_rotation_counts_where_nothing_is_seen_but_a_background_that_may_have_a_pattern() -> None:
    """The flow of a rotation needs no depth: by the lens alone, f (1 + x^2) w at the edge. The native renderer knows
    that its background has no pattern."""
    up = Pose([0.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    turned = Pose(up.position, Rotation.from_rotvec([0.0, 0.4, 0.0]).as_quat())
    path = SegmentTrajectory(up, turned, 0.05)
    assert not list(MaxDisplacement(1.0).instants(tilted_floor(PLAIN), path, 50_000))
    instants = list(MaxDisplacement(1.0).instants(tilted_floor(PLAIN, "integrator"), path, 50_000))
    edge = 50.0 * (1 + (28.0 / 50.0) ** 2) * 0.4  # centre of the outermost 4 x 4 tile
    assert len(instants) == pytest.approx(edge, abs=1.5)
    np.testing.assert_allclose(np.diff(instants), 50_000 / edge, atol=3 + 0.03 * 50_000 / edge)


def alone(half_m: float, **more: object) -> Scene:
    """Return a square in front of a black background, two metres below a camera at START's height."""
    placed = np.diag([half_m, half_m, 1.0, 1.0])
    light = {"type": "point", "position": [0.0, 0.0, 3.0], "intensity": 1.0}
    source = {"type": "scene", "light": light, "square": {"type": "rectangle", "to_world": placed}, **more}
    return Scene("alone", partial(dict, source))


DOWN = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
ABOVE = Pose([0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0])
"""Two metres above the square, looking down."""


@pytest.mark.parametrize("half_m", [0.3, 0.001])
def test_what_is_seen_counts_and_the_background_does_not(half_m: float) -> None:
    """A camera goes around a square that stays in the middle: the square hardly moves, and the background does, by
    the rotation. So too for one of a tenth of a pixel, which the centres of pixels miss."""
    renderer = make_renderer(alone(half_m), PLAIN, rays_per_pixel=1)
    angle, duration_s = 0.05, 0.05
    end = Pose(
        [-2.0 * np.sin(angle), 0.0, 2.0 * np.cos(angle)], (Rotation.from_rotvec([0, -angle, 0]) * DOWN).as_quat()
    )
    around = SegmentTrajectory(ABOVE, end, duration_s)
    clock = DisplacementClock(renderer, around, 50_000)
    # At its corners and by the chord of the circle the square moves, too.
    by_square, by_background = 50.0 * angle * (half_m / 2.0 + 0.03), 50.0 * angle * (1 + 0.56**2)
    assert clock.path_at(50_000) < min(2 * by_square + 0.1, 0.35 * by_background)
    sideways = SegmentTrajectory(ABOVE, Pose([0.1, 0.0, 2.0], ABOVE.quaternion), duration_s)
    path = DisplacementClock(renderer, sideways, 50_000).path_at(50_000)
    assert path == pytest.approx(50.0 * 0.1 / 2.0, rel=0.02)


@pytest.mark.parametrize("pattern", ["sky", "gloss"])
def test_backgrounds_count_that_have_a_pattern_or_are_reflected(pattern: str) -> None:
    more: dict[str, Parts] = {
        "sky": {"sky": environment(np.ones((4, 8, 3)))},
        "gloss": {"ball": {"type": "cube", "to_world": np.diag([0.2, 0.2, 0.2, 1.0]), "bsdf": {"type": "conductor"}}},
    }[pattern]
    renderer = make_renderer(alone(0.3, **more), PLAIN, rays_per_pixel=1)
    assert isinstance(renderer, NativeRenderer)
    turned = SegmentTrajectory(ABOVE, Pose(ABOVE.position, (DOWN * Rotation.from_rotvec([0, 0.05, 0])).as_quat()), 0.05)
    path = DisplacementClock(renderer, turned, 50_000).path_at(50_000)
    assert path == pytest.approx(50.0 * 0.05 * (1 + (28.0 / 50.0) ** 2), rel=0.02)


def test_instants_do_not_depend_on_what_is_rendered_between() -> None:
    """The instants are the same at once, one by one with images rendered between, and from another renderer."""
    renderer, trajectory = tilted_floor(PLAIN), translation()
    at_once = list(MaxDisplacement(0.5).instants(renderer, trajectory, 120_000))
    one_by_one = []
    for t_us in MaxDisplacement(0.5).instants(renderer, trajectory, 120_000):
        renderer.luma(Views.at_rest([trajectory.pose(t_us * 1e-6)] * 3))
        renderer.depth(Views.at_rest([START, START]))
        one_by_one.append(t_us)
    assert one_by_one == at_once
    assert list(MaxDisplacement(0.5).instants(tilted_floor(PLAIN), trajectory, 120_000)) == at_once


def test_twice_the_displacement_half_the_instants() -> None:
    """Instants of a displacement of 1 px are every other one of those of 0.5 px: the path is cut, not rescanned."""
    renderer, trajectory = tilted_floor(PLAIN), translation()
    fine, coarse = (list(MaxDisplacement(px).instants(renderer, trajectory, 120_000)) for px in (0.5, 1.0))
    np.testing.assert_allclose(fine[1::2], coarse, atol=1)


def test_fixed_rate_renders_at_its_rate() -> None:
    """FixedRate gives the periodic instants in (0, end], without the start, whatever moves."""
    renderer, trajectory = tilted_floor(PLAIN), SegmentTrajectory(START, START, 0.1)
    assert list(FixedRate(300.0).instants(renderer, trajectory, 10_000)) == [3333, 6667, 10_000]
    assert list(FixedRate(1000.0).instants(renderer, trajectory, 2999)) == [1000, 2000]


def test_a_tiny_displacement_is_a_render_each_microsecond_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of renders is forecast, and found in as many steps: not in one for each of 10^9 displacements."""
    asked = []
    span_end = DisplacementClock.span_end

    def counted(*given: object) -> object:
        asked.append(given)
        assert len(asked) < 2000
        return span_end(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(DisplacementClock, "span_end", counted)
    renderer = tilted_floor(PLAIN)
    assert list(MaxDisplacement(1e-9).instants(renderer, translation(), 500)) == list(range(1, 500))
    with pytest.warns(
        ManyRendersWarning, match=r"displacement of 1e-09 px .* asks for about 1\.2e\+05 renders of 0\.12 s"
    ):
        next(MaxDisplacement(1e-9).instants(renderer, translation(), 120_000))


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_settings_are_refused(value: float) -> None:
    """Displacements and rates that are not positive and finite raise ValueError with the value."""
    with pytest.raises(ValueError, match=f"pixels must be finite and > 0, got {value}"):
        MaxDisplacement(value)
    with pytest.raises(ValueError, match=f"rate_hz must be > 0 and at most 1000000 Hz, got {value}"):
        FixedRate(value)
