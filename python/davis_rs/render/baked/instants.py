"""Chooses the instants at which the light of a scene with moving bodies is baked; between two it is linear in time.

Light is first computed at a few places and at many instants of the motion. Of these, as many are taken as straight
lines between them need. Each place has two estimates with random numbers of their own, and squares are products of
both, so that the noise of the estimates does not count as motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...geometry.box import box_corners
from ...geometry.trajectory.steered import SteeredPath
from ..motion.scene_motion import SceneMotion, held

FloatArray = npt.NDArray[np.float64]

MOST_INSTANTS = 17
"""More are not baked; what light errs between them is told."""

MOTION_TOLERANCE = 4.0
"""How much light may err between two instants, where it changes at all, as a multiple of the bake's error."""

_LEAST_TESTS, _MOST_TESTS = 5, 65
_SIZES_PER_TEST = 0.125
_LOOKS = 20_000

_TRAVEL_LOOKS = 33

_TOLERANCE_S = 1e-4
"""So little after the last instant a body is taken to stand still there."""


@dataclass(frozen=True)
class MotionTimes:
    """Holds the instants that matter to bodies that move.

    Attributes:
        tests: seconds (k), instants at which light is compared, as many as the bodies go far; (1) if all stand still.
        fine: whether no corner of a box around a body goes farther than an eighth of its size between two.
        end_s: of the motion that light is baked for; it begins at 0.
        rests_after: whether all bodies stand still after it.
    """

    tests: FloatArray
    fine: bool
    end_s: float
    rests_after: bool

    def check(self, t_s: FloatArray) -> None:
        """Refuse times (n,) that the light is not baked for.

        Raises:
            ValueError: where a body has gone on since the last instant.
        """
        late = t_s[t_s > self.end_s + _TOLERANCE_S]
        if len(late) and not self.rests_after:
            raise ValueError(
                f"the scene's light is baked for the time of its camera path, 0 to {self.end_s:g} s, "
                f"and its objects move on after that; it was asked for at {late[0]:g} s. Give the scene a camera path "
                "that is as long as what is rendered"
            )


AT_START = MotionTimes(np.zeros(1), True, np.inf, True)
"""Light of the start, which stays as it is while bodies move."""


def travelling(motion: SceneMotion, duration_s: float | None) -> npt.NDArray[np.bool_]:
    """Return which objects of a motion (k) go farther from where they start than half of their size.

    What a caller moves may go anywhere.

    Args:
        duration_s: as of :func:`motion_times`.
    """
    gone = np.zeros(len(motion.objects), np.bool_)
    for number, ((name, path), box) in enumerate(zip(motion.objects.items(), motion.boxes, strict=True)):
        if isinstance(path, SteeredPath):
            gone[number] = True
            continue
        deformation = motion.deformations.get(name)
        last = max(path.duration_s, 0.0 if deformation is None else deformation.duration_s)
        looks = np.linspace(0.0, last if duration_s is None else min(duration_s, last), _TRAVEL_LOOKS)
        points = np.tile(box_corners(box), (len(looks), 1, 1)) if deformation is None else deformation.hull(looks)
        poses = held(path, looks)
        at = np.einsum("nij,nkj->nki", poses.rotations, points) + poses.positions[:, None]
        middles = (at.max(1) + at.min(1)) / 2
        size = np.linalg.norm(np.ptp(at[0], axis=0))
        gone[number] = np.linalg.norm(middles - middles[0], axis=1).max() > size / 2
    return gone


def motion_times(motion: SceneMotion, duration_s: float | None) -> MotionTimes:
    """Find the instants at which a motion is to be looked at.

    Args:
        duration_s: of the camera's path, from 0 on; None where there is none: as long as any object moves.
    """
    last = max((path.duration_s for path in motion.objects.values()), default=0.0)
    end = last if duration_s is None else min(duration_s, last)
    looks = np.linspace(0.0, end, _LOOKS)
    gone = np.zeros(_LOOKS - 1)
    for path, box in zip(motion.objects.values(), motion.boxes, strict=True):
        poses = held(path, looks)
        size = max(float(np.linalg.norm(box[1] - box[0])), 1e-9)
        # How far the corners of its box go, which tells shifts and turns in one.
        corners = box_corners(box)
        at = np.einsum("nij,kj->nki", poses.rotations, corners) + poses.positions[:, None]
        steps = np.linalg.norm(np.diff(at, axis=0), axis=-1).max(1)
        gone = np.maximum(gone, steps / size / _SIZES_PER_TEST)
    way = np.concatenate([[0.0], np.cumsum(gone)])
    after = last <= end
    if way[-1] < 1e-9:
        return MotionTimes(np.zeros(1), True, end, after)
    count = int(np.clip(np.ceil(way[-1]) + 1, _LEAST_TESTS, _MOST_TESTS))
    # Evenly over the way, not over time: where bodies rest there is nothing to look at.
    tests = np.interp(np.linspace(0.0, way[-1], count), way, looks)
    tests[0], tests[-1] = looks[int(np.argmax(way > 0)) - 1], looks[int(np.argmax(way >= way[-1]))]
    return MotionTimes(tests, bool(way[-1] <= _MOST_TESTS - 1), end, after)


def chosen(
    luma_at: Callable[[int], FloatArray], tests: int, tolerance: float, most: int = MOST_INSTANTS
) -> tuple[list[int], float]:
    """Choose at which of many instants light needs to be known.

    Args:
        luma_at: two estimates of light at n places (2, n) at one of the instants.
        tests: how many instants there are, at least 2.
        tolerance: root mean square of what straight lines may err at the others, relative, over places where light
            changes by more than this.

    Returns:
        Their numbers, and the largest root mean square between two of them.
    """
    luma = np.array([luma_at(number) for number in range(tests)])
    mean = luma.mean((0, 1))
    relative = np.divide(luma, mean, out=np.ones_like(luma), where=mean > 0)
    change = relative - relative.mean(0)
    moved = np.sqrt((change[:, 0] * change[:, 1]).mean(0).clip(min=0.0)) > tolerance / 2
    taken = [0, tests - 1]
    while True:
        errors = np.zeros(tests)
        for first, last in pairwise(taken):
            inner = np.arange(first + 1, last)
            at = ((inner - first) / (last - first))[:, None, None]
            off = relative[inner] - ((1 - at) * relative[first] + at * relative[last])
            errors[inner] = _root_mean(off[:, 0, moved] * off[:, 1, moved])
        worst = int(errors.argmax())
        if errors[worst] <= tolerance or len(taken) >= most:
            return taken, float(errors[worst])
        taken = sorted([*taken, worst])


def _root_mean(squares: FloatArray) -> FloatArray:
    if not squares.shape[1]:
        return np.zeros(len(squares))
    return np.asarray(np.sqrt(squares.mean(1).clip(min=0.0)))


def hats(instants: FloatArray, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how much light of each instant (k) counts at times (n,), and the rates of that per second, (n, k) each.

    Before the first instant only the first counts, and after the last one only the last.
    """
    weights, rates = np.zeros((len(t_s), len(instants))), np.zeros((len(t_s), len(instants)))
    if len(instants) == 1:
        weights[:] = 1.0
        return weights, rates
    row = np.arange(len(t_s))
    cell = np.clip(np.searchsorted(instants, t_s, side="right") - 1, 0, len(instants) - 2)
    length = instants[cell + 1] - instants[cell]
    fraction = np.clip((t_s - instants[cell]) / length, 0.0, 1.0)
    weights[row, cell], weights[row, cell + 1] = 1 - fraction, fraction
    inside = (t_s >= instants[0]) & (t_s < instants[-1])
    rates[row, cell], rates[row, cell + 1] = np.where(inside, -1 / length, 0.0), np.where(inside, 1 / length, 0.0)
    return weights, rates
