"""Simulates sensors in the light of a clip's frames."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..events.arrays import EventArray, concatenate_events
from ..sensor.parameters import SensorParameters
from ..simulation.from_frames.events_from_frames import events_from_frames
from ..simulation.no_events import NoEventsWarning
from .clip_light import ClipLight

NOISE = ("shot_noise_rms", "shot_noise_half_lux", "shot_noise_bandwidth_hz", "leak_rate_hz", "hot_pixel_fraction")
"""Parameters that make events without any change of light."""


def without_noise(sensor: SensorParameters) -> SensorParameters:
    """Return a sensor whose pixels fire only when their light changes."""
    return replace(sensor, **dict.fromkeys(NOISE))


def ideal(sensor: SensorParameters) -> SensorParameters:
    """Return ideal pixels with one threshold, the mean of both of a sensor's."""
    on = sensor.contrast_threshold
    off = on if sensor.contrast_threshold_off is None else sensor.contrast_threshold_off
    return SensorParameters(contrast_threshold=None if on is None or off is None else (on + off) / 2)


def simulated(
    light: ClipLight,
    numbers: range,
    sensor: SensorParameters,
    *,
    log_eps: float,
    lux_per_luma: float,
    start_phase: str | None = None,
    seed: int = 0,
    progress: Callable[[int], object] | None = None,
) -> EventArray:
    """Return the events of a sensor that sees these frames of a clip, at their place on the whole sensor.

    Args:
        light: of the clip.
        numbers: of the frames.
        sensor: whose size is not used: it sees the region of the frames.
        log_eps: dark level in luma.
        lux_per_luma: illuminance that luma 1 stands for.
        start_phase: where references lie at the first frame; None takes the sensor's own.
        progress: is told how many frames are done.
    """
    frames = list(light.frames(numbers))
    x0, y0, _, _ = light.region
    zero_us = frames[0].t_us
    packets_of_events: list[EventArray] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoEventsWarning)  # a table shows it
        packets = events_from_frames(
            [frame.luma for frame in frames],
            [frame.t_us - zero_us for frame in frames],
            sensor=replace(sensor, width=None, height=None, aps_exposure_us=None, vignetting=None, lens_blur_px=None),
            transfer="linear",
            white_level=1.0,
            log_eps=log_eps,
            lux_per_luma=lux_per_luma,
            start_phase=start_phase,
            seed=seed,
        )
        for done, packet in enumerate(packets, 1):
            packets_of_events.append(packet.events)
            if progress is not None:
                progress(done)
    events = concatenate_events(packets_of_events)
    events["t"] += zero_us
    events["x"] += np.uint16(x0)
    events["y"] += np.uint16(y0)
    return events
