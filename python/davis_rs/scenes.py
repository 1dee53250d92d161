"""Scenes by name or file, and where a camera starts in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ._mitsuba import default_variant, load_scene_source, variant
from .close_names import did_you_mean
from .pose import Pose
from .scene.checkerboard_scene import checkerboard
from .scene.fence_scene import fence
from .scene.planes_and_walls import three_planes, three_walls
from .scene.scene import Scene

BUILTIN_SCENES = {
    "three_planes": three_planes,
    "three_walls": three_walls,
    "fence": fence,
    "checkerboard": checkerboard,
}


def load_scene(name_or_path: str | Path) -> Scene:
    """A built-in scene or a sequence of the public dataset by name, or a Mitsuba XML file.

    Names are keys of :data:`BUILTIN_SCENES` and of :data:`~davis_rs.sequences.SEQUENCES`.

    Raises:
        ValueError: if it is neither a name nor a file.
    """
    if str(name_or_path) in BUILTIN_SCENES:
        return BUILTIN_SCENES[str(name_or_path)]()
    from .sequences import SEQUENCES  # many small scenes, which `import davis_rs` need not wait for

    if str(name_or_path) in SEQUENCES:
        return SEQUENCES[str(name_or_path)].scene()
    path = Path(name_or_path)
    if not path.is_file():
        names = ", ".join(BUILTIN_SCENES)
        raise ValueError(
            f"scene {str(name_or_path)!r} is neither one of {names}, a sequence of the dataset, nor a Mitsuba XML file"
            f"{did_you_mean(str(name_or_path), [*BUILTIN_SCENES, *SEQUENCES])}"
        )
    return Scene(name=path.stem, source=lambda: path, file=path)


def start_pose(scene: Scene) -> Pose:
    """Where a camera starts in a scene: its trajectory's first pose, its own start, or the scene file's first sensor.

    Raises:
        ValueError: if it has none of these.
    """
    if scene.trajectory is not None:
        return scene.trajectory.pose(0.0)
    if scene.start is not None:
        return scene.start
    with variant(default_variant()[0]) as (mi, _):
        sensors = load_scene_source(scene.source(), mi).sensors()
        if not sensors:
            raise ValueError(
                f"scene {scene.name!r} has neither a trajectory nor a sensor that a trajectory could start at"
            )
        matrix = np.array(mi.traverse(sensors[0])["to_world"].matrix, np.float64).reshape(4, 4)
    # Mitsuba's cameras look along z too, but their x points left and their y up.
    return Pose.from_matrix(matrix @ np.diag([-1.0, -1.0, 1.0, 1.0]))
