"""The scene: what Mitsuba renders, and what goes with it by default."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..camera import PRESETS, Camera
from ..pose import Pose
from ..trajectory.trajectory import Trajectory, interval, rest_of
from .light_course import LaterCourse, LightCourse

SceneSource = Path | Mapping[str, Any]


@dataclass(frozen=True)
class Scene:
    """A scene and the settings that belong to it, each of which the caller may override.

    World axes: z up, metres.

    Attributes:
        name: for people and records.
        source: called when the scene is loaded; a path of a Mitsuba XML file, or a Mitsuba scene dictionary in which
            NumPy arrays stand for bitmap data (float32, linear RGB) and transforms.
        file: the file that it comes from, for records; None for a scene made in code.
        camera: the camera it is made for.
        trajectory: the camera path that belongs to it; None if it has none.
        start: where a camera starts in it, if it has no trajectory; None leaves that to the file's first sensor.
        contrast_threshold: C in natural-log units.
        blur: soften luma by the 3 x 3 kernel of the dataset's simulator.
        shadows: trace shadows of point and directional lights. A scene in which no shadow can be seen saves them.
        objects: what moves: T_world_object over the sequence's time for shapes by their ids (keys of the dictionary,
            ids of the XML file). The source gives such a shape in the object's own frame: its ``to_world`` there places
            it within the object. Before and after its trajectory an object stands still where that begins and ends.
        lights: for lights by their ids (of a shape's own emitter ``shape.emitter``) the course of their strength.
        lux_per_luma: illuminance on the sensor's scale: lux that one unit of luma stands for.
        ambient: its constant light stands for light from all sides, also within closed rooms: only the native
            renderer and the table kernel show it so.
    """

    name: str
    source: Callable[[], SceneSource]
    file: Path | None = None
    camera: Camera = PRESETS["ideal"]
    trajectory: Trajectory | None = None
    start: Pose | None = None
    contrast_threshold: float = 0.15
    blur: bool = False
    shadows: bool = True
    objects: Mapping[str, Trajectory] = field(default_factory=dict)
    lights: Mapping[str, LightCourse] = field(default_factory=dict)
    lux_per_luma: float = 1000.0
    ambient: bool = False

    @property
    def path(self) -> Trajectory:
        """The scene's own trajectory.

        Raises:
            ValueError: if it has none.
        """
        if self.trajectory is None:
            raise ValueError(f"scene {self.name!r} has no trajectory of its own: one must be given")
        return self.trajectory

    def part(self, start_s: float = 0.0, duration_s: float | None = None) -> Scene:
        """The scene over a part of its own trajectory: what moves and flickers in it goes on from there.

        Args:
            start_s: where on the trajectory the part's t = 0 lies. duration_s: to the end by default.

        Raises:
            ValueError: if the scene has no trajectory of its own, or not that part of it.
        """
        return replace(
            self,
            trajectory=interval(self.path, start_s, duration_s),
            objects={name: rest_of(path, start_s) for name, path in self.objects.items()},
            lights={name: LaterCourse(course, start_s) for name, course in self.lights.items()},
        )
