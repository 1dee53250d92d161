"""The table kernel against Mitsuba's own renderer: python benches/render.py

three_planes, 240 x 180, in one process; medians of interleaved repetitions, in milliseconds a frame.
"""

import statistics
import time
from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

import davis_rs
from davis_rs.renderers import make_renderer
from davis_rs.views import Views

POSES, REPETITIONS = 64, 7


def mitsuba_render(scene: davis_rs.Scene, samples: int) -> Callable[[Views], None]:
    """``mi.render`` with the scene's integrator and a perspective sensor that is moved for every frame."""
    from davis_rs._mitsuba import load_scene_source

    mi.set_variant("llvm_ad_rgb")
    loaded = load_scene_source(scene.source(), mi)
    camera = scene.camera
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
            mi.render(loaded, sensor=sensor, spp=samples, seed=0).numpy()

    return render


def main() -> None:
    scene = davis_rs.load_scene("three_planes")
    assert scene.trajectory is not None
    views = Views.along(scene.trajectory, np.linspace(0.3, 0.5, POSES))
    cases: dict[str, Callable[[Views], object]] = {}
    for rays in (1, 4, 8, 13):
        for blur in (False, True):
            renderer = make_renderer(scene, scene.camera, samples=rays, blur=blur)
            cases[f"table kernel, {rays} rays{', blurred' if blur else ''}"] = renderer.luma
        cases[f"table kernel, {rays} rays, with dY/dt"] = make_renderer(
            scene, scene.camera, samples=rays, blur=False
        ).luma_and_rate
    for samples in (1, 16):
        integrator = make_renderer(scene, scene.camera, samples=samples, kind="integrator", blur=False)
        cases[f"Mitsuba's integrator on our rays, {samples} rays"] = integrator.luma
        cases[f"mi.render, {samples} samples"] = mitsuba_render(scene, samples)
    times: dict[str, list[float]] = {name: [] for name in cases}
    for repetition in range(REPETITIONS + 1):
        for name, render in cases.items():
            some = views if name.startswith("table") else views[: POSES // 4]
            start = time.perf_counter()
            render(some)
            if repetition > 0:  # the first compiles
                times[name].append((time.perf_counter() - start) / len(some) * 1e3)
    print("| what | ms a frame | frames a second |")
    print("|---|---|---|")
    for name, values in times.items():
        middle = statistics.median(values)
        print(f"| {name} | {middle:.2f} | {1e3 / middle:,.0f} |")


if __name__ == "__main__":
    main()
