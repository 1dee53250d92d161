"""Measures what a frame rate costs: a scene is rendered as video, made into events, and judged by the exact stream."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.srgb import to_srgb
from ..events.arrays import EventArray, concatenate_events
from ..events.matching import compare_events
from ..geometry.camera import Camera
from ..io.dataset.writer import image_gain_for
from ..render.choice import make_renderer
from ..sampling.displacement import DisplacementClock
from ..sampling.rules import periodic_instants
from ..scene.scene import Scene
from ..simulation.from_frames.events_from_frames import events_from_frames
from ..simulation.settings import INTERPOLATIONS
from .accuracy_sweep import half_way_s
from .reference_events import TICKS_PER_US, Recipe, exact_crossings, in_ticks

FRAME_RATES = (30, 60, 120, 240, 960)
DURATION_S = 0.2
"""Six intervals of 30 frames a second."""

_SAMPLES = 8
_LONGEST_WINDOW_US = 10_000


class VideoSetting(NamedTuple):
    """Says how a scene becomes video, and video events.

    Attributes:
        fps: frames a second.
        bits: 8 for sRGB as cameras and files have it, with the image gain of a dataset's frames; 32 for linear floating
            point.
        interpolation: as of :func:`~davis_rs.events_from_frames`.
    """

    fps: float
    bits: int
    interpolation: str


class VideoErrors(NamedTuple):
    """Says how far the events of a video are from the exact ones.

    Attributes:
        setting: of the video.
        displacement_px: how far the fastest pixel moves from a frame to the next.
        events: how many were made.
        median_us, p99_us: of the absolute time error of events that have a partner.
        missing_percent, spurious_percent: of the exact events.
    """

    setting: VideoSetting
    displacement_px: float
    events: int
    median_us: float
    p99_us: float
    missing_percent: float
    spurious_percent: float


def video_settings(rates: tuple[float, ...] = FRAME_RATES) -> list[VideoSetting]:
    """List all settings: each rate, floating point and 8 bits, each interpolation."""
    rules = [rule for rule in INTERPOLATIONS if rule != "auto"]
    return [VideoSetting(fps, bits, rule) for fps in rates for bits in (32, 8) for rule in (*rules, "auto")]


class FrameRateSweep:
    """Renders a part of a scene's camera path as video of several rates, and judges its events.

    Frames are instants, without an exposure; the exact stream is that of the same rays, so that errors are those of
    time (and with 8 bits, of rounding and clipping).

    Args:
        scene: with its camera path.
        start_s: where the part begins; None: where the fastest pixel has gone half of its path.
        duration_s: of the part.
        camera: None takes the scene's.

    Raises:
        ValueError: if there is no such part, or nothing moves in it.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        start_s: float | None = None,
        duration_s: float = DURATION_S,
        camera: Camera | None = None,
    ) -> None:
        self.scene, self.camera = scene, camera or scene.own_camera
        if start_s is None:
            whole = scene.path
            middle_s = half_way_s(make_renderer(scene, self.camera, rays_per_pixel=1), whole)
            start_s = min(middle_s, max(whole.duration_s - duration_s, 0.0))
        self._judged = scene.crop(start_s, duration_s)
        self.start_s, self.duration_s = start_s, self._judged.path.duration_s
        self._end_us = round(self.duration_s * 1e6)
        self._renderer = make_renderer(self._judged, self.camera, rays_per_pixel=_SAMPLES)
        clock = DisplacementClock(self._renderer, self._judged.path, self._end_us)
        self.path_px = clock.path_at(self._end_us)
        if self.path_px <= 0:
            raise ValueError(
                f"nothing moves in the {duration_s} s from {start_s} s of the trajectory: nothing to judge"
            )
        self.window_us = int(np.clip(self._end_us / self.path_px, 1, _LONGEST_WINDOW_US))
        self._recipe = Recipe(self._judged.path, scene.contrast_threshold, 1e-3, self.window_us)
        self._luma: dict[int, npt.NDArray[np.float32]] = {}
        self._reference: EventArray | None = None

    def measure(self, settings: list[VideoSetting]) -> Iterator[VideoErrors]:
        """Yield the errors of each setting; the first one takes the time of the exact stream."""
        for setting in settings:
            yield self._errors(setting)

    def _errors(self, setting: VideoSetting) -> VideoErrors:
        times = list(periodic_instants(setting.fps, 0, self._end_us))
        if len(times) < 2:
            raise ValueError(f"{setting.fps:g} frames a second have no two frames in {self.duration_s:g} s")
        frames = self._frames(times)
        log_eps: float | None = self._recipe.log_eps
        if setting.bits == 8:
            gain = image_gain_for(frames[0])
            encoded = to_srgb(np.minimum(gain * frames.astype(np.float64), 1))
            frames, log_eps = np.rint(255 * encoded).astype(np.uint8), None
        packets = events_from_frames(
            frames,
            times,
            interpolation=setting.interpolation,
            contrast_threshold=self._recipe.contrast_threshold,
            log_eps=log_eps,
        )
        events = concatenate_events([packet.events for packet in packets])
        if self._reference is None:
            self._reference = exact_crossings(self._renderer, self._recipe).events
        judged = self._reference[self._reference["t"] <= times[-1] * TICKS_PER_US]
        comparison = compare_events(
            in_ticks(events),
            judged,
            size=(self.camera.width, self.camera.height),
            window_us=self.window_us * TICKS_PER_US,
        )
        return VideoErrors(
            setting,
            self.path_px / self.duration_s / setting.fps,
            len(events),
            comparison.median_us / TICKS_PER_US,
            comparison.p99_us / TICKS_PER_US,
            comparison.missing_percent,
            comparison.spurious_percent,
        )

    def _frames(self, times: list[int]) -> npt.NDArray[np.float32]:
        for t_us in times:
            if t_us not in self._luma:
                self._luma[t_us] = self._renderer.luma(self._recipe.views(np.array([t_us * TICKS_PER_US])))[0]
        return np.stack([self._luma[t_us] for t_us in times])
