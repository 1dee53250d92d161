"""Recordings with frames that are simulated here: a texture that moves, seen by a sensor whose parameters are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from davis_rs import CrossingEngine, SensorParameters, StampedFrame
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.reproduction import RecordedClip

WIDTH, HEIGHT = 128, 96
_STEP_US = 500


class Scene(NamedTuple):
    """What moves, and how frames are taken.

    Attributes:
        speed_px_s: of the texture, along x; half of it along y.
        frames, frame_us: how many there are, and the time between two.
        exposure_us: of each.
        read: noise of frames as a fraction of the brightest value.
        contrast: standard deviation of the texture's log intensity.
        black: value of a frame without light, in counts of 1023.
    """

    speed_px_s: float = 90.0
    frames: int = 7
    frame_us: int = 20_000
    exposure_us: int = 500
    read: float = 0.004
    contrast: float = 0.45
    black: float = 0.0


SCENE = Scene()

SENSOR = SensorParameters(
    contrast_threshold=0.2, contrast_threshold_off=0.24, threshold_mismatch=0.05, leak_rate_hz=1e-4
)


class _Texture:
    """A texture of Gaussian patches in the middle of a grey wall."""

    def __init__(self, scene: Scene, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._kx, self._ky = np.fft.fftfreq(WIDTH)[None], np.fft.fftfreq(HEIGHT)[:, None]
        smooth = np.exp(-((2 * np.pi * np.hypot(self._kx, self._ky) * 2.5) ** 2) / 2)
        spectrum = np.fft.fft2(rng.standard_normal((HEIGHT, WIDTH))) * smooth
        spectrum[0, 0] = 0
        self._spectrum = spectrum * (scene.contrast / np.fft.ifft2(spectrum).real.std())
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        inside = np.minimum.reduce([x - 24, WIDTH - 25 - x, y - 20, HEIGHT - 21 - y])
        self._window = 1 / (1 + np.exp(-inside / 1.5))
        self._scene = scene

    def luma(self, t_us: float) -> npt.NDArray[np.float32]:
        moved = self._scene.speed_px_s * t_us * 1e-6
        shift = np.exp(-2j * np.pi * (self._kx * moved + self._ky * moved / 2))
        log = np.fft.ifft2(self._spectrum * shift).real * self._window
        return np.asarray(0.3 * np.exp(log), np.float32)


def clip_of(sensor: SensorParameters = SENSOR, scene: Scene = SCENE, seed: int = 1) -> RecordedClip:
    """Record the texture; frames are in counts of a converter of 10 bits."""
    texture = _Texture(scene, seed)
    engine = CrossingEngine(
        WIDTH, HEIGHT,
        contrast_threshold=sensor.contrast_threshold or 0.2, contrast_threshold_off=sensor.contrast_threshold_off,
        effects=sensor.effects(1000.0).engine_settings(), start_phase="stationary", seed=seed,
    )  # fmt: skip
    begin_us = 2 * scene.exposure_us + 20_000
    end_us = begin_us + (scene.frames - 1) * scene.frame_us + scene.exposure_us
    pieces = [engine.push(t_us, texture.luma(t_us)) for t_us in range(0, end_us + 1, _STEP_US)]
    events: EventArray = concatenate_events([*pieces, engine.flush()])
    rng, frames = np.random.default_rng(seed + 100), []
    for number in range(scene.frames):
        middle_us = begin_us + number * scene.frame_us
        parts = max(1, round(scene.exposure_us / 1000))
        instants = middle_us + scene.exposure_us * ((np.arange(parts) + 0.5) / parts - 0.5)
        luma = np.mean([texture.luma(t_us) for t_us in instants], axis=0)
        noisy = 1023 * (luma + scene.read * rng.standard_normal(luma.shape)) + scene.black
        frames.append(StampedFrame(float(middle_us), float(scene.exposure_us), np.rint(np.clip(noisy, 0, 1023))))
    return RecordedClip.of("simulated clip", (WIDTH, HEIGHT), events, frames)
