"""Noise of motion-captured poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...geometry.pose import FloatArray, GroundTruth, hamilton
from ..effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class MocapNoise(Effect):
    """White Gaussian noise of positions and rotations, independent from sample to sample.

    Args:
        position_m: standard deviation along each axis of the world, 0..1 m.
        rotation_rad: standard deviation of the turn about each axis of the camera, 0..0.5 rad.

    The defaults come from the public dataset's hand-held poster_6dof. Its residuals from a smooth path are white, at
    0.65 mm and 4.3 mrad (see :func:`~davis_rs.read_trajectory`).

    Raises:
        ValueError: for values out of range.

    Source: the residuals above; the paper speaks of less than a millimetre (Mueggler et al., IJRR 2017).
    """

    position_m: float = 6.5e-4
    rotation_rad: float = 4.3e-3

    name: ClassVar[str] = "mocap_noise_m"
    acts_on: ClassVar[Where] = "ground truth"

    def __post_init__(self) -> None:
        check_range("mocap_noise_m position_m", self.position_m, 0.0, 1.0, "m")
        check_range("mocap_noise_m rotation_rad", self.rotation_rad, 0.0, 0.5, "rad")

    @property
    def neutral(self) -> bool:
        """Whether poses are exact."""
        return self.position_m == 0 and self.rotation_rad == 0

    def apply(self, poses: GroundTruth, seed: int) -> GroundTruth:
        """Return ``poses`` with noise; the first n do not depend on how many follow."""
        from scipy.spatial.transform import Rotation

        draws = self.random(seed).standard_normal((len(poses.t_us), 6))
        turns: FloatArray = Rotation.from_rotvec(self.rotation_rad * draws[:, 3:]).as_quat()
        turns *= np.where(turns[:, 3:] < 0, -1.0, 1.0)  # so that the sign of the product stays continuous
        return poses._replace(
            positions=poses.positions + self.position_m * draws[:, :3], quaternions=hamilton(poses.quaternions, turns)
        )
