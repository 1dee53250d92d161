"""What the renderers share that ask Mitsuba's own integrators, with LLVM and without."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from .._mitsuba import variant
from ..camera import Camera
from ..luma import LumaFrames
from ..pose import FloatArray
from ..trajectory.views import Views
from .render import Indices, Renderer
from .scene_motion import STILL, SceneMotion, SceneState
from .scene_updates import SceneUpdates


def _integrator(scene: Any, mi: Any) -> Any:
    """The scene's integrator; path tracing where it names none.

    Raises:
        ValueError: for one that cannot be asked what a ray sees: a particle tracer, or one made for derivatives.
    """
    integrator = scene.integrator() or mi.load_dict({"type": "path"})
    if not isinstance(integrator, mi.SamplingIntegrator) or isinstance(integrator, mi.CppADIntegrator):
        raise ValueError(
            f"the scene asks for Mitsuba's {type(integrator).__name__}, which cannot follow single rays; "
            "name one that can (direct, path, volpath)"
        )
    return integrator


class SceneRenderer(Renderer):
    """Any scene, through the integrator that it names.

    Where objects move or lights flicker the scene itself is changed from view to view, see :class:`SceneUpdates`.
    """

    poses_per_launch = 1

    def __init__(
        self,
        scene: Any,
        camera: Camera,
        *,
        samples: int,
        blur: bool,
        seed: int,
        reason: str,
        motion: SceneMotion = STILL,
    ) -> None:
        super().__init__(camera, samples=samples, blur=blur, motion=motion)
        self._scene, self._seed, self.reason = scene, seed, reason
        with variant(self.variant) as (mi, _):
            self._integrator = _integrator(scene, mi)
            self._updates = SceneUpdates(scene, motion, mi)
        self.name = f"Mitsuba's {self._integrator.class_name()}"

    def _luma(self, views: Views) -> LumaFrames:
        return self._render(views, self.motion.at(views.t_s))

    def _luma_after(self, views: Views, step_s: FloatArray) -> LumaFrames:
        return self._render(views.moved(step_s), self.motion.at(views.t_s).moved(step_s))

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        return self._samples_at(self.motion.at(views.t_s), views, view, pixel, rays)

    @abstractmethod
    def _render(self, views: Views, state: SceneState) -> LumaFrames:
        """Frames of views, of the scene in as many states."""

    @abstractmethod
    def _samples_at(self, state: SceneState, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        """Single pixels of views, of the scene in as many states."""
