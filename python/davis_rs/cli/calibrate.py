"""Runs davis-rs calibrate intrinsics, hand-eye, camera-imu, rig."""

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
    as_dict,
    board_poses,
    calibrate_camera_imu,
    calibrate_hand_eye,
    calibrate_intrinsics,
    calibrate_rig,
    draw_intrinsics,
    find_board,
    report,
    tracked_poses,
)
from ..calibrate.camera.board_pose import BoardPose
from ..calibrate.camera.corners import BoardView
from ..calibrate.camera.opencv import load_opencv
from ..calibrate.camera.report import Calibration
from ..geometry.camera import Camera, load_camera
from ..io.dataset.reader import Dataset
from ..io.dataset.rig_folder import RigDataset
from ..scene.builtin.checkerboard import DATASET_BOARD, Checkerboard
from ..sensor.imu import ImuNoise
from ..sensor.rig.rig_file import kalibr_rig_chain
from .calibrate_sensor import add_sensor
from .common import figure_file


def add_calibrate(calibrate: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    calibrate.description = (
        "Calibrate a lens, a hand-eye transform, an IMU or a rig from a sequence before a checkerboard, such as the "
        "scene 'checkerboard', which needs OpenCV 4: pip install 'davis_rs[calibrate]'; or a sensor from its events."
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
    _add_inertial(camera_imu)

    rig = kinds.add_parser(
        "rig",
        help="where the cameras of a rig and its IMU are, and how far their clocks are apart",
        description="DIR is the folder of a rig, whose cameras look at the same board. Their lenses are those of "
        "cam0/calib.txt, cam1/calib.txt, and so on.",
    )
    rig.set_defaults(run=_rig)
    _add_common(rig)
    _add_inertial(rig)
    rig.add_argument("--camchain", type=Path, metavar="FILE", help="write the rig as Kalibr's camchain.yaml")


def _add_inertial(parser: argparse.ArgumentParser) -> None:
    for name, value, unit in (
        ("gyroscope", MPU6150_NOISE.gyroscope_noise_density, "rad/s/sqrt(Hz)"),
        ("accelerometer", MPU6150_NOISE.accelerometer_noise_density, "m/s^2/sqrt(Hz)"),
    ):
        parser.add_argument(
            f"--{name}-noise", type=float, default=value, metavar="D", help=f"white noise, {unit} (default: {value:g})"
        )
    parser.add_argument(
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
    with stage("fitting camera and IMU", show=not options.quiet):
        poses = board_poses(views, board, _camera(options, dataset))
        result = calibrate_camera_imu(poses, dataset.imu, noise=_noise(options), knot_rate_hz=options.knot_rate_hz)
    return _done(result, options.output)


def _rig(options: argparse.Namespace) -> int:
    board = _board(options)
    folder = RigDataset(options.dataset)
    cameras = folder.cameras
    if len(cameras) < len(folder.rig.cameras):
        raise ValueError(f"{folder.path} has {len(cameras)} of the {len(folder.rig.cameras)} cameras of its rig")
    if not folder.imus:
        raise ValueError(f"{folder.path} has no IMU: the cameras' paths between their frames follow from its samples")
    found = []
    for number, dataset in cameras.items():
        views = _find(options, dataset, board, f" of camera {number}")
        found.append(board_poses(views, board, dataset.camera))
    with stage("fitting the rig", show=not options.quiet):
        result = calibrate_rig(found, folder.imus[0], noise=_noise(options), knot_rate_hz=options.knot_rate_hz)
    if options.camchain is not None:
        lenses = [dataset.camera for dataset in cameras.values()]
        write_whole(options.camchain, kalibr_rig_chain(result.rig(lenses)))
    return _done(result, options.output)


def _noise(options: argparse.Namespace) -> ImuNoise:
    return ImuNoise(
        accelerometer_noise_density=options.accelerometer_noise, gyroscope_noise_density=options.gyroscope_noise
    )


def _board(options: argparse.Namespace) -> Checkerboard:
    try:
        rows, columns = (int(word) for word in options.tiles.split("x"))
    except ValueError:
        raise ValueError(f"--tiles must be ROWSxCOLUMNS, such as 6x7, got {options.tiles!r}") from None
    board = Checkerboard(rows, columns, options.tile_m)
    load_opencv()  # before any frame is read
    return board


def _views(options: argparse.Namespace) -> tuple[Dataset, Checkerboard, list[BoardView]]:
    board = _board(options)
    dataset = Dataset(options.dataset)
    return dataset, board, _find(options, dataset, board)


def _find(options: argparse.Namespace, dataset: Dataset, board: Checkerboard, where: str = "") -> list[BoardView]:
    with stage(f"finding the checkerboard{where}", show=not options.quiet):
        views = find_board(dataset, board, start_s=options.start_s, stop_s=options.stop_s)
    corners, frames = len(board.corners), len(dataset.frames)
    tell(f"all {corners} corners found in {len(views)} of {frames} frames{where}", file=sys.stderr)
    return views


def _camera(options: argparse.Namespace, dataset: Dataset) -> Camera:
    return dataset.camera if options.camera is None else load_camera(options.camera)


def _done(result: Calibration, output: Path | None) -> int:
    if output is not None:
        write_whole(output, json.dumps(as_dict(result), indent=2) + "\n")
    tell(report(result))
    return 0
