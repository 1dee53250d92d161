"""The photoreceptor's bandwidth: gain and phase, the corner's rule, and crossings of the filtered curve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from davis_rs import CrossingEngine, Effects, log_intensity
from davis_rs.effects import PhotoreceptorBandwidth
from davis_rs.events import EventArray
from effects_reference import Crossing, FilteredPixel, collect, constant_corner, corner_of, of_pixel, scene
from strategies import EPOCH_US, EXAMPLES

FloatArray = npt.NDArray[np.float64]
LOG_EPS = 1e-3


def behind(bandwidth: PhotoreceptorBandwidth | float) -> Effects:
    return Effects(photoreceptor_bandwidth_hz=bandwidth)


def levels(events: EventArray, base: float, c: float) -> FloatArray:
    """The level at which each event of a pixel fell."""
    levels: FloatArray = base + c * np.cumsum(np.where(events["p"] == 1, 1.0, -1.0))
    return levels


def assert_are(events: EventArray, crossings: list[Crossing]) -> None:
    """The same number, polarities and stamps, but for ticks that are in doubt."""
    assert events["p"].tolist() == [crossing.p for crossing in crossings]
    for stamp, crossing in zip(events["t"].tolist(), crossings, strict=True):
        assert crossing.may_have(stamp), f"stamp {stamp}, crossing at {float(crossing.t_us)!r}"


# The law.


@pytest.mark.parametrize("ratio", [0.1, 0.3, 1.0, 3.0, 10.0])
def test_gain_and_phase_of_a_sine_are_those_of_a_first_order_low_pass(ratio: float) -> None:
    """1 / sqrt(1 + r^2) and -atan(r) at r times the corner, both within 1 %: amplitude and phase by least squares."""
    corner_hz, samples = 1.0, 200
    w = 2 * math.pi * corner_hz * ratio * 1e-6
    gain, phase = 1 / math.sqrt(1 + ratio**2), -math.atan(ratio)
    c = gain / 40
    engine = CrossingEngine(1, 1, contrast_threshold=c, effects=behind(constant_corner(corner_hz)))
    settled_us, period_us = 3_000_000, 1e6 / (corner_hz * ratio)
    times = np.arange(0, settled_us + 2 * period_us, period_us / samples).round().astype(np.int64)
    events = collect(engine.push_log(int(t), scene(math.sin(w * t))) for t in times)
    level, kept = levels(events, 0.0, c), events["t"] > settled_us
    at = w * (events["t"][kept] - 0.5)  # a stamp is half a tick late on average
    in_phase, quadrature, _ = np.linalg.lstsq(np.stack([np.sin(at), np.cos(at), np.ones_like(at)], 1), level[kept])[0]
    assert kept.sum() >= 300
    assert math.hypot(in_phase, quadrature) == pytest.approx(gain, rel=0.01)
    assert math.atan2(quadrature, in_phase) == pytest.approx(phase, rel=0.01)


@pytest.mark.parametrize(
    ("hz", "floor_hz", "ceiling_hz"),
    [(0.1, 0.0, math.inf), (0.1, 0.003, math.inf), (0.1, 0.0, 0.04), (0.1, 0.003, 0.04), (math.inf, 0.0, 0.04)],
)
def test_the_corner_is_proportional_to_irradiance_from_floor_to_ceiling(
    hz: float, floor_hz: float, ceiling_hz: float
) -> None:
    """After a step to each luma, black among them, the way there is exponential with that luma's corner, to 1e-3."""
    luma = np.array([[0.0, 1e-3, 0.01, 0.1, 1.0, 5.0]], np.float32)
    irradiance = np.exp(log_intensity(luma, LOG_EPS))[0]
    before = (irradiance * 2 - LOG_EPS).astype(np.float32)[None]
    bandwidth = PhotoreceptorBandwidth(hz, floor_hz=floor_hz, ceiling_hz=ceiling_hz)
    engine = CrossingEngine(6, 1, contrast_threshold=0.1, log_eps=LOG_EPS, effects=behind(bandwidth))
    engine.push(0, before)
    times = np.unique(np.geomspace(1, 1e12, 500).astype(np.int64))
    events = collect(engine.push(int(t), luma) for t in times)
    step = log_intensity(before, LOG_EPS)[0] - log_intensity(luma, LOG_EPS)[0]
    for x, (size, irradiated) in enumerate(zip(step, irradiance, strict=True)):
        own = of_pixel(events, x)
        assert own["p"].tolist() == [0] * 6  # of ln 2 = 0.693
        corner_hz = min(max(hz * irradiated, floor_hz), ceiling_hz)
        time_constants = -np.log(1 - 0.1 * np.arange(1, 7) / size)
        np.testing.assert_allclose(own["t"] * 2e-6 * math.pi * corner_hz, time_constants, rtol=1e-3)


def test_a_pixel_begins_settled() -> None:
    """At its first sample, however bright or dark: a static scene makes no event, and the reference is that sample."""
    luma = np.array([[0.0, 1e-6, 1.0, 1e6]], np.float32)
    engine = CrossingEngine(4, 1, contrast_threshold=1e-6, effects=behind(0.1))
    packets = [engine.push(t, luma) for t in (0, 1, 1_000, 10_000_000, 3_600_000_000)]
    assert len(collect(packets)) == 0
    np.testing.assert_array_equal(engine.reference, log_intensity(luma, LOG_EPS))


# Crossings of the filtered curve.


@dataclass(frozen=True)
class Course:
    """One pixel's samples, its thresholds and its low-pass."""

    c_on: float
    c_off: float
    bandwidth: PhotoreceptorBandwidth
    times_us: list[int]
    samples: list[float]

    def oracle(self) -> FilteredPixel:
        corner = corner_of(self.bandwidth)
        return FilteredPixel(self.times_us[0], self.samples[0], self.c_on, self.c_off, corner)

    def engine(self) -> CrossingEngine:
        return CrossingEngine(
            1, 1, contrast_threshold=self.c_on, contrast_threshold_off=self.c_off, effects=behind(self.bandwidth)
        )


thresholds = st.floats(0.05, 1.0)
gaps = st.one_of(st.sampled_from([1, 2, 3, 1_000, 33_333, 10_000_000]), st.integers(1, 1_000_000))


@st.composite
def bandwidths(draw: st.DrawFn) -> PhotoreceptorBandwidth:
    """Corners from far below to far above the rate of samples; floors and ceilings that act, and that do not."""
    floor_hz = draw(st.one_of(st.just(0.0), st.floats(0.01, 1e4)))
    ceiling_hz = draw(st.one_of(st.just(math.inf), st.floats(1.0, 1e3).map(lambda ratio: max(floor_hz, 1e-3) * ratio)))
    return PhotoreceptorBandwidth(10 ** draw(st.floats(-1, 6)), floor_hz=floor_hz, ceiling_hz=ceiling_hz)


@st.composite
def profiles(draw: st.DrawFn) -> Course:
    """Steps, ramps, holds and turns of log intensity."""
    times_us, samples = [draw(st.sampled_from([0, 1_000, EPOCH_US]))], [draw(st.floats(-7, 4))]
    for _ in range(draw(st.integers(1, 7))):
        times_us.append(times_us[-1] + draw(gaps))
        moved = draw(st.one_of(st.just(0.0), st.floats(-2, 2)))
        samples.append(min(max(samples[-1] + moved, -12.0), 8.0))
    return Course(draw(thresholds), draw(thresholds), draw(bandwidths()), times_us, samples)


@EXAMPLES
@given(profiles())
def test_crossings_are_those_of_the_filtered_curve(profile: Course) -> None:
    """Counts, polarities, stamps and the final reference, against the equation solved in 40 digits.

    The filtered curve stays between the levels around the reference: no event is lost.
    """
    engine, oracle = profile.engine(), profile.oracle()
    for t_us, sample in zip(profile.times_us, profile.samples, strict=True):
        events = engine.push_log(t_us, scene(sample))
        crossings = oracle.advance(t_us, sample) if t_us > oracle.t_us else []
        assume(oracle.nearest > 1e-11)
        assert_are(events, crossings)
        assert engine.reference[0, 0] == pytest.approx(float(oracle.reference), abs=1e-12)
        assert -profile.c_off < float(oracle.output) - engine.reference[0, 0] < profile.c_on


@EXAMPLES
@given(profiles())
def test_sparse_samples_are_intervals_of_their_own(profile: Course) -> None:
    """Between two frames the curve goes through a pixel's own samples, each interval with the corner of its ends."""
    assume(len(profile.times_us) > 2)
    engine, oracle = profile.engine(), profile.oracle()
    engine.push_log(profile.times_us[0], scene(profile.samples[0]))
    between = range(1, len(profile.times_us) - 1)
    sparse = (
        np.zeros(len(between), np.uint32),
        np.array([profile.times_us[k] for k in between]),
        np.array([profile.samples[k] for k in between]),
    )
    events = engine.push_log(profile.times_us[-1], scene(profile.samples[-1]), sparse=sparse)
    later = zip(profile.times_us[1:], profile.samples[1:], strict=True)
    crossings = [crossing for t_us, sample in later for crossing in oracle.advance(t_us, sample)]
    assume(oracle.nearest > 1e-11)
    assert_are(events, sorted(crossings, key=lambda crossing: crossing.t_us))


@pytest.mark.parametrize("corner_hz", [50.0, 200.0, 1e4, 1e6, 1e9, 1e12, 1e300])
def test_a_long_interval_is_filtered_as_any_other(corner_hz: float) -> None:
    """A ramp of a second lags by the time constant, also where that is 1e-3 to 1e-300 of the interval."""
    engine = CrossingEngine(1, 1, contrast_threshold=0.5, effects=behind(constant_corner(corner_hz)))
    oracle = FilteredPixel(0, 0.0, 0.5, 0.5, corner_of(constant_corner(corner_hz)))
    for t_us, sample in ((0, 0.0), (1_000_000, 1.2), (2_000_000, 1.2), (2_000_001, 0.1), (3_000_001, 0.1)):
        events = engine.push_log(t_us, scene(sample))
        assert_are(events, oracle.advance(t_us, sample) if t_us else [])


def test_zero_light_is_slow_and_nothing_worse() -> None:
    """To black and back with no floor: the corner falls to that of log_eps, events stay those of the equation."""
    bandwidth = PhotoreceptorBandwidth(200.0)
    engine = CrossingEngine(1, 1, contrast_threshold=0.15, log_eps=LOG_EPS, effects=behind(bandwidth))
    oracle: FilteredPixel | None = None
    counts = []
    for k, luma in enumerate([1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]):
        frame, t_us = np.full((1, 1), luma, np.float32), 7_001 * k
        sample = float(log_intensity(frame, LOG_EPS)[0, 0])
        oracle = oracle or FilteredPixel(t_us, sample, 0.15, 0.15, corner_of(bandwidth))
        events = engine.push(t_us, frame)
        assert_are(events, oracle.advance(t_us, sample) if k else [])
        counts.append(len(events))
    # In the dark few events come, late; light brings all that are due.
    assert counts[2] > 0
    assert sum(counts[1:4]) < 8 < 12 < sum(counts[4:6])


def test_a_corner_in_the_deepest_dark_is_proportional_still() -> None:
    """At irradiance 1e-16, which log_eps allows: e^L loses no digits where it is small beside 1."""
    low, high = -37.0, -36.5
    hz = 1e3 * math.exp(-high)
    engine = CrossingEngine(1, 1, contrast_threshold=0.1, log_eps=1e-30, effects=behind(hz))
    oracle = FilteredPixel(0, low, 0.1, 0.1, corner_of(PhotoreceptorBandwidth(hz)))
    for t_us, sample in ((0, low), (1, high), (10_000, high)):
        assert_are(engine.push_log(t_us, scene(sample)), oracle.advance(t_us, sample) if t_us else [])


@pytest.mark.parametrize("threads", [1, 2])
def test_no_event_is_lost_on_a_dense_texture(threads: int) -> None:
    """After every frame the filtered signal, from a model of its own, lies between the levels of all 5,000 pixels."""
    random = np.random.default_rng(5)
    width, height, bandwidth = 100, 50, PhotoreceptorBandwidth(30.0, floor_hz=2.0, ceiling_hz=400.0)
    c_on, c_off = random.uniform(0.05, 0.4, (2, height, width))
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=c_on,
        contrast_threshold_off=c_off,
        effects=behind(bandwidth),
        threads=threads,
    )
    sample = output = random.normal(0, 2, (height, width))
    engine.push_log(0, sample)
    t_us, count = 0, 0
    for gap_us in [1_000] * 20 + [30_000] * 10 + [1] * 5:
        before, sample = sample, sample + random.normal(0, 0.3, sample.shape)
        z = bandwidth.hz * np.exp((before + sample) / 2)
        z = 2e-6 * np.pi * gap_us * np.clip(z, bandwidth.floor_hz, bandwidth.ceiling_hz)
        t_us += gap_us
        count += len(engine.push_log(t_us, sample))
        settled = -np.expm1(-z)
        output = output + (before - output) * settled + (sample - before) * (1 - settled / z)
        away = output - engine.reference
        assert np.all((away > -c_off - 1e-7) & (away < c_on + 1e-7))
    assert count > 20_000


# Hermite input.


@pytest.mark.parametrize("corner_hz", [0.5, 3.0, 1e4])
@pytest.mark.parametrize(
    ("change", "slopes"),
    [
        (1.2, (3.6, 0.0)),
        (1.2, (0.5, 3.6)),
        (-1.2, (0.0, -3.6)),
        (0.0, (6.0, -6.0)),
        (0.3, (9.0, -1.0)),
        (0.0, (40.0, -40.0)),
    ],
)
def test_a_cubic_is_filtered_as_chords_that_stray_little(
    corner_hz: float, change: float, slopes: tuple[float, float]
) -> None:
    """Every event falls where the filtered cubic, solved in 20,000 steps, is within C / 100 of its level.

    Or within what 16 chords, the most there are, stray from it: the largest second derivative / (8 * 16^2). All pixels
    see the same, each through thresholds of its own, so that events probe the whole curve.
    """
    second_us, steps, least = 1_000_000, 20_000, 0.5
    thresholds = np.geomspace(least, 1.2, 64)[None]
    effects = behind(constant_corner(corner_hz))
    engine = CrossingEngine(64, 1, contrast_threshold=thresholds, interpolation="hermite", effects=effects)
    engine.push_log(0, scene(0.0, 1, 64), scene(slopes[0], 1, 64))
    events = engine.push_log(second_us, scene(change, 1, 64), scene(slopes[1], 1, 64))
    s, quadratic, third = np.linspace(0, 1, steps + 1), 3 * change - 2 * slopes[0] - slopes[1], sum(slopes) - 2 * change
    cubic = s * (slopes[0] + s * (quadratic + s * third))
    z, output = 2 * math.pi * corner_hz / steps, np.zeros(steps + 1)
    settled = -math.expm1(-z)
    for k, (before, after) in enumerate(pairwise(cubic)):
        output[k + 1] = output[k] + (before - output[k]) * settled + (after - before) * (1 - settled / z)
    away = [
        np.interp(own["t"] / second_us, s, output) - levels(own, 0.0, c)
        for x, c in enumerate(thresholds[0])
        for own in [of_pixel(events, x)]
    ]
    wildest = 2 * max(abs(quadratic), abs(quadratic + 3 * third)) / (8 * 16**2)
    strayed = np.abs(np.concatenate(away))
    assert len(strayed) >= 9
    assert strayed.max() < max(0.01 * least, wildest) + 1e-4
