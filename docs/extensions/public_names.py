"""References to names of the package, by whichever of their names a docstring or an annotation has.

``davis_rs.Scene`` is ``davis_rs.scene.scene.Scene``, and in that module just ``Scene``. The reference has it once, under
the name that users import. This extension finds that name for all the others.
"""

from __future__ import annotations

import inspect
from importlib import import_module
from typing import Any

from docutils.nodes import Element
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

PACKAGE = "davis_rs"


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("missing-reference", PublicNames().resolve)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


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
            self._names = {id(found[0]): name for name in domain.objects if (found := look_up(name)) and not found[1]}
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
