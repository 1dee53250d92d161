"""What surfaces of glTF and OBJ files emit, against numbers worked out by hand and against Mitsuba's area lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Pose, Scene, SegmentTrajectory, load_scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.events.luma import LUMA_WEIGHTS
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.baked import baked_scene
from davis_rs.render.choice import RENDERER_KINDS, NoiseFreeKind, make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.obstacles import Unsuitable
from davis_rs.render.scene_tables.emissive_textures import TextureImage, alike
from davis_rs.render.texels import Texels
from davis_rs.scene.light_profile import SampledProfile
from davis_rs.scene.repairs import SceneFileWarning
from davis_rs.scene.texel_lookup import bilinear
from gltf_files import CORNERS, FACES, UV, Gltf, png, quad

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(width=32, height=24, fx=16.0, fy=16.0, cx=15.5, cy=11.5)
ORANGE = np.array([1.0, 0.5, 0.125])
TEXELS = np.random.default_rng(5).integers(0, 256, (6, 10, 3))
DIM = {"type": "point", "intensity": 1e-12}
"""A light that lights nothing, so that none is added."""


def image(gltf: Gltf, texels: npt.ArrayLike, **sampler: int) -> dict[str, int]:
    return gltf.texture({"bufferView": gltf.view(png(texels))}, sampler or None)


def world(gltf: Gltf, folder: Path, *, light: dict[str, Any] | None = DIM, eye: float = 3.0) -> Scene:
    """The scene of a file, seen from the z axis of the file, ``eye`` metres above or below what lies around 0."""
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.4, "aspectRatio": 4 / 3}})
    turn = [0.0, 0.0, 0.0, 1.0] if eye > 0 else [0.0, 1.0, 0.0, 0.0]
    gltf.node(camera=camera, translation=[0, 0, eye], rotation=turn)
    if light is not None:
        gltf.light(light)
    return load_scene(gltf.save(folder / "scene.glb"))


def shining(
    factor: npt.ArrayLike,
    *,
    texture: Any = None,
    strength: float | None = None,
    surface: Any = None,
    gltf: Gltf,
    uv: npt.ArrayLike = UV,
) -> int:
    """A square of 2 x 2 m that emits, and reflects nothing unless ``surface`` says more."""
    more: dict[str, Any] = {"emissiveFactor": np.asarray(factor).tolist()}
    if texture is not None:
        more["emissiveTexture"] = texture
    if strength is not None:
        more["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    material = gltf.material("lamp", more=more, **({"baseColorFactor": [0, 0, 0, 1]} | (surface or {})))
    return gltf.node(mesh=quad(gltf, uv=uv, material=material))


def luma(scene: Scene, kind: str = "auto", *, rays: int = 1, **more: Any) -> FloatArray:
    """Luma (H, W) of the scene at its start."""
    assert scene.start is not None
    renderer = make_renderer(
        scene, CAMERA, kind=kind, rays_per_pixel=rays, lattice_rays_per_pixel=rays, blur=False, **more
    )
    return np.asarray(renderer.luma(Views.at_rest([scene.start]))[0], np.float64)


@pytest.mark.parametrize("kind", ["native", "baked"])
@pytest.mark.parametrize("eye", [3.0, -3.0], ids=["front", "back"])
def test_a_colour_is_seen_from_both_sides(kind: str, eye: float, tmp_path: Path) -> None:
    """Times the strength of its extension, and no look is lost."""
    gltf = Gltf()
    shining(ORANGE, strength=2.5, gltf=gltf)
    scene = world(gltf, tmp_path, eye=eye)
    assert scene.lost_looks == ()
    shown = luma(scene, kind)
    np.testing.assert_allclose(shown[8:16, 12:20], 2.5 * ORANGE @ LUMA_WEIGHTS, rtol=1e-5)
    assert not shown[:, :8].any()


def test_a_factor_above_the_standard_is_taken_and_told(tmp_path: Path) -> None:
    """As files from before KHR_materials_emissive_strength say it; one that is rounded is 1, which is not told."""
    gltf = Gltf()
    shining(4 * ORANGE, gltf=gltf)
    with pytest.warns(SceneFileWarning, match=r"emissiveFactor above 1, .*: 1 \(the first: materials\[0"):
        scene = world(gltf, tmp_path)
    np.testing.assert_allclose(luma(scene)[8:16, 12:20], 4 * ORANGE @ LUMA_WEIGHTS, rtol=1e-5)
    rounded = Gltf()
    shining([1.000001, 1, 1], gltf=rounded)
    world(rounded, tmp_path)


@pytest.mark.without_llvm
@pytest.mark.parametrize("pixel", ["rays", "lines"])
def test_what_is_emitted_comes_on_top_of_what_is_reflected(pixel: str, tmp_path: Path) -> None:
    def shown(*, emits: bool, reflects: bool) -> FloatArray:
        gltf = Gltf()
        grey = [0.4, 0.4, 0.4, 1] if reflects else [0, 0, 0, 1]
        shining(ORANGE * emits, surface={"baseColorFactor": grey}, gltf=gltf)
        sun = {"type": "directional", "intensity": 683.0}
        return luma(world(gltf, tmp_path, light=sun), "native", rays=8, pixel=pixel)

    both, emitted, reflected = (
        shown(emits=emits, reflects=reflects) for emits, reflects in ((True, True), (True, False), (False, True))
    )
    assert emitted.max() > 0.5
    assert reflected.max() > 0.05
    np.testing.assert_allclose(both, emitted + reflected, atol=1e-6)


BASES: dict[str, Callable[[Gltf], dict[str, Any]]] = {
    "no texture": lambda gltf: {"baseColorFactor": [0.4, 0.4, 0.4, 1]},
    "a texture": lambda gltf: {"baseColorTexture": image(gltf, np.full((6, 10, 3), 150))},
    "a finer texture": lambda gltf: {"baseColorTexture": image(gltf, np.full((18, 30, 3), 150))},
    "metal": lambda gltf: {"baseColorFactor": [0.9, 0.6, 0.3, 1], "metallicFactor": 0.5, "roughnessFactor": 0.4},
}


@pytest.mark.few(2)
@pytest.mark.parametrize("base", BASES)
def test_a_texture_is_seen_as_mitsuba_sees_it(base: str, tmp_path: Path) -> None:
    """Whatever the surface reflects besides. Mitsuba's area lights shine from their fronts."""
    gltf = Gltf()
    texture = image(gltf, TEXELS)
    shining(ORANGE, texture=texture, strength=1.5e6, surface=BASES[base](gltf), gltf=gltf)
    scene = world(gltf, tmp_path)
    assert scene.lost_looks == ()
    assert "emission" not in make_renderer(scene, CAMERA, kind="native").reason
    ours, theirs = (luma(scene, kind, rays=64) for kind in ("native", "integrator"))
    inside = np.s_[8:16, 12:20]
    np.testing.assert_allclose(ours[inside], theirs[inside], rtol=0.15)  # Mitsuba's rays are drawn at random
    np.testing.assert_allclose(ours[inside].mean(), theirs[inside].mean(), rtol=0.01)


@pytest.mark.parametrize("base", ["no texture", "metal"])
def test_texels_are_where_their_coordinates_say(base: str, tmp_path: Path) -> None:
    """The luma at the middle of a pixel is that of the bilinear texture, worked out by hand; beyond its edges too."""
    gltf = Gltf()
    texture = image(gltf, TEXELS, wrapS=33071, wrapT=33071)
    shining([1, 1, 1], texture=texture, surface=BASES[base](gltf), gltf=gltf, uv=1.6 * UV - 0.3)
    shown = luma(world(gltf, tmp_path), "native", rays=1)
    rows, columns = np.mgrid[7:17, 11:21]
    # The square lies 3 m away; the one ray of a pixel passes its middle.
    u, v = ((columns - CAMERA.cx) / 16 * 3 + 1) / 2, ((rows - CAMERA.cy) / 16 * 3 + 1) / 2
    u, v = 1.6 * u - 0.3, 1.6 * v - 0.3
    assert u.min() < 0
    assert v.max() > 1
    x, y = np.clip(u * 10 - 0.5, 0, 9), np.clip(v * 6 - 0.5, 0, 5)
    column, row = np.clip(np.floor(x).astype(int), 0, 8), np.clip(np.floor(y).astype(int), 0, 4)
    right, below = (x - column)[..., None], (y - row)[..., None]
    light = from_srgb(TEXELS / 255)
    upper = light[row, column] * (1 - right) + light[row, column + 1] * right
    lower = light[row + 1, column] * (1 - right) + light[row + 1, column + 1] * right
    expected = (upper * (1 - below) + lower * below) @ LUMA_WEIGHTS
    np.testing.assert_allclose(shown[7:17, 11:21], expected, atol=2e-3)


def test_texels_of_another_size_than_the_base_colours(tmp_path: Path) -> None:
    """Both are looked up where the finer one has its texels; in between they differ by less than a texel's curve."""
    seen = {}
    for name, shape in {"alone": None, "coarser": (2, 2, 3), "finer": (36, 30, 3)}.items():
        gltf = Gltf()
        texture = image(gltf, TEXELS)
        surface = None
        if shape is not None:
            surface = {"baseColorTexture": image(gltf, np.zeros(shape)), "baseColorFactor": [1, 1, 1, 1]}
        shining([1, 1, 1], texture=texture, surface=surface, gltf=gltf)
        seen[name] = luma(world(gltf, tmp_path), "native", rays=8)
    np.testing.assert_allclose(seen["coarser"], seen["alone"], atol=1e-6)
    np.testing.assert_allclose(seen["finer"], seen["alone"], atol=0.03 * seen["alone"].max())
    assert np.ptp(seen["alone"][8:16, 12:20]) > 0.2


def test_a_texture_that_lies_elsewhere_counts_by_its_mean(tmp_path: Path) -> None:
    """Other coordinates or another wrap mode than those of the base colour; it is told. One that is black is none."""
    lost = "light of their own that differs from place to place (its mean is taken)"
    moved = {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}
    mean = from_srgb(TEXELS / 255).mean((0, 1)) @ LUMA_WEIGHTS
    cases: list[tuple[dict[str, Any], dict[str, int]]] = [(moved, {}), ({"texCoord": 1}, {})]
    cases.append(({}, {"wrapS": 33071, "wrapT": 33071}))
    for more, sampler in cases:
        gltf = Gltf(extensionsUsed=["KHR_texture_transform"])
        surface = {"baseColorTexture": image(gltf, np.zeros((4, 4, 3))), "baseColorFactor": [1, 1, 1, 1]}
        shining([1, 1, 1], texture=image(gltf, TEXELS, **sampler) | more, surface=surface, gltf=gltf)
        scene = world(gltf, tmp_path)
        assert {look.what: look.of for look in scene.lost_looks} == {lost: ("lamp",)}
        np.testing.assert_allclose(luma(scene, "native")[8:16, 12:20], mean, rtol=1e-3)


def emitting(scene: Scene) -> int:
    """How many shapes have an area light."""
    with variant(SCALAR) as (mi, _):
        return sum(shape.is_emitter() for shape in load_scene_source(scene.source(), mi).shapes())


def test_what_is_black_is_no_light(tmp_path: Path) -> None:
    """A factor of 0, and a texture that is black everywhere."""
    for factor, texels in (([0, 0, 0], TEXELS), ([1, 1, 1], np.zeros((4, 4, 3))), ([1, 1, 1], TEXELS)):
        gltf = Gltf()
        shining(factor, texture=image(gltf, texels), gltf=gltf)
        assert emitting(world(gltf, tmp_path)) == int(factor[0] == 1 and texels is TEXELS)


def test_the_files_of_textures_are_known(tmp_path: Path) -> None:
    (tmp_path / "glow.png").write_bytes(png(TEXELS))
    gltf = Gltf()
    shining([1, 1, 1], texture=gltf.texture({"uri": "glow.png"}), gltf=gltf)
    assert tmp_path / "glow.png" in world(gltf, tmp_path).files


def test_texels_with_hard_edges(tmp_path: Path) -> None:
    """As the emissive texture's own sampler says, or the base colour's if that has a texture; then it is told."""
    texels = np.zeros((2, 2, 3))
    texels[:, 1] = 255
    between = {}
    for name, (hard, base) in {"hard": (True, None), "soft": (False, None), "base soft": (True, False)}.items():
        gltf = Gltf()
        sampler = {"magFilter": 9728 if hard else 9729}
        surface = None if base is None else {"baseColorTexture": image(gltf, np.zeros((2, 2, 3)))}
        shining([1, 1, 1], texture=image(gltf, texels, **sampler), surface=surface, gltf=gltf)
        scene = world(gltf, tmp_path)
        told = "how texels of their own light are filtered (as those of the base colour are)"
        assert [look.what for look in scene.lost_looks] == [told] * (base is not None)
        row = luma(scene, "native", rays=16)[12, 12:20]
        between[name] = int(((row > 0.02) & (row < 0.98)).sum())
    assert between["hard"] <= 2
    assert between["soft"] >= 3
    assert between["base soft"] >= 3


def test_both_textures_of_any_sizes_are_brought_to_one() -> None:
    """Each is looked up at the texels of the finer one, and what lies elsewhere is refused."""
    random = np.random.default_rng(2)
    low, high = (Texels(random.random(shape)) for shape in ((3, 2, 3), (150, 7, 3)))
    turned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    image, emitted = alike(TextureImage(low, 2, turned), TextureImage(high, 2, turned), "a wall")
    assert (image.wrap, image.uv_map is turned) == (2, True)
    assert emitted is high
    x, y = np.meshgrid((np.arange(7) + 0.5) / 7, (np.arange(150) + 0.5) / 150)
    ((_, made),) = image.texels.pieces()
    np.testing.assert_allclose(made, bilinear(low, np.stack([x.ravel(), y.ravel()]), 2), atol=1e-6)
    constant = TextureImage(Texels(np.full((1, 1, 3), 0.5)), 0, np.eye(3))
    for first, second in ((constant, TextureImage(high, 2, turned)), (TextureImage(high, 2, turned), constant)):
        image, emitted = alike(first, second, "a wall")
        assert (image.wrap, image.uv_map is turned) == (2, True)
        assert image.texels.shape == emitted.shape == (150, 7, 3)
    for other in (TextureImage(high, 1, turned), TextureImage(high, 2, np.eye(3))):
        with pytest.raises(Unsuitable, match="a wall emits by a texture at other texture coordinates"):
            alike(TextureImage(low, 2, turned), other, "a wall")


def test_textures_are_charged_for_each_shape(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What they take in linear light is more than their files."""
    large = np.zeros((512, 512, 3))
    large[0, 0] = 255
    gltf = Gltf()
    texture = image(gltf, large)
    shining([1, 1, 1], texture=texture, gltf=gltf)
    path = gltf.save(tmp_path / "one.glb")
    (tmp_path / "m.mtl").write_text("newmtl lamp\nKd 0 0 0\nmap_Ke large.png\n")
    (tmp_path / "large.png").write_bytes(png(large))
    (tmp_path / "m.obj").write_text(SQUARE + "f 1/1 2/2 3/3 4/4\n")
    for file in (path, tmp_path / "m.obj"):
        monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "bytes=3000000")
        with pytest.raises(ValueError, match="a texture of 512 x 512 texels in linear light"):
            load_scene(file)
        monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "bytes=6000000")
        load_scene(file)
    # A moving copy is one more shape.
    number = gltf.document["nodes"][0]["mesh"]
    gltf.animate(gltf.node(mesh=number), "translation", [0.0, 1.0], np.array([[0, 0, 0], [1, 0, 0.0]]))
    gltf.save(path)
    with pytest.raises(ValueError, match="one more shape of the material lamp"):
        load_scene(path)


@pytest.mark.parametrize("base", ["no texture", "metal"])
def test_a_colour_filter_sees_its_light(base: str, tmp_path: Path) -> None:
    gltf = Gltf()
    shining(ORANGE, texture=image(gltf, np.full((3, 3, 3), 255)), surface=BASES[base](gltf), gltf=gltf)
    scene = world(gltf, tmp_path)
    for channel in range(3):
        shown = luma(scene, "native", weights=tuple(float(i == channel) for i in range(3)))
        np.testing.assert_allclose(shown[8:16, 12:20], ORANGE[channel], rtol=1e-4)


def panel_over_floor(folder: Path, *, strength: float, height: float = 1.0, texture: bool = False) -> Scene:
    """A grey floor in many pieces, and a square of 2 x 2 m that emits, ``height`` above it; the camera looks down."""
    gltf = Gltf()
    rows = np.linspace(-2.0, 2.0, 33)
    x, y = np.meshgrid(rows, rows)
    corners = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    index = np.arange(33 * 33).reshape(33, 33)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    grey = gltf.material("floor", baseColorFactor=[0.5, 0.5, 0.5, 1])
    gltf.node(mesh=gltf.mesh(corners, faces, material=grey))
    half = np.zeros((2, 2, 3))
    half[:, 0] = 255
    shown = image(gltf, half) if texture else None
    more = {
        "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}},
    }
    lamp = gltf.material(
        "lamp", baseColorFactor=[0, 0, 0, 1], more=more | ({"emissiveTexture": shown} if texture else {})
    )
    # It faces up: its back lights the floor.
    gltf.node(mesh=gltf.mesh(CORNERS, FACES, uv=UV, material=lamp), translation=[0, 0, height])
    return world(gltf, folder, eye=0.5)


def floor_luma(scene: Scene) -> FloatArray:
    """Luma at the floor's middle, seen from below the lamp."""
    return luma(scene, "auto", rays=4)[10:14, 14:18]


def test_a_small_lamp_lights_once(tmp_path: Path) -> None:
    """By its area, its distance and both cosines: no light is left to shadows of small lamps."""
    side = 0.01
    gltf = Gltf()
    grey = gltf.material("floor", baseColorFactor=[0.5, 0.5, 0.5, 1])
    gltf.node(mesh=gltf.mesh(CORNERS * [4, 4, 1], FACES, material=grey))
    more = {"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e5}}}
    lamp = gltf.material("lamp", baseColorFactor=[0, 0, 0, 1], more=more)
    gltf.node(mesh=gltf.mesh(CORNERS * side / 2, FACES, material=lamp), translation=[0, 0, 2])
    scene = world(gltf, tmp_path, eye=1.0)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, lattice_rays_per_pixel=1)
    assert isinstance(renderer, NativeRenderer)
    assert {light.kind for light in renderer.table.lights} == {"emission", "point", "visible", "baked"}
    np.testing.assert_allclose(floor_luma(scene), 0.5 * 1e5 * side**2 / (np.pi * 2**2), rtol=0.1)
    here, there = Pose([0, 0, 0], [0, 0, 0, 1]), Pose([1, 0, 0], [0, 0, 0, 1])
    moving = replace(scene, objects={"mesh_lamp": SegmentTrajectory(here, there, 1.0)})
    baked = RENDERER_KINDS["baked"]
    assert isinstance(baked, NoiseFreeKind)
    assert "sharp shadows" not in str(baked.why_not(moving))


def test_it_lights_other_surfaces_where_that_is_baked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its form factor (Howell, B-4), from its back too; by the mean of a texture; without a bake not at all."""
    p = np.sqrt(2.0)
    factor = 4 * (2 / p * np.arctan(1 / p)) / (2 * np.pi)
    for strength, texture in ((3.0, False), (3.0, True)):
        scene = panel_over_floor(tmp_path, strength=strength, texture=texture)
        mean = 0.5 if texture else 1.0
        np.testing.assert_allclose(floor_luma(scene), 0.5 * strength * mean * factor, rtol=0.08)
    monkeypatch.setattr(baked_scene, "MOST_QUICK_SIDES", 10)
    assert not floor_luma(scene).any()


def test_metal_shows_what_shines_and_shines_itself(tmp_path: Path) -> None:
    """In a flat mirror half of the lamp behind the camera is seen, where its texture emits."""
    gltf = Gltf()
    half = np.zeros((2, 8, 3))
    half[:, 4:] = 255
    mirror = gltf.material(
        "mirror",
        metallicFactor=1.0,
        roughnessFactor=0.0,
        baseColorFactor=[1, 1, 1, 1],
        more={"emissiveFactor": [0.25, 0.25, 0.25]},
    )
    gltf.node(mesh=quad(gltf, uv=UV, material=mirror))
    more = {"emissiveFactor": [1, 1, 1], "emissiveTexture": image(gltf, half, wrapS=33071, wrapT=33071)}
    lamp = gltf.material("lamp", baseColorFactor=[0, 0, 0, 1], more=more)
    gltf.node(mesh=gltf.mesh(CORNERS * [3, 3, 1], FACES, uv=UV, material=lamp), translation=[0, 0, 4])
    shown = luma(world(gltf, tmp_path), "native")
    assert shown[12, 13] == pytest.approx(0.25, abs=0.02)
    assert shown[12, 19] == pytest.approx(1.25, abs=0.02)


@pytest.mark.parametrize("kind", ["native", "baked"])
def test_metal_that_emits_shows_nothing_else_in_the_dark(kind: str, tmp_path: Path) -> None:
    gltf = Gltf()
    texture = image(gltf, np.full((2, 2, 3), 255))
    shining(ORANGE, texture=texture, surface=BASES["metal"](gltf), gltf=gltf)
    shown = luma(world(gltf, tmp_path), kind, rays=4)
    np.testing.assert_allclose(shown[8:16, 12:20], ORANGE @ LUMA_WEIGHTS, rtol=1e-5)


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", ["native", "baked"])
@pytest.mark.parametrize("look", ["a colour", "a texture", "colours of vertices"])
def test_an_unlit_surface_has_its_base_colour_in_any_light(look: str, kind: str, tmp_path: Path) -> None:
    """And none of the material's other looks."""
    shown = []
    for sun in (DIM, {"type": "directional", "intensity": 6830.0}):
        gltf = Gltf(extensionsUsed=["KHR_materials_unlit"])
        surface: dict[str, Any] = {"baseColorFactor": [*ORANGE, 1], "metallicFactor": 1.0}
        colours = {}
        if look == "a texture":
            surface["baseColorTexture"] = image(gltf, np.full((2, 2, 3), 188))
        elif look == "colours of vertices":
            # Where they rise most, the plane through three colours is negative beyond the triangle.
            colours = {"colours": np.array([[1, 1, 1], [0.02, 0.02, 0.02], [0.02, 0.02, 0.02], [0.02, 0.02, 0.02]])}
        more = {"extensions": {"KHR_materials_unlit": {}}, "emissiveFactor": [1, 1, 1], "normalTexture": {"index": 0}}
        material = gltf.material("flat", more=more, **surface)
        gltf.node(mesh=quad(gltf, uv=UV, material=material, **colours))
        scene = world(gltf, tmp_path, light=sun)
        assert scene.lost_looks == ()
        shown.append(luma(scene, kind)[8:16, 12:20])
    np.testing.assert_array_equal(shown[0], shown[1])
    rows, columns = np.mgrid[8:16, 12:20]
    x, y = (columns - CAMERA.cx) / 16 * 3, (CAMERA.cy - rows) / 16 * 3
    of_first = (1 - np.maximum(x, y)) / 2
    factors = {"a colour": 1.0, "a texture": from_srgb(188 / 255), "colours of vertices": 0.02 + 0.98 * of_first}
    expected = np.broadcast_to(factors[look] * (ORANGE @ LUMA_WEIGHTS), x.shape)
    np.testing.assert_allclose(shown[0], expected, rtol=1e-4)


@pytest.mark.usefixtures("llvm")
def test_the_table_kernel_refuses_what_emits(tmp_path: Path) -> None:
    gltf = Gltf()
    shining(ORANGE, gltf=gltf)
    with pytest.raises(ValueError, match="a shape emits light, which only the native renderer shows"):
        luma(world(gltf, tmp_path), "table")


@pytest.mark.parametrize("base", ["no texture", "metal"])
def test_its_strength_may_change(base: str, tmp_path: Path) -> None:
    """Of one shape, while another shines on."""
    gltf = Gltf()
    shining([1, 1, 1], texture=image(gltf, TEXELS), surface=BASES[base](gltf), gltf=gltf)
    other = gltf.material("other", more={"emissiveFactor": [0.5, 0.5, 0.5]}, baseColorFactor=[0, 0, 0, 1])
    gltf.node(mesh=quad(gltf, material=other), translation=[-2.2, 0, 0])
    scene = world(gltf, tmp_path)
    steady = luma(scene, "native")
    half = replace(scene, lights={"mesh_lamp.emitter": SampledProfile([0.0, 1.0], [0.5, 0.5])})
    np.testing.assert_allclose(luma(half, "native")[:, 12:], 0.5 * steady[:, 12:], rtol=1e-5)
    np.testing.assert_allclose(luma(half, "native")[:, :10], steady[:, :10], rtol=1e-5)
    assert steady[12, 5] == pytest.approx(0.5)


def test_a_mesh_that_deforms_emits(tmp_path: Path) -> None:
    gltf = Gltf()
    number = shining(ORANGE, gltf=gltf)
    gltf.animate(number, "scale", [0.0, 1.0], np.array([[1, 1, 1], [2, 2, 2.0]]))
    scene = world(gltf, tmp_path)
    assert scene.deformations
    np.testing.assert_allclose(luma(scene)[8:16, 12:20], ORANGE @ LUMA_WEIGHTS, rtol=1e-5)


SQUARE = """mtllib m.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl lamp
"""


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("lines", "face", "expected", "lost"),
    [
        ("Ke 1 0.5 0.125", "f 1 2 3 4", ORANGE, ()),
        ("Ke 4", "f 1 2 3 4", np.full(3, 4.0), ()),
        ("map_Ke grey.png", "f 1/1 2/2 3/3 4/4", np.full(3, float(from_srgb(100 / 255))), ()),
        ("map_Ke grey.png\nKe 2 1 0.25", "f 1/1 2/2 3/3 4/4", 2 * ORANGE * from_srgb(100 / 255), ()),
        (
            "map_Ke grey.png",
            "f 1 2 3 4",
            np.full(3, float(from_srgb(100 / 255))),
            ("light of their own that differs from place to place (its mean is taken)",),
        ),
        ("map_Ke gone.png", "f 1/1 2/2 3/3 4/4", np.zeros(3), ("light of their own",)),
        ("map_Ke -s 2 2 grey.png", "f 1/1 2/2 3/3 4/4", np.zeros(3), ("light of their own",)),
        ("map_Ke grey.png\nKe 0", "f 1/1 2/2 3/3 4/4", np.full(3, float(from_srgb(100 / 255))), ()),
        ("Ke spectral lamp.rfl", "f 1 2 3 4", np.zeros(3), ("light of their own",)),
        ("Ke 1e19 0 0", "f 1 2 3 4", np.zeros(3), ("light of their own",)),
    ],
    ids=["Ke", "bright", "map_Ke", "both", "no vt", "gone", "options", "texture alone", "spectrum", "too bright"],
)
def test_materials_of_obj_files_emit(
    lines: str, face: str, expected: FloatArray, lost: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "m.mtl").write_text(f"newmtl lamp\nKd 0 0 0\n{lines}\n")
    (tmp_path / "grey.png").write_bytes(png(np.full((4, 4, 3), 100)))
    (tmp_path / "m.obj").write_text(SQUARE + face + "\n")
    scene = load_scene(tmp_path / "m.obj")
    assert tuple(look.what for look in scene.lost_looks) == lost
    assert (tmp_path / "grey.png" in scene.files) == ("grey.png" in lines and "-s" not in lines)
    shown = luma(replace(scene, start=scene.path.pose(0.0)), "native")
    np.testing.assert_allclose(shown[11:13, 15:17], expected @ LUMA_WEIGHTS, rtol=1e-4, atol=1e-6)
