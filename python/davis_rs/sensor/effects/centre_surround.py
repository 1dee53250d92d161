"""Centre-surround pixels: what a pixel sees, less what its neighbourhood sees, as an effect on log intensity."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number


@dataclass(eq=False)
class CentreSurround:
    """Subtracts a surround from each pixel's log intensity, so that slow and wide changes of light make no events.

    The surround h follows log intensity L on a resistive grid: tau dh/dt = L - h + lambda^2 (the sum of the four
    neighbours' h, less 4 h), with no current across the sensor's border. The pixel sees L - h. A step over the whole
    sensor is forgotten within some ``tau_ms``. Of a grating of wavelength w the surround takes away about
    1 / (1 + (2 pi lambda / w)^2).

    It is a custom effect: ``Simulator(scene, custom_effects=CentreSurround(5.0))``, or on the command line
    ``--custom-effect davis_rs.sensor.effects.centre_surround:CentreSurround``, with its defaults.

    Args:
        lambda_px: the length over which the grid averages, in pixels, >= 0.
        tau_ms: the time within which it settles, in milliseconds; 0 for at once.

    Raises:
        ValueError: for values that are negative or not finite.

    Source: Delbruck, Li, Graca, Mcreynolds, "Utility and feasibility of a center surround event camera", ICIP 2022;
    v2e has the same grid (its cs_lambda_pixels and cs_tau_p_ms), stepped in time. Here each spatial mode is a low-pass
    of its own, whose step is exact for light that is constant between two keyframes.
    """

    lambda_px: float = 5.0
    tau_ms: float = 2.0
    _decay_rates: npt.NDArray[np.float64] | None = field(default=None, init=False, repr=False)
    _modes: npt.NDArray[np.float64] | None = field(default=None, init=False, repr=False)
    _before: npt.NDArray[np.float64] | None = field(default=None, init=False, repr=False)
    _last_us: int = field(default=0, init=False, repr=False)

    def __post_init__(self) -> None:
        check_number("lambda_px", self.lambda_px, 0)
        check_number("tau_ms", self.tau_ms, 0)

    def begin(self, width: int, height: int, seed: int) -> None:
        """Forget what was seen before; ``seed`` plays no part."""
        across, down = (2 - 2 * np.cos(np.pi * np.arange(side) / side) for side in (width, height))
        self._decay_rates = 1 + self.lambda_px**2 * (down[:, None] + across[None, :])
        self._modes = self._before = None

    def log_intensity(self, t_us: int, log_intensity: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return log intensity less its surround, float64 (H, W), at the time of a keyframe."""
        from scipy.fft import dctn, idctn

        assert self._decay_rates is not None
        seen = dctn(log_intensity, norm="ortho")
        if self._modes is None or self._before is None or self.tau_ms == 0:
            self._modes = seen / self._decay_rates
        else:
            settled = 0.5 * (self._before + seen) / self._decay_rates
            kept = np.exp(-(t_us - self._last_us) * 1e-3 / self.tau_ms * self._decay_rates)
            self._modes = settled + kept * (self._modes - settled)
        self._before, self._last_us = seen, t_us
        surround: npt.NDArray[np.float64] = idctn(self._modes, norm="ortho")
        return log_intensity - surround
