"""Describes a run for meta.json: all that a repetition needs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict

import numpy as np

from .._core import __version__
from .._mitsuba.variants import versions
from ..geometry.camera import Camera
from ..render.base import Renderer
from ..scene.lost_looks import LostLook
from ..scene.scene import Scene
from ..sensor.effects import CustomEffects, Effects
from ..sensor.parameters import SensorParameters
from .model_version import MODEL

_LEFT_OUT = {"camera", "size", "effects", "custom_effects", "poses_per_launch", "threads"}


class RunDescription(TypedDict):
    """Holds what ``meta.json`` says of every run, in JSON's types.

    Attributes:
        davis_rs: our version.
        model: the version of the model that events are made by.
        versions: of the libraries that render and count.
        scene: its name, files and their hashes.
        parameters: the settings that results depend on, by name.
        effects: of the pixels, readout and frames, by name, with their parameters.
    """

    davis_rs: str
    model: int
    versions: dict[str, str]
    scene: dict[str, object]
    parameters: dict[str, object]
    effects: Mapping[str, object]


class SimulatorDescription(RunDescription):
    """Holds what ``meta.json`` says of a simulator, next to what :class:`RunDescription` has.

    Attributes:
        camera: lens and size of the image.
        sensor: its width and height in pixels.
        renderer: its name, and why it renders.
        custom_effects: those of the user's own.
        lost_looks: of each look that is not rendered, the fraction of the image; None for a look of no shape.
    """

    camera: dict[str, object]
    sensor: dict[str, int]
    renderer: dict[str, str]
    custom_effects: list[dict[str, object]]
    lost_looks: dict[str, float | None]


def describe_run(
    scene: Scene,
    camera: Camera,
    renderer: Renderer,
    effects: Effects,
    settings: Mapping[str, object],
    *,
    custom_effects: CustomEffects,
    lost_looks: Mapping[LostLook, float | None],
) -> SimulatorDescription:
    """Describe versions, scene, camera, renderer, effects and settings, in JSON's types.

    Args:
        scene, camera, renderer, effects, custom_effects, lost_looks: those of the run.
        settings: by name, each with the value that it came to. Those that results do not depend on, and those that are
            told elsewhere (camera and effects), are left out.
    """
    kept = {name: value for name, value in settings.items() if name not in _LEFT_OUT}
    sensor = kept["sensor"]
    return {
        "davis_rs": __version__,
        "model": MODEL,
        "versions": {"numpy": np.__version__, **versions(renderer.variant)},
        "scene": _describe_scene(scene),
        "camera": asdict(camera),
        "sensor": {"width": camera.width, "height": camera.height},
        "renderer": {"name": renderer.name, "reason": renderer.reason},
        "parameters": {**kept, "sensor": asdict(sensor) if isinstance(sensor, SensorParameters) else sensor},
        "effects": effects.describe(),
        "custom_effects": custom_effects.describe(),
        "lost_looks": {str(look): fraction for look, fraction in lost_looks.items()},
    }


def _describe_scene(scene: Scene) -> dict[str, object]:
    described: dict[str, object] = {"name": scene.name, "lux_per_luma": scene.lux_per_luma}
    if scene.file is not None:
        described |= {"file": scene.file_name or str(scene.file), "sha256": _sha256(scene.file)}
    if scene.file is not None and scene.files:
        described["files"] = {os.path.relpath(file, scene.file.parent): _sha256(file) for file in scene.files}
    if scene.variables:
        described["variables"] = dict(scene.variables)
    if scene.note:
        described["note"] = scene.note
    described["objects"] = {name: trajectory.describe() for name, trajectory in scene.objects.items()}
    if scene.deformations:
        described["deformations"] = {name: each.describe() for name, each in scene.deformations.items()}
    described["lights"] = {name: profile.describe() for name, profile in scene.lights.items()}
    return described


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
