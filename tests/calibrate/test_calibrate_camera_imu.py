"""How camera and IMU sit on each other, and how late the IMU is."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BSpline

from calibration_views import BOARD, CAMERA, board_camera, degrees_between, exact_view, found_views, path, write_folder
from davis_rs.calibrate import BoardPose, board_pose, board_poses, calibrate_camera_imu, report
from davis_rs.calibrate.camera.body_spline import BodySpline, SplineBasis
from davis_rs.calibrate.camera.inertial_problem import InertialProblem, Readings
from davis_rs.calibrate.camera.reprojection import rotation_of
from davis_rs.cli.main import main
from davis_rs.sensor.imu import Imu, ImuArray, ImuLag, ImuNoise, Mounting, simulate_imu

FloatArray = npt.NDArray[np.float64]

IDEAL = Imu(mounting=Mounting(), lag=ImuLag(0.0024))
TRUTH = Mounting().matrix


def samples(imu: Imu, duration_s: float, seed: int = 0) -> ImuArray:
    return simulate_imu(path().crop(0.0, duration_s), imu, seed=seed)


@lru_cache
def exact_poses(duration_s: float) -> list[BoardPose]:
    t = np.arange(0.0, duration_s, 0.1)
    return [board_pose(exact_view(board_camera(s), k), BOARD, CAMERA) for k, s in enumerate(t)]


@pytest.mark.long
@pytest.mark.parametrize("name", ["ideal", "mpu6150"])
@pytest.mark.usefixtures("llvm")
def test_the_papers_transform_and_lag_are_recovered(name: str) -> None:
    """From 6 s of frames, the IMU ideal or noisy, filtered and wandering: well within 0.5 degrees, 5 mm and 0.2 ms."""
    imu = IDEAL if name == "ideal" else Imu.mpu6150()
    result = calibrate_camera_imu(board_poses(found_views()[:60], BOARD, CAMERA), samples(imu, 6.0, seed=3))
    assert degrees_between(result.imu_camera, TRUTH) < 0.05
    np.testing.assert_allclose(result.imu_camera[:3, 3], TRUTH[:3, 3], atol=2e-3)
    assert result.lag_s == pytest.approx(0.0024, abs=1.5e-4)
    assert np.linalg.norm(result.gravity) == pytest.approx(9.81, abs=0.03)
    off = np.concatenate([result.imu_camera[:3, 3] - TRUTH[:3, 3], [result.lag_s - 0.0024]])
    assert (np.abs(off) < 4 * result.deviations[3:]).all()
    assert "lag 2." in report(result)


@pytest.mark.long
def test_any_orientation_and_lag_is_found_without_a_guess() -> None:
    """An IMU upside down, 20 cm off and 31 ms early, with biases: the start comes from the angular rates alone."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_of([0.3, 3.0, -0.2]), (0.2, -0.1, 0.05)
    readings = samples(Imu(mounting=Mounting(matrix)), 6.0)
    readings["t"] -= 31_000
    readings = readings[readings["t"] >= 0]
    readings["gyro"] += (0.05, -0.03, 0.02)
    readings["accel"] += (0.2, 0.1, -0.3)
    result = calibrate_camera_imu(exact_poses(6.0), readings, noise=ImuNoise(1e-4, 1e-5))
    assert degrees_between(result.imu_camera, matrix) < 0.01
    np.testing.assert_allclose(result.imu_camera[:3, 3], matrix[:3, 3], atol=1e-3)
    assert result.lag_s == pytest.approx(-0.031, abs=2e-5)
    np.testing.assert_allclose(result.gyroscope_bias, (0.05, -0.03, 0.02), atol=1e-3)
    np.testing.assert_allclose(result.accelerometer_bias, (0.2, 0.1, -0.3), atol=2e-2)


@pytest.mark.long
def test_a_stretch_without_the_board_is_left_out() -> None:
    """Of 8 s the board is hidden for 2.1 s: both sides give the transform together, and what is left out is said."""
    poses, readings = exact_poses(8.0), samples(IDEAL, 8.0)
    result = calibrate_camera_imu(poses[:30] + poses[50:], readings, noise=ImuNoise(1e-4, 1e-5))
    assert degrees_between(result.imu_camera, TRUTH) < 0.01
    np.testing.assert_allclose(result.imu_camera[:3, 3], TRUTH[:3, 3], atol=1e-3)
    assert result.lag_s == pytest.approx(0.0024, abs=2e-5)
    assert result.unseen_s == pytest.approx(2.1)
    assert "2.10 s in which the board is not seen" in report(result)
    whole = calibrate_camera_imu(poses, readings, noise=ImuNoise(1e-4, 1e-5))
    assert whole.unseen_s == 0
    assert whole.samples > result.samples + 300
    assert "not seen" not in report(whole)


def test_what_cannot_be_told_is_refused() -> None:
    """Too few views, no IMU, times that do not meet, and a motion without rotation."""
    poses, readings = exact_poses(6.0), samples(IDEAL, 6.0)
    with pytest.raises(ValueError, match="at least 10 views"):
        calibrate_camera_imu(poses[:9], readings)
    with pytest.raises(ValueError, match="samples of the IMU, got 0"):
        calibrate_camera_imu(poses, readings[:0])
    later = readings.copy()
    later["t"] += 60_000_000
    with pytest.raises(ValueError, match="hardly overlap"):
        calibrate_camera_imu(poses, later)
    still = [replace(pose, matrix=poses[0].matrix) for pose in poses]
    with pytest.raises(ValueError, match="rotate about two axes"):
        calibrate_camera_imu(still, readings)


def test_the_jacobian_is_the_derivative() -> None:
    """Of every residual by every unknown, along random steps, against central differences."""
    poses, imu = exact_poses(2.0), samples(IDEAL, 2.0)[::5]
    readings = Readings(imu["t"] * 1e-6, imu["accel"], imu["gyro"])
    problem = InertialProblem(poses, readings, ImuNoise(), 10.0)
    state = problem.start()
    size = problem.jacobian(state).shape[1]
    random = np.random.default_rng(8)
    state = problem.moved(state, 1e-3 * random.standard_normal(size))
    jacobian = problem.jacobian(state)
    for _ in range(20):
        step = random.standard_normal(size)
        slope = (
            problem.residuals(problem.moved(state, 1e-6 * step)) - problem.residuals(problem.moved(state, -1e-6 * step))
        ) / 2e-6
        off = jacobian @ step - slope
        # One term is of first order in the small turns, which are 1e-3 here.
        assert np.linalg.norm(off) < 1e-4 * np.linalg.norm(slope)


def test_spline_matrices_agree_with_scipy() -> None:
    """Values and the first three derivatives, at the ends too."""
    basis, random = SplineBasis(1.0, 3.0, 7.0), np.random.default_rng(1)
    coefficients = random.standard_normal(basis.size)
    t = np.concatenate([[1.0, 3.0], random.uniform(1, 3, 50)])
    inner = np.linspace(1.0, 3.0, 15)
    spline = BSpline(np.concatenate([np.full(5, 1.0), inner, np.full(5, 3.0)]), coefficients, 5)
    for order in range(4):
        np.testing.assert_allclose(basis.matrix(t, order) @ coefficients, spline(t, order), rtol=1e-9, atol=1e-9)


def test_rates_of_a_turning_body_are_the_derivative_of_its_rotation() -> None:
    """With turns of any size on top of the interpolated profile: R' = R [w]x."""
    t = np.linspace(0.0, 2.0, 21)
    profile = np.stack([board_camera(s)[:3, :3] for s in t])
    spline = BodySpline(t, profile, 10.0)
    coefficients = 0.3 * np.random.default_rng(6).standard_normal((spline.basis.size, 3))
    at, h = np.linspace(0.1, 1.9, 40), 1e-5
    before, after = spline.rotations(coefficients, at - h), spline.rotations(coefficients, at + h)
    cross = np.swapaxes(spline.rotations(coefficients, at), 1, 2) @ (after - before) / (2 * h)
    rates = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], 1)
    np.testing.assert_allclose(spline.rates(coefficients, at), rates, atol=1e-5)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_command_reads_imu_txt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Transform and lag are printed and written; a folder without an IMU is refused."""
    folder, output = tmp_path / "sequence", tmp_path / "camera_imu.json"
    write_folder(folder, slice(0, 51), imu=samples(IDEAL, 5.0))
    assert main(["calibrate", "camera-imu", str(folder), "-o", str(output)]) == 0
    assert "camera and IMU from 51 views" in capsys.readouterr().out
    written = json.loads(output.read_text())
    np.testing.assert_allclose(written["T_imu_camera"], TRUTH, atol=3e-3)
    assert written["lag_s"] == pytest.approx(0.0024, abs=2e-4)
    (folder / "imu.txt").unlink()
    assert main(["calibrate", "camera-imu", str(folder)]) == 1
    assert "samples of the IMU, got 0" in capsys.readouterr().err
