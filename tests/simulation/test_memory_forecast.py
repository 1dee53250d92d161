"""The memory of a run is forecast: what cannot fit is refused before it begins, and what is much is told."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import davis_rs
from command_line import davis_rs as command
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util import memory_forecast
from davis_rs._util.memory_forecast import MemoryForecast, MeshForecast, simulation_forecast
from davis_rs.geometry.camera import PRESETS, Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.rays.camera_rays import pixel_rays, ray_table, table_bytes
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.settings import FrameSettings, complete

GIB = 1 << 30
GiB = r"[\d.]+ [KMG]iB"


def with_available(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    monkeypatch.setattr(memory_forecast, "available_bytes", lambda: size)


def test_what_cannot_fit_is_refused_with_the_size_that_fits() -> None:
    """That size has the same shape, and is not refused."""
    forecast = simulation_forecast((8000, 4000), cubic=True, ray_bytes=16)
    with pytest.raises(
        ValueError, match=rf"8000 x 4000 pixels needs about {GiB} of memory .*, and 2 GiB are"
    ) as refused:
        forecast.refuse(2 * GIB)
    found = re.search(r"(\d+) x (\d+) would fit", str(refused.value))
    assert found is not None
    width, height = int(found.group(1)), int(found.group(2))
    assert width == pytest.approx(2 * height, abs=2)
    simulation_forecast((width, height), cubic=True, ray_bytes=16).refuse(2 * GIB)
    assert simulation_forecast((width + 4, height + 2), cubic=True, ray_bytes=16).bytes > 2 * GIB


def test_more_than_a_quarter_is_told() -> None:
    forecast = MemoryForecast(1000, 1000, {"all of it": 100.0})
    assert forecast.line(400_000_001) == ""
    assert "1000 x 1000" in forecast.line(399_999_999)
    assert "95.4 MiB" in forecast.line(399_999_999)
    assert forecast.workers(8, 2 * (forecast.bytes + memory_forecast.WORKER_BYTES)) == 2
    assert forecast.workers(8, 0) == 1


def test_more_triangles_than_fit_are_refused_with_the_number_that_fits() -> None:
    """What a triangle has besides its corners counts too."""
    forecast = MeshForecast(10_000_000, textured=True, smooth=True, sharp_lights=2)
    with pytest.raises(
        ValueError, match=rf"10,000,000 triangles needs about {GiB} of memory, and 4 GiB are"
    ) as refused:
        forecast.refuse(4 * GIB)
    fits = re.search(r"([\d,]+) triangles would fit", str(refused.value))
    assert fits is not None
    count = int(fits.group(1).replace(",", ""))
    assert forecast.bytes / 10_000_000 * count == pytest.approx(4 * GIB, rel=1e-6)
    forecast.refuse(forecast.bytes)
    assert forecast.line(4 * forecast.bytes) == ""
    assert "10,000,000 triangles will take about" in forecast.line(4 * forecast.bytes - 1)
    flat = MeshForecast(10_000_000, textured=False, smooth=False, sharp_lights=0)
    for larger in (
        MeshForecast(10_000_000, textured=True, smooth=False, sharp_lights=0),
        MeshForecast(10_000_000, textured=False, smooth=True, sharp_lights=0),
        MeshForecast(10_000_000, textured=False, smooth=False, sharp_lights=1),
    ):
        assert flat.bytes < larger.bytes


def test_a_mesh_is_told_or_refused_before_its_tables_are_made(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = davis_rs.load_scene("three_walls")
    with_available(monkeypatch, 4000)
    with pytest.raises(ValueError, match="triangles would fit"):
        make_renderer(scene, scene.own_camera, kind="native", lattice_rays_per_pixel=1)
    with_available(monkeypatch, 8000)
    with variant(SCALAR) as (mi, _):
        SceneTable(load_scene_source(scene.source(), mi), mi, shadows=True, any_integrator=False)
    assert re.search(r"triangles will take about [\d.]+ KiB of memory; 7.81 KiB are available", capsys.readouterr().err)


@pytest.mark.parametrize("size", ["65535x65535", "30000x20000"])
def test_a_sensor_that_no_memory_holds_is_refused_at_once(
    size: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By the command line's name of the setting; before this a MemoryError came after a while."""
    with_available(monkeypatch, 8 * GIB)
    for words in (["simulate", "three_planes", "-o", tmp_path / "out"], ["plan", "three_planes"]):
        ended = command(*words, "--size", size)
        assert ended.returncode == 1
        assert re.match(rf"davis-rs: error: a --size of .* needs about {GiB} of memory", ended.stderr)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_limit_of_the_address_space_counts(run_python: Callable[..., str]) -> None:
    program = """
import resource
import davis_rs
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
try:
    davis_rs.Simulator(davis_rs.load_scene("three_planes"), size="4096x4096")
except ValueError as error:
    print(error)
"""
    assert re.match(rf"a size of 4096 x 4096 pixels needs about {GiB} of memory", run_python(program))


def test_the_limits_of_control_groups_count(tmp_path: Path) -> None:
    """Of both versions, and of the groups around; what is cached can be given up."""
    own = tmp_path / "own"
    own.write_text("4:memory:/a/b\n3:cpu:/a\n0::/c\n")
    files = {
        "memory/a/memory.limit_in_bytes": "5000",
        "memory/a/memory.usage_in_bytes": "1000",
        "memory/a/memory.stat": "cache 7\ntotal_inactive_file 100\n",
        "memory/memory.limit_in_bytes": "9223372036854771712",
        "memory/memory.usage_in_bytes": "1000",
        "c/memory.max": "max",
        "c/memory.current": "1",
        "memory.max": "3000",
        "memory.current": "2000",
        "memory.stat": "inactive_file 500\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert sorted(memory_forecast._of_the_groups(tmp_path, own)) == [1500, 4100]
    assert memory_forecast._of_the_groups(tmp_path, tmp_path / "none") == []
    found = memory_forecast.available_bytes()
    assert found is None or 1 << 20 < found < 1 << 50


@pytest.mark.long
def test_each_way_forecasts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Simulations and frames say what is much; both refuse what is too much, and so does a plan, before it begins."""
    frames = tmp_path / "frames.npy"
    np.save(frames, np.zeros((3, 60, 80), np.uint8))
    plan = tmp_path / "plan.yaml"
    plan.write_text("sequences: 4\nseed: 1\nscene: three_planes\nduration: 0.01\nsize: 80x60\nrays_per_pixel: 1\n")
    ways: dict[str, list[object]] = {
        "simulate": ["simulate", "three_planes", "--duration", "0.01", "--size", "80x60", "--rays-per-pixel", 1],
        "frames": ["frames", frames, "--fps", 100, "--interpolation", "linear"],
        "generate": ["generate", plan, "--workers", 4],
    }
    for name, words in ways.items():
        with_available(monkeypatch, 200_000)
        refused = command(*words, "-o", tmp_path / name)
        assert refused.returncode == 1
        assert re.search(
            r"80 x 60 pixels needs about .* and 195 KiB are available: \d+ x \d+ would fit", refused.stderr
        )
        assert not list((tmp_path / name).glob("[!.]*"))
        with_available(monkeypatch, 2_600_000)
        told = command(*words, "-o", tmp_path / name).stderr
        line = "1 of 4 processes at a time: a sequence of" if name == "generate" else "80 x 60 pixels will take about"
        assert told.count(line) == 1


@pytest.mark.long
def test_the_forecast_is_near_what_is_taken(run_python: Callable[..., str]) -> None:
    """Little less than a run takes at most, and not far more: what is refused would not have fitted."""
    program = """
import re, sys
from pathlib import Path
import davis_rs
side = int(sys.argv[1])
scene = davis_rs.load_scene("three_planes").crop(0, 0.0005)
made = davis_rs.Simulator(scene, size=(side, side), rays_per_pixel=1)
for packet in made.run():
    del packet
peak = re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())  # ru_maxrss is the parent's, too
print(int(peak.group(1)) * 1024, made.memory.bytes)
"""
    # The first run may compile modules, which takes memory of its own: the small run's peak is that of the second.
    # Memory that the imports gave back is taken again, up to 10 MB: 1,024 pixels a side are so many that it is little.
    _, (small, _), (large, forecast) = (map(int, run_python(program, side).split()) for side in ("32", "32", "1024"))
    taken = large - small
    assert taken < 1.1 * forecast
    assert forecast < 2.5 * taken


@pytest.mark.parametrize("camera", [PRESETS["ideal"], PRESETS["davis240c"]], ids=["columns and rows", "parts"])
def test_rays_in_parts_are_those_of_a_table(camera: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit: what a renderer makes of them is the same."""
    monkeypatch.setattr("davis_rs.render.rays.camera_rays._BLOCK_BYTES", 1 << 20)
    scene = davis_rs.load_scene("three_walls")
    renderer = davis_rs.Simulator(scene, camera=camera, renderer="native").renderer
    views = Views.along(scene.path, np.array([0.0, 0.3, 0.9]))
    pixel_rays.cache_clear()
    found = renderer.luma_and_rate(views)

    def whole(camera: Camera, rays: int) -> davis_rs._core.PixelRays:
        table = ray_table(camera, rays).astype(np.float32)
        return davis_rs._core.PixelRays(camera.width, camera.height, rays, table.ravel())

    monkeypatch.setattr("davis_rs.render.native.renderer.pixel_rays", whole)
    for one, other in zip(found, renderer.luma_and_rate(views), strict=True):
        assert np.array_equal(one, other)
    pixel_rays.cache_clear()


def test_rays_take_little_while_they_are_made() -> None:
    """A table of all of them, in float64, would be 512 MiB here."""
    camera = Camera(1024, 1024, 800.0, 800.0, 511.5, 511.5)
    lens = Camera(256, 256, 200.0, 200.0, 127.5, 127.5, k1=-0.1)
    for one, most in ((camera, 4 << 20), (lens, 200 << 20)):
        tracemalloc.start()
        pixel_rays(one, 32)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < most
    assert table_bytes(camera, 32) < 1 << 20
    assert table_bytes(lens, 32) == 8 * 32 * 256 * 256
    pixel_rays.cache_clear()


def test_frames_are_forecast_by_their_size(tmp_path: Path) -> None:
    """A frame that is larger than its part that is taken counts whole."""
    np.save(tmp_path / "frames.npy", np.zeros((3, 60, 80), np.uint8))
    source = davis_rs.open_frames(tmp_path / "frames.npy", fps=100)
    runs = [FrameRun(source, complete(FrameSettings, {"crop": crop}, taker="a test")) for crop in (None, "40x30")]
    whole, part = (sum(run.memory.bytes_per_pixel.values()) for run in runs)
    assert part > whole
