"""Reads how glossy materials reflect, as the native renderer knows it: one lobe over a diffuse colour, or glass.

Mitsuba's plastic, roughplastic, pplastic, conductor, roughconductor, principled, dielectric, roughdielectric,
thindielectric, polarizer and diffuse mask become a :class:`Finish` and a base colour. docs/light.md says what is
approximate.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaBsdf, MitsubaObject, MitsubaTexture
from ..scene.texel_lookup import WRAP_MODES
from .texels import LUMINANCE, bilinear_meaning, looked_up, lookup_positions, uv_map_of

FloatArray = npt.NDArray[np.float64]
_Rgb = tuple[float, float, float]
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
]
"""What the core takes, see :class:`davis_rs._core.SceneRenderer`."""

_COSINES, _WEIGHTS = (np.polynomial.legendre.leggauss(64)[0] + 1) / 2, np.polynomial.legendre.leggauss(64)[1] / 2
"""For means over directions: nodes in 0..1, and their weights, whose sum is 1."""

_ROUND = 1e-3
"""A principled material is never smoother than this."""

"""Of red, green and blue (3, 1), as Mitsuba makes one number of a colour."""

_HALF = 0.5
"""The mean opacity from which on a surface stops light that is baked."""

_UNBENT = 1 + 1e-9
"""The index of what neither bends nor reflects light; the core asks for one other than 1."""

_PASSING_NODES = 33
"""Cosines at which it is known what passes a rough coat."""

_PERIOD = 256
"""Texels along a side of a checkerboard's period: its edges become ramps of one texel."""

_LEAST_ALPHA = 1e-4
"""A brushed surface is never smoother than this, as Mitsuba's is not."""

_UNUSED = ("clearcoat", "sheen", "flatness", "spec_tint", "spec_trans")
"""Parts of ``principled`` that a finish does not have: they must be 0."""


@dataclass(frozen=True)
class NumberTexels:
    """Roughness or the fraction of metal from place to place, looked up at the texture coordinates of the base colour.

    Attributes:
        height, width: texels along each side.
        wrap: index into :data:`~davis_rs.scene.texel_lookup.WRAP_MODES`.
        values: the texels, 0 to 1, as the bytes of float32 (height, width).
    """

    height: int
    width: int
    wrap: int
    values: bytes = field(repr=False)

    @property
    def image(self) -> npt.NDArray[np.float32]:
        """The texels (height, width)."""
        return np.frombuffer(self.values, np.float32).reshape(self.height, self.width)


@dataclass(frozen=True)
class Finish:
    """How a surface reflects, besides its base colour.

    Attributes:
        alpha: roughness of the microfacets; 0 is a mirror. Of a brushed surface that along the direction in which u
            grows.
        distribution: of the microfacets, ``ggx`` or ``beckmann``.
        fresnel: ``dielectric`` (index), ``conductor`` (index and extinction, three channels each) or ``mixed`` (index,
            fraction of metal).
        tint: factor on the lobe, RGB.
        passing: factor on light that passes through, RGB.
        base_tints: the base colour is a factor on the lobe.
        under: what is below: ``nothing``, ``coated`` (index, reflected inside, entering, 1 if nonlinear; for a rough
            coat the fractions that pass it follow, at :data:`_PASSING_NODES` cosines from 0 to 1), ``rough``
            (roughness, factor), ``solid`` (index; its surface is as rough as ``alpha`` says), ``sheet`` (index) or
            ``blend`` (opacity: a diffuse base covers so much, and the rest is seen through).
        lobe: roughness and metal from place to place, of ``mixed`` over ``rough``; ``alpha`` and ``across``, over
            ``nothing`` or of ``solid``; or opacity and None, of ``blend``. Its own numbers are then means. None for
            what is the same everywhere.
        across: of a brushed surface, roughness at right angles to that of ``alpha``; None where it is the same.
    """

    alpha: float
    distribution: str
    fresnel: _Kind
    tint: _Rgb = (1.0, 1.0, 1.0)
    passing: _Rgb = (1.0, 1.0, 1.0)
    base_tints: bool = False
    under: _Kind = ("nothing", ())
    lobe: tuple[NumberTexels | None, NumberTexels | None] = (None, None)
    across: float | None = None

    @property
    def blends(self) -> bool:
        """Whether it covers a part of its area, and the rest is seen through."""
        return self.under[0] == "blend"

    @property
    def is_null(self) -> bool:
        """Whether light passes it as where nothing is, all of it or a part: Mitsuba's volumetric integrators let lamps
        shine through."""
        return self.blends or self.under == ("sheet", (_UNBENT,))

    @property
    def is_clear(self) -> bool:
        """Whether light that is baked passes through as if it were not there."""
        kind, values = self.under
        return kind in ("solid", "sheet") or (self.blends and values[0] < _HALF)

    def core(self, numbers_of: Mapping[NumberTexels, int]) -> CoreFinish:
        """Return it as the core takes it, with the numbers of its textures of roughness and metal."""
        (fresnel, numbers), (under, below) = self.fresnel, self.under
        tints = list(self.tint), list(self.passing)
        kinds = (fresnel, list(numbers)), (under, list(below))
        lobe = [None if texels is None else numbers_of[texels] for texels in self.lobe]
        return (self.alpha, self.across), self.distribution, kinds[0], *tints, self.base_tints, kinds[1], lobe

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
            index, metallic = values
            plain = self._lobe(lambda c: dielectric(c, index))
            whole, grazing = self._lobe(np.ones_like), self._lobe(lambda c: (1 - c) ** 5)
            lobe = (1 - metallic) * plain + metallic * (base * whole + (1 - base) * grazing)
        lobe = lobe * np.array(self.tint) * (base if self.base_tints else 1.0)
        return np.minimum(lobe + self._below(base), 1.0)

    def _lobe(self, reflected: Callable[[FloatArray], FloatArray]) -> float:
        """Return the mean of what the lobe reflects, less what rough microfacets hide from each other."""
        if self.alpha == 0:
            return _mean(reflected)
        alpha = self.alpha if self.across is None else float(np.sqrt(self.alpha * self.across))
        facets, hidden, weights = _facets_seen(alpha, self.distribution)
        return float((reflected(facets) * hidden * weights).sum())

    def _below(self, base: FloatArray) -> FloatArray:
        kind, values = self.under
        if kind == "coated":
            index, inside, entering, nonlinear = values[:4]
            return base * (entering / index) ** 2 / (1 - (base * inside if nonlinear else inside))
        if kind == "rough":
            return base * values[1] * _rough_albedo(values[0])
        return np.zeros_like(base)


def dielectric(cosine: FloatArray, index: float) -> FloatArray:
    """Return what a dielectric reflects at cosines, unpolarised; ``index`` is relative to the side of the light."""
    squared = 1 - (1 - cosine**2) / index**2
    inside = np.sqrt(np.maximum(squared, 0.0))
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return np.where(squared > 0, (across**2 + along**2) / 2, 1.0)


def read_finish(
    bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba
) -> tuple[MitsubaTexture, Finish] | None:
    """Return the base colour and the finish of a glossy material; None of one that has no finish.

    Args:
        inside: the objects inside it, by name.
        mi: Mitsuba, under the variant that loaded it.
    """
    reader = _READERS.get(bsdf.class_name())
    return None if reader is None else reader(bsdf, inside, mi)


def finish_remedy(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> str:
    """Return what would give a glossy material a finish, as a part of a message; "" where nothing is known.

    Args:
        inside, mi: as of :func:`read_finish`.
    """
    kind = bsdf.class_name()
    if kind in ("RoughConductor", "RoughDielectric", "PolarizedPlastic"):
        alphas = [inside[name] for name in _ALPHAS if name in inside]
        if any(_scalar(alpha, mi) is None for alpha in alphas):
            return "give it a roughness that is a number, or a bilinear bitmap or a checkerboard of 0 to 1"
        if kind == "PolarizedPlastic" and _same_alpha(inside, mi) is None:
            return "give it one alpha that is the same everywhere"
        if any(constant_of(alpha, mi) is None for alpha in alphas):
            return "look its roughness and its other textures up at the same coordinates"
        return ""
    if kind == "Principled":
        return f"set its {' and '.join(more)} to 0" if (more := _parts_left_out(inside, mi)) else ""
    return ""


def read_blend(base: MitsubaTexture, opacity: MitsubaTexture, mi: Mitsuba) -> tuple[MitsubaTexture, Finish] | None:
    """Return the colour and the finish of a diffuse surface that covers a part of its area.

    None where the opacity is neither a number nor a bilinear bitmap at the texture coordinates of the colour.
    """
    covered = _scalar(opacity, mi)
    if covered is None or not 0 <= covered.mean <= 1:
        return None
    placed = _placed(base, covered, mi=mi)
    if placed is None:
        return None
    under = "blend", (covered.mean,)
    return placed, Finish(0.0, "ggx", ("dielectric", (1.5,)), under=under, lobe=(covered.texels, None))


def mixed_colour(
    colours: tuple[MitsubaTexture, MitsubaTexture], weight: MitsubaTexture, mi: Mitsuba
) -> MitsubaTexture | None:
    """Return a texture that is two colours in one, the second by a weight from place to place, within 0..1.

    None where a colour is not the same everywhere, or the weight neither a number nor a bilinear bitmap.
    """
    first, second = (constant_of(colour, mi) for colour in colours)
    by, same = _scalar(weight, mi), constant_of(weight, mi)
    if first is None or second is None or by is None or (same is not None and np.ptp(same) > 0):
        return None
    first, second = np.array(_rgb(first)), np.array(_rgb(second))
    if by.texels is None or by.uv_map is None:
        part = min(max(by.mean, 0.0), 1.0)
        return mi.load_dict({"type": "rgb", "value": (first + part * (second - first)).tolist()})
    texels = (first + by.texels.image[..., None] * (second - first)).astype(np.float32)
    mode, to_uv = WRAP_MODES[by.texels.wrap], mi.ScalarTransform3f(by.uv_map.tolist())
    return mi.load_dict({"type": "bitmap", "raw": True, "data": mi.TensorXf(texels), "wrap_mode": mode, "to_uv": to_uv})


def constant_of(texture: MitsubaTexture, mi: Mitsuba) -> FloatArray | None:
    """Return the value of a texture that is the same everywhere; None of any other texture, and of encoded texels."""
    parameters = mi.traverse(texture)
    if "value" in parameters:
        return np.array(parameters["value"], np.float64)
    if "data" not in parameters:
        return None
    texels = np.asarray(parameters["data"])
    alike = np.issubdtype(texels.dtype, np.floating) and np.ptp(texels) == 0
    return texels.reshape(-1)[:1].astype(np.float64) if alike else None


_Read = tuple[MitsubaTexture, Finish] | None


def _plastic(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    parameters = mi.traverse(bsdf)
    tint = _tint(inside, "specular_reflectance", mi)
    if tint is None:
        return None
    index = float(parameters["eta"])
    base = inside["diffuse_reflectance"]
    nonlinear = float(_word(bsdf, "nonlinear") in ("1", "true"))
    fresnel = "dielectric", (index,)
    if bsdf.class_name() == "SmoothPlastic":
        entering = 1 - _mean(lambda c: dielectric(c, index))
        coat = index, float(_word(bsdf, "fdr_int")), entering, nonlinear
        return base, Finish(0.0, "ggx", fresnel, tint, under=("coated", coat))
    reflected, passing = _rough_coat(float(parameters["alpha"]), _distribution(bsdf), index, mi)
    entering = _mean(lambda c: np.interp(c, np.linspace(0, 1, _PASSING_NODES), passing))
    rough = index, reflected, entering, nonlinear, *passing
    finish = Finish(float(parameters["alpha"]), _distribution(bsdf), fresnel, tint, under=("coated", rough))
    return base, finish


def _rough_coat(alpha: float, distribution: str, index: float, mi: Mitsuba) -> tuple[float, list[float]]:
    """Return how much a rough coat reflects inside, and how much passes it at cosines from 0 to 1.

    Mitsuba computes both but does not tell them, so they are found by what its own material does over grey.
    """
    coat = {"type": "roughplastic", "diffuse_reflectance": 0.5, "distribution": distribution, "alpha": alpha}
    coat |= {"int_ior": index, "ext_ior": 1.0}
    kinds = [mi.load_dict({**coat, "nonlinear": nonlinear}) for nonlinear in (False, True)]
    context = mi.BSDFContext()
    context.component = 1  # the base

    def base(bsdf: MitsubaBsdf, cosine: float) -> float:
        """Return its reflectance for light and viewer at this cosine."""
        sine = float(np.sqrt(1 - cosine**2))
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f(sine, 0.0, cosine)
        value = bsdf.eval(context, interaction, mi.Vector3f(-sine, 0.0, cosine))
        return float(np.array(value).reshape(-1)[0]) * np.pi / cosine

    # They differ by (1 - reflected / 2) / (1 - reflected).
    ratio = base(kinds[0], 1.0) / base(kinds[1], 1.0)
    reflected = (ratio - 1) / (ratio - 0.5)
    cosines = np.maximum(np.linspace(0, 1, _PASSING_NODES), 1e-3).tolist()
    passing = [float(np.sqrt(base(kinds[0], cosine) / 0.5 * index**2 * (1 - reflected))) for cosine in cosines]
    return reflected, passing


_ALPHAS = ("alpha", "alpha_u", "alpha_v")


def _alphas(inside: dict[str, MitsubaObject], mi: Mitsuba) -> list[_Scalar] | None:
    """Return the roughness of microfacets: one number, or of a brushed surface those along u and across it.

    None where one is no texture that :func:`_scalar` reads.
    """
    alphas = [_scalar(inside[name], mi) for name in _ALPHAS if name in inside]
    known = [alpha for alpha in alphas if alpha is not None]
    if len(known) < len(alphas):
        return None
    alike = all(alpha.texels is None and alpha.mean == known[0].mean for alpha in known)
    return known[:1] if alike else known


def _same_alpha(inside: dict[str, MitsubaObject], mi: Mitsuba) -> float | None:
    """Return the roughness of microfacets; None where it differs from place to place, or between along and across."""
    alphas = _alphas(inside, mi)
    return alphas[0].mean if alphas is not None and len(alphas) == 1 and alphas[0].texels is None else None


class _Rough(NamedTuple):
    """Roughness, as a :class:`Finish` has it."""

    alpha: float
    across: float | None
    lobe: tuple[NumberTexels | None, NumberTexels | None]


def _rough(base: MitsubaTexture, inside: dict[str, MitsubaObject], mi: Mitsuba) -> tuple[MitsubaTexture, _Rough] | None:
    """Return the base colour of a rough surface, and its roughness; None where their coordinates differ."""
    alphas = _alphas(inside, mi)
    placed = None if alphas is None else _placed(base, *alphas, brushed=len(alphas) > 1, mi=mi)
    if alphas is None or placed is None:
        return None
    if len(alphas) == 1:
        return placed, _Rough(alphas[0].mean, None, (alphas[0].texels, None))
    along, across = alphas
    return placed, _Rough(max(along.mean, _LEAST_ALPHA), max(across.mean, _LEAST_ALPHA), (along.texels, across.texels))


def _polarized_plastic(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    """Read a ``pplastic`` as it is where light has no polarization: what enters its coat and leaves it once is light of
    the base, and nothing is reflected inside."""
    alpha, tint = _same_alpha(inside, mi), _tint(inside, "specular_reflectance", mi)
    eta = constant_of(inside["eta"], mi)
    if alpha is None or tint is None or eta is None or eta.flat[0] <= 1:
        return None
    index = float(eta.flat[0])
    entering = 1 - _mean(lambda c: dielectric(c, index))
    # Light of a base below a coat is weaker by the square of the index, for which its reflections inside make up.
    under = "coated", (index, 1 - 1 / index**2, entering, 0.0)
    finish = Finish(alpha, _distribution(bsdf), ("dielectric", (index,)), tint, under=under)
    return inside["diffuse_reflectance"], finish


def _metal(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    own = inside.get("specular_reflectance")
    base = _white(mi) if own is None else own
    rough = _rough(base, inside, mi) if bsdf.class_name() == "RoughConductor" else (base, _MIRROR)
    eta, k = (constant_of(inside[name], mi) for name in ("eta", "k"))
    if rough is None or eta is None or k is None:
        return None
    base, (alpha, across, lobe) = rough
    distribution = "ggx" if alpha == 0 else _distribution(bsdf)
    fresnel = "conductor", (*_rgb(eta), *_rgb(k))
    return base, Finish(alpha, distribution, fresnel, base_tints=own is not None, lobe=lobe, across=across)


def _principled(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    parameters = mi.traverse(bsdf)
    if _parts_left_out(inside, mi):
        return None
    brushed = constant_of(inside["anisotropic"], mi) if "anisotropic" in inside else np.zeros(1)
    surface = None if brushed is None else _lobe(inside, mi, brushed=bool(brushed.any()))
    if brushed is None or surface is None:
        return None
    base, lobe, rough, metal = surface
    if "eta" in parameters:
        index = float(parameters["eta"])
    else:
        root = np.sqrt(0.08 * float(parameters["specular"]))
        index = float((1 + root) / (1 - root))
    # Without a difference of the index nothing is reflected; the core asks for one.
    index = max(index, 1 + 1e-6)
    under, squared, across = ("rough", (rough, 1 - metal)), rough * rough, None
    if brushed.any():
        aspect = float(np.sqrt(1 - 0.9 * brushed.flat[0]))  # Burley 2012, section 5.4
        squared, across = squared / aspect, max(squared * aspect, _ROUND)
    alpha = max(squared, _ROUND)
    return base, Finish(alpha, "ggx", ("mixed", (index, metal)), under=under, lobe=lobe, across=across)


def _parts_left_out(inside: dict[str, MitsubaObject], mi: Mitsuba) -> list[str]:
    """Return the parts of a ``principled`` material that it has and a finish has not."""
    left_out = [
        name for name in _UNUSED if name in inside and ((value := constant_of(inside[name], mi)) is None or value.any())
    ]
    if "anisotropic" in inside:
        brushed = constant_of(inside["anisotropic"], mi)
        textured = any(constant_of(inside[name], mi) is None for name in ("roughness", "metallic"))
        if brushed is None or (brushed.any() and textured):
            left_out.insert(0, "anisotropic")
    return left_out


def _lobe(
    inside: dict[str, MitsubaObject], mi: Mitsuba, *, brushed: bool
) -> tuple[MitsubaTexture, tuple[NumberTexels | None, NumberTexels | None], float, float] | None:
    """Return the base colour of a ``principled`` material, its roughness and metal from place to place, and their
    means; None where their textures are not looked up at the same coordinates, or are none that are known."""
    rough, metal = (_scalar(inside[name], mi) for name in ("roughness", "metallic"))
    if rough is None or metal is None:
        return None
    base = inside["base_color"]
    lobe = rough.texels, metal.texels
    placed = _placed(base, rough, metal, brushed=brushed, mi=mi)
    return None if placed is None else (placed, lobe, rough.mean, metal.mean)


def _placed(base: MitsubaTexture, *others: _Scalar, brushed: bool = False, mi: Mitsuba) -> MitsubaTexture | None:
    """Return a base colour that is looked up at the same coordinates as other textures; None where it is not.

    Args:
        brushed: it needs coordinates in any case, whose axes are those of the mesh.
    """
    uv_maps = [number.uv_map for number in others if number.uv_map is not None]
    colour = constant_of(base, mi)
    if colour is None and (of_base := _uv_map(base, mi)) is not None:
        uv_maps.insert(0, of_base)
    elif colour is None:
        return None if uv_maps or brushed else base
    uv_maps = uv_maps or ([np.eye(3)] if brushed else [])
    if not uv_maps:
        return base
    if any(not np.array_equal(other, uv_maps[0]) for other in uv_maps):
        return None
    if brushed and (uv_maps[0][0, 1] != 0 or uv_maps[0][1, 0] != 0):
        return None
    if colour is None:
        return base
    # A texture of one texel has no coordinates, so it gets a second one.
    texels = np.broadcast_to(_rgb(colour), (1, 2, 3)).astype(np.float32)
    to_uv = mi.ScalarTransform3f(uv_maps[0].tolist())
    return mi.load_dict({"type": "bitmap", "raw": True, "data": mi.TensorXf(texels), "to_uv": to_uv})


class _Scalar(NamedTuple):
    """A texture of one number.

    Attributes:
        mean: of it.
        texels: None where it is the same everywhere.
        uv_map: (3, 3), the transform of its coordinates; None where it is the same everywhere.
    """

    mean: float
    texels: NumberTexels | None = None
    uv_map: FloatArray | None = None


def _scalar(texture: MitsubaTexture, mi: Mitsuba) -> _Scalar | None:
    """Read a texture of numbers from 0 to 1; None of one that is no constant, bitmap or checkerboard of them."""
    value = constant_of(texture, mi)
    if value is not None:
        return _Scalar(float(value.flat[0]))
    if texture.class_name() == "Checkerboard":
        return _checkerboard(texture, mi)
    uv_map = _uv_map(texture, mi)
    if uv_map is None:
        return None
    data = np.asarray(mi.traverse(texture)["data"])
    uv, mapped = lookup_positions(uv_map)
    meant = bilinear_meaning(data, mapped, looked_up(texture.eval_1, uv, mi), LUMINANCE)
    if meant is None:
        return None
    texels, wrap = meant
    values = np.concatenate([piece @ LUMINANCE for _, piece in texels.pieces()]).astype(np.float32)
    if not (values.min() >= 0 and values.max() <= 1):
        return None
    height, width = texels.shape[:2]
    return _Scalar(float(values.mean()), NumberTexels(height, width, wrap, values.tobytes()), uv_map)


def _checkerboard(texture: MitsubaTexture, mi: Mitsuba) -> _Scalar | None:
    """Read a checkerboard of two numbers from 0 to 1 as one period of texels; None of one of other textures."""
    parameters = mi.traverse(texture)
    keys = ["color0.value", "color1.value"]
    if any(key not in parameters for key in keys):
        return None
    first, second = (_luminance(np.array(parameters[key], np.float64)) for key in keys)
    if not (0 <= first <= 1 and 0 <= second <= 1):
        return None
    half = np.arange(_PERIOD) >= _PERIOD // 2
    # Rows go down as v goes up, as those of a bitmap.
    values = np.where(half == half[::-1, None], first, second).astype(np.float32)
    texels = NumberTexels(_PERIOD, _PERIOD, WRAP_MODES.index("repeat"), values.tobytes())
    return _Scalar((first + second) / 2, texels, uv_map_of(parameters))


def _luminance(value: FloatArray) -> float:
    """Return the one number that Mitsuba makes of a number or of red, green and blue."""
    return float((np.array(_rgb(value)) @ LUMINANCE)[0])


def _uv_map(texture: MitsubaTexture, mi: Mitsuba) -> FloatArray | None:
    """Return the transform (3, 3) of a bitmap's coordinates; None of another texture."""
    parameters = mi.traverse(texture)
    if "data" not in parameters or "to_uv" not in parameters:
        return None
    return uv_map_of(parameters)


def _glass(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    index = float(mi.traverse(bsdf)["eta"])
    kind = "sheet" if bsdf.class_name() == "ThinDielectric" else "solid"
    tint, passing = (_tint(inside, name, mi) for name in ("specular_reflectance", "specular_transmittance"))
    base = _white(mi)
    rough = _rough(base, inside, mi) if bsdf.class_name() == "RoughDielectric" else (base, _MIRROR)
    if tint is None or passing is None or index == 1 or rough is None:
        return None
    base, (alpha, across, lobe) = rough
    distribution, under = "ggx" if alpha == 0 else _distribution(bsdf), (kind, (index,))
    fresnel = "dielectric", (index,)
    return base, Finish(alpha, distribution, fresnel, tint, passing, under=under, lobe=lobe, across=across)


def _polarizer(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    """Read a polarizer as it is where light has no polarization: it takes half of it."""
    transmittance = constant_of(inside["transmittance"], mi)
    if transmittance is None:
        return None
    half, index = _rgb(transmittance / 2), (_UNBENT,)
    return _white(mi), Finish(0.0, "ggx", ("dielectric", index), passing=half, under=("sheet", index))


_MIRROR = _Rough(0.0, None, (None, None))

_READERS: dict[str, Callable[[MitsubaBsdf, dict[str, MitsubaObject], Mitsuba], _Read]] = {
    "SmoothPlastic": _plastic,
    "RoughPlastic": _plastic,
    "PolarizedPlastic": _polarized_plastic,
    "SmoothConductor": _metal,
    "RoughConductor": _metal,
    "Principled": _principled,
    "SmoothDielectric": _glass,
    "RoughDielectric": _glass,
    "ThinDielectric": _glass,
    "LinearPolarizer": _polarizer,
}


def _tint(inside: dict[str, MitsubaObject], name: str, mi: Mitsuba) -> _Rgb | None:
    """Return a colour that a material may have; None where it differs from place to place."""
    if name not in inside:
        return 1.0, 1.0, 1.0
    value = constant_of(inside[name], mi)
    return None if value is None else _rgb(value)


def _rgb(value: FloatArray) -> _Rgb:
    red, green, blue = np.broadcast_to(value.reshape(-1), (3,)).tolist()
    return red, green, blue


def _white(mi: Mitsuba) -> MitsubaTexture:
    return mi.load_dict({"type": "uniform", "value": 1.0})


def _distribution(bsdf: MitsubaBsdf) -> str:
    return _word(bsdf, "distribution")


def _word(bsdf: MitsubaBsdf, name: str) -> str:
    """Return what a material says of itself; Mitsuba has no other way to ask."""
    named = re.search(rf"\b{name} = ([\w.]+)", str(bsdf))
    return named[1] if named else ""


def _mean(reflected: Callable[[FloatArray], FloatArray]) -> float:
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
def _rough_albedo(roughness: float) -> float:
    """Return the albedo of Burley's diffuse base, for a white one."""
    light, viewer = (_COSINES[:, None, None], _COSINES[None, :, None])
    azimuth = np.cos(np.pi * (np.arange(16) + 0.5) / 16)
    sines = np.sqrt(1 - light**2) * np.sqrt(1 - viewer**2)
    returned = roughness * (1 + light * viewer + sines * azimuth)
    into, out = (1 - light) ** 5, (1 - viewer) ** 5
    value = (1 - into / 2) * (1 - out / 2) + returned * (into + out + into * out * (returned - 1))
    weights = 4 * light * viewer * _WEIGHTS[:, None, None] * _WEIGHTS[None, :, None] / 16
    return float((value * weights).sum())


def _conductor(cosine: FloatArray, eta: float, k: float) -> FloatArray:
    squared, sine = cosine**2, 1 - cosine**2
    rest = eta**2 - k**2 - sine
    length = np.sqrt(rest**2 + 4 * eta**2 * k**2)
    real = np.sqrt(np.maximum((length + rest) / 2, 0.0))
    even, odd = length + squared, 2 * cosine * real
    across = (even - odd) / (even + odd)
    even, odd = squared * length + sine**2, odd * sine
    return across * (1 + (even - odd) / (even + odd)) / 2
