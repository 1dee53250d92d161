"""State stored and taken up again, thresholds per pixel, and counters far from zero."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import CrossingEngine, log_intensity, reconstruct
from davis_rs.events.arrays import EventArray, concatenate_events

SHAPE = (5, 7)


def walk(frames: int, seed: int = 1) -> npt.NDArray[np.float32]:
    """Luma of random walks in log intensity."""
    random = np.random.default_rng(seed)
    return np.exp(np.cumsum(random.normal(0, 0.2, (frames, *SHAPE)), 0)).astype(np.float32)


def rates(frames: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.gradient(frames, 1e-3, axis=0).astype(np.float32)


def new(interpolation: str = "linear", **settings: Any) -> CrossingEngine:
    return CrossingEngine(SHAPE[1], SHAPE[0], interpolation=interpolation, **settings)


def push(engine: CrossingEngine, k: int, frames: npt.NDArray[np.float32], interpolation: str, log: bool) -> EventArray:
    rate = rates(frames)[k] if interpolation == "hermite" else None
    if not log:
        return engine.push(k * 1000, frames[k], rate)
    y = frames[k].astype(np.float64)
    return engine.push_log(k * 1000, np.log(y), None if rate is None else rate / y)


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
@pytest.mark.parametrize("way", ["state", "pickle"])
def test_a_stored_engine_goes_on_as_if_nothing_had_been(way: str, interpolation: str, log: bool) -> None:
    """Stored and restored before every frame, on other numbers of threads: the same bytes."""
    frames = walk(30)
    whole, pieces = new(interpolation, threads=1), new(interpolation, threads=1)
    expected, got = [], []
    for k in range(len(frames)):
        expected.append(push(whole, k, frames, interpolation, log))
        if way == "pickle":
            pieces = pickle.loads(pickle.dumps(pieces))
        else:
            pieces = CrossingEngine.from_state(pieces.state(), threads=1 + k % 3)
        got.append(push(pieces, k, frames, interpolation, log))
    assert len(concatenate_events(expected)) > 500
    assert concatenate_events(got).tobytes() == concatenate_events(expected).tobytes()
    assert np.array_equal(pieces.reference, whole.reference)
    assert np.array_equal(pieces.last_event_us, whole.last_event_us)


def test_a_billion_events_leave_the_reference_on_its_grid() -> None:
    """Float32 references, or sums of thresholds, would be off by many levels by then."""
    c_on, c_off, n_on, n_off = 0.15, 0.2, 1_000_000_003, 749_999_998
    engine = CrossingEngine(1, 1, contrast_threshold=c_on, contrast_threshold_off=c_off)
    engine.push_log(0, np.array([[0.25]]))
    state = engine.state()
    state["on"][:], state["off"][:] = n_on, n_off
    engine = CrossingEngine.from_state(state)
    exact = Fraction(0.25) + n_on * Fraction(c_on) - n_off * Fraction(c_off)
    assert engine.reference[0, 0] == float(exact)
    # The next ON level is reached to the last bit, and not a bit below.
    level = exact + Fraction(c_on)
    at = float(level) if Fraction(float(level)) >= level else np.nextafter(float(level), np.inf)
    below = np.nextafter(at, -np.inf)
    assert [len(engine.push_log(1000, np.array([[below]]))), len(engine.push_log(2000, np.array([[at]])))] == [0, 1]
    assert engine.state()["on"][0] == n_on + 1
    following = engine.push_log(3000, np.array([[float(exact)]]))
    assert [(int(e["t"]), int(e["p"])) for e in following] == []


def test_counters_that_could_overflow_are_refused() -> None:
    """2^32 events in one pixel: an error that says so, not a wrap to zero."""
    engine = CrossingEngine(1, 1)
    engine.push_log(0, np.array([[0.0]]))
    state = engine.state()
    state["on"][:] = state["off"][:] = 2**32 - 10
    engine = CrossingEngine.from_state(state)
    with pytest.raises(ValueError, match="a pixel has had 4294967286 events of one polarity"):
        engine.push_log(1000, np.array([[0.1]]))
    assert engine.state()["t_us"] == 0


@pytest.mark.parametrize("log_eps", [0.715, 1.4, 3.1, 1e-3])
def test_bounds_in_the_dark_are_not_too_wide(log_eps: float) -> None:
    """Far below the dark level luma is a small difference of large numbers: a bound off by 1e-10 would hide events."""
    threshold = 1e-6
    base = log_intensity(np.zeros((1, 1), np.float32), log_eps)[0, 0]
    on_level = next_luma(log_eps, Fraction(float(base)) + Fraction(threshold))
    engine = CrossingEngine(1, 1, contrast_threshold=threshold, log_eps=log_eps)
    engine.push(0, np.zeros((1, 1), np.float32))
    just_below = np.nextafter(on_level, np.float32(0))
    assert len(engine.push(1000, np.full((1, 1), just_below))) == 0
    assert len(engine.push(2000, np.full((1, 1), on_level))) == 1
    # And down again: the first luma whose log intensity is at or below the level.
    bright = np.float32(log_eps * 5e-6)
    engine = CrossingEngine(1, 1, contrast_threshold=threshold, log_eps=log_eps)
    engine.push(0, np.full((1, 1), bright))
    base = log_intensity(np.full((1, 1), bright), log_eps)[0, 0]
    off_level = next_luma(log_eps, Fraction(float(base)) - Fraction(threshold))
    dark = np.nextafter(off_level, np.float32(0))
    assert len(engine.push(1000, np.full((1, 1), np.nextafter(off_level, np.float32(1))))) == 0
    assert len(engine.push(2000, np.full((1, 1), dark))) == 1


def next_luma(log_eps: float, level: Fraction) -> np.float32:
    """The least float32 luma whose log intensity reaches ``level`` exactly, by bisection over the floats."""
    low, high = 0, int(np.float32(1).view(np.uint32))
    while high - low > 1:
        middle = (low + high) // 2
        luma = np.uint32(middle).view(np.float32)
        if Fraction(float(log_intensity(np.full((1, 1), luma), log_eps)[0, 0])) >= level:
            high = middle
        else:
            low = middle
    return np.float32(np.uint32(high).view(np.float32))


def test_thresholds_of_each_pixel() -> None:
    """Every pixel behaves as one alone with its own thresholds."""
    random = np.random.default_rng(3)
    on, off = random.uniform(0.001, 2, SHAPE), random.uniform(0.05, 0.6, SHAPE)
    frames = walk(20)
    engine = new(contrast_threshold=on, contrast_threshold_off=off)
    events = concatenate_events([engine.push(k * 1000, frame) for k, frame in enumerate(frames)])
    for y in range(SHAPE[0]):
        for x in range(SHAPE[1]):
            alone = CrossingEngine(1, 1, contrast_threshold=on[y, x], contrast_threshold_off=off[y, x])
            expected = [alone.push(k * 1000, frame[y : y + 1, x : x + 1]) for k, frame in enumerate(frames)]
            own = events[(events["x"] == x) & (events["y"] == y)]
            assert np.array_equal(own[["t", "p"]], concatenate_events(expected)[["t", "p"]])
            assert alone.reference[0, 0] == engine.reference[y, x]
    first = np.log(frames[0].astype(np.float64) + 1e-3)
    rebuilt = reconstruct(events, first, 19_000, on, off)
    np.testing.assert_allclose(rebuilt, engine.reference, atol=1e-12)
    again = CrossingEngine.from_state(engine.state())
    assert np.array_equal(again.reference, engine.reference)


def test_bad_thresholds_name_the_pixel() -> None:
    bad = np.full(SHAPE, 0.15)
    bad[2, 3] = -0.1
    with pytest.raises(
        ValueError, match=r"contrast_threshold must lie in 1e-6\.\.1e3.*got -0\.1 at pixel \(x, y\) = \(3, 2\)"
    ):
        new(contrast_threshold=bad)
    with pytest.raises(ValueError, match=r"contrast_threshold must have shape \(5, 7\)"):
        new(contrast_threshold=np.full((7, 5), 0.15))


def test_luma_and_log_intensity_do_not_mix() -> None:
    """An engine keeps the samples it was fed with."""
    engine = new()
    engine.push(0, walk(1)[0])
    with pytest.raises(ValueError, match="was of another kind: it cannot take log intensity"):
        engine.push_log(1000, np.zeros(SHAPE))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 1}, "version 1"),
        ({"on": np.zeros(3, np.uint32)}, "as many values"),
        ({"on": np.zeros(35, np.int64)}, "of a state must be an array of uint32"),
        ({"base": np.full(35, np.nan)}, "base of a state"),
        ({"luma": np.full(35, np.nan, np.float32)}, "luma must be finite"),
        ({"interpolation": "magic"}, "interpolation must be"),
    ],
)
def test_states_that_no_engine_can_be_in_are_refused(change: dict[str, Any], message: str) -> None:
    engine = new()
    engine.push(5, walk(1)[0])
    with pytest.raises(ValueError, match=message):
        CrossingEngine.from_state({**engine.state(), **change})
    state = engine.state()
    del state["off"]
    with pytest.raises(ValueError, match='must have an entry "off"'):
        CrossingEngine.from_state(state)


def test_an_engine_follows_a_fork(run_python: Callable[..., str]) -> None:
    """Threads do not: in a forked worker, as of a data loader, the engine would wait for them for ever."""
    program = """
import os, sys, warnings
import numpy as np
from davis_rs import CrossingEngine
warnings.simplefilter("ignore")
engine = CrossingEngine(200, 100, threads=3)
engine.push(0, np.ones((100, 200), np.float32))
child = os.fork()
events = engine.push(1000, np.full((100, 200), 2.0, np.float32))
if child == 0:
    os._exit(0 if len(events) == 80_000 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), len(events))
"""
    assert run_python(program).split() == ["0", "80000"]


@pytest.mark.parametrize("size", [(70_000, 1), (1, -1), (0, 3)])
def test_sizes_out_of_range_are_values_errors(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"must lie in 1\.\.65535|at least one pixel"):
        CrossingEngine(*size)
