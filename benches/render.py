"""The table kernel against Mitsuba's own renderer: python benches/render.py

three_planes, 240 x 180, in one process; medians, in milliseconds a frame.
"""

import gc
import statistics
import time
from collections.abc import Callable
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import davis_rs
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer

POSES, REPETITIONS = 64, 7


def mitsuba_render(scene: davis_rs.Scene, rays_per_pixel: int) -> Callable[[Views], None]:
    """``mi.render`` with the scene's integrator and a perspective sensor that is moved for every frame."""
    from davis_rs._mitsuba.variants import load_scene_source

    mi.set_variant("llvm_ad_rgb")
    loaded = load_scene_source(scene.source(), mi)
    camera = scene.own_camera
    film = {"type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"}}
    fov = float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx))))
    sensor = mi.load_dict({"type": "perspective", "fov": fov, "film": film})
    parameters = mi.traverse(sensor)

    def render(views: Views) -> None:
        for position, rotation in zip(views.positions, views.rotations, strict=True):
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = rotation @ np.diag([-1.0, -1.0, 1.0]), position
            to_world = mi.Matrix4f(matrix.tolist())
            dr.make_opaque(to_world)  # a literal would be compiled into the kernel, and compiled anew for every pose
            parameters["to_world"] = mi.Transform4f(to_world)
            parameters.update()
            mi.render(loaded, sensor=sensor, spp=rays_per_pixel, seed=0).numpy()

    return render


def milliseconds(make: Callable[[], Callable[[Views], object]], views: Views) -> float:
    """Median time a frame of what ``make`` makes, which is dropped afterwards.

    One after the other, since Mitsuba compiles every surface of all scenes that are loaded into each of its kernels.
    """
    render = make()
    render(views)  # the first compiles
    times = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        render(views)
        times.append((time.perf_counter() - start) / len(views) * 1e3)
    return statistics.median(times)


def main() -> None:
    scene = davis_rs.load_scene("three_planes")
    assert scene.trajectory is not None
    views = Views.along(scene.trajectory, np.linspace(0.3, 0.5, POSES))

    def renderer(rays: int, kind: str, blur: bool) -> Renderer:
        return make_renderer(scene, scene.own_camera, rays_per_pixel=rays, kind=kind, blur=blur)

    cases: dict[str, Callable[[], Callable[[Views], object]]] = {}
    for rays in (1, 16):
        cases[f"mi.render, {rays} samples"] = partial(mitsuba_render, scene, rays)
        cases[f"Mitsuba's integrator on our rays, {rays} rays"] = lambda n=rays: renderer(n, "integrator", False).luma
    for rays in (1, 4, 8, 13):
        cases[f"table kernel, {rays} rays"] = lambda n=rays: renderer(n, "table", False).luma
        cases[f"table kernel, {rays} rays, blurred"] = lambda n=rays: renderer(n, "table", True).luma
        cases[f"table kernel, {rays} rays, with dY/dt"] = lambda n=rays: renderer(n, "table", False).luma_and_rate
    print("| what | ms a frame | frames a second |")
    print("|---|---|---|")
    for name, make in cases.items():
        middle = milliseconds(make, views)
        print(f"| {name} | {middle:.2f} | {1e3 / middle:,.0f} |", flush=True)
        gc.collect()


if __name__ == "__main__":
    main()
