"""Holds the elements of a Mitsuba XML file, with the place of each, and writes them again.

Mitsuba reads elements and attributes alone: text between elements, comments and entities have no meaning to it.
"""

from __future__ import annotations

import copy
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from .._core import DecodeError
from .._util.budget import Budget
from .._util.untrusted import read_charged

DEEPEST = 100
"""How deep elements may be nested; Mitsuba's own scenes have less than ten levels."""

_ELEMENT_BYTES, _ATTRIBUTE_BYTES = 800, 200
"""About what an element and an attribute take, besides their bytes in the file."""

_CAPITAL = re.compile(r"(?<=[a-z])([A-Z]+)")


@dataclass(slots=True)
class Element:
    """An element of a file.

    Attributes:
        tag: its name.
        attributes: as the file has them, so that variables (``$name``) stand in them.
        children: the elements in it.
        file: that it is in.
        line: of the file, from 1.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    @property
    def name(self) -> str:
        """What the element is called in that around it, as Mitsuba 3 writes it: ``int_ior`` for ``intIOR``."""
        return snake_case(self.attributes.get("name", ""))

    @property
    def place(self) -> str:
        """Where it is, for messages."""
        return f"{self.file} (line {self.line})"

    def walk(self) -> Iterator[Element]:
        """Yield this element and all in it, each before those in it."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)

    def copied(self) -> Element:
        """Return a copy without ids, with copies of all elements in it."""
        copied = copy.deepcopy(self)
        for element in copied.walk():
            if element.tag != "ref":
                element.attributes.pop("id", None)
        return copied

    def child(self, tag: str, **attributes: str) -> Element:
        """Return a new element at the same place."""
        return Element(tag, attributes, self.file, self.line)


class Ids:
    """Gives ids to elements that have none."""

    def __init__(self, root: Element) -> None:
        self._taken = {element.attributes["id"] for element in root.walk() if "id" in element.attributes}
        self._next = defaultdict[str, int](int)

    def of(self, element: Element, stem: str) -> str:
        """Return an element's id; if the file gives none, a free one that begins with ``stem``."""
        while "id" not in element.attributes:
            name = f"{stem}_{self._next[stem]}"
            self._next[stem] += 1
            if name not in self._taken:
                element.attributes["id"] = name
        return element.attributes["id"]


def elements_by_id(root: Element) -> dict[str, Element]:
    """Return the elements that have an id of their own, by it."""
    return {id_: element for element in root.walk() if element.tag != "ref" and (id_ := element.attributes.get("id"))}


def snake_case(name: str) -> str:
    """Return a name as Mitsuba 3 writes it, of one that may be older: ``to_world`` for ``toWorld``."""
    return _CAPITAL.sub(lambda capitals: f"_{capitals[1].lower()}", name)


def read_elements(path: Path, budget: Budget) -> Element:
    """Read the elements of a file.

    Raises:
        OSError: if it cannot be read.
        DecodeError: for what is no XML, is nested too deeply, declares entities, or is too large for the budget.
    """
    parser = expat.ParserCreate()
    inside: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        budget.take(_ELEMENT_BYTES + _ATTRIBUTE_BYTES * len(attributes), f"{path}: its elements")
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        (inside[-1].children if inside else roots).append(element)
        inside.append(element)
        if len(inside) > DEEPEST:
            raise DecodeError(f"{path}: elements may be nested {DEEPEST} deep")

    def end(_: str) -> None:
        inside.pop()

    def declared(name: str, *_: object) -> None:
        raise DecodeError(f"{path}: declares the entity {name!r}, which is not read")

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = start, end, declared
    try:
        parser.Parse(read_charged(path, budget), True)
    except DecodeError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two of encodings
        raise DecodeError(f"Mitsuba cannot load {path}: no XML: {error}") from None
    return roots[0]


def with_values(text: str, values: Mapping[str, str]) -> str:
    """Return a text with values in the place of its variables; those without a value stay."""
    return re.sub(r"\$(\w+)", lambda match: values.get(match[1], match[0]), text)


def written(root: Element) -> tuple[str, list[str]]:
    """Write elements as XML, each on a line of its own; and return the place of the element on each line."""
    from xml.sax.saxutils import quoteattr  # which brings what opens web pages, and only files of Mitsuba need

    lines: list[str] = []
    places: list[str] = []
    waiting: list[Element | str] = [root]
    while waiting:
        element = waiting.pop()
        if isinstance(element, str):
            lines[-1] += element
            continue
        attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
        lines.append(f"<{element.tag}{attributes}{'' if element.children else '/'}>")
        places.append(element.place)
        if element.children:
            waiting += [f"</{element.tag}>", *reversed(element.children)]
    return "\n".join(lines), places
