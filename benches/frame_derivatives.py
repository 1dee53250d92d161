"""Derivatives of frames by the camera's pose, next to differences: python benches/frame_derivatives.py

The frame is that of examples/recover_pose.py: a tile above a floor. Errors are norms over the frame, relative to the
norm of central differences over 2 mm, or 2 mrad, of frames with 1,024 rays a pixel.
"""

from __future__ import annotations

import runpy
import time
from pathlib import Path
from typing import Any

import numpy as np

from davis_rs import Camera, Pose
from davis_rs.differentiable import CameraPoses, DifferentiableRenderer

make_scene = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "recover_pose.py"))["make_scene"]

CAMERA = Camera(96, 72, 80.0, 80.0, 47.5, 35.5)
POSE = Pose([0.1, 0.05, 2.0], [1.0, 0.0, 0.0, 0.0])
STEP = 1e-3


def main() -> None:
    import drjit as dr

    renderers = {
        f"{rays_per_pixel} rays, {'with' if edges else 'without'} edges": DifferentiableRenderer(
            make_scene(), CAMERA, rays_per_pixel=rays_per_pixel, edges=edges
        )
        for rays_per_pixel in (4, 16, 64, 256)
        for edges in (False, True)
    }
    reference = DifferentiableRenderer(make_scene(), CAMERA, rays_per_pixel=1024)
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    about = CameraPoses.at([POSE])

    def derivative(renderer: DifferentiableRenderer, increment: Any) -> Any:
        x = dr.zeros(mi.TensorXf, (1, 6))
        dr.enable_grad(x)
        dr.set_grad(x, mi.TensorXf(increment))
        return dr.forward_to(renderer.luma(about.perturbed(x))).numpy()

    rows = np.eye(6, dtype=np.float32)[:, None]
    truths = []
    for row in rows:
        ahead, behind = (reference.luma(about.perturbed(sign * STEP * row)).numpy() for sign in (1, -1))
        truths.append((ahead - behind) / (2 * STEP))
    print("| derivative by | x | y | z | rotation about x | y | z | processor time (ms) |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for name, renderer in renderers.items():
        errors = [
            np.linalg.norm(derivative(renderer, row) - truth) / np.linalg.norm(truth)
            for row, truth in zip(rows, truths, strict=True)
        ]
        begin = time.process_time()
        derivative(renderer, rows[0])
        seconds = time.process_time() - begin
        print(f"| {name} | {' | '.join(f'{error:.3f}' for error in errors)} | {1e3 * seconds:.0f} |")


if __name__ == "__main__":
    main()
