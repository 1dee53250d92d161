"""The 27 sequences of the public dataset: their table, their motions, and the commands that make and list them."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from sequence_tables import count_events, mean_luma, write_counts
from sequence_tables import main as tables

import davis_rs
from davis_rs.cli.main import main
from davis_rs.inspection.check import check_dataset
from davis_rs.scene.sequences import SEQUENCES
from davis_rs.scene.sequences.event_counts import EventCount, read_counts
from davis_rs.sensor.presets import recorded_sensor
from long_form import long_values
from places import ROOT

NAMES = list(SEQUENCES)
COUNTED = list(read_counts())
"""What is on record; the table has a dash for what is not."""


PAPER = """
shapes_rotation 59.8 0.83 730 23126288
shapes_translation 59.7 2.60 271 17363976
shapes_6dof 59.7 2.35 715 17962477
poster_rotation 59.8 0.84 884 169350136
poster_translation 59.8 2.58 240 100033286
poster_6dof 59.8 2.51 937 133464530
boxes_rotation 59.8 0.85 669 185688947
boxes_translation 59.8 3.43 319 112388307
boxes_6dof 59.8 3.84 509 133085511
hdr_poster 59.8 2.28 597 102910720
hdr_boxes 59.8 2.94 592 118499744
outdoors_walking 133.4 - - 64517638
outdoors_running 87.6 - - 98572164
dynamic_rotation 59.8 0.45 542 71324510
dynamic_translation 59.8 1.86 227 35809924
dynamic_6dof 59.7 2.91 627 57174637
calibration 59.8 0.32 67 21340629
office_zigzag 10.9 - - 7735308
office_spiral 11.2 - - 6254774
urban 10.7 - - 5359539
slider_close 6.5 0.16 0 4032668
slider_far 6.4 0.16 0 3442683
slider_hdr_close 6.5 0.16 0 3337787
slider_hdr_far 6.5 0.16 0 2509582
slider_depth 3.4 0.32 0 1078541
simulation_3planes 2.0 0.63 0 6870278
simulation_3walls 2.0 5.31 109 4104833
"""
"""Name, T, TS, RS, NE, written down a second time: sequences are made from their rows, so they cannot prove them."""


def test_the_table_is_the_papers() -> None:
    """27 rows of 1.5 thousand million events in 20 minutes, figure by figure."""
    rows = []
    for line in PAPER.split("\n")[1:-1]:
        name, *figures = line.split()
        duration, speed, rate, events = (None if figure == "-" else float(figure) for figure in figures)
        rows.append((name, (duration, speed, rate, events)))
    assert [(name, tuple(sequence.paper)) for name, sequence in SEQUENCES.items()] == rows
    assert round(sum(sequence.paper.events for sequence in SEQUENCES.values()) / 1e9, 2) == 1.51
    assert {name for name, s in SEQUENCES.items() if s.biases is None} == {"simulation_3planes", "simulation_3walls"}
    assert {s.biases for s in SEQUENCES.values()} == {*davis_rs.BIAS_SETS, None}


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_duration_and_top_speeds_are_the_tables(name: str) -> None:
    """T within 1 %, TS and RS within 10 %, by one definition of a top speed; nothing jumps when it starts."""
    paper, scene = SEQUENCES[name].paper, SEQUENCES[name].scene()
    trajectory = scene.trajectory
    assert trajectory is not None
    assert scene.name == name
    assert trajectory.duration_s == pytest.approx(paper.duration_s, rel=0.01)
    top = trajectory.top_speeds()
    if paper.speed_m_s is not None and paper.rate_deg_s is not None:
        assert top.speed_m_s == pytest.approx(paper.speed_m_s, rel=0.1)
        assert np.degrees(top.rate_rad_s) == pytest.approx(paper.rate_deg_s, rel=0.1, abs=0.1)
    else:
        assert 0.1 < top.speed_m_s < 5
    momentary = trajectory.top_speeds(0.0)
    assert momentary.speed_m_s < 1.3 * top.speed_m_s
    assert momentary.rate_rad_s < 1.5 * top.rate_rad_s + 1e-9


@pytest.mark.parametrize("name", COUNTED)
def test_the_counts_on_record_are_within_a_factor_of_three(name: str) -> None:
    """Of the whole sequence, as benches/sequence_tables.py found them."""
    count = read_counts()[name]
    paper = SEQUENCES[name].paper
    assert count.duration_s == pytest.approx(paper.duration_s, rel=0.01)
    assert paper.events / 3 < count.events < 3 * paper.events
    assert 0.3 < count.on_events / count.events < 0.7


@pytest.mark.few(3)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("name", [*COUNTED[::3], *long_values(*(name for name in COUNTED if name not in COUNTED[::3]))])
def test_the_counts_on_record_are_of_these_scenes(name: str) -> None:
    """Threshold and a view are as they were then: what has changed since must be counted again."""
    count = read_counts()[name]
    assert SEQUENCES[name].scene().contrast_threshold == count.contrast_threshold
    assert mean_luma(SEQUENCES[name]) == pytest.approx(count.luma, rel=1e-3)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("name", ["simulation_3planes", pytest.param("slider_depth", marks=pytest.mark.long)])
def test_the_counts_on_record_are_those_of_the_sequences(name: str) -> None:
    """Counted again, to the last bits that processors may differ in."""
    assert count_events(SEQUENCES[name]).events == pytest.approx(read_counts()[name].events, rel=1e-3)


@pytest.mark.long
def test_the_recorded_sensor_is_counted(tmp_path: Path) -> None:
    """With the scene's threshold, of either polarity; the count says whose it is."""
    count = count_events(SEQUENCES["slider_depth"], sensor="recorded", duration_s=0.05)
    assert count.sensor == "recorded"
    assert count.contrast_threshold == SEQUENCES["slider_depth"].scene().contrast_threshold
    assert 0.4 < count.on_events / count.events < 0.7
    write_counts(tmp_path / "one.csv", [count])
    assert read_counts(tmp_path / "one.csv") == {"slider_depth": count}


def test_counts_are_read_back_and_what_is_no_count_is_named(tmp_path: Path) -> None:
    """A file of counts holds them all; a broken line is told by its number."""
    path = tmp_path / "counts.csv"
    counts = [
        EventCount("urban", 10.7, 5_000_000, 2_400_000, 1.0, 5, 0.5, 0.1),
        EventCount("slider_far", 6.4, 12, 0, 0.5, 8, 0.3, 0.25),
    ]
    write_counts(path, counts)
    assert list(read_counts(path).values()) == counts
    path.write_text(path.read_text().replace("12,0", "twelve,0"))
    with pytest.raises(ValueError, match=r"counts.csv, line 3: not a count of events"):
        read_counts(path)


@pytest.mark.usefixtures("llvm")
def test_a_sequence_is_a_whole_dataset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Events, frames, depth, ground truth and lens as the dataset's, and a check that holds; the slider had no IMU."""
    out = tmp_path / "out"
    options = ["--duration", "0.1", "--start", "1", "--rays-per-pixel", "2", "--quiet"]
    assert main(["sequence", "slider_depth", "-o", str(out), *options]) == 0
    dataset = davis_rs.Dataset(out)
    assert [frame.t_us for frame in dataset.frames] == [0, 41_667, 83_333]
    assert len(dataset.depth_maps) == 3
    assert len(dataset.imu) == 0
    assert len(dataset.groundtruth.t_us) == 21
    assert dataset.camera == davis_rs.load_camera("davis240c")
    assert check_dataset(out).ok
    meta = json.loads((out / "meta.json").read_text())
    assert meta["scene"]["name"] == "slider_depth"
    assert meta["sequence"] == {"biases": "indoors", "differs": "plain objects at like depths"}
    assert main(["sequence", "no_such", "-o", str(tmp_path / "no")]) == 1
    assert "there is no sequence 'no_such'; there are shapes_rotation," in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.usefixtures("llvm")
def test_simulate_and_sequence_make_the_same_of_a_sequence(tmp_path: Path) -> None:
    """Its 24 frames a second come with its name, and so does that it has no IMU; options still go before them."""
    options = ["--start", "1", "--duration", "0.05", "--rays-per-pixel", "1", "--quiet"]
    written = ["events.txt", "images.txt", "depthmaps.txt", "groundtruth.txt", "calib.txt"]
    for command in ("sequence", "simulate"):
        assert main([command, "slider_depth", "-o", str(tmp_path / command), *options]) == 0
    for name in written:
        assert (tmp_path / "sequence" / name).read_bytes() == (tmp_path / "simulate" / name).read_bytes(), name
    dataset = davis_rs.Dataset(tmp_path / "simulate")
    assert not (tmp_path / "simulate" / "imu.txt").exists()
    assert [frame.t_us for frame in dataset.frames] == [0, 41_667]
    metas = [json.loads((tmp_path / command / "meta.json").read_text()) for command in ("sequence", "simulate")]
    assert metas[0]["sequence"] == metas[1]["sequence"]
    own = ["--imu", "mpu6150", "--frame-rate", "100"]
    assert main(["simulate", "slider_depth", "-o", str(tmp_path / "own"), *options, *own]) == 0
    assert len(davis_rs.Dataset(tmp_path / "own").imu) == 51
    assert len(davis_rs.Dataset(tmp_path / "own").frames) == 6


def test_frames_and_imu_are_those_of_the_dataset() -> None:
    """24 frames a second where it was recorded, 40 where it was simulated; no IMU on the slider and in simulation."""
    for name, sequence in SEQUENCES.items():
        simulated = name.startswith("simulation")
        assert sequence.settings["frame_rate_hz"] == sequence.settings["depth_rate_hz"] == (40 if simulated else 24)
        assert sequence.settings["imu"] == (None if simulated or name.startswith("slider") else "mpu6150")


@pytest.mark.long
def test_the_recorded_sensor_is_a_name_that_only_recorded_sequences_know(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its thresholds are the scene's, the rest follows from the biases; other scenes refuse the name."""
    options = ["--duration", "0.02", "--rays-per-pixel", "1", "--quiet", "--size", "240x180", "--sensor", "recorded"]
    assert main(["sequence", "slider_depth", "-o", str(tmp_path / "slider"), *options]) == 0
    sensor = json.loads((tmp_path / "slider" / "meta.json").read_text())["parameters"]["sensor"]
    scene = SEQUENCES["slider_depth"].scene()
    assert sensor == asdict(recorded_sensor("indoors", scene.contrast_threshold))
    assert (sensor["contrast_threshold"], sensor["contrast_threshold_off"]) == (scene.contrast_threshold, None)
    assert sensor["refractory_period_us"] == pytest.approx(12.96, abs=0.01)
    assert sensor["source_follower_bandwidth_hz"] is None
    assert sensor["hot_pixel_fraction"] == davis_rs.SENSORS["davis240c"].hot_pixel_fraction
    assert main(["simulate", "three_planes", "-o", str(tmp_path / "planes"), "--sensor", "recorded"]) == 1
    assert "scene 'three_planes' has no recording" in capsys.readouterr().err
    with pytest.raises(ValueError, match="has no recording"):
        davis_rs.Simulator(SEQUENCES["simulation_3planes"].scene(), sensor="recorded")
    outdoors = recorded_sensor("outdoors", 0.4)
    assert outdoors.source_follower_bandwidth_hz == pytest.approx(590, abs=1)
    for made in (davis_rs.SENSORS["davis240c"], recorded_sensor("indoors", 0.5), outdoors):
        effects, on = made.effects(1.0), made.contrast_threshold
        assert effects.shot_noise_rms is not None
        assert effects.threshold_mismatch is not None
        assert on is not None
        hz = effects.shot_noise_rms.mean_rate_hz(
            on, made.contrast_threshold_off or on, effects.threshold_mismatch, 200.0
        )
        assert hz == pytest.approx(0.00495, rel=0.01)  # at 200 lux the preset's
    with pytest.raises(ValueError, match="sensor must be one of ideal, davis240c, davis346"):
        next(iter(davis_rs.events_from_frames(np.zeros((2, 8, 8)), fps=10, sensor="recorded")))


def test_the_list_has_the_paper_beside_ours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row has T, TS, RS and NE twice; what was not counted is a dash."""
    counts = tmp_path / "counts.csv"
    write_counts(counts, [EventCount("slider_depth", 3.4, 1_000_001, 500_000, 1.0, 5, 0.5, 0.1)])
    measured = ["--measured", str(counts)]
    assert main(["sequences", "slider_depth", "urban", *measured]) == 0
    head, depth, urban, *differs = (line.split() for line in capsys.readouterr().out.splitlines())
    assert head[0] == "sequence"
    assert depth[-8:] == ["3.4", "3.4", "0.32", "0.32", "0", "0", "1,078,541", "1,000,001"]
    assert urban[-2:] == ["5,359,539", "-"]
    assert urban[-6] == "n/a"
    assert [line[0] for line in differs] == ["slider_depth,", "urban,"]
    assert tables(["table", "slider_depth", *measured]) == 0
    assert capsys.readouterr().out.splitlines()[2].startswith("| slider_depth | motorized slider | davis240c |")


@pytest.mark.long
def test_the_table_in_the_docs_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    """All 27 rows, as they are now."""
    assert tables(["table"]) == 0
    printed = capsys.readouterr().out
    assert len(printed.splitlines()) == 29
    assert printed in (ROOT / "docs" / "sequences.md").read_text()


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_counting_goes_on_where_it_was_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the file has is not counted again."""
    path = tmp_path / "counts.csv"
    write_counts(path, [EventCount(name, 10.7, 7, 3, 1.0, 5, 0.5, 0.1) for name in ("a_users_own", "urban")])
    assert tables(["count", "simulation_3planes", "urban", "-o", str(path)]) == 0
    assert capsys.readouterr().out.startswith("simulation_3planes: ")
    counts = read_counts(path)
    assert list(counts) == ["urban", "simulation_3planes", "a_users_own"]
    assert counts["urban"].events == 7
    with pytest.raises(FileNotFoundError):
        tables(["count", "slider_depth", "-o", str(tmp_path / "no" / "counts.csv")])
    with pytest.raises(ValueError, match="has counts of --sensor ideal, these are of recorded"):
        tables(["count", "slider_depth", "-o", str(path), "--sensor", "recorded"])
    recorded = tmp_path / "recorded.csv"
    assert tables(["count", "simulation_3planes", "-o", str(recorded), "--sensor", "recorded"]) == 0
    assert read_counts(recorded) == {}  # nothing was recorded


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_sheet_shows_frames_and_events(tmp_path: Path) -> None:
    """One tile a sequence, three a row: a grey frame, and the same faded with red and blue events."""
    from PIL import Image

    assert tables(["sheet", "simulation_3planes", "slider_depth", "-o", str(tmp_path / "sheet.png")]) == 0
    picture = np.asarray(Image.open(tmp_path / "sheet.png")).astype(int)
    assert picture.shape == (200, 3 * 488 - 8, 3)
    for left in (0, 488):
        frame, events = picture[20:, left : left + 240], picture[20:, left + 240 : left + 480]
        assert (frame.max(2) == frame.min(2)).all()
        assert np.unique(frame).size > 20
        coloured = events.max(2) - events.min(2) > 100
        assert 0.02 < coloured.mean() < 0.2
