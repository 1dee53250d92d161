"""Computes luma frames with derivatives in Dr.Jit, and event times with derivatives without it.

``renderer`` (luma in Dr.Jit) -> ``kernel``, ``poses``, ``frame_edges`` (the part of edges), ``scene_at`` (what
moves); ``event_times`` (PyTorch), ``event_residuals`` -> ``event_jacobian`` -> ``event_derivatives`` ->
``event_crossings``, ``moved_path``, ``event_jumps`` (rays that jump) and ``pixel_means`` -> ``turned_edges``,
``edge_passes``, ``event_levels`` and ``log_luma`` (the core's float64 gradients).
"""

from .event_derivatives import EventTimeDerivatives, LogLumaDerivatives
from .event_jacobian import event_time_derivatives, event_time_jacobian
from .event_residuals import LogLumaResidualBlock, ResidualBlock, event_log_luma_residuals, event_time_residuals
from .event_times import EventTimes
from .moved_path import moved
from .poses import CameraPoses, spline
from .renderer import DifferentiableRenderer
from .spline_weights import spline_weights

__all__ = [
    "CameraPoses",
    "DifferentiableRenderer",
    "EventTimeDerivatives",
    "EventTimes",
    "LogLumaDerivatives",
    "LogLumaResidualBlock",
    "ResidualBlock",
    "event_log_luma_residuals",
    "event_time_derivatives",
    "event_time_jacobian",
    "event_time_residuals",
    "moved",
    "spline",
    "spline_weights",
]
