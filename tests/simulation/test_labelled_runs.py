"""Labels of signal and noise of a run: by a twin without noise, which sees the same keyframes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import Dataset, Effects, Scene, SignalLabels, Simulator, label_signal, load_scene
from davis_rs.cli import main
from davis_rs.events.arrays import EventArray
from davis_rs.events.filters import BackgroundActivity, score_filters
from davis_rs.generate.sequence_arrays import read_sequence
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.inspection.check import check_dataset
from davis_rs.inspection.summary import dataset_contents
from davis_rs.sensor.effects import EFFECTS
from davis_rs.sensor.effects.effects import NOISE

SMALL = Camera(32, 24, 30.0, 30.0, 16.0, 12.0)
FAST: dict[str, Any] = {"rays_per_pixel": 1, "accuracy": "fast", "camera": SMALL, "threads": 1}
NOISY = Effects(leak_rate_hz=5, shot_noise_rms=0.08, hot_pixels=0.01, threshold_mismatch=0.05, refractory_period_us=100)
QUIET = Effects(threshold_mismatch=0.05, refractory_period_us=100)


def moving() -> Scene:
    return load_scene("three_planes").crop(0.0, 0.1)


def at_rest() -> Scene:
    scene = load_scene("three_planes")
    pose = scene.path.pose(0.0)
    return scene.with_trajectory(SegmentTrajectory(pose, pose, 1.0))


def events_of(scene: Scene, effects: Effects, **more: Any) -> EventArray:
    return np.concatenate([packet.events for packet in Simulator(scene, effects=effects, **FAST, **more).run()])


@pytest.mark.parametrize("accuracy", ["fast", "balanced", "exact"])
def test_the_twin_is_the_run_without_noise_and_leaves_the_run_as_it_is(accuracy: str) -> None:
    """Both streams are, byte for byte, those of runs of their own with the same seed; a readout holds some longer."""
    bus, settings = Effects(readout=2e5), {**FAST, "accuracy": accuracy}
    with_bus = [effects.with_defaults(bus) for effects in (NOISY, QUIET)]
    packets = list(Simulator(moving(), effects=with_bus[0], signal_window_us=10_000, **settings).run())
    for attribute, effects in zip(("events", "noiseless"), with_bus, strict=True):
        alone = [packet.events for packet in Simulator(moving(), effects=effects, **settings).run()]
        together = np.concatenate([getattr(packet, attribute) for packet in packets])
        assert len(together) > 1000
        assert np.array_equal(together, np.concatenate(alone))
    for packet in packets:
        assert packet.noiseless is not None
        assert ((packet.noiseless["t"] > packet.start_us) & (packet.noiseless["t"] <= packet.end_us)).all()


def test_without_a_window_there_is_no_twin() -> None:
    assert all(packet.noiseless is None for packet in Simulator(moving(), effects=NOISY, **FAST).run())


def test_labels_need_no_keyframes_of_their_own() -> None:
    """The run renders the same instants, each once."""
    rendered: list[list[int]] = [[], []]
    for labelled, times in zip((None, 10_000), rendered, strict=True):

        def note(t_us: int, _: int, times: list[int] = times) -> None:
            times.append(t_us)

        list(Simulator(moving(), effects=NOISY, signal_window_us=labelled, **FAST).run(after_keyframe=note))
    assert rendered[0]
    assert rendered[0] == rendered[1]


def test_a_folder_has_a_label_for_each_event(tmp_path: Path) -> None:
    """They are those of the whole streams, matched by brute force; counts add up, and the check holds."""
    davis_rs.simulate_to_folder(moving(), tmp_path / "d", effects=NOISY, signal_window_us=5000, quiet=True, **FAST)
    dataset = Dataset(tmp_path / "d")
    clean = events_of(moving(), QUIET)
    whole = label_signal(dataset.events, clean, size=(32, 24), window_us=5000)
    comparison = davis_rs.compare_events(dataset.events, clean, size=(32, 24), window_us=5000)
    assert np.array_equal(dataset.signal, whole)
    assert np.array_equal(np.load(tmp_path / "d" / "signal.npy"), whole)
    assert 0.3 < whole.mean() < 0.97  # a mixture, or the test is worth little
    counts = dataset.meta["counts"]
    assert counts["signal_events"] == int(whole.sum()) == comparison.matched
    assert counts["events"] - counts["signal_events"] == comparison.spurious
    assert check_dataset(tmp_path / "d").ok
    assert f"signal      {whole.mean():.1%} of the events, the others are noise" in dataset_contents(dataset)
    assert np.array_equal(read_sequence(tmp_path / "d").groups["events"]["signal"], whole)
    again = davis_rs.simulate_to_folder(moving(), tmp_path / "d", overwrite=True, quiet=True, **FAST)
    assert again.events
    assert not (tmp_path / "d" / "signal.npy").exists()


@pytest.mark.parametrize("effects", [Effects(), QUIET, Effects(readout=1e5, threshold_mismatch=0.1)])
def test_without_noise_all_is_signal(tmp_path: Path, effects: Effects) -> None:
    davis_rs.simulate_to_folder(
        moving(), tmp_path / "d", effects=effects, signal_window_us=0, quiet=True, accuracy="exact",
        **{name: value for name, value in FAST.items() if name != "accuracy"},
    )  # fmt: skip
    dataset = Dataset(tmp_path / "d")
    assert len(dataset.signal) == len(dataset.events) > 1000
    assert dataset.signal.all()


@pytest.mark.parametrize("effects", [Effects(leak_rate_hz=5), Effects(hot_pixels=0.1), Effects(shot_noise_rms=0.1)])
def test_at_rest_all_is_noise(tmp_path: Path, effects: Effects) -> None:
    davis_rs.simulate_to_folder(at_rest(), tmp_path / "d", effects=effects, signal_window_us=10_000, quiet=True, **FAST)
    dataset = Dataset(tmp_path / "d")
    assert len(dataset.signal) == len(dataset.events) > 50
    assert not dataset.signal.any()


def test_frames_are_labelled_too(tmp_path: Path) -> None:
    """From the command line, with noise on a bar that moves."""
    column = np.arange(40)
    frames = np.stack([np.broadcast_to(100 + 100 * (abs(column - k) < 3), (30, 40)) for k in range(0, 40, 2)])
    frames = frames.astype(np.uint8)
    np.save(tmp_path / "bar.npy", frames)
    words = ["frames", str(tmp_path / "bar.npy"), "--fps", "100", "--interpolation", "linear", "--quiet"]
    noise = ["--effect", "leak_rate_hz=5", "--effect", "shot_noise_rms=0.05"]
    assert main([*words, "-o", str(tmp_path / "noisy"), "--signal-window", "10000", *noise]) == 0
    assert main([*words, "-o", str(tmp_path / "clean")]) == 0
    noisy, clean = Dataset(tmp_path / "noisy"), Dataset(tmp_path / "clean")
    assert np.array_equal(noisy.signal, label_signal(noisy.events, clean.events, size=(40, 30)))
    assert 0.1 < noisy.signal.mean() < 0.99
    assert check_dataset(tmp_path / "noisy").ok
    settings: dict[str, Any] = {"fps": 100, "interpolation": "linear", "image_rate_hz": 333}
    noisy_effects = ["leak_rate_hz=5", "readout=2e4"]
    packets = list(davis_rs.events_from_frames(frames, effects=noisy_effects, signal_window_us=10, **settings))
    alone = davis_rs.events_from_frames(frames, effects=["readout=2e4"], **settings)
    assert np.array_equal(
        np.concatenate([packet.noiseless for packet in packets]), np.concatenate([packet.events for packet in alone])
    )


def test_a_filter_is_judged_by_the_labels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command prints what the labels say; a part of the events, or others, are not judged."""
    davis_rs.simulate_to_folder(moving(), tmp_path / "d", effects=NOISY, signal_window_us=10_000, quiet=True, **FAST)
    dataset, chosen = Dataset(tmp_path / "d"), BackgroundActivity(2000)
    passed = davis_rs.filters.filter_events(dataset.events, chosen, (32, 24))
    score = score_filters(dataset.events, dataset.signal, chosen, (32, 24))
    assert score.signal == int(dataset.signal.sum())
    assert score.noise == int((~dataset.signal).sum())
    assert score.signal_passed + score.noise_passed == len(passed) < len(dataset.events)
    assert score.signal_kept > 1 - score.noise_removed  # better than chance
    words = ["filter", str(tmp_path / "d"), str(tmp_path / "f.raw"), "--background-activity", "2000", "--quiet"]
    assert main(words) == 0
    assert f"by signal.npy: {score}" in capsys.readouterr().out
    part = davis_rs.convert(tmp_path / "d", tmp_path / "p.raw", filters=[chosen], start_us=10_000, parts=())
    assert part.filter_score is None
    with pytest.raises(ValueError, match=r"signal must have a label for each of \d+ events, got the shape \(3,\)"):
        score_filters(dataset.events, [True] * 3, chosen, (32, 24))


def test_wrong_labels_are_told(tmp_path: Path) -> None:
    davis_rs.simulate_to_folder(moving(), tmp_path / "d", effects=NOISY, signal_window_us=10_000, quiet=True, **FAST)
    path = tmp_path / "d" / "signal.npy"
    labels = np.load(path)
    np.save(path, labels[:-1])
    assert f"signal.npy labels {len(labels) - 1} events, the folder holds {len(labels)}." in str(
        check_dataset(path.parent)
    )
    for wrong in (labels.astype(np.float32), labels[None]):
        np.save(path, wrong)
        with pytest.raises(davis_rs.DecodeError, match=r"signal\.npy: expected bool \(n,\), found"):
            _ = Dataset(path.parent).signal
    path.write_bytes(b"signal")
    with pytest.raises(davis_rs.DecodeError, match=r"signal\.npy: "):
        _ = Dataset(path.parent).signal


class Copies:
    """Doubles all events."""

    def events(self, start_us: int, end_us: int | None, events: EventArray) -> EventArray:
        return np.repeat(events, 2)


def test_what_cannot_be_labelled_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="signal_window_us cannot tell which events of custom_effects on events"):
        Simulator(moving(), custom_effects=[Copies()], signal_window_us=10, **FAST)
    with pytest.raises(SystemExit):
        main(["simulate", "three_planes", "-o", "x", "--label-signal-noise"])
    assert "did you mean --signal-window?" in capsys.readouterr().err


def test_steps_have_a_twin_too() -> None:
    """Packets of steps are labelled as those of a run."""
    scene = moving()
    simulator = Simulator(scene, effects=NOISY, signal_window_us=10_000, **FAST)
    labels, told, count = SignalLabels((32, 24)), 0, 0
    for t_us in range(0, 50_001, 5000):
        for packet in simulator.step(t_us, scene.path.pose(t_us * 1e-6)):
            told += len(labels.add(packet.events, packet.noiseless, packet.end_us))
            count += len(packet.events)
    assert told + len(labels.finish()) == count == labels.signal + labels.noise
    assert labels.signal
    assert labels.noise


def test_every_effect_is_noise_or_is_not() -> None:
    """An effect that is new must be looked at: does it make events without a change of light?"""
    others = {"vignetting", "lens_blur_px", "photoreceptor_bandwidth_hz", "threshold_mismatch", "refractory_period_us"}
    assert EFFECTS.keys() == {*NOISE, *others, "readout", "aps"}
    described = json.dumps(NOISY.noiseless.describe())
    assert not any(name in described for name in NOISE)
