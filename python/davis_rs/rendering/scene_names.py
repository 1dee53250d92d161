"""The lights and shapes of a loaded Mitsuba scene and their names, which may be missing or shared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class SceneLight:
    """One light of a scene.

    Attributes:
        emitter: Mitsuba's own object, which tells this light from all others.
        shape: that it belongs to; None for a light without one.
        name: by which a profile finds it: its id, or ``shape.emitter`` for the light of a shape, whatever its own id
            is; empty where that id is.
    """

    emitter: Any
    shape: Any | None
    name: str

    def __str__(self) -> str:
        """What it is, for messages."""
        return f"light {self.name!r}" if self.name else "a light without an id"


def scene_lights(scene: Any) -> list[SceneLight]:
    """All lights of a scene, in Mitsuba's own order."""
    emitters = scene.emitters()
    # Mitsuba gives the same object for the same light for as long as somebody holds it.
    shapes = {id(shape.emitter()): shape for shape in scene.shapes() if shape.is_emitter()}
    lights = []
    for emitter in emitters:
        shape = shapes.get(id(emitter))
        own = emitter if shape is None else shape
        name = str(own.id())
        lights.append(SceneLight(emitter, shape, f"{name}.emitter" if name and shape is not None else name))
    return lights


def shape_name(shape: Any) -> str:
    """What to call a shape in messages."""
    return f"shape {shape.id()!r}" if shape.id() else "a shape without an id"


def distinct_names(names: Sequence[str], kind: str) -> list[str]:
    """Names that differ: things' own, with a number where one is taken already; ``kind[number]`` for what has none."""
    found = dict[str, None]()
    for number, name in enumerate(names):
        own = name or f"{kind}[{number}]"
        while own in found:
            own += f"[{number}]"
        found[own] = None
    return list(found)


def light_named(name: str, lights: Sequence[SceneLight], where: str = "the scene") -> SceneLight:
    """The light that has a name, see :func:`shape_named`."""
    named = [(light.name, light.emitter) for light in lights]
    return lights[_number_of(name, named, "light", where)]


def shape_named(name: str, shapes: Sequence[Any], where: str = "the scene") -> Any:
    """The shape that has a name.

    Args:
        where: that it is looked for, for messages.

    Raises:
        ValueError: if none has that name, or more than one.
    """
    named = [(str(shape.id()), shape) for shape in shapes]
    return shapes[_number_of(name, named, "object", where)]


def _number_of(name: str, named: Sequence[tuple[str, Any]], kind: str, where: str) -> int:
    """The number of the one thing that has a name; what is there twice is still one."""
    found = {id(one): number for number, (its_name, one) in enumerate(named) if name and its_name == name}
    if len(found) > 1:
        raise ValueError(f"{where} has {len(found)} {kind}s {name!r}; give each of them an id of its own")
    if not found:
        known = [*dict.fromkeys(its_name for its_name, _ in named if its_name)]
        unnamed = len({id(one) for its_name, one in named if not its_name})
        if unnamed:
            known.append(f"{unnamed} without an id, which cannot be named")
        raise ValueError(f"{where} has no {kind} {name!r}; it has {', '.join(known) or 'none'}")
    return next(iter(found.values()))
