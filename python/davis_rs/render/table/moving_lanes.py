"""Holds what moves and flickers in a scene, for lanes of rays, as Dr.Jit arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._mitsuba.types import JitArray, JitFloat, JitIndex, JitMatrix, JitRay, JitVector
from ...geometry.trajectory.views import Views
from ..motion.scene_motion import SceneState, seen_from
from ..rays.camera_rays import CameraRays, Lanes


class Body(NamedTuple):
    """A moving object, for lanes of rays: the ray in the object's own frame, and the object's pose in the world.

    A point has the same distance along this ray as along the ray in the world. ``turning`` is the object's angular rate
    in world axes; None without rates.
    """

    ray: JitRay
    position: JitVector
    rotation: JitMatrix
    turning: JitVector | None

    def to_world(self, vector: JitVector) -> JitVector:
        """Return a vector of the object in world axes; with motion its tangent too."""
        import drjit as dr

        world = self.rotation @ vector
        return world if self.turning is None else world + _tangent(dr.cross(self.turning, dr.detach(world)))

    def to_own(self, ray: JitRay) -> JitRay:
        """Return a ray of the world in the object's own frame, without derivatives."""
        import mitsuba as mi

        back = self.rotation.T
        return mi.Ray3f(mi.Point3f(back @ (ray.o - self.position)), back @ ray.d, ray.maxt, 0, [])


class Surroundings(NamedTuple):
    """The moving bodies and flickering lights for lanes of rays; a factor is None where a light is
    steady."""

    bodies: Sequence[Body]
    factors: Sequence[JitFloat]


class MovingLanes:
    """The objects' frames and the lights' factors at the views of many lanes.

    Args:
        profiles: for each light the column of its profile in ``state``, or None.
    """

    def __init__(
        self,
        camera_rays: CameraRays,
        state: SceneState,
        views: Views,
        view: JitIndex,
        pixel: JitIndex,
        *,
        profiles: Sequence[int | None],
        motion: bool,
    ) -> None:
        self._camera_rays = camera_rays
        self._bodies: list[tuple[Lanes, Lanes]] = [
            (
                camera_rays.lanes(seen_from(views, poses), view, pixel, motion=motion),
                camera_rays.lanes(poses, view, pixel, motion=motion),
            )
            for poses in state.objects
        ]
        self._factors = [None if column is None else _lanes_of(state, column, view, motion) for column in profiles]

    def of_rays(self, sample: JitIndex, rays: int) -> Surroundings:
        """Return the surroundings of lattice ray ``sample`` of ``rays``, with tangents where the lanes have motion."""
        bodies = [
            Body(
                self._camera_rays.ray(seen, sample, rays),
                pose.origin,
                pose.axes,
                None if pose.motion is None else pose.motion[1],
            )
            for seen, pose in self._bodies
        ]
        factors = [
            None if lane is None else lane[0] + (0 if lane[1] is None else _tangent(lane[1])) for lane in self._factors
        ]
        return Surroundings(bodies, factors)


def _lanes_of(state: SceneState, column: int, view: JitIndex, motion: bool) -> tuple[JitFloat, JitFloat | None]:
    """Return the factor and rate of a profile at the lanes' views."""
    import drjit as dr
    import mitsuba as mi

    tables = (state.factors, state.rates) if motion else (state.factors,)
    lanes = [dr.gather(mi.Float, mi.Float(table[:, column].astype(np.float32)), view) for table in tables]
    return lanes[0], lanes[1] if motion else None


def _tangent(rate: JitArray) -> JitArray:
    """Return zeros whose forward-mode derivative is ``rate``."""
    import drjit as dr

    zero = dr.zeros(type(rate), dr.width(rate))
    dr.enable_grad(zero)
    dr.set_grad(zero, rate)
    return zero
