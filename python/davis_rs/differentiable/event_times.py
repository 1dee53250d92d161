"""Wraps the times of events as a function that PyTorch differentiates."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ..events.arrays import EventArray
from ..geometry.camera import Camera
from ..scene.scene import Scene, check_scene
from .event_derivatives import EventTimeDerivatives
from .event_jacobian import EventTimeModel

if TYPE_CHECKING:
    import torch

FloatArray = npt.NDArray[np.float64]
TorchFunction: TypeAlias = Any
"""A subclass of ``torch.autograd.Function``."""

TorchContext: TypeAlias = Any
"""The context of such a function."""

Flags = npt.NDArray[np.bool_]


class EventTimes:
    """Computes the times of a stream's events, as a function of the camera's path and the thresholds.

    >>> times = EventTimes(scene, events, accuracy="exact", pixel="rays")
    >>> t_us, ok = times(increments)
    >>> torch.square(t_us - measured_us)[ok].mean().backward()

    Each call searches the crossings anew, as :func:`event_time_residuals`; backward is a product with the transposed
    sparse Jacobian there. All events are kept in memory, 1 kB each.

    Args:
        scene: that is simulated, whose path is moved by the increments.
        events: whole streams of their pixels from the start of the run on: their order and polarities say which
            crossings they are, their stamps where to search them.
        camera, start_s: as for :func:`event_time_jacobian`.
        within_us: how far from its stamp a crossing is searched, microseconds.
        settings: of the run, by the names that :class:`~davis_rs.Simulator` takes.

    Raises:
        TypeError, ValueError, OSError: as :func:`event_time_jacobian`.
    """

    def __init__(
        self,
        scene: Scene,
        events: EventArray,
        camera: Camera | str | os.PathLike[str] | None = None,
        *,
        start_s: float = 0.0,
        within_us: float = 20_000.0,
        **settings: Any,
    ) -> None:
        check_scene(scene)
        self._model = EventTimeModel(scene.crop(start_s), camera=camera, **settings)
        self._levels, self._within_us = self._model.levels(events), within_us

    def derivatives(
        self, increments: npt.ArrayLike | None = None, thresholds: npt.ArrayLike | None = None
    ) -> tuple[EventTimeDerivatives, Flags]:
        """Return the derivatives at the crossings, and (n,) which are known; the arguments are those of a call."""
        model = self._model.changed(increments, thresholds)
        derivatives, known = model.search(self._levels, self._within_us)
        return derivatives, known & derivatives.ok

    def __call__(
        self, increments: torch.Tensor | None = None, thresholds: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the times (n,) of the events, float64, microseconds; and (n,) whether each is known.

        One that is not known keeps its stamp, without a gradient.

        Args:
            increments: of the path, (6,) or control points (m, 6), as for :func:`moved`.
            thresholds: (2,), ON and OFF, or (2, H, W), those of each pixel, natural-log units; None for those of the
                settings.

        Raises:
            ValueError: for another shape, and thresholds that are not > 0.
            ImportError: without PyTorch.
        """
        t_us, ok = _function().apply(self, increments, thresholds)
        return t_us, ok


def _function() -> TorchFunction:
    import torch

    class Times(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(
            ctx: TorchContext, times: EventTimes, increments: torch.Tensor | None, thresholds: torch.Tensor | None
        ) -> tuple[torch.Tensor, torch.Tensor]:
            arrays = [
                None if given is None else given.detach().cpu().double().numpy() for given in (increments, thresholds)
            ]
            derivatives, ok = times.derivatives(*arrays)
            ctx.derivatives, ctx.ok, ctx.like = derivatives, ok, (increments, thresholds)
            device = next((given.device for given in (increments, thresholds) if given is not None), None)
            t_us = np.where(ok, derivatives.t_us, derivatives.levels.t_us)
            known = torch.from_numpy(ok).to(device)
            ctx.mark_non_differentiable(known)
            return torch.from_numpy(t_us).to(device), known

        @staticmethod
        def backward(ctx: TorchContext, by_time: torch.Tensor, _: object) -> tuple[torch.Tensor | None, ...]:
            by_time = np.where(ctx.ok, by_time.cpu().double().numpy(), 0.0)
            gradients = [None]
            for like, derivative in zip(ctx.like, (_by_increments, _by_thresholds), strict=True):
                wanted = like is not None and like.requires_grad
                gradient = derivative(ctx.derivatives, by_time, tuple(like.shape)) if wanted else None
                gradients.append(None if gradient is None else torch.from_numpy(gradient).to(like))
            return tuple(gradients)

    return Times


def _by_increments(derivatives: EventTimeDerivatives, by_time: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    if shape == (6,):
        return np.asarray(np.add(*derivatives.pose_parts()).T @ by_time)
    return np.asarray(derivatives.control_points(shape[0]).T @ by_time).reshape(shape)


def _by_thresholds(derivatives: EventTimeDerivatives, by_time: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    by_pixel = np.asarray(derivatives.contrast_threshold_map().T @ by_time).reshape(2, -1)
    return by_pixel.sum(1) if shape == (2,) else by_pixel.reshape(shape)
