"""Tells type checkers and editors the settings that functions take as keyword arguments.

Made by ``python benches/settings_keywords.py`` from the dataclasses in ``simulation_settings`` and ``frame_settings``,
which say what each setting means. A type checker wants a ``TypedDict`` for ``**settings``, and cannot make one of a
dataclass. Nothing imports this file when a program runs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict

from ...events.colour import ColourFilter
from ...geometry.camera import Camera
from ...sampling.rules import TimeSampling
from ...sensor.effects import Effect, EffectsLike
from ...sensor.imu import Imu
from ...sensor.motion_capture import MotionCapture
from ...sensor.parameters import SensorParameters


class PixelKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`PixelSettings`."""

    contrast_threshold: float | None
    contrast_threshold_off: float | None
    lux_per_luma: float | None
    start_phase: str | None
    seed: int


class ViewKeywords(PixelKeywords, total=False):
    """Names the keyword arguments of :class:`ViewSettings`."""

    sensor: SensorParameters | str | os.PathLike[str] | None
    camera: Camera | str | os.PathLike[str] | None
    size: tuple[int, int] | str | None
    log_eps: float | None
    rays_per_pixel: int | str | None
    noise_share: float
    matte: bool
    renderer: str
    pixel: str | None
    colour_filter: ColourFilter | str | None
    bake_error: float
    blur: bool | None


class EffectsToleranceKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`EffectsToleranceSettings`."""

    effects_tolerance: float | None


class PlanKeywords(EffectsToleranceKeywords, ViewKeywords, total=False):
    """Names the keyword arguments of :class:`PlanSettings`."""


class EngineKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`EngineSettings`."""

    threads: int | None
    signal_window_us: int | None


class SamplingKeywords(EngineKeywords, ViewKeywords, total=False):
    """Names the keyword arguments of :class:`SamplingSettings`."""

    frame_rate_hz: float
    depth_rate_hz: float
    flow_rate_hz: float
    flow_interval_s: float | None
    mask_rate_hz: float
    normal_rate_hz: float
    accuracy: str
    render_rate_hz: float | None
    max_displacement_px: float | None
    tolerance: float | None
    sampling: TimeSampling | None
    refine: bool | None
    poses_per_launch: int | None


class CustomKeywords(SamplingKeywords, total=False):
    """Names the keyword arguments of :class:`CustomSettings`."""

    custom_effects: object | None


class SimulatorKeywords(CustomKeywords, total=False):
    """Names the keyword arguments of :class:`SimulatorSettings`."""

    effects: EffectsLike | None


class SimulationKeywords(EffectsToleranceKeywords, CustomKeywords, total=False):
    """Names the keyword arguments of :class:`SimulationSettings`."""

    effects: EffectsLike | None


class FolderFileKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`FolderFileSettings`."""

    events_format: str
    image_gain: float | None


class FolderKeywords(FolderFileKeywords, SimulationKeywords, total=False):
    """Names the keyword arguments of :class:`FolderSettings`."""

    accept_noise: bool | None
    imu: Imu | str | None
    imu_rate_hz: float | None
    imu_effects: Mapping[str, Any] | str | Sequence[str | Effect] | None
    flow_png: str | None
    event_truth: str | None
    velocity_rate_hz: float
    pose_rate_hz: float
    pose_noise_m: float | None
    rotation_noise_rad: float | None
    clock_offset_s: float | None
    clock_drift_ms_per_min: float | None
    motion_capture: MotionCapture | None


class _LightKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`_LightSettings`."""

    transfer: str | None
    white_level: float | None
    log_eps: float | None


class _PartKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`_PartSettings`."""

    start_s: float
    stop_s: float | None
    slow_motion: float
    crop: tuple[int, int] | str | None
    roi: str | None
    size: tuple[int, int] | str | None
    fit: str | None
    camera: Camera | str | os.PathLike[str] | None


class _InterpolationKeywords(TypedDict, total=False):
    """Names the keyword arguments of :class:`_InterpolationSettings`."""

    interpolation: str | Callable[..., Any]
    interpolator: str | None
    max_displacement_px: float
    image_rate_hz: float | None


class FrameKeywords(EngineKeywords, PixelKeywords, _InterpolationKeywords, _PartKeywords, _LightKeywords, total=False):
    """Names the keyword arguments of :class:`FrameSettings`."""

    sensor: SensorParameters | str | os.PathLike[str] | None
    colour_filter: ColourFilter | str | None
    effects: EffectsLike | None


class FrameFolderKeywords(FolderFileKeywords, FrameKeywords, total=False):
    """Names the keyword arguments of :class:`FrameFolderSettings`."""

    images_every: int
