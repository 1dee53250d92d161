"""The table kernel: a hit from Mitsuba's ray tracer, everything else from flat tables, many poses a launch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._mitsuba import FAST, variant
from .camera import Camera
from .luma import LumaFrames
from .pose import Pose
from .render import Renderer, ray_table
from .scene_table import Light, SceneTable
from .scene_texture import WRAP_MODES

_RAYS_PER_LAUNCH = 1 << 22
_PACKET = 16
"""Pixels of a pose are padded to whole ray packets, so that no packet, and so no bit, depends on the pose beside it."""


class TableRenderer(Renderer):
    """Renders a :class:`SceneTable`: direct light on diffuse triangles, without noise.

    The kernel loops over a pixel's lattice rays and adds them in a fixed order. Constant light is taken as unoccluded;
    shadows of the other lights are traced where the table asks for them.
    """

    name = "table kernel"
    variant = FAST

    def __init__(self, table: SceneTable, camera: Camera, *, samples: int, blur: bool) -> None:
        super().__init__(camera, samples=samples, blur=blur)
        kinds = sorted({light.kind for light in table.lights})
        lights = f"{' and '.join(kinds)} light" if kinds else "no light"
        self.reason = f"diffuse triangles under {lights}, {'with' if table.shadows else 'without'} shadows"
        self._table = table
        pixels = camera.width * camera.height
        self._padded = -(-pixels // _PACKET) * _PACKET
        self.poses_per_launch = int(np.clip(_RAYS_PER_LAUNCH // self._padded, 1, 64))
        with variant(FAST) as (mi, _):
            self._rays = [mi.Float(column) for column in self._ray_columns(samples)]
            self._centre_rays = [mi.Float(column) for column in self._ray_columns(1)]
            self._gather = _Tables(table, mi)

    def _ray_columns(self, samples: int) -> list[npt.NDArray[np.float32]]:
        rays = ray_table(self.camera, samples).astype(np.float32)
        padded = np.concatenate([rays, np.repeat(rays[:, -1:], self._padded - rays.shape[1], 1)], 1)
        return [np.ascontiguousarray(padded[..., axis]).ravel() for axis in (0, 1)]

    def _luma(self, poses: Sequence[Pose]) -> LumaFrames:
        with variant(FAST) as (mi, dr):
            pixel, origin, axes = self._pose_lanes(poses, mi, dr)
            rays, gather, padded = self._rays, self._gather, self._padded

            def body(sample: Any, total: Any) -> tuple[Any, Any]:
                index = sample * padded + pixel
                direction = axes @ mi.Vector3f(
                    dr.gather(mi.Float, rays[0], index), dr.gather(mi.Float, rays[1], index), 1
                )
                return sample + 1, total + gather.luma(mi.Ray3f(origin, direction))

            samples = mi.UInt32(self.samples)
            _, total = dr.while_loop(
                (mi.UInt32(0), dr.zeros(mi.Float, dr.width(pixel))), lambda sample, _: sample < samples, body
            )
            return self._frames(total / self.samples, len(poses))

    def depth(self, poses: Sequence[Pose]) -> npt.NDArray[np.float32]:
        with variant(FAST) as (mi, dr):
            pixel, origin, axes = self._pose_lanes(poses, mi, dr)
            rays = self._centre_rays
            direction = axes @ mi.Vector3f(dr.gather(mi.Float, rays[0], pixel), dr.gather(mi.Float, rays[1], pixel), 1)
            distance, hit, _, _ = self._gather.hit(mi.Ray3f(origin, direction))
            # Camera-frame directions have z = 1, so the ray parameter is z.
            return self._frames(dr.select(hit, distance, dr.inf), len(poses))

    def _pose_lanes(self, poses: Sequence[Pose], mi: Any, dr: Any) -> tuple[Any, Any, Any]:
        """(pixel, camera position, camera axes) for every pixel of every pose."""
        lane = dr.arange(mi.UInt32, self._padded * len(poses))
        pose = lane // self._padded
        pixel = lane - pose * self._padded
        columns = np.stack([np.concatenate([p.position, p.rotation.ravel()]) for p in poses]).astype(np.float32)
        p = [dr.gather(mi.Float, mi.Float(np.ascontiguousarray(column)), pose) for column in columns.T]
        return pixel, mi.Point3f(p[:3]), mi.Matrix3f(*p[3:])

    def _frames(self, lanes: Any, count: int) -> npt.NDArray[np.float32]:
        height, width = self.camera.height, self.camera.width
        frames = lanes.numpy().reshape(count, self._padded)[:, : height * width]
        return np.ascontiguousarray(frames).reshape(count, height, width)


class _Tables:
    """The scene table as Dr.Jit buffers, and what is computed from them for a ray."""

    def __init__(self, table: SceneTable, mi: Any) -> None:
        self._table = table
        self._first_record = mi.UInt32(table.first_record)
        self._planes = mi.Float(table.planes.ravel())
        textures = table.textures
        u, v = table.u_maps, table.v_maps
        # The texture's own uv transform is affine too: fold it into the record's maps.
        own = textures.uv_maps[textures.texture_of]
        offset = np.array([0, 0, 0, 1], np.float32)
        self._uv_maps = [
            mi.Float((own[:, i, :1] * u + own[:, i, 1:2] * v + own[:, i, 2:] * offset).ravel()) for i in (0, 1)
        ]
        smooth = table.normal_maps
        self._normal_maps = [] if smooth is None else [mi.Float(smooth[:, axis].ravel()) for axis in range(3)]
        self._texture_of = mi.UInt32(textures.texture_of)
        self._sizes = mi.Int32(textures.sizes.ravel())
        self._wraps = sorted(set(textures.sizes[:, 3].tolist()))
        self._two_sided = mi.UInt32(table.two_sided)
        self._texels = [mi.Float(textures.texels(group)) for group in range(len(textures.group_weights))]

    def hit(self, ray: Any) -> tuple[Any, Any, Any, Any]:
        """(distance in units of the direction, whether anything is hit, the triangle's record and its normal)."""
        import drjit as dr
        import mitsuba as mi

        found = self._table.scene.ray_intersect_preliminary(ray, coherent=True)
        hit = found.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, found.shape)
        record = dr.gather(mi.UInt32, self._first_record, shape, hit) + found.prim_index
        plane = dr.gather(mi.Vector4f, self._planes, record, hit)
        normal = plane.xyz
        distance = -(dr.dot(normal, ray.o) + plane.w) / dr.dot(normal, ray.d)
        return distance, hit, record, normal

    def luma(self, ray: Any) -> Any:
        """Linear luma along a ray."""
        import drjit as dr
        import mitsuba as mi

        distance, hit, record, plane_normal = self.hit(ray)
        point = dr.fma(ray.d, distance, ray.o)
        normal = self._smooth_normal(point, record, hit) if self._normal_maps else plane_normal
        # Lambert's cosines count on the side that is seen; the back of a one-sided surface is black.
        facing = -dr.sign(dr.dot(normal, ray.d))
        lit = hit & ((facing > 0) | (dr.gather(mi.UInt32, self._two_sided, record, hit) == 1))
        reflectances = self._reflectances(point, record, hit)
        total = dr.zeros(mi.Float, dr.width(point))
        for light in self._table.lights:
            irradiance = self._irradiance_over_pi(light, point, normal * facing, plane_normal, lit)
            total += reflectances[light.group] * irradiance
        return dr.select(hit, dr.select(lit, total, 0), self._table.background_luma)

    def _smooth_normal(self, point: Any, record: Any, hit: Any) -> Any:
        import drjit as dr
        import mitsuba as mi

        rows = [dr.gather(mi.Vector4f, rows, record, hit) for rows in self._normal_maps]
        return dr.normalize(mi.Vector3f(*(dr.dot(row.xyz, point) + row.w for row in rows)))

    def _reflectances(self, point: Any, record: Any, hit: Any) -> list[Any]:
        """Bilinear texture lookup: the reflectance as luma, for each light colour."""
        import drjit as dr
        import mitsuba as mi

        texture = dr.gather(mi.UInt32, self._texture_of, record, hit)
        first, width, height, wrap = dr.gather(mi.Vector4i, self._sizes, texture, hit)
        rows = [dr.gather(mi.Vector4f, rows, record, hit) for rows in self._uv_maps]
        u, v = (dr.dot(row.xyz, point) + row.w for row in rows)
        columns, fx = self._texels_along(u, width, wrap)
        lines, fy = self._texels_along(v, height, wrap)
        lines = [first + line * width for line in lines]

        def lookup(texels: Any) -> Any:
            corner = [
                [dr.gather(mi.Float, texels, mi.UInt32(line + column), hit) for column in columns] for line in lines
            ]
            top, bottom = (dr.lerp(left, right, fx) for left, right in corner)
            return dr.lerp(top, bottom, fy)

        return [lookup(texels) for texels in self._texels]

    def _texels_along(self, u: Any, n: Any, wrap: Any) -> tuple[list[Any], Any]:
        """The two texels of n beside a coordinate, and the weight of the second; without a slow integer division.

        The same as :func:`scene_texture.wrap_index` on whole texels; only the modes that the scene has are compiled.
        """
        import drjit as dr
        import mitsuba as mi

        inside = u
        for mode in self._wraps:
            if WRAP_MODES[mode] == "clamp":
                folded = dr.clip(u, 0, 1)
            elif WRAP_MODES[mode] == "repeat":
                folded = u - dr.floor(u)
            else:
                period = u - 2 * dr.floor(u * 0.5)
                folded = dr.minimum(period, 2 - period)
            inside = dr.select(wrap == mode, folded, inside)
        x = dr.fma(inside, mi.Float(n), -0.5)
        x0 = dr.floor(x)
        left = mi.Int32(x0)
        right = left + 1
        last = n - 1
        repeats = wrap == WRAP_MODES.index("repeat")
        beyond_left, beyond_right = dr.select(repeats, last, 0), dr.select(repeats, 0, last)
        return [dr.select(left < 0, beyond_left, left), dr.select(right > last, beyond_right, right)], x - x0

    def _irradiance_over_pi(self, light: Light, point: Any, normal: Any, plane_normal: Any, active: Any) -> Any:
        """What a white diffuse surface reflects: irradiance / pi, in the light's strongest channel."""
        import drjit as dr
        import mitsuba as mi

        if light.kind == "constant":
            return light.strength
        vector = mi.Vector3f(*light.vector.tolist())
        if light.kind == "point":
            to_light = vector - point
            squared = dr.squared_norm(to_light)
            value = light.strength / dr.pi * dr.maximum(dr.dot(normal, to_light), 0) / (squared * dr.sqrt(squared))
        else:
            to_light = -vector
            value = light.strength / dr.pi * dr.maximum(dr.dot(normal, to_light), 0)
        if self._table.shadows:
            value = dr.select(self._occluded(light, point, plane_normal, to_light, active & (value > 0)), 0, value)
        return value

    def _occluded(self, light: Light, point: Any, plane_normal: Any, to_light: Any, active: Any) -> Any:
        import drjit as dr
        import mitsuba as mi

        # Step off the surface by its float32 rounding error, to the light's side, as Mitsuba's own integrators do.
        step = (1 + dr.max(dr.abs(point))) * (1500 * 2.0**-24)
        origin = point + plane_normal * dr.mulsign(step, dr.dot(plane_normal, to_light))
        if light.kind == "point":
            end = mi.Vector3f(*light.vector.tolist()) - origin
            return self._table.scene.ray_test(mi.Ray3f(origin, end, 1 - 1e-3, 0, []), active)
        return self._table.scene.ray_test(mi.Ray3f(origin, to_light), active)
