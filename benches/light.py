"""Baked light against Mitsuba's path tracer: python benches/light.py [box room yard] [--pictures FOLDER]

For each scene: how long the bake takes, and on a few instants of the first part of the camera's path how the events
of baked light, and of the path tracer at several numbers of samples, differ from those of the reference: the mean luma
of independent runs of the path tracer with 1,024 samples each. All see the same instants, between which log luma is
linear, so that nothing but light is compared. Two halves of the reference, compared with each other, say how far it can
be trusted. Needs LLVM. A table of docs/light.md.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from light_scenes import SCENES

from davis_rs import Camera, CrossingEngine, Scene, compare_events
from davis_rs.events import EventArray, concatenate_events
from davis_rs.luma import LumaFrames
from davis_rs.rendering.render import Renderer
from davis_rs.rendering.renderers import make_renderer
from davis_rs.trajectory.views import Views

WINDOW_US = 5000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["box"], choices=SCENES)
    parser.add_argument("--errors", type=float, nargs="+", default=[0.01], help="of baked light")
    parser.add_argument("--runs", type=int, default=4, help="of the reference, an even number")
    parser.add_argument("--reference-samples", type=int, default=1024)
    parser.add_argument("--samples", type=int, nargs="*", default=[64, 256], help="of the path tracer that is compared")
    parser.add_argument("--rays", type=int, default=256, help="of the native renderer a pixel")
    parser.add_argument("--instants", type=int, default=5)
    parser.add_argument("--duration", type=float, default=0.02, help="seconds of the camera's path")
    parser.add_argument("--width", type=int, help="of the image; the lens sees the same")
    parser.add_argument("--pictures", type=Path, help="where pictures are written to")
    given = parser.parse_args()
    # A bake that comes from the cache has no time that could be told.
    with tempfile.TemporaryDirectory() as folder:
        os.environ["DAVIS_RS_CACHE_DIR"] = folder
        for name in given.scenes:
            measure(SCENES[name](), given)


def measure(scene: Scene, given: argparse.Namespace) -> None:
    camera = scene.own_camera if given.width is None else _resized(scene.own_camera, given.width)
    views = Views.along(scene.path, np.linspace(0.0, given.duration, given.instants))
    size = f"{camera.width} x {camera.height}"
    print(f"\n## {scene.name}, {size}, {given.instants} instants of {given.duration} s, C = 0.15\n")
    runs = []
    for seed in range(given.runs):
        tracer = make_renderer(scene, camera, kind="integrator", samples=given.reference_samples, seed=1000 + seed)
        runs.append(tracer.luma(views))
    reference = np.mean(runs, axis=0, dtype=np.float32)
    events = events_of(reference, camera, given.duration)
    half = len(runs) // 2
    print("| light | bake s | ms a frame | events | median us | p99 us | missing + spurious % | rms log luma / C |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    halves = [np.mean(part, axis=0, dtype=np.float32) for part in (runs[:half], runs[half:])]
    what = f"reference: {given.runs} runs of {given.reference_samples} samples"
    row(
        f"{what}; its halves compared",
        None,
        None,
        halves[0],
        halves[1],
        events_of(halves[1], camera, given.duration),
        camera,
        given.duration,
    )
    for samples in given.samples:
        tracer = make_renderer(scene, camera, kind="integrator", samples=samples, seed=0)
        luma, ms = timed(tracer, views)
        row(f"path tracer, {samples} samples", None, ms, luma, reference, events, camera, given.duration)
    pictured = None
    for error in given.errors:
        start = time.perf_counter()
        baked = make_renderer(scene, camera, kind="baked", samples=given.rays, bake_error=error)
        seconds = time.perf_counter() - start
        pictured, ms = timed(baked, views)
        row(
            f"baked, error {error:g}, {given.rays} rays",
            seconds,
            ms,
            pictured,
            reference,
            events,
            camera,
            given.duration,
        )
        print(f"<!-- {baked.reason} -->")
    if given.pictures is not None and pictured is not None:
        picture(given.pictures / f"light_{scene.name}.png", pictured[0], reference[0])


def row(
    what: str,
    bake_s: float | None,
    ms: float | None,
    luma: LumaFrames,
    other: LumaFrames,
    events: EventArray,
    camera: Camera,
    duration_s: float,
) -> None:
    """A line of the table: luma against the reference's luma and events."""
    own = events_of(luma, camera, duration_s)
    found = compare_events(own, events, size=(camera.width, camera.height), window_us=WINDOW_US)
    wrong = found.missing_percent + found.spurious_percent
    log_rms = float(np.sqrt(np.mean((np.log(luma + 1e-3) - np.log(other + 1e-3)) ** 2))) / 0.15
    cost = ["" if value is None else f"{value:.3g}" for value in (bake_s, ms)]
    print(
        f"| {what} | {' | '.join(cost)} | {len(own):,} | {found.median_us:.0f} | {found.p99_us:.0f} | {wrong:.1f} "
        f"| {log_rms:.3f} |",
        flush=True,
    )


def events_of(luma: LumaFrames, camera: Camera, duration_s: float) -> EventArray:
    """Events of frames over the judged time, log luma being linear between them."""
    engine = CrossingEngine(camera.width, camera.height)
    stamps = np.linspace(0, duration_s * 1e6, len(luma)).astype(np.int64)
    return concatenate_events([engine.push(int(t_us), frame) for t_us, frame in zip(stamps, luma, strict=True)])


def timed(renderer: Renderer, views: Views) -> tuple[LumaFrames, float]:
    """Luma, and the least milliseconds a frame of three tries, one where they are long."""
    luma, least = renderer.luma(views[:1]), np.inf
    for _ in range(3):
        start = time.perf_counter()
        luma = renderer.luma(views)
        seconds = time.perf_counter() - start
        least = min(least, 1000 * seconds / len(views))
        if seconds > 10:
            break
    return luma, least


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
