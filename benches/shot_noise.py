"""How often noise makes events: Rice's formula, the engine, and a Gaussian process followed step by step.

python benches/shot_noise.py [-o docs/shot_noise.png]
"""

from __future__ import annotations

import math

import numpy as np
from effect_figure import on_static_scene, picture

from davis_rs import Effects
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import ShotNoise

SIDE, LOG_EPS = 64, 1e-6
NOISE = ShotNoise(0.07, half_luma=1.0, bandwidth_hz=300.0)
THRESHOLDS = np.linspace(0.1, 0.4, 13)
LIGHTS = 0.01, 0.1, 1.0
STEPS_A_PERIOD = 60
"""Steps of the process that is followed, over 1 / bandwidth."""


def engine_rates_hz(c: float, luma: float, mismatch: float | None = None) -> tuple[FloatArray, FloatArray]:
    """Events a second of each pixel on a static scene, and Rice's for its thresholds."""
    effects = Effects(shot_noise_rms=NOISE, threshold_mismatch=mismatch)
    nominal = float(NOISE.rate_hz(c, c, luma + LOG_EPS))
    seconds = min(max(20_000 / (nominal * SIDE**2 + 1e-9), 0.1), 1e4) if mismatch is None else 60.0
    settings = {"contrast_threshold": c, "log_eps": LOG_EPS}
    engine, events = on_static_scene(effects, luma, seconds, size=(SIDE, SIDE), **settings)
    law = NOISE.rate_hz(engine.contrast_threshold, engine.contrast_threshold_off, luma + LOG_EPS)
    counts = np.zeros((SIDE, SIDE))
    np.add.at(counts, (events["y"], events["x"]), 1)
    return counts / seconds, np.broadcast_to(law, counts.shape)


def followed_rate_hz(c: float, luma: float, *, pixels: int = 2000, seconds: float = 6.0) -> float:
    """Events a second of pixels whose signal is the noise itself: white noise behind two poles, step by step."""
    random = np.random.default_rng(1)
    ratio = luma / NOISE.half_luma
    of_light, decay = (math.exp(-2 * math.pi * pole / STEPS_A_PERIOD) for pole in (ratio, 1.0))
    rms = NOISE.rms / math.sqrt(1 + ratio)
    # Variance of white noise of unit variance behind two such poles.
    both = of_light * decay
    gain = rms / math.sqrt((1 + both) / ((1 - both) * (1 - of_light**2) * (1 - decay**2)))
    first, noise, reference = np.zeros(pixels), np.zeros(pixels), np.zeros(pixels)
    made, settle = 0, int(3 * STEPS_A_PERIOD * max(1.0, 1 / ratio))
    for step in range(settle + int(seconds * NOISE.bandwidth_hz * STEPS_A_PERIOD)):
        first = of_light * first + gain * random.standard_normal(pixels)
        noise = decay * noise + first
        if step < settle:
            continue
        steps = (noise >= reference + c).astype(int) - (noise <= reference - c)
        if steps.any():
            made += np.abs(steps).sum()
            reference += c * steps
    return float(made / pixels / seconds)


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=2, size=(7.2, 3.0)) as (left, right):
        for luma, colour in zip(LIGHTS, ("C0", "C1", "C2"), strict=True):
            law = NOISE.rate_hz(THRESHOLDS, THRESHOLDS, luma + LOG_EPS)
            shown = law > 1e-3
            made = np.array([engine_rates_hz(c, luma)[0].mean() for c in THRESHOLDS[shown]])
            left.plot(THRESHOLDS[shown], law[shown], color=colour, linewidth=1, label=f"luma {luma:g} x half_luma")
            left.plot(THRESHOLDS[shown], made, "o", color=colour, markersize=3)
            rows = zip(THRESHOLDS[shown], made, law[shown], strict=True)
            print(f"luma {luma:g}:", ", ".join(f"C {c:.3f}: {m:.4g} of {r:.4g} Hz" for c, m, r in rows))
        for luma, c in ((0.01, 0.2), (0.1, 0.15), (0.1, 0.2), (0.1, 0.25), (1.0, 0.15)):
            colour = f"C{LIGHTS.index(luma)}"
            followed, law = followed_rate_hz(c, luma), float(NOISE.rate_hz(c, c, luma))
            print(f"followed step by step, luma {luma:g}, C {c:g}: {followed:.4g} Hz, Rice's {law:.4g} Hz")
            left.plot(c, followed, "x", color=colour, markersize=7)
        left.plot([], [], "ko", markersize=3, label="the engine")
        left.plot([], [], "kx", label="process followed in time")
        left.set(yscale="log", xlabel="C", ylabel="noise events a second", ylim=(1e-3, None))
        left.legend(fontsize=6)
        made, law = engine_rates_hz(0.2, 0.1, 0.1)
        order = np.argsort(law, axis=None)
        groups = np.array_split(order, 40)
        right.plot(law.ravel()[order], made.ravel()[order], ",", color="0.6")
        right.plot([law.ravel()[g].mean() for g in groups], [made.ravel()[g].mean() for g in groups], "o", markersize=3)
        right.plot([2, 150], [2, 150], "k:", linewidth=1)
        right.set(xscale="log", yscale="log", xlim=(2, 150), ylim=(2, 150))
        print(f"mismatch 0.1: {made.mean():.4g} of {law.mean():.4g} Hz")
        right.set(xlabel="Rice's rate for the pixel's thresholds (Hz)", ylabel="events a second of the pixel")


if __name__ == "__main__":
    main()
