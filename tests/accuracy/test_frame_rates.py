"""What a frame rate costs: the sweep over videos of a scene, small."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from davis_rs import Camera, load_scene
from davis_rs.accuracy.frame_rate_report import draw_frame_rates, frame_rates_markdown
from davis_rs.accuracy.frame_rates import FrameRateSweep, VideoErrors, VideoSetting, video_settings
from davis_rs.cli.main import main

CAMERA = Camera(64, 48, 200.0, 200.0, 31.5, 23.5)

pytestmark = pytest.mark.usefixtures("llvm")


@pytest.fixture(scope="module")
def measured() -> list[VideoErrors]:
    sweep = FrameRateSweep(load_scene("three_planes"), start_s=1.0, duration_s=0.1, camera=CAMERA)
    settings = [VideoSetting(fps, 32, rule) for fps in (30, 120, 960) for rule in ("linear", "flow")]
    return list(sweep.measure([*settings, VideoSetting(120, 8, "linear")]))


@pytest.mark.long
def test_errors_fall_with_the_frame_rate_and_flow_helps_where_it_is_low(measured: list[VideoErrors]) -> None:
    by = {tuple(one.setting): one for one in measured}
    assert [one.displacement_px for one in measured[::2]] == pytest.approx(
        [one.displacement_px for one in measured[::2]]
    )
    line, flow = ([by[fps, 32, rule] for fps in (30, 120, 960)] for rule in ("linear", "flow"))
    assert line[0].displacement_px == pytest.approx(4 * line[1].displacement_px)
    assert line[0].median_us > 3 * line[1].median_us > 9 * line[2].median_us
    assert line[2].missing_percent + line[2].spurious_percent < 2  # the exact stream is that of the same light
    assert flow[0].median_us < 0.6 * line[0].median_us
    assert flow[0].missing_percent + flow[0].spurious_percent < 0.6 * (
        line[0].missing_percent + line[0].spurious_percent
    )
    assert by[120, 8, "linear"].median_us > line[1].median_us  # rounding costs too


@pytest.mark.long
def test_the_report(measured: list[VideoErrors], tmp_path: Path) -> None:
    page = frame_rates_markdown(measured, {"scene": "three_planes"})
    rows = [line for line in page.splitlines() if line.startswith("| ") and "frames/s" not in line]
    assert len(rows) == len(measured)
    assert sum("**" in row for row in rows) >= 4
    draw_frame_rates(measured, tmp_path / "rates.png", "three_planes")
    assert (tmp_path / "rates.png").stat().st_size > 20_000


def test_all_settings_are_there() -> None:
    settings = video_settings()
    assert len(settings) == len(set(settings)) == 5 * 2 * 4


@pytest.mark.long
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("davis_rs.cli.accuracy.video_settings", lambda: video_settings((60.0,))[:3])
    words = [
        "accuracy",
        "three_planes",
        "--frames",
        "-o",
        str(tmp_path),
        "--start",
        "1",
        "--duration",
        "0.04",
        "--quiet",
    ]
    (tmp_path / "calib.txt").write_text("100 100 31.5 23.5 0 0 0 0 0\n")
    assert main([*words, "--camera", str(tmp_path / "calib.txt"), "--size", "64x48"]) == 0
    with (tmp_path / "frame_rates.csv").open() as file:
        assert [row["interpolation"] for row in csv.DictReader(file)] == ["linear", "cubic", "flow"]
    assert (tmp_path / "frame_rates.png").exists()
    assert main([*words, "--only", "lines"]) == 1
    assert "--only chooses settings of the simulator" in capsys.readouterr().err
    assert main([*words, "--rounds", "2"]) == 1
    assert "--frames times nothing" in capsys.readouterr().err


def test_what_cannot_be_judged() -> None:
    scene = load_scene("three_planes")
    with pytest.raises(ValueError, match="30 frames a second have no two frames"):
        list(
            FrameRateSweep(scene, start_s=1.0, duration_s=0.01, camera=CAMERA).measure([VideoSetting(30, 32, "linear")])
        )
