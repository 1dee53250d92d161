"""Meshes that deform: skins, morph targets and animated scales of glTF files, against the same meshes at rest."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from davis_rs import (
    Camera,
    DecodeError,
    Scene,
    SceneFileWarning,
    SegmentTrajectory,
    VertexKeyframes,
    load_scene,
    simulate,
)
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.geometry.pose import Pose
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.closest_view import ClosestView
from davis_rs.render.flow import OpticalFlow
from davis_rs.render.motion.scene_motion import SceneMotion
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.native.seen_places import seen_places
from davis_rs.render.rays.camera_rays import pixel_centres
from davis_rs.render.truth import lost_look_fractions
from davis_rs.render.truth.scene_surfaces import SceneSurfaces
from davis_rs.sampling.breaks import find_breaks
from davis_rs.sampling.displacement import DisplacementClock
from davis_rs.scene.deformation import Deformation
from davis_rs.scene.files.gltf_poses import NodePoses
from davis_rs.scene.lost_looks import BACKS
from davis_rs.scene.meshes import Mesh, mitsuba_mesh, shape
from gltf_files import Gltf

ROWS = 9
"""Rows of vertices of the strip, from the bottom up."""
HIGH = 2.0
END_S = 1.0


def strip() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """A strip in the plane z = 0, 0.6 m wide and 2 m high, which y points up along."""
    y = np.linspace(0.0, HIGH, ROWS)
    corners = np.stack([np.stack([np.full(ROWS, x), y, np.zeros(ROWS)], 1) for x in (-0.3, 0.3)], 1).reshape(-1, 3)
    first = 2 * np.arange(ROWS - 1)[:, None]
    faces = (first[:, None] + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
    return corners, faces


def bent(
    *, normals: bool = True, kind: str = "LINEAR", joints: Any = None, weights: Any = None, axis: Any = (0, 0, 1)
) -> Gltf:
    """A file whose strip bends at half of its height: the second joint turns by 60 degrees, then goes back."""
    gltf = Gltf()
    corners, faces = strip()
    of_second = np.clip(corners[:, 1] - 0.5, 0.0, 1.0)
    joints = np.tile([0, 1, 0, 0], (len(corners), 1)) if joints is None else joints
    weights = np.stack([1 - of_second, of_second, *np.zeros((2, len(corners)))], 1) if weights is None else weights
    more = {"normals": np.tile([0, 0, 1.0], (len(corners), 1))} if normals else {}
    mesh = gltf.mesh(corners, faces, material=gltf.material(baseColorFactor=[0.5, 0.5, 0.5, 1.0]), **more)
    attributes = gltf.document["meshes"][mesh]["primitives"][0]["attributes"]
    attributes |= {"JOINTS_0": gltf.array(joints, "u1"), "WEIGHTS_0": gltf.array(weights)}
    second = gltf.node(root=False, name="second", translation=[0, 1, 0])
    first = gltf.node(name="first", children=[second])
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, :3, 3] = [0, -1, 0]
    skin = gltf.add(
        "skins", {"joints": [first, second], "inverseBindMatrices": gltf.array(inverse.swapaxes(1, 2).reshape(2, 16))}
    )
    gltf.node(name="body", mesh=mesh, skin=skin, translation=[9, 9, 9])  # a skin's own node places nothing
    turn = Rotation.from_rotvec(np.radians([[0], [60], [0]]) * np.array(axis)).as_quat()
    gltf.animate(second, "rotation", [0.0, 0.4, END_S], turn, kind)
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.9, "aspectRatio": 4 / 3}})
    gltf.node(camera=camera, translation=[0.2, 1.0, 3.0])
    gltf.light({"type": "point", "intensity": 6000.0}, translation=[1.5, 2.0, 2.5])
    return gltf


def wall(gltf: Gltf) -> None:
    """A wall behind the strip, on which its shadow falls."""
    corners = np.array([[-4, -3, -0.8], [4, -3, -0.8], [4, 5, -0.8], [-4, 5, -0.8]])
    paint = gltf.material("wall", baseColorFactor=[0.8, 0.8, 0.8, 1.0])
    gltf.node(mesh=gltf.mesh(corners, [[0, 1, 2], [0, 2, 3]], material=paint))


def load(gltf: Gltf, folder: Path) -> Scene:
    return load_scene(gltf.save(folder / "scene.glb"))


def deformation_of(scene: Scene) -> tuple[str, Deformation]:
    ((name, deformation),) = scene.deformations.items()
    return name, deformation


def frozen(scene: Scene, t_s: float) -> Scene:
    """The scene as it is at a time, from a mesh of its own that is rigid."""
    name, deformation = deformation_of(scene)
    (mesh,) = deformation.meshes(np.array([t_s]))
    count = len(mesh.positions)

    def source() -> Any:
        given = dict(scene.source())  # type: ignore[arg-type]
        of = Mesh(mesh.positions, np.arange(count).reshape(-1, 3), np.zeros((count, 2)))
        return {**given, name: shape(of, np.full(3, 0.5), normals=mesh.normals)}

    return replace(scene, source=source, deformations={}, objects={})


def views_at(scene: Scene, *t_s: float) -> Views:
    return Views.along(scene.path, np.array(t_s))


def test_a_skin_bends_by_hand(tmp_path: Path) -> None:
    """At 0.2 s the upper joint has turned by 30 degrees; below half a metre nothing moves; z up is y up of the file."""
    scene = load(bent(), tmp_path)
    name, deformation = deformation_of(scene)
    assert (name, deformation.duration_s) == ("body_paint", END_S)
    assert "1 moving object, of which 1 deforms" in scene.note
    (mesh,) = deformation.meshes(np.array([0.2]))
    corners, faces = strip()
    joint = np.array([0, 1.0, 0])
    turned = joint + Rotation.from_euler("z", 30, degrees=True).apply(corners - joint)
    weight = np.clip(corners[:, 1] - 0.5, 0.0, 1.0)[:, None]
    expected = ((1 - weight) * corners + weight * turned)[faces.ravel()]
    np.testing.assert_allclose(mesh.positions, expected[:, [0, 2, 1]] * [1, -1, 1], atol=1e-6)
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, np.tile([0, -1.0, 0], (len(expected), 1)), atol=1e-9)
    before, after = deformation.meshes(np.array([0.2 - 1e-5, 0.2 + 1e-5]))
    (velocities,) = deformation.velocities(np.array([0.2]))
    np.testing.assert_allclose(velocities, (after.positions - before.positions) / 2e-5, atol=1e-6)
    assert list(deformation.breaks_s()) == [pytest.approx(0.4)]


@pytest.mark.few(4)
@pytest.mark.parametrize("t_s", [0.0, 0.13, 0.4, 0.77])
@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0)])
def test_it_looks_like_the_same_mesh_at_rest(tmp_path: Path, t_s: float, axis: tuple[int, int, int]) -> None:
    """Luma with shadows, by rays and by lines, depths and single pixels are those of a rigid mesh of that form.

    Once it is flat, once it has normals that turn with it.
    """
    gltf = bent(normals=axis[0] == 1, axis=axis)
    wall(gltf)
    scene = load(gltf, tmp_path)
    still = frozen(scene, t_s)
    # Other instants come first: what is seen depends on the time alone.
    views = views_at(scene, 0.9, t_s, 0.3)
    for pixel in ("rays", "lines"):
        ours, theirs = (
            make_renderer(each, scene.own_camera, kind="native", pixel=pixel, lattice_rays_per_pixel=8)
            for each in (scene, still)
        )
        luma, expected = ours.luma(views)[1], theirs.luma(views)[1]
        # Coordinates are rounded relative to other centres: a ray on an edge may see the neighbour.
        assert np.mean(np.abs(luma - expected) > 1e-4 * expected.max()) < 2e-3
        assert luma.std() > 0.1 * luma.mean()
        assert not np.allclose(luma, ours.luma(views)[0], rtol=0.05)
        np.testing.assert_array_equal(ours.luma(views[1:2])[0], luma)
        pixels = np.arange(0, luma.size, 97)
        np.testing.assert_array_equal(ours.samples(views, np.full_like(pixels, 1), pixels), luma.ravel()[pixels])
        depth, true = ours.depth(views)[1], theirs.depth(views)[1]
        assert np.mean(np.abs(depth - true) > 1e-4) < 2e-3


def test_mitsuba_sees_the_same(tmp_path: Path) -> None:
    """The integrators move the vertices of Mitsuba's own mesh."""
    gltf = bent()
    wall(gltf)
    scene = load(gltf, tmp_path)
    views = views_at(scene, 0.3, 0.0)
    native, mitsuba = (
        make_renderer(scene, scene.own_camera, kind=kind, rays_per_pixel=8) for kind in ("native", "integrator")
    )
    luma, theirs = native.luma(views), mitsuba.luma(views)
    assert np.sqrt(np.mean((luma - theirs) ** 2)) < 0.02 * theirs.mean()
    assert np.mean(np.abs(native.depth(views) - mitsuba.depth(views)) > 1e-3) < 2e-3
    assert not np.allclose(luma[0], luma[1], rtol=0.05)


def test_mitsuba_has_the_same_rates(tmp_path: Path) -> None:
    scene = load(bent(axis=(1, 0, 0)), tmp_path)
    views = views_at(scene, 0.2)
    native, mitsuba = (
        make_renderer(scene, scene.own_camera, kind=kind, rays_per_pixel=4) for kind in ("native", "integrator")
    )
    rate, theirs = (each.luma_and_rate(views)[1][0] for each in (native, mitsuba))
    inside = binary_erosion(np.isfinite(native.depth(views)[0]), iterations=3)
    strong = inside & (np.abs(rate) > 0.3 * np.abs(rate[inside]).max())
    assert strong.sum() > 300
    np.testing.assert_allclose(theirs[strong], rate[strong], rtol=0.1)


def test_parts_of_one_material_deform_together(tmp_path: Path) -> None:
    """Two primitives are one shape, each with its own vertices and joints."""
    gltf = bent(normals=False)
    corners, _ = strip()
    (part,) = gltf.document["meshes"][0]["primitives"]
    other = {**part["attributes"], "POSITION": gltf.array(corners + np.array([1.0, 0, 0]))}
    other["JOINTS_0"] = gltf.array(np.ones((len(corners), 4)), "u1")
    gltf.document["meshes"][0]["primitives"].append({**part, "attributes": other})
    _, deformation = deformation_of(load(gltf, tmp_path))
    at_rest, turned = (mesh.positions for mesh in deformation.meshes(np.array([0.0, 0.2])))
    first, second = np.split(at_rest, 2)
    np.testing.assert_allclose(second, first + np.array([1.0, 0, 0]), atol=1e-6)
    first, second = np.split(turned, 2)
    axis = Rotation.from_euler("y", -30, degrees=True)  # the file's z is -y here
    expected = axis.apply(np.split(at_rest, 2)[1] - np.array([0, 0, 1])) + np.array([0, 0, 1])
    np.testing.assert_allclose(second, expected, atol=1e-6)
    assert not np.allclose(first, second - np.array([1.0, 0, 0]), atol=0.05)


@pytest.mark.parametrize("inner", [True, False])
def test_joints_within_joints_that_turn(tmp_path: Path, inner: bool) -> None:
    """Velocities count the turn of the outer joint, and that of the inner one, or that it has none."""
    gltf = bent()
    if not inner:
        gltf.document["animations"] = [{"samplers": [], "channels": []}]
    turn = Rotation.from_rotvec(np.radians([[0, 0, 0], [40, 0, 0]])).as_quat()
    gltf.animate(1, "rotation", [0.0, END_S], turn)
    _, deformation = deformation_of(load(gltf, tmp_path))
    before, after = deformation.meshes(np.array([0.2 - 1e-5, 0.2 + 1e-5]))
    (velocities,) = deformation.velocities(np.array([0.2]))
    np.testing.assert_allclose(velocities, (after.positions - before.positions) / 2e-5, atol=1e-6)
    assert np.abs(velocities[:, 1:]).max(0).min() > 0.1
    assert (np.abs(velocities[:, 0]).max() > 0.1) == inner


def test_joints_that_step_next_to_some_that_turn(tmp_path: Path) -> None:
    """Of two joints with the same keyframes, each is interpolated in its own way."""
    _, plain = deformation_of(load(bent(), tmp_path))
    gltf = bent()
    turn = Rotation.from_rotvec(np.radians([[0, 0, 0], [40, 0, 0], [40, 0, 0]])).as_quat()
    gltf.animate(1, "rotation", [0.0, 0.4, END_S], turn, "STEP")
    _, deformation = deformation_of(load(gltf, tmp_path))
    for t_s, same in ((0.2, True), (0.5, False)):
        (mesh,), (expected,) = (each.meshes(np.array([t_s])) for each in (deformation, plain))
        assert np.allclose(mesh.positions, expected.positions, atol=1e-6) == same


def test_parts_that_come_closer_are_made_finer() -> None:
    """The bound on pixels per metre counts where the mesh comes, not only where it is at first."""
    corners = np.array([[-1, 0, 9], [1, 0, 9], [0, 1, 9.0]])
    keyframes = VertexKeyframes([0.0, 1.0], np.stack([corners, corners - [[0, 0, 7]]]))
    here = Pose([0, 0, 0], [0, 0, 0, 1])
    path = SegmentTrajectory(here, here, 1.0)
    scene = Scene("one", dict, trajectory=path, deformations={"one": keyframes})
    camera = scene.own_camera
    motion = SceneMotion({"one": path}, {}, {"one": keyframes.box()}, deformations={"one": keyframes})
    rigid = SceneMotion({"one": path}, {}, {"one": keyframes.box()})
    near, far = (ClosestView(scene, camera, of).pixels_per_metre(corners[None], "one")[0] for of in (motion, rigid))
    assert near >= camera.fx / 2
    assert far < 0.3 * near
    # What takes other lights keeps how meshes deform.
    assert motion.with_lights({}).deformations == motion.with_bends([0.1, 0.2]).deformations == {"one": keyframes}


def test_rates_are_those_of_luma(tmp_path: Path) -> None:
    """dY/dt counts the deformation: inside of surfaces it is the difference of frames close by."""
    scene = load(bent(axis=(1, 0, 0)), tmp_path)
    renderer = make_renderer(scene, scene.own_camera, kind="native", lattice_rays_per_pixel=8)
    _, rate = renderer.luma_and_rate(views_at(scene, 0.2))
    before, after = renderer.luma(views_at(scene, 0.2 - 2e-4, 0.2 + 2e-4))
    difference = (after - before) / 4e-4
    inside = binary_erosion(np.isfinite(renderer.depth(views_at(scene, 0.2))[0]), iterations=3)
    strong = inside & (np.abs(difference) > 0.3 * np.abs(difference[inside]).max())
    assert strong.sum() > 300
    np.testing.assert_allclose(rate[0][strong], difference[strong], rtol=0.02)


def test_flow_follows_the_surface(tmp_path: Path) -> None:
    """Flow of pixels on the mesh is how far their points move in 100 us; displacement follows them over 50 ms."""
    scene = load(bent(), tmp_path)
    surfaces = SceneSurfaces(scene, scene.own_camera)
    camera = scene.own_camera
    renderer = make_renderer(scene, camera, kind="native")
    step_s = 1e-4
    for t_s in (0.85, 0.2):
        seen = surfaces.frame(views_at(scene, t_s))
        on_mesh = np.flatnonzero(np.isfinite(seen.depth))
        assert len(on_mesh) > 1000
        moved = surfaces.displacement(views_at(scene, t_s, t_s + step_s)).pixels.reshape(-1, 2)[on_mesh]
        np.testing.assert_allclose(seen.flow[on_mesh], moved / step_s, atol=0.02 * np.abs(moved / step_s).max())
        assert np.linalg.norm(seen.flow[on_mesh], axis=1).max() > 50
    ours = renderer.flow(views_at(scene, 0.2))[0].reshape(-1, 2)[on_mesh]
    np.testing.assert_allclose(ours, seen.flow[on_mesh], atol=1e-3)
    some = on_mesh[::37]
    views = views_at(scene, 0.6, 0.2)
    single = surfaces.of_pixels(views, np.arange(len(some)) % 2, some)
    of_frames = [surfaces.frame(views, number) for number in (0, 1)]
    for column in ("depth", "flow", "normal"):
        both = np.stack([getattr(each, column)[some] for each in of_frames])
        np.testing.assert_array_equal(getattr(single, column), both[np.arange(len(some)) % 2, np.arange(len(some))])
    far = surfaces.displacement(views_at(scene, 0.2, 0.25))
    # The strip turns about a point half way up: what is above moves to the left, by up to a third of the image.
    assert far.pixels.reshape(-1, 2)[on_mesh, 0].min() < -5


def test_normals_and_occlusion_follow_the_form(tmp_path: Path) -> None:
    """Normals are those of a rigid mesh of that form; what the mesh covers later is occluded, and is not else."""
    gltf = bent(axis=(1, 0, 0))
    scene = load(gltf, tmp_path)
    views = views_at(scene, 0.3)
    ours, theirs = (SceneSurfaces(each, scene.own_camera).frame(views) for each in (scene, frozen(scene, 0.3)))
    both = np.isfinite(ours.depth) & np.isfinite(theirs.depth)
    assert np.percentile(np.abs(ours.normal[both] - theirs.normal[both]).max(1), 99) < 1e-4
    assert ours.normal[both].std(0).max() > 0.1
    gltf = bent()
    wall(gltf)
    scene = load(gltf, tmp_path)
    surfaces = SceneSurfaces(scene, scene.own_camera)
    occluded = surfaces.displacement(views_at(scene, 0.0, 0.4)).occluded
    number = 1 + surfaces.names.index("body_paint")
    before, after = (surfaces.frame(views_at(scene, t_s)).shape.reshape(occluded.shape) == number for t_s in (0.0, 0.4))
    covered = after & ~before
    assert covered.sum() > 300
    assert occluded[binary_erosion(covered)].all()
    assert not occluded[binary_erosion(~after & ~before)].any()


def one_sided(texture: bool) -> Scene:
    """A square before a lamp and a camera, seen from its front alone, in a texture or a colour; the mesh is a shape of
    its own."""
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])

    def source() -> Any:
        import mitsuba as mi

        texels = mi.TensorXf(np.linspace(0.2, 0.9, 48, dtype=np.float32).reshape(4, 4, 3))
        colour = {"type": "bitmap", "data": texels, "raw": True} if texture else {"type": "rgb", "value": 0.5}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": colour})
        uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
        return {
            "type": "scene",
            "lamp": {"type": "point", "position": [0.5, -3.0, 1.0], "intensity": 20.0},
            "square": mitsuba_mesh(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv), properties, None),
        }

    here = Pose([0, -4, 0], Rotation.from_euler("x", -90, degrees=True).as_quat())
    forms = np.stack([corners, corners + np.array([0.3, 0.5, 0.2]), corners[[1, 0, 3, 2]]])
    return Scene(
        "square",
        source,
        trajectory=SegmentTrajectory(here, here, 1.0),
        deformations={"square": VertexKeyframes([0.0, 0.5, 1.0], forms)},
    )


@pytest.mark.parametrize("texture", [True, False])
def test_textures_and_fronts_follow_the_form(texture: bool) -> None:
    """Texture coordinates stay with the vertices, and a surface with one side is seen from its front alone."""
    scene = one_sided(texture)
    renderer = make_renderer(scene, scene.own_camera, kind="native")
    luma = renderer.luma(views_at(scene, 0.0, 0.5, 1.0))
    rigid = replace(scene, deformations={}, objects={})
    at_rest = make_renderer(rigid, scene.own_camera, kind="native").luma(views_at(scene, 0.0))[0]
    assert at_rest.max() > 0.1
    np.testing.assert_allclose(luma[0], at_rest, atol=1e-5)
    # Half a metre farther away; at the end it has turned its back.
    assert 0 < luma[1].max() < luma[0].max()
    assert luma[2].max() == 0


@pytest.mark.long
def test_the_clock_knows_the_fastest_point(tmp_path: Path) -> None:
    """The path of the fastest pixel is at least as long as any point's of the mesh, and it ends with the motion; the
    end is a break."""
    scene = load(bent(), tmp_path)
    renderer = make_renderer(scene, scene.own_camera, kind="native")
    (box,) = renderer.motion.boxes
    _, deformation = deformation_of(scene)
    points = deformation.hull(np.array([0.0, 0.2, 0.4]))
    assert (box[0] <= points.min((0, 1)) + 1e-9).all()
    assert (box[1] >= points.max((0, 1)) - 1e-9).all()
    still = SegmentTrajectory(scene.path.pose(0.0), scene.path.pose(0.0), 2.0)
    clock = DisplacementClock(renderer, still, 2_000_000)
    views = Views.along(still, np.array([0.1, 0.11]))
    moved = SceneSurfaces(scene, scene.own_camera).displacement(views).pixels
    longest = np.nanmax(np.linalg.norm(moved, axis=2))
    first, second = clock.path_at(100_000), clock.path_at(110_000)
    assert longest <= second - first < 1.2 * longest
    assert longest > 0.5
    assert clock.path_at(1_200_000) == clock.path_at(1_900_000)
    breaks = list(find_breaks(still, renderer.motion, 0, 2_000_000))
    assert [item.before_us for item in breaks] == [400_000, 999_999]  # the file's float32 lies just after 0.4 s
    assert not any(item.jump for item in breaks)


@pytest.mark.parametrize("k1", [0.0, -0.15])
def test_the_clock_follows_a_mesh_before_a_moving_camera(k1: float, tmp_path: Path) -> None:
    """No point of the mesh is faster in the image than the clock, with the lens's distortion; and it is hardly slower.
    The camera comes nearer until a part of the mesh is out of view, and its turning counts."""
    scene = load(bent(), tmp_path)
    here = scene.path.pose(0.0)
    turned = Rotation.from_quat(here.quaternion) * Rotation.from_euler("xyz", [4, 7, -100], degrees=True)
    ahead = np.add(here.position, [0.1, -0.6 * here.position[1], 0.05])
    path = SegmentTrajectory(here, Pose(ahead, turned.as_quat()), 1.0)
    camera = Camera(120, 90, 100.0, 90.0, 59.5, 44.5, k1=k1)
    for true, told in clock_and_truth(scene, camera, path):
        assert true * (1 - 1e-3) <= told < 2.5 * true


def clock_and_truth(scene: Scene, camera: Camera, path: SegmentTrajectory) -> list[tuple[float, float]]:
    """How far the fastest point that is seen moves in some milliseconds, in pixels, and how far by the clock."""
    renderer = make_renderer(scene, camera, kind="native", rays_per_pixel=1)
    clock, surfaces = DisplacementClock(renderer, path, 1_000_000), SceneSurfaces(scene, camera)
    found = []
    for t_us in range(50_000, 1_000_000, 90_000):
        clock.path_at(t_us + 1_000)
        moved = surfaces.displacement(Views.along(path, np.array([t_us, t_us + 1_000]) * 1e-6)).pixels
        longest = float(np.nanmax(np.linalg.norm(moved, axis=2)))
        assert longest > 1e-3
        found.append((longest, clock.path_at(t_us + 1_000) - clock.path_at(t_us)))
    return found


@pytest.mark.parametrize(
    ("corners", "moved", "most"),
    [
        pytest.param([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]], [0, -1.5, 0], 1.5, id="larger than the view"),
        pytest.param([[-1, -9, -1], [1, -9, -1], [1, 3, -1], [-1, 3, -1]], [0.4, 0, 0], 9.0, id="below the camera"),
    ],
)
def test_the_clock_follows_what_is_partly_seen(corners: Any, moved: Any, most: float) -> None:
    """Where some corners are out of view, those parts of the mesh count that are in view; where some are behind the
    camera, no more than a bound is known."""
    scene = one_sided(False)
    camera, forms = Camera(64, 48, 50.0, 50.0, 31.5, 23.5), np.stack([corners, np.add(corners, moved)])
    scene = replace(scene, deformations={"square": VertexKeyframes([0.0, 1.0], forms)})
    for true, told in clock_and_truth(
        scene, camera, SegmentTrajectory(scene.path.pose(0.0), scene.path.pose(0.0), 1.0)
    ):
        assert true * (1 - 1e-3) <= told < most * true


def test_the_clock_knows_morph_targets(tmp_path: Path) -> None:
    """A part of a mesh that morphs is not slower than the clock says, where no joint moves."""
    gltf = bent()
    corners, _ = strip()
    bulge = np.zeros_like(corners)
    bulge[8:12, 0] = 0.5
    gltf.document["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": gltf.array(bulge)}]
    del gltf.document["animations"]
    gltf.animate(len(gltf.document["nodes"]) - 3, "weights", [0.0, 1.0], [0, 1.0])
    scene = load(gltf, tmp_path)
    here = scene.path.pose(0.0)
    camera = Camera(120, 90, 100.0, 90.0, 59.5, 44.5)
    for true, told in clock_and_truth(scene, camera, SegmentTrajectory(here, here, 1.0)):
        assert true * (1 - 1e-3) <= told < 3 * true


def assert_means(deformation: Deformation, times: Any) -> None:
    """Each vertex is a mean of the points that are told, and its velocity the mean of theirs by the same weights: no
    linear function of both is larger than at one of the points."""
    forms, moving = deformation.meshes(times), deformation.velocities(times)
    directions = np.random.default_rng(1).normal(size=(200, 2, 3)) * [[[1.0], [0.3]]]
    for form, velocities, points in zip(forms, moving, deformation.moving_points(times), strict=True):
        of_mesh = form.positions @ directions[:, 0].T + velocities @ directions[:, 1].T
        of_points = points.positions @ directions[:, 0].T + points.velocities @ directions[:, 1].T
        own = points.own_speed * np.linalg.norm(directions[:, 1], axis=1)
        assert (of_mesh.max(0) <= of_points.max(0) + own + 1e-9).all()
        assert np.linalg.norm(velocities, axis=1).max() > 0 or not (points.velocities.any() or points.own_speed)


def test_bounds_hold(tmp_path: Path) -> None:
    """No vertex is outside of the box, or faster than the bound, also with morph targets."""
    gltf = bent()
    corners, _ = strip()
    primitive = gltf.document["meshes"][0]["primitives"][0]
    bulge = np.zeros_like(corners)
    bulge[8:12, 2] = 0.5
    primitive["targets"] = [{"POSITION": gltf.array(bulge)}, {"POSITION": gltf.array(bulge[:, [2, 0, 1]])}]
    gltf.animate(len(gltf.document["nodes"]) - 3, "weights", [0.0, 0.3, 0.9], [0, 0, 1.0, -0.5, 0.2, 1.0])
    _, deformation = deformation_of(load(gltf, tmp_path))
    low, high = deformation.box()
    times = np.linspace(-0.1, 1.1, 61)
    fastest, hull = deformation.fastest(times), deformation.hull(times)
    reached = np.zeros(2)
    for i, (mesh, velocities) in enumerate(zip(deformation.meshes(times), deformation.velocities(times), strict=True)):
        for ends in ((low, high), (hull[i].min(0), hull[i].max(0))):
            assert (mesh.positions >= ends[0] - 1e-9).all()
            assert (mesh.positions <= ends[1] + 1e-9).all()
        speed = np.linalg.norm(velocities, axis=1).max()
        assert speed <= fastest[i] * (1 + 1e-9)
        reached = np.maximum(reached, [speed / max(fastest[i], 1e-9), speed])
    assert (reached > [0.3, 1.0]).all()
    assert (high - low < 2 * HIGH).all()
    assert_means(deformation, times)
    assert_means(deformation.retimed(0.1, 2.0), times)


def test_morph_targets_move_vertices(tmp_path: Path) -> None:
    """Four targets, whose strengths are no quaternion; those of the node come before those of the mesh."""
    gltf = Gltf()
    corners, faces = strip()
    mesh = gltf.mesh(corners, faces)
    shifts = 0.1 * np.eye(4, 3) + [0, 0, 0.05]
    primitive = gltf.document["meshes"][mesh]["primitives"][0]
    primitive["targets"] = [{"POSITION": gltf.array(np.tile(shift, (len(corners), 1)))} for shift in shifts]
    gltf.document["meshes"][mesh]["weights"] = [9, 9, 9, 9]
    node = gltf.node(mesh=mesh, name="face", weights=[0, 0, 0, 0], translation=[1, 0, 0])
    strengths = np.array([[0, 0, 0, 0], [1, 0.5, 0.25, 2.0], [0, 1, 0, 0]])
    gltf.animate(node, "weights", [0.0, 0.5, 1.0], strengths.ravel())
    _, deformation = deformation_of(load(gltf, tmp_path))
    (mesh_at,) = deformation.meshes(np.array([0.25]))
    moved = (corners + strengths[1] @ shifts / 2 + [1, 0, 0])[faces.ravel()]
    np.testing.assert_allclose(mesh_at.positions, moved[:, [0, 2, 1]] * [1, -1, 1], atol=1e-6)
    assert mesh_at.normals is None
    (velocities,) = deformation.velocities(np.array([0.75]))
    expected = (2 * (strengths[2] - strengths[1]) @ shifts)[[0, 2, 1]] * [1, -1, 1]
    np.testing.assert_allclose(velocities, np.tile(expected, (len(moved), 1)), atol=1e-6)
    assert deformation.fastest(np.array([0.75]))[0] >= np.linalg.norm(expected) > 0.1


def test_what_does_not_move_has_its_form_for_good(tmp_path: Path) -> None:
    """Strengths and joints that are not animated deform once, also in a mirror; light can be baked on such a mesh."""
    gltf = Gltf()
    corners, faces = strip()
    mesh = gltf.mesh(corners, faces, uv=corners[:, :2])
    gltf.document["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": gltf.array(corners)}]
    gltf.node(mesh=mesh, weights=[0.5], scale=[-1, 1, 1])
    still = bent()
    still.document["animations"] = []
    still.document["nodes"][0]["rotation"] = Rotation.from_euler("z", 30, degrees=True).as_quat().tolist()
    (tmp_path / "bent").mkdir()
    for scene, high in ((load(gltf, tmp_path), 1.5 * HIGH), (load(still, tmp_path / "bent"), 1 + 3**0.5 / 2 + 0.15)):
        assert not scene.deformations
        assert not scene.objects
        with variant(SCALAR) as (mi, _):
            (shape_of,) = (each for each in load_scene_source(scene.source(), mi).shapes() if each.is_mesh())
            at = np.array(shape_of.vertex_positions_buffer()).reshape(-1, 3)
            normal = np.array(shape_of.face_normal(0)).ravel()
        assert at[:, 2].max() == pytest.approx(high, abs=1e-5)
        assert normal[1] == pytest.approx(-1.0, abs=1e-5)


def test_cubic_strengths_stay_within_their_bound(tmp_path: Path) -> None:
    gltf = Gltf()
    corners, faces = strip()
    mesh = gltf.mesh(corners, faces)
    gltf.document["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": gltf.array(np.full((18, 3), 1.0))}]
    node = gltf.node(mesh=mesh)
    # Tangents of 10 on both sides: it overshoots by far.
    gltf.animate(node, "weights", [0.0, 1.0], [10.0, 0.0, 10.0, -10.0, 0.5, -10.0], "CUBICSPLINE")
    _, deformation = deformation_of(load(gltf, tmp_path))
    times = np.linspace(0, 1, 41)
    hull = deformation.hull(times)
    reached = 0.0
    for points, form in zip(hull, deformation.meshes(times), strict=True):
        assert (form.positions >= points.min(0) - 1e-9).all()
        assert (form.positions <= points.max(0) + 1e-9).all()
        reached = max(reached, form.positions[:, 0].max() - 0.3)
    assert reached > 2


def test_a_scale_that_is_animated_deforms(tmp_path: Path) -> None:
    """A node that grows unevenly; one that grows from nothing has triangles without area, which are not seen yet."""
    for start in ([1.0, 1.0, 1.0], [0.0, 0.0, 0.0]):
        gltf = Gltf()
        corners, faces = strip()
        node = gltf.node(mesh=gltf.mesh(corners, faces), name="plant")
        gltf.animate(node, "scale", [0.0, 1.0], [start, [1.0, 2.0, 1.0]])
        camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.9}})
        gltf.node(camera=camera, translation=[0, 2.0, 9.0])
        wall(gltf)
        scene = load(gltf, tmp_path)
        _, deformation = deformation_of(scene)
        (grown,) = deformation.meshes(np.array([1.0]))
        assert grown.positions[:, 2].max() == pytest.approx(2 * HIGH)
        renderer = make_renderer(scene, scene.own_camera, kind="native")
        near = (renderer.depth(views_at(scene, 0.0, 0.5, 1.0)) < 9.5).sum((1, 2))
        assert (near[0] > 0) == (start[0] > 0)
        assert (np.diff(near) > 0).all()


def test_many_objects_that_grow_take_time_by_their_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At many instants each object's own poses are computed, not those of all for each."""
    gltf = Gltf()
    mesh = gltf.mesh(*strip())
    for number in range(100):
        node = gltf.node(mesh=mesh, name=f"flake {number}")
        gltf.animate(node, "scale", [0.0, 0.5, 1.0], [[1.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 1.0]])
    deformations = load(gltf, tmp_path).deformations
    assert len(deformations) == 100
    computed = 0

    def counting(self: NodePoses, nodes: Any, t: Any) -> Any:
        nonlocal computed
        computed += len(nodes) * len(t)
        return as_before(self, nodes, t)

    as_before = NodePoses._computed
    monkeypatch.setattr(NodePoses, "_computed", counting)
    for deformation in deformations.values():
        deformation.box()
    assert computed < 100 * 129 * 6


def test_what_shines_and_grows_from_nothing(tmp_path: Path) -> None:
    """A lamp of no size, which Mitsuba refuses, is loaded as large as it gets; the world's size and view count it."""
    gltf = Gltf()
    corners, faces = strip()
    lamp = gltf.material("lamp", more={"emissiveFactor": [1.0, 1.0, 1.0]})
    node = gltf.node(mesh=gltf.mesh(corners, faces, material=lamp), name="lamp")
    gltf.animate(node, "scale", [0.0, 0.5, 1.0], [np.zeros(3), np.full(3, 2.0), np.ones(3)])
    scene = load(gltf, tmp_path)
    assert scene.note.startswith("scene.glb is 1.2 m x 0 m wide and 4 m high")
    renderer = make_renderer(scene, scene.own_camera, kind="native")
    first, later = (renderer.luma(views_at(scene, t_s))[0] for t_s in (0.0, 0.5))
    assert first.max() < 0.5
    assert later.max() > 1.0


def test_a_mesh_that_always_is_scaled_to_nothing_is_left_out(tmp_path: Path) -> None:
    """As triangles without area are; it is told."""
    gltf = Gltf()
    lamp = gltf.material("lamp", more={"emissiveFactor": [1.0, 1.0, 1.0]})
    node = gltf.node(mesh=gltf.mesh(*strip(), material=lamp), name="lamp")
    gltf.animate(node, "scale", [0.0, 1.0], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    wall(gltf)
    with pytest.warns(SceneFileWarning, match="meshes that always are scaled to nothing are left out: 1"):
        scene = load(gltf, tmp_path)
    assert scene.deformations == {}


def test_a_rigid_skin_makes_the_events_of_a_body(tmp_path: Path) -> None:
    """One joint that moves a mesh as a whole: the same events as the node's own animation, but for rounding."""
    found = []
    for skinned in (True, False):
        gltf = Gltf()
        corners, faces = strip()
        mesh = gltf.mesh(corners, faces, material=gltf.material())
        if skinned:
            attributes = gltf.document["meshes"][mesh]["primitives"][0]["attributes"]
            joints, weights = np.zeros((len(corners), 4)), np.tile([0.5, 0, 0, 0], (len(corners), 1))
            attributes |= {"JOINTS_0": gltf.array(joints, "u1"), "WEIGHTS_0": gltf.array(weights)}
            mover = gltf.node(name="bone")
            gltf.node(mesh=mesh, skin=gltf.add("skins", {"joints": [mover]}))
        else:
            mover = gltf.node(mesh=mesh)
        gltf.animate(mover, "translation", [0.0, 1.0], [[0.0, 0, 0], [1.0, 0, 0]])
        camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.9}})
        gltf.node(camera=camera, translation=[0.5, 1.0, 4.0])
        wall(gltf)
        folder = tmp_path / str(skinned)
        folder.mkdir()
        told = pytest.warns(UserWarning, match="weights do not add up to 1 have them scaled: 18")
        with told if skinned else nullcontext():
            scene = load(gltf, folder)
        packets = simulate(scene.crop(0.0, 0.1), renderer="native", threads=1)
        found.append(np.concatenate([packet.events for packet in packets]))
    ours, theirs = found
    assert len(theirs) > 2000
    assert len(ours) == pytest.approx(len(theirs), rel=0.02)
    images = [np.zeros((180, 240)) for _ in found]
    for image, events in zip(images, found, strict=True):
        np.add.at(image, (events["y"], events["x"]), np.where(events["p"], 1, -1))
    assert np.abs(images[0] - images[1]).sum() < 0.05 * np.abs(images[1]).sum()


def test_other_clocks(tmp_path: Path) -> None:
    """A part of the scene, and one by a clock of another pace, show the same forms; rates follow the pace."""
    scene = load(bent(), tmp_path)
    _, whole = deformation_of(scene)
    _, part = deformation_of(scene.crop(0.3, 0.5))
    _, paced = deformation_of(scene.later(0.1).paced(2.0))
    for own, t_s, own_s, pace in ((part, 0.2, 0.5, 1.0), (paced, 0.15, 0.4 - 1e-9, 2.0), (paced, 2.0, 1.0, 0.0)):
        (mesh,), (expected,) = own.meshes(np.array([t_s])), whole.meshes(np.array([own_s]))
        np.testing.assert_allclose(mesh.positions, expected.positions, atol=1e-8)
        (velocities,), (true,) = own.velocities(np.array([t_s])), whole.velocities(np.array([own_s]))
        np.testing.assert_allclose(velocities, pace * true, atol=1e-6)
        assert own.fastest(np.array([t_s]))[0] == pytest.approx(pace * whole.fastest(np.array([own_s]))[0], abs=1e-6)
    assert list(part.breaks_s()) == [pytest.approx(0.1)]
    assert list(paced.breaks_s()) == [pytest.approx(0.15)]
    assert paced.duration_s == pytest.approx(0.45)
    _, later = deformation_of(scene.paced(2.0).later(0.1))
    (mesh,), (expected,) = later.meshes(np.array([0.05])), whole.meshes(np.array([0.3]))
    np.testing.assert_allclose(mesh.positions, expected.positions, atol=1e-8)


def test_steps_jump(tmp_path: Path) -> None:
    """Keyframes without interpolation are jumps, across which luma is not interpolated; others are not."""
    _, smooth = deformation_of(load(bent(), tmp_path))
    _, stepped = deformation_of(load(bent(kind="STEP"), tmp_path))
    assert not smooth.jumps(smooth.breaks_s()).any()
    assert stepped.jumps(stepped.breaks_s()).all()
    scene = load(bent(kind="STEP"), tmp_path)
    motion = make_renderer(scene, scene.own_camera, kind="native").motion
    still = SegmentTrajectory(scene.path.pose(0.0), scene.path.pose(0.0), 2.0)
    assert [item.jump for item in find_breaks(still, motion, 0, 2_000_000)] == [True, True]


def test_a_mirrored_skeleton_keeps_its_front(tmp_path: Path) -> None:
    """Joints that mirror turn the triangles over, and normals still point to their front."""
    gltf = bent()
    gltf.document["nodes"][1]["scale"] = [-1, 1, 1]
    scene = load(gltf, tmp_path)
    _, deformation = deformation_of(scene)
    (mesh,) = deformation.meshes(np.array([0.1]))
    assert mesh.normals is not None
    a, b, c = mesh.positions.reshape(-1, 3, 3).swapaxes(0, 1)
    front = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", front, mesh.normals.reshape(-1, 3, 3)[:, 0]) > 0).all()


def clips(*paths: tuple[int, str, Any]) -> Gltf:
    """A file of two squares, and an animation for each of the paths: (node, name, end)."""
    gltf = Gltf()
    for x in (0, 3):
        corners = np.array([[x, 0, 0], [x + 1, 0, 0], [x, 1, 0]])
        gltf.node(mesh=gltf.mesh(corners, [[0, 1, 2]]), name=f"at{x}")
    for node, name, end in paths:
        gltf.document.setdefault("animations", []).insert(0, {"samplers": [], "channels": []})
        gltf.animate(node, "translation", [0.0, 1.0], [[0, 0, 0], end])
        if name:
            gltf.document["animations"][0]["name"] = name
    gltf.document["animations"].reverse()
    return gltf


def test_animations_of_the_same_node_are_played_one_at_a_time(tmp_path: Path) -> None:
    """The first, or the one that is named; those of different nodes are played together."""
    path = clips((0, "Walk", [1, 0, 0]), (0, "Run", [2, 0, 0]), (1, "", [0, 0, 3])).save(tmp_path / "clips.glb")
    scene = load_scene(path)
    assert scene.objects.keys() == {"at0_material"}
    np.testing.assert_allclose(scene.objects["at0_material"].pose(1.0).position, [1, 0, 0], atol=1e-9)
    assert scene.note.endswith("; of 3 animations Walk is played, not Run, animation_2 (--animation)")
    assert {look.what for look in scene.lost_looks} == {BACKS}
    run = load_scene(path, animation="Run")
    np.testing.assert_allclose(run.objects["at0_material"].pose(1.0).position, [2, 0, 0], atol=1e-9)
    assert load_scene(path, animation="animation_2").objects.keys() == {"at3_material"}
    with pytest.raises(ValueError, match=r"animation must be one of those of clips\.glb: Walk, Run, animation_2, got"):
        load_scene(path, animation="Sit")
    together = load_scene(clips((0, "A", [1, 0, 0]), (1, "B", [2, 0, 0])).save(tmp_path / "both.glb"))
    assert together.objects.keys() == {"at0_material", "at3_material"}
    assert "animations" not in together.note
    with pytest.raises(ValueError, match="animation is for a glTF file that is there, got 'fence'"):
        load_scene("fence", animation="Walk")


def changed(change: Callable[[Gltf], None]) -> Gltf:
    gltf = bent()
    change(gltf)
    return gltf


CORRUPT: dict[str, tuple[Callable[[Gltf], Any], str]] = {
    "a joint that is no node": (lambda g: g.document["skins"][0].update(joints=[0, 99]), "its joint 99 is no node"),
    "no joints": (lambda g: g.document["skins"][0].update(joints=[]), "must have 1 to"),
    "too few matrices": (
        lambda g: g.document["skins"][0].update(inverseBindMatrices=g.array(np.zeros((1, 16)))),
        "has 1 matrices for 2 joints",
    ),
    "no such skin": (lambda g: g.document["nodes"][2].update(skin=5), "of the 1 skins"),
    "no weights": (
        lambda g: g.document["meshes"][0]["primitives"][0]["attributes"].pop("WEIGHTS_0"),
        "as many of JOINTS_0 and WEIGHTS_0",
    ),
    "no joints of vertices": (
        lambda g: g.document["meshes"][0]["primitives"][0]["attributes"].pop("JOINTS_0"),
        "must have JOINTS_0",
    ),
    "targets of another length": (
        lambda g: g.document["meshes"][0]["primitives"][0].update(targets=[{"POSITION": g.array(np.zeros((2, 3)))}]),
        "has 2 of POSITION for 18",
    ),
    "targets that are no list": (
        lambda g: g.document["meshes"][0]["primitives"][0].update(targets=[3]),
        "must be a list of objects",
    ),
}


@pytest.mark.parametrize("case", CORRUPT)
def test_corrupt_skins_are_refused(tmp_path: Path, case: str) -> None:
    change, message = CORRUPT[case]
    with pytest.raises(DecodeError, match=message):
        load(changed(change), tmp_path)


def test_corrupt_numbers_of_skins_are_refused(tmp_path: Path) -> None:
    count = 2 * ROWS
    with pytest.raises(DecodeError, match="name joint 7 of 2"):
        load(bent(joints=np.full((count, 4), 7)), tmp_path)
    with pytest.raises(DecodeError, match="must not be negative"):
        load(bent(weights=np.tile([1.5, -0.5, 0, 0], (count, 1))), tmp_path)
    gltf = bent()
    attributes = gltf.document["meshes"][0]["primitives"][0]["attributes"]
    attributes["NORMAL"] = gltf.array(np.concatenate([np.zeros((4, 3)), np.tile([0, 0, 1.0], (count - 4, 1))]))
    with pytest.warns(UserWarning, match="corners whose normal has no direction"):
        _, deformation = deformation_of(load(gltf, tmp_path))
    (mesh,) = deformation.meshes(np.zeros(1))
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, np.tile([0, -1.0, 0], (len(mesh.positions), 1)), atol=1e-6)
    with pytest.warns(UserWarning, match="vertices without a joint follow the skin's first one: 18"):
        load(bent(weights=np.zeros((count, 4))), tmp_path)


def test_deformations_that_fit_no_mesh_are_refused(tmp_path: Path) -> None:
    """One of another number of vertices, or of a shape that the scene does not have; and who needs rigid meshes says
    so."""
    scene = load(bent(), tmp_path)
    gltf = bent()
    wall(gltf)
    (tmp_path / "walled").mkdir()
    walled = load(gltf, tmp_path / "walled")
    name, deformation = deformation_of(walled)
    of_wall = replace(walled, deformations={"mesh_wall": deformation}, objects={})
    with pytest.raises(ValueError, match="the deformation of 'mesh_wall' has positions of shape"):
        make_renderer(of_wall, scene.own_camera, kind="native")
    nowhere = replace(scene, deformations={"ghost": deformation}, objects={})
    with pytest.raises(ValueError, match="has no object 'ghost'"):
        make_renderer(nowhere, scene.own_camera, kind="native")
    with pytest.raises(ValueError, match="deforms: light cannot be baked on it"):
        make_renderer(scene, scene.own_camera, kind="baked")
    with pytest.raises(ValueError, match="a mesh deforms, which only"):
        make_renderer(scene, scene.own_camera, kind="table")
    renderer = make_renderer(scene, scene.own_camera)
    assert renderer.name == "native renderer"
    one = np.zeros(1, np.uint32)
    with pytest.raises(ValueError, match=f"derivatives need rigid meshes, and '{name}' deforms"):
        renderer.gradients(views_at(scene, 0.0), one, one, np.ones(1))  # type: ignore[attr-defined]


def test_light_that_is_baked_quickly_stays_on_what_deforms(tmp_path: Path) -> None:
    """At the start it is that of the same mesh at rest; later it is on the same mesh, where that is then."""
    scene = load(bent(), tmp_path)
    at_rest = replace(scene, deformations={}, objects={})
    lit, still, later = (
        make_renderer(each, scene.own_camera, rays_per_pixel=8).luma(views_at(scene, t_s))[0]
        for each, t_s in ((scene, 0.0), (at_rest, 0.0), (scene, 0.5))
    )
    renderer = make_renderer(scene, scene.own_camera)
    assert "it is that of the start, and stays on surfaces that move" in renderer.reason
    np.testing.assert_allclose(lit, still, rtol=0.05)
    np.testing.assert_allclose(later[later > 0].mean(), lit[lit > 0].mean(), rtol=0.2)
    assert np.abs(later - lit).max() > 0.2 * lit.max()


def test_what_a_camera_sees_of_a_mesh_is_where_the_mesh_is_then(tmp_path: Path) -> None:
    """As many pixels see it as have a depth; places are the middles of its triangles."""
    scene = load(bent(), tmp_path)
    camera = scene.own_camera
    renderer = make_renderer(scene, camera, kind="native", rays_per_pixel=1)
    assert isinstance(renderer, NativeRenderer)
    counts = list[int]()
    for t_s in (0.0, 0.5):
        view = views_at(scene, t_s)
        seen = seen_places(renderer.table, renderer.motion, camera, view)
        counts.append(len(seen.triangles))
        assert counts[-1] == np.isfinite(renderer.depth(view)).sum()
        assert (seen.weights == 1 / 3).all()
    assert counts[0] != counts[1]


def test_vertices_at_keyframes() -> None:
    """Straight lines in between, rest before and after; normals turn with the mean of both."""
    rng = np.random.default_rng(5)
    times, positions = np.array([0.0, 0.2, 1.0]), rng.normal(size=(3, 7, 3))
    keyframes = VertexKeyframes(times, positions, 3 * positions)
    assert keyframes.duration_s == 1.0
    assert list(keyframes.breaks_s()) == [0.2]
    (mesh,) = keyframes.meshes(np.array([0.4]))
    expected = 0.75 * positions[1] + 0.25 * positions[2]
    np.testing.assert_allclose(mesh.positions, expected)
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, expected / np.linalg.norm(expected, axis=1, keepdims=True))
    before, early, late, after = keyframes.velocities(np.array([-0.1, 0.1, 0.9, 1.1]))
    np.testing.assert_allclose(early, (positions[1] - positions[0]) / 0.2)
    np.testing.assert_allclose(late, (positions[2] - positions[1]) / 0.8)
    assert not before.any()
    assert not after.any()
    (end,) = keyframes.meshes(np.array([2.0]))
    np.testing.assert_array_equal(end.positions, positions[2])
    some = np.linspace(-0.1, 1.1, 25)
    low, high = keyframes.box()
    for form, hull, speed, own in zip(
        keyframes.meshes(some), keyframes.hull(some), keyframes.fastest(some), keyframes.velocities(some), strict=True
    ):
        assert (form.positions >= hull.min(0) - 1e-12).all()
        assert (form.positions <= hull.max(0) + 1e-12).all()
        assert (hull >= low - 1e-12).all()
        assert (hull <= high + 1e-12).all()
        assert np.linalg.norm(own, axis=1).max() <= speed + 1e-12
    assert_means(keyframes, some)
    moved = np.linalg.norm(np.diff(keyframes.hull(np.array([0.3, 0.31])), axis=0), axis=2).max()
    assert moved <= 0.01 * keyframes.fastest(np.array([0.3]))[0] * (1 + 1e-9)


@pytest.mark.parametrize(
    ("times", "positions", "normals", "message"),
    [
        ([0.0], np.zeros((1, 4, 3)), None, "two or more times"),
        ([0.1, 0.2], np.zeros((2, 4, 3)), None, "increase from 0"),
        ([0.0, 0.0], np.zeros((2, 4, 3)), None, "increase from 0"),
        ([0.0, 1.0], np.zeros((3, 4, 3)), None, r"shape \(2, vertices, 3\), got \(3, 4, 3\)"),
        ([0.0, 1.0], np.zeros((2, 4, 3)), np.zeros((2, 3, 3)), "normals must have the shape"),
        ([0.0, 1.0], np.full((2, 4, 3), np.nan), None, "positions must be finite"),
    ],
)
def test_keyframes_that_are_none_are_refused(times: Any, positions: Any, normals: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VertexKeyframes(times, positions, normals)


def test_what_is_left_out_of_morph_targets_is_told(tmp_path: Path) -> None:
    gltf = bent()
    (part,) = gltf.document["meshes"][0]["primitives"]
    zeros = gltf.array(np.zeros((2 * ROWS, 3)))
    part["targets"] = [{"POSITION": zeros, "TANGENT": zeros, "COLOR_0": zeros}]
    with pytest.warns(UserWarning, match="morph targets of COLOR_0, which are left out: 1 "):
        load(gltf, tmp_path)


def test_more_than_four_joints_of_a_vertex(tmp_path: Path) -> None:
    """A second set counts like the first: half of the weight in each is what all in one is."""
    _, plain = deformation_of(load(bent(), tmp_path))
    gltf = bent()
    attributes = gltf.document["meshes"][0]["primitives"][0]["attributes"]
    corners, _ = strip()
    of_second = np.clip(corners[:, 1] - 0.5, 0.0, 1.0)
    nothing = np.zeros((3, len(corners)))
    attributes["WEIGHTS_0"] = gltf.array(np.stack([1 - of_second, *nothing], 1))
    attributes["JOINTS_1"] = gltf.array(np.ones((len(corners), 4)), "u1")
    attributes["WEIGHTS_1"] = gltf.array(np.stack([of_second, *nothing], 1))
    _, both = deformation_of(load(gltf, tmp_path))
    (mesh,), (expected,) = (each.meshes(np.array([0.2])) for each in (both, plain))
    np.testing.assert_allclose(mesh.positions, expected.positions, atol=1e-6)


def test_lost_looks_are_counted_where_the_mesh_is(tmp_path: Path) -> None:
    """The native renderer and the surfaces' truth see the same share of a look along the path."""
    gltf = bent()
    gltf.document["materials"][0]["occlusionTexture"] = {"index": 0}
    scene = load(gltf, tmp_path)
    renderer = make_renderer(scene, scene.own_camera, kind="native")
    ours, theirs = (lost_look_fractions(scene, scene.own_camera, each) for each in (renderer, None))
    assert ours == theirs
    assert 0.01 < (next(iter(ours.values())) or 0) < 0.5


def test_flow_of_a_speed_is_bounded() -> None:
    """Whatever its direction, what moves at a speed has no longer flow than the bound, and about as long in some."""
    camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5, -0.3, 0.1)
    flow = OpticalFlow(camera, pixel_centres(camera))
    pixel, depth = np.arange(64 * 48), np.full(64 * 48, 2.0, np.float32)
    bound = flow.fastest_of_motion(pixel, 3.0, depth)
    longest = np.zeros(len(pixel))
    for direction in np.random.default_rng(2).normal(size=(60, 3)):
        velocities = np.tile(3.0 * direction / np.linalg.norm(direction), (len(pixel), 1))
        longest = np.maximum(longest, np.linalg.norm(flow.of_motion(pixel, velocities, depth), axis=1))
    assert (longest <= bound * (1 + 1e-6)).all()
    assert (longest > 0.6 * bound).all()


def test_a_path_comes_on_top(tmp_path: Path) -> None:
    """A mesh that deforms may move as a body too: it is seen where both together take it."""
    scene = load(bent(), tmp_path)
    name, _ = deformation_of(scene)
    here, there = Pose([0, 0, 0], [0, 0, 0, 1]), Pose([0.5, 0, 0], [0, 0, 0, 1])
    moved = replace(scene, objects={name: SegmentTrajectory(here, there, END_S)})
    depth, still = (
        make_renderer(each, scene.own_camera, kind="native").depth(views_at(scene, 0.0, END_S))
        for each in (moved, scene)
    )
    np.testing.assert_array_equal(depth[0], still[0])
    shift = [np.nonzero(np.isfinite(each[1]))[1].mean() for each in (depth, still)]
    assert shift[0] - shift[1] == pytest.approx(0.5 / 3 * scene.own_camera.fx, rel=0.1)
