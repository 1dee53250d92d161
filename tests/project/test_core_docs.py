"""What ``help()`` shows of the Rust core, and what editors show, who read the stub ``_core.pyi`` instead."""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterator

import davis_rs._core as core
from places import ROOT


def callables() -> Iterator[tuple[str, list[str], str]]:
    """Functions, classes and methods of the core: name, parameters and docstring."""
    for name, value in vars(core).items():
        if name.startswith("_") or not callable(value) or name == "DecodeError":
            continue
        members = vars(value) if inspect.isclass(value) else {}
        methods = {f"{name}.{member}": getattr(value, member) for member in members if not member.startswith("_")}
        for path, function in {name: value, **methods}.items():
            if not inspect.isgetsetdescriptor(function):
                parameters = [parameter for parameter in inspect.signature(function).parameters if parameter != "self"]
                yield path, parameters, inspect.getdoc(function) or ""


def test_the_stub_is_up_to_date() -> None:
    """``.ci/stub`` makes it from the docstrings and signatures of the module, and refuses a name without docstring."""
    run = subprocess.run(
        [sys.executable, ROOT / ".ci" / "stub", "--check"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr


def test_docstrings_name_every_parameter() -> None:
    """And no other one, where they list parameters at all; those with two or more do."""
    seen = 0
    for path, parameters, text in callables():
        seen += 1
        if "Args:\n" not in text:
            assert len(parameters) < 2 or all(f"``{name}``" in text for name in parameters), path
            continue
        block = text.split("Args:\n")[1].split("\n\n")[0]
        heads = [line.strip().split(":")[0] for line in block.split("\n") if line.startswith("    ") and line[4] != " "]
        assert [name for head in heads for name in head.split(", ")] == parameters, path
    assert seen > 40


def test_decoder_stats_are_all_described() -> None:
    """Their names are those of the counters."""
    text = inspect.getdoc(core.Decoder.stats) or ""
    described = [line.split("``")[1] for line in text.split("\n") if line.startswith("- ``")]
    assert described == list(core.Decoder("DAVIS240C").stats)
