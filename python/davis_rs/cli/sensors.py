"""Runs davis-rs sensors."""

from __future__ import annotations

import argparse

from .._util.terminal_text import tell
from ..sensor.presets import SENSORS, SensorFile, load_sensor_file, parameter_names, preset_file, sensor_yaml, unit_of


def add_sensors(sensors: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    sensors.description = (
        "List the sensors that --sensor knows by name. One that is shown is a sensor file: davis-rs sensors show "
        "davis346 > mine.yaml, and --sensor mine.yaml."
    )
    sensors.set_defaults(run=_list)
    kinds = sensors.add_subparsers(metavar="WHAT")
    show = kinds.add_parser("show", help="print a sensor as a file: values, units and sources")
    show.set_defaults(run=_show)
    show.add_argument("sensor", metavar="SENSOR", help=f"{', '.join(SENSORS)}, or a sensor file")


def _list(_: argparse.Namespace) -> int:
    for name in SENSORS:
        sensor = preset_file(name)
        tell(f"{name:<10} {_in_short(sensor)}")
    return 0


def _in_short(sensor: SensorFile) -> str:
    parameters = sensor.parameters
    size = (
        "any size"
        if parameters.width is None or parameters.height is None
        else f"{parameters.width} x {parameters.height}"
    )
    return f"{size:<10} {len(sensor.given):>2} values  {sensor.title}"


def _show(options: argparse.Namespace) -> int:
    sensor = load_sensor_file(options.sensor)
    tell(sensor_yaml(sensor), end="")
    open_ones = [name for name in parameter_names() if name not in sensor.given]
    if open_ones:
        tell("# Not given, so that the effect is off, or the scene or the effect's own value decides:")
        for name in open_ones:
            unit = "" if unit_of(name) == "1" else f" [{unit_of(name)}]"
            tell(f"#   {name}{unit}")
    return 0
