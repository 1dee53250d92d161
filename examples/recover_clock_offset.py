"""Find by how much the clock of the ground truth is late, and how fast it falls behind, from events alone.

Gauss-Newton on `clock_offset` and `clock_drift`: first on residuals of log luma at the stamps, then on event times.
Run: python examples/recover_clock_offset.py
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from event_fits import FloatArray, events_of, spread, tukey, with_noise

from davis_rs import Camera, Scene, load_scene
from davis_rs.differentiable import event_log_luma_residuals, event_time_residuals
from davis_rs.events.arrays import EventArray
from davis_rs.geometry.trajectory.trajectory import Trajectory

BEGIN_S = 0.1003
"""Where in the scene's path the run begins."""

UNKNOWNS = ("clock_offset", "clock_drift")
LEAST_LOG, LEAST_US = 2e-4, 0.3


class LatePath(Trajectory):
    """Part of a path, as a clock has it that is late by an offset, seconds, and falls behind by a drift, s/s."""

    def __init__(self, path: Trajectory, duration_s: float, late: FloatArray) -> None:
        self.duration_s, self._path, self._late = duration_s, path, late

    def _own(self, t_s: npt.ArrayLike) -> FloatArray:
        t_s = self.times(t_s)
        return np.asarray(BEGIN_S + t_s - self._late[0] - self._late[1] * t_s)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.positions(self._own(t_s))

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.quaternions(self._own(t_s))

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.velocities(self._own(t_s)) * (1 - self._late[1])

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.angular_rates(self._own(t_s)) * (1 - self._late[1])

    def breaks_s(self) -> FloatArray:
        breaks = (self._path.breaks_s() - BEGIN_S + self._late[0]) / (1 - self._late[1])
        return breaks[(breaks > 0) & (breaks < self.duration_s)]

    def describe(self) -> dict[str, object]:
        return {"kind": "late", "late": self._late.tolist(), "trajectory": self._path.describe()}


class Found(NamedTuple):
    """What was found with one noise.

    Attributes:
        noise_us: on the stamps.
        error: (2,) of the offset, seconds, and of the drift, s/s.
        sigma: (2,) what least squares says they are off.
    """

    noise_us: float
    error: FloatArray
    sigma: FloatArray


def residuals_of(scene: Scene, events: EventArray, run: Any, of_times: bool) -> tuple[FloatArray, FloatArray]:
    """Residuals of event times, microseconds, or of log luma; and their Jacobian (n, 2)."""
    residuals, jacobians = [], []
    if of_times:
        for times in event_time_residuals(scene, events, within_us=2000.0, **run):
            residuals.append(times.residual_us[times.ok])
            jacobians.append(times.derivatives.jacobian(UNKNOWNS)[times.ok])
    else:
        for lumas in event_log_luma_residuals(scene, events, **run):
            residuals.append(lumas.residual)
            jacobians.append(lumas.derivatives.jacobian(UNKNOWNS))
    return np.concatenate(residuals), np.concatenate(jacobians)


def main(argv: list[str] | None = None) -> list[Found]:
    """Returns what was found with each noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-us", type=float, nargs="+", default=[0.0, 1.0, 10.0, 100.0], help="on the stamps")
    parser.add_argument("--offset-ms", type=float, default=5.0, help="of the clock")
    parser.add_argument("--drift", type=float, default=1e-3, help="of the clock, s/s")
    parser.add_argument("--width", type=int, default=80, help="pixels")
    parser.add_argument("--duration", type=float, default=0.1, help="seconds")
    parser.add_argument("--steps", type=int, default=8, help="on log luma")
    parser.add_argument("--time-steps", type=int, default=3, help="on event times")
    parser.add_argument("--rays-per-pixel", type=int, default=16, help="rays a pixel")
    options = parser.parse_args(argv)
    width, height, focal = options.width, options.width * 3 // 4, options.width / 1.2
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    run = {"camera": camera, "rays_per_pixel": options.rays_per_pixel, "accuracy": "exact", "contrast_threshold": 0.1}
    whole = load_scene("three_walls")

    def late(by: FloatArray) -> Scene:
        return replace(whole, trajectory=LatePath(whole.path, options.duration, by))

    true = np.array([1e-3 * options.offset_ms, options.drift])
    events = events_of(late(true), **run)
    print(f"{len(events)} events")
    found = []
    for noise_us in options.noise_us:
        noisy = with_noise(events, noise_us, 1e6 * options.duration)
        estimate, normal = np.zeros(2), np.eye(2)
        for turn in range(options.steps + options.time_steps):
            of_times = turn >= options.steps
            residual, jacobian = residuals_of(late(estimate), noisy, run, of_times)
            sigma = max(spread(residual), LEAST_US if of_times else LEAST_LOG)
            weighted = jacobian * (tukey(residual, 4 * sigma) / sigma**2)[:, None]
            normal = weighted.T @ jacobian
            estimate = estimate - np.linalg.solve(normal, weighted.T @ residual)
        found.append(Found(noise_us, estimate - true, np.sqrt(np.diag(np.linalg.inv(normal)))))
        (offset, drift), (sigma_offset, sigma_drift) = found[-1].error, found[-1].sigma
        print(
            f"noise {noise_us:5g} us: offset off by {1e6 * offset:8.4f} us (sigma {1e6 * sigma_offset:.4f}), "
            f"drift by {1e6 * drift:8.3f} ppm (sigma {1e6 * sigma_drift:.3f})",
            flush=True,
        )
    return found


if __name__ == "__main__":
    main()
