"""Textures times colours of vertices: each triangle shows the product of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import DecodeError, Scene, load_scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import VARIABLE
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.files import painted_texture
from davis_rs.scene.files.painted_texture import Patches
from gltf_files import UV, Gltf, png, quad, with_camera

FloatArray = npt.NDArray[np.float64]


def looked_up(texture: npt.NDArray[np.floating], uv: FloatArray, wrap: str) -> FloatArray:
    """The bilinear lookup (n, 3) at coordinates (n, 2), v upwards, point by point."""
    height, width = texture.shape[:2]

    def texel(column: int, row: int) -> FloatArray:
        place = []
        for at, count in ((row, height), (column, width)):
            if wrap == "clamp":
                at = min(max(at, 0), count - 1)
            elif wrap == "mirror":
                at = at % (2 * count)
                at = at if at < count else 2 * count - 1 - at
            else:
                at = at % count
            place.append(at)
        return np.asarray(texture[tuple(place)], np.float64)

    found = []
    for u, v in uv:
        x, y = u * width - 0.5, (1 - v) * height - 0.5
        i, j = int(np.floor(x)), int(np.floor(y))
        a, b = x - i, y - j
        upper = (1 - a) * texel(i, j) + a * texel(i + 1, j)
        lower = (1 - a) * texel(i, j + 1) + a * texel(i + 1, j + 1)
        found.append((1 - b) * upper + b * lower)
    return np.array(found)


def off(texture: FloatArray, wrap: str, uv: FloatArray, colours: FloatArray, seed: int = 0) -> float:
    """The largest difference between what triangles show and the product, at random points of each."""
    patches = Patches.of(texture.shape[1::-1], uv, colours)
    assert patches is not None
    painted, new = patches.painted(texture.astype(np.float32), wrap, coloured=True), patches.uv
    weights = np.random.default_rng(seed).dirichlet([0.7, 0.7, 0.7], size=(len(uv), 12))
    largest = 0.0
    for own, old, after, colour in zip(weights, uv, new, colours, strict=True):
        expected = looked_up(texture, own @ old, wrap) * (own @ colour)
        largest = max(largest, float(np.abs(looked_up(painted, own @ after, "clamp") - expected).max()))
    return largest


@given(
    seed=st.integers(0, 2**32 - 1),
    wrap=st.sampled_from(["repeat", "clamp", "mirror"]),
    size=st.sampled_from([(1, 1), (2, 3), (8, 8), (31, 17)]),
    reach=st.sampled_from([0.5, 1.0, 3.0]),
)
def test_a_triangle_shows_the_product(seed: int, wrap: str, size: tuple[int, int], reach: float) -> None:
    """Of texels that change fully from one to the next, wherever it lies, beyond the texture's edges too."""
    random = np.random.default_rng(seed)
    texture, uv = random.random((*size, 3)), reach * random.uniform(-1, 1, (6, 3, 2))
    edges = (uv[:, 1:] - uv[:, :1]) * size[::-1]
    broad = np.abs(np.linalg.det(edges)) > 0.3 * np.linalg.norm(edges, axis=2).max(1)
    assert off(texture, wrap, uv[broad], random.random((6, 3, 3))[broad]) < 0.02


def test_the_size_of_blocks_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Texels are made some at a time; also where a block ends with the last one."""
    random = np.random.default_rng(8)
    texture, colours = random.random((16, 16, 3)).astype(np.float32), random.random((30, 3, 3))
    patches = Patches.of((16, 16), random.random((30, 3, 2)), colours)
    assert patches is not None
    whole = patches.painted(texture, "repeat", coloured=True)
    count = int(patches.size.prod(1).sum())
    for together in (1, 100, count - 1, count, count + 1):
        monkeypatch.setattr(painted_texture, "_TOGETHER", together)
        assert np.array_equal(patches.painted(texture, "repeat", coloured=True), whole)
    none = Patches.of((16, 16), np.zeros((0, 3, 2)), np.zeros((0, 3, 3)))
    assert none is not None
    assert none.painted(texture, "repeat").shape == (1, 1, 3)


def test_a_triangle_shows_the_product_exactly_where_one_of_both_is_even() -> None:
    """An even colour gives the texels times it; an even texture gives the colours."""
    random = np.random.default_rng(3)
    texture, uv = random.random((16, 16, 3)), random.uniform(-0.5, 1.5, (20, 3, 2))
    even = np.repeat(random.random((20, 1, 3)), 3, 1)
    assert off(texture, "repeat", uv, even) < 1e-6
    patches = Patches.of((16, 16), uv, even)
    assert patches is not None
    assert (patches.parts == 1).all()
    assert off(np.full((16, 16, 3), 0.4), "repeat", uv, 0.3 + 0.4 * random.random((20, 3, 3))) < 1e-5


@pytest.mark.parametrize("reach", [0.0, 1e-15, 1e-4, 0.01])
def test_colours_show_where_all_corners_look_up_one_place(reach: float) -> None:
    """As with palettes, whose triangles look up one texel each; and on strips, which look up one line."""
    random = np.random.default_rng(5)
    texture = random.random((8, 8, 3))
    point = random.random((10, 1, 2)) + reach * random.uniform(-1, 1, (10, 3, 2))
    assert off(texture, "repeat", point, random.random((10, 3, 3))) < 0.02
    line = np.zeros((10, 3, 2))
    line[..., 0] = 0.2 * random.random((10, 3)) + 0.3
    line[..., 1] = 0.37
    assert off(texture, "repeat", line, random.random((10, 3, 3))) < 0.05


@pytest.mark.parametrize("far", [1e12, 1e30, 1e300])
def test_coordinates_far_away_have_no_patches(far: float) -> None:
    """Of any file, whatever its numbers are."""
    uv = np.array([[[0, 0], [1, 0], [0, 1]], [[far, 0], [far, 1], [1 + far, 0]]])
    assert Patches.of((16, 16), uv, np.random.default_rng(1).random((2, 3, 3))) is None


def test_triangles_that_are_alike_share_a_patch() -> None:
    """Copies of a mesh take no more texels than one."""
    random = np.random.default_rng(6)
    uv, colours = random.random((5, 3, 2)), random.random((5, 3, 3))
    one = Patches.of((64, 64), uv, colours)
    many = Patches.of((64, 64), np.tile(uv, (7, 1, 1)), np.tile(colours, (7, 1, 1)))
    assert one is not None
    assert many is not None
    assert many.shape == one.shape
    assert len(many.corners) == 5
    assert off(random.random((64, 64, 3)), "repeat", np.tile(uv, (2, 1, 1)), np.tile(colours, (2, 1, 1))) < 0.02


def saved(gltf: Gltf, folder: Path) -> Scene:
    return load_scene(gltf.save(folder / "quad.glb"))


def luma_of(tmp_path: Path, gltf: Gltf) -> FloatArray:
    """What a camera straight before the quad sees in light that makes white a luma of 1."""
    with_camera(gltf, 1.0)
    gltf.light({"type": "directional", "intensity": 683 * np.pi})
    scene = saved(gltf, tmp_path)
    assert scene.start is not None
    renderer = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=8)
    return np.asarray(renderer.luma(Views.at_rest([scene.start]))[0], np.float64)


COLOURS = np.array([[1, 1, 1], [0.2, 0.2, 0.2], [0.6, 0.6, 0.6], [0.9, 0.9, 0.9]], np.float32)


def textured_quad(texels: npt.NDArray[np.uint8], colours: npt.ArrayLike | None, **more: Any) -> Gltf:
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(texels))})
    material = gltf.material(baseColorTexture=image, **more)
    painted = {} if colours is None else {"colours": colours}
    gltf.node(mesh=quad(gltf, uv=UV, material=material, **painted))
    return gltf


def test_a_quad_shows_its_texture_times_its_colours(tmp_path: Path) -> None:
    """Pixel by pixel the luma of the texture alone, times that of the colours alone; nothing is lost."""
    texels = np.random.default_rng(1).integers(60, 256, (16, 16, 3), np.uint8)
    plain = luma_of(tmp_path, textured_quad(texels, None))
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, colours=COLOURS, material=gltf.material()))
    colours = luma_of(tmp_path, gltf)
    both = luma_of(tmp_path, textured_quad(texels, COLOURS))
    assert both.std() > 0.05
    np.testing.assert_allclose(both, plain * colours, atol=0.01)
    assert not saved(textured_quad(texels, COLOURS), tmp_path).lost_looks


def test_patches_are_found_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """When the file is read, not again whenever a shape is made."""
    found, real = list[Patches | None](), Patches.of

    def counted(*given: Any) -> Patches | None:
        found.append(real(*given))
        return found[-1]

    monkeypatch.setattr(Patches, "of", counted)
    texels = np.random.default_rng(1).integers(60, 256, (16, 16, 3), np.uint8)
    assert luma_of(tmp_path, textured_quad(texels, COLOURS)).std() > 0.05
    assert len(found) == 1


def test_one_colour_of_all_vertices_tints_the_material(tmp_path: Path) -> None:
    """It needs no texels, so what else is looked up stays: a normal map, hard edges of texels."""
    texels = np.random.default_rng(2).integers(60, 256, (4, 4, 3), np.uint8)
    plain = luma_of(tmp_path, textured_quad(texels, None))
    tinted = luma_of(tmp_path, textured_quad(texels, np.full((4, 3), 0.5, np.float32)))
    np.testing.assert_allclose(tinted, plain / 2, rtol=1e-5)
    bare = []
    for more in ({}, {"colours": np.full((4, 3), 0.5, np.float32)}):
        gltf = Gltf()
        gltf.node(mesh=quad(gltf, material=gltf.material(), **more))
        bare.append(luma_of(tmp_path, gltf))
    np.testing.assert_allclose(bare[1], bare[0] / 2, rtol=1e-5)
    gltf = textured_quad(texels, np.full((4, 3), 0.5, np.float32), more={"normalTexture": {"index": 0}})
    assert not saved(gltf, tmp_path).lost_looks


def test_primitives_of_different_tints_are_different_shapes(tmp_path: Path) -> None:
    """Each has its own; those of one tint stay together."""
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 200, np.uint8)))})
    material = gltf.material("wall", baseColorTexture=image)
    for grey in (0.5, 0.5, 0.25):
        gltf.node(mesh=quad(gltf, uv=UV, colours=np.full((4, 3), grey, np.float32), material=material))
    scene = saved(gltf, tmp_path)
    with variant(SCALAR) as (mi, _):
        shapes = load_scene_source(scene.source(), mi).shapes()
        triangles = sorted(shape.face_count() for shape in shapes)
    assert triangles == [2, 4]


@pytest.mark.parametrize(("limit", "most"), [("MOST_TEXELS", 300), ("MOST_PATCHES", 1)])
def test_colours_are_lost_where_their_texture_would_be_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, most: int
) -> None:
    """It is told, and the texture is shown without them."""
    texels = np.random.default_rng(1).integers(60, 256, (16, 16, 3), np.uint8)
    monkeypatch.setattr(painted_texture, limit, most)
    (look,) = saved(textured_quad(texels, COLOURS), tmp_path).lost_looks
    assert look.what == "different colours of vertices"
    plain = luma_of(tmp_path, textured_quad(texels, None))
    assert np.array_equal(luma_of(tmp_path, textured_quad(texels, COLOURS)), plain)


def test_other_textures_stay_where_they_are(tmp_path: Path) -> None:
    """Normals, metal and emission are seen at the same places, also of another size; the base colour is painted."""
    random = np.random.default_rng(4)
    nearly_white = np.array([[1, 1, 1], [0.998, 0.998, 0.998], [1, 1, 1], [1, 1, 1]], np.float32)
    bumps = np.clip(np.array([128, 128, 230]) + random.integers(-60, 60, (16, 16, 3)), 0, 255)
    images = [random.integers(60, 256, (16, n, 3)) for n in (16, 16, 1)]
    seen = []
    for colours in (np.ones((4, 3)), nearly_white):
        gltf = Gltf()
        base, metal, shining = (gltf.texture({"bufferView": gltf.view(png(image))}) for image in images)
        normals = gltf.texture({"bufferView": gltf.view(png(bumps))})
        more = {
            "pbrMetallicRoughness": {"baseColorTexture": base, "metallicRoughnessTexture": metal},
            "normalTexture": normals,
            "emissiveTexture": shining,
            "emissiveFactor": [0.3, 0.3, 0.3],
        }
        gltf.node(mesh=quad(gltf, uv=1.5 * UV, colours=colours, material=gltf.material(more=more)))
        seen.append(luma_of(tmp_path, gltf))
        assert not saved(gltf, tmp_path).lost_looks
    assert seen[0].std() > 0.02
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.01, atol=1e-3)


def bright_on_bumps(colours: npt.ArrayLike, emission: npt.NDArray[np.uint8]) -> Gltf:
    """A quad without a texture of its base colour, with normals that hardly turn it, and emission."""
    gltf = Gltf()
    bumps = gltf.texture({"bufferView": gltf.view(png(np.full((16, 16, 3), [131, 128, 255], np.uint8)))})
    shining = gltf.texture({"bufferView": gltf.view(png(emission))})
    more = {"normalTexture": bumps, "emissiveTexture": shining, "emissiveFactor": [0.2, 0.2, 0.2]}
    gltf.node(mesh=quad(gltf, uv=UV, colours=colours, material=gltf.material(more=more)))
    return gltf


def test_colours_without_a_texture_stay_what_they_are(tmp_path: Path) -> None:
    """Where normals or emission are looked up next to them, coarser ones too."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, colours=COLOURS, material=gltf.material()))
    bare = luma_of(tmp_path, gltf)
    dark = np.zeros((4, 4, 3), np.uint8)
    dark[:2] = 255
    lit = luma_of(tmp_path, bright_on_bumps(COLOURS, dark))
    upper, lower = np.zeros_like(bare, bool), np.zeros_like(bare, bool)
    upper[26:64, 40:200], lower[116:154, 40:200] = True, True
    np.testing.assert_allclose(lit[upper], bare[upper] + 0.2, atol=0.03)
    np.testing.assert_allclose(lit[lower], bare[lower], atol=0.03)


def test_what_blends_keeps_its_alpha(tmp_path: Path) -> None:
    """Haze of half the texels, before a wall that shines."""
    texels = np.random.default_rng(3).integers(60, 200, (16, 16, 4), np.uint8)
    texels[:8, :, 3] = 30
    seen = []
    for colours in (None, np.array([[1, 1, 1], [0.999, 1, 1], [1, 1, 1], [1, 1, 1]])):
        gltf = textured_quad(texels, colours, more={"alphaMode": "BLEND"})
        wall = gltf.material(more={"emissiveFactor": [1, 1, 1]})
        gltf.node(mesh=quad(gltf, material=wall), translation=[0, 0, -0.2])
        seen.append(luma_of(tmp_path, gltf))
    assert seen[0].std() > 0.1
    np.testing.assert_allclose(seen[1], seen[0], atol=5e-3)


@pytest.mark.parametrize("textured", [False, True])
def test_different_colours_are_lost_in_glass(tmp_path: Path, textured: bool) -> None:
    """Whose tint is one."""
    clear = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    gltf = Gltf(extensionsUsed=list(clear))
    image = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 200, np.uint8)))})
    surface: Any = {"baseColorTexture": image} if textured else {}
    pane = gltf.material(roughnessFactor=0.0, more={"extensions": clear}, **surface)
    gltf.node(mesh=quad(gltf, uv=UV, colours=COLOURS, material=pane))
    assert "different colours of vertices" in [look.what for look in saved(gltf, tmp_path).lost_looks]


def test_colours_are_lost_where_texels_have_hard_edges(tmp_path: Path) -> None:
    """A product with what is linear has none."""
    gltf = Gltf()
    texels = np.random.default_rng(1).integers(60, 256, (16, 16, 3), np.uint8)
    image = gltf.texture({"bufferView": gltf.view(png(texels))}, {"magFilter": 9728})
    gltf.node(mesh=quad(gltf, uv=UV, colours=COLOURS, material=gltf.material(baseColorTexture=image)))
    assert [look.what for look in saved(gltf, tmp_path).lost_looks] == ["different colours of vertices"]


@pytest.mark.parametrize("colours", [COLOURS, np.full((4, 3), 0.5, np.float32)])
@pytest.mark.parametrize("textured", [False, True])
def test_colours_are_times_the_factor_of_the_material(tmp_path: Path, textured: bool, colours: FloatArray) -> None:
    """Once, with a texture and without, whether vertices have one colour or many."""
    texels = np.random.default_rng(1).integers(60, 256, (16, 16, 3), np.uint8)

    def luma(factor: float) -> FloatArray:
        if textured:
            return luma_of(tmp_path, textured_quad(texels, colours, baseColorFactor=[factor] * 3 + [1.0]))
        gltf = Gltf()
        gltf.node(mesh=quad(gltf, colours=colours, material=gltf.material(baseColorFactor=[factor] * 3 + [1.0])))
        return luma_of(tmp_path, gltf)

    np.testing.assert_allclose(luma(0.25), luma(1.0) / 4, atol=1e-5)


def test_one_colour_of_all_vertices_tints_glass(tmp_path: Path) -> None:
    """What passes through it, before a wall that shines."""
    clear = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    seen = []
    for grey in (1.0, 0.5):
        gltf = Gltf(extensionsUsed=list(clear))
        pane = gltf.material(roughnessFactor=0.0, more={"extensions": clear})
        gltf.node(mesh=quad(gltf, colours=np.full((4, 3), grey, np.float32), material=pane), translation=[0, 0, 0.2])
        gltf.node(mesh=quad(gltf, material=gltf.material(more={"emissiveFactor": [1, 1, 1]})))
        seen.append(luma_of(tmp_path, gltf)[90, 120])
    assert seen[1] < 0.7 * seen[0]


def test_what_colours_need_is_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A texture that repeats many times has one copy of itself for each time."""
    monkeypatch.setenv(VARIABLE, "bytes=10MiB")
    gltf = Gltf()
    image = gltf.texture({"bufferView": gltf.view(png(np.full((16, 16, 3), 200, np.uint8)))})
    gltf.node(mesh=quad(gltf, uv=60 * UV, colours=COLOURS, material=gltf.material(baseColorTexture=image)))
    with pytest.raises(DecodeError, match="times the colours of its vertices"):
        saved(gltf, tmp_path)


def test_colours_stay_on_what_a_mask_shows(tmp_path: Path) -> None:
    """Half of the texture is clear: the other half has the product."""
    texels = np.full((8, 8, 4), 255, np.uint8)
    texels[:, :4, 3] = 0
    more = {"alphaMode": "MASK"}
    masked = luma_of(tmp_path, textured_quad(texels, COLOURS, more=more))
    whole = luma_of(tmp_path, textured_quad(texels[..., :3].copy(), COLOURS))
    seen = masked > 0
    assert 0.3 < seen.mean() < 0.7
    inside = seen & (np.abs(np.gradient(masked, axis=1)) < 0.02)
    np.testing.assert_allclose(masked[inside], whole[inside], atol=2e-3)
