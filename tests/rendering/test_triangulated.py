"""Round shapes, instances, and textures with hard edges, for the renderers without noise."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene, load_scene
from davis_rs._mitsuba.variants import FAST, load_scene_source, variant
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render import scene_cache
from davis_rs.render.choice import make_renderer, why_not_noise_free
from davis_rs.render.closest_view import ClosestView
from davis_rs.render.curves import CURVES, Curves, curve_mesh
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.motion.scene_motion import STILL
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.round_meshes import MOST_TRIANGLES, OUTLINE_PX, round_mesh
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


BENDS = """\
-1 0 0 .1
-.4 .4 .2 .2
.1 -.3 .1 .1
.5 .4 -.2 .15
1 .2 .3 .1
1.4 .1 .8 .1

-.7 -.4 .1 .1
-.3 -.9 0 .05
.2 -.6 0 .1
1 -1 0 .2
"""
"""Two curves, none of which bends more tightly than it is thick."""


LENGTHWISE = np.array([[6, 0, 0.3], [0, 18.7, 0.1], [0, 0, 1]])
"""No edge of a texture lies on a ball, all of which has one coordinate along the curve."""


def curve(kind: str, tmp_path: Path, points: str = BENDS, **parts: Any) -> Parts:
    file = tmp_path / "curve.txt"
    file.write_text(points)
    return {"type": kind, "filename": str(file), "bsdf": board(to_uv=LENGTHWISE), **parts}


@pytest.mark.few(1)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", CURVES)
def test_curves_look_as_mitsubas(kind: str, tmp_path: Path) -> None:
    """Outline, shading, shadow and texture, into open ends too; how many triangles there are is told. What falls
    through open ends lights no floor here."""
    shape = curve(kind, tmp_path, to_world=matrix((1, 0.2, 0), (0, 1, 0), (0, 0, 1.5)))
    floor = {"floor": {"type": "rectangle", "to_world": matrix(at=(0, 0, -1))}} if kind == "linearcurve" else {}
    scene = scene_of(shape=shape, **floor)
    off = differences(scene)
    assert np.sqrt((off**2).mean()) < 0.03
    assert abs(off.mean()) < 2e-3
    assert "1 shape made of " in make_renderer(scene, CAMERA).reason


@pytest.mark.few(1)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("at", [(0.4, -1.5, 1.6), (0.2, 1.9, 0.9), (0.5, 1.0, -1.9)])
def test_curves_are_where_mitsubas_are(kind: str, at: tuple[float, float, float], tmp_path: Path) -> None:
    """Depth and normals at pixels, and the area between both outlines: less than 0.02 px times their length. They are
    not seen along themselves, where Mitsuba misses some of their rim."""
    camera = Camera(900, 700, 700.0, 700.0, 449.5, 349.5)
    ahead = -np.array(at) / np.linalg.norm(at)
    right = np.cross(ahead, [0, 0, 1.0])
    axes = np.stack([right / np.linalg.norm(right), np.cross(ahead, right / np.linalg.norm(right)), ahead], 1)
    pose = Pose(at, Rotation.from_matrix(axes).as_quat())
    path = SegmentTrajectory(pose, pose, 1.0)
    scene = replace(scene_of(shape=curve(kind, tmp_path)), trajectory=path, camera=camera)
    seen = SceneSurfaces(scene, camera).frame(Views.at_rest([pose]))
    with variant(FAST) as (mi, _):
        rays = camera.rays(np.stack(np.meshgrid(np.arange(900.0), np.arange(700.0)), -1).reshape(-1, 2))
        rays = np.concatenate([rays, np.ones((len(rays), 1))], 1)
        towards = mi.Vector3f((rays @ axes.T).T.astype(np.float32))
        found = load_scene_source(scene.source(), mi).ray_intersect(mi.Ray3f(mi.Point3f(*at), towards))
        depth, normal = np.array(found.t), np.array(found.sh_frame.n).T @ axes
    theirs, ours = np.isfinite(depth), np.isfinite(seen.depth)
    picture = theirs.reshape(700, 900)
    outline = (picture[1:] != picture[:-1]).sum() + (picture[:, 1:] != picture[:, :-1]).sum()
    assert outline > 1000
    assert (theirs != ours).sum() < OUTLINE_PX * outline
    both = theirs & ours
    # At an outline before another part of the curves the one or the other is hit.
    off_px = np.abs(depth[both] - seen.depth[both]) * 700 / depth[both]
    assert np.mean(off_px > 0.5) < 0.01
    assert np.median(off_px) < OUTLINE_PX
    turned = np.degrees(np.arccos(np.clip((normal * seen.normal).sum(1)[both], -1, 1)))
    assert np.mean(turned > 1.5) < 0.01
    assert np.median(turned) < 0.3


def test_textures_of_curves_follow_mitsubas_turns() -> None:
    """Where a spline comes near the upright, its texture turns at once and its circles do not; no triangle has texture
    coordinates of a whole turn or more."""
    points = np.array([[0, 0, -2, 0.1], [0, 0, -1, 0.1], [0.02, 0, 0, 0.1], [0.1, 0.3, 1, 0.1], [1, 0.6, 1, 0.1]])
    made = curve_mesh(Curves(np.array([*points, *points]), np.array([0, 1, 5, 6]), is_spline=True), np.full(4, 200.0))
    assert made is not None
    u = made.mesh.uv[made.mesh.faces, 0]
    assert u.min() > -0.1
    assert u.max() < 1.1
    assert np.unique(np.floor(made.mesh.uv[:, 0])).size > 1
    alone = curve_mesh(Curves(points, np.array([0, 1]), is_spline=True), np.full(2, 200.0))
    assert alone is not None
    assert len(made.mesh.faces) == 2 * len(alone.mesh.faces)


@pytest.mark.parametrize("is_spline", [False, True])
@pytest.mark.parametrize("px", [3.0, 100.0, 1e4, np.inf])
def test_curves_are_as_fine_as_triangles_allow_and_it_is_told(is_spline: bool, px: float) -> None:
    points = np.array([line.split() for line in BENDS.splitlines() if line], float)
    firsts = np.array([0, 1, 2, 6] if is_spline else [0, 1, 2, 3, 4, 6, 7, 8])
    made = curve_mesh(Curves(points, firsts, is_spline), np.full(len(firsts), px))
    assert made is not None
    assert len(made.mesh.faces) <= MOST_TRIANGLES
    assert (made.off_px <= OUTLINE_PX) == (px <= 100)
    unknown = curve_mesh(Curves(points, firsts, is_spline), None)
    assert unknown is not None
    assert np.isnan(unknown.off_px)
    corners = made.mesh.vertices[made.mesh.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert (np.einsum("ij,ikj->ik", facing, made.normals[made.mesh.faces]) > 0.8).all()


def test_splines_are_as_far_from_their_middle_as_their_radius() -> None:
    """At the middles and edges of triangles, where they are off most."""
    points, px = np.array([line.split() for line in BENDS.splitlines()[:6]], float), 150.0
    made = curve_mesh(Curves(points, np.arange(3), is_spline=True), np.full(3, px))
    assert made is not None
    spline = BSpline(np.arange(-3.0, 7.0), points, 3)(np.linspace(0, 3, 30_001))
    corners = made.mesh.vertices[made.mesh.faces][::7]
    places = np.concatenate([corners.mean(1), *((corners[:, i] + corners[:, i - 1]) / 2 for i in range(3))])
    distance, nearest = cKDTree(spline[:, :3]).query(places)
    inside = (nearest > 0) & (nearest < 30_000)  # at open ends the nearest point of the middle is not beside
    off_px = np.abs(distance - spline[nearest, 3])[inside] * px
    assert off_px.max() < made.off_px * 1.02 <= OUTLINE_PX * 1.02
    assert off_px.max() > 0.4 * made.off_px


@pytest.mark.parametrize("is_spline", [False, True])
def test_too_many_segments_stay_curves(is_spline: bool) -> None:
    for count, fits in ((400, True), (2000, is_spline), (5000, False)):
        points = np.stack([np.arange(count + 4.0), np.zeros(count + 4), np.zeros(count + 4), np.ones(count + 4)], 1)
        made = curve_mesh(Curves(points, np.arange(count), is_spline), np.full(count, 100.0))
        assert (made is not None) == fits
        assert made is None or len(made.mesh.faces) <= MOST_TRIANGLES


@pytest.mark.parametrize(
    ("points", "reach"),
    [
        ("0 0 0 1\n0.5 0 0 .2", 1.0),  # one ball holds the other
        ("0.5 0 0 .2\n0 0 0 1", 1.0),
        ("0 0 0 .5\n0 0 0 .5", 0.5),  # nothing between
        ("0 0 0 .5\n0 0 0 .5\n0 0 0 1", 1.0),
        ("0 0 0 0\n1 0 0 0.5", 1.5),  # a tip
    ],
)
def test_balls_within_each_other(points: str, reach: float) -> None:
    """Every direction from the middle of the largest ball meets its surface; nothing lies beyond."""
    controls = np.array([line.split() for line in points.splitlines()], float)
    made = curve_mesh(Curves(controls, np.arange(len(controls) - 1), is_spline=False), None)
    assert made is not None
    vertices, faces = made.mesh.vertices, made.mesh.faces
    assert np.isfinite(vertices).all()
    assert np.isfinite(made.normals).all()
    assert np.linalg.norm(vertices[faces], axis=-1).max() == pytest.approx(reach, rel=1e-3)
    corners = vertices[faces] - controls[controls[:, 3].argmax(), :3]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume >= 4 / 3 * np.pi * controls[:, 3].max() ** 3 * 0.99


def test_splines_that_stand_still() -> None:
    """Control points that are one another's, at an end or all of them, have a direction all the same."""
    end = np.array([[0, 0, 0, 1.0]] * 4 + [[1, 0, 0, 1.0], [3, 0, 0, 1.0]])
    for points in (end, end[:4]):
        made = curve_mesh(Curves(points, np.arange(len(points) - 3), is_spline=True), None)
        assert made is not None
        np.testing.assert_allclose(np.linalg.norm(made.normals, axis=1), 1.0)
        assert np.isfinite(made.mesh.vertices).all()
        assert np.isfinite(made.mesh.uv).all()


def test_what_is_said_of_curves(tmp_path: Path) -> None:
    """Of too many segments, of thin air, and by the table kernel, which does not see through open ends."""
    many = "".join(f"{x} 0 0 .1\n" for x in range(5001))
    told = "; ".join(map(str, why_not_noise_free(scene_of(hair=curve("linearcurve", tmp_path, many)))))
    assert told == "shape 'hair' is a linearcurve of 5,000 segments, too many for 50,000 triangles: give it as a mesh"
    air = curve("linearcurve", tmp_path, "0 0 0 0\n1 0 0 -1")
    assert "is a linearcurve" in str(why_not_noise_free(scene_of(hair=air))[0])
    tube = scene_of(tube=curve("bsplinecurve", tmp_path))
    assert "px from their outlines" not in native(tube).reason
    inside = SegmentTrajectory(Pose([0, 0, 0.1], DOWN.quaternion), DOWN, 1.0)
    assert "px from their outlines" in native(replace(tube, trajectory=inside)).reason
    assert SceneSurfaces(tube, CAMERA).names == ("tube",)
    with pytest.raises(ValueError, match="shape 'tube' is a bsplinecurve, through whose open ends only the native"):
        make_renderer(tube, CAMERA, kind="table")


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
