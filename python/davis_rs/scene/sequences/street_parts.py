"""Makes parts of streets: houses, trees, hedges, cars, lamps, each of few triangles and of the textures it needs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from ..meshes import Mesh, Window, ball, box, merged, quad, tube
from ..textures import Texture
from .surface_textures import facade

FRONTS = 8
"""How many house fronts lie side by side in one texture."""


@cache
def fronts(seed: int, floors: tuple[int, int], bays: tuple[int, int]) -> Texture:
    """Draw :data:`FRONTS` facades in a row, each of a number of floors and bays between these."""
    random = np.random.RandomState(seed)
    counts = [
        (int(random.randint(floors[0], floors[1] + 1)), int(random.randint(bays[0], bays[1] + 1)))
        for _ in range(FRONTS)
    ]
    return np.concatenate([facade(seed + k, floors=f, bays=b) for k, (f, b) in enumerate(counts)], axis=1)


def front_window(number: int) -> Window:
    """Return the window of one front of :func:`fronts`, a texel within its edges."""
    left = number % FRONTS / FRONTS
    return (left + 0.0005, 0.004, left + 1 / FRONTS - 0.0005, 0.996)


def house(width: float, depth: float, height: float, ridge: float, window: Window) -> tuple[Mesh, Mesh]:
    """Make walls and roof of a house whose front, facing -y, runs from the origin along x; all lengths in metres."""
    x, y, z = np.diag([width, depth, height])
    up = np.array([0.0, depth / 2, ridge])
    gable_window = (window[0], 0.05, window[2], 0.051)  # plain wall
    walls = [
        quad([0, 0, 0], x, z, window),
        quad(y, -y, z, window),
        quad(x, y, z, window),
        quad(x + y, -x, z, window),
        *(
            Mesh(np.stack([a, a + y, a + up]), np.array([[0, 1, 2]]), np.array(gable_window)[[[0, 1], [2, 1], [0, 3]]])
            for a in (z, x + z)
        ),
    ]
    eaves = np.array([0.0, 0.4, 0.4 * 2 * ridge / depth])
    slope = (0.0, 0.0, width / 3, float(np.linalg.norm(up)) / 3)
    roof = [
        quad(z - eaves, x, up + eaves, slope),
        quad(x + y + z - eaves * (1, -1, 1), -x, up * (1, -1, 1) + eaves * (1, -1, 1), slope),
    ]
    return merged(walls), merged(roof)


def row_of_houses(
    seed: int,
    x: float,
    reach: tuple[float, float],
    *,
    height: tuple[float, float],
    width: tuple[float, float],
    gap: tuple[float, float],
    ridge: float = 2.5,
) -> Iterator[tuple[Mesh, Mesh]]:
    """Yield houses along y on the line at x, their fronts to x = 0; numbers are drawn between pairs of ends, metres."""
    random = np.random.RandomState(seed)
    y = reach[0]
    while y < reach[1]:
        wide = random.uniform(*width)
        walls_and_roof = house(wide, 9.0, random.uniform(*height), ridge, front_window(int(random.randint(FRONTS))))
        # Seen from the street the front runs from left to right: ahead on the left side, back on the right side.
        turn = np.pi / 2 if x < 0 else -np.pi / 2
        walls, roof = (mesh.moved([x, y if x < 0 else y + wide, 0.0], turn) for mesh in walls_and_roof)
        yield walls, roof
        y += wide + random.uniform(*gap)


def trees(seed: int, x: float, reach: tuple[float, float], spacing: float) -> tuple[Mesh, Mesh]:
    """Make trunks and crowns of trees along y, about so far apart."""
    random = np.random.RandomState(seed)
    trunks, crowns = [], []
    for line in np.arange(*reach, spacing):
        y = line + random.uniform(-0.2, 0.2) * spacing
        height, root = random.uniform(3.0, 4.0), np.array([x + random.uniform(-0.2, 0.2), y, 0.0])
        top = root + np.array([*random.uniform(-0.2, 0.2, 2), height])
        trunks.append(tube(root, top, (0.17, 0.11), sides=6, window=(0, 0, 1, 3)))
        for _ in range(3):
            centre = top + random.uniform((-1.0, -1.0, 1.0), (1.0, 1.0, 2.4))
            crowns.append(ball(centre, random.uniform(1.2, 2.0, 3), rings=4, sides=6, window=(0, 0, 2, 1)))
    return merged(trunks), merged(crowns)


def car() -> tuple[Mesh, Mesh]:
    """Make body, and windows with wheels, of a car that stands along y, its middle at the origin."""
    body = [box([-0.85, -2.1, 0.3], [0.85, 2.1, 0.85]), box([-0.7, -1.3, 1.3], [0.7, 0.9, 1.38])]
    body += [box([x, y, 0.8], [x * 0.94, y + 0.08, 1.32]) for x in (-0.76, 0.76) for y in (-1.35, 0.85)]
    dark = [box([-0.72, -1.3, 0.85], [0.72, 0.9, 1.3])]
    dark += [
        merged([tube([x, y, 0.32], [x * 0.78, y, 0.32], (0.32, 0.32)), _disc(x, y)])
        for x in (-0.87, 0.87)
        for y in (-1.3, 1.3)
    ]
    return merged(body), merged(dark)


def _disc(x: float, y: float) -> Mesh:
    """Make the outside of a wheel, a flat cone."""
    return tube([x, y, 0.32], [x * 1.02, y, 0.32], (0.32, 0.0))


def lamp_post() -> Mesh:
    """Make a street lamp, 4.5 m high, its arm along x."""
    return merged(
        [
            tube([0, 0, 0], [0, 0, 4.5], (0.07, 0.05), sides=6),
            box([-0.1, -0.04, 4.4], [0.9, 0.04, 4.5]),
            box([0.5, -0.12, 4.3], [1.1, 0.12, 4.42]),
        ]
    )
