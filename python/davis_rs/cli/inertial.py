"""The command line's options of IMU and motion capture."""

from __future__ import annotations

import argparse

from ..imu import IMU_EFFECTS


def add_inertial(parser: argparse.ArgumentParser) -> None:
    """Add the options of IMU and motion capture, named as in :class:`~davis_rs.run_settings.RunSettings`."""
    group = parser.add_argument_group("IMU and ground truth (docs/trajectories_and_imu.md)")
    group.add_argument(
        "--imu",
        choices=("none", "ideal", "davis", "mpu6150"),
        help="write imu.txt: ideal at the camera's centre, ideal where the DAVIS240C has it, or with all effects too",
    )
    group.add_argument("--imu-rate", type=float, metavar="HZ", help="of the IMU; 1000 if not given")
    group.add_argument(
        "--imu-effect",
        action="append",
        metavar="NAME[=VALUE[,PARAMETER=VALUE...]]",
        help=f"an imperfection of the IMU, {', '.join(IMU_EFFECTS)}; may be given several times",
    )
    group.add_argument("--pose-rate", type=float, default=200.0, metavar="HZ", help="ground truth")
    group.add_argument("--pose-noise", type=float, metavar="M", help="standard deviation of its positions")
    group.add_argument("--rotation-noise", type=float, metavar="RAD", help="and of its rotations")
    group.add_argument("--clock-offset", type=float, metavar="S", help="its clock at the camera's start")
    group.add_argument("--clock-drift", type=float, metavar="MS_PER_MIN", help="of its clock; 2 in the paper")
