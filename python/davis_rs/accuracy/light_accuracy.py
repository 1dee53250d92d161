"""Measures what baked light saves and errs, against Mitsuba's path tracer, on a few instants of a camera's path."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._core import CrossingEngine
from .._util.whole_file import whole_file
from ..events.arrays import EventArray, concatenate_events
from ..events.luma import LumaFrames
from ..events.matching import compare_events
from ..geometry.camera import Camera
from ..geometry.trajectory.views import Views
from ..render.baked.bake import BAKE_ERROR
from ..render.base import Renderer
from ..render.choice import make_renderer
from ..render.native.renderer import NativeRenderer
from ..scene.scene import Scene

LIGHT_SAMPLES = (64, 256)
"""Of the path tracer that is compared."""

REFERENCE_SAMPLES, REFERENCE_RUNS = 1024, 4
_FIRST_SEED = 1000

WINDOW_US = 5000
"""How far apart two events may be that count as the same."""

HEADS = ("light", "bake s", "ms a frame", "events", "median us", "p99 us", "missing + spurious %", "rms log luma / C")


@dataclass(frozen=True)
class LightErrors:
    """Says how far events, and log luma, of one way to light a scene are from the reference's.

    Attributes:
        what: is judged, for people.
        bake_s: how long the bake took, also where the light came from the cache; None without one.
        frame_ms: a frame takes, the bake apart; None where it was not measured.
        events: how many there are.
        median_us, p99_us: of the time error of those that have a partner.
        wrong_percent: missing and spurious, of the reference's events.
        log_rms: root mean square error of log luma, in C.
    """

    what: str
    bake_s: float | None
    frame_ms: float | None
    events: int
    median_us: float
    p99_us: float
    wrong_percent: float
    log_rms: float

    def __str__(self) -> str:
        """Write a row of a table in Markdown, under :data:`HEADS`."""
        cost = ["" if value is None else f"{value:.3g}" for value in (self.bake_s, self.frame_ms)]
        figures = [f"{self.events:,}", f"{self.median_us:.0f}", f"{self.p99_us:.0f}", f"{self.wrong_percent:.1f}"]
        return f"| {' | '.join([self.what, *cost, *figures, f'{self.log_rms:.3f}'])} |"


class LightComparison:
    """Compares baked light, and the path tracer with few samples, with the mean luma of independent runs with many.

    All see the same instants, between which log luma is linear, so that nothing but light is compared.

    Args:
        scene: that is baked under ``auto``.
        runs: of the reference, an even number; two halves of them, compared with each other, say how far it can be
            trusted.
        reference_samples: of each run.
        instants: how many, over ``duration_s`` of the path's beginning.
        rays: of the native renderer, a pixel.
        folder: keeps the runs, which are taken from there another time; None: nothing is kept.

    Attributes:
        reference, baked: luma (instants, height, width), once :meth:`measure` has them.

    Raises:
        ValueError: for a scene whose light is not baked, or an odd number of runs.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        *,
        runs: int = REFERENCE_RUNS,
        reference_samples: int = REFERENCE_SAMPLES,
        instants: int = 2,
        duration_s: float = 0.02,
        rays: int = 256,
        bake_error: float = BAKE_ERROR,
        folder: Path | None = None,
    ) -> None:
        if runs < 2 or runs % 2:
            raise ValueError(f"runs of the reference must be an even number from 2 on, got {runs}")
        self.scene, self.camera, self._folder = scene, camera, folder
        self._runs, self._samples, self._error = runs, reference_samples, bake_error
        self.duration_s = duration_s
        self._views = Views.along(scene.path, np.linspace(0.0, duration_s, instants))
        renderer = make_renderer(scene, camera, kind="baked", rays_per_pixel=rays, bake_error=bake_error)
        assert isinstance(renderer, NativeRenderer)
        assert renderer.baked is not None
        self._renderer, self._light, self._rays = renderer, renderer.baked, rays
        identity = (self._light.content, repr(camera), instants, duration_s, reference_samples)
        self._name = hashlib.sha256(repr(identity).encode()).hexdigest()[:16]
        self.reference = self.baked = np.empty((0, camera.height, camera.width), np.float32)

    def measure(self, samples: tuple[int, ...] = LIGHT_SAMPLES) -> Iterator[LightErrors]:
        """Measure errors: of the reference, the path tracer with each number of ``samples``, and baked light."""
        runs = [self._run(seed) for seed in range(_FIRST_SEED, _FIRST_SEED + self._runs)]
        # Neighbours in time are in different halves.
        even, odd = (np.asarray(np.mean(half, axis=0), np.float32) for half in (runs[::2], runs[1::2]))
        self.reference = np.mean(runs, axis=0, dtype=np.float32)
        method = f"reference: {self._runs} runs of {self._samples:,} samples; its halves compared"
        yield self._errors(method, even, odd, None, None)
        for count in samples:
            tracer = make_renderer(self.scene, self.camera, kind="integrator", rays_per_pixel=count, seed=0)
            luma, ms = self._timed(tracer)
            yield self._errors(f"path tracer, {count:,} samples", luma, self.reference, None, ms)
        self.baked, ms = self._timed(self._renderer)
        method = f"baked, error {self._error:g}, {self._rays} rays"
        yield self._errors(method, self.baked, self.reference, self._light.maps.seconds, ms)

    def _run(self, seed: int) -> LumaFrames:
        file = None if self._folder is None else self._folder / f"light_{self._name}_{seed}.npy"
        if file is not None and file.exists():
            return np.asarray(np.load(file, allow_pickle=False), np.float32)
        tracer = make_renderer(self.scene, self.camera, kind="integrator", rays_per_pixel=self._samples, seed=seed)
        luma = tracer.luma(self._views)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(file) as working:
                np.save(working, luma)
        return luma

    def _errors(
        self, method: str, luma: LumaFrames, other: LumaFrames, bake_s: float | None, ms: float | None
    ) -> LightErrors:
        own, true = self._events(luma), self._events(other)
        comparison = compare_events(own, true, size=(self.camera.width, self.camera.height), window_us=WINDOW_US)
        eps, contrast = 1e-3, self.scene.contrast_threshold
        log_rms = float(np.sqrt(np.mean((np.log(luma + eps) - np.log(other + eps)) ** 2))) / contrast
        wrong = comparison.missing_percent + comparison.spurious_percent
        return LightErrors(method, bake_s, ms, len(own), comparison.median_us, comparison.p99_us, wrong, log_rms)

    def _events(self, luma: LumaFrames) -> EventArray:
        contrast = self.scene.contrast_threshold
        engine = CrossingEngine(self.camera.width, self.camera.height, contrast_threshold=contrast)
        stamps = np.linspace(0, self.duration_s * 1e6, len(luma)).astype(np.int64)
        return concatenate_events([engine.push(int(t_us), frame) for t_us, frame in zip(stamps, luma, strict=True)])

    def _timed(self, renderer: Renderer) -> tuple[LumaFrames, float]:
        """Return luma, and the least milliseconds a frame of three tries; of one try where it is long."""
        luma, least = renderer.luma(self._views[:1]), np.inf
        for _ in range(3):
            start = time.perf_counter()
            luma = renderer.luma(self._views)
            seconds = time.perf_counter() - start
            least = min(least, 1000 * seconds / len(self._views))
            if seconds > 10:
                break
        return luma, least


_PLANNED_SAMPLES, _TRIED_SAMPLES = 64, 2


def light_cost(renderer: Renderer, scene: Scene) -> str | None:
    """Say in a line what baking saves and errs, for one who plans a run; None for a renderer without baked light.

    One frame of the path tracer is rendered with few samples; with more, it takes as many times as long.
    """
    if not isinstance(renderer, NativeRenderer) or renderer.baked is None:
        return None
    views = Views.along(scene.path, np.zeros(1))
    tracer = make_renderer(scene, renderer.camera, kind="integrator", rays_per_pixel=_TRIED_SAMPLES)
    ms = []
    for timed in (renderer, tracer):
        timed.luma(views)
        start = time.perf_counter()
        timed.luma(views)
        ms.append(1000 * (time.perf_counter() - start))
    by_paths = ms[1] * _PLANNED_SAMPLES / _TRIED_SAMPLES
    maps = renderer.baked.maps
    return (
        f"baked light: {maps.points:,} points, error {renderer.baked.errors}, baked in {maps.seconds:.3g} s "
        f"({'now in the cache' if renderer.baked.cached else 'not in a cache'}); a frame takes {ms[0]:.3g} ms, by the "
        f"path tracer at {_PLANNED_SAMPLES} samples about {by_paths:.3g} ms, with noise"
    )
