"""davis-rs frames, run as a user runs it; check, view and info of what it writes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clips import moving_bars, write_images, write_video
from davis_rs import Dataset, check_dataset, events_from_frames, frames_to_folder, open_frames
from davis_rs.cli.main import main
from davis_rs.events.arrays import concatenate_events
from davis_rs.simulation.model_version import MODEL
from tiny_onnx import blending_network

BARS = moving_bars(12)
STAMPS_MS = [20 * k + k % 3 for k in range(12)]


def run(*arguments: object) -> int:
    return main(["frames", *map(str, arguments)])


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_video(tmp_path / "clip.mkv", BARS, STAMPS_MS)


def test_a_video(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(clip, "-o", out, "--interpolation", "linear") == 0
    printed = capsys.readouterr()
    assert " events of 12 frames in 0.222 s (" in printed.out
    assert "ffv1, yuv444p, 8 bits, full range (as it says, matrix by the frame's size)" in printed.err
    assert "values 0 to 255 are luma 0 to 1, transfer srgb (the video does not say)" in printed.err
    assert "t = 0" not in printed.err
    assert "log_eps 0.0019: with 0.001 one grey level in the dark would be more than C = 0.15" in printed.err
    assert "came where the pixel changed by one grey level or less" in printed.err
    report = check_dataset(out)
    assert report.ok, report
    assert len(report.instants) == 2
    assert report.worst is not None
    dataset = Dataset(out)
    assert [frame.t_us for frame in dataset.frames] == [1000 * t for t in STAMPS_MS]
    packets = events_from_frames(open_frames(clip), interpolation="linear")
    assert np.array_equal(dataset.events, concatenate_events([packet.events for packet in packets]))
    assert not (out / "calib.txt").exists()
    for command in (["check", out], ["info", out], ["view", out, "-o", tmp_path / "view.png"]):
        assert main([str(word) for word in command]) == 0, command
    assert main(["convert", str(out), str(tmp_path / "events.aedat4"), "--quiet"]) == 0


def test_images_with_stamps_and_a_stack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same frames and stamps make the same events, whichever file they come in."""
    folder, stack = write_images(tmp_path / "in", BARS), tmp_path / "stack.npy"
    np.save(stack, BARS)
    (tmp_path / "times.txt").write_text("".join(f"{7 + t / 1000:.6f}\n" for t in STAMPS_MS))
    np.save(tmp_path / "times.npy", np.array(STAMPS_MS) * 1000)
    assert run(folder, "--timestamps", tmp_path / "times.txt", "-o", tmp_path / "a") == 0
    assert "t = 0 is 7 s on the clock of the frames\n" in capsys.readouterr().err
    assert run(stack, "--timestamps", tmp_path / "times.npy", "-o", tmp_path / "b", "--quiet") == 0
    assert (tmp_path / "a/events.txt").read_bytes() == (tmp_path / "b/events.txt").read_bytes()
    meta = json.loads((tmp_path / "a/meta.json").read_text())
    assert meta["start_time_ns"] == 7_000_000_000
    assert meta["model"] == MODEL
    assert run(tmp_path / "a", "-o", tmp_path / "c", "--quiet") == 0  # a dataset's frames are frames too
    assert Dataset(tmp_path / "c").frames[-1].t_us == 1000 * STAMPS_MS[-1]


def test_a_run_without_events_says_why(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert run(clip, "-o", tmp_path / "out", "--contrast-threshold", 15, "--quiet") == 0
    assert "davis-rs: warning: the contrast threshold 15 is above the whole range" in capsys.readouterr().err


def test_settings_reach_the_run_and_the_record(clip: Path, tmp_path: Path) -> None:
    options = (
        "--sensor davis240c --crop 32x24 --size 240x180",
        "--crop 40x30 --size 20x15 --contrast-threshold 0.2 --effect refractory_period_us=3000 --seed 3 --log-eps 0.01",
    )
    assert run(clip, "-o", tmp_path / "bad", *options[0].split()) == 1
    assert not (tmp_path / "bad").exists()
    out = tmp_path / "out"
    assert (
        run(clip, "-o", out, *options[1].split(), "--start", 0.02, "--stop", 0.2, "--images-every", 3, "--quiet") == 0
    )
    meta = json.loads((out / "meta.json").read_text())
    assert meta["sensor"] == {"width": 20, "height": 15}
    assert meta["parameters"]["contrast_threshold"] == 0.2
    assert meta["parameters"]["log_eps"] == 0.01
    assert meta["effects"] == {"refractory_period_us": {"us": 3000}} or "refractory_period_us" in meta["effects"]
    assert meta["frames"]["stamps"] == "container"
    assert meta["frames"]["part"] == {"left": 4, "top": 1, "width": 40, "height": 30, "size": [20, 15]}
    assert meta["counts"]["frames"] == 3
    report = check_dataset(out)
    assert report.ok, report
    assert report.void == ["refractory_period_us"]


def test_a_fitted_size_is_told_and_recorded(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(clip, "-o", out, "--size", "96x80", "--fit", "pad", "--stop", 0.1) == 0
    assert "48 x 32 pixels of each frame are enlarged to 96 x 64: that adds no detail" in capsys.readouterr().err
    meta = json.loads((out / "meta.json").read_text())
    assert meta["sensor"] == {"width": 96, "height": 80}
    assert meta["parameters"]["fit"] == "pad"
    part = {"left": 0, "top": 0, "width": 48, "height": 32, "size": [96, 80], "image": [96, 64]}
    assert meta["frames"]["part"] == part
    assert check_dataset(out).ok


def test_slow_motion_lies_next_to_the_events(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(clip, "-o", out, "--image-rate", 200, "--stop", 0.1) == 0
    assert "events of 5 frames in " in capsys.readouterr().out
    assert [frame.t_us for frame in Dataset(out).frames] == list(range(0, Dataset(out).frames[-1].t_us + 1, 5000))
    report = check_dataset(out)
    assert report.ok, report
    video = ["view", out, "--video", tmp_path / "slow.gif", "--panels", "frame,accumulated", "--window", 0.01]
    assert main([*map(str, video), "--fps", "20"]) == 0
    assert run(clip, "-o", tmp_path / "no", "--image-rate", 200, "--images-every", 2) == 1
    assert "only one of --image-rate and --images-every may be given" in capsys.readouterr().err


def test_an_interpolator_is_named(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The worked example: a network that blends its images is the same as blending them in sRGB by hand."""
    pytest.importorskip("onnxruntime")
    (tmp_path / "blend.onnx").write_bytes(blending_network())
    (tmp_path / "by_hand.py").write_text(
        "def linear(v): return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4\n"
        "import numpy as np\n"
        "def encode(y): return np.where(y <= 0.0031308, 12.92 * y, 1.055 * np.power(y, 1 / 2.4) - 0.055)\n"
        "def blend(before, after, shares):\n"
        "    white = max(before.max(), after.max())\n"
        "    a, b = encode(before / white), encode(after / white)\n"
        "    return [white * np.vectorize(linear)(a + s * (b - a)) for s in shares]\n"
    )
    example = Path(__file__).parents[2] / "examples/onnx_interpolator.py"
    monkeypatch.setenv("INTERPOLATOR_MODEL", str(tmp_path / "blend.onnx"))
    monkeypatch.chdir(tmp_path)
    for name, entry in (("net", f"{example}:OnnxInterpolator"), ("hand", "by_hand:blend")):
        assert run(clip, "-o", tmp_path / name, "--interpolator", entry, "--stop", 0.1, "--quiet") == 0
    net, hand = (Dataset(tmp_path / name).events for name in ("net", "hand"))
    # Pixel by pixel, because rounding may exchange events of two pixels.
    net, hand = (each[np.lexsort([each["t"], each["x"], each["y"]])] for each in (net, hand))
    assert len(net) == len(hand) > 1000
    assert np.array_equal(net[["x", "y", "p"]], hand[["x", "y", "p"]])
    assert abs(net["t"] - hand["t"]).max() <= 50  # rounding of float32 alone
    meta = json.loads((tmp_path / "net/meta.json").read_text())
    assert meta["interpolation"]["rule"] == "interpolator"
    assert meta["interpolation"]["frames_between"] > 0
    assert meta["parameters"]["interpolator"] == f"{example}:OnnxInterpolator"


def test_a_lens_goes_to_calib_txt(clip: Path, tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text("40 40 23.5 15.5 0 0 0 0 0\n")
    assert run(clip, "-o", tmp_path / "out", "--camera", tmp_path / "calib.txt", "--quiet") == 0
    camera = Dataset(tmp_path / "out").camera
    assert (camera.width, camera.height, camera.fx) == (48, 32, 40.0)
    assert check_dataset(tmp_path / "out").ok


ERRORS: dict[str, tuple[str, str]] = {
    "smaller": ("--sensor davis346", "give 48 x 32: --fit crop, pad or scale enlarges them"),
    "two interpolators": (
        "--interpolation flow --interpolator no:such",
        "only one of --interpolation and --interpolator may be given",
    ),
    "no interpolator": ("--interpolator no_such_module:f", "interpolator 'no_such_module:f': there is no module"),
    "transfer": ("--transfer pq", "transfer must be one of srgb, rec709, linear, gamma=G, got 'pq'"),
    "both": ("--fps 3 --timestamps x.txt", "only one of --timestamps and --fps may be given"),
    "unit": ("--time-unit ms", "--time-unit is that of --timestamps: give them too"),
    "shape": ("--size 24x24", "--crop 32x32 fits"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_errors_name_options(name: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options, said = ERRORS[name]
    assert run(clip, "-o", tmp_path / "out", *options.split()) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_not_empty_stays(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(clip, "-o", out, "--quiet") == 0
    before = (out / "events.txt").read_bytes()
    assert run(clip, "-o", out, "--quiet") == 1
    assert "the folder is not empty; --overwrite replaces a dataset in it" in capsys.readouterr().err
    assert (out / "events.txt").read_bytes() == before
    assert run(clip, "-o", out, "--quiet", "--overwrite", "--contrast-threshold", 0.3) == 0
    assert (out / "events.txt").read_bytes() != before


@pytest.mark.long
def test_ctrl_c_leaves_a_valid_shorter_dataset(tmp_path: Path) -> None:
    """An interrupted run ends at a frame."""
    stack = np.lib.format.open_memmap(tmp_path / "stack.npy", mode="w+", dtype=np.uint8, shape=(4000, 120, 160))
    for number in range(len(stack)):
        stack[number] = np.roll(np.arange(160, dtype=np.uint8), 2 * number)
    del stack
    out = tmp_path / "out"
    words = ["frames", tmp_path / "stack.npy", "--fps", 1000, "-o", out, "--interpolation", "linear"]
    command = [sys.executable, "-m", "davis_rs.cli", *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    deadline = time.monotonic() + 60
    while not (out / "images" / "frame_00000003.png").exists():
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "cut short by Ctrl-C" in printed
    report = check_dataset(out)
    assert report.ok, report
    assert 3 <= report.counts["frames"] < 4000
    assert json.loads((out / "meta.json").read_text())["interrupted"] is True


def test_the_readouts_late_events_are_written(tmp_path: Path) -> None:
    """A slow bus still holds events at the last frame."""
    np.save(tmp_path / "stack.npy", BARS)
    settings: dict[str, Any] = {"effects": "readout=20000", "interpolation": "linear"}
    source = open_frames(tmp_path / "stack.npy", fps=1000)
    report = frames_to_folder(source, tmp_path / "out", quiet=True, **settings)
    events = Dataset(tmp_path / "out").events
    assert len(events) == report.events
    assert events["t"][-1] > 11_000
    packets = list(events_from_frames(BARS, fps=1000, **settings))
    assert np.array_equal(concatenate_events([packet.events for packet in packets]), events)
    assert packets[-1].luma is None
