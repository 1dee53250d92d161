"""Reads and writes sensors as files, with units and sources, and holds those that come with the package."""

from .presets import IDEAL, SENSORS, load_sensor, load_sensor_file, preset_file, read_once, sensor_parameters
from .recorded_sensor import RECORDED, recorded_sensor
from .sensor_file import (
    SENSOR_SUFFIXES,
    SensorFile,
    parameter_names,
    read_sensor_file,
    save_sensor,
    sensor_yaml,
    unit_of,
)

__all__ = [
    "IDEAL",
    "RECORDED",
    "SENSORS",
    "SENSOR_SUFFIXES",
    "SensorFile",
    "load_sensor",
    "load_sensor_file",
    "parameter_names",
    "preset_file",
    "read_once",
    "read_sensor_file",
    "recorded_sensor",
    "save_sensor",
    "sensor_parameters",
    "sensor_yaml",
    "unit_of",
]
