"""Defines what is wanted of a controller: where it starts, what moves, and how well it does."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..geometry.camera import Camera
from ..geometry.pose import FloatArray, Pose, PoseLike
from .bodies import BodyState


@dataclass(frozen=True, eq=False)
class Moment:
    """Holds all that a task may judge at the end of a step.

    Attributes:
        t_s: since the episode began, seconds.
        state: how the camera moves.
        action: float64 (k,), the step's.
        camera: lens and size.
    """

    t_s: float
    state: BodyState
    action: FloatArray
    camera: Camera


@dataclass(frozen=True, eq=False)
class Verdict:
    """Holds how well a step was done.

    Attributes:
        reward: of the step.
        terminated: whether the episode is over, because the task has failed or is done.
        info: what else is known, for ``info`` of the environment: names without those that it has itself.
    """

    reward: float
    terminated: bool = False
    info: Mapping[str, object] = field(default_factory=dict)


class Task(ABC):
    """Says where episodes begin, what moves in the scene, and what a step is worth."""

    @abstractmethod
    def start(self, random: np.random.Generator) -> Pose:
        """Begin an episode; return the camera's first pose. All chance comes from ``random``."""

    def objects(self, t_s: float) -> Mapping[str, PoseLike]:
        """Return where movable objects are, T_world_object by their ids (:meth:`davis_rs.Scene.with_movable`)."""
        return {}

    def lights(self, t_s: float) -> Mapping[str, float]:
        """Return factors on the strengths of movable lights, by their ids."""
        return {}

    @abstractmethod
    def judge(self, moment: Moment) -> Verdict:
        """Judge a step."""
