"""Makes motions of a camera by rule: slider, hand-held, zigzag, spiral, walking, running."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number
from ..._util.argument_error import ArgumentError
from ..pose import FloatArray, Pose, PoseLike, as_pose, hamilton
from .sampled_trajectory import SampledTrajectory, rotation_through
from .trajectory import SPEED_WINDOW_S, SegmentTrajectory, mean_rates
from .waypoints import waypoint_trajectory

_SAMPLE_RATE_HZ = 400.0
_WHOLE_S = 2.0
"""A hand-held motion of less than a second is the end of one of this length."""

_WANDER = 0.2
"""How much a degree of freedom of the motion's kind wanders, relative to one that is not."""

_UP = np.array([0.0, 0.0, 1.0])

Kind = Literal["rotation", "translation", "6dof"]


def slider(
    start: PoseLike, distance_m: float, speed_m_s: float, *, direction: npt.ArrayLike = (1.0, 0.0, 0.0)
) -> SegmentTrajectory:
    """Make the path of a linear slider: along one direction at constant speed, without rotation.

    Args:
        start: the pose at t = 0.
        distance_m, speed_m_s: > 0; the slider of the dataset's slider_depth goes 0.98 m at 0.29 m/s.
        direction: in camera axes, of any length but 0; the default is to the right.

    Raises:
        ValueError: for numbers out of range.
    """
    start = as_pose(start, "start")
    _check_positive(distance_m=distance_m, speed_m_s=speed_m_s)
    way = start.rotation @ _unit(direction)
    end = Pose(start.position + distance_m * way, start.quaternion)
    return SegmentTrajectory(start, end, distance_m / speed_m_s)


def hand_held(
    start: PoseLike,
    duration_s: float,
    kind: Kind,
    *,
    top_speed_m_s: float,
    top_rate_rad_s: float,
    reach_m: float = 0.3,
    reach_rad: float = 0.6,
    seed: int = 0,
) -> SampledTrajectory:
    """Make hand-held motion as in the paper: each degree of freedom first alone, then together, ever faster.

    In the first half each degree of freedom of ``kind`` (three rotations, three translations, or all six) swings alone
    for an equal time; in the second half they all swing, at frequencies of their own that grow to the end. All the time
    every degree of freedom wanders a little, and those that are not of ``kind`` more, because a hand is never still.
    All is scaled to reach the two top speeds exactly, in the mean over 100 ms (:meth:`Trajectory.top_speeds`).

    Args:
        start: the pose at t = 0, about which it moves.
        duration_s: > 0. In a second or less there is no time for the pattern: it is then the end of a motion of two
            seconds, where all swing, and it is in motion already at t = 0.
        kind: ``rotation``, ``translation`` or ``6dof``.
        top_speed_m_s, top_rate_rad_s: >= 0; for a rotation the speed is that of the wandering, and so on.
        reach_m, reach_rad: about how far it swings, > 0; the frequency follows from them and the top speeds. No faster
            than 4 Hz: then it reaches farther.
        seed: of frequencies and phases, >= 0.

    Raises:
        ValueError: for numbers out of range, or a rate that this motion cannot reach (90 degrees and more either way).

    Source of the pattern: Mueggler et al., IJRR 2017, the list of datasets.
    """
    start = as_pose(start, "start")
    if kind not in ("rotation", "translation", "6dof"):
        raise ArgumentError("{kind} must be 'rotation', 'translation' or '6dof', got {!r}", kind)
    _check_positive(duration_s=duration_s, reach_m=reach_m, reach_rad=reach_rad)
    for name, value in (("top_speed_m_s", top_speed_m_s), ("top_rate_rad_s", top_rate_rad_s)):
        check_number(name, value, 0)
    random = np.random.Generator(np.random.PCG64(seed))
    t = _times(duration_s)
    whole_s = duration_s if duration_s > 1 else _WHOLE_S
    fraction = (whole_s - duration_s + t) / whole_s
    shapes: list[FloatArray] = []
    for excited, top, reach in (
        (kind != "rotation", top_speed_m_s, reach_m),
        (kind != "translation", top_rate_rad_s, reach_rad),
    ):
        slots = 6 if kind == "6dof" else 3
        first = 3 if kind == "6dof" and not shapes else 0  # of six, rotations come first
        fastest_hz = float(np.clip(top / (2 * np.pi * reach), 0.2, 4.0))
        shapes.append(
            np.stack(
                [
                    _swing(fraction, whole_s, fastest_hz, random, slot=(first + axis, slots) if excited else None)
                    for axis in range(3)
                ],
                axis=1,
            )
        )
    # A motion that is cut off at the start begins away from 0.
    shift, turn = (shape - shape[0] for shape in shapes)
    return _scaled(start, t, shift, turn, top_speed_m_s, top_rate_rad_s, f"hand-held {kind}")


def zigzag(
    start: PoseLike, legs: int, leg_m: float, speed_m_s: float, *, width_m: float = 1.0, through: bool = False
) -> SampledTrajectory:
    """Make a path forward in a zigzag, from side to side, looking ahead all the time.

    Args:
        start: the pose at t = 0; forward is its optical axis, level, and to the side is its x axis, level.
        legs: >= 1. leg_m: forward by so much on each, > 0. width_m: of the band, > 0.
        speed_m_s: > 0. through: whether corners are passed through (overshooting), or cut.

    Raises:
        ValueError: for numbers out of range, or an optical axis that points up or down.
    """
    start = as_pose(start, "start")
    _check_positive(leg_m=leg_m, speed_m_s=speed_m_s, width_m=width_m)
    check_number("legs", legs, 1, whole=True)
    forward, right = _level(start)
    corners = np.arange(legs + 1)
    side = np.where(corners % 2 == 0, 0.0, width_m)
    points = start.position + corners[:, None] * leg_m * forward + side[:, None] * right
    turned = np.tile(start.quaternion, (legs + 1, 1))
    return waypoint_trajectory(points, turned, speed_m_s=speed_m_s, through=through)


def spiral(
    start: PoseLike, turns: float, radius_m: float, speed_m_s: float, *, pitch_m: float = 0.3
) -> SampledTrajectory:
    """Make a spiral that widens in the image plane's directions while it advances, looking ahead all the time.

    Args:
        start: the pose at t = 0, on the axis.
        turns: > 0. radius_m: in the end, > 0. speed_m_s: > 0. pitch_m: ahead on each turn, >= 0.

    Raises:
        ValueError: for numbers out of range.
    """
    start = as_pose(start, "start")
    _check_positive(turns=turns, radius_m=radius_m, speed_m_s=speed_m_s)
    check_number("pitch_m", pitch_m, 0)
    fraction = np.linspace(0.0, 1.0, max(8, round(24 * turns)) + 1)
    angle = 2 * np.pi * turns * fraction
    in_camera = np.stack(
        [radius_m * fraction * np.cos(angle), radius_m * fraction * np.sin(angle), pitch_m * turns * fraction], axis=1
    )
    points = start.position + in_camera @ start.rotation.T
    return waypoint_trajectory(points, np.tile(start.quaternion, (len(points), 1)), speed_m_s=speed_m_s)


def walking(
    start: PoseLike,
    duration_s: float,
    *,
    speed_m_s: float = 1.4,
    steps_hz: float = 1.9,
    bob_m: float = 0.025,
    sway_m: float = 0.02,
    nod_rad: float = 0.02,
    seed: int = 0,
) -> SampledTrajectory:
    """Make a walking person's path ahead: up and down with each step, to one side with every second step.

    Args:
        start: the pose at t = 0; ahead is its optical axis, level.
        duration_s, speed_m_s, steps_hz: > 0.
        bob_m, sway_m, nod_rad: half the height of the steps, of the sway, and of the turns that go with them (pitch
            with each step, yaw and roll with every other), >= 0.
        seed: of a slow irregularity of the steps, >= 0.

    Raises:
        ValueError: for numbers out of range, or an optical axis that points up or down.

    The defaults are of the order that is found for a person's head (Pozzo, Berthoz and Lefort, "Head stabilization
    during various locomotor tasks in humans", Exp. Brain Res. 82, 1990), not a fit to anybody's.
    """
    start = as_pose(start, "start")
    _check_positive(duration_s=duration_s, speed_m_s=speed_m_s, steps_hz=steps_hz)
    for name, value in (("bob_m", bob_m), ("sway_m", sway_m), ("nod_rad", nod_rad)):
        check_number(name, value, 0)
    random = np.random.Generator(np.random.PCG64(seed))
    forward, right = _level(start)
    t = _times(duration_s)
    # Every few steps a little quicker or slower.
    hz, phase = random.uniform(0.05, 0.2, 3), random.uniform(0, 2 * np.pi, 3)
    step = 2 * np.pi * steps_hz * t + 0.3 * (np.sin(2 * np.pi * np.outer(t, hz) + phase) - np.sin(phase)).sum(1)
    # Body and head follow a smooth start: nothing jumps at t = 0.
    ahead = speed_m_s * t + 0.1 * bob_m * np.sin(step)
    up, side = bob_m * (np.cos(step) - 1), sway_m * np.sin(step / 2)
    position = start.position + ahead[:, None] * forward + up[:, None] * _UP + side[:, None] * right
    turn = nod_rad * np.stack([np.sin(step), 0.7 * np.sin(step / 2), 0.5 * np.sin(step / 2)], axis=1)
    return _turned(start, t, position, turn, f"strides of {speed_m_s:g} m/s at {steps_hz:g} Hz")


def running(
    start: PoseLike,
    duration_s: float,
    *,
    speed_m_s: float = 3.0,
    steps_hz: float = 2.8,
    bob_m: float = 0.045,
    sway_m: float = 0.02,
    nod_rad: float = 0.06,
    seed: int = 0,
) -> SampledTrajectory:
    """Make the path of :func:`walking` for a person who runs."""
    start = as_pose(start, "start")
    return walking(
        start,
        duration_s,
        speed_m_s=speed_m_s,
        steps_hz=steps_hz,
        bob_m=bob_m,
        sway_m=sway_m,
        nod_rad=nod_rad,
        seed=seed,
    )


def _swing(
    fraction: FloatArray,
    duration_s: float,
    fastest_hz: float,
    random: np.random.Generator,
    slot: tuple[int, int] | None,
) -> FloatArray:
    """Make the motion of a degree of freedom over fractions of the time: first alone in its slot, then with all."""
    own = random.uniform(0.8, 1.2)
    hz = random.uniform(0.5, 1.0, 2) * fastest_hz
    wander = np.sin(2 * np.pi * np.outer(fraction * duration_s, hz) + random.uniform(0, 2 * np.pi, 2)).sum(1)
    wander *= (0.4 + 0.6 * fraction) * _bump(fraction, 0.0, 2.0, 0.05)
    if slot is None:
        return wander
    index, slots = slot
    alone_at, alone_for = 0.5 * index / slots, 0.5 / slots
    alone_hz = max(0.4 * fastest_hz, 2 / (alone_for * duration_s))
    alone = np.sin(2 * np.pi * min(alone_hz, 4.0) * (fraction - alone_at) * duration_s)
    # From 40 % of the frequency in the middle to all of it at the end.
    later = np.maximum(fraction - 0.5, 0.0)
    cycles = own * fastest_hz * duration_s * (0.4 * later + 0.6 * later**2)
    together = (0.6 + 0.8 * later) * np.sin(2 * np.pi * cycles + random.uniform(0, 2 * np.pi))
    return (
        _WANDER * wander
        + 0.8 * _bump(fraction, alone_at, alone_at + alone_for, 0.2 * alone_for) * alone
        + _bump(fraction, 0.5, 2.0, 0.05) * together
    )


def _bump(x: FloatArray, start: float, end: float, edge: float) -> FloatArray:
    """Evaluate a window: 1 between start and end, 0 outside, four times differentiable at the edges."""

    def step(u: FloatArray) -> FloatArray:
        u = np.clip(u, 0.0, 1.0)
        smooth: FloatArray = u**5 * (126 + u * (-420 + u * (540 + u * (-315 + 70 * u))))
        return smooth

    return step((x - start) / edge) * step((end - x) / edge)


def _scaled(
    start: Pose, t: FloatArray, shift: FloatArray, turn: FloatArray, top_speed: float, top_rate: float, kind: str
) -> SampledTrajectory:
    """Make the path of shifts and turns (n, 3) in camera axes, each scaled to its top speed."""
    from scipy.optimize import brentq

    level = _turned(start, t, start.position + shift @ start.rotation.T, 0 * turn, kind)
    shift = shift * (top_speed / level.top_speeds().speed_m_s)
    position = start.position + shift @ start.rotation.T

    def path(scale: float) -> SampledTrajectory:
        return _turned(start, t, position, scale * turn, kind)

    def top_rate_of(scale: float) -> float:
        rotation = rotation_through(t, _turned_quaternions(start, scale * turn))
        return float(mean_rates(rotation, t[-1], SPEED_WINDOW_S).max())

    largest = np.pi / 2 / np.linalg.norm(turn, axis=1).max()
    if top_rate == 0:
        return path(0.0)
    if top_rate_of(largest) < top_rate:
        raise ValueError(
            f"top_rate_rad_s {top_rate:g} needs swings of more than 90 degrees either way at no more than 4 Hz"
        )
    return path(brentq(lambda scale: top_rate_of(scale) - top_rate, 0.0, largest, rtol=1e-6))


def _turned(start: Pose, t: FloatArray, position: FloatArray, turn: FloatArray, kind: str) -> SampledTrajectory:
    """Make a path at positions (n, 3), turned from the start by rotation vectors (n, 3) in camera axes, of below pi."""
    return SampledTrajectory(t, position, _turned_quaternions(start, turn), description={"kind": kind})


def _turned_quaternions(start: Pose, turn: FloatArray) -> FloatArray:
    half = np.linalg.norm(turn, axis=1, keepdims=True) / 2
    return hamilton(start.quaternion, np.concatenate([turn / 2 * np.sinc(half / np.pi), np.cos(half)], axis=1))


def _times(duration_s: float) -> FloatArray:
    return np.linspace(0.0, duration_s, max(8, round(duration_s * _SAMPLE_RATE_HZ)) + 1)


def _level(start: Pose) -> tuple[FloatArray, FloatArray]:
    """Return the directions ahead and to the right in the horizontal plane."""
    ahead = start.rotation[:, 2] * (1.0, 1.0, 0.0)
    if np.linalg.norm(ahead) < 1e-3:
        raise ValueError(f"the optical axis must not point straight up or down, got {start.rotation[:, 2].tolist()}")
    forward = _unit(ahead)
    return forward, np.cross(forward, _UP)


def _unit(direction: npt.ArrayLike) -> FloatArray:
    vector = np.asarray(direction, np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else np.nan
    if not 0 < length < np.inf:
        raise ValueError(f"a direction must be three finite numbers, not all 0, got {direction!r}")
    unit: FloatArray = vector / length
    return unit


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        check_number(name, value, 0, above_low=True)
