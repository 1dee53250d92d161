"""Computes luma along rays through a :class:`SceneTable`: Mitsuba finds the triangle, flat buffers give the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import (
    JitArray,
    JitFloat,
    JitIndex,
    JitMask,
    JitRay,
    JitVector,
    Mitsuba,
    MitsubaBox,
    MitsubaScene,
    MitsubaShape,
)
from ...scene.texel_lookup import WRAP_MODES
from ..rays.shadow_rays import END, STEP
from ..scene_tables.scene_table import Light, SceneTable
from .moving_lanes import Body, Surroundings


class _Hits(NamedTuple):
    """Holds the hits of rays.

    Attributes:
        hit: whether anything is hit.
        record: the triangle's record.
        depth: distance in units of the ray's direction.
        point, own_point: the point in the world, and in the frame of the record.
        normal, plane_normal: the shading normal and the plane's, in the world.
    """

    hit: JitMask
    record: JitIndex
    depth: JitFloat
    point: JitVector
    own_point: JitVector
    normal: JitVector
    plane_normal: JitVector


class TableKernel:
    """Holds the scene table as Dr.Jit buffers, and traced code that computes luma from them.

    The hit triangle is found without derivatives. All else follows from the ray by smooth operations, so derivatives
    of the ray pass through: those of luma are exact inside surfaces, and leave out edges.
    """

    def __init__(self, table: SceneTable, mi: Mitsuba) -> None:
        self._table = table
        shapes = table.scene.shapes()
        self._scene, self._bodies = table.scene, list[MitsubaScene]()
        if table.moving:
            self._scene = _subscene([shape for shape in shapes if shape.id() not in table.moving], mi)
            self._bodies = [_subscene([shape for shape in shapes if shape.id() == name], mi) for name in table.moving]
        self._first_record = mi.UInt32(_first_records(table, mi))
        self._planes = _column(table.planes, mi)
        textures = table.textures
        # In float32 from end to end: the documented event counts rest on these very roundings.
        self._uv_maps = [mi.Float(maps.ravel()) for maps in table.uv_maps(np.float32)]
        smooth = table.normal_maps
        self._normal_maps = [] if smooth is None else [_column(smooth[:, axis], mi) for axis in range(3)]
        self._wraps = sorted(set(textures.sizes[:, 3].tolist()))
        self._layout = [_RecordValues(column, mi.Int32) for column in textures.framed_sizes[textures.texture_of].T]
        self._two_sided = _RecordValues(table.two_sided, mi.UInt32)
        self._texels = [mi.Float(textures.framed(group)) for group in range(len(textures.group_weights))]

    def hit(self, ray: JitRay) -> tuple[JitFloat, JitMask, JitIndex, JitVector]:
        """Return (distance in units of the direction, whether anything is hit, the triangle's record, its normal)."""
        import drjit as dr
        import mitsuba as mi

        nearest = self._scene.ray_intersect_preliminary(dr.detach(ray), coherent=True)
        hit = nearest.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, nearest.shape)
        record = dr.gather(mi.UInt32, self._first_record, shape, hit) + nearest.prim_index
        plane = dr.gather(mi.Vector4f, self._planes, record, hit)
        normal = plane.xyz
        distance = -(dr.dot(normal, ray.o) + plane.w) / dr.dot(normal, ray.d)
        return distance, hit, record, normal

    def luma(self, ray: JitRay, around: Surroundings | None = None) -> JitFloat:
        """Return linear luma along a ray; ``around`` is what moves and flickers in the scene, None if nothing does."""
        import drjit as dr
        import mitsuba as mi

        surface = self._still_surface(ray) if around is None else self._surface(ray, around.bodies)
        hit, record = surface.hit, surface.record
        # Lambert's cosines count on the side that is seen; the back of a one-sided surface is black.
        facing = -dr.sign(dr.dot(surface.normal, ray.d))
        lit = hit & ((facing > 0) | (self._two_sided(record, hit) == 1))
        reflectances = self._reflectances(surface.own_point, record, hit)
        total = dr.zeros(mi.Float, dr.width(surface.point))
        bodies, lights = ((), self._table.lights) if around is None else (around.bodies, self._lights_at(around))
        for light in lights:
            irradiance = self._irradiance_over_pi(light, surface, surface.normal * facing, lit, bodies)
            total += reflectances[light.group] * irradiance
        background = self._table.background_luma if around is None else self._table.background(lights)
        return dr.select(hit, dr.select(lit, total, 0), background)

    def nearest(self, ray: JitRay, bodies: Sequence[Body]) -> tuple[JitFloat, JitMask, JitIndex]:
        """Return the nearest hit of a ray, without derivatives.

        Returns:
            Distance in units of the direction; whether anything is hit; 0 where it stands still, else the number of
            the body from 1 on.
        """
        _, _, hit, owner, distance = self._nearest(ray, bodies)
        return distance, hit, owner

    def _still_surface(self, ray: JitRay) -> _Hits:
        import drjit as dr

        distance, hit, record, plane_normal = self.hit(ray)
        point = dr.fma(ray.d, distance, ray.o)
        normal = self._smooth_normal(point, record, hit) if self._normal_maps else plane_normal
        return _Hits(hit, record, distance, point, point, normal, plane_normal)

    def _surface(self, ray: JitRay, bodies: Sequence[Body]) -> _Hits:
        import drjit as dr
        import mitsuba as mi

        own, record, hit, owner, _ = self._nearest(ray, bodies)
        plane = dr.gather(mi.Vector4f, self._planes, record, hit)
        distance = -(dr.dot(plane.xyz, own.o) + plane.w) / dr.dot(plane.xyz, own.d)
        own_point = dr.fma(own.d, distance, own.o)
        own_normal = self._smooth_normal(own_point, record, hit) if self._normal_maps else plane.xyz
        normal, plane_normal = own_normal, plane.xyz
        for number, body in enumerate(bodies, 1):
            normal = dr.select(owner == number, body.to_world(own_normal), normal)
            plane_normal = dr.select(owner == number, body.rotation @ plane.xyz, plane_normal)
        point = dr.fma(ray.d, distance, ray.o)
        return _Hits(hit, record, distance, point, own_point, normal, plane_normal)

    def _nearest(self, ray: JitRay, bodies: Sequence[Body]) -> tuple[JitRay, JitIndex, JitMask, JitIndex, JitFloat]:
        """Return (the ray in the frame of what it hits, record, whether anything is hit, body or 0, distance)."""
        import drjit as dr
        import mitsuba as mi

        still = self._scene.ray_intersect_preliminary(dr.detach(ray), coherent=True)
        shape, triangle, distance = dr.reinterpret_array(mi.UInt32, still.shape), still.prim_index, still.t
        origin, direction, owner = ray.o, ray.d, mi.UInt32(0)
        for number, (body, scene) in enumerate(zip(bodies, self._bodies, strict=True), 1):
            # Hits beyond the nearest one so far do not matter.
            own = mi.Ray3f(dr.detach(body.ray.o), dr.detach(body.ray.d), distance, 0, [])
            moving = scene.ray_intersect_preliminary(own, coherent=True, active=_may_hit_box(scene.bbox(), own))
            nearer = moving.is_valid()
            shape = dr.select(nearer, dr.reinterpret_array(mi.UInt32, moving.shape), shape)
            triangle = dr.select(nearer, moving.prim_index, triangle)
            distance = dr.select(nearer, moving.t, distance)
            origin, direction = dr.select(nearer, body.ray.o, origin), dr.select(nearer, body.ray.d, direction)
            owner = dr.select(nearer, number, owner)
        hit = distance < dr.inf
        record = dr.gather(mi.UInt32, self._first_record, shape, hit) + triangle
        return mi.Ray3f(origin, direction), record, hit, owner, distance

    def _lights_at(self, around: Surroundings) -> list[Light]:
        """Return the lights; the strengths of those with a profile are multiplied by its factor."""
        return [
            light if factor is None else replace(light, strength=light.strength * factor)
            for light, factor in zip(self._table.lights, around.factors, strict=True)
        ]

    def _smooth_normal(self, point: JitVector, record: JitIndex, hit: JitMask) -> JitVector:
        import drjit as dr
        import mitsuba as mi

        rows = [dr.gather(mi.Vector4f, rows, record, hit) for rows in self._normal_maps]
        return dr.normalize(mi.Vector3f(*(dr.dot(row.xyz, point) + row.w for row in rows)))

    def _reflectances(self, point: JitVector, record: JitIndex, hit: JitMask) -> list[JitFloat]:
        """Look the reflectance up bilinearly, as luma for each light colour."""
        import drjit as dr
        import mitsuba as mi

        first, width, height, wrap = (column(record, hit) for column in self._layout)
        rows = [dr.gather(mi.Vector4f, rows, record, hit) for rows in self._uv_maps]
        u, v = (dr.dot(row.xyz, point) + row.w for row in rows)
        column, fx = self._texel_before(u, width, wrap)
        line, fy = self._texel_before(v, height, wrap)
        top = mi.UInt32(first + line * (width + 2) + column)
        below = top + mi.UInt32(width + 2)

        def lookup(texels: JitFloat) -> JitFloat:
            lines = [[dr.gather(mi.Float, texels, line + i, hit) for i in (0, 1)] for line in (top, below)]
            return dr.lerp(*(dr.lerp(left, right, fx) for left, right in lines), fy)

        return [lookup(texels) for texels in self._texels]

    def _texel_before(self, u: JitFloat, n: JitIndex, wrap: JitIndex) -> tuple[JitIndex, JitFloat]:
        """Return the texel at or before a coordinate, counted from the texture's border, and the fraction of a texel
        beyond.

        It is :func:`texel_lookup.wrap_index` for Dr.Jit; only the modes that the scene has are compiled.
        """
        import drjit as dr
        import mitsuba as mi

        def fold(mode: int) -> JitFloat:
            if WRAP_MODES[mode] == "clamp":
                return dr.clip(u, 0, 1)
            if WRAP_MODES[mode] == "repeat":
                return u - dr.floor(u)
            period = u - 2 * dr.floor(u * 0.5)
            return dr.minimum(period, 2 - period)

        inside = fold(self._wraps[0])
        for mode in self._wraps[1:]:
            inside = dr.select(wrap == mode, fold(mode), inside)
        x = dr.fma(inside, mi.Float(n), -0.5)
        x0 = dr.floor(x)
        # A coordinate that is not finite must not lead outside of the buffer.
        return dr.clip(mi.Int32(x0) + 1, 0, n), x - x0

    def _irradiance_over_pi(
        self, light: Light, surface: _Hits, normal: JitVector, active: JitMask, bodies: Sequence[Body] = ()
    ) -> JitFloat:
        """Return irradiance / pi, which a white diffuse surface reflects, in the light's strongest channel."""
        import drjit as dr
        import mitsuba as mi

        if light.kind == "constant":
            return light.strength
        vector = mi.Vector3f(*light.vector.tolist())
        if light.kind == "point":
            to_light = vector - surface.point
            squared = dr.squared_norm(to_light)
            value = light.strength / dr.pi * dr.maximum(dr.dot(normal, to_light), 0) / (squared * dr.sqrt(squared))
        else:
            to_light = -vector
            value = light.strength / dr.pi * dr.maximum(dr.dot(normal, to_light), 0)
        if self._table.shadows:
            occluded = self._occluded(light, surface, dr.detach(to_light), active & (dr.detach(value) > 0), bodies)
            value = dr.select(occluded, 0, value)
        return value

    def _occluded(
        self, light: Light, surface: _Hits, to_light: JitVector, active: JitMask, bodies: Sequence[Body] = ()
    ) -> JitMask:
        """Return whether something lies between a surface and a light, by the rule of :mod:`shadow_rays`."""
        import drjit as dr
        import mitsuba as mi

        point, normal = dr.detach(surface.point), surface.plane_normal
        from_centre = point - mi.Point3f(*self._table.centre.tolist())
        step = STEP * (dr.max(dr.abs(from_centre)) + dr.detach(surface.depth))
        origin = point + normal * dr.mulsign(step, dr.dot(normal, to_light))
        if light.kind == "point":
            end = mi.Vector3f(*light.vector.tolist()) - origin
            ray = mi.Ray3f(origin, end, 1 - END, 0, [])
        else:
            ray = mi.Ray3f(origin, to_light)
        occluded = self._scene.ray_test(ray, active)
        for body, scene in zip(bodies, self._bodies, strict=True):
            own = body.to_own(ray)
            occluded |= scene.ray_test(own, active & ~occluded & _may_hit_box(scene.bbox(), own))
        return occluded


def _may_hit_box(box: MitsubaBox, ray: JitRay) -> JitMask:
    """Return whether a ray may hit what is in a box; this is far cheaper than the search in it, which most rays need
    not."""
    import drjit as dr
    import mitsuba as mi

    low, high = (mi.Point3f(*np.array(corner).tolist()) for corner in (box.min, box.max))
    far = dr.max(dr.maximum(dr.abs(low), dr.abs(high))) + dr.max(dr.abs(ray.o))
    margin = 1e-4 * dr.max(high - low) + 1e-6 * far
    inverse = dr.rcp(ray.d)
    to_low, to_high = (low - margin - ray.o) * inverse, (high + margin - ray.o) * inverse
    enter, leave = dr.max(dr.minimum(to_low, to_high)), dr.min(dr.maximum(to_low, to_high))
    return ~((enter > leave) | (leave < 0) | (enter > ray.maxt))


class _RecordValues:
    """Holds a number for each record, which is not gathered where all records have the same."""

    def __init__(self, values: npt.NDArray[np.integer], kind: JitArray) -> None:
        self._kind, self._same = kind, bool((values == values[0]).all())
        self._values = kind(int(values[0])) if self._same else kind(np.ascontiguousarray(values))

    def __call__(self, record: JitIndex, active: JitMask) -> JitIndex:
        import drjit as dr

        return self._values if self._same else dr.gather(self._kind, self._values, record, active)


def _column(values: npt.NDArray[np.float64], mi: Mitsuba) -> JitFloat:
    return mi.Float(np.ascontiguousarray(values, np.float32).ravel())


def _first_records(table: SceneTable, mi: Mitsuba) -> npt.NDArray[np.uint32]:
    """Return the record of each shape's first triangle, indexed by the shape's registry number."""
    import drjit as dr

    shapes = table.scene.shapes()
    numbers = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)).numpy()[0]) for shape in shapes]
    first = np.zeros(max(numbers) + 1, np.uint32)
    first[numbers] = np.cumsum([0, *table.counts])[:-1]
    return first


def _subscene(shapes: list[MitsubaShape], mi: Mitsuba) -> MitsubaScene:
    """Build a Mitsuba scene of some shapes of another, only to trace rays in it."""
    names = [shape.id() for shape in shapes]
    subscene = mi.load_dict(
        {"type": "scene", **{f"shape_{i}": shape for i, shape in enumerate(shapes)}}, optimize=False
    )
    for shape, name in zip(shapes, names, strict=True):  # loading has renamed them
        shape.set_id(name)
    return subscene
