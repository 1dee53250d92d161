"""The preset exact against brute force at each microsecond: python benches/exact.py [SCENE ...]

Brute force renders the same rays at every microsecond, so that no jump or dip is too short for it. It is affordable for
a few milliseconds, half way of each scene's path, of the middle of the image. Wires are 0.3, 0.45 and 1 px thick.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import davis_rs
from davis_rs import Scene, Simulator, compare_events
from davis_rs.accuracy.accuracy_sweep import half_way_s
from davis_rs.accuracy.brute_force import dense_probe
from davis_rs.accuracy.hard_case_scenes import sideways, wires
from davis_rs.events.arrays import concatenate_events
from davis_rs.render.choice import make_renderer

SECONDS, WIDTH, HEIGHT = 0.003, 160, 120
WINDOW_US = 2_000
SCENES = ["three_planes", "three_walls", "fence", "office_zigzag", "outdoors_walking", "urban"]
SCENES += ["wires", "wires without shadows"]


def scene_of(name: str) -> Scene:
    """A part of a scene's path, seen by the middle of its camera."""
    if name.startswith("wires"):
        return wires(sideways(2 * SECONDS, 1.0), shadows=name == "wires")
    scene = davis_rs.load_scene(name)
    camera = scene.own_camera
    left, top = (camera.width - WIDTH) // 2, (camera.height - HEIGHT) // 2
    middle = replace(camera, width=WIDTH, height=HEIGHT, cx=camera.cx - left, cy=camera.cy - top)
    start_s = half_way_s(make_renderer(scene, camera, rays_per_pixel=1), scene.path)
    return replace(scene, camera=middle).crop(start_s, SECONDS)


def row(name: str) -> str:
    scene = scene_of(name)
    simulator = Simulator(scene, accuracy="exact", frame_rate_hz=0, depth_rate_hz=0)
    started = time.process_time()
    events = concatenate_events([packet.events for packet in simulator.run()])
    seconds = time.process_time() - started
    truth = dense_probe(
        simulator.renderer,
        scene.path,
        step_us=1,
        contrast_threshold=scene.contrast_threshold,
        log_eps=simulator.log_eps,
    ).events
    size = (scene.own_camera.width, scene.own_camera.height)
    found = compare_events(events, truth, size=size, window_us=WINDOW_US)
    cells = [
        name,
        f"{len(truth):,}",
        f"{found.missing_percent:.3f} + {found.spurious_percent:.3f}",
        f"{found.median_us:.0f}",
        f"{found.p99_us:.0f}",
        f"{seconds:.2g}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help=f"of {', '.join(SCENES)}, or others")
    print("| scene | events | missing + spurious (%) | median (us) | p99 (us) | processor time (s) |")
    print("|---|---:|---:|---:|---:|---:|")
    for name in parser.parse_args().scenes:
        print(row(name), flush=True)


if __name__ == "__main__":
    main()
