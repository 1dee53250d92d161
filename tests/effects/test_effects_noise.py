"""Noise: shot noise and hot pixels, their laws, and that neither depends on frames, threads or each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray
from davis_rs.sensor.effects import HotPixels, ShotNoise
from effects_reference import collect, may_be_tick, noisy_pixel, of_pixel, scene
from strategies import EPOCH_US, EXAMPLES, random_paths

UNLIKELY = 1e-6
"""The significance of every statistical test here; seeds are fixed."""

SIGMAS = 5.0
"""As many standard errors are allowed about a mean: 6e-7 of a normal distribution."""

SECOND_US = 1_000_000
SILENT = 1e3
"""A threshold that no signal here reaches: what comes is noise."""

LOG_EPS = 1e-3
"""The engine's own."""

ANY_LIGHT = math.inf
"""A ``half_luma`` of noise that is the same in any light."""


def noisy(effects: Effects, *, side: int = 64, seed: int = 0, c: float = SILENT, **settings: Any) -> CrossingEngine:
    return CrossingEngine(side, side, contrast_threshold=c, effects=effects, seed=seed, **settings)


BRIEF_HZ = 1e7
"""A bandwidth at which both events of a pair have one stamp, or the next."""


def shot(rate_hz: float, half_luma: float = ANY_LIGHT, bandwidth_hz: float = BRIEF_HZ, c: float = SILENT) -> Effects:
    """Noise whose rms makes ``rate_hz`` events a second at threshold ``c`` where light does not change it."""
    rms = ShotNoise.of_rate(rate_hz, c, half_luma=ANY_LIGHT, bandwidth_hz=bandwidth_hz).rms
    return Effects(shot_noise_rms=ShotNoise(rms, half_luma, bandwidth_hz))


def by_pixel(events: EventArray) -> EventArray:
    """In the order of pixels, and of time in each."""
    return events[np.lexsort((events["t"], events["x"], events["y"]))]


def pairs_of(events: EventArray) -> tuple[EventArray, EventArray]:
    """First and second events of noise on a static scene, pixel by pixel, where both are there."""
    events = by_pixel(events)
    pixel = events["y"].astype(np.int64) << 16 | events["x"]
    new = np.diff(pixel, prepend=-1) != 0
    rank = np.arange(len(events)) - np.maximum.accumulate(np.where(new, np.arange(len(events)), 0))
    last = np.append(new[1:], True)
    first = (rank % 2 == 0) & ~last
    return events[first], events[1:][first[:-1]]


def is_away(engine: CrossingEngine) -> npt.NDArray[np.bool_]:
    """Pixels whose noise is away from zero, so that a part of the reference is noise."""
    until_us = engine.state()["effect_state"]["excursion_us"]
    return np.asarray(until_us > 0).reshape(engine.reference.shape)


def static(engine: CrossingEngine, times_us: Any, luma: float = 0.0, side: int = 64) -> EventArray:
    """What a scene that does not change makes of frames at these times."""
    return collect(engine.push(int(t), np.full((side, side), luma, np.float32)) for t in times_us)


def counts_of(events: EventArray, side: int = 64) -> npt.NDArray[np.int64]:
    counts = np.zeros((side, side), np.int64)
    np.add.at(counts, (events["y"], events["x"]), 1)
    return counts


def assert_poisson(counts: npt.NDArray[np.int64], mean: float) -> None:
    """Chi-square of counts against a Poisson distribution, bins of fewer than ten expected joined to their ends."""
    values = np.arange(counts.max() + 2)
    expected = stats.poisson.pmf(values, mean) * counts.size
    inner = values[expected >= 10]
    edges = np.concatenate([[-0.5], inner[1:] - 0.5, [np.inf]])
    observed = np.histogram(np.minimum(counts.ravel(), 1e9), edges)[0]
    share = np.diff(stats.poisson.cdf(np.floor(edges), mean))
    assert stats.chisquare(observed, share * counts.size).pvalue > UNLIKELY


def assert_exponential(events: EventArray, mean_us: float, first: int, side: int) -> None:
    """Chi-square of each pixel's first waits over 50 bins of one probability; they do not follow from each other."""
    order = np.lexsort((events["t"], events["x"], events["y"]))
    starts = np.concatenate([[0], np.cumsum(counts_of(events, side).ravel())[:-1]])
    times = events["t"][order][starts[:, None] + np.arange(first)].astype(float)
    waits = np.diff(times, axis=1, prepend=0.0)
    bins = np.histogram(stats.expon.cdf(waits.ravel(), scale=mean_us), 50, (0, 1))[0]
    assert stats.chisquare(bins).pvalue > UNLIKELY
    assert stats.pearsonr(waits[:, 1:].ravel(), waits[:, :-1].ravel()).pvalue > UNLIKELY
    assert stats.pearsonr(waits[1:].ravel(), waits[:-1].ravel()).pvalue > UNLIKELY


# Shot noise.


@pytest.mark.parametrize("luma", [0.0, 3.0])
def test_pairs_of_shot_noise_are_a_poisson_process_in_each_pixel(luma: float) -> None:
    """4,096 pixels for 2 s at a mean of 40 pairs: counts Poisson, waits exponential (chi-square, 1e-6).

    Thinned by light it is one as well.
    """
    # Light leaves 4 B sqrt(x) (rate / 4 B)^(1 + x), with x = 1/10 here.
    rate_hz = 4 * BRIEF_HZ * (40.0 / (4 * BRIEF_HZ * math.sqrt(0.1))) ** (1 / 1.1) if luma else 40.0
    effects = shot(rate_hz, 10 * luma) if luma else shot(rate_hz)
    events, _ = pairs_of(static(noisy(effects, log_eps=1e-9), [0, 2 * SECOND_US], luma))
    counts = counts_of(events)
    assert_poisson(counts, 40.0)
    assert counts.min() >= 10
    assert_exponential(events, SECOND_US / 20, 10, 64)


@pytest.mark.parametrize("c_off", [0.2, 0.27, 0.15])
@pytest.mark.parametrize("period_us", [None, 3.37])
def test_noise_comes_in_pairs_of_opposite_polarity(c_off: float, period_us: float | None) -> None:
    """The second follows after the noise's time, 1 / (2 pi bandwidth) with poles alike: exponential (chi-square, 1e-6).

    Where the pixel's thresholds differ, as they do under mismatch, nearly all pairs are such as well.
    """
    noise = Effects(
        shot_noise_rms=ShotNoise.of_rate(4.0, 0.2, half_luma=ANY_LIGHT, bandwidth_hz=200.0),
        refractory_period_us=period_us,
    )
    engine = CrossingEngine(64, 64, contrast_threshold=0.2, contrast_threshold_off=c_off, effects=noise)
    events = static(engine, [0, 2 * SECOND_US])
    if c_off == 0.2:
        back = ~is_away(engine)
        np.testing.assert_allclose(engine.reference[back], math.log(1e-3), rtol=0, atol=1e-4)
        first, second = pairs_of(events)
        assert np.all(first["p"] != second["p"])
        waits = (second["t"] - first["t"] - (period_us or 0.0) - 0.5).astype(float)
        bins = np.histogram(stats.expon.cdf(waits, scale=1e6 / (2 * math.pi * 200)), 20, (0, 1))[0]
        assert len(first) > 10_000
        assert stats.chisquare(bins).pvalue > UNLIKELY
    else:
        own = by_pixel(events)
        close = (np.diff(own["t"]) > 0) & (np.diff(own["t"]) < 4_000) & (np.diff(own["x"].astype(int)) == 0)
        assert np.mean(np.diff(own["p"].astype(int))[close] != 0) > 0.9
        assert close.sum() > 0.4 * len(own)


@EXAMPLES
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 1e-3, 3.37, 400.0, 30_000.0, 1e15]),
    st.sampled_from([(0.15, 0.15), (0.1, 0.23), (0.3, 0.07)]),
    st.sampled_from([30.0, 300.0, 1e4]),
    st.sampled_from([3.0, 1.5]),
    st.sampled_from([ANY_LIGHT, 0.7, 30.0]),
)
def test_events_are_those_of_a_pixel_followed_in_time(
    seed: int, period_us: float, c: tuple[float, float], bandwidth_hz: float, rms_in_c: float, half_luma: float
) -> None:
    """Six pixels of a moving scene, noise and signal mixed: each event of the oracle, its polarity and its tick."""
    noise = ShotNoise(c[0] / rms_in_c, half_luma, bandwidth_hz)
    effects = Effects(shot_noise_rms=noise, refractory_period_us=period_us)
    engine = CrossingEngine(3, 2, contrast_threshold=c[0], contrast_threshold_off=c[1], effects=effects, seed=seed)
    frames = 0.3 * np.random.default_rng(seed).normal(size=(15, 2, 3)).cumsum(0)
    events = collect(engine.push_log(k * 7_001, frame) for k, frame in enumerate(frames))
    for y, x in np.ndindex(2, 3):
        path = [(k * 7_001, float(frame[y, x])) for k, frame in enumerate(frames)]
        expected = noisy_pixel(path, noise, pixel=3 * y + x, seed=seed, c=c, period_us=period_us)
        own = of_pixel(events, x, y)
        assert own["p"].tolist() == [p for _, p in expected]
        assert all(may_be_tick(t, at, 1e-3) for t, (at, _) in zip(own["t"].tolist(), expected, strict=True))


@pytest.mark.parametrize("c_off", [0.2, 0.26])
def test_noise_does_not_hide_slow_contrast(c_off: float) -> None:
    """A ramp of 0.02 a second for 60 s under 5 Hz of noise: net contrast of the events is that of the ramp.

    Whether a refractory period is none, next to none or that of a DAVIS240C: the law is continuous. A period much
    longer than the noise's correlation time loses it.
    """
    net = {}
    for period_us in (None, 1e-6, 1.0, 3.37, 50_000.0):
        noise = Effects(shot_noise_rms=ShotNoise.of_rate(5.0, 0.2, half_luma=ANY_LIGHT), refractory_period_us=period_us)
        engine = CrossingEngine(32, 32, contrast_threshold=0.2, contrast_threshold_off=c_off, effects=noise)
        events = collect(engine.push_log(t * SECOND_US, scene(0.02 * t, 32, 32)) for t in range(61))
        on = int((events["p"] == 1).sum())
        net[period_us] = (0.2 * on - c_off * (len(events) - on)) / 1024
        assert len(events) / 1024 / 60 > (4.5 if c_off == 0.2 else 2) * (0.4 if period_us == 50_000.0 else 1)
    assert 1.0 < net[None] <= 1.2
    assert net[1e-6] == pytest.approx(net[None], abs=0.01)
    assert net[1.0] == pytest.approx(net[None], abs=0.01)
    assert net[3.37] == pytest.approx(net[None], abs=0.02)
    if c_off == 0.2:  # else noise of one polarity is the more frequent, and no pair makes up for it
        assert net[50_000.0] < 0.2


@pytest.mark.parametrize("half_luma", [1.0, 0.05])
def test_the_rate_rises_and_falls_with_luma(half_luma: float) -> None:
    """By Rice, sqrt(x) of the poles, rms^2 / (1 + x) of the variance: counts within five standard errors."""
    lumas = half_luma * np.array([0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 1000.0], np.float32)
    effects, dark = shot(3_000.0, half_luma), 1e-3 * half_luma
    engine = CrossingEngine(7, 500, contrast_threshold=SILENT, effects=effects, log_eps=dark)
    frame = np.broadcast_to(lumas, (500, 7))
    engine.push(0, frame)
    events = engine.push(SECOND_US, frame)
    first, _ = pairs_of(events)
    for x, luma in enumerate(lumas):
        x_of_light = float(luma + dark) / half_luma
        power = math.log(4 * BRIEF_HZ / 3_000.0) * (1 + x_of_light)
        expected = 500 * 2 * BRIEF_HZ * math.sqrt(min(x_of_light, 100.0)) * math.exp(-power)
        assert abs((first["x"] == x).sum() - expected) < SIGMAS * math.sqrt(expected) + 1
    made = np.bincount(first["x"], minlength=7)
    assert made[0] < 0.7 * made.max() > 10 * made[5]
    assert 0 < made.argmax() < 5


@pytest.mark.parametrize("bandwidth_hz", [30.0, 300.0, 3e3])
@pytest.mark.parametrize(("c", "c_off"), [(0.1, 0.1), (0.15, 0.15), (0.2, 0.2), (0.2, 0.17), (0.4, 0.3)])
@pytest.mark.parametrize("light", [0.03, 0.3, 1.0])
def test_the_rate_is_that_of_rice(c: float, c_off: float, bandwidth_hz: float, light: float) -> None:
    """Noise of one rms, 0.05: its rate over thresholds, light and bandwidth, each polarity first by its own threshold.

    Counts of 4,096 pixels, some 20,000 events, within five standard errors and what overlaps: the share of the time in
    which a pixel's noise is away already.
    """
    noise = ShotNoise(0.05, half_luma=1.0, bandwidth_hz=bandwidth_hz)
    settings: dict[str, Any] = {"contrast_threshold_off": c_off, "log_eps": 1e-9}
    variance = 0.05**2 / (1 + light)
    rates = [bandwidth_hz * math.sqrt(light) * math.exp(-(d**2) / (2 * variance)) for d in (c, c_off)]
    mean_time_s = (1 + 1 / light) / (4 * math.pi * bandwidth_hz)
    assert noise.rate_hz(c, c_off, light) == pytest.approx(2 * sum(rates), rel=1e-9)
    seconds = min(20_000 / (2 * sum(rates) * 4096), 1e4)
    events = static(noisy(Effects(shot_noise_rms=noise), c=c, **settings), [0, int(seconds * 1e6)], light)
    expected = 2 * sum(rates) * seconds * 4096
    overlap = sum(rates) * 2 * mean_time_s
    if c == c_off:
        assert abs(len(events) - expected) < SIGMAS * math.sqrt(2 * expected) + 2 * overlap * expected + 1
    # A pair's first is the event that no opposite one went before within the noise's time; of two alike it is either.
    if c == c_off and expected > 1e4:
        first, second = pairs_of(events)
        assert np.mean(first["p"] != second["p"]) == pytest.approx(1, abs=2 * overlap + 1e-3)
        assert np.mean(first["p"]) == pytest.approx(0.5, abs=SIGMAS / math.sqrt(expected) + overlap)
    if c > c_off:
        own = by_pixel(events)
        pixel = own["y"].astype(np.int64) << 16 | own["x"]
        alone = np.diff(own["t"], prepend=-SECOND_US).astype(float) > 30e6 * mean_time_s
        begins = own[alone | (np.diff(pixel, prepend=-1) != 0)]
        on, away = int(begins["p"].sum()), SIGMAS * math.sqrt(len(begins)) + 35 * overlap * len(begins)
        assert abs(on - rates[0] * seconds * 4096) < away + 1
        assert abs(len(begins) - expected / 2) < away + 1


def test_each_pixel_has_the_rate_of_its_own_thresholds() -> None:
    """Mismatch of a tenth spreads rates over more than a decade: those of groups of like pixels.

    Within five standard errors, and a tenth less where a pixel's thresholds differ: a second event now and then stays
    out.
    """
    noise = ShotNoise(0.04, half_luma=1.0, bandwidth_hz=300.0)
    effects = Effects(shot_noise_rms=noise, threshold_mismatch=0.1)
    engine = noisy(effects, side=128, c=0.15)
    counts = counts_of(static(engine, [0, 60 * SECOND_US], 0.1, side=128), 128)
    expected = 60 * noise.rate_hz(engine.contrast_threshold, engine.contrast_threshold_off, 0.1 + LOG_EPS)
    assert np.percentile(expected, 95) > 20 * np.percentile(expected, 5)
    for group in np.array_split(np.argsort(expected, axis=None), 32):
        made, mean = counts.ravel()[group].sum(), expected.ravel()[group].sum()
        assert 0.9 * mean - SIGMAS * math.sqrt(2 * mean) < made < mean + SIGMAS * math.sqrt(2 * mean)


def test_no_threshold_is_too_high_for_noise() -> None:
    """Where the formula underflows there is none, and nothing else breaks."""
    engine = noisy(Effects(shot_noise_rms=ShotNoise(1e-9)), side=8, c=10.0)
    assert len(static(engine, [0, SECOND_US, 10**12], side=8)) == 0
    assert CrossingEngine.from_state(engine.state()).state()["t_us"] == 10**12


@pytest.mark.parametrize("rate_hz", [1e-3, 0.1, 0.4])
def test_a_rate_far_below_one_event_a_second_is_on(rate_hz: float) -> None:
    """As those of dim scenes are: 100 s in the dark."""
    events = static(noisy(shot(rate_hz)), [0, 100 * SECOND_US])
    expected = rate_hz * 100 * 4096  # of Poisson pairs, so its variance is twice as much
    assert abs(len(events) - expected) < SIGMAS * math.sqrt(2 * expected)


def test_the_rate_follows_luma_within_an_interval() -> None:
    """Along a line of log intensity over one second the events of each tenth have the rate of their own luma."""
    low, high = math.log(0.01), math.log(10.0)
    effects = shot(4_000.0, 10.0)
    engine = noisy(effects, log_eps=1e-12)
    engine.push_log(0, scene(low, 64, 64))
    events = engine.push_log(SECOND_US, scene(high, 64, 64))
    observed = np.histogram(pairs_of(events)[0]["t"], 10, (0, SECOND_US))[0]
    x = np.exp(low + (high - low) * (np.arange(10_000) + 0.5) / 10_000) / 10.0
    rate = 2_000.0 * np.sqrt(x) * np.exp(-math.log(4 * BRIEF_HZ / 4_000.0) * x)
    expected = 4096 * rate.reshape(10, 1_000).mean(1) / 10
    assert np.all(np.abs(observed - expected) < SIGMAS * np.sqrt(expected))
    assert observed.max() > 3 * max(observed[0], observed[-1])


@pytest.mark.parametrize("luma", [0.0, 1.0, 99.0])
def test_both_polarities_are_alike(luma: float) -> None:
    """A pair's first is ON with 1/2 (binomial, 1e-6), in any light, and independent of the pair before."""
    first, second = pairs_of(static(noisy(shot(20.0 * 4 ** min(luma, 1), 10.0 * max(luma, 1))), [0, SECOND_US], luma))
    on = int(first["p"].sum())
    assert stats.binomtest(on, len(first), 0.5).pvalue > UNLIKELY
    assert np.all(second["p"] != first["p"])
    own = first["p"].astype(float)
    assert stats.pearsonr(own[1:], own[:-1]).pvalue > UNLIKELY


def test_noise_of_a_static_scene_does_not_depend_on_its_frames() -> None:
    """One interval, many, and irregular ones, on any number of threads: the same bytes."""
    effects = Effects(shot_noise_rms=shot(1_000.0, half_luma=8.0).shot_noise_rms, hot_pixels=HotPixels(0.1, 300.0))
    ends = [0, SECOND_US]
    random = np.random.default_rng(3)
    times = [ends, range(0, SECOND_US + 1, 1_000), sorted({*ends, *random.integers(0, SECOND_US, 300).tolist()})]
    streams = [static(noisy(effects, threads=1 + k), at, 0.3) for k, at in enumerate(times)]
    assert len(streams[0]) > 400_000
    assert streams[1].tobytes() == streams[0].tobytes()
    assert streams[2].tobytes() == streams[0].tobytes()


def test_noise_begins_at_the_first_frame_whenever_that_is() -> None:
    """At 0 and at a Unix time: the same events, shifted."""
    early = static(noisy(shot(50.0)), [0, SECOND_US])
    late = static(noisy(shot(50.0)), [EPOCH_US, EPOCH_US + SECOND_US])
    late["t"] -= EPOCH_US
    np.testing.assert_array_equal(late, early)


def test_another_seed_is_other_noise() -> None:
    """Counts of pixels do not correlate, and no more events are the same than by chance; the same seed repeats all."""
    one, two = (static(noisy(shot(50.0), seed=seed), [0, SECOND_US]) for seed in (0, 1))
    again = static(noisy(shot(50.0), seed=0), [0, SECOND_US])
    assert again.tobytes() == one.tobytes()
    assert stats.pearsonr(counts_of(one).ravel(), counts_of(two).ravel()).pvalue > UNLIKELY
    shared = np.intersect1d(one[["t", "x", "y"]], two[["t", "x", "y"]])
    assert len(shared) < 100  # 200,000 events each, on 4e9 ticks of pixels: 10 by chance, and pairs share stamps


def test_each_event_moves_the_reference_by_its_threshold() -> None:
    """In a moving scene with noise: B + C_on n_on - C_off n_off, and within C of the signal where noise is not away."""
    side, effects = 16, shot(500.0, bandwidth_hz=2_000.0, c=0.15)
    frames = random_paths(side * side, 40).reshape(40, side, side)
    engine = CrossingEngine(side, side, contrast_threshold=0.15, contrast_threshold_off=0.2, effects=effects)
    reference, away, total = frames[0].copy(), 0, 0
    for k, frame in enumerate(frames):
        events = engine.push_log(k * 10_000, frame)
        np.add.at(reference, (events["y"], events["x"]), np.where(events["p"] == 1, 0.15, -0.2))
        np.testing.assert_allclose(engine.reference, reference, rtol=0, atol=1e-9)
        quiet = ~is_away(engine)
        gap = (frame - reference)[quiet]
        assert gap.max() < 0.15 + 1e-9
        assert gap.min() > -0.2 - 1e-9
        away, total = away + int((~quiet).sum()), total + len(events)
    assert total > 10_000
    assert away > 100


def test_the_rate_is_that_of_the_light_not_of_the_photoreceptor() -> None:
    """Behind a slow photoreceptor a moving scene has the same noise."""
    frames = random_paths(16 * 16, 40).reshape(40, 16, 16)
    fast, slow = (
        noisy(Effects(shot_noise_rms=shot(5_000.0, 4.0).shot_noise_rms, photoreceptor_bandwidth_hz=hz), side=16)
        for hz in (None, 0.1)
    )
    streams = [collect(each.push_log(k * 10_000, frame) for k, frame in enumerate(frames)) for each in (fast, slow)]
    assert len(streams[0]) > 1_000
    np.testing.assert_array_equal(*streams)  # type: ignore[arg-type]


def test_a_megahertz_of_noise_has_all_its_events() -> None:
    """A microsecond apart on average, several on a tick: none is lost, each tick in raster order."""
    events = static(noisy(shot(1e6), side=4), range(0, 20_001, 500), side=4)
    overlap = 1e6 / (2 * math.pi * BRIEF_HZ)
    assert -2 * overlap < len(events) / (16 * 20_000) - 1 < SIGMAS * math.sqrt(2 / (16 * 20_000))
    assert np.all(np.diff(events["t"].astype(np.int64) * 100 + events["y"] * 10 + events["x"]) >= 0)


# Hot pixels.


def hot(
    fraction: float, rate_hz: float = 10.0, spread: float = 0.0, *, cv: tuple[float, float] = (0.1, 0.1)
) -> Effects:
    return Effects(hot_pixels=HotPixels(fraction, rate_hz, spread, *cv))


def waits_of(events: EventArray) -> list[npt.NDArray[np.float64]]:
    """Microseconds between events, pixel by pixel."""
    own = by_pixel(events)
    pixel = own["y"].astype(np.int64) << 16 | own["x"]
    return [np.diff(t).astype(float) for t in np.split(own["t"], np.flatnonzero(np.diff(pixel)) + 1)]


@pytest.mark.parametrize("fraction", [0.001, 0.05, 0.5])
def test_hot_pixels_are_a_binomial_share_and_fire_on_events(fraction: float) -> None:
    """Of 65,536 pixels (1e-6), each nearly 30 times a second; all others are silent."""
    events = static(noisy(hot(fraction, 30.0), side=256), [0, SECOND_US], side=256)
    counts = counts_of(events, 256)
    chosen = int((counts > 0).sum())
    assert stats.binomtest(chosen, counts.size, fraction).pvalue > UNLIKELY
    assert all(events["p"] == 1)
    assert np.abs(counts[counts > 0] - 30).max() <= 5
    assert counts.sum() == pytest.approx(30.0 * chosen, abs=SIGMAS * math.sqrt(0.5 * chosen))


@pytest.mark.parametrize("cv", [0.0, 0.05, 0.2, 0.5])
def test_intervals_of_hot_pixels_are_regular(cv: float) -> None:
    """Log-normal about their mean (Kolmogorov and Smirnov, 1e-6), one not following from the other, in any light."""
    streams = [static(noisy(hot(1.0, 40.0, cv=(cv, cv)), side=32), [0, 5 * SECOND_US], luma, 32) for luma in (0.0, 1e6)]
    assert streams[0].tobytes() == streams[1].tobytes()
    waits = np.stack([own[:150] for own in waits_of(streams[0])])
    assert waits.mean() == pytest.approx(25_000, rel=1e-6 + SIGMAS * cv / math.sqrt(waits.size))
    assert waits.std() == pytest.approx(25_000 * cv, rel=0.02, abs=1)
    if cv:
        deviation = math.sqrt(math.log1p(cv**2))
        scaled = np.log(waits / 25_000) / deviation + deviation / 2
        assert stats.kstest(scaled.ravel()[:20_000], "norm").pvalue > UNLIKELY
        assert stats.pearsonr(scaled[:, 1:].ravel(), scaled[:, :-1].ravel()).pvalue > UNLIKELY


def test_each_hot_pixel_has_its_own_rate_and_regularity() -> None:
    """Rates log-normal about their median, CV even in its logarithm, neither depends on the other (1e-6)."""
    events = static(noisy(hot(1.0, 20.0, 0.8, cv=(0.05, 0.5))), [0, 100 * SECOND_US])
    waits = [own for own in waits_of(events) if len(own) > 200]
    rates = np.array([1e6 / own.mean() for own in waits])
    log_rates = np.log(rates / 20) / 0.8
    assert len(waits) > 4_000
    assert stats.kstest(log_rates, "norm").pvalue > UNLIKELY
    cv = np.array([own.std() / own.mean() for own in waits])
    share = np.log(cv / 0.05) / math.log(10)
    assert stats.kstest(share, "uniform").statistic < 0.04
    assert stats.spearmanr(share, log_rates).pvalue > UNLIKELY
    assert stats.pearsonr(share[1:], share[:-1]).pvalue > UNLIKELY


@pytest.mark.parametrize("cv", [0.05, 0.5])
def test_hot_pixels_have_fired_for_long(cv: float) -> None:
    """From the first frame on there are as many in every stretch: within five standard errors at most."""
    events = static(noisy(hot(1.0, 10.0, cv=(cv, cv)), side=128), [0, SECOND_US], side=128)
    made = np.histogram(events["t"], 40, (0, SECOND_US))[0]
    assert np.abs(made / (128**2 * 0.25) - 1).max() < SIGMAS / math.sqrt(128**2 * 0.25)


def test_which_pixels_are_hot_depends_on_the_seed_alone() -> None:
    """Not on the rate, on other effects, on threads or on what is seen; a larger share keeps the smaller one's."""

    def chosen(effects: Effects, luma: float = 0.0, **settings: Any) -> npt.NDArray[np.bool_]:
        events = static(noisy(effects, **settings), [0, 10 * SECOND_US], luma)
        return counts_of(events) > 0

    first = chosen(hot(0.05, 10.0))
    np.testing.assert_array_equal(chosen(hot(0.05, 300.0), 5.0), first)
    others = Effects(hot_pixels=hot(0.05, 10.0).hot_pixels, threshold_mismatch=0.3, photoreceptor_bandwidth_hz=10.0)
    np.testing.assert_array_equal(chosen(others, c=1.0, threads=2), first)
    assert np.all(chosen(hot(0.2, 10.0))[first])
    assert stats.fisher_exact(_table(chosen(hot(0.05), seed=1), first)).pvalue > UNLIKELY


def _table(a: npt.NDArray[np.bool_], b: npt.NDArray[np.bool_]) -> list[list[int]]:
    return [[int((a & b).sum()), int((a & ~b).sum())], [int((~a & b).sum()), int((~a & ~b).sum())]]


def test_a_hot_pixel_is_reset_by_its_own_events() -> None:
    """A signal so slow that it never gets as far as C between two of them makes no event; a fast one does."""
    alone = static(noisy(hot(1.0, 200.0), side=8), [0, SECOND_US], side=8)
    streams = []
    for rate in (1.0, 100.0):
        engine = CrossingEngine(8, 8, contrast_threshold=0.15, effects=hot(1.0, 200.0))
        streams.append(collect(engine.push_log(t, scene(rate * t * 1e-6, 8, 8)) for t in (0, SECOND_US)))
    np.testing.assert_array_equal(streams[0], alone)
    assert len(streams[1]) > 2 * len(alone)


def test_shot_noise_and_hot_pixels_do_not_know_of_each_other() -> None:
    """Pixels that are not hot have the shot noise's events, hot ones their own among all."""
    both = Effects(shot_noise_rms=shot(100.0).shot_noise_rms, hot_pixels=hot(0.2, 150.0).hot_pixels)
    one, two, joined = (static(noisy(effects), [0, SECOND_US], 0.0) for effects in (shot(100.0), hot(0.2, 150.0), both))
    chosen = counts_of(two) > 0
    cold = [events[~chosen[events["y"], events["x"]]] for events in (one, joined)]
    np.testing.assert_array_equal(cold[0], cold[1])
    assert np.all(np.isin(two[["t", "x", "y", "p"]], joined[["t", "x", "y", "p"]]))
    assert len(joined) > len(one) > 300_000
