"""Interpolates keyframes: of files' animations, and of bodies that move from pose to pose.

Source: Khronos Group, glTF 2.0 Specification, appendix C (interpolation); Mitsuba 0.6 interpolates alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray, Pose, body_rates
from ..geometry.trajectory.trajectory import CallableTrajectory

_STILL = 1e-12


class Track(NamedTuple):
    """Holds keyframes: times (k,) in seconds, values (k, width), tangents (k, width) or None.

    Values of several bodies, (k, bodies, width), are interpolated alike.

    ``kind`` is LINEAR, STEP or CUBICSPLINE; ``turns`` says that the values are rotations.
    """

    times: FloatArray
    values: FloatArray
    tangents: tuple[FloatArray, FloatArray] | None
    kind: str
    turns: bool = False

    def at(self, t: FloatArray, end_s: float) -> tuple[FloatArray, FloatArray]:
        """Return values and rates (n, width) at times (n,); ``end_s`` is the end of the whole scene."""
        times, values = self.times, self.values
        if len(times) == 1:
            return np.repeat(values, len(t), 0), np.zeros((len(t), *values.shape[1:]))
        each = (-1, *(1 for _ in values.shape[1:]))
        # At a keyframe the segment after it counts; at the very end the one before it.
        segment = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        held = (t < times[0]) | (t > times[-1]) | ((t == times[-1]) & (times[-1] < end_s))
        span = times[segment + 1] - times[segment]
        fraction, span = np.clip((t - times[segment]) / span, 0.0, 1.0).reshape(each), span.reshape(each)
        first, second = values[segment], values[segment + 1]
        if self.kind == "STEP":
            result = np.where(fraction >= 1, second, first)
            rate = np.zeros_like(result)
        elif self.kind == "CUBICSPLINE":
            result, rate = self._cubic(segment, span, fraction)
        elif self.turns:
            result, rate = _slerp(first, second, fraction, span)
        else:
            result = first + fraction * (second - first)
            rate = (second - first) / span
        return result, np.where(held.reshape(each), 0.0, rate)

    def _cubic(self, segment: npt.NDArray[np.intp], span: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self.tangents is not None
        incoming, outgoing = self.tangents
        first, second = self.values[segment], self.values[segment + 1]
        start, end = span * outgoing[segment], span * incoming[segment + 1]
        result = (2 * s**3 - 3 * s**2 + 1) * first + (s**3 - 2 * s**2 + s) * start
        result = result + (3 * s**2 - 2 * s**3) * second + (s**3 - s**2) * end
        rate = (6 * s**2 - 6 * s) * (first - second) + (3 * s**2 - 4 * s + 1) * start + (3 * s**2 - 2 * s) * end
        return result, rate / span

    def largest(self) -> FloatArray:
        """Return bounds (width,) on the magnitude of the values at any time."""
        largest = np.abs(self.values).max(0)
        if self.tangents is None or len(self.times) == 1:
            return largest
        # Between two keyframes each tangent adds at most 4/27 of what it goes in the time between them.
        steepest = np.max([np.abs(tangents).max(0) for tangents in self.tangents], 0)
        return np.asarray(largest + 8 / 27 * np.diff(self.times).max() * steepest)

    @property
    def moves(self) -> bool:
        """Whether the value changes."""
        tangents = () if self.tangents is None else self.tangents
        return bool((np.abs(self.values - self.values[0]) > _STILL).any()) or any(tangent.any() for tangent in tangents)

    @property
    def corners(self) -> FloatArray:
        """The times at which the value is not smooth."""
        if self.kind != "CUBICSPLINE" or self.tangents is None:
            return self.times
        incoming, outgoing = self.tangents
        smooth = np.abs(incoming - outgoing).max(1) <= 1e-6 * (1 + np.abs(outgoing).max(1))
        smooth[[0, -1]] = False
        return self.times[~smooth]


def keyframe_path(times: FloatArray, poses: Sequence[Pose], end_s: float, of: str) -> CallableTrajectory:
    """Return the path of a body between poses at times (k,): straight lines, and turns by the shorter way.

    Args:
        end_s: its duration, at least the last time; the body stands still before the first and after the last pose.
        of: what the path is of, for records.
    """
    positions = Track(times, np.stack([pose.position for pose in poses]), None, "LINEAR")
    quaternions = np.stack([pose.quaternion for pose in poses])
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(1) < 0, -1.0, 1.0)
    quaternions = quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    turns = Track(times, quaternions, None, "LINEAR", turns=True)

    def angular_rate(t: FloatArray) -> FloatArray:
        return body_rates(*turns.at(t, end_s))

    return CallableTrajectory(
        end_s,
        position=lambda t: positions.at(t, end_s)[0],
        velocity=lambda t: positions.at(t, end_s)[1],
        quaternion=lambda t: turns.at(t, end_s)[0],
        angular_rate=angular_rate,
        breaks_s=times[(times > 0) & (times < end_s)],
        description={"path": "of an animation", "of": of},
    )


def _slerp(
    first: FloatArray, second: FloatArray, fraction: FloatArray, span: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the interpolation along the shorter arc between unit quaternions, and its rate."""
    dot = (first * second).sum(-1, keepdims=True)
    second, dot = np.where(dot < 0, -second, second), np.abs(dot)
    angle = np.arccos(np.minimum(dot, 1.0))
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    near = angle <= 1e-6
    a = np.where(near, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
    b = np.where(near, fraction, np.sin(fraction * angle) / sine)
    da = np.where(near, -1.0, -angle * np.cos((1 - fraction) * angle) / sine) / span
    db = np.where(near, 1.0, angle * np.cos(fraction * angle) / sine) / span
    return a * first + b * second, da * first + db * second
