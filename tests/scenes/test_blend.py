"""Surfaces that cover a part of their area, of glTF, OBJ and Mitsuba files: what is seen of them and through them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Pose, Scene, SceneFileWarning, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.finish import Finish
from gltf_files import CORNERS, FACES, UV, Gltf, png, quad

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(width=32, height=24, fx=16.0, fy=16.0, cx=15.5, cy=11.5)
INSIDE = np.s_[8:16, 12:20]
UNLIT: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
"""So that a surface has a known luma."""


def grey(gltf: Gltf, name: str, luma: float, alpha: float = 1.0, **more: Any) -> int:
    """An unlit material of this luma that blends."""
    looks = {"alphaMode": "BLEND", **UNLIT}
    return gltf.material(name, baseColorFactor=[luma, luma, luma, alpha], more=looks, **more)


def world(gltf: Gltf, folder: Path) -> Scene:
    """The scene of a file, seen from 3 m along its z axis, in the dark."""
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.4, "aspectRatio": 4 / 3}})
    gltf.node(camera=camera, translation=[0, 0, 3])
    gltf.light({"type": "point", "intensity": 1e-12})
    return load_scene(gltf.save(folder / "scene.glb"))


def luma(scene: Scene, kind: str = "native", rays: int = 1) -> FloatArray:
    assert scene.start is not None
    renderer = make_renderer(scene, CAMERA, kind=kind, rays_per_pixel=rays, lattice_rays_per_pixel=rays, blur=False)
    return np.asarray(renderer.luma(Views.at_rest([scene.start]))[0], np.float64)


@pytest.mark.without_llvm
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_layers_blend_in_their_order_of_depth(order: tuple[int, ...], tmp_path: Path) -> None:
    """Whatever their order in the file."""
    gltf = Gltf()
    layers = [(1.0, 0.25, 0.5), (0.3, 0.5, 0.0), (0.8, 1.0, -0.5)]
    for number in order:
        shade, alpha, z = layers[number]
        gltf.node(mesh=quad(gltf, material=grey(gltf, f"layer_{number}", shade, alpha)), translation=[0, 0, z])
    scene = world(gltf, tmp_path)
    assert scene.lost_looks == ()
    np.testing.assert_allclose(luma(scene)[10:14, 14:18], 0.25 + 0.75 * (0.5 * 0.3 + 0.5 * 0.8), rtol=1e-5)


@pytest.mark.parametrize(
    ("metal", "rough", "lost"), [(0.5, 1.0, ["metal"]), (0.0, 0.2, ["highlights"]), (0.0, 1.0, [])]
)
def test_what_a_blend_does_not_reflect_is_told(metal: float, rough: float, lost: list[str], tmp_path: Path) -> None:
    gltf = Gltf()
    base: dict[str, Any] = {"baseColorFactor": [1, 1, 1, 0.5], "metallicFactor": metal, "roughnessFactor": rough}
    gltf.node(mesh=quad(gltf, material=gltf.material("pane", more={"alphaMode": "BLEND"}, **base)))
    assert [look.what for look in world(gltf, tmp_path).lost_looks] == lost


def test_alpha_of_a_texture(tmp_path: Path) -> None:
    """The bilinear alpha at the middle of a pixel says how much is seen; with a factor, and of a lit surface too."""
    ramp = np.zeros((4, 16, 4))
    ramp[..., :3], ramp[..., 3] = 255, np.linspace(0, 255, 16)
    shown = []
    for looks in (UNLIT, {"emissiveFactor": [0, 0, 0]}):
        gltf = Gltf()
        texture = gltf.texture({"bufferView": gltf.view(png(ramp))}, {"wrapS": 33071, "wrapT": 33071})
        haze = gltf.material(
            "haze", baseColorTexture=texture, baseColorFactor=[1, 1, 1, 0.5], more={"alphaMode": "BLEND", **looks}
        )
        gltf.node(mesh=quad(gltf, uv=1.6 * UV - 0.3, material=haze))
        gltf.node(mesh=gltf.mesh(CORNERS * [9, 9, 1], FACES, material=grey(gltf, "wall", 0.2)), translation=[0, 0, -1])
        scene = world(gltf, tmp_path)
        assert scene.lost_looks == ()
        shown.append(luma(scene)[INSIDE])
    u = 1.6 * ((np.arange(12, 20) - CAMERA.cx) / 16 * 3 + 1) / 2 - 0.3
    assert u.min() < 0
    alpha = 0.5 * np.clip((u * 16 - 0.5) / 15, 0, 1)
    np.testing.assert_allclose(shown[0], np.broadcast_to(alpha + (1 - alpha) * 0.2, (8, 8)), rtol=1e-3)
    np.testing.assert_allclose(shown[1], np.broadcast_to((1 - alpha) * 0.2, (8, 8)), rtol=1e-3)


def test_what_is_hidden_is_no_surface(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, material=grey(gltf, "none", 1.0, 0.0)))
    gltf.node(mesh=quad(gltf, material=grey(gltf, "wall", 0.2)), translation=[0, 0, -0.1])
    with pytest.warns(SceneFileWarning, match="that the alpha of their material hides are left out"):
        scene = world(gltf, tmp_path)
    np.testing.assert_allclose(luma(scene)[10:14, 14:18], 0.2, rtol=1e-5)


@pytest.mark.parametrize("opacity", [0.3, 0.7])
def test_baked_light_passes_what_is_less_than_half_opaque(opacity: float, tmp_path: Path) -> None:
    """A lamp above a floor, and a sheet in between that is not seen from below it."""
    gltf = Gltf()
    steps = np.linspace(-2.0, 2.0, 33)
    x, y = np.meshgrid(steps, steps)
    corners = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    index = np.arange(33 * 33).reshape(33, 33)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    floor = gltf.material("floor", baseColorFactor=[0.5, 0.5, 0.5, 1])
    gltf.node(mesh=gltf.mesh(corners, faces, material=floor), translation=[0, 0, -2])
    lamp = gltf.material("lamp", more={"emissiveFactor": [1, 1, 1]}, baseColorFactor=[0, 0, 0, 1])
    gltf.node(mesh=quad(gltf, material=lamp), translation=[0, 0, 8])
    sheet = gltf.material("sheet", baseColorFactor=[0, 0, 0, opacity], more={"alphaMode": "BLEND"})
    gltf.node(mesh=gltf.mesh(CORNERS * [9, 9, 1], FACES, material=sheet), translation=[0, 0, 5])
    shown = luma(world(gltf, tmp_path), "auto")[10:14, 14:18]
    if opacity > 0.5:
        assert shown.max() < 1e-9
    else:
        np.testing.assert_allclose(shown, 0.5 * 4 / (np.pi * 10**2), rtol=0.05)


def test_each_clear_pane_has_the_baked_light_of_its_own_place(tmp_path: Path) -> None:
    """Two white panes at different distances from a lamp."""
    gltf = Gltf()
    lamp = gltf.material("lamp", more={"emissiveFactor": [1, 1, 1]}, baseColorFactor=[0, 0, 0, 1])
    gltf.node(mesh=quad(gltf, material=lamp), translation=[0, 0, 8])
    pane = gltf.material("pane", baseColorFactor=[1, 1, 1, 0.3], more={"alphaMode": "BLEND"})
    for x, z in ((-1.2, 0), (1.2, -1)):
        gltf.node(mesh=quad(gltf, material=pane), translation=[x, 0, z])
    shown = luma(world(gltf, tmp_path), "auto")
    for x, z in ((-1.2, 0), (1.2, -1)):
        column, squared = round(15.5 + 16 * x / (3 - z)), (8 - z) ** 2 + x**2
        assert shown[11, column] == pytest.approx(0.3 * 4 * (8 - z) ** 2 / (np.pi * squared**2), rel=0.05)


MASKED = {
    "one value": {"type": "rgb", "value": 0.4},
    "a bitmap": {
        "type": "bitmap",
        "raw": True,
        "wrap_mode": "mirror",
        "data": np.random.default_rng(8).random((9, 7, 1)).astype(np.float32),
        "to_uv": np.diag([2.0, 1.5, 1.0]),
    },
}


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("opacity", MASKED)
def test_masks_of_mitsuba_are_the_path_tracers(opacity: str) -> None:
    """A card above a floor in the light of the sun: both its sides, its shadow, and what is seen through it."""
    content = scene_with(MASKED[opacity], "path")
    ours = shown_from_above(content, "auto", 64)
    theirs = shown_from_above(content, "integrator", 1024)
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.01
    assert np.ptp(theirs) > 0.2


def test_masks_that_stay_with_mitsuba() -> None:
    """Light that falls through one lights what lies in its shadow, with integrators for volumes; an area light shines
    unseen; metal and what is bumpy twice have no part that is seen through; an opacity is 0 to 1."""
    half = MASKED["one value"]
    metal = {"type": "twosided", "nested": {"type": "conductor"}}
    bumpy = {"type": "bumpmap", "arbitrary": MASKED["a bitmap"], "nested": WHITE}
    coated = {"type": "twosided", "nested": {"type": "bumpmap", "arbitrary": MASKED["a bitmap"], "nested": bumpy}}
    lamp = {"light": {"type": "area", "radiance": 1.0}}
    for content in (
        scene_with(half, "volpath"),
        scene_with(half, "path", nested=metal),
        scene_with(half, "path", nested=coated),
        scene_with({"type": "uniform", "value": 1.5}, "path"),
    ):
        with pytest.raises(ValueError, match=r"mask\("):
            shown_from_above(content, "native", 1)
    with pytest.raises(ValueError, match=r"mask\("):
        shown_from_above(scene_with(half, "path", **lamp), "baked", 1)


@pytest.mark.parametrize(("opacity", "passes"), [(0.3, True), (0.7, False)])
def test_what_light_that_bounces_finds(opacity: float, passes: bool) -> None:
    """Nothing where most of it passes, else a diffuse surface."""
    finish = Finish(0.0, "ggx", ("dielectric", (1.5,)), under=("blend", (opacity,)))
    base = np.array([[0.2, 0.5, 0.9]])
    assert finish.is_clear == passes
    np.testing.assert_array_equal(finish.albedo(base), 0 * base if passes else base)


def test_hard_texels_and_alpha_of_a_colour_are_cut(tmp_path: Path) -> None:
    """Soft ones with hard edges, and the alpha of an OBJ file's colours, which may mean something else; it is told."""
    soft = "soft transparency (it is cut where it is half opaque)"
    ramp = np.zeros((4, 16, 4))
    ramp[..., :3], ramp[..., 3] = 255, np.linspace(0, 255, 16)
    gltf = Gltf()
    texture = gltf.texture({"bufferView": gltf.view(png(ramp))}, {"magFilter": 9728})
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture=texture, more={"alphaMode": "BLEND"})))
    (tmp_path / "m.mtl").write_text("newmtl wall\nKd 0 0 0\nnewmtl pane\nmap_Kd ramp.png\n")
    (tmp_path / "ramp.png").write_bytes(png(ramp))
    (tmp_path / "m.obj").write_text(OBJ)
    for scene in (world(gltf, tmp_path), load_scene(tmp_path / "m.obj", up="z")):
        assert [look.what for look in scene.lost_looks] == [soft]


WHITE = {"type": "diffuse", "reflectance": 0.9}


def scene_with(
    opacity: dict[str, Any], integrator: str, *, nested: dict[str, Any] | None = None, **more: Any
) -> dict[str, Any]:
    lift = np.eye(4)
    lift[2, 3] = 0.8
    card = nested or {"type": "twosided", "nested": WHITE}
    bsdf = {"type": "mask", "opacity": opacity, "nested": card}
    return {
        "type": "scene",
        "integrator": {"type": integrator, "max_depth": 3},
        "sun": {"type": "directional", "direction": [0.5, 0.2, -1.0], "irradiance": 2.0},
        "floor": {
            "type": "rectangle",
            "bsdf": {"type": "diffuse", "reflectance": 0.2},
            "to_world": np.diag([3.0, 3.0, 3.0, 1.0]),
        },
        "card": {"type": "rectangle", "bsdf": bsdf, "to_world": lift, **more},
    }


def shown_from_above(content: dict[str, Any], kind: str, rays: int) -> FloatArray:
    scene = Scene("made", lambda: content, camera=CAMERA, start=Pose([0.1, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0]))
    return luma(scene, kind, rays)


OBJ = """mtllib m.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
v -9 -9 -1
v 9 -9 -1
v 9 9 -1
v -9 9 -1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wall
f 5 6 7 8
usemtl pane
f 1/1 2/2 3/3 4/4
"""


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("lines", "opacity"),
    [
        ("d 0.25", 0.25),
        ("Tr 0.25", 0.75),
        ("map_d faint.png", 0.4),
        ("d 0.5\nmap_d faint.png", 0.2),
        ("d 0.5\nmap_d white.png", 0.5),
        ("d 1", 1.0),
        ("d 0.25\nTr 0.25", 0.25),
        ("Tr 1\nd 1", 1.0),
    ],
)
def test_materials_of_obj_files_blend(lines: str, opacity: float, tmp_path: Path) -> None:
    materials = f"newmtl wall\nKd 0 0 0\nKe 0.2\nnewmtl pane\nKd 0 0 0\nKe 1\n{lines}\n"
    (tmp_path / "m.mtl").write_text(materials)
    (tmp_path / "m.obj").write_text(OBJ)
    for name, value in (("faint.png", 102), ("white.png", 255)):
        (tmp_path / name).write_bytes(png(np.full((4, 4), value)))
    scene = load_scene(tmp_path / "m.obj", up="z")
    assert scene.lost_looks == ()
    above = Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False)
    shown = renderer.luma(Views.at_rest([above]))[0][INSIDE]
    np.testing.assert_allclose(shown, opacity + (1 - opacity) * 0.2, rtol=2e-3)
