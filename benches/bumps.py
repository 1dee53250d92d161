"""Prints how well bumps are lit by light from all around: python benches/bumps.py

A square with a normal map or a bump map, under a lamp, an environment map and constant light. Each number is the root
mean square of log luma next to Mitsuba's path tracer with 1,024 samples, in units of C = 0.15; in brackets that of the
same square without bumps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import Camera, Scene
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer

C = 0.15
CAMERA = Camera(width=24, height=20, fx=30.0, fy=30.0, cx=11.5, cy=9.5)
NUMBERS = np.random.default_rng(5)


def normal_map(slope: float) -> npt.NDArray[np.float32]:
    """Make texels that are turned by slopes of this deviation."""
    normals = NUMBERS.normal(size=(8, 8, 3)) * [slope, slope, 0] + [0, 0, 1]
    return (0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)


DIRECTIONS, HEIGHTS = normal_map(0.35), NUMBERS.uniform(0, 0.1, (8, 8, 1)).astype(np.float32)
MATTE = {"type": "diffuse", "reflectance": 0.6}
METAL = {"type": "principled", "base_color": 0.5, "roughness": 0.4, "metallic": 1.0}


def two_sided(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "twosided", "front": bsdf}


def turned(bsdf: dict[str, Any], *, fades: bool) -> dict[str, Any]:
    texels = {"type": "bitmap", "raw": True, "data": DIRECTIONS}
    return {"type": "normalmap", "normalmap": texels, "bsdf": bsdf, "use_shadowing_function": fades}


def raised(bsdf: dict[str, Any]) -> dict[str, Any]:
    texels = {"type": "bitmap", "raw": True, "data": HEIGHTS}
    return {"type": "bumpmap", "heights": texels, "bsdf": bsdf, "use_shadowing_function": False}


def lamp() -> dict[str, Any]:
    import mitsuba as mi

    place = mi.ScalarTransform4f().look_at([1.5, -0.8, 1.2], [0, 0, 0], [0, 1, 0.1])
    shape = {"type": "rectangle", "to_world": place @ mi.ScalarTransform4f().scale([0.4, 0.4, 1])}
    return {"lamp": {**shape, "emitter": {"type": "area", "radiance": 6.0}}}


def sky() -> dict[str, Any]:
    import mitsuba as mi

    radiance = np.full((32, 64, 3), 0.2, np.float32)
    radiance[6:12, 10:20] = 8.0
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    return {"sky": {"type": "envmap", "bitmap": mi.Bitmap(radiance), "to_world": upright}}


def constant() -> dict[str, Any]:
    return {"sky": {"type": "constant", "radiance": 0.7}}


SURFACES = {
    "normal map": (turned(MATTE, fades=False), MATTE),
    "with fading": (turned(MATTE, fades=True), MATTE),
    "bump map": (raised(MATTE), MATTE),
    "normal map on rough metal": (turned(METAL, fades=False), METAL),
}
LIGHTS = {"lamp at the side": lamp, "environment map with a bright part": sky, "the same from all sides": constant}


def luma(bsdf: dict[str, Any], light: Any, kind: str, rays: int) -> npt.NDArray[np.float32]:
    parts = {"type": "scene", "integrator": {"type": "path", "max_depth": 2}}
    square = {"type": "rectangle", "bsdf": two_sided(bsdf)}
    scene = Scene(name="bumps", source=lambda: {**parts, "square": square, **light()}, camera=CAMERA)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1, -1, -1]), [0.1, 0.05, 2.2]
    return make_renderer(scene, CAMERA, kind=kind, rays_per_pixel=rays, blur=False).luma(Views.at_rest([pose]))[0]


def main() -> None:
    print(f"| light | {' | '.join(SURFACES)} |")
    print("|---" * (1 + len(SURFACES)) + "|")
    for name, light in LIGHTS.items():
        cells = []
        for bumpy, plain in SURFACES.values():
            kind = "native" if light is constant else "baked"
            theirs = luma(bumpy, light, "integrator", 1024)
            ours, flat = (luma(bsdf, light, kind, 64) for bsdf in (bumpy, plain))
            off = [float(np.sqrt(np.mean(np.log(each / theirs) ** 2))) / C for each in (ours, flat)]
            cells.append(f"{off[0]:.2f} (flat: {off[1]:.2f})")
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
