"""Holds the keyframes on which adaptive sampling works, estimates the error of cubics through them, and their
slopes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .keyframes import LogLuma, lagrange_weights, slope

BoolFrame = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


class KeyframeWindow:
    """Keyframes in order of time: those not yielded yet, and a few before them.

    Attributes:
        t_us: instants, increasing.
        luma, log_luma: a frame (H, W), float32, for each.
        cuts: instants between which and the next microsecond nothing is interpolated; neither slopes nor predictions
            use keyframes across a cut. The keyframes between two cuts are one part.
        complete: whether no more keyframes come after the last.
    """

    def __init__(self) -> None:
        self.t_us: list[int] = []
        self.luma: list[LogLuma] = []
        self.log_luma: list[LogLuma] = []
        self.cuts = set[int]()
        self.complete = False
        self._missing: dict[tuple[int, ...], BoolFrame] = {}

    def insert(self, t_us: list[int], luma: list[LogLuma], log_luma: list[LogLuma]) -> None:
        """Insert keyframes in order of time."""
        columns = zip([*self.t_us, *t_us], [*self.luma, *luma], [*self.log_luma, *log_luma], strict=True)
        ordered = sorted(columns, key=lambda keyframe: keyframe[0])
        self.t_us, self.luma, self.log_luma = (list(column) for column in zip(*ordered, strict=True))

    def drop(self, count: int) -> None:
        """Drop the first ``count`` keyframes."""
        del self.t_us[:count], self.luma[:count], self.log_luma[:count]
        start_us = self.t_us[0]
        self.cuts = {t_us for t_us in self.cuts if t_us >= start_us}
        self._missing = {times: missed for times, missed in self._missing.items() if min(times) >= start_us}

    def parts(self) -> IntArray:
        """Return a number (n,) for each keyframe, the same for those between which no cut lies."""
        cut = [before_us in self.cuts and after_us == before_us + 1 for before_us, after_us in pairwise(self.t_us)]
        return np.cumsum([False, *cut])

    def slope(self, k: int) -> LogLuma:
        """Return the slope of log luma (H, W), 1/s, at keyframe k, from it and one on either side; 0 without
        neighbours.

        Both intervals around the keyframe use it. It is measured at the scale of the longer one: in noise, such as that
        of textures finer than a pixel, the slope to a keyframe close by tells nothing about the longer interval.
        """
        stretch = self.parts()
        within = np.flatnonzero(stretch == stretch[k])
        around = self.t_us[max(k - 1, int(within[0])) : min(k + 1, int(within[-1])) + 1]
        own = sorted([k, *self._others(k, max(np.diff(around).tolist(), default=0), within, 1)])
        if len(own) == 1:
            return np.zeros_like(self.log_luma[k])
        return slope([self.t_us[i] for i in own], [self.log_luma[i] for i in own], own.index(k))

    def untrusted(self, tolerated: float) -> list[BoolFrame]:
        """Return for each of the n - 1 intervals the pixels (H, W) whose cubic may miss log luma by more than allowed.

        An interval is trusted where each of its two ends is predicted from keyframes on either side.
        """
        stretch = self.parts()
        result = []
        for k, (before_us, after_us) in enumerate(pairwise(self.t_us)):
            missed = np.zeros(self.log_luma[k].shape, np.bool_)
            if stretch[k] == stretch[k + 1]:
                for end in (k, k + 1):
                    others = self._others(end, after_us - before_us, np.flatnonzero(stretch == stretch[end]), 2)
                    missed |= self._missed(end, others, stretch, tolerated)
            result.append(missed)
        return result

    def _others(self, k: int, length_us: int, within: IntArray, most: int) -> list[int]:
        """Return up to ``most`` keyframes on either side of keyframe k, which is one end of an interval of
        ``length_us``.

        They are among ``within``, the stretch of keyframe k between cuts. Keyframes less than half an interval apart
        are skipped, because one close by would hide how the interval bends.
        """
        others: list[int] = []
        for side in (range(k - 1, int(within[0]) - 1, -1), range(k + 1, int(within[-1]) + 1)):
            chosen = [k]
            for i in side:
                if len(chosen) <= most and 2 * abs(self.t_us[i] - self.t_us[chosen[-1]]) >= length_us:
                    chosen.append(i)
            others += chosen[1:]
        return others

    def _missed(self, k: int, others: list[int], stretch: IntArray, tolerated: float) -> BoolFrame:
        """Return the pixels whose prediction from ``others`` misses keyframe k by more than is tolerated."""
        log = self.log_luma
        if min(others) < k < max(others):
            times = (self.t_us[k], *(self.t_us[i] for i in others))
            if times not in self._missing:
                weights = lagrange_weights((np.array(times[1:]) - times[0]) * 1e-6, 0.0).astype(np.float32)
                missed = -log[k]
                for weight, i in zip(weights, others, strict=True):
                    missed += weight * log[i]
                self._missing[times] = np.abs(missed, out=missed) > tolerated
            return self._missing[times]
        # There is no prediction at the ends of the window or of a stretch, because it would be an extrapolation. A
        # short stretch is judged by its change, unless more of it is still to come.
        unfinished = stretch[k] == stretch[-1] and not self.complete
        if unfinished or np.count_nonzero(stretch == stretch[k]) >= 4:
            return np.zeros(log[k].shape, np.bool_)
        nearest = min(others, key=lambda i: abs(i - k))
        return np.asarray(np.abs(log[k] - log[nearest]) > tolerated)
