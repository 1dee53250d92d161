"""The native renderer and `mi.render` on meshes, and what it takes to make them ready: python benches/render_meshes.py

A ball of 10^4 to 10^6 triangles under a lamp, 240 x 180, on one thread, each size in a process of its own: the least
processor time of a frame, in turns, of `mi.render` (8 samples of the direct light), and of the native renderer by 8
rays, 32 rays and 8 lines a pixel; the seconds that Mitsuba, the tables and the core take to make the scene ready, and
the most memory by then. Needs LLVM.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from itertools import pairwise

import drjit as dr
import numpy as np
from render_native import measure, mesh

from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.scene_tables.scene_table import SceneTable

TRIANGLES = (10_000, 100_000, 1_000_000)
RAYS = 8
VIEWS = 4


def row(triangles: int) -> None:
    """Print the row of one size."""
    scene = mesh(triangles)
    camera = scene.own_camera
    times = [time.perf_counter()]
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        times.append(time.perf_counter())
        motion = scene_motion(scene, loaded, mi)
        table = SceneTable(loaded, mi, shadows=scene.shadows, any_integrator=False)
        times.append(time.perf_counter())
    native = NativeRenderer(table, camera, rays_per_pixel=RAYS, blur=False, motion=motion, threads=1)
    times.append(time.perf_counter())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    # 8 lines a pixel are named by the 32 rays that they replace.
    rays, lines = (
        NativeRenderer(table, camera, rays_per_pixel=32, pixel=pixel, blur=False, motion=motion, threads=1)
        for pixel in ("rays", "lines")
    )
    views = Views.along(scene.path, 0.3 + 1e-3 * np.arange(VIEWS))
    with variant(FAST) as (mi, _):
        dr.set_thread_count(1)
        loaded = load_scene_source(scene.source(), mi)
        middle = scene.path.pose(0.3).position
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": float(2 * np.degrees(np.arctan(0.5 * camera.width / camera.fx))),
                "to_world": mi.ScalarTransform4f().look_at(
                    origin=list(middle), target=[middle[0], middle[1], 0.0], up=[0.0, 1.0, 0.0]
                ),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "rfilter": {"type": "box"},
                },
            }
        )
        integrator = mi.load_dict({"type": "direct"})

        def render() -> None:
            dr.eval(mi.render(loaded, sensor=sensor, integrator=integrator, spp=RAYS))
            dr.sync_thread()

        ways = {
            "mitsuba": render,
            "native": lambda: native.luma(views),
            "rays": lambda: rays.luma(views),
            "lines": lambda: lines.luma(views),
        }
        least = {name: processor for name, (_, processor) in measure(ways).items()}
    theirs = least["mitsuba"]
    ours, by_rays, by_lines = (least[name] / VIEWS for name in ("native", "rays", "lines"))
    ready = " / ".join(f"{after - before:.1f}" for before, after in pairwise(times))
    print(
        f"| {triangles:,} | {theirs:.1f} | {ours:.1f} | {theirs / ours:.2f} | {by_rays:.1f} | {by_lines:.1f} |"
        f" {ready} | {memory:.0f} |",
        flush=True,
    )


def main() -> None:
    if len(sys.argv) > 1:
        row(int(sys.argv[1]))
        return
    print(
        "| triangles | `mi.render`, ms | native, ms: 8 rays | ratio | 32 rays | 8 lines |"
        " ready, s: Mitsuba / tables / core | MB |"
    )
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for triangles in TRIANGLES:
        subprocess.run([sys.executable, __file__, str(triangles)], check=True)


if __name__ == "__main__":
    main()
