"""Declares the settings of events from frames (video, images, arrays), next to those of a simulation."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...events.colour import ColourFilter
from ...geometry.camera import PRESETS, Camera
from ...sensor.effects import EffectsLike
from ...sensor.parameters import SensorParameters
from .setting import Declared, Settings, declare
from .simulation_settings import (
    COLOUR_FILTER,
    EFFECT_FORM,
    EFFECTS,
    SENSOR,
    EngineSettings,
    FolderFileSettings,
    PixelSettings,
)

_LIGHT, _PART, _BETWEEN = "light", "which part", "between frames"

FITS = ("crop", "pad", "scale")
"""How frames may be brought to a sensor of another size or shape."""

INTERPOLATIONS = ("auto", "linear", "cubic", "flow")
"""How light may run between two frames."""


@dataclass(frozen=True, kw_only=True)
class _LightSettings(Settings):
    """Declares what the values of a frame stand for."""

    transfer: str | None = declare(
        None,
        Declared(
            "how values encode light: srgb (IEC 61966-2-1), rec709 (the camera curve of ITU-R BT.709), linear, gamma=G",
            default_help="what the video says; else srgb for integers, linear for floating point",
            metavar="CURVE",
            group=_LIGHT,
        ),
    )
    white_level: float | None = declare(
        None,
        Declared(
            "the value of a frame that stands for luma 1, such as 4095 for 12 bits in 16; of a video in its own bits",
            default_help="the video's; else the largest multiple of the step between integers, 1 for floating point",
            low=0,
            above_low=True,
            metavar="V",
            group=_LIGHT,
        ),
    )
    log_eps: float | None = declare(
        None,
        Declared(
            "dark level: L = ln(luma + log_eps)",
            default_help="the sensor's dark current, or 0.001; or more, so that one grey level stays below C",
            unit="luma",
            low=0,
            high=1000,
            above_low=True,
            metavar="Y",
            group=_LIGHT,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class _PartSettings(Settings):
    """Declares which part of the frames is taken, in time and in space."""

    start_s: float = declare(
        0.0,
        Declared(
            "where to start, in seconds after the first frame",
            unit="s",
            low=0,
            group=_PART,
        ),
    )
    stop_s: float | None = declare(
        None,
        Declared(
            "where to stop, in seconds after the first frame",
            default_help="the end",
            unit="s",
            low=0,
            above_low=True,
            group=_PART,
        ),
    )
    slow_motion: float = declare(
        1.0,
        Declared(
            "factor by which the video is slowed down: 8 for 240 frames per second that are stamped as 30",
            low=1e-6,
            high=1e6,
            group=_PART,
        ),
    )
    crop: tuple[int, int] | str | None = declare(
        None,
        Declared(
            "crop the middle of each frame to this size, in pixels",
            default_help="all of it",
            metavar="WxH",
            text=str,
            group=_PART,
        ),
    )
    roi: str | None = declare(
        None,
        Declared(
            "a part of each frame: its size, and its left and upper edge, in pixels",
            default_help="all of it",
            metavar="WxH+X+Y",
            group=_PART,
        ),
    )
    size: tuple[int, int] | str | None = declare(
        None,
        Declared(
            "size of the sensor in pixels, to which that part is reduced by averaging areas",
            default_help="the size of the frames",
            metavar="WxH",
            text=str,
            group=_PART,
        ),
    )
    fit: str | None = declare(
        None,
        Declared(
            "bring that part to the sensor's size, or to size, also where that is larger or has another shape: crop "
            "cuts off what goes beyond it, pad puts black around, scale stretches",
            default_help="a size that does not fit is an error",
            choices=FITS,
            group=_PART,
        ),
    )
    camera: Camera | str | os.PathLike[str] | None = declare(
        None,
        Declared(
            f"lens of the resulting image, for calib.txt and for vignetting: {', '.join(PRESETS)}, or a calib.txt",
            default_help="not known",
            metavar="CAMERA",
            text=str,
            group=_PART,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class _InterpolationSettings(Settings):
    """Declares how light runs between two frames."""

    interpolation: str | Callable[..., Any] = declare(
        "auto",
        Declared(
            "linear or cubic in log intensity; flow: along optical flow; auto: cubic where the image hardly moves, "
            "flow where it does. From Python also interpolator(before, after, shares) -> frames",
            choices=INTERPOLATIONS,
            text=str,
            group=_BETWEEN,
        ),
    )
    interpolator: str | None = declare(
        None,
        Declared(
            "an interpolator of your own, in Python, in the place of flow (docs/events_from_video.md): "
            "MODULE:FUNCTION or FILE.py:FUNCTION; a class is called without arguments, and gives it",
            default_help="none",
            metavar="MODULE:FUNCTION",
            group=_BETWEEN,
        ),
    )
    max_displacement_px: float = declare(
        0.5,
        Declared(
            "flow and interpolators make frames so densely that the image moves by at most this much between them",
            unit="px",
            low=0.01,
            high=100,
            metavar="PX",
            group=_BETWEEN,
        ),
    )
    image_rate_hz: float | None = declare(
        None,
        Declared(
            "intensity frames at this rate, made from the light between frames: slow motion next to the events",
            default_help="the frames themselves",
            unit="Hz",
            low=0,
            high=1e6,
            above_low=True,
            metavar="HZ",
            group=_BETWEEN,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class FrameSettings(EngineSettings, PixelSettings, _InterpolationSettings, _PartSettings, _LightSettings):
    """Declares the settings of :func:`~davis_rs.events_from_frames`."""

    sensor: SensorParameters | str | os.PathLike[str] | None = declare(None, SENSOR)
    colour_filter: ColourFilter | str | None = declare(None, COLOUR_FILTER)
    effects: EffectsLike | None = declare(
        None,
        Declared(
            f"effects {EFFECT_FORM}; each is added to the sensor's, or replaces the sensor's of the same name",
            default_help="the sensor's",
            metavar=EFFECT_FORM,
            text=list,
            group=EFFECTS,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class FrameFolderSettings(FolderFileSettings, FrameSettings):
    """Declares the settings of :func:`~davis_rs.frames_to_folder`: those of the events, and what is written next to
    them."""

    images_every: int = declare(
        1,
        Declared(
            "write every Nth frame into the folder as an intensity frame; 0 for none",
            low=0,
            metavar="N",
        ),
    )
