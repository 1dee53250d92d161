"""What a colour sensor sees, and what it costs: python benches/colour.py -o docs/colour.png"""

from __future__ import annotations

import argparse
import time

import numpy as np
import numpy.typing as npt

import davis_rs
from davis_rs import Camera, Packet, Pose, Scene
from davis_rs.events.colour import filter_numbers
from davis_rs.scene.parts import start_looking_at

CAMERA = Camera(120, 90, 130.0, 130.0, 59.5, 44.5)
PATCHES = ((0.8, 0.1, 0.1), (0.1, 0.7, 0.1), (0.1, 0.15, 0.8), (0.8, 0.7, 0.1), (0.1, 0.7, 0.7), (0.75, 0.75, 0.75))
DURATION_S, TURNS = 0.2, 3


def chart() -> Scene:
    """Make a chart of six colours on dark grey, along which the camera moves sideways."""
    texels = np.full((64, 96, 3), 0.05, np.float32)
    for number, colour in enumerate(PATCHES):
        row, column = divmod(number, 3)
        texels[8 + 28 * row : 28 + 28 * row, 8 + 29 * column : 30 + 29 * column] = colour
    bitmap = {"type": "bitmap", "raw": True, "data": texels, "filter_type": "nearest"}
    wall = np.eye(4)
    wall[:3, :3] = np.array([[1.5, 0, 0], [0, 0, -1], [0, 1, 0]])
    wall[:3, 3] = [0, 2, 0]
    parts = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "light": {"type": "constant", "radiance": 1.0},
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": {"type": "twosided", "nested": {
            "type": "diffuse", "reflectance": bitmap}}},
    }  # fmt: skip
    start = start_looking_at([-0.15, 0, 0], [-0.15, 2, 0])
    end = Pose(start.position + np.array([0.3, 0, 0]), start.quaternion)
    return Scene("chart", lambda: parts, trajectory=davis_rs.SegmentTrajectory(start, end, DURATION_S), shadows=False)


def run(colour_filter: str) -> tuple[list[Packet], float]:
    """Return the packets, and the least processor time of a few runs."""
    taken_s = []
    for _ in range(TURNS):
        simulator = davis_rs.Simulator(chart(), camera=CAMERA, colour_filter=colour_filter, threads=1)
        start = time.process_time()
        packets = list(simulator.run())
        taken_s.append(time.process_time() - start)
    return packets, min(taken_s)


def draw(packets: list[Packet], output: str) -> None:
    """Draw a raw frame, the same in full colour, and events by their pixel's filter."""
    from matplotlib.figure import Figure

    shown = next(p for p in packets if p.end_us >= 1e6 * DURATION_S / 2 and p.luma is not None)
    assert shown.luma is not None
    raw = np.clip(shown.luma, 0, 1)
    numbers = filter_numbers("RGGB", CAMERA.width, CAMERA.height)
    events = np.concatenate([p.events for p in packets])
    near = events[np.abs(events["t"] - shown.end_us) < 4000]
    picture: npt.NDArray[np.float64] = np.ones((CAMERA.height, CAMERA.width, 3))
    for number, colour in enumerate(((0.85, 0.1, 0.1), (0.1, 0.6, 0.1), (0.1, 0.2, 0.9))):
        own = near[numbers[near["y"], near["x"]] == number]
        picture[own["y"], own["x"]] = colour
    figure = Figure(figsize=(11, 3.1), layout="constrained")
    panels = figure.subplots(1, 3)
    gamma = 1 / 2.2
    panels[0].imshow(raw**gamma, cmap="gray", vmin=0, vmax=1)
    panels[1].imshow(np.clip(davis_rs.demosaic(raw, "RGGB"), 0, 1) ** gamma)
    panels[2].imshow(picture)
    for panel, title in zip(panels, ("raw frame", "demosaiced", "events by their filter, 8 ms"), strict=True):
        panel.set_title(title)
        panel.set_xticks([])
        panel.set_yticks([])
    figure.savefig(output, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", help="picture, such as colour.png")
    options = parser.parse_args()
    _, plain_s = run("none")
    packets, colour_s = run("RGGB")
    print(f"processor time with filters: {colour_s / plain_s:.2f} times that without")
    if options.output:
        draw(packets, options.output)


if __name__ == "__main__":
    main()
