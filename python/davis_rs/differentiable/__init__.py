"""Luma frames with derivatives, in Dr.Jit; and event times with derivatives, without it."""

from .event_jacobian import event_time_jacobian
from .poses import CameraPoses, spline
from .renderer import DifferentiableRenderer

__all__ = ["CameraPoses", "DifferentiableRenderer", "event_time_jacobian", "spline"]
