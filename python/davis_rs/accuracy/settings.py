"""Lists the settings of the simulator that a sweep compares, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from ..sampling.presets import ACCURACY
from ..sampling.rules import MaxDisplacement, TimeSampling
from ..sampling.tolerance import Tolerance


@dataclass(frozen=True)
class Setting:
    """Holds a point on the curve: how to sample in time and space, and what it belongs to.

    Attributes:
        name: unique, for people.
        family: settings of one family differ in one thing.
        rays_per_pixel: rays a pixel, or in place of how many there are lines.
        renderer: as of :class:`~davis_rs.Simulator`; so ``refine`` and ``pixel``.
        preset: what users know it by, if they do. It decides on rays or lines itself.
    """

    name: str
    family: str
    sampling: TimeSampling
    rays_per_pixel: int = 8
    renderer: str = "auto"
    refine: bool = False
    pixel: str = "rays"
    preset: str = ""

    @property
    def random(self) -> bool:
        """Tell whether its rays carry noise, so that no exact crossings belong to them."""
        return self.renderer == "integrator"

    @property
    def promised(self) -> float | None:
        """Return the error of log luma between renders, in units of C, below which the sampling keeps 95 % of all
        pixels."""
        return self.sampling.contrast if isinstance(self.sampling, Tolerance) else None


PRESETS = "presets"
"""The family of settings that users know by name."""

_SPACINGS = {"1/6": 1 / 6, "1/3": 1 / 3, "2/3": 2 / 3, "1": 1.0, "4/3": 4 / 3}
_RAYS = (2, 4, 8, 16, 32)
_TOLERANCES = (0.2, 0.1, 0.05, 0.02)


def default_settings() -> list[Setting]:
    """Return each axis around a middle (displacement, rays, tolerance), refined times, and Mitsuba's usual way."""
    lines = [
        Setting(
            f"lines, {text} px, 8 rays",
            "lines, 8 rays: spacing",
            sampling := MaxDisplacement(pixels),
            preset="paper" if sampling == ACCURACY["paper"].sampling else "",
        )
        for text, pixels in _SPACINGS.items()
    ]
    cubics = [
        Setting(f"cubics, {text} px, 8 rays", "cubics, 8 rays: spacing", MaxDisplacement(pixels, hermite=True))
        for text, pixels in _SPACINGS.items()
    ]
    rays = [
        Setting(f"{name}, {text} px, {n} rays", f"{name}, {text} px: rays", sampling, n)
        for name, text, sampling in (
            ("lines", "1/3", MaxDisplacement(1 / 3)),
            ("cubics", "2/3", MaxDisplacement(2 / 3, hermite=True)),
        )
        for n in _RAYS
        if n != 8
    ]
    adaptive = [
        Setting(f"tolerance {contrast:g} C, 8 rays", "tolerance, 8 rays", Tolerance(contrast))
        for contrast in _TOLERANCES
    ]
    more_rays = [
        Setting(f"tolerance 0.1 C, {n} rays", "tolerance 0.1 C: rays", Tolerance(0.1), n) for n in _RAYS if n > 8
    ]
    refined = [
        Setting("lines, 1/3 px, 8 rays, refined", "refined", MaxDisplacement(1 / 3), refine=True),
        Setting("lines, 1 px, 8 rays, refined", "refined", MaxDisplacement(1.0), refine=True),
    ]
    presets = [
        Setting(
            f"preset {name}", PRESETS, accuracy.sampling, accuracy.rays_per_pixel, refine=accuracy.refine, preset=name
        )
        for name, accuracy in ACCURACY.items()
        if name != "paper"  # it is among the lines
    ]
    usual = Setting("Mitsuba, lines, 1/3 px, 16 rays", "Mitsuba's integrator", MaxDisplacement(1 / 3), 16, "integrator")
    return [*lines, *cubics, *rays, *adaptive, *more_rays, *refined, *presets, usual]
