"""Makes the scene ``office``: a desk with what stands on it and around it, for office_zigzag and office_spiral."""

from __future__ import annotations

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.camera import PRESETS
from ..meshes import Mesh, box, merged, quad, shape, tube
from ..parts import DIRECT, start_looking_at
from ..scene import Scene
from ..textures import patchwork
from .room import LUX_PER_LUMA, general_light
from .surface_textures import books, facade, grid, noise, wood, writing

# The room, metres: x to the right, y ahead, to the wall behind the desk, z up from the floor.
_LEFT, _RIGHT, _FRONT, _BACK, _CEILING = -3.0, 3.0, -3.0, 3.0, 3.0
_WINDOW = (0.95, 2.55, 0.95, 2.35)
"""In the back wall: from x to x, from z to z."""

_DESK_Z = 0.74


def office() -> Scene:
    """Make a desk 1.5 m ahead, with two monitors, keyboard, mugs, books and papers, under some 500 lux; C = 0.17.

    Around it a shelf of books, a whiteboard and pictures, a chair, a cabinet, a door, and a window onto a street whose
    light parts are about twice as bright as the walls. The camera has 0.7 m of air all around. A synthetic counterpart
    of the dataset's office by kind of things, texture and light, not a copy; the daylight is seen, but lights nothing
    in the room.
    """
    return Scene(
        name="office",
        source=lambda: {**office_room(), "chair": shape(chair().moved([0.75, 1.75, 0.0], 0.5), 0.15)},
        camera=PRESETS["davis240c"],
        start=start_looking_at([0.0, 0.7, 1.25], [0.0, 2.7, 1.1]),
        contrast_threshold=0.17,
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


def office_room() -> SceneDictionary:
    """Make the room with its light and all that stands still in any scene of it."""
    return {
        "type": "scene",
        "integrator": DIRECT,
        "lamp": {"type": "point", "position": [0.2, 0.6, 2.4], "intensity": 7.0},
        "general": general_light(250.0),
        # Onto the houses that the window shows; from outside and below, where few surfaces of the room face it and so
        # few rays have to be traced for shadows.
        "daylight": {"type": "point", "position": [0.0, 4.5, -25.0], "intensity": 8000.0},
        **_shell(),
        **_on_the_walls(),
        **_desk(),
        **_shelf(),
    }


def chair() -> Mesh:
    """Make an office chair that faces the wall behind the desk, its foot at the origin."""
    legs = [box([x - 0.02, y - 0.02, 0.0], [x + 0.02, y + 0.02, 0.37]) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    seat, back = box([-0.24, -0.24, 0.37], [0.24, 0.24, 0.44]), box([-0.22, -0.28, 0.58], [0.22, -0.23, 0.95])
    posts = [box([x - 0.02, -0.27, 0.44], [x + 0.02, -0.24, 0.58]) for x in (-0.15, 0.15)]
    return merged([*legs, seat, back, *posts])


def _shell() -> SceneDictionary:
    """Make floor, ceiling, walls and what the window shows."""
    wide, deep = _RIGHT - _LEFT, _BACK - _FRONT
    left, right, sill, lintel = _WINDOW
    x, y, z = np.diag([wide, deep, _CEILING])
    corner = np.array([_LEFT, _FRONT, 0.0])
    whole = (0.0, 0.0, 2.0, 1.0)
    around = [(_LEFT, 0.0, left, _CEILING), (right, 0.0, _RIGHT, _CEILING)]
    around += [(left, 0.0, right, sill), (left, lintel, right, _CEILING)]
    walls = [
        *(
            quad([x0, _BACK, z0], [x1 - x0, 0, 0], [0, 0, z1 - z0], (x0 / 3, -z1 / 3, x1 / 3, -z0 / 3))
            for x0, z0, x1, z1 in around
        ),
        quad(corner + x, -x, z, whole),
        quad(corner, y, z, whole),
        quad(corner + x + y, -y, z, whole),
    ]
    frame = [
        box([x0, _BACK - 0.04, z0], [x1, _BACK + 0.04, z1])
        for x0, z0, x1, z1 in (
            *((at - 0.03, sill, at + 0.03, lintel) for at in (left, (left + right) / 2, right)),
            *((left, at - 0.03, right, at + 0.03) for at in (sill, sill + 0.9, lintel)),
        )
    ]
    return {
        "floor": shape(quad(corner, x, y, (0, 0, 4, 4)), noise(41, 0.14, 0.28)),
        "ceiling": shape(quad(corner + z, x, y), grid(42, 10, 10, (25, 25), joint=0.5, low=0.75, high=0.85)),
        "walls": shape(merged(walls), noise(43, 0.6, 0.8)),
        "frame": shape(merged(frame), 0.7),
        "street": shape(
            quad([-11.0, 15.0, -6.0], [38.0, 0, 0], [0, 0, 19.0], (0, 0, 2, 1)), facade(44, floors=5, bays=6)
        ),
    }


def _on_the_walls() -> SceneDictionary:
    """Make whiteboard, pictures, sheets of paper, a door and a cabinet."""
    boards = [quad([-1.0, _BACK - 0.02, 1.45], [1.6, 0, 0], [0, 0, 0.9])]
    sheets = [quad([_LEFT + 0.02, -1.6 + 0.75 * k, 1.2 + 0.1 * (k % 2)], [0, 0.5, 0], [0, 0, 0.7]) for k in range(3)]
    papers = [quad([_RIGHT - 0.02, 1.9 - 0.6 * k, 1.2 - 0.15 * (k % 3)], [0, -0.42, 0], [0, 0, 0.6]) for k in range(5)]
    pictures = [
        quad([_LEFT + 0.02, 0.6, 1.1], [0, 1.4, 0], [0, 0, 1.0], (0, 0, 1, 0.7)),
        quad([-2.6, _BACK - 0.02, 2.15], [1.2, 0, 0], [0, 0, 0.7], (0.3, 0.2, 0.9, 0.55)),
        quad([-1.0, _FRONT + 0.02, 1.0], [-1.6, 0, 0], [0, 0, 1.2], (0.1, 0.1, 0.9, 0.7)),
    ]
    return {
        "whiteboard": shape(merged(boards), writing(51, lines=14, columns=60, paper=0.85, ink=0.4, cell=(5, 3))),
        "sheets": shape(merged([*sheets, *papers]), writing(52, lines=18, columns=24, paper=0.8, ink=0.3, cell=(4, 3))),
        "pictures": shape(
            merged(pictures),
            patchwork(256, 53, low=0.12, high=0.7, grain=0.5, shapes=90, tint=(1.0, 0.9, 0.8)),
        ),
        "woodwork": shape(
            merged(
                [box([_RIGHT - 0.5, -2.6, 0], [_RIGHT, -0.8, 1.1]), box([0.6, _FRONT, 0], [1.6, _FRONT + 0.04, 2.1])]
            ),
            wood(54),
        ),
    }


def _desk() -> SceneDictionary:
    """Make the desk and what stands on it."""
    top = _DESK_Z
    legs = [box([x - 0.03, y - 0.03, 0], [x + 0.03, y + 0.03, top]) for x in (-1.05, 1.05) for y in (2.25, 2.9)]
    plate = box([-1.15, 2.2, top - 0.04], [1.15, 2.95, top], period_m=0.8)
    monitors = [_monitor(k).moved([x, 2.7, top], turn) for k, (x, turn) in enumerate([(-0.34, 0.2), (0.3, -0.2)])]
    cases = [_case().moved([x, 2.7, top], turn) for x, turn in [(-0.34, 0.2), (0.3, -0.2)]]
    mugs = [tube([x, y, top], [x, y, top + 0.1], (0.04, 0.043)) for x, y in [(-0.75, 2.45), (0.62, 2.36)]]
    lamp = [
        tube([0.95, 2.7, top], [0.95, 2.75, top + 0.45], (0.012, 0.012), sides=5),
        tube([0.95, 2.75, top + 0.45], [0.75, 2.6, top + 0.62], (0.012, 0.012), sides=5),
        tube([0.75, 2.6, top + 0.64], [0.7, 2.55, top + 0.5], (0.03, 0.09)),
    ]
    piles = [
        box(
            [-1.05, 2.5, top + 0.04 * k],
            [-0.78 - 0.02 * (k % 2), 2.85, top + 0.04 * (k + 1)],
            window=(k / 9, 0.4, 0.3 + k / 9, 0.6),
        )
        for k in range(5)
    ]
    papers = [
        quad(np.array([x, y, top + 0.002 + 0.001 * k]), [0.2, 0.04 * turn, 0], [-0.06 * turn, 0.28, 0])
        for k, (x, y, turn) in enumerate([(-0.62, 2.24, 1), (0.42, 2.24, -1), (0.72, 2.4, 2), (-0.9, 2.22, -1)])
    ]
    keyboard = box([-0.26, 2.28, top], [0.2, 2.43, top + 0.02])
    return {
        "desk": shape(merged([*legs, plate]), wood(61, 0.35, 0.55)),
        "screens": shape(merged(monitors), writing(62, lines=48, columns=64, paper=0.14, ink=0.38, cell=(2, 2))),
        "cases": shape(merged([*cases, *lamp, box([0.28, 2.3, top], [0.34, 2.4, top + 0.03])]), 0.16),
        "mugs": shape(merged(mugs), grid(63, 4, 4, (4, 4), joint=0.7, low=0.3, high=0.8)),
        "piles": shape(merged(piles), books(64)),
        "papers": shape(merged(papers), writing(65, lines=22, columns=20, paper=0.85, ink=0.35, cell=(3, 2))),
        "keyboard": shape(keyboard, grid(66, 5, 16, (6, 6), joint=0.08, low=0.12, high=0.3)),
    }


def _monitor(number: int) -> Mesh:
    left = 0.5 * number
    return quad([-0.27, -0.031, 0.13], [0.54, 0, 0], [0, 0, 0.31], (left, 0.0, left + 0.5, 0.6))


def _case() -> Mesh:
    """Make frame and foot of a monitor."""
    return merged(
        [
            box([-0.29, -0.03, 0.11], [0.29, 0.03, 0.46]),
            box([-0.03, 0.0, 0.0], [0.03, 0.05, 0.15]),
            box([-0.12, -0.08, 0.0], [0.12, 0.08, 0.015]),
        ]
    )


def _shelf() -> SceneDictionary:
    """Make five rows of books to the left of the desk."""
    low, high, front, back = -2.75, -1.35, 2.66, _BACK
    levels = np.linspace(0.08, 1.98, 6)
    boards = [box([low, front, z - 0.03], [high, back, z]) for z in levels]
    sides = [box([x - 0.03, front, 0], [x, back, levels[-1]]) for x in (low, high + 0.03)]
    rows = [
        quad([low, front + 0.03 + 0.02 * (k % 2), z], [high - low, 0, 0], [0, 0, 0.33], (0.37 * k, 0, 0.37 * k + 1, 1))
        for k, z in enumerate(levels[:-1])
    ]
    return {
        "shelf": shape(merged([*boards, *sides]), wood(71)),
        "books": shape(merged(rows), books(72, width=384, height=88)),
    }
