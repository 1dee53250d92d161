"""One sequence of a plan: what its drawn parameters stand for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from .._core import CrossingEngine
from ..scene.scene import Scene
from ..scenes import load_scene
from ..settings import (
    FolderSettings,
    chosen_sampling,
    complete,
    make_imu,
    make_motion_capture,
    settings_of,
    view_scene,
)
from ..simulation import read_effects
from .motion import make_motion
from .parse import effect_texts
from .sequence_plan import SETTINGS, resolve


@dataclass(frozen=True)
class DrawnSequence:
    """A sequence of a plan, that any process can make which sees the plan's files.

    Attributes:
        name: of its folder.
        index: in the plan.
        parameters: what was drawn for it, see :meth:`SequencePlan.parameters`.
        base: the folder that files are relative to.
        plan_sha256: of its plan.
    """

    name: str
    index: int
    parameters: Mapping[str, Any]
    base: Path
    plan_sha256: str

    def __str__(self) -> str:
        return self.name

    @cached_property
    def settings(self) -> dict[str, Any]:
        """What belongs neither to the scene nor to the path: settings of :func:`~davis_rs.simulate_to_folder`."""
        given = {SETTINGS[key].name: value for key, value in self.parameters.items() if key in SETTINGS}
        for name in ("camera", "sensor"):
            if given.get(name) is not None:
                given[name] = resolve(name, given[name], self.base)
        for name in ("effects", "imu_effects"):
            if isinstance(given.get(name), Mapping):
                given[name] = effect_texts(given[name])
        return given

    @property
    def scene_name(self) -> str:
        """The scene as :func:`~davis_rs.load_scene` takes it."""
        return resolve("scene", self.parameters["scene"], self.base)

    def scene(self) -> Scene:
        """The scene, without the settings' light."""
        return load_scene(self.scene_name, up=self.parameters.get("up"), scale=self.parameters.get("scale"))

    def on_path(self, scene: Scene) -> Scene:
        """The scene with the part of the camera's path that is simulated, from t = 0.

        Raises:
            ValueError: as :func:`make_motion`, or if there is no such part.
            OSError: if a file cannot be read.
        """
        start_s = self.parameters.get("start") or 0.0
        duration_s, motion = self.parameters.get("duration"), self.parameters.get("motion")
        if motion is None:
            return scene.crop(start_s, duration_s)
        end_s = None if duration_s is None else start_s + duration_s
        return scene.with_trajectory(make_motion(motion, scene, end_s, self.base)).crop(start_s, duration_s)

    def check(self, scene_of: Callable[[DrawnSequence], Scene] = scene) -> None:
        """Refuse what can be refused without rendering; the rest shows when the simulator is made.

        Args:
            scene_of: the sequence's scene; sequences of one plan may share theirs.

        Raises:
            ValueError: naming sequence, keys, values and rule.
        """
        scene = self._named(lambda: scene_of(self), "scene", "up", "scale")
        self._named(lambda: self.on_path(scene), "motion", "start", "duration")
        declared = settings_of(FolderSettings)
        for name, value in self.settings.items():
            key = declared[name].key
            self._named(lambda name=name, value=value, key=key: declared[name].check(value, key), key)  # type: ignore[misc]
        settings = complete(FolderSettings, self.settings, of=str(self))
        viewed = self._named(lambda: view_scene(scene, settings), "camera", "size", "sensor")
        self._named(lambda: viewed.sensor_effects, "lux_per_luma")
        self._named(lambda: chosen_sampling(settings), "render_rate", "max_displacement", "tolerance")
        self._named(lambda: make_motion_capture(settings), *(name for name in _CAPTURE if name in self.parameters))
        self._named(lambda: make_imu(settings), "imu", "imu_rate", "imu_effects")
        effects, _ = self._named(lambda: read_effects(settings["effects"]), "effects")
        thresholds = ("contrast_threshold", "contrast_threshold_off", "log_eps")
        given = {name: settings[name] for name in thresholds if settings[name] is not None}
        self._named(lambda: CrossingEngine(1, 1, **given, effects=effects.engine_settings()), *thresholds, "effects")

    def _named(self, make: Callable[[], Any], *keys: str) -> Any:
        try:
            return make()
        except (ValueError, OSError) as error:
            given = {key: self.parameters[key] for key in keys if self.parameters.get(key) is not None}
            values = ", ".join(f"{key} = {value!r}" for key, value in given.items()) or keys[0]
            raise ValueError(f"{self.name}: {values}: {error}") from None


_CAPTURE = ("pose_rate", "pose_noise", "rotation_noise", "clock_offset", "clock_drift")
