"""Where the camera sits on a tracked body."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration_views import (
    BOARD,
    CAMERA,
    board_camera,
    degrees_between,
    exact_view,
    found_views,
    ground_truth,
    matrices,
    path,
    write_folder,
)
from davis_rs.calibrate import BoardPose, board_pose, board_poses, calibrate_hand_eye, report, tracked_poses
from davis_rs.calibrate.camera.hand_eye import (
    HandEyePoses,
    Reprojection,
    check_motion,
    covariance_of_sum,
    linear_hand_eye,
)
from davis_rs.calibrate.camera.levenberg_marquardt import levenberg_marquardt
from davis_rs.calibrate.camera.reprojection import inverse, rotation_of, transform
from davis_rs.cli.main import main
from davis_rs.geometry.trajectory.sample_noise import pose_noise
from davis_rs.scene.builtin.checkerboard_scene import board_in_world
from davis_rs.sensor.motion_capture import MocapNoise, MotionCapture

FloatArray = npt.NDArray[np.float64]

X = transform(rotation_of([1.2, -1.1, 1.3]), [0.05, -0.03, 0.08])
"""T_hand_camera: a camera that looks along the body's x, away from its origin."""


@lru_cache
def exact() -> tuple[FloatArray, list[BoardPose]]:
    """Hand and board poses all along the path, without any error."""
    t = np.arange(0.0, 19.9, 0.5)
    hands = np.stack([path().pose(s).matrix @ inverse(X) for s in t])
    return hands, [board_pose(exact_view(board_camera(s), k), BOARD, CAMERA) for k, s in enumerate(t)]


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_a_known_x_is_recovered_from_frames_and_noisy_motion_capture() -> None:
    """Poses at 200 Hz with 0.65 mm and 4.3 mrad of noise, corners as found in frames: within 1 mm and 0.1 degrees."""
    poses = MotionCapture().poses(path())
    hands = MocapNoise().apply(ground_truth(poses.t_us, matrices(poses) @ inverse(X)), seed=1)
    views = board_poses(found_views(), BOARD, CAMERA)
    tracked, covered = tracked_poses(hands, [view.view.t_us * 1e-6 for view in views])
    assert covered.all()
    result = calibrate_hand_eye(tracked, views, BOARD, CAMERA)
    assert np.linalg.norm(result.hand_camera[:3, 3] - X[:3, 3]) < 1e-3
    assert degrees_between(result.hand_camera, X) < 0.1
    assert np.linalg.norm(result.world_board[:3, 3] - board_in_world().position) < 2e-3
    assert degrees_between(result.world_board, board_in_world().matrix) < 0.1
    assert result.rms_px < result.linear_rms_px < 5
    assert 1e-4 < result.translation_deviations_m.max() < 1e-3
    assert "covariance" in report(result)


def test_without_noise_x_is_exact() -> None:
    """Linear solution and refinement both: nothing is built into the method that errs."""
    hands, views = exact()
    result = calibrate_hand_eye(hands, views, BOARD, CAMERA)
    np.testing.assert_allclose(result.linear, X, atol=1e-4)
    np.testing.assert_allclose(result.hand_camera, X, atol=1e-8)
    np.testing.assert_allclose(result.world_board, board_in_world().matrix, atol=1e-8)
    assert result.rms_px < 1e-6


@pytest.mark.long
def test_the_covariance_tells_the_scatter() -> None:
    """Over many draws of the motion capture's noise the errors of X scatter as its covariance says, within a third."""
    hands, views = exact()
    random = np.random.default_rng(3)
    errors, variances = [], []
    for _ in range(60):
        noise = random.standard_normal((len(hands), 6)) * ([1e-3] * 3 + [5e-4] * 3)
        result = calibrate_hand_eye(hands @ transform(rotation_of(noise[:, :3]), noise[:, 3:]), views, BOARD, CAMERA)
        off = inverse(X) @ result.hand_camera
        errors.append(np.concatenate([Rotation.from_matrix(off[:3, :3]).as_rotvec(), off[:3, 3]]))
        variances.append(np.diag(result.covariance)[:6])
    ratio = np.sqrt(np.mean(np.square(errors), 0) / np.mean(variances, 0))
    np.testing.assert_array_less(ratio, 1.35)
    np.testing.assert_array_less(0.7, ratio)


@pytest.mark.parametrize("likeness", [0.0, 0.3, 0.6])
def test_the_covariance_of_a_sum_counts_neighbours_that_are_alike(likeness: float) -> None:
    """Of a series whose next term is ``likeness`` of the last, the sum varies (1 + likeness) / (1 - likeness) as much.

    Of 400 terms the rule finds it within 6 % without likeness, and 20 % less at most with much of it.
    """
    random = np.random.default_rng(9)
    found = []
    for _ in range(100):
        drawn = random.standard_normal((460, 2))
        for k in range(1, len(drawn)):
            drawn[k] += likeness * drawn[k - 1]
        found.append(np.diag(covariance_of_sum(drawn[60:])))
    truth = 400 / (1 - likeness) ** 2
    ratio = np.mean(found) / truth
    assert (0.94 if likeness == 0 else 0.78) < ratio < 1.06


@pytest.mark.long
def test_views_close_in_time_have_a_larger_covariance_than_scattered_ones() -> None:
    """Smoothed poses err alike from one view to the next: what counts is the order of their stamps."""
    t = np.arange(1.0, 19.0, 1 / 15)
    views = [board_pose(exact_view(board_camera(s)), BOARD, CAMERA) for s in t]
    views = [replace(v, view=replace(v.view, t_us=round(1e6 * s))) for v, s in zip(views, t, strict=True)]
    poses = MotionCapture().poses(path())
    noisy = MocapNoise().apply(ground_truth(poses.t_us, matrices(poses) @ inverse(X)), seed=2)
    hands, _ = tracked_poses(noisy, t)
    in_time = calibrate_hand_eye(hands, views, BOARD, CAMERA).covariance
    drawn = np.random.default_rng(4).permutation(len(t))
    again = calibrate_hand_eye(hands[drawn], [views[k] for k in drawn], BOARD, CAMERA).covariance
    np.testing.assert_allclose(again, in_time, rtol=1e-4)
    stamped = [replace(v, view=replace(v.view, t_us=k)) for k, v in enumerate(views[j] for j in drawn)]
    scattered = calibrate_hand_eye(hands[drawn], stamped, BOARD, CAMERA).covariance
    assert np.median(np.diag(in_time) / np.diag(scattered)) > 1.3


@pytest.mark.long
@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_the_linear_solution_holds_for_any_orientation(vector: list[float]) -> None:
    """Half turns too, at which the equations in Rodrigues' parameters break down."""
    x = transform(rotation_of(vector), [0.1, 0.2, -0.3])
    hands, views = exact()
    cameras = np.stack([view.matrix for view in views])
    np.testing.assert_allclose(linear_hand_eye(hands @ X @ inverse(x), cameras), x, atol=5e-4)


@pytest.mark.parametrize("vector", [[np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [0, 0, 0]])
def test_the_linear_solution_holds_for_half_turns(vector: list[float]) -> None:
    """The very singularities, and the identity."""
    x = transform(rotation_of(vector), [0.1, 0.2, -0.3])
    hands, views = exact()
    cameras = np.stack([view.matrix for view in views])
    np.testing.assert_allclose(linear_hand_eye(hands @ X @ inverse(x), cameras), x, atol=5e-4)


def motion(turns: FloatArray) -> FloatArray:
    places = np.random.default_rng(2).uniform(-0.3, 0.3, (len(turns), 3))
    start = rotation_of([0.4, 0.5, -0.6])
    return transform(start @ rotation_of(turns), places)


def test_degenerate_motion_is_refused_with_its_reason() -> None:
    """Pure translation, one axis, small turns about the second, and too few views."""
    angle = np.linspace(-0.5, 0.5, 12)
    axis = np.array([0.6, 0.0, 0.8])
    with pytest.raises(ValueError, match="pure translation"):
        check_motion(motion(np.zeros((12, 3))))
    with pytest.raises(ValueError, match="rotation about one axis alone"):
        check_motion(motion(angle[:, None] * axis))
    wobble = np.random.default_rng(4).normal(0, 0.004, (12, 3))  # a tracker's noise is no motion
    with pytest.raises(ValueError, match="rotation about one axis alone"):
        check_motion(motion(angle[:, None] * axis + wobble))
    with pytest.raises(ValueError, match="at least 3 views"):
        check_motion(motion(np.zeros((2, 3))))
    check_motion(motion(angle[:, None] * axis + 0.1 * np.sin(9 * angle)[:, None] * (0.0, 1.0, 0.0)))
    hands, views = exact()
    still = np.array([transform(hands[0, :3, :3], hand[:3, 3]) for hand in hands])
    with pytest.raises(ValueError, match="degenerate"):
        calibrate_hand_eye(still, views, BOARD, CAMERA)


def test_poses_that_are_not_the_bodys_are_refused() -> None:
    """In another order, a second late, or the wrong way round they are no motion of this camera."""
    hands, views = exact()
    shuffled = hands[np.random.default_rng(7).permutation(len(hands))]
    for wrong in (shuffled, np.roll(hands, 2, axis=0)):
        with pytest.raises(ValueError, match="do not turn alike"):
            calibrate_hand_eye(wrong, views, BOARD, CAMERA)
    with pytest.raises(ValueError, match=r"do not fit together|behind the camera"):
        calibrate_hand_eye(inverse(hands), views, BOARD, CAMERA)
    with pytest.raises(ValueError, match="one pose of the hand"):
        calibrate_hand_eye(hands[:5], views, BOARD, CAMERA)


@given(st.lists(st.floats(-0.05, 0.05), min_size=12, max_size=12), st.integers(0, 11))
def test_the_jacobian_is_the_derivative(off: list[float], parameter: int) -> None:
    """Against central differences of the residuals, away from the solution."""
    hands, views = exact()
    corners = np.stack([view.view.corners for view in views])[:6]
    problem = Reprojection(hands[:6], corners, BOARD, CAMERA)
    poses = HandEyePoses(X, board_in_world().matrix).moved(np.array(off))
    step = np.zeros(12)
    step[parameter] = 1e-6
    slope = (problem.residuals(poses.moved(step)) - problem.residuals(poses.moved(-step))) / 2e-6
    np.testing.assert_allclose(problem.jacobian(poses)[:, parameter], slope, rtol=1e-4, atol=1e-2)


def test_noise_of_poses_is_estimated_and_smoothed_away() -> None:
    """Of noisy poses the noise is told within 5 %, and most of it is gone; exact poses pass unchanged."""
    poses = MotionCapture().poses(path())
    noise = MocapNoise()
    noisy = noise.apply(poses, seed=5)
    position, rotation = pose_noise(noisy.t_us * 1e-6, noisy.positions, noisy.quaternions)
    assert position == pytest.approx(noise.position_m, rel=0.05)
    assert rotation == pytest.approx(noise.rotation_rad, rel=0.05)
    t = np.arange(1.0, 19.0, 0.01)
    truth = transform(path().rotations(t), path().positions(t))
    smooth, _ = tracked_poses(noisy, t)
    assert np.sqrt(np.mean((smooth - truth)[:, :3, 3] ** 2)) < noise.position_m / 3
    through, covered = tracked_poses(poses, t)
    np.testing.assert_allclose(through, truth, atol=1e-6)
    assert covered.all()
    _, covered = tracked_poses(poses, [-0.1, 5.0, 30.0])
    assert covered.tolist() == [False, True, False]


def test_levenberg_marquardt_finds_the_least_and_says_when_it_does_not() -> None:
    """Rosenbrock's valley, whose least lies at (1, 1); two steps are not enough for it."""

    def residuals(p: FloatArray) -> FloatArray:
        return np.array([10 * (p[1] - p[0] ** 2), 1 - p[0]])

    def jacobian(p: FloatArray) -> FloatArray:
        return np.array([[-20 * p[0], 10.0], [-1.0, 0.0]])

    solve = partial(levenberg_marquardt, np.array([-1.2, 1.0]), residuals, jacobian, np.add)
    np.testing.assert_allclose(solve(), [1, 1], atol=1e-8)
    with pytest.raises(ValueError, match="not converged in 2 iterations"):
        solve(iterations=2)
    with pytest.raises(ValueError, match="finite"):
        levenberg_marquardt(np.array([np.nan, 1.0]), residuals, jacobian, np.add)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_command_reads_the_bodys_poses_from_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """groundtruth.txt holds the body's poses: X is printed and written; without them it is refused."""
    poses = MotionCapture().poses(path())
    folder, output = tmp_path / "sequence", tmp_path / "hand_eye.json"
    write_folder(folder, slice(0, 200, 4), ground_truth(poses.t_us, matrices(poses) @ inverse(X)))
    assert main(["calibrate", "hand-eye", str(folder), "-o", str(output)]) == 0
    assert "hand-eye from 50 views" in capsys.readouterr().out
    written = json.loads(output.read_text())
    np.testing.assert_allclose(np.array(written["T_hand_camera"])[:3, 3], X[:3, 3], atol=5e-4)
    assert np.array(written["covariance"]).shape == (12, 12)
    (folder / "groundtruth.txt").unlink()
    assert main(["calibrate", "hand-eye", str(folder)]) == 1
    assert "at least 10 poses, got 0" in capsys.readouterr().err
