"""Reads and writes a sensor as a YAML file: each parameter with its value, its unit and its source."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import get_args, get_type_hints

from ..._core import DecodeError
from ..._util.array_types import JsonObject
from ..._util.close_names import did_you_mean
from ..._util.whole_file import write_whole
from ..._util.yaml_file import MOST_BYTES, read_yaml
from ..parameters import SensorParameters

SENSOR_SUFFIXES = (".yaml", ".yml", ".json")
"""How the name of a sensor file may end; JSON is YAML too."""

_DESCRIPTION = "description"
_ENTRY = ("value", "unit", "uncertainty", "source")
_HEADING = "# A sensor of davis-rs: --sensor FILE.yaml, or davis_rs.load_sensor. docs/sensor.md has the keys.\n"
_WIDTH = 110
_LINE_SEPARATORS = frozenset("\x85\u2028\u2029")

_UNITS = {
    "events_per_s": "events/s",
    "hz": "Hz",
    "us": "us",
    "ns": "ns",
    "s": "s",
    "lux": "lux",
    "dn": "DN",
    "bits": "bits",
    "px": "px",
    "c": "degrees Celsius",
    "k": "K",
    "v": "V",
    "e": "electrons",
}
"""The unit that the end of a parameter's name stands for."""

_UNITS_OF_NAMES = {
    "width": "px",
    "height": "px",
    "contrast_threshold": "natural-log units",
    "contrast_threshold_off": "natural-log units",
    "threshold_mismatch": "share of the threshold",
    "hot_pixel_fraction": "share of the pixels",
    "vignetting": "exponent of the cosine",
    "aps_electrons_per_dn": "electrons a DN",
    "aps_prnu": "share of the gain",
}


@dataclass(frozen=True)
class SensorFile:
    """Holds the content of a sensor file.

    Attributes:
        parameters: of the sensor; those that the file does not give are None.
        description: of the sensor, in words; "" for none.
        sources: by a parameter's name where its value comes from, for example a data sheet, or "assumption".
        uncertainties: by a parameter's name the standard deviation of its value, in the value's unit.

    Raises:
        ValueError: for a source or an uncertainty of something that is no parameter, or an uncertainty that is not
            finite and >= 0.
    """

    parameters: SensorParameters
    description: str = ""
    sources: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    uncertainties: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for mapping, given in (("sources", self.sources), ("uncertainties", self.uncertainties)):
            for name in given:
                if name not in parameter_names():
                    raise ValueError(
                        f"{mapping}: a sensor has no parameter {name!r}{did_you_mean(name, parameter_names())}"
                    )
        for name, sigma in self.uncertainties.items():
            if not (_is_number(sigma) and math.isfinite(sigma) and sigma >= 0):
                raise ValueError(f"the uncertainty of {name} must be finite and >= 0, got {_shown(sigma)}")

    @property
    def title(self) -> str:
        """Return the first sentence of the description, without its full stop."""
        return self.description.partition(". ")[0].rstrip(".")

    @property
    def given(self) -> dict[str, float]:
        """Return the parameters that are given, by name."""
        values = ((name, getattr(self.parameters, name)) for name in parameter_names())
        return {name: value for name, value in values if value is not None}


@cache
def parameter_names() -> tuple[str, ...]:
    """Return the names of all parameters of a sensor."""
    return tuple(parameter.name for parameter in fields(SensorParameters))


def unit_of(name: str) -> str:
    """Return the unit of a parameter, which the end of its name tells; ``"1"`` for a pure number."""
    if name in _UNITS_OF_NAMES:
        return _UNITS_OF_NAMES[name]
    ends = (end for end in _UNITS if name.endswith(f"_{end}"))
    return _UNITS.get(max(ends, key=len, default=""), "1")


def read_sensor_file(path: str | os.PathLike[str]) -> SensorFile:
    """Read a sensor file, as :func:`save_sensor` writes it.

    A parameter may also be a plain value, without unit and source; null stands for one that is not known.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is no YAML, has a key that does not exist, a value that is out of range or of another type,
            or a unit that is not the parameter's; naming file, key, rule and value.
    """
    file = Path(path)
    try:
        content = read_yaml(file)
    except ValueError as error:
        raise error if isinstance(error, DecodeError) else DecodeError(str(error)) from None
    return read_sensor_content(file, content)


def read_sensor_content(file: str | os.PathLike[str], content: object) -> SensorFile:
    """Read what a sensor file holds, or a part of another file that has the same keys.

    Args:
        file: where it stands, for messages.
        content: as YAML gives it.

    Raises:
        DecodeError: as :func:`read_sensor_file`.
    """
    known = (_DESCRIPTION, *parameter_names())
    entries = _mapping(file, "a sensor", content, known)
    description = entries.pop(_DESCRIPTION, "")
    if not isinstance(description, str):
        raise DecodeError(f"{file}: {_DESCRIPTION} must be a text, got {_shown(description)}")
    values: JsonObject = {}
    sources: dict[str, str] = {}
    uncertainties: dict[str, float] = {}
    for name, entry in entries.items():
        told = _mapping(file, name, entry, _ENTRY) if isinstance(entry, dict) else {"value": entry}
        if "value" not in told:
            raise DecodeError(f"{file}: {name} must have a value, got {_shown(entry)}")
        if "unit" in told and told["unit"] not in (unit_of(name), 1 if unit_of(name) == "1" else None):
            raise DecodeError(f"{file}: {name}: unit must be {unit_of(name)}, got {_shown(told['unit'])}")
        values[name] = _checked(file, name, told["value"])
        if told.get("source") is not None:
            if not isinstance(told["source"], str):
                raise DecodeError(f"{file}: {name}: source must be a text, got {_shown(told['source'])}")
            sources[name] = told["source"]
        if told.get("uncertainty") is not None:
            uncertainties[name] = told["uncertainty"]
    try:
        parameters = SensorParameters(**values)
        parameters.effects(1000.0)  # ranges that the effects know
        return SensorFile(parameters, description, MappingProxyType(sources), MappingProxyType(uncertainties))
    except ValueError as error:
        raise DecodeError(f"{file}: {error}") from None


def save_sensor(
    path: str | os.PathLike[str],
    sensor: SensorParameters,
    *,
    description: str = "",
    sources: Mapping[str, str] | None = None,
    uncertainties: Mapping[str, float] | None = None,
) -> Path:
    """Write a sensor file, which :func:`load_sensor` reads back exactly.

    Args:
        path: the file to write; an existing one is replaced.
        description: of the sensor, in words.
        sources: by a parameter's name where its value comes from, such as a data sheet, or "assumption".
        uncertainties: by a parameter's name the standard deviation of its value, in the value's unit.

    Raises:
        OSError: if it cannot be written.
        ValueError: for sources or uncertainties of anything but a parameter, or more text than a sensor file may have.
    """
    file = Path(path)
    text = sensor_yaml(SensorFile(sensor, description, dict(sources or {}), dict(uncertainties or {})))
    encoded = text.encode()
    if len(encoded) > MOST_BYTES:
        raise ValueError(f"{file}: a sensor file may have {MOST_BYTES} bytes, this would have {len(encoded)}")
    write_whole(file, encoded)
    return file


def sensor_yaml(sensor: SensorFile) -> str:
    """Write the text of a sensor file: each value that is given, with its unit, its uncertainty and its source."""
    import yaml

    # YAML reads other line separators than its own back as spaces, unless they are escaped.
    plain = _LINE_SEPARATORS.isdisjoint("".join([sensor.description, *sensor.sources.values()]))

    def dumped(key: str, value: object) -> str:
        return yaml.safe_dump({key: value}, sort_keys=False, allow_unicode=plain, width=_WIDTH)

    sections = [_HEADING]
    if sensor.description:
        sections.append(dumped(_DESCRIPTION, sensor.description))
    told = [name for name in parameter_names() if name in {**sensor.given, **sensor.sources, **sensor.uncertainties}]
    for name in told:
        notes = {
            "unit": unit_of(name),
            "uncertainty": sensor.uncertainties.get(name),
            "source": sensor.sources.get(name),
        }
        sections.append(
            dumped(
                name, {"value": sensor.given.get(name)} | {key: one for key, one in notes.items() if one is not None}
            )
        )
    if not told:
        sections.append("{}\n" if not sensor.description else "")
    return "".join(sections)


def _mapping(file: str | os.PathLike[str], subject: str, content: object, known: Iterable[str]) -> JsonObject:
    """Check that ``content`` is a mapping with known keys only, and return it."""
    known = tuple(known)
    if not isinstance(content, dict):
        raise DecodeError(f"{file}: {subject} must be a mapping of keys to values, got {_shown(content)}")
    for key in content:
        if key not in known:
            near = did_you_mean(key if isinstance(key, str) else "", known) or f"; there are {', '.join(known)}"
            raise DecodeError(f"{file}: {subject} has no key {_shown(key)}{near}")
    return dict(content)


def _checked(file: str | os.PathLike[str], name: str, value: object) -> object:
    """Check that a value has the parameter's type; the parameter's own class checks the range."""
    kind = _kinds()[name]
    if value is None:
        return None
    fits = {
        float: _is_number(value),
        int: isinstance(value, int) and not isinstance(value, bool),
        bool: isinstance(value, bool),
        str: isinstance(value, str),
    }[kind]
    if not fits:
        wanted = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}[kind]
        unit = "" if unit_of(name) == "1" else f" ({unit_of(name)})"
        raise DecodeError(f"{file}: {name} must be {wanted}{unit}, got {_shown(value)}")
    return value


def _is_number(value: object) -> bool:
    """Return whether a value is a number; an integer beyond the range of floats is not."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, float) or abs(value) <= sys.float_info.max


def _shown(value: object) -> str:
    """Return a value for a message, cut off where it is long."""
    try:
        return f"{value!r:.60}"
    except ValueError:
        return "a number of too many digits"


@cache
def _kinds() -> Mapping[str, type]:
    """Return the type of each parameter's value, from the annotations of :class:`SensorParameters`."""
    kinds = {}
    for name, annotation in get_type_hints(SensorParameters).items():
        members = [one for one in get_args(annotation) or (annotation,) if one is not type(None)]
        if len(members) != 1 or members[0] not in (float, int, bool, str):
            raise TypeError(f"{name}: a sensor file holds numbers, truth values and texts, not {annotation}")
        kinds[name] = members[0]
    return kinds
