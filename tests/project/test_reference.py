"""The reference of the site (docs/reference) has every public name on exactly one page. Sphinx is not needed."""

from __future__ import annotations

import ast
import inspect
import re
from collections import defaultdict
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import davis_rs

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "reference").glob("*.rst"))
PUBLIC = (
    "calibrate",
    "differentiable",
    "simulation.planning",
    "sensor.effects",
    "generate",
    "gym",
    "render.truth",
    "sensor.imu",
    "sensor.motion_capture",
    "events.represent",
    "scene.sequences",
    "inspection.statistics",
    "reproduction",
    "data.torch",
    "geometry.trajectory.motions",
)
"""Modules that users import names from, next to the package itself."""


def documented() -> dict[str, list[str]]:
    """The pages of each name that has a directive of autodoc of its own."""
    found = defaultdict(list)
    for page in PAGES:
        for name in re.findall(r"^\.\. auto(?:class|data|exception|function|module):: (\S+)$", page.read_text(), re.M):
            found[name].append(page.name)
    return found


DOCUMENTED = documented()


def public_names(module: str) -> list[str]:
    """A module's ``__all__``, or the functions that it defines; read, not imported: it may need an extra."""
    path = ROOT / "python" / "davis_rs" / Path(*module.split("."))
    tree = ast.parse((path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text())
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [str(name) for name in ast.literal_eval(node.value)]
    return [node.name for node in tree.body if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]


def test_every_name_of_the_package_is_on_one_page() -> None:
    """A module is documented by the name that it is imported by."""
    for public in davis_rs.__all__:
        there = getattr(davis_rs, public)
        name = there.__name__ if inspect.ismodule(there) else f"davis_rs.{public}"
        assert len(DOCUMENTED[name]) == 1, f"{name}: {DOCUMENTED[name]}"


@pytest.mark.parametrize("module", PUBLIC)
def test_every_name_of_a_public_module_is_on_one_page(module: str) -> None:
    """Those that the package itself has are documented as the package's."""
    names = [name for name in public_names(module) if name not in davis_rs.__all__]
    for name in (f"davis_rs.{module}.{name}" for name in names):
        assert len(DOCUMENTED[name]) == 1, f"{name}: {DOCUMENTED[name]}"


def test_nothing_is_documented_twice_under_two_names() -> None:
    """An object that two modules have is one thing; the reference has it by the name that users import."""
    names: dict[int, str] = {}
    for name, pages in DOCUMENTED.items():
        assert len(pages) <= 1, f"{name}: {pages}"
        if not name.startswith("davis_rs.data.torch"):
            there = look_up(name)
            if not isinstance(there, str):  # a text may be shared by names that have nothing to do with each other
                assert id(there) not in names, f"{name} is {names[id(there)]}"
                names[id(there)] = name


def look_up(name: str) -> Any:
    """What a page documents: a module, or what a module has."""
    module, _, last = name.rpartition(".")
    if not module:
        return import_module(name)
    there = getattr(import_module(module), last, None)
    return there if there is not None else import_module(name)
