"""Writes materials of older versions of Mitsuba, and of programs with files like its own, as those of Mitsuba 3.

Only where the two look alike; a note says what differs. Mitsuba refuses all others, unless the user takes them as grey
(``grey_materials``).

Sources: Walter et al., "Microfacet models for refraction through rough surfaces", 2007 (roughness of lobes); Burley,
"Physically based shading at Disney", 2012; Oren and Nayar, "Generalization of Lambert's reflectance model", 1994.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .elements import Element
from .files import SceneFile
from .former_notation import FORMER, NUMBER
from .former_plugin import NO_COLOUR, FormerPlugin
from .former_textures import mean_of

FloatArray = npt.NDArray[np.float64]

_MOST_MIRRORED = 0.9
"""The highest fraction that the highlights of a principled material reflect from straight ahead."""
_HUE = 1e-4
"""How bright a base colour is that gives sheen its hue and reflects nothing to speak of."""
_AIR = ("air", "vacuum")
"""What has an index of 1 to 0.03 %."""
_METAL = "Cu"
"""What a metal is in older versions where nothing says so; in Mitsuba 3 it is a mirror."""
_SAME = "by the same model, with subsurface scattering as its flatness"


def translate(file: SceneFile, notes: list[str]) -> None:
    """Write the materials and media of a scene as Mitsuba 3 reads them; those that are not known stay.

    Args:
        notes: gets a line for each kind of material that looks otherwise now.
    """
    materials = [element for element in file.root.walk() if element.tag == "bsdf"]
    same: dict[str, str] = {}
    for element in reversed(materials):  # those within others first
        kind, own = element.attributes.get("type", ""), element.attributes.get("id")
        translation = _TRANSLATIONS.get(kind)
        differs = None if translation is None else translation(FormerPlugin(element, file))
        if element.tag == "ref" and own is not None:
            same[own] = element.attributes["id"]
        now = file.resolved(element).attributes.get("type")
        if differs:
            notes.append(f"its materials {kind!r} are taken {'' if now == kind else f'as {now!r}, '}{differs}")
    for element in file.root.walk():
        if element.tag == "medium":
            _medium(FormerPlugin(element, file))
        elif element.tag == "ref":
            _follow(element, same)


def _follow(reference: Element, same: dict[str, str]) -> None:
    """Let a ``ref`` to what became a ``ref`` itself name what that names.

    Args:
        same: by the id of what became a ``ref``, the id that it names.
    """
    name, passed = reference.attributes.get("id", ""), set[str]()
    while name in same and name not in passed:
        passed.add(name)
        name = same[name]
    reference.attributes["id"] = name


def _disney(material: FormerPlugin) -> str | None:
    """Write the whole material of lajolla, whose index of refraction and ``specular`` both count."""
    clear = material.number("specular_transmission", 0.0)
    index, specular = material.number("eta", 1.5), material.number("specular", 0.5)
    if clear is None or index is None or specular is None or index < 1:
        return None
    names = {"specular_transmission": "spec_trans", "specular_tint": "spec_tint", "subsurface": "flatness"}
    if clear > 0:
        material.becomes("principled", ("specular",), **names)
        material.put(eta=index)
        return "with highlights by their index of refraction alone"
    mirrored = specular * ((index - 1) / (index + 1)) ** 2
    material.becomes("principled", ("eta",), **names)
    material.put(specular=min(1.0, mirrored / 0.08))
    return _SAME


def _principled(material: FormerPlugin) -> str | None:
    """Take one of an index of refraction and ``specular``, where other programs write both, which Mitsuba refuses.

    There, the index is that of clear matter, and ``specular`` is for what reflects alone.
    """
    if material.get("eta") is None or material.get("specular") is None:
        return None
    kept, left = ("specular", "eta") if material.number("spec_trans", 0.0) == 0 else ("eta", "specular")
    material.becomes("principled", (left,))
    return f"with highlights by their {kept!r}, without {left!r}, where they have both"


def _disney_diffuse(material: FormerPlugin) -> str:
    material.becomes("principled", subsurface="flatness")
    material.put(specular=0.0)
    return _SAME


def _disney_metal(material: FormerPlugin) -> str:
    material.becomes("principled")
    material.put(metallic=1.0)
    return _SAME


def _disney_sheen(material: FormerPlugin) -> str | None:
    """Write sheen alone, whose base colour is no more than a hue."""
    colour = material.numbers("base_color", 0.5)
    if colour is None:
        return None
    material.becomes("principled")
    material.put(base_color=colour * _HUE, sheen=1.0, specular=0.0)
    if material.get("sheen_tint") is None:
        material.put(sheen_tint=0.5)
    return "by the same model, over black"


def _disney_glass(material: FormerPlugin) -> str | None:
    index = material.number("eta", 1.5)
    if index is None or index <= 1:
        return None
    material.becomes("principled")
    material.put(spec_trans=1.0, eta=index)
    return "whose reflections have no colour"


def _disney_clearcoat(material: FormerPlugin) -> str | None:
    """Write a coat over nothing, whose lobe is Burley's ("GTR1"), as a lobe of another shape that is as high."""
    gloss = material.number("clearcoat_gloss", 1.0)
    if gloss is None or not 0 <= gloss <= 1:
        return None
    square = ((1 - gloss) * 0.1 + gloss * 0.001) ** 2
    material.becomes("roughplastic", ("clearcoat_gloss",))
    material.put(alpha=math.sqrt(square * math.log(square) / (square - 1)), int_ior=1.5, ext_ior=1.0)
    material.put(diffuse_reflectance=np.zeros(3))
    material.element.children.append(material.element.child("string", name="distribution", value="ggx"))
    return "over black, with highlights as strong from straight ahead"


def _lobe_and_diffuse(material: FormerPlugin, alpha: float | None, drop: tuple[str, ...]) -> str | None:
    """Write a diffuse colour with a lobe that has no Fresnel factor, whose width is that of a Beckmann lobe."""
    mirrored, means = _specular(material)
    diffuse = material.numbers("diffuse_reflectance", 0.5)
    if mirrored is None or alpha is None or not 0 < alpha <= 1:
        return None
    if mirrored.max() <= 0:
        material.becomes("diffuse", (*drop, "specular_reflectance"), diffuse_reflectance="reflectance")
        return "which is the same without highlights"
    if diffuse is not None and diffuse.max() <= 0:
        material.becomes("roughconductor", (*drop, "diffuse_reflectance"))
        material.put(alpha=alpha)
        material.element.children.append(material.element.child("string", name="material", value="none"))
        return f"with highlights of the same width and strength from straight ahead{means}"
    straight = min(float(mirrored.mean()), _MOST_MIRRORED)
    material.becomes("principled", (*drop, "specular_reflectance"), diffuse_reflectance="base_color")
    if diffuse is not None:
        material.put(base_color=diffuse)
    material.put(roughness=math.sqrt(alpha), eta=(1 + math.sqrt(straight)) / (1 - math.sqrt(straight)))
    colour = " without colour" if np.ptp(mirrored) > NO_COLOUR else ""
    same = f"with highlights{colour} of the same width and strength from straight ahead"
    return f"{same}{means}, which are stronger aslant"


def _specular(material: FormerPlugin) -> tuple[FloatArray | None, str]:
    """Return the strength (3,) of highlights, of a texture its mean, and what to tell of that."""
    given = material.get("specular_reflectance")
    texture = None if given is None else material.file.resolved(given)
    if texture is None or texture.tag != "texture":
        return material.numbers("specular_reflectance", 0.2), ""
    return mean_of(texture, material.file), ", where textures of their strength count by their mean"


def _phong(material: FormerPlugin) -> str | None:
    exponent = material.number("exponent", 30.0)
    # The peak of the lobe, (n + 2) / 2 pi, is that of a Beckmann lobe, 1 / 4 pi alpha^2; so are the widths, nearly.
    alpha = None if exponent is None or exponent < 0 else 1 / math.sqrt(2 * (exponent + 2))
    return _lobe_and_diffuse(material, alpha, ("exponent",))


def _ward(material: FormerPlugin) -> str | None:
    both = material.number("alpha", 0.1)
    if both is None:
        return None
    along, across = material.number("alpha_u", both), material.number("alpha_v", both)
    alpha = None if along is None or across is None else math.sqrt(max(along * across, 0.0))
    differs = _lobe_and_diffuse(material, alpha, ("variant", "alpha", "alpha_u", "alpha_v"))
    return f"{differs}, and as wide along as across" if differs and along != across else differs


def _rough_diffuse(material: FormerPlugin) -> str | None:
    alpha = material.number("alpha", 0.2)
    if alpha is None or (material.get("diffuse_reflectance") is not None and material.get("reflectance") is not None):
        return None
    squared = alpha * alpha / 2  # sigma^2 of Oren and Nayar, of a slope with this root mean square
    brighter = 1 / (1 - 0.5 * squared / (squared + 0.33)) - 1
    material.becomes("diffuse", ("alpha", "use_fast_approx"), diffuse_reflectance="reflectance")
    return f"which is up to {100 * brighter:.0f} % brighter where light comes from behind the camera's side"


def _mixture(material: FormerPlugin) -> None:
    """Write a sum of materials with weights as blends of two; where the weights do not fill 1, the rest is black."""
    given = material.get("weights")
    words = "" if given is None else given.attributes.get("value", "")
    parts = [child for child in material.element.children if child.tag in ("bsdf", "ref")]
    rest = [child for child in material.element.children if child.tag not in ("bsdf", "ref") and child is not given]
    numbers = words.replace(",", " ").split()
    if rest or not parts or len(numbers) != len(parts) or not all(map(NUMBER.fullmatch, numbers)):
        return
    weights = [float(number) for number in numbers]
    total = sum(weights)
    if min(weights) < 0 or not 0 < total < math.inf:
        return
    if total > 1:
        weights = [weight / total for weight in weights]
    if total < 1 - 1e-6 or len(parts) == 1:
        black = material.element.child("bsdf", type="diffuse")
        black.children = [black.child("rgb", name="reflectance", value="0")]
        parts, weights = [*parts, black], [*weights, max(0.0, 1 - total)]
    blend, share = material.element, 1.0
    for number, (part, weight) in enumerate(zip(parts[:-1], weights, strict=False)):
        following = 1 - weight / share if share > 0 else 0.0
        share -= weight
        blend.attributes["type"] = "blendbsdf"
        last = number == len(parts) - 2
        other = parts[-1] if last else material.element.child("bsdf", type="blendbsdf")
        blend.children = [blend.child("float", name="weight", value=repr(min(1.0, max(0.0, following)))), part, other]
        blend = other


def _coating(material: FormerPlugin) -> str | None:
    """Write a clear coat on a diffuse surface as plastic, which is the same, and leave others out."""
    nested = [child for child in material.element.children if child.tag in ("bsdf", "ref")]
    if len(nested) != 1:
        return None
    (given,) = nested
    inside = material.file.resolved(given)
    if inside.tag != "bsdf" or inside is material.element:
        return None
    absorbed = material.numbers("sigma_a", 0.0)
    colours = [child for child in inside.children if child.name in ("reflectance", "diffuse_reflectance")]
    if inside.attributes.get("type") != "diffuse" or len(colours) != len(inside.children) or len(colours) > 1:
        if inside is given:
            material.element.attributes["type"] = inside.attributes.get("type", "")
            material.element.children = inside.children
        else:
            material.element.tag, material.element.children = "ref", []
            material.element.attributes = {"id": given.attributes["id"]} | {
                key: value for key, value in material.element.attributes.items() if key == "name"
            }
        return "which is below: the coat's highlights, and what it absorbs, are left out"
    kind = "roughplastic" if material.kind == "roughcoating" else "plastic"
    material.becomes(kind, ("thickness", "sigma_a"))
    material.element.children.remove(given)
    for colour in colours:
        own = colour.copied()
        own.attributes["name"] = "diffuse_reflectance"
        material.element.children.append(own)
    material.element.children.append(material.element.child("boolean", name="nonlinear", value="true"))
    return "without what the coat absorbs" if absorbed is None or absorbed.any() else None


def _smooth_metal(material: FormerPlugin) -> str | None:
    _name_metal(material)
    _outside_of_metal(material)
    return _smooth(material)


def _smooth(material: FormerPlugin) -> str | None:
    """Leave out the roughness of a material that has none: older versions did not look at it."""
    if material.get("alpha") is None:
        return None
    material.becomes(material.kind, ("alpha",))
    return "without their 'alpha', because they are smooth"


def _name_metal(metal: FormerPlugin) -> None:
    former = metal.file.root.attributes["version"] == FORMER
    if former and all(metal.get(name) is None for name in ("material", "eta", "k")):
        metal.element.children.append(metal.element.child("string", name="material", value=_METAL))


def _outside_of_metal(material: FormerPlugin) -> None:
    """Write the index of what a metal is in as a factor on its own: reflection depends on how they differ alone."""
    outside = material.number("ext_eta", 1.0)
    of_metal = {name: material.numbers(name, 0.0) for name in ("eta", "k") if material.get(name) is not None}
    if outside is None or outside <= 0:
        given = material.get("ext_eta")
        outside = 1.0 if given is not None and given.attributes.get("value") in _AIR else None
    known = len(of_metal) == 2 and all(numbers is not None for numbers in of_metal.values())
    if outside is None or (outside != 1 and not known):
        return
    material.becomes(material.kind, ("ext_eta",))
    if outside != 1:
        material.put(**{name: numbers / outside for name, numbers in of_metal.items() if numbers is not None})


def _metal(material: FormerPlugin) -> str | None:
    _name_metal(material)
    _outside_of_metal(material)
    return _rough(material)


def _normal_map(material: FormerPlugin) -> None:
    """Give the texture of a normal map its present name; without one it is the image of a ``filename``."""
    image = material.get("filename")
    texture = next((child for child in material.element.children if child.tag == "texture" and not child.name), None)
    if material.get("normalmap") is not None or (image is None) == (texture is None):
        return
    if image is not None:
        material.element.children.remove(image)
        texture = material.element.child("texture", type="bitmap")
        texture.children = [image]
        material.element.children.append(texture)
    assert texture is not None
    texture.attributes["name"] = "normalmap"
    if not any(child.name == "raw" for child in texture.children):
        texture.children.append(texture.child("boolean", name="raw", value="true"))


def _rough(material: FormerPlugin) -> str | None:
    """Give facets the distribution of Beckmann in place of Phong's, which older versions make as wide as that."""
    distribution = material.get("distribution")
    if distribution is None or distribution.attributes.get("value") not in ("as", "phong"):
        return None
    distribution.attributes["value"] = "beckmann"
    return "with facets distributed as Beckmann's in place of Phong's, which are as wide"


def _many_reflections(material: FormerPlugin) -> str:
    """Write a metal or glass whose facets reflect light more than once (Heitz et al., 2016) as the usual one."""
    metal = material.kind.startswith("roughconductor")
    coloured = metal and material.get("R0") is not None
    material.becomes(material.kind.removesuffix("GGX"), ("scattering_order_max",), R0="specular_reflectance")
    material.element.children.append(material.element.child("string", name="distribution", value="ggx"))
    told = "without light that facets reflect more than once"
    if not coloured:
        return told
    material.element.children.append(material.element.child("string", name="material", value="none"))
    return f"{told}, and with the reflectance from straight ahead at all angles"


def _lambertian(material: FormerPlugin) -> None:
    material.becomes("diffuse", diffuse_reflectance="reflectance")


_TRANSLATIONS: dict[str, Callable[[FormerPlugin], str | None]] = {
    "principled": _principled,
    "disneybsdf": _disney,
    "disneydiffuse": _disney_diffuse,
    "disneymetal": _disney_metal,
    "disneyglass": _disney_glass,
    "disneysheen": _disney_sheen,
    "disneyclearcoat": _disney_clearcoat,
    "phong": _phong,
    "ward": _ward,
    "roughdiffuse": _rough_diffuse,
    "mixturebsdf": _mixture,
    "coating": _coating,
    "roughcoating": _coating,
    "lambertian": _lambertian,
    "normalmap": _normal_map,
    "conductor": _smooth_metal,
    "dielectric": _smooth,
    "roughconductor": _metal,
    "roughdielectric": _rough,
    "roughplastic": _rough,
    "roughconductorGGX": _many_reflections,
    "roughdielectricGGX": _many_reflections,
}
"""By the former plug-in, what writes it as a present one and returns what differs; None where nothing does."""


def _medium(medium: FormerPlugin) -> None:
    """Write what a medium absorbs and scatters as its extinction and albedo, and its density as extinction."""
    if medium.kind == "heterogeneous":
        # The method and the step are how to sample.
        medium.becomes("heterogeneous", ("method", "step_size"), density="sigma_t")
    if medium.kind != "homogeneous" or medium.get("sigma_a") is None or medium.get("sigma_s") is None:
        return
    absorbed, scattered = medium.numbers("sigma_a", 0.0), medium.numbers("sigma_s", 0.0)
    scale = medium.number("scale", 1.0)
    if absorbed is None or scattered is None or scale is None:
        return
    extinct = absorbed + scattered
    most = max(float(extinct.max()), 1e-12)  # Mitsuba takes colours of 0 to 1
    medium.becomes("homogeneous", ("sigma_a", "sigma_s"))
    medium.put(scale=scale * most, sigma_t=extinct / most)
    medium.put(albedo=np.divide(scattered, extinct, out=np.zeros(3), where=extinct > 0))
