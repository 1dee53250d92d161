"""What a fit takes from frames: instants, values, and what there is to say where they do not tell."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from command_line import davis_rs as command
from davis_rs import CrossingEngine, FrameSource, StampedFrame, load_sensor, measure_stream, open_writer, read_events
from davis_rs.calibrate.sensor import fit_sensor, measure_recording
from davis_rs.calibrate.sensor.frame_noise import FrameNoise, NoiseSampler, fit_frame_noise
from davis_rs.calibrate.sensor.frame_source import of_camera, open_frames
from davis_rs.calibrate.sensor.leak_fit import find_leak
from davis_rs.calibrate.sensor.noise_fit import noise_of_threshold
from davis_rs.calibrate.sensor.signal_samples import SignalSampler
from davis_rs.calibrate.sensor.static_scene import static_events
from davis_rs.calibrate.sensor.threshold_fit import ThresholdFit, fit_thresholds
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.events.decoded import Frame
from davis_rs.inspection.statistics.stream_statistics import Measured
from davis_rs.io.formats.bag import BagWriter
from davis_rs.sensor.parameters import SensorParameters
from davis_rs.sensor.presets import SensorFile
from hidden_sensors import HEIGHT, STRIP, WIDTH, draw, draw_over_light, record, recorded

ON, OFF = 0.13, 0.17


def waves(t_s: float) -> npt.NDArray[np.float64]:
    """Log intensity of 40 x 32 pixels: waves of their own phases, brightness and speed."""
    rng = np.random.default_rng(4)
    phase, mean, hz = rng.uniform(0, 6.28, (32, 40)), rng.uniform(-2.5, -1, (32, 40)), rng.uniform(1, 3, (32, 40))
    return mean + np.sin(2 * np.pi * hz * t_s + phase)


@pytest.fixture(scope="module")
def ideal() -> EventArray:
    """Events of ideal pixels."""
    engine = CrossingEngine(40, 32, contrast_threshold=ON, contrast_threshold_off=OFF)
    pieces = [engine.push_log(t_us, waves(t_us * 1e-6)) for t_us in range(0, 2_000_001, 1000)]
    return np.concatenate(pieces)


def frames(*, lag_us: float = 0.0, black: float = 0.0, noise: float = 0.0) -> list[StampedFrame]:
    rng = np.random.default_rng(1)
    made = []
    for t_us in range(5_000, 2_000_000, 30_000):
        values = 1000 * np.exp(waves((t_us + lag_us) * 1e-6)) + black
        made.append(StampedFrame(float(t_us), 0.0, values + noise * rng.standard_normal(values.shape)))
    return made


def thresholds(events: EventArray, images: list[StampedFrame], cuts: int = 1) -> ThresholdFit:
    sampler = SignalSampler(40, 32, images)
    for piece in np.array_split(events, cuts):
        sampler.add(piece)
    return fit_thresholds(sampler.finish(), 40, leak_hz=Measured(0.0, 1e-4))


def test_samples_of_ideal_pixels_have_the_signal(ideal: EventArray) -> None:
    """Events with their fractions are the signal itself, far closer than what whole counts leave of a level."""
    sampler = SignalSampler(40, 32, frames())
    sampler.add(ideal)
    samples = sampler.finish().samples
    assert len(samples) > 20_000
    t_s, pixel = samples["t_s"], samples["pixel"]
    truth = np.array([waves(t).ravel() for t in np.unique(t_s)])[np.searchsorted(np.unique(t_s), t_s), pixel]
    found = waves(0.0).ravel()[pixel] + ON * samples["on"] - OFF * samples["off"]
    straight = samples["turns"] == 0
    assert np.sqrt(np.mean((found - truth)[straight] ** 2)) < 0.03 * ON
    whole = waves(0.0).ravel()[pixel] + ON * np.floor(samples["on"]) - OFF * np.floor(samples["off"])
    assert np.sqrt(np.mean((whole - truth)[straight] ** 2)) > 0.4 * ON


def test_thresholds_of_ideal_pixels_are_exact_however_the_stream_is_cut(ideal: EventArray) -> None:
    """With noise of frames, which is no bias: it is in the response alone."""
    found = thresholds(ideal, frames(noise=3.0))
    assert found.on.value == pytest.approx(ON, rel=0.005)
    assert found.off.value == pytest.approx(OFF, rel=0.005)
    assert found.mismatch is None or found.mismatch.value < 0.02
    again = thresholds(ideal, frames(noise=3.0), cuts=37)
    assert again.on.value == pytest.approx(found.on.value, rel=1e-6)


def test_lag_and_black_level_are_found_with_the_thresholds(ideal: EventArray) -> None:
    """Frames that are stamped 2 ms late, over a black level of 25 values, leave thresholds as they are."""
    found = thresholds(ideal, frames(lag_us=-2_000.0, black=25.0, noise=2.0))
    assert found.lag_s.value == pytest.approx(-2e-3, abs=1e-4)
    assert found.black.value == pytest.approx(25, abs=2)
    assert found.on.value == pytest.approx(ON, rel=0.01)
    assert found.off.value == pytest.approx(OFF, rel=0.01)


def test_noise_makes_lags_larger_and_less_certain(ideal: EventArray) -> None:
    """By 4 times its variance, up to 16 %; beyond that lags stay as they are, and err by 16 %."""
    sampler = SignalSampler(40, 32, frames(lag_us=1_000.0))
    sampler.add(ideal)
    samples = sampler.finish()
    below, above = (fit_thresholds(samples, 40, leak_hz=Measured(0.0, 1e-4), noise=noise) for noise in (0.199, 0.201))
    assert below.lag_s.value * (1 - 4 * 0.199**2) == pytest.approx(above.lag_s.value, rel=5e-3)
    assert below.lag_s.sigma > 0.039 * below.lag_s.value
    assert above.lag_s.sigma > 0.16 * above.lag_s.value


@pytest.mark.long
def test_a_lag_is_divided_into_what_goes_with_light_and_what_does_not() -> None:
    """Of 1.6 ms where it is as bright as the strip; thresholds that scatter leave both parts as they are."""
    sensor, rng = draw_over_light(3, 1)
    sensor = sensor._replace(
        contrast_threshold=0.12, contrast_threshold_off=0.12, threshold_mismatch=0.15, noise_hz=0.0, leak_rate_hz=1e-6,
        hot_pixel_fraction=1e-9, aps_read_noise_dn=0.5, exposure_us=500,
        source_follower_bandwidth_hz=300.0, photoreceptor_bandwidth_hz=100.0,
    )  # fmt: skip
    samples = recorded(sensor, rng, 1).samples
    assert samples is not None
    found = fit_thresholds(samples, WIDTH, over_light=True)
    assert found.lag_by_light is not None
    assert found.lag_s.value == pytest.approx(1 / (2 * np.pi * 300), rel=0.03)
    in_strip = found.lag_by_light.value / (samples.mean[:STRIP].mean() - found.black.value)
    assert in_strip == pytest.approx(1 / (2 * np.pi * 100), rel=0.02)
    assert fit_thresholds(samples, WIDTH).lag_by_light is None


@pytest.mark.long
def test_a_photoreceptor_that_is_found_is_that_of_the_quiet_pixels_light() -> None:
    """Its corner holds there, and takes the place of the base's; in other lux it is another number of the same law."""
    sensor, rng = draw_over_light(3, 2)
    sensor = sensor._replace(source_follower_bandwidth_hz=100.0)
    measured = recorded(sensor, rng, 2, lux=50.0)
    base = replace(load_sensor("davis240c"), width=None, height=None)
    made = fit_sensor([measured], SensorFile(base)).file(SensorFile(base))
    fitted, error = made.parameters, made.uncertainties
    assert fitted.photoreceptor_bandwidth_lux == 50.0
    for name in ("photoreceptor_bandwidth_hz", "source_follower_bandwidth_hz"):
        assert abs(getattr(fitted, name) - getattr(sensor, name)) < 4 * error[name] < getattr(sensor, name)
    assert fitted.noise_half_lux == base.noise_half_lux
    two = fit_sensor([measured, replace(measured, lux=150.0)], SensorFile(base)).file().parameters
    assert two.photoreceptor_bandwidth_lux == 100.0
    nothing = fit_sensor([replace(measured, lux=None)]).file().parameters
    assert nothing.photoreceptor_bandwidth_hz is None
    assert nothing.source_follower_bandwidth_hz is not None


@pytest.mark.long
def test_a_lag_of_all_brightnesses_is_no_photoreceptor(ideal: EventArray) -> None:
    """Frames that are stamped early: light is known, and one bandwidth is told all the same."""
    source = FrameSource(lambda: iter(frames(lag_us=1_000.0)), "DN")
    measured = measure_recording(ideal, size=(40, 32), frames=source, quiet=(0, 0, 8, 8))
    fit = fit_sensor([replace(measured, lux=10.0)])
    assert re.search(r"^bandwidth over light +not identifiable.*lag alike, within the errors", str(fit), re.M)
    made = fit.file().parameters
    assert made.source_follower_bandwidth_hz == pytest.approx(1000 / (2 * np.pi), rel=0.05)
    assert made == fit_sensor([measured]).file().parameters


@pytest.mark.long
def test_a_corner_is_told_by_a_certain_lag_and_its_error_is_the_larger_one(ideal: EventArray) -> None:
    """One over a lag of three errors may be anything; of more, it is less certain to higher frequencies."""

    def lag_and_corner(lag_us: float) -> tuple[Measured, Measured | None]:
        source = FrameSource(lambda: iter(frames(lag_us=lag_us, noise=3.0)), "DN")
        measured = measure_recording(ideal, size=(40, 32), frames=source)
        found = {one.parameter: one.value for one in fit_sensor([measured]).findings}
        assert measured.samples is not None
        noise = noise_of_threshold(measured.statistics)
        leak = find_leak([measured.statistics]).value
        lag = fit_thresholds(measured.samples, 40, leak_hz=leak, noise=noise).lag_s
        return lag, found["source_follower_bandwidth_hz"]

    none, _ = lag_and_corner(0.0)
    assert lag_and_corner(1e6 * (3 * none.sigma - none.value))[1] is None
    lag, corner = lag_and_corner(500.0)
    assert corner is not None
    assert corner.value == pytest.approx(1 / (2 * np.pi * lag.value))
    assert corner.sigma == pytest.approx(1 / (2 * np.pi * (lag.value - lag.sigma)) - corner.value)


def test_frames_that_are_not_of_these_events_give_no_thresholds(ideal: EventArray) -> None:
    """Mirrored ones change, but not as events say."""
    mirrored = [one._replace(values=one.values[::-1, ::-1]) for one in frames(noise=3.0)]
    source = FrameSource(lambda: iter(mirrored), "DN")
    found = str(fit_sensor([measure_recording(ideal, size=(40, 32), frames=source)]))
    assert re.search(r"^threshold ON +not identifiable from these recordings; log intensity of frames", found, re.M)
    few = FrameSource(lambda: iter(frames()[:2]), "DN")
    found = str(fit_sensor([measure_recording(ideal[:8000], size=(40, 32), frames=few)]))
    assert "2 frames make" in found, found
    alone = str(fit_sensor([measure_stream(ideal, size=(40, 32))]))
    assert re.search(r"^threshold mismatch +not identifiable from these recordings; there are no frames", alone, re.M)


def test_noise_of_frames_is_found_and_light_that_changes_is_not_taken_for_it() -> None:
    """Read noise and gain of frames of a static scene; a scene that flickers is refused."""
    rng = np.random.default_rng(3)
    level = np.linspace(50, 900, 60 * 80).reshape(60, 80)
    nothing, pattern = np.zeros((60, 80)), rng.standard_normal((60, 80))

    def fitted(flicker: float) -> FrameNoise | str:
        sampler = NoiseSampler()
        for k in range(30):
            light = level * (1 + flicker * (k % 3) * pattern)
            noisy = light + np.sqrt(2.0**2 + 0.05 * light) * rng.standard_normal(light.shape)
            sampler.add(np.rint(noisy).astype(np.float32), nothing)
        return fit_frame_noise(sampler.finish(), 0.0, 1000.0, 0.0)

    found = fitted(0.0)
    assert isinstance(found, FrameNoise)
    assert abs(found.read.value - 2.0) < 4 * found.read.sigma < 0.4
    assert abs(found.gain.value - 0.05) < 4 * found.gain.sigma < 0.01
    assert fitted(0.02) == "the light of pixels without events changes by more than the noise of frames"


@pytest.mark.long
def test_a_folder_with_frames_gives_thresholds(tmp_path: Path) -> None:
    """As a user does it: events.txt and grey frames in, stamped at the exposure's end, a sensor file out."""
    from PIL import Image

    sensor, rng = draw(1, 3)
    events, images = record(sensor, rng, 3)
    folder = tmp_path / "one"
    (folder / "images").mkdir(parents=True)
    with open_writer(folder / "events.txt", (WIDTH, HEIGHT)) as writer:
        writer.write(events)
    lines = []
    for k, image in enumerate(images):
        Image.fromarray(np.rint(image.values / 4).astype(np.uint8)).save(folder / f"images/{k}.png")
        lines.append(f"{(image.t_us + sensor.exposure_us / 2) * 1e-6:.6f} images/{k}.png\n")
    (folder / "images.txt").write_text("".join(lines))
    meta = {
        "sensor": {"width": WIDTH, "height": HEIGHT},
        "effects": {"aps": {"exposure_us": sensor.exposure_us}},
    }
    (folder / "meta.json").write_text(json.dumps(meta))
    source = open_frames(folder, (WIDTH, HEIGHT))
    assert source is not None
    assert next(source.frames()).t_us == pytest.approx(images[0].t_us, abs=1)
    done = command(
        "calibrate", "sensor", folder, "--quiet", "-o", tmp_path / "fit.yaml", "--figure", tmp_path / "fit.png"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "fit.png").stat().st_size > 20_000
    for words, truth in (
        ("threshold ON", sensor.contrast_threshold),
        ("bandwidth", sensor.source_follower_bandwidth_hz),
    ):
        found = re.search(rf"^{words} +([\d.]+) \+- ([\d.e+-]+)", done.stdout, re.M)
        assert found is not None
        assert abs(float(found[1]) - truth) < 4 * float(found[2])
    assert "in grey values of the frames" in done.stdout
    fitted = load_sensor(tmp_path / "fit.yaml")
    assert fitted.threshold_column_parity == pytest.approx(sensor.threshold_column_parity, abs=0.02)
    assert fitted.source_follower_bandwidth_hz == pytest.approx(sensor.source_follower_bandwidth_hz, rel=0.3)


def test_a_bandwidth_that_is_found_replaces_what_the_base_has_over_light(ideal: EventArray) -> None:
    """It holds in the recordings' light: next to the base's illuminance it would mean something else."""
    source = FrameSource(lambda: iter(frames(lag_us=1_000.0)), "DN")
    fit = fit_sensor([measure_recording(ideal, size=(40, 32), frames=source)])
    base = replace(load_sensor("davis240c"), width=None, height=None)
    assert base.photoreceptor_bandwidth_lux is not None
    made = fit.file(SensorFile(base, "", {"photoreceptor_bandwidth_lux": "a"})).parameters
    assert made.source_follower_bandwidth_hz == pytest.approx(1000 / (2 * np.pi), rel=0.1)
    assert made.photoreceptor_bandwidth_lux is made.photoreceptor_bandwidth_hz is None
    assert made.contrast_threshold == pytest.approx(ON, rel=0.01)


def test_a_static_scene_has_no_events_of_its_beginning() -> None:
    """Rates are those of the effects from the first second on; times count from 0."""
    sensor = SensorParameters(contrast_threshold=0.2, leak_rate_hz=0.5, leak_spread=0.0)
    events = static_events(sensor, (40, 30), 10.0)
    assert 0 < events["t"][0] < events["t"][-1] <= 10_000_000
    assert len(events) == pytest.approx(40 * 30 * 5, rel=0.02)
    assert (events["p"] == 1).all()
    with pytest.raises(ValueError, match="duration_s must be > 0"):
        static_events(sensor, (40, 30), 0.0)


def test_event_files_have_no_frames(tmp_path: Path) -> None:
    """Nothing is made up for them."""
    path = tmp_path / "one.npy"
    with open_writer(path, (4, 3)) as writer:
        writer.write(np.array([(1, 2, 1, 1), (5, 3, 2, 0)], EVENT_DTYPE))
    assert open_frames(path, (4, 3)) is None
    assert measure_recording(path, size=(4, 3)).samples is None
    assert len(read_events(path)) == 2


def test_frames_of_a_bag_and_of_a_camera_lie_where_and_when_they_were_exposed(tmp_path: Path) -> None:
    """Bags have a stamp alone; a camera's frame stands for its exposure's middle, and may be a part of the sensor."""
    pytest.importorskip("rosbags")
    path = tmp_path / "one.bag"
    with open_writer(path, (4, 3)) as writer:
        assert isinstance(writer, BagWriter)
        writer.write(np.array([(1, 2, 1, 1), (900, 3, 2, 0)], EVENT_DTYPE))
        writer.write_image(500, np.arange(12, dtype=np.uint8).reshape(3, 4))
    source = open_frames(path, (4, 3))
    assert source is not None
    [frame] = source.frames()
    assert (frame.t_us, frame.exposure_us, source.of_camera) == (500.0, 0.0, False)
    np.testing.assert_array_equal(frame.values, np.arange(12).reshape(3, 4))
    exposed = Frame(100, 110, 150, 170, 1, 2, np.full((1, 2), 64 * 7, np.uint16))
    [frame] = of_camera(iter([exposed]), (4, 3))
    assert (frame.t_us, frame.exposure_us) == (130.0, 40.0)
    assert frame.values[2].tolist()[1:3] == [7.0, 7.0]
    assert np.isfinite(frame.values).sum() == 2
