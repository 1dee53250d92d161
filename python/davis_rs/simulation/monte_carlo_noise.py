"""Estimates before a run how many events of a scene that Mitsuba's integrators render are Monte Carlo noise.

Light paths are drawn at random. The random numbers of a ray depend on the seed and on the ray's place in the frame,
and are the same in every frame. So a pixel at rest makes no events of noise. When the camera moves, each pixel's error
changes with what the pixel sees, and crosses levels that the light does not.

A few pixels are followed through a few short stretches of the path, rendered with many seeds. Averages of disjoint
seeds are runs of more samples, independent of each other. So the estimate is a measurement, not a model: an average of
few seeds against that of all others, through the crossing engine, matched event by event.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .._mitsuba.variants import SCALAR, variant
from .._util.progress import doing
from .._util.quantities import about, percent
from ..events.matching import compare_events
from ..geometry.trajectory.trajectory import Trajectory
from ..render.base import Renderer
from ..render.choice import AUTO_RENDERER, why_not_noise_free
from ..render.integrator.base import SceneRenderer
from ..sampling.rules import FixedRate, MaxDisplacement, TimeSampling
from ..sampling.tolerance import Tolerance
from ..scene.scene import Scene
from .followed_pixels import events_of_pixels, luma_of_pixels, spread_pixels, stretches_of
from .noise_estimate import NOISE_LIMIT, NoiseError, NoiseEstimate, share_text
from .settings import (
    AUTO_RAYS,
    SamplingSettings,
    ViewSettings,
    chosen_sampling,
    complete,
    renderer_of,
    takes_settings,
    view_scene,
)

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .settings.keywords import ViewKeywords

PIXELS = 256
"""How many pixels are followed."""

STRETCHES = 4
"""In so many stretches the path is sampled."""

SEEDS = 48
"""How often the pixels are rendered, each time with other random numbers."""

MOST_BASE_SAMPLES = 16
"""Samples of one rendering at most: averages of several stand for more."""

COST_SHARE, FEWEST_RAYS = 0.02, 1_000_000
"""The estimate casts at most ``COST_SHARE`` of the run's rays, or ``FEWEST_RAYS`` if that is more."""

FEWEST_RAYS_SCALAR = 30_000
"""The same without LLVM, where a ray takes some 50 us, and the path is looked at in one stretch."""

FEWEST_SEEDS, FEWEST_PIXELS = 12, 64

FEWEST_EVENTS = 30
"""Of the reference: from fewer no share can be told."""

IntArray = npt.NDArray[np.int64]


@takes_settings(ViewSettings)
def estimate_noise(scene: Scene, **settings: Unpack[ViewKeywords]) -> NoiseEstimate | None:
    """Estimate how many events along a scene's camera path will be Monte Carlo noise; None where there is none at all.

    Only what Mitsuba's integrators render has noise: for the native renderer and the table kernel it is None.

    >>> estimate = estimate_noise(load_scene("room.xml"))
    >>> print(estimate)
    about 84 % of these events are Monte Carlo noise (missing or spurious) at 8 rays per pixel; with 64 about 34 %
    >>> simulate(scene, rays_per_pixel=estimate.rays_per_pixel_for(0.05))

    Args:
        scene: with the camera path.
        {settings}

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for a value out of range, a scene without a camera path, or one that cannot be rendered.
        OSError: if a scene file or a calibration cannot be read.
    """
    return _estimate_in(scene, complete(ViewSettings, settings, taker=estimate_noise))


def _estimate_in(scene: Scene, settings: ViewSettings, sampling: TimeSampling | None = None) -> NoiseEstimate | None:
    viewed = view_scene(scene, settings)
    return estimate_noise_of(
        renderer_of(viewed, settings),
        viewed.scene.path,
        contrast_threshold=viewed.contrast_threshold,
        contrast_threshold_off=viewed.contrast_threshold_off,
        log_eps=viewed.log_eps,
        sampling=sampling,
    )


def estimate_noise_of(
    renderer: Renderer,
    trajectory: Trajectory,
    *,
    contrast_threshold: float,
    contrast_threshold_off: float,
    log_eps: float,
    sampling: TimeSampling | None = None,
    cost_share: float = COST_SHARE,
) -> NoiseEstimate | None:
    """Estimate as :func:`estimate_noise` does, for an existing renderer, which may have a lens.

    The same arguments give the same estimate.

    Args:
        renderer: of the run, with its number of samples.
        trajectory: of the run, from t = 0 on.
        sampling: of the run: keyframes lie as far apart as those of :class:`MaxDisplacement`, or else 1/3 px.
        cost_share: see :data:`COST_SHARE`.
    """
    if not isinstance(renderer, SceneRenderer):
        return None
    thresholds = contrast_threshold, contrast_threshold_off
    rule = sampling if isinstance(sampling, MaxDisplacement) else MaxDisplacement()
    with variant(renderer.variant):  # once, not for each of many small renderings
        look = _PilotRenders(renderer, trajectory, MaxDisplacement(rule.pixels), cost_share)
        return _estimate(look, thresholds, log_eps, round(look.run_rays * _frames(sampling, look)))


def _frames(sampling: TimeSampling | None, look: _PilotRenders) -> float:
    """Return how many frames a rule renders, roughly, for each keyframe that the estimate counts."""
    if isinstance(sampling, FixedRate):
        return sampling.rate_hz * look.trajectory.duration_s / look.keyframes
    if isinstance(sampling, Tolerance):
        # Half of them are intervals that it halves, and single pixels.
        return 2 * look.spacing_px / sampling.pixels
    return 2.0 if isinstance(sampling, MaxDisplacement) and sampling.hermite else 1.0


def _estimate(look: _PilotRenders, thresholds: tuple[float, float], log_eps: float, run_rays: int) -> NoiseEstimate:
    renderer = look.renderer
    if look.is_the_same():
        return NoiseEstimate(renderer.rays_per_pixel, rays=look.rays, run_rays=run_rays, noisy=False)
    frames = look.luma()
    logs = np.log(np.concatenate([part.reshape(len(part), -1) for part in frames], 1, dtype=np.float64) + log_eps)
    noise = (
        float(np.sqrt(logs.var(0, ddof=1).mean())) * math.sqrt(look.base / renderer.rays_per_pixel) / min(thresholds)
    )
    measured, events = [], 0
    blocks = 1
    while blocks <= max(1, look.seeds // 4):
        fraction, events = _mismatch(frames, look.times, blocks, thresholds, log_eps)
        # An average of k seeds against that of all others: errors of both add up, as if of an average of fewer.
        effective = 1 / (1 / blocks + 1 / (look.seeds - blocks))
        measured.append((look.base * effective, fraction))
        blocks *= 2
    if events < FEWEST_EVENTS:
        measured = []
    return NoiseEstimate(
        renderer.rays_per_pixel, tuple(measured), noise, events, rays=look.rays, run_rays=run_rays, ray_s=look.ray_s
    )


def noise_before_run(scene: Scene, settings: SamplingSettings) -> NoiseEstimate | None:
    """Estimate as :func:`estimate_noise` does, for a run with these settings."""
    return _estimate_in(scene, settings, chosen_sampling(settings).sampling)


def refuse_noise(noise: NoiseEstimate | None, scene: Scene, settings: ViewSettings) -> None:
    """Refuse a run that would have too much noise.

    Args:
        noise: that was estimated.
        scene: of the run.
        settings: of the run.

    Raises:
        NoiseError: if more than 20 % of the events would be noise, or than ``noise_share`` if that is more. It has all
            that keeps the renderers without noise from the scene, and the ways on.
    """
    if noise is None:
        return
    limit = max(NOISE_LIMIT, settings.noise_share)
    by_auto = noise.rays_per_pixel_for(settings.noise_share)
    rays_per_pixel = by_auto if settings.rays_per_pixel == AUTO_RAYS else noise.rays_per_pixel
    fraction = noise.share_at(rays_per_pixel)
    if not fraction > limit:
        return
    obstacles = why_not_noise_free(view_scene(scene, settings).scene)

    def said(given: Callable[[str, str], str]) -> str:
        lines = [
            f"{share_text(fraction, 'the events would be')} at {rays_per_pixel} rays per pixel; above {percent(limit)} "
            "nothing is rendered",
            "what keeps the renderers without noise from this scene:",
        ]
        if settings.renderer != AUTO_RENDERER:
            lines.append(f"- Mitsuba's integrators were asked for: give {given('renderer', AUTO_RENDERER)}")
        lines += [f"- {obstacle}" for obstacle in obstacles]
        lines += ["the ways on:", "- mend what is listed: then no event is noise"]
        if settings.rays_per_pixel != AUTO_RAYS:
            left = noise.share_at(by_auto)
            above = ", still above the limit," if left > limit else ""
            auto = f"with {by_auto} rays per pixel about {percent(left)} are noise{above} and the run takes"
            lines.append(f"- {given('rays_per_pixel', AUTO_RAYS)}: {auto} {about(noise.run_s(by_auto))}")
        lines.append(f"- {given('accept_noise', '')}: as it is, the run takes {about(noise.run_s(rays_per_pixel))}")
        return "\n".join(lines)

    raise NoiseError(
        said(lambda name, value: f"--{name.replace('_', '-')} {value}".rstrip()),
        in_plan=said(lambda name, value: f"{name}: {value or 'true'}"),
    )


class _PilotRenders:
    """Renders a few pixels in a few stretches of a path, with as many seeds as the cost allows."""

    def __init__(
        self, renderer: SceneRenderer, trajectory: Trajectory, rule: MaxDisplacement, cost_share: float
    ) -> None:
        self.renderer, self.trajectory, self.spacing_px = renderer, trajectory, rule.pixels
        self.rays, self.ray_s = 0, math.nan
        self.base = math.ceil(
            renderer.rays_per_pixel / 2 ** max(0, math.ceil(math.log2(renderer.rays_per_pixel / MOST_BASE_SAMPLES)))
        )
        scalar = renderer.variant == SCALAR
        self.times = stretches_of(renderer, trajectory, rule, 1 if scalar else STRETCHES)
        size = renderer.camera.width * renderer.camera.height
        span_us = sum(int(t_us[-1] - t_us[0]) for t_us in self.times)
        keyframes = sum(len(t_us) for t_us in self.times)
        per_us = (keyframes - len(self.times)) / span_us if span_us else 0.0
        self.keyframes = per_us * trajectory.duration_s * 1e6 + 1
        self.run_rays = round(self.keyframes * size * renderer.rays_per_pixel)
        # With a blur or a lens each pixel brings its neighbours.
        a_seed = keyframes * self.base * (2 * renderer.reach_px + 1) ** 2
        allowed = max(cost_share * self.run_rays, FEWEST_RAYS_SCALAR if scalar else FEWEST_RAYS) / a_seed
        self.seeds = int(np.clip(allowed // PIXELS, FEWEST_SEEDS, SEEDS))
        self.pixel = spread_pixels(size, int(np.clip(allowed // self.seeds, min(FEWEST_PIXELS, size), PIXELS)))

    def is_the_same(self) -> bool:
        """Tell whether two seeds give the same luma at the first and the last instant."""
        ends = np.array([self.times[0][0], self.times[-1][-1]])
        return np.array_equal(self._samples(ends, 0), self._samples(ends, 1))

    def luma(self) -> list[npt.NDArray[np.float32]]:
        """Return the luma (seeds, keyframes, pixels) of each stretch; takes the time of a ray."""
        before, started = self.rays, time.perf_counter()
        # A scene that changes is put into the state of an instant once, for all seeds.
        step = 1 if self.renderer.motion else max(map(len, self.times))
        pieces = [[t_us[i : i + step] for i in range(0, len(t_us), step)] for t_us in self.times]
        done, count = 0, self.seeds * sum(map(len, pieces))

        def rendered(t_us: IntArray) -> npt.NDArray[np.float32]:
            nonlocal done
            seeds = []
            for seed in range(self.seeds):
                doing(f"measuring noise, {done} of {count} renderings")
                seeds.append(self._samples(t_us, seed))
                done += 1
            return np.stack(seeds)

        luma = [np.concatenate([rendered(piece) for piece in stretch], 1) for stretch in pieces]
        self.ray_s = (time.perf_counter() - started) / (self.rays - before)
        return luma

    def _samples(self, t_us: IntArray, seed: int) -> npt.NDArray[np.float32]:
        self.rays += len(t_us) * len(self.pixel) * self.base * (2 * self.renderer.reach_px + 1) ** 2
        return luma_of_pixels(self.renderer.reseeded(seed), self.trajectory, t_us, self.pixel, rays=self.base)


def _mismatch(
    frames: list[npt.NDArray[np.float32]],
    times: list[IntArray],
    blocks: int,
    thresholds: tuple[float, float],
    log_eps: float,
) -> tuple[float, int]:
    """Return (share of events missing or spurious, events of the reference) of averages over ``blocks`` seeds.

    Up to four disjoint groups of seeds are averaged. Each is compared with the average of all other seeds.
    """
    wrong = right = 0
    for luma, t_us in zip(frames, times, strict=True):
        total = luma.sum(0, dtype=np.float64)
        for group in range(min(4, len(luma) // blocks)):
            summed = luma[group * blocks : (group + 1) * blocks].sum(0, dtype=np.float64)
            streams = [summed / blocks, (total - summed) / (len(luma) - blocks)]
            ours, theirs = (events_of_pixels(mean, t_us, thresholds, log_eps) for mean in streams)
            comparison = compare_events(ours, theirs, size=(luma.shape[2], 1))
            wrong, right = wrong + comparison.missing + comparison.spurious, right + comparison.reference
    return (wrong / right if right else math.nan), right
