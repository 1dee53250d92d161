"""Reproduces a recording: fit, simulate, compare."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from ..calibrate.sensor import SensorFit, fit_sensor, measure_recording
from ..events.arrays import EventArray, as_events
from ..sensor.parameters import SensorParameters
from ..sensor.presets import SensorFile, load_sensor_file
from ..simulation.from_frames.resolved_frames import CONTRAST_THRESHOLD, LUX_PER_LUMA
from .agreement import correlations
from .clip import Half, RecordedClip, open_clip
from .clip_light import ClipLight
from .clip_statistics import Span, measure
from .reproduced import ReproducedHalf, Row, row_of
from .reproduction import Reproduction
from .resampling import Resampling
from .simulated import ideal, simulated, without_noise

FITS = ("first", "second", "both")
"""Which half is fitted."""

_PRESETS = {(240, 180): "davis240c", (346, 260): "davis346"}
"""Where all that a recording does not tell comes from, by the size of the sensor."""

_QUIET_OF_C = 0.1
"""Pixels are quiet if their light goes through less than this fraction of the smaller threshold, in all pixels around
them."""

FITTED, NOISELESS, IDEAL = "fitted", "fitted, no noise", "ideal"


@names_checked
def reproduce(
    recording: str | os.PathLike[str] | RecordedClip,
    *,
    fit: str = "first",
    base: SensorFile | str | os.PathLike[str] | None = None,
    against: Mapping[str, EventArray] | None = None,
    size: tuple[int, int] | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    lux_per_luma: float = LUX_PER_LUMA,
    seed: int = 0,
    progress: Callable[[str], object] | None = None,
) -> Reproduction:
    """Fit a sensor to one half of a recording with frames, simulate the other half, and compare it with the recording.

    The light is made of the frames alone, as :func:`~davis_rs.events_from_frames` makes it, with the dark level that
    the noise of the frames calls for. The sensor is that of :func:`~davis_rs.fit_sensor`. It sees all frames up to the
    end of the half that is compared, so that its pixels' references have a past. Next to it stand the same sensor
    without the events that come without any change of light, and ideal pixels with its thresholds.

    Errors are those of the bootstrap over tiles of 8 x 8 pixels (of bursts, over blocks of time). A difference's z is
    its value over its standard deviation, for which the same tiles are drawn of both streams. A statistic that the
    recording tells to no better than 30 % is not judged.

    Args:
        recording: a file or a dataset folder with frames, or what :func:`open_clip` read of one.
        fit: the half that is fitted, ``first`` or ``second``; ``both`` compares each half with a fit to the other one.
        base: where all that the fit does not find comes from: a preset's name, a sensor file, or what was read of one.
            None takes the preset of a DAVIS240C or a DAVIS346 by the sensor's size, and ideal pixels for others.
        against: events of other simulators for the same frames, by name, on the recording's clock: microseconds after
            the recording's first event.
        size, start_s, stop_s: as of :func:`open_clip`, for a path.
        lux_per_luma: illuminance in lux that is taken for the brightest value of the frames, > 0.
        seed: of all that is drawn.
        progress: is told what is being done.

    Raises:
        OSError, DecodeError: if the recording cannot be read.
        ValueError: for a recording without frames or with too few of them; for settings out of range.
    """
    if fit not in FITS:
        raise ArgumentError("{fit} must be one of {}, got {!r}", ", ".join(FITS), fit)
    if not 0 < lux_per_luma < np.inf:
        raise ArgumentError("{lux_per_luma} must be finite and > 0 lux, got {!r}", lux_per_luma)
    said = progress or (lambda _: None)
    clip = (
        recording
        if isinstance(recording, RecordedClip)
        else open_clip(recording, size=size, start_s=start_s, stop_s=stop_s)
    )
    start = _base(base, clip)
    others = {name: as_events(events) for name, events in (against or {}).items()}
    first, second = clip.halves
    pairs = {"first": [(first, second)], "second": [(second, first)], "both": [(first, second), (second, first)]}
    halves = tuple(
        _compared(clip, fitted, compared, start, others, lux_per_luma, seed, said) for fitted, compared in pairs[fit]
    )
    return Reproduction(clip.name, halves, tuple(_notes(clip, start, lux_per_luma)))


def _base(base: SensorFile | str | os.PathLike[str] | None, clip: RecordedClip) -> SensorFile:
    if isinstance(base, SensorFile):
        return base
    chosen = _PRESETS.get(clip.size) if base is None else base
    return SensorFile(SensorParameters()) if chosen is None else load_sensor_file(chosen)


def _notes(clip: RecordedClip, base: SensorFile, lux_per_luma: float) -> list[str]:
    return [
        f"what the fit does not find comes from: {base.title or 'ideal pixels'}",
        f"light: the brightest value of the frames is taken for {lux_per_luma:g} lux",
        "z: difference over its standard deviation (bootstrap over tiles); a statistic with more than 30 % is not "
        "judged; half/half: the recording's own events, divided at random",
    ]


def _compared(
    clip: RecordedClip,
    fitted: Half,
    compared: Half,
    base: SensorFile,
    against: Mapping[str, EventArray],
    lux_per_luma: float,
    seed: int,
    said: Callable[[str], object],
) -> ReproducedHalf:
    """Fit one half, simulate the other one, and compare."""
    said(f"fitting the sensor to the {fitted.name} half")
    fit = _fit(clip, fitted, compared, base, lux_per_luma)
    sensor = fit.file(base)
    parameters = sensor.parameters
    on = CONTRAST_THRESHOLD if parameters.contrast_threshold is None else parameters.contrast_threshold
    off = on if parameters.contrast_threshold_off is None else parameters.contrast_threshold_off
    light = ClipLight.of(clip, fit.black)
    dark = light.dark_level(min(on, off))
    log_eps = dark.value
    numbers = range(compared.frames.stop) if compared.name == "second" else compared.frames
    # Without frames before, references anywhere between two levels would lie in places that a camera's noise has long
    # taken them from: pixels that are near a level by chance would fire at once.
    has_past = numbers.start < compared.frames.start
    streams: dict[str, EventArray] = {}
    variants = {FITTED: parameters, NOISELESS: without_noise(parameters), IDEAL: ideal(parameters)}
    for name, variant in variants.items():
        said(f"simulating the {compared.name} half: {name}")
        streams[name] = simulated(
            light,
            numbers,
            variant,
            log_eps=log_eps,
            lux_per_luma=lux_per_luma,
            start_phase="zero" if name == IDEAL or not has_past else None,
            seed=seed,
        )
    said(f"comparing the {compared.name} half")
    span = _span(clip, light, compared, log_eps, min(on, off))
    real = span.cut(clip.events)
    streams = {name: span.cut(_inside(events, clip, name)) for name, events in (streams | dict(against)).items()}
    rows = _rows(real, streams, span)
    half, rest = _divided(real, seed)
    ceiling = list(correlations(half, rest, span))
    agreed = {name: list(correlations(real, events, span)) for name, events in streams.items()}
    agreement = tuple(
        row_of(one, {name: told[k] for name, told in agreed.items()})._replace(judged=False)
        for k, one in enumerate(ceiling)
    )
    whole = tuple(float(one.draws[0]) for one in correlations(half, real, span))
    return ReproducedHalf(compared, fit, sensor, dark, lux_per_luma, rows, agreement, whole, {"real": real, **streams})


def _fit(clip: RecordedClip, fitted: Half, compared: Half, base: SensorFile, lux_per_luma: float) -> SensorFit:
    """Fit the sensor to all that the half that is compared does not have. The light of quiet pixels is that of the
    frames."""
    source = replace(clip.source, frames=lambda: clip.frames(fitted.frames))
    measured = measure_recording(clip.outside(compared), size=clip.size, frames=source)
    if measured.samples is not None:
        values = measured.samples.mean[measured.statistics.quiet]
        level = float(values[np.isfinite(values)].mean()) if np.isfinite(values).any() else 0.0
        if level > 0:
            measured = replace(measured, lux=lux_per_luma * level / measured.samples.highest)
    return fit_sensor([measured], base)


def _span(clip: RecordedClip, light: ClipLight, half: Half, log_eps: float, threshold: float) -> Span:
    from scipy.ndimage import maximum_filter

    x0, y0, x1, y1 = light.region
    contrast = maximum_filter(light.contrast(half.frames, log_eps), 3)
    quiet = np.zeros((clip.size[1], clip.size[0]), np.bool_)
    quiet[y0:y1, x0:x1] = contrast < _QUIET_OF_C * threshold
    return Span(half.start_us, half.stop_us, clip.size, quiet, Resampling.of(light.compared()))


def _rows(real: EventArray, streams: Mapping[str, EventArray], span: Span) -> tuple[Row, ...]:
    of_real = list(measure(real, span))
    of_others = {name: list(measure(events, span)) for name, events in streams.items()}
    return tuple(row_of(one, {name: told[k] for name, told in of_others.items()}) for k, one in enumerate(of_real))


def _divided(events: EventArray, seed: int) -> tuple[EventArray, EventArray]:
    """Divide events at random."""
    chosen: npt.NDArray[np.bool_] = np.random.default_rng(seed).random(len(events)) < 0.5
    return events[chosen], events[~chosen]


def _inside(events: EventArray, clip: RecordedClip, name: str) -> EventArray:
    width, height = clip.size
    if len(events) and (events["x"].max() >= width or events["y"].max() >= height):
        raise ValueError(f"{name}: events must lie inside the recording's {width} x {height} pixels")
    return events
