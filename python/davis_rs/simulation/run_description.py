"""What meta.json says of a run: all that a repetition needs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .._core import __version__
from .._mitsuba.variants import versions
from ..geometry.camera import Camera
from ..render.base import Renderer
from ..scene.scene import Scene
from ..sensor.effects import Effects
from .model_version import MODEL

_LEFT_OUT = {"camera", "size", "effects", "custom_effects", "poses_per_launch", "threads"}


def describe_run(
    scene: Scene, camera: Camera, renderer: Renderer, effects: Effects, settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Versions, scene, camera, renderer, effects and settings, in JSON's types.

    Args:
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
        "parameters": {**kept, "sensor": sensor if sensor is None or isinstance(sensor, str) else asdict(sensor)},
        "effects": effects.describe(),
    }


def _describe_scene(scene: Scene) -> dict[str, Any]:
    described: dict[str, Any] = {"name": scene.name, "lux_per_luma": scene.lux_per_luma}
    if scene.file is not None:
        described |= {"file": scene.file_name or str(scene.file), "sha256": _sha256(scene.file)}
    if scene.file is not None and scene.files:
        described["files"] = {os.path.relpath(file, scene.file.parent): _sha256(file) for file in scene.files}
    if scene.variables:
        described["variables"] = dict(scene.variables)
    if scene.note:
        described["note"] = scene.note
    described["objects"] = {name: trajectory.describe() for name, trajectory in scene.objects.items()}
    described["lights"] = {name: profile.describe() for name, profile in scene.lights.items()}
    return described


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
