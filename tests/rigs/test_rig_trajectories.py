"""Paths of what is mounted on a body, and of clocks of another pace, against differences and against the definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from davis_rs import CallableTrajectory, Flicker, Pose, SegmentTrajectory, Trajectory, load_scene
from davis_rs.geometry.pose import IDENTITY
from davis_rs.geometry.trajectory.derived import MountedTrajectory, PacedTrajectory
from davis_rs.scene.light_profile import PacedProfile

MOUNT = Pose((0.3, -0.2, 0.5), (0.1, -0.5, 0.3, 0.8062257748298549))
T = np.linspace(0.0, 0.9, 13)


def body() -> Trajectory:
    """A path that turns about a fixed axis at a rate that changes, and is thrown."""
    axis = np.array([2.0, -1.0, 2.0]) / 3

    def angle(t: np.ndarray) -> np.ndarray:
        return 0.4 * t + 1.5 * t**2

    return CallableTrajectory(
        1.0,
        position=lambda t: np.stack([t, 2 * t**2, np.sin(3 * t)], 1),
        velocity=lambda t: np.stack([np.ones_like(t), 4 * t, 3 * np.cos(3 * t)], 1),
        acceleration=lambda t: np.stack([0 * t, 4 + 0 * t, -9 * np.sin(3 * t)], 1),
        quaternion=lambda t: np.concatenate([np.sin(angle(t) / 2)[:, None] * axis, np.cos(angle(t) / 2)[:, None]], 1),
        angular_rate=lambda t: (0.4 + 3 * t)[:, None] * axis,
        angular_acceleration=lambda t: np.full((len(t), 1), 3.0) * axis,
        breaks_s=[0.5],
        description={},
    )


def check_derivatives(path: Trajectory) -> None:
    """Velocities, rates and their derivatives are those of the poses."""
    step, t = 1e-5, T[1:-1] * path.duration_s
    later, before = path.positions(t + step), path.positions(t - step)
    assert np.allclose(path.velocities(t), (later - before) / (2 * step), atol=1e-7)
    assert np.allclose(path.accelerations(t), (later - 2 * path.positions(t) + before) / step**2, atol=1e-4)
    turn = np.swapaxes(path.rotations(t - step), 1, 2) @ path.rotations(t + step)
    skew = (turn - np.swapaxes(turn, 1, 2)) / (4 * step)
    assert np.allclose(path.angular_rates(t), np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1), atol=1e-7)
    rates = (path.angular_rates(t + step) - path.angular_rates(t - step)) / (2 * step)
    assert np.allclose(path.angular_accelerations(t), rates, atol=1e-7)


def test_a_mounted_camera_moves_with_the_body() -> None:
    path = MountedTrajectory(body(), MOUNT)
    for t in T:
        assert np.allclose(path.pose(t).matrix, body().pose(t).matrix @ MOUNT.matrix, atol=1e-12)
    check_derivatives(path)
    assert path.breaks_s().tolist() == [0.5]
    assert path.describe()["kind"] == "mounted"


@pytest.mark.parametrize("pace", [0.9, 1.25])
def test_another_pace_tells_the_same_motion_at_other_times(pace: float) -> None:
    path = PacedTrajectory(body(), pace)
    assert path.duration_s == pace
    assert np.allclose(path.positions(pace * T), body().positions(T))
    assert np.allclose(path.quaternions(pace * T), body().quaternions(T))
    check_derivatives(path)
    assert path.breaks_s().tolist() == [0.5 * pace]


def test_a_light_by_another_pace() -> None:
    light, paced = (
        Flicker(100.0, modulation=0.5, waveform="square"),
        PacedProfile(Flicker(100.0, modulation=0.5, waveform="square"), 2.0),
    )
    assert np.array_equal(paced.factor(2 * T), light.factor(T))
    assert np.allclose(paced.breaks_s(0.0, 0.1), 2 * light.breaks_s(0.0, 0.05))
    sine = PacedProfile(Flicker(10.0, modulation=0.5), 2.0)
    step = 1e-6
    assert np.allclose(sine.rate(T), (sine.factor(T + step) - sine.factor(T - step)) / (2 * step), atol=1e-6)


def test_a_scene_by_another_pace() -> None:
    scene = load_scene("three_planes")
    objects = {"ball": SegmentTrajectory(IDENTITY, MOUNT, 0.4)}
    paced = replace(scene, objects=objects, lights={"lamp": Flicker(50.0, modulation=0.5)}).paced(1.5)
    assert paced.path.duration_s == pytest.approx(1.5 * scene.path.duration_s)
    assert np.allclose(paced.objects["ball"].pose(0.3).matrix, objects["ball"].pose(0.2).matrix)
    assert paced.lights["lamp"].factor([0.3]) == pytest.approx(Flicker(50.0, modulation=0.5).factor([0.2]))


def test_poses_compose_and_invert() -> None:
    other = Pose((-1.0, 2.0, 0.5), (0.5, -0.5, 0.5, 0.5))
    assert np.allclose((MOUNT @ other).matrix, MOUNT.matrix @ other.matrix)
    assert np.allclose(MOUNT.inverse.matrix, np.linalg.inv(MOUNT.matrix))
    with pytest.raises(TypeError):
        _ = MOUNT @ "left"  # type: ignore[operator]
