"""Recover a camera's pose from one frame of luma: Gauss-Newton, with the Jacobian by forward mode.

The first guess is 2 cm and 1 degree off. Run: python examples/recover_pose.py
"""

from __future__ import annotations

import argparse

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene
from davis_rs.differentiable import CameraPoses, DifferentiableRenderer


def make_scene() -> Scene:
    """A textured floor, and a textured tile above it, so that the frame has occlusion edges too."""
    random = np.random.default_rng(7)

    def rectangle(half: float, height: float, texels: int) -> dict[str, object]:
        to_world = np.diag([half, half, 1.0, 1.0])
        to_world[2, 3] = height
        data = random.uniform(0.05, 0.95, (texels, texels, 1)).astype(np.float32)
        bitmap = {"type": "bitmap", "raw": True, "data": data}
        return {"type": "rectangle", "to_world": to_world, "bsdf": {"type": "diffuse", "reflectance": bitmap}}

    source = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "lamp": {"type": "point", "position": [0.3, -0.4, 3.0], "intensity": 20.0},
        "floor": rectangle(3.0, 0.0, 48),
        "tile": rectangle(0.4, 0.5, 8),
    }
    return Scene(name="floor and tile", source=lambda: source, shadows=False)


def main(argv: list[str] | None = None) -> list[tuple[float, float]]:
    """Returns, from iteration to iteration, how far the pose is off: metres and degrees."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--rays-per-pixel", type=int, default=8, help="rays a pixel")
    options = parser.parse_args(argv)
    # Made first: it chooses an LLVM that works.
    renderer = DifferentiableRenderer(
        make_scene(), Camera(96, 72, 80.0, 80.0, 47.5, 35.5), rays_per_pixel=options.rays_per_pixel
    )
    mi.set_variant("llvm_ad_rgb")

    true = Pose([0.1, 0.05, 2.0], [1.0, 0.0, 0.0, 0.0])
    turn = Rotation.from_rotvec(np.radians([0.6, 0.0, 0.8]))
    guess = Pose(np.add(true.position, (0.02, 0.0, 0.0)), (Rotation.from_quat(true.quaternion) * turn).as_quat())
    target = renderer.luma(CameraPoses.at([true])).numpy()[0]

    about, increment = CameraPoses.at([guess]), np.zeros(6)
    errors = []
    for iteration in range(options.iterations + 1):
        # Six copies of the pose, each with the tangent of one of its six numbers: the Jacobian in one launch.
        copies = mi.TensorXf(np.tile(increment, (6, 1)).astype(np.float32))
        dr.enable_grad(copies)
        dr.set_grad(copies, mi.TensorXf(np.eye(6, dtype=np.float32)))
        frames = renderer.luma(about.perturbed(copies))
        jacobian = dr.forward_to(frames).numpy().reshape(6, -1).T.astype(np.float64)
        residual = (frames.numpy()[0] - target).ravel().astype(np.float64)

        found = Rotation.from_quat(guess.quaternion) * Rotation.from_rotvec(increment[3:])
        off = np.linalg.norm(guess.position + increment[:3] - true.position)
        angle = np.degrees((Rotation.from_quat(true.quaternion).inv() * found).magnitude())
        errors.append((float(off), float(angle)))
        rms = np.sqrt((residual**2).mean())
        print(f"iteration {iteration}: {1e3 * off:8.4f} mm, {angle:8.5f} deg, rms of luma {rms:.2e}")

        increment = increment - np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    return errors


if __name__ == "__main__":
    main()
