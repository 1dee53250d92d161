"""Makes scenes of a plan that are drawn, not named: by their kind, and what belongs to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from .._util.array_types import JsonValue
from ..scene.builtin.random_planes import random_textured_planes
from ..scene.files.texture_folder import image_files, mesh_files
from ..scene.scene import Scene
from .kinds import Key, called_with, keys_of

RANDOM_SCENES: dict[str, Callable[..., Scene]] = {"random_planes": random_textured_planes}
"""What ``kind`` of a scene may be; its other keys are the function's own arguments."""

FOLDERS: dict[str, Callable[[str | Path], tuple[Path, ...]]] = {"textures": image_files, "meshes": mesh_files}
"""Keys that name a folder, and what is taken from it."""

_listed = {key: cache(files) for key, files in FOLDERS.items()}
"""A folder of many thousand files is listed once in a process, not for each sequence."""


@cache
def scene_keys(kind: str) -> Mapping[str, Key]:
    """Return the keys of a scene that is drawn."""
    return keys_of(RANDOM_SCENES[kind])


def make_random_scene(drawn: Mapping[str, JsonValue], end_s: float | None, base: Path) -> Scene:
    """Make the scene that a drawn mapping stands for.

    Args:
        drawn: ``kind`` and what belongs to it.
        end_s: where in the scene's time the sequence ends: the length of its motion if none is given.
        base: what folders are relative to.

    Raises:
        ValueError, OSError: as the kind's function.
    """
    given = dict(drawn)
    kind = given.pop("kind")
    arguments = called_with(scene_keys(kind), given)
    for key, files in _listed.items():
        if arguments.get(key) is not None:
            arguments[key] = files(base / arguments[key])
    if "duration_s" not in arguments and end_s is not None:
        arguments["duration_s"] = end_s
    return RANDOM_SCENES[kind](**arguments)
