"""Objects that move: what is seen of them is what a still scene shows that has them there, and rates are exact."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Flicker, MaxDisplacement, Pose, Scene, SegmentTrajectory, Trajectory, simulate
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.edges.swept_objects import MovingSilhouettes
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer
from davis_rs.render.motion.scene_motion import held, seen_from
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.sampling.displacement import DisplacementClock
from long_form import long_values
from moving_scene import BOX, DIRECT, FLOOR, LAMP, OTHER, PATH, SKY, SUN, diffuse, placed, turned, write_ball

FloatArray = npt.NDArray[np.float64]
Parts = dict[str, dict[str, Any]]

CAMERA = Camera(32, 24, 28.0, 33.0, 14.2, 12.9, k1=-0.2, k2=0.05, p1=0.004, p2=-0.006)
SMALL = Camera(12, 9, 10.0, 11.0, 5.3, 4.2, k1=-0.1)
# Looks at the origin, rolled by 0.4 rad.
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])


def scenes(name: str, tmp_path: Path) -> tuple[Parts, dict[str, Trajectory], bool]:
    """(parts, objects, shadows)."""
    lights: Parts = {"lamp": LAMP, "sun": SUN}
    if name == "shadows":
        return {**lights, "floor": FLOOR, "box": BOX}, {"box": PATH}, True
    if name == "no shadows":
        return {**lights, "sky": SKY, "floor": FLOOR, "box": BOX}, {"box": PATH}, False
    if name == "two objects":
        panel = placed("rectangle", [0, 0, 0.1], 0.3, diffuse(two_sided=False))
        return {**lights, "panel": panel, "floor": FLOOR, "box": BOX}, {"box": PATH, "panel": OTHER}, True
    if name == "behind":
        # A grille before the box: what moves is hidden in parts by what stands still.
        bars = {f"bar{i}": placed("cube", [0.25 * i - 0.5, 0.0, 1.2], [0.05, 0.6, 0.02], diffuse()) for i in range(5)}
        return {**lights, "floor": FLOOR, "box": BOX, **bars}, {"box": PATH}, True
    if name == "smooth normals":
        return {**lights, "floor": FLOOR, "ball": write_ball(tmp_path / "ball.obj")}, {"ball": PATH}, True
    return {"lamp": LAMP, "box": BOX}, {"box": PATH}, True  # nothing stands still


SCENES = pytest.mark.parametrize(
    "name", ["shadows", "no shadows", "two objects", "behind", "smooth normals", "all moves"]
)
every_renderer = pytest.mark.parametrize("kind", ["native", "table", FAST, SCALAR])
TABLES = pytest.mark.parametrize("kind", ["native", *long_values("table")])


def build(
    kind: str,
    parts: Parts,
    objects: dict[str, Trajectory] | None = None,
    *,
    shadows: bool = True,
    rays_per_pixel: int = 2,
    camera: Camera = CAMERA,
    blur: bool = False,
) -> Renderer:
    source = {"type": "scene", "by": DIRECT, **parts}
    scene = Scene("test", partial(dict, source), objects=objects or {}, shadows=shadows)
    if kind in ("native", "table"):
        return make_renderer(scene, camera, rays_per_pixel=rays_per_pixel, kind=kind, blur=blur)
    with variant(kind) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
    make = IntegratorRenderer if kind == FAST else ScalarRenderer
    return make(loaded, camera, rays_per_pixel=rays_per_pixel, blur=blur, seed=3, reason="", motion=motion)


def put(parts: Parts, objects: dict[str, Trajectory], t_s: float) -> Parts:
    """The scene as it is at a time, with nothing in it that moves."""
    still = {key: dict(part) for key, part in parts.items()}
    for name, path in objects.items():
        still[name]["to_world"] = path.pose(float(np.clip(t_s, 0, path.duration_s))).matrix @ still[name]["to_world"]
    return still


def moving(t_s: list[float], camera_moves: bool = True) -> Views:
    """Cameras at one pose that go and turn, or rest."""
    still = Views.at_rest([POSE] * len(t_s), t_s)
    velocity, angular_rate = np.array([[0.2, -0.25, 0.1], [-0.3, 0.1, 0.2]]) * camera_moves
    ones = np.ones((len(t_s), 1))
    return Views(still.t_s, still.positions, still.rotations, ones * velocity, ones * angular_rate)


@pytest.mark.few(7)
@SCENES
@pytest.mark.usefixtures("llvm")
@TABLES
def test_frames_are_those_of_a_still_scene(kind: str, name: str, tmp_path: Path) -> None:
    """Several times in one launch, before, on and after the trajectory: luma, depth and single pixels, to 1e-5."""
    parts, objects, shadows = scenes(name, tmp_path)
    renderer = build(kind, parts, objects, shadows=shadows)
    views = Views.at_rest([POSE] * 5, [0.0, 0.35, 0.8, 1.7, 0.35])
    frames, depths = renderer.luma(views), renderer.depth(views)
    assert np.array_equal(frames[1], frames[4])
    assert not np.array_equal(frames[0], frames[1])
    for frame, depth, t_s in zip(frames, depths, views.t_s, strict=True):
        still = build(kind, put(parts, objects, t_s), shadows=shadows)
        expected = still.luma(views[:1])[0]
        # A ray on an edge may pass to either side of it.
        close = np.abs(frame - expected) < 1e-5 * expected.max()
        assert close.mean() > 0.995
        expected = still.depth(views[:1])[0]
        assert np.isclose(depth, expected, rtol=0, atol=1e-5).mean() > 0.995
    view, pixel = np.array([3, 0, 2, 2, 1]), np.array([5, 400, 401, 767, 333])
    assert np.array_equal(renderer.samples(views, view, pixel), frames.reshape(5, -1)[view, pixel])
    assert np.array_equal(renderer.luma(views[2:3])[0], frames[2])


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["shadows", "two objects", "smooth normals", "all moves"])
@pytest.mark.parametrize("kind", [FAST, SCALAR])
def test_integrators_show_the_same(name: str, kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Mitsuba's integrators, whose scene is changed from view to view, see what they see of a still scene there."""
    request.getfixturevalue("llvm") if kind == FAST else None
    parts, objects, _ = scenes(name, tmp_path)
    renderer = build(kind, parts, objects, rays_per_pixel=1, camera=SMALL)
    views = Views.at_rest([POSE] * 3, [0.35, 0.0, 0.8])
    frames, depths = renderer.luma(views), renderer.depth(views)
    for frame, depth, t_s in zip(frames, depths, views.t_s, strict=True):
        still = build(kind, put(parts, objects, t_s), rays_per_pixel=1, camera=SMALL)
        expected = still.luma(views[:1])[0]
        assert (np.abs(frame - expected) < 1e-4 * expected.max()).mean() > 0.97
        expected = still.depth(views[:1])[0]
        assert np.isclose(depth, expected, rtol=0, atol=1e-4).mean() > 0.97
    view, pixel = np.array([2, 0, 1, 1]), np.array([60, 50, 51, 100])
    assert np.array_equal(renderer.samples(views, view, pixel), frames.reshape(3, -1)[view, pixel])


@pytest.mark.parametrize("kind", [FAST, SCALAR])
def test_a_sphere_moves_with_integrators(kind: str, request: pytest.FixtureRequest) -> None:
    """What is placed by a matrix and not by vertices moves too; the others make triangles of it, which do."""
    request.getfixturevalue("llvm")
    ball = {"type": "sphere", "center": [0.1, 0.0, 0.0], "radius": 0.3, "bsdf": diffuse()}
    renderer = build(kind, {"lamp": LAMP, "ball": ball}, {"ball": PATH}, rays_per_pixel=1, camera=SMALL)
    pose = PATH.pose(0.6)
    centre = (pose.matrix @ [0.1, 0, 0, 1])[:3]
    depth = renderer.depth(Views.at_rest([POSE] * 2, [0.0, 0.6]))[1]
    still = build(kind, {"lamp": LAMP, "ball": {**ball, "center": centre.tolist()}}, rays_per_pixel=1, camera=SMALL)
    expected = still.depth(Views.at_rest([POSE]))[0]
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(depth, expected, rtol=1e-5)
    for table in ("native", "table"):
        renderer = build(table, {"lamp": LAMP, "ball": ball}, {"ball": PATH}, rays_per_pixel=1, camera=SMALL)
        found = renderer.depth(Views.at_rest([POSE] * 2, [0.0, 0.6]))[1]
        assert np.mean(np.isfinite(found) != np.isfinite(expected)) < 0.01
        np.testing.assert_allclose(found, np.where(np.isfinite(found), expected, found), rtol=1e-3)


@SCENES
@pytest.mark.parametrize("camera_moves", [False, True])
@pytest.mark.usefixtures("llvm")
@TABLES
def test_rates_are_the_slopes_of_luma(kind: str, name: str, camera_moves: bool, tmp_path: Path) -> None:
    """Inside surfaces the rate is the central difference of luma(), of objects that go and turn, the camera too."""
    parts, objects, shadows = scenes(name, tmp_path)
    renderer = build(kind, parts, objects, shadows=shadows, rays_per_pixel=1)
    views = moving([0.3, 0.6], camera_moves)
    frames, rates = renderer.luma_and_rate(views)
    assert np.array_equal(frames, renderer.luma(views))
    step = 1e-3
    before, after = (renderer.luma(views.moved(np.full(2, t))).astype(np.float64) for t in (-step, step))
    central = (after - before) / (2 * step)
    moves = np.abs(central) > 1e-9
    smooth = moves & (np.abs(after - 2 * frames + before) / step < 0.05 * np.abs(central).std())
    assert smooth.sum() > 60
    scale = np.abs(central[smooth]).std()
    error = np.abs(rates - central)[smooth] / scale
    median, most, nearly_all = np.quantile(error, [0.5, 0.9, 0.98])
    assert median < 2e-3
    assert most < 0.03
    assert nearly_all < 0.1


@pytest.mark.parametrize("kind", [FAST, SCALAR])
def test_integrators_rates_are_differences(kind: str, request: pytest.FixtureRequest) -> None:
    """The very first instant too, before which the object stood still: the rate is that of what follows."""
    request.getfixturevalue("llvm") if kind == FAST else None
    parts = {"lamp": LAMP, "floor": FLOOR, "box": BOX}
    renderer = build(kind, parts, {"box": PATH}, rays_per_pixel=1, camera=SMALL)
    views = Views.at_rest([POSE] * 2, [0.0, 0.5])
    frames, rates = renderer.luma_and_rate(views)
    assert np.array_equal(frames, renderer.luma(views))
    step = 5e-4
    later, latest = (renderer.luma(views.moved(np.full(2, i * step))).astype(np.float64) for i in (1, 2))
    slope = (4 * later - latest - 3 * frames) / (2 * step)
    smooth = (np.abs(slope) > 1e-9) & (np.abs(latest - 2 * later + frames) / step < 0.05 * np.abs(slope).std())
    assert smooth[0].sum() > 3
    assert smooth[1].sum() > 3
    assert np.quantile(np.abs(rates - slope)[smooth] / np.abs(slope[smooth]).std(), 0.9) < 0.05
    assert (rates[np.abs(slope) < 1e-9] == 0).mean() > 0.95


@pytest.mark.usefixtures("llvm")
@every_renderer
@pytest.mark.parametrize("camera_moves", [False, True])
def test_flow_is_where_the_surface_point_goes(kind: str, camera_moves: bool) -> None:
    """A point of the object goes with it, one of the floor stays; NaN where nothing is."""
    camera = CAMERA if kind in ("native", "table") else SMALL
    small_floor = placed("rectangle", [0, 0, 0], [0.8, 0.8, 1], diffuse())
    renderer = build(kind, {"lamp": LAMP, "floor": small_floor, "box": BOX}, {"box": PATH}, camera=camera)
    views = moving([0.4, 0.7], camera_moves)
    flow, depth = renderer.flow(views), renderer.depth(views)
    missed = np.isinf(depth)
    assert 0 < missed.mean() < 1
    assert np.array_equal(np.isnan(flow[..., 0]), missed)
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
    rays = np.concatenate([camera.rays(pixels), np.ones((*pixels.shape[:2], 1))], -1)
    step = 1e-5
    for i, t_s in enumerate(views.t_s):
        hit = ~missed[i]
        points = views.positions[i] + (depth[i].astype(np.float64)[..., None] * rays)[hit] @ views.rotations[i].T
        pose = PATH.pose(t_s)
        own = (points - pose.position) @ pose.rotation
        on_box = (np.abs(own - [0.05, 0.02, 0.01]) < 0.2501).all(-1)
        assert 0 < on_box.mean() < 1
        images = []
        for dt in (-step, step):
            view, later = views[i : i + 1].moved([dt]), PATH.pose(t_s + dt)
            now = np.where(on_box[:, None], own @ later.rotation.T + later.position, points)
            images.append(camera.project((now - view.positions[0]) @ view.rotations[0]))
        expected = (images[1] - images[0]) / (2 * step)
        assert np.abs(expected[on_box]).max() > 1
        np.testing.assert_allclose(flow[i][hit], expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_the_camera_in_an_objects_frame() -> None:
    """Its pose is T_world_object^-1 T_world_camera, and its twist that pose's derivative."""
    views, objects = moving([0.4]), held(PATH, np.array([0.4]))
    own = seen_from(views, objects)
    step = 1e-6
    before, after = (seen_from(views.moved([dt]), objects.moved(np.array([dt]))) for dt in (-step, step))
    np.testing.assert_allclose(
        own.positions[0], PATH.pose(0.4).rotation.T @ (POSE.position - PATH.pose(0.4).position), atol=1e-12
    )
    np.testing.assert_allclose(own.velocities, (after.positions - before.positions) / (2 * step), atol=1e-8)
    turn = Rotation.from_matrix(before.rotations[0]).inv() * Rotation.from_matrix(after.rotations[0])
    np.testing.assert_allclose(own.angular_rates[0], turn.as_rotvec() / (2 * step), atol=1e-8)


def test_an_object_is_held_at_its_ends() -> None:
    """Before and after its trajectory it stands there, and only there it has no velocity."""
    poses = held(PATH, np.array([-1.0, 0.0, 0.5, 1.0, 1.1]))
    np.testing.assert_array_equal(poses.t_s, [-1.0, 0.0, 0.5, 1.0, 1.1])
    np.testing.assert_allclose(poses.positions[[0, 1, 3, 4]], [PATH.pose(t).position for t in (0, 0, 1, 1)])
    assert (poses.velocities[[0, 4]] == 0).all()
    assert (poses.angular_rates[[0, 4]] == 0).all()
    assert (poses.velocities[1:4] == PATH.velocities([0.0])).all()


@pytest.mark.usefixtures("llvm")
def test_without_objects_nothing_changes(tmp_path: Path) -> None:
    """A scene in which nothing moves is rendered by the same code as ever: times do not matter to its bits."""
    parts, _, _ = scenes("shadows", tmp_path)
    renderer = build("table", parts, rays_per_pixel=3)
    frames = renderer.luma(Views.at_rest([POSE] * 2, [0.0, 0.7]))
    assert np.array_equal(frames[0], frames[1])
    assert not renderer.motion


@pytest.mark.parametrize("kind", ["native", "table", "integrator"])
@pytest.mark.parametrize("name", ["bocks", "lamp"])
def test_an_unknown_object_is_refused(kind: str, name: str, llvm: str) -> None:
    """The message names the scene's shapes."""
    del llvm
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}
    scene = Scene("test", partial(dict, source), objects={name: PATH})
    with pytest.raises(ValueError, match=f"scene 'test' has no object '{name}'; it has floor, box"):
        make_renderer(scene, CAMERA, kind=kind)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("pixels", [1 / 3, 1.0])
def test_no_pixel_of_an_object_moves_farther_than_asked(pixels: float) -> None:
    """Before a camera at rest: between two instants no corner of the box goes farther, and not far less."""
    renderer = build("table", {"lamp": LAMP, "floor": FLOOR, "box": BOX}, {"box": PATH}, rays_per_pixel=1)
    rest = SegmentTrajectory(POSE, POSE, 0.2)
    instants = [0, *MaxDisplacement(pixels).instants(renderer, rest, 200_000)]
    assert len(instants) > 4
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * 0.25 + [0.05, 0.02, 0.01]
    images = []
    for t_us in instants:
        pose = PATH.pose(t_us * 1e-6)
        images.append(CAMERA.project((corners @ pose.rotation.T + pose.position - POSE.position) @ POSE.rotation))
    inside = ((images[0] > 0) & (images[0] < [31, 23])).all(-1)
    assert inside.sum() > 3
    moved = np.linalg.norm(np.diff(images, axis=0), axis=-1)[:, inside].max(1)
    assert moved.max() < 1.05 * pixels
    assert moved.mean() > 0.7 * pixels
    # Nothing moves after its end; a stretch that starts there stands still.
    assert DisplacementClock(renderer, rest, 200_000, start_us=1_000_010).path_at(200_000) == 0


@pytest.mark.usefixtures("llvm")
def test_an_object_that_the_camera_follows_stands_still() -> None:
    """A camera that goes along with the object sees it at rest; one that stays sees it move."""
    line = SegmentTrajectory(PATH.start, Pose(PATH.end.position, PATH.start.quaternion), 1.0)
    renderer = build("table", {"lamp": LAMP, "box": BOX}, {"box": line}, rays_per_pixel=1)
    start, end = (Pose(POSE.position + pose.position, POSE.quaternion) for pose in (line.start, line.end))
    follower = SegmentTrajectory(start, end, 1.0)
    flow = renderer.flow(Views.along(follower, [0.1]))
    assert np.isfinite(flow).any()
    assert np.nanmax(np.abs(flow)) < 1e-4
    rest = SegmentTrajectory(start, start, 1.0)
    assert DisplacementClock(renderer, rest, 200_000).path_at(200_000) > 1


@pytest.mark.usefixtures("llvm")
def test_events_come_only_where_the_object_passes() -> None:
    """Before a camera at rest, pixels that neither the object nor its shadow passes keep silent; others do not."""
    path = SegmentTrajectory(Pose([-0.4, 0, 0.3], turned(0, 0, 0)), Pose([0.4, 0.1, 0.3], turned(0, 0, 0.3)), 0.2)
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}
    scene = Scene("test", partial(dict, source), objects={"box": path})
    rest = SegmentTrajectory(POSE, POSE, 0.2)
    packets = list(simulate(scene.with_trajectory(rest), camera=CAMERA, rays_per_pixel=2, frame_rate_hz=200.0))
    events = concatenate_events([packet.events for packet in packets])
    frames = np.array([packet.luma for packet in packets if packet.luma is not None])
    fired = np.zeros((24, 32), np.bool_)
    fired[events["y"], events["x"]] = True
    changed = np.log(frames.max(0) + 1e-3) - np.log(frames.min(0) + 1e-3)
    assert len(events) > 500
    assert fired[changed > 0.2].all()
    assert fired.mean() < 0.8
    packets = list(simulate(scene.with_trajectory(rest), camera=CAMERA, rays_per_pixel=2, frame_rate_hz=5000.0))
    fine = np.array([packet.luma for packet in packets])
    still = (fine == fine[0]).all(0)
    assert still.mean() > 0.2
    assert not fired[still].any()


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("camera_moves", [False, True])
def test_no_edge_of_an_object_sweeps_a_pixel_unmarked(camera_moves: bool) -> None:
    """Every pixel in which the visible object changes within an interval is marked; most of the image is not."""
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}
    scene = Scene("test", partial(dict, source), objects={"box": PATH})
    with variant(FAST) as (mi, _):
        loaded = load_scene_source(source, mi)
        silhouettes = MovingSilhouettes(loaded, scene_motion(scene, loaded, mi))
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind="table")
    shift = np.array([0.03, 0.02, -0.01]) if camera_moves else np.zeros(3)
    poses = [Pose(POSE.position + i * shift, POSE.quaternion) for i in range(4)]
    times = np.array([0.1, 0.15, 0.2, 0.5])
    marked = silhouettes.swept(CAMERA, poses[:-1], poses[1:], t_before_s=times[:-1], t_after_s=times[1:], margin_px=0.0)
    for i, mask in enumerate(marked > 0):
        t = np.linspace(times[i], times[i + 1], 40)
        path = SegmentTrajectory(poses[i], poses[i + 1], times[i + 1] - times[i])
        views = Views.along(path, t - times[i], start_s=times[i])
        owners = renderer._owners(views)
        changes = (owners != owners[0]).any(0)
        assert changes.any()
        assert not (changes & ~mask).any()
        assert mask.mean() < 0.6
    rest = silhouettes.swept(CAMERA, [POSE], [POSE], t_before_s=[1.2], t_after_s=[1.4], margin_px=0.0)
    assert not rest.any()
    with pytest.raises(ValueError, match=r"1 intervals need as many times, got \(2,\)"):
        silhouettes.swept(CAMERA, [POSE], [POSE], t_before_s=[0.0, 1.0], t_after_s=[0.0], margin_px=0.0)


@pytest.mark.long
def test_a_part_of_a_scene_goes_on_from_there(llvm: str) -> None:
    """Objects that still move, one that has come to rest, and light run on: frames are those of the whole sequence."""
    short = SegmentTrajectory(PATH.start, PATH.end, 0.2)
    scene = Scene(
        "parts",
        partial(dict, type="scene", integrator=DIRECT, lamp=LAMP, floor=FLOOR, box=BOX, other=BOX),
        camera=SMALL,
        trajectory=SegmentTrajectory(POSE, Pose(POSE.position + 0.1, POSE.quaternion), 0.8),
        objects={"box": PATH, "other": short},
        lights={"lamp": Flicker(3.0, modulation=0.4)},
    )
    settings: dict[str, Any] = {"frame_rate_hz": 10, "depth_rate_hz": 10, "sampling": MaxDisplacement(1.0)}
    whole = {packet.end_us: packet for packet in simulate(scene, **settings) if packet.luma is not None}
    part = {p.end_us: p for p in simulate(scene, start_s=0.3, duration_s=0.4, **settings) if p.luma is not None}
    assert list(part) == [0, 100_000, 200_000, 300_000, 400_000]
    for t_us, packet in part.items():
        same = whole[t_us + 300_000]
        assert packet.luma is not None
        assert same.luma is not None
        np.testing.assert_allclose(packet.luma, same.luma, rtol=2e-4)
        assert packet.depth is not None
        assert same.depth is not None
        np.testing.assert_allclose(packet.depth, same.depth, rtol=1e-5)
    described = scene.crop(0.1).crop(0.2, 0.1).lights["lamp"].describe()
    assert described == {**scene.lights["lamp"].describe(), "start_s": pytest.approx(0.3)}
    with pytest.raises(ValueError, match="scene 'parts' has no trajectory of its own"):
        replace(scene, trajectory=None).crop()


def test_a_part_has_the_objects_of_that_time_whoever_gave_the_path(llvm: str) -> None:
    """The clocks of objects and lights move with the part, also where the path was handed over with_trajectory()."""
    camera_path = SegmentTrajectory(POSE, Pose(POSE.position + 0.1, POSE.quaternion), 10.0)
    object_path = SegmentTrajectory(PATH.start, PATH.end, 10.0)
    scene = Scene(
        "parts",
        partial(dict, type="scene", integrator=DIRECT, lamp=LAMP, floor=FLOOR, box=BOX),
        camera=SMALL,
        trajectory=camera_path,
        objects={"box": object_path},
        lights={"lamp": Flicker(3.0, modulation=0.4)},
    )
    settings: dict[str, Any] = {"frame_rate_hz": 20, "depth_rate_hz": 20, "duration_s": 0.1, "rays_per_pixel": 2}
    own = list(simulate(scene, start_s=8, **settings))
    handed = list(simulate(scene.with_trajectory(scene.path), start_s=8, **settings))
    late = list(simulate(scene.with_trajectory(camera_path.crop(8)), **settings))
    assert sum(len(packet.events) for packet in own) > 50
    for a, b in zip(own, handed, strict=True):
        assert a.events.tobytes() == b.events.tobytes()
        for one, other in ((a.luma, b.luma), (a.depth, b.depth)):
            assert (one is None) == (other is None)
            assert one is None or other is None or one.tobytes() == other.tobytes()
    # A path that begins later on by itself leaves the objects where they are at the start.
    assert own[0].depth is not None
    assert late[0].depth is not None
    assert own[0].depth.tobytes() != late[0].depth.tobytes()
    part = scene.crop(8, 0.1)
    np.testing.assert_allclose(
        part.objects["box"].pose(0.05).position, object_path.pose(8.05).position, rtol=0, atol=1e-12
    )
    assert part.lights["lamp"].describe()["start_s"] == 8
    assert scene.with_trajectory(camera_path.crop(8)).objects == scene.objects
