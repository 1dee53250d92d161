"""How long a run will take: said before it begins, where that is long."""

from __future__ import annotations

from pathlib import Path

import pytest

from davis_rs import Camera, load_scene
from davis_rs._util.progress import Forecast
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.sampling.rules import FixedRate, MaxDisplacement
from davis_rs.sampling.tolerance import Tolerance
from davis_rs.simulation import run_time
from davis_rs.simulation.folder import simulate_to_folder
from davis_rs.simulation.run_time import estimate_run_time

pytestmark = pytest.mark.without_llvm

CAMERA = Camera(width=64, height=48, fx=55.0, fy=55.0, cx=31.5, cy=23.5)
SCENE = load_scene("three_planes").crop(0.0, 1.0)


def renderer_of(rays: int, pixel: str = "rays"):  # type: ignore[no-untyped-def]
    return make_renderer(SCENE, CAMERA, kind="native", rays_per_pixel=rays, pixel=pixel, blur=False)


@pytest.mark.parametrize(
    ("rays", "frame_s", "ray_s", "measured", "text"),
    [
        (32, 0.0, 1.5, [2, 8], "about 50 seconds"),
        (64, 2.9, 0.05, [2, 8, 64], "about 6 seconds"),
        (64, 40.0, 0.0, [2, 8], "about 40 seconds"),
        (8, 3.0, 0.0, [2, 8], "about 3 seconds"),
    ],
    ids=["rays", "mostly the frame", "the frame", "few rays"],
)
def test_the_time_is_that_of_all_frames(
    rays: int, frame_s: float, ray_s: float, measured: list[int], text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames are as many as the rule renders. A slow one is rendered by few rays, others as the run does it."""
    asked = []

    def seconds(renderer: NativeRenderer, _: Views) -> float:
        asked.append(renderer.rays_per_pixel)
        return frame_s + ray_s * renderer.rays_per_pixel

    monkeypatch.setattr(run_time, "TOLD_S", 0.0)
    monkeypatch.setattr(run_time, "_seconds", seconds)
    rule = MaxDisplacement(1 / 4)
    renderer = renderer_of(rays)
    found = estimate_run_time(renderer, SCENE.path, rule)
    assert found is not None
    assert found.frames == pytest.approx(len([*rule.instants(renderer, SCENE.path, 1_000_000)]), rel=0.2)
    assert asked == measured
    assert found.seconds == pytest.approx(found.frames * (frame_s + ray_s * rays))
    assert f"some {found.frames:,} frames of {text} each (--size" in str(found)
    wider = estimate_run_time(renderer, SCENE.path, Tolerance(pixels=1 / 2))
    assert wider is not None
    assert wider.frames == pytest.approx(found.frames / 2, rel=0.01)


def test_where_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of short runs, measured or not, and of rules that do not space frames by displacement."""
    assert estimate_run_time(renderer_of(4), SCENE.path, MaxDisplacement()) is None
    monkeypatch.setattr(run_time, "_SLOWEST_RAY_S", 1e3)
    assert estimate_run_time(renderer_of(4), SCENE.path, MaxDisplacement()) is None
    assert estimate_run_time(renderer_of(4), SCENE.path, FixedRate(1e6)) is None
    at_rest = SCENE.crop(0.0, 1e-6).path
    assert estimate_run_time(renderer_of(4), at_rest, MaxDisplacement()) is None


@pytest.mark.parametrize("told_s", [0.0, 1e9])
def test_one_line_says_how_long_a_run_takes(
    told_s: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The one before the run or, where that is not known, the one that goes by the first frames."""
    monkeypatch.setattr(run_time, "TOLD_S", told_s)
    monkeypatch.setattr(run_time, "_SLOWEST_RAY_S", 1e3)
    monkeypatch.setattr(Forecast, "seconds", lambda *_: 1000.0)
    simulate_to_folder(SCENE.crop(0.0, 0.02), tmp_path / "out", camera=CAMERA, rays_per_pixel=1)
    told = capsys.readouterr().err
    lines = ["this run will take about", "simulating will take about 17 minutes"]
    assert [told.count(line) for line in lines] == ([1, 0] if told_s == 0 else [0, 1])
