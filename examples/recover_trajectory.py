"""Recover a camera's path from events alone: Gauss-Newton on event times.

The path is off by 2 cm and 1 degree (rms), by sines in all six of its coordinates that no spline of the estimate has
exactly. The estimate is a cubic B-spline of 20 control points, six increments each. Coarse to fine: 4, 6, 10, 20
control points on residuals of log luma at the stamps, then residuals of the times themselves. The thresholds and the
scene are known. Run: python examples/recover_trajectory.py -o docs/recover_trajectory.png
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from event_fits import FloatArray, events_of, save, spread, tukey, with_noise
from scipy.sparse import csr_array, diags_array, vstack
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from davis_rs import Camera, SampledTrajectory, Scene, load_scene
from davis_rs.differentiable import event_log_luma_residuals, event_time_residuals, moved, spline_weights
from davis_rs.events.arrays import EventArray

COARSE_TO_FINE = (4, 6, 10, 20)
PRIOR = np.array([0.02] * 3 + [np.radians(1.0)] * 3)
"""What is known of the increments before: their rms, metres and radians. It holds what events do not see."""

LEAST_LOG, LEAST_US = 2e-4, 0.3
"""Residuals below these are no better known: rays that jump, and the microsecond of a stamp."""


class Found(NamedTuple):
    """A path that was recovered, compared with the true one.

    Attributes:
        noise_us: on the stamps.
        history: (k, 2) rms of position, metres, and of angle, degrees, from iteration to iteration.
        t_s: (n,) instants, seconds.
        errors: (n, 2) there, metres and degrees.
    """

    noise_us: float
    history: FloatArray
    t_s: FloatArray
    errors: FloatArray


def off_course(scene: Scene) -> Scene:
    """The scene with its path off by slow sines, 2 cm and 1 degree (rms)."""
    t = np.linspace(0.0, scene.path.duration_s, 400)
    sines = np.sin(2 * np.pi * t[:, None] / t[-1] * np.array([1.0, 0.8, 1.2, 0.9, 1.1, 1.0]) + np.arange(6) * 1.3)
    sines[:, :3] *= 0.02 / np.sqrt((sines[:, :3] ** 2).sum(1).mean())
    sines[:, 3:] *= np.radians(1.0) / np.sqrt((sines[:, 3:] ** 2).sum(1).mean())
    turned = Rotation.from_quat(scene.path.quaternions(t)) * Rotation.from_rotvec(sines[:, 3:])
    return replace(scene, trajectory=SampledTrajectory(t, scene.path.positions(t) + sines[:, :3], turned.as_quat()))


def errors_of(estimate: Scene, true: Scene, t_s: FloatArray) -> FloatArray:
    """(n, 2): how far positions are off, metres, and rotations, degrees. No alignment."""
    one, other = estimate.path, true.path
    metres = np.linalg.norm(one.positions(t_s) - other.positions(t_s), axis=1)
    turn = Rotation.from_quat(other.quaternions(t_s)).inv() * Rotation.from_quat(one.quaternions(t_s))
    return np.stack([metres, np.degrees(turn.magnitude())], 1)


def step(jacobian: csr_array, residual: FloatArray, weight: FloatArray, points: FloatArray, coarse: csr_array) -> Any:
    """A Gauss-Newton step of weighted residuals and the prior; ``coarse`` takes points of a coarser spline to all."""
    prior = diags_array(1 / np.tile(PRIOR, len(points)) ** 2)
    weighted = jacobian.T @ diags_array(weight)
    normal = coarse.T @ (weighted @ jacobian + prior) @ coarse
    gradient = coarse.T @ (weighted @ residual + prior @ points.ravel())
    return points - (coarse @ spsolve(normal.tocsc(), gradient)).reshape(-1, 6)


def log_luma_system(scene: Scene, events: EventArray, count: int, run: Any) -> tuple[FloatArray, csr_array]:
    """Residuals of log luma, and their Jacobian by the control points."""
    blocks = list(event_log_luma_residuals(scene, events, **run))
    jacobians = [block.derivatives.control_points(count) for block in blocks]
    return np.concatenate([block.residual for block in blocks]), csr_array(vstack(jacobians))


def time_system(scene: Scene, events: EventArray, count: int, run: Any) -> tuple[FloatArray, csr_array]:
    """Residuals of event times, microseconds, and their Jacobian by the control points."""
    residuals, jacobians = [], []
    for block in event_time_residuals(scene, events, within_us=2000.0, **run):
        residuals.append(block.residual_us[block.ok])
        jacobians.append(block.derivatives.control_points(count)[np.flatnonzero(block.ok)])
    return np.concatenate(residuals), csr_array(vstack(jacobians))


def recover(true: Scene, start: Scene, events: EventArray, run: Any, noise_us: float, options: Any) -> Found:
    """From ``start``'s path to one that explains the events."""
    count, duration_s = options.points, true.path.duration_s
    t_s = np.linspace(0.0, duration_s, 401)
    points = np.zeros((count, 6))
    history = []

    def note(what: str, residual: str) -> None:
        errors = errors_of(moved(start, points), true, t_s)
        history.append(np.sqrt((errors**2).mean(0)))
        print(f"{what:24s} {residual:32s} {1e3 * history[-1][0]:10.5f} mm {history[-1][1]:9.6f} deg", flush=True)

    note("start", "")
    fine = spline_weights(t_s, count, duration_s=duration_s).toarray()
    for level in sorted({min(n, count) for n in COARSE_TO_FINE}):
        few = spline_weights(t_s, level, duration_s=duration_s).toarray()
        coarse = csr_array(np.kron(np.linalg.lstsq(fine, few, rcond=None)[0], np.eye(6)))
        for _ in range(options.steps):
            residual, jacobian = log_luma_system(moved(start, points), events, count, run)
            sigma = max(spread(residual), LEAST_LOG)
            points = step(jacobian, residual, tukey(residual, 4 * sigma) / sigma**2, points, coarse)
            note(f"log luma, {level} points", f"residuals {spread(residual):.6f}")
    everything = csr_array(np.eye(6 * count))
    for _ in range(options.time_steps):
        residual, jacobian = time_system(moved(start, points), events, count, run)
        sigma = max(spread(residual), LEAST_US)
        points = step(jacobian, residual, tukey(residual, 4 * sigma) / sigma**2, points, everything)
        note("event times", f"{len(residual)} residuals {spread(residual):.3f} us")
    return Found(noise_us, np.array(history), t_s, errors_of(moved(start, points), true, t_s))


def main(argv: list[str] | None = None) -> list[Found]:
    """Returns what was found with each noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-us", type=float, nargs="+", default=[0.0, 1.0, 10.0, 100.0], help="on the stamps")
    parser.add_argument("--width", type=int, default=80, help="pixels")
    parser.add_argument("--duration", type=float, default=0.1, help="seconds")
    parser.add_argument("--points", type=int, default=20, help="control points")
    parser.add_argument("--steps", type=int, default=5, help="on log luma, for each number of control points")
    parser.add_argument("--time-steps", type=int, default=3, help="on event times")
    parser.add_argument("--rays-per-pixel", type=int, default=16, help="rays a pixel")
    parser.add_argument("-o", "--output", help="picture")
    options = parser.parse_args(argv)
    width, height, focal = options.width, options.width * 3 // 4, options.width / 1.2
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    scene = load_scene("three_walls").crop(0.1003, options.duration)
    run = {"camera": camera, "rays_per_pixel": options.rays_per_pixel, "accuracy": "exact", "contrast_threshold": 0.1}
    events = events_of(scene, **run)
    print(f"{len(events)} events")
    start, found = off_course(scene), []
    for noise_us in options.noise_us:
        print(f"noise of {noise_us:g} us")
        noisy = with_noise(events, noise_us, 1e6 * scene.path.duration_s)
        found.append(recover(scene, start, noisy, run, noise_us, options))
    if options.output:
        draw(found, options.output)
    return found


def draw(found: list[Found], path: str) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(8.0, 5.2), layout="constrained")
    for one in found:
        label = f"{one.noise_us:g} us"
        for column, (scale, unit) in enumerate(((1e3, "position (mm)"), (1.0, "rotation (deg)"))):
            axes[0, column].semilogy(scale * one.history[:, column], label=label)
            axes[1, column].semilogy(1e3 * one.t_s, scale * one.errors[:, column], label=label)
            axes[0, column].set(xlabel="iteration", ylabel=f"rms error of {unit}")
            axes[1, column].set(xlabel="time (ms)", ylabel=f"final error of {unit}")
    for ax in axes.ravel():
        ax.grid(alpha=0.3)
    axes[0, 1].legend(title="noise of stamps", fontsize=8, title_fontsize=8)
    save(figure, path)


if __name__ == "__main__":
    main()
