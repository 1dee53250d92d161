"""Applies the lens's effects to the image before any pixel sees it."""

from __future__ import annotations

from copy import copy

import numpy as np

from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from ...render.base import Renderer
from ...render.edges.neighbours import ImageMap, Indices
from .effects import Effects
from .lens_blur import blur_frame, blur_squares


class Optics(ImageMap):
    """The lens: image = vignetting x (point-spread function * scene).

    The order is this because the fall-off is a fraction of the light that goes to an image point, wherever it then
    lands: a spot in the corner is as wide as one in the middle, and is dimmed as a whole. With spots of a few pixels,
    over which the fall-off hardly changes, the other order would give nearly the same.

    Args:
        camera: the lens, which vignetting needs; None where it is not known.
        effects: those that act on luma (:attr:`Effects.optical`) are applied.

    Raises:
        ValueError: for vignetting without a lens.
    """

    def __init__(self, camera: Camera | None, effects: Effects) -> None:
        vignetting, lens_blur = effects.vignetting, effects.lens_blur_px
        if vignetting is not None and camera is None:
            raise ValueError("vignetting depends on the lens: give camera")
        self._gain = None if vignetting is None or camera is None else vignetting.gain(camera)
        self._weights = None if lens_blur is None else lens_blur.weights()
        self.reach = 0 if self._weights is None else len(self._weights) - 1

    def frames(self, luma: LumaFrames) -> LumaFrames:
        image = np.empty_like(luma)
        # Frame by frame, so that it stays in the processor's cache.
        for frame, out in zip(luma, image, strict=True):
            if self._weights is None:
                out[:] = frame
            else:
                blur_frame(frame, self._weights, out)
            if self._gain is not None:
                np.multiply(out, self._gain, out=out)
        return image

    def pixels(self, squares: LumaFrames, pixel: Indices) -> LumaFrames:
        luma = squares[0, 0] if self._weights is None else blur_squares(squares, self._weights)
        return luma if self._gain is None else luma * self._gain.ravel()[pixel]


def with_optics(renderer: Renderer, effects: Effects) -> Renderer:
    """Return the renderer behind a lens that shades and blurs: luma, rates and samples are of the lens's image.

    Depth, flow and silhouettes stay those of the scene. The renderer's own 3 x 3 blur comes before the lens.

    Args:
        effects: those that act on luma (:attr:`Effects.optical`) are applied; the others act behind the lens.

    Returns:
        The renderer itself where no optical effect is on; else a copy that shares its scene.

    Raises:
        ValueError: if the renderer has a lens already.
    """
    if not effects.optical:
        return renderer
    if renderer.optics is not None:
        raise ValueError(f"{renderer.name} renders through a lens already; give all optical effects at once")
    behind = copy(renderer)
    behind.optics = Optics(renderer.camera, effects)
    return behind
