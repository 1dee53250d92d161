"""Looks at a sequence to foresee effects: a few pixels all the time, all pixels now and then."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from ...events.luma import LumaFrames
from ...events.matching import compare_events
from ...geometry.trajectory.views import Views
from ...render.base import Renderer
from ...sampling.keyframes import Stretch
from ...sampling.rules import MaxDisplacement
from .luma_sample import IntArray, LumaSample, LumaSegment

PATCH_PX = 2
"""Pixels are taken in squares of this side: those of a blur have most of their neighbours in common, and those of many
small squares see more of the scene than as many pixels of a few large ones."""

MOST_PATCHES, FEWEST_PATCHES = 256, 64
SENSOR_SHARE = 1 / 8
"""A small sensor's share that is looked at; of a large one :data:`MOST_PATCHES` do."""

MOST_KEYFRAMES, PARTS = 4096, 8
"""A sequence of more than ``MOST_KEYFRAMES`` keyframes is sampled in ``PARTS`` parts, spread evenly over its motion."""

WHOLE_FRAMES, WINDOWS = 16, 4
"""All pixels are rendered at ``WHOLE_FRAMES`` consecutive keyframes in each of ``WINDOWS`` windows."""

SAMPLING_KEYFRAMES = 512
"""The error of sampling in time is estimated from this many keyframes."""

_SAMPLES_A_CALL = 1 << 16
_SHORTEST_WINDOW_US, _LONGEST_WINDOW_US = 200, 10_000


class SequenceSample:
    """Samples a sequence cheaply.

    Keyframes lie a third of a pixel apart by the displacement clock. Most effects act in single pixels but over all
    time (levels that drift, drift further), so small squares, spread evenly, are seen at all keyframes: ``pixels``. A
    lens acts on neighbours but on each instant alone, so all pixels are seen in a few windows: ``frames``.

    Args:
        stretch: the whole sequence.
        contrast_threshold_off: C_off; C_on is the stretch's.
        start_phase: of the engine.
        seed: of the places of the squares, and of the engine.
    """

    def __init__(
        self,
        stretch: Stretch,
        *,
        contrast_threshold: float,
        contrast_threshold_off: float,
        start_phase: str = "zero",
        seed: int,
    ) -> None:
        self.stretch = stretch
        self.renderer = stretch.renderer
        self.camera = stretch.renderer.camera
        self.duration_us = stretch.end_us - stretch.start_us
        planned = MaxDisplacement().instants(
            stretch.renderer, stretch.trajectory, self.duration_us, start_us=stretch.start_us
        )
        self.t_us = np.unique(np.array([0, *planned, self.duration_us], np.int64))
        self.path_px = (len(self.t_us) - 2) * MaxDisplacement().pixels
        self.seed = seed
        self._engine = (contrast_threshold, contrast_threshold_off, stretch.log_eps, start_phase, seed)
        self.pixel = _scattered(self.camera.width, self.camera.height, seed)

    @cached_property
    def pixels(self) -> LumaSample:
        """Return a few pixels over the whole time; of a long sequence in some parts."""
        return self.sample(self.pixel, self.renderer)

    @cached_property
    def held_out(self) -> IntArray:
        """Return pixels other than those of :attr:`pixels`, to test what was found on these; none of a tiny sensor."""
        return np.setdiff1d(_scattered(self.camera.width, self.camera.height, self.seed + 1), self.pixel)

    def sample(self, pixel: IntArray, renderer: Renderer) -> LumaSample:
        """Return pixels y W + x over the whole time, as a renderer sees them; of a long sequence in some parts."""
        chosen = [self.t_us]
        if len(self.t_us) > MOST_KEYFRAMES:
            chosen = _spread(self.t_us, PARTS, MOST_KEYFRAMES // PARTS)
        return self._sample_at(chosen, pixel, renderer)

    def sampling_error_us(self, window_us: int) -> float:
        """Return the median error of the times of events by the sampling in time, at least the 1 us of stamps.

        Found by rendering instants between the keyframes as well. Lines between keyframes err by the square of their
        distance, so the difference is three quarters of the error.
        """
        chosen = _spread(self.t_us, PARTS, SAMPLING_KEYFRAMES // PARTS)
        finer = [np.unique(np.concatenate([t_us, (t_us[1:] + t_us[:-1]) // 2])) for t_us in chosen]
        coarse, fine = (self._sample_at(parts, self.pixel, self.renderer) for parts in (chosen, finer))
        comparison = compare_events(coarse.ideal, fine.ideal, size=coarse.size, window_us=window_us)
        return max(4 / 3 * comparison.median_us, 1.0) if comparison.matched else 1.0

    def _sample_at(self, chosen: list[IntArray], pixel: IntArray, renderer: Renderer) -> LumaSample:
        segments = [LumaSegment(t_us, self._samples(t_us, pixel, renderer)) for t_us in chosen]
        origin = self._samples(self.t_us[:1], pixel, renderer)
        return LumaSample(origin, segments, *self._engine, len(pixel) / self._size)

    @cached_property
    def frames(self) -> LumaSample:
        """Return all pixels in a few windows."""
        chosen = _spread(self.t_us, WINDOWS, WHOLE_FRAMES)
        segments = [LumaSegment(t_us, self.luma(t_us)) for t_us in chosen]
        return LumaSample(self.luma(self.t_us[:1]), segments, *self._engine, 1.0)

    def luma(self, t_us: IntArray) -> LumaFrames:
        """Return whole frames (k, H, W)."""
        batch = self.stretch.batch
        batches = [self.renderer.luma(self._views(t_us[i : i + batch])) for i in range(0, len(t_us), batch)]
        return np.concatenate(batches)

    @property
    def window_us(self) -> int:
        """Return how far apart events of the same crossing may be: the average time of one pixel of motion.

        At least 0.2 ms, so that common delays can be seen, and 10 ms where nothing moves.
        """
        pixel_us = self.duration_us / self.path_px if self.path_px > 0 else math.inf
        return math.ceil(np.clip(pixel_us, _SHORTEST_WINDOW_US, _LONGEST_WINDOW_US))

    @property
    def _size(self) -> int:
        return self.camera.width * self.camera.height

    def _views(self, t_us: IntArray) -> Views:
        return self.stretch.views(self.stretch.start_us + t_us)

    def _samples(self, t_us: IntArray, pixel: IntArray, renderer: Renderer) -> LumaFrames:
        """Return single pixels as frames (k, 1, n)."""
        count, batch = len(pixel), max(1, _SAMPLES_A_CALL // len(pixel))
        batches = []
        for i in range(0, len(t_us), batch):
            views = self._views(t_us[i : i + batch])
            view = np.repeat(np.arange(len(views)), count)
            batches.append(renderer.samples(views, view, np.tile(pixel, len(views))).reshape(-1, 1, count))
        return np.concatenate(batches)


def _spread(t_us: IntArray, runs: int, length: int) -> list[IntArray]:
    """Return ``runs`` parts of ``length`` consecutive instants, spread evenly; one if there are too few instants."""
    if len(t_us) <= runs * length:
        return [t_us]
    starts = np.linspace(0, len(t_us) - length, runs).astype(int)
    return [t_us[start : start + length] for start in starts.tolist()]


def _scattered(width: int, height: int, seed: int) -> IntArray:
    """Return pixels y W + x of squares, one at random in each cell of a grid."""
    across, down = min(PATCH_PX, width), min(PATCH_PX, height)
    wanted = float(np.clip(SENSOR_SHARE * width * height / (across * down), FEWEST_PATCHES, MOST_PATCHES))
    columns = int(np.clip(round(math.sqrt(wanted * width / height)), 1, width // across))
    rows = int(np.clip(round(wanted / columns), 1, height // down))
    random = np.random.Generator(np.random.Philox(seed))
    pixels = []
    for row in range(rows):
        for column in range(columns):
            left, right = column * width // columns, (column + 1) * width // columns
            top, bottom = row * height // rows, (row + 1) * height // rows
            x = random.integers(left, right - across, endpoint=True) + np.arange(across)
            y = random.integers(top, bottom - down, endpoint=True) + np.arange(down)
            pixels.append((y[:, None] * width + x).ravel())
    return np.concatenate(pixels)
