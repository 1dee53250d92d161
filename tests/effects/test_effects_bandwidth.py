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
from davis_rs.events.arrays import EventArray
from davis_rs.sensor.effects import PhotoreceptorBandwidth
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


def sine_response(bandwidth: PhotoreceptorBandwidth, frequency_hz: float, gain: float) -> complex:
    """Complex gain of a sine of log intensity, from events of a pixel: amplitude and phase by least squares.

    ``gain`` is about what is expected: it sets the threshold. The sine's mean is 0, so its light is 1, and small.
    """
    samples, size = 200, 2e-3
    w = 2e-6 * math.pi * frequency_hz
    c = size * gain / 40
    engine = CrossingEngine(1, 1, contrast_threshold=c, effects=behind(bandwidth))
    period_us = 1e6 / frequency_hz
    settled_us = period_us * math.ceil(5e6 / min(bandwidth.hz, bandwidth.source_follower_hz) / period_us)
    times = np.arange(0, settled_us + 2 * period_us, period_us / samples).round().astype(np.int64)
    events = collect(engine.push_log(int(t), scene(size * math.sin(w * t))) for t in times)
    level, kept = levels(events, 0.0, c), events["t"] > settled_us
    at = w * (events["t"][kept] - 0.5)  # a stamp is half a tick late on average
    in_phase, quadrature, _ = np.linalg.lstsq(np.stack([np.sin(at), np.cos(at), np.ones_like(at)], 1), level[kept])[0]
    assert kept.sum() >= 300
    return complex(in_phase, quadrature) / size


@pytest.mark.parametrize("ratio", [0.1, 0.3, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("hz", [1.0, math.inf])
def test_gain_and_phase_of_a_sine_are_those_of_a_first_order_low_pass(hz: float, ratio: float) -> None:
    """1 / sqrt(1 + r^2) and -atan(r) at r times the corner, both within 1 %, of either pole alone."""
    bandwidth = PhotoreceptorBandwidth(hz, source_follower_hz=math.inf if hz == 1.0 else 1.0)
    expected = 1 / (1 + 1j * ratio)
    found = sine_response(bandwidth, ratio, abs(expected))
    assert abs(found) == pytest.approx(abs(expected), rel=0.01)
    assert np.angle(found) == pytest.approx(np.angle(expected), rel=0.01)
    assert bandwidth.response(ratio, 1.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("frequency_hz", [0.1, 0.5, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("corners_hz", [(1.0, 1.0), (1.0, 4.0), (4.0, 1.0), (0.5, 50.0)])
def test_gain_and_phase_of_a_sine_are_those_of_two_poles(corners_hz: tuple[float, float], frequency_hz: float) -> None:
    """The product of both first-order responses, within 1 %, also where -3 dB of the two together lie."""
    first, second = corners_hz
    expected = 1 / ((1 + 1j * frequency_hz / first) * (1 + 1j * frequency_hz / second))
    bandwidth = PhotoreceptorBandwidth(first, source_follower_hz=second)
    found = sine_response(bandwidth, frequency_hz, abs(expected))
    assert abs(found) == pytest.approx(abs(expected), rel=0.01)
    assert np.angle(found) == pytest.approx(np.angle(expected), rel=0.01)
    assert bandwidth.response(frequency_hz, 1.0) == pytest.approx(expected, rel=1e-12)


def test_both_poles_lose_three_decibel_where_the_closed_form_says() -> None:
    """Poles alike at 1 Hz: half of the power is left at sqrt(sqrt(2) - 1) = 0.644 Hz."""
    corner_hz = math.sqrt(math.sqrt(2) - 1)
    found = sine_response(PhotoreceptorBandwidth(1.0, source_follower_hz=1.0), corner_hz, math.sqrt(0.5))
    assert abs(found) == pytest.approx(math.sqrt(0.5), rel=0.01)


@pytest.mark.parametrize("corners_hz", [(3.0, 3.0), (3.0, 20.0), (20.0, 3.0), (1e3, 3.0), (3.0, 1e3)])
def test_the_way_to_a_step_is_that_of_two_poles(corners_hz: tuple[float, float]) -> None:
    """1 - (f2 exp(-w1 t) - f1 exp(-w2 t)) / (f2 - f1), or (1 + w t) exp(-w t): every stamp within a tick."""
    first, second = (2e-6 * math.pi * hz for hz in corners_hz)

    def response(t: FloatArray) -> FloatArray:
        if first == second:
            return 1 - (1 + first * t) * np.exp(-first * t)
        return 1 - (second * np.exp(-first * t) - first * np.exp(-second * t)) / (second - first)

    size, c = 1e-3, 1e-5  # so small that the light, and so the first corner, stays as it is
    engine = CrossingEngine(1, 1, contrast_threshold=c, effects=behind(PhotoreceptorBandwidth(*corners_hz)))
    engine.push_log(0, scene(0))
    engine.push_log(1, scene(size))
    events = collect(engine.push_log(t, scene(size)) for t in (200_000, 2_000_000))
    assert len(events) == 99
    t = events["t"] - 0.5  # the step takes the first microsecond
    reached = c * np.arange(1, 100) / size
    assert np.all(response(t - 1.0) < reached * (1 + 1e-3))
    assert np.all(response(t + 1.0) > reached * (1 - 1e-3))


def test_a_source_follower_that_follows_at_once_changes_nothing() -> None:
    """Continuous as its corner goes to infinity: the same events as without, and nearly so a little below."""
    random = np.random.default_rng(2)
    frames = np.cumsum(random.normal(0, 0.3, (40, 20, 20)), 0)

    def events(follower_hz: float) -> EventArray:
        effects = behind(PhotoreceptorBandwidth(50.0, source_follower_hz=follower_hz))
        engine = CrossingEngine(20, 20, contrast_threshold=0.1, effects=effects)
        return collect(engine.push_log(k * 5_000, frame) for k, frame in enumerate(frames))

    without = events(math.inf)
    assert len(without) > 2_000
    for follower_hz in (1e12, 1e15, 1e300):
        np.testing.assert_array_equal(events(follower_hz), without)
    near = events(1e7)  # 0.016 us late
    assert len(near) == len(without)
    assert np.abs(near["t"] - without["t"]).max() <= 1
    assert len(events(100.0)) < 0.95 * len(without)


def test_the_corner_is_proportional_to_the_photocurrent() -> None:
    """After a step to each luma, black among them, the way there is exponential with the corner of light plus dark."""
    luma = np.array([[0.0, 1e-3, 0.01, 0.1, 1.0, 5.0]], np.float32)
    photocurrent = np.exp(log_intensity(luma, LOG_EPS))[0]
    before = (photocurrent * 2 - LOG_EPS).astype(np.float32)[None]
    hz = 0.1
    engine = CrossingEngine(6, 1, contrast_threshold=0.1, log_eps=LOG_EPS, effects=behind(PhotoreceptorBandwidth(hz)))
    engine.push(0, before)
    times = np.unique(np.geomspace(1, 1e12, 500).astype(np.int64))
    events = collect(engine.push(int(t), luma) for t in times)
    step = log_intensity(before, LOG_EPS)[0] - log_intensity(luma, LOG_EPS)[0]
    for x, (size, current) in enumerate(zip(step, photocurrent, strict=True)):
        own = of_pixel(events, x)
        assert own["p"].tolist() == [0] * 6  # of ln 2 = 0.693
        time_constants = -np.log(1 - 0.1 * np.arange(1, 7) / size)
        np.testing.assert_allclose(own["t"] * 2e-6 * math.pi * hz * current, time_constants, rtol=1e-3)


@pytest.mark.parametrize("dark", [1e-3, 0.05, 0.5])
def test_the_dark_current_is_the_floor_of_bandwidth_and_contrast(dark: float) -> None:
    """In the dark the corner is hz * dark, and light twice as bright is less than twice the photocurrent."""
    bandwidth = PhotoreceptorBandwidth(100.0)
    engine = CrossingEngine(2, 1, contrast_threshold=1e-3, log_eps=dark, effects=behind(bandwidth))
    engine.push(0, np.array([[0.02, 20.0]], np.float32))
    luma = np.array([[0.01, 10.0]], np.float32)
    events = collect(engine.push(int(t), luma) for t in np.unique(np.geomspace(1, 1e10, 300).astype(np.int64)))
    for x, light in enumerate(luma[0].astype(np.float64)):
        own = of_pixel(events, x)
        contrast = math.log((2 * light + dark) / (light + dark))
        assert len(own) == math.floor(contrast / 1e-3 - 1e-6)
        events_to_half = len(own) // 2
        way = -math.log(1 - events_to_half * 1e-3 / contrast)
        corner_hz = way / (2e-6 * math.pi * own["t"][events_to_half - 1])
        assert corner_hz == pytest.approx(100 * (light + dark), rel=0.02)
        assert corner_hz > 100 * dark


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
        both = math.isfinite(self.bandwidth.hz)
        follower_hz = self.bandwidth.source_follower_hz if both else math.inf
        return FilteredPixel(
            self.times_us[0], self.samples[0], self.c_on, self.c_off, corner_of(self.bandwidth), follower_hz
        )

    def engine(self) -> CrossingEngine:
        return CrossingEngine(
            1, 1, contrast_threshold=self.c_on, contrast_threshold_off=self.c_off, effects=behind(self.bandwidth)
        )


thresholds = st.floats(0.05, 1.0)
gaps = st.one_of(st.sampled_from([1, 2, 3, 1_000, 33_333, 10_000_000]), st.integers(1, 1_000_000))


@st.composite
def bandwidths(draw: st.DrawFn) -> PhotoreceptorBandwidth:
    """Corners from far below to far above the rate of samples; the photoreceptor's, the source follower's, or both."""
    hz, follower_hz = (10 ** draw(st.floats(-1, 6)) for _ in range(2))
    hz, follower_hz = draw(st.sampled_from([(hz, math.inf), (math.inf, follower_hz), (hz, follower_hz)]))
    return PhotoreceptorBandwidth(hz, source_follower_hz=follower_hz)


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


@pytest.mark.long
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
    """At irradiance 1e-16, which log_eps allows: e^L loses no digits where it is small compared with 1."""
    low, high = -37.0, -36.5
    hz = 1e3 * math.exp(-high)
    engine = CrossingEngine(1, 1, contrast_threshold=0.1, log_eps=1e-30, effects=behind(hz))
    oracle = FilteredPixel(0, low, 0.1, 0.1, corner_of(PhotoreceptorBandwidth(hz)))
    for t_us, sample in ((0, low), (1, high), (10_000, high)):
        assert_are(engine.push_log(t_us, scene(sample)), oracle.advance(t_us, sample) if t_us else [])


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("follower_hz", [math.inf, 20.0, 300.0])
def test_no_event_is_lost_on_a_dense_texture(threads: int, follower_hz: float) -> None:
    """After every frame the filtered signal, from a model of its own, lies between the levels of all 5,000 pixels.

    That of one low-pass, and that of two.
    """
    random = np.random.default_rng(5)
    width, height, bandwidth = 100, 50, PhotoreceptorBandwidth(30.0, source_follower_hz=follower_hz)
    c_on, c_off = random.uniform(0.05, 0.4, (2, height, width))
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=c_on,
        contrast_threshold_off=c_off,
        effects=behind(bandwidth),
        threads=threads,
    )
    sample = output = follower = random.normal(0, 2, (height, width))
    engine.push_log(0, sample)
    t_us, count = 0, 0
    for gap_us in [1_000] * 20 + [30_000] * 10 + [1] * 5:
        before, sample = sample, sample + random.normal(0, 0.3, sample.shape)
        w = 2e-6 * np.pi * bandwidth.hz * np.exp((before + sample) / 2)
        t_us += gap_us
        count += len(engine.push_log(t_us, sample))
        rate = (sample - before) / gap_us
        transient = output - before + rate / w
        output = sample - rate / w + transient * np.exp(-w * gap_us)
        if math.isinf(follower_hz):
            follower = output
        else:
            w2 = 2e-6 * np.pi * follower_hz
            passed = transient * w2 / (w2 - w)
            own = follower - before + rate / w + rate / w2 - passed
            late = sample - rate / w - rate / w2
            follower = late + passed * np.exp(-w * gap_us) + own * np.exp(-w2 * gap_us)
        away = follower - engine.reference
        assert np.all((away > -c_off - 1e-7) & (away < c_on + 1e-7))
    assert count > 10_000


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
