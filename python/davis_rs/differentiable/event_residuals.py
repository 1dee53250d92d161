"""Residuals of measured event times against those that a scene, a path and thresholds predict, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..events import EventArray
from ..scene.scene import Scene
from .event_derivatives import EventTimeDerivatives
from .event_jacobian import EventTimeModel
from .event_levels import EventLevels

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

MIDDLE_US = 0.5
"""A stamp is the end of the microsecond in which its event is; the middle is what is compared."""

_SAME_US = 0.1
"""By how much rounding may put two events of a jump into the wrong order."""


@dataclass(frozen=True, eq=False)
class ResidualBlock:
    """Some of the events of a stream, pixel by pixel.

    Attributes:
        index: (k,) their numbers in the stream.
        residual_us: (k,) predicted time less the middle of the microsecond that ends at the stamp; NaN where no
            crossing was found.
        ok: (k,) whether residual and derivatives are known, and the events of the pixel follow each other in the same
            order as predicted.
        count_differs: (k,) whether the pixel's predicted events are not as many as its measured ones: one of them has
            no crossing, or at the end of the path log luma is a threshold or more from the level of the last one.
        derivatives: of the predicted times.
    """

    index: IntArray
    residual_us: FloatArray
    ok: Flags
    count_differs: Flags
    derivatives: EventTimeDerivatives


def event_time_residuals(
    scene: Scene,
    events: EventArray,
    camera: Camera | str | None = None,
    *,
    start_s: float = 0.0,
    within_us: float = 20_000.0,
    block: int = 1 << 14,
    thresholds: npt.ArrayLike | None = None,
    **settings: Any,
) -> Iterator[ResidualBlock]:
    """Compare measured events with the times that a scene predicts for them, with derivatives: for least squares.

    The k-th event of a pixel belongs to the level that the pixel's first k polarities lead to. Its predicted time is
    where log luma crosses this level: from the stamp on, later where it is not reached there yet, before where it is.

    >>> for block in event_time_residuals(moved(scene, increment), events):
    ...     jacobian = block.derivatives.jacobian(("pose",))[block.ok]
    ...     normal += jacobian.T @ jacobian
    ...     gradient += jacobian.T @ block.residual_us[block.ok]

    Nothing is weighted: where the estimate is far off, some events find another crossing than their own.

    Args:
        scene: of the estimate, see :func:`moved`.
        events: measured, the whole stream of each of their pixels from the start of the run on; pixels may be left out.
        camera, start_s: as for :func:`event_time_jacobian`.
        within_us: how far from its stamp a crossing is looked for, microseconds.
        block: how many events there are in a block, about: a pixel is never divided. It takes 1 kB an event.
        thresholds: (2,) or, of each pixel, (2, H, W): ON and OFF, natural-log units; None for those of the settings.
        settings: of the estimate, by the names that :class:`~davis_rs.Simulator` takes.

    Raises:
        TypeError, ValueError, OSError: as :func:`event_time_jacobian`; ValueError for ``within_us`` or ``block`` that
            is not > 0, and for thresholds of another shape or not > 0.
    """
    for name, value in (("within_us", within_us), ("block", block)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be > 0 and finite, got {value}")
    model = EventTimeModel(scene.crop(start_s), thresholds, camera=camera, **settings)
    levels = model.levels(events)

    def blocks() -> Iterator[ResidualBlock]:
        order = np.argsort(levels.pixel, kind="stable")
        firsts = np.flatnonzero(np.diff(levels.pixel[order], prepend=-1))
        begin = 0
        while begin < len(order):
            after = firsts[firsts >= begin + block]
            end = int(after[0]) if len(after) else len(order)
            yield _residuals(model, levels, order[begin:end], within_us)
            begin = end

    return blocks()


def _residuals(model: EventTimeModel, levels: EventLevels, index: IntArray, within_us: float) -> ResidualBlock:
    levels = levels.take(index)
    derivatives, found = model.search(levels, within_us)
    predicted_us = np.where(found, derivatives.t_us, np.nan)
    _, first, of_pixel = np.unique(levels.pixel, return_index=True, return_inverse=True)
    # One pixel after the other on one axis: the latest event before each is then a running maximum.
    span_us = 2 * model.field.duration_s * 1e6
    latest = np.maximum.accumulate(span_us * of_pixel + np.where(found, derivatives.t_us, 0.0))
    in_order = derivatives.t_us + _SAME_US >= latest - span_us * of_pixel
    last = np.append(first[1:], len(index)) - 1
    differs = _more_events(model, levels.take(last))
    differs |= np.bincount(of_pixel[~found], minlength=len(first)) > 0
    residual_us = predicted_us - (levels.t_us - MIDDLE_US)
    return ResidualBlock(index, residual_us, found & derivatives.ok & in_order, differs[of_pixel], derivatives)


def _more_events(model: EventTimeModel, last: EventLevels) -> Flags:
    """Whether pixels have more events after these."""
    _, level = model.start_and_level(last)
    end_us = np.full(len(level), model.field.duration_s * 1e6)
    beyond = model.field.at(end_us, last.pixel).value - level
    on, off = model.thresholds[:, last.pixel]
    return np.asarray((beyond >= on) | (beyond <= -off))
