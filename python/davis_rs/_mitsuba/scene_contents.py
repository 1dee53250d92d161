"""Loads what a scene of meshes has in it, without what Mitsuba traces rays by.

When Mitsuba makes a scene, it sorts all triangles. For a renderer that traces rays itself, this would be a large part
of the time that loading takes, and of the memory.
"""

from __future__ import annotations

from collections.abc import Mapping

from .types import (
    Mitsuba,
    MitsubaBox,
    MitsubaEmitter,
    MitsubaIntegrator,
    MitsubaObject,
    MitsubaScene,
    MitsubaShape,
)


class SceneContents:
    """Has what a ``mi.Scene`` tells of its contents, under the same names. No ray can be traced in it.

    Args:
        rest: a scene of all that is no shape.
        shapes: those of the scene.
        emitters: all lights, those of shapes too.
        box: what lies around all shapes.
    """

    def __init__(
        self, rest: MitsubaScene, shapes: list[MitsubaShape], emitters: list[MitsubaEmitter], box: MitsubaBox
    ) -> None:
        self._rest, self._shapes, self._emitters, self._box = rest, shapes, emitters, box

    def shapes(self) -> list[MitsubaShape]:
        return self._shapes

    def emitters(self) -> list[MitsubaEmitter]:
        return self._emitters

    def sensors(self) -> list[MitsubaObject]:
        sensors: list[MitsubaObject] = self._rest.sensors()
        return sensors

    def integrator(self) -> MitsubaIntegrator:
        return self._rest.integrator()

    def bbox(self) -> MitsubaBox:
        return self._box

    def traverse(self, callback: MitsubaObject) -> None:
        """Hand on all objects to a ``mi.TraversalCallback``."""
        self._rest.traverse(callback)
        for shape in self._shapes:
            callback.put(shape.id(), shape, 0)


def scene_contents(source: Mapping[str, object], mi: Mitsuba) -> SceneContents | None:
    """Load a scene dictionary whose shapes are meshes that are made already; None for any other."""
    meshes = {name: node for name, node in source.items() if isinstance(node, mi.Mesh)}
    if not meshes:
        return None
    rest = mi.load_dict({name: node for name, node in source.items() if name not in meshes}, optimize=False)
    if not isinstance(rest, mi.Scene) or rest.shapes():
        return None
    emitters, box = {str(emitter.id()): emitter for emitter in rest.emitters()}, mi.BoundingBox3f()
    for name, mesh in meshes.items():
        mesh.set_id(name)
        box.expand(mesh.bbox())
    in_order = (mesh.emitter() if (mesh := meshes.get(name)) is not None else emitters.get(name) for name in source)
    return SceneContents(rest, list(meshes.values()), [emitter for emitter in in_order if emitter is not None], box)
