"""The command line, run as a user runs it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from command_line import SMALL, davis_rs
from command_line import in_own_process as run
from davis_rs import Dataset, Scene, __version__, load_scene, start_pose
from davis_rs.cli.common import on_path
from davis_rs.simulation.model_version import MODEL
from gltf_files import Gltf
from places import SHARED

pytestmark = pytest.mark.without_llvm


def simulate(*arguments: object) -> subprocess.CompletedProcess[str]:
    return davis_rs("simulate", *arguments, *SMALL)


@pytest.mark.long
def test_simulate_check_and_view(tmp_path: Path) -> None:
    """The main job: a dataset that its own check accepts, and that a second run repeats byte for byte."""
    out, again = tmp_path / "out", tmp_path / "again"
    short = ("three_planes", "--duration", 0.1, "--rays-per-pixel", 1)
    done = run("simulate", *short, "-o", out, "--threads", 1)
    assert done.returncode == 0, done.stderr
    assert " events in 0.1 s (" in done.stdout
    assert "rendering with" in done.stderr
    checked = davis_rs("check", out)
    assert checked.returncode == 0, checked.stdout
    assert "the check holds" in checked.stdout
    viewed = davis_rs("view", out, "-o", tmp_path / "view.png")
    assert viewed.returncode == 0, viewed.stderr
    assert (tmp_path / "view.png").stat().st_size > 50_000

    quiet = davis_rs("simulate", *short, "-o", again, "--threads", 2, "--quiet")
    # Without any LLVM Dr.Jit itself says so on stderr when it is imported.
    own = [line for line in quiet.stderr.splitlines() if not line.startswith("jit")]
    assert (quiet.returncode, own) == (0, [])
    names = ["events.txt", "images.txt", "depthmaps.txt", "groundtruth.txt", "calib.txt", "images/frame_00000004.png"]
    for name in names:
        assert (out / name).read_bytes() == (again / name).read_bytes(), name
    meta = json.loads((out / "meta.json").read_text())
    assert meta["complete"] is True
    assert meta["parameters"]["contrast_threshold"] == 0.15
    assert meta["model"] == MODEL
    dataset = Dataset(out)
    assert [frame.t_us for frame in dataset.frames] == [0, 25_000, 50_000, 75_000, 100_000]
    assert list(dataset.groundtruth.t_us) == list(range(0, 100_001, 5_000))


def test_a_folder_that_exists_is_kept(tmp_path: Path) -> None:
    """Yesterday's dataset is not overwritten by a repeated command; --overwrite does it."""
    out = tmp_path / "out"
    assert simulate("three_planes", "-o", out, "--duration", 0.01).returncode == 0
    before = (out / "events.txt").read_bytes()
    refused = simulate("three_planes", "-o", out, "--duration", 0.02)
    assert refused.returncode == 1
    assert "davis-rs: error:" in refused.stderr
    assert "--overwrite" in refused.stderr
    assert (out / "events.txt").read_bytes() == before
    assert simulate("three_planes", "-o", out, "--duration", 0.02, "--overwrite").returncode == 0
    assert len((out / "events.txt").read_bytes()) > len(before)


@pytest.mark.parametrize(
    ("threshold", "line"),
    [
        (15, "the contrast threshold 15 is above the whole range of the image, which is 6.91 in log intensity, "),
        (6, "0 events in 0.01 s: the contrast threshold is 6 in log intensity, and all frames together span "),
    ],
)
def test_a_run_without_events_says_why(tmp_path: Path, threshold: float, line: str) -> None:
    done = simulate("three_planes", "-o", tmp_path / "out", "--duration", 0.01, "--contrast-threshold", threshold)
    assert ": 0 events in 0.01 s (" in done.stdout
    assert [f"davis-rs: warning: {line}" in one for one in done.stderr.splitlines()].count(True) == 1
    assert done.stderr.count("warning") == 1


@pytest.mark.long
def test_two_runs_into_one_folder_do_not_mix(tmp_path: Path) -> None:
    """The second is refused while the first one writes, --overwrite or not; the first one's dataset is whole."""
    out = tmp_path / "out"
    arguments = ["simulate", "three_planes", "-o", out, "--overwrite", *SMALL, "--duration"]
    command = [sys.executable, "-m", "davis_rs.cli", *map(str, arguments)]
    with subprocess.Popen([*command, "0.5"], stderr=subprocess.DEVNULL) as first:
        while not (out / "events.txt").exists():
            assert first.poll() is None
            time.sleep(0.002)
        first.send_signal(signal.SIGSTOP)  # so that it still writes, however fast it is
        try:
            second = davis_rs(*arguments, 0.1)
        finally:
            first.send_signal(signal.SIGCONT)
        assert first.wait(300) == 0
    assert second.returncode == 1
    assert f"{out}: another program is writing into it" in second.stderr
    assert json.loads((out / "meta.json").read_text())["duration_us"] == 500_000
    assert davis_rs("check", out).returncode == 0


def test_bad_input_leaves_the_old_dataset_alone(tmp_path: Path) -> None:
    """With --overwrite too, what is there goes only once the new run is known to work."""
    out = tmp_path / "out"
    assert simulate("three_planes", "-o", out, "--duration", 0.01).returncode == 0
    before = (out / "events.txt").read_bytes()
    path = tmp_path / "path.txt"
    path.write_text("0.0 0 0 0 0 0 0 1\n0.005 0 0 0 0 0 0 2\n")
    failed = simulate("three_planes", "-o", out, "--overwrite", "--trajectory", path)
    assert failed.returncode == 1
    assert f"{path}, line 2" in failed.stderr
    assert "Traceback" not in failed.stderr
    away = simulate("three_planes", "-o", out, "--overwrite", "--trajectory", still_path(tmp_path), "--no-align")
    assert away.returncode == 1
    assert "no ray hits anything" in away.stderr
    assert (out / "events.txt").read_bytes() == before


def still_path(folder: Path) -> Path:
    """A trajectory that stays at the origin, which looks up into the sky of three_planes, and shakes."""
    path = folder / "still.txt"
    path.write_text("".join(f"{k * 0.005:.3f} {0.001 * (k % 3)} 0 5 0 0 0 1\n" for k in range(40)))
    return path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["no_such_scene"],
            "fence, checkerboard, a sequence of the dataset, nor a file (Mitsuba XML, glTF, OBJ or PLY)",
        ),
        (["three_planes", "--camera", "no_such_camera"], "neither a preset"),
        (["three_planes", "--trajectory", "no_such_file"], "no_such_file"),
        (["three_planes", "--duration", "5"], "runs from 0 to 2 s"),
        (["three_planes", "--start", "-1"], "--start must be finite and >= 0, got -1.0"),
    ],
)
def test_errors_are_one_sentence(tmp_path: Path, arguments: list[str], message: str) -> None:
    """No traceback, no folder left behind."""
    failed = simulate(*arguments, "-o", tmp_path / "out")
    assert failed.returncode == 1
    assert message in failed.stderr
    assert "Traceback" not in failed.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--contrast-threshold", "-1"], "argument --contrast-threshold: must be > 0, got -1.0"),
        (["--contrast-threshold", "low"], "argument --contrast-threshold: must be a number, got 'low'"),
        (["--render-rate", "0"], "argument --render-rate: must be > 0 and <= 1000000 Hz, got 0.0"),
        (["--max-displacement", "nan"], "argument --max-displacement: must be finite, got nan"),
        (
            ["--sensor", "davis24"],
            "must be one of ideal, davis240c, davis346, recorded, or a file (.yaml, .yml, .json), got 'davis24'; "
            "did you mean davis240c?",
        ),
        (["--rays-per-pixel", "1.5"], "argument --rays-per-pixel: must be an integer, or auto, got '1.5'"),
        (["--no-such-option"], "unrecognized arguments: --no-such-option"),
        (
            ["--duratoin=1"],
            "unrecognized arguments: --duratoin=1; did you mean --duration? (see davis-rs simulate --help)",
        ),
    ],
)
def test_errors_of_options_are_one_line_that_names_the_option(
    tmp_path: Path, arguments: list[str], message: str
) -> None:
    """Without the usage of forty options; the exit status is the one that is usual for them."""
    failed = simulate("three_planes", *arguments, "-o", tmp_path / "out")
    assert failed.returncode == 2
    assert message in failed.stderr
    assert len(failed.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_path_that_cannot_be_written(tmp_path: Path) -> None:
    """A folder under a file can be made by nobody, root included."""
    (tmp_path / "file").write_text("")
    failed = simulate("three_planes", "-o", tmp_path / "file" / "out", "--duration", 0.01)
    assert failed.returncode == 1
    assert str(tmp_path / "file") in failed.stderr


@pytest.mark.parametrize(("number", "name"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")])
def test_a_signal_leaves_a_valid_shorter_dataset(tmp_path: Path, number: signal.Signals, name: str) -> None:
    """What was simulated until then is whole: it passes the check. The line says which signal it was."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "davis_rs.cli", "simulate", "three_planes", "-o", str(out), *map(str, SMALL)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not (out / "images" / "frame_00000002.png").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 130, stderr
    assert f"cut short by {name}" in stdout
    meta = json.loads((out / "meta.json").read_text())
    assert (meta["complete"], meta["interrupted"]) == (False, True)
    assert 25_000 <= meta["duration_us"] < 2_000_000
    checked = davis_rs("check", out)
    assert checked.returncode == 0, checked.stdout


def test_a_camera_file_and_a_trajectory_file(tmp_path: Path) -> None:
    """A hand-held path in a built-in scene is moved to where the scene's camera starts, and keeps its own motion. The
    file's clock begins elsewhere: the dataset begins at 0, and its clock is told."""
    (tmp_path / "calib.txt").write_text("150.0 155.0 118.0 91.0 -0.3 0.1 0.001 -0.0005 0.0\n")
    t = np.arange(41) * 0.005
    rows = np.stack([1000 + t, 0.3 * np.sin(4 * t), 7 + 0.1 * t, 0 * t, 0 * t, 0 * t, 0 * t, 1 + 0 * t], 1)
    np.savetxt(tmp_path / "path.txt", rows, fmt="%.9f")
    out = tmp_path / "out"
    done = davis_rs(
        "simulate", "three_planes", "-o", out, "--trajectory", tmp_path / "path.txt",
        "--camera", tmp_path / "calib.txt", "--start", 0.05, "--duration", 0.1, "--rays-per-pixel", 1,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    away_m = np.linalg.norm([0.3 * np.sin(0.2), 7.005, 0] - start_pose(load_scene("three_planes")).position)
    assert f"path.txt: moved by {away_m:.3g} m and turned by " in done.stderr
    assert "path.txt: positions and rotations taken as they are" in done.stderr
    assert done.stderr.count("t = 0") == 1
    assert "t = 0 is 1000.05 s on the clock of the camera path\n" in done.stderr
    assert json.loads((out / "meta.json").read_text())["start_time_ns"] == 1_000_050_000_000
    assert "clock       t = 0 is 1000.05 s on the clock of the input\n" in davis_rs("info", out).stdout
    dataset = Dataset(out)
    assert dataset.camera.fy == 155.0
    start = start_pose(load_scene("three_planes"))
    np.testing.assert_allclose(dataset.groundtruth.positions[0], start.position, atol=1e-9)
    moved = np.linalg.norm(dataset.groundtruth.positions - dataset.groundtruth.positions[0], axis=1)
    expected = np.hypot(0.3 * (np.sin(4 * (t[10:31])) - np.sin(0.2)), 0.1 * (t[10:31] - 0.05))
    np.testing.assert_allclose(moved, expected, atol=1e-4)
    assert davis_rs("check", out).returncode == 0


@pytest.mark.parametrize("with_camera", [False, True])
def test_a_path_for_a_file_stays_where_it_is(tmp_path: Path, with_camera: bool) -> None:
    """The file's camera, or the path around that it gets without one, moves no other path; --align does."""
    square = Gltf()
    square.node(mesh=square.mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]]))
    if with_camera:
        lens = square.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}})
        square.node(camera=lens, translation=[0, 0, 4])
    scene = square.save(tmp_path / "square.glb")
    path = tmp_path / "path.txt"
    path.write_text("".join(f"{0.01 * k:.2f} {0.01 * k} -5 0 {-(0.5**0.5)} 0 0 {0.5**0.5}\n" for k in range(9)))
    given = (scene, "--trajectory", path, "--position-sigma", 0, "--rotation-sigma", 0, "--duration", 0.01)
    out = tmp_path / "out"
    done = simulate(*given, "-o", out)
    assert done.returncode == 0, done.stderr
    assert "moved by" not in done.stderr
    np.testing.assert_allclose(Dataset(out).groundtruth.positions[0], [0, -5, 0], atol=1e-6)
    aligned = simulate(*given, "-o", tmp_path / "aligned", "--align")
    assert "path.txt: moved by " in aligned.stderr
    start = start_pose(load_scene(scene))
    np.testing.assert_allclose(Dataset(tmp_path / "aligned").groundtruth.positions[0], start.position, atol=1e-6)


@pytest.mark.skipif(not (SHARED / "data" / "poster_6dof.csv").exists(), reason="needs the recorded trajectory")
def test_a_real_hand_held_trajectory(tmp_path: Path) -> None:
    """Motion capture with its jitter and gaps: gaps are told of, the check holds."""
    out = tmp_path / "out"
    path = SHARED / "data" / "poster_6dof.csv"
    done = simulate("three_planes", "-o", out, "--trajectory", path, "--start", 44.3, "--duration", 0.1)
    assert done.returncode == 0, done.stderr
    assert "bridged" in done.stderr
    assert davis_rs("check", out).returncode == 0


NOWHERE = "/nonexistent/libLLVM.so"
BALL = """<scene version="3.0.0"><integrator type="direct"/>
<emitter type="point"><point name="position" x="0" y="-1" z="-3"/></emitter><shape type="sphere">
<bsdf type="principled"><float name="clearcoat" value="0.3"/></bsdf></shape>
<sensor type="perspective">
<transform name="to_world"><lookat origin="0,0,-3" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film></sensor></scene>"""


@pytest.mark.long
def test_without_llvm_the_native_renderer_does_it(tmp_path: Path) -> None:
    """README's first command renders with all of its rays, asks for nothing to be installed; the dataset is whole."""
    out = tmp_path / "out"
    shown = ("--duration", 0.01, "--frame-rate", 200, "--size", "60x45")
    done = run("simulate", "three_planes", "-o", out, *shown, DRJIT_LIBLLVM_PATH=NOWHERE)
    assert done.returncode == 0, done.stderr
    assert "rendering with native renderer" in done.stderr
    assert "install" not in done.stderr
    assert json.loads((out / "meta.json").read_text())["parameters"]["rays_per_pixel"] == 32
    checked = davis_rs("check", out)
    assert checked.returncode == 0, checked.stdout


@pytest.mark.long
def test_without_llvm_what_needs_mitsuba_is_slow_and_says_so(tmp_path: Path) -> None:
    """For brushed metal, one sentence says how to get the fast variant."""
    scene, out = tmp_path / "ball.xml", tmp_path / "out"
    scene.write_text(BALL)
    still = tmp_path / "still.txt"
    still.write_text("0.0 0 0 -3 0 0 0 1\n0.01 0.01 0 -3 0 0 0 1\n0.02 0.02 0 -3 0 0 0 1\n0.03 0.03 0 -3 0 0 0 1\n")
    done = run("simulate", scene, "-o", out, "--trajectory", still, "--rays-per-pixel", 1, DRJIT_LIBLLVM_PATH=NOWHERE)
    assert done.returncode == 0, done.stderr
    assert "scalar variant" in done.stderr
    assert "apt-get install libllvm19" in done.stderr


def test_the_version_is_told() -> None:
    assert run("--version").stdout.strip() == f"davis-rs {__version__}"


def test_of_a_path_that_a_file_does_not_have_two_seconds_are_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Unless a duration or another path is given, or less is left; it is told."""
    (tmp_path / "plate.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n")
    scene = load_scene(tmp_path / "plate.obj")

    def taken_s(scene: Scene, start_s: float = 0.0, duration_s: float | None = None) -> tuple[float, str]:
        options = Namespace(trajectory=None, align=None, start_s=start_s, duration_s=duration_s)
        return on_path(options, scene).path.duration_s, capsys.readouterr().err

    assert taken_s(scene) == (2.0, "2 s of its path are taken (--duration 10: to its end)\n")
    assert taken_s(scene, 3.5) == (2.0, "2 s of its path are taken (--duration 6.5: to its end)\n")
    assert taken_s(scene, 9.0) == (1.0, "")
    assert taken_s(scene, 0.0, 7.0) == (7.0, "")
    assert taken_s(scene.with_trajectory(scene.path)) == (10.0, "")
