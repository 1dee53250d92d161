"""Trajectories by rule and from control points, their derivatives, and writing them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Trajectory, waypoint_trajectory, write_trajectory
from davis_rs.geometry.pose import Pose
from davis_rs.geometry.trajectory.motions import Kind, hand_held, running, slider, spiral, walking, zigzag

# Looking along the world's y axis, x right, y down.
START = Pose([1.0, 2.0, 1.5], [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
SKEW = Pose([1.0, 2.0, 1.5], Rotation.from_euler("xyz", [-1.4, 0.2, 0.5]).as_quat())

MOTIONS: dict[str, Trajectory] = {
    "slider": slider(SKEW, 0.3, 0.16),
    "rotation": hand_held(SKEW, 12.0, "rotation", top_speed_m_s=0.5, top_rate_rad_s=8.0),
    "translation": hand_held(SKEW, 12.0, "translation", top_speed_m_s=2.0, top_rate_rad_s=2.0),
    "6dof": hand_held(SKEW, 12.0, "6dof", top_speed_m_s=2.0, top_rate_rad_s=8.0),
    "zigzag": zigzag(SKEW, 3, 0.5, 1.0),
    "spiral": spiral(SKEW, 2.0, 0.4, 0.8),
    "walking": walking(SKEW, 4.0),
    "running": running(SKEW, 4.0),
}


@pytest.mark.parametrize("trajectory", MOTIONS.values(), ids=MOTIONS.keys())
def test_derivatives_are_those_of_the_poses(trajectory: Trajectory) -> None:
    """Velocity, acceleration, rate and angular acceleration agree with differences of what they derive from."""
    h = 1e-5
    t = np.linspace(0.05, trajectory.duration_s - 0.05, 50)
    velocity = (trajectory.positions(t + h) - trajectory.positions(t - h)) / (2 * h)
    acceleration = (trajectory.velocities(t + h) - trajectory.velocities(t - h)) / (2 * h)
    turn = Rotation.from_quat(trajectory.quaternions(t - h)).inv() * Rotation.from_quat(trajectory.quaternions(t + h))
    angular = (trajectory.angular_rates(t + h) - trajectory.angular_rates(t - h)) / (2 * h)
    assert np.allclose(trajectory.velocities(t), velocity, atol=1e-6)
    assert np.allclose(trajectory.accelerations(t), acceleration, atol=1e-4)
    assert np.allclose(trajectory.angular_rates(t), turn.as_rotvec() / (2 * h), atol=1e-5)
    assert np.allclose(trajectory.angular_accelerations(t), angular, atol=1e-4)


@pytest.mark.parametrize("name", [name for name in MOTIONS if name not in ("zigzag", "spiral")])
def test_starts_at_the_pose_that_is_given(name: str) -> None:
    """Hand-held, slider and strides: exactly there; the rule moves on from it."""
    pose = MOTIONS[name].pose(0.0)
    assert np.allclose(pose.position, SKEW.position, atol=1e-9)
    assert abs(pose.quaternion @ SKEW.quaternion) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("kind", ["rotation", "translation", "6dof"])
@pytest.mark.parametrize("duration_s", [1e-3, 0.05, 0.3, 1.0, 1.01])
@pytest.mark.parametrize("seed", range(4))
def test_hand_held_motion_may_be_short(duration_s: float, kind: Kind, seed: int) -> None:
    """A clip of 50 ms starts at the pose, moves at once, at the top speeds asked for and within a hand's reach."""
    path = hand_held(SKEW, duration_s, kind, top_speed_m_s=1.0, top_rate_rad_s=2.0, seed=seed)
    assert path.duration_s == pytest.approx(duration_s)
    top = path.top_speeds()
    assert top.speed_m_s == pytest.approx(1.0, rel=1e-4)
    assert top.rate_rad_s == pytest.approx(2.0, rel=1e-4)
    start = path.pose(0.0)
    assert np.allclose(start.position, SKEW.position, atol=1e-9)
    assert abs(start.quaternion @ SKEW.quaternion) == pytest.approx(1.0, abs=1e-9)
    t = np.linspace(0, duration_s, 200)
    assert np.linalg.norm(path.positions(t) - SKEW.position, axis=1).max() < min(1.001 * duration_s, 0.8)
    if duration_s <= 0.05:  # no start from rest, which would be a jerk
        assert np.linalg.norm(path.accelerations(t), axis=1).max() < 100


def test_slider_has_one_speed_and_no_turn() -> None:
    """To the right by default, at just the speed asked for."""
    path = slider(START, 0.5, 0.16)
    t = np.linspace(0, path.duration_s, 20)
    assert path.duration_s == pytest.approx(0.5 / 0.16)
    assert np.allclose(path.velocities(t), [0.16, 0, 0], atol=1e-15)
    assert np.allclose(path.positions([path.duration_s])[0], START.position + np.array([0.5, 0, 0]), atol=1e-12)
    assert not path.angular_rates(t).any()
    assert not path.accelerations(t).any()


@pytest.mark.long
@pytest.mark.parametrize("kind", ["rotation", "translation", "6dof"])
def test_hand_held_motion_grows_as_in_the_paper(kind: str) -> None:
    """One degree of freedom after the other in the first half, then all; faster to the end; the two tops reached."""
    path = hand_held(START, 60.0, kind, top_speed_m_s=2.51, top_rate_rad_s=np.radians(937))  # type: ignore[arg-type]
    top = path.top_speeds()
    assert top.speed_m_s == pytest.approx(2.51, rel=1e-4)
    assert top.rate_rad_s == pytest.approx(np.radians(937), rel=1e-4)
    t = np.arange(0, 60, 0.002)
    body = np.einsum("nji,nj->ni", path.rotations(t) * 0 + START.rotation, path.velocities(t))
    rates = path.angular_rates(t)
    moving = {"rotation": rates, "translation": body, "6dof": np.concatenate([rates, body], 1)}[kind]
    count = moving.shape[1]
    usual = moving[t > 52].std(0)
    for slot in range(count):  # in its middle that degree of freedom swings, and the others wander a little
        middle = (t > 30 * (slot + 0.3) / count) & (t < 30 * (slot + 0.7) / count)
        speeds = np.abs(moving[middle]).max(0) / usual
        assert speeds.argmax() == slot
        assert np.delete(speeds, slot).max() < 0.8 * speeds[slot]
    half_second = np.ones(250) / 250
    calmest = np.convolve((np.abs(moving) / usual).max(1), half_second, "valid")[500:]
    assert calmest.min() > 0.05  # a hand is never still: not between two slots, and not before all swing
    together = [moving[(t > a) & (t < a + 7)].std(0) for a in (31, 38, 45, 52)]
    assert (np.diff(together, axis=0) > 0).all()
    for speeds in np.split(together[-1], count // 3):  # rotations, translations
        assert speeds.min() > 0.5 * speeds.max()
    other = hand_held(START, 60.0, kind, top_speed_m_s=2.51, top_rate_rad_s=np.radians(937), seed=1)  # type: ignore[arg-type]
    assert not np.allclose(other.positions(t), path.positions(t), atol=0.01)


def test_zigzag_and_spiral_keep_their_speed_and_their_attitude() -> None:
    """Between the ramps the speed is constant to 1 %, and the camera looks ahead all the time."""
    for path in (zigzag(START, 4, 1.0, 1.2), zigzag(START, 4, 1.0, 1.2, through=True), spiral(START, 3, 0.5, 1.2)):
        speeds = np.linalg.norm(path.velocities(np.linspace(0.35, path.duration_s - 0.35, 500)), axis=1)
        assert np.allclose(speeds, 1.2, rtol=0.01)
        assert path.velocities([0.0])[0] == pytest.approx([0, 0, 0], abs=1e-3)
        assert np.abs(np.abs(path.quaternions(np.linspace(0, path.duration_s, 50)) @ START.quaternion) - 1).max() < 1e-9
    ahead = zigzag(START, 4, 1.0, 1.2).pose(zigzag(START, 4, 1.0, 1.2).duration_s).position - START.position
    assert ahead == pytest.approx([0.0, 4.0, 0.0], abs=1e-6)  # along y, where the camera looks


def test_strides_go_ahead_and_bob_with_each_step() -> None:
    """So far in so long, up and down at the rate of the steps, to the side at half of it."""
    for stride, speed, steps in ((walking, 1.4, 1.9), (running, 3.0, 2.8)):
        path = stride(START, 20.0)
        t = np.arange(0, 20, 0.01)
        p = path.positions(t) - START.position
        assert p[-1, 1] == pytest.approx(speed * 20, rel=0.01)
        for axis, hz in ((2, steps), (0, steps / 2)):
            spectrum = np.abs(np.fft.rfft(p[:, axis] - p[:, axis].mean()))
            assert np.fft.rfftfreq(len(t), 0.01)[spectrum.argmax()] == pytest.approx(hz, abs=0.1)


class TestWaypoints:
    corners = np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.5]])
    turns = Rotation.from_rotvec(np.outer(np.radians([0, 30, 60, 90]), [0, 0, 1])).as_quat()

    def test_through_passes_every_point_with_its_rotation(self) -> None:
        """The path comes within 0.1 mm and 0.01 deg of each."""
        path = waypoint_trajectory(self.corners, self.turns, speed_m_s=1.0)
        t = np.linspace(0, path.duration_s, 40_000)
        for corner, turn in zip(self.corners, self.turns, strict=True):
            distances = np.linalg.norm(path.positions(t) - corner, axis=1)
            nearest = int(distances.argmin())
            assert distances[nearest] < 1e-4
            assert 2 * np.arccos(min(1.0, abs(path.pose(t[nearest]).quaternion @ turn))) < np.radians(0.05)

    def test_near_keeps_within_the_hull_and_meets_the_ends(self) -> None:
        """A B-spline of control points: corners are cut, ends are met."""
        path = waypoint_trajectory(self.corners, self.turns, speed_m_s=1.0, through=False)
        p = path.positions(np.linspace(0, path.duration_s, 500))
        assert (p >= self.corners.min(0) - 1e-6).all()
        assert (p <= self.corners.max(0) + 1e-6).all()
        assert np.allclose(p[[0, -1]], self.corners[[0, -1]], atol=1e-9)
        assert np.linalg.norm(p - self.corners[1], axis=1).min() > 0.1

    def test_turns_on_the_spot(self) -> None:
        """A rotation without a way takes the time of 0.2 m a radian."""
        path = waypoint_trajectory(np.zeros((4, 3)), self.turns, speed_m_s=0.4, ramp_s=0.0)
        assert path.duration_s == pytest.approx(np.pi / 2 * 0.2 / 0.4, rel=0.02)
        rates = path.angular_rates(np.linspace(0.1, path.duration_s - 0.1, 50))
        assert np.allclose(rates, [0, 0, 2.0], rtol=0.03, atol=1e-6)

    def test_rules(self) -> None:
        """Each is an error that states it."""
        for points, turns, speed, message in (
            (self.corners[:1], self.turns[:1], 1.0, r"n >= 2, got \(1, 3\)"),
            (self.corners, self.turns * 1.1, 1.0, "norm 1 within"),
            (self.corners, self.turns, 0.0, "speed_m_s must be finite and > 0, got 0"),
            (self.corners[[0, 0]], self.turns[[0, 0]], 1.0, "waypoints 0 and 1 are the same"),
            (self.corners[:2], self.turns[[0, 3]], 1.0, "less than 90 degrees, got 90.0 between 0 and 1"),
        ):
            with pytest.raises(ValueError, match=message):
                waypoint_trajectory(points, turns, speed_m_s=speed)


@pytest.mark.parametrize("tum", [False, True])
def test_written_poses_are_read_back_bit_by_bit(tmp_path: object, tum: bool) -> None:
    """groundtruth.txt and TUM: 200 Hz from 0, nine decimals, exact numbers, a header for TUM alone."""
    from pathlib import Path

    from davis_rs import MotionCapture, read_trajectory

    path = Path(str(tmp_path)) / "poses.txt"
    trajectory = MOTIONS["6dof"]
    assert write_trajectory(trajectory, path, tum=tum) == 2401
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# timestamp tx") == tum
    assert lines[1 + tum].startswith("0.005000000 ")
    poses = MotionCapture().poses(trajectory)
    rows = np.array([[float(word) for word in line.split()] for line in lines[tum:]])
    assert np.array_equal(rows[:, 1:4], poses.positions)
    assert np.allclose(rows[:, 4:], poses.quaternions, atol=1e-15)
    read = read_trajectory(path, position_sigma_m=0, rotation_sigma_rad=0)
    t = poses.t_us * 1e-6
    assert np.allclose(read.positions(t), poses.positions, atol=1e-9)
