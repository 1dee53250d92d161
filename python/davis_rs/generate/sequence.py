"""One sequence of a plan: what its drawn parameters stand for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from .._core import CrossingEngine
from ..dataset.writer import check_image_gain
from ..effects import Effects
from ..lattice import rank1_lattice
from ..rendering.renderers import check_renderer
from ..run_settings import RunSettings
from ..sampling.presets import accuracy_preset
from ..sampling.rules import periodic_instants
from ..scene.scene import Scene
from ..scenes import load_scene
from ..sensor_parameters import sensor_parameters
from .motion import make_motion
from .parse import effect_texts
from .plan import resolve


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
    def settings(self) -> RunSettings:
        """What belongs neither to the scene nor to the path."""
        own = {one.name for one in fields(RunSettings)}
        given = {key: value for key, value in self.parameters.items() if key in own and key != "effects"}
        if given.get("camera") is not None:
            given["camera"] = resolve("camera", given["camera"], self.base)
        effects = self.parameters.get("effects")
        given["effects" if isinstance(effects, str) else "effect"] = (
            effects if isinstance(effects, str) else effect_texts(effects or {})
        )
        return RunSettings(**given, imu_effect=effect_texts(self.parameters.get("imu_effects") or {}))

    @property
    def scene_name(self) -> str:
        """The scene as :func:`~davis_rs.load_scene` takes it."""
        return resolve("scene", self.parameters["scene"], self.base)

    def scene(self) -> Scene:
        """The scene, without the settings' light."""
        return load_scene(self.scene_name)

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
        trajectory = make_motion(motion, scene, end_s, self.base)
        return replace(scene, trajectory=trajectory.crop(start_s, duration_s))

    def check(self, scene_of: Callable[[DrawnSequence], Scene] = scene) -> None:
        """Refuse what can be refused without rendering; the rest shows when the simulator is made.

        Args:
            scene_of: the sequence's scene; sequences of one plan may share theirs.

        Raises:
            ValueError: naming sequence, keys, values and rule.
        """
        scene = self._named(lambda: scene_of(self), "scene")
        self._named(lambda: self.on_path(scene), "motion", "start", "duration")
        settings = self.settings
        self._named(settings.make_camera, "camera")
        self._named(settings.make_sampling, "render_rate", "max_displacement", "tolerance")
        self._named(lambda: accuracy_preset(settings.accuracy), "accuracy")
        self._named(settings.make_motion_capture, *(name for name in _CAPTURE if name in self.parameters))
        self._named(settings.make_imu, "imu", "imu_rate", "imu_effects")
        sensor = self._named(lambda: sensor_parameters(settings.sensor), "sensor")
        self._named(lambda: sensor.effects(settings.make_scene(scene).lux_per_luma), "lux_per_luma")
        self._named(lambda: check_renderer(settings.renderer), "renderer")
        self._named(lambda: check_image_gain(settings.image_gain), "image_gain")
        for key in ("frame_rate", "depth_rate"):
            self._named(lambda key=key: periodic_instants(getattr(settings, key), 0, 0), key)  # type: ignore[misc]
        if settings.samples is not None:
            self._named(lambda: rank1_lattice(settings.samples or 0), "samples")
        effects = self._named(settings.make_effects, "effects")
        thresholds = ("contrast_threshold", "contrast_threshold_off", "log_eps")
        given = {key: value for key in thresholds if (value := getattr(settings, key)) is not None}
        engine = effects.engine_settings() if isinstance(effects, Effects) else {}
        self._named(lambda: CrossingEngine(1, 1, **given, effects=engine), *thresholds, "effects")

    def _named(self, make: Callable[[], Any], *keys: str) -> Any:
        try:
            return make()
        except (ValueError, OSError) as error:
            given = {key: self.parameters[key] for key in keys if self.parameters.get(key) is not None}
            values = ", ".join(f"{key} = {value!r}" for key, value in given.items()) or keys[0]
            raise ValueError(f"{self.name}: {values}: {error}") from None


_CAPTURE = ("pose_rate", "pose_noise", "rotation_noise", "clock_offset", "clock_drift")
