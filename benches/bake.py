"""Processor time of baking light: python benches/bake.py [box office room yard] [--error 0.01] [--repeat 3]

For each scene of benches/light_scenes.py: processor seconds and wall time of the bake (the least of several runs,
without the cache), at how many points light was computed, from how many samples of lamps and of bounces, the error that
is told, and the most memory. Needs no LLVM.
"""

from __future__ import annotations

import argparse
import os
import resource
import time

from light_scenes import SCENES

from davis_rs.render.baked import baked_scene
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["box"], choices=SCENES)
    parser.add_argument("--error", type=float, default=0.01, help="of baked light")
    parser.add_argument("--repeat", type=int, default=1)
    given = parser.parse_args()
    os.environ["DAVIS_RS_CACHE_DIR"] = ""  # a bake that comes from the cache takes no time
    print("| scene | error asked for | told | points | samples: lamps, bounces | processor s | wall s | MB |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for name in given.scenes:
        scene = SCENES[name]()
        taken = []
        for _ in range(given.repeat):
            baked_scene._known.clear()
            start = time.process_time(), time.perf_counter()
            renderer = make_renderer(
                scene, scene.own_camera, kind="baked", bake_error=given.error, lattice_rays_per_pixel=8
            )
            taken.append((time.process_time() - start[0], time.perf_counter() - start[1]))
        assert isinstance(renderer, NativeRenderer)
        assert renderer.baked is not None
        maps = renderer.baked.maps
        processor_s, wall_s = min(taken)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        samples = ", ".join(map(str, maps.samples))
        print(
            f"| {name} | {given.error:g} | {maps.error:.2g} | {maps.points:,} | {samples} | {processor_s:.3g} | "
            f"{wall_s:.3g} | {memory} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
