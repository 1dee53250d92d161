"""Hard cases of the crossing engine, by name; each says why it is hard."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from davis_rs import CrossingEngine, log_intensity
from davis_rs.events.arrays import EventArray
from reference import exact_events
from strategies import EPOCH_US


def test_equal_log_steps_give_equal_events_over_130_db() -> None:
    """Neighbours from 1e-6 to 1e6 in luma, all brighter by e and darker again: one event for each C, everywhere.

    log_eps far below the darkest pixel, so that it eats at most a thousandth of the step there.
    """
    luma = np.logspace(-6, 6, 13, dtype=np.float32)[None, :]
    engine = CrossingEngine(13, 1, contrast_threshold=0.0765, log_eps=1e-9)
    engine.push(0, luma)
    up = engine.push(1_000, luma * np.float32(math.e))
    down = engine.push(2_000, luma)
    for events, polarity in ((up, 1), (down, 0)):
        assert np.bincount(events["x"], minlength=13).tolist() == [13] * 13  # 13.07 thresholds
        assert set(events["p"].tolist()) == {polarity}


@pytest.mark.parametrize("luma", [0.0, -0.0, 1e-45, 1e-38, 1.0, 1e6, float(np.finfo(np.float32).max)])
def test_extreme_luma_gives_all_its_events(luma: float) -> None:
    """To and from black, -0.0, subnormals and the largest float32: an event for each threshold, and back."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.15, log_eps=1e-3)
    start, end = (np.full((1, 1), value, np.float32) for value in (1e-2, luma))
    levels = [float(log_intensity(frame, 1e-3)[0, 0]) for frame in (start, end)]
    expected = exact_events([0, 1_000, 2_000], [np.array([[v]]) for v in (*levels, levels[0])], 0.15, 0.15)
    events = [engine.push(t, frame) for t, frame in ((0, start), (1_000, end), (2_000, start))]
    np.testing.assert_array_equal(np.concatenate(events), expected)
    assert len(expected) >= 30


def test_one_microsecond_holds_any_jump() -> None:
    """0 to 1e6 within 1 us is 138 events, all on the one tick there is."""
    engine = CrossingEngine(1, 1)
    engine.push(7, np.zeros((1, 1), np.float32))
    events = engine.push(8, np.full((1, 1), 1e6, np.float32))
    assert len(events) == math.floor(math.log(1e9 + 1) / 0.15) == 138
    assert set(events["t"].tolist()) == {8}
    assert set(events["p"].tolist()) == {1}


@pytest.mark.long
def test_a_slow_ramp_of_a_million_frames_misses_nothing() -> None:
    """1e-9 a frame under C = 1e-4: nine levels up, nine down, each at its exact tick, whatever the base.

    A million steps far below any tolerance, where L, R and the tick come from sums and quotients that all round.
    """
    frames, gap_us, c, step = 1_000_000, 1_000, 1e-4, 1e-9
    bases = np.array([0.0, -6.9, 13.8, 0.0, -6.9, 13.8])
    slopes = np.array([step, step, step, -step, -step, -step])
    engine = CrossingEngine(6, 1, contrast_threshold=c, threads=1)
    samples = bases + slopes * np.arange(frames)[:, None]
    packets = (engine.push_log(k * gap_us, row[None, :]) for k, row in enumerate(samples))
    found = np.concatenate([packet for packet in packets if len(packet)])
    for x, (base, slope) in enumerate(zip(bases, slopes, strict=True)):
        expected = []
        for n in range(1, 10):
            level = Fraction(base) + int(np.sign(slope)) * n * Fraction(c)
            towards = 1 if slope > 0 else -1
            # Every sample is base + slope k rounded, so that the level lies within an ulp of its place in the list.
            near = round((level - Fraction(base)) / Fraction(slope))
            k = next(k for k in range(near - 3, near + 4) if towards * (Fraction(samples[k, x]) - level) >= 0)
            before, after = Fraction(samples[k - 1, x]), Fraction(samples[k, x])
            expected.append((k - 1) * gap_us + math.ceil((level - before) / (after - before) * gap_us))
        assert found[found["x"] == x]["t"].tolist() == expected
        assert set(found[found["x"] == x]["p"].tolist()) == {int(slope > 0)}


@pytest.mark.long
def test_an_hour_is_the_same_from_zero_later_and_from_the_unix_epoch() -> None:
    """At 100 Hz, from 0, 1e9 us and 1.7e15 us on: identical events, shifted; no error adds up.

    Ten pixels, so that as many samples as of an hour at 1 kHz are compared.
    """
    k = np.arange(360_000)[:, None]
    phase = np.arange(10)
    luma = np.exp(np.sin(k * 0.0037 + phase) + np.sin(k * 0.00011 * (1 + phase))).astype(np.float32)[:, None]

    def run(start_us: int) -> EventArray:
        push = CrossingEngine(10, 1, contrast_threshold=0.07, contrast_threshold_off=0.09, threads=1).push
        packets = (
            push(t, frame) for t, frame in zip(range(start_us, start_us + 3_600_000_000, 10_000), luma, strict=True)
        )
        return np.concatenate([packet for packet in packets if len(packet)])

    events = run(0)
    assert len(events) > 100_000
    for start_us in (1_000_000_000, EPOCH_US):
        shifted = run(start_us)
        shifted["t"] -= start_us
        np.testing.assert_array_equal(shifted, events)
