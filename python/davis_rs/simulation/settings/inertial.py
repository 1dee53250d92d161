"""Makes the IMU and the motion capture that settings stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..._util.argument_error import ArgumentError
from ...sensor.effects.effects import named_effects
from ...sensor.imu import IMU_EFFECTS, IMU_MODELS, Imu
from ...sensor.motion_capture import MocapClock, MocapNoise, MotionCapture
from .simulation_settings import FolderSettings


def make_imu(settings: FolderSettings) -> Imu | None:
    """Make the IMU that the settings ask for; None for none.

    Raises:
        ValueError: for an effect that is not there or out of range, or a rate or effects where there is no IMU.
    """
    imu, rate_hz, effects = settings.imu, settings.imu_rate_hz, settings.imu_effects
    if imu in (None, "none"):
        if rate_hz is not None or effects:
            raise ArgumentError("{imu_rate_hz} and {imu_effects} are those of an IMU, but {imu} is none: choose an IMU")
        return None
    made: Imu = imu if isinstance(imu, Imu) else IMU_MODELS[imu]()
    given: dict[str, Any] = dict(named_effects(effects, IMU_EFFECTS))
    # Together, so that lag and low-pass are looked at as a pair.
    return replace(made, rate_hz=made.rate_hz if rate_hz is None else rate_hz, **given)


def make_motion_capture(settings: FolderSettings) -> MotionCapture:
    """Make the motion capture that gives the ground truth.

    Raises:
        ValueError: for a value out of range, or a motion capture next to settings of another one.
    """
    asked = {
        "pose_noise_m": settings.pose_noise_m,
        "rotation_noise_rad": settings.rotation_noise_rad,
        "clock_offset_s": settings.clock_offset_s,
        "clock_drift_ms_per_min": settings.clock_drift_ms_per_min,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    made = settings.motion_capture
    if made is not None:
        if given:
            raise ArgumentError("{motion_capture} is given: {others} would be ignored", others=list(given))
        return made
    noise = MocapNoise(given.get("pose_noise_m", 0.0), given.get("rotation_noise_rad", 0.0))
    clock = MocapClock(given.get("clock_offset_s", 0.0), given.get("clock_drift_ms_per_min", 0.0) * 1e-3 / 60)
    return MotionCapture(
        settings.pose_rate_hz, noise=None if noise.neutral else noise, clock=None if clock.neutral else clock
    )
