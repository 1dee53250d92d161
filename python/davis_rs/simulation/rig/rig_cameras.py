"""Says what each camera of a rig simulates: its scene, by its own clock, and its settings."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..._util.argument_error import ArgumentError
from ...geometry.pose import Pose
from ...geometry.trajectory.derived import MountedTrajectory
from ...geometry.trajectory.trajectory import Trajectory
from ...scene.scene import Scene
from ...sensor.rig import Rig
from ...sensor.rig.rig import member_seed
from ..settings import CustomSettings

SettingsType = TypeVar("SettingsType", bound=CustomSettings)


def scene_of_camera(scene: Scene, rig: Rig, camera: int) -> Scene:
    """Return the scene as a camera of a rig records it: from where its clock shows 0, on the camera's own path.

    Args:
        scene: its camera path, if it has one, is that of the rig's body.
        rig, camera: which camera.

    Raises:
        ValueError: if the camera's clock does not show 0 before the path ends.
    """
    each, begins_s = rig.cameras[camera], rig.begins_s(camera)
    if scene.trajectory is not None and not begins_s < scene.trajectory.duration_s:
        raise ArgumentError(
            "{rig} {!r}: the clock of cam{} shows 0 after {:g} s of the path, which ends at {:g} s",
            *(rig.name, camera, begins_s, scene.trajectory.duration_s),
        )
    recorded = scene.later(begins_s) if scene.trajectory is None else scene.crop(begins_s)
    if each.clock.drift:
        recorded = recorded.paced(each.clock.pace)
    if _at_body(each.mount):
        return recorded
    path: Trajectory | None = recorded.trajectory
    return replace(
        recorded,
        trajectory=None if path is None else MountedTrajectory(path, each.mount),
        baked_along=scene.path_of_bake,
        start=None if recorded.start is None else recorded.start @ each.mount,
    )


def _at_body(mount: Pose) -> bool:
    """Return whether a camera is where the body is, so that its path is the body's, bit by bit."""
    return not mount.position.any() and np.array_equal(mount.quaternion, (0.0, 0.0, 0.0, 1.0))


def settings_of_camera(settings: SettingsType, rig: Rig, camera: int) -> SettingsType:
    """Return the settings of a camera of a rig: the given ones with its lens, its sensor and its seed.

    Raises:
        ValueError: for settings that the rig decides, or that only a single camera can have.
    """
    each = rig.cameras[camera]
    if settings.camera is not None or settings.size is not None:
        raise ArgumentError("{camera} and {size} are those of the {rig}'s cameras: leave them out")
    if settings.sensor is not None and all(other.sensor is not None for other in rig.cameras):
        raise ArgumentError("{sensor} would be ignored, because each camera of the {rig} has its own: leave it out")
    if settings.custom_effects and len(rig.cameras) > 1:
        raise ArgumentError("{custom_effects} may remember what one camera has seen: a {rig} of {} cameras cannot "
                            "share them", len(rig.cameras))  # fmt: skip
    return replace(
        settings,
        camera=each.camera,
        sensor=settings.sensor if each.sensor is None else each.sensor,
        seed=member_seed(settings.seed, camera),
    )
