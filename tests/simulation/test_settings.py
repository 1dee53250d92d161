"""Settings are declared once: Python, the command line, plans, docstrings and records all follow."""

from __future__ import annotations

import inspect
import json
import pydoc
import re
from dataclasses import FrozenInstanceError, asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from settings_keywords import keywords_source

import davis_rs
from davis_rs import (
    ColourFilter,
    FixedRate,
    Imu,
    MocapClock,
    MotionCapture,
    Simulator,
    load_scene,
    plan_effects,
    simulate_to_folder,
)
from davis_rs.cli.main import main
from davis_rs.generate import load_sequence_plan
from davis_rs.generate.generate import draw_sequences
from davis_rs.generate.sequence_plan import KEYS, SETTINGS
from davis_rs.geometry.camera import Camera
from davis_rs.sensor.presets import SENSORS
from davis_rs.simulation.settings import (
    FolderSettings,
    FrameFolderSettings,
    FrameSettings,
    PlanSettings,
    SimulationSettings,
    SimulatorSettings,
    ViewSettings,
    complete,
    keywords,
    resolve,
    settings_of,
)

TAKERS: list[tuple[Any, type]] = [
    (Simulator, SimulatorSettings),
    (davis_rs.simulate, SimulationSettings),
    (simulate_to_folder, FolderSettings),
    (plan_effects, PlanSettings),
    (davis_rs.events_from_frames, FrameSettings),
    (davis_rs.frames_to_folder, FrameFolderSettings),
]
NAMES = list(settings_of(FolderSettings))
SMALL = Camera(12, 9, 10.0, 10.0, 5.5, 4.0)
PLANES = load_scene("three_planes")


def shown(taker: Any) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(taker).parameters)


@pytest.mark.parametrize(
    ("taker", "declaration"), TAKERS, ids=["Simulator", "simulate", "folder", "plan", "frames", "frames to folder"]
)
def test_signature_and_help_list_every_setting(taker: Any, declaration: type) -> None:
    """With the declared default, type and a line of its own; no ``**settings`` is left for a reader to look up."""
    parameters, text = shown(taker), pydoc.plain(pydoc.render_doc(taker))
    declared = settings_of(declaration)
    assert all(one.kind is not inspect.Parameter.VAR_KEYWORD for one in parameters.values())
    assert declared.keys() <= parameters.keys()
    assert "{settings}" not in text
    for name, setting in declared.items():
        assert parameters[name].default == setting.declared.default
        assert parameters[name].kind is inspect.Parameter.KEYWORD_ONLY
        assert f"{name} ({setting.annotation}" in text
        assert "<class" not in setting.annotation


def test_a_setting_is_the_same_wherever_it_is_taken() -> None:
    """A smaller function's settings are a larger one's, with the same declaration; ``effects`` takes more there."""
    small, large = settings_of(SimulatorSettings), settings_of(FolderSettings)
    for name, setting in settings_of(ViewSettings).items():
        assert small[name] == setting
    assert {name for name, setting in small.items() if large[name] != setting} == {"effects"}


def test_the_defaults_are_those_of_python_plan_and_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a command without options and a plan without keys come to is what a call without arguments does."""
    plan = tmp_path / "plan.yaml"
    plan.write_text("scene: three_planes\n")
    [sequence] = draw_sequences(load_sequence_plan(plan))
    assert complete(FolderSettings, sequence.settings, taker="a plan") == FolderSettings()
    defaults = FolderSettings().by_name()
    assert {name: one.default for name, one in shown(simulate_to_folder).items() if name in defaults} == defaults
    assert command_line(monkeypatch) == {"accept_noise": False}  # the library only warns


def command_line(monkeypatch: pytest.MonkeyPatch, *options: str) -> dict[str, Any]:
    """The settings that davis-rs simulate hands over."""
    taken: dict[str, Any] = {}

    def take(scene: Any, path: Any, **given: Any) -> Any:
        taken.update({name: value for name, value in given.items() if name in NAMES})
        raise OSError("enough was seen")

    monkeypatch.setattr("davis_rs.simulation.folder.simulate_to_folder", take)
    assert main(["simulate", "three_planes", "-o", "no_such_folder", *options]) == 1
    return taken


VALUES: dict[str, tuple[str, Any]] = {
    "camera": ("davis240c", "davis240c"),
    "size": ("346x260", "346x260"),
    "sensor": ("davis346", "davis346"),
    "renderer": ("table", "table"),
    "pixel": ("lines", "lines"),
    "colour_filter": ("GRBG", "GRBG"),
    "accuracy": ("fast", "fast"),
    "imu": ("davis", "davis"),
    "effects": ("leak_rate_hz=1", ["leak_rate_hz=1"]),
    "imu_effects": ("lag=0.003", ["lag=0.003"]),
    "rays_per_pixel": ("3", 3),
    "start_phase": ("stationary", "stationary"),
    "seed": ("18446744073709551615", 2**64 - 1),
    "threads": ("2", 2),
    "custom_effects": ("math:pi", ["math:pi"]),
    "flow_png": ("dsec", "dsec"),
    "event_truth": ("npz", "npz"),
    "signal_window_us": ("10000", 10_000),
    "events_format": ("aedat4", "aedat4"),
}


@pytest.mark.parametrize("name", NAMES)
def test_every_setting_has_an_option_and_a_key(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Under the setting's own name without its unit, and both hand over the same value; or only Python has it."""
    setting = settings_of(FolderSettings)[name]
    if setting.kind is None:
        assert name in {"sampling", "poses_per_launch", "motion_capture"}
        assert setting.key not in KEYS
        with pytest.raises(SystemExit):
            main(["simulate", "three_planes", "-o", "no_such_folder", setting.option, "1"])
        return
    text, value = VALUES.get(name, ("0.75", 0.75))
    option = setting.option.removesuffix("s") if setting.kind is list else setting.option
    given = [option] if setting.kind is bool else [option, text]
    expected = True if setting.kind is bool else value
    # Too much noise is refused, where the library only warns.
    assert command_line(monkeypatch, *given) == {"accept_noise": False, name: expected}
    # Drawn, the workers', code that no plan runs, and of all sequences alike.
    if name in {"seed", "threads", "custom_effects", "accept_noise"}:
        assert setting.key not in SETTINGS
        return
    in_plan = {"leak_rate_hz": 1} if name == "effects" else {"lag": 0.003} if name == "imu_effects" else expected
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump({"scene": "three_planes", setting.key: in_plan}))
    [sequence] = draw_sequences(load_sequence_plan(tmp_path / "plan.yaml"))
    assert sequence.settings == {name: in_plan}


def test_a_plan_has_no_keys_but_those_of_settings_scene_and_path() -> None:
    """A key that nothing declares could come to nothing."""
    of_files = {"up", "scale", "animation", "grey_unknown"}
    assert KEYS.keys() == {"scene", *of_files, "motion", "start", "start_pose", "rig", "duration", *SETTINGS}
    assert {setting.name for setting in SETTINGS.values()} <= {*NAMES}


def test_type_checkers_know_the_settings_that_are_declared() -> None:
    """The TypedDicts of keyword arguments are those that the declarations make."""
    assert Path(keywords.__file__).read_text() == keywords_source()


def test_what_is_resolved_serves_a_simulator_and_stays_as_it_is() -> None:
    """Nothing of it is changed by the run; the settings are those that were given, with the sensor decided."""
    settings = complete(SimulatorSettings, {"camera": SMALL, "sensor": "davis240c", "log_eps": None}, taker="a test")
    settings = replace(settings, sensor=replace(SENSORS["davis240c"], width=None, height=None))
    resolved = resolve(PLANES.crop(0, 0.01), settings)
    before = replace(resolved, settings=replace(settings))
    simulator = Simulator.of_resolved(resolved, resolved.renderer())
    assert sum(len(packet.events) for packet in simulator.run()) > 0
    assert resolved == before
    assert simulator.settings is resolved.settings
    with pytest.raises(FrozenInstanceError):
        resolved.settings.seed = 1  # type: ignore[misc]


@pytest.mark.parametrize("taker", [Simulator, davis_rs.simulate, plan_effects])
def test_a_name_that_is_no_setting_is_told_with_the_nearest(taker: Any) -> None:
    """A TypeError as of any function, at once; a setting of another function is none here."""
    with pytest.raises(TypeError, match=r"has no argument 'contrast_treshold'; did you mean contrast_threshold\?"):
        taker(PLANES, contrast_treshold=0.2)
    with pytest.raises(TypeError, match="has no argument 'imu_rate_hz'"):
        taker(PLANES, imu_rate_hz=100.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("duration", "duration_s"),
        ("duration_ms", "duration_s"),
        ("pos_thres", "contrast_threshold? (pos_thres in v2e)"),
        ("contrast_threshold_neg", "contrast_threshold_off? (contrast_threshold_neg in ESIM)"),
        ("Cp", "contrast_threshold? (cp in rpg_vid2e)"),
        ("spp", "rays_per_pixel? (spp in Mitsuba)"),
        (
            "simulation_post_gaussian_blur_sigma",
            "effects={'lens_blur_px': ...}? (simulation_post_gaussian_blur_sigma in",
        ),
        ("leak_rate_hz", "effects={'leak_rate_hz': ...}"),
        ("leak_rate", "effects={'leak_rate_hz': ...}"),
        ("refractory_period_s", "effects={'refractory_period_us': ...}? (refractory_period_s in v2e; here in micro"),
    ],
)
def test_a_name_that_is_close_or_anothers_is_told_with_ours(name: str, message: str) -> None:
    """With or without a unit; an effect is no setting, but may be given in one; the function's own arguments count."""
    takers: tuple[Any, ...] = (davis_rs.simulate, partial(simulate_to_folder, path="no_such_folder"))
    for taker in takers:
        with pytest.raises(TypeError, match=re.escape(f"has no argument {name!r}; did you mean {message}")):
            taker(PLANES, **{name: 0.1})


@pytest.mark.parametrize(
    ("taker", "name", "message"),
    [
        (load_scene, "scal", "load_scene has no argument 'scal'; did you mean scale?"),
        (davis_rs.open_frames, "rate", "open_frames has no argument 'rate'; it has path, timestamps, fps, time_unit"),
        (Camera, "w", "Camera has no argument 'w'; it has width, height"),
        (davis_rs.SensorParameters, "cutoff_hz", "did you mean photoreceptor_bandwidth_hz? (cutoff_hz in v2e)"),
        (davis_rs.represent.voxel_grid, "bin", "voxel_grid has no argument 'bin'; did you mean bins?"),
        (davis_rs.EventWindows, "duration", "has no argument 'duration'; did you mean duration_us?"),
    ],
)
def test_functions_without_settings_name_the_argument_that_is_close_too(taker: Any, name: str, message: str) -> None:
    """Python alone, before 3.13, says only that there is no such argument."""
    with pytest.raises(TypeError, match=re.escape(message)):
        taker(**{name: 1})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"contrast_threshold": 0}, "contrast_threshold must be > 0, got 0"),
        ({"contrast_threshold": True}, "contrast_threshold must be a number, got True"),
        ({"contrast_threshold": "0.2"}, "contrast_threshold must be a number, got '0.2'"),
        ({"frame_rate_hz": None}, "frame_rate_hz must be given, got None"),
        ({"frame_rate_hz": 2e6}, r"frame_rate_hz must be 0\.\.1000000 Hz, got 2000000\.0"),
        ({"depth_rate_hz": float("nan")}, "depth_rate_hz must be finite, got nan"),
        ({"render_rate_hz": 0.0}, r"render_rate_hz must be > 0 and <= 1000000 Hz, got 0\.0"),
        ({"rays_per_pixel": 2.0}, r"rays_per_pixel must be an integer, or auto, got 2\.0"),
        ({"rays_per_pixel": 1025}, r"rays_per_pixel must be 1\.\.1024, or auto, got 1025"),
        ({"seed": -1}, "seed must be .*, got -1"),
        (
            {"renderer": "tabel"},
            r"renderer must be one of auto, native, table, baked, integrator, got 'tabel'; did you mean table\?",
        ),
        ({"accuracy": "exactly"}, r"accuracy must be one of paper, .*, got 'exactly'; did you mean exact\?"),
        ({"accuracy": 3}, "accuracy must be str, got 3"),
        ({"sensor": "davis24"}, r"sensor must be one of .*, got 'davis24'; did you mean davis240c\?"),
        ({"blur": "no"}, "blur must be bool, got 'no'"),
        ({"sampling": 3}, "sampling must be TimeSampling, got 3"),
        ({"camera": 3}, r"camera must be Camera \| str \| PathLike\[str\] \(CAMERA\), got 3"),
        ({"size": (240.7, 180)}, r"size must be two integers, width and height in pixels, got \(240\.7, 180\)"),
        (
            {"size": "240"},
            r"size must be WIDTHxHEIGHT in pixels, 1\.\.65535 each, such as 346x260, or .* such as evk4, got '240'",
        ),
        ({"size": "0x5"}, r"size must lie in 1\.\.65535 pixels each way, got 0 x 5"),
        ({"log_eps": 1e9}, r"log_eps must be > 0 and <= 1000 luma, got 1000000000\.0"),
        ({"tolerance": 1e9}, r"tolerance must be > 0 and <= 10, got 1000000000\.0"),
        ({"max_displacement_px": 1e9}, r"max_displacement_px must be > 0 and <= 1000 px, got 1000000000\.0"),
        ({"tolerance": 0.1, "render_rate_hz": 9.0}, "only one of .* may be given, got render_rate_hz, tolerance"),
    ],
)
def test_a_value_that_is_not_allowed_is_told_with_setting_and_rule(given: dict[str, Any], message: str) -> None:
    """Nothing is rounded, cut or taken for true."""
    with pytest.raises(ValueError, match=f"^{message}$"):
        Simulator(PLANES, **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"imu": "mpu6500"}, r"imu must be one of none, ideal, davis, mpu6150, got 'mpu6500'; did you mean mpu6150\?"),
        ({"imu": 3}, r"imu must be Imu \| str, got 3"),
        ({"imu_rate_hz": 100.0}, "imu_rate_hz and imu_effects are those of an IMU, but imu is none: choose an IMU"),
        ({"pose_noise_m": -1.0}, r"pose_noise_m must be >= 0 m, got -1\.0"),
        ({"image_gain": 0.0}, r"image_gain must be > 0, got 0\.0"),
        (
            {"effects": 3},
            r"effects must be Effects \| Effect \| Mapping.* \| str \| Sequence.*, got 3",
        ),
        ({"effects": ["leak=1"]}, "there is no effect 'leak'; .*"),
        (
            {"motion_capture": MotionCapture(), "clock_offset_s": 0.1},
            "motion_capture is given: clock_offset_s would be ignored",
        ),
    ],
)
def test_what_is_written_is_checked_before_a_folder_is_made(
    tmp_path: Path, given: dict[str, Any], message: str
) -> None:
    """A mistake in the IMU's settings must not cost the simulation."""
    with pytest.raises(ValueError, match=f"^{message}$"):
        simulate_to_folder(PLANES, tmp_path / "out", quiet=True, **given)
    assert not (tmp_path / "out").exists()


OTHER: dict[str, Any] = {
    "contrast_threshold": 0.21,
    "contrast_threshold_off": 0.22,
    "log_eps": 2e-3,
    "lux_per_luma": 500.0,
    "start_phase": "stationary",
    "rays_per_pixel": 2,
    "noise_share": 0.2,
    "matte": True,
    "renderer": "table",
    "bake_error": 0.02,
    "pixel": "rays",
    "colour_filter": "GRBG",
    "blur": False,
    "seed": 5,
    "frame_rate_hz": 100.0,
    "depth_rate_hz": 50.0,
    "accuracy": "fast",
    "render_rate_hz": 300.0,
    "max_displacement_px": 0.4,
    "tolerance": 0.2,
    "sampling": FixedRate(200.0),
    "refine": True,
    "sensor": "ideal",
    "flow_rate_hz": 20.0,
    "flow_interval_s": 0.05,
    "mask_rate_hz": 20.0,
    "normal_rate_hz": 20.0,
    "signal_window_us": 5000,
}
"""For each setting of a simulator a value that is not its default."""
ELSEWHERE = {"camera", "size", "effects", "custom_effects", "threads", "poses_per_launch"}
"""In ``camera``, ``effects`` and ``custom_effects`` of meta.json, or without any part in the results."""


@pytest.mark.usefixtures("llvm")
def test_the_record_has_every_setting_that_results_depend_on() -> None:
    """Given or not, by its name and with the value that it came to; what results do not depend on is not there."""
    assert {*OTHER} | ELSEWHERE == {*settings_of(SimulatorSettings)}
    plain = Simulator(PLANES, camera=SMALL).describe()
    assert plain["parameters"].keys() == {*settings_of(SimulatorSettings)} - ELSEWHERE
    json.dumps(plain)
    for name, value in OTHER.items():
        given = {**({"camera": SMALL} if name != "sensor" else {}), name: value}
        if name == "flow_interval_s":
            given["flow_rate_hz"] = 20.0
        found = Simulator(PLANES, **given).describe()["parameters"]
        told = {"sampling": repr(value), "colour_filter": asdict(ColourFilter("GRBG"))}
        assert found[name] == told.get(name, value), name
        assert found[name] != plain["parameters"][name], name


@pytest.mark.usefixtures("llvm")
def test_the_record_has_the_settings_of_what_is_written_too(tmp_path: Path) -> None:
    """IMU, ground truth and the gain of the frames."""
    report = simulate_to_folder(
        PLANES, tmp_path / "out", duration_s=0.02, camera=SMALL, contrast_threshold=0.02, quiet=True,
        imu=Imu(rate_hz=500.0), image_gain=0.5, pose_rate_hz=100.0, clock_offset_s=0.25,
        clock_drift_ms_per_min=2.0, pose_noise_m=0.001, seed=3,
    )  # fmt: skip
    meta = json.loads((report.path / "meta.json").read_text())
    assert meta["parameters"]["seed"] == 3
    assert meta["imu"]["rate_hz"] == 500.0
    assert meta["image_gain"] == 0.5
    assert meta["pose_rate_hz"] == 100.0
    assert meta["motion_capture"]["clock"] == {"offset_s": 0.25, "drift": pytest.approx(2e-3 / 60)}
    assert meta["motion_capture"]["noise"]["position_m"] == 0.001
    given = MotionCapture(100.0, clock=MocapClock(0.25, 2e-3 / 60))
    again = simulate_to_folder(
        PLANES, tmp_path / "b", duration_s=0.02, camera=SMALL, contrast_threshold=0.02, quiet=True, motion_capture=given
    )
    other = json.loads((again.path / "meta.json").read_text())["motion_capture"]
    assert other["clock"] == meta["motion_capture"]["clock"]
