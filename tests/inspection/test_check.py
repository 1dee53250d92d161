"""The check of a dataset: it passes on an honest one and finds every kind of tampering."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from davis_rs import EVENT_DTYPE
from davis_rs.events.arrays import EventArray
from davis_rs.inspection.check import CheckReport, check_dataset
from davis_rs.inspection.dataset_description import describe_dataset
from davis_rs.inspection.summary import dataset_contents
from davis_rs.io.dataset.reader import Dataset
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.io.files.conversion import convert
from davis_rs.simulation.model_version import MODEL
from places import SHARED
from written_sequence import (
    CAMERA,
    FRAME_STEPS,
    HEIGHT,
    STEP_US,
    STEPS,
    WIDTH,
    luma_at,
    packet_of,
    packets,
    parameters,
    write_sequence,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An honest dataset, to be tampered with."""
    write_sequence(tmp_path / "d")
    return tmp_path / "d"


def rewrite_events(folder: Path, events: EventArray) -> None:
    lines = [f"{t // 10**6}.{t % 10**6:06d}000 {x} {y} {p}\n" for t, x, y, p in events.tolist()]
    (folder / "events.txt").write_text("".join(lines))


def change_meta(folder: Path, **changes: Any) -> None:
    path = folder / "meta.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def counts_of(folder: Path) -> dict[str, Any]:
    """The counts that are true of the folder's events, so that only the events' content is at fault."""
    events = Dataset(folder).events
    stated: dict[str, Any] = Dataset(folder).meta["counts"]
    return stated | {"events": len(events), "on_events": int(events["p"].sum())}


def problem_of(folder: Path) -> str:
    """The one problem of a dataset with one fault."""
    report = check_dataset(folder)
    assert not report.ok
    assert str(report).endswith("the check fails: 1 problem"), str(report)
    return report.problems[0]


def errors_in_c(folder: Path, c_on: float, c_off: float) -> dict[int, np.ndarray[Any, np.dtype[np.float64]]]:
    """The check's errors by hand, from the luma that went in: time -> (HEIGHT, WIDTH) in units of C."""
    events = Dataset(folder).events
    errors = {}
    for image in Dataset(folder).luma[1:]:
        until = events[events["t"] <= image.t_us]
        reference = np.log(luma_at(0).astype(np.float64) + 1e-3)
        np.add.at(reference, (until["y"], until["x"]), np.where(until["p"] == 1, c_on, -c_off))
        error = np.log(luma_at(image.t_us // STEP_US).astype(np.float64) + 1e-3) - reference
        errors[image.t_us] = np.where(error > 0, error / c_on, error / c_off)
    return errors


@pytest.mark.parametrize(("c_on", "c_off"), [(0.15, 0.15), (0.2, 0.11)])
def test_an_honest_dataset_holds(tmp_path: Path, c_on: float, c_off: float) -> None:
    """The engine's own events pass, and the report's figures are those of the sum written out by hand."""
    events = write_sequence(tmp_path / "d", c_on=c_on, c_off=c_off)
    report = check_dataset(tmp_path / "d")
    assert report.problems == []
    assert report.ok
    assert report.counts == {
        "events": len(events),
        "on_events": int(events["p"].sum()),
        "frames": 7,
        "depth_maps": 4,
        "luma_maps": 4,
    }
    by_hand = errors_in_c(tmp_path / "d", c_on, c_off)
    assert [instant.t_us for instant in report.instants] == list(by_hand) == [20_000, 40_000, 60_000]
    for instant, error in zip(report.instants, by_hand.values(), strict=True):
        assert instant.largest == pytest.approx(np.abs(error).max(), abs=1e-9)
        assert instant.largest == pytest.approx(abs(error[instant.y, instant.x]), abs=1e-9)
        assert instant.mean == pytest.approx(np.abs(error).mean(), abs=1e-9)
        assert 0.5 < instant.largest < 1
    assert report.worst is not None
    assert report.worst.largest == max(instant.largest for instant in report.instants)


def test_references_that_began_between_levels_are_known(tmp_path: Path) -> None:
    """By start phase and seed in meta.json: with another seed, or as of references at the signal, it does not hold."""
    path = tmp_path / "d"
    plain = write_sequence(tmp_path / "plain", c_on=0.2, c_off=0.11)
    events = write_sequence(path, c_on=0.2, c_off=0.11, start_phase="stationary", seed=7)
    assert events["t"][0] < plain["t"][0]
    report = check_dataset(path)
    assert report.ok, str(report)
    assert all(0.9 < instant.largest < 1 for instant in report.instants)
    of_run = Dataset(path).meta["parameters"]
    for changed in ({"start_phase": "zero"}, {"start_phase": None}, {"seed": 8}):
        change_meta(path, parameters=of_run | changed)
        assert "the events do not give log intensity within (-C_off, C_on)" in problem_of(path)
    for changed in ({"start_phase": "random"}, {"start_phase": 3}, {"seed": -1}, {"seed": "7"}):
        change_meta(path, parameters=of_run | changed)
        assert problem_of(path).startswith("meta.json does not say where references began"), changed


def test_the_report_reads_well(folder: Path) -> None:
    """A few lines: what was found, the largest error with time and pixel, the verdict."""
    lines = str(check_dataset(folder)).splitlines()
    assert len(lines) == 3
    assert "7 frames, 4 depth maps" in lines[0]
    assert " C at 0.0" in lines[1]
    assert "pixel (" in lines[1]
    assert lines[2] == "the check holds"


def test_a_threshold_that_is_not_said_is_not_described(folder: Path) -> None:
    """Although that of OFF events is, as somebody's meta.json may have it."""
    path = folder / "meta.json"
    meta = json.loads(path.read_text())
    meta["parameters"] |= {"contrast_threshold": None, "contrast_threshold_off": 0.2}
    path.write_text(json.dumps(meta))
    assert describe_dataset(Dataset(folder)).threshold is None


def test_noise_and_an_older_model_are_told_and_are_no_failure(folder: Path) -> None:
    """Rendered luma has the run's noise, so the check holds; a folder that says no model is of the first."""
    noise = "about 46 % of the events are Monte Carlo noise (missing or spurious)"
    change_meta(folder, davis_rs="9.9", model=MODEL, monte_carlo_noise={"share": 0.0})
    assert len(str(check_dataset(folder)).splitlines()) == 3
    change_meta(folder, davis_rs="0.2.0", model=None, monte_carlo_noise={"share": 0.4608})
    report = check_dataset(folder)
    assert report.ok
    assert report.noise == 0.4608
    assert str(report).splitlines()[2:] == [
        f"made by davis_rs 0.2.0, model 1; today's is {MODEL}: counts of events may differ, see CHANGELOG.md",
        f"{noise}; rendered luma has it too, so that the check cannot see it",
        "the check holds, noise included",
    ]
    change_meta(folder, davis_rs="9.9", model=MODEL + 1, monte_carlo_noise=None)
    assert str(check_dataset(folder)).splitlines()[2:] == [
        f"made by davis_rs 9.9, model {MODEL + 1}; today's is {MODEL}: counts of events may differ, see CHANGELOG.md",
        "the check holds",
    ]


def test_many_problems_are_not_all_printed() -> None:
    """A report of a thousand problems stays readable."""
    lines = str(CheckReport(Path("d"), problems=["No."] * 1000)).splitlines()
    assert len(lines) < 30
    assert lines[-2:] == ["... and 980 more", "the check fails: 1000 problems"]


def test_a_deleted_event_is_counted(folder: Path) -> None:
    """One line less than meta.json says, and one ON event less."""
    events = Dataset(folder).events
    rewrite_events(folder, np.delete(events, np.flatnonzero(events["p"])[0]))
    problems, on = check_dataset(folder).problems, int(events["p"].sum())
    assert f"meta.json counts {len(events)} events, the folder holds {len(events) - 1}." in problems
    assert f"meta.json counts {on} on events, the folder holds {on - 1}." in problems


def test_a_deleted_event_shows_in_log_intensity(folder: Path) -> None:
    """Even with the counts mended: one ON event less, and its pixel is beyond the threshold at the next instant."""
    events = Dataset(folder).events
    error = errors_in_c(folder, 0.15, 0.15)[20_000]
    rising = np.flatnonzero((events["p"] == 1) & (events["t"] <= 20_000) & (error[events["y"], events["x"]] > 0.1))
    deleted = events[rising[0]]
    rewrite_events(folder, np.delete(events, rising[0]))
    change_meta(folder, counts=counts_of(folder))
    problem = problem_of(folder)
    off = error[deleted["y"], deleted["x"]] + 1
    assert "the events do not give log intensity within (-C_off, C_on): first at 0.020000 s" in problem
    assert f"pixel ({deleted['x']}, {deleted['y']}) is {off:.6f} C away" in problem


def test_a_flipped_polarity_shows_in_log_intensity(folder: Path) -> None:
    """Two thresholds off, whatever the pixel."""
    events = Dataset(folder).events.copy()
    events["p"][5] ^= 1
    rewrite_events(folder, events)
    change_meta(folder, counts=counts_of(folder))
    assert f"where pixel ({events['x'][5]}, {events['y'][5]}) is" in problem_of(folder)


def test_another_threshold_than_stated_is_found(folder: Path) -> None:
    """Events of C = 0.15 do not pass for events of C = 0.14."""
    change_meta(folder, parameters=parameters(0.14, 0.14))
    assert "do not give log intensity" in problem_of(folder)


def test_swapped_lines_are_found(folder: Path) -> None:
    """Two lines exchanged: times go back."""
    lines = (folder / "events.txt").read_text().splitlines(keepends=True)
    at = next(i for i in range(len(lines) - 1) if lines[i].split()[0] != lines[i + 1].split()[0])
    lines[at], lines[at + 1] = lines[at + 1], lines[at]
    (folder / "events.txt").write_text("".join(lines))
    problems = check_dataset(folder).problems
    assert any("events.txt" in problem and "must not decrease" in problem for problem in problems)


def test_ties_in_another_order_are_found(folder: Path) -> None:
    """At one time y decides, then x: a stream of another order is not the engine's."""
    events = Dataset(folder).events.copy()
    tied = np.flatnonzero((np.diff(events["t"]) == 0) & (np.diff(events["y"].astype(int)) > 0))[0]
    events[[tied, tied + 1]] = events[[tied + 1, tied]]
    rewrite_events(folder, events)
    assert f"not sorted by (t, y, x): event {tied + 2} of events.txt" in problem_of(folder)


def test_a_bus_has_its_own_order_within_a_time(folder: Path) -> None:
    """What a bus has read out is sorted by time alone."""
    events = Dataset(folder).events.copy()
    tied = np.flatnonzero((np.diff(events["t"]) == 0) & (np.diff(events["y"].astype(int)) > 0))[0]
    events[[tied, tied + 1]] = events[[tied + 1, tied]]
    rewrite_events(folder, events)
    change_meta(folder, effects={"readout": {"events_per_s": 12e6}})
    assert check_dataset(folder).ok
    events[[0, -1]] = events[[-1, 0]]
    rewrite_events(folder, events)
    assert "event times must not decrease" in problem_of(folder)


def test_a_camera_has_its_own_order_within_a_time(tmp_path: Path) -> None:
    """What was converted from a recording is sorted by time alone, and may begin at 0."""
    events = np.array([(0, 5, 3, 1), (7, 6, 2, 0), (7, 1, 1, 1), (9, 0, 0, 1)], EVENT_DTYPE)
    np.save(tmp_path / "recorded.npy", events)
    convert(tmp_path / "recorded.npy", tmp_path / "folder", size=(8, 6))
    assert check_dataset(tmp_path / "folder").ok
    rewrite_events(tmp_path / "folder", events[[1, 0, 2, 3]])
    assert not check_dataset(tmp_path / "folder").ok


def test_two_events_of_one_pixel_at_one_time_are_allowed(tmp_path: Path) -> None:
    """A step over two levels within a microsecond gives tied events of one pixel."""
    engine_luma = [np.full((HEIGHT, WIDTH), value, np.float32) for value in (0.5, 0.5 * np.exp(0.31))]
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 0, luma=engine_luma[0]))
        tied = [(1, x, y, 1) for y in range(HEIGHT) for x in range(WIDTH) for _ in range(2)]
        writer.write(packet_of(0, 1, *tied, luma=engine_luma[1]))
        writer.finish({"parameters": parameters() | {"frame_rate_hz": 1e6}})
    assert check_dataset(tmp_path / "d").problems == []


@pytest.mark.parametrize(
    ("event", "sentence"),
    [
        ((60_001, 0, 0, 1), "1 of the events lie outside of (0 s, 0.060000 s], the first at 0.060001 s."),
        ((60_000, WIDTH, HEIGHT - 1, 1), "outside of the 24 x 18 sensor, the first at (24, 17), 0.060000 s."),
    ],
)
def test_an_event_where_none_can_be_is_found(folder: Path, event: tuple[int, int, int, int], sentence: str) -> None:
    """After the end, or off the sensor."""
    rewrite_events(folder, np.append(Dataset(folder).events, np.array([event], EVENT_DTYPE)))
    change_meta(folder, counts=counts_of(folder))
    assert sentence in problem_of(folder)


def test_an_event_at_zero_is_found(folder: Path) -> None:
    """The first frame sets the references: nothing can have crossed by then."""
    rewrite_events(folder, np.insert(Dataset(folder).events, 0, np.array((0, 0, 0, 1), EVENT_DTYPE)))
    change_meta(folder, counts=counts_of(folder))
    assert "outside of (0 s, 0.060000 s], the first at 0.000000 s." in problem_of(folder)


def test_a_polarity_that_is_none_is_found(folder: Path) -> None:
    """The line is named."""
    text = (folder / "events.txt").read_text()
    (folder / "events.txt").write_text(text[:-2] + "2\n")
    problems = check_dataset(folder).problems
    assert any("polarity must be 0 or 1" in problem and "events.txt" in problem for problem in problems)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("images/frame_00000003.png", "Frame 3 is listed, but there is no file"),
        ("depthmaps/frame_00000002.exr", "Depth map 2 is listed, but there is no file"),
        ("luma/frame_00000001.exr", "Luma map 1 is listed, but there is no file"),
    ],
)
def test_a_missing_image_is_found(folder: Path, name: str, sentence: str) -> None:
    """A file that a list names must be there."""
    (folder / name).unlink()
    assert sentence in problem_of(folder)


def test_a_broken_image_is_found(folder: Path) -> None:
    """A file must open, too."""
    (folder / "images/frame_00000003.png").write_bytes(b"\x89PNG")
    assert "Frame 3 cannot be read" in problem_of(folder)


def test_an_image_of_another_size_is_found(folder: Path) -> None:
    """Frames have the sensor's size."""
    Image.new("L", (WIDTH, HEIGHT + 1)).save(folder / "images/frame_00000003.png")
    assert "Frame 3 has shape (19, 24), the sensor (18, 24)" in problem_of(folder)


def test_a_missing_frame_is_found(folder: Path) -> None:
    """A line less in images.txt: the frames after it are not where their rate puts them."""
    lines = (folder / "images.txt").read_text().splitlines(keepends=True)
    (folder / "images.txt").write_text("".join(lines[:3] + lines[4:]))
    problems = " ".join(check_dataset(folder).problems)
    assert "Frame 3 is at 0.040000 s, but fell due at 0.030000 s." in problems
    assert "meta.json counts 7 frames, the folder holds 6." in problems


def test_instants_are_multiples_of_the_period_to_the_nearest_microsecond(tmp_path: Path) -> None:
    """At 30 Hz frames fall due at 0, 33,333 and 66,667 us, not at 66,666."""
    for third_us, fine in ((66_667, True), (66_666, False)):
        with DatasetWriter(tmp_path / "d", CAMERA, overwrite=True) as writer:
            for start_us, end_us in ((0, 0), (0, 33_333), (33_333, third_us)):
                writer.write(packet_of(start_us, end_us, luma=luma_at(0)))
            writer.finish({"parameters": parameters() | {"frame_rate_hz": 30.0}})
        assert check_dataset(tmp_path / "d").ok == fine


def test_times_that_do_not_increase_are_found(folder: Path) -> None:
    """Frames at one and the same time, where no rate says what they should be."""
    change_meta(folder, parameters=parameters() | {"frame_rate_hz": None})
    text = (folder / "images.txt").read_text()
    (folder / "images.txt").write_text(text.replace("0.030000000", "0.020000000"))
    assert problem_of(folder) == "The times of the frames do not increase: 0.020000 s follows 0.020000 s."


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("0.060000000 0 0 0 0 0 0 1", "The times of the ground truth do not increase: 0.060000 s follows 0.060000 s."),
        ("0.061000000 0 0 0 0 0 0.1 1", "quaternions must have norm 1: it is 1.00498756 at 0.061000 s."),
    ],
)
def test_bad_poses_are_found(folder: Path, line: str, sentence: str) -> None:
    """Ground truth has increasing times and unit quaternions."""
    with (folder / "groundtruth.txt").open("a") as file:
        file.write(line + "\n")
    change_meta(folder, counts=counts_of(folder) | {"poses": len(Dataset(folder).groundtruth.t_us)})
    assert sentence in problem_of(folder)


@pytest.mark.parametrize("empty", [False, True])
def test_lost_poses_are_found(folder: Path, empty: bool) -> None:
    """Also where the whole file is gone, or nothing is in it."""
    poses = len(Dataset(folder).groundtruth.t_us)
    (folder / "groundtruth.txt").unlink()
    if empty:
        (folder / "groundtruth.txt").touch()
    assert problem_of(folder) == f"meta.json counts {poses} poses, the folder holds 0."


@pytest.mark.parametrize("name", ["poses", "frames"])
def test_a_count_that_is_not_stated_is_told(folder: Path, name: str) -> None:
    """Without it nobody would miss what was lost."""
    counts = counts_of(folder)
    found = counts.pop(name)
    change_meta(folder, counts=counts)
    assert problem_of(folder) == f"meta.json does not say how many {name} there are, the folder holds {found}."


@pytest.mark.parametrize("changes", [
    {"duration_us": "long"}, {"duration_us": 1 << 70}, {"counts": [1]}, {"parameters": {"frame_rate_hz": "fast"}},
    {"parameters": {"contrast_threshold": 1e400}}, {"parameters": {"log_eps": -1}}, {"sensor": {"width": 1e400}},
    {"effects": 3}, {"complete": 1}, {"model": "new"}, {"davis_rs": 2}, {"monte_carlo_noise": 0.1},
    {"monte_carlo_noise": {"share": "most"}}, {"monte_carlo_noise": {"share": -0.5}},
])  # fmt: skip
def test_metadata_of_wrong_types_are_a_problem_not_a_crash(folder: Path, changes: dict[str, Any]) -> None:
    """Numbers beyond all bounds included."""
    change_meta(folder, **changes)
    assert any("meta.json" in problem for problem in check_dataset(folder).problems)
    (folder / "meta.json").write_text("[" * 100_000)
    assert any("meta.json" in problem for problem in check_dataset(folder).problems)


def test_images_of_other_folders_are_not_looked_at(folder: Path) -> None:
    """A list names files of its own folder."""
    for name in ("/etc/passwd", "../frame.png", "images/a\0.png"):
        (folder / "images.txt").write_text(f"0.000000000 {name}\n")
        assert any("expected a file of this folder" in problem for problem in check_dataset(folder).problems)


def test_a_malformed_file_is_a_problem_not_a_crash(folder: Path) -> None:
    """Each unreadable part is a sentence with file and line; the rest is checked all the same."""
    (folder / "groundtruth.txt").write_text("what\n")
    (folder / "images.txt").write_text("0.0\n")
    problems = check_dataset(folder).problems
    assert any("groundtruth.txt, line 1" in problem for problem in problems)
    assert any("images.txt, line 1" in problem for problem in problems)
    assert check_dataset(folder).instants


@pytest.mark.parametrize("missing", ["contrast_threshold", "log_eps"])
def test_unknown_parameters_are_a_problem(folder: Path, missing: str) -> None:
    """Without thresholds nothing was compared, so the check must not hold."""
    change_meta(folder, parameters={name: value for name, value in parameters().items() if name != missing})
    assert "meta.json lacks the parameters" in problem_of(folder)


def test_no_stored_luma_is_a_problem(folder: Path) -> None:
    """Nothing to compare with is not a pass."""
    (folder / "luma.txt").unlink()
    change_meta(folder, counts=counts_of(folder) | {"luma_maps": 0})
    assert "Fewer than two luma maps" in problem_of(folder)


@pytest.mark.parametrize("by_finish", [True, False])
def test_an_interrupted_dataset_holds(tmp_path: Path, by_finish: bool) -> None:
    """Ended early by the caller or by Ctrl-C: valid, only shorter, and checked up to its last frame."""
    with (
        suppress(KeyboardInterrupt),
        DatasetWriter(tmp_path / "d", CAMERA, meta={"parameters": parameters()}) as writer,
    ):
        for packet in packets():
            if packet.end_us > 3.5 * FRAME_STEPS * STEP_US:
                break
            assert packet.pose is not None
            writer.write(packet, [(packet.end_us, packet.pose)])
        if not by_finish:
            raise KeyboardInterrupt
        writer.finish(interrupted=True)
    report = check_dataset(tmp_path / "d")
    assert report.problems == []
    assert [instant.t_us for instant in report.instants] == [3 * FRAME_STEPS * STEP_US]
    assert "cut short: its writer was stopped" in dataset_contents(Dataset(tmp_path / "d"))


def test_an_unfinished_dataset_does_not_hold_but_is_checked(folder: Path) -> None:
    """What a killed writer leaves is compared as far as it goes, and the report says that it was never finished."""
    change_meta(folder, complete=False, counts={})
    report = check_dataset(folder)
    assert report.problems == ["The dataset was never finished (meta.json says so): its writer was killed or failed."]
    assert report.instants[-1].t_us == STEPS * STEP_US
    assert "never finished" in dataset_contents(Dataset(folder))


def test_the_public_dataset_fails_for_what_it_lacks() -> None:
    """A dataset of a real camera opens, and the report says what cannot be checked."""
    if not (SHARED / "data" / "slider_depth").is_dir():
        pytest.skip("needs the public slider_depth sequence")
    problems = check_dataset(SHARED / "data" / "slider_depth").problems
    assert any("There is no meta.json" in problem for problem in problems)
    assert any("events.txt" in problem for problem in problems)


def test_no_dataset_is_an_error(tmp_path: Path) -> None:
    """A wrong path raises instead of giving a report about nothing."""
    with pytest.raises(FileNotFoundError, match="is not a dataset"):
        check_dataset(tmp_path)
