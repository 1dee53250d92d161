"""Declares the settings of a simulation, and resolves them with a given scene.

``simulation_settings`` and ``frame_settings`` declare each setting once, as a field of a frozen dataclass, with its
type, range, unit and help. Options of the command line, keys of a plan, arguments of Python, their checks,
``meta.json`` and docs/settings.md follow, so that they cannot disagree. ``setting`` is what reads a declaration.
``keywords`` says the same to type checkers, and is made from them. ``resolve`` decides what settings leave open.
"""

from .frame_settings import INTERPOLATIONS, FrameFolderSettings, FrameSettings
from .image_camera import camera_of_size
from .inertial import make_imu, make_motion_capture
from .resolve import (
    AUTO_RAYS,
    LOG_EPS,
    Resolved,
    ViewedScene,
    chosen_sampling,
    first_given,
    fixed_sensor,
    memory_of,
    renderer_of,
    resolve,
    truth_rates_hz,
    view_scene,
)
from .setting import Declared, Setting, Settings, complete, former_names_of, only, settings_of, takes_settings
from .simulation_settings import (
    EFFECTS_TOLERANCE,
    CustomSettings,
    FolderSettings,
    PlanSettings,
    SamplingSettings,
    SimulationSettings,
    SimulatorSettings,
    ViewSettings,
)

__all__ = [
    "AUTO_RAYS",
    "EFFECTS_TOLERANCE",
    "INTERPOLATIONS",
    "LOG_EPS",
    "CustomSettings",
    "Declared",
    "FolderSettings",
    "FrameFolderSettings",
    "FrameSettings",
    "PlanSettings",
    "Resolved",
    "SamplingSettings",
    "Setting",
    "Settings",
    "SimulationSettings",
    "SimulatorSettings",
    "ViewSettings",
    "ViewedScene",
    "camera_of_size",
    "chosen_sampling",
    "complete",
    "first_given",
    "fixed_sensor",
    "former_names_of",
    "make_imu",
    "make_motion_capture",
    "memory_of",
    "only",
    "renderer_of",
    "resolve",
    "settings_of",
    "takes_settings",
    "truth_rates_hz",
    "view_scene",
]
