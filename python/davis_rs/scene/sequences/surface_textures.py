"""Draws textures of rooms and streets: carpet, wood, writing, books, keys, facades, paving, leaves.

They come from frozen random numbers. All repeat.
"""

from __future__ import annotations

import numpy as np

from ..textures import Texture, value_noise
from .reflectance import GREY, Tint, between, finished


def noise(seed: int, low: float, high: float, *, size: int = 256, tint: Tint = GREY) -> Texture:
    """Draw plaster, carpet, asphalt, grass: coarse and fine grain between two reflectances, even in log
    reflectance."""
    return finished(between(low, high, value_noise(size, np.random.RandomState(seed))), tint)


def wood(seed: int, low: float = 0.2, high: float = 0.55) -> Texture:
    """Draw grain along the rows."""
    grain = value_noise(256, np.random.RandomState(seed))
    return finished(low + (high - low) * grain[:, np.arange(256) // 8], (1.0, 0.8, 0.6))


def writing(
    seed: int, *, lines: int, columns: int, paper: float, ink: float, cell: tuple[int, int] = (4, 3)
) -> Texture:
    """Draw lines of words of one to nine letters, ragged to the right, here and there an empty line.

    Args:
        cell: texels of a line and of a letter.
    """
    random = np.random.RandomState(seed)
    marks = np.zeros((lines, columns))
    for line in marks[1:-1]:
        position, end = 1 + int(random.randint(3)), int(columns * random.uniform(0.4, 1.0)) - 1
        while position < end and random.random_sample() < 0.97:
            word = int(random.randint(1, 10))
            line[position : min(position + word, end)] = 1
            position += word + 1
    marks[random.random_sample(lines) < 0.12] = 0
    marks *= random.uniform(0.5, 1.0, marks.shape)
    rows = np.zeros((lines, cell[0], columns, cell[1]))
    rows[:, : max(cell[0] // 2, 1)] = marks[:, None, :, None]
    return finished(paper + (ink - paper) * rows.reshape(lines * cell[0], columns * cell[1]))


def books(seed: int, *, width: int = 256, height: int = 64) -> Texture:
    """Draw a shelf full of spines: of their own widths, heights and brightness, with a band or two; dark
    above them."""
    random = np.random.RandomState(seed)
    shelf = np.full((height, width), 0.1)
    position = 0
    while position < width:
        end = position + int(random.randint(5, 14))
        top = int(random.randint(2, height // 3))
        brightness = 0.14 * 3.5 ** random.random_sample()
        shelf[top:, position + 1 : end] = brightness
        for _ in range(int(random.randint(0, 3))):
            band = int(random.randint(top, height - 4))
            shelf[band : band + int(random.randint(2, 8)), position + 1 : end] = 0.14 * 3.5 ** random.random_sample()
        position = end
    return finished(shelf)


def grid(
    seed: int, rows: int, columns: int, cell: tuple[int, int], *, joint: float, low: float, high: float
) -> Texture:
    """Draw keys, tiles, slabs, bricks: cells (texels high and wide) of their own brightness, a joint of a texel
    between."""
    random = np.random.RandomState(seed)
    cells = np.repeat(np.repeat(random.uniform(low, high, (rows, columns)), cell[0], 0), cell[1], 1)
    cells[:: cell[0]] = joint
    cells[:, :: cell[1]] = joint
    return finished(cells)


def facade(seed: int, *, floors: int, bays: int, texels: int = 256) -> Texture:
    """Draw the front of a house: rows of windows with frames, glazing bars and sills on a wall of courses, doors
    below."""
    random = np.random.RandomState(seed)
    wall = random.uniform(0.2, 0.55)
    front = wall * (0.75 + 0.5 * value_noise(texels, random))
    front[:: texels // 32] *= random.uniform(0.7, 0.95)  # courses
    height, width = texels // floors, texels // bays
    wide, high = int(width * random.uniform(0.4, 0.65)), int(height * random.uniform(0.5, 0.65))
    frame, frame_texels = 0.12 if random.random_sample() < 0.5 else 0.7, max(2, texels // 128)
    for floor in range(floors):
        front[floor * height : floor * height + frame_texels] = wall * random.uniform(0.5, 1.4)  # cornice
        for bay in range(bays):
            left = bay * width + (width - wide) // 2
            top = floor * height + (height - high) // 2
            door = floor == floors - 1 and random.random_sample() < 0.3
            bottom = (floor + 1) * height if door else top + high
            front[top - frame_texels : bottom, left - frame_texels : left + wide + frame_texels] = frame
            front[top:bottom, left : left + wide] = random.uniform(0.1, 0.4) if door else random.uniform(0.06, 0.16)
            if not door:
                front[top : top + int(random.uniform(0, 0.6) * high), left : left + wide] = random.uniform(0.1, 0.7)
                front[top:bottom, left + wide // 2 : left + wide // 2 + frame_texels - 1] = frame  # glazing bars
                front[top + high // 2 : top + high // 2 + frame_texels - 1, left : left + wide] = frame
                front[bottom : bottom + frame_texels, left - frame_texels : left + wide + frame_texels] = 0.6  # sill
    return finished(front)


def leaves(seed: int, *, size: int = 256, count: int = 1500) -> Texture:
    """Draw a crown or a hedge from outside: lit and unlit leaves, and dark gaps between them."""
    random = np.random.RandomState(seed)
    level = 0.25 * value_noise(size, random)
    y, x = np.mgrid[-9:10, -9:10]
    for _ in range(count):
        row, column, brightness = random.randint(size), random.randint(size), random.random_sample()
        radius, slant = random.uniform(4.0, 8.0), random.uniform(-1.0, 1.0)
        rows, columns = np.nonzero((x + slant * y) ** 2 + 2 * (y - slant * x) ** 2 < radius * radius)
        level[(row + rows - 9) % size, (column + columns - 9) % size] = brightness
    return finished(0.05 * 6**level, (0.8, 1.1, 0.5))
