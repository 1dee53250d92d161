"""Baked light against Mitsuba's path tracer: python benches/light.py [box moving office room yard] [--pictures FOLDER]

For each scene: how long the bake takes, and on a few instants of the first part of the camera's path how the events
of baked light, and of the path tracer at several numbers of samples, differ from those of the reference: the mean luma
of independent runs of the path tracer with 1,024 samples each. All see the same instants, between which log luma is
linear, so that nothing but light is compared. Two halves of the reference, compared with each other, say how far it can
be trusted; --kept keeps its runs, so that another time more may be added. --second: how long a simulated second takes
with all its events, the bake apart; --coarse: the same, sampled as docs/sequences.md counts events. Needs LLVM. The
tables of docs/light.md.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from light_scenes import SCENES
from sequence_tables import COARSE_PX, COARSE_SAMPLES

from davis_rs import Camera, Scene, Simulator
from davis_rs.accuracy.light_accuracy import HEADS, LightComparison
from davis_rs.events.luma import LumaFrames
from davis_rs.sampling.rules import MaxDisplacement


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["box"], choices=SCENES)
    parser.add_argument("--error", type=float, default=0.01, help="of baked light")
    parser.add_argument("--runs", type=int, default=4, help="of the reference, an even number")
    parser.add_argument("--reference-samples", type=int, default=1024)
    parser.add_argument("--samples", type=int, nargs="*", default=[64, 256], help="of the path tracer that is compared")
    parser.add_argument("--rays", type=int, default=256, help="of the native renderer a pixel")
    parser.add_argument("--instants", type=int, default=2)
    parser.add_argument("--duration", type=float, default=0.02, help="seconds of the camera's path")
    parser.add_argument("--width", type=int, help="of the image; the lens sees the same")
    parser.add_argument("--pictures", type=Path, help="where pictures are written to")
    parser.add_argument("--kept", type=Path, help="where runs of the reference are kept")
    parser.add_argument("--second", action="store_true", help="only simulate: the camera's whole path, all events")
    parser.add_argument("--coarse", action="store_true", help="--second, sampled as docs/sequences.md counts events")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        # A bake that comes from the user's own cache would measure an older one.
        os.environ.setdefault("DAVIS_RS_CACHE_DIR", folder)
        for name in given.scenes:
            scene = SCENES[name]()
            camera = scene.own_camera if given.width is None else _resized(scene.own_camera, given.width)
            (simulate if given.second or given.coarse else measure)(scene, camera, given)


def measure(scene: Scene, camera: Camera, given: argparse.Namespace) -> None:
    size = f"{camera.width} x {camera.height}"
    print(f"\n## {scene.name}, {size}, {given.instants} instants of {given.duration} s, C = 0.15\n")
    comparison = LightComparison(
        scene,
        camera,
        runs=given.runs,
        reference_samples=given.reference_samples,
        instants=given.instants,
        duration_s=given.duration,
        rays=given.rays,
        bake_error=given.error,
        folder=given.kept,
    )
    print(f"| {' | '.join(HEADS)} |")
    print("|---|" + "---:|" * (len(HEADS) - 1))
    for errors in comparison.measure(tuple(given.samples)):
        print(errors, flush=True)
    if given.pictures is not None:
        picture(given.pictures / f"light_{scene.name}.png", comparison.baked[0], comparison.reference[0])


def simulate(scene: Scene, camera: Camera, given: argparse.Namespace) -> None:
    """The camera's whole path, at the default preset or as sequences are counted."""
    start = time.perf_counter()
    coarse: dict[str, Any] = {
        "sampling": MaxDisplacement(COARSE_PX),
        "rays_per_pixel": COARSE_SAMPLES,
        "frame_rate_hz": 0,
        "depth_rate_hz": 0,
    }
    simulator = Simulator(replace(scene, camera=camera), bake_error=given.error, **(coarse if given.coarse else {}))
    made = time.perf_counter() - start
    start, events = time.perf_counter(), 0
    for packet in simulator.run():
        events += len(packet.events)
    seconds, simulated = time.perf_counter() - start, scene.path.duration_s
    print(
        f"{scene.name}, {camera.width} x {camera.height}: {made:.3g} s to load and bake; {events:,} events of "
        f"{simulated:g} s in {seconds:.3g} s: {seconds / simulated:.3g} s for a simulated second"
    )


def picture(file: Path, baked: LumaFrames, reference: LumaFrames) -> None:
    """Baked light, the path tracer's, and how much brighter baked light is."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(15, 4), layout="constrained")
    white = float(np.quantile(reference, 0.98))
    shown: Sequence[tuple[str, LumaFrames]] = (("baked light", baked), ("path tracer", reference))
    for axis, (title, luma) in zip(axes, shown, strict=False):
        axis.imshow((luma / white).clip(0, 1) ** (1 / 2.2), cmap="gray", vmin=0, vmax=1)
        axis.set_title(title)
    off = axes[2].imshow(100 * (baked / np.maximum(reference, 1e-6) - 1), cmap="RdBu_r", vmin=-5, vmax=5)
    axes[2].set_title("difference, %")
    figure.colorbar(off, ax=axes[2])
    for axis in axes:
        axis.set_axis_off()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=80)
    pyplot.close(figure)


def _resized(camera: Camera, width: int) -> Camera:
    factor = width / camera.width
    place = ((camera.cx + 0.5) * factor - 0.5, (camera.cy + 0.5) * factor - 0.5)
    return replace(
        camera,
        width=width,
        height=round(camera.height * factor),
        fx=camera.fx * factor,
        fy=camera.fy * factor,
        cx=place[0],
        cy=place[1],
    )


if __name__ == "__main__":
    main()
