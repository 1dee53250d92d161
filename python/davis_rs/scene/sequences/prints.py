"""Draws what is printed on walls, posters and boxes: plain shapes, stones, lines of text.

Made of frozen random numbers. A texture has no finer copies of itself for far views, so each has its smallest detail a
few texels wide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

from ...geometry.pose import FloatArray
from ..textures import Texture, value_noise
from .reflectance import between, finished


def stones(height: int, width: int, seed: int, *, low: float, high: float, stone: float) -> Texture:
    """Draw a rock face, (height, width, 3): stones of different brightness with dark joints, grained and stained.

    Args:
        height, width: texels.
        low, high: range of reflectance.
        stone: about a stone's size, texels.
    """
    from scipy.spatial import cKDTree

    random = np.random.RandomState(seed)
    size = 1 << int(np.ceil(np.log2(max(height, width))))
    bend_x, bend_y, grain = (value_noise(size, random)[:height, :width] for _ in range(3))
    # Each texel belongs to the nearest of scattered points; bent, so that no joint is a straight line.
    count = round(height * width / stone**2)
    points = random.random_sample((count, 2)) * (height, width)
    rows, columns = np.mgrid[:height, :width]
    bent = np.stack([rows + size / 8 * bend_y, columns + size / 8 * bend_x], -1) % (height, width)
    (nearest, second), owner = _two_nearest(cKDTree(points, boxsize=(height, width)), bent)
    joint = np.clip((second - nearest) / (0.25 * stone), 0, 1)
    level = joint * (0.35 + 0.4 * random.random_sample(count)[owner] + 0.5 * (grain - 0.5))
    return finished(between(low, high, level))


def blocks(size: int, seed: int, *, low: float, high: float, count: int) -> Texture:
    """Draw overlapping upright rectangles, (size, size, 3), a tenth to half as wide and high as all, from low to
    high."""
    random = np.random.RandomState(seed)
    level = np.full((size, size), 0.5)
    for _ in range(count):
        height, width = np.round(size * random.uniform(0.1, 0.5, 2)).astype(int)
        top, left = random.randint(size - height), random.randint(size - width)
        level[top : top + height, left : left + width] = random.random_sample()
    return finished(between(low, high, level))


def text(size: int, seed: int, *, line: int, ink: float, paper: float) -> Texture:
    """Draw a page, (size, size, 3): lines of words whose letters are bars; every sixth line or so is a heading.

    Args:
        size: texels a side.
        line: texels from line to line; a letter's strokes are a sixth of it wide, two texels at least.
        ink, paper: reflectances.
    """
    random = np.random.RandomState(seed)
    cover = np.zeros((size, size))
    top, margin = line // 2, line
    while top + 2 * line < size:
        scale = 2 if random.random_sample() < 0.17 else 1
        stroke = scale * max(line // 6, 2)
        strokes = (size - 2 * margin) // stroke
        # Words of a few strokes with gaps between; in a word every other stroke is ink, now and then two run together.
        inked = (np.arange(strokes) % 2 == 0) | (random.random_sample(strokes) < 0.25)
        inked &= np.repeat(random.random_sample(strokes // 3 + 1) < 0.8, 3)[:strokes]
        inked &= np.arange(strokes) < strokes * (0.6 + 0.4 * random.random_sample())
        height = scale * line // 2
        cover[top : top + height, margin : margin + strokes * stroke] = np.repeat(inked, stroke)
        top += scale * line
    return finished(paper + (ink - paper) * cover)


def plain_shapes(
    height: int,
    width: int,
    seed: int,
    *,
    cell: int,
    radius: tuple[float, float],
    fraction: float,
    ink: float,
    paper: float,
) -> Texture:
    """Draw discs, triangles, squares, hexagons and stars on plain paper, (height, width, 3); none touches another.

    Args:
        height, width: texels.
        cell: side in texels of the squares that hold at most one shape each.
        radius: smallest and largest, texels; at most a third of ``cell``.
        fraction: of the squares that have a shape.
        ink, paper: reflectances.
    """
    random = np.random.RandomState(seed)
    cover = np.zeros((height, width))
    y, x = np.mgrid[:cell, :cell] + 0.5
    for top in range(0, height - cell + 1, cell):
        for left in range(0, width - cell + 1, cell):
            here, scale, at_x, at_y, angle, kind = random.random_sample(6)
            if here > fraction:
                continue
            r = radius[0] * (radius[1] / radius[0]) ** scale
            free = cell / 2 - r - 1
            dx, dy = x - cell / 2 - free * (2 * at_x - 1), y - cell / 2 - free * (2 * at_y - 1)
            # A texel that an edge crosses is partly inked.
            inked = np.clip(
                0.5 - _outside(("disc", "triangle", "square", "hexagon", "star")[int(5 * kind)], dx, dy, r, angle), 0, 1
            )
            cover[top : top + cell, left : left + cell] = inked
    return finished(paper + (ink - paper) * cover)


def _outside(kind: str, dx: FloatArray, dy: FloatArray, radius: float, angle: float) -> FloatArray:
    """Return the signed distance of points from a shape in texels, negative inside."""
    if kind == "disc":
        return np.asarray(np.sqrt(dx * dx + dy * dy) - radius)
    # The sides of a polygon, or of a star through the corners of a pentagon: how far past each.
    sides = {"triangle": 3, "square": 4, "hexagon": 6, "star": 5}[kind]
    inner = radius * np.cos(2 * np.pi / 5 if kind == "star" else np.pi / sides)
    turns = 2 * np.pi * (np.arange(sides) + angle)[:, None, None] / sides
    # Six digits: the last of a sine is not the same on every machine.
    past = np.sort(np.round(np.cos(turns), 6) * dx + np.round(np.sin(turns), 6) * dy - inner, axis=0)
    # A point of a star is past one side, and one only.
    return np.asarray(past[-2] if kind == "star" else past[-1])


def _two_nearest(tree: cKDTree, positions: FloatArray) -> tuple[tuple[FloatArray, FloatArray], npt.NDArray[np.int_]]:
    distances, owners = tree.query(positions, k=2)
    return (distances[..., 0], distances[..., 1]), owners[..., 0]
