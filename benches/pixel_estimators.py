"""What a pixel's luma costs and errs, by rays and by lines: python benches/pixel_estimators.py [SCENE ...]

Each scene is seen at 240 x 180 without distortion; with --distortion by a DAVIS240C's lens. Frames follow each other so
that the fastest pixels move by 0.1 px. Processor time is the least of some rounds in which the estimators take turns,
on one thread. Errors are those against 1,024 rays a pixel: of log luma, in units of C, and of events. These come from
the crossing engine, along lines between the frames; events match within half a pixel's motion. Jumps are pixels whose
log luma has a second difference above 0.05 C while the camera moves by 0.005 px a step.

With --edges: an edge of contrast 5:1 at many angles, also that of the lines, moves in steps of 0.005 px; the largest
change of log luma in one step, in C, next to that of the edge's own motion.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

import davis_rs
from davis_rs import Camera, Pose, Scene, SegmentTrajectory
from davis_rs._core import CrossingEngine, log_intensity
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.matching import compare_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.scene import meshes
from davis_rs.scene.sequences import SEQUENCES
from davis_rs.scene.textures import patchwork

sys.path.insert(0, str(Path(__file__).parent))
from accuracy_workshop import workshop

C, LOG_EPS = 0.15, 1e-3
STEP_PX, FRAMES = 0.1, 21
JUMP_PX, JUMP_FRAMES, JUMP_C = 0.005, 24, 0.05
TIMED, ROUNDS = 4, 5
"""How many frames are timed together, and how many times at least."""

TICKS = 10_000
"""From one frame to the next, for the crossing engine."""

ESTIMATORS = [("32 rays", "rays", 32), ("8 lines", "lines", 32), ("377 rays", "rays", 377), ("16 lines", "lines", 64)]
"""Their names, what a pixel's luma is made of, and how many rays it has or stands for."""

REFERENCE = 1024

Luma = npt.NDArray[np.float32]


def texture(seed: int) -> npt.NDArray[np.float32]:
    return patchwork(256, seed, low=0.1, high=0.9, grain=0.3, shapes=120, tint=(1.0, 1.0, 1.0))


def before_a_wall(name: str, things: meshes.Mesh, reflectance: object, *, shadows: bool) -> Scene:
    """A mesh before a textured wall under one lamp; the camera moves along it and turns a little."""
    wall = meshes.quad([-3.0, 3.2, -2.4], [6.0, 0.0, 0.0], [0.0, 0.0, 4.8])

    def source() -> dict[str, object]:
        return {
            "type": "scene",
            "integrator": {"type": "direct"},
            "lamp": {"type": "point", "position": [0.9, -0.6, 1.1], "intensity": 30.0},
            "wall": meshes.shape(wall, texture(11)),
            "things": meshes.shape(things, reflectance),
        }

    level = np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # looks along y, z is up
    turned = np.array([-np.sqrt(0.5), 0.02, 0.015, np.sqrt(0.5)])
    path = SegmentTrajectory(Pose([0.0, 0.0, 0.0], level), Pose([0.4, 0.0, 0.13], turned / np.linalg.norm(turned)), 1.0)
    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    return Scene(name, source, camera=camera, trajectory=path, shadows=shadows)


def wires() -> Scene:
    """60 dark wires, 0.3 px wide, at any angle, and their shadows; some lie along rows or columns."""
    rng = np.random.default_rng(60)

    def wire(number: int) -> meshes.Mesh:
        depth, angle = 1.8 + 0.4 * rng.random(), np.pi * rng.random()
        angle = [0.0, np.pi / 2, angle, angle, angle, angle][number % 6]
        x, z = 2.6 * (rng.random() - 0.5), 2.0 * (rng.random() - 0.5)
        along = 1.4 * np.array([np.cos(angle), 0.0, np.sin(angle)])
        across = 0.3 * depth / 200.0 * np.array([-np.sin(angle), 0.0, np.cos(angle)])
        return meshes.quad(np.array([x, depth, z]) - along / 2, along, across)

    return before_a_wall("wires", meshes.merged(map(wire, range(60))), 0.05, shadows=True)


def foliage() -> Scene:
    """10,000 leaves some pixels wide, each in its own grey, without shadows."""
    rng = np.random.default_rng(5)
    count = 10_000
    depth = 1.6 + 0.8 * rng.random(count)
    middles = np.stack([1.3 * (rng.random(count) - 0.5) * depth, depth, 1.0 * (rng.random(count) - 0.5) * depth], -1)
    size = 5.2 * depth / 200.0
    vertices = middles[:, None] + size[:, None, None] * (rng.random((count, 3, 3)) - 0.5)
    uv = np.repeat(rng.random((count, 1, 2)), 3, axis=1)
    leaves = meshes.Mesh(vertices.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), uv.reshape(-1, 2))
    return before_a_wall("foliage", leaves, texture(6), shadows=False)


BUILT: dict[str, Callable[[], Scene]] = {"wires": wires, "foliage": foliage, "workshop": workshop}
SCENES = ["three_planes", "fence", "office_zigzag", "outdoors_walking", "workshop", "wires", "foliage"]


def scene_of(name: str, *, distortion: bool) -> Scene:
    """The scene, seen by a camera of 240 x 180 pixels, without distortion or with a DAVIS240C's."""
    if name in BUILT:
        scene = BUILT[name]()
    else:
        scene = SEQUENCES[name].scene() if name in SEQUENCES else davis_rs.load_scene(name)
    if distortion:
        return replace(scene, camera=davis_rs.load_camera("davis240c"))
    camera = replace(scene.own_camera, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
    return replace(scene, camera=camera)


def edge(degrees: float) -> Scene:
    """A half plane before one that is five times as bright, and a camera that moves across its edge by one pixel."""
    turn = np.radians(degrees)
    along, across = np.array([np.cos(turn), 0.0, np.sin(turn)]), np.array([-np.sin(turn), 0.0, np.cos(turn)])

    def source() -> dict[str, object]:
        return {
            "type": "scene",
            "integrator": {"type": "direct"},
            "light": {"type": "constant", "radiance": 1.0},
            "wall": meshes.shape(meshes.quad([-9.0, 2.0, -9.0], [18.0, 0.0, 0.0], [0.0, 0.0, 18.0]), 0.8),
            "half": meshes.shape(meshes.quad(np.array([0.013, 1.0, 0.007]) - 4 * along, 8 * along, 8 * across), 0.16),
        }

    level = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    path = SegmentTrajectory(Pose([0.0, 0.0, 0.0], level), Pose(across / 100.0, level), 1.0)
    camera = Camera(48, 40, 100.0, 100.0, 23.5, 19.5)
    return Scene("edge", source, camera=camera, trajectory=path, shadows=False)


def print_edges() -> None:
    """Print a table of the largest changes of luma while an edge moves, by its angle."""
    print("| angle, degrees | " + " | ".join(f"{name}, C" for name, _, _ in ESTIMATORS) + " | the edge's motion, C |")
    print("|---|" + "---|" * (len(ESTIMATORS) + 1))
    parallel = [float(np.degrees(np.arctan(rise))) for rise in (-3 / 8, -3 / 16)]
    for degrees in sorted([*np.arange(0.0, 180.0, 7.5).tolist(), 5.0, 9.9, 19.9, *parallel]):
        scene, steps = edge(degrees), round(1 / JUMP_PX)
        views = Views.along(scene.path, np.linspace(0.0, 1.0, steps + 1))
        row = [f"{degrees:.2f}"]
        for _, pixel, rays in ESTIMATORS:
            renderer = make_renderer(
                scene, scene.own_camera, rays_per_pixel=rays, pixel=pixel, blur=False, kind="native", threads=1
            )
            row.append(f"{np.abs(np.diff(log_of(renderer.luma(views)), axis=0)).max() / C:.2f}")
        # From dark to bright the edge covers at most sqrt(2) of a pixel's side, where luma is least.
        print("| " + " | ".join([*row, f"{np.log1p(4 * np.sqrt(2) * JUMP_PX) / C:.2f}"]) + " |", flush=True)


@dataclass
class Case:
    """A scene with its estimators."""

    name: str
    distortion: bool

    def __post_init__(self) -> None:
        self.scene = scene_of(self.name, distortion=self.distortion)
        self.renderers = {name: self.renderer(rays, pixel) for name, pixel, rays in ESTIMATORS}
        start = Views.along(self.scene.path, np.array([0.4 * self.scene.path.duration_s]))
        flow = np.linalg.norm(self.renderers["32 rays"].flow(start), axis=-1)
        self.px_per_s = float(np.nanquantile(flow, 0.99))

    def renderer(self, rays: int, pixel: str) -> Renderer:
        return make_renderer(
            self.scene, self.scene.own_camera, rays_per_pixel=rays, pixel=pixel, blur=False, kind="native", threads=1
        )

    def views(self, count: int, step_px: float) -> Views:
        times = 0.4 * self.scene.path.duration_s + step_px / self.px_per_s * np.arange(count)
        return Views.along(self.scene.path, times)

    def milliseconds(self, rounds: int) -> dict[str, float]:
        """The least processor time of a frame by each estimator; they take turns."""
        views = self.views(TIMED, STEP_PX)
        least = dict.fromkeys(self.renderers, np.inf)
        for _ in range(rounds):
            for name, renderer in self.renderers.items():
                began = time.process_time()
                renderer.luma(views)
                least[name] = min(least[name], 1e3 * (time.process_time() - began) / TIMED)
        return least

    def errors(self) -> dict[str, list[float]]:
        """The rms error of log luma in C, and missing and spurious events in per cent, of each estimator."""
        views = self.views(FRAMES, STEP_PX)
        reference = self.renderer(REFERENCE, "rays")
        truth = np.concatenate([reference.luma(views[i : i + 1]) for i in range(FRAMES)])
        events, size = events_of(truth), (self.scene.own_camera.width, self.scene.own_camera.height)
        errors = {}
        for name, renderer in self.renderers.items():
            luma = renderer.luma(views)
            window = round(0.5 / STEP_PX) * TICKS
            compared = compare_events(events_of(luma), events, size=size, window_us=window)
            rms = float(np.sqrt(np.mean((log_of(luma) - log_of(truth)) ** 2))) / C
            errors[name] = [rms, compared.missing_percent + compared.spurious_percent]
        return errors

    def jumps(self) -> dict[str, float]:
        """Of each estimator the pixels in per cent that jump."""
        views = self.views(JUMP_FRAMES, JUMP_PX)

        def jumping(renderer: Renderer) -> float:
            return 100 * float((np.abs(np.diff(log_of(renderer.luma(views)), 2, axis=0)).max(0) > JUMP_C * C).mean())

        return {name: jumping(renderer) for name, renderer in self.renderers.items()}


def log_of(luma: Luma) -> npt.NDArray[np.float64]:
    return np.log(luma.astype(np.float64) + LOG_EPS)


def events_of(luma: Luma) -> EventArray:
    engine = CrossingEngine(luma.shape[2], luma.shape[1], contrast_threshold=C, log_eps=LOG_EPS)
    packets = [engine.push_log(TICKS * number, log_intensity(frame, LOG_EPS)) for number, frame in enumerate(luma)]
    return concatenate_events(packets)


def main() -> None:
    parser = argparse.ArgumentParser(description="what a pixel's luma costs and errs, by rays and by lines")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="rounds of timing")
    parser.add_argument("--time-only", action="store_true", help="leave out errors and jumps")
    parser.add_argument("--distortion", action="store_true", help="scenes behind a DAVIS240C's lens")
    parser.add_argument("--edges", action="store_true", help="only an edge at many angles")
    chosen = parser.parse_args()
    if chosen.edges:
        print_edges()
        return
    if unknown := [name for name in chosen.scenes if name not in SCENES]:
        parser.error(f"no such scene: {', '.join(unknown)}; there are {', '.join(SCENES)}")
    print("| scene | estimator | ms a frame | 32 rays = 1 | rms of log luma, C | missing + spurious, % | jumps, % |")
    print("|---|---|---|---|---|---|---|")
    for name in chosen.scenes or SCENES:
        case = Case(name, chosen.distortion)
        took = case.milliseconds(chosen.rounds)
        errors, jumps = ({}, {}) if chosen.time_only else (case.errors(), case.jumps())
        for estimator in case.renderers:
            row = [name, estimator, f"{took[estimator]:.2f}", f"{took[estimator] / took['32 rays']:.2f}"]
            if not chosen.time_only:
                rms, wrong = errors[estimator]
                row += [f"{rms:.4f}", f"{wrong:.2f}", f"{jumps[estimator]:.3f}"]
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
