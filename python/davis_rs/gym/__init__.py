"""Puts a simulated event camera into the loop of a controller: environments of Gymnasium (extra ``gym``).

``environment`` is the environment. ``bodies`` say what an action does to the camera, ``tasks`` what is wanted and
what moves, ``observations`` what a controller sees; ``marker`` is a task with its scene. Importing this package
registers the environments that it has by their ids.
"""

from .._util.extras import from_extra

with from_extra("gym"):
    import gymnasium as _gymnasium

from .bodies import Body, BodyState, PointMassBody, PoseBody, QuadrotorBody, VelocityBody
from .environment import EventCameraEnv
from .marker import KeepCentred, marker_env, marker_scene
from .observations import OBSERVATIONS
from .tasks import Moment, Task, Verdict

__all__ = [
    "OBSERVATIONS",
    "Body",
    "BodyState",
    "EventCameraEnv",
    "KeepCentred",
    "Moment",
    "PointMassBody",
    "PoseBody",
    "QuadrotorBody",
    "Task",
    "VelocityBody",
    "Verdict",
    "marker_env",
    "marker_scene",
]

for _name, _body in (("Marker", "velocity"), ("MarkerPose", "pose"), ("MarkerPointMass", "point_mass"),
                     ("MarkerQuadrotor", "quadrotor")):  # fmt: skip
    _gymnasium.register(f"davis_rs/{_name}-v0", entry_point="davis_rs.gym.marker:marker_env", kwargs={"body": _body})
