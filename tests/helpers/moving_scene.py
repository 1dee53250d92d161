"""Parts of scenes in which objects move: a floor, a box, a ball, lights, and paths."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from davis_rs import Pose, SegmentTrajectory

TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SUN = {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": 3.0}
SKY = {"type": "constant", "radiance": 0.7}


def diffuse(*, two_sided: bool = True, scale: float = 1.0) -> dict[str, Any]:
    bitmap = {"type": "bitmap", "raw": True, "data": TEXELS, "to_uv": np.diag([scale, scale, 1.0])}
    inner = {"type": "diffuse", "reflectance": bitmap}
    return {"type": "twosided", "inner": inner} if two_sided else inner


def placed(kind: str, centre: npt.ArrayLike, half: npt.ArrayLike, bsdf: dict[str, Any]) -> dict[str, Any]:
    to_world = np.diag([*np.broadcast_to(np.asarray(half, np.float64), 3), 1.0])
    to_world[:3, 3] = centre
    return {"type": kind, "to_world": to_world, "bsdf": bsdf}


def turned(*rotvec: float) -> npt.NDArray[np.float64]:
    return np.asarray(Rotation.from_rotvec(rotvec).as_quat())


FLOOR = placed("rectangle", [0, 0, 0], [4, 4, 1], diffuse())
BOX = placed("cube", [0.05, 0.02, 0.01], 0.25, diffuse(scale=-1.3))
PATH = SegmentTrajectory(Pose([-0.4, -0.1, 0.4], turned(0, 0, 0.2)), Pose([0.4, 0.2, 0.6], turned(0.3, 0.2, 0.7)), 1.0)
OTHER = SegmentTrajectory(Pose([0.3, 0.3, 1.0], turned(0.5, 0, 0)), Pose([-0.2, -0.1, 0.9], turned(0, 0.9, 0)), 0.8)


def write_ball(path: Path) -> dict[str, Any]:
    """A coarse sphere with vertex normals, as OBJ."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 13))
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    number = np.arange(1, polar.size + 1).reshape(polar.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    lines = [f"{kind} {x} {y} {z}" for kind in ("v", "vn") for x, y, z in points.reshape(-1, 3).tolist()]
    lines += [f"vt {u} {v}" for u, v in np.stack([around, polar], -1).reshape(-1, 2).tolist()]
    lines += [f"f {i}/{i}/{i} {j}/{j}/{j} {k}/{k}/{k}" for i, j, k in np.concatenate(faces).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return {**placed("obj", [0.1, 0, 0], 0.4, diffuse()), "filename": str(path)}
