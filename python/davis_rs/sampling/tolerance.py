"""Samples in time with control of the error: renders only where interpolation would fail."""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, islice, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.read_ahead import leave_if_unwanted
from ..events.luma import LumaFrames
from ..render.edges.swept import Counts
from .breaks import Break, break_instants
from .displacement import LARGEST_BEND, DisplacementClock, path_bound
from .keyframe_window import BoolFrame, KeyframeWindow
from .keyframes import Keyframe, LogLuma, SparseSamples, Stretch
from .plausibility import probed
from .rules import TimeSampling, next_count

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Tolerance(TimeSampling):
    """Keep the estimated error of log luma between renders below ``contrast`` times the contrast threshold.

    Keyframes are spaced by the displacement of the fastest pixel. Between them log luma runs along cubics through the
    keyframes (slopes from their neighbours, so that they cost nothing). Leaving a keyframe out and predicting it from
    the two on either side shows, pixel by pixel, how far such a cubic can be trusted, as the embedded formulas of
    adaptive ODE solvers do. Where an interval has too many pixels that cannot be trusted it is halved, and keyframes
    come closer from there on; where it has few, the keyframes are spaced wider. The pixels that are left (edges) are
    rendered alone at the middle of their interval, and again at the middles of its halves, until a sample lies where
    the line between its neighbours predicted it.

    Something that appears and vanishes between two samples leaves no trace in either: no estimate can see it. Where
    luma is a mean over rays it may happen when edges of the geometry pass over a pixel. The interval of such a pixel is
    halved whatever the samples are: twice for one edge, and fully for two, because there may be something thin between
    them. A thin line of a texture has no such protection. Lines (``pixel="lines"``) see all that a pixel holds, so
    that nothing need be halved for them while keyframes are less than a pixel apart.

    Where motion or light breaks there are keyframes on both sides; neither slopes nor estimates use keyframes across
    it.

    Args:
        contrast: tolerated error, as a fraction of the contrast threshold.
        pixels: displacement between keyframes at the start.
        longest: largest displacement between keyframes.
        halvings: how often a pixel's interval is halved at most.
        edges: halve the intervals of pixels that edges pass, see above.

    Raises:
        ValueError: for a value out of range.

    Source: Catmull, Rom 1974 (the cubic); Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4
    (step size control).
    """

    contrast: float = 0.05
    pixels: float = 0.5
    longest: float = 1.0
    halvings: int = 3
    edges: bool = True

    def __post_init__(self) -> None:
        for name in ("contrast", "pixels", "longest"):
            check_number(name, getattr(self, name), 0, above_low=True)
        check_number("halvings", self.halvings, 0, whole=True)

    @property
    def interpolation(self) -> str:
        return "hermite"

    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        return _StretchSampler(self, stretch).keyframes()


_STEP = 8
"""Keyframes rendered between two decisions; fixed, so that results do not depend on ``batch``."""

_TRUST = 1.0
"""Assumed ratio of an interval's error to the errors that leaving out its ends would have made: 0.14 for a smooth
signal, 1 for noise, such as that of textures finer than a pixel. With 1/2, a tenth of all pixels would miss their
tolerance."""

_WIDE, _NARROW = 0.35, 0.1
"""Fraction of untrusted pixels above which an interval is halved, and the fraction at which the spacing aims."""

_SHORTEST = 1 / 32
"""Smallest displacement between keyframes, as a fraction of that at the start. Halving may go below, but a jump or
noise does not shorten all that follows."""

_FOR_ONE_EDGE = 2
"""Least number of halvings where one edge passes; such an edge mostly leaves a trace in what follows."""

_REMAINS = 1 / 3
"""Assumed fraction of a line's error that is left when its middle becomes a sample: 1/4 if smooth, 1/2 at a jump."""


class _StretchSampler:
    """Runs over a stretch: yields keyframes in order, and holds those not yielded yet in a window."""

    def __init__(self, settings: Tolerance, stretch: Stretch) -> None:
        self._settings, self._stretch = settings, stretch
        self._tolerated = float(settings.contrast * stretch.contrast_threshold)
        self._pixels = min(settings.pixels, settings.longest)
        self._window = KeyframeWindow()
        self._count = 1  # how many keyframes the next call of the renderer may take

    def keyframes(self) -> Iterator[Keyframe]:
        window = self._window
        given = 0  # of the window
        if self._stretch.start_luma is not None:
            self._insert([self._stretch.start_us], self._stretch.start_luma[None])
            given = 1
        elif not self._stretch.first:
            self._render([self._stretch.start_us])
            given = 1
        for times, last in self._steps():
            window.complete = last
            self._render(times)
            untrusted, split = self._split(max(given - 1, 0))
            # The estimate of an interval needs two keyframes after it.
            ready = len(window.t_us) if last else max(len(window.t_us) - 2, given)
            if given == 0 and ready > 0:
                yield self._keyframe(0, None)
                given = 1
            for k, sparse in zip(range(given, ready), self._sparse(untrusted, given - 1, ready - 1), strict=True):
                yield self._keyframe(k, sparse)
            if ready > given and not split:
                same_part = np.diff(window.parts()[given - 1 : ready]) == 0
                fractions = [_fraction(pixels) for pixels in untrusted[given - 1 : ready - 1]]
                fraction = float(np.mean(np.array(fractions)[same_part])) if same_part.any() else _NARROW
                stretched = self._pixels * np.clip((_NARROW / max(fraction, 1e-3)) ** (1 / 3), 0.6, 1.4)
                self._pixels = float(min(stretched, self._settings.longest))
            self._pixels = max(self._pixels, _SHORTEST * min(self._settings.pixels, self._settings.longest))
            dropped = max(ready - 3, 0)
            given = ready - dropped
            window.drop(dropped)

    def _steps(self) -> Iterator[tuple[list[int], bool]]:
        """Yield the times to render next, and whether they are the last."""
        times: list[int] = []
        for t_us in self._instants():
            times.append(t_us)
            if len(times) >= _STEP:
                yield times, False
                times = []
        yield times, True

    def _instants(self) -> Iterator[int]:
        """Yield the instants at which to render, each by the spacing at the time when it is needed."""
        stretch = self._stretch
        length_us = stretch.end_us - stretch.start_us
        bound, clock = path_bound(stretch.renderer, stretch.trajectory, length_us), None
        last_us = stretch.start_us
        for required_us in self._required():
            while bound >= self._pixels:
                if clock is None:
                    clock = DisplacementClock(
                        stretch.renderer, stretch.trajectory, length_us, start_us=stretch.start_us
                    )
                moved, start_us = self._pixels, last_us - stretch.start_us
                path = clock.path_at(start_us) + moved
                end = clock.span_end(start_us, path, LARGEST_BEND * moved, required_us - stretch.start_us)
                if end is None or (next_us := max(stretch.start_us + end.t_us, last_us + 1)) >= required_us:
                    break
                yield from self._probed(last_us, next_us)
                if next_us == last_us + 1:
                    self._window.cuts.add(last_us)  # no motion is so fast, so it is a jump
                yield next_us
                last_us = next_us
            yield from self._probed(last_us, required_us)
            yield required_us
            last_us = required_us

    def _required(self) -> Iterator[int]:
        """Return the due instants and both sides of breaks; a break is a cut."""
        stretch = self._stretch
        at_breaks = break_instants(map(self._cut, stretch.breaks()), stretch.start_us, both=True)
        return (t_us for t_us, _ in groupby(heapq.merge(stretch.due, at_breaks)))

    def _cut(self, item: Break) -> Break:
        self._window.cuts.add(item.before_us)
        return item

    def _probed(self, start_us: int, end_us: int) -> Iterator[int]:
        """Yield the instants of :func:`probed`; a jump that it finds becomes a cut."""
        last_us = start_us
        for t_us in [*probed(self._stretch, start_us, end_us), end_us]:
            if t_us == last_us + 1 and end_us > start_us + 1:
                self._window.cuts.add(last_us)
            if t_us < end_us:
                yield t_us
            last_us = t_us

    def _render(self, times: list[int]) -> None:
        """Render keyframes at ``times``, and insert them into the window."""
        stretch = self._stretch
        ahead = iter(times)
        while batch := list(islice(ahead, self._count)):
            leave_if_unwanted()
            began = time.monotonic()
            self._insert(batch, stretch.renderer.luma(stretch.views(batch)))
            self._count = next_count(self._count, len(batch), time.monotonic() - began, stretch.batch)

    def _insert(self, times: list[int], luma: LumaFrames) -> None:
        self._window.insert(times, list(luma), list(self._stretch.log_luma(luma)))

    def _split(self, first: int) -> tuple[list[BoolFrame], bool]:
        """Halve intervals from ``first`` on until few of their pixels are untrusted.

        Returns:
            The untrusted pixels of each interval, and whether any interval was halved.
        """
        window, split = self._window, False
        untrusted = window.untrusted(self._tolerated / _TRUST)
        for _ in range(self._settings.halvings + 1):
            intervals = islice(zip(pairwise(window.t_us), untrusted, strict=True), first, None)
            middles = [(t + end) // 2 for (t, end), pixels in intervals if _fraction(pixels) > _WIDE and end - t > 1]
            if not middles:
                break
            self._render(middles)
            untrusted = window.untrusted(self._tolerated / _TRUST)
            # From here on keyframes come closer.
            self._pixels, split = self._pixels * (0.7 if not split else 1.0), True
        return untrusted, split

    def _sparse(self, untrusted: list[BoolFrame], first: int, end: int) -> Iterator[SparseSamples | None]:
        """Yield the samples of untrusted pixels within each interval in first..end."""
        if end <= first:
            return
        pieces, samples = self._pieces(untrusted, first, end), []
        for turn in range(self._settings.halvings):
            pieces = pieces.select(pieces.end_us - pieces.start_us > 1)
            if len(pieces.pixel) == 0:
                break
            middle_us = (pieces.start_us + pieces.end_us) // 2
            times, view = np.unique(middle_us, return_inverse=True)
            luma = self._stretch.renderer.samples(self._stretch.views(times), view, pieces.pixel)
            samples.append((pieces.interval, pieces.pixel, middle_us, luma))
            log = self._stretch.log_luma(luma)
            remains = np.float32(_REMAINS) * np.abs(log - pieces.line(middle_us))
            again = (turn + 1 < pieces.halvings) | (remains > self._tolerated)
            if turn + 1 < self._settings.halvings:
                pieces = pieces.halves(middle_us, log).select(np.tile(again, 2))
        if not samples:
            yield from [None] * (end - first)
            return
        interval, pixel, t_us, luma = (np.concatenate(column) for column in zip(*samples, strict=True))
        order = np.lexsort((t_us, pixel, interval))
        for chosen in np.split(order, np.searchsorted(interval[order], np.arange(1, end - first))):
            yield SparseSamples(pixel[chosen].astype(np.uint32), t_us[chosen], luma[chosen])

    def _pieces(self, untrusted: list[BoolFrame], first: int, end: int) -> _IntervalPieces:
        """Return the intervals in first..end of untrusted pixels, and of pixels that edges sweep."""
        window, most = self._window, self._settings.halvings
        sweeps = self._sweeps(first, end)
        least_halvings = np.array([0, min(_FOR_ONE_EDGE, most), most])
        columns = []
        for i, k in enumerate(range(first, end)):
            swept = np.zeros(untrusted[k].size, np.uint8) if sweeps is None else sweeps[i].ravel()
            wanted = untrusted[k].ravel() | (swept > 0)
            pixel = np.flatnonzero(wanted)
            edges = np.minimum(swept[pixel], 2)
            columns.append(
                (
                    np.full(len(pixel), i),
                    pixel,
                    np.full(len(pixel), window.t_us[k]),
                    np.full(len(pixel), window.t_us[k + 1]),
                    window.log_luma[k].ravel()[pixel],
                    window.log_luma[k + 1].ravel()[pixel],
                    least_halvings[edges],
                )
            )
        return _IntervalPieces(*(np.concatenate(column) for column in zip(*columns, strict=True)))

    def _sweeps(self, first: int, end: int) -> Counts | None:
        """Return how many edges may pass over each pixel in each interval in first..end, (end - first, H, W)."""
        renderer = self._stretch.renderer
        if renderer.silhouettes is None or self._settings.halvings == 0:
            return None
        t_us = np.array(self._window.t_us[first : end + 1])
        poses = [self._stretch.trajectory.pose((t - self._stretch.start_us) * 1e-6) for t in t_us.tolist()]
        return renderer.silhouettes.swept(
            renderer.camera,
            poses[:-1],
            poses[1:],
            t_before_s=t_us[:-1] * 1e-6,
            t_after_s=t_us[1:] * 1e-6,
            margin_px=float(renderer.reach_px),
        )

    def _keyframe(self, k: int, sparse: SparseSamples | None) -> Keyframe:
        luma = self._window.luma[k]
        rate = self._window.slope(k)
        rate *= luma + np.float32(self._stretch.log_eps)
        return Keyframe(self._window.t_us[k], luma, rate, sparse)


def _fraction(chosen: BoolFrame) -> float:
    """Return the fraction of pixels that are chosen."""
    return np.count_nonzero(chosen) / chosen.size


class _IntervalPieces(NamedTuple):
    """Holds pieces of pixels' intervals: start and end, log luma at both, and the least number of halvings."""

    interval: IntArray
    pixel: IntArray
    start_us: IntArray
    end_us: IntArray
    before: LogLuma
    after: LogLuma
    halvings: IntArray

    def select(self, chosen: npt.NDArray[np.bool_]) -> _IntervalPieces:
        """Return the chosen pieces."""
        interval, pixel, start_us, end_us, before, after, halvings = self
        return _IntervalPieces(
            interval[chosen],
            pixel[chosen],
            start_us[chosen],
            end_us[chosen],
            before[chosen],
            after[chosen],
            halvings[chosen],
        )

    def line(self, t_us: IntArray) -> LogLuma:
        """Return log luma on the line between both ends."""
        fraction = ((t_us - self.start_us) / (self.end_us - self.start_us)).astype(np.float32)
        return np.asarray(self.before + fraction * (self.after - self.before))

    def halves(self, t_us: IntArray, log: LogLuma) -> _IntervalPieces:
        """Cut the pieces at ``t_us``, where log luma is ``log``; return all first halves, then all second halves."""
        return _IntervalPieces(
            np.tile(self.interval, 2),
            np.tile(self.pixel, 2),
            np.concatenate([self.start_us, t_us]),
            np.concatenate([t_us, self.end_us]),
            np.concatenate([self.before, log]),
            np.concatenate([log, self.after]),
            np.tile(self.halvings, 2),
        )
