"""What ``help()`` shows of the Rust core: every public name has a docstring and a signature, those of its stub.

The docstrings that run are the doc comments in ``rust/src/python``. The stub ``_core.pyi`` has them once more, because
editors read stubs and nothing else of a compiled module. These tests keep the two alike.
"""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from typing import Any

import pytest

import davis_rs._core as core

STUB = Path(core.__file__).parent / "_core.pyi"

Function = ast.FunctionDef
Documented = tuple[str, Any, Function | ast.ClassDef]


def is_property(node: Function) -> bool:
    """Whether a function of the stub stands for an attribute."""
    return any(isinstance(mark, ast.Name) and mark.id == "property" for mark in node.decorator_list)


def public_names() -> list[Documented]:
    """All functions, classes, methods and attributes of the stub, with what they are at run time."""
    found: list[Documented] = []
    for node in ast.parse(STUB.read_text()).body:
        if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
            continue
        there = getattr(core, node.name)
        found.append((node.name, there, node))
        for part in node.body if isinstance(node, ast.ClassDef) else []:
            if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                found.append((f"{node.name}.{part.name}", getattr(there, part.name), part))
    return found


def stub_signature(node: Function | ast.ClassDef) -> inspect.Signature:
    """Names, kinds and defaults of the parameters, as ``inspect.signature`` gives them at run time."""
    if isinstance(node, ast.ClassDef):
        node = next(part for part in node.body if isinstance(part, ast.FunctionDef) and part.name == "__new__")
    arguments, empty = node.args, inspect.Parameter.empty

    def parameter(name: str, default: ast.expr | None, keyword: bool) -> inspect.Parameter:
        kind = inspect.Parameter.KEYWORD_ONLY if keyword else inspect.Parameter.POSITIONAL_OR_KEYWORD
        value = empty if default is None else ast.literal_eval(default)
        return inspect.Parameter(name, kind, default=value)

    plain = [argument.arg for argument in arguments.args if argument.arg != "cls"]
    defaults = [None] * (len(plain) - len(arguments.defaults)) + arguments.defaults
    of_plain = [parameter(name, default, False) for name, default in zip(plain, defaults, strict=True)]
    keywords = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    return inspect.Signature(of_plain + [parameter(one.arg, default, True) for one, default in keywords])


def run_time_signature(there: Any) -> inspect.Signature:
    """What ``inspect.signature`` tells; ``self`` may be passed by place alone, which no stub says."""
    signature = inspect.signature(there)
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    return inspect.Signature(
        [one.replace(kind=kind) if one.name == "self" else one for one in signature.parameters.values()]
    )


NAMES = public_names()
IDS = [name for name, _, _ in NAMES]
CALLABLES = [
    one
    for one in NAMES
    if one[0] != "DecodeError" and not (isinstance(one[2], ast.FunctionDef) and is_property(one[2]))
]


def test_the_stub_has_every_name() -> None:
    """Of the module, and of each class; a name without a stub would escape the tests below."""
    constants = {"RUST_SYSROOT"}  # a text, which has no docstring of its own
    there = {name for name in vars(core) if not name.startswith("_")} - constants
    assert there == {name for name in IDS if "." not in name} == set(core.__all__) - constants - {"__version__"}
    for name, cls, node in NAMES:
        if isinstance(node, ast.ClassDef) and name != "DecodeError":
            members = {f"{name}.{member}" for member in vars(cls) if not member.startswith("_")}
            assert members == {one for one in IDS if one.startswith(f"{name}.")}


@pytest.mark.parametrize(("name", "there", "node"), NAMES, ids=IDS)
def test_docstrings_are_those_of_the_stub(name: str, there: Any, node: Function | ast.ClassDef) -> None:
    """A docstring of the core is its doc comment in Rust: change both."""
    shown = inspect.getdoc(there)
    assert shown, f"{name} has no docstring: help() shows nothing"
    assert shown == ast.get_docstring(node)


@pytest.mark.parametrize(("name", "there", "node"), CALLABLES, ids=[name for name, _, _ in CALLABLES])
def test_signatures_are_those_of_the_stub(name: str, there: Any, node: Function | ast.ClassDef) -> None:
    """Names, kinds and defaults; the types are the stub's alone."""
    assert str(run_time_signature(there)) == str(stub_signature(node))


@pytest.mark.parametrize(("name", "there", "node"), CALLABLES, ids=[name for name, _, _ in CALLABLES])
def test_docstrings_name_every_parameter(name: str, there: Any, node: Function | ast.ClassDef) -> None:
    """And no other one, where they list parameters at all; those with two or more do."""
    parameters = [one for one in stub_signature(node).parameters if one != "self"]
    text = ast.get_docstring(node) or ""
    if "Args:\n" not in text:
        assert len(parameters) < 2 or all(f"``{one}``" in text for one in parameters)
        return
    block = text.split("Args:\n")[1].split("\n\n")[0]
    heads = [line.strip().split(":")[0] for line in block.split("\n") if line.startswith("    ") and line[4] != " "]
    assert [name for head in heads for name in head.split(", ")] == parameters


def test_decoder_stats_are_all_described() -> None:
    """Their names are those of the counters."""
    text = inspect.getdoc(core.Decoder.stats) or ""
    described = [line.split("``")[1] for line in text.split("\n") if line.startswith("- ``")]
    assert described == list(core.Decoder("DAVIS240C").stats)
