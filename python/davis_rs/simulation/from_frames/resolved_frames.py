"""Resolves settings with the first frame: area, thresholds, effects, and the light that values stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..._util.argument_checks import parse_size
from ..._util.argument_error import ArgumentError
from ..._util.memory_forecast import MemoryForecast, frames_forecast
from ...events.colour import ColourFilter, as_colour_filter
from ...geometry.camera import Camera
from ...sensor.effects import Effects
from ...sensor.effects.effects import effects_of
from ...sensor.parameters import SensorParameters
from ...sensor.presets import sensor_parameters
from ..settings import LOG_EPS, FrameSettings, camera_of_size, first_given
from .frame_part import FramePart, fitted, frame_part
from .frame_source import Encoding, FrameArray
from .frames_between import Auto, FramesBetween, load_interpolator
from .interpolation import Cubic, Interpolation, Linear
from .light import Light
from .quantisation import dark_level

CONTRAST_THRESHOLD = 0.15
LUX_PER_LUMA = 1000.0
"""What a scene has where nothing says else (:class:`~davis_rs.Scene`)."""


@dataclass(frozen=True)
class ResolvedFrames:
    """Holds all that a run over frames needs, decided; the run changes nothing of it.

    Attributes:
        settings: those that were given, the sensor's file read.
        area: which rectangle of the frames is taken, and where it comes to lie on the sensor.
        camera: the lens, None where that is not known.
        contrast_threshold, contrast_threshold_off: C_on and C_off in natural-log units.
        start_phase: where references lie at the first frame.
        lux_per_luma: illuminance that one unit of luma stands for.
        effects: of the pixels and the readout.
        left_out: effects of the sensor that frames cannot have.
        light: how values become luma.
        colour_filter: before the pixels; None for a sensor without colour.
        filters_left_out: the sensor has colour filters, but the frames are grey.
        dark_luma: the dark level of the sensor in units of luma.
        log_eps: dark level in units of luma, at which one grey level stays below C.
    """

    settings: FrameSettings
    area: FramePart
    camera: Camera | None
    contrast_threshold: float
    contrast_threshold_off: float
    start_phase: str
    lux_per_luma: float
    effects: Effects
    left_out: tuple[str, ...]
    light: Light
    colour_filter: ColourFilter | None
    filters_left_out: bool
    dark_luma: float
    log_eps: float

    @property
    def least_threshold(self) -> float:
        """Return the smaller one of C_on and C_off."""
        return min(self.contrast_threshold, self.contrast_threshold_off)

    def fitting_log_eps(self, encoding: Encoding) -> float:
        """Return the dark level that fits frames of another encoding, where none is given."""
        return dark_level(_light_of(encoding, self.settings).levels, self.least_threshold, self.dark_luma)

    def interpolation(self) -> Interpolation:
        """Make what interpolates light between two frames.

        Raises:
            ValueError: for an interpolator that is not there, or where two are named.
            ImportError: for what needs OpenCV, without it.
        """
        chosen, step_px = self.settings.interpolation, self.settings.max_displacement_px
        if self.settings.interpolator is not None:
            if chosen != "auto":
                raise ArgumentError("only one of {interpolation} and {interpolator} may be given")
            chosen = load_interpolator(self.settings.interpolator)
        if chosen == "linear":
            return Linear()
        if chosen == "cubic":
            return Cubic(self.log_eps)
        try:
            if chosen == "auto":
                return Auto(self.log_eps, step_px)
            return FramesBetween(step_px, None if isinstance(chosen, str) else chosen)
        except ImportError as error:
            raise ImportError(f"{error}; or choose interpolation linear or cubic, which do without") from error

    def memory(self, first: FrameArray) -> MemoryForecast:
        """Forecast what the run takes; ``first`` is the first frame."""
        return frames_forecast(
            self.area.size,
            frame_bytes=first.nbytes / math.prod(self.area.size),
            flow=self.settings.interpolation in ("auto", "flow"),
            planes=1 if self.colour_filter is None else 3,
            effects=bool(self.effects.engine_settings()),
            twin=self.settings.signal_window_us is not None and self.effects.noiseless != self.effects,
        )


def resolve_frames(first: FrameArray, encoding: Encoding, settings: FrameSettings) -> ResolvedFrames:
    """Decide what settings leave open, and refuse settings that contradict each other or the frames.

    Args:
        first: the first frame (H, W) or (H, W, 3), which says how large the sensor is.
        encoding: how its values stand for light.
        settings: with the sensor's file read.

    Raises:
        ValueError: for a contradiction, or effects that frames cannot have.
        OSError, DecodeError: if a calibration cannot be read.
    """
    sensor = sensor_parameters(settings.sensor)
    light = _light_of(encoding, settings)
    area = _area(first, sensor, settings)
    lens = settings.camera
    camera = None if lens is None else camera_of_size(lens, area.size, "the frames")
    on = first_given(settings.contrast_threshold, sensor.contrast_threshold, CONTRAST_THRESHOLD)
    off = first_given(settings.contrast_threshold_off, sensor.contrast_threshold_off, on)
    lux_per_luma = first_given(settings.lux_per_luma, LUX_PER_LUMA)
    effects, left_out = _effects(sensor, lux_per_luma, settings)
    dark_luma = first_given(sensor.dark_luma(lux_per_luma), LOG_EPS)
    log_eps = first_given(settings.log_eps, dark_level(light.levels, min(on, off), dark_luma))
    phase = settings.start_phase or sensor.start_phase
    filters, filters_left_out = _filters(first, sensor, settings)
    return ResolvedFrames(
        settings=settings,
        area=area,
        camera=camera,
        contrast_threshold=on,
        contrast_threshold_off=off,
        start_phase=phase,
        lux_per_luma=lux_per_luma,
        effects=effects,
        left_out=left_out,
        light=light,
        colour_filter=filters,
        filters_left_out=filters_left_out,
        dark_luma=dark_luma,
        log_eps=log_eps,
    )


def check_times(settings: FrameSettings) -> None:
    """Refuse a part of the frames that ends before it starts."""
    if settings.stop_s is not None and settings.stop_s <= settings.start_s:
        raise ArgumentError(
            "{stop_s} must be after {start_s}, got {:g} s and {:g} s", settings.stop_s, settings.start_s
        )


def _light_of(encoding: Encoding, settings: FrameSettings) -> Light:
    return Light(encoding, settings.transfer, settings.white_level)


def _filters(first: FrameArray, sensor: SensorParameters, settings: FrameSettings) -> tuple[ColourFilter | None, bool]:
    """Return the filters before the pixels, and whether grey frames leave out those of the sensor."""
    asked = settings.colour_filter
    filters = sensor.colour_filter() if asked is None else as_colour_filter(asked)
    if filters is None or first.ndim == 3:
        return filters, False
    if asked is not None:
        raise ArgumentError("{colour_filter} needs frames of red, green and blue, and these are grey")
    return None, True


def _area(first: FrameArray, sensor: SensorParameters, settings: FrameSettings) -> FramePart:
    height, width = first.shape[:2]
    own = None if sensor.width is None or sensor.height is None else (sensor.width, sensor.height)
    if settings.fit is not None:
        size = parse_size(settings.size) or own
        if size is None:
            raise ArgumentError("{fit} needs the size of the sensor: give {size}, or a {sensor} that has one")
        area = frame_part(width, height, crop=settings.crop, roi=settings.roi, size=None)
        area = fitted(area, size, settings.fit)
    else:
        area = frame_part(width, height, crop=settings.crop, roi=settings.roi, size=settings.size)
    (width, height) = area.size
    if own is None or area.size == own:
        return area
    if settings.fit is not None:
        raise ArgumentError("{size} {}x{} is not the sensor's, which has {} x {} pixels", width, height, *own)
    sizes = f"the sensor has {own[0]} x {own[1]} pixels, the frames give {width} x {height}"
    if width < own[0] or height < own[1]:
        raise ArgumentError("{}: {fit} crop, pad or scale enlarges them", sizes)
    raise ArgumentError("{}: {size:{}} reduces them, or {fit} crop, pad or scale", sizes, f"{own[0]}x{own[1]}")


def _effects(sensor: SensorParameters, lux_per_luma: float, settings: FrameSettings) -> tuple[Effects, tuple[str, ...]]:
    """Return the given effects over the sensor's, and the names of the sensor's that frames do not allow."""
    named = effects_of(
        settings.effects,
        not_planned="is for a scene that can be rendered; for frames name {sensor} or {effects}",
    )
    if named.aps is not None:
        raise ValueError("the effect aps makes intensity frames from light, but here intensity frames are the input")
    of_sensor = sensor.effects(lux_per_luma)
    left_out = ("aps",) if of_sensor.aps is not None else ()
    return named.with_defaults(of_sensor.without(left_out)), left_out
