"""Defines the parameters of a sensor, in the units of its data sheet."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.html_table import html_table
from .._util.quantities import with_unit
from ..events.colour import COLOURS, PATTERNS, ColourFilter, Weights
from .biases import BiasValues, CoarseFineBias, as_biases
from .effects import Aps, Effects, HotPixels, LeakRate, PhotoreceptorBandwidth, Readout, ShotNoise, ThresholdMismatch
from .effects.effect import check_range
from .effects.leak_rate import REFERENCE_C, warmth

# Of the event pixel of the DAVIS240 and DAVIS346, by Nozaki, Delbruck, "Temperature and Parasitic Photocurrent Effects
# in Dynamic Vision Sensors", IEEE Trans. Electron Devices 2017, fig. 1, with the capacitances that jAER's DavisConfig
# gives as estimates from the layout.
KAPPA_N = KAPPA_P = 0.7  # subthreshold slope factors
CAPACITANCE_RATIO = 20.0  # C1 / C2 of the differencing amplifier
INPUT_CAPACITANCE_F = 131.167e-15  # C1, the source follower's load
REFRACTORY_CAPACITANCE_F = 20e-15
REFRACTORY_SWING_V = 0.8
THERMAL_VOLTAGE_V = 25e-3  # kT/q at room temperature

START_PHASES = ("zero", "stationary")
"""The values of ``start_phase``: where references may lie at the first frame."""

THRESHOLD_GAIN = KAPPA_N / KAPPA_P**2 / CAPACITANCE_RATIO
"""Change of log intensity for a change of 1 in the logarithm of the comparator's current ratio."""

_SIZES, _LARGEST_SIZE = {"width", "height"}, 65535
_POSITIVE = {
    *_SIZES,
    *["contrast_threshold", "contrast_threshold_off", "photoreceptor_bandwidth_hz", "photoreceptor_bandwidth_lux"],
    "source_follower_bandwidth_hz",
    "dark_current_lux",
    *[
        "leak_double_lux",
        "shot_noise_half_lux",
        "shot_noise_bandwidth_hz",
        "readout_events_per_s",
        "aps_exposure_us",
        "aps_bits",
        "aps_full_scale_lux",
        "aps_full_well_e",
        "aps_electrons_per_dn",
    ],
}
_SIGNED = {"temperature_c", "threshold_column_parity", "threshold_correlation"}
_FRACTIONS = {
    "threshold_column_parity",
    "threshold_correlation",
    "hot_pixel_fraction",
    "readout_by_columns",
    "leak_spread",
    "leak_jitter",
    "aps_prnu",
}


_TEXTS = ("colour_pattern", "colour_red", "colour_green", "colour_blue")


@names_checked
@dataclass(frozen=True, kw_only=True)
class SensorParameters:
    """Holds the parameters of a sensor. None stands for what is not known or does not occur; the effect is then off.

    Illuminances (lux) are those of the scene as its ``lux_per_luma`` counts them; :meth:`effects` turns them into luma.

    Attributes:
        width, height: of the pixel array; None leaves the size to the camera.
        contrast_threshold: C_on in natural-log units; None leaves it to the scene.
        contrast_threshold_off: C_off, positive; None takes C_on.
        threshold_mismatch: standard deviation of the thresholds from pixel to pixel, as a fraction of the threshold.
        threshold_correlation: correlation of a pixel's own ON and OFF thresholds, -1..1; None takes 0.
        threshold_column_parity: fraction by which thresholds of even columns are lower, and those of odd ones higher.
        photoreceptor_bandwidth_hz: corner frequency of the photoreceptor at ``photoreceptor_bandwidth_lux``; it is
            proportional to the photocurrent, dark current included. Both are given or neither.
        photoreceptor_bandwidth_lux: the illuminance of that corner frequency.
        source_follower_bandwidth_hz: corner frequency of the source follower behind it, in any light.
        dark_current_lux: the illuminance whose photocurrent is as large as the photodiode's dark current at 25 degrees
            Celsius. It doubles in 8 degrees, as the leak does (:class:`~davis_rs.sensor.effects.LeakRate`). It is the
            dark level ``log_eps`` of a simulation, unless that is given.
        refractory_period_us: how long a pixel is held in reset after each event.
        leak_rate_hz: ON events of a pixel on a static scene in the dark at 25 degrees Celsius.
        leak_spread: standard deviation of that rate from pixel to pixel, as a fraction; None takes the effect's own
            value.
        leak_jitter: standard deviation of a pixel's intervals, as a fraction; None takes the effect's own value.
        leak_double_lux: the illuminance that doubles the rate; None for none.
        temperature_c: of the sensor, for leak and dark current; None takes 25.
        shot_noise_rms: standard deviation of log intensity in the dark, from noise.
        shot_noise_half_lux: the illuminance at which its square has halved; None takes the illuminance at which
            photoreceptor and source follower have the same corner, or the effect's own value where these are not known.
        shot_noise_bandwidth_hz: the noise's pole that does not depend on light; None takes the source follower's, or
            the effect's own value.
        shot_noise_floor: standard deviation of log intensity that is left in bright light; None takes 0.
        hot_pixel_fraction: fraction of the pixels that fire on their own.
        hot_pixel_rate_hz: the median of their rates; None takes the effect's own value. Their spread and
            regularity are the effect's own.
        readout_events_per_s: throughput of the bus.
        readout_row_us: the time that the bus needs for a row's address; None takes 0.
        readout_latency_us: delay of every event; None takes 0.
        readout_jitter_us: scatter of the stamps; None takes 0.
        readout_by_columns: 1 where rows of the bus are columns of the image, else 0; None takes 0.
        aps_exposure_us: exposure of the intensity frames.
        aps_read_noise_dn: their read noise in counts of the converter; None takes the effect's own value.
        aps_bits: bits of the converter; None takes the effect's own value.
        aps_full_scale_lux: illuminance that saturates it at that exposure; None takes the effect's own value.
        aps_full_well_e: electrons that a pixel holds; None for no limit.
        aps_electrons_per_dn: electrons of a count of the converter; None makes a full well full scale.
        aps_prnu: standard deviation of the pixels' gains as a fraction (PRNU); None takes 0.
        aps_dsnu_dn: standard deviation of the pixels' offsets in counts (DSNU); None takes 0.
        aps_column_offset_dn: standard deviation of the columns' offsets, the same in each frame; None takes 0.
        aps_column_noise_dn: standard deviation of the columns' offsets that change from frame to frame; None takes 0.
        aps_row_readout_us: time between the ends of exposure of neighbouring rows, for a rolling shutter; None for a
            global one.
        vignetting: exponent of the cosine by which the lens darkens away from its axis; 4 is natural vignetting.
        lens_blur_px: standard deviation of the lens's point spread.
        colour_pattern: the Bayer pattern of the filters before the pixels, one of ``RGGB``, ``GRBG``, ``GBRG``,
            ``BGGR``; None for a sensor without colour.
        colour_red, colour_green, colour_blue: what a filter passes: weights of linear red, green and blue, as a text of
            three numbers such as ``0.9 0.1 0``; None takes its own colour alone.

    Raises:
        ValueError: for a value out of range, naming it.
    """

    width: int | None = None
    height: int | None = None
    contrast_threshold: float | None = None
    contrast_threshold_off: float | None = None
    threshold_mismatch: float | None = None
    threshold_correlation: float | None = None
    threshold_column_parity: float | None = None
    photoreceptor_bandwidth_hz: float | None = None
    photoreceptor_bandwidth_lux: float | None = None
    source_follower_bandwidth_hz: float | None = None
    dark_current_lux: float | None = None
    refractory_period_us: float | None = None
    leak_rate_hz: float | None = None
    leak_spread: float | None = None
    leak_jitter: float | None = None
    leak_double_lux: float | None = None
    temperature_c: float | None = None
    shot_noise_rms: float | None = None
    shot_noise_half_lux: float | None = None
    shot_noise_bandwidth_hz: float | None = None
    shot_noise_floor: float | None = None
    hot_pixel_fraction: float | None = None
    hot_pixel_rate_hz: float | None = None
    readout_events_per_s: float | None = None
    readout_row_us: float | None = None
    readout_latency_us: float | None = None
    readout_jitter_us: float | None = None
    readout_by_columns: int | None = None
    aps_exposure_us: float | None = None
    aps_read_noise_dn: float | None = None
    aps_bits: int | None = None
    aps_full_scale_lux: float | None = None
    aps_full_well_e: float | None = None
    aps_electrons_per_dn: float | None = None
    aps_prnu: float | None = None
    aps_dsnu_dn: float | None = None
    aps_column_offset_dn: float | None = None
    aps_column_noise_dn: float | None = None
    aps_row_readout_us: float | None = None
    vignetting: float | None = None
    lens_blur_px: float | None = None
    colour_pattern: str | None = None
    colour_red: str | None = None
    colour_green: str | None = None
    colour_blue: str | None = None

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if value is None or name in _TEXTS:
                continue
            if name in _POSITIVE and value == 0:
                raise ValueError(f"{name} must be finite and > 0, got {value!r}")
            least = -math.inf if name in _SIGNED else 0.0
            check_range(
                name, value, least, 1.0 if name in _FRACTIONS else _LARGEST_SIZE if name in _SIZES else math.inf
            )
            if name in _SIZES and value != int(value):
                raise ValueError(f"{name} must be an integer number of pixels, got {value!r}")
        if self.readout_by_columns not in (None, 0, 1):
            raise ValueError(f"readout_by_columns must be 0 or 1, got {self.readout_by_columns!r}")
        self.colour_filter()
        hz, lux = self.photoreceptor_bandwidth_hz, self.photoreceptor_bandwidth_lux
        if (hz is None) != (lux is None):
            raise ValueError(
                "photoreceptor_bandwidth_hz and photoreceptor_bandwidth_lux belong together, got "
                f"{hz!r} and {lux!r}; a corner that does not depend on light is source_follower_bandwidth_hz"
            )

    def colour_filter(self) -> ColourFilter | None:
        """Return the filters before the pixels; None for a sensor without colour.

        Raises:
            ValueError: for a pattern or weights that do not exist, or weights without a pattern.
        """
        weights = {name: _weights(f"colour_{name}", getattr(self, f"colour_{name}")) for name in COLOURS}
        given = {name: value for name, value in weights.items() if value is not None}
        if self.colour_pattern is None:
            if given:
                raise ValueError(f"colour_{next(iter(given))} needs a colour_pattern")
            return None
        if self.colour_pattern not in PATTERNS:
            raise ValueError(f"colour_pattern must be one of {', '.join(PATTERNS)}, got {self.colour_pattern!r}")
        return ColourFilter(self.colour_pattern, **given)

    @classmethod
    def from_biases(cls, biases: str | BiasValues, **known: Any) -> SensorParameters:
        """Return thresholds, source follower and refractory period of a DAVIS240 or DAVIS346 with these biases.

        - thresholds: (kappa_n / kappa_p^2) (C2 / C1) ln(I / I_DiffBn) with I of OnBn, and of OffBn (negative there);
        - source follower's bandwidth: I_PrSFBp / (2 pi U_T C1), in any light, where I_PrSFBp is at most half of I_PrBp;
        - refractory period: 20 fF x 0.8 V / I_RefrBp.

        They are nominal: mismatch and temperature move them. Of the vendor's default biases recordings of a DAVIS346
        tell about the same thresholds (0.286 +- 0.01 and 0.311 +- 0.02, the formula 0.283 and 0.262: docs/sensor.md).
        Of the dataset's indoor biases the formula's thresholds, 0.414 and 0.116, are refuted: counterparts of the
        sequences have up to 5 times the paper's events with them, four of five OFF (docs/sequences.md).

        Args:
            biases: "indoors" or "outdoors" (the sets of the event-camera dataset), or names with (coarse, fine).
            known: parameters by the names of this class, for which no formula is used; None leaves a parameter open.

        Raises:
            ValueError: for a quantity that the formulas do not give with these biases and that is not in ``known``;
                for biases that do not exist or are out of range.
            TypeError: for a quantity in ``known`` that does not exist.

        Source: Nozaki, Delbruck, IEEE Trans. Electron Devices 2017, doi:10.1109/TED.2017.2717848, as used by jAER.
        """
        sensor = cls(**known)
        values = as_biases(biases)
        derived: dict[str, Any] = {
            name: formula(name, values) for name, formula in _FORMULAS.items() if name not in known
        }
        return replace(sensor, **derived)

    def _repr_html_(self) -> str:
        known = [(field.name, getattr(self, field.name)) for field in fields(self)]
        rows = [(name, with_unit(name, value)) for name, value in known if value is not None]
        return html_table("SensorParameters", rows or [("none", "ideal pixels")])

    @property
    def noise_half_lux(self) -> float | None:
        """``shot_noise_half_lux``, or its default.

        The default is the illuminance at which photoreceptor and source follower have the same corner; None where
        these are not known.
        """
        hz, lux = self.photoreceptor_bandwidth_hz, self.photoreceptor_bandwidth_lux
        follower_hz = self.source_follower_bandwidth_hz
        if self.shot_noise_half_lux is not None or hz is None or lux is None or follower_hz is None:
            return self.shot_noise_half_lux
        return follower_hz / hz * lux

    @property
    def start_phase(self) -> str:
        """Return where references lie at the first frame.

        ``stationary``, as in a camera that has run before; ``zero`` for ideal pixels, of which no parameter is given.
        It does not depend on which effects are on.
        """
        return "zero" if self == SensorParameters() else "stationary"

    def effects(self, lux_per_luma: float) -> Effects:
        """Return the effects that this sensor has in a scene whose unit of luma is ``lux_per_luma`` lux.

        Thresholds are not effects: the simulation takes them by their own names.

        Raises:
            ValueError: for a scale that is not finite and > 0.
        """
        check_range("lux_per_luma", lux_per_luma, 0.0, math.inf, "lux")
        if lux_per_luma == 0:
            raise ArgumentError("{lux_per_luma} must be finite and > 0 lux, got {!r}", lux_per_luma)
        hz, lux = self.photoreceptor_bandwidth_hz, self.photoreceptor_bandwidth_lux
        follower_hz = self.source_follower_bandwidth_hz
        receptor_hz = hz * lux_per_luma / lux if hz is not None and lux is not None else math.inf
        half_lux, full_scale_lux = self.noise_half_lux, self.aps_full_scale_lux
        return Effects(
            vignetting=self.vignetting,
            lens_blur_px=self.lens_blur_px,
            photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(receptor_hz, _first(follower_hz, math.inf)),
            threshold_mismatch=ThresholdMismatch(
                _first(self.threshold_mismatch, 0.0),
                column_parity=_first(self.threshold_column_parity, 0.0),
                correlation=_first(self.threshold_correlation, 0.0),
            ),
            refractory_period_us=self.refractory_period_us,
            leak_rate_hz=_effect(
                LeakRate,
                rate_hz=self.leak_rate_hz,
                spread=self.leak_spread,
                jitter=self.leak_jitter,
                temperature_c=self.temperature_c,
                double_luma=self.leak_double_lux and self.leak_double_lux / lux_per_luma,
            ),
            shot_noise_rms=_effect(
                ShotNoise,
                rms=0.0 if self.shot_noise_rms is None and self.shot_noise_floor else self.shot_noise_rms,
                half_luma=half_lux and half_lux / lux_per_luma,
                bandwidth_hz=follower_hz if self.shot_noise_bandwidth_hz is None else self.shot_noise_bandwidth_hz,
                floor=self.shot_noise_floor,
            ),
            hot_pixels=_effect(HotPixels, fraction=self.hot_pixel_fraction, rate_hz=self.hot_pixel_rate_hz),
            readout=_effect(
                Readout,
                events_per_s=self.readout_events_per_s,
                row_us=self.readout_row_us,
                latency_us=self.readout_latency_us,
                jitter_us=self.readout_jitter_us,
                by_columns=self.readout_by_columns,
            ),
            aps=_effect(
                Aps,
                exposure_us=self.aps_exposure_us,
                read_noise_dn=self.aps_read_noise_dn,
                bits=self.aps_bits,
                full_scale_luma=full_scale_lux and full_scale_lux / lux_per_luma,
                full_well_e=self.aps_full_well_e,
                electrons_per_dn=self.aps_electrons_per_dn,
                prnu=self.aps_prnu,
                dsnu_dn=self.aps_dsnu_dn,
                column_offset_dn=self.aps_column_offset_dn,
                column_noise_dn=self.aps_column_noise_dn,
                row_readout_us=self.aps_row_readout_us,
            ),
        )

    def dark_luma(self, lux_per_luma: float) -> float | None:
        """Return the dark current in units of luma, at the sensor's temperature; None where it is not known.

        It is the ``log_eps`` of L = ln(luma + log_eps), because the photoreceptor sees light and dark current.
        """
        if self.dark_current_lux is None:
            return None
        doublings = warmth(_first(self.temperature_c, REFERENCE_C), LeakRate.doubling_c)
        return self.dark_current_lux * doublings / lux_per_luma


def _first(given: float | None, otherwise: float) -> float:
    return otherwise if given is None else given


_Effect = TypeVar("_Effect")


def _effect(effect: Callable[..., _Effect], **values: float | None) -> _Effect | None:
    """Make an effect from the values that are known; return None where the first one is unknown."""
    known = {name: value for name, value in values.items() if value is not None}
    return effect(**known) if next(iter(values)) in known else None


_Biases = Mapping[str, CoarseFineBias]


def _uncovered(quantity: str, why: str) -> ValueError:
    return ValueError(
        f"{quantity} does not follow from these biases: {why}; "
        f"give it, as in from_biases(..., {quantity}=...), or None to leave it open"
    )


def _current_a(quantity: str, name: str, biases: _Biases) -> float:
    if name not in biases:
        raise _uncovered(quantity, f"it needs {name}, which is not among them")
    if biases[name].fine == 0:
        raise _uncovered(quantity, f"{name} is {biases[name]}, for which the table of currents gives 0 A")
    return biases[name].current_a


def _threshold(quantity: str, comparator: str, sign: int, biases: _Biases) -> float:
    current, amplifier = (_current_a(quantity, name, biases) for name in (comparator, "DiffBn"))
    threshold = sign * THRESHOLD_GAIN * math.log(current / amplifier)
    if threshold <= 0:
        rule = "more" if sign > 0 else "less"
        raise _uncovered(
            quantity,
            f"{comparator} {biases[comparator]} ({current:.3g} A) must be {rule} than "
            f"DiffBn {biases['DiffBn']} ({amplifier:.3g} A)",
        )
    return threshold


def _on_threshold(quantity: str, biases: _Biases) -> float:
    return _threshold(quantity, "OnBn", 1, biases)


def _off_threshold(quantity: str, biases: _Biases) -> float:
    return _threshold(quantity, "OffBn", -1, biases)


def _follower_bandwidth_hz(quantity: str, biases: _Biases) -> float:
    current = _current_a(quantity, "PrSFBp", biases)
    if "PrBp" in biases and current > biases["PrBp"].current_a / 2:
        raise _uncovered(
            quantity,
            f"PrSFBp {biases['PrSFBp']} ({current:.3g} A) must be at most half of PrBp {biases['PrBp']} "
            f"({biases['PrBp'].current_a:.3g} A), or the photoreceptor limits it",
        )
    return current / (2 * math.pi * THERMAL_VOLTAGE_V * INPUT_CAPACITANCE_F)


def _refractory_period_us(quantity: str, biases: _Biases) -> float:
    return 1e6 * REFRACTORY_CAPACITANCE_F * REFRACTORY_SWING_V / _current_a(quantity, "RefrBp", biases)


_FORMULAS: dict[str, Callable[[str, _Biases], float]] = {
    "contrast_threshold": _on_threshold,
    "contrast_threshold_off": _off_threshold,
    "source_follower_bandwidth_hz": _follower_bandwidth_hz,
    "refractory_period_us": _refractory_period_us,
}


def _weights(name: str, text: str | None) -> Weights | None:
    """Return the three numbers of a text."""
    if text is None:
        return None
    try:
        red, green, blue = (float(word) for word in text.split())
        ColourFilter(red=(red, green, blue))
    except (AttributeError, ValueError):
        raise ValueError(f"{name} must be three weights >= 0, not all 0, got {text!r}") from None
    return red, green, blue
