"""Collects why a renderer cannot render a scene: each obstacle with its rule and its remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from .._mitsuba.types import MitsubaObject, MitsubaShape

_PLUGINS = {
    "BlendBSDF": "blendbsdf",
    "LinearPolarizer": "polarizer",
    "MeshAttribute": "mesh_attribute",
    "PolarizedPlastic": "pplastic",
}
"""Names of plugins that do not follow from their classes."""


@dataclass(frozen=True)
class Obstacle:
    """Describes a property of a scene that a renderer cannot render.

    Attributes:
        rule: which rule of the renderer is broken: ``is a sphere, not made of triangles``.
        remedy: what would help; "" where nothing is known.
        objects: the parts of the scene that break it, such as ``shape 'ball'``; () where the rule names them.
    """

    rule: str
    remedy: str = ""
    objects: tuple[str, ...] = ()

    def __str__(self) -> str:
        likewise = f" (likewise {listed(self.objects[1:])})" if len(self.objects) > 1 else ""
        remedy = f": {self.remedy}" if self.remedy else ""
        return f"{''.join(self.objects[:1])}{likewise} {self.rule}{remedy}".lstrip()


class Unsuitable(Exception):
    """Raised for a scene that a renderer cannot render.

    Args:
        rule, remedy, object_name: the only obstacle, see :class:`Obstacle`.

    Attributes:
        obstacles: all that were found.
    """

    def __init__(self, rule: str, remedy: str = "", object_name: str = "") -> None:
        super().__init__()
        self.obstacles: tuple[Obstacle, ...] = (Obstacle(rule, remedy, (object_name,) if object_name else ()),)

    def __str__(self) -> str:
        return "; ".join(map(str, self.obstacles))


class Obstacles:
    """Collects obstacles while a scene is examined, so that one message can name all of them.

    Attributes:
        met: each once; obstacles with the same rule and remedy are one, with all their objects.
    """

    def __init__(self) -> None:
        self._met: dict[tuple[str, str], dict[str, None]] = {}

    @property
    def met(self) -> tuple[Obstacle, ...]:
        return tuple(Obstacle(rule, remedy, tuple(objects)) for (rule, remedy), objects in self._met.items())

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Catch :class:`Unsuitable` in ``with obstacles.collect():``, note its obstacles, and go on after the block."""
        try:
            yield
        except Unsuitable as unsuitable:
            for obstacle in unsuitable.obstacles:
                self._met.setdefault((obstacle.rule, obstacle.remedy), {}).update(dict.fromkeys(obstacle.objects))

    def refuse(self) -> None:
        """Refuse the scene if there are obstacles.

        Raises:
            Unsuitable: with all of them.
        """
        if self._met:
            unsuitable = Unsuitable("")
            unsuitable.obstacles = self.met
            raise unsuitable


def listed(names: Iterable[str], most: int = 6) -> str:
    """Join names for a message: all of a few; of many the first ones, and how many more there are."""
    names = list(names)
    return ", ".join(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"


def plugin_name(node: MitsubaObject) -> str:
    """Return a Mitsuba object's plugin name, as scene files have it: ``conductor``, ``sphere``, ``checkerboard``."""
    name = str(node.class_name())
    plain = name.removeprefix("Smooth").removesuffix("BRDF").removesuffix("BSDF")
    return _PLUGINS.get(name, plain.lower())


def shape_name(shape: MitsubaShape) -> str:
    """Return how messages name a shape: by its id, or by its position where it has none."""
    if shape.id():
        return f"shape {shape.id()!r}"
    box = shape.bbox()
    middle = (np.array(box.min, np.float64) + np.array(box.max, np.float64)).reshape(3) / 2
    return f"the {plugin_name(shape)} without an id around ({', '.join(f'{one:.3g}' for one in middle)})"
