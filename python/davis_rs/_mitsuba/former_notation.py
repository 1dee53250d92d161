"""Writes what older versions of Mitsuba, and other systems, write in another way, as Mitsuba 3 reads it.

Nothing changes what the scene looks like, so nothing is told, but the version that a file does not give, and names that
are not of its version.
"""

from __future__ import annotations

import re

import numpy as np

from .._util.srgb import from_srgb
from .elements import Element
from .files import SceneFile

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
"""A number as XML files have it."""

_SUFFIX = re.compile(r"(?<=[\d.])[fF](?=\s*(,|$))")
_VERSION = re.compile(r"\s*(\d{1,9})\.(\d{1,9})\.(\d{1,9})\s*")
FORMER, _NOW = "0.6.0", "3.0.0"
_VALUES = ("boolean", "integer", "float", "string", "rgb", "spectrum", "point", "vector")
"""Elements that hold a value of a plug-in."""
_WITH_NAMES = (*_VALUES, "transform", "animation", "texture", "ref")
"""Elements whose names say what they are to that around them."""
_CAMEL = re.compile(r"[a-z][A-Z]")
_OBJECTS = ("shape", "bsdf", "ref", "emitter", "sensor")
"""Elements of objects that count whatever they are called."""
_NAMED = re.compile(rf"{_CAMEL.pattern}|^diffuseReflectance$|^[uv](offset|scale)$")
"""Names of parameters before version 2."""


def rewrite(file: SceneFile, notes: list[str]) -> None:
    """Write a file's elements as Mitsuba 3 reads them."""
    version = min(_version(root, notes) for root in file.roots)
    for root in file.roots:
        root.attributes.pop("version", None)  # an included part of a scene may have none
    file.root.attributes["version"] = version
    for element in file.root.walk():
        attributes = element.attributes
        if element.tag == "lookAt":
            element.tag = "lookat"
        elif element.tag in ("rgb", "srgb", "spectrum") and "value" in attributes:
            attributes.pop("intent", None)  # of which spectrum a colour is: here, colours are three numbers
            _rewrite_colour(element)
        elif element.name == "filter_type" and attributes.get("value") in ("trilinear", "ewa"):
            attributes["value"] = "bilinear"
        elif attributes.get("name") == "filename" and "value" in attributes:
            attributes["value"] = attributes["value"].replace("\\", "/")
        elif element.tag == "path" and (folder := element.file.parent / attributes.get("value", "")).is_dir():
            attributes["value"] = str(folder.absolute())
        if version == FORMER:
            _take_all(element)
        else:
            _rename(element, notes)
        _take_last(element, notes)


def _rename(element: Element, notes: list[str]) -> None:
    """Give what is in an element its present name, where it has a former one in a file of a present version."""
    taken = {child.attributes.get("name") for child in element.children}
    for child in element.children:
        name = child.attributes.get("name", "")
        if child.tag in _WITH_NAMES and _CAMEL.search(name) and child.name not in taken:
            notes.append(f"its former name {name[:40]!r} is read as {child.name[:40]!r}")
            child.attributes["name"] = child.name


def _take_last(element: Element, notes: list[str]) -> None:
    """Take the last of several values of one name, as former versions did; note those that say something else."""
    values = [child for child in element.children if child.tag in _VALUES and "name" in child.attributes]
    last = {child.attributes["name"]: child for child in values}
    repeated = {id(child): child for child in values if child is not last[child.attributes["name"]]}
    element.children = [child for child in element.children if id(child) not in repeated]
    for child in repeated.values():
        kept = last[child.attributes["name"]]
        if (child.tag, child.attributes, child.children) != (kept.tag, kept.attributes, kept.children):
            notes.append(f"the last {child.attributes['name'][:40]!r} of a {element.tag} counts, as in older versions")


def _take_all(element: Element) -> None:
    """Take all objects that share a name, as former versions did, to which it was no more than a word. Mitsuba 3 would
    leave out all but one, or refuse them."""
    named = set[str]()
    for child in element.children:
        name = child.attributes.get("name", "")
        if child.tag in _OBJECTS and name in named:
            del child.attributes["name"]
        elif child.tag in _OBJECTS and name:
            named.add(name)


def _version(root: Element, notes: list[str]) -> str:
    """Return the version that names of parameters in a file are of: a former one, or the present one.

    Mitsuba's versions differ in how they write names. Its upgrade of former ones leaves present ones as they are.
    """
    given = root.attributes.get("version")
    numbers = None if given is None else _VERSION.fullmatch(given)
    if numbers:
        return FORMER if int(numbers[1]) < 2 else _NOW
    if root.tag != "scene":
        return _NOW  # a part of a scene: that which includes it has the version
    had = "it has no version" if given is None else f"its version {given[:20]!r} is none of Mitsuba's"
    former = next((name for each in root.walk() if _NAMED.search(name := each.attributes.get("name", ""))), None)
    if former is None:
        notes.append(f"{had}, so it is read as one of Mitsuba 3")
        return _NOW
    notes.append(f"{had}, so it is read as one of Mitsuba 0.6, because of names such as {former[:40]!r}")
    return FORMER


def _rewrite_colour(element: Element) -> None:
    """Write a colour as linear red, green and blue, where it is one: three numbers, or a number of 6 digits.

    Before version 2 ``rgb`` was linear in both forms, ``srgb`` encoded, and ``spectrum`` could be three numbers.
    Numbers by wavelength could end in an f, as in C.
    """
    value = element.attributes["value"]
    if ":" in value:
        element.attributes["value"] = _SUFFIX.sub("", value)
        return
    if digits := re.fullmatch(r"\s*#([0-9a-fA-F]{6})\s*", value):
        colour = np.array(list(bytes.fromhex(digits[1]))) / 255.0
    else:
        words = value.replace(",", " ").split()
        if len(words) not in ((1, 3) if element.tag == "srgb" else (3,)) or not all(map(NUMBER.fullmatch, words)):
            return
        colour = np.array([*words] if len(words) == 3 else words * 3, np.float64)
    if element.tag == "srgb":
        colour = from_srgb(colour)
    element.tag = "rgb"
    element.attributes["value"] = ", ".join(map(repr, colour.tolist()))
