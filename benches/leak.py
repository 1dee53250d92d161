"""What a leak does on static scenes: rates and intervals of pixels, with their spread, their jitter and in light.

python benches/leak.py [-o docs/leak.png]
"""

from __future__ import annotations

import numpy as np
from effect_figure import of_each_pixel, on_static_scene, picture

from davis_rs import Effects
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import LeakRate

SIDE, SECONDS = 100, 600


def stamps(leak: LeakRate, luma: float = 1.0) -> list[FloatArray]:
    """Seconds of the events of each pixel of a static scene."""
    effects = Effects(leak_rate_hz=leak, threshold_mismatch=0.12)
    _, events = on_static_scene(effects, luma, SECONDS, size=(SIDE, SIDE), log_eps=1e-6)
    return [own["t"] * 1e-6 for own in of_each_pixel(events)]


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=3, size=(8.4, 2.7)) as axes:
        for leak, name in ((LeakRate(0.5, 0, 0), "no spread"), (LeakRate(0.5), "LeakRate(0.5)")):
            own = stamps(leak)
            rates = np.array([(len(t) - 1) / (t[-1] - t[0]) for t in own])
            waits = np.concatenate([np.diff(t) / np.diff(t).mean() for t in own])
            axes[0].hist(rates, 60, range=(0, 1.2), histtype="step", label=name)
            axes[1].hist(waits, 60, range=(0.4, 1.6), histtype="step", label=name, density=True)
            print(f"{name}: {rates.mean():.4f} Hz, spread {rates.std() / rates.mean():.3f}, jitter {waits.std():.4f}")
        axes[0].set(xlabel="events a second of a pixel", ylabel="pixels", yscale="log")
        axes[1].set(xlabel="interval over the pixel's mean", ylabel="density", yscale="log")
        axes[1].legend(fontsize=6)
        lumas = np.geomspace(1e-2, 10, 7)
        for temperature_c in (25.0, 45.0):
            leak = LeakRate(0.1, temperature_c=temperature_c, double_luma=0.3)
            made = [sum(map(len, stamps(leak, luma))) / SIDE**2 / SECONDS for luma in lumas]
            axes[2].loglog(lumas, leak.mean_rate_hz(lumas), label=f"{temperature_c:g} degrees", linewidth=1)
            axes[2].plot(lumas, made, "ko", markersize=3)
            rows = zip(lumas, made, strict=True)
            print(f"{temperature_c:g} degrees:", ", ".join(f"luma {a:.3g}: {b:.4f} Hz" for a, b in rows))
        axes[2].set(xlabel="luma (double_luma = 0.3)", ylabel="events a second of a pixel")
        axes[2].legend(fontsize=6)


if __name__ == "__main__":
    main()
