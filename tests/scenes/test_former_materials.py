"""Materials and media of older versions of Mitsuba, and of programs with files like its own."""

from __future__ import annotations

import re
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import davis_rs
from davis_rs._mitsuba.elements import Element
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.cli.main import main
from davis_rs.scene.lost_looks import UNKNOWN, LostLook
from davis_rs.scene.repairs import SceneFileWarning

SCENE = """<scene version="{version}"><integrator type="path"/>
<emitter type="constant"/>
{other}
<shape type="rectangle" id="square">{material}</shape></scene>"""


MIXTURE = """<bsdf type="mixturebsdf"><string name="weights" value="{}"/><bsdf type="diffuse"/>
<bsdf type="plastic"/></bsdf>"""


def scene_file(folder: Path, material: str, version: str = "0.6.0", other: str = "") -> Path:
    """Write a scene of a square with a material."""
    path = folder / "scene.xml"
    path.write_text(SCENE.format(material=material, version=version, other=other))
    return path


def told_of(path: Path, **arguments: Any) -> list[str]:
    """Return what is told of a scene's file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneFileWarning)
        davis_rs.load_scene(path, **arguments)
    return [str(one.message).removeprefix(f"{path}: ") for one in caught]


def reflected(path: Path, into: npt.ArrayLike, out: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return BSDF times cosine (3,) of the square, for directions in its own axes."""
    with variant(SCALAR) as (mi, _):
        shape = load_scene_source(path, mi).shapes()[0]
        hit = mi.SurfaceInteraction3f()
        hit.wi = mi.Vector3f(np.asarray(into) / np.linalg.norm(into))
        towards = mi.Vector3f(np.asarray(out) / np.linalg.norm(out))
        return np.array(shape.bsdf().eval(mi.BSDFContext(), hit, towards), np.float64)


ALIKE = {
    "lambertian": (
        '<bsdf type="lambertian"><rgb name="diffuseReflectance" value="0.2, 0.3, 0.4"/></bsdf>',
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.3, 0.4"/></bsdf>',
    ),
    "coating": (
        '<bsdf type="coating"><float name="intIOR" value="1.7"/><float name="thickness" value="2"/>'
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.3, 0.4"/></bsdf></bsdf>',
        '<bsdf type="plastic"><float name="int_ior" value="1.7"/><boolean name="nonlinear" value="true"/>'
        '<rgb name="diffuse_reflectance" value="0.2, 0.3, 0.4"/></bsdf>',
    ),
    "rough coating": (
        '<bsdf type="roughcoating"><float name="alpha" value="0.2"/><bsdf type="diffuse"/></bsdf>',
        '<bsdf type="roughplastic"><float name="alpha" value="0.2"/><boolean name="nonlinear" value="true"/></bsdf>',
    ),
    "metal in air": (
        '<bsdf type="roughconductor"><string name="extEta" value="air"/><string name="material" value="Cu"/></bsdf>',
        '<bsdf type="roughconductor"><string name="material" value="Cu"/></bsdf>',
    ),
    "metal that has no name": (
        '<bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf>',
        '<bsdf type="roughconductor"><float name="alpha" value="0.2"/><string name="material" value="Cu"/></bsdf>',
    ),
    "metal in water": (
        '<bsdf type="roughconductor"><float name="extEta" value="1.25"/><rgb name="eta" value="1, 2, 0.5"/>'
        '<spectrum name="k" value="5"/></bsdf>',
        '<bsdf type="roughconductor"><rgb name="eta" value="0.8, 1.6, 0.4"/><spectrum name="k" value="4"/></bsdf>',
    ),
    "image of numbers": (
        '<bsdf type="twosided"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
        '<string name="filename" value="bumps.png"/><float name="gamma" value="1"/></texture></bsdf></bsdf>',
        '<bsdf type="twosided"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
        '<string name="filename" value="bumps.png"/><boolean name="raw" value="true"/></texture></bsdf></bsdf>',
    ),
    "numbers that stand twice": (
        '<bsdf type="roughplastic"><float name="alpha" value="0.3"/><float name="alpha" value="0.3"/></bsdf>',
        '<bsdf type="roughplastic"><float name="alpha" value="0.3"/></bsdf>',
    ),
    "spectrum with suffixes": (
        '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0.1f, 500:1.f, 700:0"/></bsdf>',
        '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0.1, 500:1, 700:0"/></bsdf>',
    ),
    "mixture": (
        '<bsdf type="mixturebsdf"><string name="weights" value="0.5, 0.2 0.1"/><bsdf type="diffuse">'
        '<rgb name="reflectance" value="0.8, 0, 0"/></bsdf><bsdf type="diffuse"><rgb name="reflectance" '
        'value="0, 0.5, 0"/></bsdf><bsdf type="diffuse"><rgb name="reflectance" value="0, 0, 1"/></bsdf></bsdf>',
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.4, 0.1, 0.1"/></bsdf>',
    ),
    "mixture of more than all": (
        '<bsdf type="mixturebsdf"><string name="weights" value="3 1"/><bsdf type="diffuse">'
        '<rgb name="reflectance" value="0.8, 0, 0"/></bsdf><bsdf type="diffuse"><rgb name="reflectance" '
        'value="0, 0.4, 0"/></bsdf></bsdf>',
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.1, 0"/></bsdf>',
    ),
    "mixture of one": (
        '<bsdf type="mixturebsdf"><string name="weights" value="0.5"/><bsdf type="diffuse"/></bsdf>',
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.25"/></bsdf>',
    ),
}  # fmt: skip


ALIKE |= {
    f"normal map, {name}": (
        f'<bsdf type="normalmap">{former}<bsdf type="diffuse"/></bsdf>',
        '<bsdf type="normalmap"><texture type="bitmap" name="normalmap"><boolean name="raw" value="true"/>'
        '<string name="filename" value="../bumps.png"/></texture><bsdf type="diffuse"/></bsdf>',
    )
    for name, former in {
        "its image alone": '<string name="filename" value="bumps.png"/>',
        "its texture without a name": '<texture type="bitmap"><string name="filename" value="bumps.png"/></texture>',
    }.items()
}


PIXEL = (180, 100, 230)
"""Of the image that materials have."""
LINEAR = from_srgb(np.array(PIXEL) / 255)
IMAGE = '<texture {} type="bitmap"><string name="filename" value="bumps.png"/>{}</texture>'
DIFFUSE = '<bsdf type="twosided"><bsdf type="diffuse">{}</bsdf></bsdf>'


def rgb(name: str, colour: npt.ArrayLike) -> str:
    """Return an element for a colour."""
    return f'<rgb name="{name}" value="{", ".join(map(repr, np.asarray(colour).tolist()))}"/>'


def scaled(factor: float, texture: str, attributes: str) -> str:
    """Return an element for a factor on a texture, as Mitsuba 0.6 has it."""
    return f'<texture type="scale" {attributes}><float name="scale" value="{factor}"/>{texture}</texture>'


ALIKE |= {
    "image times a number": (
        DIFFUSE.format(scaled(0.5, IMAGE.format("", ""), 'name="reflectance"')),
        DIFFUSE.format(rgb("reflectance", LINEAR / 2)),
    ),
    "image of numbers times a number": (
        DIFFUSE.format(scaled(0.51, IMAGE.format("", '<float name="gamma" value="1"/>'), 'name="reflectance"')),
        DIFFUSE.format(rgb("reflectance", np.array(PIXEL) / 500)),
    ),
    "checkerboard times a number": (
        DIFFUSE.format(scaled(0.5, f'<texture type="checkerboard">{rgb("color0", [0.8, 0.6, 0.4])}</texture>',
                              'name="reflectance"')),
        DIFFUSE.format(rgb("reflectance", [0.4, 0.3, 0.2])),
    ),
}  # fmt: skip

ELSEWHERE = {
    "image times two numbers": (
        IMAGE.format('id="t"', "")
        + scaled(2, '<ref id="t"/>', 'id="more"')
        + scaled(0.25, '<ref id="more"/>', 'id="less"'),
        DIFFUSE.format('<ref name="reflectance" id="less"/>'),
        DIFFUSE.format(rgb("reflectance", LINEAR / 2)),
    ),
    "coating on a diffuse material": (
        '<bsdf type="diffuse" id="paint">' + IMAGE.format('id="t" name="reflectance"', "") + "</bsdf>",
        '<bsdf type="coating"><ref id="paint"/></bsdf>',
        f'<bsdf type="plastic">{rgb("diffuse_reflectance", LINEAR)}<boolean name="nonlinear" value="true"/></bsdf>',
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ELSEWHERE)
def test_what_is_defined_elsewhere_is_the_same(tmp_path: Path, case: str) -> None:
    other, former, now = ELSEWHERE[case]
    Image.fromarray(np.full((4, 4, 3), PIXEL, np.uint8)).save(tmp_path / "bumps.png")
    (tmp_path / "now").mkdir()
    directions = [0.3, -0.2, 0.9], [-0.4, 0.3, 0.8]
    expected = reflected(scene_file(tmp_path / "now", now, "3.0.0"), *directions)
    path = scene_file(tmp_path, former, other=other)
    np.testing.assert_allclose(reflected(path, *directions), expected, rtol=1e-5, atol=1e-8)
    assert told_of(path) == []


def test_one_scale_of_both_texture_coordinates(tmp_path: Path) -> None:
    Image.fromarray(np.full((4, 4, 3), PIXEL, np.uint8)).save(tmp_path / "bumps.png")
    texture = IMAGE.format('name="reflectance"', '<float name="uvscale" value="3"/><float name="uscale" value="2"/>')
    path = scene_file(tmp_path, f'<bsdf type="diffuse">{texture}</bsdf>')
    with variant(SCALAR) as (mi, _):
        to_uv = mi.traverse(load_scene_source(path, mi).shapes()[0].bsdf())["reflectance.to_uv"]
    np.testing.assert_allclose(np.diag(np.array(to_uv.matrix))[:2], [2, 3])


@pytest.mark.parametrize("kind", ["phong", "ward"])
@pytest.mark.parametrize("elsewhere", [False, True])
def test_textures_of_highlights_count_by_their_mean(tmp_path: Path, kind: str, elsewhere: bool) -> None:
    """Of an image that is half PIXEL and half black, twice as bright."""
    Image.fromarray(np.array([[PIXEL, (0, 0, 0)]], np.uint8)).save(tmp_path / "bumps.png")
    diffuse, directions = rgb("diffuseReflectance", [0.2, 0.3, 0.4]), ([0, 0, 1], [0.05, 0, 1])
    (tmp_path / "now").mkdir()
    given = f'<bsdf type="{kind}">{diffuse}{rgb("specularReflectance", LINEAR)}</bsdf>'
    expected = reflected(scene_file(tmp_path / "now", given), *directions)
    image = IMAGE.format('id="gloss"', "")
    texture = scaled(2, '<ref id="gloss"/>' if elsewhere else image, 'name="specularReflectance"')
    path = scene_file(tmp_path, f'<bsdf type="{kind}">{diffuse}{texture}</bsdf>', other=image if elsewhere else "")
    (line,) = told_of(path)
    assert "where textures of their strength count by their mean, which are stronger aslant" in line
    np.testing.assert_allclose(reflected(path, *directions), expected, rtol=1e-5)


def test_coats_of_one_material_defined_elsewhere_are_left_out(tmp_path: Path) -> None:
    """In a row, each named by the next, before and after what they name."""
    metal = '<bsdf type="roughconductor" id="metal"><string name="material" value="Au"/></bsdf>'
    other = (
        '<bsdf type="coating" id="first"><ref id="second"/></bsdf>'
        f'<bsdf type="coating" id="second"><ref id="metal"/></bsdf>{metal}'
        '<bsdf type="coating" id="last"><ref id="first"/></bsdf>'
    )
    path = scene_file(tmp_path, '<bsdf type="twosided"><ref id="last"/></bsdf>', other=other)
    (line,) = told_of(path)
    assert "'coating' are taken as 'roughconductor', which is below: the coat's" in line
    directions = [0.3, 0, 1], [0, 0.2, 1]
    shown = reflected(path, *directions)
    np.testing.assert_allclose(shown, reflected(scene_file(tmp_path, '<ref id="metal"/>', other=metal), *directions))


@pytest.mark.parametrize("coat", ['<ref id="paint"/>', '<ref id="none"/>'])
def test_a_coat_on_nothing_is_refused(tmp_path: Path, coat: str) -> None:
    other = f'<bsdf type="coating" id="paint">{coat}</bsdf>'
    with pytest.raises(ValueError, match="Mitsuba cannot load"):
        davis_rs.load_scene(scene_file(tmp_path, '<ref id="paint"/>', other=other))


@pytest.mark.parametrize("case", ALIKE)
def test_materials_with_other_names_are_the_same(tmp_path: Path, case: str) -> None:
    former, now = ALIKE[case]
    Image.fromarray(np.full((4, 4, 3), (180, 100, 230), np.uint8)).save(tmp_path / "bumps.png")
    directions = [0.3, -0.2, 0.9], [-0.4, 0.3, 0.8]
    (tmp_path / "now").mkdir()
    shutil.copy(tmp_path / "bumps.png", tmp_path / "now")
    expected = reflected(scene_file(tmp_path / "now", now, "3.0.0"), *directions)
    path = scene_file(tmp_path, former)
    np.testing.assert_allclose(reflected(path, *directions), expected, rtol=1e-5, atol=1e-8)
    assert told_of(path) == []


WITH_VALUES = {
    "phong": (
        '<bsdf type="phong"><float name="exponent" value="$n"/><spectrum name="diffuseReflectance" value="0.3"/>'
        '<spectrum name="specularReflectance" value="0.1"/></bsdf>',
        "'phong' are taken as 'principled', with highlights of the same width and strength from straight ahead",
    ),
    "phong of metal": (
        '<bsdf type="phong"><float name="exponent" value="$n"/><rgb name="diffuseReflectance" value="0"/>'
        '<rgb name="specularReflectance" value="0.1"/></bsdf>',
        "'phong' are taken as 'roughconductor', with highlights of the same width",
    ),
}


@pytest.mark.parametrize("case", WITH_VALUES)
def test_highlights_of_phong_are_as_high_and_as_wide(tmp_path: Path, case: str) -> None:
    """Against the model itself, (n + 2) / 2 pi cos^n around the mirrored direction."""
    material, told = WITH_VALUES[case]
    exponent, diffuse = 200, 0.3 if "metal" not in case else 0.0
    path = scene_file(tmp_path, material, other=f'<default name="n" value="{exponent}"/>')
    (line,) = told_of(path)
    assert told in line
    across = [0.0, 0.05, 0.1]
    found = np.array([reflected(path, [0, 0, 1], [np.sin(a), 0, np.cos(a)])[0] / np.cos(a) for a in across])
    lobe = 0.1 * (exponent + 2) / (2 * np.pi) * np.cos(across) ** exponent
    # The lobe is GGX in a principled material: it falls a little faster, and has longer tails.
    np.testing.assert_allclose(found, diffuse / np.pi + lobe, rtol=0.3)
    np.testing.assert_allclose(found[0], diffuse / np.pi + lobe[0], rtol=0.01)


@pytest.mark.parametrize(
    ("material", "told"),
    [
        (
            '<bsdf type="ward"><float name="alphaU" value="0.1"/><float name="alphaV" value="0.3"/></bsdf>',
            "which are stronger aslant, and as wide along as across",
        ),
        (
            '<bsdf type="ward"><rgb name="specularReflectance" value="0.3, 0.1, 0"/></bsdf>',
            "with highlights without colour of the same width",
        ),
        ('<bsdf type="phong"><rgb name="specularReflectance" value="0"/></bsdf>', "the same without highlights"),
        ('<bsdf type="roughdiffuse"><float name="alpha" value="0.5"/></bsdf>', "up to 16 % brighter"),
        ('<bsdf type="roughplastic"><string name="distribution" value="as"/></bsdf>', "in place of Phong's"),
        ('<bsdf type="roughconductor"><string name="distribution" value="phong"/></bsdf>', "in place of Phong's"),
        ('<bsdf type="coating"><bsdf type="roughconductor"/></bsdf>', "are taken as 'roughconductor', which is below"),
        (
            '<bsdf type="coating"><rgb name="sigmaA" value="0.1 0.2 0.3"/><bsdf type="diffuse"/></bsdf>',
            "'coating' are taken as 'plastic', without what the coat absorbs",
        ),
        (
            '<bsdf type="plastic"><float name="intIOR" value="1.3"/><float name="intIOR" value="1.4"/></bsdf>',
            "the last 'intIOR' of a bsdf counts, as in older versions",
        ),
        ('<bsdf type="conductor"><float name="alpha" value="0.2"/></bsdf>', "'conductor' are taken without their 'al"),
        ('<bsdf type="dielectric"><float name="alpha" value="0.2"/></bsdf>', "without their 'alpha', because they are"),
        (
            '<bsdf type="diffuse"><texture name="reflectance" type="bitmap"><string name="filename" '
            'value="bumps.png"/><float name="gamma" value="2.2"/></texture></bsdf>',
            "its images with a gamma of 2.2 are read as sRGB",
        ),
        (
            '<bsdf type="roughconductorGGX"><rgb name="R0" value="1, 0.8, 0.5"/></bsdf>',
            "'roughconductorGGX' are taken as 'roughconductor', without light that facets reflect more than once, and "
            "with the reflectance from straight ahead at all angles",
        ),
        (
            '<bsdf type="roughdielectricGGX"><integer name="scatteringOrderMax" value="9"/></bsdf>',
            "'roughdielectricGGX' are taken as 'roughdielectric', without light that facets reflect more than once",
        ),
        ('<bsdf type="disneybsdf"><float name="subsurface" value="1"/></bsdf>', "by the same model"),
        ('<bsdf type="disneybsdf"><float name="specularTransmission" value="1"/></bsdf>', "by their index"),
        ('<bsdf type="disneydiffuse"><rgb name="baseColor" value="0.2, 0.3, 0.4"/></bsdf>', "by the same model"),
        ('<bsdf type="disneymetal"><rgb name="baseColor" value="0.2, 0.3, 0.4"/></bsdf>', "by the same model"),
        ('<bsdf type="disneysheen"/>', "'disneysheen' are taken as 'principled', by the same model, over black"),
        ('<bsdf type="disneyclearcoat"/>', "over black, with highlights as strong from straight ahead"),
        ('<bsdf type="disneyglass"><float name="eta" value="1.4"/></bsdf>', "whose reflections have no colour"),
    ],
)  # fmt: skip
def test_what_differs_is_told(tmp_path: Path, material: str, told: str) -> None:
    Image.fromarray(np.full((4, 4, 3), (180, 100, 230), np.uint8)).save(tmp_path / "bumps.png")
    (line,) = told_of(scene_file(tmp_path, material, "2.0.0" if "disney" in material else "0.6.0"))
    assert told in line


def test_disney_highlights_follow_both_numbers(tmp_path: Path) -> None:
    """F0 is ``specular`` times that of the index: 0.5 x 0.04 is that of a ``specular`` of 0.25."""
    directions = [0, 0, 1], [0, 0.1, 1]
    (tmp_path / "now").mkdir()
    now = '<bsdf type="principled"><float name="specular" value="0.25"/><float name="roughness" value="0.3"/></bsdf>'
    expected = reflected(scene_file(tmp_path / "now", now, "3.0.0"), *directions)
    former = '<bsdf type="disneybsdf"><float name="roughness" value="0.3"/></bsdf>'
    np.testing.assert_allclose(reflected(scene_file(tmp_path, former, "3.0.0"), *directions), expected, rtol=1e-5)


@pytest.mark.parametrize(("given", "tint"), [('<float name="sheenTint" value="0.8"/>', 0.8), ("", 0.5)])
def test_disney_sheen_alone(tmp_path: Path, given: str, tint: float) -> None:
    """Against Burley's formula, of white and the hue of the colour."""
    colour = np.array([0.2, 0.4, 0.1])
    path = scene_file(tmp_path, f'<bsdf type="disneysheen">{rgb("baseColor", colour)}{given}</bsdf>', "3.0.0")
    into, out = np.array([-0.8, 0.1, 0.4]), np.array([0.9, 0.1, 0.3])
    into, out = into / np.linalg.norm(into), out / np.linalg.norm(out)
    half = (into + out) / np.linalg.norm(into + out)
    hue = 1 - tint + tint * colour / (colour @ [0.212671, 0.715160, 0.072169])
    np.testing.assert_allclose(reflected(path, into, out), hue * (1 - half @ out) ** 5 * out[2], rtol=1e-3)


@pytest.mark.parametrize(("given", "gloss"), [('<float name="clearcoatGloss" value="0.4"/>', 0.4), ("", 1.0)])
def test_disney_clearcoat_alone(tmp_path: Path, given: str, gloss: float) -> None:
    """Straight ahead it is as strong as Burley's lobe, of an index of 1.5."""
    path = scene_file(tmp_path, f'<bsdf type="disneyclearcoat">{given}</bsdf>', "0.6.0")
    square = ((1 - gloss) * 0.1 + gloss * 0.001) ** 2
    height = (square - 1) / (np.pi * np.log(square) * square)
    ahead = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(reflected(path, ahead, ahead), 0.04 * height / 4, rtol=1e-3)


@pytest.mark.parametrize(
    "material",
    [
        '<bsdf type="hk"/>',
        '<bsdf type="disneyclearcoat"><float name="clearcoatGloss" value="2"/></bsdf>',
        '<bsdf type="phong"><texture name="specularReflectance" type="mesh_attribute"><string name="name" '
        'value="vertex_color"/></texture></bsdf>',
        '<bsdf type="phong"><texture name="exponent" type="checkerboard"/></bsdf>',
        '<bsdf type="ward"><texture name="alpha" type="checkerboard"/></bsdf>',
        '<bsdf type="coating"><bsdf type="diffuse"/><bsdf type="diffuse"/></bsdf>',
        MIXTURE.format("1"),
        MIXTURE.format("nan 1"),
        '<bsdf type="disneyglass"><float name="eta" value="0.9"/></bsdf>',
        '<bsdf type="disneysheen"><texture name="baseColor" type="checkerboard"/></bsdf>',
    ],
)  # fmt: skip
def test_others_are_refused_or_grey_if_the_user_wants(tmp_path: Path, material: str) -> None:
    path = scene_file(tmp_path, '<ref id="paint"/>', other=material.replace("<bsdf", '<bsdf id="paint"', 1))
    with pytest.raises(ValueError, match=r"(?s)scene.xml \(line 3\).* not found!; --grey-unknown .* as grey"):
        davis_rs.load_scene(path)
    kind = re.findall('type="([^"]*)', material)[0]
    told = f"its material 'paint' ('{kind}', which is not known) is taken as grey"
    assert told_of(path, grey_unknown=True) == [told]
    with pytest.warns(SceneFileWarning):
        scene = davis_rs.load_scene(path, grey_unknown=True)
    assert scene.lost_looks == (LostLook(UNKNOWN, ("'paint'",), ("square",)),)
    with variant(SCALAR) as (mi, _):
        bsdf = load_scene_source(scene.source(), mi).shapes()[0].bsdf()
        assert float(np.ravel(mi.traverse(bsdf)["reflectance.value"])[0]) == 0.5


def test_shapes_with_grey_are_known(tmp_path: Path) -> None:
    """Also those without an id, and with materials within others."""
    other = """<bsdf type="hk" id="skin"/><bsdf type="twosided" id="both"><ref id="skin"/></bsdf>
        <shape type="sphere"><ref id="both"/></shape><shape type="sphere" id="plain"/>
        <shape type="sphere" id="masked"><bsdf type="mask"><bsdf type="irawan"/></bsdf></shape>"""
    path = scene_file(tmp_path, '<ref id="both"/>', other=other)
    with pytest.warns(SceneFileWarning):
        looks = davis_rs.load_scene(path, grey_unknown=True).lost_looks
    assert [(look.of, look.shapes) for look in looks] == [
        (("'skin'",), ("shape_0", "square")),
        (("in line 5",), ("masked",)),
    ]


def test_grey_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scene_file(tmp_path, '<bsdf type="hk"/>')
    run = ["simulate", str(path), "--camera", "ideal", "-o", str(tmp_path / "out"), "--grey-unknown"]
    assert main(["simulate", "three_planes", *run[2:]]) != 0
    assert "--grey-unknown is for a Mitsuba XML file, a glTF file, or an OBJ or a PLY mesh" in capsys.readouterr().err


@pytest.mark.parametrize("coefficient", ["0.5, 1, 2", "2"])
def test_media_by_what_they_absorb_and_scatter(tmp_path: Path, coefficient: str) -> None:
    kind = "rgb" if "," in coefficient else "float"
    medium = f"""<medium name="interior" type="homogeneous"><{kind} name="sigmaA" value="{coefficient}"/>
        <rgb name="sigmaS" value="0.5, 3, 0"/><float name="scale" value="2"/></medium>"""
    path = scene_file(tmp_path, medium)
    with variant(SCALAR) as (mi, _):
        inside = load_scene_source(path, mi).shapes()[0].interior_medium()
        hit = mi.MediumInteraction3f()
        scattered, _, extinct = (np.array(each) for each in inside.get_scattering_coefficients(hit))
    absorbed = np.array([float(word) for word in coefficient.split(",")])
    np.testing.assert_allclose(extinct, 2 * (absorbed + np.array([0.5, 3, 0])), rtol=1e-3)
    np.testing.assert_allclose(scattered, [1, 6, 0], rtol=1e-3, atol=1e-3)


def test_media_from_place_to_place_by_their_density(tmp_path: Path) -> None:
    medium = """<medium name="interior" type="heterogeneous"><string name="method" value="woodcock"/>
        <volume name="density" type="constvolume"><float name="value" value="0.5"/></volume></medium>"""
    assert told_of(scene_file(tmp_path, medium)) == []


def test_names_are_read_as_they_are_now() -> None:
    for former, now in {
        "intIOR": "int_ior",
        "toWorld": "to_world",
        "rr_depth": "rr_depth",
        "uvScale": "uv_scale",
    }.items():
        assert Element("float", {"name": former}, Path(), 1).name == now


def test_a_metal_in_what_has_no_numbers_is_refused(tmp_path: Path) -> None:
    """Its own index is a name, or that of its surroundings is: neither can be divided by the other."""
    for metal in (
        '<float name="extEta" value="1.33"/><string name="material" value="Cu"/>',
        '<string name="extEta" value="pyrex"/><rgb name="eta" value="1, 2, 0.5"/><rgb name="k" value="5, 5, 5"/>',
    ):
        with pytest.raises(ValueError, match="it has ext_eta of a conductor, which this Mitsuba does not read"):
            davis_rs.load_scene(scene_file(tmp_path, f'<bsdf type="conductor">{metal}</bsdf>'))


def test_a_coat_that_is_left_out_shows_what_is_below(tmp_path: Path) -> None:
    metal = '<bsdf type="roughconductor"><float name="alpha" value="0.4"/><string name="material" value="Au"/></bsdf>'
    shown = reflected(scene_file(tmp_path, f'<bsdf type="coating">{metal}</bsdf>'), [0.3, 0, 1], [0, 0.2, 1])
    np.testing.assert_allclose(shown, reflected(scene_file(tmp_path, metal), [0.3, 0, 1], [0, 0.2, 1]))


def test_objects_of_one_name_all_count(tmp_path: Path) -> None:
    """Shapes of a scene, and the parts of a blend: Mitsuba 3 itself leaves out all but one, or refuses them."""
    parts = '<ref name="bsdf" id="red"/><ref name="bsdf" id="blue"/>'
    blend = f'<bsdf type="blendbsdf"><float name="weight" value="0.25"/>{parts}</bsdf>'
    other = (
        '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.8, 0, 0"/></bsdf>'
        '<bsdf type="diffuse" id="blue"><rgb name="reflectance" value="0, 0, 0.4"/></bsdf>'
    )
    balls = '<shape type="sphere" name="ball"/><shape type="disk" name="ball"/>'
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(material=blend, version="0.6.0", other=other).replace("</scene>", f"{balls}</scene>"))
    assert told_of(path) == []
    colour = reflected(path, [0, 0, 1], [0, 0, 1]) * np.pi
    np.testing.assert_allclose(colour, [0.6, 0, 0.1], rtol=1e-5, atol=1e-8)
    with variant(SCALAR) as (mi, _):
        assert len(load_scene_source(path, mi).shapes()) == 3


@pytest.mark.parametrize(("clear", "kept", "left"), [(0, "specular", "eta"), (0.5, "eta", "specular")])
def test_one_of_two_numbers_for_highlights_counts(tmp_path: Path, clear: float, kept: str, left: str) -> None:
    """Of clear materials the index of refraction, of others ``specular``; Mitsuba refuses both."""
    numbers = {"specular": 0.3, "eta": 1.7}
    text = '<bsdf type="principled">{}</bsdf>'
    both, alone = (
        text.format(
            "".join(
                f'<float name="{name}" value="{value}"/>'
                for name, value in {"spec_trans": clear, "roughness": 0.3, **values}.items()
            )
        )
        for values in (numbers, {kept: numbers[kept]})
    )
    (tmp_path / "now").mkdir()
    directions = [0, 0, 1], [0, 0.1, 1]
    expected = reflected(scene_file(tmp_path / "now", alone, "3.0.0"), *directions)
    path = scene_file(tmp_path, both, "3.0.0")
    np.testing.assert_allclose(reflected(path, *directions), expected, rtol=1e-5)
    (line,) = told_of(path)
    assert f"with highlights by their {kept!r}, without {left!r}" in line


def test_metal_of_many_reflections_is_as_bright_from_straight_ahead(tmp_path: Path) -> None:
    """Its own widths and distribution; a metal of full reflectance has its colour."""
    own = '<float name="alphaU" value="0.3"/><float name="alphaV" value="0.1"/>'
    former = f'<bsdf type="roughconductorGGX">{own}{rgb("R0", [0.9, 0.6, 0.3])}</bsdf>'
    now = (
        f'<bsdf type="roughconductor">{own}{rgb("specularReflectance", [0.9, 0.6, 0.3])}'
        '<string name="material" value="none"/><string name="distribution" value="ggx"/></bsdf>'
    )
    (tmp_path / "now").mkdir()
    directions = [0.1, 0, 1], [0, 0.1, 1]
    expected = reflected(scene_file(tmp_path / "now", now), *directions)
    assert expected.min() > 0.01
    np.testing.assert_allclose(reflected(scene_file(tmp_path, former), *directions), expected, rtol=1e-5)


def test_the_last_of_two_values_counts_in_files_of_any_version(tmp_path: Path) -> None:
    twice = '<bsdf type="roughplastic"><float name="alpha" value="0.3"/><float name="alpha" value="{}"/></bsdf>'
    for version in ("0.6.0", "2.2.1", "3.0.0"):
        path = scene_file(tmp_path, twice.format(0.2), version)
        assert told_of(path) == ["the last 'alpha' of a bsdf counts, as in older versions"]
        assert told_of(scene_file(tmp_path, twice.format(0.3), version)) == []


def test_metal_without_a_name_stays_a_mirror_in_files_of_present_versions(tmp_path: Path) -> None:
    """Older versions take copper."""
    mirror = '<bsdf type="roughconductor"><float name="alpha" value="0.2"/>{}</bsdf>'
    none = '<string name="material" value="none"/>'
    directions = [0.3, -0.2, 0.9], [-0.4, 0.3, 0.8]
    (tmp_path / "now").mkdir()
    expected = reflected(scene_file(tmp_path / "now", mirror.format(none), "3.0.0"), *directions)
    np.testing.assert_allclose(reflected(scene_file(tmp_path, mirror.format(""), "3.0.0"), *directions), expected)
