"""What a mesh that deforms costs, next to the same one at rest: python benches/deforming.py

A tube of 10^3 to 10^5 triangles that bends, under a lamp, 240 x 180, 8 rays a pixel, on one thread: the least processor
time of a frame, in turns; how much of it goes into the new form; and the time of one pixel at an instant of its own, as
refined event times ask for it.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from render_native import measure

from davis_rs import Camera, Pose, Scene, SegmentTrajectory, VertexKeyframes
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.scene.meshes import Mesh, shape

TRIANGLES = (1_000, 10_000, 100_000)
VIEWS = 8
PIXELS = 40


def tube(triangles: int, bend: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return vertices, normals and faces of a tube along y that bends towards x."""
    side = round(np.sqrt(triangles / 2))
    angle, along = np.meshgrid(np.linspace(0, 2 * np.pi, side + 1), np.linspace(-1, 1, side + 1))
    normals = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1).reshape(-1, 3)
    positions = 0.4 * normals + np.stack([bend * along**2, along, 0 * along], -1).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1, 1)
    faces = (first + np.array([[0, 1, side + 2, 0, side + 2, side + 1]])).reshape(-1, 3)
    return positions, normals, faces


def scene_of(triangles: int, *, deforms: bool) -> Scene:
    """Make a scene of the tube."""
    positions, normals, faces = tube(triangles, 0.0)
    forms = np.stack([positions, tube(triangles, 0.5)[0]])

    def source() -> dict[str, object]:
        mesh = Mesh(positions, faces, np.zeros((len(positions), 2)))
        return {
            "type": "scene",
            "tube": shape(mesh, 0.5, normals=normals),
            "lamp": {"type": "point", "position": [2.0, 1.0, -3.0], "intensity": 20.0},
        }

    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    here = Pose([0, 0, -3], [0, 0, 0, 1])
    deformations = {"tube": VertexKeyframes([0.0, 1.0], forms, np.stack([normals] * 2))} if deforms else {}
    path = SegmentTrajectory(here, here, 1.0)
    return Scene("tube", source, camera=camera, trajectory=path, deformations=deformations)


def row(triangles: int) -> None:
    """Print the row of one size."""
    renderers = []
    for deforms in (False, True):
        scene = scene_of(triangles, deforms=deforms)
        renderer = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=8, threads=1)
        assert isinstance(renderer, NativeRenderer)
        renderers.append(renderer)
    rigid, deforming = renderers
    views = Views.along(scene.path, 0.1 + 0.01 * np.arange(VIEWS))
    one = Views.along(scene.path, 0.1 + 0.01 * np.arange(PIXELS))
    pixel = np.full(PIXELS, 90 * 240 + 120)
    least = measure(
        {
            "rigid": lambda: rigid.luma(views),
            "deforming": lambda: deforming.luma(views),
            "pixels": lambda: deforming.samples(one, np.arange(PIXELS), pixel),
        }
    )
    begun = time.process_time()
    for _ in deforming.deforming.each(views.t_s):
        pass
    form = 1e3 * (time.process_time() - begun) / VIEWS
    still, moving, pixels = least["rigid"][1] / VIEWS, least["deforming"][1] / VIEWS, least["pixels"][1] / PIXELS
    print(f"| {triangles:,} | {still:.1f} | {moving:.1f} | {form:.1f} | {pixels:.1f} |", flush=True)


def main() -> None:
    print(
        "| triangles | at rest, ms a frame | deforming, ms a frame | of it the form, ms | one pixel at an instant, ms |"
    )
    print("|---:|---:|---:|---:|---:|", flush=True)
    for triangles in TRIANGLES:
        row(triangles)


if __name__ == "__main__":
    main()
