"""A scene for benches/accuracy.py that no preset was chosen by: meshes, shadows, thin wires, and a wheel that turns."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from davis_rs import CallableTrajectory, Camera, Pose, Scene, SegmentTrajectory
from davis_rs.scene import meshes
from davis_rs.scene.parts import look_at
from davis_rs.scene.textures import patchwork

DURATION_S, TURN_RAD_S = 1.0, 3.0
HUB = np.array([0.35, 1.3, 1.25])
"""The wheel's centre, metres."""


def workshop() -> Scene:
    """A bench before a wall under a lamp: a ball, wires 2 mm thick (0.25 px), a wheel of six blades; C = 0.15."""

    def source() -> dict[str, Any]:
        wall = meshes.quad([-2.0, 2.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 2.5])
        top = meshes.box([-1.2, 0.9, 0.75], [1.2, 1.7, 0.8])
        wires = [meshes.box([x - 0.001, 1.5, 0.8], [x + 0.001, 1.502, 2.2]) for x in np.linspace(-0.9, -0.1, 9)]
        blades = [meshes.box([-0.03, -0.005, 0.05], [0.03, 0.005, 0.33], period_m=0.3) for _ in range(6)]
        turned = [_about_y(blade, np.pi / 3 * k) for k, blade in enumerate(blades)]
        return {
            "type": "scene",
            "integrator": {"type": "direct"},
            "lamp": {"type": "point", "position": [-0.8, -0.4, 2.3], "intensity": 14.0},
            "floor": meshes.shape(meshes.quad([-3, -2, 0], [6, 0, 0], [0, 5, 0]), _texture(41)),
            "wall": meshes.shape(wall, _texture(42)),
            "bench": meshes.shape(top, _texture(43)),
            "ball": meshes.shape(meshes.ball([-0.2, 1.2, 0.98], [0.18] * 3, rings=24, sides=32), _texture(44)),
            "wires": meshes.shape(meshes.merged(wires), 0.05),
            "wheel": meshes.shape(meshes.merged(turned), _texture(45)),
        }

    eye, target = np.array([0.15, -0.15, 1.45]), np.array([0.0, 1.5, 1.1])
    quaternion = Rotation.from_matrix(look_at(eye, target)).as_quat()
    further = (Rotation.from_quat(quaternion) * Rotation.from_rotvec([0.02, 0.06, 0.05])).as_quat()
    path = SegmentTrajectory(Pose(eye, quaternion), Pose(eye + np.array([0.35, 0.12, 0.08]), further), DURATION_S)
    wheel = CallableTrajectory(
        DURATION_S,
        position=lambda t: np.tile(HUB, (len(t), 1)),
        velocity=lambda t: np.zeros((len(t), 3)),
        quaternion=lambda t: Rotation.from_rotvec(np.multiply.outer(TURN_RAD_S * t, [0.0, 1.0, 0.0])).as_quat(),
        angular_rate=lambda t: np.tile([0.0, TURN_RAD_S, 0.0], (len(t), 1)),
        description={"path": "a wheel that turns"},
    )
    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    return Scene("workshop", source, camera=camera, trajectory=path, objects={"wheel": wheel})


def _about_y(mesh: meshes.Mesh, angle: float) -> meshes.Mesh:
    return mesh._replace(vertices=mesh.vertices @ Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix().T)


def _texture(seed: int) -> Any:
    return patchwork(256, seed, low=0.15, high=0.9, grain=0.4, shapes=60, tint=(1.0, 1.0, 1.0))
