"""Reads and changes the elements of plug-ins that Mitsuba 3 knows by other names or properties."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .elements import Element
from .files import SceneFile
from .former_notation import NUMBER

FloatArray = npt.NDArray[np.float64]

NO_COLOUR = 0.02
"""Colours whose parts differ by no more than this are grey."""


class FormerPlugin:
    """Reads and changes the properties of a plug-in's element, by their present names."""

    def __init__(self, element: Element, file: SceneFile) -> None:
        self.element, self.file = element, file

    @property
    def kind(self) -> str:
        """The plug-in."""
        return self.element.attributes.get("type", "")

    def get(self, name: str) -> Element | None:
        """Return the property of this name."""
        return next((child for child in self.element.children if child.name == name), None)

    def numbers(self, name: str, default: float) -> FloatArray | None:
        """Return the numbers (3,) of a property, the same three for one; None where it is a texture."""
        given = self.get(name)
        if given is None:
            return np.full(3, default)
        if given.tag not in ("float", "integer", "rgb", "spectrum"):
            return None
        words = self.file.with_values(given.attributes.get("value", "")).replace(",", " ").split()
        if len(words) not in (1, 3) or not all(map(NUMBER.fullmatch, words)):
            return None
        return np.array(words * (3 // len(words)), np.float64)

    def number(self, name: str, default: float) -> float | None:
        """Return a property that is one number; None where it is anything else."""
        numbers = self.numbers(name, default)
        return None if numbers is None or np.ptp(numbers) > NO_COLOUR else float(numbers.mean())

    def becomes(self, kind: str, drop: tuple[str, ...] = (), **renamed: str) -> None:
        """Make it one of another kind, without some properties, and with others renamed (old name to new)."""
        self.element.attributes["type"] = kind
        self.element.children = [child for child in self.element.children if child.name not in drop]
        for child in self.element.children:
            if child.name:
                child.attributes["name"] = renamed.get(child.name, child.name)

    def put(self, **numbers: float | FloatArray) -> None:
        """Set properties to numbers or colours."""
        for name, value in numbers.items():
            self.element.children = [child for child in self.element.children if child.name != name]
            tag, text = (
                ("float", repr(value)) if isinstance(value, float) else ("rgb", ", ".join(map(repr, value.tolist())))
            )
            self.element.children.append(self.element.child(tag, name=name, value=text))
