"""Runs over frames: reads them by settings that are decided, and makes packets of events."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import chain

import numpy as np

from ..._core import CrossingEngine, __version__
from ..._util.folder_report import start_line
from ..._util.read_ahead import read_ahead
from ...events.arrays import EventArray, concatenate_events
from ...events.colour import filter_numbers
from ...events.packet import Packet
from ...sensor.effects import Effects, Optics
from ...sensor.parameters import SensorParameters
from ...sensor.presets import read_once
from ..model_version import MODEL
from ..no_events import warned_without_events
from ..noiseless_twin import NoiselessTwin, last_time_us
from ..run_description import RunDescription
from ..settings import FrameSettings
from .colour_light import ColourLight
from .event_forecast import EventForecast
from .frame_source import FrameSource, StampedFrame
from .frame_values import FrameValues, FrameValuesWarning
from .images_between import ImagesBetween
from .interpolation import SensorFrame
from .light import LumaFrame
from .quantisation import QuantisationCount
from .resolved_frames import check_times, resolve_frames

_FRAMES_AHEAD = 4
"""Frames that are decoded while the ones before them are worked on."""


class FramesDescription(RunDescription):
    """Holds what ``meta.json`` says of events from frames, next to what :class:`RunDescription` has.

    Attributes:
        frames: what they are and how they are taken.
        start_time_ns: the stamp of the first frame.
        interpolation: what lies between frames.
        camera: lens and size of the image; None where that is not known.
        effects_left_out: effects of the sensor that frames cannot have.
    """

    frames: dict[str, object]
    start_time_ns: int
    interpolation: dict[str, object]
    camera: dict[str, object] | None
    effects_left_out: list[str]


class FrameRun:
    """Makes events from frames; :meth:`packets` goes through them once.

    The first frame is read at once: it says how large the sensor is.

    Args:
        source: of the frames.
        settings: of the run.
        from_zero: the first frame that is taken gets the stamp 0; else stamps stay as the source has them.

    Attributes:
        size: (width, height) of the sensor in pixels.
        camera: its lens, None where that is not known.
        contrast_threshold, contrast_threshold_off: C_on and C_off.
        start_phase: where references lie at the first frame.
        log_eps: dark level in units of luma.
        light: how values become luma.
        effects: of the pixels and the readout.
        resolved: all that is decided.
        left_out: effects of the sensor that frames cannot have.
        frames: how many were taken so far.
        quantisation: events that rounding may have made.
        interpolation: what lies between frames.
        memory: what the run is forecast to take.

    Raises:
        ValueError: for settings that are out of range or contradict each other, or frames for which there is not enough
            memory.
        OSError, DecodeError: if the first frame cannot be read.
    """

    def __init__(self, source: FrameSource, settings: FrameSettings, *, from_zero: bool = False) -> None:
        self.settings = settings = replace(settings, sensor=read_once(settings.sensor))
        self.source = source
        check_times(settings)
        self._taken = self._frames_between()
        self.frames = 0
        first = next(self._taken, None)
        if first is None:
            raise ValueError(f"{source.name}: there are no frames{self._between_words()}")
        self._first = first
        self._start_us = self._end_us = 0 if from_zero else _rounded(first.t_ns, 1000)
        self._values = FrameValues(
            source.encoding(first), first.image, white_level=settings.white_level, log_eps=settings.log_eps
        )
        self.resolved = resolved = resolve_frames(first.image, self._values.encoding, settings)
        self.size, self.camera, self.light = resolved.area.size, resolved.camera, resolved.light
        self.effects, self.left_out = resolved.effects, resolved.left_out
        self.log_eps, self.start_phase = resolved.log_eps, resolved.start_phase
        self.contrast_threshold = resolved.contrast_threshold
        self.contrast_threshold_off = resolved.contrast_threshold_off
        self._optics = Optics(self.camera, self.effects) if self.effects.optical else None
        # What is averaged over areas or blurred has finer levels than the frames, and rounding shows less.
        plain = self._optics is None and not resolved.area.resized
        filters = resolved.colour_filter
        self._filter_numbers = None if filters is None else filter_numbers(filters.pattern, *self.size)
        self.quantisation = QuantisationCount(self.light.levels if plain else None)
        refractory = self.effects.refractory_period_us
        self._forecast = EventForecast(
            resolved.least_threshold, self.log_eps, 0.0 if refractory is None else refractory.period_us
        )
        self.interpolation = resolved.interpolation()
        self.memory = resolved.memory(first.image)
        self.memory.refuse()
        self._engine = self._make_engine(self.effects)
        self._twin = NoiselessTwin(self._make_engine, self.effects, wanted=settings.signal_window_us is not None)

    def _make_engine(self, effects: Effects) -> CrossingEngine:
        return CrossingEngine(
            *self.size,
            contrast_threshold=self.contrast_threshold,
            contrast_threshold_off=self.contrast_threshold_off,
            log_eps=self.log_eps,
            interpolation=self.interpolation.engine,
            effects=effects.engine_settings(),
            start_phase=self.start_phase,
            seed=self.settings.seed,
            threads=self.settings.threads,
        )

    @property
    def dropped_events(self) -> int:
        """Count the events that the readout has dropped so far."""
        return self._engine.dropped_events

    @property
    def missed_events(self) -> int:
        """Count how often a pixel has reached a level before its last event was read out and its reset over."""
        return self._engine.missed_events

    def packets(self) -> Iterator[Packet]:
        """Yield one packet a frame: it ends at the frame's instant, and ``luma`` is what the pixels saw there.

        With an ``image_rate_hz`` packets end at the instants of these images in place of the frames'.

        The first has no events: it sets the references. Where a readout still holds events at the end, one more brings
        them.

        Warns:
            FrameValuesWarning: where values may stand for other light than they are taken for.
            NoEventsWarning: of a run without events.

        Raises:
            OSError, ValueError: for a frame that cannot be read or taken, naming it; the packets before it are whole.
        """
        self._warn_of_values()
        thresholds = (self.contrast_threshold, self.contrast_threshold_off)
        yield from warned_without_events(self._packets(), thresholds, self.log_eps, stacklevel=3)
        self._warn_of_values()
        self._warn_of_other_steps()

    def _packets(self) -> Iterator[Packet]:
        rate_hz = self.settings.image_rate_hz
        images = None if rate_hz is None else ImagesBetween(rate_hz, self.log_eps)
        pending: list[EventArray] = []
        of_frame: list[EventArray] = []
        before: SensorFrame | None = None
        for sample in self.interpolation.samples(self._sensor_frames()):
            events = self._engine.push(sample.t_us, sample.luma, sample.rate)
            self._twin.push(sample.t_us, sample.luma, sample.rate)
            pending.append(events)
            of_frame.append(events)
            frame = sample.frame
            if before is None:
                self._end_us = sample.t_us
            if images is not None:
                for t_us, luma in images.until(sample):
                    yield self._packet(pending, t_us, luma)
            if frame is None:
                continue
            self.frames += 1
            if before is not None:
                self.quantisation.add(concatenate_events(of_frame), before.luma, frame.luma)
            of_frame.clear()
            before = frame
            if images is None:
                yield self._packet(pending, frame.t_us, frame.luma)
        if images is not None and before is not None and self._end_us < before.t_us:
            yield self._packet(pending, before.t_us, None)
        yield from self.flush()

    def _packet(self, pending: list[EventArray], end_us: int, luma: LumaFrame | None) -> Packet:
        """Return the packet from the last one's end to ``end_us``; what comes later stays in ``pending``."""
        events = concatenate_events(pending)
        count = int(np.searchsorted(events["t"], end_us, side="right"))
        pending[:] = [events[count:]] if count < len(events) else []
        start_us, self._end_us = self._end_us, end_us
        noiseless = self._twin.take(events[:count], end_us)
        return Packet(start_us, end_us, events[:count], None, luma, noiseless=noiseless)

    def flush(self) -> Iterator[Packet]:
        """Yield what a readout still holds after the last frame: a packet, if there is any."""
        late = self._engine.flush()
        noiseless = self._twin.flush(late)
        if (end_us := last_time_us(late, noiseless)) is not None:
            yield Packet(self._end_us, end_us, late, None, noiseless=noiseless)

    def describe(self) -> FramesDescription:
        """Return all that a repetition needs, for meta.json; after :meth:`packets` also what the frames showed."""
        sensor, filters = self.settings.sensor, self.resolved.colour_filter
        given = {name: value for name, value in self.settings.by_name().items() if name not in _TOLD_ELSEWHERE}
        return {
            "davis_rs": __version__,
            "model": MODEL,
            "versions": {"numpy": np.__version__},
            "scene": {"name": self.source.name},
            "frames": self.describe_frames(),
            "start_time_ns": self._first.t_ns,
            "interpolation": self.interpolation.describe(),
            "camera": None if self.camera is None else asdict(self.camera),
            "parameters": {
                **given,
                "sensor": asdict(sensor) if isinstance(sensor, SensorParameters) else sensor,
                "contrast_threshold": self.contrast_threshold,
                "contrast_threshold_off": self.contrast_threshold_off,
                "start_phase": self.start_phase,
                "log_eps": self.log_eps,
                "lux_per_luma": self.resolved.lux_per_luma,
                "colour_filter": None if filters is None else asdict(filters),
            },
            "effects": self.effects.describe(),
            "effects_left_out": list(self.left_out),
        }

    def describe_frames(self) -> dict[str, object]:
        """Return what the frames are and how they are taken, for meta.json, by those that were read so far."""
        return {
            **self.source.describe(),
            "transfer": self.light.transfer,
            "black_level": self.light.black,
            "white_level": self.light.white,
            "value_step": self._values.encoding.step,
            "value_step_of_all_frames": self._values.shown().step,
            "part": self.resolved.area.describe(),
        }

    @property
    def step_line(self) -> str:
        """Say what follows from the step that the first frame shows, for people; "" where it is as the source says."""
        if not self._values.step_found:
            return ""
        return (
            f"{self.source.name}: values come in steps of {self._values.encoding.step:.4g} in the first frame, so that "
            f"{self.light.white:g} is taken for white, and log_eps is {self.log_eps:.3g}; white_level and log_eps "
            "override it"
        )

    def notes(self) -> Iterator[str]:
        """Say what is assumed about the frames, a line each, for people."""
        about = self.source.describe()
        transfer = f"{self.light.transfer} ({'given' if self.settings.transfer else self._why_transfer(about)})"
        step = (
            f" in steps of {self._values.encoding.step:.4g}, as in the first frame," if self._values.step_found else ""
        )
        encoded = f"values {self.light.black:g} to {self.light.white:g}{step} are luma 0 to 1, transfer {transfer}"
        if about["kind"] == "video":
            matrix = "" if about["matrix_stated"] or about["matrix"] is None else ", matrix by the frame's size"
            stated = "as it says" if about["range_stated"] else "which it does not say"
            range_ = f"{about['range']} range ({stated}{matrix})"
            encoded = f"{about['codec']}, {about['pixel_format']}, {about['bits']} bits, {range_}, {encoded}"
        yield f"{self.source.name}: {encoded}"
        if self._first.t_ns:
            yield start_line(self._first.t_ns, "the frames")
        if self.settings.log_eps is None and self.log_eps > self.resolved.dark_luma:
            yield (
                f"log_eps {self.log_eps:.3g}: with {self.resolved.dark_luma:.3g} one grey level in the dark would be "
                f"more than C = {self.resolved.least_threshold:g} (--log-eps)"
            )
        if line := self.memory.line():
            yield line
        area = self.resolved.area
        if area.image[0] > area.width or area.image[1] > area.height:
            yield (
                f"{area.width} x {area.height} pixels of each frame are enlarged to {area.image[0]} x {area.image[1]}: "
                "that adds no detail"
            )
        if self.left_out:
            names = ", ".join(self.left_out)
            yield f"of the sensor's effects {names} is left out: the intensity frames are what came in"
        if self.resolved.filters_left_out:
            yield "the sensor's colour filters are left out: the frames are grey"

    def findings(self) -> Iterator[str]:
        """Say what was found on the way, a line each, for people."""
        yield from self.interpolation.findings()
        if self.quantisation.counts and self.quantisation.suspect:
            yield str(self.quantisation)

    @staticmethod
    def _why_transfer(about: dict[str, object]) -> str:
        if about["kind"] == "video":
            return "as the video says" if about["transfer_stated"] else "the video does not say"
        return "by the type of the values"

    def _warn_of_values(self) -> None:
        for doubt in self._values.doubts():
            warnings.warn(f"{self.source.name}: {doubt}", FrameValuesWarning, stacklevel=3)

    def _warn_of_other_steps(self) -> None:
        """Warn where all frames together show another step than the first, by which the dark level was chosen."""
        shown = self._values.shown()
        fitting = self.resolved.fitting_log_eps(shown)
        if self.settings.log_eps is None and not math.isclose(fitting, self.log_eps, rel_tol=_SAME_DARK_LEVEL):
            warnings.warn(
                f"{self.source.name}: all frames together have values in steps of {shown.step:.4g}, and the first "
                f"frame did not show it: log_eps {fitting:.3g} fits them, {self.log_eps:.3g} was taken",
                FrameValuesWarning,
                stacklevel=3,
            )

    def _frames_between(self) -> Iterator[StampedFrame]:
        """Yield the frames from start to stop, their stamps increasing."""
        start_ns = round(self.settings.start_s * 1e9)
        stop_s = self.settings.stop_s
        first_ns = last_ns = None
        for frame in self.source.frames():
            if last_ns is not None and frame.t_ns <= last_ns:
                raise ValueError(
                    f"{frame.where}: stamps must increase, got {_seconds(frame.t_ns)} after {_seconds(last_ns)}"
                )
            first_ns, last_ns = frame.t_ns if first_ns is None else first_ns, frame.t_ns
            if stop_s is not None and frame.t_ns - first_ns > stop_s * 1e9:
                return
            if frame.t_ns - first_ns >= start_ns:
                yield frame

    def _sensor_frames(self) -> Iterator[SensorFrame]:
        """Yield the frames as the sensor sees them, made ahead in a thread of their own."""
        count = 0
        for frame in read_ahead(self._seen(chain([self._first], self._taken)), most=_FRAMES_AHEAD):
            count += 1
            yield frame
        if count == 1:
            raise ValueError(f"{self._first.where}: one frame{self._between_words()} makes no events: two are needed")

    def _seen(self, frames: Iterator[StampedFrame]) -> Iterator[SensorFrame]:
        shape, dtype = self._first.image.shape, self._first.image.dtype
        scale = 1000 * self.settings.slow_motion
        last_us, last = -1, None
        for frame in frames:
            if frame.image.shape != shape:
                raise ValueError(
                    f"{frame.where}: all frames must have one size, this has {_shape(frame.image.shape)}, "
                    f"the first {_shape(shape)}"
                )
            if frame.image.dtype != dtype and not _both_floating(frame.image.dtype, dtype):
                raise ValueError(
                    f"{frame.where}: all frames must have one type, this has {frame.image.dtype}, the first {dtype}"
                )
            if frame is not self._first:
                self._values.add(frame.image)
            t_us = self._start_us + _rounded(frame.t_ns - self._first.t_ns, scale)
            if t_us < 0:
                raise ValueError(f"{frame.where}: stamps must be >= 0, got {_seconds(frame.t_ns)}")
            if t_us == last_us:
                raise ValueError(f"{frame.where}: it falls on the same microsecond as the frame before it ({t_us} us)")
            last_us = t_us
            seen = self._on_sensor(frame, t_us)
            if last is not None:
                self._forecast.check(last, seen)
            last = seen
            yield seen

    def _on_sensor(self, frame: StampedFrame, t_us: int) -> SensorFrame:
        """Turn a frame into the light that the pixels see, behind the lens and their filters."""
        area, filters = self.resolved.area, self.resolved.colour_filter
        image = area.cut(frame.image)
        if filters is None:
            planes = [self.light.luma(image, frame.where)]
        else:
            planes = self.light.through(filters, image, frame.where)
        planes = [area.fit(plane) for plane in planes]
        if self._optics is not None:
            planes = list(self._optics.frames(np.stack(planes)))
        if self._filter_numbers is None:
            return SensorFrame(t_us, planes[0], frame.where)
        colours = ColourLight(tuple(planes), self._filter_numbers)
        return SensorFrame(t_us, colours.seen(colours.light), frame.where, colours)

    def _between_words(self) -> str:
        stop_s = self.settings.stop_s
        end = "the end" if stop_s is None else f"{stop_s:g} s"
        whole = self.settings.start_s == 0 and stop_s is None
        return "" if whole else f" between {self.settings.start_s:g} s and {end}"


_SAME_DARK_LEVEL = 0.05
"""How far two dark levels may differ and hardly change the events."""

_TOLD_ELSEWHERE = {"camera", "size", "effects", "threads", "crop", "roi", "transfer", "white_level", "interpolation"}


def _rounded(value_ns: int, unit_ns: float) -> int:
    """Round a time to the nearest unit, halves up; exactly where the unit is an integer."""
    if unit_ns == int(unit_ns):
        unit = int(unit_ns)
        return (2 * value_ns + unit) // (2 * unit)
    return round(value_ns / unit_ns)


def _both_floating(first: np.dtype[np.generic], second: np.dtype[np.generic]) -> bool:
    return np.issubdtype(first, np.floating) and np.issubdtype(second, np.floating)


def _seconds(t_ns: int) -> str:
    return f"{t_ns / 1e9:.9g} s"


def _shape(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} pixels" + (f" of {shape[2]} values" if len(shape) == 3 else " of one value")
