"""A picture of one window in every representation: python benches/representations.py -o docs/representations.png"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import davis_rs
from davis_rs.events.represent import count_image, event_spike_tensor, last_event_times, time_surface, voxel_grid


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "planes"
        scene = davis_rs.load_scene("three_planes")
        davis_rs.simulate_to_folder(scene, folder, start_s=0.6, duration_s=0.04, accuracy="fast", quiet=True)
        window = davis_rs.EventWindows(folder, duration_us=30_000)[0]
    events, size = window.events, window.size
    assert size is not None
    limits = {"start_us": window.start_us, "stop_us": window.end_us}
    counts, surface = count_image(events, size).astype(float), time_surface(events, size, 10_000, t_us=window.end_us)
    latest = last_event_times(events, size, **limits)
    voxels, est = voxel_grid(events, size, 3, **limits), event_spike_tensor(events, size, 3, **limits)
    panels = [
        ("count, OFF", counts[0], "gray_r"), ("time surface, OFF", surface[0], "magma"),
        ("last times, OFF", latest[0], "magma"),
        ("count, ON", counts[1], "gray_r"), ("time surface, ON", surface[1], "magma"),
        ("last times, ON", latest[1], "magma"),
        *((f"voxel grid, plane {k}", voxels[k], "RdBu_r") for k in range(3)),
        *((f"spike tensor, OFF {k}", est[k], "gray_r") for k in range(3)),
        *((f"spike tensor, ON {k}", est[3 + k], "gray_r") for k in range(3)),
    ]  # fmt: skip
    figure, axes = plt.subplots(5, 3, figsize=(9, 11.6), layout="constrained")
    for axis, (title, image, colours) in zip(axes.flat, panels, strict=True):
        most = max(float(np.percentile(np.abs(image), 99.5)), 1e-6)
        axis.imshow(image, cmap=colours, vmin=-most if colours == "RdBu_r" else 0, vmax=most)
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
    figure.savefig(output, dpi=80)
    with Image.open(output) as picture:  # 64 colours suffice, and take a quarter of the room
        few = picture.convert("RGB").quantize(64)
    few.save(output, optimize=True)


if __name__ == "__main__":
    main()
