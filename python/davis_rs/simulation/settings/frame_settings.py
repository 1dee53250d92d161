"""The settings of events from frames (video, images, arrays), each declared once, next to those of a simulation."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Annotated, Any, TypedDict

from ...geometry.camera import PRESETS, Camera
from ...sensor.effects import EffectsLike
from ...sensor.parameters import SensorParameters
from .setting import Declared
from .simulation_settings import EFFECT_FORM, EFFECTS, SENSOR, EngineSettings, FolderFileSettings, PixelSettings

_LIGHT, _PART, _BETWEEN = "light", "which part", "between frames"

INTERPOLATIONS = ("auto", "linear", "cubic", "flow")
"""How light may run between two frames."""


class _LightSettings(TypedDict, total=False):
    """What the values of a frame stand for."""

    transfer: Annotated[
        str | None,
        Declared(
            "how values encode light: srgb (IEC 61966-2-1), rec709 (the camera curve of ITU-R BT.709), linear, gamma=G",
            default_help="what the video says; else srgb for integers, linear for floating point",
            metavar="CURVE",
            group=_LIGHT,
        ),
    ]
    white_level: Annotated[
        float | None,
        Declared(
            "the value of a frame that stands for luma 1, such as 4095 for 12 bits in 16; of a video in its own bits",
            default_help="the video's; else the largest multiple of the step between integers, 1 for floating point",
            low=0,
            above_low=True,
            metavar="V",
            group=_LIGHT,
        ),
    ]
    log_eps: Annotated[
        float | None,
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
    ]


class _PartSettings(TypedDict, total=False):
    """Which part of the frames is taken, in time and in space."""

    start_s: Annotated[
        float, Declared("where to start, in seconds after the first frame", 0.0, unit="s", low=0, group=_PART)
    ]
    stop_s: Annotated[
        float | None,
        Declared(
            "where to stop, in seconds after the first frame",
            default_help="the end",
            unit="s",
            low=0,
            above_low=True,
            group=_PART,
        ),
    ]
    slow_motion: Annotated[
        float,
        Declared(
            "factor by which the video is slowed down: 8 for 240 frames per second that are stamped as 30",
            1.0,
            low=1e-6,
            high=1e6,
            group=_PART,
        ),
    ]
    crop: Annotated[
        tuple[int, int] | str | None,
        Declared(
            "crop the middle of each frame to this size, in pixels",
            default_help="all of it",
            metavar="WxH",
            text=str,
            group=_PART,
        ),
    ]
    roi: Annotated[
        str | None,
        Declared(
            "a part of each frame: its size, and its left and upper edge, in pixels",
            default_help="all of it",
            metavar="WxH+X+Y",
            group=_PART,
        ),
    ]
    size: Annotated[
        tuple[int, int] | str | None,
        Declared(
            "size of the sensor in pixels, to which that part is reduced by averaging areas",
            default_help="the size of the frames",
            metavar="WxH",
            text=str,
            group=_PART,
        ),
    ]
    camera: Annotated[
        Camera | str | os.PathLike[str] | None,
        Declared(
            f"lens of the resulting image, for calib.txt and for vignetting: {', '.join(PRESETS)}, or a calib.txt",
            default_help="not known",
            metavar="CAMERA",
            text=str,
            group=_PART,
        ),
    ]


class _BetweenSettings(TypedDict, total=False):
    """How light runs between two frames."""

    interpolation: Annotated[
        str | Callable[..., Any],
        Declared(
            "linear or cubic in log intensity; flow: along optical flow; auto: cubic where the image hardly moves, "
            "flow where it does. From Python also interpolator(before, after, shares) -> frames",
            "auto",
            choices=INTERPOLATIONS,
            text=str,
            group=_BETWEEN,
        ),
    ]
    max_displacement_px: Annotated[
        float,
        Declared(
            "flow and interpolators make frames so densely that the image moves by at most this much between them",
            0.5,
            unit="px",
            low=0.01,
            high=100,
            metavar="PX",
            group=_BETWEEN,
        ),
    ]


class FrameSettings(_LightSettings, _PartSettings, _BetweenSettings, PixelSettings, EngineSettings, total=False):
    """The settings of :func:`~davis_rs.events_from_frames`."""

    sensor: Annotated[SensorParameters | str | os.PathLike[str] | None, SENSOR]
    effects: Annotated[
        EffectsLike | None,
        Declared(
            f"effects {EFFECT_FORM}; each is added to the sensor's, or replaces the sensor's of the same name",
            default_help="the sensor's",
            metavar=EFFECT_FORM,
            text=list,
            group=EFFECTS,
        ),
    ]


class FrameFolderSettings(FrameSettings, FolderFileSettings, total=False):
    """The settings of :func:`~davis_rs.frames_to_folder`: those of the events, and what is written next to them."""

    images_every: Annotated[
        int,
        Declared("write every Nth frame into the folder as an intensity frame; 0 for none", 1, low=0, metavar="N"),
    ]
