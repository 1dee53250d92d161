"""Computes depth, optical flow and shape at each event, at its own pixel and its own microsecond."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray, as_events
from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ...scene.scene import Scene, check_scene
from .scene_surfaces import SceneSurfaces

EVENT_TRUTH_DTYPE = np.dtype([("depth", "<f4"), ("flow", "<f4", (2,)), ("shape", "<u2")])
"""Depth in metres along the optical axis, inf for nothing; flow in pixels per second (x right, y down), NaN for
nothing; the number of the shape, 0 for nothing."""

EventTruthArray = npt.NDArray[np.void]

_AT_ONCE = 1 << 16
"""Events whose views are in memory at a time: 200 bytes each, and as many for each object that moves."""


class EventTruth:
    """Computes what the centre of each event's pixel sees at the event's time.

    The light of an event comes from all of its pixel. At an edge a part of the pixel sees another surface; the surface
    at the centre counts. Without ``surfaces``, backs of :attr:`Scene.one_sided` are culled, as by the native renderer.

    Args:
        scene: with its camera path, made of triangles alone.
        camera: its lens and size; None takes the scene's.
        surfaces: of the scene and the camera, where the caller has them already; None makes them.

    Attributes:
        shape_names: the ids of the scene's shapes; shape number 1 is the first.

    Raises:
        ValueError: for a scene without a path or a camera, or as :class:`SceneSurfaces`.
        OSError: as there.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera | None = None,
        *,
        surfaces: SceneSurfaces | None = None,
        threads: int | None = None,
    ) -> None:
        check_scene(scene)
        self._camera, self._path = scene.own_camera if camera is None else camera, scene.path
        self._surfaces = surfaces or SceneSurfaces(scene, self._camera, threads=threads)
        self.shape_names = self._surfaces.names
        self._end_us = round(1e6 * self._path.duration_s)

    def __call__(self, events: EventArray) -> EventTruthArray:
        """Return the truth at events (n,), which may be in any order: :data:`EVENT_TRUTH_DTYPE`, (n,).

        Events after the end of the camera's path, such as those that a slow readout delays, get its last view.

        Raises:
            ValueError: for an event outside of the sensor or before the start.
        """
        events = as_events(events)
        width, height = self._camera.width, self._camera.height
        wrong = (events["x"] >= width) | (events["y"] >= height) | (events["t"] < 0)
        if wrong.any():
            t, x, y, _ = events[wrong.argmax()]
            raise ValueError(f"events must have t >= 0, x < {width} and y < {height}, got t = {t} us, x = {x}, y = {y}")
        truth = np.empty(len(events), EVENT_TRUTH_DTYPE)
        for first in range(0, len(events), _AT_ONCE):
            block = slice(first, first + _AT_ONCE)
            t_us, view = np.unique(np.minimum(events["t"][block], self._end_us), return_inverse=True)
            pixel = events["y"][block].astype(np.int64) * width + events["x"][block]
            seen = self._surfaces.of_pixels(Views.along(self._path, t_us * 1e-6), view.ravel(), pixel)
            truth["depth"][block], truth["flow"][block], truth["shape"][block] = seen.depth, seen.flow, seen.shape
        return truth


def event_truth(scene: Scene, events: EventArray, camera: Camera | None = None) -> EventTruthArray:
    """Return depth, optical flow and shape at events that a scene made.

    >>> truth = event_truth(scene, events)
    >>> truth["depth"], truth["flow"], truth["shape"]

    Args:
        scene: with its camera path.
        events: (n,), :data:`~davis_rs.EVENT_DTYPE`, times from the start of that path.
        camera: lens and size; None takes the scene's.

    Returns:
        (n,) of :data:`EVENT_TRUTH_DTYPE`. :attr:`EventTruth.shape_names` tells the shapes' names.

    Raises:
        ValueError, OSError: as :class:`EventTruth`.
    """
    return EventTruth(scene, camera)(events)
