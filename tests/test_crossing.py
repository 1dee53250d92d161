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

from davis_rs import EVENT_DTYPE, CrossingEngine, log_intensity, reconstruct
from davis_rs.events import EventArray
from reference import ExactEngine, ExactPixel, LogFrame, exact_events
from strategies import EPOCH_US, EXAMPLES, Sequence, intervals, nudged, sequences, start_times

LumaFrame = npt.NDArray[np.float32]


def engine_of(sequence: Sequence, threads: int | None = 1) -> CrossingEngine:
    height, width = sequence.shape
    return CrossingEngine(
        width, height, contrast_threshold=sequence.c_on, contrast_threshold_off=sequence.c_off, threads=threads
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
@given(sequences())
def test_reference_is_the_exact_one_rounded_and_reconstruct_gives_it_to_the_bit(sequence: Sequence) -> None:
    """engine.reference is within an ulp of R, and reconstruct() finds the same bits from events and first frame."""
    engine = engine_of(sequence)
    oracle = ExactEngine(contrast_threshold=sequence.c_on, contrast_threshold_off=sequence.c_off)
    assert np.isnan(engine.reference).all()
    packets: list[EventArray] = []
    references: list[LogFrame] = []
    for t_us, frame in zip(sequence.times_us, sequence.frames, strict=True):
        packets.append(engine.push_log(t_us, frame))
        references.append(engine.reference)
        oracle.push_log(t_us, frame)
        for pixel, exact in oracle.pixels.items():
            rounded = float(references[-1][pixel])
            assert abs(Fraction(rounded) - exact.reference) <= Fraction(math.ulp(rounded))
    everything = np.concatenate(packets)
    for t_us, reference in zip(sequence.times_us, references, strict=True):
        rebuilt = reconstruct(everything, sequence.frames[0], t_us, sequence.c_on, sequence.c_off)
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


def paths(count: int, frames: int) -> npt.NDArray[np.float64]:
    """(frames, count) random walks with jumps, the same in every run."""
    rng = np.random.default_rng(7)
    steps = rng.normal(0, 0.2, (frames, count)) + rng.choice([0, 1.5], (frames, count), p=[0.9, 0.1])
    walks: npt.NDArray[np.float64] = np.cumsum(steps, axis=0)
    return walks


def test_every_pixel_of_a_large_sensor_is_the_oracles() -> None:
    """131 x 77 pixels (more than one thread takes at once) that follow eleven paths: all events, in (t, y, x) order."""
    width, height, times_us = 131, 77, [5, 1_005, 1_019, 40_000]
    walks = paths(11, len(times_us))
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


@pytest.mark.parametrize(
    ("log_eps", "least", "most", "c"),
    [
        (1e-300, 1e-6, 1e5, 0.13),
        (1e-9, 1e-6, 1e5, 0.13),
        (1e-3, 1e-6, 1e5, 0.13),
        (10.0, 1e-6, 1e5, 0.13),
        # Faint against log_eps: a float32 step of luma is a thousandth of what 1e-9 is of luma + log_eps.
        (11.31, 1e-3, 1e-2, 1.3e-5),
        (11.32, 1e-3, 1e-2, 1.3e-5),
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


@pytest.mark.parametrize("gap_us", [1, 1_000, (1 << 52) + 1])
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
    """1, 2, 7 threads or one a core return the same bytes, padding included, and the padding is zero."""
    frames = np.exp(paths(120 * 90, 4)).astype(np.float32).reshape(4, 90, 120)

    def run(threads: int | None) -> list[bytes]:
        engine = CrossingEngine(120, 90, contrast_threshold=0.1, threads=threads)
        return [engine.push(i * 1_000, frame).tobytes() for i, frame in enumerate(frames)]

    alone = run(1)
    assert len(alone[1]) > 16 * 10_000
    assert not np.frombuffer(b"".join(alone), np.uint8).reshape(-1, 16)[:, 13:].any()
    for threads in (2, 7, None):
        assert run(threads) == alone


# ---- frames as NumPy has them ----


def layouts(frame: LumaFrame) -> dict[str, npt.NDArray[np.floating[Any]]]:
    """The same values in every layout that ``push`` takes."""
    height, width = frame.shape
    wide = np.full((height * 2, width * 3), np.float32(np.nan))
    wide[1::2, ::3] = frame
    read_only = frame.copy()
    read_only.flags.writeable = False
    return {
        "F order": np.asfortranarray(frame),
        "strided": wide[1::2, ::3],
        "reversed": frame[::-1, ::-1].copy()[::-1, ::-1],
        "read-only": read_only,
        "float64": frame.astype(np.float64),
        "float64, F order": np.asfortranarray(frame.astype(np.float64)),
    }


@pytest.mark.parametrize("layout", list(layouts(np.zeros((1, 1), np.float32))))
def test_any_layout_of_a_frame_gives_the_same_events(layout: str) -> None:
    """F order, strides, read-only memory and float64 are taken as the values that they hold, and left untouched."""
    frames = np.exp(paths(12, 3)).astype(np.float32).reshape(3, 3, 4)
    plain, other = CrossingEngine(4, 3), CrossingEngine(4, 3)
    plain_log, other_log = CrossingEngine(4, 3), CrossingEngine(4, 3)
    for i, frame in enumerate(frames):
        array = layouts(frame)[layout]
        before = (array.tobytes(), array.flags.writeable)
        assert other.push(i * 100, array).tobytes() == plain.push(i * 100, frame).tobytes()
        assert other_log.push_log(i * 100, array).tobytes() == plain_log.push_log(i * 100, frame).tobytes()
        assert (array.tobytes(), array.flags.writeable) == before
    assert (plain.last_event_us >= 0).any()


def test_a_misaligned_frame_is_taken() -> None:
    """A frame at an odd address, as in a file mapped after its header, is a float32 frame like any other."""
    memory = np.zeros(4 * 6 + 1, np.uint8)
    frame = memory[1:].view(np.float32).reshape(2, 3)
    frame[:] = 0.5
    assert not frame.flags.aligned
    engine = CrossingEngine(3, 2)
    engine.push(0, frame)
    np.testing.assert_array_equal(engine.reference, log_intensity(np.full((2, 3), 0.5, np.float32), 1e-3))


def test_float32_log_intensity_is_taken_as_it_is() -> None:
    """push_log widens float32 without a loss: its values are the float64 ones."""
    frame = np.array([[0.1, 0.7]], np.float32)
    engine = CrossingEngine(2, 1)
    engine.push_log(0, frame)
    assert engine.reference.tolist() == [[float(np.float32(0.1)), float(np.float32(0.7))]]


def test_results_are_copies_that_belong_to_the_caller() -> None:
    """Writing into returned references, surfaces or pushed frames changes nothing in the engine."""
    engine = CrossingEngine(1, 1)
    frame = np.ones((1, 1), np.float32)
    engine.push(0, frame)
    frame[:] = 100
    engine.reference[:] = 100.0
    engine.last_event_us[:] = 100
    assert engine.last_event_us.tolist() == [[-1]]
    assert len(engine.push(1, np.ones((1, 1), np.float32))) == 0


# ---- what is refused, and that it changes nothing ----


def spoiled(frame: LumaFrame, value: float) -> LumaFrame:
    """A copy with a bad value at (x, y) = (1, 2) and another further on, where the error need not look."""
    bad = frame.copy()
    bad[2, 1] = bad[3, 2] = value
    return bad


@pytest.mark.parametrize("good_frames", [0, 1, 3])
def test_a_refused_frame_leaves_the_engine_as_it_was(good_frames: int) -> None:
    """After any refusal the next good frame gives what it would have given, for the first frame and for later ones."""
    frames = np.exp(paths(12, 6)).astype(np.float32).reshape(6, 4, 3)
    engine, untroubled = CrossingEngine(3, 4), CrossingEngine(3, 4)
    for i in range(good_frames):
        engine.push(100 + i, frames[i])
        untroubled.push(100 + i, frames[i])
    good, pixel = frames[5], r"pixel \(x, y\) = \(1, 2\) of the frame at t = 500 us"
    for value, shown in ((np.nan, "NaN"), (np.inf, "inf"), (-np.inf, "-inf"), (-1e-30, "-")):
        with pytest.raises(ValueError, match=rf"luma must be finite and >= 0, got {shown}.* at {pixel}"):
            engine.push(500, spoiled(good, value))
    for value in (np.nan, np.inf, -np.inf, 746.5, -1e300):
        with pytest.raises(ValueError, match=rf"log intensity must lie within \+-746, got .* at {pixel}"):
            engine.push_log(500, spoiled(good, 0).astype(np.float64) + np.where(good == spoiled(good, 0), 0, value))
    for wrong in (good.T, good[None], good.ravel(), good[:, :2], np.zeros((0, 0), np.float32)):
        with pytest.raises(ValueError, match=r"must have shape \(4, 3\), got"):
            engine.push(500, wrong)
    for dtype in (np.uint8, np.int64, np.float16, np.complex64, np.bool_, object):
        with pytest.raises(ValueError, match="must be float32 or float64, got"):
            engine.push(500, good.astype(dtype))
    with pytest.raises(ValueError, match="must be a NumPy array, got"):
        engine.push(500, good.tolist())
    for late in {-1, *(() if good_frames == 0 else (100, 100 + good_frames - 1))}:
        with pytest.raises(ValueError, match=rf"got {late} us"):
            engine.push(late, good)
    assert engine.reference.tobytes() == untroubled.reference.tobytes()
    assert engine.last_event_us.tobytes() == untroubled.last_event_us.tobytes()
    for i in range(good_frames, 6):
        assert engine.push(100 + i, frames[i]).tobytes() == untroubled.push(100 + i, frames[i]).tobytes()


def test_times_must_increase_and_the_error_tells_both() -> None:
    """A frame at or before the last one is refused, with both times."""
    engine = CrossingEngine(1, 1)
    frame = np.ones((1, 1), np.float32)
    engine.push(1_000, frame)
    for t_us in (1_000, 999, 0):
        with pytest.raises(ValueError, match=rf"must be after the last one \(1000 us\), got {t_us} us"):
            engine.push(t_us, frame)
    with pytest.raises(ValueError, match=r"less than 2\^53 us apart, got 1000 us and 9007199254741992 us"):
        engine.push((1 << 53) + 1_000, frame)
    engine.push((1 << 53) + 999, frame)


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"contrast_threshold": 0.0}, "contrast_threshold must lie in"),
        ({"contrast_threshold": -0.15}, "contrast_threshold must lie in"),
        ({"contrast_threshold": math.nan}, "contrast_threshold must lie in"),
        ({"contrast_threshold": math.inf}, "contrast_threshold must lie in"),
        ({"contrast_threshold_off": 0.0}, "contrast_threshold_off must lie in"),
        ({"contrast_threshold_off": math.nan}, "contrast_threshold_off must lie in"),
        ({"log_eps": 0.0}, "log_eps"),
        ({"log_eps": -1e-3}, "log_eps"),
        ({"log_eps": math.nan}, "log_eps"),
        ({"log_eps": math.inf}, "log_eps"),
        ({"log_eps": 1e-301}, "log_eps"),
        ({"threads": 0}, "threads must be at least 1"),
        ({"width": 0}, "at least one pixel, got 0 x 2"),
        ({"height": 0}, "at least one pixel, got 3 x 0"),
    ],
)
def test_parameters_out_of_range_are_refused(arguments: dict[str, Any], rule: str) -> None:
    """A ValueError that names the parameter."""
    with pytest.raises(ValueError, match=rule):
        CrossingEngine(**{"width": 3, "height": 2, **arguments})


def test_parameters_are_keywords_and_c_off_is_c_on_unless_given() -> None:
    """Thresholds cannot be swapped by position, and None means a symmetric pixel."""
    with pytest.raises(TypeError, match="positional"):
        CrossingEngine(3, 2, 0.15)  # type: ignore[call-arg]
    symmetric = CrossingEngine(1, 1, contrast_threshold=0.25)
    symmetric.push_log(0, np.zeros((1, 1)))
    assert symmetric.push_log(4, np.full((1, 1), -1.0))["t"].tolist() == [1, 2, 3, 4]


def test_reconstruct_refuses_what_it_cannot_place() -> None:
    """An event outside of the frame and thresholds out of range are errors; events after t_us are not looked at."""
    events = np.array([(10, 1, 0, 1), (20, 2, 0, 1)], EVENT_DTYPE)
    first = np.zeros((1, 2))
    np.testing.assert_array_equal(reconstruct(events, first, 10, 0.5), [[0.0, 0.5]])
    with pytest.raises(ValueError, match=r"event 1 at \(x, y\) = \(2, 0\) lies outside of the 2 x 1 sensor"):
        reconstruct(events, first, 20, 0.5)
    with pytest.raises(ValueError, match="contrast_threshold_off must lie in"):
        reconstruct(events, first, 20, 0.5, 0.0)
    with pytest.raises(ValueError, match="must have shape"):
        reconstruct(events, np.zeros(2), 20, 0.5)


# ---- hard cases ----


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


def test_a_slow_ramp_of_205_000_frames_misses_nothing() -> None:
    """1e-9 a frame under C = 1e-4: two levels up, two down, each at its exact tick, whatever the base.

    205,000 steps far below any tolerance, where L, R and the tick come from sums and quotients that all round.
    """
    frames, gap_us, c, step = 205_000, 1_000, 1e-4, 1e-9
    bases = np.array([0.0, -6.9, 13.8, 0.0, -6.9, 13.8])
    slopes = np.array([step, step, step, -step, -step, -step])
    engine = CrossingEngine(6, 1, contrast_threshold=c, threads=1)
    samples = np.array([bases + slopes * k for k in range(frames)])
    packets = [engine.push_log(k * gap_us, row[None, :]) for k, row in enumerate(samples)]
    found = np.concatenate([packet for packet in packets if len(packet)])
    for x, (base, slope) in enumerate(zip(bases, slopes, strict=True)):
        expected = []
        for n in (1, 2):
            level = Fraction(base) + int(np.sign(slope)) * n * Fraction(c)
            towards = 1 if slope > 0 else -1
            # Every sample is base + slope k rounded, so that the level lies within an ulp of its place in the list.
            near = round((level - Fraction(base)) / Fraction(slope))
            k = next(k for k in range(near - 3, near + 4) if towards * (Fraction(samples[k, x]) - level) >= 0)
            before, after = Fraction(samples[k - 1, x]), Fraction(samples[k, x])
            expected.append((k - 1) * gap_us + math.ceil((level - before) / (after - before) * gap_us))
        assert found[found["x"] == x]["t"].tolist() == expected
        assert set(found[found["x"] == x]["p"].tolist()) == {int(slope > 0)}


def test_20_000_frames_are_the_same_from_zero_an_hour_and_the_unix_epoch() -> None:
    """20 s at 1 kHz that start at 0, 1e9 us and 1.7e15 us: identical events, shifted."""
    luma = np.exp(np.sin(np.arange(20_000) * 0.37) + np.sin(np.arange(20_000) * 0.011)).astype(np.float32)

    def run(start_us: int) -> EventArray:
        engine = CrossingEngine(1, 1, contrast_threshold=0.07, contrast_threshold_off=0.09, threads=1)
        return np.concatenate([engine.push(start_us + k * 1_000, y.reshape(1, 1)) for k, y in enumerate(luma)])

    events = run(0)
    assert len(events) > 10_000
    for start_us in (1_000_000_000, EPOCH_US):
        shifted = run(start_us)
        shifted["t"] -= start_us
        np.testing.assert_array_equal(shifted, events)
