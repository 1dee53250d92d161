"""The documents keep their promises: every code block and every command of README.md and docs/ is run.

A command that no longer parses fails here, as does a Python block that no longer runs. Commands that take long are
shortened by options, and what cannot run in a test is named with its reason in the tables below, and still parsed. What
README.md shows runs in every run of the tests; what the other documents show is parsed, and runs with ``--long``.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from settings_tables import settings_markdown

from clips import moving_bars, write_images, write_video
from davis_rs import load_sensor
from davis_rs._mitsuba.variants import variant
from davis_rs.cli.main import COMMANDS, main, make_parser
from davis_rs.cli.parser import Parser
from davis_rs.generate import load_sequence_plan
from places import ROOT

EXAMPLES = ROOT / "examples"
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
DOCUMENTS.remove(
    ROOT / "docs" / "own_scene.md"
)  # one story, which tests/project/test_own_scene_page.py runs from top to end

SHORT_RUN = "--duration 0.05 --rays-per-pixel 1"  # long enough for two frames, which davis-rs check needs
SHORTENED = {
    "sequences": "slider_depth",
    "simulate": SHORT_RUN,
    "sequence": "--start 1 --duration 0.1 --rays-per-pixel 1",  # at its start the camera rests
    "record": "--duration 0.02",
    "plan": "--duration 0.02",
    "frames": "--stop 0.11",  # of a clip of four frames, a tenth of a second apart
}
"""What is added to a command to make it short, by its name."""

RUN_INSTEAD = {
    "davis-rs simulate three_walls -o walls": "davis-rs simulate three_walls -o walls "
    "--start 0.6 --duration 0.02 --rays-per-pixel 1",
    "davis-rs view walls --time 0.6": "davis-rs view walls --time 0.01",
    "davis-rs view walls --html out.html --time 0.6": "davis-rs view DIR --html out.html --time 0.01",
    "davis-rs view DIR --html span.html --whole --time 1.5": "davis-rs view DIR --html span.html --whole --time 0.01",
    "davis-rs simulate checkerboard -o DIR --imu mpu6150 --frame-rate 20 --depth-rate 0": "davis-rs simulate "
    "checkerboard -o DIR --imu mpu6150 --frame-rate 10 --depth-rate 0 --duration 2 --max-displacement 8 "
    "--rays-per-pixel 1 --contrast-threshold 1",
    "davis-rs simulate checkerboard --rig pair.yaml -o PAIR --frame-rate 20 --depth-rate 0 --duration 6 "
    "--accuracy fast": (
        "davis-rs simulate checkerboard --rig pair.yaml -o PAIR --frame-rate 20 --depth-rate 0 --duration 2 "
        "--accuracy fast --contrast-threshold 1"
    ),
    "davis-rs simulate dynamic_6dof -o DIR --start 45 --duration 0.1 --flow-rate 20 --mask-rate 20 --normal-rate 20": (
        "davis-rs simulate dynamic_6dof -o DIR --start 45 --duration 0.01 --size 120x90 --flow-rate 20 --mask-rate 20 "
        "--normal-rate 20 --rays-per-pixel 1"
    ),
    "davis-rs frames clip.mp4 -o DIR --start 0.1 --stop 0.3": "davis-rs frames clip.mp4 -o DIR --start 0.1 --stop 0.3",
    "davis-rs generate example.yaml -o data --quiet": "davis-rs generate PLAN.yaml -o data --quiet",
}
"""Commands that are shortened in another way, and what is run in their place."""

NOT_RUN = {
    "davis-rs view DIR --rerun out.rrd": "needs Rerun's SDK; tests/inspection/test_view_rerun.py runs it where it is",
    "davis-rs view DIR --rerun": "starts a viewer",
    "davis-rs generate PLAN.yaml -o ROOT --cluster tcp://HOST:8786": "needs a Dask scheduler",
    "davis-rs simulate varnished.xml --trajectory slide.txt --size 64x48 -o DIR": "is refused; "
    "tests/rendering/test_monte_carlo_noise.py refuses such scenes",
    "davis-rs devices": "needs libusb, and tells what is plugged in",
    "davis-rs simulate mesh.obj -o DIR": "needs a mesh; tests/project/test_own_scene_page.py makes one",
    "davis-rs info data": "needs the folder of the lines before it; tests/inspection/test_plan_folder.py runs it",
    "davis-rs view data/sequence_00000": "the same",
    "davis-rs record -o FILE": "needs a camera",
    "davis-rs accuracy SCENE -o COSTS": "its reference takes a minute; tests/accuracy/test_accuracy.py runs small ones",
    "davis-rs accuracy SCENE -o DIR": "the same",
    "davis-rs accuracy three_planes --frames -o three_planes": "takes minutes",
    "davis-rs accuracy three_walls --frames -o three_walls": "takes minutes",
    "davis-rs accuracy slider_depth --frames -o slider_depth --duration 0.1334": "takes minutes",
    "davis-rs accuracy SCENE --frames -o DIR": "takes minutes; tests/accuracy/test_frame_rates.py runs a small one",
    "davis-rs accuracy SCENE -o DIR --light 4": "takes minutes; tests/rendering/test_baked_light.py runs a small one",
    "davis-rs hard-cases -o DIR": "takes minutes; tests/accuracy/test_hard_cases.py runs some of them",
    "davis-rs hard-cases -o docs": "the same",
    "davis-rs reproduce RECORDING -o DIR": "needs a recording with frames; tests/reproduction runs it",
    "davis-rs reproduce davis346_sample.aedat4 -o DIR --fit both": "needs the recording that it names",
    "davis-rs simulate slider_close --sensor one_ms.yaml --frame-rate 40 -o slider": "needs the sensor file that its "
    "sentence describes, and takes minutes; tests/sensors/test_sensor_fit.py fits others",
    "davis-rs calibrate sensor slider --lux 134 --base one_ms.yaml -o fitted.yaml": "the same",
    "davis-rs calibrate KIND DIR": "needs a checkerboard's dataset; docs/calibration.md's lines are run",
    "davis-rs calibrate rig DIR": "needs the folder of a rig; docs/calibration.md's lines are run",
    "davis-rs calibrate intrinsics | hand-eye | camera-imu | rig DIR": "the same",
}
"""Commands that are parsed and not run, and why."""

NOT_RUN_PYTHON = {
    "dask_jobqueue": "needs a SLURM cluster",
    "davis_rs.Davis.open": "needs a camera",
}
"""Python blocks with this in them are compiled and their names of davis_rs looked up; why they are not run."""

OPTIONAL = ("torch", "tonic")
"""Libraries that the tests' extra does not bring; blocks with one of them run where it is installed."""

OWN_INTERPRETER = "__main__"
"""Python blocks with this in them are programs of their own: they start workers."""

LONG_PLAN, SHORTER_PLAN = "sequences: 1000", "sequences: 3"
"""What becomes of a plan of many sequences, of which all are drawn."""

SHORTER_SCENE = ('load_scene("three_planes")', 'load_scene("three_planes").crop(0, 0.1)')
"""What becomes of the scene where a block plans effects for all of it."""

LONG = (
    'simulate(scene, effects="auto")',
    "DifferentiableRenderer(make_scene(), camera, rays_per_pixel=1024)",
    'print(generate_sequences(plan, "ROOT"))',
    "davis-rs simulate three_planes --rig stereo-davis346",
    "davis-rs calibrate sensor FILE",
    "--effects auto --effect aps=500",
    "--sensor davis346 --fit pad",
    "davis-rs generate PLAN.yaml",
)
"""Blocks with one of these in them take long, and what they show is tested elsewhere in less time: --long runs them."""

PLACEHOLDERS = {
    "SCENE": "three_planes",
    "NAME": "shapes_rotation",
    "KIND": "intrinsics",
    "IN": "IN.aedat4",
    "OUT": "OUT.txt",
    "REAL": "FILE",
    "RECORDING": "FILE",
    "SIMULATED": "DIR",
}
"""Words in capitals that a user replaces; DIR, PATH, IN, FILE and PLAN.yaml are files of the test (``folder``)."""

PROGRAMS = ("davis-rs", "python", "python3", "pip", "pytest", "cargo", "git")

OPTIONS_OF_OTHERS = {"--picture-only", "--target", "--first", "--mutants", "--seed", "--shared"}
"""Options in running text that are of other programs."""


@dataclass(frozen=True)
class Snippet:
    """A piece of code of a document: ``kind`` is a fence's language, ``indented`` or ``inline``."""

    where: str
    kind: str
    text: str

    @property
    def commands(self) -> list[str]:
        """Commands, without their prompts, comments and what is said of them."""
        return [one for one in self._lines() if not one.startswith("--")]

    @property
    def with_options(self) -> list[str]:
        """Options that have a line of their own below a command, each with that command."""
        found, command = [], ""
        for line in self._lines():
            if line.startswith("--"):
                found.append(f"{command} {line}")
            else:
                command = line
        return found

    def _lines(self) -> list[str]:
        if self.kind not in ("indented", "inline"):
            return []
        lines = [" ".join(self.text.split())] if self.kind == "inline" else self.text.splitlines()
        code = [re.split(r"\s{2,}|\s#\s", line.strip().removeprefix("$ "), maxsplit=1)[0] for line in lines]
        code = [one for line in code for one in line.split(" && ")]
        return [one for one in code if one.partition(" ")[0] in PROGRAMS or one.startswith("--")]


def snippets() -> Iterator[Snippet]:
    """All of them: fenced blocks, indented blocks, and inline code that begins with a program's name."""
    for document in DOCUMENTS:
        name, text = document.relative_to(ROOT), document.read_text()
        blocks = r"^```(?P<kind>\w*)\n(?P<fenced>.*?)^```$|(?<=\n\n)(?P<indented>(?: {4}[^\n]*\n|\n(?= {4}))+)"
        rest = text
        for found in re.finditer(blocks, text, re.S | re.M):
            where = f"{name}:{text.count(chr(10), 0, found.start()) + 1}"
            yield Snippet(where, found["kind"] or "indented", found["fenced"] or found["indented"])
            rest = rest.replace(found[0], re.sub(r"[^\n]", "", found[0]), 1)
        for found in re.finditer(r"`([^`]+)`", rest):
            if found[1].partition(" ")[0] in PROGRAMS:
                where = f"{name}:{rest.count(chr(10), 0, found.start()) + 1}"
                yield Snippet(where, "inline", found[1])


ALL = list(snippets())
IN_BLOCKS = {command for one in ALL if one.kind != "inline" for command in one.commands}
PYTHON = [one for one in ALL if one.kind in ("python", "py")]
YAML = [one for one in ALL if one.kind == "yaml" and not one.where.startswith("docs/sensor.md")]
SENSOR_FILES = [one for one in ALL if one.kind == "yaml" and one not in YAML]


def with_commands() -> list[Snippet]:
    """Blocks with commands of ours, and inline ones that stand nowhere else; a command's mere name is no command."""
    known, kept = set(IN_BLOCKS), []
    for one in ALL:
        ours = [command for command in one.commands if command.startswith("davis-rs ")]
        if one.kind == "inline":
            ours = [command for command in ours if command not in known and len(command.split()) > 2]
            known.update(ours)
        if ours:
            kept.append(one)
    return kept


@pytest.fixture(scope="session")
def example_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the documents' commands read, each under the name that stands for it there."""
    folder = tmp_path_factory.mktemp("example")
    assert main(["simulate", "three_planes", "-o", str(folder / "DIR"), *SHORT_RUN.split(), "--quiet"]) == 0
    shutil.copytree(folder / "DIR", folder / "PATH")
    assert main(["convert", str(folder / "DIR"), str(folder / "IN.aedat4"), "--quiet"]) == 0
    assert main(["record", "--virtual", "three_planes", "-o", str(folder / "FILE"), "--duration", "0.02"]) == 0
    bars, stamps_ms = 96 + moving_bars(4, 360, 270) // 4, [100 * k for k in range(4)]
    write_video(folder / "clip.mp4", bars, stamps_ms, codec="libx264", pixel_format="yuv420p")
    write_images(folder / "images", bars)
    (folder / "times.txt").write_text("".join(f"{t / 1000:.3f}\n" for t in stamps_ms))
    np.save(folder / "stack.npy", bars)
    np.save(folder / "times.npy", np.array(stamps_ms) / 1000)
    (folder / "PLAN.yaml").write_text("scene: three_planes\nduration: 0.02\naccuracy: fast\n")
    (folder / "example.yaml").write_text(YAML[0].text)
    shown = next(one.text for one in ALL if "$ cat pair.yaml" in one.text)
    (folder / "pair.yaml").write_text(textwrap.dedent(shown).partition("\n")[2].partition("\n$ ")[0])
    (folder / "my_effects.py").write_text(next(one.text for one in PYTHON if "class Crosstalk" in one.text))
    return folder


@pytest.fixture
def folder(example_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of its own with those files."""
    shutil.copytree(example_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # main replaces it
    return tmp_path


def words_of(command: str) -> list[str]:
    """The arguments of davis-rs, placeholders replaced, without the file that the shell writes (``> FILE``)."""
    return [PLACEHOLDERS.get(word, word) for word in shlex.split(command.partition(" > ")[0])[1:]]


def alternatives(command: str) -> list[str]:
    """``a b | c d`` stands for ``a b d`` and ``a c d``."""
    found = re.search(r"(\S+)((?: \| \S+)+)", command)
    if found is None:
        return [command]
    choices = [found[1], *found[2].removeprefix(" | ").split(" | ")]
    return [command.replace(found[0], choice) for choice in choices]


def marked(some: list[Snippet]) -> Any:
    """The snippets as parameters, with the place that each stands at; most are long."""

    def is_long(one: Snippet) -> bool:
        return not one.where.startswith("README.md") or any(text in one.text for text in LONG)

    return [pytest.param(one, id=one.where, marks=[pytest.mark.long] if is_long(one) else []) for one in some]


@pytest.mark.parametrize("snippet", with_commands(), ids=lambda one: one.where)
def test_commands_parse(snippet: Snippet) -> None:
    """Each command and each option that has a line of its own is one that there is; help is printed."""
    for command in (one for one in snippet.commands if one.startswith("davis-rs ")):
        if "--help" in command:
            with pytest.raises(SystemExit, match="0"):
                main(words_of(command))
            continue
        for one in alternatives(command):
            make_parser().parse_args(words_of(one))
    for command in snippet.with_options:
        make_parser().parse_args(words_of(command))


@pytest.mark.parametrize("snippet", marked(with_commands()))
def test_commands_run(snippet: Snippet, folder: Path) -> None:
    """One after the other in one folder; what a command writes to is removed first: lines are often alternatives."""
    for command in (one for one in snippet.commands if one.startswith("davis-rs ")):
        if "--help" not in command and command not in NOT_RUN:
            words = words_of(RUN_INSTEAD.get(command, f"{command} {SHORTENED.get(command.split()[1], '')}"))
            if "-o" in words:
                make_way(folder / words[words.index("-o") + 1])
            with ExitStack() as stack:
                if " > " in command:
                    written = (folder / command.partition(" > ")[2]).open("w")
                    stack.enter_context(redirect_stdout(stack.enter_context(written)))
                assert main(words) == 0, command


def make_way(output: Path) -> None:
    """Remove what is there, and make the folder that it lies in."""
    output.parent.mkdir(exist_ok=True)
    if output.is_dir():
        shutil.rmtree(output)
    else:
        output.unlink(missing_ok=True)


def test_the_tables_name_commands_of_the_documents() -> None:
    """An exception whose command no document has any more goes."""
    commands = {command for one in ALL for command in one.commands}
    assert commands >= {*RUN_INSTEAD, *NOT_RUN}
    assert COMMANDS.keys() >= SHORTENED.keys()
    assert all(any(mark in one.text for one in PYTHON) for mark in NOT_RUN_PYTHON)


def test_blocks_are_of_a_kind_that_is_tested() -> None:
    """Python, YAML, or lines of commands; what a command prints follows one with a prompt."""
    for one in ALL:
        assert one.kind in ("python", "yaml", "indented", "inline"), f"{one.where}: a block of {one.kind}"
        if one.kind == "indented" and "$ " not in one.text:
            lines = [line for line in one.text.splitlines() if line.strip()]
            assert len(one.commands) + len(one.with_options) >= len(lines), f"{one.where}: not all lines are commands"


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    """All options of a parser and of its commands."""
    if isinstance(parser, Parser):
        parser.fill()
    found = {option for action in parser._actions for option in action.option_strings}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found.update(option for command in action.choices.values() for option in options_of(command))
    return found


def test_commands_and_options_that_are_named_exist() -> None:
    """``davis-rs NAME`` and ``--option`` in running text."""
    options = options_of(make_parser()) | OPTIONS_OF_OTHERS
    for document in DOCUMENTS:
        text = document.read_text()
        for name in re.findall(r"`davis-rs (\S+?)[ `\n]", text):
            assert name in COMMANDS, f"{document.name}: davis-rs {name}"
        for code in re.findall(r"`(--[^`]+)`", text):
            assert set(re.findall(r"(?<!\S)--[\w-]+", code)) <= options, f"{document.name}: {code}"


def test_other_commands_name_what_there_is() -> None:
    """Scripts, tests, benches and extras; they run elsewhere, or install packages."""
    cargo, project = (ROOT / "Cargo.toml").read_text(), (ROOT / "pyproject.toml").read_text()
    for one in ALL:
        for command in one.commands:
            for option, file in re.findall(r"(\S+) (\S+\.py)\b", command):
                own = option == "--custom-effect"  # a file of the reader's own
                assert own or (ROOT / file).is_file(), f"{one.where}: {command}"
            for bench in re.findall(r"--bench (\w+)", command):
                assert f'name = "{bench}"' in cargo, f"{one.where}: {command}"
            for extra in re.findall(r"\[(\w+)\]'", command):
                assert f"\n{extra} = [" in project, f"{one.where}: {command}"


@pytest.mark.parametrize("snippet", PYTHON, ids=lambda one: one.where)
def test_python_blocks_name_what_there_is(snippet: Snippet) -> None:
    """Each block is Python, and what it takes from this package is there."""
    tree = ast.parse(snippet.text, snippet.where)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("davis_rs"):
            module = import_module(node.module or "")
            assert all(hasattr(module, name.name) for name in node.names), snippet.where
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "davis_rs":
            assert hasattr(import_module("davis_rs"), node.attr), f"{snippet.where}: davis_rs.{node.attr}"


@pytest.mark.parametrize("snippet", marked(PYTHON))
def test_python_blocks_run_by_themselves(
    snippet: Snippet, folder: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each block runs with its own imports alone, in its own interpreter where needed. The folder has a PLAN.yaml."""
    for library in OPTIONAL:
        if library in snippet.text:
            pytest.importorskip(library)
    if any(mark in snippet.text for mark in NOT_RUN_PYTHON):
        return
    if OWN_INTERPRETER not in snippet.text:
        text = snippet.text.replace(*SHORTER_SCENE) if "sensor=" in snippet.text else snippet.text
        with ExitStack() as stack:
            if "llvm_ad_rgb" in text:  # which it sets for all
                stack.enter_context(variant(request.getfixturevalue("llvm")))
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("always", UserWarning)
            monkeypatch.syspath_prepend(EXAMPLES)
            out = stack.enter_context(redirect_stdout(StringIO()))
            exec(compile(text, snippet.where, "exec"), {"__name__": "__main__"})
        check_output(snippet, out.getvalue())
        return
    (folder / "block.py").write_text(snippet.text)
    path = os.pathsep.join([str(EXAMPLES), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-W", "error::DeprecationWarning:__main__", "block.py"]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, f"{snippet.where}\n{done.stdout}\n{done.stderr}"
    check_output(snippet, done.stdout)


def check_output(snippet: Snippet, printed: str) -> None:
    """README's first block prints a line a frame; docs/differentiable.md says what the error is about."""
    if snippet.where.startswith("README.md") and "duration_s=0.1" in snippet.text:
        assert [line.split()[0] for line in printed.splitlines()] == ["0", "25000", "50000", "75000", "100000"]
    if "error of the frame" in snippet.text:
        found = re.fullmatch(r"error of the frame: ([\d.]+); without edges ([\d.]+)\n", printed)
        assert found is not None
        assert float(found[1]) < 0.02
        assert 0.4 < float(found[2]) < 0.6


@pytest.mark.parametrize("snippet", YAML, ids=lambda one: one.where)
def test_plans_are_plans(snippet: Snippet, folder: Path) -> None:
    """A whole plan is one; the lines of other blocks are alternatives, and each a part of one."""
    texts = [snippet.text] if "scene:" in snippet.text else snippet.text.splitlines()
    (folder / "groundtruth.txt").write_bytes((folder / "DIR" / "groundtruth.txt").read_bytes())
    for text in texts:
        (folder / "plan.yaml").write_text(
            text.replace(LONG_PLAN, SHORTER_PLAN)
            if "scene:" in text
            else f"scene: three_planes\nduration: 0.02\n{text}\n"
        )
        load_sequence_plan("plan.yaml")
        assert main(["generate", "plan.yaml", "--dry-run"]) == 0


@pytest.mark.parametrize("snippet", SENSOR_FILES, ids=lambda one: one.where)
def test_sensor_files_are_sensors(snippet: Snippet, folder: Path) -> None:
    """Each block of docs/sensor.md that is YAML."""
    (folder / "mine.yaml").write_text(snippet.text)
    assert load_sensor("mine.yaml") != load_sensor("ideal")


def test_the_plan_draws_what_is_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """docs/generate.md shows the draws of its plan."""
    shown = next(one.text for one in ALL if "$ davis-rs generate example.yaml --dry-run" in one.text)
    assert main(["generate", "example.yaml", "--dry-run"]) == 0
    printed = capsys.readouterr().out.splitlines()
    block = [line.removeprefix("    ").rstrip() for line in shown.splitlines()]
    assert block[1 : 1 + len(printed)] == [line.rstrip() for line in printed]


def test_the_table_of_settings_is_what_the_command_prints() -> None:
    """docs/settings.md ends with it. tests/scenes/test_sequences.py compares the table of sequences."""
    assert (ROOT / "docs/settings.md").read_text().endswith(f"\n{settings_markdown()}\n")


def test_links_and_pictures_lead_somewhere() -> None:
    for document in DOCUMENTS:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
