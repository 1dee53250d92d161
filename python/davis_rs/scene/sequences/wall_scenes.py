"""Makes flat scenes: a wall of plain shapes, and a wall behind a poster of rocks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ..._mitsuba.types import SceneDictionary
from ...geometry.camera import PRESETS
from ..parts import DIRECT, rectangle, start_looking_at
from ..scene import Scene
from ..textures import Texture, bitmap
from .prints import plain_shapes, stones
from .room import FACING, LUX_PER_LUMA, empty_room, general_light, point_light

_EYE_M, _WALL_M, _HEIGHT_M = 1.4, 1.1, 2.8
"""The camera's height, its distance from the wall, and the room's height; at the wall a pixel is 5.5 mm wide."""

_TEXEL_M = 0.005

_EVEN = {"lamp": point_light((0.5, -2.5, 1.9), 350.0, 3.8), "general": general_light(150.0)}
"""500 lux on the wall."""


def shapes() -> Scene:
    """Make a white wall with a few dozen plain black shapes of 5 to 25 cm, in an evenly lit room.

    A synthetic counterpart of the dataset's shapes by kind: plain, black on white, flat; sizes and places are other
    ones.
    """
    return _before_a_wall("shapes", _shapes)


def poster(hdr: bool = False) -> Scene:
    """Make a wall covered by a poster of rocks, in an evenly lit room or (``hdr``) by a light close to it: 80 to 2400
    lux.

    A synthetic counterpart of the dataset's poster and hdr_poster by kind of texture and light: dense, irregular, flat;
    the rocks are other ones, and the light has no shade, so its spot has a soft edge.
    """
    return _before_a_wall("hdr_poster" if hdr else "poster", partial(_poster, hdr))


def _before_a_wall(name: str, source: Callable[[], SceneDictionary]) -> Scene:
    return Scene(
        name=name,
        source=source,
        camera=PRESETS["davis240c"],
        start=start_looking_at((0.0, 0.0, _EYE_M), (0.0, _WALL_M, _EYE_M)),
        contrast_threshold=0.5,
        # Seen from inside, nothing in an empty room shades anything.
        shadows=False,
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


def _shapes() -> SceneDictionary:
    printed = plain_shapes(504, 1064, 41, cell=56, radius=(5.0, 25.0), fraction=0.16, ink=0.12, paper=0.75)
    return {
        "type": "scene",
        "integrator": DIRECT,
        **_EVEN,
        **empty_room((-3.0, 3.0), (-4.0, _WALL_M + 1e-4), _HEIGHT_M, walls=0.75, ceiling=0.75),
        "shapes": _on_the_wall(printed),
    }


def _poster(hdr: bool) -> SceneDictionary:
    printed = stones(512, 1024, 42, low=0.08, high=0.85, stone=30.0)
    lights = (
        {"spot": point_light((-0.5, _WALL_M - 0.3, 1.7), 2320.0, 0.3), "general": general_light(80.0)} if hdr else _EVEN
    )
    return {
        "type": "scene",
        "integrator": DIRECT,
        **lights,
        **empty_room((-3.0, 3.0), (-4.0, _WALL_M + 1e-4), _HEIGHT_M),
        "poster": _on_the_wall(printed),
    }


def _on_the_wall(printed: Texture) -> SceneDictionary:
    """Make a sheet in the middle of the wall, 0.1 mm before it."""
    height, width = printed.shape[:2]
    half = (width * _TEXEL_M / 2, height * _TEXEL_M / 2)
    return rectangle([0.0, _WALL_M, _HEIGHT_M / 2], FACING, half, bitmap(printed))
