"""Counts the events that are wrong next to Mitsuba's path tracer, on any worlds.

    python benches/worlds_events.py WORLD ... [--samples 1024] [--width 96] [--frames 40] [--events 2.5] [--rays 32 128]
        [--renderers auto] [--error 0.03] [--kept FOLDER] [--pictures FILE]

A world is a Mitsuba, glTF, OBJ or PLY file. The camera follows the beginning of its path, until a pixel has made as
many events as --events says, on average; without a path it slides to the right. Every renderer renders the same
instants, and the same engine makes events of them, at C = 0.15, with log luma linear between them. So nothing but luma
is compared. The backs of surfaces that have one side are shown, because Mitsuba shows them. Events are matched as in
docs/accuracy.md: by pixel, polarity and time, at most the time of one pixel of the fastest surface apart. Wrong are
those without a partner, missing and spurious, in per cent of the reference's.

The reference is the mean of two halves. Each half takes --samples random paths a pixel, in four runs. A row says how
many events of one half are wrong against the other: the noise of a reference of so many samples. Renderers are judged
against the mean, which has half of that noise. "Net" is without it, because wrong events grow as the error of log luma
does: the root of the difference of squares. "Sure" pixels are those where the standard error of the mean is below
0.1 C, from the scatter of the eight runs. References are kept in a folder if one is named. With --pictures, a file has
a row for each world: its luma, and by how many the events of each pixel differ (white: 3).
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from labelled_sheet import labelled_sheet
from path_tracer import PIXELS, C, at_width, shown, with_paths, world_name
from PIL import Image

import davis_rs
from davis_rs import CrossingEngine, compare_events
from davis_rs._util.whole_file import whole_file
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.motions import slider
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.estimators import LINES
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.truth.scene_surfaces import SceneSurfaces
from davis_rs.sampling.displacement import DisplacementClock

LOG_EPS = 1e-3
RUNS = 4
"""Of each half of the reference."""

SURE = 0.1 * C
"""The reference's largest standard error of log luma, over the instants, in pixels that count as sure."""

SHORTEST_PX, LONGEST_PX = 1.0, 64.0
"""Of the path of the fastest pixel."""

HEADS = ("world", "luma of", "events a pixel", "wrong %", "net %", "sure pixels", "wrong %", "net %", "rms / C", "ms")


@dataclass(frozen=True)
class Span:
    """Holds the instants that are compared, in seconds, and how far apart events may be that count as the same."""

    instants: npt.NDArray[np.float64]
    window_us: int

    def events(self, luma: LumaFrames) -> EventArray:
        """Return the events of luma at the instants."""
        engine = CrossingEngine(luma.shape[2], luma.shape[1], contrast_threshold=C, log_eps=LOG_EPS)
        stamps = np.round(self.instants * 1e6).astype(np.int64)
        return concatenate_events([engine.push(int(t), frame) for t, frame in zip(stamps, luma, strict=True)])


def moving(scene: davis_rs.Scene, camera: Camera) -> davis_rs.Scene:
    """Return a scene with a camera path; one without slides as far as what it looks at is away."""
    if scene.trajectory is not None:
        return scene
    start = davis_rs.start_pose(scene)
    depth = make_renderer(scene, camera, rays_per_pixel=1).depth(Views.at_rest([start]))
    away_m = float(np.median(depth[np.isfinite(depth)]))
    return scene.with_trajectory(slider(start, away_m, away_m))


def surface_window_us(surfaces: SceneSurfaces, views: Views) -> int:
    """Return the time that the fastest surface takes for a pixel, on average over some views."""
    flows = (surfaces.frame(views, number).flow for number in range(len(views)))
    speeds = [float(np.linalg.norm(flow[np.isfinite(flow[:, 0])], axis=1).max(initial=0.0)) for flow in flows]
    return max(1, round(1e6 / max(float(np.mean(speeds)), 1e-6)))


def span_of(scene: davis_rs.Scene, renderer: Renderer, frames: int, wanted: float) -> Span:
    """Return the beginning of a path in which a pixel makes so many events on average, or the longest one."""
    path, pixels = scene.path, renderer.camera.width * renderer.camera.height
    clock = DisplacementClock(renderer, path, round(path.duration_s * 1e6))
    surfaces = SceneSurfaces(scene, renderer.camera)
    length_px = SHORTEST_PX
    while True:
        reached_us = clock.time_at(length_px)
        end_us = round(path.duration_s * 1e6) if reached_us is None else reached_us
        if clock.path_at(end_us) <= 0:
            raise SystemExit(f"{scene.name}: nothing moves, so there are no events to count")
        instants = np.linspace(0.0, end_us * 1e-6, frames)
        views = Views.along(path, instants)
        span = Span(instants, surface_window_us(surfaces, views))
        if reached_us is None or 1.5 * length_px > LONGEST_PX:
            return span
        if len(span.events(renderer.luma(views))) >= wanted * pixels:
            return span
        length_px *= 1.5


def reference(scene: davis_rs.Scene, camera: Camera, span: Span, samples: int, kept: Path | None) -> LumaFrames:
    """Return luma (runs, instants, h, w) of the path tracer; the runs of one half come first."""
    views, runs = Views.along(scene.path, span.instants), list[LumaFrames]()
    for seed in range(2 * RUNS):
        file = kept and kept.with_name(f"{kept.name}_{seed}.npy")
        if file is not None and file.exists():
            runs.append(np.load(file))
            continue
        tracer = make_renderer(
            scene, camera, kind="integrator", rays_per_pixel=max(1, samples // RUNS), seed=seed, blur=False
        )
        runs.append(tracer.luma(views))
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(file) as working:
                np.save(working, runs[-1])
    return np.array(runs)


class Judge:
    """Judges luma by its events against the reference's, in all pixels and in those where the reference is sure."""

    def __init__(self, span: Span, runs: LumaFrames) -> None:
        self.span = span
        self.halves = runs[:RUNS].mean(0), runs[RUNS:].mean(0)
        self.mean = runs.mean(0)
        error = runs.std(0, ddof=1) / np.sqrt(len(runs)) / (self.mean + LOG_EPS)
        self.sure = np.sqrt(np.mean(error**2, axis=0)) < SURE
        self.noise = self._wrong(*self.halves)

    def row(self, world: str, what: str, luma: LumaFrames | None, ms: float | None) -> str:
        """Return a row of the table under :data:`HEADS`; without luma, of one half against the other."""
        own, other = self.halves if luma is None else (luma, self.mean)
        wrong = self._wrong(own, other)
        net = [
            "" if luma is None else f"{np.sqrt(max(share**2 - (noise / 2) ** 2, 0.0)):.1f}"
            for share, noise in zip(wrong, self.noise, strict=True)
        ]
        off = (np.log(own + LOG_EPS) - np.log(other + LOG_EPS))[:, self.sure]
        cells = [
            world,
            what,
            f"{len(self.span.events(other)) / self.sure.size:.1f}",
            f"{wrong[0]:.1f}",
            net[0],
            f"{self.sure.mean():.0%}",
            f"{wrong[1]:.1f}",
            net[1],
            f"{np.sqrt(np.mean(off**2)) / C:.2f}",
            "" if ms is None else f"{ms:.0f}",
        ]
        return f"| {' | '.join(cells)} |"

    def picture(self, luma: LumaFrames | None) -> Image.Image:
        """Return by how many the events of each pixel differ; without luma, of one half from the other."""
        own, other = (self._counts(frames) for frames in (self.halves if luma is None else (luma, self.mean)))
        return shown(np.abs(own - other).sum(0).astype(np.float64), 3.0)

    def _wrong(self, luma: LumaFrames, other: LumaFrames) -> tuple[float, float]:
        """Return missing and spurious events in per cent of the other's, in all pixels and in the sure ones."""
        height, width = self.sure.shape
        streams = [self.span.events(frames) for frames in (luma, other)]
        sure = [events[self.sure[events["y"], events["x"]]] for events in streams]
        of_all, of_sure = (
            compare_events(*pair, size=(width, height), window_us=self.span.window_us) for pair in (streams, sure)
        )
        return of_all.missing_percent + of_all.spurious_percent, of_sure.missing_percent + of_sure.spurious_percent

    def _counts(self, luma: LumaFrames) -> npt.NDArray[np.int64]:
        """Return how many OFF and ON events each pixel has (2, h, w)."""
        events, shape = self.span.events(luma), (2, *self.sure.shape)
        place = np.ravel_multi_index((events["p"], events["y"], events["x"]), shape)
        return np.bincount(place, minlength=int(np.prod(shape))).reshape(shape)


def judge_world(file: Path, given: argparse.Namespace) -> dict[str, Image.Image]:
    """Print the rows of a world, and return its pictures."""
    scene = replace(davis_rs.load_scene(file), one_sided=())
    camera, name = at_width(scene.own_camera, given.width, 1.0), world_name(file)
    scene = moving(scene, camera)
    renderers = {
        (kind, rays): make_renderer(
            scene,
            camera,
            kind=kind,
            rays_per_pixel=rays or None,
            **PIXELS,
            bake_error=given.error,
            blur=False,
        )
        for kind in given.renderers
        for rays in given.rays
    }
    span = span_of(scene, next(iter(renderers.values())), given.frames, given.events)
    end_us = round(span.instants[-1] * 1e6)
    kept = given.kept and given.kept / f"{name}_{given.width}_{given.frames}_{end_us}_{given.samples}"
    judge = Judge(span, reference(with_paths(scene), camera, span, given.samples, kept))
    print(judge.row(name, f"{given.samples:,} paths, twice", None, None), flush=True)
    white = float(np.quantile(judge.mean, 0.98))
    pictures = {"path tracer": shown(judge.mean[0], white), "its halves": judge.picture(None)}
    for (kind, _), renderer in renderers.items():
        start = time.process_time()
        luma = renderer.luma(Views.along(scene.path, span.instants))
        ms = 1e3 * (time.process_time() - start) / given.frames
        light = "baked" if isinstance(renderer, NativeRenderer) and renderer.baked else renderer.name
        lines = renderer.pixel == "lines"
        pixel = f"{LINES[renderer.rays_per_pixel]} lines" if lines else f"{renderer.rays_per_pixel} rays"
        what = f"{kind} ({light}), {pixel}"
        print(judge.row(name, what, luma, ms), flush=True)
        pictures[what] = judge.picture(luma)
    return pictures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", type=Path, nargs="+", metavar="WORLD")
    parser.add_argument("--samples", type=int, default=1024, help="of each half of the reference (if not given: 1024)")
    parser.add_argument("--width", type=int, default=96, help="pixels of a row (if not given: 96)")
    parser.add_argument("--frames", type=int, default=40, help="instants (if not given: 40)")
    parser.add_argument("--events", type=float, default=2.5, help="a pixel, on average (if not given: 2.5)")
    parser.add_argument(
        "--rays", type=int, nargs="+", default=[0], help="a pixel, one row each; 0 (if not given): as balanced has it"
    )
    parser.add_argument("--error", type=float, default=0.03, help="of baked light (if not given: 0.03)")
    parser.add_argument("--renderers", nargs="+", default=["auto"], help="one row each (if not given: auto)")
    parser.add_argument("--kept", type=Path, help="folder for references, which are used again")
    parser.add_argument("--pictures", type=Path, help="file for pictures")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print(f"| {' | '.join(HEADS)} |\n|---|---|{'---:|' * (len(HEADS) - 2)}", flush=True)
    rows = {world_name(file): judge_world(file, given) for file in given.worlds}
    if given.pictures is not None:
        given.pictures.parent.mkdir(parents=True, exist_ok=True)
        labelled_sheet(rows).save(given.pictures, optimize=True)


if __name__ == "__main__":
    main()
