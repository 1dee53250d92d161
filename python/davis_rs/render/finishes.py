"""Reads how glossy materials reflect, as the native renderer knows it: a lobe over a diffuse colour, or glass.

Mitsuba's plastic, roughplastic, pplastic, conductor, roughconductor, principled, dielectric, roughdielectric,
thindielectric, polarizer and diffuse mask become a :class:`Finish` and a base colour. docs/light.md says what is
approximate.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaBsdf, MitsubaObject, MitsubaTexture
from ..scene.principled import COAT_ALPHAS, MOST_ANISOTROPIC, alphas_of
from ..scene.texel_lookup import WRAP_MODES
from .finish import PASSING_NODES, UNBENT, Finish, Rgb, dielectric, mean_reflected
from .number_textures import NumberTexels, NumberTexture, constant_of, number_texture, placed_alike, rgb_of

FloatArray = npt.NDArray[np.float64]

_LEAST_ALPHA = 1e-4
"""An anisotropic surface is never smoother than this, as Mitsuba's is not."""

_COAT = "clearcoat", "clearcoat_gloss"

_SHEEN = "sheen", "sheen_tint"


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
        if any(number_texture(alpha, mi) is None for alpha in alphas):
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

    None where the opacity is not read by :func:`number_texture`, or is at other texture coordinates than the colour.
    """
    covered = number_texture(opacity, mi)
    if covered is None or not 0 <= covered.mean <= 1:
        return None
    placed = placed_alike(base, covered, mi=mi)
    if placed is None:
        return None
    under = "blend", (covered.mean,)
    return placed, Finish(0.0, "ggx", ("dielectric", (1.5,)), under=under, lobe=(covered.texels, None))


def mixed_colour(
    colours: tuple[MitsubaTexture, MitsubaTexture], weight: MitsubaTexture, mi: Mitsuba
) -> MitsubaTexture | None:
    """Return a texture that is two colours in one, the second by a weight from place to place, within 0..1.

    None where a colour is not the same everywhere, or the weight is not read by :func:`number_texture`.
    """
    first, second = (constant_of(colour, mi) for colour in colours)
    by, same = number_texture(weight, mi), constant_of(weight, mi)
    if first is None or second is None or by is None or (same is not None and np.ptp(same) > 0):
        return None
    first, second = np.array(rgb_of(first)), np.array(rgb_of(second))
    if by.texels is None or by.uv_map is None:
        part = min(max(by.mean, 0.0), 1.0)
        return mi.load_dict({"type": "rgb", "value": (first + part * (second - first)).tolist()})
    texels = (first + by.texels.image[..., None] * (second - first)).astype(np.float32)
    mode, to_uv = WRAP_MODES[by.texels.wrap], mi.ScalarTransform3f(by.uv_map.tolist())
    return mi.load_dict({"type": "bitmap", "raw": True, "data": mi.TensorXf(texels), "wrap_mode": mode, "to_uv": to_uv})


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
        entering = 1 - mean_reflected(lambda c: dielectric(c, index))
        coat = index, float(_word(bsdf, "fdr_int")), entering, nonlinear
        return base, Finish(0.0, "ggx", fresnel, tint, under=("coated", coat))
    reflected, passing = _rough_coat(float(parameters["alpha"]), _distribution(bsdf), index, mi)
    entering = mean_reflected(lambda c: np.interp(c, np.linspace(0, 1, PASSING_NODES), passing))
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
    cosines = np.maximum(np.linspace(0, 1, PASSING_NODES), 1e-3).tolist()
    passing = [float(np.sqrt(base(kinds[0], cosine) / 0.5 * index**2 * (1 - reflected))) for cosine in cosines]
    return reflected, passing


_ALPHAS = ("alpha", "alpha_u", "alpha_v")


def _alphas(inside: dict[str, MitsubaObject], mi: Mitsuba) -> list[NumberTexture] | None:
    """Return the roughness of microfacets: one number, or of an anisotropic surface those along u and across it.

    None where one is no texture that :func:`_scalar` reads.
    """
    alphas = [number_texture(inside[name], mi) for name in _ALPHAS if name in inside]
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
    placed = None if alphas is None else placed_alike(base, *alphas, anisotropic=len(alphas) > 1, mi=mi)
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
    entering = 1 - mean_reflected(lambda c: dielectric(c, index))
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
    fresnel = "conductor", (*rgb_of(eta), *rgb_of(k))
    return base, Finish(alpha, distribution, fresnel, base_tints=own is not None, lobe=lobe, across=across)


def _principled(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    parameters = mi.traverse(bsdf)
    if _parts_left_out(inside, mi):
        return None
    anisotropic = _number(inside, "anisotropic", mi) or 0.0
    surface = _lobe(inside, mi, anisotropic=anisotropic != 0)
    if surface is None:
        return None
    base, lobe, rough, metal = surface
    if "eta" in parameters:
        index = float(parameters["eta"])
    else:
        root = np.sqrt(0.08 * float(parameters["specular"]))
        index = float((1 + root) / (1 - root))
    if index < 1:
        return None
    # Without a difference of the index nothing has highlights, and no metal reflects. The core asks for one.
    shown, index = (1.0 if index > 1 else 0.0,) * 3, max(index, 1 + 1e-6)
    along, across = alphas_of(rough, anisotropic)
    transmission, tint = (_number(inside, name, mi) or 0.0 for name in ("spec_trans", "spec_tint"))
    under = "rough", (rough, (1 - metal) * (1 - transmission))
    flatness, sheen, hue = (_number(inside, name, mi) or 0.0 for name in ("flatness", *_SHEEN))
    # Sheen covers what light passes, too; that of a finish is a part of the base.
    sheen /= max(1 - transmission, 1e-9)
    fresnel = "mixed", (index, metal, tint)
    finish = Finish(along, "ggx", fresnel, shown, under=under, lobe=lobe, transmission=transmission, flatness=flatness)
    if anisotropic != 0:
        finish = replace(finish, across=across)
    return base, replace(finish, coat=_coat(inside, mi), sheen=(sheen, hue) if sheen > 0 else None)


def _coat(inside: dict[str, MitsubaObject], mi: Mitsuba) -> tuple[float, float] | None:
    """Return the strength and the roughness of the coat of a ``principled`` material; None where it has none."""
    strength, gloss = (_number(inside, name, mi) for name in _COAT)
    if not strength:
        return None
    dull, glossy = COAT_ALPHAS
    return strength, dull + (gloss or 0.0) * (glossy - dull)


def _number(inside: dict[str, MitsubaObject], name: str, mi: Mitsuba) -> float | None:
    """Return a number of a material, 0 if it is not given; None where it differs from place to place."""
    value = constant_of(inside[name], mi) if name in inside else np.zeros(1)
    return None if value is None else float(value.flat[0])


def _is_fraction(inside: dict[str, MitsubaObject], name: str, mi: Mitsuba) -> bool:
    """Return whether a number of a material is the same everywhere, and 0 to 1."""
    value = _number(inside, name, mi)
    return value is not None and 0 <= value <= 1


def _parts_left_out(inside: dict[str, MitsubaObject], mi: Mitsuba) -> list[str]:
    """Return the parts of a ``principled`` material that it has and a finish has not."""
    left_out = [name for name in ("flatness", "spec_trans", "spec_tint") if not _is_fraction(inside, name, mi)]
    for strength, kind in (_COAT, _SHEEN):
        if not _is_fraction(inside, strength, mi):
            left_out.append(strength)
        elif _number(inside, strength, mi) != 0 and not _is_fraction(inside, kind, mi):
            left_out.append(kind)
    if _number(inside, "spec_trans", mi) == 1 and _number(inside, "sheen", mi):
        left_out.append("sheen with a spec_trans of 1")
    if "anisotropic" in inside:
        anisotropic = _number(inside, "anisotropic", mi)
        textured = any(constant_of(inside[name], mi) is None for name in ("roughness", "metallic"))
        if anisotropic is None or anisotropic >= MOST_ANISOTROPIC or (anisotropic != 0 and textured):
            left_out.insert(0, "anisotropic")
    return left_out


def _lobe(
    inside: dict[str, MitsubaObject], mi: Mitsuba, *, anisotropic: bool
) -> tuple[MitsubaTexture, tuple[NumberTexels | None, NumberTexels | None], float, float] | None:
    """Return the base colour of a ``principled`` material, its roughness and metal from place to place, and their
    means; None where their textures are not looked up at the same coordinates, or are none that are known."""
    rough, metal = (number_texture(inside[name], mi) for name in ("roughness", "metallic"))
    if rough is None or metal is None:
        return None
    base = inside["base_color"]
    lobe = rough.texels, metal.texels
    placed = placed_alike(base, rough, metal, anisotropic=anisotropic, mi=mi)
    return None if placed is None else (placed, lobe, rough.mean, metal.mean)


def _glass(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    index = float(mi.traverse(bsdf)["eta"])
    kind = "sheet" if bsdf.class_name() == "ThinDielectric" else "solid"
    tint, passing = (_tint(inside, name, mi) for name in ("specular_reflectance", "specular_transmittance"))
    base = _white(mi)
    rough = _rough(base, inside, mi) if bsdf.class_name() == "RoughDielectric" else (base, _MIRROR)
    if tint is None or passing is None or index == 1 or rough is None:
        return None
    base, (alpha, across, lobe) = rough
    distribution = "ggx" if alpha == 0 else _distribution(bsdf)
    under = kind, (index, *((0.0, 0.0, 0.0) if kind == "solid" else ()))
    fresnel = "dielectric", (index,)
    return base, Finish(alpha, distribution, fresnel, tint, passing, under=under, lobe=lobe, across=across)


def _polarizer(bsdf: MitsubaBsdf, inside: dict[str, MitsubaObject], mi: Mitsuba) -> _Read:
    """Read a polarizer as it is where light has no polarization: it takes half of it."""
    transmittance = constant_of(inside["transmittance"], mi)
    if transmittance is None:
        return None
    half, index = rgb_of(transmittance / 2), (UNBENT,)
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


def _tint(inside: dict[str, MitsubaObject], name: str, mi: Mitsuba) -> Rgb | None:
    """Return a colour that a material may have; None where it differs from place to place."""
    if name not in inside:
        return 1.0, 1.0, 1.0
    value = constant_of(inside[name], mi)
    return None if value is None else rgb_of(value)


def _white(mi: Mitsuba) -> MitsubaTexture:
    return mi.load_dict({"type": "uniform", "value": 1.0})


def _distribution(bsdf: MitsubaBsdf) -> str:
    return _word(bsdf, "distribution")


def _word(bsdf: MitsubaBsdf, name: str) -> str:
    """Return what a material says of itself; Mitsuba has no other way to ask."""
    named = re.search(rf"\b{name} = ([\w.]+)", str(bsdf))
    return named[1] if named else ""
