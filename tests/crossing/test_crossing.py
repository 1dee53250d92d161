"""The crossing engine against its contract: events identical to the exact oracle's, and what follows from that."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from davis_rs import EVENT_DTYPE, CrossingEngine, log_intensity, reconstruct
from davis_rs.events.arrays import EventArray
from effects_reference import START_PHASE, Draw
from long_form import long_values
from reference import ExactEngine, ExactPixel, LogFrame, exact_events
from strategies import EPOCH_US, EXAMPLES, Sequence, intervals, nudged, random_paths, sequences, start_times

LumaFrame = npt.NDArray[np.float32]


def engine_of(sequence: Sequence, threads: int | None = 1, **settings: Any) -> CrossingEngine:
    height, width = sequence.shape
    return CrossingEngine(
        width,
        height,
        contrast_threshold=sequence.c_on,
        contrast_threshold_off=sequence.c_off,
        threads=threads,
        **settings,
    )


def events_of(sequence: Sequence) -> list[EventArray]:
    """What the engine returns, frame by frame."""
    engine = engine_of(sequence)
    return [engine.push_log(t, frame) for t, frame in zip(sequence.times_us, sequence.frames, strict=True)]


def one_pixel(times_us: list[int], samples: list[float], c_on: float, c_off: float | None = None) -> EventArray:
    """The events of a single pixel."""
    frames = [np.array([[sample]]) for sample in samples]
    return np.concatenate(events_of(Sequence(c_on, c_on if c_off is None else c_off, times_us, frames)))


# ---- against the oracle ----


@EXAMPLES
@given(sequences())
@example(Sequence(0.001, 0.0015, [0, 1, 4], [np.array([[v]]) for v in (-3.0, 3.0, -3.0)]))
@example(Sequence(2.0, 2.0, [EPOCH_US, EPOCH_US + 1], [np.array([[-700.0]]), np.array([[700.0]])]))
def test_every_event_is_the_oracles(sequence: Sequence) -> None:
    """Number, pixels, polarities, order and every tick are those of rational arithmetic, frame by frame."""
    oracle = ExactEngine(contrast_threshold=sequence.c_on, contrast_threshold_off=sequence.c_off)
    for t_us, frame, events in zip(sequence.times_us, sequence.frames, events_of(sequence), strict=True):
        np.testing.assert_array_equal(events, oracle.push_log(t_us, frame))


@EXAMPLES
@given(
    st.floats(-8, 8),
    st.floats(0.01, 1),
    st.sampled_from([1.0, 0.7, 1.3]),
    st.lists(st.tuples(st.integers(1, 1 << 45), st.integers(-3, 3), st.integers(-2, 2)), min_size=1, max_size=8),
    st.data(),
)
def test_crossings_within_an_ulp_of_a_tick_take_the_right_tick(
    base: float, c: float, ratio: float, steps: list[tuple[int, int, int]], data: st.DataObject
) -> None:
    """Lines drawn to cross a level on a whole tick, missed by at most a few ulps, are stamped as the oracle does."""
    times_us, samples = [0], [base]
    for ticks, level, ulps in steps:
        target = base + (level * c if level > 0 else level * c * ratio)
        k = data.draw(st.integers((ticks + 3) // 4, ticks))
        times_us.append(times_us[-1] + ticks)
        samples.append(nudged(samples[-1] + (target - samples[-1]) * (ticks / k), ulps))
        if abs(samples[-1] - base) > 20 * c:
            samples[-1] = target
    expected = exact_events(times_us, [np.array([[v]]) for v in samples], c, c * ratio)
    np.testing.assert_array_equal(one_pixel(times_us, samples, c, c * ratio), expected)


@EXAMPLES
@given(sequences(gaps=st.integers(1, 40)))
def test_the_oracle_is_what_walking_tick_by_tick_finds(sequence: Sequence) -> None:
    """A second reading of the contract: at each tick in turn, an event for every level that the line has reached."""
    for y, x in np.ndindex(sequence.shape):
        samples = [Fraction(float(frame[y, x])) for frame in sequence.frames]
        pixel = ExactPixel(sequence.times_us[0], float(samples[0]), sequence.c_on, sequence.c_off)
        reference, c_on, c_off = samples[0], Fraction(sequence.c_on), Fraction(sequence.c_off)
        for i, t_us in enumerate(sequence.times_us[1:], 1):
            start_us, walked = sequence.times_us[i - 1], []
            for now in range(start_us + 1, t_us + 1):
                value = samples[i - 1] + (samples[i] - samples[i - 1]) * (now - start_us) / (t_us - start_us)
                while value >= reference + c_on:
                    reference += c_on
                    walked.append((now, 1))
                while value <= reference - c_off:
                    reference -= c_off
                    walked.append((now, 0))
            assert pixel.advance(t_us, float(samples[i])) == walked


# ---- what the contract promises of every sequence ----


@EXAMPLES
@given(sequences())
def test_stamps_lie_in_their_interval_and_the_order_is_t_y_x(sequence: Sequence) -> None:
    """Events of a frame lie in (t_a, t_b], sorted by (t, y, x); the first frame has none."""
    packets = events_of(sequence)
    assert packets[0].dtype == EVENT_DTYPE
    assert len(packets[0]) == 0
    for start_us, end_us, events in zip(sequence.times_us, sequence.times_us[1:], packets[1:], strict=False):
        assert np.all((events["t"] > start_us) & (events["t"] <= end_us))
        np.testing.assert_array_equal(np.lexsort((events["x"], events["y"], events["t"])), np.arange(len(events)))


@EXAMPLES
@given(sequences())
def test_the_reference_stays_within_a_threshold_of_the_signal(sequence: Sequence) -> None:
    """-C_off < L - R < C_on after every sample, R being the first sample plus the events, in rational numbers."""
    c_on, c_off = Fraction(sequence.c_on), Fraction(sequence.c_off)
    references = {pixel: Fraction(float(sequence.frames[0][pixel])) for pixel in np.ndindex(sequence.shape)}
    for frame, events in zip(sequence.frames, events_of(sequence), strict=True):
        for _, x, y, p in events.tolist():
            references[y, x] += c_on if p else -c_off
        for pixel, reference in references.items():
            assert -c_off < Fraction(float(frame[pixel])) - reference < c_on


@EXAMPLES
@given(sequences(), st.sampled_from(["zero", "stationary"]), st.integers(0, 2**64 - 1))
def test_reference_is_the_exact_one_rounded_and_reconstruct_gives_it_to_the_bit(
    sequence: Sequence, start_phase: str, seed: int
) -> None:
    """engine.reference is within an ulp of R, and reconstruct() finds the same bits from events and first frame.

    From any start phase, whose references the oracle begins with: its events, too, and always within both thresholds.
    """
    settings: dict[str, Any] = {"start_phase": start_phase, "seed": seed}
    engine = engine_of(sequence, **settings)
    assert np.isnan(engine.reference).all()
    engine.push_log(sequence.times_us[0], sequence.frames[0])
    oracle = ExactEngine(
        contrast_threshold=sequence.c_on,
        contrast_threshold_off=sequence.c_off,
        first_reference=engine.reference,
    )
    engine = engine_of(sequence, **settings)
    packets: list[EventArray] = []
    references: list[LogFrame] = []
    for t_us, frame in zip(sequence.times_us, sequence.frames, strict=True):
        packets.append(engine.push_log(t_us, frame))
        references.append(engine.reference)
        np.testing.assert_array_equal(packets[-1], oracle.push_log(t_us, frame))
        for pixel, exact in oracle.pixels.items():
            rounded = float(references[-1][pixel])
            assert abs(Fraction(rounded) - exact.reference) <= Fraction(math.ulp(rounded))
            assert -exact.c_off < exact.log_intensity - exact.reference < exact.c_on
    everything = np.concatenate(packets)
    for t_us, reference in zip(sequence.times_us, references, strict=True):
        rebuilt = reconstruct(everything, sequence.frames[0], t_us, sequence.c_on, sequence.c_off, **settings)
        assert rebuilt.tobytes() == reference.tobytes()


@EXAMPLES
@given(sequences())
def test_last_event_us_is_the_surface_of_active_events(sequence: Sequence) -> None:
    """Each pixel shows the time of its latest event, and -1 before its first."""
    engine = engine_of(sequence)
    surface = np.full(sequence.shape, -1, np.int64)
    np.testing.assert_array_equal(engine.last_event_us, surface)
    for t_us, frame in zip(sequence.times_us, sequence.frames, strict=True):
        for t, x, y, _ in engine.push_log(t_us, frame).tolist():
            surface[y, x] = t
        np.testing.assert_array_equal(engine.last_event_us, surface)


@EXAMPLES
@given(sequences(), st.integers(0, EPOCH_US))
def test_events_do_not_depend_on_where_time_begins(sequence: Sequence, shift_us: int) -> None:
    """Shifted frame times give the same events, shifted."""
    shifted = Sequence(sequence.c_on, sequence.c_off, [t + shift_us for t in sequence.times_us], sequence.frames)
    events = np.concatenate(events_of(sequence))
    events["t"] += shift_us
    np.testing.assert_array_equal(np.concatenate(events_of(shifted)), events)


@EXAMPLES
@given(
    st.integers(-(1 << 20), 1 << 20),
    st.integers(-(1 << 14), 1 << 14),
    st.integers(1 << 12, 1 << 18),
    st.sampled_from([1.0, 0.5, 1.25]),
    start_times,
    st.lists(st.integers(1, 139), max_size=12, unique=True),
)
def test_a_ramp_gives_the_same_events_in_any_pieces(
    base: int, slope: int, threshold: int, ratio: float, start_us: int, cuts: list[int]
) -> None:
    """Samples on one straight line (all exact in binary) add nothing: 1, 2, 7 or any pieces, the same events."""
    unit = 2.0**-18
    c_on = threshold * unit

    def events(ticks: list[int]) -> EventArray:
        samples = [(base + slope * k) * unit for k in ticks]
        return one_pixel([start_us + k for k in ticks], samples, c_on, c_on * ratio)

    whole = events([0, 140])
    np.testing.assert_array_equal(events([0, 70, 140]), whole)
    np.testing.assert_array_equal(events(list(range(0, 141, 20))), whole)
    np.testing.assert_array_equal(events([0, *sorted(cuts), 140]), whole)
    # Closed form: the n-th level lies n thresholds away, reached at the first whole tick from there on.
    distance = Fraction(c_on) if slope > 0 else Fraction(c_on) * Fraction(ratio)
    rate = Fraction(abs(slope)) * Fraction(unit)
    count = rate * 140 // distance
    assert whole["t"].tolist() == [start_us + math.ceil(n * distance / rate) for n in range(1, count + 1)]
    assert set(whole["p"].tolist()) <= {int(slope > 0)}


@EXAMPLES
@given(
    st.lists(st.lists(st.floats(0, 2.0**127, width=32), min_size=6, max_size=6), min_size=2, max_size=6),
    st.sampled_from([1e-9, 1e-3, 0.5]),
    intervals,
)
def test_push_is_push_log_of_log_intensity(luma: list[list[float]], log_eps: float, gap_us: int) -> None:
    """Luma in or its log intensity in, the events and the references are the same."""
    by_luma = CrossingEngine(3, 2, contrast_threshold=0.3, log_eps=log_eps, threads=1)
    by_log = CrossingEngine(3, 2, contrast_threshold=0.3, threads=1)
    for i, pixels in enumerate(luma):
        frame = np.array(pixels, np.float32).reshape(2, 3)
        events = by_luma.push(i * gap_us, frame)
        assert events.tobytes() == by_log.push_log(i * gap_us, log_intensity(frame, log_eps)).tobytes()
        assert by_luma.reference.tobytes() == by_log.reference.tobytes()


# ---- sensors of many pixels ----


def test_every_pixel_of_a_large_sensor_is_the_oracles() -> None:
    """131 x 77 pixels (more than one thread takes at once) that follow eleven paths: all events, in (t, y, x) order."""
    width, height, times_us = 131, 77, [5, 1_005, 1_019, 40_000]
    walks = random_paths(11, len(times_us))
    which = (np.arange(height)[:, None] * 5 + np.arange(width) * 3) % 11
    engine = CrossingEngine(width, height, contrast_threshold=0.21, contrast_threshold_off=0.16)
    oracle = ExactEngine(contrast_threshold=0.21, contrast_threshold_off=0.16)
    for t_us, walk in zip(times_us, walks, strict=True):
        eleven = oracle.push_log(t_us, walk[None, :])
        expected = np.concatenate([eleven[eleven["x"] == which[y, x]] for y in range(height) for x in range(width)])
        counts = np.array([np.count_nonzero(eleven["x"] == path) for path in range(11)])[which.ravel()]
        expected["y"], expected["x"] = np.divmod(np.repeat(np.arange(width * height), counts), width)
        order = np.argsort(expected["t"], kind="stable")
        np.testing.assert_array_equal(engine.push_log(t_us, walk[which]), expected[order])


@EXAMPLES
@given(sequences(max_frames=5), st.sampled_from([7, 11, 43]))
def test_pixels_side_by_side_do_not_disturb_each_other(sequence: Sequence, copies: int) -> None:
    """The same few pixels many times over a row, in step with no vector width: each copy has the events of one."""
    wide = Sequence(sequence.c_on, sequence.c_off, sequence.times_us, [np.tile(f, copies) for f in sequence.frames])
    width = sequence.shape[1]
    for few, many in zip(events_of(sequence), events_of(wide), strict=True):
        expected = np.repeat(few[None, :], copies, axis=0)
        expected["x"] += (np.arange(copies) * width)[:, None].astype(np.uint16)
        expected = expected.ravel()
        order = np.lexsort((np.tile(np.arange(len(few)), copies), expected["x"], expected["y"], expected["t"]))
        np.testing.assert_array_equal(many, expected[order])


def on_and_beside_levels(base: LogFrame, frames: int, c_on: float, c_off: float) -> list[LogFrame]:
    """Log intensity that steps from grid point to grid point, or stays where it is, pixel by pixel."""
    rng = np.random.default_rng(11)
    walk = [base]
    for _ in range(frames - 1):
        grid = base + rng.integers(-3, 4, base.shape) * c_on - rng.integers(-3, 4, base.shape) * c_off
        walk.append(np.where(rng.random(base.shape) < 0.3, walk[-1], grid))
    return walk


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("log_eps", "least", "most", "c"),
    [
        *long_values((1e-300, 1e-6, 1e5, 0.13), (1e-3, 1e-6, 1e5, 0.13)),
        (1e-9, 1e-6, 1e5, 0.13),
        (10.0, 1e-6, 1e5, 0.13),
        # Faint against log_eps: a float32 step of luma is a thousandth of what 1e-9 is of luma + log_eps.
        (11.31, 1e-3, 1e-2, 1.3e-5),
        *long_values((11.32, 1e-3, 1e-2, 1.3e-5)),
    ],
)
def test_luma_on_and_beside_levels_gives_the_oracles_events(
    log_eps: float, least: float, most: float, c: float
) -> None:
    """Luma within a few float32 of every level, black, subnormal and huge luma among it: decided by L in float64."""
    width, height, c_on, c_off = 61, 43, c, 1.3 * c
    rng = np.random.default_rng(5)
    base = np.log(np.exp(rng.uniform(math.log(least), math.log(most), (height, width))) + log_eps)
    extremes = np.array([0.0, -0.0, 1e-45, 1e-40, 3e38, np.finfo(np.float32).max] if c > 0.1 else [0.0, -0.0, 1e-45])
    engine = CrossingEngine(width, height, contrast_threshold=c_on, contrast_threshold_off=c_off, log_eps=log_eps)
    oracle = ExactEngine(contrast_threshold=c_on, contrast_threshold_off=c_off)
    total = 0
    for i, log in enumerate(on_and_beside_levels(base, 5, c_on, c_off)):
        luma = np.maximum(np.exp(log) - log_eps, 1e-44).astype(np.float32)
        luma = (luma.view(np.int32) + rng.integers(-2, 3, luma.shape, dtype=np.int32)).view(np.float32)
        rare = rng.random(luma.shape) < 0.002
        luma[rare] = rng.choice(extremes, np.count_nonzero(rare))
        expected = oracle.push_log(i * 1_000, log_intensity(luma, log_eps))
        np.testing.assert_array_equal(engine.push(i * 1_000, luma), expected)
        total += len(expected)
    assert total > 15_000


@pytest.mark.parametrize("gap_us", [1, (1 << 52) + 1, *long_values(1_000)])
def test_log_intensity_on_and_beside_levels_gives_the_oracles_events(gap_us: int) -> None:
    """Log intensity within a few float64 of every level, over intervals of any length."""
    width, height, c_on, c_off = 61, 43, 0.13, 0.17
    rng = np.random.default_rng(5)
    base = rng.uniform(-20, 20, (height, width))
    engine = CrossingEngine(width, height, contrast_threshold=c_on, contrast_threshold_off=c_off)
    oracle = ExactEngine(contrast_threshold=c_on, contrast_threshold_off=c_off)
    for i, log in enumerate(on_and_beside_levels(base, 5, c_on, c_off)):
        log = (log.view(np.int64) + rng.integers(-2, 3, log.shape)).view(np.float64)
        np.testing.assert_array_equal(engine.push_log(i * gap_us, log), oracle.push_log(i * gap_us, log))


def test_pixels_with_a_billion_events_behind_them_go_on_exactly() -> None:
    """Counters that high leave float64 1e-7 to err in; events are the oracle's all the same."""
    width, height, c_on, c_off = 37, 11, 0.15, 0.2
    n_on = 1_000_000_000 + np.arange(width * height, dtype=np.uint32).reshape(height, width)
    n_off = n_on // 4 * 3  # 0.15 up four times is 0.2 down three times: the references lie near B
    first = np.zeros((height, width))
    engine = CrossingEngine(width, height, contrast_threshold=c_on, contrast_threshold_off=c_off)
    engine.push_log(0, first)
    oracle = ExactEngine(contrast_threshold=c_on, contrast_threshold_off=c_off)
    oracle.push_log(0, first)
    last = np.empty((height, width))
    for place, pixel in oracle.pixels.items():
        pixel.n_on, pixel.n_off = int(n_on[place]), int(n_off[place])
        last[place] = float(pixel.reference)
        pixel.log_intensity = Fraction(last[place])
    counters = {"on": n_on.ravel(), "off": n_off.ravel(), "log_intensity": last.ravel()}
    engine = CrossingEngine.from_state({**engine.state(), **counters})
    rng = np.random.default_rng(3)
    for i, log in enumerate(on_and_beside_levels(last, 9, c_on, c_off), 1):
        near = log + rng.uniform(-3e-7, 3e-7, log.shape)
        np.testing.assert_array_equal(engine.push_log(i * 1_000, near), oracle.push_log(i * 1_000, near))


def test_thread_counts_do_not_change_a_byte() -> None:
    """1, 2, 7 threads or as many as pay return the same bytes, padding included, and the padding is zero."""
    frames = np.exp(random_paths(120 * 90, 4)).astype(np.float32).reshape(4, 90, 120)

    def run(threads: int | None) -> list[bytes]:
        engine = CrossingEngine(120, 90, contrast_threshold=0.1, threads=threads)
        return [engine.push(i * 1_000, frame).tobytes() for i, frame in enumerate(frames)]

    alone = run(1)
    assert len(alone[1]) > 16 * 10_000
    assert not np.frombuffer(b"".join(alone), np.uint8).reshape(-1, 16)[:, 13:].any()
    for threads in (2, 7, None):
        assert run(threads) == alone


# ---- start phases ----


@pytest.mark.parametrize(("c_on", "c_off"), [(0.2, 0.2), (0.1, 0.3)])
def test_stationary_references_begin_anywhere_between_both_levels(c_on: float, c_off: float) -> None:
    """L - R of 10,000 pixels: the draw of (seed, pixel), which is even (chi-square over 50 bins, 1e-6) and not
    correlated, scaled to (-C_off, C_on); of luma as of log intensity. Without it all references are at the signal."""
    shares = []
    for seed in (0, 1):
        settings: dict[str, Any] = {"contrast_threshold": c_on, "contrast_threshold_off": c_off, "seed": seed}
        engine = CrossingEngine(100, 100, start_phase="stationary", **settings)
        engine.push_log(5, np.full((100, 100), -1.25))
        shares.append((-1.25 - engine.reference + c_off) / (c_on + c_off))
        drawn = [Draw(seed, START_PHASE, pixel, 0).uniform for pixel in (0, 1, 105, 9_999)]
        np.testing.assert_allclose(shares[-1].ravel()[[0, 1, 105, 9_999]], drawn, atol=1e-13)
        assert stats.chisquare(np.histogram(shares[-1], 50, (0, 1))[0]).pvalue > 1e-6
        assert stats.pearsonr(shares[-1][:, 1:].ravel(), shares[-1][:, :-1].ravel()).pvalue > 1e-6
        of_luma = CrossingEngine(100, 100, start_phase="stationary", **settings)
        luma = np.full((100, 100), 0.4, np.float32)
        of_luma.push(5, luma)
        np.testing.assert_allclose(log_intensity(luma, 1e-3) - of_luma.reference, -1.25 - engine.reference, atol=1e-13)
        ideal = CrossingEngine(100, 100, **settings)
        ideal.push_log(5, np.full((100, 100), -1.25))
        assert np.all(ideal.reference == -1.25)
    assert not np.any(shares[0] == shares[1])


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("effects", [None, {"refractory_period_us": {"period_us": 1.0}}])
def test_stationary_pixels_fire_at_once_and_alike_in_both_directions(threads: int, effects: Any) -> None:
    """Half a threshold up makes an event in a quarter of the pixels of alike thresholds, half of one down likewise."""
    for step, p in ((0.1, 1), (-0.1, 0)):
        engine = CrossingEngine(
            200, 100, contrast_threshold=0.2, start_phase="stationary", effects=effects, threads=threads
        )
        engine.push(0, np.ones((100, 200), np.float32))
        events = engine.push(1_000, np.full((100, 200), np.exp(step), np.float32))
        assert set(events["p"].tolist()) == {p}
        assert len(events) == pytest.approx(5_000, abs=5 * math.sqrt(5_000 * 0.75))
        assert stats.kstest(events["t"] / 1_000, "uniform").pvalue > 1e-6


def test_a_stored_engine_keeps_its_start_phase() -> None:
    """Before the first frame, when nothing is drawn yet, and after it, with references far from any log intensity."""
    frames = [np.full((3, 4), value) for value in (0.0, 900.0 / 2, -300.0)]
    whole = CrossingEngine(4, 3, contrast_threshold=700.0, start_phase="stationary", seed=3)
    expected = [whole.push_log(t, frame) for t, frame in enumerate(frames)]
    parts = CrossingEngine(4, 3, contrast_threshold=700.0, start_phase="stationary", seed=3)
    for t, frame in enumerate(frames):
        parts = CrossingEngine.from_state(parts.state())
        np.testing.assert_array_equal(parts.push_log(t, frame), expected[t])
    np.testing.assert_array_equal(parts.reference, whole.reference)
    assert np.abs(whole.reference - frames[-1]).max() > 500
    assert 'start_phase="stationary"' in repr(parts)
    for make in (
        lambda: CrossingEngine(1, 1, start_phase="random"),
        lambda: reconstruct(np.zeros(0, EVENT_DTYPE), np.zeros((1, 1)), 0, 0.1, start_phase="random"),
        lambda: CrossingEngine.from_state({**parts.state(), "start_phase": "random"}),
    ):
        with pytest.raises(ValueError, match="start_phase must be 'zero' or 'stationary', got \"random\""):
            make()
