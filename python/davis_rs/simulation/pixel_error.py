"""Estimates before a run how many events are wrong because a pixel is so many rays or lines, not its whole area.

They are a pattern, the same in every frame, so they make no noise. But edges, highlights and textures pass from ray to
ray, and a mean of few rays jumps a little with each. A few pixels are followed through a few short stretches of the
path, by the run's rays or lines and by more rays; then events are matched.
"""

from __future__ import annotations

from dataclasses import dataclass

from .._util.progress import doing
from .._util.quantities import percent
from ..events.matching import compare_events
from ..geometry.trajectory.trajectory import Trajectory
from ..render.base import Renderer
from ..render.native.estimators import LINES
from ..render.native.renderer import NativeRenderer
from ..sampling.rules import MaxDisplacement
from .followed_pixels import events_of_pixels, luma_of_pixels, spread_pixels, stretches_of

_MORE, _MOST_RAYS, _NEXT_TO_LINES = 4, 1024, 512
"""The reference has so many times the rays, and so many at most; and next to lines so many."""

_STRETCHES, _FEWEST_PIXELS, _MOST_PIXELS = 3, 64, 256

_COST_SHARE, _MOST_COST = 0.01, 10_000_000
"""At most this share of the run's rays is cast, and so many rays: some ten seconds."""

_FEWEST_EVENTS = 30
"""From fewer no share can be told."""


@dataclass(frozen=True)
class PixelError:
    """Says how many events are wrong because of what a pixel is made of.

    Attributes:
        share: of missing and spurious events (:func:`~davis_rs.compare_events`, within 10 ms), in those of more rays.
        pixel: what it is made of, for people.
        reference_rays: of what it was compared with.
        pixels: how many were followed.
        events: how many they had by more rays.
    """

    share: float
    pixel: str
    reference_rays: int
    pixels: int
    events: int

    def __str__(self) -> str:
        return (
            f"about {percent(self.share)} of these events will be wrong (missing or spurious) because a pixel is "
            f"{self.pixel}: measured next to {self.reference_rays} rays, on {self.pixels} pixels with "
            f"{self.events} events (--rays-per-pixel and --accuracy change it)"
        )


def estimate_pixel_error(
    renderer: Renderer, trajectory: Trajectory, *, thresholds: tuple[float, float], log_eps: float
) -> PixelError | None:
    """Estimate how many events of a run are wrong because of what a pixel is made of; None where that is not known.

    It is not known of renderers other than the native one, of runs that take no longer than the estimate, and where few
    events are seen.

    Args:
        renderer: of the run; it may have a lens.
        trajectory: of the run, from t = 0 on.
        thresholds: of ON and OFF events, natural-log units.
    """
    if not isinstance(renderer, NativeRenderer):
        return None
    rays, lines = renderer.rays_per_pixel, renderer.pixel == "lines"
    more = max(_NEXT_TO_LINES if lines else min(_MORE * rays, _MOST_RAYS), rays + 1)
    size = renderer.camera.width * renderer.camera.height
    times = stretches_of(renderer, trajectory, MaxDisplacement(), _STRETCHES)
    spans_us = sum(int(t_us[-1] - t_us[0]) for t_us in times)
    if more > _MOST_RAYS or spans_us == 0:
        return None
    keyframes = sum(map(len, times))
    run_rays = size * rays * keyframes * trajectory.duration_s * 1e6 / spans_us
    a_pixel = keyframes * (rays + more) * (2 * renderer.reach_px + 1) ** 2
    pixels = min(int(min(_COST_SHARE * run_rays, _MOST_COST) / a_pixel), _MOST_PIXELS, size)
    if pixels < _FEWEST_PIXELS:
        return None
    pixel = spread_pixels(size, pixels)
    wrong = right = 0
    for t_us in times:
        doing("comparing pixels with those of more rays")
        own, reference = (
            events_of_pixels(luma_of_pixels(each, trajectory, t_us, pixel), t_us, thresholds, log_eps)
            for each in (renderer, renderer.by_rays(more))
        )
        comparison = compare_events(own, reference, size=(pixels, 1))
        wrong, right = wrong + comparison.missing + comparison.spurious, right + comparison.reference
    if right < _FEWEST_EVENTS:
        return None
    return PixelError(wrong / right, f"{LINES[rays]} lines" if lines else f"{rays} rays", more, pixels, right)
