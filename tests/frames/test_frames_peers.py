"""Peers: the rule of rpg_vid2e's esim_py, written down from its published description and source, and compared."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
import pytest

from clips import moving_texture
from davis_rs import EVENT_DTYPE, compare_events, events_from_frames
from davis_rs.events.arrays import EventArray, concatenate_events

C, LOG_EPS = 0.2, 1e-3


def esim_py(frames: npt.NDArray[np.float32], times_s: list[float], c: float) -> EventArray:
    """Its rule, pixel by pixel, in its types: log intensity, reference and levels in float32, times in float64.

    The reference starts at the first frame. A pixel that changes by more than 1e-6 gets an event at each level, one C
    further in the change's direction from the reference, that lies beyond the last frame's value and not beyond the new
    one's; the time is interpolated linearly, and the reference moves to the level.
    """
    log = np.log(frames + np.float32(LOG_EPS))
    found: list[tuple[int, int, int, int]] = []
    for y, x in np.ndindex(log.shape[1:]):
        reference = log[0, y, x]
        for k, (a, b) in enumerate(itertools.pairwise(log[:, y, x])):
            if abs(b - a) <= 1e-6:
                continue
            sign = np.float32(1 if b >= a else -1)
            while True:
                level = np.float32(reference + sign * np.float32(c))
                if not (a < level <= b if sign > 0 else b <= level < a):
                    break
                t = times_s[k] + float(level - a) * (times_s[k + 1] - times_s[k]) / float(b - a)
                found.append((int(np.ceil(t * 1e6 - 1e-6)), x, y, int(sign > 0)))
                reference = level
    return np.array(sorted(found, key=lambda e: (e[0], e[2], e[1])), EVENT_DTYPE)


@pytest.fixture(scope="module")
def both() -> tuple[EventArray, EventArray]:
    frames, times_us = moving_texture(12, 1.3, 40, 30), [k * 10_000 + 37 * k * k for k in range(12)]
    packets = events_from_frames(frames, times_us, interpolation="linear", contrast_threshold=C, log_eps=LOG_EPS)
    ours = concatenate_events([packet.events for packet in packets])
    return ours, esim_py(frames, [t / 1e6 for t in times_us], C)


def test_counts_are_esim_pys_but_for_its_float32(both: tuple[EventArray, EventArray]) -> None:
    ours, theirs = both
    assert len(theirs) > 5000
    assert abs(len(ours) - len(theirs)) <= 1e-3 * len(theirs)
    found = compare_events(ours, theirs, size=(40, 30), window_us=2000)
    assert found.missing_percent + found.spurious_percent < 0.1


def test_stamps_are_esim_pys_but_for_its_float32(both: tuple[EventArray, EventArray]) -> None:
    """Its levels are rounded to float32, some 1e-7 of log intensity: the slower the change, the more microseconds."""
    ours, theirs = both
    errors = np.abs(compare_events(ours, theirs, size=(40, 30), window_us=2000).time_error_us)
    assert np.median(errors) <= 1
    assert (errors <= 1).mean() > 0.98


def test_where_the_rules_differ() -> None:
    """A step below esim_py's tolerance that crosses a level is lost to it: its next comparison begins beyond the level,
    and the pixel is silent from then on. Here the event comes."""
    levels = np.log(0.5 + LOG_EPS) + np.array([0, 0.2 - 4e-7, 0.2 + 4e-7, 0.5, 0.9])
    frames = np.broadcast_to((np.exp(levels) - LOG_EPS)[:, None, None], (5, 1, 1)).astype(np.float32)
    times = [0, 10_000, 20_000, 30_000, 40_000]
    packets = events_from_frames(frames, times, interpolation="linear", contrast_threshold=C, log_eps=LOG_EPS)
    ours = concatenate_events([packet.events for packet in packets])
    assert len(ours) == 4
    assert len(esim_py(frames, [t / 1e6 for t in times], C)) < 4
