"""Makes the scenes of a camera on a linear slider: a wall of prints ahead, and objects at several depths."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ..._util.argument_error import ArgumentError
from ...geometry.camera import PRESETS
from ..parts import DIRECT, rectangle, start_looking_at
from ..scene import Scene
from ..textures import Texture, bitmap, patchwork
from .prints import blocks, plain_shapes, stones, text
from .room import FACING, LUX_PER_LUMA, covered_box, empty_room, general_light, point_light

_EYE_M = (0.0, 0.0, 1.2)
_SLIDE_M = 1.04

_SHEET_M, _PITCH_M = 0.512, 0.54
"""A sheet's side, 256 texels of 2 mm; from sheet to sheet. A pixel sees 1.2 mm at 0.231 m, and 2.9 mm at 0.584 m."""


def slider_wall(distance_m: float, hdr: bool = False) -> Scene:
    """Make a wall hung with prints, exactly so far in front of a camera that slides 1.04 m to its right.

    Lit evenly, or (``hdr``) by a light close to the wall, half-way along the slide: from 2400 lux down to 95 lux at the
    ends of the slide, 83 where the wall is as close as 0.23 m. The dataset's distances are 0.231 m (slider_close,
    slider_hdr_close) and 0.584 m (slider_far, slider_hdr_far).

    A synthetic counterpart by kind: flat prints of hard edges and grain, parallel to the image; the dataset's were
    other pictures.

    Raises:
        ValueError: for a distance that is not in 0.1..2 m.
    """
    if not 0.1 <= distance_m <= 2:
        raise ArgumentError("{distance_m} must lie in 0.1..2 m, got {}", distance_m)
    return Scene(
        name="slider_hdr_wall" if hdr else "slider_wall",
        source=partial(_wall, distance_m, hdr),
        camera=PRESETS["davis240c"],
        start=start_looking_at(_EYE_M, (0.0, 1.0, _EYE_M[2])),
        contrast_threshold=0.3,
        # Flat, and lit from inside of an empty room.
        shadows=False,
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


def _wall(distance_m: float, hdr: bool) -> SceneDictionary:
    # The closer the camera, the less of the wall it passes: the smaller must the spot be for all of its falling off.
    spot_m = min(0.2, 0.35 * distance_m)
    lights = (
        {"spot": point_light((_SLIDE_M / 2, distance_m - spot_m, 1.3), 2320.0, spot_m), "general": general_light(80.0)}
        if hdr
        else {"lamp": point_light((0.5, distance_m - 2.5, 2.0), 350.0, 2.6), "general": general_light(150.0)}
    )
    sheets = _sheets()
    columns, rows = np.arange(-2, 5), np.arange(-1, 2)
    hung = {
        f"sheet_{i}{j}": rectangle(
            [_PITCH_M * column, distance_m, _EYE_M[2] + 0.04 + _PITCH_M * row],
            FACING,
            (_SHEET_M / 2, _SHEET_M / 2),
            bitmap(sheets[(i + 2 * j) % len(sheets)]),
        )
        for (i, column), (j, row) in product(enumerate(columns.tolist()), enumerate(rows.tolist()))
    }
    return {
        "type": "scene",
        "integrator": DIRECT,
        **lights,
        # The wall itself is 0.1 mm behind its prints.
        **empty_room((-2.0, 3.0), (distance_m - 4.0, distance_m + 1e-4), 2.5),
        **hung,
    }


def _sheets() -> list[Texture]:
    return [
        patchwork(256, 81, low=0.06, high=0.9, grain=0.4, shapes=120, tint=(1.0, 1.0, 1.0)),
        text(256, 82, line=18, ink=0.08, paper=0.8),
        stones(256, 256, 83, low=0.06, high=0.85, stone=20.0),
        blocks(256, 84, low=0.06, high=0.9, count=90),
        plain_shapes(256, 256, 85, cell=42, radius=(6.0, 14.0), fraction=0.9, ink=0.85, paper=0.1),
    ]


_NEAREST_M = 0.584

_OBJECTS = [
    (0.10, _NEAREST_M, 0.14, 0.22),
    (0.62, _NEAREST_M, 0.18, 0.16),
    (1.20, 0.65, 0.16, 0.28),
    (-0.25, 0.85, 0.20, 0.40),
    (0.38, 0.95, 0.22, 0.34),
    (0.90, 1.05, 0.20, 0.42),
    (1.60, 1.15, 0.30, 0.50),
    (0.10, 1.45, 0.30, 0.55),
    (1.25, 1.60, 0.35, 0.60),
    (0.65, 1.80, 0.30, 0.45),
    (-0.70, 1.70, 0.40, 0.70),
]
"""Position to the right, distance of the front, width and height, all in metres; on a table."""


def slider_depth() -> Scene:
    """Make printed boxes on a table at 0.58 to 1.8 m, before a wall at 2.6 m; the camera slides 1.09 m to its right.

    The front of the nearest two is exactly 0.584 m from the camera's way and parallel to the image. A synthetic
    counterpart by kind of layout: objects at several depths, each before others; not the dataset's objects.
    """
    return Scene(
        name="slider_depth",
        source=_depths,
        camera=PRESETS["davis240c"],
        start=start_looking_at(_EYE_M, (0.0, 1.0, _EYE_M[2])),
        contrast_threshold=0.3,
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


def _depths() -> SceneDictionary:
    top = 1.02
    covers = [
        blocks(48, 86, low=0.08, high=0.8, count=20),
        text(64, 87, line=12, ink=0.08, paper=0.8),
        plain_shapes(48, 48, 88, cell=16, radius=(4.0, 6.5), fraction=0.9, ink=0.85, paper=0.15),
        blocks(48, 89, low=0.08, high=0.8, count=30),
        stones(64, 64, 91, low=0.1, high=0.8, stone=12.0),
    ]
    boxes = {
        f"box_{k:02}": covered_box(
            np.array([x, front + 0.05, top + height / 2]), np.array([width, 0.1, height]), 0.0, covers[k % len(covers)]
        )
        for k, (x, front, width, height) in enumerate(_OBJECTS)
    }
    poster = stones(256, 256, 90, low=0.15, high=0.7, stone=40.0)
    return {
        "type": "scene",
        "integrator": DIRECT,
        "lamp": point_light((0.5, -0.8, 2.4), 350.0, 2.0),
        "general": general_light(150.0),
        **empty_room((-2.5, 3.5), (-2.5, 2.601), 2.7),
        "table": covered_box(np.array([0.5, 1.45, top - 0.02]), np.array([3.0, 1.9, 0.04]), 0.0, 0.4),
        "poster": rectangle([0.6, 2.6, 1.9], FACING, (0.9, 0.6), bitmap(poster)),
        **boxes,
    }
