"""The command line's options of IMU and motion capture."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from .effects import parse_effect
from .imu import IMU_EFFECTS, Imu, Mounting
from .motion_capture import MocapClock, MocapNoise, MotionCapture


def add_inertial(parser: argparse.ArgumentParser) -> None:
    """Add the options that :func:`imu_of` and :func:`motion_capture_of` read."""
    group = parser.add_argument_group("IMU and ground truth (docs/trajectories_and_imu.md)")
    group.add_argument(
        "--imu",
        choices=("none", "ideal", "davis", "mpu6150"),
        default="none",
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


def imu_of(options: argparse.Namespace) -> Imu | None:
    """The IMU that the options ask for.

    Raises:
        ValueError: for an effect that is not there or out of range, or options of an IMU without ``--imu``.
    """
    if options.imu == "none":
        if options.imu_rate is not None or options.imu_effect:
            raise ValueError("--imu-rate and --imu-effect need --imu")
        return None
    imu = {"ideal": Imu(), "davis": Imu(mounting=Mounting()), "mpu6150": Imu.mpu6150()}[options.imu]
    effects: dict[str, Any] = {
        text.partition("=")[0]: parse_effect(text, IMU_EFFECTS) for text in options.imu_effect or ()
    }
    # Together, so that lag and low-pass are looked at as a pair.
    return replace(imu, rate_hz=imu.rate_hz if options.imu_rate is None else options.imu_rate, **effects)


def motion_capture_of(options: argparse.Namespace) -> MotionCapture:
    """The motion capture that the options ask for.

    Raises:
        ValueError: for a value out of range.
    """
    noise = MocapNoise(options.pose_noise or 0.0, options.rotation_noise or 0.0)
    clock = MocapClock(options.clock_offset or 0.0, (options.clock_drift or 0.0) * 1e-3 / 60)
    return MotionCapture(
        options.pose_rate, noise=None if noise.neutral else noise, clock=None if clock.neutral else clock
    )
