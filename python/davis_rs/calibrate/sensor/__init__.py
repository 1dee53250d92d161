"""Fits sensors to recordings: what events tell of one, and what frames tell in addition."""

from .frame_source import FrameSource
from .measured_recording import MeasuredRecording, measure_recording
from .sensor_fit import SensorFit, fit_sensor
from .signal_samples import StampedFrame

__all__ = ["FrameSource", "MeasuredRecording", "SensorFit", "StampedFrame", "fit_sensor", "measure_recording"]
