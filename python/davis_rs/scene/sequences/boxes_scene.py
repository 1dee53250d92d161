"""Makes a cluttered room: printed boxes that stand and are stacked on a carpet."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.camera import PRESETS
from ..parts import DIRECT, rectangle, start_looking_at
from ..scene import Scene
from ..textures import Texture, bitmap, patchwork
from .prints import blocks, plain_shapes, stones, text
from .room import FACING, LUX_PER_LUMA, SIDEWAYS, covered_box, empty_room, general_light, point_light

_EYE_M = (0.0, 0.0, 1.1)
_FREE_M = 1.1
"""No box stands within so much of the camera's start, to the front and to either side."""

_CELL_M = 0.62
"""Stacks stand on a grid this wide, at most one in a square, and so that none reaches out of its square."""


def boxes(hdr: bool = False) -> Scene:
    """Make some fifty boxes of 15 to 50 cm on a carpet, evenly lit or (``hdr``) by a light among them: 80 to 2400 lux.

    A synthetic counterpart of the dataset's boxes and hdr_boxes by kind: many textured boxes at 1 to 4 m, each before
    others; none of them is one of the dataset's.
    """
    return Scene(
        name="hdr_boxes" if hdr else "boxes",
        source=partial(_boxes, hdr),
        camera=PRESETS["davis240c"],
        start=start_looking_at(_EYE_M, (0.0, 2.0, 0.65)),
        contrast_threshold=0.5,
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


def _boxes(hdr: bool) -> SceneDictionary:
    lights = (
        {"spot": point_light((-0.45, 1.5, 1.6), 2320.0, 0.545), "general": general_light(80.0)}
        if hdr
        else {"lamp": point_light((0.9, -0.6, 2.1), 350.0, 2.5), "general": general_light(200.0)}
    )
    carpet = patchwork(256, 60, low=0.08, high=0.5, grain=0.7, shapes=120, tint=(1.0, 0.9, 0.8))
    return {
        "type": "scene",
        "integrator": DIRECT,
        **lights,
        **empty_room((-2.5, 2.5), (-3.0, 3.3), 3.0, floor=bitmap(carpet, repeats=(3.0, 4.0))),
        **_pictures(),
        **_stacks(np.random.RandomState(61)),
    }


def _pictures() -> SceneDictionary:
    """Make posters on the wall ahead and those to the sides, 2 mm before them."""
    rocks = stones(128, 192, 72, low=0.08, high=0.8, stone=18.0)
    planes = blocks(128, 73, low=0.08, high=0.85, count=60)
    page = text(128, 74, line=12, ink=0.08, paper=0.9)
    return {
        "rocks": rectangle([-0.9, 3.298, 1.75], FACING, (0.75, 0.5), bitmap(rocks)),
        "planes": rectangle([0.55, 3.298, 1.7], FACING, (0.45, 0.45), bitmap(planes)),
        "page": rectangle([1.8, 3.298, 1.7], FACING, (0.5, 0.5), bitmap(page)),
        "left_planes": rectangle([-2.498, 1.2, 1.7], SIDEWAYS, (0.6, 0.6), bitmap(planes)),
        "right_rocks": rectangle([2.498, 1.4, 1.7], SIDEWAYS, (0.75, 0.5), bitmap(rocks)),
    }


def _stacks(random: np.random.RandomState) -> SceneDictionary:
    covers = _covers()
    stacks: SceneDictionary = {}
    for x, y in _positions():
        bottom, width, depth = 0.0, *random.uniform(0.3, 0.46, 2)
        # Higher at the back, so that the ones behind are seen too.
        top = 0.25 + 0.45 * y * random.uniform(0.6, 1.0)
        while bottom < top and min(width, depth) > 0.15:
            height = random.uniform(0.15, 0.45)
            turn = random.uniform(-0.3, 0.3)
            centre = np.array([x, y, bottom + height / 2])
            cover = covers[random.randint(len(covers))]
            stacks[f"box_{len(stacks):02}"] = covered_box(centre, np.array([width, depth, height]), turn, cover)
            bottom += height
            width, depth = random.uniform(0.7, 1.0, 2) * (width, depth)
    return stacks


def _positions() -> Iterator[tuple[float, float]]:
    """Yield middles of the squares that have a stack: around the camera's position, but not behind it."""
    for row in range(5):
        for column in range(-3, 4):
            x, y = _CELL_M * column, 0.35 + _CELL_M * row
            near = abs(x) < _FREE_M + _CELL_M / 2 and y < _FREE_M + _CELL_M / 2
            if not near and (row + 2 * column) % 5 < 3:
                yield x, y


def _covers() -> list[Texture]:
    """Draw the prints of boxes; 48 texels are 3 to 9 mm each on a box's side, about what a pixel sees."""
    pictures = [blocks(48, 62 + k, low=0.08, high=0.8, count=40) for k in range(5)]
    pages = [text(48, 67 + k, line=9, ink=0.1, paper=paper) for k, paper in enumerate((0.8, 0.45))]
    signs = [
        plain_shapes(48, 48, 69 + k, cell=16, radius=(4.0, 6.5), fraction=0.9, ink=ink, paper=0.3)
        for k, ink in enumerate((0.05, 0.85))
    ]
    return [*pictures, *pages, *signs]
