"""Luma frames with derivatives, in Dr.Jit."""

from .poses import CameraPoses, spline
from .renderer import DifferentiableRenderer

__all__ = ["CameraPoses", "DifferentiableRenderer", "spline"]
