"""Defines the accuracy presets: points on the measured curve of accuracy against time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from .._util.former_names import FormerAttribute, takes_former_names
from .rules import MaxDisplacement, TimeSampling
from .tolerance import Tolerance


class PixelArguments(TypedDict):
    """Names the arguments of ``make_renderer`` that say what a pixel is made of."""

    lattice_rays_per_pixel: int
    lattice_pixel: str
    glossy_rays_per_pixel: int | None


@takes_former_names(samples="rays_per_pixel")
@dataclass(frozen=True)
class Accuracy:
    """Holds the settings of sampling in time and space.

    Attributes:
        sampling: the rule of sampling in time.
        rays_per_pixel: of renderers whose rays are a lattice. Mitsuba's integrators draw theirs at random: their
            error is noise, for which ``rays_per_pixel="auto"`` chooses a number.
        refine: refine each event's time by rendering near it, where luma is a mean over rays.
        pixel: ``lines``: lines in place of these rays, where the renderer has them; ``rays``.
        glossy_rays_per_pixel: rays where surfaces are glossy, which lines do not show; None: ``rays_per_pixel``.
    """

    sampling: TimeSampling
    rays_per_pixel: int
    refine: bool = False
    pixel: str = "rays"
    glossy_rays_per_pixel: int | None = None

    samples = FormerAttribute("rays_per_pixel")


def pixel_arguments(accuracy: Accuracy) -> PixelArguments:
    """Return what a pixel is made of, as ``make_renderer`` takes it."""
    return {
        "lattice_rays_per_pixel": accuracy.rays_per_pixel,
        "lattice_pixel": accuracy.pixel,
        "glossy_rays_per_pixel": accuracy.glossy_rays_per_pixel,
    }


DEFAULT_ACCURACY = "balanced"

ACCURACY = {
    "paper": Accuracy(MaxDisplacement(), 8),
    "fast": Accuracy(MaxDisplacement(2 / 3), 8),
    "balanced": Accuracy(
        Tolerance(0.5, pixels=1 / 2, longest=1 / 2, halvings=1, edges=False),
        32,
        pixel="lines",
        glossy_rays_per_pixel=128,
    ),
    "exact": Accuracy(
        Tolerance(0.1, pixels=1 / 6, longest=1 / 6, halvings=3),
        64,
        refine=True,
        pixel="lines",
        glossy_rays_per_pixel=256,
    ),
}
"""``docs/accuracy.md`` shows where they lie.

``balanced`` is the default. Where it can, it takes the integral over a pixel's area by 8 lines, because the jumps of 32
rays are most of their error, above all where things are thin. ``paper`` is the rule of the dataset's own simulator:
straight lines between renders a third of a pixel apart. ``exact`` takes 16 lines. It refines the event times of rays,
which jump. Those of lines it does not refine: that
would cost five times as much, and change them by less than the error that the integral has.

Glossy surfaces take four times as many rays, because lines do not show them, and textures, bumps and highlights need
them: docs/light.md has the wrong events of 32 and of 128 rays.
"""
