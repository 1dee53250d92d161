"""The settings of a simulation: their declarations, and what they stand for with a given scene.

A setting is declared once, with its type, range, unit and help. Options of the command line, keys of a plan,
arguments of Python, their checks, ``meta.json`` and docs/settings.md follow, so that they cannot disagree.
"""

from .frame_settings import INTERPOLATIONS, FrameFolderSettings, FrameSettings
from .image_camera import camera_of_size
from .inertial import make_imu, make_motion_capture
from .resolve import (
    AUTO,
    LOG_EPS,
    ViewedScene,
    chosen_sampling,
    fixed_sensor,
    memory_of,
    renderer_settings,
    truth_rates_hz,
    view_scene,
    whole_frame_sampling,
)
from .setting import Declared, Setting, complete, only, settings_of, takes_settings
from .simulation_settings import (
    EFFECTS_TOLERANCE,
    FolderSettings,
    PlanSettings,
    SimulationSettings,
    SimulatorSettings,
    ViewSettings,
)

__all__ = [
    "AUTO",
    "EFFECTS_TOLERANCE",
    "INTERPOLATIONS",
    "LOG_EPS",
    "Declared",
    "FolderSettings",
    "FrameFolderSettings",
    "FrameSettings",
    "PlanSettings",
    "Setting",
    "SimulationSettings",
    "SimulatorSettings",
    "ViewSettings",
    "ViewedScene",
    "camera_of_size",
    "chosen_sampling",
    "complete",
    "fixed_sensor",
    "make_imu",
    "make_motion_capture",
    "memory_of",
    "only",
    "renderer_settings",
    "settings_of",
    "takes_settings",
    "truth_rates_hz",
    "view_scene",
    "whole_frame_sampling",
]
