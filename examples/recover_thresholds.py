"""Recover ON and OFF thresholds of each pixel from the events of a known motion: least squares, pixel by pixel.

The k-th event of a pixel says L(t_k) - L(0) = n_on C_on - n_off C_off: linear in its two thresholds, once log luma at
the stamps is known. Run: python examples/recover_thresholds.py -o docs/recover_thresholds.png
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np
from event_fits import FloatArray, events_of, save, spread, tukey, with_noise

from davis_rs import Camera, CrossingEngine, Effects, load_scene
from davis_rs.differentiable import LogLumaResidualBlock, event_log_luma_residuals, event_time_residuals

NOMINAL = 0.15, 0.18
LEAST_LOG = 1e-3
"""Below this log luma at a stamp is no better known: rays that jump, and the steps between samples of the run."""

KNOWN = 0.02
"""A threshold is known where least squares says that it is within this share of the nominal one."""


class Found(NamedTuple):
    """Thresholds that were recovered with one noise.

    Attributes:
        noise_us: on the stamps.
        true, found, sigma: (2, H, W) ON and OFF: thresholds, estimates, and what least squares says they are off.
        known: (2, H, W) whether ``sigma`` is within :data:`KNOWN` of the nominal threshold.
        correlation, rms: (2,) of those that are known: with the truth; of the error as a share of nominal.
    """

    noise_us: float
    true: FloatArray
    found: FloatArray
    sigma: FloatArray
    known: Any
    correlation: FloatArray
    rms: FloatArray


def thresholds_of(
    block: LogLumaResidualBlock, noise_us: float, height: int, width: int
) -> tuple[FloatArray, FloatArray]:
    """Estimates (2, H, W), and their standard deviations; those of a pixel that says nothing are nominal, infinite."""
    pixels = height * width
    levels, here = block.derivatives.levels, block.derivatives.here
    on, off = levels.on, -levels.off
    change = here.value - block.derivatives.start.value
    # A stamp is off by its noise and by where in its microsecond the event was, log luma by that times its rate.
    sigma = np.hypot(LEAST_LOG, np.hypot(noise_us, 12**-0.5) * 1e-6 * here.rate)
    found = np.repeat(np.array(NOMINAL)[:, None], pixels, axis=1)
    weight = np.ones(len(on))
    for _ in range(8):
        w = weight / sigma**2
        a, b, c = (np.bincount(levels.pixel, w * part, pixels) for part in (on**2, on * off, off**2))
        e, f = (np.bincount(levels.pixel, w * part * change, pixels) for part in (on, off))
        # A weak prior, so that a pixel of one polarity has an answer for the other: the nominal threshold.
        prior = 1e-2 / np.array(NOMINAL) ** 2
        a, c, e, f = a + prior[0], c + prior[1], e + prior[0] * NOMINAL[0], f + prior[1] * NOMINAL[1]
        determinant = a * c - b**2
        found = np.stack([c * e - b * f, a * f - b * e]) / determinant
        residual = (change - on * found[0, levels.pixel] - off * found[1, levels.pixel]) / sigma
        weight = tukey(residual, 4.0 * max(spread(residual), 1.0))
    deviation = np.sqrt(np.stack([c, a]) / determinant) * max(spread(residual), 1.0)
    return found.reshape(2, height, width), deviation.reshape(2, height, width)


def main(argv: list[str] | None = None) -> list[Found]:
    """Returns what was found with each noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-us", type=float, nargs="+", default=[0.0, 1.0, 10.0, 100.0], help="on the stamps")
    parser.add_argument("--width", type=int, default=80, help="pixels")
    parser.add_argument("--duration", type=float, default=0.3, help="seconds")
    parser.add_argument("--rays-per-pixel", type=int, default=8, help="rays a pixel")
    parser.add_argument("--mismatch", type=float, default=0.14, help="standard deviation, as a share of the threshold")
    parser.add_argument("-o", "--output", help="picture")
    options = parser.parse_args(argv)
    width, height, focal = options.width, options.width * 3 // 4, options.width / 1.2
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    scene = load_scene("three_walls").crop(0.1003, options.duration)
    both: dict[str, Any] = {"contrast_threshold": NOMINAL[0], "contrast_threshold_off": NOMINAL[1]}
    run = {"camera": camera, "rays_per_pixel": options.rays_per_pixel, "accuracy": "exact", **both}
    effects = Effects(threshold_mismatch=options.mismatch)
    engine = CrossingEngine(width, height, effects=effects, seed=5, **both)
    true = np.stack([np.asarray(engine.contrast_threshold), np.asarray(engine.contrast_threshold_off)])
    events = events_of(scene, effects=effects, seed=5, **run)
    print(f"{len(events)} events, {len(events) / width / height:.1f} a pixel")

    results = []
    for noise_us in options.noise_us:
        noisy = with_noise(events, noise_us, 1e6 * options.duration)
        (block,) = event_log_luma_residuals(scene, noisy, block=len(noisy), **run)
        found, sigma = thresholds_of(block, noise_us, height, width)
        known = sigma < KNOWN * np.array(NOMINAL)[:, None, None]
        pairs = [(found[k][known[k]], true[k][known[k]]) for k in range(2)]
        correlation = np.array([np.corrcoef(one, other)[0, 1] for one, other in pairs])
        rms = np.array([np.sqrt(((one - other) ** 2).mean()) / NOMINAL[k] for k, (one, other) in enumerate(pairs)])
        median = np.array([np.median(np.abs(one - other)) / NOMINAL[k] for k, (one, other) in enumerate(pairs)])
        results.append(Found(noise_us, true, found, sigma, known, correlation, rms))
        for k, name in enumerate(("ON", "OFF")):
            print(
                f"noise {noise_us:5g} us, {name:3s}: {known[k].mean():6.1%} of the pixels known, correlation "
                f"{correlation[k]:.5f}, error {rms[k]:.3%} rms, {median[k]:.3%} median",
                flush=True,
            )
    print(f"residuals of times: {times_off(scene, events, None, run):.0f} us with nominal thresholds, ", end="")
    print(f"{times_off(scene, events, np.maximum(results[0].found, 1e-3), run):.2f} us with those found")
    if options.output:
        draw(results, options.output)
    return results


def times_off(scene: Any, events: Any, thresholds: FloatArray | None, run: Any) -> float:
    """Median size of the residuals of event times, microseconds."""
    blocks = event_time_residuals(scene, events, thresholds=thresholds, **run)
    return float(np.nanmedian(np.abs(np.concatenate([block.residual_us[block.ok] for block in blocks]))))


def draw(results: list[Found], path: str) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(10.5, 2.7), layout="constrained")
    first = results[0]
    limits = first.true[0].min(), first.true[0].max()
    image = axes[0].imshow(first.true[0], vmin=limits[0], vmax=limits[1], cmap="viridis")
    axes[0].set_title("true C_on", fontsize=9)
    axes[1].imshow(np.where(first.known[0], first.found[0], np.nan), vmin=limits[0], vmax=limits[1], cmap="viridis")
    axes[1].set_title("found, white: not known", fontsize=9)
    for ax in axes[:2]:
        ax.set(xlabel="x (px)", ylabel="y (px)")
    figure.colorbar(image, ax=axes[1], label="C_on (ln units)")
    last = results[-1]
    for one, colour in ((last, "tab:orange"), (first, "tab:blue")):
        for k in range(2):
            axes[2].plot(one.true[k][one.known[k]], one.found[k][one.known[k]], ".", ms=1, color=colour, alpha=0.5)
        axes[2].plot([], [], ".", color=colour, label=f"{one.noise_us:g} us")
    axes[2].legend(title="noise of stamps", fontsize=7, title_fontsize=7)
    ends = [0.08, 0.32]
    axes[2].plot(ends, ends, "k", lw=0.5)
    axes[2].set(xlabel="true C (ln units)", ylabel="found C (ln units)", xlim=ends, ylim=ends)
    noises = [max(one.noise_us, 0.29) for one in results]
    for k, name in enumerate(("ON", "OFF")):
        axes[3].semilogx(noises, [100 * one.rms[k] for one in results], "o-", ms=4, label=name)
    axes[3].set(xlabel="noise of stamps (us)", ylabel="rms error (% of C)", ylim=(0, None))
    axes[3].legend(fontsize=7)
    axes[3].grid(alpha=0.3)
    save(figure, path)


if __name__ == "__main__":
    main()
