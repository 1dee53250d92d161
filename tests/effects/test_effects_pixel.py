"""Effects inside the pixel: thresholds that differ, the refractory period, and the leak of the reference."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from davis_rs import CrossingEngine, Effects, log_intensity
from davis_rs.events.arrays import EventArray
from davis_rs.sensor.effects import LeakRate, ThresholdMismatch
from effects_reference import FIRST, collect, constant_corner, leaky_pixel, may_be_tick, of_pixel, scene
from strategies import EPOCH_US, EXAMPLES, random_paths

UNLIKELY = 1e-6
"""The significance of every statistical test here; seeds are fixed."""

HOUR_US = 3_600_000_000


def log_paths(frames: int, height: int, width: int) -> npt.NDArray[np.float64]:
    """Random walks of log intensity with jumps, (frames, height, width)."""
    return random_paths(height * width, frames).reshape(frames, height, width)


def run(engine: CrossingEngine, frames: npt.NDArray[np.float64], gap_us: int = 1_000) -> EventArray:
    return collect(engine.push_log(k * gap_us, frame) for k, frame in enumerate(frames))


@pytest.mark.parametrize("past", [0.0, 1e-12, 1e-10, 2e-9])
@pytest.mark.parametrize(("level", "polarity"), [(0.25, 1), (-0.5, 0)])
def test_a_frame_that_ends_on_a_level_is_not_taken_for_quiet(past: float, level: float, polarity: int) -> None:
    """The bounds within which pixels are passed over lie inside of their levels, for ON and OFF events alike."""
    effects = Effects(refractory_period_us=1e-3)
    engine = CrossingEngine(1, 1, contrast_threshold=0.25, contrast_threshold_off=0.5, effects=effects)
    end = np.full((1, 1, 1), level + math.copysign(past, level))
    events = run(engine, np.concatenate([np.zeros((1, 1, 1)), end]))
    assert events.tolist() == [(1_000, 0, 0, polarity)]


# Threshold mismatch.


def mismatched(sigma: float, *, seed: int = 0, c_on: Any = 0.2, c_off: Any = 0.3, size: int = 200) -> CrossingEngine:
    effects = Effects(threshold_mismatch=sigma)
    return CrossingEngine(size, size, contrast_threshold=c_on, contrast_threshold_off=c_off, effects=effects, seed=seed)


@pytest.mark.parametrize("sigma", [0.03, 0.14, 0.5, 1.0])
def test_thresholds_have_the_nominal_mean_and_the_given_sigma(sigma: float) -> None:
    """Both of 40,000 pixels: log-normal (Kolmogorov and Smirnov, 1e-6), all positive, mean within five standard errors.

    And not correlated, neither ON with OFF nor with the neighbours'.
    """
    engine = mismatched(sigma)
    on, off = engine.contrast_threshold / 0.2, engine.contrast_threshold_off / 0.3
    variance = math.log1p(sigma**2)
    normal = []
    for factor in (on, off):
        assert isinstance(factor, np.ndarray)
        assert factor.shape == (200, 200)
        assert factor.min() > 0
        assert factor.mean() == pytest.approx(1.0, abs=5 * sigma / 200)
        normal.append((np.log(factor) + variance / 2) / math.sqrt(variance))
        assert stats.kstest(normal[-1].ravel(), "norm").pvalue > UNLIKELY
    pairs = [(normal[0], normal[1]), (normal[0][:, 1:], normal[0][:, :-1]), (normal[1][1:], normal[1][:-1])]
    for a, b in pairs:
        assert stats.pearsonr(a.ravel(), b.ravel()).pvalue > UNLIKELY


def test_thresholds_are_a_fixed_pattern_for_a_seed() -> None:
    """The same for a seed whatever the sensor is fed with, another for another seed, and never redrawn."""
    first, again, other = mismatched(0.2, size=8), mismatched(0.2, size=8), mismatched(0.2, size=8, seed=1)
    drawn = np.array(first.contrast_threshold), np.array(first.contrast_threshold_off)
    for k, frame in enumerate(log_paths(50, 8, 8)):
        first.push_log(k * 1_000, frame)
    for on, off in ((first.contrast_threshold, first.contrast_threshold_off), (again.contrast_threshold, drawn[1])):
        np.testing.assert_array_equal(on, drawn[0])
        np.testing.assert_array_equal(off, drawn[1])
    assert not np.any(other.contrast_threshold == drawn[0])
    # Neither does the pattern depend on sigma, but for its scale.
    wide = mismatched(0.4, size=8).contrast_threshold
    assert stats.spearmanr(np.ravel(wide), drawn[0].ravel()).statistic == pytest.approx(1.0)


def test_columns_differ_alternately_and_columns_and_rows_each_from_the_others() -> None:
    """Each part by itself: the pattern, its moments, and that ON and OFF have it in common."""
    size = 1000

    def thresholds(**parts: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        effects = Effects(threshold_mismatch=ThresholdMismatch(0.0, **parts))
        engine = CrossingEngine(size, size, contrast_threshold=0.2, contrast_threshold_off=0.3, effects=effects)
        return np.asarray(engine.contrast_threshold) / 0.2, np.asarray(engine.contrast_threshold_off) / 0.3

    on, off = thresholds(column_parity=0.06)
    np.testing.assert_allclose(on, np.where(np.arange(size) % 2 == 0, 0.94, 1.06) * np.ones((size, 1)), rtol=1e-12)
    np.testing.assert_allclose(off, on, rtol=1e-12)
    for part, line in (("columns", np.s_[0]), ("rows", np.s_[:, 0])):
        on, off = thresholds(**{part: 0.1})
        np.testing.assert_allclose(off, on, rtol=1e-12)
        along, deviation = on[line], math.sqrt(math.log1p(0.01))
        np.testing.assert_array_equal(on, np.broadcast_to(along if part == "columns" else along[:, None], on.shape))
        assert stats.kstest(np.log(along) / deviation + deviation / 2, "norm").pvalue > UNLIKELY
        assert stats.pearsonr(along[1:], along[:-1]).pvalue > UNLIKELY
    assert Effects(threshold_mismatch=ThresholdMismatch(0.0, columns=0.1)).threshold_mismatch is not None


@pytest.mark.parametrize("correlation", [-1.0, -0.4, 0.0, 0.6, 1.0])
def test_on_and_off_thresholds_may_be_correlated(correlation: float) -> None:
    """Each keeps its law, and those of ON are what they are without it; at 0 so are those of OFF."""

    def thresholds(**parts: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        engine = CrossingEngine(200, 200, effects=Effects(threshold_mismatch=ThresholdMismatch(0.1, **parts)))
        return np.log(engine.contrast_threshold).ravel(), np.log(engine.contrast_threshold_off).ravel()

    (on, off), (alone, other) = thresholds(correlation=correlation), thresholds()
    np.testing.assert_array_equal(on, alone)
    assert np.array_equal(off, other) == (correlation == 0)
    assert off.std() == pytest.approx(other.std(), rel=5 / 200)
    assert stats.pearsonr(on, off).statistic == pytest.approx(correlation, abs=5 / 200)


@pytest.mark.long
def test_even_and_odd_columns_have_events_by_their_parity() -> None:
    """With the davis240c preset's parity 1.127 times as many in even columns where light goes far, as recorded."""
    effects = Effects(threshold_mismatch=ThresholdMismatch(0.1085, 0.06))
    engine = CrossingEngine(240, 180, contrast_threshold=0.283, effects=effects)
    far = np.random.default_rng(1).uniform(10, 20, (180, 240))
    frames = [(k % 2) * far for k in range(5)]
    events = collect(engine.push_log(k * 1_000, frame) for k, frame in enumerate(frames))
    for p in (0, 1):
        even = (events["x"][events["p"] == p] % 2 == 0).mean()
        assert even / (1 - even) == pytest.approx(1.127, rel=0.01)


@pytest.mark.parametrize("sigma", [0.1, 0.5])
@pytest.mark.parametrize("per_pixel", [False, True])
def test_events_are_those_of_an_engine_with_the_drawn_thresholds(sigma: float, per_pixel: bool) -> None:
    """Byte by byte; nominal thresholds of each pixel are each multiplied by its factor."""
    nominal = np.geomspace(0.05, 0.5, 96).reshape(8, 12) if per_pixel else 0.2
    effects = Effects(threshold_mismatch=sigma)
    engine = CrossingEngine(12, 8, contrast_threshold=nominal, contrast_threshold_off=0.3, effects=effects, seed=4)
    plain = CrossingEngine(
        12,
        8,
        contrast_threshold=engine.contrast_threshold,
        contrast_threshold_off=engine.contrast_threshold_off,
    )
    flat = CrossingEngine(12, 8, contrast_threshold=1.0, contrast_threshold_off=1.0, effects=effects, seed=4)
    np.testing.assert_allclose(engine.contrast_threshold, nominal * flat.contrast_threshold, rtol=1e-15)
    np.testing.assert_allclose(engine.contrast_threshold_off, 0.3 * flat.contrast_threshold_off, rtol=1e-15)
    frames = log_paths(40, 8, 12)
    events = run(engine, frames)
    assert events.tobytes() == run(plain, frames).tobytes()
    assert len(events) > 1_000


# Refractory period.


def refractory(period_us: float, **settings: Any) -> CrossingEngine:
    return CrossingEngine(1, 1, effects=Effects(refractory_period_us=period_us), **settings)


@EXAMPLES
@given(
    st.integers(1, 1023),
    st.booleans(),
    st.floats(0.01, 1.0),
    st.one_of(st.integers(1, 5_000).map(float), st.floats(0.001, 3_000)),
    st.lists(st.one_of(st.integers(1, 50), st.integers(1, 40_000)), min_size=1, max_size=40),
    st.sampled_from([0, 12, EPOCH_US]),
)
def test_on_a_ramp_the_interval_is_the_threshold_over_the_slope_plus_the_period(
    slope: int, rises: bool, c: float, period_us: float, gaps: list[int], start_us: int
) -> None:
    """C / s + T, exactly: over any frames, up and down, with holds that end between ticks or frames later."""
    per_us = Fraction(slope, 2**17) * (1 if rises else -1)  # so that all samples are exact
    engine = refractory(period_us, contrast_threshold=c)
    elapsed = [0, *np.cumsum(gaps).tolist()]
    engine.push_log(start_us, scene(0))
    events = collect(engine.push_log(start_us + t, scene(float(per_us * t))) for t in elapsed[1:])
    climb, period = Fraction(c) / abs(per_us), Fraction(period_us)
    last = Fraction(elapsed[-1])
    expected = [(k + 1) * climb + k * period for k in range(int((last + period) / (climb + period)) + 1)]
    expected = [at for at in expected if at <= last]
    assert len(events) == len(expected)
    assert all(events["p"] == int(rises))
    for stamp, at in zip((events["t"] - start_us).tolist(), expected, strict=True):
        assert may_be_tick(stamp, at), f"stamp {stamp}, crossing at {float(at)}"
    held = bool(expected) and expected[-1] + period > last
    memorised = Fraction(0) if not expected else per_us * (expected[-1] + period)
    reference = engine.reference[0, 0]
    assert math.isnan(reference) if held else abs(reference - float(memorised)) < 1e-12 + float(abs(per_us)) * FIRST


@pytest.mark.parametrize("period_us", [40.0, 0.5, 12.75])
@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_stamps_are_exact_where_all_numbers_are(period_us: float, interpolation: str) -> None:
    """C, s and T of few bits: every stamp is the first tick at or after k (C / s + T) - T, without a doubt."""
    engine = refractory(period_us, contrast_threshold=0.125, interpolation=interpolation)
    slope = 2.0**-10
    frames = [(t, scene(t * slope), scene(slope * 1e6)) for t in range(0, 50_001, 250)]
    packets = [engine.push_log(*(frame if interpolation == "hermite" else frame[:2])) for frame in frames]
    interval = Fraction(128) + Fraction(period_us)
    expected = [math.ceil(k * interval - Fraction(period_us)) for k in range(1, 50_000 // int(interval) + 2)]
    assert collect(packets)["t"].tolist() == [t for t in expected if t <= 50_000]


@pytest.mark.parametrize("gap_us", [50, 1_000, 1_000_000])
def test_on_a_parabola_each_interval_starts_where_the_hold_ended(gap_us: int) -> None:
    """L = a t^2 as Hermite cubics: u' = sqrt((u + T)^2 + C / a), whatever the frames."""
    a, c, period_us, end_us = 2.0**-36, 0.25, 700.3, 1_000_000
    engine = refractory(period_us, contrast_threshold=c, interpolation="hermite")
    times = range(0, end_us + 1, gap_us)
    events = collect(engine.push_log(t, scene(a * t * t), scene(2e6 * a * t)) for t in times)
    expected = [math.sqrt(c / a)]
    while expected[-1] <= end_us:
        expected.append(math.sqrt((expected[-1] + period_us) ** 2 + c / a))
    assert len(events) == len(expected) - 1 > 40
    assert all(may_be_tick(stamp, at) for stamp, at in zip(events["t"].tolist(), expected, strict=False))


@pytest.mark.parametrize("short_of_top", [0.1, 1e-3, 1e-5, 1e-8])
def test_a_hold_near_a_turn_ends_when_it_should(short_of_top: float) -> None:
    """A parabola up to 1/4 and back in a second, whose ON level lies just below its top: s = (1 - sqrt(d)) / 2 there.

    OFF events follow, at b - C with b memorised at each release, all in closed form.
    """
    c_off, period_us = 0.01, 100_000.0
    c_on = 0.25 * (1 - short_of_top)
    engine = refractory(period_us, contrast_threshold=c_on, contrast_threshold_off=c_off, interpolation="hermite")
    engine.push_log(0, scene(0), scene(1))
    events = engine.push_log(1_000_000, scene(0), scene(-1))

    def after(s: float) -> float:
        """When the curve s - s^2 lies C_off below its value at s."""
        return (1 + math.sqrt((1 - 2 * s) ** 2 + 4 * c_off)) / 2

    first = (1 - math.sqrt(1 - 4 * c_on)) / 2
    expected = [first]
    while expected[-1] <= 1:
        expected.append(after(expected[-1] + 0.1))
    assert events["p"].tolist() == [1] + [0] * (len(expected) - 2)
    for stamp, s in zip(events["t"].tolist(), expected, strict=False):
        assert may_be_tick(stamp, 1e6 * s, 1e-3), f"stamp {stamp}, crossing at {1e6 * s}"


@pytest.mark.parametrize("time_constants", [1.0, 30.0, 500.0])
def test_a_hold_behind_a_low_pass_ends_when_it_should(time_constants: float) -> None:
    """After a step what is missing falls as exp(-t / tau): to C less at each event, then on for T, in closed form."""
    second_us, c, period_us = 1_000_000, 0.07, 500.0
    tau_us = second_us / time_constants
    effects = Effects(
        refractory_period_us=period_us, photoreceptor_bandwidth_hz=constant_corner(1e6 / (2 * math.pi * tau_us))
    )
    engine = CrossingEngine(1, 1, contrast_threshold=c, effects=effects)
    packets = [engine.push_log(t, scene(t > 0)) for t in (0, 1, 1 + second_us, 1 + 2 * second_us)]
    missing = (1 - math.exp(-1 / tau_us)) * tau_us  # after a ramp of 1 us
    now, wanted, expected = 1.0, 1 - c, []
    while wanted > 0:
        now += tau_us * math.log(missing / wanted)
        expected.append(now)
        now += period_us
        missing = wanted * math.exp(-period_us / tau_us)
        wanted = missing - c
    expected = [at for at in expected if at <= 1 + 2 * second_us]
    events = collect(packets)
    assert len(events) == len(expected) > 3
    for stamp, at in zip(events["t"].tolist(), expected, strict=True):
        assert may_be_tick(stamp, at, 1e-3), f"stamp {stamp}, crossing at {at}"


def test_what_happens_while_a_pixel_is_held_is_lost() -> None:
    """A flash within the hold makes no event, and none after: the reference is what the pixel sees at the end."""
    engine = refractory(1_000.0, contrast_threshold=0.5)
    engine.push_log(0, scene(0))
    assert engine.push_log(100, scene(0.6))["t"].tolist() == [84]
    assert math.isnan(engine.reference[0, 0])
    for t, value in ((300, 5.0), (700, 5.0), (900, 0.7)):
        assert len(engine.push_log(t, scene(value))) == 0
        assert math.isnan(engine.reference[0, 0])
    # Released at 83.3 + 1000, on the way from 0.7 to 1.0: at 0.7 + 0.3 (1083.3 - 900) / 300.
    assert len(engine.push_log(1_200, scene(1.0))) == 0
    assert engine.reference[0, 0] == pytest.approx(0.7 + 0.3 * (250 / 3 + 1_000 - 900) / 300, abs=1e-12)
    assert engine.last_event_us[0, 0] == 84


def test_a_period_longer_than_the_recording_leaves_one_event_a_pixel() -> None:
    """The first that the ideal pixel has; from then on all are held."""
    frames = log_paths(60, 8, 8)
    ideal = run(CrossingEngine(8, 8), frames)
    engine = CrossingEngine(8, 8, effects=Effects(refractory_period_us=1e15))
    events = run(engine, frames)
    _, first = np.unique(ideal["y"].astype(int) * 8 + ideal["x"], return_index=True)
    np.testing.assert_array_equal(events, ideal[np.sort(first)])
    fired = np.zeros((8, 8), bool)
    fired[events["y"], events["x"]] = True
    assert fired.sum() > 32
    np.testing.assert_array_equal(np.isnan(engine.reference), fired)


# Leak.


def leaking(
    rate_hz: float, *, c_on: float = 0.2, c_off: float = 0.2, side: int = 8, start_phase: str = "stationary"
) -> CrossingEngine:
    return CrossingEngine(
        side,
        side,
        contrast_threshold=c_on,
        contrast_threshold_off=c_off,
        effects=Effects(leak_rate_hz=LeakRate(rate_hz, spread=0, jitter=0)),
        start_phase=start_phase,
    )


@pytest.mark.few(3)
@pytest.mark.parametrize("rate_hz", [0.1, 0.37, 7.0])
@pytest.mark.parametrize("luma", [0.0, 0.4])
@pytest.mark.parametrize(("start_phase", "c_off"), [("zero", 0.2), ("stationary", 0.2), ("stationary", 0.05)])
def test_a_static_scene_for_an_hour_makes_events_at_the_rate(
    rate_hz: float, luma: float, start_phase: str, c_off: float
) -> None:
    """ON alone, 1 / rate apart in each pixel, and the first when all of the way to the ON level has leaked.

    That takes 1 / rate where the reference begins at the signal. A black scene leaks, too. Frames come irregularly,
    from a microsecond to minutes apart.
    """
    engine = leaking(rate_hz, c_off=c_off, side=4, start_phase=start_phase)
    end_us = HOUR_US + 12_345  # not at an event
    times = np.unique(np.concatenate([[0, 1, 2, end_us], np.random.default_rng(2).integers(0, HOUR_US, 500)]))
    frame = np.full((4, 4), luma, np.float32)
    engine.push(0, frame)
    phase = (log_intensity(frame, 1e-3) - engine.reference) / 0.2
    events = collect(engine.push(int(t), frame) for t in times[1:])
    assert all(events["p"] == 1)
    for y, x in np.ndindex(4, 4):
        own = of_pixel(events, x, y)["t"]
        expected = (np.arange(len(own)) + 1 - phase[y, x]) * (1e6 / rate_hz)
        assert np.abs(own - expected).max() <= 1
        assert len(own) == math.floor(end_us * 1e-6 * rate_hz + phase[y, x])
    in_step = 16 if start_phase == "zero" else 1
    assert len(np.unique(events["t"])) == len(events) / in_step


def test_an_hour_in_one_interval_is_an_hour_in_many() -> None:
    """The drift is a function of time: the same events but for a tick, the same reference but for rounding."""
    whole, parts = leaking(3.0), leaking(3.0)
    for engine in (whole, parts):
        engine.push_log(0, scene(0, 8, 8))
    one = whole.push_log(HOUR_US, scene(0, 8, 8))
    many = collect(parts.push_log(int(t), scene(0, 8, 8)) for t in np.linspace(0, HOUR_US, 777).astype(np.int64)[1:])
    for y, x in np.ndindex(8, 8):
        a, b = of_pixel(one, x, y)["t"], of_pixel(many, x, y)["t"]
        assert len(a) == len(b)
        assert np.abs(a - b).max() <= 1
    assert (one["t"] != many["t"]).mean() < 1e-3
    np.testing.assert_allclose(whole.reference, parts.reference, rtol=0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("rate_hz", [0.1, 50.0])
def test_no_pixel_is_muted_after_an_hour_of_leaking(rate_hz: float) -> None:
    """A step up then has an event for each threshold between the leaked reference and its top, and down likewise."""
    engine = leaking(rate_hz, c_on=0.2, c_off=0.13)
    engine.push_log(0, scene(0, 8, 8))
    engine.push_log(HOUR_US, scene(0, 8, 8))
    now, t_us = 0.0, HOUR_US
    for step in (2.1, -3.05, 0.7):
        reference = engine.reference
        assert np.all((now - reference >= 0.2 - 1e-6) <= (step < 0))
        now, t_us = now + step, t_us + 10
        events = engine.push_log(t_us, scene(now, 8, 8))
        missing = now - reference + 10e-6 * rate_hz * 0.2  # which leaks on the way
        expected = np.floor(np.where(missing > 0, missing / 0.2, -missing / 0.13)).astype(int)
        counts = np.zeros((8, 8), int)
        np.add.at(counts, (events["y"], events["x"]), 1)
        np.testing.assert_array_equal(counts, expected)
        assert set(events["p"].tolist()) == {int(step > 0)}


def test_a_leak_that_could_overflow_the_counters_is_refused() -> None:
    """The interval's own share of 2^32 events counts before it is run, and the engine stays as it was."""
    engine = leaking(1e5, side=1)
    engine.push_log(0, scene(0))
    state = engine.state()
    state["on"][:] = state["off"][:] = 2**32 - 60_000
    engine = CrossingEngine.from_state(state)
    assert len(engine.push_log(100_000, scene(0))) in (9_999, 10_000)
    with pytest.raises(ValueError, match="2\\^32 - 1 that it can count"):
        engine.push_log(1_100_000, scene(0))
    assert engine.state()["t_us"] == 100_000


@pytest.mark.parametrize("slope", [-0.5, -0.1, 0.3, 2.0])
def test_leak_and_signal_add_up(slope: float) -> None:
    """On a ramp of s per second events come at (s + rate C_on) / C: a bright ramp sooner, a dark one later or not."""
    rate_hz, c_on, c_off = 1.0, 0.2, 0.15
    engine = leaking(rate_hz, c_on=c_on, c_off=c_off, side=4)
    engine.push_log(0, scene(0, 4, 4))
    phase = -engine.reference / c_on
    events = engine.push_log(60_000_000, scene(60 * slope, 4, 4))
    drift = slope + rate_hz * c_on
    assert set(events["p"].tolist()) == {int(drift > 0)}
    for y, x in np.ndindex(4, 4):
        own = of_pixel(events, x, y)["t"].tolist()
        first = (1 - phase[y, x]) * c_on if drift > 0 else c_off + phase[y, x] * c_on
        for k, stamp in enumerate(own):
            assert may_be_tick(stamp, (first + k * (c_on if drift > 0 else c_off)) / abs(drift) * 1e6)
        assert len(own) == math.floor((60 * abs(drift) - first) / (c_on if drift > 0 else c_off)) + 1


def test_a_leak_between_two_hermite_samples_turns_with_the_curve() -> None:
    """The signal's rise and the leak's make one curve: where it turns back within an interval, its top counts.

    Events are those of 10,000 lines along the cubic, within what these are off.
    """
    c, slopes, change = 0.02, (0.8, -1.3), -0.1
    coarse, fine = (
        CrossingEngine(
            4,
            4,
            contrast_threshold=c,
            interpolation=interpolation,
            effects=Effects(leak_rate_hz=LeakRate(6.0, jitter=0)),  # whose draws a tick would change
            start_phase="stationary",
        )
        for interpolation in ("hermite", "linear")
    )
    coarse.push_log(0, scene(0, 4, 4), scene(slopes[0], 4, 4))
    events = coarse.push_log(1_000_000, scene(change, 4, 4), scene(slopes[1], 4, 4))
    s = np.linspace(0, 1, 10_001)
    cubic = s * (slopes[0] + s * (3 * change - 2 * slopes[0] - slopes[1] + s * (sum(slopes) - 2 * change)))
    lines = collect(fine.push_log(round(at * 1e6), scene(value, 4, 4)) for at, value in zip(s, cubic, strict=True))
    assert set(events["p"].tolist()) == {0, 1}
    for y, x in np.ndindex(4, 4):
        own, expected = of_pixel(events, x, y), of_pixel(lines, x, y)
        assert own["p"].tolist() == expected["p"].tolist()
        assert np.abs(own["t"] - expected["t"]).max() <= 30


def test_leak_and_refractory_period_make_longer_intervals() -> None:
    """On a static scene each pixel's events are 1 / rate + T apart."""
    effects = Effects(leak_rate_hz=LeakRate(100.0, spread=0, jitter=0), refractory_period_us=2_500.5)
    engine = CrossingEngine(4, 4, effects=effects)
    events = collect(engine.push_log(t, scene(0, 4, 4)) for t in range(0, 10_000_001, 7_777))
    for y, x in np.ndindex(4, 4):
        own = of_pixel(events, x, y)["t"]
        assert np.abs(own - (own[0] + np.arange(len(own)) * 12_500.5)).max() <= 1
        assert len(own) >= 799


def static_leak(leak: LeakRate, seconds: int, *, luma: float = 0.0, side: int = 64, **settings: Any) -> Any:
    """Stamps of a static scene's events, pixel by pixel."""
    effects = Effects(leak_rate_hz=leak)
    engine = CrossingEngine(side, side, contrast_threshold=0.2, log_eps=1e-9, effects=effects, **settings)
    events = collect(engine.push(t * 1_000_000, np.full((side, side), luma, np.float32)) for t in (0, seconds))
    assert all(events["p"] == 1)
    order = np.lexsort((events["t"], events["x"], events["y"]))
    places = events["y"][order].astype(int) * side + events["x"][order]
    return np.split(events["t"][order].astype(float), np.flatnonzero(np.diff(places)) + 1)


@pytest.mark.few(1)
@pytest.mark.parametrize("spread", [0.1, 0.23, 0.8])
def test_each_pixel_leaks_at_a_rate_of_its_own(spread: float) -> None:
    """Log-normal (Kolmogorov and Smirnov, 1e-6), the mean of all is the rate, neighbours do not correlate."""
    stamps = static_leak(LeakRate(10.0, spread=spread, jitter=0), 60)
    assert len(stamps) == 4096
    rates = np.array([(len(own) - 1) / (own[-1] - own[0]) * 1e6 for own in stamps])
    assert rates.mean() == pytest.approx(10.0, abs=5 * 10 * spread / 64)
    deviation = math.sqrt(math.log1p(spread**2))
    scaled = (np.log(rates / 10) + deviation**2 / 2) / deviation
    assert stats.kstest(scaled, "norm").pvalue > UNLIKELY
    assert stats.pearsonr(scaled[1:], scaled[:-1]).pvalue > UNLIKELY
    assert all(np.abs(np.diff(own) - np.diff(own).mean()).max() <= 1.001 for own in stamps)


@pytest.mark.few(2)
@pytest.mark.parametrize("jitter", [0.02, 0.1, 0.25])
@pytest.mark.parametrize("period_us", [None, 1_000.0])
def test_intervals_of_a_leak_jitter(jitter: float, period_us: float | None) -> None:
    """Normal with this share of their mean (KS, 1e-6), cut off at a half, each by itself; T comes on top."""
    effects = Effects(leak_rate_hz=LeakRate(10.0, spread=0, jitter=jitter), refractory_period_us=period_us)
    engine = CrossingEngine(32, 32, contrast_threshold=0.2, effects=effects)
    events = collect(engine.push_log(t, scene(0, 32, 32)) for t in (0, 12_345_678, 30_000_000))
    events = events[np.lexsort((events["t"], events["x"], events["y"]))]
    waits = np.concatenate([np.diff(of_pixel(events, x, y)["t"])[:250] for y, x in np.ndindex(8, 32)]).reshape(256, -1)
    since, waits = waits, waits - (period_us or 0.0)
    # What is uncertain is what has leaked since the event before, and that is an interval that jittered, too.
    share = (waits[:, 1:] - 1e5) / since[:, :-1]
    inside = np.abs(share) < 0.45
    assert inside.mean() > (0.999 if jitter < 0.2 else 0.9)
    if jitter < 0.2:
        assert stats.kstest(share.ravel() / jitter, "norm").pvalue > UNLIKELY
        assert waits.std() == pytest.approx(1e5 * jitter, rel=0.03)
    assert waits.mean() == pytest.approx(1e5, rel=0.01)
    assert stats.pearsonr(share[:, 1:].ravel(), share[:, :-1].ravel()).pvalue > UNLIKELY


@pytest.mark.parametrize(("temperature_c", "factor"), [(25.0, 1.0), (33.0, 2.0), (9.0, 0.25), (65.0, 32.0)])
@pytest.mark.parametrize("luma", [0.0, 0.1, 2.0])
def test_a_leak_doubles_with_warmth_and_with_light(temperature_c: float, factor: float, luma: float) -> None:
    """Light's part does not depend on temperature; the plan's formula is the same."""
    leak = LeakRate(2.0, spread=0, jitter=0, temperature_c=temperature_c, double_luma=0.5)
    stamps = static_leak(leak, 60, luma=luma, side=16)
    expected = 2.0 * (factor + luma / 0.5)
    rates = [(len(own) - 1) / (own[-1] - own[0]) * 1e6 for own in stamps]
    np.testing.assert_allclose(rates, expected, rtol=1e-6)
    assert leak.mean_rate_hz(luma) == pytest.approx(expected)


def test_a_leak_by_light_follows_light_and_is_kept_in_a_state() -> None:
    """Luma that runs straight between frames: what has leaked is the integral of the rate, to rounding."""
    leak = LeakRate(2.0, spread=0, jitter=0, double_luma=0.5)
    engine = CrossingEngine(4, 4, contrast_threshold=0.2, log_eps=1e-9, effects=Effects(leak_rate_hz=leak))
    lumas = np.random.default_rng(5).uniform(0.1, 2.0, 30).astype(np.float32)
    leaked, net, before = 0.0, np.zeros((4, 4)), None
    for k, luma in enumerate(lumas):
        events = engine.push(k * 500_000, np.full((4, 4), luma, np.float32))
        np.add.at(net, (events["y"], events["x"]), np.where(events["p"] == 1, 0.2, -0.2))
        if before is None:
            first = engine.reference.copy()
        else:
            leaked += 0.2 * 2.0 * 0.5 * (1 + (float(before) + float(luma) + 2e-9) / 2 / 0.5)
        np.testing.assert_allclose(engine.reference, first + net - leaked, rtol=0, atol=1e-9)
        before = luma
        engine = CrossingEngine.from_state(engine.state())
    assert leaked > 1
    assert np.all(net > 1)


@EXAMPLES
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 3.37, 4_000.5]),
    st.sampled_from([0.0, 0.1, 0.4]),
    st.sampled_from([0.0, 0.3]),
    st.sampled_from([math.inf, 0.7]),
    st.sampled_from(["zero", "stationary"]),
)
def test_events_are_those_of_a_pixel_that_leaks(
    seed: int, period_us: float, jitter: float, spread: float, double_luma: float, start_phase: str
) -> None:
    """Six pixels of a scene that moves slowly: each event of the oracle, its polarity and its tick."""
    leak = LeakRate(80.0, spread, jitter, 30.0, double_luma=double_luma)
    effects = Effects(leak_rate_hz=leak, refractory_period_us=period_us)
    c = (0.15, 0.1)
    engine = CrossingEngine(
        3,
        2,
        contrast_threshold=c[0],
        contrast_threshold_off=c[1],
        effects=effects,
        start_phase=start_phase,
        seed=seed,
    )
    frames = 0.1 * np.random.default_rng(seed).normal(size=(30, 2, 3)).cumsum(0)
    events = collect(engine.push_log(5 + k * 7_001, frame) for k, frame in enumerate(frames))
    for y, x in np.ndindex(2, 3):
        path = [(k * 7_001, float(frame[y, x])) for k, frame in enumerate(frames)]
        own = of_pixel(events, x, y)
        stamps = (own["t"] - 5).tolist()
        expected = leaky_pixel(
            path, leak, stamps, pixel=3 * y + x, seed=seed, c=c, period_us=period_us, start_phase=start_phase
        )
        assert own["p"].tolist() == [p for _, p in expected]
        assert all(may_be_tick(t, at, 1e-3) for t, (at, _) in zip(stamps, expected, strict=True))
