"""Motion capture with noise and a clock of its own, and finding that clock again."""

from __future__ import annotations

import functools
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import (
    Camera,
    Imu,
    MocapClock,
    MocapNoise,
    MotionCapture,
    SampledTrajectory,
    Simulator,
    align_clocks,
    load_scene,
    simulate_imu,
    start_pose,
)
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import Pose
from davis_rs.geometry.trajectory.motions import hand_held
from davis_rs.geometry.trajectory.trajectory_file import read_trajectory
from places import SHARED

POSTER = SHARED / "data" / "poster_6dof.csv"
START = Pose([0.0, 0.0, 1.5], [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


@functools.cache
def moving(duration_s: float = 12.0) -> SampledTrajectory:
    return hand_held(START, duration_s, "6dof", top_speed_m_s=1.5, top_rate_rad_s=6.0)


class TestMotionCapture:
    def test_by_default_it_is_exact_at_200_hz_from_0(self) -> None:
        """The trajectory's own poses every 5 ms, the last at the end."""
        poses = MotionCapture().poses(moving())
        assert np.array_equal(poses.t_us, np.arange(2401) * 5000)
        assert np.array_equal(poses.positions, moving().positions(poses.t_us * 1e-6))
        assert np.array_equal(poses.quaternions, moving().quaternions(poses.t_us * 1e-6))

    @pytest.mark.parametrize(("offset", "drift"), [(0.0, 1e-3), (0.0123, -1e-3), (-0.2, 2e-3 / 60)])
    def test_a_stamp_is_the_clock_at_the_time_of_the_pose(self, offset: float, drift: float) -> None:
        """The pose stamped t_mocap is that of (t_mocap - offset) / (1 + drift), and none lies outside the sequence."""
        poses = MotionCapture(clock=MocapClock(offset, drift)).poses(moving())
        t = (poses.t_us * 1e-6 - offset) / (1 + drift)
        assert np.allclose(poses.positions, moving().positions(t), atol=1e-12)
        assert (poses.t_us % 5000 == 0).all()
        assert poses.t_us[0] >= 0
        assert t[0] >= -1e-9
        assert t[-1] <= 12.0 + 1e-9
        assert t[-1] > 12.0 - 0.0051

    def test_noise_has_its_standard_deviations(self) -> None:
        """Per axis, in metres and radians, about 0; the same seed gives the same bytes, a longer run begins alike."""
        noise = MocapNoise(6.5e-4, 4.3e-3)
        exact, noisy, again, other = (
            MotionCapture(noise=n).poses(moving(), seed=seed)
            for n, seed in ((None, 1), (noise, 1), (noise, 1), (noise, 2))
        )
        shift = noisy.positions - exact.positions
        turn = (Rotation.from_quat(exact.quaternions).inv() * Rotation.from_quat(noisy.quaternions)).as_rotvec()
        bound = 5 / np.sqrt(2 * len(shift))
        assert np.allclose(shift.std(0), 6.5e-4, rtol=bound)
        assert np.allclose(turn.std(0), 4.3e-3, rtol=bound)
        assert np.abs(shift.mean(0)).max() < 5 * 6.5e-4 / np.sqrt(len(shift))
        assert ((noisy.quaternions * exact.quaternions).sum(1) > 0.99).all()
        assert noisy.positions.tobytes() == again.positions.tobytes()
        assert not np.isin(other.positions, noisy.positions).any()
        short = MotionCapture(noise=noise).poses(moving().crop(0.0, 3.0), seed=1)
        assert np.array_equal(short.positions, noisy.positions[: len(short.t_us)])

    def test_rules(self) -> None:
        """Values out of range are refused by name."""
        with pytest.raises(ValueError, match=r"drift must lie in -0\.1\.\.0\.1, got 1"):
            MocapClock(0.0, 1.0)
        with pytest.raises(ValueError, match=r"position_m must lie in 0\.\.1 m, got -1"):
            MocapNoise(-1.0)
        with pytest.raises(ValueError, match=r"rate_hz must lie in"):
            MotionCapture(-5.0)


class TestAlignment:
    @pytest.mark.parametrize(("offset", "drift"), [(0.0, 0.0), (0.0137, 2e-3 / 60), (-0.31, -1e-3)])
    def test_exact_poses_and_gyro_give_the_clock_back(self, offset: float, drift: float) -> None:
        """Without noise, to 10 us and 0.1 ms a minute, with the IMU's mounting unknown."""
        poses = MotionCapture(clock=MocapClock(offset, drift)).poses(moving())
        samples = simulate_imu(moving(), Imu(mounting=Imu.mpu6150().mounting))
        found = align_clocks(poses, imu=samples, position_sigma_m=0, rotation_sigma_rad=0)
        assert found.offset_s == pytest.approx(offset, abs=1e-5)
        assert found.drift == pytest.approx(drift, abs=1e-4 / 60)
        assert found.unexplained < 1e-5
        back = found.camera_times_us(poses.t_us)
        assert np.abs(back - (poses.t_us - offset * 1e6) / (1 + drift)).max() < 20

    @pytest.mark.long
    @pytest.mark.skipif(not POSTER.exists(), reason="needs ../shared/data")
    def test_a_noisy_minute_gives_the_clock_back(self) -> None:
        """With motion-capture noise and all effects of the MPU-6150: 0.3 ms, and 0.5 of the 2 ms a minute of drift."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # gaps that the recording has
            trajectory = read_trajectory(POSTER)
        clock = MocapClock(0.0137)
        poses = MotionCapture(noise=MocapNoise(), clock=clock).poses(trajectory, seed=1)
        found = align_clocks(poses, imu=simulate_imu(trajectory, Imu.mpu6150(), seed=1), imu_lag_s=0.0024)
        assert found.offset_s == pytest.approx(clock.offset_s, abs=3e-4)
        assert found.drift == pytest.approx(clock.drift, abs=0.5e-3 / 60)
        assert abs(found.offset_s - clock.offset_s) < 4 * found.offset_sigma_s
        assert abs(found.drift - clock.drift) < 4 * found.drift_sigma

    @pytest.mark.long
    @pytest.mark.usefixtures("llvm")
    @pytest.mark.parametrize(("offset", "drift"), [(0.0137, 0.0), (-0.04, 0.01)])
    def test_events_give_the_clock_back_to_a_few_milliseconds(self, offset: float, drift: float) -> None:
        """Of a rendered sequence, to the 5 ms by which events are late: the offset in the middle, and 1 % of drift."""
        trajectory, events = shaken()
        poses = MotionCapture(clock=MocapClock(offset, drift)).poses(trajectory)
        found = align_clocks(poses, events=events, max_offset_s=0.2, position_sigma_m=0, rotation_sigma_rad=0)
        middle = 2.0
        error = (found.offset_s + found.drift * middle) - (offset + drift * middle)
        assert -0.005 < error < 0.001
        assert found.drift == pytest.approx(drift, abs=0.003)
        assert found.unexplained < 0.2

    def test_rules(self) -> None:
        """One source, some overlap."""
        poses = MotionCapture().poses(moving())
        samples = simulate_imu(moving())
        with pytest.raises(ValueError, match="just one of imu and events, got none"):
            align_clocks(poses)
        with pytest.raises(ValueError, match="max_offset_s must be finite and > 0, got 0"):
            align_clocks(poses, imu=samples, max_offset_s=0)
        with pytest.raises(ValueError, match="at least 50 samples or bins in common"):
            align_clocks(poses, imu=samples[:20])


@functools.cache
def shaken() -> tuple[SampledTrajectory, EventArray]:
    """Four seconds of a small camera that is shaken in front of three planes, and its events."""
    scene = load_scene("three_planes")
    start, fx, fy = start_pose(scene), scene.own_camera.fx, scene.own_camera.fy
    t = np.arange(0, 4.0005, 0.005)
    shift = [0.1 * np.sin(5 * t + np.sin(3 * t)), 0.08 * np.sin(7 * t) * np.cos(t), 0.1 * np.sin(4 * t) ** 3]
    turn = Rotation.from_rotvec(0.1 * np.stack([np.sin(9 * t), np.sin(6 * t + 1), np.sin(8 * t)], 1))
    turned = (Rotation.from_quat(start.quaternion) * turn).as_quat()
    trajectory = SampledTrajectory(t, start.position + np.stack(shift, 1), turned)
    simulator = Simulator(
        scene.with_trajectory(trajectory),
        camera=Camera(60, 45, fx / 4, fy / 4, 29.5, 22.0),
        frame_rate_hz=0,
        depth_rate_hz=0,
        rays_per_pixel=4,
        accuracy="fast",
    )
    return trajectory, concatenate_events([packet.events for packet in simulator.run()])
