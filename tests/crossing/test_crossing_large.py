"""The crossing engine where its fast path has seams: sensors of several tiles and bands, maps, far numbers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from test_crossing_state import rates

from davis_rs import CrossingEngine
from davis_rs.events.arrays import EventArray
from reference import ExactEngine

LogFrame = npt.NDArray[np.float64]


def sparse_walk(height: int, width: int, shares: list[float]) -> LogFrame:
    """Log intensity of which in each frame a share of the pixels, scattered over the sensor, makes a step."""
    random = np.random.default_rng(4)
    steps = [np.where(random.random((height, width)) < s, random.normal(0, 0.5, (height, width)), 0.0) for s in shares]
    return np.cumsum(np.array([random.normal(0, 1, (height, width)), *steps]), axis=0)


@pytest.mark.few(1)
@pytest.mark.parametrize("threads", [1, 2])
def test_few_events_over_a_large_sensor_are_the_oracles(threads: int) -> None:
    """A batch of candidates spans tiles only where events are few: none is lost and none stands at another's place."""
    frames = sparse_walk(55, 61, [0.001, 0.02, 0.1, 0.0, 0.5, 0.02])
    engine = CrossingEngine(61, 55, contrast_threshold=0.2, contrast_threshold_off=0.15, threads=threads)
    oracle = ExactEngine(contrast_threshold=0.2, contrast_threshold_off=0.15)
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(engine.push_log(i * 1_000, frame), oracle.push_log(i * 1_000, frame))


@pytest.mark.parametrize("few", [0, 1, 255, 256, 257, 1024])
def test_a_batch_of_any_size_has_room_for_a_tile_of_events(few: int) -> None:
    """Many events among the first 1024 pixels, then one in every pixel: all of them come, at their pixels."""
    engine = CrossingEngine(1024, 3, contrast_threshold=0.25, threads=1)
    engine.push_log(0, np.zeros((3, 1024)))
    frame = np.full((3, 1024), 0.3)
    frame[0, few:] = 0.0
    events = engine.push_log(1_000, frame)
    expected = [(x, 0) for x in range(few)] + [(x, y) for y in (1, 2) for x in range(1024)]
    assert list(zip(events["x"].tolist(), events["y"].tolist(), strict=True)) == expected


def take(
    engine: CrossingEngine, k: int, frame: npt.NDArray[np.floating], rate: npt.NDArray[np.floating] | None, log: bool
) -> EventArray:
    return engine.push_log(k * 1_000, frame, rate) if log else engine.push(k * 1_000, frame, rate)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("maps", ["none", "on", "off", "both"])
@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
@pytest.mark.parametrize("log", [False, True])
def test_every_row_of_a_large_sensor_is_as_if_alone(log: bool, interpolation: str, maps: str, threads: int) -> None:
    """Thresholds, rates, references, surface and restored state find their pixels beyond the first 1024."""
    height, width = 49, 67
    random = np.random.default_rng(5)
    on = random.uniform(0.05, 1, (height, width)) if maps in ("on", "both") else 0.15
    off = random.uniform(0.05, 1, (height, width)) if maps in ("off", "both") else 0.2
    frames: npt.NDArray[np.floating] = sparse_walk(height, width, [0.02, 0.3, 0.01, 0.9, 0.05, 0.05])
    frames = frames if log else np.exp(frames).astype(np.float32)
    slopes = rates(frames).astype(frames.dtype) if interpolation == "hermite" else [None] * len(frames)

    def row(of: npt.NDArray[np.floating] | float, y: int) -> npt.NDArray[np.floating] | float:
        return of[y : y + 1] if isinstance(of, np.ndarray) else of

    def new(
        rows: int, on: npt.NDArray[np.floating] | float, off: npt.NDArray[np.floating] | float, threads: int
    ) -> CrossingEngine:
        return CrossingEngine(
            width, rows, contrast_threshold=on, contrast_threshold_off=off, threads=threads, interpolation=interpolation
        )

    engine = new(height, on, off, threads)
    alone = [new(1, row(on, y), row(off, y), 1) for y in range(height)]
    for k, (frame, slope) in enumerate(zip(frames, slopes, strict=True)):
        events = take(engine, k, frame, slope, log)
        for y in range(height):
            own = events[events["y"] == y]
            expected = take(alone[y], k, frame[y : y + 1], None if slope is None else slope[y : y + 1], log)
            assert own[["t", "x", "p"]].tolist() == expected[["t", "x", "p"]].tolist()
        np.testing.assert_array_equal(engine.last_event_us, np.concatenate([e.last_event_us for e in alone]))
        np.testing.assert_array_equal(engine.reference, np.concatenate([e.reference for e in alone]))
        if k % 3 == 1:
            engine = CrossingEngine.from_state(engine.state(), threads=threads)


def test_a_threshold_beyond_the_smallest_float_is_reached() -> None:
    """exp(-720) is no normal float64: from the largest luma to black over a tiny dark level is one event."""
    engine = CrossingEngine(1, 1, contrast_threshold=1.0, contrast_threshold_off=720.0, log_eps=1e-300)
    engine.push(0, np.full((1, 1), 3e38, np.float32))
    assert engine.push(1_000, np.zeros((1, 1), np.float32))["p"].tolist() == [0]


@pytest.mark.parametrize(("base", "c_on", "c_off", "first", "then"), [(-746, 650, 1, 0, 1e-35), (746, 1, 745, 50, 2)])
def test_a_reference_that_no_luma_leads_to_hides_no_event(
    base: float, c_on: float, c_off: float, first: float, then: float
) -> None:
    """A restored base may lie beyond all luma, where bounds in terms of luma end: every sample is worth a look."""
    start, end = (np.full((1, 1), luma, np.float32) for luma in (first, then))
    engine = CrossingEngine(1, 1, contrast_threshold=c_on, contrast_threshold_off=c_off, log_eps=1e-300)
    engine.push(0, start)
    engine = CrossingEngine.from_state({**engine.state(), "base": np.array([float(base)])})
    assert engine.push(1_000, end)["p"].tolist() == [int(base < 0)]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("place", [(0, 0), (299, 299)])
def test_a_bad_pixel_of_a_large_frame_is_refused(place: tuple[int, int], threads: int) -> None:
    """Threads check a frame in parts; NaN in any part is an error that names its pixel."""
    engine = CrossingEngine(300, 300, threads=threads)
    frame = np.ones((300, 300), np.float32)
    frame[place] = np.nan
    with pytest.raises(ValueError, match=rf"pixel \(x, y\) = \({place[1]}, {place[0]}\)"):
        engine.push(0, frame)


@pytest.mark.parametrize("width", [64, 7])
def test_a_level_between_two_subnormal_lumas_is_reached_at_the_second(width: int) -> None:
    """Where float32 has no digits left to draw a bound inward, the bound itself is worth a look: >=, not >."""
    three, four = (np.full((1, width), k, np.uint32).view(np.float32) for k in (3, 4))
    engine = CrossingEngine(width, 1, contrast_threshold=np.log(4 / 3) * (1 - 1e-7), log_eps=1e-300)
    engine.push(0, three)
    for k, (frame, polarity) in enumerate([(four, 1), (three, 0), (four, 1)], 1):
        assert engine.push(k, frame)["p"].tolist() == [polarity] * width


@pytest.mark.parametrize(("last", "now"), [(0.4, 0.3013), (0.3, 0.4007), (0.3, 0.3)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_level_that_a_restored_state_has_passed_is_reached_at_the_first_tick(
    last: float, now: float, sign: int
) -> None:
    """Whichever way the signal runs from there: no stamp lies before or beyond the interval."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.25)
    engine.push_log(0, np.zeros((1, 1)))
    engine = CrossingEngine.from_state({**engine.state(), "log_intensity": np.array([sign * last])})
    events = engine.push_log(1_000, np.full((1, 1), sign * now))
    assert events[["t", "p"]].tolist() == [(1, int(sign > 0))]


def test_counters_are_watched_from_push_to_push() -> None:
    """An interval could have 3000 / C + 2 = 32 events: the first still has room for them, the second has not."""
    engine = CrossingEngine(1, 1, contrast_threshold=100.0)
    engine.push_log(0, np.zeros((1, 1)))
    state = engine.state()
    state["on"][:] = state["off"][:] = 2**32 - 1 - 32
    engine = CrossingEngine.from_state(state)
    assert engine.push_log(1_000, np.full((1, 1), 150.0))["p"].tolist() == [1]
    with pytest.raises(ValueError, match="a pixel has had 4294967264 events of one polarity"):
        engine.push_log(2_000, np.full((1, 1), 250.0))
