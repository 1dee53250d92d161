"""Noise: shot noise and hot pixels, their laws, and that neither depends on frames, threads or each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray
from davis_rs.sensor.effects import HotPixels, PhotoreceptorBandwidth, ShotNoise
from effects_reference import collect, scene
from noise_oracle import TwoPoles, noisy_events
from strategies import random_paths

UNLIKELY = 1e-6
"""The significance of every statistical test here; seeds are fixed."""

SIGMAS = 5.0
"""As many standard errors are allowed about a mean: 6e-7 of a normal distribution."""

SECOND_US = 1_000_000
SILENT = 1e3
"""A threshold that no signal here reaches: what comes is from hot pixels."""

FOLLOWER_HZ = 300.0

NOISE = ShotNoise(0.05, half_luma=1.0, bandwidth_hz=FOLLOWER_HZ)


def noisy(effects: Effects, *, side: int = 64, seed: int = 0, c: float = SILENT, **settings: Any) -> CrossingEngine:
    return CrossingEngine(side, side, contrast_threshold=c, effects=effects, seed=seed, **settings)


def static(engine: CrossingEngine, times_us: Any, luma: float = 0.0, side: int = 64) -> EventArray:
    """What a scene that does not change makes of frames at these times."""
    return collect(engine.push(int(t), np.full((side, side), luma, np.float32)) for t in times_us)


def by_pixel(events: EventArray) -> EventArray:
    """In the order of pixels, and of time in each."""
    return events[np.lexsort((events["t"], events["x"], events["y"]))]


def counts_of(events: EventArray, side: int = 64) -> npt.NDArray[np.int64]:
    counts = np.zeros((side, side), np.int64)
    np.add.at(counts, (events["y"], events["x"]), 1)
    return counts


# Shot noise.


def at_phase(
    noise: ShotNoise,
    light: float,
    phase: float,
    seconds: float,
    *,
    c: tuple[float, float] = (0.2, 0.2),
    side: int = 32,
    frames: int = 1,
    **effects: Any,
) -> EventArray:
    """Events of pixels that stand still at a phase: that far above their reference, in units of C_on.

    The signal steps there in a microsecond, after which the light is the asked one.
    """
    settings: dict[str, Any] = {"contrast_threshold": c[0], "contrast_threshold_off": c[1]}
    engine = CrossingEngine(side, side, effects=Effects(shot_noise_rms=noise, **effects), **settings)
    here = scene(math.log(light), side, side)
    engine.push_log(0, here - phase * c[0])
    times = np.unique(np.linspace(1, seconds * SECOND_US, frames + 1).astype(int))
    return collect(engine.push_log(int(t), here) for t in times)


def poles_of(noise: ShotNoise, light: float) -> TwoPoles:
    return TwoPoles(noise.bandwidth_hz * light / noise.half_luma, noise.bandwidth_hz, float(noise.sigma(light)))


def apart(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> float:
    """How many standard errors two means lie apart, the scatter being that of the samples."""
    error = math.sqrt(a.var() / a.size + b.var() / b.size)
    return float(a.mean() - b.mean()) / error if error else 0.0


def oracle_counts(noise: ShotNoise, light: float, phase: float, seconds: float, pixels: int) -> npt.NDArray[np.int64]:
    """Events of each pixel, followed in small steps."""
    _, pixel, _ = noisy_events(
        poles_of(noise, light), (0.2, 0.2), lambda _: phase * 0.2, pixels=pixels, seconds=seconds
    )
    return np.bincount(pixel.astype(int), minlength=pixels)


@pytest.mark.few(1)
@pytest.mark.parametrize(("light", "phase"), [(0.3, 0.5), (1.5, 0.3)])
def test_noise_makes_as_many_events_as_when_followed_in_small_steps(light: float, phase: float) -> None:
    """300 pixels for half a second against 4,096: means of their counts, by their own scatter."""
    noise = ShotNoise(0.09, bandwidth_hz=FOLLOWER_HZ)
    expected = oracle_counts(noise, light, phase, 0.5, 300)
    made = counts_of(at_phase(noise, light, phase, 0.5, side=64))
    assert expected.mean() > 4
    assert abs(apart(made, expected)) < 4


@pytest.mark.long
def test_rates_over_phase_light_and_threshold_are_those_of_small_steps() -> None:
    """60 points: chi-square over their number within 0.5 to 1.6, none beyond four standard errors.

    Scatter where events are few is Poisson's, of pairs.
    """
    scores = []
    for light in (0.01, 0.1, 0.7, 3.0, 20.0):
        for rms_in_c in (0.15, 0.3, 0.5):
            for phase in (0.0, 0.3, 0.5, 0.8):
                noise = ShotNoise(0.2 * rms_in_c * math.sqrt(1 + light), bandwidth_hz=30.0)
                seconds, pixels = min(2.0, 2 / max(light, 0.5)), 500
                expected = oracle_counts(noise, light, phase, seconds, pixels)
                made = counts_of(at_phase(noise, light, phase, seconds, side=48), 48).ravel()
                both = (expected.sum() + made.sum()) / (expected.size + made.size)
                error = math.sqrt(max(expected.var(), 2 * both) / expected.size + max(made.var(), 2 * both) / made.size)
                scores.append((made.mean() - expected.mean()) / error if error else 0.0)
    assert len(scores) == 60
    counted = np.array([score for score in scores if score])
    assert np.abs(counted).max() < 4
    assert 0.5 < np.mean(counted**2) < 1.6


@pytest.mark.long
@pytest.mark.parametrize("slope", [5.0, 40.0])
def test_noise_moves_the_events_of_a_signal_as_in_small_steps(slope: float) -> None:
    """A ramp from rest: mean and scatter of each pixel's first event, the scatter within 5 %."""
    noise, light, c = ShotNoise(0.03, half_luma=math.inf, bandwidth_hz=100.0), 1.0, 0.2
    poles, seconds = TwoPoles(100.0, 100.0, 0.03), 0.4 / slope
    t, pixel, _ = noisy_events(poles, (c, c), lambda t: slope * t, pixels=20_000, seconds=seconds)
    expected = np.array([t[i] for i in np.unique(pixel, return_index=True)[1]])
    engine = CrossingEngine(128, 128, contrast_threshold=c, effects=Effects(shot_noise_rms=noise))
    engine.push_log(0, scene(math.log(light), 128, 128))
    events = engine.push_log(int(seconds * SECOND_US), scene(math.log(light) + slope * seconds, 128, 128))
    first = np.unique(events["y"].astype(int) * 128 + events["x"], return_index=True)[1]
    made = events["t"][first] * 1e-6
    assert len(made) == 128**2
    assert made.std() == pytest.approx(expected.std(), rel=0.05)
    assert made.mean() == pytest.approx(expected.mean(), abs=4 * expected.std() / 120 + poles.step_s)


def test_jitter_of_a_step_falls_with_light() -> None:
    """An edge of twice the threshold through a low-pass: the scatter of its first event goes with the noise's."""
    scatter = []
    for light in (0.1, 1.0, 10.0):
        noise = ShotNoise(0.02, bandwidth_hz=FOLLOWER_HZ)
        effects = Effects(
            shot_noise_rms=noise, photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(math.inf, FOLLOWER_HZ)
        )
        engine = CrossingEngine(32, 32, contrast_threshold=0.2, effects=effects)
        engine.push_log(0, scene(math.log(light), 32, 32))
        engine.push_log(1, scene(math.log(light) + 0.4, 32, 32))
        events = engine.push_log(4_000, scene(math.log(light) + 0.4, 32, 32))
        first = by_pixel(events)
        first = first[np.diff(first["y"].astype(int) * 32 + first["x"], prepend=-1) != 0]
        scatter.append(float(first["t"].std()) / float(noise.sigma(light * 1.3)))
    assert scatter == pytest.approx([scatter[0]] * 3, rel=0.15)


EVERY = [(light, rms) for light in (0.02, 0.3, 4.0) for rms in (0.03, 0.05, 0.07)]
SHORT = [(0.02, 0.07), (0.3, 0.05), (4.0, 0.03)]


@pytest.mark.parametrize(
    ("light", "rms"), [pytest.param(*each, marks=[] if each in SHORT else pytest.mark.long) for each in EVERY]
)
def test_the_rate_is_the_one_that_is_told(light: float, rms: float) -> None:
    """In the mean over phases, and at three of them: within a tenth and five standard errors."""
    noise = ShotNoise(rms * math.sqrt(1 + light), bandwidth_hz=FOLLOWER_HZ)
    for phase in (0.1, 0.3, 0.5):
        counts = counts_of(at_phase(noise, light, phase, 3.0), 32)
        told = float(noise.rate_hz(0.2, 0.2, light, phase)) * 3.0
        error = SIGMAS * math.sqrt(max(float(counts.var()), 2 * told) / counts.size)
        assert counts.mean() == pytest.approx(told, rel=0.1, abs=error)
    phases = np.linspace(-0.995, 0.995, 200)
    mean = float(noise.rate_hz(0.2, 0.2, light, phases).mean())
    assert float(noise.rate_hz(0.2, 0.2, light)) == pytest.approx(mean, rel=0.02)
    assert noise.rate_hz(0.2, 0.2, light, 0.4) == pytest.approx(float(noise.rate_hz(0.2, 0.2, light, 0.6)), rel=0.02)


@pytest.mark.parametrize("rate_hz", [0.01, 1.0, 40.0])
def test_the_noise_of_a_rate_has_that_rate(rate_hz: float) -> None:
    noise = ShotNoise.of_rate(rate_hz, 0.2)
    lights = np.geomspace(1e-4, 100, 400)
    assert noise.rate_hz(0.2, 0.2, lights).max() == pytest.approx(rate_hz, rel=1e-2)
    here = ShotNoise.of_rate(rate_hz, 0.2, light=3.0, floor=0.001)
    assert here.rate_hz(0.2, 0.2, 3.0) == pytest.approx(rate_hz, rel=1e-6)
    anywhere = ShotNoise.of_rate(rate_hz, 0.2, half_luma=math.inf)
    np.testing.assert_allclose(anywhere.rate_hz(0.2, 0.2, [0.0, 9.0]), rate_hz, rtol=1e-6)
    with pytest.raises(ValueError, match="must lie below"):
        ShotNoise.of_rate(1e5, 0.2)


@pytest.mark.long
def test_noise_of_a_static_scene_does_not_depend_on_its_frames() -> None:
    """One interval, many, and irregular ones, on any number of threads: the same bytes."""
    random = np.random.default_rng(3)
    streams = []
    for frames, threads in ((1, 1), (313, 2), (0, 3)):
        engine = noisy(
            Effects(shot_noise_rms=NOISE, hot_pixels=HotPixels(0.1, 300.0)), c=0.1, threads=threads, log_eps=1e-9
        )
        times = [0, *sorted({SECOND_US // 2, *random.integers(1, SECOND_US // 2, 200).tolist()})]
        streams.append(static(engine, np.linspace(0, SECOND_US // 2, frames + 1) if frames else times, 0.3))
    assert len(streams[0]) > 100_000
    assert streams[1].tobytes() == streams[0].tobytes()
    assert streams[2].tobytes() == streams[0].tobytes()


@pytest.mark.long
def test_a_moving_scene_has_the_same_law_for_any_frames() -> None:
    """A sine of three thresholds seen by 20 and by 200 frames: counts of pixels, by their scatter."""
    counts = []
    for frames in (20, 200):
        engine = noisy(Effects(shot_noise_rms=ShotNoise(0.05, half_luma=math.inf)), c=0.1, side=32, seed=frames)
        engine.push_log(0, scene(0.0, 32, 32))
        t = np.linspace(0, 1, frames + 1)[1:]
        wave = np.interp(t, np.linspace(0, 1, 21), 0.3 * np.sin(np.linspace(0, 8, 21)))
        events = collect(
            engine.push_log(round(at * SECOND_US), scene(value, 32, 32)) for at, value in zip(t, wave, strict=True)
        )
        counts.append(counts_of(events, 32))
    assert counts[0].mean() > 30
    assert abs(apart(*counts)) < 4


def test_noise_events_come_in_pairs() -> None:
    """The event after one of noise is of the opposite polarity, nearly always, and references stay about the signal."""
    noise = ShotNoise.of_rate(4.0, 0.2, half_luma=math.inf, bandwidth_hz=200.0)
    for period_us in (None, 3.37):
        own = by_pixel(at_phase(noise, 1.0, 0.0, 4.0, refractory_period_us=period_us))
        same = np.diff(own["x"].astype(int)) == 0
        assert same.sum() > 80
        assert np.mean(np.diff(own["p"].astype(int))[same] != 0) > 0.97


@pytest.mark.parametrize("period_us", [None, 1.0, 3.37])
def test_noise_does_not_hide_slow_contrast(period_us: float | None) -> None:
    """A ramp of 0.1 a second for 12 s under noise: ON less OFF events are those of the ramp."""
    noise = ShotNoise.of_rate(5.0, 0.2, half_luma=math.inf)
    effects = Effects(shot_noise_rms=noise, refractory_period_us=period_us)
    engine = CrossingEngine(16, 16, contrast_threshold=0.2, effects=effects)
    events = collect(engine.push_log(t * SECOND_US, scene(0.1 * t, 16, 16)) for t in range(13))
    net = 2 * int((events["p"] == 1).sum()) - len(events)
    assert len(events) > 256 * 20
    assert 0.2 * net / 256 == pytest.approx(1.2, abs=0.11)


def test_a_long_hold_memorises_what_it_ends_with() -> None:
    """Held for longer than noise remembers, references after a first event scatter about the signal as noise does."""
    engine = CrossingEngine(
        64, 64, contrast_threshold=0.1, effects=Effects(shot_noise_rms=NOISE, refractory_period_us=50_000.0)
    )
    here = scene(0.0, 64, 64)
    engine.push_log(0, here)
    engine.push_log(1, here + 0.15)  # all pixels are held from now on
    engine.push_log(50_002, here + 0.15)
    memorised = engine.reference[np.isfinite(engine.reference)] - 0.15
    sigma = float(NOISE.sigma(math.exp(0.15)))
    assert len(memorised) > 3000
    assert memorised.std() == pytest.approx(sigma, rel=SIGMAS / math.sqrt(2 * len(memorised)))
    assert memorised.mean() == pytest.approx(0.0, abs=SIGMAS * sigma / 50)


def test_the_rate_is_that_of_the_light_not_of_the_photoreceptor() -> None:
    """Behind a slow photoreceptor that keeps the signal where it was, noise gets fewer as it gets bright."""
    bandwidth = PhotoreceptorBandwidth(math.inf, source_follower_hz=1e-3)
    made = []
    for luma in (0.3, 10.0):
        engine = noisy(Effects(shot_noise_rms=NOISE, photoreceptor_bandwidth_hz=bandwidth), c=0.1, side=16)
        engine.push_log(0, scene(math.log(0.3), 16, 16))
        engine.push_log(1, scene(math.log(luma), 16, 16))
        made.append(len(engine.push_log(SECOND_US // 2, scene(math.log(luma), 16, 16))))
    assert made[0] > 1_000
    assert made[1] < made[0] / 50


def test_a_floor_is_left_in_bright_light() -> None:
    """The standard deviation of what a reset memorises comes to the floor."""
    noise = ShotNoise(0.05, floor=0.02)
    assert noise.sigma(1e9) == pytest.approx(0.02, rel=1e-6)
    assert noise.sigma(1.0) == pytest.approx(math.sqrt((0.05**2 + 0.02**2) / 2))
    rates = []
    for each in (noise, ShotNoise(0.05)):
        counts = counts_of(at_phase(each, 50.0, 0.5, 0.3, c=(0.09, 0.09)), 32)
        told = float(each.rate_hz(0.09, 0.09, 50.0, 0.5)) * 0.3
        assert counts.mean() == pytest.approx(told, rel=0.1, abs=SIGMAS * math.sqrt(2 * max(told, 0.01) / counts.size))
        rates.append(counts.mean())
    assert rates[0] > 10 * rates[1]
    assert not ShotNoise(0.0, floor=0.01).neutral
    with pytest.raises(ValueError, match="floor must be 0"):
        CrossingEngine(2, 2, effects=Effects(shot_noise_rms=ShotNoise(0.1, math.inf, floor=0.1)))


def test_stationary_phases_begin_without_a_burst() -> None:
    """What a camera that has run before memorised lies within both thresholds of signal and noise together."""
    engine = noisy(Effects(shot_noise_rms=NOISE), c=0.1, start_phase="stationary")
    events = static(engine, [0, 1, SECOND_US // 10], 0.1)
    assert (events["t"] <= 1).sum() < 10
    assert len(events) > 4096


def test_no_threshold_is_too_high_for_noise() -> None:
    """Where there is none, time costs nothing; a state goes on; an interval without end is refused."""
    engine = noisy(Effects(shot_noise_rms=ShotNoise(1e-9)), side=8, c=10.0)
    assert len(static(engine, [0, SECOND_US, 10**9], side=8)) == 0
    assert CrossingEngine.from_state(engine.state()).state()["t_us"] == 10**9
    with pytest.raises(ValueError, match="shot_noise_rms of bandwidth_hz 300"):
        static(engine, [10**15], side=8)
    assert engine.state()["t_us"] == 10**9


def test_a_stored_state_goes_on() -> None:
    """Into the middle of a cell, and where cells were left out: the same bytes."""
    frames = random_paths(64, 30).reshape(30, 8, 8)
    effects = Effects(shot_noise_rms=NOISE, refractory_period_us=200.0)
    whole = noisy(effects, side=8, c=0.1)
    events = [whole.push_log(k * 777, frame) for k, frame in enumerate(frames)]
    engine = noisy(effects, side=8, c=0.1)
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(engine.push_log(k * 777, frame), events[k])
        engine = CrossingEngine.from_state(engine.state())
    assert sum(map(len, events)) > 200


def test_draws_of_noise_are_no_others() -> None:
    """Another seed has other events; pixels do not share theirs."""
    first, again, other = (
        static(noisy(Effects(shot_noise_rms=NOISE), c=0.1, seed=seed), [0, SECOND_US // 4], 0.3) for seed in (1, 1, 2)
    )
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    counts = counts_of(first).astype(float)
    assert stats.pearsonr(counts[1:].ravel(), counts[:-1].ravel()).pvalue > UNLIKELY
    assert stats.pearsonr(counts[:, 1:].ravel(), counts[:, :-1].ravel()).pvalue > UNLIKELY


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


@pytest.mark.long
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


@pytest.mark.long
def test_shot_noise_and_hot_pixels_do_not_know_of_each_other() -> None:
    """Pixels that are not hot have the shot noise's events, hot ones their own among all."""
    both = Effects(shot_noise_rms=NOISE, hot_pixels=hot(0.2, 150.0).hot_pixels)
    one, two, joined = (
        static(noisy(effects, c=0.1), [0, SECOND_US // 2], 0.3)
        for effects in (Effects(shot_noise_rms=NOISE), hot(0.2, 150.0), both)
    )
    chosen = counts_of(two) > 0
    cold = [events[~chosen[events["y"], events["x"]]] for events in (one, joined)]
    np.testing.assert_array_equal(cold[0], cold[1])
    assert np.all(np.isin(two[["t", "x", "y", "p"]], joined[["t", "x", "y", "p"]]))
    assert len(joined) > len(one) > 50_000
