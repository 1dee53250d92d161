"""Defines the accuracy presets: points on the measured curve of accuracy against time."""

from __future__ import annotations

from dataclasses import dataclass

from .._util.former_names import FormerAttribute, takes_former_names
from .rules import MaxDisplacement, TimeSampling
from .tolerance import Tolerance


@takes_former_names(samples="rays_per_pixel")
@dataclass(frozen=True)
class Accuracy:
    """The settings of sampling in time and space.

    Attributes:
        sampling: the rule of sampling in time.
        rays_per_pixel: of renderers whose rays are a lattice. Mitsuba's integrators draw theirs at random: their
            error is noise, for which ``rays_per_pixel="auto"`` chooses a number.
        refine: refine each event's time by rendering near it.
    """

    sampling: TimeSampling
    rays_per_pixel: int
    refine: bool = False

    samples = FormerAttribute("rays_per_pixel")


DEFAULT_ACCURACY = "balanced"

ACCURACY = {
    "paper": Accuracy(MaxDisplacement(), 8),
    "fast": Accuracy(MaxDisplacement(2 / 3), 8),
    "balanced": Accuracy(Tolerance(0.5, pixels=1 / 2, longest=1 / 2, halvings=1, edges=False), 32),
    "exact": Accuracy(Tolerance(0.05, pixels=1 / 6, longest=1 / 6, halvings=6), 32, refine=True),
}
"""``docs/accuracy.md`` shows where they lie.

``balanced`` is the default: rays are cheap, and with the 8 of ``paper`` they are most of the error. ``paper`` is the
rule of the dataset's own simulator: straight lines between renders a third of a pixel apart.
"""
