"""How many events of a scene that Mitsuba's integrators render are Monte Carlo noise: an estimate before the run.

Light paths are drawn at random. The random numbers of a ray depend on the seed and on the ray's place in the frame,
and are the same in every frame. So a pixel at rest makes no events of noise. When the camera moves, each pixel's error
changes with what the pixel sees, and crosses levels that the light does not.

A few pixels are followed through a few short stretches of the path, rendered with many seeds. Averages of disjoint
seeds are runs of more samples, independent of each other. So the estimate is a measurement, not a model: an average of
few seeds against that of all others, through the crossing engine, matched event by event.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._core import CrossingEngine
from ._mitsuba import SCALAR, variant
from .event_matching import compare_events
from .events import EventArray
from .pose import FloatArray
from .rendering.render import Renderer
from .rendering.render_scene import SceneRenderer
from .rendering.renderers import make_renderer
from .sampling.rules import MaxDisplacement, TimeSampling
from .scene.scene import Scene
from .settings import ViewSettings, complete, renderer_settings, takes_settings, view_scene
from .trajectory.trajectory import Trajectory
from .trajectory.views import Views

if TYPE_CHECKING:
    from typing_extensions import Unpack

PIXELS = 256
"""How many pixels are followed."""

STRETCHES, KEYFRAMES = 4, 25
"""The path is sampled in ``STRETCHES`` stretches of ``KEYFRAMES`` keyframes: 8 pixels of motion each, at the paper's
third of a pixel a keyframe."""

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

SAMPLE_NUMBERS = (8, 13, 21, 34, 55, 89, 144, 233, 377, 610, 987, 1024)
"""What ``samples="auto"`` takes one of: Fibonacci numbers, whose lattices integrate edges best, and the most."""

IntArray = npt.NDArray[np.int64]


class NoiseWarning(UserWarning):
    """Warns that a larger share of a run's events than ``noise_share`` is expected to be Monte Carlo noise."""


@dataclass(frozen=True)
class NoiseEstimate:
    """How many events of a run are noise.

    A share is that of missing and spurious events (:func:`~davis_rs.compare_events`, within 10 ms) in the number of
    events without noise; it may exceed 1.

    Attributes:
        samples: rays a pixel of the run.
        measured: (samples, share), measured, by increasing samples; empty where there is no noise, or too few events
            to tell.
        log_noise: root mean square of the noise of log luma at ``samples``, in units of C.
        events: how many the estimate saw without noise.
        rays: how many it cast.
        run_rays: how many the run will cast, roughly.
        noisy: whether two seeds gave different light at all.
    """

    samples: int
    measured: tuple[tuple[float, float], ...] = ()
    log_noise: float = 0.0
    events: int = 0
    rays: int = 0
    run_rays: int = 0
    noisy: bool = True

    @property
    def known(self) -> bool:
        """Whether :meth:`share_at` has a result."""
        return bool(self.measured) or not self.noisy

    def share_at(self, samples: float) -> float:
        """Return share of events that noise makes missing or spurious, with ``samples`` rays a pixel.

        Between two measured numbers it is a straight line in logarithms. Outside it falls as the inverse square root of
        ``samples``, as the noise of luma itself does. NaN where it is not known.
        """
        if not self.noisy:
            return 0.0
        if not self.measured:
            return math.nan
        counts, shares = (np.array(column) for column in zip(*self.measured, strict=True))
        inside = float(np.clip(samples, counts[0], counts[-1]))
        logs = np.log(np.maximum(shares, 1e-6))
        return float(np.exp(np.interp(np.log(inside), np.log(counts), logs)) * math.sqrt(inside / samples))

    def samples_for(self, share: float) -> int:
        """Return the fewest of ``SAMPLE_NUMBERS``, from :attr:`samples` on, that keep the share; else 1024."""
        enough = (n for n in SAMPLE_NUMBERS if n > self.samples and self.share_at(n) <= share)
        return self.samples if not self.known or self.share_at(self.samples) <= share else next(enough, 1024)

    def describe(self, samples: int | None = None) -> dict[str, Any]:
        """Return the estimate in JSON's types, for meta.json.

        Args:
            samples: rays a pixel of the run, where others were chosen by the estimate.
        """
        shares = {f"{count:.4g}": float(f"{share:.4g}") for count, share in self.measured}
        samples = self.samples if samples is None else samples
        share = self.share_at(samples)
        return {
            "share": None if math.isnan(share) else float(f"{share:.4g}"),
            "samples": samples,
            "log_noise_over_c": float(f"{self.log_noise * math.sqrt(self.samples / samples):.4g}"),
            "measured": shares,
            "rays": self.rays,
        }

    def __str__(self) -> str:
        if not self.noisy:
            return "no Monte Carlo noise: two seeds give the same light"
        if not self.measured:
            return (
                f"too few events to tell how many are Monte Carlo noise at {self.samples} samples; log luma is wrong "
                f"by {self.log_noise:.2g} C (rms)"
            )
        told = f"{_share_text(self.share_at(self.samples))} at {self.samples} samples"
        more = 64 if self.samples < 64 else 4 * self.samples
        return told if more > 1024 else f"{told}; {more} samples: about {100 * self.share_at(more):.2g} %"


def _share_text(share: float) -> str:
    if share >= 0.995:
        return f"most of these events are Monte Carlo noise ({100 * share:.0f} missing or spurious to 100 right ones)"
    return f"about {100 * share:.2g} % of these events are Monte Carlo noise (missing or spurious)"


@takes_settings(ViewSettings)
def estimate_noise(scene: Scene, **settings: Unpack[ViewSettings]) -> NoiseEstimate | None:
    """Estimate how many events along a scene's camera path will be Monte Carlo noise; None where there is none at all.

    Only what Mitsuba's integrators render has noise: for the native renderer and the table kernel it is None.

    >>> estimate = estimate_noise(load_scene("room.xml"))
    >>> print(estimate)
    about 84 % of these events are Monte Carlo noise (missing or spurious) at 8 samples; 64 samples: about 34 %
    >>> simulate(scene, samples=estimate.samples_for(0.05))

    Args:
        scene: with the camera path.
        {settings}

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for a value out of range, a scene without a camera path, or one that cannot be rendered.
        OSError: if a scene file or a calibration cannot be read.
    """
    given = complete(ViewSettings, settings, of=estimate_noise)
    viewed = view_scene(scene, given)
    renderer = make_renderer(viewed.scene, viewed.camera, **renderer_settings(given))
    return estimate_noise_of(
        renderer,
        viewed.scene.path,
        contrast_threshold=viewed.contrast_threshold,
        contrast_threshold_off=viewed.contrast_threshold_off,
        log_eps=viewed.log_eps,
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
    """The same as :func:`estimate_noise`, for an existing renderer, which may have a lens.

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
        return _estimate(_Look(renderer, trajectory, MaxDisplacement(rule.pixels), cost_share), thresholds, log_eps)


def _estimate(look: _Look, thresholds: tuple[float, float], log_eps: float) -> NoiseEstimate:
    renderer = look.renderer
    if look.is_the_same():
        return NoiseEstimate(renderer.rays, rays=look.rays, run_rays=look.run_rays, noisy=False)
    frames = look.luma()
    logs = np.log(np.concatenate([part.reshape(len(part), -1) for part in frames], 1, dtype=np.float64) + log_eps)
    noise = float(np.sqrt(logs.var(0, ddof=1).mean())) * math.sqrt(look.base / renderer.rays) / min(thresholds)
    measured, events = [], 0
    blocks = 1
    while blocks <= max(1, look.seeds // 4):
        share, events = _mismatch(frames, look.times, blocks, thresholds, log_eps)
        # An average of k seeds against that of all others: errors of both add up, as if of an average of fewer.
        effective = 1 / (1 / blocks + 1 / (look.seeds - blocks))
        measured.append((look.base * effective, share))
        blocks *= 2
    if events < FEWEST_EVENTS:
        measured = []
    return NoiseEstimate(renderer.rays, tuple(measured), noise, events, look.rays, look.run_rays)


class _Look:
    """A few pixels in a few stretches of a path, and how many seeds the cost allows."""

    def __init__(
        self, renderer: SceneRenderer, trajectory: Trajectory, rule: MaxDisplacement, cost_share: float
    ) -> None:
        self.renderer, self.trajectory = renderer, trajectory
        self.rays = 0
        self.base = math.ceil(renderer.rays / 2 ** max(0, math.ceil(math.log2(renderer.rays / MOST_BASE_SAMPLES))))
        scalar = renderer.variant == SCALAR
        self.times = _stretches(renderer, trajectory, rule, 1 if scalar else STRETCHES)
        size = renderer.camera.width * renderer.camera.height
        span_us = sum(int(t_us[-1] - t_us[0]) for t_us in self.times)
        keyframes = sum(len(t_us) for t_us in self.times)
        per_us = (keyframes - len(self.times)) / span_us if span_us else 0.0
        self.run_rays = round((per_us * trajectory.duration_s * 1e6 + 1) * size * renderer.rays)
        # With a blur or a lens each pixel brings its neighbours.
        a_seed = keyframes * self.base * (2 * renderer.reach_px + 1) ** 2
        allowed = max(cost_share * self.run_rays, FEWEST_RAYS_SCALAR if scalar else FEWEST_RAYS) / a_seed
        self.seeds = int(np.clip(allowed // PIXELS, FEWEST_SEEDS, SEEDS))
        self.pixel = _spread_pixels(size, int(np.clip(allowed // self.seeds, min(FEWEST_PIXELS, size), PIXELS)))

    def is_the_same(self) -> bool:
        """Whether two seeds give the same luma at the first and the last instant."""
        ends = np.array([self.times[0][0], self.times[-1][-1]])
        return np.array_equal(self._samples(ends, 0), self._samples(ends, 1))

    def luma(self) -> list[npt.NDArray[np.float32]]:
        """Return the luma (seeds, keyframes, pixels) of each stretch."""
        # A scene that changes is put into the state of an instant once, for all seeds.
        step = 1 if self.renderer.motion else max(map(len, self.times))
        return [
            np.concatenate(
                [
                    np.stack([self._samples(t_us[i : i + step], seed) for seed in range(self.seeds)])
                    for i in range(0, len(t_us), step)
                ],
                1,
            )
            for t_us in self.times
        ]

    def _samples(self, t_us: IntArray, seed: int) -> npt.NDArray[np.float32]:
        views, count = Views.along(self.trajectory, t_us * 1e-6), len(self.pixel)
        seeded = self.renderer.reseeded(seed)
        self.rays += len(t_us) * count * self.base * (2 * self.renderer.reach_px + 1) ** 2
        view = np.repeat(np.arange(len(views)), count)
        return seeded.samples(views, view, np.tile(self.pixel, len(views)), rays=self.base).reshape(-1, count)


def _stretches(renderer: Renderer, trajectory: Trajectory, rule: MaxDisplacement, stretches: int) -> list[IntArray]:
    """The keyframes of stretches, spread evenly over the path; of a short path all that there are."""
    end_us = round(trajectory.duration_s * 1e6)
    wanted = stretches * KEYFRAMES
    first = [0, *islice(rule.instants(renderer, trajectory, end_us), wanted)]
    if len(first) <= wanted:
        return [np.unique(np.array([*first, end_us], np.int64))]
    found = [np.array(first[:KEYFRAMES], np.int64)]
    for number in range(1, stretches):
        start_us = max(end_us * number // stretches, int(found[-1][-1]))
        rest = trajectory.crop(start_us * 1e-6)
        instants = islice(rule.instants(renderer, rest, end_us - start_us, start_us=start_us), KEYFRAMES - 1)
        t_us = np.array([start_us, *(start_us + t_us for t_us in instants)], np.int64)
        if len(t_us) > 1:
            found.append(t_us)
    return found


def _spread_pixels(size: int, count: int) -> IntArray:
    """Indices y W + x of ``count`` pixels: one in each of ``count`` equal runs, at places that form no pattern."""
    edges = np.linspace(0, size, count + 1)
    golden = np.arange(count) * ((math.sqrt(5) - 1) / 2) % 1
    return np.minimum((edges[:-1] + golden * np.diff(edges)).astype(np.int64), size - 1)


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
            part = luma[group * blocks : (group + 1) * blocks].sum(0, dtype=np.float64)
            streams = [part / blocks, (total - part) / (len(luma) - blocks)]
            ours, theirs = (_events(mean, t_us, thresholds, log_eps) for mean in streams)
            found = compare_events(ours, theirs, size=(luma.shape[2], 1))
            wrong, right = wrong + found.missing + found.spurious, right + found.reference
    return (wrong / right if right else math.nan), right


def _events(luma: FloatArray, t_us: IntArray, thresholds: tuple[float, float], log_eps: float) -> EventArray:
    """The events of pixels (keyframes, pixels)."""
    engine = CrossingEngine(
        luma.shape[1],
        1,
        contrast_threshold=thresholds[0],
        contrast_threshold_off=thresholds[1],
        log_eps=log_eps,
        threads=1,
    )
    rows = luma.astype(np.float32)[:, None]
    return np.concatenate([engine.push(t, row) for t, row in zip((t_us - t_us[0]).tolist(), rows, strict=True)])
