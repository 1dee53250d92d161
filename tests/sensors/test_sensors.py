"""Sensors as files: presets, what a file may hold, what is refused, and that a file stands wherever a name does."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from hypothesis import example, given, reject, settings
from hypothesis import strategies as st

import davis_rs
from clips import moving_bars
from command_line import davis_rs as command
from davis_rs import DecodeError, SensorParameters, Simulator, load_scene, load_sensor, save_sensor
from davis_rs.generate import load_sequence_plan
from davis_rs.generate.generate import check_sequences, draw_sequences
from davis_rs.geometry.camera import Camera
from davis_rs.sensor.biases import DAVIS240C_BIASES, DAVIS346_BIASES
from davis_rs.sensor.effects import Effects
from davis_rs.sensor.presets import SENSORS, parameter_names, preset_file, read_sensor_file, sensor_yaml, unit_of
from davis_rs.sensor.presets import presets as presets_module
from generated import write_plan

PRESETS = Path(presets_module.__file__).parent
SMALL = Camera(12, 9, 10.0, 10.0, 5.5, 4.0)
PLANES = load_scene("three_planes")
SMALL_SENSOR = "contrast_threshold: 0.2\nthreshold_mismatch: {value: 0.1, unit: share of the threshold}\n"


def written(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", SENSORS)
def test_a_preset_is_a_file_that_show_prints(name: str, tmp_path: Path) -> None:
    """The shipped file is what the writer makes of it, and a shown one is the same sensor."""
    assert (PRESETS / f"{name}.yaml").read_text() == sensor_yaml(preset_file(name))
    shown = command("sensors", "show", name)
    assert shown.stdout.startswith(sensor_yaml(preset_file(name)))
    path = written(tmp_path, shown.stdout)
    assert load_sensor(path) == load_sensor(name) == SENSORS[name]
    assert read_sensor_file(path) == preset_file(name)
    assert command("sensors", "show", path).stdout == shown.stdout


@pytest.mark.parametrize("name", SENSORS)
def test_each_value_of_a_preset_has_its_source_and_all_others_are_named(name: str) -> None:
    """Who shows a sensor sees where each number comes from, and what it leaves open."""
    sensor = preset_file(name)
    assert sensor.sources.keys() == sensor.given.keys()
    assert all(sensor.sources.values())
    assert sensor.description
    text = command("sensors", "show", name).stdout
    left_open = re.findall(r"^#   (\w+)", text, re.MULTILINE)
    assert sorted([*left_open, *sensor.given]) == sorted(parameter_names())


def test_presets_are_what_formulas_and_papers_give() -> None:
    """The files hold numbers: those that follow from biases or from others are derived here once more."""
    for name, chip, scatter in (("davis240c", DAVIS240C_BIASES, 0.035), ("davis346", DAVIS346_BIASES, 0.03)):
        sensor = SENSORS[name]
        biases = {bias: one.default for bias, one in chip.items()}
        off = {"contrast_threshold_off": None} if name == "davis240c" else {}
        derived = SensorParameters.from_biases(biases, **off)
        assert derived.contrast_threshold is not None
        assert sensor.contrast_threshold == derived.contrast_threshold
        assert sensor.contrast_threshold_off == derived.contrast_threshold_off
        assert sensor.refractory_period_us == derived.refractory_period_us
        corner_hz = derived.source_follower_bandwidth_hz
        assert corner_hz is not None
        assert sensor.source_follower_bandwidth_hz == corner_hz
        assert (sensor.photoreceptor_bandwidth_hz, sensor.photoreceptor_bandwidth_lux) == (3000.0, 1000.0)
        assert sensor.threshold_mismatch is not None
        whole = math.hypot(sensor.threshold_mismatch, sensor.threshold_column_parity or 0.0)
        assert whole == pytest.approx(scatter / derived.contrast_threshold, rel=1e-15)
        assert sensor.shot_noise_rms == (0.0522 if name == "davis240c" else 0.0468)
    assert SENSORS["davis240c"].aps_read_noise_dn == pytest.approx(1023 / 10 ** (51 / 20), rel=1e-15)


def values(name: str) -> st.SearchStrategy[Any]:
    """Values of a parameter that a sensor takes."""
    if name in ("width", "height"):
        return st.integers(1, 65535)
    if name == "aps_bits":
        return st.integers(1, 16)
    if name == "readout_by_columns":
        return st.integers(0, 1)
    if name == "hot_pixel_fraction":
        return st.floats(0, 1)
    # Of these the effects know the ranges as well.
    ranges = {
        "threshold_mismatch": (0, 1),
        "vignetting": (0, 8),
        "lens_blur_px": (0, 5),
        "readout_events_per_s": (1, 1e9),
        "aps_full_well_e": (1, 1e9),
    }
    low, high = ranges.get(name, (1e-3, 1.0))  # which all others allow
    return st.floats(low, high)


TEXTS = st.text(st.characters(codec="utf-8"), max_size=40)
SOME_NAMES = st.sets(st.sampled_from(parameter_names()), max_size=6)
"""Few, because of many some do not go together."""
SENSORS_OF_ANY_VALUES = SOME_NAMES.flatmap(
    lambda names: st.fixed_dictionaries({name: values(name) for name in sorted(names)})
)


@pytest.mark.long
@settings(max_examples=60)
@given(parameters=SENSORS_OF_ANY_VALUES, description=TEXTS, source=TEXTS, sigma=st.floats(0, 1e9))
@example(parameters={"width": 3}, description="\x85", source="a\u2028b", sigma=0.0)
def test_what_is_written_is_read_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, parameters: dict[str, Any], description: str, source: str, sigma: float
) -> None:
    """Every number to its last bit, and every text."""
    path = tmp_path_factory.mktemp("sensor") / "one.yaml"
    try:
        sensor = SensorParameters(**parameters)
        sensor.effects(1000.0)
    except ValueError:
        reject()  # a combination that no effect takes
    sources, sigmas = dict.fromkeys(parameters, source), dict.fromkeys(parameters, sigma)
    save_sensor(path, sensor, description=description, sources=sources, uncertainties=sigmas)
    found = read_sensor_file(path)
    assert found.parameters == sensor
    assert (found.description, found.sources, found.uncertainties) == (description, sources, sigmas)


def test_every_parameter_has_a_type_that_a_file_can_hold() -> None:
    """Numbers, truth values and texts; another type needs a form in the file first."""
    hints = get_type_hints(SensorParameters)
    assert parameter_names() == tuple(one.name for one in fields(SensorParameters))
    for name in parameter_names():
        assert set(str(hints[name]).replace(" ", "").split("|")) <= {"float", "int", "bool", "str", "None"}, name


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("leak_rate_hz", "Hz"),
        ("readout_events_per_s", "events/s"),
        ("refractory_period_us", "us"),
        ("shot_noise_half_lux", "lux"),
        ("aps_read_noise_dn", "DN"),
        ("width", "px"),
        ("contrast_threshold", "natural-log units"),
        ("something_new", "1"),
        ("something_new_hz", "Hz"),
    ],
)
def test_the_end_of_a_name_is_its_unit(name: str, unit: str) -> None:
    """So a parameter that is added has its unit without another table."""
    assert unit_of(name) == unit


def test_plain_values_null_and_json_are_read_as_well(tmp_path: Path) -> None:
    """Who writes a file by hand needs no source; what meta.json holds of a run's sensor is a sensor file."""
    plain = written(tmp_path, "leak_rate_hz: 1e-1\nhot_pixel_fraction: null\nshot_noise_rms: {value: 2}\n")
    assert load_sensor(plain) == SensorParameters(leak_rate_hz=0.1, shot_noise_rms=2)
    record = written(tmp_path, json.dumps(asdict(SENSORS["davis346"])), "meta.json")
    assert load_sensor(record) == SENSORS["davis346"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("leak_rate: 0.1", "a sensor has no key 'leak_rate'; did you mean leak_rate_hz?"),
        ("zzz: 1", "a sensor has no key 'zzz'; there are description, width"),
        ("5: 1", "a sensor has no key 5; there are description"),
        ("leak_rate_hz: {value: 1, sorce: x}", "leak_rate_hz has no key 'sorce'; did you mean source?"),
        ("leak_rate_hz: {unit: Hz}", "leak_rate_hz must have a value, got {'unit': 'Hz'}"),
        ("leak_rate_hz: {value: 1, unit: kHz}", "leak_rate_hz: unit must be Hz, got 'kHz'"),
        ("leak_rate_hz: -1", "leak_rate_hz must be finite and >= 0, got -1"),
        ("leak_rate_hz: .inf", "leak_rate_hz must be finite and >= 0, got inf"),
        ("leak_rate_hz: .nan", "leak_rate_hz must be finite and >= 0, got nan"),
        ("leak_rate_hz: fast", "leak_rate_hz must be a number (Hz), got 'fast'"),
        ("leak_rate_hz: true", "leak_rate_hz must be a number (Hz), got True"),
        ("leak_rate_hz: [1]", "leak_rate_hz must be a number (Hz), got [1]"),
        (f"leak_rate_hz: 1{'0' * 400}", "leak_rate_hz must be a number (Hz), got 1000000"),
        (f"leak_rate_hz: 0x{'f' * 9000}", "leak_rate_hz must be a number (Hz), got a number of too many digits"),
        ("width: 1.5", "width must be an integer (px), got 1.5"),
        ("width: 0", "width must be finite and > 0, got 0"),
        ("width: 70000", "width must lie in 0..65535, got 70000"),
        ("hot_pixel_fraction: 2", "hot_pixel_fraction must lie in 0..1, got 2"),
        ("aps_exposure_us: 10\naps_bits: 99", "bits must"),
        ("leak_rate_hz: {value: 1, source: 5}", "leak_rate_hz: source must be a text, got 5"),
        ("leak_rate_hz: {value: 1, uncertainty: -1}", "uncertainty of leak_rate_hz must be finite and >= 0, got -1"),
        ("description: 5", "description must be a text, got 5"),
        ("leak_rate_hz: 1\nleak_rate_hz: 2", "the key 'leak_rate_hz' stands here a second time"),
        ("- 1", "a sensor must be a mapping of keys to values, got [1]"),
        ("", "a sensor must be a mapping of keys to values, got None"),
        ("leak_rate_hz: [", "expected the node content"),
        (f"description: {'x' * 200_000}", "it may have 131072 bytes"),
        (f"leak_rate_hz: {'[' * 5000}", "nested 50 levels"),
    ],
)  # fmt: skip
def test_a_file_that_breaks_a_rule_is_refused_by_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    """Nothing that is misspelt or out of range comes to nothing."""
    path = written(tmp_path, text)
    with pytest.raises(DecodeError, match=re.escape(message)) as raised:
        load_sensor(path)
    assert str(raised.value).startswith(str(path))


def test_what_is_neither_a_name_nor_a_file_is_refused(tmp_path: Path) -> None:
    """A misspelt name is told as such; a file must be there."""
    with pytest.raises(ValueError, match=r"sensor must be one of ideal, .*, got 'davis24'; did you mean davis240c\?"):
        load_sensor("davis24")
    with pytest.raises(FileNotFoundError):
        load_sensor(tmp_path / "none.yaml")
    (tmp_path / "folder.yaml").mkdir()
    with pytest.raises(IsADirectoryError):
        load_sensor(tmp_path / "folder.yaml")


def test_why_a_value_is_not_known_is_kept(tmp_path: Path) -> None:
    """A source without a value says it: it is read, written, and read again."""
    path = tmp_path / "mine.yaml"
    path.write_text("leak_rate_hz:\n  value: null\n  source: nothing in the recording stands still\n")
    sensor = read_sensor_file(path)
    path.write_text(sensor_yaml(sensor))
    assert read_sensor_file(path) == sensor
    assert sensor.sources["leak_rate_hz"] == "nothing in the recording stands still"


def test_a_file_that_could_not_be_read_back_is_not_written(tmp_path: Path) -> None:
    """A misspelt source, and more text than a file may have."""
    with pytest.raises(
        ValueError, match=r"sources: a sensor has no parameter 'leak_rate'; did you mean leak_rate_hz\?"
    ):
        save_sensor(tmp_path / "a.yaml", SensorParameters(), sources={"leak_rate": "x"})
    with pytest.raises(ValueError, match="a sensor file may have 131072 bytes"):
        save_sensor(tmp_path / "a.yaml", SensorParameters(), description="x" * 140_000)
    assert not (tmp_path / "a.yaml").exists()


def events_of(**given: Any) -> bytes:
    """The events of a short run."""
    scene = PLANES.crop(0.0, 0.3)
    events = [packet.events for packet in davis_rs.simulate(scene, camera=SMALL, renderer="native", **given)]
    return b"".join(one.tobytes() for one in events)


def test_a_run_has_the_files_sensor_and_is_repeated_from_its_record(tmp_path: Path) -> None:
    """Without the file: meta.json has every parameter."""
    path = written(tmp_path, SMALL_SENSOR)
    expected = SensorParameters(contrast_threshold=0.2, threshold_mismatch=0.1)
    simulator = Simulator(PLANES, camera=SMALL, renderer="native", sensor=str(path))
    record = json.loads(json.dumps(simulator.describe()))
    by_file = events_of(sensor=str(path))
    assert events_of(sensor=path) == by_file
    path.unlink()
    repeated = SensorParameters(**record["parameters"]["sensor"])
    assert repeated == expected
    assert (simulator.contrast_threshold, simulator.effects) == (0.2, Effects(threshold_mismatch=0.1))
    assert by_file == events_of(sensor=repeated) != events_of()


@pytest.mark.parametrize(
    "words", [["simulate", "three_planes"], ["sequence", "slider_far"]], ids=lambda words: words[0]
)
def test_commands_take_a_file(words: list[str], tmp_path: Path) -> None:
    """davis-rs simulate and sequence, and the record has its parameters."""
    path = written(tmp_path, SMALL_SENSOR + "width: 12\nheight: 9\n")
    short = ["--duration", "0.02", "--rays-per-pixel", "1", "--renderer", "native", "--quiet"]
    done = command(*words, "-o", tmp_path / "out", "--sensor", path, *short)
    assert (done.returncode, done.stderr) == (0, "")
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert meta["sensor"] == {"width": 12, "height": 9}
    assert meta["parameters"]["sensor"]["threshold_mismatch"] == 0.1
    assert meta["parameters"]["contrast_threshold"] == 0.2
    assert "threshold_mismatch" in meta["effects"]


def test_the_planner_takes_a_file(tmp_path: Path) -> None:
    """Its effects are the candidates."""
    path = written(tmp_path, SMALL_SENSOR + "width: 12\nheight: 9\n")
    done = command("plan", "three_planes", "--duration", "0.05", "--renderer", "native", "--sensor", path)
    assert done.returncode == 0, done.stderr
    rows = re.findall(r"^(\w+) +(?:yes|no) ", done.stdout, re.MULTILINE)
    assert rows == ["threshold_mismatch"]


def test_frames_take_a_file(tmp_path: Path) -> None:
    """Thresholds and effects come from it, and the record has its parameters."""
    path = written(tmp_path, SMALL_SENSOR)
    np.save(tmp_path / "bars.npy", moving_bars(3))
    frames = davis_rs.open_frames(tmp_path / "bars.npy", fps=100.0)
    report = davis_rs.frames_to_folder(frames, tmp_path / "out", sensor=path, quiet=True)
    meta = json.loads((report.path / "meta.json").read_text())
    assert meta["parameters"]["sensor"]["threshold_mismatch"] == 0.1
    assert meta["parameters"]["contrast_threshold"] == 0.2


def test_a_plan_of_many_sequences_draws_among_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They lie next to the plan, and the plan is another one where a file of it is."""
    sensor = written(tmp_path, SMALL_SENSOR)
    path = write_plan(tmp_path, sensor={"choice": ["davis240c", "mine.yaml"]}, camera=None, sequences=8)
    plan = load_sequence_plan(path)
    assert "mine.yaml" in plan.digests
    monkeypatch.chdir("/")
    sequences = draw_sequences(plan)
    check_sequences(plan, sequences)
    drawn = {one.parameters["sensor"]: one.settings["sensor"] for one in sequences}
    assert drawn == {"davis240c": "davis240c", "mine.yaml": str(sensor)}
    sensor.write_text("leak_rate_hz: -1")
    assert load_sequence_plan(path).sha256 != plan.sha256
    with pytest.raises(ValueError, match=r"sensor = 'mine.yaml': .*leak_rate_hz must be finite and >= 0, got -1"):
        check_sequences(plan, sequences)


def test_the_list_has_every_preset() -> None:
    """With its size and what it is."""
    lines = command("sensors").stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(SENSORS)
    assert "346 x 260" in lines[2]
    assert "DAVIS346 with the biases" in lines[2]
