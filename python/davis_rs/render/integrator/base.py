"""Defines what the two renderers on Mitsuba's integrators share, with LLVM and without."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaIntegrator, MitsubaScene
from ..._mitsuba.variants import variant
from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray
from ...geometry.trajectory.views import Views
from ..baked.lights import hides_lights
from ..base import Indices, Renderer
from ..media import has_media
from ..motion.scene_motion import STILL, SceneMotion, SceneState
from ..motion.scene_scale import scale_scene
from ..motion.scene_updates import SceneUpdates

_SEED_STEP = 15_485_863
"""Distance between the seeds of :meth:`SceneRenderer.reseeded`: the scalar variant uses one more seed for each ray."""

PAST = 1 + 1e-4
"""A ray that goes past a lamp begins anew so much farther away than the lamp."""


def _integrator(scene: MitsubaScene, mi: Mitsuba) -> MitsubaIntegrator:
    """Return the integrator that the scene names; a path tracer where it names none, one for volumes if it has media.

    Raises:
        ValueError: for one that cannot be asked what a ray sees: a particle tracer, or one made for derivatives.
    """
    integrator = scene.integrator() or mi.load_dict({"type": "volpath" if has_media(scene) else "path"})
    if not isinstance(integrator, mi.SamplingIntegrator) or isinstance(integrator, mi.CppADIntegrator):
        raise ValueError(
            f"the scene asks for Mitsuba's {type(integrator).__name__}, which cannot follow single rays; "
            "name one that can (direct, path, volpath)"
        )
    return integrator


class SceneRenderer(Renderer):
    """Renders any scene through the integrator that the scene names.

    Where objects move or lights flicker the scene itself is changed from view to view, see :class:`SceneUpdates`.
    A scene that is very small or very large is scaled first, see :func:`scale_scene`, and the views with it.

    Args:
        scene: loaded under :attr:`variant`; the renderer changes it, so nobody else may use it any more.

    Warns:
        UserWarning: if a scene that is too small or too large cannot be scaled.
    """

    poses_per_launch = 1

    scale: float
    """The factor by which the scene is scaled for rendering."""

    def __init__(
        self,
        scene: MitsubaScene,
        camera: Camera,
        *,
        rays_per_pixel: int,
        blur: bool,
        seed: int,
        reason: str,
        motion: SceneMotion = STILL,
    ) -> None:
        super().__init__(camera, rays_per_pixel=rays_per_pixel, blur=blur, motion=motion)
        self._scene, self._seed, self.reason = scene, seed, reason
        with variant(self.variant) as (mi, _):
            self._integrator = _integrator(scene, mi)
            self._hides_lights = hides_lights(scene)
            self.scale = scale_scene(scene, self._integrator, mi)
            self._updates = SceneUpdates(scene, motion, mi)
        self.name = f"Mitsuba's {self._integrator.class_name()}"

    def reseeded(self, number: int) -> SceneRenderer:
        """Return a renderer of the same scene with other random numbers, whose seed is ``number`` + 1 steps on."""
        other = copy(self)
        other._seed = (self._seed + _SEED_STEP * (number + 1)) % 2**31
        return other

    def _luma(self, views: Views) -> LumaFrames:
        return self._render(views.scaled(self.scale), self._state(views))

    def _luma_after(self, views: Views, step_s: FloatArray) -> LumaFrames:
        return self._render(views.moved(step_s).scaled(self.scale), self._state(views).moved(step_s))

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        return self._samples_at(self._state(views), views.scaled(self.scale), view, pixel, rays)

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        return self._scaled_depth(views.scaled(self.scale)) / np.float32(self.scale)

    def _owners(self, views: Views) -> npt.NDArray[np.uint32]:
        return self._scaled_owners(views.scaled(self.scale))

    def _state(self, views: Views) -> SceneState:
        """Return the state of the scaled scene at the times of the views."""
        return self.motion.at(views.t_s).scaled(self.scale)

    # What a subclass implements, for the scaled scene and scaled views.

    @abstractmethod
    def _scaled_depth(self, views: Views) -> npt.NDArray[np.float32]: ...

    @abstractmethod
    def _scaled_owners(self, views: Views) -> npt.NDArray[np.uint32]: ...

    @abstractmethod
    def _render(self, views: Views, state: SceneState) -> LumaFrames:
        """Render the frames of views, the scene in the state of each."""

    @abstractmethod
    def _samples_at(self, state: SceneState, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        """Render single pixels of views, the scene in the state of each."""
