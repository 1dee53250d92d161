"""Recover the texture of a floor from events alone, under known motion: Gauss-Newton on log reflectance.

Residuals are those of log luma at the stamps. Events see differences of log luma alone, so the texture has a factor of
its own that they do not tell (all but: the dark level gives a faint hint); errors are those modulo it.
Run: python examples/recover_texture_from_events.py -o docs/recover_texture_from_events.png
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np
from event_fits import FloatArray, events_of, save, spread, tukey, with_noise
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_array, diags_array, vstack

from davis_rs import Camera, Pose, Scene, SegmentTrajectory
from davis_rs.differentiable import event_log_luma_residuals

TEXELS = 40
PRIOR = 0.5
"""What is known of log reflectance before: its rms about the first guess."""

FIRST_GUESS = 0.3
KNOWN = 0.05
"""A texel is known where least squares puts its logarithm within this, modulo the common factor."""

LEAST_LOG = 2e-4


class Found(NamedTuple):
    """A texture that was recovered with one noise.

    Attributes:
        noise_us: on the stamps.
        true, found: (T, T) reflectance; what was found is times the factor that gives it the truth's median of known
            texels.
        known: (T, T) whether least squares puts log reflectance within :data:`KNOWN`, modulo the common factor.
        error: (T, T) of log reflectance, modulo the common factor.
        factor: by which what was found was off.
    """

    noise_us: float
    true: FloatArray
    found: FloatArray
    known: Any
    error: FloatArray
    factor: float


def make_scene(reflectance: FloatArray, duration_s: float) -> Scene:
    """A floor under a lamp, and a camera that looks down and moves across."""
    bitmap = {"type": "bitmap", "raw": True, "data": reflectance[..., None].astype(np.float32)}
    source = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "lamp": {"type": "point", "position": [0.3, -0.4, 3.0], "intensity": 20.0},
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": bitmap}},
    }
    ends = Pose([-0.1, -0.06, 1.3], [1.0, 0.0, 0.0, 0.0]), Pose([0.1, 0.08, 1.3], [0.9950, 0.0998, 0.0, 0.0])
    return Scene(name="floor", source=lambda: source, shadows=False, trajectory=SegmentTrajectory(*ends, duration_s))


def main(argv: list[str] | None = None) -> list[Found]:
    """Returns what was found with each noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-us", type=float, nargs="+", default=[0.0, 10.0, 100.0, 1000.0], help="on the stamps")
    parser.add_argument("--width", type=int, default=64, help="pixels")
    parser.add_argument("--duration", type=float, default=0.2, help="seconds")
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--rays-per-pixel", type=int, default=4, help="rays a pixel")
    parser.add_argument("-o", "--output", help="picture")
    options = parser.parse_args(argv)
    middle, focal = (options.width - 1) / 2, options.width * 0.9
    camera = Camera(options.width, options.width, focal, focal, middle, middle)
    run = {"camera": camera, "rays_per_pixel": options.rays_per_pixel, "accuracy": "exact", "contrast_threshold": 0.1}
    noise = gaussian_filter(np.random.default_rng(7).normal(size=(TEXELS, TEXELS)), 1.2)
    true = np.clip(0.3 * np.exp(0.5 * noise / noise.std()), 0.05, 0.8)
    events = events_of(make_scene(true, options.duration), **run)
    print(f"{len(events)} events")
    results = []
    for noise_us in options.noise_us:
        noisy = with_noise(events, noise_us, 1e6 * options.duration)
        results.append(recover(true, noisy, run, noise_us, options))
        one = results[-1]
        error = one.error[one.known]
        print(
            f"noise {noise_us:5g} us: {one.known.mean():6.1%} of the texels known, log reflectance off by "
            f"{np.sqrt((error**2).mean()):.5f} rms, {np.median(np.abs(error)):.5f} median, factor {one.factor:.4f}",
            flush=True,
        )
    if options.output:
        draw(results, options.output)
    return results


def recover(true: FloatArray, events: Any, run: Any, noise_us: float, options: Any) -> Found:
    """From a uniform floor to one that explains the events."""
    guess = np.full(true.size, np.log(FIRST_GUESS))
    logs, normal, seen = guess.copy(), np.eye(true.size), np.ones(true.size, np.bool_)
    for _ in range(options.steps):
        reflectance = np.exp(logs)
        scene = make_scene(reflectance.reshape(true.shape), options.duration)
        blocks = list(event_log_luma_residuals(scene, events, **run))
        residual = np.concatenate([block.residual for block in blocks])
        jacobian = csr_array(vstack([block.derivatives.reflectance() for block in blocks])) @ diags_array(reflectance)
        sigma = max(spread(residual), LEAST_LOG)
        weighted = jacobian.T @ diags_array(tukey(residual, 6 * sigma) / sigma**2)
        informed = (weighted @ jacobian).toarray()
        seen = informed.diagonal() > 0
        normal = informed + np.eye(true.size) / PRIOR**2
        step = np.linalg.solve(normal, weighted @ residual + (logs - guess) / PRIOR**2)
        logs = np.clip(logs - np.clip(step, -0.7, 0.7), np.log(0.01), np.log(0.99))
    covariance = np.linalg.inv(normal)
    # Of a logarithm less the mean of those that are seen: the common factor is taken out.
    variance = covariance.diagonal() - 2 * covariance[:, seen].mean(1) + covariance[np.ix_(seen, seen)].mean()
    known = seen & (variance < KNOWN**2)
    off = logs - np.log(true.ravel())
    common = float(np.median(off[known])) if known.any() else 0.0
    shape = true.shape
    found = np.exp(logs - common).reshape(shape)
    return Found(noise_us, true, found, known.reshape(shape), (off - common).reshape(shape), float(np.exp(common)))


def draw(results: list[Found], path: str) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(10.5, 2.9), layout="constrained")
    first = results[0]
    shown = {"vmin": 0.0, "vmax": float(first.true.max()), "cmap": "gray"}
    pictures = (first.true, np.full_like(first.true, FIRST_GUESS), np.where(first.known, first.found, np.nan))
    titles = ("truth", "first guess", "found, blue: not known")
    for ax, picture, title in zip(axes, pictures, titles, strict=False):
        ax.set_facecolor("lightsteelblue")
        image = ax.imshow(picture, **shown)
        ax.set_title(title, fontsize=9)
    figure.colorbar(image, ax=axes[2], label="reflectance")
    percent = np.where(first.known, 100 * first.error, np.nan)
    limit = float(np.nanquantile(np.abs(percent), 0.98))
    axes[3].set_facecolor("lightsteelblue")
    image = axes[3].imshow(percent, vmin=-limit, vmax=limit, cmap="RdBu")
    axes[3].set_title("error", fontsize=9)
    figure.colorbar(image, ax=axes[3], label="error (% of reflectance)")
    for ax in axes:
        ax.set(xticks=[], yticks=[])
    save(figure, path)


if __name__ == "__main__":
    main()
