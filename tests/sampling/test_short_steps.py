"""What makes short steps cheap changes no result: the same instants, bits and tiles as the plain ways."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import CallableTrajectory, Camera, Pose, Scene, SegmentTrajectory
from davis_rs.geometry.pose import hamilton, rotation_matrices
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.displacement import DisplacementClock, _least_of_tiles
from davis_rs.sampling.rules import periodic_instants
from moving_scene import BOX, DIRECT, FLOOR, LAMP


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


@pytest.mark.parametrize("rows", [1, 3, 4, 5, 8, 47])
def test_the_least_of_tiles(rows: int) -> None:
    """Four rows each; the last tile has what is left."""
    values = np.random.default_rng(rows).uniform(size=(2, rows, 7)).astype(np.float32)
    expected = np.minimum.reduceat(values, np.arange(0, rows, 4), 1)
    assert np.array_equal(_least_of_tiles(values), expected)


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
