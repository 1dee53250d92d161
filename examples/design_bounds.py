"""Cramer-Rao bounds of the camera's pose: which motion and which threshold say most about it, at which event rate.

A constant increment of the path is unknown, six numbers; stamps have normal noise, and each stamp is rounded to a
microsecond. With the Jacobian J of the event times, the covariance of any unbiased estimate is at least
sigma^2 (J^T J)^-1. Run: python examples/design_bounds.py -o docs/design_bounds.png
Source: Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, chapter 3.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from event_fits import FloatArray, events_of, save, with_noise
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene, SegmentTrajectory, load_scene
from davis_rs.differentiable import event_time_jacobian, event_time_residuals

DURATION_S = 0.1
MOTIONS = {
    "along x": (0.1, 0, 0, 0, 0, 0),
    "along the optical axis": (0, 0, 0.1, 0, 0, 0),
    "about the optical axis": (0, 0, 0, 0, 0, 0.1),
    "about y": (0, 0, 0, 0, 0.1, 0),
    "all six": (0.05, 0.05, 0.05, 0.05, 0.05, 0.05),
}
"""Metres and radians within the run, in camera axes."""

MOST_CONDITION = 1e12
"""Of the Fisher information: beyond it the events do not tell all six numbers."""


class Bound(NamedTuple):
    """The bound of one motion and threshold.

    Attributes:
        motion, threshold: of the run.
        rate_hz: events a second that are known.
        covariance: (6, 6) metres in world axes, radians in camera axes; infinite where the events do not tell all six.
    """

    motion: str
    threshold: float
    rate_hz: float
    covariance: FloatArray

    def rms(self) -> tuple[float, float]:
        """Of position, millimetres, and of rotation, degrees."""
        diagonal = self.covariance.diagonal()
        return 1e3 * float(np.sqrt(diagonal[:3].sum())), float(np.degrees(np.sqrt(diagonal[3:].sum())))


def with_motion(scene: Scene, motion: str) -> Scene:
    """From one pose of the scene's path on, at constant velocity."""
    at, by = scene.path.pose(0.1503), np.array(MOTIONS[motion], np.float64)
    turn = Rotation.from_quat(at.quaternion)
    end = Pose(at.position + turn.apply(by[:3]), (turn * Rotation.from_rotvec(by[3:])).as_quat())
    return replace(scene, trajectory=SegmentTrajectory(at, end, DURATION_S))


def deviation_us(noise_us: float) -> float:
    """Of a stamp: its noise, and where in its microsecond the event was."""
    return float(np.hypot(noise_us, 12**-0.5))


def bound_of(scene: Scene, motion: str, noise_us: float, run: Any) -> Bound:
    """Of one motion and threshold."""
    events = events_of(scene, **run)
    jacobian, ok = event_time_jacobian(scene, events, of=("pose",), **run)
    information = jacobian[ok].T @ jacobian[ok] / deviation_us(noise_us) ** 2
    # What the events do not tell has no bound.
    told = np.linalg.cond(information) < MOST_CONDITION
    covariance = np.linalg.inv(information) if told else np.full((6, 6), np.inf)
    return Bound(motion, run["contrast_threshold"], ok.sum() / DURATION_S, covariance)


def normalised_errors(scene: Scene, bound: Bound, noise_us: float, draws: int, run: Any) -> FloatArray:
    """(draws,) squared errors of estimates by the bound's covariance: 6 in the mean where the bound is reached.

    An estimate is one Gauss-Newton step from the truth, on noisy stamps.
    """
    events = events_of(scene, **run)
    squared = []
    for seed in range(draws):
        noisy = with_noise(events, noise_us, 1e6 * DURATION_S, seed)
        normal, gradient = np.zeros((6, 6)), np.zeros(6)
        for block in event_time_residuals(scene, noisy, within_us=2000.0, **run):
            ok = block.ok & (np.abs(block.residual_us) < 5 * deviation_us(noise_us))
            jacobian = block.derivatives.jacobian(("pose",))[ok]
            normal += jacobian.T @ jacobian
            gradient += jacobian.T @ block.residual_us[ok]
        error = np.linalg.solve(normal, gradient)
        squared.append(error @ np.linalg.solve(bound.covariance, error))
    return np.array(squared)


def main(argv: list[str] | None = None) -> tuple[list[Bound], FloatArray]:
    """Returns the bounds, and the normalised errors of estimates of the last motion and threshold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-us", type=float, default=10.0, help="on the stamps")
    parser.add_argument(
        "--thresholds", type=float, nargs="+", default=[0.05, 0.07, 0.1, 0.14, 0.2, 0.28], help="natural-log units"
    )
    parser.add_argument("--motions", nargs="+", default=list(MOTIONS), choices=list(MOTIONS))
    parser.add_argument("--draws", type=int, default=20, help="of noise, for the check")
    parser.add_argument("--width", type=int, default=64, help="pixels")
    parser.add_argument("--rays-per-pixel", type=int, default=8, help="rays a pixel")
    parser.add_argument("-o", "--output", help="picture")
    options = parser.parse_args(argv)
    width, height, focal = options.width, options.width * 3 // 4, options.width / 1.2
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    whole, bounds = load_scene("three_walls"), []
    for motion in options.motions:
        scene = with_motion(whole, motion)
        for threshold in options.thresholds:
            run = {
                "camera": camera,
                "rays_per_pixel": options.rays_per_pixel,
                "accuracy": "exact",
                "contrast_threshold": threshold,
            }
            bounds.append(bound_of(scene, motion, options.noise_us, run))
            metres, degrees = bounds[-1].rms()
            print(
                f"{motion:22s} C {threshold:.2f} {1e-3 * bounds[-1].rate_hz:8.1f} kHz {metres:9.5f} mm {degrees:9.6f} "
                f"deg",
                flush=True,
            )
    squared = normalised_errors(scene, bounds[-1], options.noise_us, options.draws, run)
    print(f"squared errors by the last bound: {squared.mean():.2f} in the mean of {len(squared)} draws, 6 at the bound")
    if options.output:
        draw(bounds, options)
    return bounds, squared


def draw(bounds: list[Bound], options: Any) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
    for motion in options.motions:
        own = [bound for bound in bounds if bound.motion == motion]
        rates = [1e-3 * bound.rate_hz for bound in own]
        for column, ax in enumerate(axes):
            ax.loglog(rates, [bound.rms()[column] for bound in own], "o-", ms=4, label=motion)
    for ax, unit in zip(axes, ("position (mm)", "rotation (degrees)"), strict=True):
        ax.set(xlabel="events a second (thousands)", ylabel=f"bound of {unit}")
        ax.grid(alpha=0.3, which="both")
    axes[1].legend(title="motion", fontsize=7, title_fontsize=7)
    save(figure, options.output)


if __name__ == "__main__":
    main()
