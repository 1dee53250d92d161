"""Computes residuals of measured events against the prediction of a scene, a path and thresholds, block by block.

They are residuals of the events' times, or of log luma at their stamps.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..events.arrays import EventArray
from ..geometry.camera import Camera
from ..scene.scene import Scene, check_scene
from .event_derivatives import EventTimeDerivatives, LogLumaDerivatives
from .event_jacobian import EventTimeModel
from .event_levels import EventLevels

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

MIDDLE_US = 0.5
"""A stamp is the end of the microsecond of its event; this much earlier is the middle, which is compared."""

_SAME_US = 0.1
"""By how much rounding may reverse the order of two events of a jump."""


@dataclass(frozen=True, eq=False)
class ResidualBlock:
    """Holds a block of a stream's events, pixel by pixel, with their residuals.

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


@dataclass(frozen=True, eq=False)
class LogLumaResidualBlock:
    """Holds a block of a stream's events, pixel by pixel, with their residuals.

    Attributes:
        index: (k,) their numbers in the stream.
        residual: (k,) natural-log units: log luma at the middle of the microsecond that ends at the stamp, less the
            event's level.
        derivatives: of these residuals.
    """

    index: IntArray
    residual: FloatArray
    derivatives: LogLumaDerivatives


def event_time_residuals(
    scene: Scene,
    events: EventArray,
    camera: Camera | str | os.PathLike[str] | None = None,
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
        within_us: how far from its stamp a crossing is searched, microseconds.
        block: how many events there are in a block, about: a pixel is never divided. It takes 1 kB an event.
        thresholds: (2,) or, of each pixel, (2, H, W): ON and OFF, natural-log units; None for those of the settings.
        settings: of the estimate, by the names that :class:`~davis_rs.Simulator` takes.

    Raises:
        TypeError, ValueError, OSError: as :func:`event_time_jacobian`; ValueError for ``within_us`` or ``block`` that
            is not > 0, and for thresholds of another shape or not > 0.
    """
    _check_positive("within_us", within_us)
    _check_positive("block", block)
    check_scene(scene)
    model = EventTimeModel(scene.crop(start_s), thresholds, camera=camera, **settings)
    levels = model.levels(events)
    return (_time_residuals(model, levels, index, within_us) for index in _blocks(levels, block))


def event_log_luma_residuals(
    scene: Scene,
    events: EventArray,
    camera: Camera | str | os.PathLike[str] | None = None,
    *,
    start_s: float = 0.0,
    block: int = 1 << 14,
    thresholds: npt.ArrayLike | None = None,
    **settings: Any,
) -> Iterator[LogLumaResidualBlock]:
    """Compare log luma at the stamps of measured events with the events' levels, with derivatives.

    The k-th event of a pixel means that log luma has changed by n_on C_on - n_off C_off since the start of the run. The
    residual is L(t_k) - L(0) less that. Near the solution it is the residual of :func:`event_time_residuals` times
    -dL/dt. Far from it it serves better: a time needs the event's own crossing, which may be far away or not there at
    all; log luma at the stamp always exists, and needs one evaluation. It is less exact where edges make the events.

    >>> for block in event_log_luma_residuals(moved(scene, increments), events):
    ...     jacobian = block.derivatives.control_points(len(increments))
    ...     normal += jacobian.T @ jacobian
    ...     gradient += jacobian.T @ block.residual

    Args:
        scene, events, camera, start_s, thresholds, settings: as for :func:`event_time_residuals`.
        block: how many events there are in a block, about: a pixel is never divided. It takes 1 kB an event.

    Raises:
        TypeError, ValueError, OSError: as :func:`event_time_residuals`.
    """
    _check_positive("block", block)
    check_scene(scene)
    model = EventTimeModel(scene.crop(start_s), thresholds, camera=camera, **settings)
    levels = model.levels(events)
    return (_log_luma_residuals(model, levels, index) for index in _blocks(levels, block))


def _check_positive(name: str, value: float) -> None:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be > 0 and finite, got {value}")


def _blocks(levels: EventLevels, block: int) -> Iterator[IntArray]:
    """Yield numbers of events, pixel by pixel, about ``block`` at a time; a pixel is never divided."""
    order = np.argsort(levels.pixel, kind="stable")
    firsts = np.flatnonzero(np.diff(levels.pixel[order], prepend=-1))
    begin = 0
    while begin < len(order):
        after = firsts[firsts >= begin + block]
        end = int(after[0]) if len(after) else len(order)
        yield order[begin:end]
        begin = end


def _log_luma_residuals(model: EventTimeModel, levels: EventLevels, index: IntArray) -> LogLumaResidualBlock:
    levels = levels.take(index)
    start, level = model.start_and_level(levels)
    t_us = levels.t_us - MIDDLE_US
    here = model.field.at(t_us, levels.pixel)
    known = np.ones(len(index), np.bool_)
    derivatives = LogLumaDerivatives(t_us, levels, start, here, known, model.field)
    return LogLumaResidualBlock(index, here.value - level, derivatives)


def _time_residuals(model: EventTimeModel, levels: EventLevels, index: IntArray, within_us: float) -> ResidualBlock:
    levels = levels.take(index)
    derivatives, known = model.search(levels, within_us)
    predicted_us = np.where(known, derivatives.t_us, np.nan)
    _, first, of_pixel = np.unique(levels.pixel, return_index=True, return_inverse=True)
    # The pixels lie one after the other on one time axis, so the latest event before each is a running maximum.
    span_us = 2 * model.field.duration_s * 1e6
    latest = np.maximum.accumulate(span_us * of_pixel + np.where(known, derivatives.t_us, 0.0))
    in_order = derivatives.t_us + _SAME_US >= latest - span_us * of_pixel
    last = np.append(first[1:], len(index)) - 1
    differs = _more_events(model, levels.take(last))
    differs |= np.bincount(of_pixel[~known], minlength=len(first)) > 0
    residual_us = predicted_us - (levels.t_us - MIDDLE_US)
    return ResidualBlock(index, residual_us, known & derivatives.ok & in_order, differs[of_pixel], derivatives)


def _more_events(model: EventTimeModel, last: EventLevels) -> Flags:
    """Return whether the model predicts more events of the pixels after these."""
    _, level = model.start_and_level(last)
    end_us = np.full(len(level), model.field.duration_s * 1e6)
    beyond = model.field.at(end_us, last.pixel).value - level
    on, off = model.thresholds[:, last.pixel]
    return np.asarray((beyond >= on) | (beyond <= -off))
