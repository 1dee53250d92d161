"""A sequence of the public dataset, as its simulated twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ..scene import Scene
from ..trajectory import Trajectory


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's table.

    Attributes:
        duration_s: T.
        speed_m_s, rate_deg_s: the top speeds TS and RS; None where the table says n/a.
        events: NE.

    Source: Mueggler et al., IJRR 2017, the table of sequences.
    """

    duration_s: float
    speed_m_s: float | None
    rate_deg_s: float | None
    events: int


@dataclass(frozen=True)
class Sequence:
    """One of the dataset's sequences: a twin by kind of motion and texture, not a copy.

    Attributes:
        name: the dataset's.
        paper: its row in the paper's table.
        make_scene: the scene, with camera and contrast threshold; it has a start, or a trajectory of its own.
        make_motion: the camera's path in that scene; None for the scene's own trajectory.
        biases: the set of biases that it was recorded with (:data:`~davis_rs.BIAS_SETS`), None where it was simulated.
        differs: what it is not.
    """

    name: str
    paper: PaperRow
    make_scene: Callable[[], Scene]
    make_motion: Callable[[Scene], Trajectory] | None
    biases: str | None
    differs: str

    def scene(self) -> Scene:
        """The scene under the sequence's name, with the sequence's trajectory."""
        scene = self.make_scene()
        trajectory = scene.trajectory if self.make_motion is None else self.make_motion(scene)
        return replace(scene, name=self.name, trajectory=trajectory)
