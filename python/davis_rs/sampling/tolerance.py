"""Sampling in time that controls its own error: renders where interpolation would fail, and nowhere else."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..rendering.swept import Counts
from .breaks import Break, break_instants
from .displacement import LARGEST_BEND, DisplacementClock
from .keyframes import Keyframe, SparseSamples, Stretch, lagrange_weights, slopes
from .plausibility import probed
from .rules import TimeSampling

BoolFrames = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
LogLuma = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Tolerance(TimeSampling):
    """Keep the estimated error of log luma between renders below ``contrast`` times the contrast threshold.

    Keyframes are spaced by the displacement of the fastest pixel. Between them log luma runs along cubics through the
    keyframes (slopes from their neighbours, so that they cost nothing). Leaving a keyframe out and predicting it from
    the two on either side shows, pixel by pixel, how far such a cubic can be trusted, as the embedded formulas of
    adaptive ODE solvers do. Where an interval has too many pixels that cannot be trusted it is halved, and keyframes
    come closer from there on; where it has few, they are stretched. The pixels that are left (edges) are rendered
    alone at the middle of their interval, and again at the middles of its halves, until a sample lies where the line
    between its neighbours predicted it.

    What happens and vanishes between two samples leaves no trace in either: no estimate can see it. Where an edge of
    the geometry passes over a pixel that may be so, and its interval is halved whatever the samples say: twice for one
    edge, to the end for two, because there may be something thin between them. A thin line of a texture has no such
    protection.

    Where motion or light breaks there are keyframes on both sides; neither slopes nor estimates look across.

    Args:
        contrast: tolerated error, as a share of the contrast threshold.
        pixels: displacement between keyframes at the start, and ``longest`` at the most.
        halvings: how often a pixel's interval is halved at the most.
        edges: halve it so often where two edges of the geometry may pass, and twice where one may.

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
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"a tolerance's {name} must be > 0 and finite, got {getattr(self, name)}")
        if self.halvings < 0:
            raise ValueError(f"a tolerance's halvings must be >= 0, got {self.halvings}")

    @property
    def interpolation(self) -> str:
        return "hermite"

    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        return _Control(self, stretch).keyframes()


_STEP = 8
"""Keyframes rendered between two decisions; fixed, so that results do not depend on ``batch``."""

_TRUST = 1.0
"""An interval's error, as a share of the errors that leaving out its ends would have made: 0.14 for a smooth signal,
1 for noise, as which textures finer than a pixel come. With 1/2, a tenth of all pixels would miss their tolerance."""

_WIDE, _NARROW = 0.35, 0.1
"""Share of untrusted pixels from which on an interval is halved, and that which keyframes are spaced for."""

_SHORTEST = 1 / 32
"""Displacement between keyframes at the least, as a share of that at the start: halving goes on below, but what is
known only at a jump or in noise does not shorten all that follows."""

_FOR_ONE_EDGE = 2
"""Halvings in any case where one edge passes, which leaves a trace in what follows, but for short dips at a level."""

_REMAINS = 1 / 3
"""Error of a line that is left when its middle becomes a sample: 1/4 for a smooth signal, 1/2 at a jump."""


class _Control:
    """One run over a stretch: keyframes in order, those not handed on yet in a window."""

    def __init__(self, settings: Tolerance, stretch: Stretch) -> None:
        self._settings, self._stretch = settings, stretch
        self._tolerated = np.float32(settings.contrast * stretch.contrast_threshold)
        self._pixels = min(settings.pixels, settings.longest)
        camera = stretch.renderer.camera
        shape = (0, camera.height, camera.width)
        self._t_us = np.zeros(0, np.int64)
        self._luma, self._log = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._cuts = set[int]()  # instants from which to the next microsecond nothing is interpolated
        self._last = False  # whether the window ends where the stretch does

    def keyframes(self) -> Iterator[Keyframe]:
        given = 0  # of the window
        if not self._stretch.first:
            self._render([self._stretch.start_us])
            given = 1
        for times, last in self._steps():
            self._last = last
            self._render(times)
            untrusted, split = self._split(max(given - 1, 0))
            # The estimate of an interval looks two keyframes ahead.
            ready = len(self._t_us) if last else max(len(self._t_us) - 2, given)
            if given == 0 and ready > 0:
                yield self._keyframe(0, None)
                given = 1
            for k, sparse in zip(range(given, ready), self._sparse(untrusted, given - 1, ready - 1), strict=True):
                yield self._keyframe(k, sparse)
            if ready > given and not split:
                smooth = np.diff(self._part()[given - 1 : ready]) == 0
                share = float(untrusted[given - 1 : ready - 1][smooth].mean()) if smooth.any() else _NARROW
                stretched = self._pixels * np.clip((_NARROW / max(share, 1e-3)) ** (1 / 3), 0.6, 1.4)
                self._pixels = float(min(stretched, self._settings.longest))
            self._pixels = max(self._pixels, _SHORTEST * min(self._settings.pixels, self._settings.longest))
            dropped = max(ready - 3, 0)
            given = ready - dropped
            self._t_us, self._luma, self._log = self._t_us[dropped:], self._luma[dropped:], self._log[dropped:]
            self._cuts = {t_us for t_us in self._cuts if t_us >= self._t_us[0]}

    def _steps(self) -> Iterator[tuple[list[int], bool]]:
        """Times to render next, and whether they are the last."""
        times: list[int] = []
        for t_us in self._instants():
            times.append(t_us)
            if len(times) >= _STEP:
                yield times, False
                times = []
        yield times, True

    def _instants(self) -> Iterator[int]:
        """When to render; each is found when it is asked for, by the spacing of that time."""
        stretch = self._stretch
        length_us = stretch.end_us - stretch.start_us
        clock = DisplacementClock(stretch.renderer, stretch.trajectory, length_us, start_us=stretch.start_us)
        last_us = stretch.start_us
        for required_us in self._required():
            while True:
                moved, start_us = self._pixels, last_us - stretch.start_us
                path = clock.path_at(start_us) + moved
                end = clock.span_end(start_us, path, LARGEST_BEND * moved, required_us - stretch.start_us)
                if end is None or (next_us := max(stretch.start_us + end.t_us, last_us + 1)) >= required_us:
                    break
                yield from self._probed(last_us, next_us)
                if next_us == last_us + 1:
                    self._cuts.add(last_us)  # no motion is so fast: it jumps
                yield next_us
                last_us = next_us
            yield from self._probed(last_us, required_us)
            yield required_us
            last_us = required_us

    def _required(self) -> Iterator[int]:
        """What is due, and both sides of breaks, which cut what comes before from what comes after."""
        stretch = self._stretch
        at_breaks = break_instants(map(self._cut, stretch.breaks()), stretch.start_us, both=True)
        return (t_us for t_us, _ in groupby(heapq.merge(stretch.due, at_breaks)))

    def _cut(self, found: Break) -> Break:
        self._cuts.add(found.before_us)
        return found

    def _probed(self, start_us: int, end_us: int) -> Iterator[int]:
        """As :func:`probed`; a jump that it finds is cut."""
        last_us = start_us
        for t_us in [*probed(self._stretch, start_us, end_us), end_us]:
            if t_us == last_us + 1 and end_us > start_us + 1:
                self._cuts.add(last_us)
            if t_us < end_us:
                yield t_us
            last_us = t_us

    def _render(self, times: list[int]) -> None:
        """Take up keyframes at ``times``, wherever they fall in the window."""
        stretch = self._stretch
        at = np.asarray(times, np.int64)
        batches = (at[i : i + stretch.batch] for i in range(0, len(at), stretch.batch))
        luma = [stretch.renderer.luma(stretch.views(batch)) for batch in batches]
        self._t_us = np.concatenate([self._t_us, at])
        order = np.argsort(self._t_us, kind="stable")
        self._t_us = self._t_us[order]
        self._luma = np.concatenate([self._luma, *luma])[order]
        self._log = np.concatenate([self._log, *map(stretch.log_luma, luma)])[order]

    def _split(self, first: int) -> tuple[BoolFrames, bool]:
        """Halve intervals from ``first`` on until few of their pixels are untrusted.

        Returns:
            What then is untrusted, and whether any interval was halved.
        """
        untrusted, split = self._untrusted(), False
        for _ in range(self._settings.halvings + 1):
            wide = (untrusted[first:].mean((1, 2)) > _WIDE) & (np.diff(self._t_us)[first:] > 1)
            if not wide.any():
                break
            middles = (self._t_us[first:-1] + self._t_us[first + 1 :])[wide] // 2
            self._render(middles.tolist())
            untrusted = self._untrusted()
            # From here on they come closer.
            self._pixels, split = self._pixels * (0.7 if not split else 1.0), True
        return untrusted, split

    def _part(self) -> IntArray:
        """(n,): a number for each keyframe, the same for those between which no cut lies."""
        pairs = pairwise(self._t_us.tolist())
        cut = [before_us in self._cuts and after_us == before_us + 1 for before_us, after_us in pairs]
        return np.cumsum([False, *cut])

    def _untrusted(self) -> BoolFrames:
        """(n - 1, H, W): where the cubic of an interval cannot be trusted."""
        missed = np.zeros((len(self._t_us) - 1, *self._log.shape[1:]), np.float32)
        known: dict[tuple[int, ...], LogLuma] = {}
        part = self._part()
        for k, length_us in enumerate(np.diff(self._t_us).tolist()):
            if part[k] != part[k + 1]:
                continue
            for end in (k, k + 1):
                others = self._others(end, length_us, np.flatnonzero(part == part[end]))
                key = (end, *others)
                if key not in known:
                    known[key] = self._missed(end, others, part)
                np.maximum(missed[k], known[key], out=missed[k])
        return np.asarray(np.float32(_TRUST) * missed > self._tolerated)

    def _others(self, k: int, length_us: int, within: IntArray) -> list[int]:
        """The keyframes on either side that predict keyframe k, at one end of an interval of this length.

        They are of those ``within``, its own part between cuts. Those less than half an interval apart are passed over:
        one close by would hide the error.
        """
        others: list[int] = []
        for side in (range(k - 1, int(within[0]) - 1, -1), range(k + 1, int(within[-1]) + 1)):
            chosen = [k]
            for i in side:
                if len(chosen) < 3 and 2 * abs(int(self._t_us[i] - self._t_us[chosen[-1]])) >= length_us:
                    chosen.append(i)
            others += chosen[1:]
        return others

    def _missed(self, k: int, others: list[int], part: IntArray) -> LogLuma:
        """By how much a prediction from others misses keyframe k."""
        if min(others) < k < max(others):
            at_s = (self._t_us[others] - self._t_us[k]) * 1e-6
            weights = lagrange_weights(at_s, 0.0).astype(np.float32)
            return np.asarray(np.abs(self._log[k] - np.tensordot(weights, self._log[others], 1)))
        # No prediction at the ends of the window or of a part, where it would be an extrapolation; a short part has
        # nothing better than its change, unless more of it is still to come.
        unfinished = part[k] == part[-1] and not self._last
        if unfinished or np.count_nonzero(part == part[k]) >= 4:
            return np.zeros_like(self._log[k])
        nearest = min(others, key=lambda i: abs(i - k))
        return np.asarray(np.abs(self._log[k] - self._log[nearest]))

    def _sparse(self, untrusted: BoolFrames, first: int, end: int) -> Iterator[SparseSamples | None]:
        """The samples of untrusted pixels within each interval in first..end."""
        flat = self._log.reshape(len(self._log), -1)
        sweeps = self._sweeps(first, end)
        most = self._settings.halvings
        in_any_case = np.array([0, min(_FOR_ONE_EDGE, most), most])
        interval, pixel = np.nonzero((untrusted[first:end] | (sweeps > 0)).reshape(end - first, flat.shape[1]))
        pieces = _Pieces(
            interval,
            pixel,
            self._t_us[first + interval],
            self._t_us[first + interval + 1],
            flat[first + interval, pixel],
            flat[first + interval + 1, pixel],
            in_any_case[np.minimum(sweeps, 2).reshape(end - first, flat.shape[1])[interval, pixel]],
        )
        found = []
        for turn in range(most):
            pieces = pieces.of(pieces.end_us - pieces.start_us > 1)
            if len(pieces.pixel) == 0:
                break
            middle_us = (pieces.start_us + pieces.end_us) // 2
            times, view = np.unique(middle_us, return_inverse=True)
            luma = self._stretch.renderer.samples(self._stretch.views(times), view, pieces.pixel)
            found.append((pieces.interval, pieces.pixel, middle_us, luma))
            log = self._stretch.log_luma(luma)
            remains = np.float32(_REMAINS) * np.abs(log - pieces.line(middle_us))
            again = (turn + 1 < pieces.halvings) | (remains > self._tolerated)
            pieces = pieces.halves(middle_us, log).of(np.tile(again, 2))
        if not found:
            yield from [None] * (end - first)
            return
        interval, pixel, t_us, luma = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.lexsort((t_us, pixel, interval))
        for chosen in np.split(order, np.searchsorted(interval[order], np.arange(1, end - first))):
            yield SparseSamples(pixel[chosen].astype(np.uint32), t_us[chosen], luma[chosen])

    def _sweeps(self, first: int, end: int) -> Counts:
        """(end - first, H, W): how many edges may pass over each pixel within each interval in first..end."""
        renderer = self._stretch.renderer
        if renderer.silhouettes is None or end <= first or self._settings.halvings == 0:
            return np.zeros((max(end - first, 0), *self._log.shape[1:]), np.uint8)
        t_us = self._t_us[first : end + 1]
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
        own = np.flatnonzero(self._part() == self._part()[k])  # slopes do not look across a cut
        beside = slice(max(k - 1, int(own[0])), min(k + 1, int(own[-1])) + 1)
        slope = np.zeros_like(self._log[k])
        if len(own) > 1:
            slope = slopes(self._t_us[beside], self._log[beside])[k - beside.start]
        rate = slope * (self._luma[k] + np.float32(self._stretch.log_eps))
        return Keyframe(int(self._t_us[k]), self._luma[k], rate, sparse)


class _Pieces(NamedTuple):
    """Pieces of pixels' intervals: from when to when, log luma at both ends, how often they are halved in any case."""

    interval: IntArray
    pixel: IntArray
    start_us: IntArray
    end_us: IntArray
    before: LogLuma
    after: LogLuma
    halvings: IntArray

    def of(self, chosen: npt.NDArray[np.bool_]) -> _Pieces:
        interval, pixel, start_us, end_us, before, after, halvings = self
        return _Pieces(
            interval[chosen],
            pixel[chosen],
            start_us[chosen],
            end_us[chosen],
            before[chosen],
            after[chosen],
            halvings[chosen],
        )

    def line(self, t_us: IntArray) -> LogLuma:
        """Log luma on the line between both ends."""
        share = ((t_us - self.start_us) / (self.end_us - self.start_us)).astype(np.float32)
        return np.asarray(self.before + share * (self.after - self.before))

    def halves(self, t_us: IntArray, log: LogLuma) -> _Pieces:
        """All first parts, then all second parts, of the pieces cut at ``t_us``, where log luma is ``log``."""
        return _Pieces(
            np.tile(self.interval, 2),
            np.tile(self.pixel, 2),
            np.concatenate([self.start_us, t_us]),
            np.concatenate([t_us, self.end_us]),
            np.concatenate([self.before, log]),
            np.concatenate([log, self.after]),
            np.tile(self.halvings, 2),
        )
