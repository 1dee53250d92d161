"""Presets: points on the measured curve of accuracy against time."""

from __future__ import annotations

from dataclasses import dataclass

from .rules import MaxDisplacement, TimeSampling
from .tolerance import Tolerance


@dataclass(frozen=True)
class Accuracy:
    """How finely a scene is sampled.

    Attributes:
        sampling: in time.
        samples: in space: rays a pixel; None leaves it to the renderer.
        refine: polish each event's time by asking the renderer itself.
    """

    sampling: TimeSampling
    samples: int | None
    refine: bool = False


ACCURACY = {
    "paper": Accuracy(MaxDisplacement(), None),
    "fast": Accuracy(MaxDisplacement(2 / 3), 5),
    "balanced": Accuracy(Tolerance(0.5, pixels=2 / 3, longest=2 / 3, halvings=1, edges=False), 13),
    "exact": Accuracy(Tolerance(0.05, pixels=1 / 16, longest=1 / 16, halvings=3), 32, refine=True),
}
"""``docs/accuracy.md`` shows where they lie.

``paper``, the default, is the rule of the dataset's own simulator: straight lines between renders a third of a pixel
apart.

Lattices of 5, 8, 13, 21 points (Fibonacci numbers) integrate edges best for their cost.
"""
