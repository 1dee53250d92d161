"""Turns the drawn parameters of a sequence into a scene, a path and settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from .._core import CrossingEngine
from .._util.argument_error import Argument, told
from .._util.array_types import JsonObject, JsonValue
from .._util.close_names import without_unit
from .._util.memory_forecast import MemoryForecast
from ..geometry.pose import Pose
from ..geometry.trajectory.trajectory import align
from ..scene.files.mesh_scene import Axis
from ..scene.load import load_scene, start_pose
from ..scene.scene import Scene
from ..sensor.effects import Effects
from ..sensor.effects.effects import read_effects
from ..sensor.rig import Rig, load_rig
from ..simulation.rig.rig_cameras import scene_of_camera, settings_of_camera
from ..simulation.settings import (
    FolderSettings,
    chosen_sampling,
    complete,
    make_imu,
    make_motion_capture,
    memory_of,
    settings_of,
    view_scene,
)
from .motion import make_motion, moved
from .random_scene import make_random_scene
from .sequence_plan import FORMER_KEYS, KEYS, SETTINGS, resolve

Made = TypeVar("Made")

OF_FILES = ("up", "scale", "animation", "grey_unknown")
"""The keys of a plan that go with the name of a file."""


class SceneKey(NamedTuple):
    """Holds what :func:`~davis_rs.load_scene` takes."""

    name: str
    up: Axis | None
    scale: float | None
    animation: str | None
    grey_unknown: bool

    def load(self) -> Scene:
        """Load the scene."""
        return load_scene(
            self.name, up=self.up, scale=self.scale, animation=self.animation, grey_unknown=self.grey_unknown
        )


@dataclass(frozen=True)
class DrawnSequence:
    """Describes a sequence of a plan, which any process can make that sees the plan's files.

    Attributes:
        name: of its folder.
        index: in the plan.
        parameters: what was drawn for it, see :meth:`SequencePlan.parameters`.
        base: the folder that files are relative to.
        plan_sha256: of its plan.
        accept_noise: make it however many of its events are Monte Carlo noise.
    """

    name: str
    index: int
    parameters: Mapping[str, JsonValue]
    base: Path
    plan_sha256: str
    accept_noise: bool = False

    def __str__(self) -> str:
        return self.name

    @cached_property
    def settings(self) -> JsonObject:
        """Return the settings of :func:`~davis_rs.simulate_to_folder`: neither the scene's keys nor the path's."""
        present = {FORMER_KEYS.get(key, key): value for key, value in self.parameters.items()}
        given = {SETTINGS[key].name: value for key, value in present.items() if key in SETTINGS}
        for name in ("camera", "sensor"):
            if given.get(name) is not None:
                given[name] = resolve(name, given[name], self.base)
        for name in ("effects", "imu_effects"):
            if isinstance(given.get(name), Mapping):
                # One without a value has its own defaults.
                given[name] = {key: {} if value is None else value for key, value in given[name].items()}
        return given

    @property
    def rig(self) -> Rig | None:
        """Return the rig; None for one camera alone."""
        named = self.parameters.get("rig")
        return None if named is None else load_rig(resolve("rig", named, self.base))

    @property
    def scene_key(self) -> SceneKey | None:
        """Return what :func:`~davis_rs.load_scene` takes; None for a scene that is drawn for this sequence."""
        named = self.parameters["scene"]
        if not isinstance(named, str):
            return None
        up, scale, animation, grey_unknown = (self.parameters.get(key) for key in OF_FILES)
        return SceneKey(resolve("scene", named, self.base), up, scale, animation, bool(grey_unknown))

    def scene(self) -> Scene:
        """Load or draw the scene, without the settings' light."""
        if self.scene_key is not None:
            return self.scene_key.load()
        if given := [key for key in OF_FILES if self.parameters.get(key) is not None]:
            raise ValueError(f"{' and '.join(given)}: for a scene's file, not for a scene that is drawn")
        return make_random_scene(self.parameters["scene"], self._end_s, self.base)

    @property
    def _end_s(self) -> float | None:
        """Return the end of the sequence on the camera's path, if the plan says so."""
        duration_s: float | None = self.parameters.get("duration")
        return None if duration_s is None else (self.parameters.get("start") or 0.0) + duration_s

    def on_path(self, scene: Scene) -> Scene:
        """Give a scene the part of the camera's path that is simulated, from t = 0.

        Raises:
            ValueError: as :func:`make_motion`, or if there is no such part.
            OSError: if a file cannot be read.
        """
        start_s = self.parameters.get("start") or 0.0
        duration_s, motion = self.parameters.get("duration"), self.parameters.get("motion")
        start = self._start_pose(scene, start_s)
        path = None
        if motion is not None:
            path = make_motion(motion, scene, self._end_s, self.base, start)
        elif start is not None:
            path = align(scene.path, start, start_s)
        if path is not None:
            # One bake serves all sequences in a world: it is finest along the world's own path.
            scene = replace(scene, trajectory=path, baked_along=scene.path_of_bake)
        return scene.crop(start_s, duration_s)

    def _start_pose(self, scene: Scene, start_s: float) -> Pose | None:
        """Return where the plan has the camera's path start; None if it does not say."""
        given = self.parameters.get("start_pose")
        if given is None:
            return None
        if "time" in given and self.parameters.get("motion") is None:
            raise ValueError("time is where on the scene's own path a motion starts; without a motion give start")
        if scene.trajectory is None and "time" in given:
            raise ValueError(f"scene {scene.name!r} has no path of its own: time must not be given")
        if scene.trajectory is None:
            return moved(start_pose(scene), given)
        if "time" not in given:
            return moved(scene.path.pose(start_s if self.parameters.get("motion") is None else 0.0), given)
        if not 0 <= given["time"] <= scene.path.duration_s:
            raise ValueError(f"time must lie on the scene's path, 0..{scene.path.duration_s:g} s, got {given['time']}")
        return moved(scene.path.pose(given["time"]), given)

    def check(self, scene_of: Callable[[DrawnSequence], Scene] = scene) -> MemoryForecast:
        """Refuse what can be refused without rendering; the rest shows when the simulator is made.

        Args:
            scene_of: the sequence's scene; sequences of one plan may share theirs.

        Returns:
            What the sequence is forecast to take, without its rays.

        Raises:
            ValueError: naming sequence, keys, values and rule.
        """
        scene = self._named(lambda: scene_of(self), "scene", *OF_FILES)
        self._named(lambda: self.on_path(scene), "motion", "start_pose", "start", "duration")
        declared = settings_of(FolderSettings)
        for name, value in self.settings.items():
            self._named(partial(declared[name].check, value), declared[name].key)
        settings = complete(FolderSettings, self.settings, taker=str(self))
        rig = self._named(lambda: self.rig, "rig")
        if rig is not None:
            whole = self._named(lambda: self.on_path(scene), "motion")
            cameras = range(len(rig.cameras))
            self._named(lambda: [scene_of_camera(whole, rig, camera) for camera in cameras], "rig")
            settings = self._named(lambda: [settings_of_camera(settings, rig, camera) for camera in cameras], "rig")[0]
        viewed = self._named(lambda: view_scene(scene, settings), "camera", "size", "sensor")
        self._named(lambda: viewed.sensor_effects, "lux_per_luma")
        self._named(lambda: chosen_sampling(settings), "render_rate", "max_displacement", "tolerance")
        self._named(lambda: make_motion_capture(settings), *(name for name in _CAPTURE if name in self.parameters))
        self._named(lambda: make_imu(settings), "imu", "imu_rate", "imu_effects")
        effects, _ = self._named(lambda: read_effects(settings.effects), "effects")
        self._named(
            lambda: _check_engine(settings, effects),
            *("contrast_threshold", "contrast_threshold_off", "log_eps", "effects"),
        )
        memory = memory_of(
            viewed.camera, settings, effects.with_defaults(viewed.sensor_effects), refine=bool(settings.refine)
        )
        self._named(memory.refuse, "size", "camera", "sensor")
        return memory

    def _named(self, make: Callable[[], Made], *keys: str) -> Made:
        try:
            return make()
        except (ValueError, OSError) as error:
            given = {key: self.parameters[key] for key in keys if self.parameters.get(key) is not None}
            values = ", ".join(f"{key} = {value!r}" for key, value in given.items()) or keys[0]
            raise ValueError(f"{self.name}: {values}: {told(error, as_key)}") from None


def _check_engine(settings: FolderSettings, effects: Effects) -> None:
    """Have the crossing engine refuse thresholds and effects; what is not given is decided later."""
    given = {
        "contrast_threshold": settings.contrast_threshold,
        "contrast_threshold_off": settings.contrast_threshold_off,
        "log_eps": settings.log_eps,
    }
    thresholds: JsonObject = {name: value for name, value in given.items() if value is not None}
    CrossingEngine(1, 1, **thresholds, effects=effects.engine_settings())


def as_key(argument: Argument) -> str:
    """Write an argument as a plan has it: ``frame_rate``, or with a value ``effects: auto``."""
    key = without_unit(argument.name)
    key = key if key in KEYS else argument.name
    return f"{key}: {argument.value.lower()}" if argument.value else key


_CAPTURE = ("pose_rate", "pose_noise", "rotation_noise", "clock_offset", "clock_drift")
