"""Mitsuba's own integrators on our own rays, for every scene that the table kernel does not cover."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._mitsuba import FAST, SCALAR, variant
from .camera import Camera
from .luma import LUMA_WEIGHTS, LumaFrames
from .pose import Pose
from .render import Renderer, ray_table


def _integrator(scene: Any, mi: Any) -> Any:
    """The scene's integrator; path tracing where it names none.

    Raises:
        ValueError: for one that cannot be asked what a ray sees: a particle tracer, or one made for derivatives.
    """
    integrator = scene.integrator() or mi.load_dict({"type": "path"})
    if not isinstance(integrator, mi.SamplingIntegrator) or isinstance(integrator, mi.CppADIntegrator):
        raise ValueError(
            f"the scene asks for Mitsuba's {type(integrator).__name__}, which cannot follow single rays; "
            "name one that can (direct, path, volpath)"
        )
    return integrator


class IntegratorRenderer(Renderer):
    """Any scene, through the integrator that it names, in the LLVM variant.

    Every frame draws the same random numbers, so that a still image makes no events.
    """

    variant = FAST
    poses_per_launch = 1

    def __init__(self, scene: Any, camera: Camera, *, samples: int, blur: bool, seed: int, reason: str) -> None:
        super().__init__(camera, samples=samples, blur=blur)
        self._scene, self._seed, self.reason = scene, seed, reason
        with variant(FAST) as (mi, _):
            self._integrator = _integrator(scene, mi)
            # The rays of a pixel lie side by side, to be summed in order.
            columns = ray_table(camera, samples).transpose(2, 1, 0).astype(np.float32)
            self._rays = [mi.Float(np.ascontiguousarray(column).ravel()) for column in columns]
            centres = ray_table(camera, 1)[0].T.astype(np.float32)
            self._centre_rays = [mi.Float(np.ascontiguousarray(column)) for column in centres]
            self._sampler = mi.load_dict({"type": "independent"})
        self.name = f"Mitsuba's {self._integrator.class_name()}"

    def _luma(self, poses: Sequence[Pose]) -> LumaFrames:
        return np.stack([self._one(pose) for pose in poses])

    def _one(self, pose: Pose) -> LumaFrames:
        with variant(FAST) as (mi, dr):
            rays = self._camera_rays(pose, self._rays, mi)
            self._sampler.seed(self._seed, dr.width(self._rays[0]))
            colour, valid, *_ = self._integrator.sample(
                self._scene, self._sampler, mi.RayDifferential3f(rays), None, True
            )
            del valid  # a ray that hits nothing has the background's colour
            luma = colour[0] * LUMA_WEIGHTS[0] + colour[1] * LUMA_WEIGHTS[1] + colour[2] * LUMA_WEIGHTS[2]
            total = dr.block_sum(luma, self.samples) / self.samples
            return np.array(total, np.float32).reshape(self.camera.height, self.camera.width)

    def depth(self, poses: Sequence[Pose]) -> npt.NDArray[np.float32]:
        with variant(FAST) as (mi, dr):
            depths = []
            for pose in poses:
                found = self._scene.ray_intersect_preliminary(
                    self._camera_rays(pose, self._centre_rays, mi), coherent=True
                )
                # Directions are unit here and camera-frame z is 1 before: t over the length is z.
                length = dr.sqrt(dr.square(self._centre_rays[0]) + dr.square(self._centre_rays[1]) + 1)
                z = dr.select(found.is_valid(), found.t / length, dr.inf)
                depths.append(np.array(z, np.float32).reshape(self.camera.height, self.camera.width))
            return np.stack(depths)

    @staticmethod
    def _camera_rays(pose: Pose, rays: list[Any], mi: Any) -> Any:
        axes = [mi.Vector3f(axis) for axis in pose.rotation.T.astype(np.float32).tolist()]
        direction = axes[0] * rays[0] + axes[1] * rays[1] + axes[2]
        # Integrators expect unit directions.
        import drjit as dr

        return mi.Ray3f(mi.Point3f(pose.position.astype(np.float32).tolist()), dr.normalize(direction))


class ScalarRenderer(Renderer):
    """The same without LLVM: one ray after the other in Mitsuba's scalar variant. Slow, but it runs everywhere.

    Each ray seeds the sampler by its own number, so that its random numbers never depend on its neighbours' paths.
    """

    variant = SCALAR
    poses_per_launch = 1

    def __init__(self, scene: Any, camera: Camera, *, samples: int, blur: bool, seed: int, reason: str) -> None:
        super().__init__(camera, samples=samples, blur=blur)
        self._scene, self._seed, self.reason = scene, seed, reason
        with variant(SCALAR) as (mi, _):
            self._integrator = _integrator(scene, mi)
            self._sampler = mi.load_dict({"type": "independent"})
        self._rays = self._unit_rays(samples)
        self._centre_rays = self._unit_rays(1)
        self.name = f"Mitsuba's {self._integrator.class_name()}, scalar"

    def _unit_rays(self, samples: int) -> npt.NDArray[np.float64]:
        """Unit directions (H * W * samples, 3) in camera axes, a pixel's rays side by side."""
        xy = ray_table(self.camera, samples).transpose(1, 0, 2).reshape(-1, 2)
        directions = np.concatenate([xy, np.ones((len(xy), 1))], 1)
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def _luma(self, poses: Sequence[Pose]) -> LumaFrames:
        return np.stack([self._one(pose) for pose in poses])

    def _one(self, pose: Pose) -> LumaFrames:
        with variant(SCALAR) as (mi, _):
            origin = mi.Point3f(*pose.position.tolist())
            scene, sampler, sample, seed = self._scene, self._sampler, self._integrator.sample, self._seed
            make_ray, make_vector = mi.RayDifferential3f, mi.Vector3f
            red, green, blue = LUMA_WEIGHTS
            values = []
            for number, (x, y, z) in enumerate((self._rays @ pose.rotation.T).tolist()):
                sampler.seed(seed + number)
                colour = sample(scene, sampler, make_ray(origin, make_vector(x, y, z)))[0]
                values.append(red * colour[0] + green * colour[1] + blue * colour[2])
            luma = np.array(values).reshape(self.camera.height, self.camera.width, self.samples)
            return luma.mean(-1).astype(np.float32)

    def depth(self, poses: Sequence[Pose]) -> npt.NDArray[np.float32]:
        with variant(SCALAR) as (mi, _):
            depths = []
            for pose in poses:
                origin = mi.Point3f(*pose.position.tolist())
                directions = (self._centre_rays @ pose.rotation.T).tolist()
                hit = self._scene.ray_intersect_preliminary
                # A miss has t = inf; the unit direction's camera-frame z turns distance into depth.
                distance = np.array([hit(mi.Ray3f(origin, d), True).t for d in directions])
                depths.append((distance * self._centre_rays[:, 2]).reshape(self.camera.height, self.camera.width))
            return np.stack(depths).astype(np.float32)
