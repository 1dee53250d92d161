"""Prints simulation/settings/keywords.py, made from the declarations: python benches/settings_keywords.py"""

from __future__ import annotations

from davis_rs.simulation.settings import (
    FolderSettings,
    FrameFolderSettings,
    PlanSettings,
    Settings,
    SimulationSettings,
    SimulatorSettings,
    ViewSettings,
)

_HEAD = '''"""Tells type checkers and editors the settings that functions take as keyword arguments.

Made by ``python benches/settings_keywords.py`` from the dataclasses in ``simulation_settings`` and ``frame_settings``,
which say what each setting means. A type checker wants a ``TypedDict`` for ``**settings``, and cannot make one of a
dataclass. Nothing imports this file when a program runs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict

from ...events.colour import ColourFilter
from ...geometry.camera import Camera
from ...sampling.rules import TimeSampling
from ...sensor.effects import Effect, EffectsLike
from ...sensor.imu import Imu
from ...sensor.motion_capture import MotionCapture
from ...sensor.parameters import SensorParameters
'''

_TAKEN = (ViewSettings, PlanSettings, SimulatorSettings, SimulationSettings, FolderSettings, FrameFolderSettings)


def keywords_source() -> str:
    """Return the module's text: a TypedDict for each dataclass, bases first."""
    made: dict[type[Settings], str] = {}
    for declaration in _TAKEN:
        for kind in reversed(declaration.__mro__):
            if issubclass(kind, Settings) and kind is not Settings and kind not in made:
                made[kind] = _typed_dict(kind)
    return "\n\n".join([_HEAD, *made.values()])


def _typed_dict(declaration: type[Settings]) -> str:
    bases = [_name(base) for base in declaration.__bases__ if base is not Settings]
    # The annotations are as they are written, because the modules have postponed evaluation.
    keys = [f"    {name}: {annotation}" for name, annotation in declaration.__annotations__.items()]
    head = f"class {_name(declaration)}({', '.join(bases or ['TypedDict'])}, total=False):"
    docstring = f'    """Names the keyword arguments of :class:`{declaration.__name__}`."""'
    return "\n".join([head, docstring, "", *keys]).rstrip() + "\n"


def _name(declaration: type) -> str:
    return declaration.__name__.replace("Settings", "Keywords")


if __name__ == "__main__":
    print(keywords_source(), end="")
