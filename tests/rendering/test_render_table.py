"""The native renderer and the table kernel against Mitsuba: the same light on the same triangles, its own camera."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene, load_scene
from davis_rs._mitsuba.variants import FAST, load_scene_source, variant
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer, why_not_noise_free
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.table.renderer import TableRenderer

pytestmark = pytest.mark.usefixtures("llvm")

FloatArray = npt.NDArray[np.float64]
Parts = dict[str, dict[str, Any]]

BT601 = np.array([0.299, 0.587, 0.114])
CAMERA = Camera(32, 24, 28.0, 28.0, 14.2, 12.9)
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
# With constant light this one draws the light where the surface reflects: no noise on an unoccluded diffuse surface.
FOLLOW_SURFACE = {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1}
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
LIFT = np.array([[0.0, 0.0, 0.0, 0.0]] * 2 + [[0.0, 0.0, 0.0, 0.2]] + [[0.0, 0.0, 0.0, 0.0]])
SHEAR = np.array([[2.0, 0.5, 0.1], [-0.3, 1.5, 0.2], [0.0, 0.0, 1.0]])


def look_at(position: npt.ArrayLike, target: npt.ArrayLike = (0.0, 0.0, 0.0), roll: float = 0.4) -> Pose:
    """A camera that looks at a target, its x axis level but for the roll: a skew rotation, unlike its transpose."""
    origin = np.asarray(position, np.float64)
    forward = np.asarray(target, np.float64) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward], 1)
    return Pose(origin, (Rotation.from_matrix(level) * Rotation.from_rotvec([0.0, 0.0, roll])).as_quat())


POSE = look_at([1.0, -1.7, 1.6])
BELOW = look_at([1.0, -1.7, -1.6])


def point(intensity: Any = 20.0, position: tuple[float, float, float] = (0.5, -1.0, 3.0)) -> dict[str, Any]:
    return {"type": "point", "position": list(position), "intensity": intensity}


def sun(irradiance: Any = 3.0) -> dict[str, Any]:
    return {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": irradiance}


def sky(radiance: Any = 0.7) -> dict[str, Any]:
    return {"type": "constant", "radiance": radiance}


def rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


def bitmap(data: Any = TEXELS, to_uv: FloatArray | None = None, **settings: Any) -> dict[str, Any]:
    return {"type": "bitmap", "raw": True, "data": data, "to_uv": np.eye(3) if to_uv is None else to_uv, **settings}


def diffuse(reflectance: Any = 0.5) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": reflectance}


def both_sides(reflectance: Any = 0.5) -> dict[str, Any]:
    return {"type": "twosided", "inner": diffuse(reflectance)}


def rectangle(bsdf: dict[str, Any], matrix: npt.ArrayLike | None = None, **settings: Any) -> dict[str, Any]:
    to_world = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf, **settings}


def box(size: float, centre: tuple[float, float, float], bsdf: dict[str, Any]) -> dict[str, Any]:
    to_world = np.diag([size, size, size, 1.0])
    to_world[:3, 3] = centre
    return {"type": "cube", "to_world": to_world, "bsdf": bsdf}


def make_scene(parts: Parts, *, integrator: dict[str, Any] | None = DIRECT, shadows: bool = True) -> Scene:
    asked = {} if integrator is None else {"integrator": integrator}
    return Scene("test", partial(dict, {"type": "scene", **asked, **parts}), shadows=shadows)


def build(kind: str, scene: Scene, *, rays_per_pixel: int = 1, camera: Camera = CAMERA) -> Renderer:
    renderer = make_renderer(scene, camera, rays_per_pixel=rays_per_pixel, kind=kind)
    assert isinstance(renderer, NativeRenderer if kind == "native" else TableRenderer)
    return renderer


def luma_of(kind: str, parts: Parts, pose: Pose = POSE, **settings: Any) -> LumaFrames:
    return build(kind, make_scene(parts, **settings)).luma(Views.at_rest([pose]))[0]


def perspective(camera: Camera, pose: Pose, mi: Any) -> Any:
    """Mitsuba's own pinhole camera for ours (its x points left, its y up, and pixel centres lie at + 0.5)."""
    return mi.load_dict(
        {
            "type": "perspective",
            "to_world": mi.ScalarTransform4f(pose.matrix @ np.diag([-1.0, -1.0, 1.0, 1.0])),
            "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
            "fov_axis": "x",
            "principal_point_offset_x": (camera.width / 2 - (camera.cx + 0.5)) / camera.width,
            "principal_point_offset_y": (camera.height / 2 - (camera.cy + 0.5)) / camera.height,
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
        }
    )


def mitsuba_luma(parts: Parts, pose: Pose = POSE, *, integrator: dict[str, Any] = DIRECT) -> FloatArray:
    """BT.601 luma of the rays that Mitsuba's own camera sends through the pixel centres."""
    with variant(FAST) as (mi, dr):
        scene = load_scene_source(make_scene(parts, integrator=integrator).source(), mi)
        x, y = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
        film = mi.Point2f((x / CAMERA.width).ravel(), (y / CAMERA.height).ravel())
        ray, _ = perspective(CAMERA, pose, mi).sample_ray_differential(0, 0.5, film, mi.Point2f(0.5))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(0, dr.width(film))
        colour = scene.integrator().sample(scene, sampler, ray, None, True)[0]
        return (BT601 @ np.array(colour, np.float64)).reshape(CAMERA.height, CAMERA.width)


def assert_same_light(ours: LumaFrames, theirs: FloatArray, *, tolerance: float = 1e-4, lit: float = 0.05) -> None:
    """Equal within ``tolerance`` of the brightest pixel; at least a share ``lit`` of the pixels must be lit at all."""
    assert (theirs > 1e-3 * theirs.max()).mean() > lit, "the scene is dark: nothing would be compared"
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * theirs.max())


SCENES: dict[str, Parts] = {
    "point light": {"light": point(), "floor": rectangle(diffuse())},
    "directional light": {"light": sun(), "floor": rectangle(diffuse(bitmap()))},
    "coloured light on a coloured texture": {
        "light": point(rgb(9.0, 1.0, 30.0)),
        "floor": rectangle(diffuse(bitmap())),
    },
    "coloured surface": {"light": sun(rgb(0.0, 2.0, 5.0)), "floor": rectangle(diffuse(rgb(0.9, 0.2, 0.4)))},
    "several triangles and textures": {
        "light": point(),
        "floor": rectangle(both_sides(bitmap())),
        "box": box(0.3, (0.2, 0.1, 0.4), diffuse(bitmap(TEXELS[::-1].copy(), SHEAR))),
        "other": box(0.2, (-0.5, 0.4, 0.3), diffuse(0.8)),
    },
    "texture repeated": {"light": sun(), "floor": rectangle(diffuse(bitmap(to_uv=SHEAR, wrap_mode="repeat")))},
    "texture clamped": {"light": sun(), "floor": rectangle(diffuse(bitmap(to_uv=SHEAR, wrap_mode="clamp")))},
    "texture mirrored": {"light": sun(), "floor": rectangle(diffuse(bitmap(to_uv=SHEAR, wrap_mode="mirror")))},
    "three wrap modes at once": {
        "light": sun(),
        "a": rectangle(diffuse(bitmap(to_uv=SHEAR, wrap_mode="repeat")), np.diag([1.0, 0.3, 1.0, 1.0])),
        "b": box(0.3, (0.3, 0.3, 0.3), diffuse(bitmap(to_uv=-SHEAR, wrap_mode="clamp"))),
        "c": box(0.3, (-0.4, -0.3, 0.4), diffuse(bitmap(to_uv=-3 * SHEAR, wrap_mode="mirror"))),
    },
    "texture of one channel": {"light": sun(), "floor": rectangle(diffuse(bitmap(TEXELS[..., :1].copy())))},
    "texture of one texel": {"light": sun(), "floor": rectangle(diffuse(bitmap(TEXELS[:1, :1].copy())))},
    "texture of one row": {"light": sun(), "floor": rectangle(diffuse(bitmap(TEXELS[:1].copy(), wrap_mode="clamp")))},
    "back of a two-sided surface": {
        "light": point(),
        "floor": rectangle(both_sides(bitmap()), np.diag([1.0, -1.0, -1.0, 1.0])),
    },
    "flipped normals of a rectangle": {
        "light": point(),
        "black": rectangle(diffuse(), flip_normals=True),
        "lit": rectangle(diffuse(bitmap()), np.diag([0.5, -0.5, -1.0, 1.0]) + LIFT, flip_normals=True),
    },
    "flipped normals of a mesh": {
        "light": point(position=(0.5, -1.0, 2.0)),
        "room": {**box(3.0, (0.0, 0.0, 0.0), diffuse(bitmap())), "flip_normals": True},
    },
    "mirroring transform": {
        "light": point(),
        "rectangle": rectangle(diffuse(bitmap()), np.diag([-1.0, 1.0, 1.0, 1.0])),
        "cube": {"type": "cube", "to_world": np.diag([0.2, -0.2, 0.3, 1.0]), "bsdf": diffuse()},
    },
    "shadow of a point light": {
        "light": point(position=(0.5, -0.3, 1.5)),
        "floor": rectangle(diffuse(bitmap())),
        "between": box(0.15, (0.2, 0.1, 0.5), diffuse(0.3)),
        "behind the light": box(0.2, (0.8, -0.6, 2.4), diffuse(0.3)),
    },
    "shadow of the sun": {
        "light": sun(),
        "floor": rectangle(diffuse(bitmap())),
        "between": box(0.15, (0.2, 0.1, 0.5), diffuse(0.3)),
    },
}


@pytest.mark.few(4)
@pytest.mark.parametrize("name", SCENES)
def test_light_of_a_scene_is_mitsubas(kind: str, name: str) -> None:
    """Pixel for pixel the luma that Mitsuba's direct integrator finds through its own camera."""
    parts = SCENES[name]
    assert_same_light(luma_of(kind, parts), mitsuba_luma(parts))


def test_constant_light_and_its_background(kind: str) -> None:
    """Constant light reflects evenly, from the back of a two-sided surface too, and fills pixels that see nothing."""
    parts = {"light": sky(rgb(0.5, 0.9, 0.2)), "floor": rectangle(both_sides(bitmap()))}
    for pose in (POSE, BELOW):
        ours = luma_of(kind, parts, pose)
        assert_same_light(ours, mitsuba_luma(parts, pose, integrator=FOLLOW_SURFACE), lit=0.9)
        assert ours[0, 0] == pytest.approx(BT601 @ (0.5, 0.9, 0.2))


def test_hidden_lights_leave_the_background_black(kind: str) -> None:
    """Where the integrator hides emitters, constant light still falls on surfaces but fills no background."""
    parts = {"light": sky(), "floor": rectangle(diffuse(bitmap()))}
    hiding = {**FOLLOW_SURFACE, "hide_emitters": True}
    ours = luma_of(kind, parts, integrator=hiding)
    assert ours[0, 0] == 0
    inside = ours > 0
    np.testing.assert_allclose(ours[inside], luma_of(kind, parts)[inside], rtol=1e-6)
    with variant(FAST) as (mi, _):
        loaded = load_scene_source(make_scene(parts, integrator=hiding).source(), mi)
    theirs = IntegratorRenderer(loaded, CAMERA, rays_per_pixel=1, blur=False, seed=0, reason="").luma(
        Views.at_rest([POSE])
    )[0]
    assert np.array_equal(theirs == 0, ours == 0)


def test_one_sided_backs_are_black(kind: str) -> None:
    """The back of a one-sided surface is black under every light, and hides what is behind it."""
    floor = rectangle(diffuse())
    front, back = (luma_of(kind, {"sky": sky(), "floor": floor}, pose) for pose in (POSE, BELOW))
    covered = front != front[0, 0]
    assert covered.any()
    hit = np.isfinite(build(kind, make_scene({"floor": floor})).depth(Views.at_rest([BELOW]))[0])
    assert hit.any()
    assert (back[hit] == 0).all()
    for light in (sun(), point()):
        assert (luma_of(kind, {"light": light, "floor": floor}, BELOW) == 0).all()
    # From below and lit from below a one-sided surface is black too.
    assert (luma_of(kind, {"light": point(position=(0.5, -1.0, -3.0)), "floor": floor}, BELOW) == 0).all()


def test_lamberts_law_by_hand(kind: str) -> None:
    """Luma is BT.601 (0.299, 0.587, 0.114) of linear reflectance x irradiance / pi for each light, by hand."""
    camera = Camera(8, 6, 10.0, 10.0, 3.0, 3.5)
    pose = Pose([0.3, -0.2, 2.0], [1.0, 0.0, 0.0, 0.0])  # looks down; x right is the world's x, y down its -y
    albedo = np.array([0.8, 0.5, 0.1])
    rows, columns = np.indices((6, 8))
    ground = np.stack([0.3 + (columns - 3.0) / 10 * 2, -0.2 - (rows - 3.5) / 10 * 2, 0.0 * rows], -1)
    to_lamp = np.array([0.4, 0.5, 1.5]) - ground
    distance = np.linalg.norm(to_lamp, axis=-1)
    from_lamp = to_lamp[..., 2] / distance / distance**2
    from_sun = np.full((6, 8), 1.0 / np.sqrt(0.2**2 + 0.3**2 + 1.0))
    expected = {
        "point": (point(rgb(3.0, 4.0, 5.0), (0.4, 0.5, 1.5)), from_lamp[..., None] * (3.0, 4.0, 5.0) / np.pi),
        "directional": (sun(rgb(3.0, 4.0, 5.0)), from_sun[..., None] * (3.0, 4.0, 5.0) / np.pi),
        "constant": (sky(rgb(3.0, 4.0, 5.0)), np.ones((6, 8, 1)) * (3.0, 4.0, 5.0)),
    }
    floor = rectangle(diffuse(rgb(*albedo)), np.diag([9.0, 9.0, 1.0, 1.0]))
    for light, arriving in expected.values():
        luma = build(kind, make_scene({"light": light, "floor": floor}), camera=camera).luma(Views.at_rest([pose]))[0]
        np.testing.assert_allclose(luma, (arriving * albedo) @ BT601, rtol=1e-5)
    together = {f"light {i}": light for i, (light, _) in enumerate(expected.values())}
    luma = build(kind, make_scene({**together, "floor": floor}), camera=camera).luma(Views.at_rest([pose]))[0]
    np.testing.assert_allclose(luma, (sum(arriving for _, arriving in expected.values()) * albedo) @ BT601, rtol=1e-5)


def test_red_and_blue_lights_add_up(kind: str) -> None:
    """A red and a blue light on one texture, each seen in its own channel: together the sum of Mitsuba's two images."""
    floor = rectangle(diffuse(bitmap()))
    red, blue = point(rgb(20.0, 0.0, 0.0)), point(rgb(0.0, 0.0, 30.0), (-1.0, 0.5, 2.0))
    alone = [mitsuba_luma({"light": light, "floor": floor}) for light in (red, blue)]
    for light, theirs in zip((red, blue), alone, strict=True):
        assert_same_light(luma_of(kind, {"light": light, "floor": floor}), theirs)
    assert_same_light(luma_of(kind, {"red": red, "blue": blue, "floor": floor}), alone[0] + alone[1])


def test_lights_of_one_hue_and_of_none(kind: str) -> None:
    """Two white lights of different strength add up; a light of no strength and a scene without lights are black."""
    floor = rectangle(diffuse(bitmap()))
    one, other = point(20.0), point(7.0, (-1.0, 0.5, 2.0))
    expected = mitsuba_luma({"light": one, "floor": floor}) + mitsuba_luma({"light": other, "floor": floor})
    assert_same_light(luma_of(kind, {"one": one, "other": other, "floor": floor}), expected)
    assert (luma_of(kind, {"light": point(0.0), "floor": floor}) == 0).all()
    assert (luma_of(kind, {"floor": floor}) == 0).all()


@pytest.mark.few(4)
@pytest.mark.parametrize("raw", [True, False])
@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_image_files_are_linearised_unless_raw(kind: str, tmp_path: Path, raw: bool, mode: str) -> None:
    """An 8-bit PNG is decoded from sRGB to linear reflectance unless it is marked raw; a grey one is grey."""
    path = tmp_path / "texture.png"
    values = (TEXELS * 255).astype(np.uint8)
    Image.fromarray(values if mode == "RGB" else values[..., 0]).save(path)
    texture = {"type": "bitmap", "filename": str(path), "raw": raw, "to_uv": np.diag([41.0, 43.0, 1.0])}
    parts = {"light": sun(np.pi), "floor": rectangle(diffuse(texture), np.diag([20.0, 20.0, 1.0, 1.0]))}
    ours = luma_of(kind, parts)
    assert_same_light(ours, mitsuba_luma(parts), tolerance=1e-3)
    stored = values.astype(np.float64) / 255
    linear = stored if raw else np.where(stored < 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    mean = (linear @ BT601).mean() if mode == "RGB" else linear[..., 0].mean()
    cosine = 1 / np.sqrt(0.2**2 + 0.3**2 + 1.0)
    assert ours.mean() == pytest.approx(mean * cosine, rel=0.05)


@pytest.mark.parametrize("size", [64, 1024])
def test_fine_textures_that_repeat_often_are_still_bilinear(kind: str, size: int) -> None:
    """A texture of many texels, repeated many times, is recognised although float32 blurs its coordinates."""
    texels = np.random.RandomState(1).random_sample((size, size, 3)).astype(np.float32)
    texture = bitmap(texels, np.diag([25.0, 20.0, 1.0]))
    parts = {"light": sun(), "floor": rectangle(diffuse(texture))}
    assert_same_light(luma_of(kind, parts), mitsuba_luma(parts), tolerance=1e-2)


def write_ball(path: Path, *, normals: bool, uv: bool, rings: int = 5) -> None:
    """A coarse sphere as OBJ or PLY (text), with or without vertex normals and texture coordinates."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1))
    vertices = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    rows, columns = vertices.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate(
        [np.stack(t, -1)[:, s].reshape(-1, 3) for t, s in (((a, b, c), slice(0, -1)), ((a, c, d), slice(1, None)))]
    )
    lines: list[str] = []
    data = [vertices.reshape(-1, 3) * (0.8, 0.8, 0.5)]
    data += [vertices.reshape(-1, 3)] if normals else []
    data += [np.stack([around / (2 * np.pi), polar / np.pi], -1).reshape(-1, 2)] if uv else []
    if path.suffix == ".obj":
        for key, values in zip(["v"] + ["vn"] * normals + ["vt"] * uv, data, strict=True):
            lines += [" ".join([key, *map(str, row)]) for row in values.tolist()]
        corner = {(0, 0): "{0}", (0, 1): "{0}/{0}", (1, 0): "{0}//{0}", (1, 1): "{0}/{0}/{0}"}[normals, uv]
        lines += [" ".join(["f", *(corner.format(i + 1) for i in face)]) for face in faces.tolist()]
    else:
        names = ["x", "y", "z"] + ["nx", "ny", "nz"] * normals + ["u", "v"] * uv
        lines += ["ply", "format ascii 1.0", f"element vertex {rows * columns}"]
        lines += [f"property float {name}" for name in names]
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        lines += [" ".join(map(str, row)) for row in np.concatenate(data, 1).tolist()]
        lines += [" ".join(map(str, [3, *face])) for face in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.few(1)
@pytest.mark.parametrize("suffix", ["obj", "ply"])
@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("uv", [False, True])
def test_meshes_from_files(kind: str, tmp_path: Path, suffix: str, normals: bool, uv: bool) -> None:
    """OBJ and PLY, shaded smoothly and by faces, with and without texture coordinates, one- and two-sided, flipped."""
    path = tmp_path / f"ball.{suffix}"
    write_ball(path, normals=normals, uv=uv)
    smooth = {"type": suffix, "filename": str(path), "bsdf": diffuse(bitmap())}
    flat = {**smooth, "face_normals": True}
    images = []
    for ball in (smooth, flat, {**smooth, "flip_normals": True, "bsdf": both_sides(bitmap())}):
        parts = {"light": point(), "ball": ball}
        images.append(luma_of(kind, parts))
        assert_same_light(images[-1], mitsuba_luma(parts))
    assert np.abs(images[0] - images[1]).max() > 0.02 * images[0].max(), "smooth shading must differ from flat"
    inside_out = {"light": point(), "ball": {**smooth, "flip_normals": True}}
    theirs = mitsuba_luma(inside_out)
    assert (theirs > 0).mean() < 0.01
    np.testing.assert_allclose(luma_of(kind, inside_out), theirs, rtol=0, atol=1e-4 * images[0].max())


def test_shadows_can_be_left_out(kind: str) -> None:
    """shadows=False changes just the pixels in shadow, to the light that they would have had."""
    parts = SCENES["shadow of a point light"]
    traced, untraced = (luma_of(kind, parts, shadows=shadows) for shadows in (True, False))
    in_shadow = traced != untraced
    assert 0.01 < in_shadow.mean() < 0.2
    assert (untraced[in_shadow] > 0).all()
    # Light is there or not: what is seen in shadow is black.
    assert (traced[in_shadow] == 0).all()


def test_many_rays_a_pixel_against_mi_render(kind: str) -> None:
    """64 lattice rays give the image that mi.render converges to, with its own camera and film, to 0.4 % of white."""
    parts = {
        "light": point(),
        "floor": rectangle(diffuse(bitmap(to_uv=SHEAR)), np.diag([2.0, 2.0, 1.0, 1.0])),
        "box": box(0.3, (0.2, 0.1, 0.4), diffuse(0.8)),
    }
    with variant(FAST) as (mi, _):
        scene = load_scene_source(make_scene(parts).source(), mi)
        image = mi.render(scene, sensor=perspective(CAMERA, POSE, mi), spp=4096, seed=1)
        theirs = np.array(image, np.float64) @ BT601
    ours = build(kind, make_scene(parts), rays_per_pixel=64).luma(Views.at_rest([POSE]))[0]
    # At the box's edges 64 rays are good to a few 1/64 of the contrast, 4,096 random ones to 0.02.
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.06 * theirs.max())
    assert np.sqrt(((ours - theirs) ** 2).mean()) < 0.004 * theirs.max()


def test_depth_is_z_and_not_the_length_of_the_ray() -> None:
    """Depth maps are n . (p - o) / (n . R (x, y, 1)) on a tilted plane, for a skew pose, distortion and fx != fy."""
    camera = Camera(40, 30, 30.0, 34.0, 18.3, 16.1, k1=-0.2, k2=0.05, p1=0.004, p2=-0.006)
    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix() * (20.0, 20.0, 1.0)
    tilt[:3, 3] = (0.1, 0.2, -0.3)
    scene = make_scene({"floor": rectangle(both_sides(), tilt)})
    rows, columns = np.indices((30, 40))
    rays = np.concatenate([camera.rays(np.stack([columns, rows], -1)), np.ones((30, 40, 1))], -1)
    poses = [look_at([0.3, -0.6, 2.0]), look_at([0.4, 0.9, 2.0], (0.3, 0.2, 0.0), roll=-1.0)]
    for kind in ("native", "table", "integrator"):
        for pose, z in zip(poses, make_renderer(scene, camera, kind=kind).depth(Views.at_rest(poses)), strict=True):
            normal = tilt[:3, 2]
            expected = normal @ (tilt[:3, 3] - pose.position) / (rays @ pose.rotation.T @ normal)
            assert (expected > 0).all()
            assert z.dtype == np.float32
            np.testing.assert_allclose(z, expected, rtol=2e-5)


def test_depth_of_nothing_is_infinite(kind: str) -> None:
    """A pixel whose centre ray hits nothing is at inf, from any renderer; the others are finite and in front."""
    scene = make_scene(SCENES["several triangles and textures"])
    ours, theirs = (make_renderer(scene, CAMERA, kind=k).depth(Views.at_rest([POSE]))[0] for k in (kind, "integrator"))
    assert 0 < np.isinf(ours).mean() < 1
    assert np.array_equal(np.isinf(ours), np.isinf(theirs))
    hit = np.isfinite(ours)
    np.testing.assert_allclose(ours[hit], theirs[hit], rtol=1e-5)
    assert (ours[hit] > 0).all()


def test_depth_of_three_planes(kind: str) -> None:
    """From straight above, the depth of three_planes is the camera's height above the highest plane at each pixel."""
    scene = load_scene("three_planes")
    assert scene.trajectory is not None
    renderer = build(kind, scene, camera=scene.own_camera)
    t_s = [0.0, 0.4, 1.3]
    poses = [scene.trajectory.pose(t) for t in t_s]
    column = np.arange(240)
    for pose, depth in zip(poses, renderer.depth(Views.at_rest(poses)), strict=True):
        expected = np.full(240, np.inf)
        # x from, x to, height of each plane (the camera at height 1.8 looks down).
        for left, right, z in ((-7.8, -0.8, -0.1), (-0.8, -0.2, 0.6), (-0.2, 6.8, 0.2)):
            x = pose.position[0] + (column - 119.5) / 200.0 * (1.8 - z)
            on_it = (x > left) & (x < right)
            expected = np.where(on_it, np.minimum(expected, 1.8 - z), expected)
        assert set(np.round(expected, 6)) == {1.9, 1.2, 1.6}
        np.testing.assert_allclose(depth, np.broadcast_to(expected, (180, 240)), rtol=1e-5)


ODD = Camera(33, 17, 28.0, 28.0, 14.2, 8.9)
POSES = [look_at([1.0 + 0.05 * i, -1.7, 1.6 - 0.03 * i], roll=0.1 * i) for i in range(16)]


@pytest.mark.parametrize("camera", [ODD, CAMERA])
@pytest.mark.parametrize("threads", [1, 2])
def test_bits_do_not_depend_on_the_batch_or_the_threads(kind: str, camera: Camera, threads: int) -> None:
    """A pose has the same luma and depth bits alone, among 3 or 16, in any order, after others, on 1 and 2 threads."""
    renderer = build(kind, make_scene(SCENES["several triangles and textures"]), rays_per_pixel=5, camera=camera)
    expected, depth = renderer.luma(Views.at_rest(POSES)), renderer.depth(Views.at_rest(POSES))
    assert len({frame.tobytes() for frame in expected}) == len(POSES)
    with variant(FAST) as (_, dr):
        before = dr.thread_count()
        dr.set_thread_count(threads)
    try:
        for index in (0, 7, 15):
            assert np.array_equal(renderer.luma(Views.at_rest([POSES[index]]))[0], expected[index])
            assert np.array_equal(renderer.depth(Views.at_rest([POSES[index]]))[0], depth[index])
        assert np.array_equal(renderer.luma(Views.at_rest(POSES[5:8])), expected[5:8])
        assert np.array_equal(renderer.luma(Views.at_rest(POSES[::-1])), expected[::-1])
        assert np.array_equal(renderer.depth(Views.at_rest(POSES[::-1])), depth[::-1])
        again = build(kind, make_scene(SCENES["several triangles and textures"]), rays_per_pixel=5, camera=camera)
        assert np.array_equal(again.luma(Views.at_rest(POSES[:3])), expected[:3])
    finally:
        with variant(FAST) as (_, dr):
            dr.set_thread_count(before)


def test_frames_are_independent_arrays(kind: str) -> None:
    """Frames are float32 (n, H, W), and later renders leave earlier frames alone."""
    renderer = build(kind, make_scene(SCENES["point light"]))
    first = renderer.luma(Views.at_rest(POSES[:2]))
    kept = first.copy()
    assert first.dtype == np.float32
    assert first.shape == (2, 24, 32)
    renderer.luma(Views.at_rest(POSES[5:7]))
    assert np.array_equal(first, kept)


def test_blur_softens_what_is_rendered() -> None:
    """With blur a frame is the 3 x 3 blur of the frame without."""
    scene = make_scene(SCENES["point light"])
    sharp, soft = (make_renderer(scene, CAMERA, blur=blur).luma(Views.at_rest([POSE]))[0] for blur in (False, True))
    around = sum(
        weight * np.roll(np.roll(sharp, dy, 0), dx, 1)
        for weight, dy, dx in [
            (0.25, 0, 0),
            *((0.125, *o) for o in ((0, 1), (0, -1), (1, 0), (-1, 0))),
            *((0.0625, *o) for o in ((1, 1), (1, -1), (-1, 1), (-1, -1))),
        ]
    )
    np.testing.assert_allclose(soft[1:-1, 1:-1], np.asarray(around)[1:-1, 1:-1], atol=1e-6 * sharp.max())


MISSES = """
import sys
import numpy as np
from davis_rs import Camera, Pose, Scene
from davis_rs.render.choice import make_renderer
from davis_rs.geometry.trajectory.views import Views

floor = {
    "type": "rectangle",
    "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "data": np.ones((3, 5, 3), np.float32)}},
}
light = {"type": "point", "position": [0.0, 0.0, 2.0], "intensity": 1.0}
scene = Scene("floor", lambda: {"type": "scene", "light": light, "floor": floor})
renderer = make_renderer(scene, Camera(33, 17, 28.0, 28.0, 14.2, 8.9), rays_per_pixel=3, kind=sys.argv[1])
down, up = Pose([0.9, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]), Pose([0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0])
luma, depth = renderer.luma(Views.at_rest([down, up])), renderer.depth(Views.at_rest([down, up]))
assert 0 < (luma[0] > 0).mean() < 1 and (luma[1] == 0).all(), luma
assert 0 < np.isfinite(depth[0]).mean() < 1 and np.isinf(depth[1]).all(), depth
print("alive")
"""


@pytest.mark.long
def test_rays_that_miss_do_no_harm(kind: str, run_python: Callable[..., str]) -> None:
    """Rays that hit nothing are dark and at inf; in a process of its own: an integer division by zero would kill it."""
    assert run_python(MISSES, kind) == "alive\n"


VARNISH = {"type": "principled", "flatness": {"type": "checkerboard"}}

FLOOR = rectangle(diffuse())
UNSUITABLE: dict[str, tuple[Parts, dict[str, Any] | None, str]] = {
    "varnish": (
        {"shape": rectangle(VARNISH)},
        DIRECT,
        "'shape' has a principled surface, not a diffuse one",
    ),
    "two varnishes alike": (
        {"first": rectangle(VARNISH), "second": rectangle(VARNISH)},
        DIRECT,
        r"'first' \(likewise shape 'second'\) has a principled surface, not a diffuse one",
    ),
    "polariser": (
        {"shape": rectangle({"type": "retarder"})},
        DIRECT,
        r"'shape' has a linearretarder surface, not a diffuse one \(polarisation of light is not simulated, by any",
    ),
    "mirror on the back": (
        {"shape": rectangle({"type": "twosided", "front": diffuse(), "back": {"type": "conductor"}})},
        DIRECT,
        r"'shape' has a twosided\(diffuse, conductor\) surface, not a diffuse one",
    ),
    "mirror on the front": (
        {"shape": rectangle({"type": "twosided", "front": {"type": "conductor"}, "back": diffuse()})},
        DIRECT,
        r"'shape' has a twosided\(conductor, diffuse\) surface, not a diffuse one",
    ),
    "other reflectance on the back": (
        {"shape": rectangle({"type": "twosided", "front": diffuse(0.5), "back": diffuse(0.4)})},
        DIRECT,
        "'shape' has two different sides",
    ),
    "texture on the back": (
        {"shape": rectangle({"type": "twosided", "front": diffuse(0.5), "back": diffuse(bitmap())})},
        DIRECT,
        "'shape' has two different sides",
    ),
    "field of distances": (
        {"shape": {"type": "sdfgrid", "grid": np.mgrid[:2, :2, :2][0, ..., None] - 0.5, "bsdf": diffuse()}},
        DIRECT,
        "'shape' is a sdfgrid, not made of triangles: give it as a mesh",
    ),
    "wide spot light": (
        {"lamp": {"type": "spot", "texture": bitmap(), "cutoff_angle": 90.0}, "floor": FLOOR},
        DIRECT,
        "the spot light 'lamp' has a texture and a cutoff_angle of 90 degrees or more: make it narrower",
    ),
    "checkerboard of pictures": (
        {"shape": rectangle(diffuse({"type": "checkerboard", "color0": bitmap()}))},
        DIRECT,
        "'shape' has a checkerboard of textures as its reflectance: give it two colours, or as a bitmap",
    ),
    "colours that the mesh lacks": (
        {"shape": rectangle(diffuse({"type": "mesh_attribute", "name": "vertex_color"}))},
        DIRECT,
        "'shape' has a mesh_attribute that its mesh does not have",
    ),
}


@pytest.mark.few(4)
@pytest.mark.parametrize("name", UNSUITABLE)
def test_what_has_no_tables_falls_back(kind: str, name: str) -> None:
    """Such a scene goes to Mitsuba's integrator, with the reason named; the others, asked for by name, refuse it."""
    parts, integrator, reason = UNSUITABLE[name]
    scene = make_scene({"light": point(), **parts}, integrator=integrator)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1)
    assert isinstance(renderer, IntegratorRenderer)
    what = {"native": "native renderer", "table": "table kernel"}[kind]
    with pytest.raises(ValueError, match=f"the {what} cannot render this scene: .*(?:{reason})"):
        make_renderer(scene, CAMERA, rays_per_pixel=1, kind=kind)
    with pytest.raises(ValueError, match=f"{re.escape(renderer.reason)}$"):
        make_renderer(scene, CAMERA, rays_per_pixel=1, kind="baked")
    assert np.isfinite(renderer.luma(Views.at_rest([POSE]))).all()


def test_glossy_surfaces_are_the_native_renderers(kind: str) -> None:
    """The table kernel knows diffuse surfaces alone; lines of pixels and derivatives do too."""
    scene = make_scene({"light": point(), "shape": rectangle({"type": "conductor"}), "floor": FLOOR}, integrator=DIRECT)
    if kind == "table":
        with pytest.raises(ValueError, match="'shape' has a conductor surface, not a diffuse one"):
            make_renderer(scene, CAMERA, kind=kind)
        return
    renderer = make_renderer(scene, CAMERA)
    assert isinstance(renderer, NativeRenderer)
    assert renderer.reason.startswith("diffuse and glossy triangles under point light")
    with pytest.raises(ValueError, match="derivatives need a scene of diffuse surfaces, and this one has glossy ones"):
        renderer.gradients(Views.at_rest([POSE]), np.zeros(1, np.uint32), np.zeros((1, 1), np.uint32), np.ones(1))
    lines = make_renderer(scene, CAMERA, pixel="lines")
    with pytest.raises(ValueError, match="lines through pixels need a scene of diffuse surfaces"):
        lines.luma(Views.at_rest([POSE]))


MANY_OBSTACLES = """<scene version="3.0.0"><integrator type="path"/>
<bsdf type="roughdielectric" id="glass"><texture type="checkerboard" name="alpha">
<float name="color1" value="1.5"/></texture></bsdf>
<shape type="sphere" id="ball"><ref id="glass"/></shape>
<shape type="sphere" id="knob"><ref id="glass"/></shape>
<shape type="disk"><transform name="to_world"><translate x="3" y="-1"/></transform><bsdf type="roughconductor">
<float name="alpha_u" value="0.1"/><texture type="checkerboard" name="alpha_v"><float name="color1" value="2"/>
</texture></bsdf></shape>
<shape type="rectangle" id="floor"><bsdf type="twosided"><bsdf type="diffuse">
<texture type="checkerboard" name="reflectance"/></bsdf><bsdf type="diffuse"/></bsdf></shape>
<shape type="rectangle" id="coat"><bsdf type="twosided"><bsdf type="principled">
<texture type="checkerboard" name="flatness"/></bsdf></bsdf></shape>
<emitter type="projector" id="beamer"><texture type="checkerboard" name="irradiance">
<texture type="checkerboard" name="color0"/></texture></emitter>
</scene>"""


def test_all_obstacles_are_told_at_once(tmp_path: Path) -> None:
    """Each with its remedy, what differs in the name alone as one; those of the renderer that has the fewest."""
    file = tmp_path / "many.xml"
    file.write_text(MANY_OBSTACLES)
    scene = load_scene(file)
    told = {
        "material 'glass' has a roughdielectric surface, not a diffuse one: give it a roughness that is a number, or "
        "a bilinear bitmap or a checkerboard of 0 to 1, or give it a diffuse material",
        "the mesh without an id around (3, -1, 0) has a roughconductor surface, not a diffuse one: give it a roughness "
        "that is a number, or a bilinear bitmap or a checkerboard of 0 to 1, or give it a diffuse material",
        "shape 'floor' has two different sides: give both the same diffuse material",
        "shape 'coat' has a twosided(principled) surface, not a diffuse one: --matte (matte=True) takes its diffuse "
        "colour alone, or set its flatness to 0, or give it a diffuse material",
        "the projector 'beamer' throws a checkerboard, which is no bitmap: give it as one",
    }
    assert set(map(str, why_not_noise_free(scene))) == told
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1)
    assert renderer.reason.endswith("; and 2 more")
    with pytest.raises(ValueError, match="the renderer of baked light cannot render this scene: ") as refused:
        make_renderer(scene, CAMERA, kind="baked")
    assert set(str(refused.value).partition(": ")[2].split("; ")) == told
    matte = why_not_noise_free(replace(scene, matte=True))
    assert len(matte) == 4
    assert why_not_noise_free(make_scene(SCENES["point light"])) == ()


def test_light_that_bounces_is_baked_unless_direct_light_is_asked_for(llvm: str, kind: str) -> None:
    """A scene that names the path integrator gets baked light; asked for by name the others give direct light only."""
    scene = make_scene(SCENES["point light"], integrator={"type": "path"})
    chosen = make_renderer(scene, CAMERA, rays_per_pixel=1, bake_error=0.2)
    assert isinstance(chosen, NativeRenderer)
    assert "baked light" in chosen.reason
    asked = make_renderer(scene, CAMERA, rays_per_pixel=1, kind=kind)
    assert np.array_equal(asked.luma(Views.at_rest([POSE]))[0], luma_of(kind, SCENES["point light"]))


def test_suitable_scenes_take_the_native_renderer_and_say_why() -> None:
    """Diffuse triangles go to the native renderer, whose reason names lights and shadows; other names override it."""
    scene = make_scene(SCENES["point light"])
    chosen = make_renderer(scene, CAMERA)
    assert isinstance(chosen, NativeRenderer)
    table = make_renderer(scene, CAMERA, kind="table")
    assert isinstance(table, TableRenderer)
    assert table.reason == chosen.reason
    assert chosen.reason == "diffuse triangles under point light, with shadows"
    unshadowed = make_scene({"sun": sun(), "sky": sky(), "floor": FLOOR}, shadows=False)
    assert make_renderer(unshadowed, CAMERA).reason == (
        "diffuse triangles under constant and directional light, without shadows"
    )
    dark = make_scene({"floor": FLOOR})
    assert make_renderer(dark, CAMERA).reason == "diffuse triangles under no light, with shadows"
    assert make_renderer(scene, CAMERA, kind="integrator").reason == "asked for"
    assert make_renderer(scene, CAMERA).rays_per_pixel == 8
    with pytest.raises(ValueError, match="auto, native, table, baked, integrator, got 'fast'"):
        make_renderer(scene, CAMERA, kind="fast")
    with pytest.raises(ValueError, match=r"1\.\.1024, got 0"):
        make_renderer(scene, CAMERA, rays_per_pixel=0)
