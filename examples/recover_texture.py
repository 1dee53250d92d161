"""Recover a surface's texture from frames along a trajectory: Adam, with the gradient by reverse mode.

Run: python examples/recover_texture.py
"""

from __future__ import annotations

import argparse

import drjit as dr
import mitsuba as mi
import numpy as np

from davis_rs import Camera, Pose, Scene
from davis_rs.differentiable import CameraPoses, DifferentiableRenderer, spline

TEXELS = 32


def make_scene() -> Scene:
    """A textured floor under a lamp."""
    data = np.random.default_rng(7).uniform(0.05, 0.95, (TEXELS, TEXELS, 1)).astype(np.float32)
    bitmap = {"type": "bitmap", "raw": True, "data": data}
    source = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "lamp": {"type": "point", "position": [0.3, -0.4, 3.0], "intensity": 20.0},
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": bitmap}},
    }
    return Scene(name="floor", source=lambda: source, shadows=False)


def main(argv: list[str] | None = None) -> tuple[float, float]:
    """Returns the rms error of the texture's reflectance, before and after."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=80)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--rays-per-pixel", type=int, default=4, help="rays a pixel")
    options = parser.parse_args(argv)
    # Made first: it chooses an LLVM that works.
    renderer = DifferentiableRenderer(
        make_scene(), Camera(96, 96, 64.0, 64.0, 47.5, 47.5), rays_per_pixel=options.rays_per_pixel
    )
    mi.set_variant("llvm_ad_rgb")

    # Four control points of a cubic B-spline about a camera that looks down: the frames see all of the floor.
    control_points = [
        [-0.3, -0.2, 0, 0, 0, -0.2],
        [0.3, 0, 0.1, 0, 0.1, 0],
        [0, 0.4, 0, 0.1, 0, 0],
        [0, 0, 0, 0, 0, 0.3],
    ]
    about = CameraPoses.at([Pose([0.0, 0.0, 1.8], [1.0, 0.0, 0.0, 0.0])])
    times = np.linspace(0.0, 1.0, options.frames)
    poses = about.perturbed(spline(control_points, times, duration_s=1.0))
    target = renderer.luma(poses)
    true = renderer.parameters["floor.reflectance"].numpy()[..., 0]

    optimizer = mi.ad.Adam(lr=0.1)
    optimizer["floor.reflectance"] = mi.TensorXf(np.full((TEXELS, TEXELS), 0.5, np.float32))

    def error() -> float:
        return float(np.sqrt(((optimizer["floor.reflectance"].numpy() - true) ** 2).mean()))

    before = error()
    for iteration in range(options.iterations):
        optimizer.set_learning_rate(0.1 * 0.5 ** (8 * iteration / options.iterations))
        loss = dr.mean(dr.square(renderer.luma(poses, optimizer) - target), axis=None)
        dr.backward(loss)
        optimizer.step()
        if iteration % 10 == 0:
            print(f"iteration {iteration}: loss {loss.array[0]:.2e}, rms error of reflectance {error():.4f}")
    after = error()
    print(f"rms error of reflectance {before:.4f} before, {after:.4f} after")
    return before, after


if __name__ == "__main__":
    main()
