"""Round shapes, instances, and textures with hard edges, for the renderers without noise."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene, load_scene
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render import scene_cache
from davis_rs.render.choice import make_renderer
from davis_rs.render.closest_view import ClosestView
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.motion.scene_motion import STILL
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.primitives import MOST_TRIANGLES, OUTLINE_PX, round_mesh
from davis_rs.render.scene_tables.sharp_textures import RAMP_PX, divide
from davis_rs.render.truth.scene_surfaces import SceneSurfaces
from long_form import long_values

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
DOWN = Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
"""A camera three metres above the origin, looking down."""

Parts = dict[str, Any]


def matrix(*columns: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0)) -> npt.NDArray[np.float64]:
    made = np.eye(4)
    made[:3, :3] = np.array(columns).T if columns else np.eye(3)
    made[:3, 3] = at
    return made


def scene_of(**parts: Any) -> Scene:
    content = {
        "type": "scene",
        "integrator": {"type": "direct"},
        "lamp": {"type": "point", "position": [0.6, 0.4, 2.5], "intensity": 9.0},
        **parts,
    }
    path = SegmentTrajectory(DOWN, Pose([0.3, 0.0, 3.0], DOWN.quaternion), 1.0)
    return Scene("made", lambda: content, camera=CAMERA, trajectory=path)


def board(**changes: Any) -> Parts:
    colours = {"color0": {"type": "rgb", "value": [0.9, 0.5, 0.1]}, "color1": 0.05}
    return {"type": "diffuse", "reflectance": {"type": "checkerboard", **colours, **changes}}


def picture(**changes: Any) -> Parts:
    data = np.random.RandomState(3).uniform(0, 1, (3, 4, 3)).astype(np.float32)
    to_uv = np.array([[2.3, 0.4, 0.2], [-0.3, 1.7, -0.4], [0, 0, 1.0]])
    return {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "data": data, "to_uv": to_uv, **changes}}


def coloured(kind: str) -> Any:
    """Two triangles with a colour at each vertex, or one each."""
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": kind}})
    mesh = mi.Mesh("mesh", 4, 2, properties, has_vertex_normals=False, has_vertex_texcoords=False)
    buffers = mi.traverse(mesh)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0.2], [-1, 1, 0]], np.float32)
    buffers["vertex_positions"] = type(buffers["vertex_positions"])(corners.ravel())
    buffers["faces"] = type(buffers["faces"])(np.array([0, 1, 2, 0, 2, 3], np.uint32))
    buffers.update()
    colours = np.random.RandomState(5).uniform(0, 1, ((4 if kind.startswith("vertex") else 2), 3))
    mesh.add_attribute(kind, 3, colours.astype(np.float32).ravel())
    return mesh


TEXTURES: dict[str, Any] = {
    "checkerboard": board(),
    "checkerboard, turned": board(to_uv=np.array([[3.1, 1.2, 0.3], [-1.0, 2.2, 0.1], [0, 0, 1.0]])),
    "two-sided checkerboard": {"type": "twosided", "nested": board(to_uv=np.diag([4.0, 2.0, 1.0]))},
    **{f"nearest, {wrap}": picture(filter_type="nearest", wrap_mode=wrap) for wrap in ("repeat", "clamp", "mirror")},
}


def differences(scene: Scene, kind: str = "native") -> npt.NDArray[np.float64]:
    """Return how far log luma of a renderer without noise lies from Mitsuba's, whose rays are random."""
    views = Views.at_rest([DOWN])
    ours = make_renderer(scene, CAMERA, rays_per_pixel=64, kind=kind)
    assert not isinstance(ours, IntegratorRenderer)
    theirs = make_renderer(scene, CAMERA, rays_per_pixel=1024, kind="integrator")
    return np.log(ours.luma(views)[0] + 0.01) - np.log(theirs.luma(views)[0] + 0.01)


@pytest.mark.few(1)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", ["native", *long_values("table")])
@pytest.mark.parametrize("name", TEXTURES)
def test_textures_with_hard_edges_look_as_mitsubas(name: str, kind: str) -> None:
    off = differences(scene_of(floor={"type": "rectangle", "bsdf": TEXTURES[name]}), kind)
    assert np.sqrt((off**2).mean()) < 0.02
    assert abs(off.mean()) < 1e-3


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", ["vertex_color", "face_color"])
def test_colours_of_vertices_and_faces_look_as_mitsubas(kind: str) -> None:
    """Linear between vertices; of one colour on each face."""
    scene = scene_of()
    light = scene.source()
    assert isinstance(light, dict)
    scene = replace(scene, source=lambda: {**light, "mesh": coloured(kind)})
    off = differences(scene)
    assert np.sqrt((off**2).mean()) < 0.02
    assert abs(off.mean()) < 1e-3


def test_edges_are_as_narrow_as_asked_for_or_the_width_is_told() -> None:
    small = divide((0.5, 40.0), 2)
    assert (small.columns, small.rows) == (32, 2048)
    assert small.width_px <= RAMP_PX
    large = divide((4000.0, 4000.0), 2)
    assert large.columns * large.rows == 1 << 22
    assert large.width_px == pytest.approx(4000 / 2048)
    assert divide((1e3, 1e3), 1, texels=1 << 23)[:2] == (1, 1)
    assert np.isinf(divide((np.inf, np.inf), 2).width_px)
    assert np.isnan(divide(None, 2).width_px)
    far = scene_of(floor={"type": "rectangle", "bsdf": board(to_uv=np.diag([0.05, 0.05, 1.0]))})
    near = scene_of(floor={"type": "rectangle", "bsdf": board(to_uv=np.diag([9, 9, 1.0]))})
    assert "hard edges of textures are up to" in make_renderer(far, CAMERA).reason
    assert "hard edges" not in make_renderer(near, CAMERA).reason


ROUND: dict[str, Parts] = {
    "sphere": {"type": "sphere", "center": [0.1, -0.2, 0.3], "radius": 0.7, "bsdf": board(to_uv=np.diag([6, 4, 1.0]))},
    "sphere from within": {"type": "sphere", "radius": 4.0, "flip_normals": True, "bsdf": board()},
    "mirrored sphere": {
        "type": "sphere",
        "to_world": matrix((0, 0.7, 0), (0.7, 0, 0), (0, 0, 0.7)),
        "bsdf": board(to_uv=np.diag([6, 4, 1.0])),
    },
    "disk": {
        "type": "disk",
        "to_world": matrix((0.9, 0.1, 0.2), (0, 0.6, 0), (0, 0, 1)),
        "bsdf": board(to_uv=np.diag([3, 6, 1.0])),
    },
    "disk from below": {"type": "disk", "flip_normals": True, "bsdf": {"type": "twosided", "nested": board()}},
    "cylinder": {
        "type": "cylinder",
        "p0": [-0.8, 0, 0],
        "p1": [0.8, 0.1, 0.2],
        "radius": 0.4,
        "bsdf": board(to_uv=np.diag([6, 4, 1.0])),
    },
    "open cylinder": {
        "type": "cylinder",
        "p0": [0, 0, -1],
        "p1": [0, 0, 0.4],
        "radius": 0.9,
        "flip_normals": True,
        "bsdf": {"type": "twosided", "nested": board(to_uv=np.diag([6, 4, 1.0]))},
    },
}


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", ["native", *long_values("table")])
@pytest.mark.parametrize("name", ROUND)
def test_round_shapes_look_as_mitsubas(name: str, kind: str) -> None:
    """Outline, shading and texture; front and back; how many triangles there are is told."""
    scene = scene_of(floor={"type": "rectangle", "to_world": matrix(at=(0, 0, -1))}, shape=ROUND[name])
    off = differences(scene, kind)
    assert np.sqrt((off**2).mean()) < 0.03
    assert abs(off.mean()) < 2e-3
    chosen = make_renderer(scene, CAMERA)
    assert isinstance(chosen, NativeRenderer)
    assert "1 shape made of " in chosen.reason


@pytest.mark.parametrize("kind", ["sphere", "disk", "cylinder"])
@pytest.mark.parametrize("radius_px", [0.5, 30.0, 150.0, 1e9])
def test_outlines_are_within_a_fiftieth_of_a_pixel_or_it_is_told(kind: str, radius_px: float) -> None:
    """Between corners that lie outside of the true circle, and middles of sides that lie inside."""
    mesh, normals, off_px = round_mesh(kind, radius_px)
    assert len(mesh.faces) <= MOST_TRIANGLES
    assert (off_px <= OUTLINE_PX) == (radius_px < 1000)
    corners = mesh.vertices[mesh.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert (np.einsum("ij,ikj->ik", facing, normals[mesh.faces]) > 0.9).all()
    across = slice(0, 3 if kind == "sphere" else 2)
    reach = np.linalg.norm(corners[..., across], axis=-1)
    if kind == "disk":
        sides = (corners[:, :, across].mean(1), reach)
        deepest = np.linalg.norm((corners[:, 1, across] + corners[:, 2, across]) / 2, axis=-1).min()
    else:
        sides = (facing, reach)
        deepest = np.einsum("ij,ij->i", facing[:, across], corners[:, 0, across]).min()
    assert len(sides[0])
    assert (reach.max() - 1) * radius_px <= off_px * 1.001
    assert (1 - deepest) * radius_px <= off_px * 1.001


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_instances_are_copies_of_all_shapes_of_their_group() -> None:
    """Each where it belongs, a mirrored one too; a sphere and a cube, which have no names."""
    group = {
        "type": "shapegroup",
        "cube": {
            "type": "cube",
            "to_world": matrix((0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.2)),
            "bsdf": board(),
            "face_normals": True,
        },
        "ball": {"type": "sphere", "radius": 0.25, "center": [0.0, 0.4, 0.0]},
    }
    first = matrix((1, 0.3, 0), (-0.3, 1, 0), (0, 0, 1), at=(-0.6, 0, 0))
    second = matrix((-1.3, 0, 0), (0, 1, 0), (0, 0, 1), at=(0.6, 0, 0.2))
    scene = scene_of(
        floor={"type": "rectangle", "to_world": matrix(at=(0, 0, -1))},
        group=group,
        **{
            name: {"type": "instance", "nested": {"type": "ref", "id": "group"}, "to_world": pose}
            for name, pose in (("first", first), ("second", second))
        },
    )
    off = differences(scene)
    assert np.sqrt((off**2).mean()) < 0.03
    assert abs(off.mean()) < 2e-3
    names = SceneSurfaces(scene, CAMERA).names
    assert names == ("floor", "first_0", "first_1", "second_0", "second_1")


WITHOUT_NAMES = """<scene version="3.0.0"><integrator type="direct"/><emitter type="point"/>
<shape type="shapegroup" id="pair"><shape type="sphere"/><shape type="cube"/></shape>
<shape type="rectangle" id="floor"/><shape type="sphere"/><shape type="instance"><ref id="pair"/></shape></scene>"""


def test_shapes_without_names_stay_so(tmp_path: Path) -> None:
    """All of a group are there, although they are called alike; nothing gets a name that the file does not have."""
    file = tmp_path / "scene.xml"
    file.write_text(WITHOUT_NAMES)
    assert SceneSurfaces(load_scene(file), CAMERA).names == ("floor", "", "", "")


@pytest.mark.long
def test_a_nearer_path_gets_more_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the tables of the scene are kept; for the same path they are the same."""
    monkeypatch.setattr(scene_cache, "_cache", OrderedDict())
    far = scene_of(ball={"type": "sphere", "radius": 0.5, "bsdf": board(to_uv=np.diag([9, 9, 1.0]))})
    near = replace(far, trajectory=SegmentTrajectory(DOWN, Pose([0.0, 0.0, 0.8], DOWN.quaternion), 1.0))
    counts = [sum(native(scene).table.counts) for scene in (far, near, far)]
    assert counts[0] == counts[2] < counts[1]
    assert native(far).table is native(far).table


def native(scene: Scene) -> NativeRenderer:
    renderer = make_renderer(scene, CAMERA)
    assert isinstance(renderer, NativeRenderer)
    return renderer


@pytest.mark.usefixtures("llvm")
@pytest.mark.long
def test_light_of_a_round_lamp_is_baked() -> None:
    """A sphere that shines keeps the name of its light."""
    ball = {"type": "sphere", "center": [0, 0, 1.2], "radius": 0.2, "emitter": {"type": "area", "radiance": 8.0}}
    scene = scene_of(floor={"type": "rectangle", "bsdf": board()}, ball=ball)
    off = differences(scene, "baked")
    assert np.sqrt((off**2).mean()) < 0.05
    assert abs(off.mean()) < 5e-3


def test_the_bound_on_pixels_holds_between_instants_and_for_objects_that_come_closer() -> None:
    path = SegmentTrajectory(DOWN, Pose([0.0, 0.0, 1.0], DOWN.quaternion), 1.0)
    scene = replace(scene_of(), trajectory=path)
    view = ClosestView(scene, CAMERA, STILL)
    triangle = np.array([[[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0]]])
    [found] = view.pixels_per_metre(triangle, "floor")
    at_corner = 1 + (24 / 40) ** 2 + (18 / 40) ** 2
    assert 40 * at_corner <= found < 40 * at_corner * 1.02
    [touched] = view.pixels_per_metre(triangle + np.array([0, 0, 1.0]), "floor")
    assert touched == np.inf
    fast = SegmentTrajectory(Pose([-64.0, 0, 0.3], DOWN.quaternion), Pose([64.0, 0, 0.3], DOWN.quaternion), 1.0)
    [passed] = ClosestView(replace(scene, trajectory=fast), CAMERA, STILL).pixels_per_metre(
        triangle * 0.01 + np.array([0.5, 0, 0]), "floor"
    )
    assert passed >= 40 / 0.3
    assert not ClosestView(replace(scene, trajectory=None, start=None), CAMERA, STILL).known
    assert view == ClosestView(scene, CAMERA, STILL)
    assert view != ClosestView(scene_of(), CAMERA, STILL)


def test_materials_of_instances_may_be_glossy() -> None:
    """As those of the same shape that stands for itself."""
    plastic = {"type": "plastic", "diffuse_reflectance": 0.3}
    alone = scene_of(ball={"type": "sphere", "radius": 0.8, "bsdf": plastic})
    group = {"type": "shapegroup", "ball": {"type": "sphere", "radius": 0.8, "bsdf": plastic}}
    copy = {"type": "instance", "group": {"type": "ref", "id": "group"}}
    views = Views.at_rest([DOWN])
    same = [
        make_renderer(scene, CAMERA, kind="native").luma(views) for scene in (alone, scene_of(group=group, copy=copy))
    ]
    assert np.ptp(same[0]) > 0.05
    np.testing.assert_allclose(same[1], same[0], rtol=1e-4, atol=1e-5)
