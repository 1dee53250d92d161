"""What autodoc shows, made readable: constants by their own words, arrays as ``NDArray``, no base class ``object``."""

from __future__ import annotations

import inspect
import re
import sys
from types import ModuleType
from typing import Any, get_type_hints

import numpy.typing as npt
from docutils import nodes
from public_names import PACKAGE
from sphinx.addnodes import desc_content
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.inspect import signature as signature_of
from sphinx.util.inspect import stringify_signature
from sphinx.util.typing import stringify_annotation

ARRAY = re.compile(r"(~?)numpy\.ndarray\[tuple\[[^\]]*\], ~?numpy\.dtype\[([^\[\]]*)\]\]")
LONG = {
    "ArrayLike": stringify_annotation(npt.ArrayLike, "smart", short_literals=True),
}
"""What autodoc writes for NumPy's unions."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("autodoc-skip-member", skip_alias)
    app.connect("autodoc-process-docstring", of_constant, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", without_type, priority=450)
    app.connect("autodoc-before-process-signature", evaluated)
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
    last = name.rpartition(".")[2]
    texts = (
        ModuleAnalyzer.for_module(module.__name__).find_attr_docs().get(("", last))
        for module in modules()
        if vars(module).get(last) is value
    )
    lines[:] = next((text for text in texts if text), [])


def modules() -> list[ModuleType]:
    """Those of the package that are imported, as far as they are Python."""
    return [
        module
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] == PACKAGE and (getattr(module, "__file__", None) or "").endswith(".py")
    ]


def without_type(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Napoleon would read "The ids of shapes: ..." of a property as a type and a text; types stand in the code here."""
    if what in ("attribute", "property", "data") and lines:
        lines.insert(0, "\\")  # an escaped end of line, which shows nothing


class AsWritten:
    """A default that Python does not print as an expression, by its name in the module."""

    def __init__(self, value: Any, names: dict[str, Any]) -> None:
        self._name = next((name for name, one in names.items() if one is value), "...")

    def __repr__(self) -> str:
        return self._name


def evaluated(app: Sphinx, there: Any, bound_method: bool) -> None:
    """Annotations that are still text, with the names of the module that has them; defaults as they are written."""
    if not inspect.isfunction(there):
        return
    if there.__name__ == "__new__":  # of a named tuple: its annotations do not know their module
        for value in (value for module in modules() for value in vars(module).values()):
            if isinstance(value, type) and hasattr(value, "_fields") and value.__new__ is there:
                there.__annotations__ = get_type_hints(value)
        return
    names = vars(sys.modules[there.__module__])
    signature = inspect.signature(there)
    parameters = [
        one.replace(annotation=value_of(one.annotation, names), default=shown_default(one.default, names))
        for one in signature.parameters.values()
    ]
    if hasattr(there, "__signature__") or any(isinstance(one.default, AsWritten) for one in parameters):
        returned = value_of(signature.return_annotation, names)
        there.__signature__ = signature.replace(parameters=parameters, return_annotation=returned)  # type: ignore[attr-defined]


def value_of(annotation: Any, names: dict[str, Any]) -> Any:
    """An annotation's value, or the annotation where the module imports names for type checkers alone."""
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, names)
    except NameError:
        return annotation


def shown_default(value: Any, names: dict[str, Any]) -> Any:
    """The default, or its name if it prints as no expression."""
    if value is inspect.Parameter.empty:
        return value
    try:
        compile(repr(value), "default", "eval")
    except SyntaxError:
        return AsWritten(value, names)
    return value


def short_arrays(
    app: Sphinx, what: str, name: str, value: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """``numpy.ndarray[tuple[Any, ...], numpy.dtype[numpy.float32]]`` is ``NDArray[float32]``."""
    if what == "class" and any("__sphinx_mock__" in vars(base) for base in inspect.getmro(value)):
        # autodoc takes that of the stand-in for a base class of a library that is not there
        own = signature_of(value.__init__, bound_method=True)
        signature = stringify_signature(own, show_return_annotation=False, unqualified_typehints=True)
    return shorter(signature), shorter(returned)


def shorter(text: str | None) -> str | None:
    """The same with ``NDArray`` and ``ArrayLike`` in place of what these stand for."""
    if text is None:
        return None
    for name, long in LONG.items():
        text = text.replace(long, f"~numpy.typing.{name}")
    return ARRAY.sub(r"~numpy.typing.NDArray[\2]", text)


def without_object(app: Sphinx, doctree: nodes.document) -> None:
    """Every class derives from ``object``."""
    for content in doctree.findall(desc_content):
        for child in list(content.children):
            if isinstance(child, nodes.paragraph) and child.astext() == "Bases: object":
                content.remove(child)
