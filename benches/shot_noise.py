"""How often noise makes events, and how far it moves those of a signal: the engine, small steps of time, and the law.

python benches/shot_noise.py [-o docs/shot_noise.png]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from effect_figure import picture

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import ShotNoise

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from noise_oracle import TwoPoles, noisy_events

SIDE, C, FOLLOWER_HZ, DARK_LUX = 64, 0.2, 286.26, 0.5
NOISE = ShotNoise(0.086, half_luma=FOLLOWER_HZ / 3, bandwidth_hz=FOLLOWER_HZ)
"""In lux, as a sensor with a photoreceptor of 3 Hz a lux has it."""

PHASES = 0.0, 0.15, 0.3, 0.45, 0.6, 0.85
LUX = 5.0, 50.0, 200.0
SLOPE = 20.0


def poles(lux: float) -> TwoPoles:
    """Corners and standard deviation in this light."""
    light = lux + DARK_LUX
    return TwoPoles(FOLLOWER_HZ * light / NOISE.half_luma, FOLLOWER_HZ, float(NOISE.sigma(light)))


def engine_events(lux: float, start: float, signal: FloatArray, times_s: FloatArray) -> EventArray:
    """Events of pixels whose reference is at ``start``, along a signal; light is that of the signal at 0."""
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=C, effects=Effects(shot_noise_rms=NOISE))
    here = np.full((SIDE, SIDE), math.log(lux + DARK_LUX))
    engine.push_log(0, here + start)
    events = [engine.push_log(1, here)]
    pairs = zip(signal.tolist(), times_s.tolist(), strict=True)
    return concatenate_events([*events, *(engine.push_log(round(1e6 * t) + 1, here + value) for value, t in pairs)])


def rates_hz(lux: float, phase: float, *, seconds: float = 4.0, pixels: int = 500) -> tuple[float, float]:
    """Events a second of a pixel that stands still at a phase: of the engine, and in small steps."""
    events = engine_events(lux, -phase * C, np.zeros(1), np.array([seconds]))
    t, _, _ = noisy_events(poles(lux), (C, C), lambda _: phase * C, pixels=pixels, seconds=seconds)
    return len(events) / SIDE**2 / seconds, len(t) / pixels / seconds


def jitter_us(lux: float) -> tuple[float, float]:
    """Standard deviation of the first event of a ramp: of the engine, and in small steps."""
    # The ramp is short, so that light is nearly the same all the way.
    seconds = 1.5 * C / SLOPE
    events = engine_events(lux, 0.0, np.array([SLOPE * seconds]), np.array([seconds]))
    first = np.unique(events["y"].astype(int) * SIDE + events["x"], return_index=True)[1]
    t, pixel, _ = noisy_events(poles(lux), (C, C), lambda t: SLOPE * t, pixels=SIDE**2, seconds=seconds)
    return float(events["t"][first].std()), float(1e6 * t[np.unique(pixel, return_index=True)[1]].std())


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=2, size=(7.2, 3.0)) as (left, right):
        phases = np.linspace(0, 1, 101)
        for lux, colour in zip(LUX, ("C0", "C1", "C2"), strict=True):
            left.plot(
                phases, NOISE.rate_hz(C, C, lux + DARK_LUX, phases), color=colour, linewidth=1, label=f"{lux:g} lux"
            )
            made = np.array([rates_hz(lux, phase) for phase in PHASES])
            left.plot(PHASES, made[:, 0], "o", color=colour, markersize=3)
            left.plot(PHASES, made[:, 1], "x", color=colour, markersize=7)
            rows = zip(PHASES, made.tolist(), strict=True)
            print(f"{lux:g} lux:", ", ".join(f"{p:g} C: {e:.3g} Hz, steps {s:.3g} Hz" for p, (e, s) in rows))
        left.plot([], [], "k-", linewidth=1, label="approximation")
        left.plot([], [], "ko", markersize=3, label="the engine")
        left.plot([], [], "kx", label="small steps")
        left.set(yscale="log", xlabel="signal less reference, in C", ylabel="noise events a second", ylim=(1e-2, None))
        left.legend(fontsize=6)
        lux = np.geomspace(1, 1000, 7)
        made = np.array([jitter_us(float(value)) for value in lux])
        right.plot(lux, made[:, 0], "ko", markersize=3, label="the engine")
        right.plot(lux, made[:, 1], "kx", markersize=7, label="small steps")
        right.plot(lux, 1e6 * NOISE.sigma(lux + DARK_LUX) / SLOPE, "k:", linewidth=1, label="rms / slope")
        right.set(xscale="log", yscale="log", xlabel="lux", ylabel="jitter of an event (us)")
        right.legend(fontsize=6)
        print(
            "jitter:",
            ", ".join(f"{x:.0f} lux {a:.0f} us, steps {b:.0f} us" for x, (a, b) in zip(lux, made, strict=True)),
        )


if __name__ == "__main__":
    main()
