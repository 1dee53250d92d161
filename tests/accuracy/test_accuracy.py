"""The sweep of settings: its references, what it measures, what it writes, and the fence it is hardest on."""

from __future__ import annotations

import csv
import signal
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import (
    ACCURACY,
    Camera,
    FixedRate,
    MaxDisplacement,
    Pose,
    Scene,
    SegmentTrajectory,
    Simulator,
    Tolerance,
    Trajectory,
    load_scene,
    log_intensity,
    start_pose,
)
from davis_rs.accuracy.accuracy_sweep import Measurement, Sweep, sweep
from davis_rs.accuracy.reference_events import (
    Crossings,
    FineReference,
    Recipe,
    exact_crossings,
    fine_reference,
    in_ticks,
)
from davis_rs.accuracy.report import draw, facts_of, markdown, pareto
from davis_rs.accuracy.settings import Setting, default_settings
from davis_rs.cli.accuracy import run_sweep
from davis_rs.cli.main import main
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.matching import compare_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.interpolate import interpolated
from davis_rs.sampling.keyframes import Keyframe, SparseSamples
from davis_rs.scene import meshes

CAMERA = Camera(40, 30, 200.0, 200.0, 19.5, 14.5)
"""The middle of the ideal camera's image: textures are as sharp as there."""
SIZE = (CAMERA.width, CAMERA.height)

pytestmark = pytest.mark.usefixtures("llvm")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("three_planes")


@pytest.fixture(scope="module")
def recipe(scene: Scene) -> Recipe:
    """30 ms, in which the fastest pixel moves some 3 px."""
    assert scene.trajectory is not None
    return Recipe(scene.trajectory.crop(1.0, 0.03), scene.contrast_threshold, 1e-3, 10_000)


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> Renderer:
    return make_renderer(scene, CAMERA, rays_per_pixel=4)


def simulated(scene: Scene, recipe: Recipe, pixels: float, *, rays_per_pixel: int = 4) -> EventArray:
    simulator = Simulator(
        scene.with_trajectory(recipe.trajectory),
        camera=CAMERA,
        sampling=MaxDisplacement(pixels),
        rays_per_pixel=rays_per_pixel,
        frame_rate_hz=0,
        depth_rate_hz=0,
    )
    return concatenate_events([packet.events for packet in simulator.run()])


# ---- references ----


@pytest.fixture(scope="module")
def exact(renderer: Renderer, recipe: Recipe) -> Crossings:
    return exact_crossings(renderer, recipe)


def test_exact_crossings_lie_between_two_ticks(renderer: Renderer, recipe: Recipe, exact: Crossings) -> None:
    """The renderer's own luma has reached the level at the tick of each event, and not one tick before."""
    events = exact.events
    assert len(events) > 500
    pixel = events["y"].astype(np.int64) * CAMERA.width + events["x"]
    sign = np.where(events["p"] == 1, 1, -1)

    def excess(ticks: np.ndarray[tuple[int], np.dtype[np.int64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        views = Views.along(recipe.trajectory, ticks * 1e-7)
        luma = renderer.samples(views, np.arange(len(ticks)), pixel)
        return np.asarray(sign * (log_intensity(luma[None], recipe.log_eps)[0] - exact.level))

    assert (excess(events["t"]) >= 0).all()
    assert (excess(events["t"] - 1) < 0).all()


def test_exact_crossings_are_those_of_dense_rendering(scene: Scene, renderer: Renderer, recipe: Recipe) -> None:
    """The same events as a simulation with the same dense renders, and levels a whole number of thresholds apart."""
    found = exact_crossings(renderer, recipe, pixels=1 / 20)
    dense = simulated(scene, recipe, 1 / 20)
    compared = compare_events(in_ticks(dense), found.events, size=SIZE, window_us=100_000)
    assert compared.missing + compared.spurious <= 0.01 * len(dense)
    assert compared.median_us < 400  # ticks: a texelsh of the 0.5 ms between renders
    first = log_intensity(renderer.luma(Views.along(recipe.trajectory, [0.0]))[0], recipe.log_eps)
    steps = (found.level - first[found.events["y"], found.events["x"]]) / recipe.contrast_threshold
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)


def test_coarser_renders_are_further_off_in_time(scene: Scene, recipe: Recipe, exact: Crossings) -> None:
    """Errors against the exact crossings of the same rays grow with the displacement between renders."""
    medians = [
        compare_events(in_ticks(simulated(scene, recipe, px)), exact.events, size=SIZE, window_us=100_000).median_us
        for px in (1 / 24, 1 / 6, 2 / 3)
    ]
    assert 2 * medians[0] < medians[1]
    assert 2 * medians[1] < medians[2]


def test_the_fine_reference_converges_and_is_kept(renderer: Renderer, recipe: Recipe, tmp_path: Path) -> None:
    """Halving its displacement moves events little; from its file it is the same, without a render."""
    cache = tmp_path / "deeper" / "frames.npz"

    def run(frames: Generator[tuple[int, int], None, FineReference]) -> tuple[int, FineReference]:
        rendered = 0
        while True:
            try:
                next(frames)
            except StopIteration as stop:
                return rendered, stop.value
            rendered += 1

    fine = make_renderer(load_scene("three_planes"), CAMERA, rays_per_pixel=64)
    rendered, first = run(fine_reference(fine, recipe, cache))
    assert rendered == len(first.t_us)
    assert first.pixels < 1 / 4
    assert first.shift_us[0] < 100
    assert first.changed_percent < 2
    assert first.luma.shape == (len(first.t_us), CAMERA.height, CAMERA.width)
    rendered, again = run(fine_reference(fine, recipe, cache))
    assert rendered == 0
    assert again.events.tobytes() == first.events.tobytes()
    # Another threshold is another sequence.
    assert run(fine_reference(fine, replace(recipe, contrast_threshold=0.3), cache))[0] > 5


def test_interpolation_is_the_engines(recipe: Recipe) -> None:
    """Lines, cubics with their limits, and sparse samples, on numbers worked out by hand."""
    eps = 1e-3

    def frame(*log: float) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
        return (np.exp(np.array([log])) - eps).astype(np.float32)

    def at(last: Keyframe, new: Keyframe, t_us: int) -> list[float]:
        ((_, nothing), (_, (log,))) = interpolated([last, new], [t_us], eps)
        assert nothing == []
        return np.round(log[0], 5).tolist()

    start, stop = frame(0, 0, 0, 0), frame(1, 1, 0, 1)
    lines = Keyframe(0, start), Keyframe(1000, stop)
    assert at(*lines, 250) == [0.25, 0.25, 0, 0.25]
    # Per second over a millisecond: slopes of 1 and 1, 0 and 0, +1 and -1, and two that go the other way.
    rates = np.array([[1000.0, 0, 1000, -1000]]), np.array([[1000.0, 0, -1000, -1000]])
    values = [np.exp([[0.0] * 4]), np.exp([[1.0, 1, 0, 1]])]
    cubic = [
        keyframe._replace(rate=(rate * value).astype(np.float32))
        for keyframe, rate, value in zip(lines, rates, values, strict=True)
    ]
    assert at(cubic[0], cubic[1], 500) == [0.5, 0.5, 0.25, 0.5]
    assert at(cubic[0], cubic[1], 250) == [0.25, 0.15625, 0.1875, 0.25]
    sparse = SparseSamples(
        np.array([1, 1], np.uint32), np.array([400, 800]), (np.exp([2.0, 0.0]) - eps).astype(np.float32)
    )
    for t_us, expected in [(200, 1.0), (400, 2.0), (600, 1.0), (900, 0.5)]:
        assert at(lines[0], lines[1]._replace(sparse=sparse), t_us)[1] == expected


# ---- the sweep ----

SETTINGS = [
    Setting("close", "lines", MaxDisplacement(1 / 6), 4),
    Setting("wide", "lines", MaxDisplacement(1.0), 4),
    Setting("cubic", "cubics", MaxDisplacement(1.0, hermite=True), 4),
    Setting("loose", "tolerance", Tolerance(0.4), 4),
    Setting("unkept", "tolerance", Tolerance(0.02, pixels=1.0, halvings=0), 4),
    Setting("usual", "Mitsuba", MaxDisplacement(1.0), 4, "integrator"),
    Setting("named", "presets", ACCURACY["fast"].sampling, 8, preset="fast"),
]


@pytest.fixture(scope="module")
def prepared(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    folder = tmp_path_factory.mktemp("sweep")
    made = Sweep(scene, start_s=1.0, duration_s=0.03, camera=CAMERA, folder=folder, fine_rays=64)
    counted = list(made.prepare())
    assert [done for done, _ in counted] == list(range(1, len(made.fine.t_us) + 1))
    assert len({most for _, most in counted}) == 1
    assert counted[-1][0] <= counted[-1][1]
    return made


@pytest.fixture(scope="module")
def measured(prepared: Sweep) -> list[Measurement]:
    runs = list(sweep(prepared, SETTINGS, 2))
    assert len(runs) == 2 * len(SETTINGS)
    return runs[-1]


@pytest.mark.long
def test_what_a_sweep_measures(prepared: Sweep, measured: list[Measurement]) -> None:
    """Close renders are better in time than wide ones, cubics than lines; random rays have no exact crossings."""
    close, wide, cubic, loose, unkept, usual, _ = measured
    assert close.in_time is not None
    assert wide.in_time is not None
    assert cubic.in_time is not None
    assert 2 * close.in_time.median_us < wide.in_time.median_us
    assert 2 * close.in_time.log_rms < wide.in_time.log_rms
    assert cubic.in_time.median_us < wide.in_time.median_us
    assert cubic.in_time.log_rms < wide.in_time.log_rms
    assert usual.in_time is None
    assert all(one.kept_percent is None for one in (close, wide, cubic, usual))
    assert loose.kept_percent is not None
    assert unkept.kept_percent is not None
    assert unkept.kept_percent < 90 < 95 < loose.kept_percent
    for measurement in measured:
        assert len(measurement.wall_s) == (1 if measurement.slow else 2)
        assert measurement.median_wall_s > 0
        assert measurement.in_all.median_us > 0.4  # a stamp's microsecond
        pixels = CAMERA.width * CAMERA.height
        rays = pixels * measurement.setting.rays_per_pixel
        in_keyframes = measurement.keyframes_per_s * rays
        assert in_keyframes < measurement.rays_per_s < 1.2 * in_keyframes + 200 * rays  # and probes
    assert prepared.path_px == pytest.approx(3, abs=0.3)
    assert close.keyframes_per_s == pytest.approx(prepared.path_px * 6 / 0.03, rel=0.15)


def test_a_setting_is_no_further_from_itself_than_its_stamps(prepared: Sweep, scene: Scene) -> None:
    """Rendered every microsecond a setting is its own exact crossings, but for the stamp's microsecond."""
    short = Sweep(scene, start_s=1.0, duration_s=2e-4, camera=CAMERA, folder=prepared.folder / "short", fine_rays=4)
    list(short.prepare())
    dense = short.measure(Setting("dense", "fixed", FixedRate(1e6), 4))
    assert dense.in_time is not None
    assert dense.in_time.log_rms == 0
    if dense.events:
        assert (dense.in_time.missing_percent, dense.in_time.spurious_percent) == (0, 0)
        assert dense.in_time.p99_us <= 1


@dataclass(frozen=True)
class CtrlC(MaxDisplacement):
    """A rule during which the user interrupts."""

    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> Iterator[int]:
        signal.raise_signal(signal.SIGINT)
        return super().instants(renderer, trajectory, end_us, start_us=start_us)


@pytest.mark.long
def test_meshes_are_made_for_each_setting(tmp_path: Path) -> None:
    """What is made under one of Mitsuba's variants is nothing to another, and what moves is left where a run ends."""
    made = []
    texels = np.random.Generator(np.random.PCG64(1)).uniform(0.2, 0.9, (64, 64, 3)).astype(np.float32)

    def source() -> dict[str, Any]:
        made.append(True)
        wall = meshes.shape(meshes.quad([-1, -1, 2], [2, 0, 0], [0, 2, 0]), texels)
        return {
            "type": "scene",
            "integrator": {"type": "direct"},
            "wall": wall,
            "lamp": {"type": "point", "intensity": 9.0},
        }

    path = SegmentTrajectory(Pose([0, 0, 0], [0, 0, 0, 1]), Pose([0.05, 0, 0], [0, 0, 0, 1]), 0.01)
    judged = Sweep(Scene("wall", source, trajectory=path), start_s=0.0, camera=CAMERA, folder=tmp_path, fine_rays=2)
    list(judged.prepare())
    settings = [Setting(name, "lines", MaxDisplacement(1.0), 2, name) for name in ("native", "table", "native")]
    counts = [judged.measure(setting, same_rays=False).events for setting in settings]
    assert min(counts) > 0
    assert len(made) >= len(settings)


@pytest.mark.long
def test_an_interrupted_sweep_keeps_its_rows(prepared: Sweep, capsys: pytest.CaptureFixture[str]) -> None:
    """Ctrl-C in the third of four settings: the two before are in all files, and the exit status tells."""
    settings = [*SETTINGS[:2], Setting("interrupted", "lines", CtrlC(), 4), SETTINGS[2]]
    assert run_sweep(prepared, settings, rounds=3, command="davis-rs", quiet=True) == 130
    with (prepared.folder / "accuracy.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["setting"] for row in rows] == ["close", "wide"]
    for row in rows:
        assert float(row["fine_median_us"]) > 0
        assert float(row["same_rays_log_rms"]) > 0
        assert float(row["wall_s_per_s"]) > 0
        assert int(row["rounds"]) == 1
    page = (prepared.folder / "accuracy.md").read_text()
    assert "interrupted" in page
    assert all(f"| {name}" in page for name in ("close", "wide"))
    assert str(prepared.folder / "accuracy.md") in capsys.readouterr().out
    left = {file.name for file in prepared.folder.iterdir() if file.is_file()}
    assert left == {"accuracy.csv", "accuracy.md", "accuracy.png", "reference_64_rays.npz"}


@pytest.mark.long
def test_the_report(prepared: Sweep, measured: list[Measurement], tmp_path: Path) -> None:
    """A row for each setting, by time; how it was measured; and a figure."""
    facts = facts_of(prepared, measured, command="davis-rs accuracy three_planes", interrupted=True)
    page = markdown(measured, facts)
    rows = [line.split("|")[1:] for line in page.splitlines() if line.startswith("| ")][1:]
    assert {row[0].strip() for row in rows} == {"close", "wide", "cubic", "loose", "unkept", "usual", "named (fast)"}
    times = [float(row[1]) for row in rows]
    assert times == sorted(times)
    assert "davis-rs accuracy three_planes" in page
    assert "2 rounds" in page or all(measurement.slow for measurement in measured)
    assert "interrupted" in page
    kept = {row[0].strip(): row[-2].strip() for row in rows}
    assert kept["loose"] == f"0.4 C: {measured[3].kept_percent:.1f} %"
    assert kept["wide"] == "-"
    assert page.count("**") >= 6
    draw(measured, tmp_path / "accuracy.png", "three_planes")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_a_front_holds_the_points_that_nothing_beats() -> None:
    """Neither slower and worse ones, nor ties, nor what has no value."""
    points = [(2.0, 1.0), (1.0, 5.0), (3.0, 0.5), (3.0, 1.0), (2.5, float("nan")), (1.0, 6.0), (4.0, 0.5)]
    assert pareto(points) == [1, 0, 2]


def test_the_settings_have_names_of_their_own() -> None:
    """Rows are told apart by them; presets and the usual way are among them."""
    settings = default_settings()
    assert len({setting.name for setting in settings}) == len(settings)
    assert {"paper", "fast", "balanced", "exact"} <= {setting.preset for setting in settings}
    assert [setting.renderer for setting in settings].count("integrator") == 1


def test_a_part_is_chosen_where_things_move(scene: Scene, tmp_path: Path) -> None:
    """By default half way of the motion, and six pixels long; a camera at rest is refused."""
    chosen = Sweep(scene, camera=CAMERA, folder=tmp_path)
    assert chosen.start_s == pytest.approx(1.0, abs=0.1)
    assert chosen.path_px == pytest.approx(6, rel=0.02)
    assert chosen.timed_s == pytest.approx(min(4 * chosen.duration_s, 2 - chosen.start_s))
    start = start_pose(scene)
    resting = scene.with_trajectory(SegmentTrajectory(start, start, 1.0))
    with pytest.raises(ValueError, match="nothing moves in the"):
        Sweep(resting, camera=CAMERA, folder=tmp_path)


def test_the_command_line_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scene that there is not, a setting that there is not, no round."""
    for arguments, message in [
        (["four_planes"], "is neither one of"),
        (["three_planes", "--only", "nonsense"], "no setting has 'nonsense'"),
        (["three_planes", "--rounds", "0"], "rounds must be at least 1"),
    ]:
        assert main(["accuracy", *arguments, "-o", str(tmp_path / "out")]) == 1
        assert message in capsys.readouterr().err


# ---- the fence ----


def test_the_fence_is_thin_and_before_a_wall() -> None:
    """At 16 rays a pixel some bars are a fraction of a pixel wide, all are below two; everywhere there is a wall."""
    fence = load_scene("fence")
    assert fence.trajectory is not None
    renderer = make_renderer(fence, fence.own_camera, rays_per_pixel=1)
    assert renderer.name == "native renderer"
    depth = renderer.depth(Views.along(fence.trajectory, np.linspace(0, 2, 21)))
    assert np.isfinite(depth).all()
    bars = depth < 1.7
    assert 0.02 < bars.mean() < 0.15
    # Seen at ten times the resolution, a row through the upright bars shows runs of 3 to 15 samples.
    large = Camera(2400, 4, 2000.0, 2000.0, 1199.5, -300.0)
    row = make_renderer(fence, large, rays_per_pixel=1).depth(Views.along(fence.trajectory, [0.0]))[0, 2] < 1.7
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(int)))
    widths = (edges[1::2] - edges[::2]) / 10
    assert len(widths) > 15
    assert widths.min() < 0.5
    assert np.median(widths) < 1.2


def test_no_shadow_can_be_seen_in_the_fence() -> None:
    """Its shadows are left out because all fall below the view: tracing them changes no pixel of the path.

    But for those right at an edge where one bar or stroke of a letter lies 0.1 to 0.3 mm before another, and shades it.
    """
    fence = load_scene("fence")
    assert fence.trajectory is not None
    assert not fence.shadows
    views = Views.along(fence.trajectory, np.linspace(0, 2, 21))
    without = make_renderer(fence, fence.own_camera, rays_per_pixel=1).luma(views)
    traced = make_renderer(replace(fence, shadows=True), fence.own_camera, rays_per_pixel=1).luma(views)
    changed = without != traced
    assert changed.mean() < 2e-5
    assert (traced[changed] == 0).all()
    hit_at = make_renderer(fence, fence.own_camera, rays_per_pixel=1).depth(views)[changed]
    assert (hit_at < 2.7).all(), "the wall is farther"
    assert 0.005 < without.min() < without.max() < 3


def test_the_fences_path_is_smooth_and_its_rates_its_own() -> None:
    """Velocity and body rate agree with central differences of positions and rotations over 2 us."""
    path, step = load_scene("fence").trajectory, 1e-6
    assert path is not None
    assert path.duration_s == 2.0
    t = np.linspace(0.001, 1.999, 101)
    slope = (path.positions(t + step) - path.positions(t - step)) / (2 * step)
    np.testing.assert_allclose(path.velocities(t), slope, atol=1e-6)
    before, after = (Rotation.from_quat(path.quaternions(t + sign * step)) for sign in (-1, 1))
    np.testing.assert_allclose(path.angular_rates(t), (before.inv() * after).as_rotvec() / (2 * step), atol=1e-6)
