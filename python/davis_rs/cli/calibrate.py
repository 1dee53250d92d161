"""Runs davis-rs calibrate intrinsics, hand-eye, camera-imu."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .._util.progress import stage
from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from ..calibrate import (
    MPU6150_NOISE,
    CameraImu,
    HandEye,
    Intrinsics,
    as_dict,
    board_poses,
    calibrate_camera_imu,
    calibrate_hand_eye,
    calibrate_intrinsics,
    draw_intrinsics,
    find_board,
    report,
    tracked_poses,
)
from ..calibrate.camera.board_pose import BoardPose
from ..calibrate.camera.corners import BoardView
from ..calibrate.camera.opencv import load_opencv
from ..geometry.camera import Camera, load_camera
from ..io.dataset.reader import Dataset
from ..scene.builtin.checkerboard import DATASET_BOARD, Checkerboard
from ..sensor.imu import ImuNoise
from .calibrate_sensor import add_sensor
from .common import figure_file


def add_calibrate(calibrate: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    calibrate.description = (
        "Calibrate a lens, a hand-eye transform or an IMU from a sequence before a checkerboard, such as the scene "
        "'checkerboard', which needs OpenCV 4: pip install 'davis_rs[calibrate]'; or a sensor from its events."
    )
    kinds = calibrate.add_subparsers(required=True, metavar="WHAT")
    add_sensor(kinds.add_parser("sensor", help="hot pixels, leak and bounds on the readout, from events alone"))

    intrinsics = kinds.add_parser("intrinsics", help="focal lengths, principal point and distortion, k3 = 0")
    intrinsics.set_defaults(run=_intrinsics)
    _add_common(intrinsics)
    intrinsics.add_argument("--calib", type=Path, metavar="FILE", help="write the camera as a calib.txt")
    intrinsics.add_argument(
        "--figure", type=figure_file, metavar="FILE", help="draw the corners and their errors: .png, .pdf, .svg ..."
    )

    hand_eye = kinds.add_parser(
        "hand-eye",
        help="where the camera is on the body whose poses are in groundtruth.txt",
        description="groundtruth.txt must hold the tracked body's poses, on the frames' clock.",
    )
    hand_eye.set_defaults(run=_hand_eye)
    _add_common(hand_eye, camera=True)

    camera_imu = kinds.add_parser("camera-imu", help="rotation, translation and time lag between camera and IMU")
    camera_imu.set_defaults(run=_camera_imu)
    _add_common(camera_imu, camera=True)
    for name, value, unit in (
        ("gyroscope", MPU6150_NOISE.gyroscope_noise_density, "rad/s/sqrt(Hz)"),
        ("accelerometer", MPU6150_NOISE.accelerometer_noise_density, "m/s^2/sqrt(Hz)"),
    ):
        camera_imu.add_argument(
            f"--{name}-noise", type=float, default=value, metavar="D", help=f"white noise, {unit} (default: {value:g})"
        )
    camera_imu.add_argument(
        "--knot-rate",
        dest="knot_rate_hz",
        type=float,
        default=25.0,
        metavar="HZ",
        help="knots of the splines; three times the fastest motion (default: 25)",
    )


def _add_common(parser: argparse.ArgumentParser, *, camera: bool = False) -> None:
    parser.add_argument("dataset", type=Path, metavar="DIR")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, only the result")
    parser.add_argument(
        "--tiles",
        default=f"{DATASET_BOARD.rows}x{DATASET_BOARD.columns}",
        metavar="RxC",
        help="rows and columns of tiles; inner corners are one fewer each way (default: %(default)s)",
    )
    parser.add_argument(
        "--tile-size",
        dest="tile_m",
        type=float,
        default=DATASET_BOARD.tile_m,
        metavar="M",
        help="metres (default: %(default)s)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="JSON", help="write the result, with covariances")
    parser.add_argument(
        "--start",
        dest="start_s",
        type=float,
        default=0.0,
        metavar="S",
        help="only frames from here on, after the first",
    )
    parser.add_argument(
        "--stop", dest="stop_s", type=float, metavar="S", help="only frames before this time after the first"
    )
    if camera:
        parser.add_argument("--camera", metavar="CAMERA", help="a preset or a calib.txt; the dataset's if not given")


def _intrinsics(options: argparse.Namespace) -> int:
    dataset, board, views = _views(options)
    height, width = dataset.read_image(views[0].frame).shape
    with stage("fitting the lens", show=not options.quiet):
        result = calibrate_intrinsics(views, board, width=width, height=height)
    if options.calib is not None:
        write_whole(options.calib, result.camera.to_calib())
    if options.figure is not None:
        draw_intrinsics(dataset, views, board, result, options.figure)
    return _done(result, options.output)


def _hand_eye(options: argparse.Namespace) -> int:
    dataset, board, views = _views(options)
    camera = _camera(options, dataset)
    poses = board_poses(views, board, camera)
    hand, covered = tracked_poses(dataset.groundtruth, [pose.view.t_us * 1e-6 for pose in poses])
    seen: list[BoardPose] = [pose for pose, known in zip(poses, covered, strict=True) if known]
    with stage("fitting the hand-eye transform", show=not options.quiet):
        result = calibrate_hand_eye(hand[covered], seen, board, camera)
    return _done(result, options.output)


def _camera_imu(options: argparse.Namespace) -> int:
    dataset, board, views = _views(options)
    noise = ImuNoise(
        accelerometer_noise_density=options.accelerometer_noise, gyroscope_noise_density=options.gyroscope_noise
    )
    with stage("fitting camera and IMU", show=not options.quiet):
        poses = board_poses(views, board, _camera(options, dataset))
        result = calibrate_camera_imu(poses, dataset.imu, noise=noise, knot_rate_hz=options.knot_rate_hz)
    return _done(result, options.output)


def _views(options: argparse.Namespace) -> tuple[Dataset, Checkerboard, list[BoardView]]:
    try:
        rows, columns = (int(word) for word in options.tiles.split("x"))
    except ValueError:
        raise ValueError(f"--tiles must be ROWSxCOLUMNS, such as 6x7, got {options.tiles!r}") from None
    board = Checkerboard(rows, columns, options.tile_m)
    load_opencv()  # before any frame is read
    dataset = Dataset(options.dataset)
    with stage("finding the checkerboard", show=not options.quiet):
        views = find_board(dataset, board, start_s=options.start_s, stop_s=options.stop_s)
    tell(f"all {len(board.corners)} corners found in {len(views)} of {len(dataset.frames)} frames", file=sys.stderr)
    return dataset, board, views


def _camera(options: argparse.Namespace, dataset: Dataset) -> Camera:
    return dataset.camera if options.camera is None else load_camera(options.camera)


def _done(result: Intrinsics | HandEye | CameraImu, output: Path | None) -> int:
    if output is not None:
        write_whole(output, json.dumps(as_dict(result), indent=2) + "\n")
    tell(report(result))
    return 0
