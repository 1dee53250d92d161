"""What keeps a renderer from a scene: each thing with its rule and its remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

_PLUGINS = {"BlendBSDF": "blendbsdf", "MeshAttribute": "mesh_attribute", "PolarizedPlastic": "pplastic"}
"""Plugins whose names do not follow from their classes."""


@dataclass(frozen=True)
class Obstacle:
    """Something in a scene that a renderer cannot render.

    Attributes:
        rule: what is wrong with it: ``is a sphere, not made of triangles``.
        remedy: what would help; "" where nothing is known.
        things: what it is about, such as ``shape 'ball'``; () where the rule says it.
    """

    rule: str
    remedy: str = ""
    things: tuple[str, ...] = ()

    def __str__(self) -> str:
        likewise = f" (likewise {listed(self.things[1:])})" if len(self.things) > 1 else ""
        remedy = f": {self.remedy}" if self.remedy else ""
        return f"{''.join(self.things[:1])}{likewise} {self.rule}{remedy}".lstrip()


class Unsuitable(Exception):
    """A scene that a renderer cannot render.

    Args:
        rule, remedy, thing: of its only obstacle, see :class:`Obstacle`.

    Attributes:
        obstacles: all that keep the renderer from it, as far as they were looked for.
    """

    def __init__(self, rule: str, remedy: str = "", thing: str = "") -> None:
        super().__init__()
        self.obstacles: tuple[Obstacle, ...] = (Obstacle(rule, remedy, (thing,) if thing else ()),)

    def __str__(self) -> str:
        return "; ".join(map(str, self.obstacles))


class Obstacles:
    """Obstacles as they are met.

    Attributes:
        met: each once, those that differ in nothing but what they are about as one.
    """

    def __init__(self) -> None:
        self._met: dict[tuple[str, str], dict[str, None]] = {}

    @property
    def met(self) -> tuple[Obstacle, ...]:
        return tuple(Obstacle(rule, remedy, tuple(things)) for (rule, remedy), things in self._met.items())

    @contextmanager
    def go_on(self) -> Iterator[None]:
        """Note what makes a scene unsuitable, in ``with obstacles.go_on():``, and go on after the block."""
        try:
            yield
        except Unsuitable as unsuitable:
            for one in unsuitable.obstacles:
                self._met.setdefault((one.rule, one.remedy), {}).update(dict.fromkeys(one.things))

    def refuse(self) -> None:
        """Refuse the scene if anything was met.

        Raises:
            Unsuitable: with all of it.
        """
        if self._met:
            unsuitable = Unsuitable("")
            unsuitable.obstacles = self.met
            raise unsuitable


def listed(names: Iterable[str], most: int = 6) -> str:
    """Names for a line: all of a few, the first of many and how many more there are."""
    names = list(names)
    return ", ".join(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"


def plugin_name(node: Any) -> str:
    """What scene files call the kind of one of Mitsuba's objects: ``conductor``, ``sphere``, ``checkerboard``."""
    name = str(node.class_name())
    plain = name.removeprefix("Smooth").removesuffix("BRDF").removesuffix("BSDF")
    return _PLUGINS.get(name, plain.lower())


def shape_name(shape: Any) -> str:
    """How a line calls a shape: by its id, or by where it is."""
    if shape.id():
        return f"shape {shape.id()!r}"
    box = shape.bbox()
    middle = (np.array(box.min, np.float64) + np.array(box.max, np.float64)).reshape(3) / 2
    return f"the {plugin_name(shape)} without an id around ({', '.join(f'{one:.3g}' for one in middle)})"
