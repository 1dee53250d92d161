"""A recording that is simulated here is reproduced by its own sensor, and by no other one."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from command_line import davis_rs as command
from davis_rs import StampedFrame, reproduce
from davis_rs.events.arrays import EVENT_DTYPE
from davis_rs.reproduction import RecordedClip, Reproduction
from davis_rs.reproduction.clip_statistics import burst_starts
from davis_rs.reproduction.figure import draw_reproduction
from davis_rs.sensor.presets import SensorFile
from recorded_clips import SENSOR, clip_of

DESCRIPTION = "A sensor whose biases are neither those of the driver nor any that a camera has. It makes the clip."


@pytest.fixture(scope="module")
def clip() -> RecordedClip:
    return clip_of()


@pytest.fixture(scope="module")
def reproduced(clip: RecordedClip) -> Reproduction:
    wrong = clip_of(replace(SENSOR, contrast_threshold=0.3, contrast_threshold_off=0.36))
    late = clip.events.copy()
    late["t"] += 4000
    return reproduce(clip, base=SensorFile(SENSOR, DESCRIPTION), against={"wrong": wrong.events, "late": late})


def test_its_own_sensor_reproduces_it(reproduced: Reproduction) -> None:
    """All but two statistics within three standard deviations, none beyond five; correlations above those of halves.

    The bits of NumPy's functions differ between processors; so do the clip, its fit and these numbers, a little.
    """
    half = reproduced.halves[0]
    within, judged = half.within("fitted")
    assert judged >= 8
    assert within >= judged - 2
    assert max(abs(row.others["fitted"][1]) for row in half.rows if row.judged) < 5
    vox20 = half.agreement[1]
    assert vox20.others["fitted"][0].value > max(0.95, vox20.real.value)


def test_what_is_assumed_ends_at_a_sentence(reproduced: Reproduction) -> None:
    assert reproduced.notes[0] == f"what the fit does not find comes from: {DESCRIPTION.partition('. ')[0]}"


def test_another_sensor_does_not(reproduced: Reproduction) -> None:
    """Thresholds that are half as high again: rates and intervals are told apart."""
    z = {row.name: row.others["wrong"][1] for row in reproduced.halves[0].rows}
    assert z["ON events of a pixel"] < -3
    assert z["OFF events of a pixel"] < -3
    assert z["50 % of intervals of one polarity are below"] > 3


def test_a_late_stream_has_the_rates_and_not_the_correlation(reproduced: Reproduction) -> None:
    half = reproduced.halves[0]
    rows = {row.name: row for row in half.rows}
    assert abs(rows["ON events of a pixel"].others["late"][1]) < 3
    assert half.agreement[2].others["late"][0].value < half.agreement[2].others["fitted"][0].value


def test_the_figure_says_which_half_it_shows(reproduced: Reproduction, tmp_path: Path) -> None:
    """Each half has a title of its own."""
    (half,) = reproduced.halves
    other = replace(half, half=half.half._replace(name="first"))
    both = replace(reproduced, halves=(half, other))
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        drawn = draw_reproduction(both, tmp_path / "both.svg").read_text()
    assert drawn.count(reproduced.name) == 2
    assert drawn.count("fitted to the first half, compared with the second half: frames 3 to 6") == 1
    assert drawn.count("fitted to the second half, compared with the first half: frames 3 to 6") == 1


def test_halves_share_no_events_and_an_odd_frame_belongs_to_both(clip: RecordedClip) -> None:
    first, second = clip.halves
    assert first.frames == range(4)
    assert second.frames == range(3, 7)
    assert first.stop_us == second.start_us
    assert len(clip.outside(first)) + len(clip.between(first.start_us, first.stop_us)) == len(clip.events)


def test_bursts_begin_ten_microseconds_after_the_one_before() -> None:
    stamps = np.array([0, 3, 9, 10, 12, 19, 20, 40])
    assert burst_starts(stamps).tolist() == [0, 3, 6, 7]


def test_what_is_no_clip_is_told_in_a_line(clip: RecordedClip) -> None:
    frames = list(clip.source.frames())
    with pytest.raises(ValueError, match="there are 2 frames, and at least 3 are needed"):
        RecordedClip.of("short", clip.size, clip.events, frames[:2])
    with pytest.raises(ValueError, match="no events between the frames of the first half"):
        RecordedClip.of("late", clip.size, clip.events[clip.events["t"] > frames[4].t_us], frames)
    with pytest.raises(ValueError, match="stamps of frames must increase"):
        RecordedClip.of("repeated", clip.size, clip.events, [frames[0], *frames])
    with pytest.raises(ValueError, match="events must lie inside the sensor's 20 x 20"):
        RecordedClip.of("small", (20, 20), clip.events, frames)
    with pytest.raises(ValueError, match="fit must be one of first, second, both, got 'third'"):
        reproduce(clip, fit="third")
    black = [StampedFrame(frame.t_us, frame.exposure_us, 0 * frame.values) for frame in frames]
    with pytest.raises(ValueError, match="frames have no light"):
        reproduce(RecordedClip.of("black", clip.size, clip.events, black))


@pytest.mark.long
def test_the_command_writes_tables_and_says_what_is_missing(tmp_path: Path) -> None:
    """Of a dataset folder; a file without frames gets one line."""
    out = tmp_path / "run"
    made = command("simulate", "slider_close", "-o", out, "--duration", "0.3", "--frame-rate", "25", "--quiet")
    assert made.returncode == 0, made.stderr
    told = command("reproduce", out, "-o", tmp_path / "page", "--quiet", "--no-figure", "--fit", "both")
    assert told.returncode == 0, told.stderr
    assert "compared with the second half" in told.stdout
    rows = list(csv.DictReader(io.StringIO((tmp_path / "page" / "table.csv").read_text())))
    assert {row["half"] for row in rows} == {"first", "second"}
    assert {row["stream"] for row in rows} == {"real", "fitted", "fitted, no noise", "ideal"}
    described = json.loads((tmp_path / "page" / "table.json").read_text())
    assert described["halves"][0]["half"] == "second"
    again = command("reproduce", out, "-o", tmp_path / "page", "--quiet")
    assert "is not empty" in again.stderr
    events = np.zeros(3, EVENT_DTYPE)
    np.save(tmp_path / "events.npy", events)
    bare = command("reproduce", tmp_path / "events.npy", "-o", tmp_path / "no", "--size", "60x45", "--quiet")
    assert bare.returncode == 1
    assert bare.stderr == "davis-rs: error: events.npy: there are no frames, and light comes from frames\n"
