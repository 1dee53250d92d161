"""Finds when a camera is back at its first pose, and says what that does to the events."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.pose import GroundTruth
from ..io.dataset.reader import Dataset
from .dataset_description import describe_dataset

_NEAR = 1e-3
"""As a fraction of how far the camera goes and turns away: much nearer than motion within a pixel."""


def returns_us(truth: GroundTruth) -> npt.NDArray[np.int64]:
    """Return the times in microseconds at which a path comes back to its first pose, after it has left it.

    Between two samples the camera moves along a straight line. A camera that rests never comes back.
    """
    if len(truth.t_us) < 3:
        return np.zeros(0, np.int64)
    # A quaternion and its negative are one rotation: take the one that is nearer to the first.
    turned = truth.quaternions * np.where(truth.quaternions @ truth.quaternions[0] < 0, -1.0, 1.0)[:, None]
    away = [truth.positions - truth.positions[0], turned - turned[0]]
    farthest = [float(np.linalg.norm(offsets, axis=1).max()) for offsets in away]
    # What does not move at all counts for nothing.
    scaled = np.concatenate(
        [offsets / far for offsets, far in zip(away, farthest, strict=True) if far > 1e-9]
        or [np.zeros((len(turned), 1))],
        axis=1,
    )
    start, step = scaled[:-1], np.diff(scaled, axis=0)
    length = (step**2).sum(axis=1)
    fraction = np.clip(-(start * step).sum(axis=1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(start + fraction[:, None] * step, axis=1)
    distance = np.linalg.norm(scaled, axis=1)
    times: list[int] = []
    last = 0  # the sample at which it was there last
    for i in np.flatnonzero(nearest < _NEAR).tolist():
        if distance[last : i + 1].max() > 10 * _NEAR:  # it has been away since
            times.append(int(truth.t_us[i]) + round(float(fraction[i]) * int(truth.t_us[i + 1] - truth.t_us[i])))
        last = i + 1 if distance[i + 1] < _NEAR else i
    return np.unique(np.array(times, np.int64))


def return_note(dataset: Dataset) -> str | None:
    """Say when a dataset's camera is back at its first pose, where its pixels began in step; else return None.

    Raises:
        OSError, DecodeError: if ``meta.json`` or the ground truth cannot be read.
    """
    if not describe_dataset(dataset).aligned_start or not len(back_us := returns_us(dataset.groundtruth)):
        return None
    times = ", ".join(f"{t_us / 1e6:.4g} s" for t_us in back_us[:3]) + (", ..." if len(back_us) > 3 else "")
    return (
        f"the camera is back at its first pose at {times}: there the pixels, which begin in step, fire together, and "
        "the rate has a peak (docs/crossing.md; --start-phase stationary)"
    )
