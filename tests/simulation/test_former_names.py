"""Former names of settings: all takers know them, and say the present ones."""

import json
import warnings
from pathlib import Path

import pytest

import davis_rs
from command_line import davis_rs as run
from davis_rs import Accuracy, Simulator, load_scene
from davis_rs._util.former_names import takes_former_names
from davis_rs.generate.sequence import DrawnSequence
from davis_rs.generate.sequence_plan import load_sequence_plan
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.rules import MaxDisplacement
from davis_rs.simulation.noise_estimate import NoiseEstimate

IS_NOW = "^samples is called rays_per_pixel now$"


def test_arguments_and_attributes() -> None:
    """Settings, renderers, presets and estimates take or have the former name; the warning is at the user's line."""
    scene = load_scene("three_planes")
    with pytest.warns(DeprecationWarning, match=IS_NOW) as told:
        simulator = Simulator(scene, size=(24, 18), samples=3)  # type: ignore[call-arg]
    assert [warning.filename for warning in told] == [__file__]
    assert simulator.renderer.rays_per_pixel == 3
    with pytest.warns(DeprecationWarning, match=IS_NOW) as told:
        renderer = make_renderer(scene, simulator.camera, samples=2)  # type: ignore[call-arg]
    assert [warning.filename for warning in told] == [__file__]
    assert renderer.rays_per_pixel == 2
    with pytest.warns(DeprecationWarning, match=IS_NOW):
        accuracy = Accuracy(MaxDisplacement(), samples=5)  # type: ignore[call-arg]
    with pytest.warns(DeprecationWarning, match=IS_NOW):
        assert accuracy.samples == accuracy.rays_per_pixel == 5
    estimate = NoiseEstimate(8, ((8.0, 0.2), (64.0, 0.05)))
    with pytest.warns(DeprecationWarning, match="^samples_for is called rays_per_pixel_for now$"):
        assert estimate.samples_for(0.1) == estimate.rays_per_pixel_for(0.1)  # type: ignore[operator]


def test_both_names() -> None:
    """One argument by both of its names is refused."""
    with pytest.raises(TypeError, match="rays_per_pixel is given twice, once by its former name samples"):
        Simulator(load_scene("three_planes"), samples=3, rays_per_pixel=3)  # type: ignore[call-arg]


def test_present_names_are_silent() -> None:
    """A function that takes former names warns of them alone, and keeps its docstring."""

    @takes_former_names(old="new")
    def taker(new: int) -> int:
        """Return it."""
        return new

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (taker(1), taker(new=2), taker.__doc__) == (1, 2, "Return it.")


def test_command_line(tmp_path: Path) -> None:
    """The former option does what the present one does, with one line; ``--help`` does not list it."""
    done = run(
        "simulate", "three_planes", "-o", tmp_path / "out", "--size", "24x18", "--duration", 0.02, "--samples", 3
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("davis-rs: warning: --samples is called --rays-per-pixel now\n") == 1
    assert json.loads((tmp_path / "out" / "meta.json").read_text())["parameters"]["rays_per_pixel"] == 3
    assert "--samples" not in run("simulate", "--help").stdout
    wrong = run("simulate", "three_planes", "-o", tmp_path / "none", "--rays-per-pixel", 0)
    assert "argument --rays-per-pixel: must be 1..1024, or auto, got 0" in wrong.stderr


def test_plan(tmp_path: Path) -> None:
    """A plan with the former key draws what it drew, and the setting gets it; both keys are refused."""
    plan = tmp_path / "plan.yaml"
    plan.write_text("scene: three_planes\nseed: 3\nduration: 0.02\nsamples: {integers: [1, 1024]}\n")
    with pytest.warns(FutureWarning, match=r"plan\.yaml: samples is called rays_per_pixel now$"):
        read = load_sequence_plan(plan)
    drawn = read.parameters(0)
    assert drawn["samples"] == 636  # as before the key was renamed
    sequence = DrawnSequence("sequence_00000", 0, drawn, tmp_path, read.sha256)
    assert sequence.settings["rays_per_pixel"] == drawn["samples"]
    plan.write_text("scene: three_planes\nsamples: 2\nrays_per_pixel: 2\n")
    with pytest.raises(ValueError, match="samples: must be the only one, but rays_per_pixel is given as well"):
        load_sequence_plan(plan)


def test_simulate_warns_at_its_line() -> None:
    """The warning of a generator's setting is at a line of the user as well."""
    scene = load_scene("three_planes")
    with pytest.warns(DeprecationWarning, match=IS_NOW) as told:
        next(davis_rs.simulate(scene, size=(24, 18), samples=1, duration_s=0.01))  # type: ignore[call-arg]
    assert [warning.filename for warning in told] == [__file__]
