"""Errors carry the names of the arguments that they are about; so each way in calls them as its users do."""

from __future__ import annotations

import argparse
import ast
import copy
import pickle
import re
import string
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import pytest

import davis_rs
from davis_rs._util.argument_error import ArgumentError, OverwriteError
from davis_rs._util.names_elsewhere import NAMES_ELSEWHERE
from davis_rs.cli.main import _as_option, make_parser
from davis_rs.cli.parser import Parser
from davis_rs.generate.sequence import as_key
from davis_rs.sensor.effects import EFFECTS
from davis_rs.simulation.settings import FolderSettings, FrameFolderSettings, settings_of
from places import ROOT

PACKAGE = ROOT / "python" / "davis_rs"
MODULES = sorted(PACKAGE.rglob("*.py"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(path.read_text())))


def raised(path: Path, *kinds: str) -> Iterator[ast.Call]:
    """The calls that make errors of these kinds, where they are raised."""
    if not any(kind in path.read_text() for kind in kinds):
        return  # to parse all files takes seconds
    for node in nodes(path):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and ast.unparse(node.exc.func) in kinds:
            yield node.exc


def text_of(node: ast.expr) -> str:
    """The literal text of a message; what is filled in is a space."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) for part in node.values)
    if isinstance(node, ast.BinOp):
        return text_of(node.left) + text_of(node.right)
    return " "


def arguments_of_commands() -> set[str]:
    """What the library calls the arguments of all commands."""

    def of(parser: argparse.ArgumentParser) -> Iterator[str]:
        if isinstance(parser, Parser):
            parser.fill()
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for one in action.choices.values():
                    yield from of(one)
            else:
                yield action.dest

    return set(of(make_parser()))


@pytest.mark.long
def test_no_message_names_an_argument_that_the_error_does_not_carry() -> None:
    """The command line could only call it by Python's name."""
    known = {*arguments_of_commands(), *settings_of(FolderSettings), *settings_of(FrameFolderSettings)}
    names = {name for name in known if "_" in name} | {"fps", "renderer", "transfer", "crop", "roi"}  # no plain words
    word = re.compile(rf"(?<![\w.'\"=-])({'|'.join(sorted(names))})(?= must| may| is |=|\W*$)")
    for path in MODULES:
        if path.parent.name == "cli":
            continue
        for call in raised(path, "ValueError", "OSError", "FileExistsError"):
            for text in map(text_of, call.args):
                found = word.search(text)
                assert found is None, f"{path.relative_to(PACKAGE)}: {text!r} names {found and found[0]}"


def test_rules_have_a_value_for_each_brace() -> None:
    """An error that is rarely raised must not be the first to fail."""

    def fields(rule: str) -> list[str]:
        parsed = [(field, spec or "") for _, field, spec, _ in string.Formatter().parse(rule) if field is not None]
        return [name for field, spec in parsed for name in (field, *fields(spec))]

    checked = 0
    for path in MODULES:
        for call in raised(path, "ArgumentError", "OverwriteError"):
            rule, *values = call.args[1:] if ast.unparse(call.func) == "OverwriteError" else call.args
            where = f"{path}: {ast.unparse(call)}"
            found = fields(text_of(rule))
            assert all(name.isidentifier() for name in found if name), where
            assert any(found), where
            assert {keyword.arg for keyword in call.keywords} <= {*found}, where
            if not any(isinstance(value, ast.Starred) for value in values):
                assert found.count("") == len(values), where
                checked += 1
    assert checked > 100


def test_an_error_tells_its_arguments_in_words_of_the_callers() -> None:
    """Values stay as they are, braces in them too; what a message asks for is written as it is given."""
    error = ArgumentError(
        "{size} must fit {!r:>6}: give {overwrite:True}, {crop:{}x{}} or {rules}", "{x}", 3, 4, rules=["a_b", "c"]
    )
    assert str(error) == "size must fit '{x}' : give overwrite=True, crop='3x4' or a_b, c".replace("'{x}' ", " '{x}'")
    assert (error.argument, error.arguments) == ("size", ("size", "overwrite", "crop", "a_b", "c"))
    written = {"size": "--size", "overwrite": "--overwrite", "crop": "--crop", "a_b": "--a-b"}
    assert error.told(partial(_as_option, written)) == (
        "--size must fit  '{x}': give --overwrite, --crop 3x4 or --a-b, c"
    )
    assert ArgumentError("{refine:False} does").told(partial(_as_option, {"refine": "--refine"})) == "--no-refine does"
    assert ArgumentError("{frame_rate_hz} and {refine:True}").told(as_key) == "frame_rate and refine: true"


@pytest.mark.parametrize(
    "error",
    [
        ArgumentError("{fps} must be > 0, got {} or {fits:{}}", "{x}", 5, fits="max_fps"),
        OverwriteError("{a}", "it is there; {overwrite:True} replaces it"),
    ],
)
def test_an_error_is_the_same_in_another_process(error: ArgumentError | OverwriteError) -> None:
    """Workers send theirs."""
    for same in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(same) is type(error)
        assert (str(same), same.arguments, same.told()) == (str(error), error.arguments, error.told())
    assert isinstance(error, ValueError | FileExistsError)


def test_names_of_other_simulators_stand_for_names_that_there_are() -> None:
    """Settings, effects, or arguments of the functions that simulate."""
    ours = {
        *EFFECTS,
        *settings_of(FolderSettings),
        *settings_of(FrameFolderSettings),
        "trajectory",
        "fps",
        "duration_s",
        "",
    }
    assert {one.ours for one in NAMES_ELSEWHERE.values()} <= ours
    assert davis_rs.ArgumentError is ArgumentError
