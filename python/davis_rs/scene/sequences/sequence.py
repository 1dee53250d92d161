"""Describes a sequence of the public dataset and its synthetic counterpart."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from ...geometry.camera import PRESETS
from ...geometry.trajectory.trajectory import Trajectory
from ..scene import Scene


class PaperRow(NamedTuple):
    """A row of the paper's table: T, TS, RS and NE; None where it says n/a.

    Source: Mueggler et al., IJRR 2017, the table of sequences.
    """

    duration_s: float
    speed_m_s: float | None
    rate_deg_s: float | None
    events: int


@dataclass(frozen=True)
class Sequence:
    """One of the dataset's sequences: a synthetic counterpart by kind of motion and texture, not a copy.

    Attributes:
        name: the dataset's.
        paper: its row in the paper's table.
        make_scene: the scene, which has a start or a trajectory of its own.
        motion: the camera's, in a few words.
        make_motion: the camera's path in that scene; None for the scene's own.
        camera: the lens: a key of :data:`~davis_rs.geometry.camera.PRESETS`.
        biases: the set of biases it was recorded with, a key of :data:`~davis_rs.BIAS_SETS`; None where it was
            simulated.
        frame_rate_hz: of its frames: about 24 Hz where it was recorded, 40 Hz where it was simulated.
        imu: whether it has an IMU: neither the slider's sequences nor the simulated ones have.
        differs: what it is not.
    """

    name: str
    paper: PaperRow
    make_scene: Callable[[], Scene]
    motion: str
    make_motion: Callable[[Scene], Trajectory] | None
    camera: str
    biases: str | None
    frame_rate_hz: float
    imu: bool
    differs: str

    @property
    def settings(self) -> dict[str, str | float | None]:
        """The frames, depth maps and IMU of the dataset's sequence, as settings of
        :func:`~davis_rs.simulate_to_folder`."""
        return {
            "imu": "mpu6150" if self.imu else None,
            "frame_rate_hz": self.frame_rate_hz,
            "depth_rate_hz": self.frame_rate_hz,
        }

    def scene(self) -> Scene:
        """Return the scene under the sequence's name, with its lens and its trajectory."""
        return _scene(self)


@functools.lru_cache(maxsize=32)
def _scene(sequence: Sequence) -> Scene:
    """Make the scene once, because a trajectory of 60 s takes a second."""
    scene = sequence.make_scene()
    trajectory = scene.trajectory if sequence.make_motion is None else sequence.make_motion(scene)
    return replace(
        scene,
        name=sequence.name,
        camera=PRESETS[sequence.camera],
        trajectory=trajectory,
        biases=sequence.biases,
    )
