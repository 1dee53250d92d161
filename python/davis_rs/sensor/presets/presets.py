"""Loads sensors by name or file; those of the package are sensor files next to this module."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from ..._util.close_names import no_name_or_file
from ..parameters import SensorParameters
from .sensor_file import SENSOR_SUFFIXES, SensorFile, read_sensor_file

IDEAL = "ideal"
"""The sensor of ideal pixels, which leaves size and thresholds to the scene."""

_NAMES = (IDEAL, "davis240c", "davis346")


class _Presets(Mapping[str, SensorParameters]):
    """Maps names to sensors, each read from its file on first use."""

    def __getitem__(self, name: str) -> SensorParameters:
        return preset_file(name).parameters

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)

    def __repr__(self) -> str:
        return f"<sensors {', '.join(_NAMES)}>"


SENSORS: Mapping[str, SensorParameters] = _Presets()
"""Sensors by name. ``davis-rs sensors show NAME`` prints what is known of each, with units and sources.

``ideal`` has no imperfection at all. ``davis240c`` and ``davis346`` are those cameras with the biases that the vendor's
driver sends; what no source is known for is left open.
"""


@cache
def preset_file(name: str) -> SensorFile:
    """Load a preset with its description and its sources.

    Raises:
        KeyError: for another name.
    """
    if name not in _NAMES:
        raise KeyError(name)
    return read_sensor_file(Path(__file__).with_name(f"{name}.yaml"))


def load_sensor(name_or_path: str | os.PathLike[str]) -> SensorParameters:
    """Load a sensor from a file, or a preset by its name.

    >>> sensor = load_sensor("davis240c")  # or "my_camera.yaml"
    >>> Simulator(scene, sensor=sensor)

    Args:
        name_or_path: a name in :data:`SENSORS`, else a YAML file; docs/sensor.md says what it holds.

    Raises:
        ValueError: if it is no preset, and no file by its suffix (.yaml, .yml, .json).
        OSError: if the file cannot be read.
        DecodeError: if the file breaks a rule, naming file, key, rule and value.
    """
    return load_sensor_file(name_or_path).parameters


def load_sensor_file(name_or_path: str | os.PathLike[str]) -> SensorFile:
    """Load a sensor as :func:`load_sensor` does, with description, sources and uncertainties."""
    name = os.fspath(name_or_path)
    if name in _NAMES:
        return preset_file(name)
    if not name.lower().endswith(SENSOR_SUFFIXES):
        raise no_name_or_file("sensor", name, _NAMES, SENSOR_SUFFIXES)
    return read_sensor_file(name)


def sensor_parameters(sensor: str | os.PathLike[str] | SensorParameters | None) -> SensorParameters:
    """Return the parameters of a sensor given by name, file or parameters; None is the ideal one.

    Raises:
        ValueError, OSError: as :func:`load_sensor`.
    """
    if sensor is None:
        return SensorParameters()
    return sensor if isinstance(sensor, SensorParameters) else load_sensor(sensor)


def read_once(sensor: str | os.PathLike[str] | SensorParameters | None) -> str | SensorParameters | None:
    """Read a sensor's file if it is one, so that the result no longer depends on the file; return all else unchanged.

    A run reads its sensor once, so that all of its parts, and its record, have the same one.

    Raises:
        ValueError, OSError: as :func:`load_sensor`.
    """
    if sensor is None or isinstance(sensor, SensorParameters):
        return sensor
    name = os.fspath(sensor)
    return name if name in _NAMES else load_sensor(name)
