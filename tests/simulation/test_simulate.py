"""The simulator end to end: packets, determinism, closed loop."""

from __future__ import annotations

import hashlib
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import (
    Camera,
    FixedRate,
    MaxDisplacement,
    Packet,
    Pose,
    Scene,
    Simulator,
    Tolerance,
    simulate,
)
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sampling.rules import TimeSampling

pytestmark = pytest.mark.without_llvm

SMALL = Camera(40, 30, 33.0, 33.0, 19.5, 14.5)
PARAMETERS: dict[str, Any] = {"camera": SMALL, "rays_per_pixel": 2}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return davis_rs.load_scene("three_planes")


def events_of(packets: list[Packet]) -> EventArray:
    return concatenate_events([packet.events for packet in packets])


def test_packets_tile_the_time_and_bring_what_falls_due(scene: Scene) -> None:
    """A gap or an overlap between packets would lose or double events."""
    packets = list(simulate(scene, duration_s=0.06, frame_rate_hz=40, depth_rate_hz=100, **PARAMETERS))
    assert (packets[0].start_us, packets[0].end_us, len(packets[0].events)) == (0, 0, 0)
    assert packets[-1].end_us == 60_000
    for before, after in itertools.pairwise(packets):
        assert before.end_us == after.start_us < after.end_us
    for packet in packets:
        t = packet.events["t"]
        assert np.all((t > packet.start_us) & (t <= packet.end_us))
    assert [p.end_us for p in packets if p.luma is not None] == [0, 25_000, 50_000]
    assert [p.end_us for p in packets if p.depth is not None] == list(range(0, 60_001, 10_000))
    events = events_of(packets)
    assert len(events) > 1000
    order = np.lexsort((events["x"], events["y"], events["t"]))
    assert np.all(np.diff(events["t"]) >= 0)
    assert np.array_equal(events[["t", "y", "x"]][order], events[["t", "y", "x"]])


def test_frames_and_events_agree_exactly(scene: Scene) -> None:
    """A frame is one of the rendered instants: the events up to it leave log intensity within one threshold."""
    packets = list(simulate(scene, duration_s=0.06, **PARAMETERS, contrast_threshold=0.1, contrast_threshold_off=0.2))
    first = packets[0].luma
    assert first is not None
    start = davis_rs.log_intensity(first, 1e-3)
    for packet in packets[1:]:
        if packet.luma is None:
            continue
        error = davis_rs.log_intensity(packet.luma, 1e-3) - davis_rs.reconstruct(
            events_of(packets), start, packet.end_us, 0.1, 0.2
        )
        assert -0.2 < error.min() < -0.05
        assert 0.05 < error.max() < 0.1


def test_threads_and_batches_do_not_change_a_byte(scene: Scene) -> None:
    """The stream is a function of its parameters alone."""
    streams = [
        events_of(list(simulate(scene, duration_s=0.05, **PARAMETERS, threads=threads, poses_per_launch=batch)))
        for threads, batch in [(1, None), (2, None), (1, 1), (2, 7)]
    ]
    assert len(streams[0]) > 500
    assert {stream.tobytes() for stream in streams} == {streams[0].tobytes()}


def test_more_renders_than_frames_change_only_the_sampling(scene: Scene) -> None:
    """Frames are extra samples on a path that is sampled densely: few events may differ."""
    with_frames = events_of(list(simulate(scene, duration_s=0.05, frame_rate_hz=40, **PARAMETERS)))
    without = events_of(list(simulate(scene, duration_s=0.05, frame_rate_hz=0, depth_rate_hz=0, **PARAMETERS)))
    assert abs(len(with_frames) - len(without)) < 0.01 * len(without)


def test_start_and_duration_choose_a_part(scene: Scene) -> None:
    """t = 0 of the sequence lies at the start; poses are the trajectory's from there."""
    packets = list(simulate(scene, start_s=0.5, duration_s=0.05, **PARAMETERS))
    assert scene.trajectory is not None
    assert packets[-1].end_us == 50_000
    assert packets[-1].pose is not None
    np.testing.assert_allclose(packets[-1].pose.position, scene.trajectory.pose(0.55).position, atol=1e-12)
    with pytest.raises(ValueError, match=r"to 2 s"):
        list(simulate(scene, start_s=1.9, duration_s=0.2, **PARAMETERS))


def test_a_fixed_rate_renders_as_often_as_it_says(scene: Scene) -> None:
    """Two dense samplings agree on how many events there are; one at 25 ms misses many."""
    coarse = events_of(list(simulate(scene, duration_s=0.05, sampling=FixedRate(40.0), **PARAMETERS)))
    fine = events_of(list(simulate(scene, duration_s=0.05, sampling=FixedRate(2000.0), **PARAMETERS)))
    finer = events_of(list(simulate(scene, duration_s=0.05, sampling=MaxDisplacement(0.05), **PARAMETERS)))
    assert abs(len(fine) - len(finer)) < 0.1 * len(finer)
    assert len(coarse) < 0.7 * len(finer)


def test_steps_of_a_controller_give_what_a_run_gives(scene: Scene) -> None:
    """Poses on a straight path, handed over one by one in whatever form, are the path."""
    start = davis_rs.start_pose(scene)
    target = Pose(start.position + np.array([0.03, -0.01, 0.02]), start.quaternion)
    path = davis_rs.SegmentTrajectory(start, target, 0.05)
    settings = {**PARAMETERS, "sampling": FixedRate(1000.0)}
    run = events_of(list(Simulator(scene.with_trajectory(path), **settings).run()))
    stepper = Simulator(scene, **settings)
    packets = stepper.step(0, path.pose(0.0))
    for t_us in (7_000, 20_000, 26_000, 50_000):
        pose = path.pose(t_us * 1e-6)
        forms: dict[int, Any] = {7_000: pose.matrix, 20_000: (pose.position, pose.quaternion)}
        packets += stepper.step(t_us, forms.get(t_us, pose))
    assert packets[-1].end_us == 50_000
    assert [p.end_us for p in packets if p.luma is not None] == [0, 25_000, 50_000]
    stepped = events_of(packets)
    assert len(run) > 300
    # The same instants; poses agree to rounding, so events agree but for a few that lie on a tick's edge.
    assert abs(len(stepped) - len(run)) <= 0.01 * len(run)
    with pytest.raises(ValueError, match=r"after the last one \(50000 us\)"):
        stepper.step(50_000, target)
    with pytest.raises(ValueError, match="first step must be at t = 0"):
        Simulator(scene, **settings).step(5, target)


def step_to(scene: Scene, pose: Pose, duration_us: int) -> None:
    """Step from the start of the scene's path, 1.2 to 1.9 m before three planes, to a pose relative to it."""
    stepper = Simulator(scene, **PARAMETERS)
    stepper.step(0, scene.path.pose(0.0))
    stepper.step(duration_us, scene.path.pose(0.0) @ pose)


@pytest.mark.parametrize(
    ("pose", "duration_us"),
    [(Pose((5.0, 0, 0), (0, 0, 0, 1)), 1000), (Pose((0, 0, 0), (0, 1, 0, 0)), 10_000)],
    ids=["5 m in a millisecond", "a half turn in 10 ms"],
)
def test_a_jump_of_the_camera_is_told(scene: Scene, pose: Pose, duration_us: int) -> None:
    """In one line, with how far it is, what is plausible, and what to do."""
    with pytest.warns(
        davis_rs.JumpWarning, match=r"moves the image as a turn by 1\d\d degrees does\. More than 120 is a jump"
    ) as caught:
        step_to(scene, pose, duration_us)
    (warning,) = caught
    assert warning.filename == __file__
    text = str(warning.message)
    assert "\n" not in text
    assert f"the step to {duration_us} us moves the camera by" in text
    assert "restart() begins elsewhere" in text


@pytest.mark.parametrize(
    ("pose", "duration_us"),
    [
        (Pose((0.3, 0, 0), (0, 0, 0, 1)), 10_000),
        (Pose((0, 0, 0), (0, np.sin(0.25), 0, np.cos(0.25))), 10_000),
        (Pose((5.0, 0, 0), (0, 0, 0, 1)), 1_000_000),
    ],
    ids=["30 m/s", "half a radian in 10 ms", "a step of a second"],
)
def test_fast_motion_is_no_jump(scene: Scene, pose: Pose, duration_us: int) -> None:
    step_to(scene, pose, duration_us)  # warnings are errors


@pytest.mark.parametrize(
    ("sampling", "same"),
    [(FixedRate(1000.0, hermite=True), 0.99), (Tolerance(0.05), 0.95)],
    ids=["hermite", "tolerance"],
)
def test_steps_agree_with_a_run_where_slopes_and_samples_look_around(
    scene: Scene, sampling: TimeSampling, same: float
) -> None:
    """Steps cut the path into stretches that do not know what comes after: other keyframes, nearly the same events.

    With a fixed rate the instants are the same, and the rates, as the velocity is; a tolerance places its keyframes
    anew from each step, and its slopes at a step are those of one side.
    """
    start = davis_rs.start_pose(scene)
    target = Pose(start.position + np.array([0.03, -0.01, 0.02]), start.quaternion)
    path = davis_rs.SegmentTrajectory(start, target, 0.05)
    settings = {**PARAMETERS, "sampling": sampling, "rays_per_pixel": 8}
    run = events_of(list(Simulator(scene.with_trajectory(path), **settings).run()))
    stepper = Simulator(scene, **settings)
    packets = stepper.step(0, path.pose(0.0))
    for t_us in (1, 7_000, 7_001, 20_000, 26_000, 50_000):
        packets += stepper.step(t_us, path.pose(t_us * 1e-6))
        assert packets[-1].end_us == t_us
    stepped = events_of(packets)
    assert len(run) > 300
    found = davis_rs.compare_events(stepped, run, size=(SMALL.width, SMALL.height), window_us=3000)
    assert found.matched >= same * len(run)
    assert found.spurious <= (1 - same) * len(run)
    assert found.median_us <= 50


def test_steps_are_refined_to_where_the_renderer_has_their_levels(scene: Scene) -> None:
    """Refined times do not depend on the keyframes, so neither on the steps: nearly all agree to the microsecond."""
    start = davis_rs.start_pose(scene)
    target = Pose(start.position + np.array([0.02, -0.01, 0.02]), start.quaternion)
    path = davis_rs.SegmentTrajectory(start, target, 0.03)
    settings = {**PARAMETERS, "rays_per_pixel": 8, "sampling": Tolerance(0.05), "refine": True}
    run = events_of(list(Simulator(scene.with_trajectory(path), **settings).run()))
    stepper = Simulator(scene, **settings)
    packets = stepper.step(0, path.pose(0.0))
    for t_us in (8_000, 20_000, 30_000):
        packets += stepper.step(t_us, path.pose(t_us * 1e-6))
    found = davis_rs.compare_events(events_of(packets), run, size=(SMALL.width, SMALL.height), window_us=3000)
    assert found.matched > max(0.95 * len(run), 200)
    assert (np.abs(found.time_error_us) <= 1).mean() > 0.95


def test_the_record_of_a_run_names_its_sampling(scene: Scene) -> None:
    """What decides the events is in meta.json: the rule with its settings, and whether times were refined."""
    for sampling in (Tolerance(0.07, halvings=2), FixedRate(250.0, hermite=True)):
        parameters = Simulator(scene, **PARAMETERS, sampling=sampling, refine=True).describe()["parameters"]
        assert parameters["sampling"] == repr(sampling)
        assert parameters["refine"] is True
    assert "contrast=0.07" in repr(Tolerance(0.07))
    assert Simulator(scene, **PARAMETERS).describe()["parameters"]["refine"] is False


@pytest.mark.parametrize("t_us", [2**53, 2**63])
def test_steps_beyond_all_times_are_refused(scene: Scene, monkeypatch: pytest.MonkeyPatch, t_us: int) -> None:
    """Before anything is rendered for them."""
    stepper, pose = Simulator(scene, **PARAMETERS), davis_rs.start_pose(scene)
    stepper.step(0, pose)
    monkeypatch.setattr(stepper, "_packets", lambda *_: [])
    with pytest.raises(ValueError, match=rf"t_us must be below 2\^53 us, .* got {t_us}"):
        stepper.step(t_us, pose)


def test_a_camera_at_rest_makes_no_events(scene: Scene) -> None:
    """Any noise of the renderer would show here as events."""
    start = davis_rs.start_pose(scene)
    still = davis_rs.SegmentTrajectory(start, start, 0.2)
    with pytest.warns(davis_rs.NoEventsWarning, match=r"0 events in 0\.2 s: .* and every pixel changed by less"):
        packets = list(simulate(scene.with_trajectory(still), **PARAMETERS))
    assert len(packets) == 9
    assert sum(len(packet.events) for packet in packets) == 0


def test_looking_away_is_an_error_that_says_where(scene: Scene) -> None:
    """An empty dataset would be found out much later."""
    away = Pose([0, 0, 100], [0, 0, 0, 1])
    resting = scene.with_trajectory(davis_rs.SegmentTrajectory(away, away, 1.0))
    with pytest.raises(ValueError, match=r"no ray hits anything.*three_planes.*--align"):
        next(iter(simulate(resting, **PARAMETERS)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"contrast_threshold": 0.0}, "contrast_threshold"),
        ({"contrast_threshold_off": float("nan")}, "contrast_threshold_off"),
        ({"log_eps": 0.0}, "log_eps"),
        ({"frame_rate_hz": -1.0}, "rate"),
        ({"depth_rate_hz": 2e6}, "rate"),
        ({"rays_per_pixel": 0}, "rays_per_pixel"),
        ({"threads": 0}, "threads"),
        ({"poses_per_launch": 0}, "poses_per_launch"),
        ({"renderer": "magic"}, "renderer"),
    ],
)
def test_bad_settings_are_refused(scene: Scene, settings: dict[str, Any], message: str) -> None:
    """Each names its rule and value, before anything is rendered."""
    with pytest.raises(ValueError, match=message):
        Simulator(scene, **{**PARAMETERS, **settings})


def test_a_simulator_runs_once(scene: Scene) -> None:
    """A second run would begin with the first one's references."""
    simulator = Simulator(scene.crop(0, 0.01), **PARAMETERS)
    list(simulator.run())
    with pytest.raises(ValueError, match="has run already"):
        next(simulator.run())


def test_a_scene_without_a_path_asks_for_one(scene: Scene) -> None:
    with pytest.raises(ValueError, match="has no trajectory"):
        simulate(Scene(name="mine", source=scene.source), **PARAMETERS)


def test_the_record_of_a_run_names_the_scene_file(tmp_path: Path, scene: Scene) -> None:
    """A file can change after the run: its checksum tells."""
    path = tmp_path / "wall.xml"
    path.write_text('<scene version="3.0.0"><shape type="rectangle"/><emitter type="constant"/></scene>')
    described = Simulator(davis_rs.load_scene(path), **PARAMETERS).describe()
    assert described["scene"]["file"] == str(path)
    assert described["scene"]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert described["camera"]["fx"] == 33.0
    assert "file" not in Simulator(scene, **PARAMETERS).describe()["scene"]
