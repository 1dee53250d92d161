"""glTF files as scenes, against numbers worked out by hand."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from davis_rs import DecodeError, LostLookWarning, Scene, SceneFileWarning, Simulator, load_scene, simulate
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.diffuse_materials import children
from davis_rs.render.finishes import read_finish
from davis_rs.render.scene_cache import shared_scenes
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.render.truth import lost_look_fractions
from davis_rs.scene.files import gltf_mesh
from davis_rs.scene.lost_looks import BACKS, MISSING, MISSING_NUMBERS
from davis_rs.scene.texel_lookup import WRAP_MODES
from gltf_files import CORNERS, FACES, UV, Gltf, png, quad, with_camera

TURN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""glTF's axes in the world's."""

BT601 = np.array([0.299, 0.587, 0.114])


def saved(gltf: Gltf, folder: Path, suffix: str = ".glb") -> Scene:
    return load_scene(gltf.save(folder / f"scene{suffix}"))


def shapes_of(scene: Scene) -> dict[str, dict[str, Any]]:
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        return {
            shape.id(): {
                "corners": np.array(shape.vertex_positions_buffer()).reshape(-1, 3),
                "uv": np.array(shape.vertex_texcoords_buffer()).reshape(-1, 2),
            }
            for shape in loaded.shapes()
        }


def test_a_square_in_front_of_a_camera_by_hand(tmp_path: Path) -> None:
    """Luma of Lambert's law under a lamp of 683 cd, seen through the file's camera: nothing but the file's numbers."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, material=gltf.material(baseColorFactor=[0.5, 0.25, 1.0, 1.0])))
    gltf.light({"type": "point", "intensity": 683.0, "color": [1.0, 0.5, 0.25]}, translation=[0.0, 0.0, 2.0])
    with_camera(gltf)
    scene = saved(gltf, tmp_path)
    camera = scene.own_camera
    assert (camera.width, camera.height) == (240, 180)
    assert camera.fx == camera.fy == pytest.approx(90.0)
    assert scene.start is not None
    np.testing.assert_allclose(scene.start.position, [0, -3, 0], atol=1e-12)
    np.testing.assert_allclose(scene.start.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    luma = make_renderer(scene, camera, kind="native", rays_per_pixel=1).luma(Views.at_rest([scene.start]))[0]
    rows, columns = np.indices(luma.shape)
    x, y = (columns - camera.cx) / 90 * 3, (rows - camera.cy) / 90 * 3
    inside = (np.abs(x) < 0.99) & (np.abs(y) < 0.99)
    colour = BT601 @ (np.array([1.0, 0.5, 0.25]) * [0.5, 0.25, 1.0])
    expected = colour / np.pi * 2 / (x**2 + y**2 + 4) ** 1.5
    np.testing.assert_allclose(luma[inside], expected[inside], rtol=1e-5)
    assert (luma[(np.abs(x) > 1.01) | (np.abs(y) > 1.01)] == 0).all()
    assert scene.lux_per_luma == pytest.approx(683 * np.pi)
    assert "; 1 light, 683 lux or candela as one unit; the camera" in scene.note


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_textures_with_all_that_places_them(tmp_path: Path, suffix: str) -> None:
    """Texels in sRGB times the factor, wrapped as the sampler says, moved as KHR_texture_transform says."""
    texels = np.random.default_rng(1).integers(0, 256, (4, 8, 3))
    gltf = Gltf()
    image = {"bufferView": gltf.view(png(texels)), "mimeType": "image/png"}
    texture = gltf.texture(image, {"wrapS": 33648, "wrapT": 33648})
    move = {"offset": [0.25, 0.5], "scale": [2.0, 3.0], "rotation": 0.3}
    texture |= {"extensions": {"KHR_texture_transform": move}}  # type: ignore[dict-item]
    paint = gltf.material(baseColorTexture=texture, baseColorFactor=[1.0, 0.5, 0.25, 1.0])
    gltf.node(mesh=quad(gltf, uv=UV, material=paint))
    (shape,) = shapes_of(saved(gltf, tmp_path, suffix)).values()
    cos, sin = np.cos(0.3), np.sin(0.3)
    u, v = UV.T * [[2.0], [3.0]]
    moved = np.stack([cos * u + sin * v + 0.25, -sin * u + cos * v + 0.5], 1)
    np.testing.assert_allclose(shape["uv"], moved[FACES.ravel()], atol=1e-6)
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(load_scene(tmp_path / f"scene{suffix}").source(), mi)
        data = np.array(mi.traverse(loaded.shapes()[0].bsdf())["brdf_0.reflectance.data"])
        table = SceneTable(loaded, mi, shadows=True, any_integrator=False)
    assert WRAP_MODES[table.textures.sizes[0, 3]] == "mirror"
    np.testing.assert_allclose(data, from_srgb(texels / 255) * [1.0, 0.5, 0.25], rtol=1e-6)


def test_nodes_within_nodes_place_what_they_hold(tmp_path: Path) -> None:
    """Matrix, translation, rotation and scale, in the file's order, and normals upright under uneven scale."""
    gltf = Gltf()
    half = np.sqrt(0.5)
    inner = gltf.node(
        root=False, mesh=quad(gltf, normals=np.tile([0, half, half], (4, 1))), rotation=[0, 0, half, half]
    )
    middle = gltf.node(root=False, children=[inner], scale=[1, 2, 4], translation=[0, 0, 1])
    matrix = np.array([[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])
    gltf.node(children=[middle], matrix=matrix.T.ravel().tolist())
    scene = saved(gltf, tmp_path)
    (shape,) = shapes_of(scene).values()
    turned = CORNERS[:, [1, 0, 2]] * [-1, 1, 1]
    expected = (turned * [1, 2, 4] + [5, 6, 8]) @ TURN.T
    np.testing.assert_allclose(shape["corners"], expected[FACES.ravel()], atol=1e-5)
    with variant(SCALAR) as (mi, _):
        normals = load_scene_source(scene.source(), mi).shapes()[0].vertex_normals_buffer()
    normal = np.array([-half, 0, half]) / [1, 2, 4]
    np.testing.assert_allclose(np.array(normals)[:3], TURN @ (normal / np.linalg.norm(normal)), atol=1e-6)


def test_primitives_of_all_kinds_of_triangles(tmp_path: Path) -> None:
    """Lists without indices, strips and fans give the same triangles, turned alike; so do quantised positions."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], np.float32)

    def turned(scene: Scene) -> list[list[float]]:
        (shape,) = shapes_of(scene).values()
        a, b, c = shape["corners"].reshape(-1, 3, 3).swapaxes(0, 1)
        cross = np.cross(b - a, c - a)
        return sorted(np.round(cross, 4).tolist())

    found = []
    for mode, order, kind in (
        (4, [0, 1, 2, 2, 1, 3], "u1"),
        (5, [0, 1, 2, 3], "u2"),
        (4, None, ""),
        (6, [1, 3, 2, 0], "u4"),
    ):
        gltf = Gltf()
        used = corners if order is not None else corners[[0, 1, 2, 2, 1, 3]]
        primitive = {"attributes": {"POSITION": gltf.array(used)}, "mode": mode}
        if order is not None:
            primitive["indices"] = gltf.array(order, kind)
        gltf.node(mesh=gltf.add("meshes", {"primitives": [primitive]}))
        found.append(turned(saved(gltf, tmp_path)))
    assert len(found[0]) == 2
    for others in found[1:]:
        np.testing.assert_allclose(others, found[0], atol=1e-6)
    gltf = Gltf(extensionsUsed=["KHR_mesh_quantization"], extensionsRequired=["KHR_mesh_quantization"])
    packed = np.zeros((4, 4), np.int16)
    packed[:, :3] = np.rint(corners * 32767)
    view = gltf.view(packed.tobytes())
    gltf.document["bufferViews"][view]["byteStride"] = 8
    short = {"bufferView": view, "componentType": 5122, "count": 4, "type": "VEC3", "normalized": True}
    primitive = {"attributes": {"POSITION": gltf.add("accessors", short)}, "mode": 5}
    gltf.node(mesh=gltf.add("meshes", {"primitives": [primitive]}))
    np.testing.assert_allclose(turned(saved(gltf, tmp_path)), found[0], atol=1e-3)


def test_sparse_accessors(tmp_path: Path) -> None:
    """Some elements replaced by others; without a buffer view, those of zeros."""
    gltf = Gltf()
    sparse = {
        "count": 2,
        "indices": {"bufferView": gltf.view(np.array([1, 2], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": gltf.view(np.array([[2, 0, 0], [0, 3, 0]], "<f4").tobytes())},
    }
    position = gltf.add("accessors", {"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse})
    gltf.node(mesh=gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]}))
    (shape,) = shapes_of(saved(gltf, tmp_path)).values()
    np.testing.assert_array_equal(shape["corners"], np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]]) @ TURN.T)


def test_colours_of_vertices(tmp_path: Path) -> None:
    """Linear, times the material's factor, as on a PLY mesh."""
    gltf = Gltf()
    colours = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0.5]], np.float32)
    gltf.node(mesh=quad(gltf, colours=colours, material=gltf.material(baseColorFactor=[0.5, 0.5, 0.5, 1.0])))
    with_camera(gltf, 1.0)
    gltf.light({"type": "directional", "intensity": 683 * np.pi})
    scene = saved(gltf, tmp_path)
    assert scene.start is not None
    camera = scene.own_camera
    luma = make_renderer(scene, camera, kind="native", rays_per_pixel=1).luma(Views.at_rest([scene.start]))[0]
    first = BT601 @ np.array([0.5, 0.5, 0.5]) * (0.5)  # the middle lies half way between the first and the third corner
    middle = (BT601 @ (colours[0] + colours[2]) / 2) * 0.5
    assert luma[89:91, 119:121].mean() == pytest.approx(middle, rel=0.02)
    assert first != pytest.approx(middle, rel=0.02)


def test_lights_of_all_kinds(tmp_path: Path) -> None:
    """Directional along the node's -z, in lux; a spot's axis and cone; the node's scale changes none."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    half = float(np.sqrt(0.5))
    gltf.light({"type": "directional", "intensity": 1366.0}, name="sun", rotation=[-half, 0, 0, half], scale=[3, 3, 3])
    cone = {"innerConeAngle": 0.2, "outerConeAngle": 0.5}
    gltf.light({"type": "spot", "intensity": 68.3, "spot": cone}, name="spot", translation=[1, 2, 3])
    scene = saved(gltf, tmp_path)
    source: Any = scene.source()
    assert [str(look) for look in scene.lost_looks if look.what != BACKS] == [
        "how the spot light's edge falls off (linear in the angle here) of spot"
    ]
    sun, spot = source["light_sun"], source["light_spot"]
    np.testing.assert_allclose(sun["direction"], TURN @ [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(sun["irradiance"]["value"], [2, 2, 2])
    np.testing.assert_allclose(spot["to_world"][:3, 3], TURN @ [1, 2, 3])
    np.testing.assert_allclose(spot["to_world"][:3, 2], TURN @ [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(spot["intensity"]["value"], [0.1] * 3)
    assert (spot["cutoff_angle"], spot["beam_width"]) == pytest.approx((np.degrees(0.5), np.degrees(0.2)))
    assert "sun" not in source
    assert "sky" not in source


def hermite(t: float, first: Any, out: Any, second: Any, into: Any, span: float) -> Any:
    s = t / span
    return (
        (2 * s**3 - 3 * s**2 + 1) * np.array(first)
        + (s**3 - 2 * s**2 + s) * span * np.array(out)
        + (3 * s**2 - 2 * s**3) * np.array(second)
        + (s**3 - s**2) * span * np.array(into)
    )


def test_the_cameras_animation_is_the_path(tmp_path: Path) -> None:
    """Straight lines, cubics and jumps through the file's keyframes, within a node that turns; rates by differences."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    camera = with_camera(gltf, root=False)
    carrier = gltf.node(children=[camera], translation=[0, 1, 0])
    gltf.animate(camera, "translation", [0.5, 1.0, 2.0], [[0, 0, 3], [1, 0, 3], [1, 2, 3]])
    axis = np.array([1.0, 2.0, 2.0]) / 3
    spins = [[0, 0, 0, 1], [*np.sin(0.4) * axis, np.cos(0.4)]]
    gltf.animate(carrier, "rotation", [0.0, 2.0], spins)
    tangents = np.array([[[0, 0, 0], [0, 1, 0], [0, 0, 2]], [[1, 0, 0], [0, 1, 0.5], [0, 0, 0]]])
    gltf.animate(carrier, "translation", [0.0, 1.5], np.reshape(tangents, (-1, 3)), "CUBICSPLINE")
    path = saved(gltf, tmp_path).path
    assert path.duration_s == 2.0
    for t in (0.2, 0.7, 1.4, 1.9):
        own = np.array([np.interp(t, [0.5, 1, 2], column) for column in ([0, 1, 1], [0, 0, 2], [3, 3, 3])])
        turn = Rotation.from_rotvec(0.8 * t / 2 * axis).as_matrix()
        carried = hermite(min(t, 1.5), [0, 1, 0], [0, 0, 2], [0, 1, 0.5], [1, 0, 0], 1.5)
        np.testing.assert_allclose(path.pose(t).position, TURN @ (turn @ own + carried), atol=1e-6)
        np.testing.assert_allclose(path.pose(t).rotation, TURN @ turn @ np.diag([1, -1, -1]), atol=1e-6)
    times = np.array([0.2, 0.7, 1.4, 1.9])
    step = 1e-6  # seconds
    np.testing.assert_allclose(
        path.velocities(times), (path.positions(times + step) - path.positions(times - step)) / (2 * step), atol=1e-6
    )
    turned = np.swapaxes(path.rotations(times - step), 1, 2) @ path.rotations(times + step)
    rates = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], 1) / (2 * step)
    np.testing.assert_allclose(path.angular_rates(times), rates, atol=1e-6)
    np.testing.assert_allclose(path.breaks_s(), [0.5, 1.0, 1.5])


def test_a_camera_that_moves_comes_before_others(tmp_path: Path) -> None:
    """Of all the animated one is taken, wherever it stands in the file, and the note names the others."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    with_camera(gltf, name="still")
    gltf.animate(with_camera(gltf, name="moving"), "translation", [0.0, 1.0], [[0, 0, 3], [1, 0, 3]])
    ortho = gltf.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 1}})
    gltf.node(camera=ortho, name="flat")
    scene = saved(gltf, tmp_path)
    np.testing.assert_allclose(scene.path.velocities([0.5]), [[1, 0, 0]], atol=1e-9)
    assert "the camera moving, 240 x 180 px, moves for 1 s; not taken: the cameras still, flat" in scene.note


def test_steps_jump_and_long_turns_keep_their_sign(tmp_path: Path) -> None:
    """STEP holds until the next keyframe; a full turn in quarters is a continuous quaternion."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    camera = with_camera(gltf)
    gltf.animate(camera, "translation", [0.0, 1.0, 2.0], [[0, 0, 3], [0, 0, 4], [0, 0, 5]], "STEP")
    angles = np.linspace(0, 2 * np.pi, 5)
    quarters = np.stack([0 * angles, 0 * angles, np.sin(angles / 2), np.cos(angles / 2)], 1)
    quarters[2] *= -1  # the file may choose either sign
    gltf.animate(camera, "rotation", angles / np.pi, quarters)
    path = saved(gltf, tmp_path).path
    np.testing.assert_allclose(path.positions([0.999, 1.0, 1.5])[:, 1], [-3, -4, -4], atol=1e-6)
    assert (path.velocities([0.5, 1.5]) == 0).all()
    t = np.linspace(0, 2, 200)
    assert np.abs(np.diff(path.quaternions(t), axis=0)).max() < 0.05
    np.testing.assert_allclose(np.linalg.norm(path.angular_rates(t), axis=1), np.pi, rtol=1e-6)


def test_animated_nodes_are_moving_objects(tmp_path: Path) -> None:
    """A body of two materials on a turning arm: where its corners are, at rest in the world only what does not move."""
    gltf = Gltf()
    red, blue = (
        gltf.material(name, baseColorFactor=[*colour, 1.0])
        for name, colour in (("red", [1, 0, 0]), ("blue", [0, 0, 1]))
    )
    body = quad(gltf, material=red)
    second = quad(gltf, material=blue)
    gltf.document["meshes"][body]["primitives"] += gltf.document["meshes"][second]["primitives"]
    part = gltf.node(root=False, mesh=body, name="body", translation=[2, 0, 0], scale=[0.5, -0.5, 1.0])
    arm = gltf.node(children=[part], name="arm")
    gltf.node(mesh=quad(gltf, material=red), name="floor")
    gltf.animate(arm, "rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, np.sin(0.5), np.cos(0.5)]])
    with_camera(gltf, 5.0)
    gltf.light({"type": "directional", "intensity": 683.0})
    scene = saved(gltf, tmp_path)
    assert set(scene.objects) == {"body_red", "body_blue"}
    shapes = shapes_of(scene)
    assert set(shapes) == {"mesh_red", "body_red", "body_blue"}
    for t in (0.0, 0.6, 1.0):
        pose = scene.objects["body_red"].pose(t)
        there = shapes["body_red"]["corners"] @ pose.rotation.T + pose.position
        cos, sin = np.cos(t), np.sin(t)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        expected = (CORNERS * [0.5, -0.5, 1.0] + [2, 0, 0]) @ turn.T @ TURN.T
        # A mirror image, so its corners go round the other way.
        np.testing.assert_allclose(there, expected[FACES[:, ::-1].ravel()], atol=1e-5)
    assert scene.path.duration_s == 1.0
    assert (scene.path.velocities([0.5]) == 0).all()
    events = sum(
        len(packet.events)
        for packet in simulate(scene, duration_s=0.2, rays_per_pixel=1, frame_rate_hz=0, depth_rate_hz=0)
    )
    assert events > 100


def test_a_file_of_a_mesh_alone_is_seen_from_around(tmp_path: Path) -> None:
    """Without camera and lights it gets what a mesh file gets; up and scale as well; one line says the size."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    path = gltf.save(tmp_path / "plain.glb")
    scene = load_scene(path, up="z", scale=0.001)
    assert "plain.glb is 0.002 m x 0.002 m wide and 0 m high, at 0.001 m to a unit and with axis z up" in scene.note
    assert "no camera, so one that goes around" in scene.note
    assert "no lights, so a sun and a sky" in scene.note
    assert scene.path.duration_s == 10
    source: Any = scene.source()
    assert {"sun", "sky"} < source.keys()
    with pytest.raises(ValueError, match="up must be y or z"):
        load_scene(path, up="x")  # type: ignore[arg-type]


def looks_of(scene: Scene) -> dict[str, tuple[str, ...]]:
    """What is lost of which materials, lights or nodes."""
    return {look.what: look.of for look in scene.lost_looks}


def test_looks_that_are_lost_are_known(tmp_path: Path) -> None:
    """Of materials by their names, of the rest by what it is; a plain file has none, nor what only looks like one."""
    gltf = Gltf(extensionsUsed=["KHR_materials_dispersion", "ACME_fog", "KHR_texture_basisu", "EXT_mesh_features"])
    coat = {"extensions": {"KHR_materials_dispersion": {}, "KHR_materials_emissive_strength": {"emissiveStrength": 2}}}
    shiny = {
        "occlusionTexture": {"index": 0},
        "normalTexture": {"index": 0, "texCoord": 1},
        "alphaMode": "BLEND",
        **coat,
    }
    image = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 4), 100)))}, {"magFilter": 9728, "wrapT": 33071})
    glass = gltf.material("glass", baseColorTexture=image, metallicFactor=1.0, double_sided=False, more=shiny)
    pane = gltf.material("pane", baseColorTexture=image, more={"alphaMode": "BLEND"})
    dark = {"emissiveTexture": {"index": 0}}  # times a factor of 0
    solid = gltf.material("solid", baseColorTexture=image, baseColorFactor=[1, 1, 1, 0.9999999], more=dark)
    gltf.node(mesh=quad(gltf, uv=UV, material=glass, colours=np.linspace(0.1, 0.9, 12).reshape(4, 3)))
    gltf.node(mesh=quad(gltf, uv=UV, material=pane))
    gltf.node(mesh=quad(gltf, uv=UV, material=solid))
    bright = gltf.material("bright", more={"alphaMode": "BLEND"})
    gltf.node(mesh=quad(gltf, material=bright, colours=np.full((4, 4), [2, 0, 0, 0.5])))
    gltf.light({"type": "point", "range": 3.0}, name="bulb")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = saved(gltf, tmp_path)
    wrapped = "the wrap mode clamp along v (repeat is taken both ways)"
    assert looks_of(scene) == {
        "occlusion maps": ("glass",),
        "normal maps": ("glass",),
        "backs that cannot be seen (they are seen from both sides)": ("glass",),
        "KHR_materials_dispersion": ("glass",),
        "transparency": ("glass", "pane", "bright"),
        wrapped: ("glass", "pane", "solid"),
        "different colours of vertices": ("glass",),
        "colours of vertices beyond 0 to 1 (they are cut there)": ("bright",),
        "the range of the light (it shines without end)": ("bulb",),
        "what unknown extensions say": ("ACME_fog",),
    }
    shapes = {look.what: look.shapes for look in scene.lost_looks}
    assert shapes["transparency"] == ("mesh_glass", "mesh_pane", "mesh_bright")
    assert shapes["what unknown extensions say"] == ()


def test_texels_with_hard_edges(tmp_path: Path) -> None:
    """A filter for large texels shows as it is, one for small ones is for previews alone; metal's is lost."""
    seen = {}
    for name, sampler in {"hard": {"magFilter": 9728}, "soft": {"magFilter": 9729, "minFilter": 9984}}.items():
        gltf = Gltf()
        texels = np.zeros((2, 2, 3))
        texels[:, 1] = 255
        image = gltf.texture({"bufferView": gltf.view(png(texels))}, sampler)
        gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture=image)))
        with_camera(gltf, 2.0)
        scene = saved(gltf, tmp_path)
        assert looks_of(scene) == {}
        assert scene.camera is not None
        assert scene.start is not None
        renderer = make_renderer(replace(scene, soft_light=False), scene.camera, rays_per_pixel=4)
        luma = renderer.luma(Views.at_rest([scene.start]))[0][90, 80:160]  # of the square, not of what is around it
        seen[name] = np.count_nonzero((luma > 0.02 * luma.max()) & (luma < 0.98 * luma.max()))
    assert seen["hard"] <= 3
    assert seen["soft"] > 30
    gltf = Gltf()
    rough = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 200)))}, {"magFilter": 9728})
    metal = gltf.material(metallicFactor=1.0, metallicRoughnessTexture=rough, baseColorTexture=rough)
    gltf.node(mesh=quad(gltf, uv=UV, material=metal))
    lost = "hard edges of texels of metal and roughness (they are taken as bilinear)"
    assert looks_of(saved(gltf, tmp_path)) == {lost: ("paint",)}


def halves(**right: Any) -> Gltf:
    """A camera that sees a square of one colour on the left half of its image, another one on the right."""
    gltf = Gltf()
    wide = CORNERS * [10, 20, 1]
    gltf.node(mesh=gltf.mesh(wide, FACES, material=gltf.material("left")), translation=[-10, 0, 0])
    gltf.node(mesh=gltf.mesh(wide, FACES, material=gltf.material("right", **right)), translation=[10, 0, 0])
    gltf.light({"type": "directional", "intensity": 683.0})
    gltf.animate(with_camera(gltf), "translation", [0.0, 1.0], np.array([[0, 0, 3], [0, 0.5, 3]]))
    return gltf


def test_the_share_of_the_image_that_lost_looks_concern(tmp_path: Path) -> None:
    """Half of the pixels see what has an occlusion map, nothing sees a lamp: in one line, which meta.json repeats."""
    gltf = halves(more={"occlusionTexture": {"index": 0}})
    gltf.node(
        mesh=quad(gltf, material=gltf.material("lamp", more={"extensions": {"KHR_materials_sheen": {}}})),
        translation=[0, 0, 9],
    )
    gltf.light({"type": "point", "intensity": 1.0, "range": 3.0}, name="bulb", translation=[0, 0, 5])
    scene = saved(gltf, tmp_path)
    with pytest.warns(LostLookWarning) as caught:
        simulator = Simulator(scene, rays_per_pixel=1)
    (warning,) = caught
    assert str(warning.message) == (
        f"{tmp_path / 'scene.glb'}: these looks are lost, with their fraction of "
        "the image along the camera path: occlusion maps of right (50 %); not in view: "
        "sheen (a Mitsuba XML file has a weaker one, as the sheen of principled) of lamp; "
        "fraction not known: the range of the light (it shines without end) of bulb"
    )
    assert simulator.describe()["lost_looks"] == {
        "occlusion maps of right": 0.5,
        "sheen (a Mitsuba XML file has a weaker one, as the sheen of principled) of lamp": 0.0,
        "the range of the light (it shines without end) of bulb": None,
    }


def test_shares_are_not_known_of_a_scene_that_was_changed(tmp_path: Path) -> None:
    """Where nothing says where the camera is, and where a shape is not made of triangles; the looks are told."""
    scene = saved(halves(more={"occlusionTexture": {"index": 0}}), tmp_path)
    (look,) = scene.lost_looks
    assert lost_look_fractions(scene, scene.own_camera) == {look: 0.5}
    assert lost_look_fractions(replace(scene, trajectory=None), scene.own_camera) == {look: 0.5}  # at its start
    nowhere = replace(scene, trajectory=None, start=None)
    assert lost_look_fractions(nowhere, scene.own_camera) == {look: None}

    def with_field() -> Any:
        grid = np.mgrid[:2, :2, :2][0, ..., None] - 0.5
        return {**scene.source(), "field": {"type": "sdfgrid", "grid": grid}}  # type: ignore[dict-item]

    changed = replace(scene, source=with_field)
    assert lost_look_fractions(changed, scene.own_camera) == {look: None}
    with pytest.warns(LostLookWarning, match=r"fraction not known: occlusion maps of right$"):
        Simulator(changed, rays_per_pixel=1)


@pytest.mark.parametrize("mirrored", [False, True])
def test_backs_are_lost_only_where_they_are_seen(tmp_path: Path, mirrored: bool) -> None:
    """A one-sided square from its front is as it should be; so is its mirror image; turned round, it is not.

    Mitsuba shows its back.
    """
    gltf = halves(double_sided=False)
    gltf.document["nodes"][1]["scale"] = [-1, 1, 1] if mirrored else [1, 1, 1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Simulator(saved(gltf, tmp_path), rays_per_pixel=1, renderer="integrator")
    gltf.document["nodes"][1]["rotation"] = [0, 1, 0, 0]
    gltf.animate(
        1, "translation", [0.0, 1.0], np.array([[10, 0, 0], [10, 0.1, 0]])
    )  # a body that moves has its own axes
    with pytest.warns(LostLookWarning, match=r"backs that cannot be seen .* of right \(50 %\)"):
        Simulator(saved(gltf, tmp_path), rays_per_pixel=1, renderer="integrator")


def test_copies_of_a_mesh_are_where_they_belong(tmp_path: Path) -> None:
    """EXT_mesh_gpu_instancing: translation, rotation and scale of each, within the node, at rest and on the move."""
    gltf = Gltf(extensionsRequired=["EXT_mesh_gpu_instancing"])
    half = float(np.sqrt(0.5))
    places, turns = [[0, 0, 0], [5, 0, 0], [0, 7, 1]], [[0, 0, 0, 1], [0, 0, half, half], [0, 0, 0, 1]]
    sizes = [[1, 1, 1], [2, 1, 1], [-1, 1, 1]]
    attributes = {
        "TRANSLATION": gltf.array(places),
        "ROTATION": gltf.array(np.array(turns)),
        "SCALE": gltf.array(sizes),
    }
    copies = {"EXT_mesh_gpu_instancing": {"attributes": {**attributes, "_ID": 0}}}
    gltf.node(mesh=quad(gltf), name="still", extensions=copies, scale=[3, 3, 3])
    mover = gltf.node(mesh=quad(gltf), name="mover", extensions=copies, translation=[0, 0, 9])
    gltf.animate(mover, "translation", [0.0, 1.0], [[0, 0, 9], [1, 0, 9]])
    scene = saved(gltf, tmp_path)
    turned = CORNERS * [2, 1, 1] @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + np.array([5, 0, 0])
    mirrored = CORNERS * [-1, 1, 1] + np.array([0, 7, 1])
    faces = [FACES, FACES, FACES[:, ::-1]]
    corners = zip((CORNERS, turned, mirrored), faces, strict=True)
    expected = np.concatenate([places[order.ravel()] for places, order in corners])
    shapes = shapes_of(scene)
    np.testing.assert_allclose(shapes["mesh_material"]["corners"], 3 * expected @ TURN.T, atol=1e-5)
    pose = scene.objects["mover_material"].pose(1.0)
    there = shapes["mover_material"]["corners"] @ pose.rotation.T + pose.position
    np.testing.assert_allclose(there, (expected + np.array([1, 0, 9])) @ TURN.T, atol=1e-5)
    assert {look.what for look in scene.lost_looks} == {BACKS}


def test_copies_are_counted_before_they_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_mesh, "MOST_TRIANGLES", 7)
    gltf = Gltf()
    attributes = {"TRANSLATION": gltf.array(np.zeros((4, 3)))}
    gltf.node(mesh=quad(gltf), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    with pytest.raises(DecodeError, match=r"nodes\[0\]: a scene may have 7 triangles"):
        saved(gltf, tmp_path)


def test_diffuse_colours_of_specular_glossiness(tmp_path: Path) -> None:
    """They are the base colour, before that of metallic-roughness; what is lost is the gloss."""
    texels = np.random.default_rng(2).integers(0, 256, (4, 4, 3))
    gltf = Gltf(extensionsRequired=["KHR_materials_pbrSpecularGlossiness"])
    texture = gltf.texture({"bufferView": gltf.view(png(texels))})
    texture |= {"texCoord": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}  # type: ignore[dict-item]
    gloss = {"diffuseFactor": [0.5, 0.25, 1.0, 1.0], "diffuseTexture": texture, "specularFactor": [1, 1, 1]}
    more = {"extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}}
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorFactor=[0, 0, 0, 1], more=more)))
    scene = saved(gltf, tmp_path)
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        data = np.array(mi.traverse(shape.bsdf())["brdf_0.reflectance.data"])
    np.testing.assert_allclose(data, from_srgb(texels / 255) * [0.5, 0.25, 1.0], rtol=1e-6)
    np.testing.assert_allclose(shapes_of(scene)["mesh_paint"]["uv"], 2 * UV[FACES.ravel()], atol=1e-6)
    assert looks_of(scene) == {"gloss": ("paint",)}


def metal_of(gltf: Gltf, folder: Path) -> tuple[dict[str, float], dict[str, Any], dict[str, tuple[str, ...]]]:
    """Numbers and texels of the one shape's metal and roughness, and what is lost."""
    scene = saved(gltf, folder)
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        given = dict(mi.traverse(shape.bsdf()))
    given = {name.removeprefix("brdf_0."): value for name, value in given.items() if "brdf_0" in name}
    numbers = {
        name[:-6]: float(value) for name, value in given.items() if name in ("metallic.value", "roughness.value")
    }
    texels = {name[:-5]: np.array(given[name]) for name in ("metallic.data", "roughness.data") if name in given}
    return numbers, texels, looks_of(scene)


def test_metal_by_its_numbers(tmp_path: Path) -> None:
    """The factors, 1 where the file says nothing; rough without metal, without highlights, or unlit it is diffuse."""
    unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}

    def specular(factor: float) -> dict[str, Any]:
        return {"extensions": {"KHR_materials_specular": {"specularFactor": factor}}}

    cases: list[tuple[dict[str, Any], dict[str, float]]] = [
        ({"metallicFactor": 0.75, "roughnessFactor": 0.25}, {"metallic": 0.75, "roughness": 0.25}),
        ({"metallicFactor": None}, {"metallic": 1.0, "roughness": 1.0}),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.25}, {"metallic": 0.0, "roughness": 0.25}),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.7}, {"metallic": 0.0, "roughness": float(np.float32(0.7))}),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.71}, {}),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.25, "more": specular(0.0)}, {}),
        (
            {"metallicFactor": 0.0, "roughnessFactor": 0.25, "more": specular(0.5)},
            {"metallic": 0.0, "roughness": 0.25},
        ),
        ({"metallicFactor": 1.0, "more": unlit}, {}),
        ({"metallicFactor": 1.0, "more": {"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}}}, {}),
    ]
    for surface, expected in cases:
        gltf = Gltf(extensionsUsed=["KHR_materials_unlit"])
        gltf.node(mesh=quad(gltf, material=gltf.material(**surface)))
        numbers, texels, lost = metal_of(gltf, tmp_path)
        assert (numbers, texels) == (expected, {}), surface
        (extension,) = surface.get("more", unlit)["extensions"]
        weak = surface.get("more") == specular(0.5)
        told = ["gloss"] if extension == "KHR_materials_pbrSpecularGlossiness" else []
        assert [look.split(" (")[0] for look in lost] == (
            ["how specularFactor weakens highlights at a grazing angle"] if weak else told
        )
    wrong: list[tuple[str, Any]] = [("metallicFactor", 1.5), ("roughnessFactor", "smooth")]
    for name, value in wrong:
        gltf = Gltf()
        surface = {"metallicFactor": 1.0, name: value}
        gltf.node(mesh=quad(gltf, material=gltf.material(**surface)))
        with pytest.raises(DecodeError, match=rf"materials\[0\]: {name}"):
            saved(gltf, tmp_path)


def test_metal_by_its_texture(tmp_path: Path) -> None:
    """Green is roughness and blue is metal, not in sRGB; where the base colour has other coordinates it is the mean.

    Without any blue there is no metal, and what is rough then is diffuse.
    """
    texels = np.random.default_rng(4).integers(0, 256, (4, 3, 3))
    moved = {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}

    def metal(base: dict[str, Any] | None, texels: Any, moved: dict[str, Any], more: Any = None) -> Any:
        gltf = Gltf(extensionsUsed=["KHR_texture_transform"])
        own = gltf.texture({"bufferView": gltf.view(png(texels))}, {"wrapS": 33648, "wrapT": 33648}) | moved
        surface = {"metallicFactor": 0.5, "roughnessFactor": 0.75, "metallicRoughnessTexture": own}
        if base is not None:
            surface["baseColorTexture"] = gltf.texture({"bufferView": gltf.view(png(np.full((2, 2, 3), 99)))}) | base
        gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(more=more, **surface)))  # type: ignore[arg-type]
        return metal_of(gltf, tmp_path)

    alike: tuple[dict[str, Any] | None, ...] = (moved, None)
    for base in alike:
        numbers, data, lost = metal(base, texels, moved)
        assert not numbers
        assert not lost
        np.testing.assert_allclose(data["roughness"][..., 0], 0.75 * texels[..., 1] / 255, rtol=1e-6)
        np.testing.assert_allclose(data["metallic"][..., 0], 0.5 * texels[..., 2] / 255, rtol=1e-6)
        with variant(SCALAR) as (mi, _):
            (shape,) = load_scene_source(load_scene(tmp_path / "scene.glb").source(), mi).shapes()
            # UV moved by half of the image's width.
            np.testing.assert_allclose(np.array(shape.vertex_texcoords_buffer()).reshape(-1, 2)[:, 0].min(), 0.5)
    roughness, metallic = texels[..., 1:].reshape(-1, 2).mean(0) / 255 * [0.75, 0.5]
    numbers, data, lost = metal({}, texels, moved)
    assert numbers == pytest.approx({"metallic": metallic, "roughness": roughness})
    assert not data
    told = "metal and roughness that differ from place to place (their means are taken)"
    assert lost == {told: ("paint",)}
    assert metal({}, np.where([0, 1, 0], 250, texels * [1, 1, 0]), {}) == ({}, {}, {})
    numbers, data, lost = metal({}, np.where([0, 1, 0], 120, texels * [1, 1, 0]), {})
    assert (numbers, lost) == ({}, {})
    np.testing.assert_allclose(data["roughness"], 0.75 * 120 / 255, rtol=1e-6)
    np.testing.assert_array_equal(data["metallic"], 0.0)
    dull = {"extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
    numbers, data, lost = metal({}, np.where([0, 1, 0], 120, texels * [1, 1, 0]), {}, dull)
    assert (numbers, data, lost) == ({}, {}, {})
    # The base colour repeats, and these are mirrored, as their own sampler says.
    metal({}, texels, {})
    scene = load_scene(tmp_path / "scene.glb")
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        front = children(shape.bsdf())["brdf_0"]
        read = read_finish(front, children(front), mi)
    assert read is not None
    assert [None if lobe is None else WRAP_MODES[lobe.wrap] for lobe in read[1].lobe] == ["mirror", "mirror"]


@pytest.mark.without_llvm
def test_smooth_surfaces_without_metal_mirror_four_percent(tmp_path: Path) -> None:
    """A black one before the camera shows a wall of luma 1 behind it, by the refractive index 1.5 of the standard."""
    gltf = Gltf(extensionsUsed=["KHR_materials_unlit"])
    black: dict[str, Any] = {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0.0, "roughnessFactor": 0.0}
    gltf.node(mesh=quad(gltf, material=gltf.material("varnish", **black)))
    unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
    bright = gltf.material("wall", more=unlit, baseColorFactor=[1, 1, 1, 1])
    gltf.node(mesh=gltf.mesh(9 * CORNERS, FACES, material=bright), translation=[0, 0, 6])
    gltf.light({"type": "point", "intensity": 1e-12})
    with_camera(gltf)
    scene = saved(gltf, tmp_path)
    assert scene.start is not None
    luma = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=1).luma(Views.at_rest([scene.start]))
    assert luma[0, 90, 120] == pytest.approx(0.04, rel=1e-3)


def test_mirrors_show_what_stands_before_them(tmp_path: Path) -> None:
    """A camera before a mirror sees the wall behind itself, with the mirror's own shadow, under direct light alone."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, material=gltf.material("mirror", metallicFactor=1.0, roughnessFactor=0.0)))
    wall = gltf.mesh(5 * CORNERS, FACES, material=gltf.material("wall", baseColorFactor=[0.5, 0.5, 0.5, 1.0]))
    gltf.node(mesh=wall, translation=[0, 0, 6])
    gltf.light({"type": "directional", "intensity": 683.0}, rotation=[0, 1, 0, 0])  # along +z, onto the wall
    with_camera(gltf)
    scene = saved(gltf, tmp_path)
    assert scene.start is not None
    views = Views.at_rest([scene.start])
    with shared_scenes():
        middle = [
            make_renderer(shown, scene.own_camera, kind="native", rays_per_pixel=1).luma(views)[0, 70:110, 100:140]
            for shown in (scene, replace(scene, reflections=False))
        ]
    # The shadow is 2 m wide, 9 m away in the mirror.
    seen = np.pad(np.zeros((18, 18)), 11, constant_values=0.5 / np.pi)
    edge = np.pad(np.zeros((18, 18), bool), 2, constant_values=True)
    away = ~np.pad(edge, 9)
    np.testing.assert_allclose(middle[0][away], seen[away], rtol=0.01)
    assert not middle[1].any()
    # Mitsuba's own integrator looks along the lobes too.
    with variant(SCALAR) as (mi, _):
        assert "bsdf_samples = 1" in str(load_scene_source(scene.source(), mi).integrator())


def test_matte_metal_is_its_base_colour(tmp_path: Path) -> None:
    """Bit for bit what a file without metal shows."""

    def luma(metal: float, matte: bool) -> Any:
        gltf = halves(metallicFactor=metal, baseColorFactor=[0.8, 0.4, 0.2, 1.0])
        scene = replace(saved(gltf, tmp_path), matte=matte)
        return make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=1).luma(
            Views.along(scene.path, np.zeros(1))
        )

    np.testing.assert_array_equal(luma(1.0, True), luma(0.0, False))
    assert (luma(1.0, True) != luma(1.0, False)).any()


def test_textures_of_webp(tmp_path: Path) -> None:
    """Where there is no other image; next to one the usual kind is read."""
    file = io.BytesIO()
    Image.fromarray(np.full((4, 4, 3), (255, 0, 0), np.uint8)).save(file, "WEBP", lossless=True)
    gltf = Gltf(extensionsUsed=["EXT_texture_webp"], extensionsRequired=["EXT_texture_webp"])
    image = gltf.add("images", {"bufferView": gltf.view(file.getvalue()), "mimeType": "image/webp"})
    texture = gltf.add("textures", {"extensions": {"EXT_texture_webp": {"source": image}}})
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture={"index": texture})))
    scene = saved(gltf, tmp_path)
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        data = np.array(mi.traverse(shape.bsdf())["brdf_0.reflectance.data"])
    assert data.dtype == np.uint8  # as the file has them
    np.testing.assert_array_equal(data, np.tile([255, 0, 0], (4, 4, 1)))
    assert scene.lost_looks == ()


def test_required_extensions_that_change_looks_alone_do_not_refuse_a_file(tmp_path: Path) -> None:
    gltf = Gltf(extensionsRequired=["KHR_materials_unlit", "KHR_materials_transmission", "KHR_materials_variants"])
    glow = {"extensions": {"KHR_materials_unlit": {}, "KHR_materials_transmission": {"transmissionFactor": 1}}}
    gltf.node(mesh=quad(gltf, material=gltf.material("pane", more=glow)))
    assert looks_of(saved(gltf, tmp_path)) == {}


def test_numbers_that_only_rounding_put_beyond_their_bounds_are_taken(tmp_path: Path) -> None:
    """Colours, angles of spots in float32, quaternions of 8 bits, weights of nothing; normals of any length."""
    gltf = Gltf()
    paint = gltf.material(baseColorFactor=[1.00000012, -1e-8, 0.5, 1.0000001])
    mesh = quad(gltf, material=paint, normals=np.array([[0, 0, 2], [0, 0, 0], [np.nan, 0, 1], [0, 0.6, 0.8]]))
    gltf.document["meshes"][mesh]["weights"] = [1e-9]
    gltf.node(mesh=mesh, rotation=[0, 0, 0.71, 0.71], weights=[0.0])
    cone = {"innerConeAngle": float(np.float32(np.pi / 2)), "outerConeAngle": float(np.float32(np.pi / 2))}
    gltf.light({"type": "spot", "spot": cone, "color": [1.0, -1e-9, 0.0]}, name="spot")
    gltf.animate(0, "weights", [0.0, 1.0], [0, 1e-9])
    told = "corners whose normal has no direction take that of their triangle: 3 "
    with pytest.warns(SceneFileWarning, match=re.escape(told) + r"\(the first: meshes\[0\]\.primitives\[0\]\)$"):
        scene = saved(gltf, tmp_path)
    with variant(SCALAR) as (mi, _):
        source: Any = scene.source()
        assert source["light_spot"]["cutoff_angle"] == 90.0
        assert 89 < source["light_spot"]["beam_width"] < 90
        shape = load_scene_source(source, mi).shapes()[0]
        colour = np.array(mi.traverse(shape.bsdf())["brdf_0.reflectance.value"]).ravel()
        normals = np.array(shape.vertex_normals_buffer()).reshape(-1, 3) @ TURN
    np.testing.assert_array_equal(colour, np.array([1, 0, 0.5]))
    half = np.float32(np.sqrt(0.5))
    np.testing.assert_allclose(normals[:3], [[0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(normals[5], [-0.6, 0, 0.8], atol=1e-6)
    assert np.abs(shapes_of(scene)["mesh_paint"]["corners"]).max() == pytest.approx(2 * half * half)


def test_animated_nodes_with_a_matrix(tmp_path: Path) -> None:
    """glTF does not allow it, but exporters write it: what is not animated is as the matrix says."""
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True)

    def world(name: str, **at: Any) -> Scene:
        gltf = Gltf()
        node = gltf.node(mesh=quad(gltf, material=gltf.material()), name="card", **at)
        gltf.animate(node, "translation", [0, 1], [[0, 0, 0], [1, 2, 3]])
        return load_scene(gltf.save(tmp_path / name))

    matrix = np.eye(4)
    matrix[:3, :3] = turn.as_matrix() * [1, 2, -3]
    given = {"rotation": Rotation.from_matrix(turn.as_matrix() * [-1, -1, 1]).as_quat().tolist(), "scale": [-1, -2, -3]}
    expected = world("usual.glb", translation=[9, 9, 9], **given)
    with pytest.warns(SceneFileWarning, match=r"have a matrix, which glTF does not allow.*: 1 \(the first: nodes\[0\]"):
        scene = world("matrix.glb", matrix=matrix.T.ravel().tolist())
    assert scene.objects.keys() == expected.objects.keys() != set()
    for name, path in scene.objects.items():
        np.testing.assert_allclose(path.pose(0.5).matrix, expected.objects[name].pose(0.5).matrix, atol=1e-6)
    for part, same in zip(positions_of(scene), positions_of(expected), strict=True):
        np.testing.assert_allclose(part, same, atol=1e-6)
    sheared = matrix.copy()
    sheared[0, 1] += 1
    with pytest.raises(DecodeError, match=r"nodes\[0\].* its matrix must be made of a translation, a rotation and a"):
        world("sheared.glb", matrix=sheared.T.ravel().tolist())


def positions_of(scene: Scene) -> list[Any]:
    """The vertices of the scene's shapes at the start."""
    with variant(SCALAR) as (mi, _):
        shapes = load_scene_source(scene.source(), mi).shapes()
        return [np.array(mi.traverse(shape)["vertex_positions"]) for shape in shapes]


def test_animations_by_pointer(tmp_path: Path) -> None:
    """Of a node's place they are its animation; of a material's colour a look that is lost."""
    gltf = Gltf(extensionsUsed=["KHR_animation_pointer"])
    node = gltf.node(mesh=quad(gltf, material=gltf.material()), name="body")
    for pointer in (f"/nodes/{node}/translation", "/materials/0/pbrMetallicRoughness/baseColorFactor"):
        gltf.animate(node, "pointer", [0.0, 1.0], [[0, 0, 0], [2, 0, 0]])
        channel = gltf.document["animations"][0]["channels"][-1]
        channel["target"] = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
    gltf.animate(node, "translation", [0.0, 1.0], [[0, 0, 0], [9, 0, 0]])  # a second time in one animation
    scene = saved(gltf, tmp_path)
    np.testing.assert_allclose(scene.objects["body_paint"].pose(0.5).position, [1, 0, 0], atol=1e-9)
    assert looks_of(scene) == {
        "the animation": ("'/materials/0/pbrMetallicRoughness/baseColorFactor'",),
        "a second animation": ("body",),
    }


def test_animations_of_what_does_not_move_are_left_out(tmp_path: Path) -> None:
    """The rest of the file is used."""
    gltf = Gltf(extensionsUsed=["KHR_animation_pointer"])
    node = gltf.node(mesh=quad(gltf, material=gltf.material()), name="body")
    pointers = ["/cameras/0/perspective/yfov", "/nodes/0/extensions/KHR_node_visibility/visible", "/meshes/0/weights/0"]
    for pointer in pointers:
        gltf.animate(node, "pointer", [0.0, 1.0], [0.0, 1.0])
        channel = gltf.document["animations"][0]["channels"][-1]
        channel["target"] = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
    gltf.animate(node, "yfov", [0.0, 1.0], [0.5, 1.0])
    gltf.animate(node, "translation", [0.0, 1.0], [[0, 0, 0], [2, 0, 0]])
    scene = saved(gltf, tmp_path)
    np.testing.assert_allclose(scene.objects["body_paint"].pose(0.5).position, [1, 0, 0], atol=1e-9)
    assert looks_of(scene) == {"the animation": (*map(repr, pointers), "'yfov'")}


@pytest.mark.parametrize("kind", ["LINEAR", "CUBICSPLINE"])
def test_keyframes_before_the_beginning_and_at_one_time(tmp_path: Path, kind: str) -> None:
    """Blender writes its frame 0 at a time below 0. What is played is what comes from 0 s on."""
    times = [-0.75, -0.5, 0.5, 0.5, 1.5]
    places = np.outer([9.0, 1.0, 8.0, 3.0, 5.0], [1.0, 0, 0])
    values = places if kind == "LINEAR" else np.stack([np.zeros((5, 3)), places, np.zeros((5, 3))], 1)
    gltf = Gltf()
    node = gltf.node(mesh=quad(gltf, material=gltf.material()), name="body")
    still = gltf.node(mesh=quad(gltf, material=gltf.material()), name="still")
    gltf.animate(node, "translation", times, values.reshape(-1, 3), kind)
    gltf.animate(still, "translation", [-1.0, -0.5], [[0, 0, 0], [0, 4, 0]])
    with pytest.warns(SceneFileWarning) as told:
        scene = saved(gltf, tmp_path)
    assert "keyframes before 0 s, where the animation begins: 4 (the first: animations[0].samplers[0])" in str(
        told[0].message
    )
    assert "keyframes at the time of the next one, which are left out: 1 (the first: anim" in str(told[0].message)
    # From 1 at -0.5 s to 3 at 0.5 s: in the middle at 0 s, both along a line and along a symmetric curve.
    along = [scene.objects["body_paint"].pose(t).position[0] for t in (0.0, 0.5, 1.0, 1.5)]
    np.testing.assert_allclose(along, [2, 3, 4, 5], atol=1e-6)
    assert set(scene.objects) == {"body_paint"}
    assert shapes_of(scene)["mesh_paint"]["corners"][:, 2].max() == pytest.approx(CORNERS[:, 1].max() + 4)


@pytest.mark.parametrize("times", [[0.0], [0.0, 1.0]])
def test_an_animation_that_holds_still_poses_its_node(times: list[float], tmp_path: Path) -> None:
    """What it says counts, not the node's own place: so viewers show it."""
    gltf = Gltf()
    own = {"translation": [7, 0, 0], "scale": [3.0, 3.0, 3.0]}
    child = gltf.node(root=False, mesh=quad(gltf, material=gltf.material()), scale=[2.0, 1.0, 1.0])
    node = gltf.node(children=[child], **own)
    gltf.animate(node, "translation", times, [[1, 0, 0]] * len(times))
    gltf.animate(node, "rotation", times, [[0, 0, np.sqrt(0.5), np.sqrt(0.5)]] * len(times))
    scene = saved(gltf, tmp_path)
    assert scene.objects == {}
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    expected = (CORNERS * [2, 1, 1] * 3 @ quarter.T + [1, 0, 0]) @ TURN.T
    np.testing.assert_allclose(shapes_of(scene)["mesh_paint"]["corners"], expected[FACES.ravel()], atol=1e-5)


def test_a_quaternion_of_length_0_turns_nothing_and_is_told(tmp_path: Path) -> None:
    """As viewers take it; the node is where it would be without a rotation."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf), rotation=[0, 0, 0, 0], translation=[1, 2, 3])
    told = r"rotation is a quaternion of length 0 are not turned: 1 \(the first: nodes\[0\]\.rotation\)"
    with pytest.warns(SceneFileWarning, match=told):
        (shape,) = shapes_of(saved(gltf, tmp_path)).values()
    np.testing.assert_allclose(shape["corners"], (CORNERS + np.array([1, 2, 3]))[FACES.ravel()] @ TURN.T, atol=1e-6)


def test_quaternions_of_another_length_are_scaled_and_told(tmp_path: Path) -> None:
    """Of nodes, of copies and of keyframes; a place counts once."""
    half = np.sqrt(0.5)
    scenes = []
    for length in (1.0, 2.0):
        gltf = Gltf()
        gltf.node(mesh=quad(gltf, material=gltf.material()), rotation=[0, 0, length * half, length * half])
        turns = np.array([[0, 0, 0, 1], [0, 0, half, half]])
        gltf.animate(gltf.node(mesh=0, name="body"), "rotation", [0.0, 1.0], turns * [[1], [length / 1.25 + 0.2]])
        if length == 1:
            scenes.append(saved(gltf, tmp_path))
            continue
        told = "rotations by quaternions whose length is not 1, which are scaled to it: 2 (the first: "
        first = "animations[0].samplers[0].output; off by up to 1)"
        with pytest.warns(SceneFileWarning, match=re.escape(told + first) + "$"):
            scenes.append(saved(gltf, tmp_path))
    for name, shape in shapes_of(scenes[0]).items():
        np.testing.assert_allclose(shapes_of(scenes[1])[name]["corners"], shape["corners"], atol=1e-12)
    paths = [scene.objects["body_paint"] for scene in scenes]
    np.testing.assert_allclose(paths[1].rotations([0.3, 1.0]), paths[0].rotations([0.3, 1.0]), atol=1e-12)


def test_nodes_that_are_not_visible_are_not_there(tmp_path: Path) -> None:
    """With all that is within them (KHR_node_visibility)."""
    gltf = Gltf(extensionsUsed=["KHR_node_visibility"])
    child = gltf.node(root=False, mesh=quad(gltf, material=gltf.material("hidden")))
    gltf.node(children=[child], extensions={"KHR_node_visibility": {"visible": False}})
    gltf.node(mesh=quad(gltf, material=gltf.material("shown")), extensions={"KHR_node_visibility": {"visible": True}})
    assert set(shapes_of(saved(gltf, tmp_path))) == {"mesh_shown"}


def test_triangles_without_area_are_left_out_in_one_line(tmp_path: Path) -> None:
    """Of all primitives together; those of strips only turn corners."""
    gltf = Gltf()
    mesh = gltf.mesh(CORNERS, [[0, 1, 2], [0, 0, 2], [1, 1, 1]])
    strip = {"attributes": {"POSITION": 0}, "indices": gltf.array([0, 1, 2, 2, 3], "u2"), "mode": 5}
    gltf.document["meshes"][mesh]["primitives"].append(strip)
    gltf.node(mesh=mesh)
    told = r"triangles without area are left out: 2 \(the first: meshes\[0\]\.primitives\[0\]\)$"
    with pytest.warns(SceneFileWarning, match=told):
        scene = saved(gltf, tmp_path)
    (shape,) = shapes_of(scene).values()
    assert len(shape["corners"]) == 3 * 2


def broken(change: Callable[[Gltf], Any]) -> Gltf:
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material()))
    camera = with_camera(gltf)
    gltf.animate(camera, "translation", [0.0, 1.0], [[0, 0, 3], [1, 0, 3]])
    gltf.light({"type": "point"})
    change(gltf)
    return gltf


def put(kind: str, number: int, **values: Any) -> Callable[[Gltf], Any]:
    return lambda gltf: gltf.document[kind][number].update(values)


def in_primitive(**values: Any) -> Callable[[Gltf], Any]:
    return lambda gltf: gltf.document["meshes"][0]["primitives"][0].update(values)


def textured(uri: str) -> Callable[[Gltf], Any]:
    def change(gltf: Gltf) -> None:
        gltf.document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = gltf.texture({"uri": uri})

    return change


@pytest.mark.parametrize("grey_unknown", [False, True])
def test_an_image_is_found_by_the_end_of_its_name(tmp_path: Path, grey_unknown: bool) -> None:
    """Copied next to the file, it is taken, which is told once."""
    (tmp_path / "paint.png").write_bytes(png(np.full((2, 2, 3), 9)))
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(metallicFactor=0.0)))
    textured("../textures/paint%2Epng")(gltf)
    path = gltf.save(tmp_path / "scene.glb")
    with pytest.warns(SceneFileWarning) as told:
        scene = load_scene(path, grey_unknown=grey_unknown)
    assert tmp_path / "paint.png" in scene.files
    lines = [str(line.message) for line in told]
    assert len(lines) == 1
    assert lines[0].endswith("'../textures/paint.png' is taken to be 'paint.png' next to it")


def paint(**values: Any) -> Callable[[Gltf], Any]:
    return lambda gltf: gltf.document["materials"][0]["pbrMetallicRoughness"].update(values)


def copies(gltf: Gltf, **attributes: int) -> None:
    gltf.document["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}


def meshopt_alone(gltf: Gltf) -> None:
    gltf.document["extensionsUsed"] = ["EXT_meshopt_compression"]
    lacking = {"byteLength": 1000, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    gltf.document["buffers"] = [lacking]
    gltf.document["bufferViews"][0]["buffer"] = 1


BROKEN: dict[str, tuple[Callable[[Gltf], Any], str]] = {
    "version": (
        lambda gltf: gltf.document.update(asset={"version": "1.0"}),
        r"must be glTF 2\.0, got version '1\.0'; Blender and gltf-pipeline convert",
    ),
    "version as a number": (
        lambda gltf: gltf.document.update(asset={"version": 1}),
        r"must be glTF 2\.0, got version 1; Blender and gltf-pipeline convert",
    ),
    "images of another kind": (
        lambda gltf: gltf.document.update(extensionsRequired=["EXT_texture_avif"]),
        "extensionsRequired: 'EXT_texture_avif' is not read; export its textures as PNG, JPEG or WebP",
    ),
    "no mesh": (put("nodes", 0, mesh=7), r"nodes\[0\]\.mesh: must be a number of the 1 meshes, counted from 0, got 7"),
    "negative": (put("nodes", 0, mesh=-1), "got -1"),
    "word": (put("nodes", 0, translation=["a", 0, 0]), r"translation: must be 3 numbers .* got \['a', 0, 0\]"),
    "nan": (put("nodes", 0, scale=[float("nan"), 1, 1]), r"nodes\[0\]\.scale: must be 3 numbers"),
    "circle": (put("nodes", 0, children=[0]), r"nodes\[0\]: is within itself"),
    "shared child": (put("nodes", 1, children=[0]), "is within itself, or within two nodes"),
    "index": (lambda gltf: gltf.data.__setitem__(slice(80, 82), b"\xff\xff"), r"indices: name vertex 65535 of 4"),
    "points": (in_primitive(mode=9), r"primitives\[0\]\.mode: must be a number of a kind of primitives"),
    "no position": (in_primitive(attributes={}), "has no POSITION"),
    "count": (put("accessors", 0, count=1000), r"accessors\[0\]: 1000 elements of 12 bytes, 12 apart, exceed"),
    "huge": (put("accessors", 0, count=2**31 - 1), "exceed its bufferView"),
    "zeros": (put("accessors", 0, count=2**31 - 1, bufferView=None), "2147483647 elements of 3 numbers needs 48 GiB"),
    "type": (put("accessors", 0, type="VEC9"), "must have a componentType and a type"),
    "width": (put("accessors", 0, type="VEC2", count=4), r"must have 3 numbers each"),
    "view": (put("bufferViews", 0, byteLength=10**9), r"bufferViews\[0\]\.byteLength: must be a number of bytes"),
    "stride": (put("bufferViews", 0, byteStride=4), "12 bytes, 4 apart, exceed"),
    "skin": (put("nodes", 0, skin=0), r"nodes\[0\].skin: must be a number of the 0 skins"),
    "morph": (put("meshes", 0, weights=[0.5]), "has strengths of 1 morph targets, and its mesh has 0"),
    "morph of a node": (put("nodes", 0, weights=[0.5, 1]), "has strengths of 2 morph targets, and its mesh has 0"),
    "points of a mesh": (in_primitive(mode=0), "no triangles.*parts made of points, which .* left out: 1"),
    "lines": (in_primitive(mode=3), "no triangles.*parts made of lines, which .* left out: 1"),
    "meshopt data alone": (meshopt_alone, r"buffers\[1\]: has data by EXT_meshopt_compression alone"),
    "too bright": (paint(baseColorFactor=[1.01, 0, 0, 1]), r"baseColorFactor: must be 4 numbers from 0 to 1"),
    "too bright gloss": (
        lambda gltf: gltf.document["materials"][0].update(
            extensions={"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [2, 0, 0, 1]}}
        ),
        r"KHR_materials_pbrSpecularGlossiness: diffuseFactor: must be 4 numbers from 0 to 1",
    ),
    "quaternion of hardly any length": (
        put("nodes", 0, rotation=[0, 0, 0, 1e-9]),
        r"nodes\[0\]\.rotation: rotations must be",
    ),
    "keyframe of no length": (
        lambda gltf: gltf.animate(1, "rotation", [0.0, 0.5], np.array([[0, 0, 0, 1], [0, 0, 0, 0]])),
        r"samplers\[1\]\.output: rotations must be quaternions with a direction, got \[0\.0, 0\.0, 0\.0, 0\.0\]",
    ),
    "copies": (
        lambda gltf: copies(gltf, TRANSLATION=gltf.array(np.zeros((2, 3))), SCALE=gltf.array(np.ones((3, 3)))),
        r"nodes\[0\]: EXT_mesh_gpu_instancing: must have as many of each attribute, got 2 and 3",
    ),
    "no copies": (lambda gltf: copies(gltf), r"nodes\[0\]: EXT_mesh_gpu_instancing: must have attributes, got"),
    "no area": (
        lambda gltf: gltf.document["meshes"][0]["primitives"][0].update(indices=gltf.array([0, 0, 1], "u2")),
        r"no triangles: .* \(triangles without area are left out: 1 \(the first: meshes\[0\]\.primitives\[0\]\)\)",
    ),
    "no image that is read": (
        lambda gltf: gltf.document["materials"][0]["pbrMetallicRoughness"].update(
            baseColorTexture={"index": gltf.add("textures", {"extensions": {"EXT_texture_avif": {"source": 0}}})}
        ),
        r"baseColorTexture: has no image of a kind that is read \(PNG, JPEG, WebP, KTX2\)",
    ),
    "times": (
        lambda gltf: gltf.animate(1, "rotation", [1.0, 0.5], [[0, 0, 0, 1]] * 2),
        r"animations\[0\]\.samplers\[1\]\.input: times must increase, from -1e\+06 s at least to 1e\+06 s",
    ),
    "early times": (
        lambda gltf: gltf.animate(1, "rotation", [-2e6, 0.5], [[0, 0, 0, 1]] * 2),
        r"animations\[0\]\.samplers\[1\]\.input: times must increase",
    ),
    "spline": (
        lambda gltf: gltf.animate(1, "rotation", [0.0, 0.5], [[0, 0, 0, 1]] * 2, "CUBICSPLINE"),
        "must have 6 values for its times, got 2",
    ),
    "growing camera": (
        lambda gltf: gltf.animate(1, "scale", [0.0, 1.0], [[1, 1, 1], [2, 2, 2]]),
        "node node_1: its animation scales or shears it",
    ),
    "weights": (
        lambda gltf: gltf.animate(0, "weights", [0.0, 1.0], [0, 1]),
        r"nodes\[0\]: animates 1 morph targets, and its mesh has 0",
    ),
    "lens": (lambda gltf: gltf.document["cameras"][0]["perspective"].update(yfov=4.0), r"yfov: must be a number from"),
    "light": (lambda gltf: gltf.document["extensions"]["KHR_lights_punctual"]["lights"][0].update(type="disc"),
              "type: must be point, directional or spot, got 'disc'"),
    "dark": (lambda gltf: gltf.document["extensions"]["KHR_lights_punctual"]["lights"][0].update(intensity=-1),
             r"lights\[0\]\.intensity: must be a number from 0"),
    "outside": (textured("../secret.png"), r"images\[0\]: names '\.\./secret\.png', which lies outside"),
    "encoded outside": (textured("%2e%2e/secret.png"), "which lies outside of the scene's folder"),
    "root": (textured("/etc/passwd"), "which lies outside of the scene's folder"),
    "internet": (textured("https://example.org/a.png"), "must name a file in the scene's folder"),
    "windows": (textured("C:\\a.png"), "must name a file in the scene's folder"),
    "data": (textured("data:image/png;base64,####"), r"images\[0\]: is no base64"),
    "no image": (textured("data:image/png;base64,aGVsbG8="), "not an image that can be read as a texture"),
    "nothing": (lambda gltf: gltf.document.update(nodes=[{}] * 3, animations=[]), "it has no triangles"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"garbage", "a glTF file must begin with 'glTF' (binary) or be a JSON object, got b'garbage'"),
        (b"", "a glTF file must begin with 'glTF' (binary) or be a JSON object, got b''"),
        (b'{"asset":', "its JSON cannot be read: Expecting value: line 1 column 10 (char 9)"),
    ],
)
def test_what_is_no_gltf_file_is_told(tmp_path: Path, content: bytes, said: str) -> None:
    for name in ("bad.glb", "bad.gltf"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DecodeError, match=rf"^{re.escape(f'{tmp_path / name}: {said}')}$"):
            load_scene(tmp_path / name)


@pytest.mark.parametrize(("change", "said"), BROKEN.values(), ids=BROKEN)
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_broken_files_are_refused_by_file_and_place(
    tmp_path: Path, suffix: str, change: Callable[[Gltf], Any], said: str
) -> None:
    (tmp_path / "secret.png").write_bytes(png(np.zeros((2, 2, 3))))
    folder = tmp_path / "scene"
    folder.mkdir()
    path = broken(change).save(folder / f"broken{suffix}")
    with pytest.raises(DecodeError, match=said) as caught:
        load_scene(path)
    assert str(caught.value).startswith(str(folder))
    assert "\n" not in str(caught.value)


def test_a_glb_file_of_version_1_is_told_with_what_converts_it(tmp_path: Path) -> None:
    data = broken(lambda gltf: None).save(tmp_path / "former.glb").read_bytes()
    (tmp_path / "former.glb").write_bytes(data[:4] + (1).to_bytes(4, "little") + data[8:])
    with pytest.raises(DecodeError, match=r"former\.glb: must be glTF 2\.0, got a GLB .* 1; Blender and gltf-pipeline"):
        load_scene(tmp_path / "former.glb")


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(png(np.zeros((2, 2, 3))))
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "inside.png").symlink_to(tmp_path / "secret.png")
    with pytest.raises(DecodeError, match=r"'inside\.png' is a link to outside of the scene's folder"):
        load_scene(broken(textured("inside.png")).save(folder / "scene.gltf"))


def test_missing_files_say_who_names_them(tmp_path: Path) -> None:
    path = broken(textured("none.png")).save(tmp_path / "scene.gltf")
    with pytest.raises(FileNotFoundError, match=r"scene\.gltf: images\[0\]: the file 'none\.png' is not there"):
        load_scene(path)


def test_missing_textures_are_grey_where_the_user_says_so(tmp_path: Path) -> None:
    """Colours are grey; metal, normals and light of missing textures are left out. A missing buffer is refused."""
    gltf = Gltf()
    (tmp_path / "there.png").write_bytes(png(np.full((2, 2, 3), 200)))
    none, there = (gltf.texture({"uri": name}) for name in ("none.png", "there.png"))
    more = {"normalTexture": none, "emissiveTexture": none, "emissiveFactor": [1, 1, 1]}
    surface = {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 1.0, "metallicRoughnessTexture": none}
    of_paint = gltf.material("paint", more=more, baseColorTexture=none, **surface)
    gltf.node(mesh=quad(gltf, uv=UV, material=of_paint))
    whole = gltf.material("whole", baseColorTexture=there, roughnessFactor=1.0)
    gltf.node(mesh=quad(gltf, uv=UV, material=whole), translation=[0, 0, 1])
    with_camera(gltf)
    path = gltf.save(tmp_path / "scene.gltf", buffer="data.bin")
    with pytest.raises(FileNotFoundError, match=r"'none\.png' is not there; .* as grey: --grey-unknown"):
        load_scene(path)
    scene = load_scene(path, grey_unknown=True)
    assert {(look.what, look.of) for look in scene.lost_looks} == {(MISSING_NUMBERS, ("paint",)), (MISSING, ("paint",))}
    assert [file.name for file in scene.files] == ["data.bin", "there.png"]
    with variant(SCALAR) as (mi, _):
        shapes = {shape.id(): shape for shape in load_scene_source(scene.source(), mi).shapes()}
        assert not any(shape.is_emitter() for shape in shapes.values())
        (colour,) = (value for name, value in mi.traverse(shapes["mesh_paint"].bsdf()) if "reflectance" in name)
    np.testing.assert_allclose(np.ravel(colour), 0.5)
    (tmp_path / "data.bin").unlink()
    with pytest.raises(FileNotFoundError, match=r"buffers\[0\]: the file 'data\.bin' is not there$"):
        load_scene(path, grey_unknown=True)


def test_one_mesh_shown_too_often_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file cannot ask for any amount of memory."""
    monkeypatch.setattr(gltf_mesh, "MOST_TRIANGLES", 7)
    gltf = Gltf()
    mesh = quad(gltf)
    for _ in range(4):
        gltf.node(mesh=mesh)
    with pytest.raises(DecodeError, match=r"nodes\[3\]: a scene may have 7 triangles"):
        saved(gltf, tmp_path)


def test_files_next_to_it_are_known(tmp_path: Path) -> None:
    """For meta.json: the buffer and the image, each once."""
    (tmp_path / "paint.png").write_bytes(png(np.zeros((2, 2, 3))))
    gltf = broken(textured("paint.png"))
    scene = load_scene(gltf.save(tmp_path / "scene.gltf", buffer="scene data.bin"))
    assert set(scene.files) == {tmp_path / "paint.png", tmp_path / "scene data.bin"}
