"""Sensors fitted to events: hidden parameters are found within their errors, and what is not told is said so."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from command_line import davis_rs as command
from davis_rs import (
    CrossingEngine,
    SensorParameters,
    load_sensor,
    measure_recording,
    measure_stream,
    open_writer,
    save_sensor,
)
from davis_rs.calibrate.sensor import SensorFit, fit_sensor
from davis_rs.calibrate.sensor.finding import Finding, KnownParameters
from davis_rs.calibrate.sensor.measured_recording import MeasuredRecording
from davis_rs.calibrate.sensor.noise_fit import refuted_noise
from davis_rs.calibrate.sensor.quiet_pixels import neighbours_with_events
from davis_rs.calibrate.sensor.signal_samples import SignalSampler
from davis_rs.calibrate.sensor.static_scene import before_a_leak
from davis_rs.events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from davis_rs.inspection.statistics.stream_statistics import Measured
from davis_rs.sensor.effects import Effects, HotPixels, LeakRate, ShotNoise
from davis_rs.sensor.presets import SENSORS, SensorFile, read_sensor_file
from hidden_sensors import (
    MOVES_US,
    OVER_LIGHT,
    STRIP,
    HiddenSensor,
    HiddenStaticSensor,
    draw,
    draw_static,
    pulls,
    pulls_over_light,
    record,
    static_pulls,
    static_recordings,
)

WIDTH, HEIGHT = 120, 90


def static_scene(effects: Effects, duration_s: float, seed: int, *, before_s: float = 0.0) -> EventArray:
    """What pixels make of light that does not change, and that they have leaked in for long. References of noisy ones
    begin anywhere below the signal, too.

    Args:
        before_s: what comes before is left out. With noise a leak's first event of each pixel comes early, because
            references begin anywhere below a level, and not where noise would have brought them.
    """
    engine = CrossingEngine(
        WIDTH, HEIGHT, contrast_threshold=0.2, effects=effects.engine_settings(), seed=seed, interpolation="linear"
    )
    luma = np.full((HEIGHT, WIDTH), 0.2, np.float32)
    steps = np.linspace(1, (before_s + duration_s) * 1e6, 12).astype(np.int64).tolist()
    still = effects.leak_rate_hz is None and effects.shot_noise_rms is None
    engine.push(0, luma if still else before_a_leak(luma, engine, seed))
    events = concatenate_events([engine.push(t_us, luma) for t_us in steps])
    return events[events["t"] > before_s * 1e6]


def noise(rate_hz: float) -> ShotNoise:
    """Noise events of both polarities together, in any light of these tests."""
    return ShotNoise.of_rate(rate_hz, 0.2, half_luma=math.inf)


def found(fit: SensorFit, parameter: str) -> Measured | None:
    [value] = [one.value for one in fit.findings if one.parameter == parameter]
    return value


def fitted(*streams: EventArray) -> SensorFit:
    return fit_sensor([measure_stream(events, size=(WIDTH, HEIGHT)) for events in streams])


@pytest.mark.long
@pytest.mark.parametrize(
    ("pulls_of", "parameters"),
    [(pulls, HiddenSensor._fields[:9]), (pulls_over_light, OVER_LIGHT), (static_pulls, HiddenStaticSensor._fields[:5])],
    ids=["moving, with frames", "the same in known light", "static, in known light"],
)
def test_hidden_parameters_are_found_within_their_errors(
    pulls_of: Callable[[int, int], dict[str, float]], parameters: tuple[str, ...]
) -> None:
    """The first 12 recordings of ``python benches/sensor_fit.py``. chi^2 is what chance allows, once in a thousand
    draws beyond it at either end, so errors are neither too small nor far too large, but for the leak of static scenes,
    whose error is the model's own. None is beyond 5 sigma. Two thirds of the recordings tell each, but with frames
    alone half of them tell the source follower, whose lag is short next to what noise does to the times of events."""
    found: dict[str, list[float]] = {}
    recordings = 12
    for number in range(recordings):
        for name, pull in pulls_of(7001, number).items():
            found.setdefault(name, []).append(pull)
    assert set(found) == set(parameters)
    for name, listed in found.items():
        least_told = 1 / 2 if (pulls_of, name) == (pulls, "source_follower_bandwidth_hz") else 2 / 3
        assert len(listed) >= least_told * recordings, name
        least, most = chi2.ppf([1e-3, 1 - 1e-3], len(listed))
        if (pulls_of, name) == (static_pulls, "leak_rate_hz"):
            least /= 10
        assert least < np.sum(np.square(listed)) < most, (name, listed)
        assert np.abs(listed).max() < 5, name


@pytest.mark.long
def test_a_leak_is_told_from_noise() -> None:
    """Noise comes in pairs: without a leak none is found, and its rate in this light is reported, not fitted."""
    stream = measure_stream(static_scene(Effects(shot_noise_rms=noise(0.4)), 20.0, 3), size=(WIDTH, HEIGHT))
    fit = fit_sensor([stream], SensorFile(SensorParameters(contrast_threshold=0.2)))
    leak = found(fit, "leak_rate_hz")
    assert leak is not None
    assert leak.value < 3 * leak.sigma < 0.1
    assert found(fit, "shot_noise_rms") is None
    [said] = [one.note for one in fit.findings if one.parameter == "shot_noise_rms"]
    rate = re.search(r"it makes ([\d.]+) \+- ([\d.]+) Hz here", said)
    assert rate is not None
    assert abs(float(rate[1]) - 0.4) < 4 * float(rate[2])


@pytest.mark.long
def test_pixels_that_all_see_signal_give_no_leak() -> None:
    """Where each pixel has events, what neighbours have in common tells: a texture that drifts under noise."""
    sensor, rng = draw(1, 1)
    events, _ = record(sensor._replace(leak_rate_hz=0.02), rng, 1)
    events = events[(events["y"] >= STRIP) & (events["t"] < MOVES_US)]
    fit = fit_sensor([measure_stream(events, size=(80, 72), quiet=(0, STRIP, 80, 72))])
    assert found(fit, "leak_rate_hz") is None
    [said] = [one.note for one in fit.findings if one.parameter == "leak_rate_hz"]
    assert re.search(r"see signal: they have [\d.]+ OFF events and [\d.]+ ON events more", said)


def test_quiet_pixels_that_see_signal_give_no_leak() -> None:
    """Edges everywhere: neighbours fire together, and it is said."""
    rng = np.random.default_rng(1)
    sweeps = []
    for k in range(20):
        y, x = np.nonzero(np.kron(rng.random((23, 30)) < 0.1, np.ones((4, 4)))[:HEIGHT])
        sweep = np.zeros(len(x), EVENT_DTYPE)
        sweep["t"], sweep["x"], sweep["y"], sweep["p"] = 50_000 * k, x, y, k % 3 > 0
        sweeps.append(sweep)
    events = concatenate_events(sweeps)
    fit = fitted(events)
    assert found(fit, "leak_rate_hz") is None
    assert "not identifiable from these recordings; the quietest pixels of events see signal" in str(fit)


def test_the_scatter_of_leaks_needs_events_and_little_noise(long: bool) -> None:
    """Each reason why it is not told; and a bound where pixels are alike."""
    few = fitted(static_scene(Effects(leak_rate_hz=0.1), 20.0, 1))
    assert re.search(
        r"leak's spread +not identifiable from these recordings; quiet pixels have 2 leak events", str(few)
    )
    if long:
        noisy = fitted(static_scene(Effects(leak_rate_hz=1.0, shot_noise_rms=noise(2.0)), 20.0, 1, before_s=5.0))
        assert re.search(r"leak's jitter .*; quiet pixels have [\d.]+ noise events of each polarity for", str(noisy))
    jittered, alike = (
        fitted(static_scene(Effects(leak_rate_hz=LeakRate(1.0, spread=0.0, jitter=jitter)), 20.0, 1))
        for jitter in (0.25, 0.0)
    )
    for one in (jittered, alike):
        assert re.search(r"leak's spread +not identifiable from these recordings; it is at most 0.0\d", str(one))
    jitter = found(alike, "leak_jitter")
    assert jitter is not None
    assert jitter.value < 1e-3


def test_a_smooth_change_of_light_is_no_spread() -> None:
    """A slow signal that differs over the sensor changes rates smoothly: neighbours still agree."""
    leak = Effects(leak_rate_hz=LeakRate(1.0, spread=0.0, jitter=0.0)).engine_settings()
    engine = CrossingEngine(WIDTH, HEIGHT, contrast_threshold=0.2, effects=leak, seed=1, interpolation="linear")
    ramp = np.linspace(0.0, 2.0, WIDTH, dtype=np.float32) + np.zeros((HEIGHT, 1), np.float32)
    pieces = [engine.push(t_s * 1_000_000, 0.2 * np.exp(ramp * t_s / 20)) for t_s in range(21)]
    fit = fit_sensor([measure_stream(concatenate_events(pieces), size=(WIDTH, HEIGHT), quiet=(0, 0, WIDTH, HEIGHT))])
    assert found(fit, "leak_spread") is None
    assert re.search(r"leak's spread .*; it is at most 0.0\d", str(fit))


@pytest.mark.long
def test_noise_needs_light_and_thresholds() -> None:
    """Each reason why it is not told. In one light the base's half light is taken, in two it is found."""
    sensor = draw_static(7001, 0)
    dark, light = static_recordings(sensor, 0)
    base = SensorFile(sensor.known)

    def said(fit: SensorFit) -> str:
        [line] = [line for line in str(fit).splitlines() if line.startswith("shot noise ")]
        return line

    assert "the recordings' light is not known (--lux); it makes" in said(fit_sensor([dark.statistics], base))
    assert "its rms needs thresholds (--base); it makes" in said(fit_sensor([dark, light]))
    assert "its rms needs the light in which its square is halved" in said(fit_sensor([dark], base))
    both = fit_sensor([dark, light], base)
    for name in ("shot_noise_rms", "shot_noise_half_lux"):
        value = found(both, name)
        assert value is not None, name
        assert abs(value.value - getattr(sensor, name)) < 4 * value.sigma
    half = replace(sensor.known, shot_noise_rms=1.0, shot_noise_half_lux=sensor.shot_noise_half_lux)
    one = fit_sensor([light], SensorFile(half))
    value = found(one, "shot_noise_rms")
    assert value is not None
    assert abs(value.value - sensor.shot_noise_rms) < 4 * value.sigma
    assert found(one, "shot_noise_half_lux") is None
    with pytest.raises(ValueError, match=r"lux must be finite and > 0, or None, got -1\.0"):
        measure_recording(np.zeros(0, EVENT_DTYPE), size=(4, 4), lux=-1.0)


def test_pairs_of_neighbours_are_counted() -> None:
    """Against the chance of independent pixels, on which a pixel with many events has no weight."""
    rng = np.random.default_rng(0)
    counts, quiet = rng.poisson(0.1, (200, 200)), np.ones((200, 200), np.bool_)
    counts[50, 50] = 10_000
    pairs = neighbours_with_events(counts, quiet)
    assert abs(pairs.observed - pairs.expected) < 4 * math.sqrt(pairs.expected)
    assert pairs.expected == pytest.approx(2 * 199**2 * (1 - math.exp(-0.1)) ** 2, rel=0.05)
    together = np.kron(rng.poisson(0.1, (50, 50)), np.ones((4, 4), np.int64))
    assert neighbours_with_events(together, quiet).observed > 4 * neighbours_with_events(together, quiet).expected


def test_several_recordings_tell_more_than_one() -> None:
    """The error shrinks; bounds are the tightest; another size is another sensor."""
    effects = Effects(leak_rate_hz=0.15)
    streams = [static_scene(effects, 10.0, seed) for seed in range(3)]
    one, three = fitted(streams[0]), fitted(*streams)
    alone, together = found(one, "leak_rate_hz"), found(three, "leak_rate_hz")
    assert alone is not None
    assert together is not None
    assert together.sigma < alone.sigma  # not by the root of 3: what the model errs stays
    assert abs(together.value - 0.15) < 4 * together.sigma
    bounds = [fitted(stream).refractory_bound_us for stream in streams]
    assert three.refractory_bound_us == min(bound for bound in bounds if bound is not None)
    with pytest.raises(ValueError, match="the recordings must be of one sensor: their sizes are 120 x 90, 240 x 180"):
        fit_sensor([measure_stream(streams[0], size=size) for size in ((WIDTH, HEIGHT), (240, 180))])
    with pytest.raises(ValueError, match="events: there are no two events at different times"):
        fitted(streams[0][:1])
    with pytest.raises(ValueError, match="at least one recording is needed"):
        fit_sensor([])


def test_what_is_not_found_comes_from_the_base(tmp_path: Path) -> None:
    """With its sources; what was found has the recordings as its source, and its error. A file stands for a base."""
    fit = fitted(static_scene(Effects(leak_rate_hz=0.05), 10.0, 0))
    base = SensorFile(
        SensorParameters(vignetting=4.0, leak_rate_hz=1.0), "mine", {"vignetting": "a", "leak_rate_hz": "b"}
    )
    made = fit.file(base)
    assert (made.parameters.width, made.parameters.height) == (WIDTH, HEIGHT)
    assert (made.parameters.vignetting, made.sources["vignetting"]) == (4.0, "a")
    assert made.parameters.leak_rate_hz == pytest.approx(0.05, rel=0.2)
    assert made.sources["leak_rate_hz"].startswith("fitted to events; ON less OFF")
    assert 0 < made.uncertainties["leak_rate_hz"] < 0.01
    assert made.description == "Fitted to events. mine"
    assert fit.file().parameters.vignetting is None
    path = save_sensor(tmp_path / "mine.yaml", base.parameters, description="mine", sources=base.sources)
    assert fit.file(path) == fit.file(str(path)) == made
    stream = measure_stream(static_scene(Effects(leak_rate_hz=0.05), 10.0, 0), size=(WIDTH, HEIGHT))
    assert fit_sensor([stream], path) == fit_sensor([stream], base)
    with pytest.raises(
        ValueError, match="the recordings have 120 x 90 pixels, the sensor that gives all else has 240 x"
    ):
        fit.file(SensorFile(SENSORS["davis240c"]))


@pytest.mark.long
def test_a_refractory_period_above_the_bound_is_left_out() -> None:
    """A recording that contradicts the base wins; one that allows it changes nothing."""
    fit = fitted(static_scene(Effects(shot_noise_rms=noise(20.0)), 5.0, 0))
    bound = fit.refractory_bound_us
    assert bound is not None
    assert f"at most {bound:,} us" in str(fit)
    held = SensorFile(SensorParameters(refractory_period_us=bound + 1.0), "", {"refractory_period_us": "a"})
    assert fit.file(held).parameters.refractory_period_us is None
    assert "the recordings refute what was given" in fit.file(held).sources["refractory_period_us"]
    allowed = SensorFile(SensorParameters(refractory_period_us=float(bound)))
    assert fit.file(allowed).parameters.refractory_period_us == bound


def test_noise_that_dark_pixels_would_show_is_refuted() -> None:
    """In the mean light noise would make next to none; half of the quiet pixels are dark, and have no events."""
    noisy = SensorParameters(
        contrast_threshold=0.2, shot_noise_rms=0.06, shot_noise_half_lux=10.0, shot_noise_bandwidth_hz=300.0
    )
    known = KnownParameters([], SensorFile(noisy))
    stream = measure_stream(static_scene(Effects(leak_rate_hz=0.02), 5.0, 1), size=(WIDTH, HEIGHT))
    samples = SignalSampler(WIDTH, HEIGHT, []).finish()
    values = np.full((HEIGHT, WIDTH), 1.0)
    values[: HEIGHT // 2] = 399.0
    recording = MeasuredRecording(stream, samples=samples._replace(mean=values), lux=200.0)
    lights = recording.lux_of_quiet
    assert lights is not None
    assert lights.mean() == pytest.approx(200.0, rel=0.05)
    assert (lights.min(), lights.max()) == pytest.approx((1.0, 399.0), rel=0.4)
    assert refuted_noise([stream], [np.array([200.0])], known) == {}
    assert "shot_noise_rms" in refuted_noise([stream], [lights], known)
    assert refuted_noise([stream], [None], known) == {}


def test_a_bandwidth_that_is_found_leaves_the_noise_of_the_base() -> None:
    """It takes the photoreceptor's place, from which the noise's fall with light was derived."""
    bandwidth = Finding("bandwidth", "source_follower_bandwidth_hz", Measured(137.0, 10.0))
    base = SensorFile(SENSORS["davis240c"])
    made = SensorFit((240, 180), ("one",), (bandwidth,), None).file(base)
    assert made.parameters.photoreceptor_bandwidth_hz is None
    assert made.parameters.shot_noise_half_lux == base.parameters.noise_half_lux == pytest.approx(95.42, abs=0.01)
    assert "shot_noise_half_lux" in made.sources
    told = SensorFile(replace(SENSORS["davis240c"], shot_noise_half_lux=50.0), "", {"shot_noise_half_lux": "a"})
    kept = SensorFit((240, 180), ("one",), (bandwidth,), None).file(told)
    assert (kept.parameters.shot_noise_half_lux, kept.sources["shot_noise_half_lux"]) == (50.0, "a")


def test_the_command_writes_a_sensor_that_simulates_alike(tmp_path: Path) -> None:
    """The circle: a recording, its sensor, a simulation with it, and the same quiet rate."""
    path = tmp_path / "one.npy"
    with open_writer(path, (WIDTH, HEIGHT)) as writer:
        writer.write(static_scene(Effects(leak_rate_hz=0.1, hot_pixels=HotPixels(2e-3, rate_hz=20)), 15.0, 1))
    save_sensor(tmp_path / "base.yaml", SensorParameters(contrast_threshold=0.3), sources={"contrast_threshold": "x"})
    words: list[Any] = ["calibrate", "sensor", path, "--size", f"{WIDTH}x{HEIGHT}", "--quiet"]
    done = command(*words, "-o", tmp_path / "fit.yaml", "--base", tmp_path / "base.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^leak +0\.\d+ \+- 0\.\d+ Hz; ON less OFF", done.stdout, re.MULTILINE)
    assert re.search(r"^refractory period +not identifiable from these recordings; at most", done.stdout, re.MULTILINE)
    sensor = load_sensor(tmp_path / "fit.yaml")
    assert sensor.contrast_threshold == 0.3
    assert read_sensor_file(tmp_path / "fit.yaml").sources["hot_pixel_fraction"].startswith("fitted to one.npy; ")
    again = static_scene(sensor.effects(1000.0), 15.0, 9)
    before, after = (measure_stream(one, size=(WIDTH, HEIGHT)) for one in (path, again))
    sigma = math.hypot(before.quiet_rate_hz.sigma, after.quiet_rate_hz.sigma)
    assert abs(before.quiet_rate_hz.value - after.quiet_rate_hz.value) < 4 * sigma
    assert len(after.hot_pixels) == pytest.approx(len(before.hot_pixels), abs=4 * math.sqrt(2 * len(before.hot_pixels)))
    lit = command(*words, "--lux", 100, "--base", tmp_path / "base.yaml")
    assert re.search(
        r"^shot noise +not identifiable from these recordings; quiet pixels have too few OFF", lit.stdout, re.M
    )
    failed = command(*words, "--lux", 100, 200)
    assert failed.returncode == 1
    assert "--lux must have a value for each of 1 recordings, got 2" in failed.stderr
    failed = command(*words, "--base", "davis24")
    assert failed.returncode == 1
    assert "did you mean davis240c?" in failed.stderr
