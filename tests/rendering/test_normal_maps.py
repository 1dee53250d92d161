"""Normal maps and bump maps without noise: against Mitsuba, against numbers worked by hand, and their rates."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Scene, load_scene
from davis_rs._core import SceneRenderer
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer, why_not_noise_free
from gltf_files import CORNERS, FACES, UV, Gltf, png
from one_triangle import one_triangle

CAMERA = Camera(width=24, height=20, fx=30.0, fy=30.0, cx=11.5, cy=9.5)
NUMBERS = np.random.default_rng(5)
BASE = NUMBERS.uniform(0.2, 0.8, (4, 4, 3)).astype(np.float32)


def directions(steep: float) -> npt.NDArray[np.float32]:
    normals = NUMBERS.normal(size=(8, 8, 3)) * [steep, steep, 0] + [0, 0, 1]
    return (0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)


BUMPS = directions(0.35)


def bitmap(data: npt.NDArray[np.float32], **more: Any) -> dict[str, Any]:
    return {"type": "bitmap", "raw": True, "data": data, **more}


def bumpy(nested: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "twosided", "front": {"type": "normalmap", "normalmap": bitmap(BUMPS), "bsdf": nested, **more}}


def tilted(nested: dict[str, Any]) -> dict[str, Any]:
    """A surface with a normal map of one direction."""
    direction = {"type": "rawconstant", "value": [0.65, 0.4, 0.95]}
    return {"type": "twosided", "front": {"type": "normalmap", "normalmap": direction, "bsdf": nested}}


HEIGHTS = NUMBERS.uniform(0, 0.1, (8, 8, 1)).astype(np.float32)


def raised(nested: dict[str, Any], heights: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """A surface with a bump map of 8 x 8 texels, 0.1 high, on a square of 2 x 2."""
    bumps = {"type": "bumpmap", "heights": bitmap(HEIGHTS) if heights is None else heights, "bsdf": nested, **more}
    return {"type": "twosided", "front": bumps}


def diffuse(reflectance: Any = None) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6} if reflectance is None else reflectance}


def metal() -> dict[str, Any]:
    base = {"type": "rgb", "value": [0.6, 0.5, 0.4]}
    return {"type": "principled", "base_color": base, "roughness": 0.4, "metallic": 1.0}


TURNED = np.array([[0.7, 1.1, 0.2], [-1.4, 0.5, 0.1], [0, 0, 1]])
POINT = {"type": "point", "position": [0.7, -0.8, 1.0], "intensity": 5.0}
BEHIND = {"type": "point", "position": [0.7, -0.8, -1.0], "intensity": 5.0}
LOW = {"type": "point", "position": [1.6, 0.4, 0.35], "intensity": 5.0}
GRAZING = {"type": "directional", "direction": [1, 0.2, -0.2], "irradiance": 2.0}


def world(material: dict[str, Any], light: dict[str, Any], shape: str = "rectangle") -> Scene:
    source = {"type": "scene", "integrator": {"type": "direct"}, "light": light, "it": {"type": shape, "m": material}}
    return Scene(name="bumps", source=lambda: source, camera=CAMERA)


def view(
    z: float, velocity: tuple[float, ...] = (0.0, 0.0, 0.0), turning: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Views:
    """A camera that looks at the middle along z, from the front where z > 0."""
    axes, side = np.eye(4), np.sign(z)
    axes[:3, :3], axes[:3, 3] = np.diag([1, -side, -side]), [0.1, 0.05, z]
    still = Views.at_rest([axes])
    return Views(still.t_s, still.positions, still.rotations, np.array([velocity]), np.array([turning]))


def luma(
    scene: Scene, seen: Views, kind: str = "native", rays: int = 64, pixel: str = "rays"
) -> npt.NDArray[np.float32]:
    rays_per_pixel = None if pixel == "lines" else rays
    renderer = make_renderer(
        scene, CAMERA, kind=kind, rays_per_pixel=rays_per_pixel, blur=False, pixel=pixel, bake_error=0.03
    )
    return renderer.luma(seen)[0]


CASES = {
    "from the front": (bumpy(diffuse()), POINT, 2.2, "rectangle"),
    "on a texture": (bumpy(diffuse(bitmap(BASE))), POINT, 2.2, "rectangle"),
    "on a back": (bumpy(diffuse()), BEHIND, -2.2, "rectangle"),
    "grazing": (bumpy(diffuse()), GRAZING, 2.2, "rectangle"),
    "without fading": (bumpy(diffuse(), use_shadowing_function=False), GRAZING, 2.2, "rectangle"),
    "front alone": (bumpy(diffuse())["front"], POINT, 2.2, "rectangle"),
    "back of that": (bumpy(diffuse())["front"], BEHIND, -2.2, "rectangle"),
    "smooth": (bumpy(diffuse()), POINT, 3.0, "sphere"),
    "tilted": (tilted(diffuse()), POINT, 2.2, "rectangle"),
    "tilted metal": (tilted(metal()), LOW, 2.2, "sphere"),
    "metal": (bumpy(metal()), POINT, 2.2, "rectangle"),
    "metal in grazing light": (bumpy(metal()), GRAZING, 2.2, "rectangle"),
    "metal by a low lamp": (bumpy(metal()), LOW, 2.2, "rectangle"),
    "metal's back": (bumpy(metal()), BEHIND, -2.2, "rectangle"),
    "heights": (raised(diffuse()), POINT, 2.2, "rectangle"),
    "heights on a texture": (raised(diffuse(bitmap(BASE)), scale=1.5), POINT, 2.2, "rectangle"),
    "heights on a back": (raised(diffuse()), BEHIND, -2.2, "rectangle"),
    "heights, turned": (raised(diffuse(), bitmap(HEIGHTS, to_uv=TURNED, wrap_mode="mirror")), LOW, 2.2, "rectangle"),
    "heights in grazing light": (raised(diffuse()), GRAZING, 2.2, "rectangle"),
    "heights without fading": (raised(diffuse(), use_shadowing_function=False), GRAZING, 2.2, "rectangle"),
    "heights below": (raised(diffuse(), bitmap(HEIGHTS.repeat(3, 2)), scale=-0.7), POINT, 2.2, "rectangle"),
    "smooth heights": (raised(diffuse()), POINT, 3.0, "sphere"),
    "heights on metal": (raised(metal()), LOW, 2.2, "rectangle"),
    "turned ones on metal": (raised(metal(), bitmap(HEIGHTS, to_uv=TURNED, wrap_mode="mirror")), LOW, 2.2, "rectangle"),
    "clamped ones on metal": (raised(metal(), bitmap(HEIGHTS, to_uv=TURNED, wrap_mode="clamp")), LOW, 2.2, "rectangle"),
}


@pytest.mark.parametrize("name", CASES)
def test_they_look_as_in_mitsuba(name: str) -> None:
    """Of all pixels' luma, little is another; Mitsuba's pixels are means of random places."""
    material, light, z, shape = CASES[name]
    scene, seen = world(material, light, shape), view(z)
    assert not why_not_noise_free(scene)
    ours, theirs = luma(scene, seen), luma(scene, seen, "integrator", 1024)
    if name == "back of that":
        assert not ours.any()
        assert not theirs.any()
        return
    assert ours.mean() == pytest.approx(theirs.mean(), rel=3e-3)
    assert np.abs(ours - theirs).mean() < (0.03 if "ones on metal" in name else 0.01) * theirs.mean()
    flat = world({"type": "twosided", "front": metal() if "metal" in name else diffuse()}, light, shape)
    if "on a texture" not in name:
        assert np.abs(luma(flat, seen) - theirs).mean() > 0.03 * theirs.mean()


def under(material: dict[str, Any], light: Callable[[], dict[str, Any]]) -> Scene:
    parts = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "it": {"type": "rectangle", "m": material},
    }
    return Scene(name="bumps", source=lambda: {**parts, **light()}, camera=CAMERA)


def sky() -> dict[str, Any]:
    """A dark sky with a bright part to one side."""
    import mitsuba as mi

    radiance = np.full((32, 64, 3), 0.2, np.float32)
    radiance[6:12, 10:20] = 8.0
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    return {"sky": {"type": "envmap", "bitmap": mi.Bitmap(radiance), "to_world": upright}}


def lamp() -> dict[str, Any]:
    import mitsuba as mi

    at = mi.ScalarTransform4f().look_at([1.5, -0.8, 1.2], [0, 0, 0], [0, 1, 0.1])
    shape = {"type": "rectangle", "to_world": at @ mi.ScalarTransform4f().scale([0.4, 0.4, 1])}
    return {"lamp": {**shape, "emitter": {"type": "area", "radiance": 6.0}}}


def constant() -> dict[str, Any]:
    return {"sky": {"type": "constant", "radiance": 0.7}}


PLASTIC = {"type": "roughplastic", "diffuse_reflectance": 0.6, "alpha": 0.4}
FADES: dict[str, Any] = {"use_shadowing_function": False}
BUMPY: dict[str, dict[str, Any]] = {
    "normals": bumpy(diffuse(), **FADES),
    "heights": raised(diffuse(), **FADES),
    "metal": bumpy(metal(), **FADES),
    "plastic": bumpy(PLASTIC, **FADES),
}


@pytest.mark.few(3)  # each under another light
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("light", [lamp, sky, constant])
@pytest.mark.parametrize("name", BUMPY)
def test_light_from_all_around_sees_them(name: str, light: Callable[[], dict[str, Any]]) -> None:
    """Baked and constant light, next to the path tracer's: most of what a flat surface errs is gone."""
    kind, seen = "native" if light is constant else "baked", view(2.2)
    plain = {"type": "twosided", "front": {"metal": metal(), "plastic": PLASTIC}.get(name, diffuse())}
    # Other numbers of samples are other paths. One render alone of the metal is off by 0.012.
    renders = [luma(under(BUMPY[name], light), seen, "integrator", samples) for samples in (1024, 1000, 960, 900)]
    theirs = np.mean(renders, axis=0)
    ours, flat = (luma(under(material, light), seen, kind) for material in (BUMPY[name], plain))

    def error(luma: npt.NDArray[np.float32]) -> float:
        return float(np.sqrt(np.mean(np.log(luma / theirs) ** 2)))

    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.03)
    assert error(flat) > 0.01
    assert error(ours) < max(0.3 * error(flat), 0.01)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("material", [raised(diffuse()), bumpy(metal())], ids=["diffuse", "metal"])
def test_rates_under_light_from_all_around(material: dict[str, Any]) -> None:
    scene = under(material, lambda: lamp() | constant())
    renderer = make_renderer(scene, CAMERA, kind="baked", rays_per_pixel=4, blur=False, bake_error=0.1)
    seen, step = view(2.2, (0.3, -0.2, 0.4), (0.1, 0.2, -0.5)), 1e-4
    before, after = (renderer.luma(seen.moved(np.array([t])))[0].astype(np.float64) for t in (-step, step))
    difference = (after - before) / (2 * step)
    (value,), (rate,) = renderer.luma_and_rate(seen)
    np.testing.assert_array_equal(value, renderer.luma(seen)[0])
    wrong = np.abs(rate - difference) > 0.02 * np.abs(difference).max()
    assert wrong.mean() < 0.06


@pytest.mark.without_llvm
@pytest.mark.parametrize("nested", [diffuse(bitmap(BASE)), metal()], ids=["diffuse", "metal"])
@pytest.mark.parametrize("light", [POINT, GRAZING], ids=["point", "sun"])
@pytest.mark.parametrize("kind", [bumpy, raised])
def test_rates_are_derivatives(
    nested: dict[str, Any], light: dict[str, Any], kind: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    scene = world(kind(nested), light)
    seen = view(2.2, (0.3, -0.2, 0.4), (0.1, 0.2, -0.5))
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=1, blur=False)
    step = 1e-4
    before, after = (renderer.luma(seen.moved([t]))[0].astype(np.float64) for t in (-step, step))
    difference = (after - before) / (2 * step)
    (value,), (rate,) = renderer.luma_and_rate(seen)
    np.testing.assert_array_equal(value, renderer.luma(seen)[0])
    # Where a lookup passes from texel to texel, or a light sets, the rate jumps.
    wrong = np.abs(rate - difference) > 0.02 * np.abs(difference).max()
    assert wrong.mean() < 0.06
    assert np.abs(difference).max() > 0.05


@pytest.mark.without_llvm
@pytest.mark.parametrize("kind", [bumpy, raised])
def test_lines_see_them(kind: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    scene = world(kind(diffuse()), POINT)
    seen = view(2.2)
    lines, rays = luma(scene, seen, pixel="lines"), luma(scene, seen, rays=987)
    assert np.abs(lines - rays).mean() < 0.01 * rays.mean()


def test_what_is_not_shown_without_noise() -> None:
    """Turned texture coordinates, other coordinates than those of the reflectance, and two normal maps."""
    turned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    inner = {"type": "normalmap", "normalmap": bitmap(BUMPS), "bsdf": diffuse()}
    for material, why in (
        (bumpy(diffuse(bitmap(BASE, to_uv=np.diag([2.0, 2, 1])))), "other texture coordinates"),
        ({"type": "normalmap", "normalmap": bitmap(BUMPS, to_uv=turned), "bsdf": diffuse()}, "turned or mirrored"),
        (bumpy(inner), "normalmap"),
        ({**inner, "bsdf": {"type": "dielectric"}}, "normalmap"),
        (raised(diffuse(bitmap(BASE)), bitmap(HEIGHTS, to_uv=turned)), "bump map at other texture coordinates"),
        (raised(diffuse(), bitmap(HEIGHTS, filter_type="nearest")), "bump map whose lookup is not bilinear"),
        (raised(diffuse(), {"type": "checkerboard"}), "bumpmap"),
    ):
        obstacles = why_not_noise_free(world(material, POINT))
        assert why in " ".join(map(str, obstacles))


@pytest.mark.without_llvm
def test_derivatives_are_refused() -> None:
    renderer = make_renderer(world(bumpy(diffuse()), POINT), CAMERA, kind="native", rays_per_pixel=1, blur=False)
    one = np.zeros(1, np.uint32)
    with pytest.raises(ValueError, match=r"need a scene without normal textures.*--matte"):
        renderer.ray_hits(view(2.2), one, one)  # type: ignore[attr-defined]


TILT = 0.6
"""The sine of the angle by which the textures of the files below turn normals."""


def texels(along: float, up: float, side: int = 4) -> npt.NDArray[np.uint8]:
    """A normal that is turned alike everywhere."""
    normal = np.array([along, up, np.sqrt(1 - along**2 - up**2)])
    return np.broadcast_to(np.round(255 * (0.5 + 0.5 * normal)), (side, side, 3)).astype(np.uint8)


def file(
    folder: Path,
    image: npt.NDArray[np.uint8],
    *,
    uv: npt.NDArray[np.floating[Any]] = UV,
    towards: tuple[float, ...] = (0, 0, 1),
    base: bool = False,
    vertices: Any = None,
    normal: Any = None,
    more: Any = None,
) -> Scene:
    """A square in the light of a sun that stands in a direction (file's axes: x right, y up, z to the camera)."""
    gltf = Gltf()
    bumps = gltf.texture({"bufferView": gltf.view(png(image))})
    looks: dict[str, Any] = {"normalTexture": {**bumps, **(normal or {})}, **(more or {})}
    surface: dict[str, Any] = {}
    if base:
        surface["baseColorTexture"] = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 255)))})
    material = gltf.material("paint", more=looks, **surface)
    gltf.node(mesh=gltf.mesh(CORNERS, FACES, material=material, **({"uv": uv} if vertices is None else vertices)))
    x, y, z = towards
    turn = np.array([-y, x, 0, 1 + z]) / np.linalg.norm([y, x, 0, 1 + z])
    gltf.light({"type": "directional", "intensity": 683.0 * np.pi}, rotation=turn.tolist())
    return load_scene(gltf.save(folder / "scene.glb"))


def seen_from(z: float) -> Views:
    """A camera on the file's z axis; the file's y is the world's z."""
    axes, side = np.eye(4), np.sign(z)
    to_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    axes[:3, :3], axes[:3, 3] = to_world @ np.diag([side, -1, -side]), to_world @ [0.0, 0.0, z]
    return Views.at_rest([axes])


def middle(scene: Scene, z: float = 4.0) -> float:
    renderer = make_renderer(scene, CAMERA, kind="native", rays_per_pixel=1, blur=False)
    return float(renderer.luma(seen_from(z))[0, 10, 12])


FLAT, FACING, AWAY = 0.8, 0.8 * 0.8 + 0.6 * 0.6, 0.8 * 0.8 - 0.6 * 0.6
"""Cosines between light at the sine 0.6 from the square's normal, and normals that are not turned, or towards or away
from it by as much."""


@pytest.mark.few(2)
@pytest.mark.without_llvm
@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_tangents_of_gltf(mirrored: bool, base: bool, tmp_path: Path) -> None:
    """Red points to the right in the picture, green upwards; where the picture is mirrored, so is red."""
    uv = UV * [-1, 1] + [1, 0] if mirrored else UV
    sign = -1 if mirrored else 1
    for image, right, up in ((texels(TILT, 0), sign * TILT, 0.0), (texels(0, TILT), 0.0, TILT)):
        for side, cosine in ((1, FACING), (-1, AWAY)):
            light = (side * right, side * up, 0.8)
            scene = file(tmp_path, image, uv=uv, towards=light, base=base)
            assert not scene.lost_looks
            assert middle(scene) == pytest.approx(cosine, abs=0.01)


@pytest.mark.without_llvm
def test_tangents_are_at_right_angles_to_smooth_normals(tmp_path: Path) -> None:
    """Normals of vertices that lean to the right by 30 degrees, which the texture turns on by 36.9."""
    lean, turn = np.radians(30.0), np.arcsin(TILT)
    vertices = {"uv": UV, "normals": np.tile([np.sin(lean), 0, np.cos(lean)], (4, 1))}
    for side, angle in ((1, lean + turn), (-1, lean - turn)):
        scene = file(tmp_path, texels(side * TILT, 0), vertices=vertices)
        assert middle(scene) == pytest.approx(np.cos(angle), abs=0.01)


@pytest.mark.without_llvm
def test_light_from_behind_stays_there(tmp_path: Path) -> None:
    """A normal may be turned to a light behind the surface; none of it comes through."""
    light = np.array([0.95, 0.0, -0.3]) / np.hypot(0.95, 0.3)
    assert [TILT, 0, 0.8] @ light > 0.3
    assert middle(file(tmp_path, texels(TILT, 0), towards=tuple(light))) == 0


@pytest.mark.without_llvm
def test_the_back_of_gltf_is_turned_round(tmp_path: Path) -> None:
    """What is a bump from the front is a dent from behind: its normal is the opposite one."""
    image = texels(TILT, 0)
    for x, cosine in ((-TILT, FACING), (TILT, AWAY)):
        assert middle(file(tmp_path, image, towards=(x, 0, -0.8)), -4.0) == pytest.approx(cosine, abs=0.01)


@pytest.mark.without_llvm
def test_the_scale_of_gltf(tmp_path: Path) -> None:
    """It scales what lies along the surface."""
    image = texels(TILT, 0)
    for scale in (0.0, 0.5, 2.0):
        normal = np.array([scale * 0.6, 0, 0.8]) / np.hypot(scale * 0.6, 0.8)
        scene = file(tmp_path, image, towards=(0.6, 0, 0.8), normal={"scale": scale})
        assert middle(scene) == pytest.approx(normal @ [0.6, 0, 0.8], abs=0.01)


@pytest.mark.without_llvm
def test_where_gltf_has_no_tangents(tmp_path: Path) -> None:
    """Vertices without texture coordinates lose it and say so, those with colours do not; a texture that turns nothing
    does not count."""
    light = (0.6, 0.0, 0.8)
    scene = file(tmp_path, texels(TILT, 0), towards=light, vertices={})
    assert [look.what for look in scene.lost_looks] == ["normal maps"]
    assert middle(scene) == pytest.approx(FLAT, abs=0.01)
    for colours in (np.full((4, 3), 0.5), np.array([[0.5] * 3, [0.4] * 3, [0.5] * 3, [0.6] * 3])):
        scene = file(tmp_path, texels(TILT, 0), towards=light, vertices={"uv": UV, "colours": colours})
        assert not scene.lost_looks
        assert middle(scene) == pytest.approx(FACING * 0.5, abs=0.01)
        scene = file(tmp_path, texels(TILT, 0), towards=light, vertices={"uv": np.zeros((4, 2)), "colours": colours})
        assert middle(scene) == pytest.approx(FLAT * 0.5, abs=0.01)
    scene = file(tmp_path, np.full((4, 4, 3), (128, 128, 255)), towards=light)
    assert not scene.lost_looks
    assert middle(scene) == pytest.approx(FLAT, abs=0.01)
    one = file(tmp_path, texels(TILT, 0, side=1), towards=light)
    assert middle(one) == pytest.approx(FACING, abs=0.01)
    degenerate = file(tmp_path, texels(TILT, 0), towards=light, uv=np.zeros((4, 2)))
    assert middle(degenerate) == pytest.approx(FLAT, abs=0.01)


TABLES: dict[str, Any] = {
    "of": [0],
    "layouts": [[0, 1, 1, 0]],
    "texels": np.zeros(27, np.uint16),
    "heights": [True],
    "fades": [True],
}


@pytest.mark.without_llvm
@pytest.mark.parametrize(
    "wrong",
    [
        {"of": [0, 0]},
        {"of": [1]},
        {"fades": []},
        {"heights": []},
        {"layouts": [[0, 2, 1, 0]]},
        {"texels": np.zeros(28, np.uint16)},
        {"texels": np.full(27, 0xFFFF, np.uint16)},
    ],
    ids=str,
)
def test_tables_that_do_not_belong_together_are_refused(wrong: dict[str, Any]) -> None:
    def core(tables: dict[str, Any]) -> SceneRenderer:
        of_texture, rest = np.array(tables["of"], np.uint32), (tables[key] for key in ("layouts", "texels", "heights"))
        return one_triangle(normal_textures=(of_texture, *rest, tables["fades"], True))

    core(TABLES)
    with pytest.raises(
        ValueError, match=r"normal textures do not belong|lie within|groups of 3|normal texels|must be finite"
    ):
        core({**TABLES, **wrong})
