"""Plans: what is read, what is drawn, and what is refused with which words."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import davis_rs
from davis_rs.cli.main import main
from davis_rs.generate import SequencePlan, load_sequence_plan
from davis_rs.generate.generate import check_sequences, draw_sequences
from davis_rs.generate.motion import MOTIONS, make_motion
from davis_rs.generate.sequence_plan import sequence_name
from davis_rs.scene.lost_looks import UNKNOWN
from davis_rs.sensor.effects import parse_effect
from davis_rs.sensor.effects.effects import named_effects
from davis_rs.simulation.settings import FolderSettings, complete, view_scene
from generated import PLAN, write_plan


def read(folder: Path, text: str) -> SequencePlan:
    path = folder / "plan.yaml"
    path.write_text(text)
    return load_sequence_plan(path)


def test_every_sequence_draws_its_own(tmp_path: Path) -> None:
    """All keys are drawn, the seeds among them, and the same plan draws the same again."""
    plan = load_sequence_plan(write_plan(tmp_path))
    drawn = [plan.parameters(index) for index in range(plan.sequences)]
    assert drawn == [plan.parameters(index) for index in range(plan.sequences)]
    assert len({one["duration"] for one in drawn}) == len({one["seed"] for one in drawn}) == 20
    assert all(0.02 <= one["duration"] <= 0.03 for one in drawn)
    assert {one["motion"]["kind"] for one in drawn} == {"slider", "walking"}
    assert all(("seed" in one["motion"]) == (one["motion"]["kind"] == "walking") for one in drawn)
    assert {one["imu"] for one in drawn} == {None, "mpu6150"}
    assert plan.digests.keys() == {"scenes/board.xml"}
    assert sequence_name(123) == "sequence_00123"


def test_order_of_keys_and_number_of_sequences_change_no_draw(tmp_path: Path) -> None:
    """So a plan can be written anew, or grow, and goes on with what is there: it is the same plan."""
    plan = load_sequence_plan(write_plan(tmp_path / "a"))
    path = write_plan(tmp_path / "b")
    path.write_text(yaml.safe_dump(dict(reversed({**PLAN, "sequences": 500}.items())), sort_keys=False))
    other = load_sequence_plan(path)
    assert other.sha256 == plan.sha256
    assert all(list(plan.parameters(k).items()) == list(other.parameters(k).items()) for k in range(20))


def test_a_plan_is_another_one_where_a_file_of_it_is(tmp_path: Path) -> None:
    """The same name may stand for another scene tomorrow."""
    path = write_plan(tmp_path)
    before = load_sequence_plan(path)
    (tmp_path / "scenes" / "board.xml").write_text("<scene/>")
    assert load_sequence_plan(path).sha256 != before.sha256


def test_a_mesh_has_its_axis_its_unit_and_its_files(tmp_path: Path) -> None:
    """``up`` and ``scale`` as on the command line; the plan is another one where a mesh's material is."""
    (tmp_path / "flag.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "flag.obj").write_text("mtllib flag.mtl\nusemtl red\nv 0 0 0\nv 2 0 0\nv 0 0 4\nf 1 2 3\n")
    text = "scene: flag.obj\nduration: 0.1\nup: {choice: [z]}\nscale: {uniform: [0.1, 0.2]}\nsequences: 2\n"
    plan = read(tmp_path, text)
    assert set(plan.digests) == {"flag.obj", "flag.mtl"}
    sequences = draw_sequences(plan)
    check_sequences(plan, sequences)
    for sequence in sequences:
        scale = sequence.parameters["scale"]
        assert 0.1 <= scale <= 0.2
        assert f"is {2 * scale:.3g} m x 0 m wide and {4 * scale:.3g} m high" in sequence.scene().note
    (tmp_path / "flag.mtl").write_text("newmtl red\nKd 0 1 0\n")
    assert load_sequence_plan(plan.file).sha256 != plan.sha256


def test_what_is_missing_is_grey_where_the_plan_says_so(tmp_path: Path) -> None:
    """As with ``--grey-unknown``; without it the plan is refused, with that remedy."""
    (tmp_path / "flag.obj").write_text("mtllib none.mtl\nusemtl red\nv 0 0 0\nv 2 0 0\nv 0 0 4\nf 1 2 3\n")
    text = "scene: flag.obj\nduration: 0.1\nup: z\n"
    plan = read(tmp_path, text)
    with pytest.raises(ValueError, match=r"none\.mtl.*--grey-unknown"):
        check_sequences(plan, draw_sequences(plan))
    plan = read(tmp_path, text + "grey_unknown: true\n")
    [sequence] = draw_sequences(plan)
    check_sequences(plan, [sequence])
    assert [look.what for look in sequence.scene().lost_looks] == [UNKNOWN]
    assert set(plan.digests) == {"flag.obj"}


def test_a_known_name_is_no_file(tmp_path: Path) -> None:
    """As in davis-rs simulate, a file next to the plan that has a scene's or a camera's name is not taken for it."""
    path = write_plan(tmp_path, scene={"choice": ["fence", "slider_far"]}, camera="ideal", sequences=1)
    before = load_sequence_plan(path).sha256
    for name in ("fence", "slider_far", "ideal"):
        (tmp_path / name).write_text("notes")
    plan = load_sequence_plan(path)
    assert (plan.digests, plan.sha256) == ({}, before)
    [sequence] = draw_sequences(plan)
    assert sequence.scene().name == sequence.parameters["scene"]
    viewed = view_scene(sequence.scene(), complete(FolderSettings, sequence.settings, taker="a plan"))
    assert viewed.camera == davis_rs.load_camera("ideal")


def test_files_lie_beside_the_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One in the working directory alone, which the plan's digest does not know, is not taken."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "calib.txt").write_text("200 200 119.5 89.5 0 0 0 0 0")
    monkeypatch.chdir(tmp_path / "elsewhere")
    [sequence] = draw_sequences(load_sequence_plan(write_plan(tmp_path, camera="calib.txt", sequences=1)))
    settings = complete(FolderSettings, sequence.settings, taker="a plan")
    with pytest.raises(ValueError, match=re.escape(f"{tmp_path / 'calib.txt'}")):
        view_scene(sequence.scene(), settings)


def test_numbers_are_read_as_in_json(tmp_path: Path) -> None:
    """YAML 1.1 takes 1e-3 for a text."""
    assert read(tmp_path, "scene: fence\nlog_eps: 1e-3\n").parameters(0)["log_eps"] == 1e-3
    assert read(tmp_path, "scene: fence\nlog_eps: {uniform: [1e-4, 2E-4]}\n").parameters(0)["log_eps"] < 2e-4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the plan: must be a mapping of keys to values, got None"),
        ("- 1", "the plan: must be a mapping of keys to values, got [1]"),
        ("scene: [", "plan.yaml, line 1, column 9: expected the node content"),
        ("seed: 1\nscene: fence\nseed: 2", "plan.yaml, line 3, column 1: the key 'seed' stands here a second time"),
        ("seed: 1", "a plan needs a scene"),
        ("scene: fence\nspeed: 3", "speed: there is no such key; did you mean seed?"),
        ("scene: fence\nzzz: 3", "zzz: there is no such key; there are seed, sequences, shards, accept_noise, scene,"),
        ("scene: fence\nlog_epps: 1", "log_epps: there is no such key; did you mean log_eps?"),
        ("scene: fence\n3: 4", "must be a mapping whose keys are texts, got 3"),
        ("scene: 4", "scene: must be a text or a distribution"),
        ("scene: null", "scene: must be a text or a distribution"),
        ("scene: fence\nseed: -1", "seed: must be an integer >= 0, got -1"),
        ("scene: fence\nsequences: 0", "sequences: must be an integer >= 1, got 0"),
        ("scene: fence\nsequences: {integers: [1, 2]}", "sequences: must be an integer >= 1"),
        ("scene: fence\nlog_eps: text", "log_eps: must be a number or a distribution"),
        ("scene: fence\nlog_eps: true", "log_eps: must be a number or a distribution"),
        ("scene: fence\nlog_eps: .nan", "log_eps: must be a number or a distribution"),
        ("scene: fence\nframe_rate: null", "frame_rate: must be a number or a distribution"),
        ("scene: fence\nrays_per_pixel: 1.5", "rays_per_pixel: must be an integer or a distribution"),
        (
            "scene: fence\nrays_per_pixel: {uniform: [1, 4]}",
            "rays_per_pixel: must be an integer, or a distribution of such",
        ),
        ("scene: fence\nrefine: 1", "refine: must be true or false or a distribution"),
        ("scene: {uniform: [1, 2]}", "scene: must be a text, or a distribution of such"),
        ("scene: {choice: [fence, 4]}", "scene.choice[1]: must be a text or a distribution"),
        ("scene: {choice: fence}", "scene.choice: must be a list, got 'fence'"),
        ("scene: {choice: [fence], weights: [a]}", "scene.weights: must be a list of values that are each a number"),
        (
            "scene: {choice: [fence], weights: [1, 2]}",
            "scene: choice: there must be a weight for each of the 1 options",
        ),
        ("scene: fence\nduration: {uniform: [1]}", "duration.uniform: must be a list of 2, got [1]"),
        ("scene: fence\nduration: {uniform: [2, 1]}", "duration: uniform: the first bound must lie below"),
        ("scene: fence\nduration: {uniform: [1, 2], min: 1}", "duration.min: there is no such key"),
        ("scene: fence\nduration: {uniform: [1, 2], normal: [1, 2]}", "duration: must be a number or one distribution"),
        ("scene: fence\nduration: {uniform: [1, a]}", "duration.uniform: must be a list of values that are each"),
        ("scene: fence\nduration: {normal: [1, 2], max: a}", "duration.max: must be a list of values that are each"),
        ("scene: fence\nmotion: walking", "motion: must be a mapping with the motion's kind, got 'walking'"),
        ("scene: fence\nmotion: {kind: flying}", "motion.kind: must be one of slider, hand_held, zigzag"),
        ("scene: fence\nmotion: {kind: slider, distance_m: 1}", "motion: a motion of kind slider needs speed_m_s"),
        (
            "scene: fence\nmotion: {kind: walking, bob: 1}",
            "motion.bob: there is no such key; did you mean bob_m?",
        ),
        ("scene: fence\nmotion: {kind: walking, nod_rad: 1, nod_deg: 1}", "motion.nod_deg: must be the only one"),
        ("scene: fence\nmotion: {choice: [{kind: walking, bob_m: x}]}", "motion.choice[0].bob_m: must be a number"),
        ("scene: fence\nmotion: {kind: slider, direction: 3}", "motion.direction: must be a list of numbers, got 3"),
        (
            "scene: fence\neffects: all",
            "effects: must be a mapping from effects to their values, or texts NAME=VALUE, or auto, got 'all'",
        ),
        ("scene: fence\neffects: {leak_rate_hz: x}", "effects.leak_rate_hz: must be a number or a distribution"),
        ("scene: fence\neffects: {aps: {3: 4}}", "effects.aps: must be a mapping whose keys are texts, got 3"),
        ("scene: fence\nimu_effects: {noise: {x: 1, null: 4}}", "imu_effects.noise: must be a mapping whose keys"),
        ("scene: fence\nlog_eps: 1" + 400 * "0", "log_eps: must be a number or a distribution"),
        ("scene: fence\nrays_per_pixel: 1" + 400 * "0", "rays_per_pixel: must be an integer or a distribution"),
        ("scene: fence\nduration: {uniform: [0, 1" + 400 * "0" + "]}", "duration.uniform: must be a list of values"),
        ("scene: fence\nduration: {normal: [0, 1], max: 1" + 400 * "0" + "}", "duration.max: must be a list of values"),
        ("scene: fence\nduration: {integers: [0, 1" + 400 * "0" + "]}", "duration.integers: must be a list of values"),
        ("scene: fence\nduration: 1" + 5000 * "0", "not a YAML file: Exceeds the limit"),
        ("scene: fence\nduration: 2026-13-01", "not a YAML file: month must be in 1..12"),
        (
            "scene: fence\nimu_effects: auto",
            "imu_effects: must be a mapping from effects to their values, or texts NAME=VALUE, got 'auto'",
        ),
    ],
)
def test_a_fault_is_named_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    """File, key path, rule and value."""
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        read(tmp_path, text)
    assert str(refused.value).startswith(str(tmp_path / "plan.yaml"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": "nowhere"}, "nowhere' is neither one of"),
        ({"camera": "nowhere"}, "nowhere' is neither a preset"),
        ({"up": "z"}, "up = 'z': up and scale are for a mesh that is there (OBJ, PLY or glTF)"),
        ({"scale": 0.1}, "scale = 0.1: up and scale are for a mesh that is there (OBJ, PLY or glTF)"),
        ({"duration": 100}, "duration = 100: duration must be at most"),
        ({"motion": None}, "scene 'board' has no trajectory of its own"),
        ({"motion": {"kind": "slider", "distance_m": 1, "speed_m_s": 0}}, "speed_m_s must be finite and > 0, got 0"),
        ({"motion": {"kind": "walking"}, "duration": None}, "a motion of kind walking has no end of its own"),
        ({"motion": {"kind": "file", "file": "no.txt"}}, "no.txt"),
        ({"frame_rate": -1}, "frame_rate = -1: frame_rate must be 0..1000000 Hz, got -1"),
        ({"depth_rate": {"choice": [0, -2]}}, "depth_rate = -2: depth_rate must be 0..1000000 Hz, got -2"),
        ({"rays_per_pixel": 0}, "rays_per_pixel = 0: rays_per_pixel must be 1..1024, or auto, got 0"),
        ({"accuracy": "best"}, "accuracy = 'best': accuracy must be one of"),
        ({"sensor": "eye"}, "sensor = 'eye': sensor must be one of"),
        ({"imu": "best"}, "imu = 'best': imu must be one of"),
        (
            {"imu": None, "imu_rate": 5},
            "imu_rate = 5: imu_rate and imu_effects are those of an IMU, but imu is none",
        ),
        ({"imu_effects": {"lag": 0.001}, "imu": "mpu6150"}, "must be at least 0.002 s"),
        ({"pose_noise": -1}, "pose_noise = -1: "),
        ({"contrast_threshold": {"uniform": [-1, 1]}}, "contrast_threshold = -"),
        ({"log_eps": 0}, "log_eps = 0: log_eps must be > 0 and <= 1000 luma, got 0"),
        ({"effects": {"leak": 3}}, "there is no effect 'leak'"),
        ({"effects": {"leak_rate_hz": {"normal": [0, 1]}}}, "effects = {'leak_rate_hz': -"),
        ({"image_gain": 0}, "image_gain = 0: image_gain must be > 0, got 0"),
        ({"image_gain": {"uniform": [-2, -1]}}, "image_gain must be > 0, got -1."),
        (
            {"renderer": "best"},
            "renderer = 'best': renderer must be one of auto, native, table, baked, integrator, got",
        ),
        ({"lux_per_luma": 0}, "lux_per_luma = 0: lux_per_luma must be > 0 lux, got 0"),
        ({"lux_per_luma": -5}, "lux_per_luma = -5: lux_per_luma must be > 0 lux, got -5"),
        ({"tolerance": 0.1}, "only one of render_rate, max_displacement, tolerance, sampling may be given"),
    ],
    ids=str,
)
def test_a_draw_that_will_be_refused_is_refused_first(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    """Before hours of work, by the words of what will refuse it, with plan, sequence and key."""
    plan = load_sequence_plan(write_plan(tmp_path, **changes))
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        check_sequences(plan, draw_sequences(plan))
    assert str(refused.value).startswith(f"{plan.file}: sequence_000")


def test_effects_are_those_of_the_command_line(tmp_path: Path) -> None:
    """A value, parameters by name, none, or nothing at all."""
    text = "scene: fence\neffects: {leak_rate_hz: 0.1, aps: {exposure_us: 100.5}, hot_pixels: 1e-7, readout: null}\n"
    [sequence] = draw_sequences(read(tmp_path, text))
    given = named_effects(sequence.settings["effects"])
    texts = ["aps=100.5", "hot_pixels=1e-7", "leak_rate_hz=0.1", "readout"]
    assert list(given.values()) == [parse_effect(text) for text in texts]


@pytest.mark.parametrize(
    "motion",
    [
        {"kind": "slider", "distance_m": 1, "speed_m_s": 0.5, "direction": [0, 1, 0]},
        {"kind": "hand_held", "degrees_of_freedom": "6dof", "top_speed_m_s": 1, "top_rate_deg_s": 40, "seed": 3},
        {"kind": "zigzag", "legs": 2, "leg_m": 1, "speed_m_s": 1, "through": True},
        {"kind": "spiral", "turns": 2, "radius_m": 1, "speed_m_s": 1},
        {"kind": "walking", "nod_deg": 2, "seed": 4},
        {"kind": "running", "speed_m_s": 2.5, "seed": 4},
    ],
    ids=lambda motion: motion["kind"],
)
def test_motions_are_those_of_the_module(motion: dict[str, Any]) -> None:
    """At the scene's start, as long as the sequence where they have no length, angles in degrees where the key says."""
    scene = davis_rs.load_scene("three_walls")
    path = make_motion(motion, scene, 2.5, Path())
    start = davis_rs.start_pose(scene)
    assert path.pose(0.0).position == pytest.approx(start.position)
    if motion["kind"] in ("hand_held", "walking", "running"):
        assert path.duration_s == pytest.approx(2.5)
    if motion["kind"] == "hand_held":
        assert path.top_speeds().rate_rad_s == pytest.approx(0.698, abs=1e-3)
        assert path.top_speeds().speed_m_s == pytest.approx(1.0)
    assert motion["kind"] in MOTIONS


def test_a_file_is_relative_to_the_plan(tmp_path: Path) -> None:
    """And moved to the start of a built-in scene, unless told otherwise; not to that of a file."""
    (tmp_path / "path.txt").write_text("".join(f"{0.02 * k} {0.01 * k} 0 0 0 0 0 1\n" for k in range(9)))
    scene = davis_rs.load_scene("three_walls")
    motion = {"kind": "file", "file": "path.txt", "position_sigma_m": 0, "rotation_sigma_deg": 0}
    assert make_motion(motion, scene, None, tmp_path).pose(0).position == pytest.approx(
        davis_rs.start_pose(scene).position
    )
    assert make_motion(motion | {"align": False}, scene, None, tmp_path).pose(0.02).position[0] == pytest.approx(0.01)
    (tmp_path / "mesh.obj").write_text("v 5 0 0\nv 6 0 0\nv 5 1 1\nf 1 2 3\n")
    mesh = davis_rs.load_scene(tmp_path / "mesh.obj")
    assert make_motion(motion, mesh, None, tmp_path).pose(0.02).position[0] == pytest.approx(0.01)
    there = make_motion(motion | {"align": True}, mesh, None, tmp_path).pose(0)
    assert there.position == pytest.approx(davis_rs.start_pose(mesh).position)


numbers = st.integers() | st.just(10**400) | st.floats()
pairs = st.lists(numbers, min_size=2, max_size=2)
distributions = st.sampled_from(["uniform", "log_uniform", "normal", "integers", "choice"]).flatmap(
    lambda distribution: st.fixed_dictionaries(
        {distribution: pairs}, optional={"weights": pairs, "min": numbers, "max": numbers}
    )
)
parameters = st.dictionaries(st.sampled_from(["aps", "x"]), st.dictionaries(st.sampled_from(["x", 3, None]), numbers))
junk = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["choice", "uniform", "normal", "weights", "kind", "min", "x"]), inner)
        | st.dictionaries(st.sampled_from(["x", 3, None]), inner)
    ),
    max_leaves=6,
)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["scene", "seed", "motion", "effects", "duration", "rays_per_pixel", "refine"]),
    value=junk | distributions | parameters,
)
def test_whatever_stands_in_a_plan_is_drawn_or_refused_by_name(tmp_path: Path, key: str, value: Any) -> None:
    """Never another exception, and never a message without the file."""
    named = pytest.raises(ValueError, match="^" + re.escape(str(tmp_path / "plan.yaml")))
    with suppress(pytest.fail.Exception), named:  # not refused: it was drawn
        plan = read(tmp_path, yaml.safe_dump({"scene": "fence", key: value}, sort_keys=False))
        assert "scene" in plan.parameters(0)
        assert plan.sha256


def test_a_dry_run_prints_the_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What all have in common once, and a row for each sequence; nothing is made."""
    assert main(["generate", str(write_plan(tmp_path, sequences=3)), "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "rays_per_pixel: 1" in lines
    assert [line.split()[0] for line in lines[-3:]] == ["sequence_00000", "sequence_00001", "sequence_00002"]
    assert "motion.speed_m_s" in lines[-4]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.yaml", "scenes"]
    assert main(["generate", str(tmp_path / "plan.yaml")]) == 1
    assert "-o ROOT must be given" in capsys.readouterr().err
