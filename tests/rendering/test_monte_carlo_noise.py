"""The estimate of Monte Carlo noise against whole runs, and what is made of it."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import davis_rs
from davis_rs import (
    Camera,
    FixedRate,
    MaxDisplacement,
    NoiseError,
    NoiseEstimate,
    NoiseWarning,
    Simulator,
    Tolerance,
    compare_events,
    estimate_noise,
    load_scene,
    simulate,
)
from davis_rs._mitsuba.variants import FAST, default_variant, variant
from davis_rs._util.quantities import percent
from davis_rs.cli.main import main
from davis_rs.events.arrays import EventArray
from davis_rs.generate import generate, load_sequence_plan
from davis_rs.generate.generate import draw_sequences
from davis_rs.generate.job import make_sequence
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.rules import TimeSampling
from davis_rs.scene.scene import Scene
from davis_rs.simulation import monte_carlo_noise
from davis_rs.simulation.folder import simulate_to_folder
from davis_rs.simulation.monte_carlo_noise import estimate_noise_of, refuse_noise
from davis_rs.simulation.noise_estimate import share_text
from davis_rs.simulation.settings import FolderSettings, SimulationSettings, complete
from davis_rs.simulation.simulate import make_simulator
from lamp_box import lamp_box

SIZE = (40, 30)


@pytest.fixture(autouse=True, scope="module")
def _in_llvm() -> Iterator[None]:
    """Mitsuba's variant is set once: changing it for each frame would take longer than rendering."""
    if default_variant()[0] != FAST:
        yield
        return
    with variant(FAST):
        yield


def small_box() -> Scene:
    """Light that bounces three times."""
    return lamp_box(*SIZE)


def plain_box() -> Scene:
    """Light that does not bounce: less to compile and to trace."""
    return lamp_box(32, 24, integrator={"type": "path", "max_depth": 2})


@pytest.fixture
def few_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of what is done with an estimate, not of how good it is."""
    monkeypatch.setattr(monte_carlo_noise, "SEEDS", 12)


@pytest.fixture(scope="module")
def of_the_box(_in_llvm: None) -> NoiseEstimate:
    estimate = estimate_noise(small_box(), renderer="integrator")
    assert estimate is not None
    return estimate


def noisy_room(folder: Path) -> list[str]:
    """A chequered floor under a lamp as a file, and a path through it, as arguments of the command line."""
    scene = folder / "lamp.xml"
    scene.write_text(
        """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><float name="fov" value="60"/>
        <transform name="to_world"><lookat origin="0.5, 0.2, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate y="1" angle="180"/>
        <translate z="3"/></transform>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
        <shape type="rectangle" id="floor"><transform name="to_world"><scale value="4"/></transform>
        <bsdf type="twosided"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
        <transform name="to_uv"><scale value="4"/></transform></texture></bsdf><bsdf type="diffuse"/></bsdf></shape>
        <shape type="sphere" id="ball"><float name="radius" value="0.1"/><bsdf type="principled">
        <float name="metallic" value="1"/><texture type="checkerboard" name="flatness"/></bsdf></shape>
        </scene>"""
    )
    path = folder / "path.txt"
    path.write_text("".join(f"{t} {0.5 + t} 0.2 2 1 0 0 0\n" for t in np.arange(0, 0.2, 0.01)))
    return [str(scene), "--trajectory", str(path), "--position-sigma", "0", "--rotation-sigma", "0"]


def events_of(scene: Scene, rays_per_pixel: int, seed: int) -> EventArray:
    run = Simulator(
        scene, renderer="integrator", rays_per_pixel=rays_per_pixel, seed=seed, frame_rate_hz=0, depth_rate_hz=0
    ).run()
    return np.concatenate([packet.events for packet in run])


@pytest.mark.usefixtures("llvm")
@pytest.mark.long
def test_the_estimate_is_what_whole_runs_have(of_the_box: NoiseEstimate) -> None:
    """Of some pixels it tells the share of all pixels' events that 256 samples do not have, at 8 and at 32."""
    scene, estimate = small_box(), of_the_box
    truth = events_of(scene, 256, 99)
    for rays_per_pixel in (8, 32):
        found = compare_events(events_of(scene, rays_per_pixel, 3), truth, size=SIZE)
        measured = (found.missing + found.spurious) / found.reference
        assert estimate.share_at(rays_per_pixel) == pytest.approx(measured, rel=0.25)
    assert estimate.share_at(8) > 2 * estimate.share_at(64) > 0
    assert re.search(
        r"of these events are Monte Carlo noise \(.*\) at 8 rays per pixel; with 64 about \d+ %$",
        str(estimate),
    )
    assert estimate_noise(scene, renderer="integrator") == estimate  # nothing but the scene and the seed decides
    assert estimate.rays < 1_300_000


@pytest.mark.usefixtures("llvm", "few_seeds")
def test_the_measuring_of_noise_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each rendering is counted, of as many as there are: it may take minutes."""
    told: list[str] = []
    monkeypatch.setattr(monte_carlo_noise, "doing", told.append)
    estimate_noise(plain_box(), renderer="integrator")
    count = len(told)
    assert count >= 12
    assert told == [f"measuring noise, {done} of {count} renderings" for done in range(count)]


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_more_light_paths_have_less_noise_by_their_root(of_the_box: NoiseEstimate) -> None:
    """Log luma's noise is told in C, and halves with four times the samples."""
    many = estimate_noise(small_box(), renderer="integrator", rays_per_pixel=32)
    assert many is not None
    assert of_the_box.log_noise / many.log_noise == pytest.approx(2, rel=0.15)
    assert of_the_box.log_noise > 0.3


def test_samples_for_a_share() -> None:
    """The fewest of the list that keep it, never fewer than there are, and 1024 where none does."""
    estimate = NoiseEstimate(8, measured=((8.0, 0.8), (32.0, 0.4), (128.0, 0.2)))
    assert [estimate.share_at(n) for n in (8, 16, 512, 2)] == pytest.approx([0.8, 0.8 / 2**0.5, 0.1, 1.6])
    assert estimate.rays_per_pixel_for(0.9) == 8
    assert estimate.rays_per_pixel_for(0.4) == 34
    assert estimate.rays_per_pixel_for(0.1) == 610
    assert estimate.rays_per_pixel_for(0.01) == 1024
    silent = NoiseEstimate(13, noisy=False)
    assert (silent.share_at(1), silent.rays_per_pixel_for(1e-9)) == (0.0, 13)
    unknown = NoiseEstimate(13)
    assert math.isnan(unknown.share_at(8))
    assert unknown.rays_per_pixel_for(0.05) == 13
    assert "too few events" in str(unknown)


@pytest.mark.usefixtures("llvm")
def test_no_noise_is_not_told_as_noise(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The native renderer has none; an integrator that draws nothing neither. Auto takes the default and says why."""
    planes = load_scene("three_planes").crop(0.0, 0.02)
    assert estimate_noise(planes) is None
    direct = estimate_noise(planes, renderer="integrator")
    assert direct is not None
    assert not direct.noisy
    simulate_to_folder(planes, tmp_path / "planes", rays_per_pixel="auto", depth_rate_hz=0)
    said = capsys.readouterr().err
    assert "rays_per_pixel auto: 32, the default: the native renderer draws nothing at random" in said
    meta = json.loads((tmp_path / "planes" / "meta.json").read_text())
    assert meta["parameters"]["rays_per_pixel"] == 32
    assert meta["monte_carlo_noise"] is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(planes, renderer="integrator", rays_per_pixel=1)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_a_run_says_how_much_of_it_is_noise(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """One line before a run into a folder, a warning before one in Python or a quiet one; not where it may be so."""
    scene = plain_box().crop(0.0, 0.1)
    options = {"frame_rate_hz": 0.0, "depth_rate_hz": 0.0, "renderer": "integrator", "noise_share": 0.01}
    simulate_to_folder(scene, tmp_path / "told", **options)  # type: ignore[arg-type]
    lines = capsys.readouterr().err.splitlines()
    told = [line for line in lines if "of these events are Monte Carlo noise" in line]
    assert len(told) == 1
    assert told[0].endswith("with rays_per_pixel auto as many are taken as keep it below 1 %")
    share = json.loads((tmp_path / "told" / "meta.json").read_text())["monte_carlo_noise"]["share"]
    assert f"{100 * share:.0f} missing or spurious" in told[0] or f"about {100 * share:.2g} %" in told[0]
    with pytest.warns(NoiseWarning, match=re.escape(told[0])):
        simulate(scene, renderer="integrator", noise_share=0.01)
    with pytest.warns(NoiseWarning, match="Monte Carlo noise"):
        simulate_to_folder(scene, tmp_path / "quiet", quiet=True, **options)  # type: ignore[arg-type]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(scene, renderer="integrator", noise_share=1.0)


@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_noise_is_measured_before_the_one_simulator_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where samples are chosen, too: a second simulator would load effects of the user's own twice."""
    scene = plain_box()
    estimate = estimate_noise(scene, renderer="integrator")
    assert estimate is not None
    made: list[str] = []
    setting_up, measuring = Simulator._set_up, estimate_noise_of

    def set_up(*given: Any) -> None:
        made.append("simulator")
        setting_up(*given)

    def measured(*given: Any, **named: Any) -> Any:
        made.append("noise")
        return measuring(*given, **named)

    monkeypatch.setattr(Simulator, "_set_up", set_up)
    monkeypatch.setattr("davis_rs.simulation.simulate.estimate_noise_of", measured)
    settings = {
        "renderer": "integrator",
        "accuracy": "paper",
        "rays_per_pixel": "auto",
        "noise_share": estimate.share_at(20),
    }
    simulator = make_simulator(scene, complete(SimulationSettings, settings, taker="a test")).simulator
    assert simulator.renderer.rays_per_pixel == 21
    assert made == ["noise", "simulator"]


@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
@pytest.mark.long
def test_auto_takes_as_many_samples_as_the_share_needs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """And the run is the same as with that number given."""
    scene = plain_box()
    estimate = estimate_noise(scene, renderer="integrator")
    assert estimate is not None
    share = estimate.share_at(20)
    # Auto takes no fewer than the preset does, which are 8 here.
    options = {"frame_rate_hz": 0.0, "depth_rate_hz": 0.0, "renderer": "integrator", "accuracy": "paper"}
    simulate_to_folder(scene, tmp_path / "auto", rays_per_pixel="auto", noise_share=share, **options)  # type: ignore[arg-type]
    said = capsys.readouterr().err
    assert "rays_per_pixel auto: 21; about" in said
    meta = json.loads((tmp_path / "auto" / "meta.json").read_text())
    assert meta["parameters"]["rays_per_pixel"] == meta["monte_carlo_noise"]["rays_per_pixel"] == 21
    assert meta["monte_carlo_noise"]["share"] < share
    simulate_to_folder(scene, tmp_path / "given", rays_per_pixel=21, **options)  # type: ignore[arg-type]
    events = [(tmp_path / name / "events.txt").read_bytes() for name in ("auto", "given")]
    assert events[0] == events[1] != b""
    with pytest.raises(ValueError, match="rays_per_pixel='auto' must be resolved before a simulator is made"):
        Simulator(scene, rays_per_pixel="auto")


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_plan_says_it_too(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """`davis-rs plan` of a scene that the integrator renders ends with the line; a plan of sequences takes auto."""
    assert main(["plan", *noisy_room(tmp_path), "--effect", "leak_rate_hz=0.1"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"of these events are Monte Carlo noise \(.*\) at 8 rays per pixel; with 64 about", out)
    plan = tmp_path / "plan.yaml"
    plan.write_text("scene: three_planes\nduration: 0.02\nrays_per_pixel: auto\nnoise_share: 0.1\nmatte: true\n")
    drawn = load_sequence_plan(plan).parameters(0)
    assert (drawn["rays_per_pixel"], drawn["noise_share"], drawn["matte"]) == ("auto", 0.1, True)
    plan.write_text("scene: three_planes\nduration: 0.02\nrays_per_pixel: many\n")
    with pytest.raises(ValueError, match="rays_per_pixel: must be an integer"):
        load_sequence_plan(plan)


def test_samples_are_a_number_or_auto(capsys: pytest.CaptureFixture[str]) -> None:
    """Anything else is refused by its rule, in Python and on the command line."""
    for wrong in ("many", 0, 1025, 2.5):
        with pytest.raises(ValueError, match=r"rays_per_pixel must be"):
            Simulator(load_scene("three_planes"), rays_per_pixel=wrong)  # type: ignore[arg-type]
    with pytest.raises(SystemExit):
        main(["simulate", "three_planes", "-o", "x", "--rays-per-pixel", "lots"])
    assert "must be an integer, or auto, got 'lots'" in capsys.readouterr().err


OBSTACLES = """\
what keeps the renderers without noise from this scene:
- shape 'floor' has two different sides: give both the same diffuse material
- shape 'ball' has a principled surface, not a diffuse one: --matte (matte=True) takes its diffuse colour alone, or \
set its flatness to 0, or give it a diffuse material
the ways on:
- mend what is listed: then no event is noise
"""


@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_a_run_that_would_be_mostly_noise_is_refused(tmp_path: Path) -> None:
    """Before it renders, with all obstacles and the ways on, one of which is to accept it; then all who look say so."""
    out = tmp_path / "out"
    run = ["simulate", *noisy_room(tmp_path), "-o", out, "--depth-rate", 0, "--rays-per-pixel", 2, "--duration", 0.05]
    refused = davis_rs(*run)
    assert refused.returncode == 2
    assert not out.exists()
    told = refused.stderr.partition("davis-rs: error: ")[2]
    assert re.match(
        r"about \d\d % of the events would be Monte Carlo noise \(.*\) at 2 rays per pixel; above 20 %", told
    )
    first, _, ways = told.partition(OBSTACLES)
    assert len(first.splitlines()) == 1
    auto, accept = ways.splitlines()
    assert re.fullmatch(
        r"- --rays-per-pixel auto: with \d+ rays per pixel about \S+ % are noise.* and the run takes about \d+ \w+",
        auto,
    )
    assert re.fullmatch(r"- --accept-noise: as it is, the run takes about \d+ \w+", accept)

    accepted = davis_rs(*run, "--accept-noise", "--quiet")
    assert accepted.returncode == 0, accepted.stderr
    assert "warning" in accepted.stderr
    share = json.loads((out / "meta.json").read_text())["monte_carlo_noise"]["share"]
    assert share > 0.2
    noise = f"{share_text(share, 'the events are')}"
    assert f"noise       {noise}\n" in davis_rs("info", out, "--quiet").stdout
    assert davis_rs("check", out).stdout.splitlines()[-2:] == [
        f"{noise}; rendered luma has it too, so that the check cannot see it",
        "the check holds, noise included",
    ]
    assert open_visual_sequence(out).label.endswith(f"sensor 32 x 24, ideal, {percent(share)} Monte Carlo noise")


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_a_plan_says_whether_noise_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of it is refused before anything is written, in the words of plans; accepting changes no sequence."""
    noisy_room(tmp_path)
    plan = tmp_path / "plan.yaml"
    path = "motion: {kind: file, file: path.txt, position_sigma_m: 0, rotation_sigma_rad: 0}"
    text = f"scene: lamp.xml\n{path}\nrays_per_pixel: 2\nduration: 0.05\ndepth_rate: 0\n"
    plan.write_text(text)
    refused = davis_rs("generate", plan, "-o", tmp_path / "root", "--quiet")
    assert refused.returncode == 2
    assert OBSTACLES in refused.stderr
    assert "- rays_per_pixel: auto: with" in refused.stderr
    assert "- accept_noise: true: as it is, the run takes about" in refused.stderr
    assert not (tmp_path / "root" / "plan.json").exists()
    [sequence] = draw_sequences(load_sequence_plan(plan))
    with pytest.raises(NoiseError, match="accept_noise: true"):
        make_sequence(sequence, tmp_path, threads=1)

    plan.write_text(text + "accept_noise: true\n")
    accepting = load_sequence_plan(plan)
    [accepted] = draw_sequences(accepting)
    assert accepting.sha256 == sequence.plan_sha256
    assert accepted.parameters == sequence.parameters
    assert make_sequence(accepted, tmp_path, threads=1)["events"] > 0
    plan.write_text(text + "accept_noise: 0.5\n")
    with pytest.raises(ValueError, match=r"accept_noise: must be true or false, got 0\.5"):
        load_sequence_plan(plan)

    # A first sequence that cannot be made for another reason is no reason not to make the others.
    monkeypatch.setattr(generate, "_outcomes", lambda *_: (one for one in list[Any]()))
    plan.write_text(text + "renderer: native\n")
    assert generate.generate_sequences(load_sequence_plan(plan), tmp_path / "other", quiet=True).made == 0


def test_what_is_refused_and_how_long_the_ways_on_take() -> None:
    """More than 20 % or than noise_share; the times follow from the rays of the run and the time of one."""
    parts = {"type": "scene", "integrator": {"type": "direct"}, "floor": {"type": "rectangle"}}
    floor = Scene("floor", lambda: dict(parts), camera=Camera(8, 6, 8.0, 8.0, 3.5, 2.5))
    estimate = NoiseEstimate(8, measured=((8.0, 0.46), (256.0, 0.16)), run_rays=10**8, ray_s=1e-6)
    assert estimate.run_s(16) == 2 * estimate.run_s(8) == pytest.approx(200)

    def refusal(noise: NoiseEstimate | None = estimate, **settings: Any) -> str:
        given = complete(FolderSettings, {"renderer": "integrator", **settings}, taker="the test")
        with pytest.raises(NoiseError) as refused:
            refuse_noise(noise, floor, given)
        return str(refused.value)

    assert refusal().splitlines() == [
        "about 46 % of the events would be Monte Carlo noise (missing or spurious) at 8 rays per pixel; above 20 % "
        "nothing is rendered",
        "what keeps the renderers without noise from this scene:",
        "- Mitsuba's integrators were asked for: give --renderer auto",
        "the ways on:",
        "- mend what is listed: then no event is noise",
        "- --rays-per-pixel auto: with 1024 rays per pixel about 8 % are noise and the run takes about 4 hours",
        "- --accept-noise: as it is, the run takes about 2 minutes",
    ]
    assert "with 377 rays per pixel about 13 % are noise and the run takes about 80 minutes" in refusal(
        noise_share=0.14
    )
    assert "--rays-per-pixel" not in refusal(replace(estimate, measured=((8.0, 9.0),)), rays_per_pixel="auto")
    worse = refusal(replace(estimate, measured=((8.0, 9.0),)))
    assert worse.startswith("most of the events would be Monte Carlo noise (900 missing or spurious to 100 right ones)")
    assert "with 1024 rays per pixel about 80 % are noise, still above the limit, and the run takes" in worse

    for noise, settings in (
        (None, {}),
        (NoiseEstimate(8, noisy=False), {}),
        (NoiseEstimate(8), {}),  # too few events to tell
        (replace(estimate, measured=((8.0, 0.2),)), {}),
        (estimate, {"noise_share": 0.5}),
        (estimate, {"rays_per_pixel": "auto"}),
    ):
        refuse_noise(noise, floor, complete(FolderSettings, settings, taker="the test"))


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.usefixtures("few_seeds")
def test_the_frames_of_the_run_follow_from_its_sampling(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fixed rate has as many as it says; the adaptive rule about two for each of its intervals."""
    monkeypatch.setattr(monte_carlo_noise, "FEWEST_RAYS", 10_000)
    scene = plain_box().crop(0.0, 0.1)
    renderer = make_renderer(scene, scene.own_camera, kind="integrator", rays_per_pixel=2)

    def frames(sampling: TimeSampling | None) -> float:
        noise = estimate_noise_of(
            renderer,
            scene.path,
            contrast_threshold=0.15,
            contrast_threshold_off=0.15,
            log_eps=1e-3,
            sampling=sampling,
            cost_share=0.0,
        )
        assert noise is not None
        assert noise.run_s(2) > 0
        return noise.run_rays / (2 * 32 * 24)

    assert frames(FixedRate(5000.0)) == pytest.approx(500)
    plain = frames(None)
    assert frames(Tolerance(0.5, pixels=1 / 2, longest=1 / 2)) == pytest.approx(plain * 4 / 3, rel=1e-3)
    assert frames(MaxDisplacement(1 / 3, hermite=True)) == pytest.approx(2 * plain, rel=1e-3)
