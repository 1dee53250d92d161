"""Decides which camera a simulation has: by the scene, a calibration, a size and a sensor, which must agree."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from ..._util.argument_checks import parse_size
from ..._util.argument_error import ArgumentError
from ...geometry.camera import PRESETS, Camera
from ...scene.scene import Scene
from ...sensor.parameters import SensorParameters
from ...sensor.presets import SENSORS

_SIZE_OF_PUBLIC_CALIBRATIONS = (240, 180)
_CENTRED = 0.15
"""A principal point lies within this share of the size from the centre, or the size is another one."""


def image_camera(
    scene: Scene,
    camera: Camera | str | os.PathLike[str] | None,
    size: tuple[int, int] | str | None,
    sensor: SensorParameters,
) -> Camera:
    """Make the camera that the arguments ask for together.

    Args:
        camera: a camera, a preset's name or a ``calib.txt``; None takes the scene's lens.
        size: (width, height) in pixels or ``WxH``.
        sensor: its size, where it has one, is the image's.

    The scene's lens on another size keeps its horizontal field of view: fx and fy grow with the width, the principal
    point stays at the same share of width and height, the distortion is unchanged.

    Raises:
        ValueError: where camera, size and sensor contradict each other, naming both sides; for a calibration file
            whose size is not known; for a malformed size.
        OSError, DecodeError: if a calibration cannot be read.
    """
    asked = parse_size(size)
    own = None if sensor.width is None or sensor.height is None else (sensor.width, sensor.height)
    if asked is not None and own is not None and asked != own:
        raise ArgumentError("{size} {} contradicts the sensor's {} pixels", _text(asked), _text(own))
    wanted = asked or own
    if camera is None:
        own_camera = scene.own_camera
        return own_camera if wanted in (None, (own_camera.width, own_camera.height)) else own_camera.resized(*wanted)
    return camera_of_size(camera, wanted, "size" if asked is not None else "the sensor")


def camera_of_size(camera: Camera | str | os.PathLike[str], wanted: tuple[int, int] | None, source: str) -> Camera:
    """Load a camera, a preset's name or a ``calib.txt``, for an image of a size.

    Args:
        wanted: (width, height) in pixels; None takes the camera's own.
        source: who asks for that size, for messages.

    Raises:
        ValueError: if the camera has another size, or a calibration file whose size is not known.
        OSError, DecodeError: if a calibration cannot be read.

    Warns:
        UserWarning: for a principal point that lies far from the middle.
    """
    if not isinstance(camera, Camera):
        name = os.fspath(camera)
        if name not in PRESETS:
            return _from_calibration(name, wanted)
        camera = PRESETS[name]
    if wanted not in (None, (camera.width, camera.height)):
        raise ArgumentError(
            "the {camera} has {} pixels, but {} asks for {}",
            _text((camera.width, camera.height)),
            source,
            _text(wanted),
        )
    return camera


def _from_calibration(name: str, wanted: tuple[int, int] | None) -> Camera:
    path = Path(name)
    if not path.is_file():
        presets = ", ".join(PRESETS)
        if name in SENSORS:
            raise ArgumentError(
                "{camera} {!r} is neither a preset ({}) nor a calib.txt file; did you mean {sensor:{}}?",
                name,
                presets,
                name,
            )
        raise ArgumentError("{camera} {!r} is neither a preset ({}) nor a calib.txt file", name, presets)
    width, height = wanted or _SIZE_OF_PUBLIC_CALIBRATIONS
    camera = Camera.from_calib(path, width=width, height=height)
    if wanted is None and not _centred(camera):
        raise ArgumentError(
            "{} has its principal point at ({:g}, {:g}), which is not that of a {} sensor, and a calib.txt does not "
            "hold its size: give {size} WxH or a {sensor}",
            path,
            camera.cx,
            camera.cy,
            _text(_SIZE_OF_PUBLIC_CALIBRATIONS),
        )
    if not (-0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5):
        raise ValueError(
            f"{path} has its principal point at ({camera.cx:g}, {camera.cy:g}), outside of an image of "
            f"{_text((width, height))} pixels"
        )
    if not _centred(camera):
        warnings.warn(
            f"{path} has its principal point at ({camera.cx:g}, {camera.cy:g}), far from the middle of an image of "
            f"{_text((width, height))} pixels: is it the calibration of another size?",
            stacklevel=2,
        )
    return camera


def _centred(camera: Camera) -> bool:
    across = abs(camera.cx - (camera.width - 1) / 2) / camera.width
    down = abs(camera.cy - (camera.height - 1) / 2) / camera.height
    return max(across, down) <= _CENTRED


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
