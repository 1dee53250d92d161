"""Sparse samples: pixels that bring samples of their own between two frames, against the exact oracle."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import CrossingEngine, log_intensity
from davis_rs.events.arrays import EventArray
from reference import ExactPixel, LogFrame
from strategies import EXAMPLES, base_levels, next_sample, random_paths, steps, threshold_pairs

SparseArrays = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]

Samples = dict[int, list[tuple[int, float]]]
"""For each pixel its sparse samples (t_us, log intensity), in order."""


def arrays(sparse: Samples) -> SparseArrays:
    """As :meth:`CrossingEngine.push_log` takes them."""
    rows = [(pixel, t, value) for pixel in sorted(sparse) for t, value in sparse[pixel]]
    pixel, t_us, value = (np.array(column) for column in zip(*rows, strict=True)) if rows else ([], [], [])
    return np.asarray(pixel, np.uint32), np.asarray(t_us, np.int64), np.asarray(value, np.float64)


def oracle(
    frames: LogFrame, times_us: list[int], sparse: list[Samples], c_on: float, c_off: float
) -> list[list[tuple[int, int, int]]]:
    """(t, pixel, p) for each frame, in the order of a stream."""
    pixels = [ExactPixel(times_us[0], float(value), c_on, c_off) for value in frames[0]]
    found = []
    for frame, t_us, samples in zip(frames[1:], times_us[1:], sparse, strict=True):
        crossings = []
        for i, pixel in enumerate(pixels):
            for t, value in [*samples.get(i, []), (t_us, float(frame[i]))]:
                crossings += [(event.t_us, i, event.p) for event in pixel.advance(t, value)]
        found.append(sorted(crossings, key=lambda crossing: crossing[:2]))
    return found


def as_tuples(events: EventArray) -> list[tuple[int, int, int]]:
    return [(int(e["t"]), int(e["x"]), int(e["p"])) for e in events]


@st.composite
def sparse_sequences(draw: st.DrawFn) -> tuple[LogFrame, list[int], list[Samples], float, float]:
    """Frames (n, width) of a few pixels in a row, with sparse samples between some of them."""
    c_on, c_off = draw(threshold_pairs)
    width, count = draw(st.integers(1, 4)), draw(st.integers(2, 4))
    times_us = [0]
    for _ in range(count - 1):
        times_us.append(times_us[-1] + draw(st.integers(1, 40)))
    frames = np.empty((count, width))
    sparse: list[Samples] = [{} for _ in times_us[1:]]
    for x in range(width):
        path = [draw(base_levels)]
        frames[0, x] = path[0]
        for k, (start, end) in enumerate(pairwise(times_us)):
            for t in [*sorted(draw(st.sets(st.integers(start, end), max_size=4)) - {start, end}), end]:
                path.append(next_sample(draw(steps), path, c_on, c_off))
                if t < end:
                    sparse[k].setdefault(x, []).append((t, path[-1]))
            frames[k + 1, x] = path[-1]
    return frames, times_us, sparse, c_on, c_off


@EXAMPLES
@given(sparse_sequences())
def test_lines_between_sparse_samples_are_the_oracles(
    sequence: tuple[LogFrame, list[int], list[Samples], float, float],
) -> None:
    """Counts, polarities, order and stamps of every event, in pixels with and without samples of their own."""
    frames, times_us, sparse, c_on, c_off = sequence
    engine = CrossingEngine(frames.shape[1], 1, contrast_threshold=c_on, contrast_threshold_off=c_off, threads=1)
    engine.push_log(times_us[0], frames[:1])
    expected = oracle(frames, times_us, sparse, c_on, c_off)
    for t, frame, samples, events in zip(times_us[1:], frames[1:], sparse, expected, strict=True):
        assert as_tuples(engine.push_log(t, frame[None], sparse=arrays(samples))) == events


@pytest.mark.long
def test_sparse_samples_anywhere_on_a_large_sensor_are_the_oracles() -> None:
    """Many tiles, batches, bands and threads: first and last pixels, runs of neighbours, pixels that never fire."""
    width, height, gap_us = 160, 70, 1_000
    rng = np.random.default_rng(5)
    frames = random_paths(width * height, 4)
    times_us = [gap_us * k for k in range(4)]
    sparse: list[Samples] = []
    for k in range(3):
        chosen = {0, 1, width * height - 1, *range(2_000, 2_070), *rng.integers(0, width * height, 500).tolist()}
        ticks = {i: sorted(rng.choice(np.arange(1, gap_us), 3, replace=False).tolist()) for i in chosen}
        sparse.append({i: [(times_us[k] + t, float(rng.normal(0, 0.4))) for t in ticks[i]] for i in chosen})
    expected = oracle(frames, times_us, sparse, 0.15, 0.2)
    for threads in (1, 3):
        engine = CrossingEngine(width, height, contrast_threshold=0.15, contrast_threshold_off=0.2, threads=threads)
        engine.push_log(0, frames[0].reshape(height, width))
        for t, frame, samples, wanted in zip(times_us[1:], frames[1:], sparse, expected, strict=True):
            events = engine.push_log(t, frame.reshape(height, width), sparse=arrays(samples))
            index = events["y"].astype(int) * width + events["x"]
            assert list(zip(events["t"].tolist(), index.tolist(), events["p"].tolist(), strict=True)) == wanted


def test_luma_there_and_back_between_two_equal_frames_makes_its_events() -> None:
    """What a line crossing a pixel within one interval does: nothing in the frames, everything in between."""
    still = np.full((2, 3), 0.5, np.float32)
    engine = CrossingEngine(3, 2, contrast_threshold=0.2)
    engine.push(0, still)
    levels = [float(log_intensity(np.full((1, 1), y, np.float32), 1e-3)[0, 0]) for y in (0.5, 1.0)]
    pixel = ExactPixel(0, levels[0], 0.2, 0.2)
    wanted = [(e.t_us, 1, 1, e.p) for t, level in ((40, levels[1]), (100, levels[0])) for e in pixel.advance(t, level)]
    events = engine.push(100, still, sparse=(np.array([4]), np.array([40]), np.array([1.0])))
    assert [(e["t"], e["x"], e["y"], e["p"]) for e in events] == wanted
    assert len(wanted) == 6
    assert engine.last_event_us[1, 1] == wanted[-1][0]
    assert len(engine.push(200, still)) == 0


def test_hermite_pixels_with_sparse_samples_follow_lines_and_the_others_their_curves() -> None:
    """Rates bend a pixel's interval unless it brings samples of its own."""
    engine = CrossingEngine(2, 1, contrast_threshold=0.25, interpolation="hermite")
    line = CrossingEngine(1, 1, contrast_threshold=0.25)
    curve = CrossingEngine(1, 1, contrast_threshold=0.25, interpolation="hermite")
    first, last = np.zeros((1, 2)), np.full((1, 2), 1.0)
    flat = np.zeros((1, 2))
    engine.push_log(0, first, flat)
    line.push_log(0, first[:, :1])
    curve.push_log(0, first[:, 1:], flat[:, 1:])
    events = engine.push_log(1_000, last, flat, sparse=(np.array([0]), np.array([300]), np.array([0.6])))
    middle = line.push_log(300, np.full((1, 1), 0.6))
    straight = np.concatenate([middle, line.push_log(1_000, last[:, :1])])
    bent = curve.push_log(1_000, last[:, 1:], flat[:, 1:])
    assert events[events["x"] == 0]["t"].tolist() == straight["t"].tolist()
    assert events[events["x"] == 1]["t"].tolist() == bent["t"].tolist()
    assert straight["t"].tolist() != bent["t"].tolist()


ONE = np.array([1])


@pytest.mark.parametrize(
    ("sparse", "rule"),
    [
        ((np.array([6]), ONE * 50, ONE * 1.0), r"sparse sample 0 of pixel 6 at 50 us lies outside of the 3 x 2 sensor"),
        ((ONE, ONE * 0, ONE * 1.0), "does not lie strictly between the frames at 0 and 100 us"),
        ((ONE, ONE * 100, ONE * 1.0), "does not lie strictly between the frames at 0 and 100 us"),
        ((np.array([2, 1]), np.array([50, 60]), np.ones(2)), "sparse sample 1 of pixel 1 at 60 us does not come after"),
        ((np.array([1, 1]), np.array([50, 50]), np.ones(2)), "sorted by pixel and time"),
        ((np.array([1, 1]), np.array([60, 50]), np.ones(2)), "sorted by pixel and time"),
        ((ONE, ONE * 50, np.ones(2)), r"as many pixels as times and values, got \[1, 1, 2\]"),
        (
            (ONE, ONE * 50, ONE * np.nan),
            r"luma .* got NaN at pixel \(x, y\) = \(1, 0\).* t = 50 us",
        ),
        ((ONE, ONE * 50, ONE * -1.0), r"luma must be finite and >= 0, got -1"),
        ((-ONE, ONE * 50, ONE * 1.0), "pixels of sparse samples must fit uint32"),
        ((ONE * 0.5, ONE * 50, ONE * 1.0), "pixels of sparse samples must be a one-dimensional array of uint32"),
        ((ONE, np.array([[50]]), ONE * 1.0), "times of sparse samples must be a one-dimensional array"),
    ],
)
def test_sparse_samples_without_a_place_are_refused(sparse: SparseArrays, rule: str) -> None:
    """The error names the sample; the engine is as it was."""
    still = np.full((2, 3), 0.5, np.float32)
    engine = CrossingEngine(3, 2, contrast_threshold=0.2)
    with pytest.raises(ValueError, match="first frame can have no sparse samples"):
        engine.push(0, still, sparse=(ONE, ONE * 50, ONE * 1.0))
    engine.push(0, still)
    with pytest.raises(ValueError, match=rule):
        engine.push(100, still, sparse=sparse)
    assert len(engine.push(100, still, sparse=(ONE, ONE * 50, ONE * 0.75))) == 4


def test_samples_of_many_pixels_are_not_counted_as_those_of_one() -> None:
    """A pixel counts to 2^32 - 1. With a tiny threshold an interval may hold many events, but only this pixel's own."""
    pixels = np.arange(60 * 50)
    engine = CrossingEngine(60, 50, contrast_threshold=1e-3, threads=1)
    engine.push_log(0, np.zeros((50, 60)))
    times, values = np.full(pixels.size, 500, np.int64), np.full(pixels.size, 0.0025)
    events = engine.push_log(1000, np.zeros((50, 60)), sparse=(pixels, times, values))
    assert len(events) == 4 * pixels.size
