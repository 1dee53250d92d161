"""What the command line says when something is wrong, and that it is quick to start."""

from __future__ import annotations

import argparse
import inspect
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import davis_rs as package
from command_line import SMALL, davis_rs
from command_line import in_own_process as run
from davis_rs.cli.main import COMMANDS, main
from davis_rs.cli.parser import Parser
from davis_rs.io.formats.registry import written_formats

HEAVY = ("scipy", "mitsuba", "drjit", "PIL", "matplotlib", "tqdm", "OpenEXR", "yaml", "usb")


def modules_after(program: str) -> set[str]:
    """First names of the modules that a program leaves imported, and the package's own in full."""
    told = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport sys\nprint(*sys.modules)"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    ).stdout.split()
    return {name if name.startswith("davis_rs") else name.split(".")[0] for name in told}


def test_importing_the_package_imports_next_to_nothing() -> None:
    """`import davis_rs` takes no longer than NumPy: what it offers is imported when it is asked for."""
    assert {name for name in modules_after("import davis_rs") if name.startswith("davis_rs")} == {"davis_rs"}
    assert not modules_after("import davis_rs") & {"numpy", *HEAVY}
    everything = "import davis_rs\nfor name in davis_rs.__all__: getattr(davis_rs, name)"
    assert not modules_after(everything) & set(HEAVY)


def test_no_module_has_the_name_of_a_function() -> None:
    """An import of such a module would put it in the function's place."""
    modules = {path.stem for path in Path(package.__file__).parent.glob("*.py")}
    functions = {name for name in package.__all__ if callable(getattr(package, name))}
    assert not modules & functions


def test_building_the_parser_imports_no_command() -> None:
    """Neither does `davis-rs --help`: a command is imported when it is called."""
    found = modules_after("from davis_rs.cli.main import make_parser\nmake_parser().format_help()")
    assert not found & {"numpy", *HEAVY}
    assert {name for name in found if name.startswith("davis_rs.")} == {
        "davis_rs.cli",
        "davis_rs.cli.ctrl_c",
        "davis_rs.cli.main",
        "davis_rs.cli.parser",
        "davis_rs._util",
        "davis_rs._util.argument_error",
        "davis_rs._util.close_names",
        "davis_rs._util.names_elsewhere",
        "davis_rs._util.progress",
        "davis_rs._util.quantities",
        "davis_rs._util.terminal_text",
    }


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With --debug; and none needs a heavy library to say what it takes."""
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    told = capsys.readouterr().out
    assert told.startswith(f"usage: davis-rs {command}")
    assert "--debug" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulat", "three_planes"], "there is no such command: simulat; did you mean simulate?"),
        (["generat"], "there is no such command: generat; did you mean generate? (see davis-rs --help)"),
        (["calibrate", "zoom"], "zoom; there are sensor, intrinsics, hand-eye, camera-imu, rig"),
        (["simulate", "three_planes"], "the following arguments are required: -o/--output"),
        (["simulate", "three_planes", "-o", "x", "--sensor", "DAVIS240"], "did you mean davis240c?"),
        (["simulate", "three_planes", "-o", "x", "--duration", "long"], "invalid float value: 'long'"),
        (["calibrate", "intrinsic", "x"], "did you mean intrinsics?"),
        (["simulate", "three_planes", "-o", "x", "--size", "0x5"], "--size: must lie in 1..65535 pixels"),
        (["simulate", "x", "-o", "x", "--pos_thres", "0.2"], "did you mean --contrast-threshold? (pos_thres in v2e)"),
        (
            ["simulate", "x", "-o", "x", "--contrast_threshold_neg=0.2"],
            "did you mean --contrast-threshold-off? (contrast_threshold_neg in ESIM)",
        ),
        (
            ["frames", "x", "-o", "x", "--cutoff_hz", "30"],
            "--effect photoreceptor_bandwidth_hz=VALUE? (cutoff_hz in v2e)",
        ),
        (["frames", "x", "-o", "x", "--stop_time", "3"], "did you mean --stop? (stop_time in v2e)"),
        (
            ["simulate", "x", "-o", "x", "--refractory_period_ns", "30"],
            "refractory_period_us=VALUE? (refractory_period_ns in ESIM and rpg_vid2e; here in microseconds)",
        ),
        (["simulate", "x", "-o", "x", "--leak-rate", "3"], "did you mean --effect leak_rate_hz=VALUE?"),
        (["plan", "three_planes", "--size", "240"], "--size: must be WIDTHxHEIGHT in pixels"),
        (
            ["simulate", "x", "-o", "x", "--frame-rat", "10"],
            "unrecognized arguments: --frame-rat 10; did you mean --frame-rate?",
        ),
        (["--debu", "sequences"], "unrecognized arguments: --debu; did you mean --debug?"),
        (["calibrate", "sensor", "x", "--quie"], "unrecognized arguments: --quie; did you mean --quiet?"),
        (
            ["frames", "x", "-o", "x", "--roi", "100", "50", "300", "200"],
            "argument --roi: in place of the corners 100 50 300 200 give size and place, --roi 200x150+100+50 (see",
        ),
        (
            ["convert", "x", "y", "--roi", "100", "50", "300", "200"],
            "argument --roi: in place of the corners 100 50 300 200 give size and place, --roi 200x150+100+50 (see",
        ),
        (
            ["compare", "x", "y", "--quiet-region", "0", "0", "20", "10", "--quiet"],
            "--quiet-region: in place of the corners 0 0 20 10 give size and place, --quiet-region 20x10+0+0",
        ),
        (
            ["convert", "x", "y", "--roi", "9", "9", "3", "3"],
            "corners 9 9 3 3 give size and place, --roi WIDTHxHEIGHT+LEFT+TOP",
        ),
        *[
            (
                [*command, "--roi", roi],
                f"--roi: must be WIDTHxHEIGHT+LEFT+TOP in pixels, such as 346x260+100+50, got '{roi}'",
            )
            for command in (["convert", "x", "y"], ["frames", "x", "-o", "x"])
            for roi in ("200x150", "100", "200x150+100", "100,50,300,200")
        ],
        (["convert", "x", "y", "--roi", "0x150+100+50"], "--roi: must lie in 1..65535 pixels each way, got 0 x 150"),
    ],
)
def test_a_wrong_command_line_is_told_in_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the whole usage, and with the exit status of such errors."""
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith("davis-rs: error: ")
    assert message in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "text", "message"),
    [
        (
            ["simulate", "three_planes", "-o", "out", "--sensor"],
            "contrast_treshold: 0.2\n",
            "a sensor has no key 'contrast_treshold'; did you mean contrast_threshold?",
        ),
        (
            ["generate", "-o", "out"],
            "scene: fence\nlog_epps: 1\n",
            "log_epps: there is no such key; did you mean log_eps?",
        ),
        (
            ["generate", "-o", "out"],
            "scene: fence\nzzz: 1\n",
            "contrast_threshold, contrast_threshold_off, lux_per_luma",
        ),
    ],
)
def test_keys_of_a_file_have_their_own_names(
    command: list[str], text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And not those of options, which a file does not know."""
    path = tmp_path / "one.yaml"
    path.write_text(text)
    assert main([*command, str(path)]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "tree_planes", "-o", "OUT"], "did you mean three_planes?"),
        (["simulate", "poster_6dofs", "-o", "OUT"], "did you mean poster_6dof?"),
        (["sequence", "slider_dept", "-o", "OUT"], "did you mean slider_depth?"),
        (["simulate", "three_planes", "-o", "OUT", "--effect", "leak_rat_hz=1"], "did you mean leak_rate_hz?"),
        (["simulate", "three_planes", "-o", "FULL"], "full: the folder is not empty, and there is no dataset in it"),
        (["simulate", "three_planes", "-o", "FULL", "--overwrite"], "(no events.txt and meta.json): choose another"),
        (["simulate", "no_scene", "-o", "FULL", "--overwrite"], "full: the folder is not empty"),
        (["sequence", "slider_depth", "-o", "FULL"], "and meta.json): choose another"),
        (["frames", "EVENTS", "-o", "FULL"], "full: the folder is not empty, and there is no dataset in it"),
        (["info", "OUT/none.txt"], "none.txt: No such file or directory"),
        (["convert", "EVENTS", "OUT.foo", "--size", "9x9"], "is no event format (.raw, .aedat4, .npy, "),
        (["convert", "EVENTS", "OUT.foo", "--size", "9x9"], ": give --format\n"),
        (["view", "EVENTS", "--size", "9x9", "--time", "5"], "error: --time must lie in the sequence, "),
        (["view", "EVENTS", "--size", "9x9", "--window", "0"], "error: --window must be finite and > 0, got 0.0"),
        (["view", "EVENTS", "--size", "9x9", "--fps", "5"], "error: --fps means nothing for the picture: leave it out"),
        (["view", "EVENTS"], "nor does a meta.json or frame next to it: give --size WxH\n"),
        (["compare", "EVENTS", "EVENTS2", "--size", "9x9", "--start", "2", "--stop", "1"], "--start < --stop, got 2.0"),
        (
            ["simulate", "three_planes", "-o", "OUT", "--effects-tolerance", "0.1"],
            "--effects-tolerance is 0.1, but no effects are planned: it is for --effect auto",
        ),
        (
            ["simulate", "three_planes", "-o", "OUT", "--refine", "--effect", "leak_rate_hz=1"],
            "error: --refine finds the times of ideal pixels",
        ),
        (["convert", "EVENTS", "EVENTS2", "--size", "9x9"], "the file exists; --overwrite replaces it"),
        (
            ["convert", "EVENTS", "OUT.aedat4", "--size", "9x9", "--option", "compresion=lz4"],
            "no option 'compresion'; did you mean compression?; it has compression, level, start_us",
        ),
        (["convert", "EVENTS", "OUT.npy", "--size", "9x9", "--option", "level=1"], "no option 'level'; it has none"),
    ],
)
def test_errors_say_what_is_meant(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line, in the command line's own words, with what was probably meant; and nothing is written."""
    for name in ("events.txt", "events2.txt"):
        (tmp_path / name).write_text("0.000001000 1 2 1\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("precious")
    for word, place in (("FULL", "full"), ("OUT", "out"), ("EVENTS2", "events2.txt"), ("EVENTS", "events.txt")):
        arguments = [str(tmp_path / place) + a.removeprefix(word) if a.startswith(word) else a for a in arguments]
    before = sorted(tmp_path.iterdir())
    assert main(arguments) == 1
    last = capsys.readouterr().err.split("\r")[-1]
    assert message in last
    assert last.startswith("davis-rs: error: ")
    assert sorted(tmp_path.iterdir()) == before


def test_a_formats_options_are_those_that_it_takes() -> None:
    """What is listed in a message is what the writer has."""
    for format in written_formats().values():
        takes = inspect.signature(format.open_writer).parameters
        named = {name for name, one in takes.items() if one.kind is one.KEYWORD_ONLY} - {"overwrite"}
        assert named <= set(format.options)
        if not any(one.kind is one.VAR_KEYWORD for one in takes.values()):
            assert named == set(format.options)


def break_with(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    """Give the command line a command ``break`` that raises the error."""

    def broken(_: argparse.Namespace) -> int:
        raise error

    def fill(parser: argparse.ArgumentParser) -> None:
        parser.set_defaults(run=broken)

    def parser() -> Parser:
        made = Parser(prog="davis-rs")
        made.add_argument("--debug", action="store_true")
        made.add_subparsers().add_parser("break", fill=fill)
        return made

    monkeypatch.setattr(sys.modules["davis_rs.cli.main"], "make_parser", parser)


@pytest.mark.parametrize("said", ["", "8 GiB for an array"])
def test_a_lack_of_memory_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], said: str
) -> None:
    break_with(monkeypatch, MemoryError(said))
    assert main(["break"]) == 1
    told = capsys.readouterr().err
    assert told == f"davis-rs: error: there is not enough memory{said and f': {said}'}\n"


def test_an_unexpected_error_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The net under everything; --debug shows the traceback."""
    break_with(monkeypatch, RuntimeError("the drum\nis broken"))
    assert main(["break"]) == 1
    told = capsys.readouterr().err
    assert told == "davis-rs: error: unexpected RuntimeError: the drum is broken; --debug shows where\n"
    assert main(["--debug", "break"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("Traceback (most recent call last)")
    assert told.endswith("davis-rs: error: unexpected RuntimeError: the drum is broken\n")


@pytest.mark.parametrize("error", [ImportError("NumPy failed"), SystemError("returned a result")])
def test_ctrl_c_behind_another_error_is_ctrl_c(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A library that is interrupted while it is imported says that it cannot be imported."""

    def interrupted(*_: object) -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as ctrl_c:
            raise error from ctrl_c

    monkeypatch.setattr(sys.modules["davis_rs.cli.main"], "_run", interrupted)
    assert main(["sequences"]) == 130
    assert capsys.readouterr().err == "davis-rs: stopped by Ctrl-C\n"


def test_a_scene_file_without_a_camera_needs_a_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text('<scene version="3.0.0"><shape type="rectangle"/><emitter type="constant"/></scene>')
    assert main(["simulate", str(scene), "-o", str(tmp_path / "out")]) == 1
    assert "has no trajectory of its own: give --trajectory FILE" in capsys.readouterr().err


def test_a_broken_pipe_ends_it_quietly() -> None:
    """davis-rs sensors | head -1, where head is gone before there is anything to read."""
    command = [sys.executable, "-m", "davis_rs.cli", "sensors"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as told:
        assert told.read() == ""
    assert process.wait(60) == 1


def test_ctrl_c_while_an_error_is_told_prints_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["davis_rs.cli.main"], "_in_a_line", interrupted)
    assert main(["info", "none.txt"]) == 130


@pytest.mark.long
def test_ctrl_c_while_it_imports_prints_no_traceback(tmp_path: Path) -> None:
    """Wherever it comes, once our own code runs."""
    for delay_s in (0.15, 0.3, 0.6):
        command = [sys.executable, "-m", "davis_rs.cli", "simulate", "three_planes", "-o", str(tmp_path / "out")]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        ready = Path(f"/proc/{process.pid}/maps")
        while "libcrypto" not in (maps := ready.read_text()) and "_core.abi3" not in maps:
            assert process.poll() is None
            time.sleep(0.001)
        time.sleep(delay_s - 0.15)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
        assert "Traceback" not in told
        assert process.returncode in (130, -signal.SIGINT, 1)


def test_ctrl_c_in_a_finaliser_is_not_lost(run_python: Callable[..., str]) -> None:
    """Python only prints what a finaliser raises; the command must end all the same, and print nothing of it."""
    program = """
import os, signal, sys, time
from davis_rs.cli import main as cli

class Finalised:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)

def run(arguments, options):
    Finalised()
    time.sleep(30)
    return 0

main = sys.modules["davis_rs.cli.main"]
main._run = run
sys.stderr = sys.stdout
print(main.main([]))
"""
    assert run_python(program) == "davis-rs: stopped by Ctrl-C\n130\n"


@pytest.mark.long
def test_ctrl_c_while_mitsuba_is_loaded_waits_until_it_is_whole(run_python: Callable[..., str]) -> None:
    """Python aborts in a half-made extension, or when it ends."""
    program = """
import os, signal, sys
from davis_rs._mitsuba.variants import variant

class CtrlC:
    def find_spec(self, name, *_):
        if name == awaited:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, CtrlC())
for awaited in ("drjit._drjit_ext", "mitsuba.scalar_rgb"):
    try:
        with variant("scalar_rgb"):
            print("not stopped")
    except KeyboardInterrupt:
        print(awaited, sys.modules["mitsuba"].variant())
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""
    assert run_python(program).splitlines() == [
        "drjit._drjit_ext None",
        "mitsuba.scalar_rgb scalar_rgb",
        "True",
    ]


@pytest.mark.long
def test_a_signal_at_the_very_start_leaves_a_dataset_that_holds(tmp_path: Path) -> None:
    """As soon as the folder is there: the dataset has at least two frames, so that the check can be made."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "davis_rs.cli", "simulate", "three_planes", "-o", str(out), *map(str, SMALL)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not out.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.0005)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 130, stderr
    assert "cut short by Ctrl-C" in stdout
    checked = davis_rs("check", out)
    assert checked.returncode == 0, checked.stdout


SLOW_WORKERS = """
import signal, sys, time
waits = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
sys.stdout.write("imported, waits\\n" if waits else "imported\\n")  # in one write, whatever buffers it
sys.stdout.flush()
time.sleep(1.0)
from functools import partial
from davis_rs.generate.local import run_locally
def nothing(): pass
if __name__ == "__main__":
    try:
        list(run_locally(str, ["a", "b"], workers=2, begin=nothing, report=print))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.long
def test_ctrl_c_while_workers_import_prints_no_traceback(tmp_path: Path) -> None:
    """A terminal sends it to the workers too, also before they can say that they don't want it."""
    script = tmp_path / "slow.py"
    script.write_text(SLOW_WORKERS)
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    said = ""
    while said.count("imported") < 3:  # the script itself, then each worker, which imports it again
        line = process.stdout.readline()
        assert line
        said += line  # two workers may write into one line
    assert said.count("waits") == 2, "the signal has to wait in each worker until it is ready for it"
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert told == ""
    assert process.returncode == 130


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("line", "some"),
    [
        ("davis-rs sim", {"simulate"}),
        ("davis-rs simulate three_planes --contrast-threshold-", {"--contrast-threshold-off"}),
        ("davis-rs plan three_planes --sensor davis3", {"davis346"}),
        ("davis-rs calibrate hand", {"hand-eye"}),
    ],
)
def test_the_shell_completes(line: str, some: set[str], tmp_path: Path) -> None:
    """Commands, options and choices, of the very parsers that read them."""
    pytest.importorskip("argcomplete")
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "said"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    done = run(**asked)
    assert done.returncode == 0, done.stderr
    assert {word.strip() for word in (tmp_path / "said").read_text().splitlines()} == some
