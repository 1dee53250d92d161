"""Mistakes seen in public event-camera simulators, each pinned down by a signal that shows it."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import CrossingEngine
from davis_rs.events.arrays import EventArray


def luma(value: float) -> npt.NDArray[np.float32]:
    return np.full((1, 1), value, np.float32)


def log_frame(value: float) -> npt.NDArray[np.float64]:
    return np.full((1, 1), value)


def run_log(samples: list[float], *, c: float, c_off: float | None = None, gap_us: int = 1_000) -> EventArray:
    """The events of one pixel that takes these log intensities at t = 0, gap_us, 2 gap_us, ..."""
    engine = CrossingEngine(1, 1, contrast_threshold=c, contrast_threshold_off=c_off)
    return np.concatenate([engine.push_log(i * gap_us, log_frame(value)) for i, value in enumerate(samples)])


def test_timestamps_are_not_float32() -> None:
    """float32 seconds are 61 us apart at 1000 s; ours differ by single microseconds there, and after a Unix epoch."""
    for start_us in (1_000_000_000, 1_700_000_000_000_000):
        engine = CrossingEngine(1, 1, contrast_threshold=0.125)
        engine.push_log(start_us, log_frame(0.0))
        assert (engine.push_log(start_us + 8, log_frame(1.0))["t"] - start_us).tolist() == [1, 2, 3, 4, 5, 6, 7, 8]


def test_a_step_below_any_tolerance_that_crosses_a_level_is_seen() -> None:
    """Simulators that ask for a step above 1e-6 let such a step carry L over a level unseen and mute the pixel."""
    c = 0.15
    samples = [0.0, math.nextafter(c, 0.0), c, c + 1e-12, c + 0.1, 2 * c, c, 0.0, -c]
    events = run_log(samples, c=c)
    assert events["p"].tolist() == [1, 1, 0, 0, 0]
    assert events["t"].tolist() == [2_000, 5_000, 6_000, 7_000, 8_000]


def test_creeping_over_a_level_by_the_smallest_floats_does_not_mute_the_pixel() -> None:
    """One float a frame from below a level to above it: one event, at the frame that reaches it; then life goes on."""
    c = 0.15
    below = [c]
    for _ in range(5):
        below.append(math.nextafter(below[-1], 0.0))
    above = [math.nextafter(c, 1.0), 0.4, 0.0, -0.2]
    events = run_log([0.0, *below[::-1], *above], c=c)
    assert events["t"].tolist()[0] == 6_000
    assert events["p"].tolist() == [1, 1, 0, 0, 0]


def test_an_exact_level_hit_counts_once_and_does_not_mute_the_pixel() -> None:
    """A sample exactly on a level counts there, not again later, and the pixel goes on from it either way."""
    assert run_log([0.0, 0.25, 0.25, 0.5, 0.25, 0.0], c=0.25)["p"].tolist() == [1, 1, 0, 0]
    assert run_log([0.0, 0.25, 0.2, 0.25, 0.3], c=0.25)["p"].tolist() == [1]
    assert run_log([0.0, 0.25, 0.0, 0.25, 0.0], c=0.25)["t"].tolist() == [1_000, 2_000, 3_000, 4_000]
    assert run_log([0.0, -0.25, -0.25, -0.5, -0.25, 0.0], c=0.25)["p"].tolist() == [0, 0, 1, 1]


def test_returning_to_the_first_sample_hits_its_level_exactly_however_often() -> None:
    """Levels summed up as floats (0.1 three times is not 0.3) drift away from L(0); counters do not."""
    cycles = 2_000
    events = run_log([0.0, *([0.1 * 3, 0.0] * cycles)], c=0.1)  # 0.1 * 3 is the first float above three times 0.1
    assert events["p"].tolist() == [1, 1, 1, 0, 0, 0] * cycles
    assert events["t"][5::6].tolist() == [2_000 * k for k in range(1, cycles + 1)]  # the level L(0), at the frame


def test_unequal_thresholds_do_not_drift_either() -> None:
    """After 100,000 events the reference is still B + n_on C_on - n_off C_off to the last bit."""
    c_on, c_off, cycles = 0.1, 0.15, 10_000
    engine = CrossingEngine(1, 1, contrast_threshold=c_on, contrast_threshold_off=c_off)
    engine.push_log(0, log_frame(1.0))
    polarities = [
        p for i in range(1, 2 * cycles + 1) for p in engine.push_log(i, log_frame(1.9 if i % 2 else 1.0))["p"].tolist()
    ]
    n_on, n_off = polarities.count(1), polarities.count(0)
    exact = 1 + n_on * Fraction(c_on) - n_off * Fraction(c_off)
    assert n_off > 40_000
    assert abs(Fraction(float(engine.reference[0, 0])) - exact) <= Fraction(math.ulp(1.0))


def test_events_of_one_frame_have_stamps_of_their_own() -> None:
    """A ramp over ten levels within one frame interval: ten stamps, evenly spread, not the frame's."""
    events = run_log([0.0, 1.25], c=0.125, gap_us=10_000)
    assert events["t"].tolist() == [1_000 * k for k in range(1, 11)]


def test_a_frame_can_give_a_pixel_many_events() -> None:
    """At most one event per pixel and frame loses contrast: a jump of 20 thresholds is 20 events."""
    assert len(run_log([0.0, 20 * 0.125], c=0.125)) == 20
    assert len(run_log([0.0, -20 * 0.125], c=0.125)) == 20


def test_a_first_frame_at_zero_is_not_never() -> None:
    """t = 0 as 'never fired' confuses sequences that begin at 0: an event may fall on the very next microsecond."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.25)
    assert engine.last_event_us.tolist() == [[-1]]
    engine.push_log(0, log_frame(0.0))
    assert engine.last_event_us.tolist() == [[-1]]
    assert engine.push_log(1, log_frame(0.25))["t"].tolist() == [1]
    assert engine.push_log(2, log_frame(0.5))["t"].tolist() == [2]
    assert engine.last_event_us.tolist() == [[2]]


def test_no_packet_is_older_than_the_one_before() -> None:
    """Every stamp lies after the last frame, so that packets put end to end are sorted."""
    rng = np.random.default_rng(3)
    engine = CrossingEngine(16, 12, contrast_threshold=0.1)
    frames = np.exp(np.cumsum(rng.normal(0, 0.3, (30, 12, 16)), axis=0)).astype(np.float32)
    packets = [engine.push(int(t), frame) for t, frame in zip(np.cumsum(rng.integers(1, 50, 30)), frames, strict=True)]
    stream = np.concatenate(packets)
    assert len(stream) > 5_000
    np.testing.assert_array_equal(np.lexsort((stream["x"], stream["y"], stream["t"])), np.arange(len(stream)))


def test_black_is_a_finite_log_intensity() -> None:
    """log(0) is minus infinity: a pixel that starts black, or goes black, has as many events as log_eps gives it."""
    for first, then, polarity in ((0.0, 1.0, 1), (1.0, 0.0, 0)):
        engine = CrossingEngine(1, 1, contrast_threshold=0.15, log_eps=1e-3)
        engine.push(0, luma(first))
        events = engine.push(1_000, luma(then))
        assert len(events) == math.floor(math.log(1.001 / 0.001) / 0.15) == 46
        assert set(events["p"].tolist()) == {polarity}
        assert np.isfinite(engine.reference).all()


def test_the_last_frame_gives_its_events_at_once() -> None:
    """No event is held back until a next frame that never comes: those of an interval return with its end."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.25)
    engine.push_log(0, log_frame(0.0))
    assert engine.push_log(1_000, log_frame(1.0))["t"].tolist() == [250, 500, 750, 1_000]


def test_thresholds_are_the_same_at_every_update() -> None:
    """Thresholds redrawn at every update are noise, not mismatch: here equal steps give equal events every time."""
    engine = CrossingEngine(4, 4, contrast_threshold=0.15)
    engine.push_log(0, np.zeros((4, 4)))
    for i in range(1, 200):
        events = engine.push_log(i, np.full((4, 4), 0.15 * i + 1e-9))
        assert len(events) == 16


def test_contrast_below_one_step_of_eight_bits_is_seen() -> None:
    """8-bit input turns a gentle dark gradient into steps: ours is float, and integers are refused, not guessed at."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.1, log_eps=1e-6)
    engine.push(0, luma(0.2 / 255))
    assert len(engine.push(1_000, luma(0.4 / 255))) == 6
    eight_bit = CrossingEngine(1, 1)
    with pytest.raises(ValueError, match="must be float32 or float64, got uint8"):
        eight_bit.push(0, np.full((1, 1), 51, np.uint8))
