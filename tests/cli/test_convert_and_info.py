"""davis-rs convert and davis-rs info: from any format to any format, and what a file or a folder holds."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from command_line import davis_rs as command
from davis_rs import EventWindows, open_reader, open_writer, read_events
from davis_rs.cli.main import main
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.events.filters import Refractory
from davis_rs.geometry.pose import GroundTruth
from davis_rs.inspection.summary import Gap, dataset_row, draw_rates, summarize_events, top_speeds
from davis_rs.io.dataset.reader import Dataset
from davis_rs.io.files.conversion import convert
from davis_rs.io.files.sensor_size import SensorSizeWarning
from davis_rs.simulation.model_version import MODEL
from event_files import assert_same, events_of
from places import SHARED
from written_sequence import write_sequence

SIZE = (240, 180)
DATA = SHARED / "data"


def many(count: int) -> EventArray:
    rng = np.random.default_rng(4)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = 1_000_000 + np.cumsum(rng.integers(0, 20, count))
    for field, limit in (("x", SIZE[0]), ("y", SIZE[1]), ("p", 2)):
        events[field] = rng.integers(0, limit, count)
    return events


def text_file(path: Path, events: EventArray) -> Path:
    with open_writer(path, SIZE, "text") as writer:
        writer.write(events)
    return path


# ---- convert ----


def test_a_slice_goes_from_text_through_formats_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Window and region are half-open; the text at the end is that of the selected events, byte by byte."""
    for module in ("h5py", "hdf5plugin", "numcodecs", "pyarrow", "rosbags"):
        pytest.importorskip(module)
    events = many(50_000)
    source = text_file(tmp_path / "events.txt", events)
    arguments = ["--start", "1.05", "--stop", "1.4", "--roi", "90x70+10+20", "--size", "240x180", "--quiet"]
    assert main(["convert", str(source), str(tmp_path / "a.h5"), *arguments]) == 0
    for before, after in (("a.h5", "b.parquet"), ("b.parquet", "c.bag"), ("c.bag", "d.txt")):
        assert main(["convert", str(tmp_path / before), str(tmp_path / after), "--quiet"]) == 0
    keep = (events["t"] >= 1_050_000) & (events["t"] < 1_400_000)
    keep &= (events["x"] >= 10) & (events["x"] < 100) & (events["y"] >= 20) & (events["y"] < 90)
    expected = text_file(tmp_path / "expected.txt", events[keep])
    assert (tmp_path / "d.txt").read_bytes() == expected.read_bytes()
    assert f"c.bag: bag, {np.count_nonzero(keep):,} events" in capsys.readouterr().out


def test_options_reach_the_format_and_wrong_ones_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--option name=value; an unknown name and a value out of range are errors in one line."""
    pytest.importorskip("pyarrow")
    source, target = text_file(tmp_path / "events.txt", many(1_000)), str(tmp_path / "e.parquet")
    command = ["convert", str(source), target, "--size", "240x180", "--quiet", "--option"]
    assert main([*command, "row_group=100"]) == 0
    assert main([*command, "row_group=0", "--overwrite"]) == 1
    assert main([*command, "rows=100", "--overwrite"]) == 1
    told = capsys.readouterr().err
    assert "row_group must be at least 1: got 0" in told
    assert "rows" in told
    assert len(read_events(target)) == 1_000


def test_what_cannot_be_converted_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An existing file, a file onto itself, and a source whose sensor nobody knows; nothing is touched."""
    pytest.importorskip("pyarrow")
    source = text_file(tmp_path / "events.txt", many(100))
    before = source.read_bytes()
    (tmp_path / "there.parquet").write_bytes(b"mine")
    there, new = str(tmp_path / "there.parquet"), str(tmp_path / "new.parquet")
    assert main(["convert", str(source), there, "--size", "240x180", "--quiet"]) == 1
    assert main(["convert", str(source), str(source), "--size", "240x180", "--overwrite", "--quiet"]) == 1
    assert main(["convert", str(source), new, "--quiet"]) == 1
    told = capsys.readouterr().err
    assert "overwrite" in told
    assert "onto itself" in told
    assert "sensor's size" in told
    assert (source.read_bytes(), (tmp_path / "there.parquet").read_bytes()) == (before, b"mine")
    assert not (tmp_path / "new.parquet").exists()


@pytest.mark.long
def test_a_closed_pipe_ends_the_conversion(tmp_path: Path) -> None:
    """Standard output that nobody reads any more: exit status 1 and no word, as of any program before `head`."""
    source = text_file(tmp_path / "events.txt", many(200_000))
    command = [sys.executable, "-m", "davis_rs.cli", "convert", str(source), "-", "--format", "text"]
    with subprocess.Popen(
        [*command, "--size", "240x180", "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == source.read_bytes().split(b"\n")[0] + b"\n"
        process.stdout.close()
        told = process.stderr.read().decode()
    assert process.returncode == 1
    assert told == ""


@pytest.mark.long
def test_memory_stays_constant(tmp_path: Path, run_python: Callable[..., str]) -> None:
    """Three times the events take no more than 30 MB more; the first million does not fill all buffers yet."""
    pytest.importorskip("pyarrow")
    program = (
        "import resource, sys\n"
        "from davis_rs.io.files.conversion import convert\n"
        "convert(sys.argv[1], sys.argv[2], size=(240, 180))\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n"
    )
    peaks = []
    for millions in (3, 9):
        source = tmp_path / f"{millions}.txt"
        with open_writer(source, SIZE) as writer:
            part = many(1_000_000)
            for _ in range(millions):
                writer.write(part)
                part["t"] += int(part["t"][-1])
        peaks.append(int(run_python(program, str(source), str(tmp_path / f"{millions}.parquet"))) / 1024)
    assert peaks[1] < peaks[0] + 30, peaks


def test_progress_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    source = text_file(tmp_path / "events.txt", many(100))
    report = convert(source, tmp_path / "b.txt", size=SIZE, progress=shares.append)
    assert (report.events, shares[-1]) == (100, 1.0)


def small_folder(path: Path) -> Path:
    """Four packets of a 24 x 18 sensor with frames, depth and poses, of which no event reaches the last column."""
    write_sequence(path)
    return path


def test_what_the_target_cannot_hold_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In one line on standard error, with counts; a file of events loses nothing, so nothing is said."""
    folder = Dataset(small_folder(tmp_path / "d"))
    assert main(["convert", str(folder.path), str(tmp_path / "e.npy"), "--quiet"]) == 0
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert f"{len(folder.frames)} frames, {len(folder.depth_maps)} depth maps" in told
    assert main(["convert", str(tmp_path / "e.npy"), str(tmp_path / "e.npz"), "--size", "24x18", "--quiet"]) == 0
    assert not capsys.readouterr().err


def says_the_size(folder: Path, what: str) -> Path:
    """The file that says how large the sensor is, in a folder with a calib.txt, which does not."""
    (folder / "calib.txt").write_text("20 20 14.5 9.5 0 0 0 0 0\n")
    if what == "meta.json":
        (folder / "meta.json").write_text('{"sensor": {"width": 30, "height": 20}}')
        return folder / "meta.json"
    if what == "listed frame":
        (folder / "images.txt").write_text("0.0 images/a.png\n")
    (folder / "images").mkdir()
    Image.new("L", (30, 20)).save(folder / "images" / "a.png")
    return folder / "images" / "a.png"


@pytest.mark.parametrize("what", ["meta.json", "listed frame", "frame"])
def test_the_size_is_that_of_what_lies_next_to_a_file(tmp_path: Path, what: str) -> None:
    """Where neither the file nor --size says it; one line says from where. All commands find it alike."""
    events = events_of((5, 29, 19, 1), (9, 3, 4, 0))
    source, out = text_file(tmp_path / "part.txt", events), tmp_path / "out"
    out.mkdir()
    found = says_the_size(tmp_path, what)
    for words, said in (
        (["convert", source, out / "e.aedat4", "--quiet"], "2 events"),
        (["info", source, "--quiet"], "sensor      30 x 20\n"),
        (["view", source, "--html", out / "e.html"], "2 of 2 events"),
        (["compare", source, out / "e.aedat4", "--quiet"], "30 x 20"),
        (["decode", source, "-o", out / "d.aedat4"], "2 events"),
    ):
        done = command(*words)
        assert (done.returncode, said in done.stdout) == (0, True), done
        assert f"{source} does not say the sensor's size: 30 x 20 is taken from {found}\n" in done.stderr
        assert done.stderr.count("\n") == 1
    with open_reader(out / "e.aedat4") as reader:
        assert reader.size == (30, 20)
    with pytest.warns(SensorSizeWarning, match="30 x 20 is taken from"):
        assert EventWindows(source, "count", count=1).size == (30, 20)
    done = command("convert", source, out / "f.aedat4", "--quiet", "--size", "31x20")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_size_that_nobody_knows_is_asked_for(tmp_path: Path) -> None:
    """By the option's name; a calib.txt does not say it, nor does a meta.json that is something else's."""
    source = text_file(tmp_path / "events.txt", many(10))
    (tmp_path / "calib.txt").write_text("200 200 119.5 89.5 0 0 0 0 0\n")
    (tmp_path / "meta.json").write_text("[1]")
    for place in (source, tmp_path):
        (tmp_path / "meta.json").unlink(missing_ok=place == tmp_path)
        for words in (
            ["convert", place, tmp_path / "e.aedat4", "--quiet"],
            ["view", place, "--html", tmp_path / "e.html"],
            ["compare", place, place, "--quiet"],
            ["calibrate", "sensor", place, "--quiet"],
            ["decode", place, "-o", tmp_path / "e.aedat4"],
        ):
            done = command(*words)
            assert (done.returncode, "give --size" in done.stderr) == (1, True), done
            assert command(*words, "--size", "240x180").returncode == 0
            (tmp_path / "e.aedat4").unlink(missing_ok=True)
    assert command("info", tmp_path, "--size", "240x180", "--quiet").stdout.count("240 x 180") == 1


@pytest.mark.parametrize("name", ["e.txt", "e.npy", "e.npz"])
def test_a_file_that_cannot_hold_a_size_needs_none(tmp_path: Path, name: str) -> None:
    """But events outside of a size that is given are refused, and a first line with the size needs it."""
    source = tmp_path / "events.txt"
    source.write_text("0.000005 300 200 1\n0.000009 3 4 0\n")
    out = tmp_path / "out" / name
    out.parent.mkdir()
    done = command("convert", source, out, "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    assert_same(read_events(out), events_of((5, 300, 200, 1), (9, 3, 4, 0)))
    done = command("convert", source, out, "--quiet", "--overwrite", "--size", "240x180")
    assert (done.returncode, "240" in done.stderr) == (1, True), done
    if name == "e.txt":
        done = command("convert", source, out, "--quiet", "--overwrite", "--option", "size_line=true")
        assert (done.returncode, "give --size" in done.stderr) == (1, True), done


def test_filters_need_the_sensors_size(tmp_path: Path) -> None:
    source = text_file(tmp_path / "events.txt", many(10))
    with pytest.raises(ValueError, match="give size WxH"):
        convert(source, tmp_path / "out.npy", filters=[Refractory(10)])


def test_a_size_that_contradicts_the_file_is_refused(tmp_path: Path) -> None:
    """As in all places where two things say how large the sensor is: neither is ignored."""
    text_file(tmp_path / "events.txt", many(10))
    (tmp_path / "meta.json").write_text('{"sensor": {"width": 240, "height": 180}}')
    assert command("convert", tmp_path, tmp_path / "e.aedat4", "--quiet").returncode == 0
    for place in (tmp_path, tmp_path / "e.aedat4"):
        for words in (["info", place], ["convert", place, tmp_path / "f.npy"], ["compare", place, place]):
            done = command(*words, "--quiet", "--size", "346x260")
            assert done.returncode == 1
            assert f"{place} says that the sensor has 240 x 180 pixels: --size 346 x 260 contradicts it" in done.stderr


def test_a_calibration_has_the_size_that_is_given(tmp_path: Path) -> None:
    """calib.txt has none, and 240 x 180 is only what it has in the public dataset."""
    (tmp_path / "d").mkdir()
    text_file(tmp_path / "d" / "events.txt", many(10))
    (tmp_path / "d" / "calib.txt").write_text("300 300 172.5 129.5 0 0 0 0 0\n")
    report = convert(tmp_path / "d", tmp_path / "e", size=(346, 260))
    assert report.parts == {"camera": 1}
    assert (Dataset(tmp_path / "e").camera.width, Dataset(tmp_path / "e").camera.height) == (346, 260)


# ---- info ----


def test_a_folder_is_known_by_what_it_says_of_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Format and size are the folder's, not its text file's; scene and C are those of meta.json."""
    folder = small_folder(tmp_path / "d")
    meta = json.loads((folder / "meta.json").read_text())
    meta |= {"scene": {"name": "fence"}, "parameters": {"contrast_threshold": 0.2}, "effects": {}}
    meta["sensor"] = {"width": 30, "height": 20}
    (folder / "meta.json").write_text(json.dumps(meta))
    assert main(["info", str(folder), "--quiet"]) == 0
    said = capsys.readouterr().out
    for line in ("d: dataset folder", "sensor      30 x 20\n", "scene       fence", "C = 0.2", "effects     none"):
        assert line in said
    assert f"{len(Dataset(folder).frames)} frames" in said
    assert "made by" not in said
    assert "noise" not in said
    meta |= {"davis_rs": "0.2.0", "monte_carlo_noise": {"share": 0.46}}
    (folder / "meta.json").write_text(json.dumps(meta))
    assert main(["info", str(folder), "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "noise       about 46 % of the events are Monte Carlo noise (missing or spurious)\n" in said
    assert f"made by     davis_rs 0.2.0, model 1; today's is {MODEL}: counts of events may differ" in said
    (folder / "meta.json").write_text(json.dumps(meta | {"model": MODEL}))
    assert main(["info", str(folder), "--quiet"]) == 0
    assert f"made by     davis_rs 0.2.0, model {MODEL}\n" in capsys.readouterr().out


def test_a_file_is_summed_up_as_a_loop_would(tmp_path: Path) -> None:
    """Counts, rates, the fullest interval of 10 ms and the longest gaps; also where the file knows no sensor size."""
    events = many(60_000)
    events["t"][30_000:] += 123_456
    summary = summarize_events(text_file(tmp_path / "events.txt", events))
    t = events["t"].astype(int)
    assert (summary.events, summary.on) == (len(events), int(events["p"].sum()))
    assert (summary.first_us, summary.last_us, summary.backward) == (t[0], t[-1], 0)
    assert summary.size == (events["x"].max() + 1, events["y"].max() + 1)
    assert not summary.size_known
    counts = np.zeros(summary.counts.shape, int)
    np.add.at(counts, (events["y"], events["x"]), 1)
    np.testing.assert_array_equal(summary.counts, counts)
    windows = np.bincount(t // 10_000)
    assert summary.peak_events == windows.max()
    assert summary.peak_us == windows.argmax() * 10_000
    assert summary.mean_rate_hz == pytest.approx(len(events) * 1e6 / (t[-1] - t[0]))
    assert summary.gaps[0] == Gap(t[30_000] - t[29_999], t[29_999])
    assert [gap.length_us for gap in summary.gaps] == sorted(np.diff(t))[-1:-4:-1]


def test_an_empty_file_is_summed_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No events are no error, but they have no rates to draw."""
    source = text_file(tmp_path / "events.txt", np.zeros(0, EVENT_DTYPE))
    assert main(["info", str(source), "--quiet"]) == 0
    assert "events      0" in capsys.readouterr().out
    assert main(["info", str(source), "--quiet", "--picture", str(tmp_path / "p.png")]) == 1
    assert "no rates to draw" in capsys.readouterr().err


def test_the_picture_of_rates_is_drawn(tmp_path: Path) -> None:
    """A PNG in which the busy corner is brighter than the rest."""
    pytest.importorskip("matplotlib")
    events = many(20_000)
    events["x"][:10_000] %= 24
    summary = summarize_events(text_file(tmp_path / "events.txt", events), size=SIZE)
    path = draw_rates(summary, tmp_path / "rates.png")
    with Image.open(path) as image:
        assert image.width > 800


def test_top_speeds_are_those_of_the_motion() -> None:
    """A camera that turns at 90 deg/s and moves at 2 m/s, in both signs of the quaternion; none for a single pose."""
    seconds = np.arange(0, 1, 0.005)
    half = np.radians(90 * seconds) / 2
    quaternions = np.stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], axis=1)
    quaternions[::3] *= -1
    positions = np.stack([2 * seconds, np.zeros_like(half), np.zeros_like(half)], axis=1)
    truth = GroundTruth((seconds * 1e6).astype(np.int64), positions, quaternions)
    assert top_speeds(truth) == pytest.approx((2.0, 90.0))
    assert np.isnan(top_speeds(GroundTruth(truth.t_us[:1], positions[:1], quaternions[:1]))).all()
    assert top_speeds(GroundTruth(truth.t_us[:2], positions[:2], quaternions[:2])) == pytest.approx((2.0, 90.0))


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the recordings")
def test_the_public_sequence_has_the_papers_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """slider_depth: a linear slider at 0.32 m/s that does not turn (the paper's table 1)."""
    for name in ("calib.txt", "groundtruth.txt"):
        (tmp_path / name).write_bytes((DATA / "slider_depth" / name).read_bytes())
    text_file(tmp_path / "events.txt", many(1_000))
    row = dataset_row(tmp_path, summarize_events(tmp_path))
    assert row.translation_m_s == pytest.approx(0.32, abs=0.03)
    assert row.rotation_deg_s == 0
    assert main(["info", str(tmp_path), "--quiet"]) == 0
    assert "RS = 0.0 deg/s, NE = 1,000" in capsys.readouterr().out
    assert len(Dataset(tmp_path).groundtruth.t_us) > 100
