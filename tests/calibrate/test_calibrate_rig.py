"""Where the cameras of a rig and its IMU are, and how far their clocks are apart."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from calibration_views import BOARD, CAMERA, SCENE, board_camera, degrees_between, exact_view, path
from davis_rs.calibrate import BoardPose, BoardView, RigCalibration, board_pose, calibrate_rig
from davis_rs.calibrate.camera.inertial_problem import InertialProblem, Readings
from davis_rs.calibrate.camera.report import report
from davis_rs.calibrate.camera.reprojection import inverse, rotation_of, transform, vector_of
from davis_rs.calibrate.camera.rig import CameraCamera
from davis_rs.cli.main import main
from davis_rs.geometry.pose import Pose
from davis_rs.sensor.imu import Imu, ImuLag, ImuNoise, Mounting, simulate_imu
from davis_rs.sensor.rig.rig import CameraClock, Rig, RigCamera, RigImu
from davis_rs.sensor.rig.rig_file import read_rig_file, rig_yaml
from davis_rs.simulation.rig.rig_to_folder import simulate_rig_to_folder

FloatArray = npt.NDArray[np.float64]

SECOND = transform(rotation_of([0.02, 0.09, -0.04]), (0.11, -0.005, 0.01))
"""T_cam0,cam1."""

LAG_S = 0.007
NOISE = ImuNoise(1e-3, 1e-4)
IMU = Imu(mounting=Mounting(), lag=ImuLag(0.0024), noise=NOISE)


def views(times_s: FloatArray, mount: FloatArray, stamp_s: float, noise_px: float, seed: int) -> list[BoardPose]:
    """What a camera at ``mount`` sees of the board, stamped later by ``stamp_s``."""
    random = np.random.default_rng(seed)
    found = []
    for number, t in enumerate(times_s.tolist()):
        exact = exact_view(board_camera(t) @ mount, number)
        corners = exact.corners + noise_px * random.standard_normal(exact.corners.shape)
        found.append(board_pose(BoardView(round((t + stamp_s) * 1e6), number, corners), BOARD, CAMERA))
    return found


@lru_cache
def poses(duration_s: float, seed: int = 0) -> tuple[list[BoardPose], list[BoardPose]]:
    """Of both cameras, whose frames are of different instants, and at different rates."""
    first = views(np.arange(0.0, duration_s, 0.05), np.eye(4), 0.0, 0.05, 2 * seed)
    return first, views(np.arange(0.021, duration_s, 0.07), SECOND, LAG_S, 0.05, 2 * seed + 1)


@lru_cache
def calibrated(duration_s: float, seed: int = 0) -> RigCalibration:
    readings = simulate_imu(path().crop(0.0, duration_s), IMU, seed=seed)
    return calibrate_rig(poses(duration_s, seed), readings, noise=NOISE)


def pulls(result: RigCalibration) -> FloatArray:
    """By how many standard deviations place and lag of the second camera are off."""
    (other,) = result.others
    off = np.concatenate([other.first_other[:3, 3] - SECOND[:3, 3], [other.lag_s - LAG_S]])
    return np.asarray(off / other.deviations[3:])


def test_the_second_camera_and_its_clock_are_found() -> None:
    """From 4 s: the place to half a millimetre, the clock to 0.1 ms, without a guess of either; and the IMU as well."""
    result = calibrated(4.0)
    (other,) = result.others
    assert degrees_between(other.first_other, SECOND) < 0.02
    np.testing.assert_allclose(other.first_other[:3, 3], SECOND[:3, 3], atol=5e-4)
    assert other.lag_s == pytest.approx(LAG_S, abs=1e-4)
    assert np.abs(pulls(result)).max() < 4
    assert other.corner_rms_px == pytest.approx(0.05, rel=0.3)
    assert other.views == len(poses(4.0)[1]) - 2  # those within a lag of either end are left out
    assert degrees_between(result.camera_imu.imu_camera, Mounting().matrix) < 0.05
    assert result.camera_imu.lag_s == pytest.approx(0.0024, abs=1e-4)


@pytest.mark.long
def test_deviations_are_those_of_many_recordings() -> None:
    """Of 24 draws of all noise, the mean square of off / deviation is 1 within what chance allows, and none is far."""
    off = np.array([pulls(calibrated(4.0, seed)) for seed in range(24)])
    assert np.abs(off).max() < 4.2
    assert (off**2).mean() == pytest.approx(1.0, abs=0.45)


def test_the_jacobian_is_the_derivative() -> None:
    """Of every residual by every unknown of a rig, along random steps, against central differences."""
    first, second = poses(2.0)
    imu = simulate_imu(path().crop(0.0, 2.0), IMU, seed=0)[::5]
    readings = Readings(imu["t"] * 1e-6, imu["accel"], imu["gyro"])
    problem = InertialProblem(first, readings, NOISE, 10.0, [second, second])
    state, random = problem.start(), np.random.default_rng(8)
    size = problem.jacobian(state).shape[1]
    state = problem.moved(state, 1e-3 * random.standard_normal(size))
    jacobian = problem.jacobian(state)
    for own in (slice(None), slice(size - 14, size)):
        for _ in range(10):
            step = np.zeros(size)
            step[own] = random.standard_normal(len(step[own]))
            ends = [problem.residuals(problem.moved(state, sign * 1e-6 * step)) for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / 2e-6
            assert np.linalg.norm(jacobian @ step - slope) < 1e-4 * np.linalg.norm(slope)


def test_the_result_is_a_rig() -> None:
    """Its places and clocks are those that were found: Kalibr's timeshift is t_imu - t_cam."""
    result = calibrated(4.0)
    rig = result.rig([CAMERA, CAMERA], imu_rate_hz=1000.0)
    np.testing.assert_allclose(rig.relative_pose(0, 1).matrix, result.others[0].first_other, atol=1e-12)
    lag = result.camera_imu.lag_s
    assert rig.cameras[0].clock.offset_s == pytest.approx(-lag)
    assert rig.cameras[1].clock.offset_s == pytest.approx(result.others[0].lag_s - lag)
    np.testing.assert_allclose(rig.imus[0].imu.effective_mounting.matrix, result.camera_imu.imu_camera, atol=1e-12)
    with pytest.raises(ValueError, match="2 cameras were calibrated, got 1 lenses"):
        result.rig([CAMERA])


def test_the_report_has_the_numbers_of_a_rig_file() -> None:
    """Places and time shifts are those that rig.yaml states, so that they can be compared line by line."""
    result = calibrated(4.0)
    stated = yaml.safe_load(rig_yaml(result.rig([CAMERA, CAMERA])))
    lines = report(result).splitlines()

    def matrix_after(name: str) -> FloatArray:
        (at,) = (number for number, line in enumerate(lines) if line.startswith(name))
        return np.array([line.split() for line in lines[at + 1 : at + 5]], float)

    np.testing.assert_allclose(matrix_after("T_cam1_cam0"), stated["cam1"]["T_cam_parent"], atol=1e-6)
    np.testing.assert_allclose(matrix_after("T_imu_camera"), stated["imu0"]["T_imu_parent"], atol=1e-6)
    shifts = [float(line.split()[1]) for line in lines if line.startswith("timeshift_cam_imu: ")]
    assert shifts == pytest.approx([stated[name]["timeshift_cam_imu"] for name in ("cam0", "cam1")], abs=1e-6)


def test_deviations_of_the_inverse_follow_from_the_covariance() -> None:
    """Against draws of small motions; far from the first camera, a turn moves the place much."""
    random = np.random.default_rng(3)
    mixed = random.standard_normal((6, 6)) * np.repeat([1e-4, 3e-5], 3)[:, None]
    place = transform(rotation_of([0.3, 0.9, -0.4]), (0.8, -0.5, 0.4))
    covariance = np.zeros((7, 7))
    covariance[:6, :6] = mixed @ mixed.T
    other = CameraCamera(place, 0.0, covariance, 0.1, 30)
    draws = random.standard_normal((20_000, 6)) @ mixed.T
    drawn = inverse(transform(place[:3, :3] @ rotation_of(draws[:, :3]), place[:3, 3] + draws[:, 3:]))
    spread = (drawn[:, :3, 3] - other.other_first[:3, 3]).std(0)
    np.testing.assert_allclose(other.other_first_deviations[3:], spread, rtol=0.03)
    turns = vector_of(drawn[:, :3, :3] @ place[:3, :3]).std(0)
    np.testing.assert_allclose(other.other_first_deviations[:3], turns, rtol=0.03)


def test_what_cannot_be_told_is_refused() -> None:
    """A single camera, and cameras whose clocks are too far apart."""
    first, _ = poses(2.0)
    readings = simulate_imu(path().crop(0.0, 2.0), IMU, seed=0)
    with pytest.raises(ValueError, match="two cameras or more, got 1"):
        calibrate_rig([first], readings)
    later = views(np.arange(0.021, 2.0, 0.07), SECOND, 5.0, 0.05, 3)
    with pytest.raises(ValueError, match=r"camera 1 sees the board in 0 frames while camera 0 .* 1 s apart"):
        calibrate_rig([first, later], readings)


@pytest.mark.few(1)
@pytest.mark.parametrize("lag_ms", [-51.0, 51.0, 900.0, 80.0, -300.0])
def test_clocks_that_are_far_apart_are_found(lag_ms: float) -> None:
    """Of a camera and of the IMU, the one early and the other late."""
    first = poses(4.0)[0]
    second = views(np.arange(0.5, 3.5, 0.07), SECOND, lag_ms * 1e-3, 0.05, 5)
    readings = simulate_imu(path().crop(0.0, 4.0), IMU, seed=0).copy()
    readings["t"] -= round(lag_ms * 1e3)
    result = calibrate_rig([first, second], readings, noise=NOISE)
    assert result.others[0].lag_s == pytest.approx(lag_ms * 1e-3, abs=2e-4)
    assert result.camera_imu.lag_s == pytest.approx(-lag_ms * 1e-3 + 0.0024, abs=2e-4)
    assert degrees_between(result.others[0].first_other, SECOND) < 0.02


def test_a_camera_may_see_the_board_for_longer_than_the_first() -> None:
    """Most of its views are of times of which nothing else is known; that says nothing of its clock."""
    first = [pose for pose in poses(4.0)[0] if 1e6 <= pose.view.t_us <= 2.5e6]
    result = calibrate_rig([first, poses(4.0)[1]], simulate_imu(path().crop(0.0, 4.0), IMU, seed=0), noise=NOISE)
    (other,) = result.others
    assert 2 * other.views < len(poses(4.0)[1])
    assert other.lag_s == pytest.approx(LAG_S, abs=3e-4)
    assert degrees_between(other.first_other, SECOND) < 0.05


@pytest.mark.long
def test_the_command_reads_the_folder_of_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of simulated frames: the camchain, with an IMU, is a rig file with the places and clocks of the rig."""
    cameras = [
        RigCamera(camera=CAMERA),
        RigCamera(camera=CAMERA, mount=Pose.from_matrix(SECOND), clock=CameraClock(0.007)),
    ]
    rig = Rig(name="pair", cameras=tuple(cameras), imus=(RigImu(imu=replace(IMU, lag=None)),))
    folder, chain = tmp_path / "pair", tmp_path / "camchain.yaml"
    simulate_rig_to_folder(
        SCENE, folder, rig=rig, duration_s=4.0, frame_rate_hz=20.0, depth_rate_hz=0.0, accuracy="fast"
    )
    assert main(["calibrate", "rig", str(folder), "--camchain", str(chain), "--quiet"]) == 0
    assert "its clock is 6.9" in (told := capsys.readouterr().out) or "its clock is 7.0" in told
    chain.write_text(chain.read_text() + "imu0: {}\n")  # a camchain alone says nothing of the IMU
    found = read_rig_file(chain)
    np.testing.assert_allclose(found.relative_pose(0, 1).position, SECOND[:3, 3], atol=5e-4)
    offsets = [camera.clock.offset_s for camera in found.cameras]
    assert offsets == pytest.approx([0.0, 0.007], abs=1e-4)


def test_the_command_refuses_a_rig_without_an_imu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And the folder of one camera."""
    cameras = (RigCamera(camera=CAMERA), RigCamera(camera=CAMERA, mount=Pose.from_matrix(SECOND)))
    folder = tmp_path / "pair"
    rig = Rig(name="pair", cameras=cameras)
    simulate_rig_to_folder(SCENE, folder, rig=rig, duration_s=0.002, accuracy="fast", rays_per_pixel=1)
    assert main(["calibrate", "rig", str(folder)]) == 1
    assert "has no IMU" in capsys.readouterr().err
    shutil.rmtree(folder / "cam1")
    assert main(["calibrate", "rig", str(folder)]) == 1
    assert "has 1 of the 2 cameras of its rig" in capsys.readouterr().err
    assert main(["calibrate", "rig", str(folder / "cam0")]) == 1
    assert "is not the folder of a rig" in capsys.readouterr().err
