"""Renders a small picture of a scene, for notebooks: what its camera sees first, within two seconds."""

from __future__ import annotations

import html
import io
import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from .._util.html_table import html_picture
from .._util.srgb import to_srgb
from ..geometry.camera import PRESETS, Camera
from ..geometry.trajectory.views import Views
from ..scene.scene import Scene
from .base import Renderer
from .choice import make_renderer

_LONGEST_SIDE = 160
"""Of the picture in pixels."""

_LONGEST_S = 2.0
_RAYS, _RANDOM_RAYS = 8, 16


def scene_picture(scene: Scene) -> str:
    """Return a picture of a scene as HTML, or a line that says why there is none; never raises an error.

    It shows luma at t = 0 of the camera path, or from where a camera starts, without the light that would have to be
    baked. What takes longer than two seconds is given up, where that can be done: not on Windows, nor outside of the
    main thread, nor where Ctrl-C or the timer is the caller's own.
    """
    try:
        with _deadline(_LONGEST_S), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a run says them
            luma, said = _seen(scene)
            return html_picture(_png(luma), luma.shape[1]) + _line(said)
    except Exception as error:
        return _line(f"no picture: {error}")


def _seen(scene: Scene) -> tuple[npt.NDArray[np.float32], str]:
    """Return luma (H, W) of a small image, and what it shows."""
    if scene.trajectory is not None:
        pose, when = scene.trajectory.pose(0.0), "at t = 0"
    elif scene.start is not None:
        pose, when = scene.start, "from where a camera starts"
    else:
        raise ValueError("the scene has no camera path")
    renderer = _quick_renderer(scene, _small(PRESETS["ideal"] if scene.camera is None else scene.camera))
    return renderer.luma(Views.at_rest([pose]))[0], f"luma {when}"


def _small(camera: Camera) -> Camera:
    """Return the same lens with an image of at most :data:`_LONGEST_SIDE` pixels each way."""
    factor = min(1.0, _LONGEST_SIDE / max(camera.width, camera.height))
    return camera.resized(*(max(1, round(side * factor)) for side in (camera.width, camera.height)))


def _quick_renderer(scene: Scene, camera: Camera) -> Renderer:
    """Make the native renderer under direct light, or Mitsuba's integrator for what that cannot render."""
    try:
        return make_renderer(scene, camera, kind="native", rays_per_pixel=_RAYS)
    except ValueError:
        return make_renderer(scene, camera, kind="integrator", rays_per_pixel=_RANDOM_RAYS)


def _png(luma: npt.NDArray[np.float32]) -> bytes:
    """Return a grey picture; the 98th percentile of luma comes to 0.8 of white, and grey is encoded as in sRGB."""
    from PIL import Image

    bright = float(np.percentile(luma, 98))
    linear = np.clip(luma * (0.8 / bright if bright > 0 else 1.0), 0.0, 1.0)
    stream = io.BytesIO()
    Image.fromarray(np.rint(255 * to_srgb(linear)).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def _line(text: str) -> str:
    return f"<div style='font-size:small;color:#666'>{html.escape(text)}</div>"


@contextmanager
def _deadline(seconds: float) -> Iterator[None]:
    """End the block after some seconds by a TimeoutError, where the system can: as a Ctrl-C would, which is raised
    where it does no harm.

    Raises:
        TimeoutError: saying how long it took.
    """
    may = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if (
        not may
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        or any(signal.getitimer(signal.ITIMER_REAL))
    ):
        yield
        return
    over = False

    def end(number: int, frame: object) -> None:
        nonlocal over
        over = True
        signal.raise_signal(signal.SIGINT)

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except KeyboardInterrupt:
        if not over:
            raise
        raise TimeoutError(f"it takes longer than {seconds:g} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
