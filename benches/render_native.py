"""The native renderer against the table kernel, in one interleaved run: python benches/render_native.py [SCENE ...]

For each scene, 240 x 180, views a millisecond apart, on one thread: the least processor and wall time of a frame out
of several rounds in which the renderers take turns; their ratios hold on a busy machine too. With it one view alone,
the rate and two threads; at last a step of the simulator with a new pose. Needs LLVM for the table kernel.
"mesh of 1,000,000" is rendered where it is asked for.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from functools import partial

import drjit as dr
import numpy as np

import davis_rs
from davis_rs import Scene, Simulator
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.scene import meshes
from davis_rs.scene.meshes import shape
from davis_rs.scene.sequences import SEQUENCES

VIEWS = 16
ROUNDS, ROUNDS_S, MOST_ROUNDS = 3, 6.0, 40
"""At least ROUNDS, then more until ROUNDS_S have passed, so that short work also has an undisturbed round."""

CASES = [
    *((scene, rays) for scene in ("three_planes", "three_walls") for rays in (8, 32)),
    *((scene, 8) for scene in ("boxes_6dof", "office_zigzag", "poster_6dof", "slider_depth")),
    *((scene, 8) for scene in ("outdoors_walking", "urban", "dynamic_6dof", "mesh of 100,000")),
]
ON_REQUEST = [("mesh of 1,000,000", 8)]

Job = Callable[[], object]


def mesh(triangles: int) -> Scene:
    """A ball of about ``triangles`` triangles under a lamp, with shadows."""
    rings = 1 + round((triangles / 2) ** 0.5)

    def source() -> dict[str, object]:
        ball = shape(meshes.ball([0.0, 0.0, 0.0], [0.8, 0.9, 0.6], rings=rings, sides=rings), 0.6)
        lamp = {"type": "point", "position": [0.5, -0.4, 2.0], "intensity": 9.0}
        return {"type": "scene", "integrator": {"type": "direct"}, "ball": ball, "lamp": lamp}

    down = davis_rs.Pose([0.0, 0.0, 1.9], [1.0, 0.0, 0.0, 0.0])
    aside = davis_rs.Pose([0.2, 0.1, 1.8], [1.0, 0.0, 0.0, 0.0])
    return Scene("mesh", source, trajectory=davis_rs.SegmentTrajectory(down, aside, 1.0))


def scene_of(name: str) -> Scene:
    if name.startswith("mesh"):
        return mesh(int(name.split()[-1].replace(",", "")))
    return SEQUENCES[name].scene() if name in SEQUENCES else davis_rs.load_scene(name)


def native(scene: Scene, rays: int, threads: int) -> NativeRenderer:
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
        moving = list(motion.objects)
        table = SceneTable(loaded, mi, shadows=scene.shadows, any_integrator=False, moving=moving)
    return NativeRenderer(table, scene.own_camera, rays_per_pixel=rays, blur=False, motion=motion, threads=threads)


def measure(jobs: dict[str, Job]) -> dict[str, tuple[float, float]]:
    """The least (wall, processor) milliseconds of each job; they take turns, so that a busy machine is busy for all."""
    for job in jobs.values():
        job()  # the first compiles
    least = dict.fromkeys(jobs, (np.inf, np.inf))
    begin = time.perf_counter()
    for count in range(MOST_ROUNDS):
        if count >= ROUNDS and time.perf_counter() - begin > ROUNDS_S:
            break
        for name, job in jobs.items():
            wall, processor = time.perf_counter(), time.process_time()
            job()
            took = (1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processor))
            least[name] = (min(least[name][0], took[0]), min(least[name][1], took[1]))
    return least


def compare(name: str, rays: int) -> None:
    scene = scene_of(name)
    views = Views.along(scene.path, 0.3 + 1e-3 * np.arange(VIEWS))
    kernel, ours, two = (
        make_renderer(scene, scene.own_camera, rays_per_pixel=rays, blur=False, kind="table"),
        native(scene, rays, 1),
        native(scene, rays, 2),
    )
    least = measure(
        {
            "table": partial(kernel.luma, views),
            "native": partial(ours.luma, views),
            "rate": partial(ours.luma_and_rate, views),
            "two": partial(two.luma, views),
            "table, one": partial(kernel.luma, views[:1]),
            "native, one": partial(ours.luma, views[:1]),
        }
    )
    table, frame, rate, both = (least[key] for key in ("table", "native", "rate", "two"))
    alone = [least[f"{kind}, one"] for kind in ("table", "native")]
    row = [
        f"{name}, {rays}",
        f"{table[1] / VIEWS:.2f}",
        f"{frame[1] / VIEWS:.2f}",
        f"{table[1] / frame[1]:.1f}",
        f"{alone[1][0]:.1f}",
        f"{alone[0][1] / alone[1][1]:.1f}",
        f"{rate[1] / frame[1]:.2f}",
        f"{frame[0] / both[0]:.2f}",
    ]
    print("| " + " | ".join(row) + " |", flush=True)


def step_latency(renderer: str, accuracy: str) -> None:
    """A controller's loop: a new pose each millisecond."""
    scene = davis_rs.load_scene("three_planes")
    simulator = Simulator(scene, rays_per_pixel=8, renderer=renderer, accuracy=accuracy)
    poses = [scene.path.pose(0.3 + 1e-3 * i) for i in range(60)]
    walls, processors = [], []
    for i, pose in enumerate(poses):
        wall, processor = time.perf_counter(), time.process_time()
        simulator.step(1000 * i, pose)
        walls.append(1e3 * (time.perf_counter() - wall))
        processors.append(1e3 * (time.process_time() - processor))
    print(
        f"Simulator.step, {renderer}, {accuracy}, three_planes, 8 rays, a pose each millisecond: "
        f"least {min(walls[5:]):.1f} ms, median {np.median(walls[5:]):.1f}, most {max(walls[5:]):.1f}; "
        f"processor time, least {min(processors[5:]):.1f} ms"
    )


def main() -> None:
    with variant(FAST):
        dr.set_thread_count(1)
    wanted = sys.argv[1:]
    heads = ["scene, rays", "table kernel, processor ms a frame", "native", "ratio", "one view alone: native, wall ms"]
    heads += ["ratio of processor time", "with dY/dt / without", "one thread / two, wall"]
    print("| " + " | ".join(heads) + " |")
    print("|---|---|---|---|---|---|---|---|")
    for name, rays in CASES + ON_REQUEST:
        if name in (wanted or dict(CASES)):
            compare(name, rays)
    print()
    for accuracy in ("paper", "balanced"):
        for renderer in ("table", "native"):
            step_latency(renderer, accuracy)
    print(f"most memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
