"""The settings of a simulation: their declarations, and what they stand for with a given scene."""

from .image_camera import parse_size
from .inertial import make_imu, make_motion_capture
from .resolve import ViewedScene, chosen_sampling, view_scene
from .setting import Setting, complete, only, settings_of, takes_settings
from .simulation_settings import FolderSettings, SimulationSettings, SimulatorSettings, ViewSettings

__all__ = [
    "FolderSettings",
    "Setting",
    "SimulationSettings",
    "SimulatorSettings",
    "ViewSettings",
    "ViewedScene",
    "chosen_sampling",
    "complete",
    "make_imu",
    "make_motion_capture",
    "only",
    "parse_size",
    "settings_of",
    "takes_settings",
    "view_scene",
]
