"""Makes the scenes ``outdoors`` and ``urban``: a path between gardens and a street, and the fronts of a city street."""

from __future__ import annotations

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.camera import PRESETS
from ..meshes import Mesh, box, merged, quad, shape
from ..parts import DIRECT, start_looking_at
from ..scene import Scene
from .street_parts import car, front_window, fronts, house, lamp_post, row_of_houses, trees
from .surface_textures import grid, leaves, noise, writing

_REACH = (-60.0, 400.0)
"""The extent along y in metres; the camera starts at 0."""

_SUNLIGHT = {
    "sun": {"type": "directional", "direction": [0.62, 0.42, -0.66], "irradiance": 2.6},
    "sky": {"type": "constant", "radiance": 0.3},
}
_LUX_PER_LUMA = 80_000.0
"""White on the ground has a luma of 0.85 in the sun, some 68,000 lx, and of 0.3 in the shade."""


def outdoors() -> Scene:
    """Make a sunny path between trees, a street to its right and gardens to its left, 400 m ahead; C = 0.4.

    For a camera carried straight ahead, 300 m at most, by a person who walks or runs: slabs and grass, trees whose
    shadows lie on the path, hedges, houses on both sides, lamps, parked cars, and a skyline at the end. A synthetic
    counterpart of the dataset's outdoor sequences by kind of things and light, not a copy: nobody else is about, the
    sky has no clouds, and the person who carries the camera casts no shadow.
    """
    return Scene(
        name="outdoors",
        source=_outdoors,
        camera=PRESETS["davis240c"],
        start=start_looking_at([0.0, 0.0, 1.6], [0.0, 10.0, 1.5]),
        contrast_threshold=0.4,
        lux_per_luma=_LUX_PER_LUMA,
    )


def urban() -> Scene:
    """Make five-storey fronts, shops and parked cars on both sides of a city street, from its pavement; C = 0.4.

    For a camera held by hand that looks across and along the street. A synthetic counterpart of the dataset's by kind
    of things and light, not a copy: nobody walks or drives, and fronts are flat but for their balconies and signs.
    """
    return Scene(
        name="urban",
        source=_urban,
        camera=PRESETS["davis240c"],
        start=start_looking_at([-4.6, 0.0, 1.7], [6.0, 9.0, 3.4]),
        contrast_threshold=0.4,
        lux_per_luma=_LUX_PER_LUMA,
    )


def _strip(left: float, right: float, z: float, period: float) -> Mesh:
    """Make a strip of ground along the street."""
    start, end = _REACH
    repeats = ((right - left) / period, (end - start) / period)
    return quad([left, start, z], [right - left, 0, 0], [0, end - start, 0], (0, 0, *repeats))


def _skyline(seed: int) -> list[Mesh]:
    """Make high blocks at both ends and far to the sides."""
    random = np.random.RandomState(seed)
    blocks = []
    for x0, y0, x1, y1 in [(-90, 405, 90, 440), (-90, -100, 90, -65), (-95, -80, -80, 420), (80, -80, 95, 420)]:
        for _ in range(14):
            wide, deep, height = random.uniform(14, 30), 12.0, random.uniform(10, 38)
            walls, _ = house(wide, deep, height, 1.0, front_window(int(random.randint(8))))
            base = [random.uniform(x0, x1), random.uniform(y0, y1), 0.0]
            blocks.append(walls.moved(base, np.pi / 2 if x1 - x0 < 50 else 0.0))
    return blocks


def _outdoors() -> SceneDictionary:
    rows = [
        *row_of_houses(101, -11.0, _REACH, height=(5, 8), width=(9, 14), gap=(1, 4)),
        *row_of_houses(102, 16.0, _REACH, height=(5, 9), width=(9, 14), gap=(0, 3)),
    ]
    trunks, crowns = zip(
        *(trees(seed, x, _REACH, apart) for seed, x, apart in [(103, -2.7, 11.0), (104, 2.7, 13.0), (105, 13.5, 24.0)]),
        strict=True,
    )
    random = np.random.RandomState(106)
    hedges = [
        box([-5.2, y, 0], [-4.3, y + random.uniform(5, 10), random.uniform(0.9, 1.5)], period_m=1.5)
        for y in np.arange(*_REACH, 10.0)
    ]
    cars = list(zip(*(_parked(random, 6.0, y) for y in np.arange(*_REACH, 16.0)), strict=True))
    lamps = [lamp_post().moved([1.9, y, 0]) for y in np.arange(*_REACH, 28.0)]
    return {
        "type": "scene",
        "integrator": DIRECT,
        **_SUNLIGHT,
        "lawn": shape(
            quad([-300, -300, 0], [600, 0, 0], [0, 1000, 0], (0, 0, 100, 167)),
            noise(111, 0.1, 0.35, tint=(0.8, 1.1, 0.5)),
        ),
        "path": shape(_strip(-1.6, 1.6, 0.02, 4.0), grid(112, 8, 8, (12, 12), joint=0.2, low=0.3, high=0.5)),
        "road": shape(_strip(4.9, 11.5, 0.02, 5.0), noise(113, 0.1, 0.25)),
        "walls": shape(merged([*(walls for walls, _ in rows), *_skyline(114)]), fronts(115, (2, 3), (3, 4))),
        "roofs": shape(merged(roof for _, roof in rows), grid(116, 12, 12, (8, 8), joint=0.06, low=0.12, high=0.3)),
        "trunks": shape(merged(trunks), noise(117, 0.06, 0.4, size=64)),
        "leaves": shape(merged([*crowns, *hedges]), leaves(118)),
        "cars": shape(merged(cars[0]), grid(119, 4, 4, (16, 16), joint=0.4, low=0.3, high=0.7)),
        "dark": shape(merged([*cars[1], *lamps]), 0.09),
    }


def _parked(random: np.random.RandomState, x: float, y: float) -> tuple[Mesh, Mesh]:
    body, dark = car()
    base = [x + random.uniform(-0.15, 0.15), y + random.uniform(-2.5, 2.5), 0.0]
    return body.moved(base), dark.moved(base)


def _urban() -> SceneDictionary:
    reach = (-60.0, 120.0)
    rows = [
        *row_of_houses(201, -7.0, reach, height=(14, 18), width=(11, 16), gap=(0, 0)),
        *row_of_houses(202, 9.0, reach, height=(14, 18), width=(11, 16), gap=(0, 0)),
    ]
    random = np.random.RandomState(203)
    cars = list(zip(*(_parked(random, x, y) for x in (-2.2, 4.4) for y in np.arange(*reach, 6.5)), strict=True))
    lamps = [lamp_post().moved([-3.4, y, 0]) for y in np.arange(-52, 120, 22.0)]
    balconies = [
        box([8.1, y, z], [9.0, y + 1.6, z + 1.0], window=(0.1, 0.1, 0.5, 0.3))
        for y in np.arange(*reach, 4.2)
        for z in (5.6, 8.8)
        if random.random_sample() < 0.4
    ]
    signs = [
        quad([8.95, y + 4, 3.1], [0, -4.0, 0], [0, 0, 0.7], (0, k / 7, 1, k / 7 + 0.14))
        for k, y in enumerate(np.arange(*reach, 6.0))
    ]
    trunks, crowns = trees(204, 6.4, reach, 15.0)
    return {
        "type": "scene",
        "integrator": DIRECT,
        **_SUNLIGHT,
        "ground": shape(quad([-300, -300, 0], [600, 0, 0], [0, 1000, 0], (0, 0, 75, 125)), noise(211, 0.1, 0.3)),
        "pavements": shape(
            merged([_strip(-7.0, -3.1, 0.12, 4.0), _strip(5.4, 9.0, 0.12, 4.0)]),
            grid(212, 8, 8, (12, 12), joint=0.15, low=0.3, high=0.5),
        ),
        "walls": shape(merged([*(walls for walls, _ in rows), *_skyline(213)]), fronts(214, (5, 5), (4, 5))),
        "roofs": shape(merged(roof for _, roof in rows), grid(215, 12, 12, (8, 8), joint=0.06, low=0.12, high=0.3)),
        "signs": shape(
            merged([*signs, *balconies]), writing(216, lines=8, columns=24, paper=0.15, ink=0.8, cell=(6, 6))
        ),
        "trunks": shape(trunks, noise(217, 0.06, 0.4, size=64)),
        "leaves": shape(crowns, leaves(218)),
        "cars": shape(merged(cars[0]), grid(219, 4, 4, (16, 16), joint=0.4, low=0.1, high=0.7)),
        "dark": shape(merged([*cars[1], *lamps]), 0.09),
    }
