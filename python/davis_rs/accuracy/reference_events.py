"""Makes reference streams: the events of a short recipe, as nearly as rendering can tell, to judge simulations by.

Times are in ticks of a tenth of a microsecond, so that the microsecond of a simulated stamp is seen as what it is: an
error of half a microsecond.
"""

from __future__ import annotations

import json
from collections.abc import Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import CrossingEngine, __version__, log_intensity
from .._util.whole_file import whole_file
from ..events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from ..events.matching import compare_events
from ..geometry.pose import FloatArray
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..sampling.keyframes import exact_log_luma, slope
from ..sampling.rules import MaxDisplacement

TICKS_PER_US = 10

EXACT_PX = 1 / 48
"""How far the fastest pixel moves between the samples that bracket exact crossings."""

IntArray = npt.NDArray[np.int64]

_AT_ONCE = 1 << 15
"""Single pixels asked for in one call: bounds the memory of their views."""


@dataclass(frozen=True)
class Recipe:
    """Holds what is simulated, and judged.

    Attributes:
        trajectory: from t = 0.
        contrast_threshold: C in natural-log units.
        log_eps: dark level in units of luma.
        window_us: events further apart than this are not the same, see
            :func:`~davis_rs.compare_events`.
    """

    trajectory: Trajectory
    contrast_threshold: float
    log_eps: float
    window_us: int

    @property
    def end_us(self) -> int:
        return round(self.trajectory.duration_s * 1e6)

    def views(self, ticks: IntArray) -> Views:
        return Views.along(self.trajectory, ticks * (1e-6 / TICKS_PER_US))

    def engine(self, renderer: Renderer, interpolation: str) -> CrossingEngine:
        camera, threshold = renderer.camera, self.contrast_threshold
        return CrossingEngine(camera.width, camera.height, contrast_threshold=threshold, interpolation=interpolation)

    def log_luma(self, luma: npt.NDArray[np.float32]) -> FloatArray:
        """Return L (n, H, W), float64, of frames."""
        return np.stack([log_intensity(frame, self.log_eps) for frame in luma])


class Crossings(NamedTuple):
    """Holds events, t in ticks of 0.1 us, sorted by (t, y, x); ``level`` is the log intensity that each one reached."""

    events: EventArray
    level: FloatArray


class FineReference(NamedTuple):
    """Says what :func:`fine_reference` finds.

    Attributes:
        events: t in ticks of 0.1 us.
        t_us, luma: the rendered instants (n,) and their frames (n, H, W), float32.
        pixels: displacement between them.
        shift_us: how far halving the displacement to this one has moved the events: median and 99th percentile.
        changed_percent: events that it has brought or taken, in per cent.
    """

    events: EventArray
    t_us: IntArray
    luma: npt.NDArray[np.float32]
    pixels: float
    shift_us: tuple[float, float]
    changed_percent: float


def in_ticks(events: EventArray) -> EventArray:
    """Bring a simulated stream, t in us, to a reference's ticks."""
    ticks = events.copy()
    ticks["t"] *= TICKS_PER_US
    return ticks


def exact_crossings(renderer: Renderer, recipe: Recipe, *, pixels: float = EXACT_PX) -> Crossings:
    """Find the events that a renderer's own luma makes, as if it were rendered at every instant.

    It is rendered so densely that nothing is missed: whenever the fastest pixel has moved by ``pixels``. Each crossing
    found lies between two such samples, one that has not reached the level and one that has; that bracket is halved
    by rendering the pixel in its middle, until it is one tick long. Jumps (edges that pass a lattice ray) are found
    likewise. So what a simulation with the same renderer differs by is its error in time alone.
    """
    engine = recipe.engine(renderer, "linear")
    times = _instants(renderer, recipe, pixels)
    crossings: list[tuple[npt.NDArray[np.generic], ...]] = []
    last_us = 0
    for start in range(0, len(times), renderer.poses_per_launch):
        batch = times[start : start + renderer.poses_per_launch]
        for t_us, log in zip(
            batch.tolist(), recipe.log_luma(renderer.luma(recipe.views(batch * TICKS_PER_US))), strict=True
        ):
            before = engine.reference.ravel()
            events = engine.push_log(t_us, log)
            pixel = events["y"].astype(np.int64) * renderer.camera.width + events["x"]
            order = np.argsort(pixel, kind="stable")  # a line goes one way: a pixel's levels follow each other
            events, pixel = events[order], pixel[order]
            new = np.concatenate([[True], pixel[1:] != pixel[:-1]])[: len(pixel)]
            nth = np.arange(len(pixel)) - np.maximum.accumulate(np.where(new, np.arange(len(pixel)), 0)) + 1
            sign = np.where(events["p"] == 1, 1.0, -1.0)
            level = before[pixel] + sign * nth * recipe.contrast_threshold
            bracket = np.broadcast_to(np.array([[last_us], [t_us]]) * TICKS_PER_US, (2, len(pixel)))
            crossings.append((pixel, sign, level, bracket))
            last_us = t_us
    pixel, sign, level, (low, high) = (np.concatenate(column, -1) for column in zip(*crossings, strict=True))
    ticks = _first_ticks(renderer, recipe, pixel, sign, level, low, high)
    events = np.zeros(len(pixel), EVENT_DTYPE)
    events["t"], events["p"] = ticks, sign > 0
    events["y"], events["x"] = np.divmod(pixel, renderer.camera.width)
    order = np.lexsort((events["x"], events["y"], events["t"]))
    return Crossings(events[order], level[order])


def _first_ticks(
    renderer: Renderer,
    recipe: Recipe,
    pixel: IntArray,
    sign: FloatArray,
    level: FloatArray,
    low: IntArray,
    high: IntArray,
) -> IntArray:
    """Find the ticks in (low, high] at which pixels have reached their levels, and one tick before have not."""
    low, high = low.copy(), high.copy()
    while len(active := np.flatnonzero(high - low > 1)):
        for start in range(0, len(active), _AT_ONCE):
            some = active[start : start + _AT_ONCE]
            middle = (low[some] + high[some]) // 2
            luma = renderer.samples(recipe.views(middle), np.arange(len(some)), pixel[some])
            log = exact_log_luma(luma, recipe.log_eps)
            reached = sign[some] * (log - level[some]) >= 0
            high[some[reached]] = middle[reached]
            low[some[~reached]] = middle[~reached]
    return high


def fine_reference(
    renderer: Renderer,
    recipe: Recipe,
    cache: Path,
    *,
    coarsest: float = 1 / 4,
    finest: float = 1 / 16,
) -> Generator[tuple[int, int], None, FineReference]:
    """Find the events by a renderer of very many rays, along cubics between its frames.

    For 1,024 rays a pixel, whose lattice shares no point with the small ones. The displacement between frames is halved
    from ``coarsest`` until that moves the median event by less than a thousandth of the window, or it is ``finest``.

    Args:
        cache: an .npz file for the frames; used if it holds those of the same sequence and renderer.

    Yields:
        After each frame, how many there are, and how many there will be at most.
    """
    key = json.dumps(
        {
            "davis_rs": __version__,
            "trajectory": recipe.trajectory.describe(),
            "threshold": [recipe.contrast_threshold, recipe.log_eps],
            "camera": asdict(renderer.camera),
            "renderer": [renderer.name, renderer.rays_per_pixel, renderer.blur],
        }
    )
    size, window_us = (renderer.camera.width, renderer.camera.height), recipe.window_us * TICKS_PER_US
    frames = _cached_frames(cache, key)
    latest: FineReference | None = None
    halvings = range(round(np.log2(coarsest / finest)) + 1)
    rounds = {coarsest / 2**halving: _instants(renderer, recipe, coarsest / 2**halving) for halving in halvings}
    most = len(frames.keys() | np.unique(np.concatenate([*rounds.values()])).tolist())
    for pixels, times in rounds.items():
        for t_us in times.tolist():
            if t_us not in frames:
                frames[t_us] = renderer.luma(recipe.views(np.array([t_us * TICKS_PER_US])))[0]
                yield len(frames), most
        luma = np.stack([frames[t_us] for t_us in times.tolist()])
        events = _cubic_events(renderer, recipe, times, luma)
        shift, changed = (np.nan, np.nan), np.nan
        if latest is not None:
            compared = compare_events(latest.events, events, size=size, window_us=window_us)
            shift = (compared.median_us / TICKS_PER_US, compared.p99_us / TICKS_PER_US)
            changed = compared.missing_percent + compared.spurious_percent
        latest = FineReference(events, times, luma, pixels, shift, changed)
        if shift[0] <= recipe.window_us / 1000:
            break
    assert latest is not None
    cache.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(cache) as working, working.open("wb") as file:
        np.savez(file, key=np.array(key), t_us=latest.t_us, luma=latest.luma)
    return latest


def _cached_frames(cache: Path, key: str) -> dict[int, npt.NDArray[np.float32]]:
    if not cache.is_file():
        return {}
    with np.load(cache) as file:
        if str(file["key"]) != key:
            return {}
        return dict(zip(file["t_us"].tolist(), file["luma"], strict=True))


def _cubic_events(renderer: Renderer, recipe: Recipe, t_us: IntArray, luma: npt.NDArray[np.float32]) -> EventArray:
    """Find events in ticks, along cubics whose slopes come from neighbouring frames."""
    engine = recipe.engine(renderer, "hermite")
    log = recipe.log_luma(luma)
    ticks, rounded = (t_us * TICKS_PER_US).tolist(), list(log.astype(np.float32))
    return concatenate_events(
        [
            # The slope is per second of the engine's, whose microsecond is a tick.
            engine.push_log(tick, log[k], slope(ticks, rounded, k).astype(np.float64))
            for k, tick in enumerate(ticks)
        ]
    )


def _instants(renderer: Renderer, recipe: Recipe, pixels: float) -> IntArray:
    """Return the start, the end, and each instant at which the fastest pixel has moved by ``pixels`` more."""
    between = MaxDisplacement(pixels).instants(renderer, recipe.trajectory, recipe.end_us)
    return np.unique([0, *between, recipe.end_us])
