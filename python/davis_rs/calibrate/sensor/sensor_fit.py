"""Fits a sensor to recordings, and says what they do not tell."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from ..._util.argument_checks import check_type
from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.stream_statistics import Measured
from ...sensor.parameters import SensorParameters
from ...sensor.presets import SensorFile, load_sensor_file
from .finding import Finding, KnownParameters
from .frame_fit import BLACK_LEVEL, find_of_frames
from .hot_pixel_fit import find_hot_pixels
from .leak_fit import find_leak, find_leak_variation
from .measured_recording import MeasuredRecording
from .noise_fit import find_noise, refuted_noise
from .readout_fit import COLUMN_PARITY, find_parity, find_readout, find_refractory_period, row_bound_us

_NOT_FITTED = (
    Finding("mismatch of rows", None, None, "but for parity: what is the scene's cannot be told from it"),
    Finding("mismatch of columns", None, None, "likewise"),
)
"""What no recording is asked for, and why."""

_BANDWIDTH_OVER_LIGHT = ("photoreceptor_bandwidth_hz", "photoreceptor_bandwidth_lux")


@dataclass(frozen=True)
class SensorFit:
    """Holds what recordings of one sensor tell of it.

    Attributes:
        size: (width, height) in pixels.
        recordings: their names.
        findings: one by one.
        refractory_bound_us: the refractory period is at most as long; None without two events of a pixel.
        row_bound_us: a row of the readout takes at most as long.
        refuted: by the names of parameters of the base, why the recordings refute them.
    """

    size: tuple[int, int]
    recordings: tuple[str, ...]
    findings: tuple[Finding, ...]
    refractory_bound_us: int | None
    row_bound_us: float = math.inf
    refuted: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def black(self) -> Measured | None:
        """Return the value of a frame without light, in units of the frames; None where it is not known."""
        return next((one.value for one in self.findings if one.what == BLACK_LEVEL), None)

    def __str__(self) -> str:
        return "\n".join(map(str, self.findings))

    def file(self, base: SensorFile | str | os.PathLike[str] | None = None) -> SensorFile:
        """Return the sensor: what was found, and all else from ``base``.

        What the recordings were asked for and do not tell is the base's, and its source says "not identifiable". What
        they refute is left out, and its source says so: noise that would make far more events than quiet pixels have,
        a refractory period above the shortest interval, a row of the readout that takes longer than rows were apart.

        If one bandwidth was found, not how it goes with light, it holds in the recordings' light: it becomes the one
        corner that does not depend on light, and the base's photoreceptor is left out. The noise of the base still
        halves in the light that followed from its own bandwidths.

        Args:
            base: a preset's name, a sensor file, or what was read of one; None for ideal pixels.

        Raises:
            ValueError: for a base of another size; else as :func:`~davis_rs.load_sensor`.
            OSError, DecodeError: as there.
        """
        start = _base_file(base)
        own = (start.parameters.width, start.parameters.height)
        if None not in own and own != self.size:
            raise ValueError(
                f"the recordings have {self.size[0]} x {self.size[1]} pixels, "
                f"the sensor that gives all else has {own[0]} x {own[1]}"
            )
        source = f"fitted to {', '.join(self.recordings)}"
        values: dict[str, Any] = {"width": self.size[0], "height": self.size[1]}
        sources = dict(start.sources) | {"width": source, "height": source}
        sigmas = dict(start.uncertainties)
        for _, parameter, value, note in self.findings:
            if parameter is not None and value is not None:
                values[parameter] = value.value
                sigmas.pop(parameter, None)
                if math.isfinite(value.sigma):
                    sigmas[parameter] = value.sigma
                sources[parameter] = f"{source}{f'; {note}' if note else ''}"
        fitted = values.keys() & {"source_follower_bandwidth_hz", *_BANDWIDTH_OVER_LIGHT}
        left_out = _BANDWIDTH_OVER_LIGHT if fitted and not fitted & set(_BANDWIDTH_OVER_LIGHT) else ()
        half_lux = start.parameters.noise_half_lux
        if fitted and half_lux is not None and start.parameters.shot_noise_half_lux is None:
            values["shot_noise_half_lux"] = half_lux
            sources["shot_noise_half_lux"] = "where photoreceptor and source follower of the base have the same corner"
        refuted = dict(self.refuted)
        for name, bound_us in (
            ("refractory_period_us", self.refractory_bound_us),
            ("readout_row_us", self.row_bound_us),
        ):
            held_us = getattr(start.parameters, name)
            if held_us is not None and bound_us is not None and held_us > bound_us:
                refuted[name] = f"{held_us:g} us, and the recordings have at most {bound_us:.3g} us"
        for _, parameter, value, note in self.findings:
            if parameter is not None and value is None and start.given.get(parameter) is not None:
                told = start.sources.get(parameter, "no source")
                sources[parameter] = f"not identifiable ({note}); from the preset or file that was given: {told}"
        for name in (*left_out, *refuted):
            values[name] = None
            sources.pop(name, None)
            sigmas.pop(name, None)
        for name, why in refuted.items():
            if start.given.get(name) is None:
                continue
            sources[name] = f"left out, because the recordings refute what was given: {why}"
        description = f"Fitted to {', '.join(self.recordings)}. {start.description}".strip()
        return SensorFile(replace(start.parameters, **values), description, sources, sigmas)


def _base_file(base: SensorFile | str | os.PathLike[str] | None) -> SensorFile:
    if isinstance(base, str | os.PathLike):
        return load_sensor_file(base)
    return base or SensorFile(SensorParameters())


def fit_sensor(
    recordings: Sequence[StreamStatistics | MeasuredRecording], base: SensorFile | str | os.PathLike[str] | None = None
) -> SensorFit:
    """Fit what recordings can tell of the sensor that they come from.

    From events alone:

    - Hot pixels: their share, and the median of their rates.
    - Leak: ON less OFF events of quiet pixels, because events of noise come in pairs of both polarities. Its standard
      deviation is that of the pixels' scatter. It is not identifiable where quiet pixels fire together with their
      neighbours.
    - Leak's spread and jitter: how these counts scatter between neighbours, and how intervals of a pixel do. They need
      at least 5 leak events a pixel, which takes minutes.
    - Shot noise: OFF events of quiet pixels, in recordings whose light is known. Recordings whose
      light differs by a factor of 1.5 or more also tell how noise goes with light.
    - Refractory period: at most the shortest interval of any pixel.
    - Readout: at least as many row bursts as were seen.
    - Parity of columns and rows; that of columns as a share of thresholds.

    With frames, too, see ``davis_rs.calibrate.sensor.threshold_fit.fit_thresholds``: thresholds, their mismatch and
    parity, the bandwidth by the lag of events behind frames (over light, where that is known), exposure and noise of
    frames.

    Args:
        recordings: of one sensor with the same biases, measured by :func:`~davis_rs.measure_recording`, or their events
            alone by :func:`~davis_rs.measure_stream`.
        base: where thresholds, their mismatch and the bandwidth of the noise come from, if the recordings do not tell
            them: shot noise needs them. A preset's name, a sensor file, or what was read of one.

    Raises:
        ValueError: for none, for recordings of different sizes, or without events; else as
            :func:`~davis_rs.load_sensor`.
        OSError, DecodeError: as there.
    """
    if not recordings:
        raise ValueError("at least one recording is needed")
    for recording in recordings:
        made_by = "davis_rs.measure_recording(...) makes one of a file"
        check_type("each of recordings", recording, (StreamStatistics, MeasuredRecording), made_by)
    measured = [one if isinstance(one, MeasuredRecording) else MeasuredRecording(one) for one in recordings]
    streams = [one.statistics for one in measured]
    sizes = {one.size for one in streams}
    if len(sizes) > 1:
        listed = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise ValueError(f"the recordings must be of one sensor: their sizes are {listed}")
    for stream in streams:
        if stream.duration_s <= 0:
            raise ValueError(f"{stream.name}: there are no two events at different times, nothing can be fitted")
    shortest = min((one.any.least for one in streams if one.any.least is not None), default=None)
    leak = find_leak(streams)
    parity = list(find_parity(streams))
    with_frames = list(find_of_frames(measured, leak.value))
    if any(one.parameter == COLUMN_PARITY[1] for one in with_frames):
        parity = [one for one in parity if one.parameter is None]
    known = KnownParameters(with_frames, _base_file(base))
    on, off = known.get("contrast_threshold"), known.get("contrast_threshold_off")
    off_over_on = None if on is None else 1.0 if off is None else off.value / on.value
    lux = [one.lux for one in measured]
    leak = find_leak(streams, off_over_on)
    variation = find_leak_variation(streams)
    findings = (
        *find_hot_pixels(streams),
        leak,
        *variation,
        *find_noise(streams, lux, known, leak.value, variation[1].value),
        find_refractory_period(shortest),
        *find_readout(streams),
        *parity,
        *with_frames,
        *_NOT_FITTED,
    )
    noise_found = any(one.parameter == "shot_noise_rms" and one.value is not None for one in findings)
    return SensorFit(
        streams[0].size,
        tuple(one.name for one in streams),
        findings,
        shortest,
        row_bound_us(streams),
        MappingProxyType({} if noise_found else refuted_noise(streams, lux, known)),
    )
