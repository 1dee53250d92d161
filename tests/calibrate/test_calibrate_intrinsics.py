"""Corners of a checkerboard, and the camera that they tell."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration_views import BOARD, CAMERA, board_camera, exact_view, found_views, frames, write_folder
from davis_rs import Camera
from davis_rs.calibrate import BoardView, board_pose, board_poses, calibrate_intrinsics, find_corners
from davis_rs.calibrate.camera.intrinsics import PARAMETERS
from davis_rs.calibrate.camera.opencv import load_opencv
from davis_rs.calibrate.camera.reprojection import moved, projection_jacobian, transform
from davis_rs.cli.main import main


def every(long: bool) -> int:
    """Of how many frames one is looked at."""
    return 1 if long else 4


@pytest.mark.usefixtures("llvm")
def test_corners_are_found_to_a_fraction_of_a_pixel(long: bool) -> None:
    """Against the projected truth: every frame's board found, in the right order, 0.04 px rms and below 0.3 px."""
    views = found_views(every(long))
    assert len(views) == len(frames().t_us[:: every(long)])
    error = np.stack([view.corners - exact_view(board_camera(view.t_us * 1e-6)).corners for view in views])
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.abs(error).max() < 0.3
    assert np.abs(error.mean((0, 1))).max() < 0.01  # a shift would go straight into the principal point


@pytest.mark.usefixtures("llvm")
def test_a_board_upside_down_keeps_its_first_corner() -> None:
    """Turned by half a turn, a frame's corners turn along, in the same order."""
    image = frames().images[0]
    upright, turned = find_corners(image, BOARD), find_corners(np.ascontiguousarray(image[::-1, ::-1]), BOARD)
    assert upright is not None
    assert turned is not None
    np.testing.assert_allclose(turned, (CAMERA.width - 1, CAMERA.height - 1) - upright, atol=0.1)


@pytest.mark.usefixtures("llvm")
def test_a_board_that_is_cut_off_or_missing_is_not_found() -> None:
    """Corners are all there or the frame is left out: some of them would be taken for others."""
    image = frames().images[0].copy()
    image[:, 120:] = 128
    assert find_corners(image, BOARD) is None
    assert find_corners(np.full((180, 240), 77, np.uint8), BOARD) is None


@pytest.mark.parametrize("shape", [(180, 240, 3), (180,)])
def test_frames_of_another_kind_are_refused(shape: tuple[int, ...]) -> None:
    """Colour, or a row, is not what the dataset's frames are."""
    with pytest.raises(ValueError, match=r"uint8 of shape \(H, W\)"):
        find_corners(np.zeros(shape, np.uint8), BOARD)


@pytest.mark.usefixtures("llvm")
def test_the_simulated_camera_is_recovered(long: bool) -> None:
    """Focal lengths within 0.2 % of the davis240c's, every parameter within four standard deviations, k3 = 0."""
    result = calibrate_intrinsics(found_views(every(long)), BOARD, width=CAMERA.width, height=CAMERA.height)
    camera = result.camera
    assert camera.fx == pytest.approx(CAMERA.fx, rel=2e-3)
    assert camera.fy == pytest.approx(CAMERA.fy, rel=2e-3)
    assert camera.k3 == 0
    for name in PARAMETERS:
        assert abs(getattr(camera, name) - getattr(CAMERA, name)) < 4 * result.deviations[name], name
    assert result.deviations["fx"] < 0.3
    assert result.rms_px < 0.12
    assert result.views == len(result.frame_rms_px) == (80 if long else 50)


def test_exact_corners_give_the_exact_camera() -> None:
    """With corners from the model itself nothing is left but float32, in which OpenCV takes them."""
    views = [exact_view(board_camera(0.2 * k), k) for k in range(100)]
    result = calibrate_intrinsics(views, BOARD, width=240, height=180)
    camera = result.camera
    assert result.views == 80  # of more, some are enough
    for name in PARAMETERS:
        assert getattr(camera, name) == pytest.approx(getattr(CAMERA, name), rel=1e-3, abs=1e-4), name


@pytest.mark.parametrize("noise_px", [0.0, 0.05])
def test_views_from_one_direction_are_refused(noise_px: float) -> None:
    """A board seen straight at any distance leaves the focal length open: an answer would be a made-up one."""
    random = np.random.default_rng(5)
    views = []
    for k in range(10):
        place = BOARD.centre + np.array([0.02 * k, 0.0, -0.7 - 0.05 * k])
        view = exact_view(transform(np.eye(3), place), k)
        views.append(BoardView(view.t_us, k, view.corners + noise_px * random.standard_normal((30, 2))))
    with pytest.raises(ValueError, match="do not tell the focal length"):
        calibrate_intrinsics(views, BOARD, width=240, height=180)


def test_a_handful_of_views_is_refused() -> None:
    """The rule and the number are named."""
    with pytest.raises(ValueError, match="at least 6 views of the board, got 2"):
        calibrate_intrinsics([exact_view(board_camera(k)) for k in range(2)], BOARD, width=240, height=180)


@given(st.floats(0, 19.9))
def test_a_pose_is_found_from_exact_corners(t_s: float) -> None:
    """The flat board's two-fold ambiguity is resolved all along the path, distortion included."""
    truth = board_camera(t_s)
    pose = board_pose(exact_view(truth), BOARD, CAMERA)
    np.testing.assert_allclose(pose.matrix, truth, atol=2e-4)
    assert pose.rms_px < 1e-2


def test_corners_that_no_pose_explains_are_left_out() -> None:
    """Corners that were taken for others: the view is dropped, and refused where no other is left."""
    view = exact_view(board_camera(1.0), 1)
    wrong = BoardView(0, 0, np.roll(view.corners, 1, axis=0))
    assert [pose.view for pose in board_poses([wrong, view], BOARD, CAMERA)] == [view]
    with pytest.raises(ValueError, match="no pose of the camera explains the corners of any of 1 views"):
        board_poses([wrong], BOARD, CAMERA)


@given(st.floats(0, 19.9), st.integers(0, 5))
def test_a_poses_information_is_the_curvature_of_its_residuals(t_s: float, axis: int) -> None:
    """Moved by a small step, the squared corner error grows by step' information step."""
    truth = board_camera(t_s)
    pose = board_pose(exact_view(truth), BOARD, CAMERA)
    step = np.zeros(6)
    step[axis] = 1e-4
    off = exact_view(moved(truth, step)).corners - exact_view(truth).corners
    assert np.sum(off**2) == pytest.approx(step @ pose.information @ step, rel=0.02)


@given(st.floats(-0.6, 0.6), st.floats(-0.5, 0.5), st.floats(0.3, 3))
def test_projection_jacobian_is_the_derivative(x: float, y: float, z: float) -> None:
    """Against central differences of the camera's own projection."""
    point, h = np.array([x * z, y * z, z]), 1e-6
    slope = np.stack([(CAMERA.project(point + h * e) - CAMERA.project(point - h * e)) / (2 * h) for e in np.eye(3)], 1)
    np.testing.assert_allclose(projection_jacobian(CAMERA, point), slope, rtol=1e-5, atol=1e-3)


def test_a_missing_opencv_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install: OpenCV is an extra."""
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ImportError, match=r"pip install 'davis_rs\[calibrate\]'"):
        load_opencv()


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_command_writes_camera_figure_and_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From a folder: the report, a calib.txt that reads back as the camera, JSON with deviations, and the figure."""
    folder = tmp_path / "sequence"
    write_folder(folder, slice(0, 200, 5))
    calib, result, figure = tmp_path / "calib.txt", tmp_path / "result.json", tmp_path / "figure.png"
    wanted = ["--calib", str(calib), "-o", str(result), "--figure", str(figure)]
    assert main(["calibrate", "intrinsics", str(folder), *wanted]) == 0
    printed = capsys.readouterr()
    assert "reprojection error 0.0" in printed.out
    assert "all 30 corners found in 40 of 40 frames" in printed.err
    camera = Camera.from_calib(calib)
    assert camera.fx == pytest.approx(CAMERA.fx, rel=2e-3)
    written = json.loads(result.read_text())
    assert written["fx"] == camera.fx
    assert set(written["deviations"]) == set(PARAMETERS)
    assert figure.stat().st_size > 10_000
    assert main(["calibrate", "intrinsics", str(folder), "--tiles", "6by7"]) == 1
    assert "ROWSxCOLUMNS" in capsys.readouterr().err
    assert main(["calibrate", "intrinsics", str(folder), "--tiles", "8x9"]) == 1
    assert "none of the 40 frames" in capsys.readouterr().err
