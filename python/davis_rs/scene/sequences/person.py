"""Makes a body like a person's, of nine rigid parts, and moves them by its joints.

Each part has a frame of its own with its upper joint at the origin: x to the body's right, y ahead, z up. Lengths are
those of an adult of 1.85 m; the rest is as simple as a wooden figure's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.pose import FloatArray
from ..meshes import Mesh, Window, ball, box, merged, tube
from ..textures import Texture
from .reflectance import finished
from .surface_textures import grid, noise

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

THIGH_M, SHIN_M, ANKLE_M = 0.44, 0.43, 0.09
_UPPER_ARM_M = 0.3
_HIP, _SHOULDER = 0.1, 0.22
"""To either side of the middle, metres."""

_SHOULDER_Z = 0.5
"""Above the hips."""

_ROUND_M = 0.02

_SHIRT: Window = (0.02, 0.02, 0.98, 0.48)
_TROUSERS: Window = (0.02, 0.52, 0.48, 0.98)
_SKIN: Window = (0.52, 0.52, 0.73, 0.98)
_DARK: Window = (0.77, 0.52, 0.98, 0.98)


def parts() -> dict[str, Mesh]:
    """Make the parts by name, each in its own frame."""
    torso = [
        box([-0.17, -0.1, -0.08], [0.17, 0.1, 0.1], window=_TROUSERS),
        box([-0.19, -0.11, 0.1], [0.19, 0.12, 0.54], window=_SHIRT),
        tube([0, 0, 0.52], [0, 0.01, 0.64], (0.06, 0.055), window=_SKIN),
        ball([0, 0.02, 0.74], [0.08, 0.1, 0.125], rings=8, sides=12, window=_SKIN),
        ball([0, -0.005, 0.775], [0.085, 0.1, 0.105], rings=6, sides=12, window=_DARK),
        *(box([x - 0.014, 0.105, 0.755], [x + 0.014, 0.12, 0.77], window=_DARK) for x in (-0.035, 0.035)),
        box([-0.03, 0.1, 0.67], [0.03, 0.112, 0.682], window=_DARK),
    ]
    thigh = tube([0, 0, 0.04], [0, 0, -THIGH_M], (0.095, 0.065), window=_TROUSERS)
    foot = box([-0.045, -0.08, -SHIN_M - ANKLE_M], [0.045, 0.19, -SHIN_M], window=_DARK)
    shin = merged([tube([0, 0, 0.03], [0, 0, -SHIN_M], (0.066, 0.05), window=_TROUSERS), foot])
    upper_arm = tube([0, 0, 0.05], [0, 0, -_UPPER_ARM_M], (0.06, 0.048), window=_SHIRT)
    lower_arm = merged(
        [
            tube([0, 0, 0.03], [0, 0, -0.25], (0.045, 0.034), window=_SKIN),
            ball([0, 0.01, -0.31], [0.03, 0.045, 0.085], window=_SKIN),
        ]
    )
    limbs = {"thigh": thigh, "shin": shin, "upper_arm": upper_arm, "lower_arm": lower_arm}
    return {"torso": merged(torso), **{f"{side}_{name}": m for side in ("left", "right") for name, m in limbs.items()}}


def clothes() -> Texture:
    """Draw a checked shirt above; trousers, skin, and what is dark (hair and shoes) below."""
    shirt = grid(81, 8, 16, (8, 8), joint=0.45, low=0.22, high=0.4)
    below = [noise(82, 0.1, 0.2)[:64, :64], noise(83, 0.4, 0.6)[:64, :32], noise(84, 0.06, 0.15)[:64, :32]]
    return finished(np.concatenate([shirt, np.concatenate(below, axis=1)])[..., 0].astype(np.float64))


@dataclass(frozen=True)
class Joints:
    """The angles of the joints at n instants, radians, and the position of the body.

    Attributes:
        place: (n, 2) of the hips on the floor, metres.
        heading: (n,) about the vertical axis; 0 faces the world's y.
        lean: (n,) of the trunk, ahead.
        hips, knees: (n, 2), left and right: the thigh's swing ahead, and the shin's back from it.
        shoulders, elbows: (n, 2): the arm's swing ahead, and the lower arm's from it.
        aside: (n, 2): the arm's, away from the body.
    """

    position: FloatArray
    heading: FloatArray
    lean: FloatArray
    hips: FloatArray
    knees: FloatArray
    shoulders: FloatArray
    elbows: FloatArray
    aside: FloatArray

    def placed(self) -> dict[str, tuple[FloatArray, Rotation]]:
        """Return positions (n, 3) and SciPy rotations of the parts in the world.

        The lower ankle is within 2 cm of its height over a flat foot. Feet turn with their shins, so that in a walk
        toes reach up to 4 cm into the floor where a heel is raised.
        """
        from scipy.spatial.transform import Rotation

        def about(axis: str, angles: FloatArray) -> Rotation:
            return Rotation.from_euler(axis, angles[:, None])

        reach = THIGH_M * np.cos(self.hips) + SHIN_M * np.cos(self.hips - self.knees)
        # The longer of the two, rounded off where they take turns.
        height = _ROUND_M * np.logaddexp(*(reach.T / _ROUND_M))
        hips = np.column_stack([self.position, ANKLE_M + height])
        body = about("z", self.heading)
        trunk = body * about("x", -self.lean)
        placed: dict[str, tuple[FloatArray, Rotation]] = {"torso": (hips, trunk)}
        for k, (side, sign) in enumerate([("left", -1.0), ("right", 1.0)]):
            hip, thigh = hips + body.apply([sign * _HIP, 0, 0]), body * about("x", self.hips[:, k])
            knee, shin = hip + thigh.apply([0, 0, -THIGH_M]), thigh * about("x", -self.knees[:, k])
            shoulder = hips + trunk.apply([sign * _SHOULDER, 0, _SHOULDER_Z])
            upper = trunk * about("y", -sign * self.aside[:, k]) * about("x", self.shoulders[:, k])
            elbow, lower = shoulder + upper.apply([0, 0, -_UPPER_ARM_M]), upper * about("x", self.elbows[:, k])
            names = [f"{side}_{name}" for name in ("thigh", "shin", "upper_arm", "lower_arm")]
            frames = [(hip, thigh), (knee, shin), (shoulder, upper), (elbow, lower)]
            placed.update(zip(names, frames, strict=True))
        return placed
