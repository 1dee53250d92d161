"""Keep a marker centred from events alone: a PI controller in the environment davis_rs/Marker-v0.

Run: python examples/keep_centred.py -o path.png
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt

from davis_rs.gym import EventCameraEnv  # registers the environments, too

FloatArray = npt.NDArray[np.float64]

PROPORTIONAL, INTEGRAL = 10.0, 40.0
LEAST_EVENTS, MEMORY = 5, 0.5
DISTANCE_M = 2.0


class Path(NamedTuple):
    """Holds times (n,) in seconds, places of camera and marker (n, 2) in metres, right and down, and events a step."""

    t_s: FloatArray
    camera: FloatArray
    marker: FloatArray
    offset_px: FloatArray
    events: npt.NDArray[np.int64]


def follow(*, seed: int = 1, duration_s: float = 4.0, size: int = 96, blind: bool = False) -> Path:
    """Follow the marker for an episode; a blind controller gets no events."""
    env = gymnasium.make("davis_rs/Marker-v0", observe=["events"], duration_s=duration_s, size=size)
    assert isinstance(env.unwrapped, EventCameraEnv)
    step_s, metres_per_px, middle = 0.01, DISTANCE_M / env.unwrapped.simulator.camera.fx, (size - 1) / 2
    observation, info = env.reset(seed=seed)
    offset, velocity, rows = np.zeros(2), np.zeros(2), []
    over = False
    while not over:
        events = observation["events"][: 0 if blind else None]
        if len(events) >= LEAST_EVENTS:  # without events the marker stays where it is in the image
            offset = (1 - MEMORY) * offset + MEMORY * (events[:, 1:3].mean(0) - middle)
        velocity = velocity + INTEGRAL * step_s * metres_per_px * offset
        command = np.clip(velocity + PROPORTIONAL * metres_per_px * offset, -2, 2)
        observation, _, terminated, truncated, info = env.step(np.r_[command, 0, 0, 0, 0].astype(np.float32))
        over = terminated or truncated
        camera = info["pose"][:3, 3] @ [[1, 0], [0, 0], [0, -1]] + [0, 1.2]
        marker = camera + metres_per_px * info["offset_px"]
        rows.append((info["t_s"], camera, marker, info["offset_px"], info["events"]))
    env.close()
    t_s, camera, marker, offset_px, count = (np.array(column) for column in zip(*rows, strict=True))
    return Path(t_s, camera, marker, offset_px, count)


def draw(seeing: Path, blind: Path, output: str) -> None:
    """Draw where marker and camera went, how far apart they are in the image, and how many events there were."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.6), layout="constrained")
    plane, over_time = figure.subplots(1, 2, width_ratios=(1, 1.7))
    plane.plot(*(100 * seeing.marker.T), color="0.6", linewidth=3, label="marker")
    plane.plot(*(100 * seeing.camera.T), color="C3", linewidth=1.2, label="camera")
    plane.plot(*(100 * seeing.camera[0]), "o", color="C3", markersize=4)
    plane.set(xlabel="right (cm)", ylabel="down (cm)", aspect="equal")
    plane.invert_yaxis()
    plane.legend(frameon=False, loc="center", bbox_to_anchor=(0.7, 0.5))
    for path, colour, label in ((blind, "0.6", "camera at rest"), (seeing, "C3", "controller")):
        over_time.plot(path.t_s, np.linalg.norm(path.offset_px, axis=1), color=colour, label=label)
    over_time.set(
        xlabel="time (s)",
        ylabel="marker from the image's middle (px)",
        ylim=(0, 1.25 * np.linalg.norm(blind.offset_px, axis=1).max()),
    )
    counts = over_time.twinx()
    counts.plot(seeing.t_s, seeing.events, color="C0", linewidth=0.6, alpha=0.6)
    counts.set_ylabel("events a step", color="C0")
    counts.set_ylim(0, 4 * seeing.events.max())
    over_time.set_xlim(0, seeing.t_s[-1])
    over_time.legend(frameon=False, loc="upper left", ncols=2)
    figure.savefig(output, dpi=150)


def main(argv: list[str] | None = None) -> tuple[float, float]:
    """Return the rms distance of the marker from the image's middle in pixels, of the controller and at rest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration", type=float, default=4.0, help="seconds")
    parser.add_argument("--size", type=int, default=96, help="pixels")
    parser.add_argument("-o", "--output", help="picture of the path, such as path.png")
    options = parser.parse_args(argv)
    seeing, blind = (
        follow(seed=options.seed, duration_s=options.duration, size=options.size, blind=blind)
        for blind in (False, True)
    )
    if options.output:
        draw(seeing, blind, options.output)
    with_events, at_rest = (float(np.sqrt((path.offset_px**2).sum(1).mean())) for path in (seeing, blind))
    print(f"rms distance from the middle: {with_events:.2f} px with the controller, {at_rest:.2f} px at rest")
    return with_events, at_rest


if __name__ == "__main__":
    main()
