"""Defines the scene: what is rendered, and the settings that belong to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path

import numpy as np

from .._mitsuba.files import XmlFile
from .._util.argument_checks import check_type
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.html_table import html_table
from ..geometry.camera import PRESETS, Camera
from ..geometry.pose import Pose, as_pose
from ..geometry.trajectory.derived import PacedTrajectory
from ..geometry.trajectory.steered import SteeredPath
from ..geometry.trajectory.trajectory import SegmentTrajectory, Trajectory
from .deformation import Deformation
from .light_profile import LightProfile, PacedProfile, ShiftedProfile
from .lost_looks import LostLook
from .steered_profile import SteeredProfile

SceneSource = Path | XmlFile | Mapping[str, object]


@names_checked
@dataclass(frozen=True)
class Scene:
    """A scene and the settings that belong to it, each of which the caller may override.

    World axes: z up, metres.

    Attributes:
        name: for messages and records.
        source: called whenever the scene is loaded, and must give the same each time. It gives the path of a Mitsuba
            XML file, such a file with values for its variables, or a Mitsuba scene dictionary in which NumPy arrays
            stand for bitmap data (float32, linear RGB) and transforms.
        file: the file that it comes from, for records; None for a scene made in code.
        files: what is read in addition to ``file``: a mesh's materials and textures.
        file_name: the name of that file in records; None for its path.
        camera: the camera it is made for; None for a file without a perspective sensor.
        trajectory: the camera path that belongs to it; None if it has none.
        baked_along: the camera path along which a quick bake of its light is finest. None: ``trajectory``. Parts of a
            path and the cameras of a rig keep the whole path, so that they have the same light.
        default_duration_s: how many seconds of the path the command line simulates where ``--duration`` is not given:
            of a path that its file does not have, the beginning is enough to see what it shows. None: all of it.
        start: where a camera starts in it, if it has no trajectory; a file's first sensor stands there.
        contrast_threshold: C in natural-log units.
        blur: blur luma with the 3 x 3 kernel of the dataset's simulator.
        shadows: trace shadows of point and directional lights. A scene in which no shadow can be seen saves them.
        objects: what moves: T_world_object over the sequence's time for shapes by their ids (keys of the dictionary,
            ids of the XML file). The source gives such a shape in the object's own frame: its ``to_world`` is its pose
            within the object. Before and after its trajectory an object stands still where that begins and ends.
        deformations: meshes that deform, by their ids. One without a path in ``objects`` rests.
        lights: the profiles of strength of lights by their ids (of an area light ``shape.emitter``).
        lux_per_luma: how many lux on the sensor one unit of luma stands for.
        ambient: its constant light stands for light from all sides, also within closed rooms: only the table kernel
            and the native renderer show it so.
        matte: materials that have a diffuse colour and more (``principled``, ``plastic``, ``roughplastic``, bumps) are
            rendered by that colour alone. Those without one (metal, glass) stay what they are.
        reflections: mirrors and metal show all surfaces, and coloured glass absorbs light. Otherwise Mitsuba's
            integrator ``direct`` shows lights and skies alone in them.
        soft_light: its file does not say which light counts (glTF, OBJ, PLY). Then ``auto`` bakes the light of its
            sky, with what hides it, of surfaces that emit, and the light that bounces, if that is quick; otherwise its
            light is direct, that of the sky throws no shadow, and what surfaces emit is seen but lights nothing. They
            emit from both sides.
        one_sided: the ids of shapes whose backs are culled: from behind, one sees through them, as glTF says of
            materials that are not double-sided. Their light and their shadows are those of both sides. Only the native
            renderer culls, under direct and baked light; the others show both sides.
        biases: of a sequence of the public dataset: the set of biases, a key of :data:`~davis_rs.BIAS_SETS`, that its
            recording was made with. ``sensor="recorded"`` takes the sensor that follows from it.
        variables: of the file, the values that were given for its variables; for records.
        note: one line about the file that whoever simulates it should see, such as the size of a mesh in metres.
        lost_looks: looks of shapes in the file that are not shown by every renderer, or by none. A simulator
            warns of those that its renderer does not show, with the fraction of the image that each concerns.
    """

    name: str
    source: Callable[[], SceneSource]
    file: Path | None = None
    files: tuple[Path, ...] = ()
    file_name: str | None = None
    camera: Camera | None = PRESETS["ideal"]
    trajectory: Trajectory | None = None
    baked_along: Trajectory | None = None
    default_duration_s: float | None = None
    start: Pose | None = None
    contrast_threshold: float = 0.15
    blur: bool = False
    shadows: bool = True
    objects: Mapping[str, Trajectory] = field(default_factory=dict)
    deformations: Mapping[str, Deformation] = field(default_factory=dict)
    lights: Mapping[str, LightProfile] = field(default_factory=dict)
    lux_per_luma: float = 1000.0
    ambient: bool = False
    matte: bool = False
    reflections: bool = False
    soft_light: bool = False
    one_sided: tuple[str, ...] = ()
    biases: str | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    note: str = ""
    lost_looks: tuple[LostLook, ...] = ()

    def __post_init__(self) -> None:
        if self.start is not None:
            object.__setattr__(self, "start", as_pose(self.start, "start"))
        rests = {name: _resting(each) for name, each in self.deformations.items() if name not in self.objects}
        if rests:
            object.__setattr__(self, "objects", {**self.objects, **rests})

    def __repr__(self) -> str:
        moves = "no trajectory" if self.trajectory is None else f"{self.trajectory.duration_s:.6g} s"
        size = "no camera" if self.camera is None else f"{self.camera.width} x {self.camera.height} px"
        return f"<Scene {self.name!r}, {size}, {moves}, C = {self.contrast_threshold:g}>"

    def _repr_html_(self) -> str:
        path, camera = self.trajectory, self.camera
        rows = [
            ("file", str(self.file) if self.file is not None else "made in code"),
            ("camera", "none" if camera is None else f"{camera.width} x {camera.height} px"),
            ("path", "none" if path is None else f"{path.duration_s:.6g} s"),
            ("objects that move", ", ".join(self.objects) or "none"),
            ("meshes that deform", ", ".join(self.deformations) or "none"),
            ("lights that change", ", ".join(self.lights) or "none"),
            ("contrast threshold", f"{self.contrast_threshold:g}"),
            ("lux per luma", f"{self.lux_per_luma:g}"),
        ]
        if self.note:
            rows.append(("note", self.note))
        below = "" if path is None else path.html_plot()
        return html_table(f"Scene {self.name}", rows, below=below, beside=self._html_picture)

    @cached_property
    def _html_picture(self) -> str:
        """Return a small picture of what its camera sees first, or why there is none, as HTML."""
        # Renderers lie above scenes, so that none is imported before a notebook shows one.
        return str(import_module("davis_rs.render.thumbnail").scene_picture(self))

    @property
    def path(self) -> Trajectory:
        """The scene's own trajectory.

        Raises:
            ValueError: if it has none.
        """
        if self.trajectory is None:
            raise ValueError(
                f"scene {self.name!r} has no trajectory of its own: give it one, scene.with_trajectory(...)"
            )
        return self.trajectory

    @property
    def path_of_bake(self) -> Trajectory | None:
        """The camera path along which a quick bake of its light is finest; None if it has no path."""
        return self.trajectory if self.baked_along is None else self.baked_along

    @property
    def own_camera(self) -> Camera:
        """The scene's own camera.

        Raises:
            ValueError: if it has none.
        """
        if self.camera is None:
            raise ArgumentError(
                "scene {!r} has no perspective sensor that tells lens and size: give {camera}", self.name
            )
        return self.camera

    def with_trajectory(self, trajectory: Trajectory | None) -> Scene:
        """Return the scene with this camera path; its objects and lights keep their own times.

        Args:
            trajectory: of the camera. Its t = 0 is the scene's t = 0. None for a scene without one.

        Raises:
            TypeError: for what is no trajectory.
        """
        if trajectory is not None:
            check_type("trajectory", trajectory, Trajectory, "davis_rs.read_trajectory(...) reads one")
        return replace(self, trajectory=trajectory, baked_along=None, default_duration_s=None)

    def with_movable(self, *objects: str, lights: Iterable[str] = ()) -> Scene:
        """Return the scene with objects and lights that :meth:`Simulator.step` moves and dims.

        >>> scene = scene.with_movable("ball", lights=["lamp"])
        >>> simulator.step(1000, pose, objects={"ball": ball_pose}, lights={"lamp": 0.5})

        Until they are given a pose or a strength, objects stand where the scene's source has them, and lights are as
        strong as there. Paths and profiles of their own are replaced.

        Args:
            objects: ids of shapes.
            lights: ids of lights (of an area light ``shape.emitter``).
        """
        lights = (lights,) if isinstance(lights, str) else lights
        return replace(
            self,
            objects={**self.objects, **{name: SteeredPath() for name in objects}},
            lights={**self.lights, **{name: SteeredProfile() for name in lights}},
        )

    def crop(self, start_s: float = 0.0, duration_s: float | None = None) -> Scene:
        """Return the scene over a part of its camera path, with t = 0 at the start of that part.

        The clocks of objects and lights move with the camera's, so the part looks as it does within the whole.

        Args:
            start_s: start of the part on the trajectory, seconds.
            duration_s: its length, seconds; None: to the end of the trajectory.

        Raises:
            ValueError: if the scene has no trajectory, or the part does not lie inside it.
        """
        part = self.path.crop(start_s, duration_s)
        return replace(self.later(start_s), trajectory=part, baked_along=self.path_of_bake)

    def later(self, start_s: float) -> Scene:
        """Return the scene with t = 0 of its objects and lights ``start_s`` later; its camera path keeps its own.

        What a caller moves has no times of its own: it begins where the caller puts it.
        """
        return replace(
            self,
            objects={name: _from(path, start_s) for name, path in self.objects.items()},
            deformations={name: each.retimed(start_s) for name, each in self.deformations.items()},
            lights={
                name: ShiftedProfile(profile, start_s) if start_s and not _is_steered(profile) else profile
                for name, profile in self.lights.items()
            },
        )

    def paced(self, pace: float) -> Scene:
        """Return the scene by a clock of another pace, which a camera with a drifting clock has.

        Path, objects and lights keep their motion; only the times at which it is told change. What a caller moves is
        left as it is, because the caller moves it by the camera's clock.

        Args:
            pace: seconds of the new clock in a second of the scene's, > 0.

        Raises:
            ValueError: for a pace that is not finite and > 0.
        """
        return replace(
            self,
            trajectory=None if self.trajectory is None else PacedTrajectory(self.trajectory, pace),
            baked_along=self.path_of_bake,
            objects={
                name: path if _is_steered(path) else PacedTrajectory(path, pace) for name, path in self.objects.items()
            },
            deformations={name: each.retimed(0.0, pace) for name, each in self.deformations.items()},
            lights={
                name: profile if _is_steered(profile) else PacedProfile(profile, pace)
                for name, profile in self.lights.items()
            },
        )


def check_scene(scene: object) -> None:
    """Refuse anything but a scene, such as a scene's name.

    Raises:
        TypeError: with the call that loads a scene by its name or file.
    """
    if not isinstance(scene, Scene):
        given = repr(str(scene)) if isinstance(scene, str | Path) else "NAME_OR_FILE"
        kind = type(scene).__name__
        raise TypeError(
            f"scene must be a Scene, got {kind}; davis_rs.load_scene({given}) makes one of a name or a file"
        )


def _resting(deformation: Deformation) -> Trajectory:
    here = Pose(np.zeros(3), [0, 0, 0, 1])
    return SegmentTrajectory(here, here, deformation.duration_s)


def _is_steered(motion: Trajectory | LightProfile) -> bool:
    """Return whether a caller moves an object or dims a light, step by step."""
    return isinstance(motion, (SteeredPath, SteeredProfile))


def _from(path: Trajectory, start_s: float) -> Trajectory:
    """Return an object's path from ``start_s`` on; after its end the object stands still."""
    if start_s < path.duration_s:
        return path.crop(start_s)
    last = path.pose(path.duration_s)
    return SegmentTrajectory(last, last, 1.0)
