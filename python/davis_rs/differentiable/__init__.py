"""Luma frames with derivatives, in Dr.Jit; and event times with derivatives, without it."""

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
