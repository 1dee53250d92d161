"""Describes what changes in a scene besides the camera: objects that move, and lights whose strength varies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number
from ..._util.argument_error import ArgumentError
from ...geometry.pose import FloatArray, Pose, PoseLike, as_pose
from ...geometry.trajectory.steered import SteeredPath
from ...geometry.trajectory.trajectory import TIME_TOLERANCE_S, Trajectory
from ...geometry.trajectory.views import Views
from ...scene.deformation import Deformation
from ...scene.light_profile import LightProfile
from ...scene.steered_profile import SteeredProfile


@dataclass(frozen=True, eq=False)
class SceneState:
    """Holds the state of a scene at n instants.

    Attributes:
        objects: pose and motion of each moving object at the instants: T_world_object, rates in the object's axes.
        factors: (n, lights), by which the strengths of the lights with a profile are multiplied.
        rates: (n, lights), the derivatives of the factors, per second.
        t_s: (n,), the instants, at which meshes deform.
        scale: how many times as large the world is as that of the deformations.
    """

    objects: tuple[Views, ...]
    factors: FloatArray
    rates: FloatArray
    t_s: FloatArray
    scale: float = 1.0

    def moved(self, step_s: FloatArray) -> SceneState:
        """Return the state (n,) seconds after each instant, at constant velocity, body rate and rate."""
        factors = self.factors + self.rates * step_s[:, None]
        objects = tuple(pose.moved(step_s) for pose in self.objects)
        return replace(self, objects=objects, factors=factors, t_s=self.t_s + step_s)

    def scaled(self, factor: float) -> SceneState:
        """Return the same state in a world that is ``factor`` times as large."""
        return replace(self, objects=tuple(pose.scaled(factor) for pose in self.objects), scale=factor * self.scale)


@dataclass(frozen=True, eq=False)
class Steering:
    """Holds what a caller moves and dims in a step: poses of objects and factors of lights, by their ids."""

    objects: Mapping[str, Pose]
    lights: Mapping[str, float]


class SceneMotion:
    """Holds the trajectories of a scene's objects and the profiles of its lights, by their ids.

    Args:
        boxes: for each object the lowest and highest corner (2, 3) around it in its own frame, metres.
        bends_s: seconds at which the rate of luma jumps, besides those that paths and profiles tell.
        deformations: of the objects whose meshes deform.
    """

    def __init__(
        self,
        objects: Mapping[str, Trajectory],
        lights: Mapping[str, LightProfile],
        boxes: Mapping[str, npt.ArrayLike],
        bends_s: npt.ArrayLike = (),
        deformations: Mapping[str, Deformation] = {},
    ) -> None:
        self.bends_s = np.asarray(bends_s, np.float64)
        # What a caller moves starts anew for each simulation of a scene.
        self._paths = {name: SteeredPath() for name, path in objects.items() if isinstance(path, SteeredPath)}
        self._strengths = {
            name: SteeredProfile() for name, light in lights.items() if isinstance(light, SteeredProfile)
        }
        self.objects: dict[str, Trajectory] = {**objects, **self._paths}
        self.lights: dict[str, LightProfile] = {**lights, **self._strengths}
        self.boxes = [np.asarray(boxes[name], np.float64) for name in self.objects]
        self.deformations = dict(deformations)

    def __bool__(self) -> bool:
        """Return whether anything moves or changes."""
        return bool(self.objects or self.lights)

    def with_bends(self, instants: npt.ArrayLike) -> SceneMotion:
        """Return the same motion with ``instants`` as :attr:`bends_s`, if there is more than one."""
        if np.size(instants) < 2:
            return self
        return self._replaced(bends_s=instants)

    def with_lights(self, lights: Mapping[str, LightProfile]) -> SceneMotion:
        """Return the same motion with other profiles of strength."""
        return self._replaced(lights=lights)

    def _replaced(
        self, lights: Mapping[str, LightProfile] | None = None, bends_s: npt.ArrayLike | None = None
    ) -> SceneMotion:
        return SceneMotion(
            self.objects,
            self.lights if lights is None else lights,
            dict(zip(self.objects, self.boxes, strict=True)),
            self.bends_s if bends_s is None else bends_s,
            self.deformations,
        )

    def restart(self) -> None:
        """Put all that a caller moves where the scene has it."""
        for path in self._paths.values():
            path.restart()
        for light in self._strengths.values():
            light.restart()

    def steered(self, objects: Mapping[str, PoseLike], lights: Mapping[str, float]) -> Steering:
        """Check what a caller wants to move and dim.

        Raises:
            ArgumentError: for an object or a light that is not the caller's, what is no pose, or a factor that is not
                finite and >= 0.
        """
        for name in objects:
            if name not in self._paths:
                raise ArgumentError(
                    "of {objects}, {!r} is not the caller's ({}); scene.with_movable names them before the simulator "
                    "is made",
                    name,
                    _listed(self._paths),
                )
        for name in lights:
            if name not in self._strengths:
                raise ArgumentError(
                    "of {lights}, {!r} is not the caller's ({}); scene.with_movable(lights=...) names them before the "
                    "simulator is made",
                    name,
                    _listed(self._strengths),
                )
        poses = {name: as_pose(pose, f"objects[{name!r}]") for name, pose in objects.items()}
        for name, factor in lights.items():
            check_number(f"lights[{name!r}]", factor, 0)
        return Steering(poses, {name: float(factor) for name, factor in lights.items()})

    def steer(self, steering: Steering, start_us: int, end_us: int, *, seen_from_us: float) -> None:
        """Move and dim what :meth:`steered` has checked over (start_us, end_us], or put it there if ``end_us`` is 0.

        Args:
            seen_from_us: nobody looks at an earlier instant any more.
        """
        for name, pose in steering.objects.items():
            if end_us == 0:
                self._paths[name].put(pose)
            else:
                self._paths[name].move(start_us, end_us, pose, seen_from_us=seen_from_us)
        for name, factor in steering.lights.items():
            if end_us == 0:
                self._strengths[name].put(factor)
            else:
                self._strengths[name].change(start_us, end_us, factor, seen_from_us=seen_from_us)

    def steered_alone(self) -> SceneMotion:
        """Return what a caller steers, alone and not steered yet: to follow it by another clock than a camera's."""
        boxes = dict(zip(self.objects, self.boxes, strict=True))
        return SceneMotion(self._paths, self._strengths, {name: boxes[name] for name in self._paths})

    def steering_at(self, t_s: float) -> Steering:
        """Return where all is that a caller steers, and how strong, at a time in seconds of the last step."""
        return Steering(
            {name: path.pose(t_s) for name, path in self._paths.items()},
            {name: float(light.factor(t_s)) for name, light in self._strengths.items()},
        )

    def at(self, t_s: FloatArray) -> SceneState:
        """Return the state of the scene at times (n,) of the sequence, seconds.

        Raises:
            ValueError: where a profile gives another shape, or a factor that is negative or not finite.
        """
        poses = tuple(held(trajectory, t_s) for trajectory in self.objects.values())
        rates = [_checked(name, "rate", light.rate(t_s), t_s, -np.inf) for name, light in self.lights.items()]
        return SceneState(poses, self.factors(t_s), _columns(rates, len(t_s)), t_s)

    def factors(self, t_s: FloatArray) -> FloatArray:
        """Return the factors of :meth:`at` alone."""
        factors = [_checked(name, "factor", light.factor(t_s), t_s, 0.0) for name, light in self.lights.items()]
        return _columns(factors, len(t_s))


STILL = SceneMotion({}, {}, {})
"""A scene in which nothing changes."""


def held(trajectory: Trajectory, t_s: FloatArray) -> Views:
    """Return poses of an object at any times (n,); outside of its trajectory it stands still at the nearer end."""
    inside = np.clip(t_s, 0.0, trajectory.duration_s)
    path = Views.along(trajectory, inside)
    moves = (np.abs(t_s - inside) <= TIME_TOLERANCE_S)[:, None]
    velocities, rates = (np.where(moves, twist, 0.0) for twist in (path.velocities, path.angular_rates))
    return Views(t_s, path.positions, path.rotations, velocities, rates)


def pose_arrays(cameras: Sequence[Views]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return cameras in f frames, n views each, flat as the Rust core takes them.

    These are positions (n, f, 3), rotations (n, f, 3, 3), velocities (n, f, 3) and angular rates (n, f, 3).
    """
    if len(cameras) == 1:
        camera = cameras[0]
        arrays = camera.positions, camera.rotations, camera.velocities, camera.angular_rates
        return arrays[0].ravel(), arrays[1].ravel(), arrays[2].ravel(), arrays[3].ravel()
    positions, rotations, velocities, angular_rates = (
        np.stack([getattr(camera, name) for camera in cameras], 1).ravel()
        for name in ("positions", "rotations", "velocities", "angular_rates")
    )
    return positions, rotations, velocities, angular_rates


def seen_from(cameras: Views, objects: Views) -> Views:
    """Return the cameras in the frames of objects (n each), as if the objects stood still and only the cameras
    moved."""
    to_object = objects.rotations.swapaxes(1, 2)
    offset = cameras.positions - objects.positions
    turning = np.einsum("nij,nj->ni", objects.rotations, objects.angular_rates)  # world axes
    velocities = cameras.velocities - objects.velocities - np.cross(turning, offset)
    return Views(
        cameras.t_s,
        np.einsum("nij,nj->ni", to_object, offset),
        to_object @ cameras.rotations,
        np.einsum("nij,nj->ni", to_object, velocities),
        cameras.angular_rates - np.einsum("nji,nj->ni", cameras.rotations, turning),
    )


def _columns(columns: list[FloatArray], length: int) -> FloatArray:
    return np.stack(columns, 1) if columns else np.empty((length, 0))


def _checked(name: str, quantity: str, values: npt.ArrayLike, t_s: FloatArray, least: float) -> FloatArray:
    array = np.asarray(values, np.float64)
    if array.shape != t_s.shape:
        raise ValueError(f"the {quantity} of light {name!r} must have shape {t_s.shape}, got {array.shape}")
    wrong = ~((array >= least) & np.isfinite(array))
    if wrong.any():
        rule = "finite and >= 0" if least == 0 else "finite"
        raise ValueError(f"the {quantity} of light {name!r} must be {rule}, got {array[wrong][0]} at {t_s[wrong][0]} s")
    return array


def _listed(names: Iterable[str]) -> str:
    """Say which names there are."""
    return f"the caller's: {', '.join(map(repr, names))}" if names else "there are none"
