"""Noise: shot noise and hot pixels, their laws, and that neither depends on frames, threads or each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from davis_rs import CrossingEngine, Effects
from davis_rs.effects import HotPixels, ShotNoise
from davis_rs.events import EventArray
from effects_reference import collect, scene
from strategies import EPOCH_US, random_paths

UNLIKELY = 1e-6
"""The significance of every statistical test here; seeds are fixed."""

SIGMAS = 5.0
"""As many standard errors are allowed about a mean: 6e-7 of a normal distribution."""

SECOND_US = 1_000_000
SILENT = 1e3
"""A threshold that no signal here reaches: what comes is noise."""


def noisy(effects: Effects, *, side: int = 64, seed: int = 0, c: float = SILENT, **settings: Any) -> CrossingEngine:
    return CrossingEngine(side, side, contrast_threshold=c, effects=effects, seed=seed, **settings)


def shot(rate_hz: float, half_luma: float = 1.0) -> Effects:
    return Effects(shot_noise_rate_hz=ShotNoise(rate_hz, half_luma))


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
def test_shot_noise_is_a_poisson_process_in_each_pixel(luma: float) -> None:
    """4,096 pixels for 2 s at a mean of 40 events: counts Poisson, waits exponential (chi-square, 1e-6).

    Thinned by light it is one as well.
    """
    rate_hz = 20.0 * (1 + luma)
    engine = noisy(shot(rate_hz))
    events = static(engine, [0, 2 * SECOND_US], luma)
    counts = counts_of(events)
    assert_poisson(counts, 40.0)
    assert counts.min() >= 10
    assert_exponential(events, SECOND_US / 20, 10, 64)


@pytest.mark.parametrize("half_luma", [1.0, 0.05])
def test_the_rate_falls_with_luma(half_luma: float) -> None:
    """rate / (1 + luma / half_luma), black included: counts of a second within five standard errors."""
    lumas = np.array([0.0, 0.01, 0.1, 1.0, 10.0, 1000.0], np.float32)
    engine = CrossingEngine(6, 500, contrast_threshold=SILENT, effects=shot(300.0, half_luma))
    frame = np.broadcast_to(lumas, (500, 6))
    engine.push(0, frame)
    events = engine.push(SECOND_US, frame)
    for x, luma in enumerate(lumas):
        expected = 500 * 300.0 / (1 + luma / half_luma)
        assert abs((events["x"] == x).sum() - expected) < SIGMAS * math.sqrt(expected)


@pytest.mark.parametrize("rate_hz", [1e-3, 0.1, 0.4])
def test_a_rate_far_below_one_event_a_second_is_on(rate_hz: float) -> None:
    """As those of dim scenes are: 100 s in the dark."""
    events = static(noisy(shot(rate_hz)), [0, 100 * SECOND_US])
    expected = rate_hz * 100 * 4096
    assert abs(len(events) - expected) < SIGMAS * math.sqrt(expected)


def test_the_rate_follows_luma_within_an_interval() -> None:
    """Along a line of log intensity over one second the events of each tenth have the rate of their own luma."""
    low, high = math.log(0.01), math.log(10.0)
    engine = noisy(shot(400.0), log_eps=1e-12)
    engine.push_log(0, scene(low, 64, 64))
    events = engine.push_log(SECOND_US, scene(high, 64, 64))
    observed = np.histogram(events["t"], 10, (0, SECOND_US))[0]
    s = (np.arange(10_000) + 0.5) / 10_000
    expected = 400.0 * 4096 * (1 / (1 + np.exp(low + (high - low) * s))).reshape(10, 1_000).mean(1) / 10
    assert np.all(np.abs(observed - expected) < SIGMAS * np.sqrt(expected))
    assert observed[0] > 5 * observed[-1]


@pytest.mark.parametrize("luma", [0.0, 1.0, 99.0])
def test_both_polarities_are_alike(luma: float) -> None:
    """ON is binomial with 1/2 (1e-6), whether light thins the process or not, and independent of the event before."""
    events = static(noisy(shot(20.0 * (1 + luma))), [0, SECOND_US], luma)
    on = int(events["p"].sum())
    assert stats.binomtest(on, len(events), 0.5).pvalue > UNLIKELY
    own = events["p"][np.lexsort((events["t"], events["x"], events["y"]))].astype(float)
    assert stats.pearsonr(own[1:], own[:-1]).pvalue > UNLIKELY


def test_noise_of_a_static_scene_does_not_depend_on_its_frames() -> None:
    """One interval, many, and irregular ones, on any number of threads: the same bytes."""
    effects = Effects(shot_noise_rate_hz=200.0, hot_pixels=HotPixels(0.1, 300.0))
    ends = [0, SECOND_US]
    random = np.random.default_rng(3)
    times = [ends, range(0, SECOND_US + 1, 1_000), sorted({*ends, *random.integers(0, SECOND_US, 300).tolist()})]
    streams = [static(noisy(effects, threads=1 + k), at, 0.3) for k, at in enumerate(times)]
    assert len(streams[0]) > 600_000
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
    assert len(shared) < 50  # 200,000 events each, on 4e9 ticks of pixels: 10 by chance


def test_noise_leaves_the_reference_where_it_is() -> None:
    """A moving scene has its own events and the noise's, none more and none less; the reference is the ideal one's."""
    side, effects = 16, shot(500.0, half_luma=1e12)
    frames = random_paths(side * side, 40).reshape(40, side, side)
    ideal, engine, alone = (
        CrossingEngine(side, side, contrast_threshold=c, effects=on)
        for c, on in ((0.15, None), (0.15, effects), (SILENT, effects))
    )
    streams = [
        collect(each.push_log(k * 10_000, frame) for k, frame in enumerate(frames)) for each in (ideal, engine, alone)
    ]
    assert min(len(streams[0]), len(streams[2])) > 5_000
    both = np.sort(np.concatenate([streams[0], streams[2]]), order=("t", "y", "x", "p"))
    np.testing.assert_array_equal(np.sort(streams[1], order=("t", "y", "x", "p")), both)
    np.testing.assert_array_equal(engine.reference, ideal.reference)
    assert np.all(engine.last_event_us == np.maximum(ideal.last_event_us, alone.last_event_us))


def test_the_rate_is_that_of_the_light_not_of_the_photoreceptor() -> None:
    """Behind a slow photoreceptor a moving scene has the same noise."""
    frames = random_paths(16 * 16, 40).reshape(40, 16, 16)
    fast, slow = (
        noisy(Effects(shot_noise_rate_hz=ShotNoise(500.0, 0.5), photoreceptor_bandwidth_hz=hz), side=16)
        for hz in (None, 0.1)
    )
    streams = [collect(each.push_log(k * 10_000, frame) for k, frame in enumerate(frames)) for each in (fast, slow)]
    assert len(streams[0]) > 1_000
    np.testing.assert_array_equal(*streams)  # type: ignore[arg-type]


@pytest.mark.parametrize("period_us", [30_000.0, 7_777.25, 1e15])
def test_a_refractory_period_lets_through_what_noise_comes_later(period_us: float) -> None:
    """In each pixel the arrivals are those without it, less what falls within T after one that was let through."""
    side, end_us = 3, 2 * SECOND_US
    free = static(noisy(shot(100.0), side=side, seed=2), [0, end_us], side=side)
    effects = Effects(shot_noise_rate_hz=100.0, refractory_period_us=period_us)
    held = static(noisy(effects, side=side, seed=2), range(0, end_us + 1, 1_000), side=side)
    until = np.full((side, side), -math.inf)
    expected = []
    for event in free:
        wait = event["t"] - until[event["y"], event["x"]]
        assert abs(wait) > 1, "ticks cannot tell; take another seed"
        if wait > 0:
            expected.append(event)
            until[event["y"], event["x"]] = event["t"] + period_us
    np.testing.assert_array_equal(held, np.array(expected))
    assert len(held) < 0.8 * len(free)


def test_a_megahertz_of_noise_has_all_its_events() -> None:
    """A microsecond apart on average, several on a tick: none is lost, each tick in raster order."""
    events = static(noisy(shot(1e6), side=4), range(0, 20_001, 500), side=4)
    assert abs(len(events) - 16 * 20_000) < SIGMAS * math.sqrt(16 * 20_000)
    assert np.all(np.diff(events["t"].astype(np.int64) * 100 + events["y"] * 10 + events["x"]) >= 0)


# Hot pixels.


def hot(fraction: float, rate_hz: float = 10.0) -> Effects:
    return Effects(hot_pixels=HotPixels(fraction, rate_hz))


@pytest.mark.parametrize("fraction", [0.001, 0.05, 0.5])
def test_hot_pixels_are_a_binomial_share_and_fire_on_events(fraction: float) -> None:
    """Of 65,536 pixels (1e-6), each a Poisson process of mean 30 (chi-square); all others are silent."""
    events = static(noisy(hot(fraction, 30.0), side=256), [0, SECOND_US], side=256)
    counts = counts_of(events, 256)
    chosen = int((counts > 0).sum())
    assert stats.binomtest(chosen, counts.size, fraction).pvalue > UNLIKELY
    assert all(events["p"] == 1)
    assert counts.sum() == pytest.approx(30.0 * chosen, abs=SIGMAS * math.sqrt(30.0 * chosen))
    if chosen > 1_000:
        assert_poisson(counts[counts > 0], 30.0)


def test_waits_of_hot_pixels_are_exponential() -> None:
    """All pixels hot: chi-square of waits, in black and in bright light alike."""
    streams = [static(noisy(hot(1.0, 40.0)), [0, SECOND_US], luma) for luma in (0.0, 1e6)]
    assert streams[0].tobytes() == streams[1].tobytes()
    assert_poisson(counts_of(streams[0]), 40.0)
    assert_exponential(streams[0], SECOND_US / 40, 10, 64)


def test_which_pixels_are_hot_depends_on_the_seed_alone() -> None:
    """Not on the rate, on other effects, on threads or on what is seen; a larger share keeps the smaller one's."""

    def chosen(effects: Effects, luma: float = 0.0, **settings: Any) -> npt.NDArray[np.bool_]:
        events = static(noisy(effects, **settings), [0, 10 * SECOND_US], luma)
        return counts_of(events) > 0

    first = chosen(hot(0.05, 10.0))
    np.testing.assert_array_equal(chosen(hot(0.05, 300.0), 5.0), first)
    others = Effects(hot_pixels=HotPixels(0.05, 10.0), threshold_mismatch=0.3, photoreceptor_bandwidth_hz=10.0)
    np.testing.assert_array_equal(chosen(others, c=1.0, threads=2), first)
    assert np.all(chosen(hot(0.2, 10.0))[first])
    assert stats.fisher_exact(_table(chosen(hot(0.05), seed=1), first)).pvalue > UNLIKELY


def _table(a: npt.NDArray[np.bool_], b: npt.NDArray[np.bool_]) -> list[list[int]]:
    return [[int((a & b).sum()), int((a & ~b).sum())], [int((~a & b).sum()), int((~a & ~b).sum())]]


def test_a_hot_pixel_sees_the_scene_as_well() -> None:
    """Its events are the ideal pixel's and those of its own process."""
    side = 16
    frames = random_paths(side * side, 30).reshape(30, side, side)
    engines = [
        CrossingEngine(side, side, contrast_threshold=c, effects=effects)
        for c, effects in ((0.15, None), (0.15, hot(0.3, 200.0)), (SILENT, hot(0.3, 200.0)))
    ]
    ideal, seen, alone = (
        collect(engine.push_log(k * 10_000, frame) for k, frame in enumerate(frames)) for engine in engines
    )
    both = np.sort(np.concatenate([ideal, alone]), order=("t", "y", "x", "p"))
    np.testing.assert_array_equal(np.sort(seen, order=("t", "y", "x", "p")), both)
    assert min(len(ideal), len(alone)) > 1_000


def test_shot_noise_and_hot_pixels_do_not_know_of_each_other() -> None:
    """Together they make the events of each alone."""
    one, two = shot(100.0), hot(0.2, 150.0)
    both = Effects(shot_noise_rate_hz=100.0, hot_pixels=HotPixels(0.2, 150.0))
    streams = [static(noisy(effects), [0, SECOND_US], 0.0) for effects in (one, two, both)]
    joined = np.sort(np.concatenate(streams[:2]), order=("t", "y", "x", "p"))
    np.testing.assert_array_equal(np.sort(streams[2], order=("t", "y", "x", "p")), joined)
