"""Gives rays of a differentiable renderer what moves and flickers at the times of their views."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, JitIndex, JitRay
from ..render.motion.scene_motion import SceneMotion
from ..render.scene_tables.scene_table import SceneTable
from ..render.table.moving_lanes import Body, Surroundings

FloatArray = npt.NDArray[np.float64]


class SceneAt:
    """A scene's objects and lights at n times, as constants; rays keep their derivatives.

    Args:
        t_s: (n,) seconds.
    """

    def __init__(self, motion: SceneMotion, table: SceneTable, t_s: FloatArray) -> None:
        self._state = motion.at(t_s) if motion else None
        columns = {name: column for column, name in enumerate(motion.lights)}
        self._columns = [columns.get(light.name) for light in table.lights]

    def around(self, ray: JitRay, view: JitIndex) -> Surroundings | None:
        """Return the surroundings of rays, each at time number ``view``; None where nothing ever changes."""
        import drjit as dr
        import mitsuba as mi

        state = self._state
        if state is None:
            return None

        def gather(table: FloatArray) -> list[JitFloat]:
            columns = np.ascontiguousarray(table.reshape(len(table), -1).T, np.float32)
            return [dr.gather(mi.Float, mi.Float(column), view) for column in columns]

        bodies = []
        for poses in state.objects:
            position, rotation = mi.Point3f(gather(poses.positions)), mi.Matrix3f(*gather(poses.rotations))
            own = mi.Ray3f(mi.Point3f(rotation.T @ mi.Vector3f(ray.o - position)), rotation.T @ ray.d)
            bodies.append(Body(own, position, rotation, None))
        factors = [None if column is None else gather(state.factors[:, [column]])[0] for column in self._columns]
        return Surroundings(bodies, factors)
