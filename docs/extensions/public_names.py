"""References to names of the package, by whichever of their names a docstring or an annotation has.

``davis_rs.Scene`` is ``davis_rs.scene.scene.Scene``, and in that module just ``Scene``. The reference has it once, by
the name that users import. This extension finds that name for all the others.
"""

from __future__ import annotations

import inspect
import re
from functools import cache
from importlib import import_module
from typing import Any

from docutils.nodes import Element
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

PACKAGE = "davis_rs"
ROLE = re.compile(r":(class|func|meth|data|attr|exc|mod):`([^`]+)`")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", absolute_roles, priority=300)
    app.connect("missing-reference", PublicNames().resolve)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def absolute_roles(app: Sphinx, what: str, name: str, there: Any, options: Any, lines: list[str]) -> None:
    """Names in a docstring's roles, from the module that the docstring is in: only there they are what is meant."""
    home = getattr(inspect.unwrap(there) if callable(there) else getattr(there, "fget", there), "__module__", None)
    if not isinstance(home, str) or not home.startswith(PACKAGE):
        return

    def absolute(found: re.Match[str]) -> str:
        role, target = found[1], found[2]
        full = f"{home}{target}" if target.startswith(".") else f"{home}.{target}"
        if "<" in target or target.startswith((PACKAGE, "~")) or look_up(full) is None:
            return found[0]
        shown = f"{target.lstrip('.')}()" if role in ("func", "meth") else target.lstrip(".")
        return f":{role}:`{shown} <{full}>`"

    lines[:] = [ROLE.sub(absolute, line) for line in lines]


class PublicNames:
    """Which name the reference has for an object."""

    def __init__(self) -> None:
        self._names: dict[int, str] = {}

    def resolve(self, app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: Element) -> Element | None:
        """The place in the reference that a role or an annotation means, if there is one."""
        if node.get("refdomain") != "py":
            return None
        domain = env.domains.python_domain
        if not self._names:
            self._names = {
                id(found[0]): name
                for name, entry in domain.objects.items()
                if not entry.aliased and (found := look_up(name)) and not found[1]
            }
        for full in self._candidates(node):
            if full in domain.objects:
                return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, shown)
        return None

    def _candidates(self, node: pending_xref) -> list[str]:
        """Names under which the reference may have it."""
        target = node["reftarget"].lstrip(".")
        names = []
        for scope in scopes(node):
            found = look_up(".".join(part for part in (scope, target) if part))
            if found is not None:
                for one in inspect.getmro(found[0]) if inspect.isclass(found[0]) else [found[0]]:
                    if id(one) in self._names:
                        names.append(".".join([self._names[id(one)], *found[1]]))
        return names


def scopes(node: pending_xref) -> list[str]:
    """Where a short name may stand: as it is, in its class, in the module that defines what the docstring is of."""
    module, of_class = node.get("py:module") or "", node.get("py:class") or ""
    inner = f"{module}.{of_class}" if of_class else module
    found = look_up(inner)
    home = getattr(found[0], "__module__", "") if found else ""
    return ["", inner, home, module, PACKAGE]


@cache  # a name that is not there takes long, because the package searches for close ones
def look_up(dotted: str) -> tuple[Any, list[str]] | None:
    """A module or what it has, and names of what that has in turn; None if there is no such thing in the package."""
    parts = dotted.split(".")
    if parts[0] != PACKAGE:
        return None
    there: Any = import_module(PACKAGE)
    for place, part in enumerate(parts[1:], 1):
        module = ".".join(parts[: place + 1])
        try:
            there = import_module(module)
        except ImportError:
            there = getattr(there, part, None)
            return None if there is None or is_plain(there) else (there, parts[place + 1 :])
    return there, []


def is_plain(value: Any) -> bool:
    """Whether a value is one of those that Python shares between names."""
    return isinstance(value, bool | int | float | str | bytes)
