"""The renderer: poses in, frames of linear luma and depth maps out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .lattice import rank1_lattice
from .luma import LumaFrames, blur_3x3
from .pose import Pose


class Renderer(ABC):
    """Renders a scene through a camera's own rays, so that images match its calibration and distortion.

    Each pixel averages ``samples`` rays of a fixed lattice over its square; depth is that of the ray through its
    centre. The same pose gives the same bits, whatever is rendered before, beside or after it.
    """

    name: str
    """What renders, for people."""

    reason: str
    """Why it was chosen, for people."""

    variant: str
    """The Mitsuba variant."""

    poses_per_launch: int
    """How many poses are best rendered in one call."""

    def __init__(self, camera: Camera, *, samples: int, blur: bool) -> None:
        self.camera, self.samples, self.blur = camera, samples, blur

    def luma(self, poses: Sequence[Pose]) -> LumaFrames:
        """Linear luma (n, H, W), float32, for n poses."""
        frames = self._luma(poses)
        return blur_3x3(frames) if self.blur else frames

    @abstractmethod
    def _luma(self, poses: Sequence[Pose]) -> LumaFrames: ...

    @abstractmethod
    def depth(self, poses: Sequence[Pose]) -> npt.NDArray[np.float32]:
        """Depth (n, H, W), float32: z along the optical axis in metres; inf where a ray hits nothing."""


def ray_table(camera: Camera, samples: int) -> npt.NDArray[np.float64]:
    """Undistorted ray directions (samples, H * W, 2): x and y of (x, y, 1) in camera axes, row by row."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    centres = np.stack([x, y], -1).reshape(-1, 2)
    return camera.rays(centres[None] + rank1_lattice(samples)[:, None])
