"""Scales a loaded Mitsuba scene to a size at which Mitsuba's own rays are right.

A ray that leaves a surface at p starts 9e-5 (1 + max|p|) off it (Mitsuba's RayEpsilon), so that it does not hit that
surface again. In a scene of millimetres this distance is larger than the objects that throw shadows. Far beyond 10 km
in diameter it is less than the rounding of points on large slanted surfaces near the origin, which then throw shadows
upon themselves.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator

import numpy as np

from ..._mitsuba.types import Mitsuba, MitsubaEmitter, MitsubaIntegrator, MitsubaParameters, MitsubaScene, MitsubaShape
from .scene_updates import MovableShape, like, strength_key

SMALLEST, LARGEST = 1.0, 1e4
"""A scene whose diameter, in its own units, lies between these is not scaled."""

_SMALL_TARGET, _LARGE_TARGET = 64.0, 4096.0
"""Smaller and larger scenes get diameters from these to twice these, by a power of two, so that nothing is rounded."""

_INTEGRATORS = ("DirectIntegrator", "PathIntegrator", "VolumetricPathIntegrator", "VolpathMisIntegratorImpl")
_FAR_LIGHTS = (
    *("DirectionalEmitter", "ConstantBackgroundEmitter", "EnvironmentMapEmitter"),
    *("SunskyEmitter", "TimedSunskyEmitter"),
)
_SURFACE_LIGHTS = ("AreaLight", "DirectionalArea")
_BSDFS_WITH_LENGTHS = ("BumpMap", "Volume")

_Change = Callable[[float], None]


def scale_scene(scene: MitsubaScene, integrator: MitsubaIntegrator, mi: Mitsuba) -> float:
    """Scale a scene, in place and about the origin, where it is too small or too large for Mitsuba's rays.

    Point lights, spots and projectors become stronger by the square, so that surfaces are as bright as before.

    Returns:
        How many times as large it is now: 1, or another power of two.

    Warns:
        UserWarning: if it should be scaled and has a part for which we do not know how; it is left as it was.
    """
    box = scene.bbox()
    diameter = float(np.linalg.norm(np.array(box.max, np.float64) - np.array(box.min, np.float64)))
    if SMALLEST <= diameter <= LARGEST or not 0 < diameter < math.inf:
        return 1.0
    target = _SMALL_TARGET if diameter < SMALLEST else _LARGE_TARGET
    factor = 2.0 ** math.ceil(math.log2(target / diameter))
    try:
        changes = list(_changes(scene, integrator, mi))
    except _Unscalable as reason:
        consequence = (
            "shadows are wrong near what throws them" if diameter < SMALLEST else "surfaces may shadow themselves"
        )
        warnings.warn(
            f"the scene is {diameter:.3g} in diameter, and Mitsuba's integrators are made for {SMALLEST:g} to "
            f"{LARGEST:g}: {consequence}. It cannot be scaled, because of {reason}; give it in other units",
            stacklevel=2,
        )
        return 1.0
    for change in changes:
        change(factor)
    scene.parameters_changed()
    for emitter in scene.emitters():
        if emitter.class_name() in _FAR_LIGHTS:
            emitter.set_scene(scene)  # they keep the size of what they light
    return factor


class _Unscalable(Exception):
    """Raised with the part of a scene that cannot be scaled."""


def _changes(scene: MitsubaScene, integrator: MitsubaIntegrator, mi: Mitsuba) -> Iterator[_Change]:
    """Yield the changes that scale a scene; the caller makes them only if it gets all of them."""
    if integrator.class_name() not in _INTEGRATORS:
        raise _Unscalable(f"the integrator, a {integrator.class_name()}, whose values may be lengths")
    for shape in scene.shapes():
        yield _shape_change(shape, mi)
    for emitter in scene.emitters():
        if emitter.class_name() not in (*_FAR_LIGHTS, *_SURFACE_LIGHTS):
            yield _light_change(emitter, mi)


def _shape_change(shape: MitsubaShape, mi: Mitsuba) -> _Change:
    name = f"shape {shape.id()!r}, a {shape.class_name()}"
    if shape.interior_medium() is not None or shape.exterior_medium() is not None:
        raise _Unscalable(f"the medium of {name}")
    bsdf = str(shape.bsdf())
    for kind in _BSDFS_WITH_LENGTHS:
        if f"{kind}[" in bsdf:
            raise _Unscalable(f"the {kind} of {name}")
    parameters = mi.traverse(shape)
    if "control_points" in parameters:
        return _multiply(parameters, "control_points", 1)
    for key in ("to_world", "vertex_positions"):
        if key in parameters and not shape.is_ellipsoids():
            return _scale_shape(parameters, key)
    raise _Unscalable(name)


def _light_change(emitter: MitsubaEmitter, mi: Mitsuba) -> _Change:
    """Return the change of a light in one point: of its position, and of its strength with the square of the
    distances."""
    parameters = mi.traverse(emitter)
    kind = emitter.class_name()
    if kind == "PointLight":
        move = _multiply(parameters, "position", 1)
    elif kind in ("SpotLight", "Projector"):
        move = _scale_position(parameters, "to_world")
    else:
        raise _Unscalable(f"light {emitter.id()!r}, a {kind}")
    strengthen = _multiply(parameters, strength_key("", parameters), 2)

    def change(factor: float) -> None:
        move(factor)
        strengthen(factor)

    return change


def _scale_shape(parameters: MitsubaParameters, key: str) -> _Change:
    def change(factor: float) -> None:
        MovableShape(parameters, key).move_to(np.diag([factor, factor, factor, 1.0]))
        parameters.update()

    return change


def _scale_position(parameters: MitsubaParameters, key: str) -> _Change:
    """Return the change of a light's position only: a scale of its axes would scale its light too."""

    def change(factor: float) -> None:
        matrix = np.array(parameters[key].matrix, np.float64).reshape(4, 4)
        matrix[:3, 3] *= factor
        parameters[key] = type(parameters[key])(matrix)
        parameters.update()

    return change


def _multiply(parameters: MitsubaParameters, key: str, power: int) -> _Change:
    def change(factor: float) -> None:
        parameters[key] = like(parameters[key], np.array(parameters[key], np.float64) * factor**power)
        parameters.update()

    return change
