"""Effects in whole simulations: over a sensor's, through closed loops, into folders, and out of stored states."""

from __future__ import annotations

import json
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import (
    Camera,
    CrossingEngine,
    Effects,
    SensorParameters,
    Simulator,
    check_dataset,
    load_scene,
    log_intensity,
    plan_effects,
    simulate,
    simulate_to_folder,
)
from davis_rs.cli.main import main
from davis_rs.events.arrays import concatenate_events
from davis_rs.events.packet import Packet
from davis_rs.scene.scene import Scene
from davis_rs.sensor.effects import EFFECTS, Aps, LeakRate, Readout
from davis_rs.sensor.presets import SENSORS
from davis_rs.simulation.settings import SimulationSettings, complete
from davis_rs.simulation.simulate import make_simulator
from effects_reference import scene

pytestmark = pytest.mark.usefixtures("llvm")

PLANES = load_scene("three_planes")
SLOW_BUS = Readout(1e5)
SMALL = Camera(40, 30, 33.0, 33.0, 19.5, 14.5)


def planes(seconds: float) -> Scene:
    return PLANES.crop(0.0, seconds)


def test_what_is_given_stands_over_the_sensor_and_neutral_switches_off() -> None:
    """A number replaces the sensor's, 0 removes it, what is not named stays."""
    given = Effects(leak_rate_hz=0, refractory_period_us=50, aps=Aps(0, 0, None, None))
    effects = Simulator(PLANES, sensor="davis240c", effects=given, frame_rate_hz=400).effects
    assert effects.leak_rate_hz is None
    assert effects.aps is None
    assert effects.refractory_period_us is not None
    assert effects.refractory_period_us.period_us == 50
    assert effects.shot_noise_rms is not None


def test_thresholds_are_given_then_the_sensors_then_the_scenes() -> None:
    """In that order, ON and OFF each by itself; OFF as ON at last."""
    sensor = SensorParameters(contrast_threshold=0.3, contrast_threshold_off=0.2)
    cases: list[tuple[dict[str, Any], tuple[float, float]]] = [
        ({}, (0.15, 0.15)),
        ({"sensor": sensor}, (0.3, 0.2)),
        ({"sensor": sensor, "contrast_threshold": 0.4}, (0.4, 0.2)),
        ({"contrast_threshold": 0.4}, (0.4, 0.4)),
    ]
    for settings, expected in cases:
        simulator = Simulator(PLANES, **settings)
        assert (simulator.contrast_threshold, simulator.contrast_threshold_off) == expected


def test_the_dark_level_is_given_then_the_sensors_dark_current() -> None:
    """In this order, the dark current by the scene's light; a run records what it took."""
    for settings, expected in (
        ({}, 1e-3),
        ({"sensor": "davis240c"}, 0.5 / 1000),
        ({"sensor": "davis240c", "lux_per_luma": 2.0}, 0.25),
        ({"sensor": "davis240c", "log_eps": 0.01}, 0.01),
    ):
        simulator = Simulator(PLANES, **settings)
        assert simulator.describe()["parameters"]["log_eps"] == pytest.approx(expected)
        assert simulator.log_eps == pytest.approx(expected)


def test_the_start_phase_is_given_then_the_sensors() -> None:
    """Ideal pixels begin at their signal, whatever their effects; every sensor's anywhere between their levels."""
    leak, bare = Effects(leak_rate_hz=1.0), SensorParameters(width=240, height=180)
    for settings, expected in (
        ({}, "zero"),
        ({"effects": leak}, "zero"),
        ({"sensor": "ideal"}, "zero"),
        ({"sensor": "davis240c"}, "stationary"),
        ({"sensor": "davis240c", "effects": Effects().without(EFFECTS)}, "stationary"),
        ({"sensor": bare}, "stationary"),
        ({"sensor": "davis240c", "start_phase": "zero"}, "zero"),
        ({"start_phase": "stationary"}, "stationary"),
    ):
        simulator = Simulator(PLANES, **settings)
        assert simulator.describe()["parameters"]["start_phase"] == simulator.start_phase == expected
        [first] = simulator.step(0, PLANES.path.pose(0))
        assert first.luma is not None
        references = simulator._engine.reference - log_intensity(first.luma, simulator.log_eps)
        assert np.abs(references).max() > 0.1 if expected == "stationary" else not references.any()


def test_no_event_of_a_slow_bus_is_lost_in_a_closed_loop() -> None:
    """Steps and a flush bring as many events as pixels without a bus make, less those that they miss.

    run() flushes by itself.
    """
    steps = [(t_us, PLANES.path.pose(t_us * 1e-6)) for t_us in range(0, 20_001, 5_000)]
    ideal, slow = Simulator(PLANES), Simulator(PLANES, effects=Effects(readout=SLOW_BUS))
    made = sum(len(packet.events) for t_us, pose in steps for packet in ideal.step(t_us, pose))
    packets = [packet for t_us, pose in steps for packet in slow.step(t_us, pose)]
    assert made > sum(len(packet.events) for packet in packets)
    late = slow.flush()
    assert made == sum(len(packet.events) for packet in packets + late) + slow.missed_events
    assert [packet.start_us for packet in late] == [20_000]
    assert slow.flush() == []
    ran = list(Simulator(planes(0.02), effects=Effects(readout=SLOW_BUS)).run())
    events = concatenate_events([packet.events for packet in ran])
    assert ran[-1].start_us == 20_000 < ran[-1].end_us == events["t"][-1]
    assert np.all(np.diff(events["t"]) >= 0)


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_folder_holds_what_the_bus_still_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupted: bool
) -> None:
    """Late events are written, also after Ctrl-C; the duration is that of the scene, and drops are counted."""
    effects = Effects(readout=Readout(1e5, drop_after_us=30_000))
    run, simulators = Simulator.run, []

    def watched(simulator: Simulator, after_keyframe: Callable[[int, int], object] | None = None) -> Iterator[Packet]:
        simulators.append(simulator)
        for packet in run(simulator, after_keyframe=after_keyframe):
            yield packet
            if interrupted and packet.end_us:
                os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Simulator, "run", watched)
    recording = simulate_to_folder(planes(0.1), tmp_path / "out", effects=effects, depth_rate_hz=0, quiet=True)
    [simulator] = simulators
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert recording.interrupted == interrupted
    assert recording.duration_s < 0.1 if interrupted else recording.duration_s == pytest.approx(0.1)
    assert meta["duration_us"] > recording.duration_s * 1e6
    assert meta["counts"]["events"] == recording.events > 0
    assert meta["dropped_events"] == recording.dropped_events == simulator.dropped_events > 0
    assert f"{recording.dropped_events:,} dropped by the readout" in str(recording)
    assert meta["missed_events"] == recording.missed_events == simulator.missed_events > 0
    assert f"{recording.missed_events:,} missed by pixels that waited for the bus" in str(recording)
    report = check_dataset(tmp_path / "out")
    assert report.ok, str(report)
    assert report.void == ["readout"]


@pytest.mark.long
def test_frames_of_active_pixels_stand_beside_exact_luma(tmp_path: Path) -> None:
    """Packets and folders hold both: images are exposed, the check compares events with exact luma."""
    blurred = Simulator(planes(0.05), effects=Effects(aps=Aps(20_000, 0)), depth_rate_hz=0)
    exact = Simulator(planes(0.05), depth_rate_hz=0)
    for a, b in zip(blurred.run(), exact.run(), strict=True):
        np.testing.assert_array_equal(a.events, b.events)
        if b.luma is not None:
            assert a.luma is not None
            assert a.frame is not None
            np.testing.assert_array_equal(a.luma, b.luma)
            assert a.frame.shape == a.luma.shape
            assert (np.abs(a.frame - a.luma).max() > 0.01) == (a.end_us > 0)
        assert b.frame is None
    simulate_to_folder(planes(0.05), tmp_path / "out", effects=Effects(aps=Aps(20_000, 0)), quiet=True)
    assert check_dataset(tmp_path / "out").ok
    with pytest.raises(ValueError, match="exposure of 20000 us must not exceed the frames' period of 10000 us"):
        Simulator(PLANES, effects=Effects(aps=Aps(20_000)), frame_rate_hz=100)


@pytest.mark.long
def test_auto_takes_what_the_plan_calls_for(tmp_path: Path) -> None:
    """The plan of the very run is kept and recorded; a closed loop has no trajectory to plan for."""
    not_planned: Any = "auto"
    with pytest.raises(ValueError, match="auto"):
        Simulator(PLANES, effects=not_planned)
    report = simulate_to_folder(planes(0.1), tmp_path / "out", effects="auto", depth_rate_hz=0, quiet=True)
    assert report.plan is not None
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert meta["effects"] == report.plan.effects.describe()
    assert list(meta["effects"]) == [effect.name for effect in report.plan.effects]
    assert meta["effect_plan"] == report.plan.describe()
    assert "photoreceptor_bandwidth_hz" in meta["effects"]


@pytest.mark.few(1)
@pytest.mark.parametrize(("name", "lux"), [("three_planes", 5.0), ("fence", 300.0), ("three_walls", 20_000.0)])
def test_planned_effects_make_as_many_events_as_all_of_them(name: str, lux: float) -> None:
    """Whole runs within 2 %, and as the plan foresaw: what it leaves out has no say over the first references."""
    scene, counts = load_scene(name).crop(0.5, 0.1), []
    settings = {"camera": SMALL, "frame_rate_hz": 0.0, "depth_rate_hz": 0.0, "lux_per_luma": lux}
    for of in ({"sensor": replace(SENSORS["davis240c"], width=None, height=None)}, {"effects": "auto"}):
        made = make_simulator(scene, complete(SimulationSettings, {**settings, **of}, taker="a test"))
        counts.append(sum(len(packet.events) for packet in made.simulator.run()))
    assert made.plan is not None
    assert len(list(made.plan.effects)) <= len(made.plan.items) - 2
    assert counts[0] > 300
    assert counts[1] == pytest.approx(counts[0], rel=0.02)
    assert made.plan.together is not None
    assert abs(made.plan.together.omission.count_percent) < 2


@pytest.mark.long
def test_the_tolerance_of_the_plan_is_a_setting(tmp_path: Path) -> None:
    """It reaches the plan from Python and the command line; without a plan it would be ignored, which is refused."""
    report = simulate_to_folder(planes(0.05), tmp_path / "out", effects="auto", effects_tolerance=1.0, quiet=True)
    assert report.plan is not None
    assert report.plan.effects_tolerance == 1.0
    assert not report.plan.effects
    command = ["simulate", "three_planes", "-o", str(tmp_path / "other"), "--duration", "0.05", "--quiet"]
    small = ["--camera", calibration(tmp_path), "--size", "40x30", "--effects-tolerance", "0.5"]
    assert main([*command, *small, "--effects", "auto"]) == 0
    meta = json.loads((tmp_path / "other" / "meta.json").read_text())
    assert meta["effect_plan"]["effects_tolerance"] == 0.5
    with pytest.raises(ValueError, match=r"effects_tolerance is 0\.5, but no effects are planned"):
        simulate(planes(0.05), effects_tolerance=0.5)


def test_what_is_named_beside_auto_is_kept_and_the_rest_is_planned(tmp_path: Path) -> None:
    """A value that is given stands, a neutral one keeps its effect off; neither is a candidate."""
    called_for = plan_effects(planes(0.1), camera=SMALL).effects
    assert called_for.shot_noise_rms is not None
    assert called_for.threshold_mismatch is not None
    out = str(tmp_path / "out")
    options = ["--effects", "auto", "--effect", "leak_rate_hz=7", "--effect", "shot_noise_rms=0"]
    command = ["simulate", "three_planes", "-o", out, "--duration", "0.1", "--camera", calibration(tmp_path)]
    assert main([*command, "--size", "40x30", "--depth-rate", "0", "--quiet", *options]) == 0
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert meta["effects"]["leak_rate_hz"] == LeakRate(7.0).settings() | {"double_luma": "inf"}
    assert "shot_noise_rms" not in meta["effects"]
    assert "threshold_mismatch" in meta["effects"]
    candidates = {item["effect"] for item in meta["effect_plan"]["effects"]}
    assert candidates == {effect.name for effect in davis240c()} - {"leak_rate_hz", "shot_noise_rms"}


@pytest.mark.long
def test_a_sensor_brings_back_nothing_that_the_plan_left_out() -> None:
    """The plan's effects over that sensor are the plan's, not all of the sensor's."""
    plan = plan_effects(planes(0.1), sensor="davis240c")
    left_out = {item.effect.name for item in plan.items if not item.called_for}
    assert left_out
    effects = Simulator(planes(0.1), sensor="davis240c", effects=plan.effects).effects
    assert effects == plan.effects
    assert not left_out & {effect.name for effect in effects}


@pytest.mark.long
def test_effects_that_are_all_off_are_not_none_given() -> None:
    """Over a sensor they switch its effects off, in a simulator, in a run and in a plan."""
    sensor = SENSORS["davis240c"]
    off = Effects().without(effect.name for effect in sensor.effects(1.0))
    assert not off
    assert not Simulator(planes(0.05), sensor=sensor, effects=off).effects
    assert plan_effects(planes(0.05), sensor=sensor, effects=off).items == ()
    settings: dict[str, Any] = {"frame_rate_hz": 0, "depth_rate_hz": 0}
    runs = [simulate(planes(0.05), sensor=sensor, effects=effects, **settings) for effects in (off, None)]
    counts = [sum(len(packet.events) for packet in run) for run in runs]
    assert counts[0] != counts[1]


def test_auto_is_refused_with_the_name_of_what_resolves_it() -> None:
    """A simulator may step along a path that nobody knows yet: it cannot plan."""
    not_planned: Any = "auto"
    with pytest.raises(ValueError, match=r"effects=plan_effects\(scene, sensor=\.\.\.\)\.effects"):
        Simulator(PLANES, effects=not_planned)


def test_a_simulator_is_whole_before_it_runs() -> None:
    """Whatever can be asked of one can be asked at once, and asking changes nothing."""
    effects = Effects(readout=Readout(1e5, drop_after_us=30_000))
    asked, plain = (Simulator(planes(0.05), effects=effects, camera=SMALL) for _ in range(2))
    assert asked.flush() == []
    assert asked.dropped_events == 0
    described = asked.describe()
    assert list(described["effects"]) == ["readout"]
    streams = [concatenate_events([packet.events for packet in one.run()]) for one in (asked, plain)]
    assert streams[0].tobytes() == streams[1].tobytes()
    assert len(streams[0]) > 0
    assert asked.describe() == described


def davis240c() -> Effects:
    return SENSORS["davis240c"].effects(PLANES.lux_per_luma)


def calibration(folder: Path) -> str:
    """A file of the small camera."""
    path = folder / "small.txt"
    path.write_text(SMALL.to_calib())
    return str(path)


@pytest.mark.parametrize(
    ("effects", "said"), [("all", "there is no effect 'all'"), (["leak_rate_hz"], "leak_rate_hz needs a value")]
)
def test_what_is_no_composition_of_effects_is_refused(effects: Any, said: str) -> None:
    """With what is wrong about it."""
    with pytest.raises(ValueError, match=said):
        Simulator(PLANES, effects=effects)


def test_refining_is_for_ideal_pixels() -> None:
    """Asked for it is refused, by a preset it is left out."""
    with pytest.raises(ValueError, match=r"refine finds the times of ideal pixels.*leak_rate_hz"):
        Simulator(PLANES, effects=Effects(leak_rate_hz=1), refine=True)
    assert not Simulator(PLANES, effects=Effects(leak_rate_hz=1), accuracy="exact", pixel="rays").refine
    assert Simulator(PLANES, effects=Effects(vignetting=4), accuracy="exact", pixel="rays").refine


def test_exact_refines_what_rays_see() -> None:
    """Luma by lines does not jump, so that it is done there only where it is asked for."""
    assert Simulator(PLANES, accuracy="exact").renderer.pixel == "lines"
    assert not Simulator(PLANES, accuracy="exact").refine
    assert Simulator(PLANES, accuracy="exact", refine=True).refine
    assert Simulator(PLANES, accuracy="exact", rays_per_pixel=64).refine
    assert not Simulator(PLANES, pixel="lines").refine


def test_optics_and_frames_are_not_the_engines() -> None:
    """They would be ignored there: refused, by name."""
    for effects in (Effects(vignetting=4), Effects(aps=Aps())):
        with pytest.raises(ValueError, match="does not act in the crossing engine"):
            CrossingEngine(2, 2, effects=effects)


# Stored states.


def test_references_that_have_leaked_far_are_stored_and_restored() -> None:
    """Hours of a leak lead memorised values beyond all log intensities: that is no reason to refuse them."""
    effects = Effects(leak_rate_hz=1000, refractory_period_us=1)
    engine = CrossingEngine(3, 2, contrast_threshold=0.3, effects=effects)
    engine.push_log(0, scene(0.0, 2, 3))
    engine.push_log(10_000_000, scene(0.1, 2, 3))
    assert max(engine.state()["base"]) > 746
    again = pickle.loads(pickle.dumps(engine))
    frame = scene(-0.4, 2, 3)
    np.testing.assert_array_equal(again.push_log(10_100_000, frame), engine.push_log(10_100_000, frame))


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"filtered": np.full(6, np.nan)}, "filtered of a state must be within"),
        ({"filtered": np.full(6, 1e9)}, "filtered of a state must be within"),
        ({"held_us": np.full(6, np.nan)}, "held_us of a state must be > 0"),
        ({"held_us": np.zeros(6)}, "held_us of a state must be > 0"),
        ({"noise_cell": np.full(6, -1)}, "noise_cell of a state must be that of the last frame"),
        ({"noise_cell": np.full(6, 2**40)}, "noise_cell of a state must be that of the last frame"),
        ({"noise_log_light": np.full(6, np.nan)}, "noise_log_light of a state must be within"),
        ({"noise_photoreceptor": np.full(6, 1e9)}, "noise_photoreceptor of a state must be within 500"),
        ({"noise_filtered": np.full(6, np.inf)}, "noise_filtered of a state must be within 50"),
        ({"hot_wait_us": np.full(6, np.nan)}, "hot_wait_us of a state must be finite and > 0"),
        ({"started_us": -(2**63)}, "started_us of a state must lie in 0..2000"),
        ({"started_us": 2001}, "started_us of a state must lie in 0..2000"),
    ],
)
def test_states_of_effects_that_no_engine_can_be_in_are_refused(change: dict[str, Any], rule: str) -> None:
    """Each with its name and rule, before anything is run on it."""
    state = everything().state()
    state["effect_state"] |= change
    with pytest.raises(ValueError, match=rule):
        CrossingEngine.from_state(state)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"free_us": 2**63 - 1}, "times of the bus"),
        ({"free_share": float("nan")}, "times of the bus"),
        ({"free_share": 1.0}, "times of the bus"),
        ({"last_stamp_us": -1}, "times of the bus"),
        ({"waiting": ("y", 9)}, "events of the sensor"),
        ({"waiting": ("x", 3)}, "events of the sensor"),
        ({"waiting": ("t", 2001)}, "waiting events until then"),
        ({"stamped": ("t", 2000)}, "stamps after that"),
        ({"ready_us": np.zeros(5, np.int64)}, "a time near then for each pixel"),
        ({"ready_us": np.full(6, -1)}, "a time near then for each pixel"),
        ({"ready_us": np.full(6, 2**62)}, "a time near then for each pixel"),
        ({"ready_us": np.zeros(6, np.int64)}, "one waiting event of each pixel that waits"),
        ({"ready_us": np.full(6, 2**63 - 1)}, "one waiting event of each pixel that waits"),
        ({"waiting": ("p", 2)}, "events of the sensor"),
        ({"started_us": 2_001}, "have begun by then"),
        ({"started_us": -1}, "have begun by then"),
        (None, "a readout if its effects have one, and only then"),
    ],
)
def test_states_of_a_readout_that_no_engine_can_be_in_are_refused(change: dict[str, Any] | None, rule: str) -> None:
    """Each with its rule, before anything is run on it."""
    state = everything().state()
    assert len(state["readout"]["waiting"]) > 0
    assert len(state["readout"]["stamped"]) > 0
    if change is None:
        state["readout"] = None
    else:
        for name, value in change.items():
            if isinstance(value, tuple):
                events = state["readout"][name].copy()
                events[value[0]][-1 if value[0] == "t" and name == "waiting" else 0] = value[1]
                value = events
            state["readout"][name] = value
    with pytest.raises(ValueError, match=rule):
        CrossingEngine.from_state(state)


def everything() -> CrossingEngine:
    """An engine at 2,000 us under all effects, whose bus holds both waiting and stamped events."""
    effects = Effects(
        photoreceptor_bandwidth_hz=1e4,
        refractory_period_us=20,
        leak_rate_hz=1,
        shot_noise_rms=0.1,
        hot_pixels=1.0,
        readout=Readout(1e3, latency_us=5_000),
    )
    engine = CrossingEngine(3, 2, effects=effects)
    engine.push_log(0, scene(0.0, 2, 3))
    engine.push_log(2_000, scene(2.0, 2, 3))
    return engine
