"""Makes an environment map and a sun in place of Mitsuba's ``sunsky``, for renderers that know these.

The sun becomes a directional light of the same irradiance, whose shadows have no soft edges. A sun that is larger than
the real one becomes several, about a degree apart, so that its shadows fade in steps.
"""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaEmitter
from .._util.last_used import keep_last
from .baked.lights import numbers

FloatArray = npt.NDArray[np.float64]

KIND = "SunskyEmitter"

_WIDTH, _HEIGHT = 512, 256
"""Of the map: 0.7 degrees a texel."""

_MOST_SUNS = 16
"""Lights in place of one sun: one for each square of a degree along its diameter, and no more than these."""

_RINGS = 64
"""Of the sun, in which its radiance is looked up."""

_MOST_KNOWN = 4
_known: dict[tuple[str, bytes], npt.NDArray[np.float32]] = {}
"""The last maps by what they were made from: a run makes several renderers of one scene."""


def as_known_lights(sunsky: MitsubaEmitter, mi: Mitsuba) -> list[MitsubaEmitter]:
    """Return an environment map, with the light's id, and directional lights, in place of a ``sunsky``."""
    parameters = mi.traverse(sunsky)
    half = np.radians(_number(sunsky, "Sun aperture") / 2)
    towards = np.array(parameters["sun_direction"], np.float64).reshape(3)
    both = {name: parameters[name] for name in ("sun_scale", "sky_scale")}

    def scaled(**scales: float) -> None:
        for name, scale in (both | scales).items():
            parameters[name] = scale
        parameters.update()

    scaled(sky_scale=0.0)
    irradiance = _irradiance(sunsky, towards, half, mi)
    scaled(sun_scale=0.0)
    made_from = str(sunsky), b"".join(numbers(value).tobytes() for _, value in parameters)
    texels = _known[made_from] if made_from in _known else _texels(sunsky, mi)
    keep_last(_known, made_from, texels, _MOST_KNOWN)
    scaled()
    count = int(np.clip(round(np.degrees(2 * half) ** 2), 1, _MOST_SUNS))
    suns = _over_disk(towards, half, count) if irradiance.any() else np.empty((0, 3))
    sky = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(texels), "id": sunsky.id()})
    return [sky, *(_directional(sun, irradiance / count, mi) for sun in suns)]


def _texels(light: MitsubaEmitter, mi: Mitsuba) -> npt.NDArray[np.float32]:
    """Return the radiance (h, w, 3) of a light around, as a map whose top is y."""
    azimuth = 2 * np.pi * (np.arange(_WIDTH) + 0.5) / _WIDTH
    height = np.pi * (np.arange(_HEIGHT) + 0.5) / _HEIGHT
    sine = np.sin(height)[:, None]
    towards = np.stack(
        np.broadcast_arrays(sine * np.sin(azimuth), np.cos(height)[:, None], -sine * np.cos(azimuth)), axis=-1
    )
    return _radiance(light, towards.reshape(-1, 3), mi).reshape(_HEIGHT, _WIDTH, 3).astype(np.float32)


def _radiance(light: MitsubaEmitter, towards: FloatArray, mi: Mitsuba) -> FloatArray:
    """Return the radiance (n, 3) that comes from directions (n, 3)."""
    hit = mi.SurfaceInteraction3f()
    found = np.empty((len(towards), 3))
    for number, (x, y, z) in enumerate(towards.tolist()):
        hit.wi = mi.Vector3f(-x, -y, -z)
        found[number] = light.eval(hit)
    return found


def _irradiance(sun: MitsubaEmitter, towards: FloatArray, half: float, mi: Mitsuba) -> FloatArray:
    """Return what the sun's disk sends to a surface that faces it, RGB."""
    across, _ = _around(towards)
    angles = half * (np.arange(_RINGS) + 0.5) / _RINGS
    rings = np.cos(angles)[:, None] * towards + np.sin(angles)[:, None] * across
    solid = 2 * np.pi * np.sin(angles) * half / _RINGS
    return np.asarray(solid @ _radiance(sun, rings, mi))


def _over_disk(towards: FloatArray, half: float, count: int) -> FloatArray:
    """Return directions (count, 3) that lie evenly over the sun's disk; its middle for one."""
    if count == 1:
        return towards[None]
    number = np.arange(count) + 0.5
    angle, turn = half * np.sqrt(number / count), 2 * np.pi * 0.618033988749895 * number
    across, upwards = _around(towards)
    aside = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * upwards
    return np.asarray(np.cos(angle)[:, None] * towards + np.sin(angle)[:, None] * aside)


def _around(towards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors that stand on a direction and on each other."""
    across = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    across /= np.linalg.norm(across)
    return across, np.cross(towards, across)


def _directional(towards: FloatArray, irradiance: FloatArray, mi: Mitsuba) -> MitsubaEmitter:
    strength = {"type": "rgb", "value": irradiance.tolist()}
    return mi.load_dict({"type": "directional", "direction": (-towards).tolist(), "irradiance": strength})


def _number(light: MitsubaEmitter, name: str) -> float:
    """Return what Mitsuba tells of a light in words alone."""
    found = re.search(rf"{name} = ([\d.e+-]+)", str(light))
    assert found is not None
    return float(found[1])
