"""The hard cases as a command, and what brute force makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from davis_rs import FixedRate, Simulator
from davis_rs.accuracy.brute_force import dense_probe, early
from davis_rs.accuracy.hard_case_scenes import START_S, hard_cases, room, starting
from davis_rs.cli.main import main
from davis_rs.events.arrays import concatenate_events
from davis_rs.sampling.presets import ACCURACY


def test_names_are_unique_and_parts_begin_where_they_say() -> None:
    """Each case has a path and a camera; the late one starts a day after its path does."""
    cases = {case.name: case for case in hard_cases()}
    assert len(cases) == len(hard_cases()) == 13
    for case in cases.values():
        assert 0.004 <= case.part.path.duration_s <= 0.03
        assert case.scene.camera is not None
    scaled = cases["scaled"]
    np.testing.assert_allclose(scaled.true_part.path.positions([0.01]), 1e4 * scaled.part.path.positions([0.01]))
    late = cases["late start"]
    assert late.start_s == 86_400.0
    np.testing.assert_allclose(late.part.path.positions([0.01]), late.scene.path.positions([late.start_s + 0.01]))


@pytest.mark.usefixtures("llvm")
def test_brute_force_knows_when_a_pixel_first_changes() -> None:
    """Until the start from rest nothing does; an event before that is early, one after it is not."""
    scene = room(starting())
    made = Simulator(scene, rays_per_pixel=1, sampling=FixedRate(100.0))
    probe = dense_probe(made.renderer, scene.path, step_us=500, contrast_threshold=0.15)
    assert probe.unchanged_until_us.min() == pytest.approx(START_S * 1e6, abs=501)
    assert len(probe.events) > 500
    assert probe.events["t"].min() > START_S * 1e6
    assert early(probe.events, probe, by_us=0) == 0
    moved = probe.events.copy()
    moved["t"] -= 5_000
    assert early(moved, probe, by_us=100) > 100


@pytest.mark.usefixtures("llvm")
def test_the_command_writes_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row for each preset, none of which has an event before the light goes on."""
    assert main(["hard-cases", "-o", str(tmp_path), "--only", "black", "--quiet"]) == 0
    page = tmp_path / "hard_cases.md"
    assert capsys.readouterr().out.strip() == str(page)
    rows = [line for line in page.read_text("utf-8").splitlines() if line.startswith("| black to light")]
    assert [row.split(" | ")[1] for row in rows] == list(ACCURACY)
    for row in rows:
        *_, differences, _, before = row.strip("| ").split(" | ")
        assert (differences, before) == ("0.00 + 0.00", "0")


def test_an_unknown_case_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The message names those that there are."""
    assert main(["hard-cases", "-o", str(tmp_path), "--only", "moon"]) == 1
    assert "no hard case has 'moon' in its name; there are still start, light jump" in capsys.readouterr().err


@pytest.mark.parametrize("preset", ["paper", "balanced"])
@pytest.mark.usefixtures("llvm")
def test_a_controllers_steps_are_nearer_brute_force_than_a_run(preset: str) -> None:
    """Each step ends with a keyframe, so steps sample more finely: where they differ from a run, the run is wrong.

    Brute force on the same rays judges both: a run of these presets misses and adds about 2 %, steps of 1 ms 0.3 %.
    """
    from davis_rs import Camera, compare_events, load_scene

    camera = Camera(40, 30, 120.0, 120.0, 19.5, 14.5)
    scene = load_scene("three_planes").crop(0.5, 0.03)

    def made() -> Simulator:
        return Simulator(scene, camera=camera, accuracy=preset, frame_rate_hz=0, depth_rate_hz=0)

    running, stepping = made(), made()
    run = concatenate_events([packet.events for packet in running.run()])
    times = range(0, 30_001, 1000)
    steps = concatenate_events([p.events for t in times for p in stepping.step(t, scene.path.pose(t * 1e-6))])
    probe = dense_probe(running.renderer, scene.path, step_us=50, contrast_threshold=running.contrast_threshold)

    def wrong(events: np.ndarray, reference: np.ndarray) -> float:
        found = compare_events(events, reference, size=(40, 30), window_us=5_000)
        return found.missing_percent + found.spurious_percent

    assert wrong(steps, probe.events) < 0.6
    assert wrong(steps, probe.events) <= wrong(run, probe.events)
    assert wrong(steps, run) < wrong(run, probe.events) + wrong(steps, probe.events) + 0.1
