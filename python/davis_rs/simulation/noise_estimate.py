"""Says what an estimate of Monte Carlo noise found: the fraction of events that are noise, by the rays per pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .._util.former_names import FormerAttribute
from .._util.quantities import percent

NOISE_LIMIT = 0.2
"""From a larger share of noise on, a run is refused that was not told to accept it; or from the ``noise_share`` that it
was given on, if that is more."""

RAY_COUNTS = (8, 13, 21, 34, 55, 89, 144, 233, 377, 610, 987, 1024)
"""What ``rays_per_pixel="auto"`` takes one of: Fibonacci numbers, whose lattices integrate edges best, and the most."""


class NoiseWarning(UserWarning):
    """Warns that a larger share of a run's events than ``noise_share`` is expected to be Monte Carlo noise."""


class NoiseError(ValueError):
    """Refuses a run before it renders: more of its events than 20 % would be Monte Carlo noise.

    Args:
        said: with options of the command line.
        in_plan: the same with keys of a plan.
    """

    def __init__(self, said: str, in_plan: str = "") -> None:
        super().__init__(said)
        self.in_plan = in_plan or said


@dataclass(frozen=True)
class NoiseEstimate:
    """Says how many events of a run are noise.

    A share is that of missing and spurious events (:func:`~davis_rs.compare_events`, within 10 ms) in the number of
    events without noise; it may exceed 1.

    Attributes:
        rays_per_pixel: rays a pixel of the run.
        measured: (rays per pixel, share), by increasing rays; empty where there is no noise, or too few events
            to tell.
        log_noise: root mean square of the noise of log luma at ``rays_per_pixel``, in units of C.
        events: how many the estimate saw without noise.
        rays: how many it cast.
        run_rays: how many the run will cast, roughly.
        noisy: whether two seeds gave different light at all.
        ray_s: how long a ray took, in seconds; NaN where none was timed.
    """

    rays_per_pixel: int
    measured: tuple[tuple[float, float], ...] = ()
    log_noise: float = 0.0
    events: int = 0
    rays: int = 0
    run_rays: int = 0
    noisy: bool = True
    ray_s: float = field(default=math.nan, compare=False)

    samples = FormerAttribute("rays_per_pixel")
    samples_for = FormerAttribute("rays_per_pixel_for")

    @property
    def known(self) -> bool:
        """Tell whether :meth:`share_at` has a result."""
        return bool(self.measured) or not self.noisy

    def share_at(self, rays_per_pixel: float) -> float:
        """Return share of events that noise makes missing or spurious, with ``rays_per_pixel`` rays a pixel.

        Between two measured numbers it is a straight line in logarithms. Outside it falls as the inverse square root of
        ``rays_per_pixel``, as the noise of luma itself does. NaN where it is not known.
        """
        if not self.noisy:
            return 0.0
        if not self.measured:
            return math.nan
        counts, fractions = (np.array(column) for column in zip(*self.measured, strict=True))
        inside = float(np.clip(rays_per_pixel, counts[0], counts[-1]))
        logs = np.log(np.maximum(fractions, 1e-6))
        return float(np.exp(np.interp(np.log(inside), np.log(counts), logs)) * math.sqrt(inside / rays_per_pixel))

    def rays_per_pixel_for(self, share: float) -> int:
        """Return the fewest of ``RAY_COUNTS``, from :attr:`rays_per_pixel` on, that keep the share; else 1024."""
        enough = (n for n in RAY_COUNTS if n > self.rays_per_pixel and self.share_at(n) <= share)
        return (
            self.rays_per_pixel if not self.known or self.share_at(self.rays_per_pixel) <= share else next(enough, 1024)
        )

    def describe(self, rays_per_pixel: int | None = None) -> dict[str, object]:
        """Return the estimate in JSON's types, for meta.json.

        Args:
            rays_per_pixel: rays a pixel of the run, where others were chosen by the estimate.
        """
        fractions = {f"{count:.4g}": float(f"{fraction:.4g}") for count, fraction in self.measured}
        rays_per_pixel = self.rays_per_pixel if rays_per_pixel is None else rays_per_pixel
        fraction = self.share_at(rays_per_pixel)
        return {
            "share": None if math.isnan(fraction) else float(f"{fraction:.4g}"),
            "rays_per_pixel": rays_per_pixel,
            "log_noise_over_c": float(f"{self.log_noise * math.sqrt(self.rays_per_pixel / rays_per_pixel):.4g}"),
            "measured": fractions,
            "rays": self.rays,
        }

    def run_s(self, rays_per_pixel: int) -> float:
        """Return how long the run would take to render with ``rays_per_pixel`` rays a pixel, in seconds, roughly; NaN
        where it is not known."""
        return self.run_rays * rays_per_pixel / self.rays_per_pixel * self.ray_s

    def __str__(self) -> str:
        if not self.noisy:
            return "no Monte Carlo noise: two seeds give the same light"
        if not self.measured:
            return (
                "too few events to tell how many are Monte Carlo noise at "
                f"{self.rays_per_pixel} rays per pixel; log luma "
                f"is wrong by {self.log_noise:.2g} C (rms)"
            )
        text = share_text(self.share_at(self.rays_per_pixel), "these events are")
        told = f"{text} at {self.rays_per_pixel} rays per pixel"
        more = 64 if self.rays_per_pixel < 64 else 4 * self.rays_per_pixel
        return told if more > 1024 else f"{told}; with {more} about {percent(self.share_at(more))}"


def share_text(fraction: float, these_are: str) -> str:
    """Write a fraction of noise in words.

    Args:
        these_are: ``these events are``, or what else is said of them.
    """
    if fraction >= 0.995:
        return f"most of {these_are} Monte Carlo noise ({100 * fraction:.0f} missing or spurious to 100 right ones)"
    return f"about {percent(fraction)} of {these_are} Monte Carlo noise (missing or spurious)"
