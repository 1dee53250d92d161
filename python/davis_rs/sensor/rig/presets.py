"""Loads rigs by name or file; those of the package are rig files next to this module."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from ..._util.close_names import no_name_or_file
from .rig import Rig
from .rig_file import read_rig_file

RIGS = ("stereo-davis346", "stereo-dsec")
"""Rigs by name; ``load_rig`` reads each from a file of the package, which tells its values and their sources."""

_SUFFIXES = (".yaml", ".yml", ".json")


def load_rig(name_or_path: str | os.PathLike[str] | Rig) -> Rig:
    """Load a rig from a file, or a preset by its name.

    >>> rig = load_rig("stereo-davis346")  # or "my_rig.yaml"
    >>> simulate_rig(scene, rig)

    Args:
        name_or_path: a name in :data:`RIGS`, else a YAML file; docs/rigs.md says what it holds. A rig stays one.

    Raises:
        ValueError: if it is no preset, and no file by its suffix (.yaml, .yml, .json).
        OSError: if the file cannot be read.
        DecodeError: if the file breaks a rule, naming file, sensor, rule and value.
    """
    if isinstance(name_or_path, Rig):
        return name_or_path
    name = os.fspath(name_or_path)
    if name in RIGS:
        return _preset(name)
    if not name.lower().endswith(_SUFFIXES):
        raise no_name_or_file("rig", name, RIGS, _SUFFIXES)
    return read_rig_file(name)


@cache
def _preset(name: str) -> Rig:
    return read_rig_file(Path(__file__).with_name(f"{name}.yaml"))
