"""What autodoc shows, made readable: constants by their own words, arrays as ``NDArray``, no base class ``object``."""

from __future__ import annotations

import re
import sys
from typing import Any

from docutils import nodes
from sphinx.addnodes import desc_content
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

from public_names import PACKAGE, look_up

ARRAY = re.compile(r"(~?)numpy\.ndarray\[tuple\[[^\]]*\], ~?numpy\.dtype\[([^\[\]]*)\]\]")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("autodoc-skip-member", skip_alias)
    app.connect("autodoc-process-docstring", of_constant, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", without_type, priority=450)
    app.connect("autodoc-process-signature", short_arrays)
    app.connect("doctree-read", without_object)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def skip_alias(app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any) -> bool | None:
    """Fields of named tuples: their docstring is "Alias for field number 0", and the class has described them."""
    return True if type(member).__name__ == "_tuplegetter" else None


def of_constant(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """A constant's docstring is that of its type; what is meant is the text below its assignment, wherever that is."""
    if what != "data":
        return
    found = look_up(name)
    last = name.rpartition(".")[2]
    for module_name, module in list(sys.modules.items()):
        if module_name.startswith(PACKAGE) and vars(module).get(last) is value and found and getattr(module, "__file__", ""):
            if not module.__file__.endswith(".py"):
                continue
            text = ModuleAnalyzer.for_module(module_name).find_attr_docs().get(("", last))
            if text:
                lines[:] = text
                return
    lines[:] = []


def without_type(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Napoleon would read "The ids of shapes: ..." of a property as a type and a text; types stand in the code here."""
    if what in ("attribute", "property", "data") and lines:
        lines.insert(0, "\\")  # an escaped end of line, which shows nothing


def short_arrays(app: Sphinx, what: str, name: str, value: Any, options: Any, signature: str | None, returned: str | None) -> Any:
    """``numpy.ndarray[tuple[Any, ...], numpy.dtype[numpy.float32]]`` is ``NDArray[float32]``."""
    return tuple(text and ARRAY.sub(r"~numpy.typing.NDArray[\2]", text) for text in (signature, returned))


def without_object(app: Sphinx, doctree: nodes.document) -> None:
    """Every class derives from ``object``."""
    for content in doctree.findall(desc_content):
        for child in list(content.children):
            if isinstance(child, nodes.paragraph) and child.astext() == "Bases: object":
                content.remove(child)
