"""The motion-capture system that gives the ground truth: ideal unless noise or a clock of its own are asked for."""

from .clock import MocapClock
from .motion_capture import MotionCapture
from .noise import MocapNoise

__all__ = ["MocapClock", "MocapNoise", "MotionCapture"]
