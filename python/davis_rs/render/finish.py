"""Says how glossy surfaces reflect, as the native renderer knows it, and how much of the light from all sides."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .number_textures import NumberTexels

FloatArray = npt.NDArray[np.float64]
Rgb = tuple[float, float, float]
_Kind = tuple[str, tuple[float, ...]]

CoreFinish = tuple[
    tuple[float, float | None],
    str,
    tuple[str, list[float]],
    list[float],
    list[float],
    bool,
    tuple[str, list[float]],
    list[int | None],
    tuple[float, float] | None,
    tuple[float, float] | None,
    float,
    float,
]
"""What the core takes, see :class:`davis_rs._core.SceneRenderer`."""

_COSINES, _WEIGHTS = (np.polynomial.legendre.leggauss(64)[0] + 1) / 2, np.polynomial.legendre.leggauss(64)[1] / 2
"""For means over directions: nodes in 0..1, and their weights, whose sum is 1."""

_HALF = 0.5
"""Below this mean opacity, and above this transmission, light that is baked passes a surface."""

UNBENT = 1 + 1e-9
"""The index of what neither bends nor reflects light; the core asks for one other than 1."""

PASSING_NODES = 33
"""Cosines at which it is known what passes a rough coat."""


_SHEEN_ALBEDO = 0.01157
"""The albedo of whole sheen: pi times the mean of Schlick's weight over half vectors of all directions."""

_COAT_HIDING = 0.25
"""The roughness by which a coat's microfacets hide each other."""


@dataclass(frozen=True)
class Finish:
    """How a surface reflects, besides its base colour.

    Attributes:
        alpha: roughness of the microfacets; 0 is a mirror. Of an anisotropic surface, that along the direction in which
            u grows.
        distribution: of the microfacets, ``ggx`` or ``beckmann``.
        fresnel: ``dielectric`` (index), ``conductor`` (index and extinction, three channels each) or ``mixed`` (index,
            fraction of metal, fraction of other highlights that has the hue of the base colour).
        tint: factor on the lobe, RGB.
        passing: factor on light that passes through, RGB.
        base_tints: the base colour is a factor on the lobe.
        under: what is below: ``nothing``, ``coated`` (index, reflected inside, entering, 1 if nonlinear; for a rough
            coat the fractions that pass it follow, at :data:`PASSING_NODES` cosines from 0 to 1), ``rough``
            (roughness, factor), ``solid`` (index, and how much light is absorbed inside per unit of length, RGB; its
            surface is as rough as ``alpha`` says), ``sheet`` (index) or
            ``blend`` (opacity: a diffuse base covers so much, and the rest is seen through).
        lobe: roughness and metal from place to place, of ``mixed`` over ``rough``; ``alpha`` and ``across``, over
            ``nothing`` or of ``solid``; or opacity and None, of ``blend``. Its own numbers are then means. None for
            what is the same everywhere.
        across: of an anisotropic surface, roughness at right angles to that of ``alpha``; None where it is the same.
        coat: a second lobe above all else, of ``mixed`` over ``rough``: its strength and its roughness; None for none.
        sheen: of a ``rough`` base below ``mixed``: its strength, and the fraction that has the hue of the base colour;
            None for none.
        transmission: of ``mixed`` over ``rough``, the fraction of what is no metal that is the surface of a solid:
            light passes it, tinted by the root of the base colour.
        flatness: of such a ``rough`` base, the fraction of it that is as if light went below the surface.
    """

    alpha: float
    distribution: str
    fresnel: _Kind
    tint: Rgb = (1.0, 1.0, 1.0)
    passing: Rgb = (1.0, 1.0, 1.0)
    base_tints: bool = False
    under: _Kind = ("nothing", ())
    lobe: tuple[NumberTexels | None, NumberTexels | None] = (None, None)
    across: float | None = None
    coat: tuple[float, float] | None = None
    sheen: tuple[float, float] | None = None
    transmission: float = 0.0
    flatness: float = 0.0

    @property
    def blends(self) -> bool:
        """Whether it covers a part of its area, and the rest is seen through."""
        return self.under[0] == "blend"

    @property
    def is_null(self) -> bool:
        """Whether light passes it as where nothing is, all of it or a part: Mitsuba's volumetric integrators let lamps
        shine through."""
        return self.blends or self.under == ("sheet", (UNBENT,))

    @property
    def is_glass(self) -> bool:
        """Whether nothing below its mirror is diffuse."""
        return self.under[0] in ("solid", "sheet")

    @property
    def is_clear(self) -> bool:
        """Whether light that is baked passes through as if it were not there."""
        return self.is_glass or (self.blends and self.under[1][0] < _HALF) or self.transmission > _HALF

    @property
    def bends_light(self) -> bool:
        """Whether what is seen through it is seen along bent rays."""
        return self.under[0] == "solid" or self.transmission > 0

    def absorbing(self, absorption: Rgb) -> Finish:
        """Return the finish of a solid that absorbs light inside, RGB, per unit of length."""
        kind, (index, *_) = self.under
        assert kind == "solid"
        return replace(self, under=(kind, (index, *absorption)))

    def core(self, numbers_of: Mapping[NumberTexels, int]) -> CoreFinish:
        """Return it as the core takes it, with the numbers of its textures of roughness and metal."""
        (fresnel, numbers), (under, below) = self.fresnel, self.under
        tints = list(self.tint), list(self.passing)
        kinds = (fresnel, list(numbers)), (under, list(below))
        lobe = [None if texels is None else numbers_of[texels] for texels in self.lobe]
        return (
            (self.alpha, self.across),
            self.distribution,
            kinds[0],
            *tints,
            self.base_tints,
            kinds[1],
            lobe,
            self.coat,
            self.sheen,
            self.transmission,
            self.flatness,
        )

    def albedo(self, base: FloatArray) -> FloatArray:
        """Return how much of light from all sides is reflected (n, 3), for base colours (n, 3); 0 where it is clear.

        Light that bounces is baked as if surfaces were diffuse with this reflectance, so that no energy is lost. Each
        channel depends on itself alone: textures of 8 bits ask for 256 values of each.
        """
        if self.is_clear:
            return np.zeros_like(base)
        if self.blends:
            return base
        kind, values = self.fresnel
        if kind == "dielectric":
            lobe = np.full_like(base, self._lobe(lambda c: dielectric(c, values[0])))
        elif kind == "conductor":
            metal = [self._lobe(functools.partial(_conductor, eta=values[i], k=values[3 + i])) for i in range(3)]
            lobe = np.broadcast_to(np.array(metal), base.shape)
        else:
            # A tint is taken as white, because it mixes channels.
            index, metallic, _ = values
            plain = self._lobe(lambda c: dielectric(c, index))
            whole, grazing = self._lobe(np.ones_like), self._lobe(lambda c: (1 - c) ** 5)
            lobe = (1 - metallic) * plain + metallic * (base * whole + (1 - base) * grazing)
        lobe = lobe * np.array(self.tint) * (base if self.base_tints else 1.0)
        lobe = lobe + (0.0 if self.coat is None else _coat_albedo(*self.coat))
        return np.minimum(lobe + self._below(base), 1.0)

    def _lobe(self, reflected: Callable[[FloatArray], FloatArray]) -> float:
        """Return the mean of what the lobe reflects, less what rough microfacets hide from each other."""
        if self.alpha == 0:
            return mean_reflected(reflected)
        alpha = self.alpha if self.across is None else float(np.sqrt(self.alpha * self.across))
        facets, hidden, weights = _facets_seen(alpha, self.distribution)
        return float((reflected(facets) * hidden * weights).sum())

    def _below(self, base: FloatArray) -> FloatArray:
        kind, values = self.under
        if kind == "coated":
            index, inside, entering, nonlinear = values[:4]
            return base * (entering / index) ** 2 / (1 - (base * inside if nonlinear else inside))
        if kind == "rough":
            sheen = 0.0 if self.sheen is None else self.sheen[0] * _SHEEN_ALBEDO
            return values[1] * (base * _rough_albedo(values[0], self.flatness) + sheen)
        return np.zeros_like(base)


def dielectric(cosine: FloatArray, index: float) -> FloatArray:
    """Return what a dielectric reflects at cosines, unpolarised; ``index`` is relative to the side of the light."""
    squared = 1 - (1 - cosine**2) / index**2
    inside = np.sqrt(np.maximum(squared, 0.0))
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return np.where(squared > 0, (across**2 + along**2) / 2, 1.0)


def mean_reflected(reflected: Callable[[FloatArray], FloatArray]) -> float:
    """Return the mean over directions that follow the cosine."""
    return float((reflected(_COSINES) * 2 * _COSINES * _WEIGHTS).sum())


@functools.cache
def _facets_seen(alpha: float, distribution: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return microfacets that viewers of all directions see: the cosine to each, how much of what it reflects is not
    hidden by others, and its weight.

    They are those of GGX (Heitz 2018); for Beckmann's distribution they have other weights.
    """
    number = np.arange(256)
    radius, angle = np.sqrt((number + 0.5) / 256), 2 * np.pi * (number * 0.618033988749895 % 1)
    across, up = radius * np.cos(angle), radius * np.sin(angle)
    out = _COSINES[:, None]
    sine = np.sqrt(1 - out**2)
    length = np.sqrt((alpha * sine) ** 2 + out**2)
    x, z = alpha * sine / length, out / length
    most, fraction = np.sqrt(1 - across**2), (1 + z) / 2
    up = most * (1 - fraction) + up * fraction
    along = np.sqrt(np.maximum(1 - across**2 - up**2, 0.0))
    # The disk's axes: level, upwards, and towards the viewer.
    normal = np.stack([alpha * (-up * z + along * x), alpha * across + 0 * z, up * x + along * z])
    normal /= np.linalg.norm(normal, axis=0)
    facet = sine * normal[0] + out * normal[2]
    into = 2 * facet * normal[2] - out
    above = into > 0
    into = np.where(above, into, 1.0)
    weights = 2 * out * _WEIGHTS[:, None] / 256 * above
    if distribution == "ggx":
        return facet, _seen_of_ggx(into, alpha), weights
    squared = normal[2] ** 2
    dense = np.exp(-(1 - squared) / squared / alpha**2) / (np.pi * alpha**2 * squared**2)
    dense_of_ggx = alpha**2 / np.pi / (1 - squared * (1 - alpha**2)) ** 2
    weights = weights * dense / dense_of_ggx * _seen_of_beckmann(out, alpha) / _seen_of_ggx(out, alpha)
    return facet, _seen_of_beckmann(into, alpha), weights


def _seen_of_ggx(cosine: FloatArray, alpha: float) -> FloatArray:
    """Return the fraction of microfacets that are seen at cosines (Walter et al. 2007, equation 34)."""
    return 2 / (1 + np.sqrt(1 + alpha**2 * (1 - cosine**2) / cosine**2))


def _seen_of_beckmann(cosine: FloatArray, alpha: float) -> FloatArray:
    """Return the same of Beckmann's (equation 27)."""
    a = 1 / (alpha * np.sqrt(np.maximum(1 - cosine**2, 1e-12)) / cosine)
    return np.where(a < 1.6, (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2), 1.0)


@functools.cache
def _rough_albedo(roughness: float, flatness: float) -> float:
    """Return the albedo of Burley's diffuse base, for a white one, of which a fraction is flat."""
    light, viewer = (_COSINES[:, None, None], _COSINES[None, :, None])
    azimuth = np.cos(np.pi * (np.arange(16) + 0.5) / 16)
    sines = np.sqrt(1 - light**2) * np.sqrt(1 - viewer**2)
    returned = roughness * (1 + light * viewer + sines * azimuth)
    into, out = (1 - light) ** 5, (1 - viewer) ** 5
    value = (1 - into / 2) * (1 - out / 2) + returned * (into + out + into * out * (returned - 1))
    both = (1 + (returned / 2 - 1) * into) * (1 + (returned / 2 - 1) * out)
    value += flatness * (1.25 * (both * (1 / (light + viewer) - 0.5) + 0.5) - value)
    weights = 4 * light * viewer * _WEIGHTS[:, None, None] * _WEIGHTS[None, :, None] / 16
    return float((value * weights).sum())


@functools.cache
def _coat_albedo(strength: float, alpha: float) -> float:
    """Return the albedo of a coat, by microfacets in the middles of parts of equal size."""
    number, squared = np.arange(1024), alpha**2
    up = (1 - squared ** (1 - (number + 0.5) / 1024)) / (1 - squared)
    azimuth = np.cos(2 * np.pi * (number * 0.618033988749895 % 1))
    out = _COSINES[:, None]
    facet = np.sqrt(1 - out**2) * np.sqrt(1 - up) * azimuth + out * np.sqrt(up)
    into = 2 * facet * np.sqrt(up) - out
    above = (facet > 0) & (into > 0)
    facet, into = np.where(above, facet, 1.0), np.where(above, into, 1.0)
    fresnel = 0.04 + 0.96 * (1 - facet) ** 5
    seen = _seen_of_ggx(out, _COAT_HIDING) * _seen_of_ggx(into, _COAT_HIDING)
    weights = 2 * out * _WEIGHTS[:, None] / 1024 * above
    return float((strength * fresnel * seen * into * facet / np.sqrt(up) * weights).sum())


def _conductor(cosine: FloatArray, eta: float, k: float) -> FloatArray:
    squared, sine = cosine**2, 1 - cosine**2
    rest = eta**2 - k**2 - sine
    length = np.sqrt(rest**2 + 4 * eta**2 * k**2)
    real = np.sqrt(np.maximum((length + rest) / 2, 0.0))
    even, odd = length + squared, 2 * cosine * real
    across = (even - odd) / (even + odd)
    even, odd = squared * length + sine**2, odd * sine
    return across * (1 + (even - odd) / (even + odd)) / 2
