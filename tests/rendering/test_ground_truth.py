"""What a camera cannot give: flow, displacement, shapes, normals and truth at events, next to geometry and files."""

from __future__ import annotations

import json
import shutil
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import davis_rs
from davis_rs import Camera, Dataset, Pose, Scene, SegmentTrajectory, Simulator, Trajectory, Velocities, load_scene
from davis_rs._core import DecodeError
from davis_rs.geometry.trajectory.views import Views
from davis_rs.inspection.check import check_dataset
from davis_rs.inspection.flow_picture import flow_picture
from davis_rs.io.dataset.event_truth_file import open_event_truth
from davis_rs.io.dataset.files import EVENT_TRUTH
from davis_rs.render.truth import EVENT_TRUTH_DTYPE, EventTruth, SceneSurfaces, camera_velocities, event_truth
from moving_scene import BOX, DIRECT, FLOOR, LAMP, OTHER, PATH, diffuse, placed, write_ball

FloatArray = npt.NDArray[np.float64]
Map = npt.NDArray[Any]

CAMERA = Camera(40, 30, 34.0, 33.0, 19.2, 15.9, k1=-0.2, k2=0.05, p1=0.004, p2=-0.006)
LOOK = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
FLIGHT = SegmentTrajectory(
    LOOK,
    Pose([0.3, -0.7, 1.6], (Rotation.from_quat(LOOK.quaternion) * Rotation.from_rotvec([0.1, 0.2, 0.3])).as_quat()),
    1.0,
)
PANEL = placed("rectangle", [0, 0, 0.1], 0.3, diffuse())
OBJECTS: dict[str, Trajectory] = {"box": PATH, "panel": OTHER}
PIXELS = np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0)), -1)


@lru_cache
def moving_scene() -> Scene:
    """A floor, a box and a panel that both fly and turn, and a camera that does."""
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX, "panel": PANEL}
    return Scene("test", partial(dict, source), camera=CAMERA, trajectory=FLIGHT, objects=OBJECTS, shadows=False)


def follow(scene: Scene, names: tuple[str, ...], depth: Map, shapes: Map, t: float, later: float) -> FloatArray:
    """Where the points that pixels see at ``t`` are in the image ``later``, (H, W, 2), by poses alone."""
    rays = np.concatenate([CAMERA.rays(PIXELS.reshape(-1, 2)), np.ones((1200, 1))], 1).reshape(30, 40, 3)
    camera, after = (scene.path.pose(s).matrix for s in (t, later))
    points = (rays * depth[..., None]) @ camera[:3, :3].T + camera[:3, 3]
    for name, path in scene.objects.items():
        of = shapes == names.index(name) + 1
        before, then = (path.pose(float(np.clip(s, 0, path.duration_s))).matrix for s in (t, later))
        move = then @ np.linalg.inv(before)
        points[of] = points[of] @ move[:3, :3].T + move[:3, 3]
    seen = (points - after[:3, 3]) @ after[:3, :3]
    return CAMERA.project(seen.reshape(-1, 3)).reshape(30, 40, 2)


def maps(scene: Scene, t: float) -> tuple[SceneSurfaces, Map, Map, Map, Map]:
    surfaces = SceneSurfaces(scene, CAMERA)
    seen = surfaces.frame(Views.along(scene.path, [t]))
    shape = (30, 40)
    return (
        surfaces,
        seen.depth.reshape(shape),
        seen.shape.reshape(shape),
        seen.flow.reshape(*shape, 2),
        seen.normal.reshape(*shape, 3),
    )


@pytest.mark.parametrize("t", [0.1, 0.45])
def test_flow_is_the_motion_of_the_points_that_are_seen(t: float) -> None:
    """Through the lens, of the camera and of the bodies: against finite motion of each point, to 1e-3 px."""
    scene, h = moving_scene(), 1e-4
    surfaces, depth, shapes, flow, _ = maps(scene, t)
    assert set(np.unique(shapes)) >= {surfaces.names.index(name) + 1 for name in ("floor", "box", "panel")}
    ahead, back = (follow(scene, surfaces.names, depth, shapes, t, t + step) for step in (h, -h))
    seen = np.isfinite(depth)
    np.testing.assert_allclose(flow[seen] * 0.01, (ahead - back)[seen] / (2 * h) * 0.01, atol=1e-3)
    assert np.isnan(flow[~seen]).all()


def test_displacement_follows_surfaces_and_says_what_hides_them() -> None:
    """Points go with their bodies; what is hidden at the end is what a ray to the point meets something before."""
    scene, t, later = moving_scene(), 0.1, 0.5
    surfaces, depth, shapes, flow, _ = maps(scene, t)
    found = surfaces.displacement(Views.along(scene.path, [t, later]))
    expected = follow(scene, surfaces.names, depth, shapes, t, later) - PIXELS
    seen = np.isfinite(depth)
    np.testing.assert_allclose(found.pixels[seen], expected[seen], atol=1e-3)
    assert np.nanmax(np.abs(found.pixels - flow * (later - t))[seen]) > 1  # it is not flow times the interval
    # A point that ends well inside of a pixel's shape in the image, and is not hidden, is of the shape seen there.
    ends = PIXELS + found.pixels
    _, _, shapes_later, _, _ = maps(scene, later)
    column, row = np.rint(np.where(seen[..., None], ends, -1)).astype(int).transpose(2, 0, 1)
    inside = seen & (column >= 1) & (column < 39) & (row >= 1) & (row < 29)
    r, c = np.clip(row, 1, 28), np.clip(column, 1, 38)
    around = np.stack([shapes_later[r + i, c + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    sure = inside & (around == around[0]).all(0)
    assert (shapes[sure & ~found.occluded] == around[0][sure & ~found.occluded]).all()
    other = sure & (shapes == surfaces.names.index("floor") + 1) & (around[0] != shapes)
    assert other.sum() > 10
    assert found.occluded[other].all()
    assert not found.occluded[~seen].any()


def test_shapes_are_where_geometry_has_them() -> None:
    """A wall behind a plate: the mask is the plate's outline in the image, and the names are the scene's."""
    plate, wall = (
        placed("rectangle", [0.1, -0.05, 2.0], [0.5, 0.3, 1], diffuse()),
        placed("rectangle", [0, 0, 4], 9, diffuse()),
    )
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "plate": plate, "wall": wall}
    still = Pose([0, 0, 0], [0, 0, 0, 1])
    scene = Scene("plate", partial(dict, source), camera=CAMERA, trajectory=SegmentTrajectory(still, still, 1.0))
    surfaces, depth, shapes, _, normals = maps(scene, 0.0)
    x, y = CAMERA.rays(PIXELS.reshape(-1, 2)).T.reshape(2, 30, 40)
    on_plate = (np.abs(2 * x - 0.1) < 0.5) & (np.abs(2 * y + 0.05) < 0.3)
    assert [surfaces.names[k - 1] for k in (shapes[15, 20], shapes[2, 2])] == ["plate", "wall"]
    assert np.array_equal(shapes == surfaces.names.index("plate") + 1, on_plate)
    np.testing.assert_allclose(depth, np.where(on_plate, 2.0, 4.0), rtol=1e-6)
    np.testing.assert_allclose(normals, np.broadcast_to([0, 0, -1.0], normals.shape), atol=1e-6)


def test_normals_of_a_smooth_mesh_are_its_own(tmp_path: Path) -> None:
    """Interpolated between the vertices' and turned with the camera; on the side that is seen, at the rim too."""
    ball = write_ball(tmp_path / "ball.obj")  # radius 0.4 around (0.1, 0, 0)
    scene = Scene(
        "ball",
        partial(dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "ball": ball}),
        camera=CAMERA,
        trajectory=FLIGHT,
    )
    _, depth, shapes, flow, normals = maps(scene, 0.0)
    seen = shapes == 1
    assert 50 < seen.sum() < 600
    rays = np.concatenate([CAMERA.rays(PIXELS.reshape(-1, 2)), np.ones((1200, 1))], 1).reshape(30, 40, 3)
    pose = FLIGHT.pose(0.0).matrix
    points = (rays * np.where(seen, depth, 0)[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    outward = (points - [0.1, 0, 0])[seen] @ pose[:3, :3]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert (np.einsum("mi,mi->m", outward, normals[seen]) > 0.97).all()
    np.testing.assert_allclose(np.linalg.norm(normals[seen], axis=1), 1, atol=1e-6)
    assert np.isnan(normals[~seen]).all()
    assert np.isnan(flow[~seen]).all()


def test_truth_at_events_is_that_of_maps_at_their_instants() -> None:
    """Each event has what a map rendered at its very microsecond has at its pixel."""
    scene = moving_scene().crop(0.2, 0.1)
    events = np.concatenate([packet.events for packet in Simulator(scene, frame_rate_hz=0, depth_rate_hz=0).run()])
    truth = event_truth(scene, events)
    assert truth.dtype == EVENT_TRUTH_DTYPE
    surfaces = SceneSurfaces(scene, CAMERA)
    for k in np.linspace(0, len(events) - 1, 25).astype(int):
        t, x, y, _ = events[k].tolist()
        seen = surfaces.frame(Views.along(scene.path, [t * 1e-6]))
        pixel = y * 40 + x
        assert truth["depth"][k] == seen.depth[pixel]
        assert truth["shape"][k] == seen.shape[pixel]
        np.testing.assert_array_equal(truth["flow"][k], seen.flow[pixel])
    shuffled = np.random.default_rng(1).permutation(len(events))
    again = event_truth(scene, events[shuffled])
    assert again.tobytes() == truth[shuffled].tobytes()
    late = events[:1].copy()
    late["t"] = 10**9
    assert (
        EventTruth(scene)(late)["depth"]
        == surfaces.frame(Views.along(scene.path, [0.1])).depth[late["y"] * 40 + late["x"]]
    )
    late["x"] = 40
    with pytest.raises(ValueError, match="x < 40 and y < 30, got t = 1000000000 us, x = 40"):
        EventTruth(scene)(late)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """0.2 s of the moving scene with all that there is."""
    path = tmp_path_factory.mktemp("truth") / "out"
    davis_rs.simulate_to_folder(
        moving_scene().crop(0.0, 0.2),
        path,
        flow_rate_hz=20,
        flow_interval_s=0.05,
        flow_png="dsec",
        mask_rate_hz=20,
        normal_rate_hz=20,
        depth_rate_hz=20,
        velocity_rate_hz=200,
        event_truth="npz",
        quiet=True,
    )
    return path


def test_a_folder_proves_its_flow_by_depth_and_poses_alone(folder: Path) -> None:
    """Nothing of the renderer: what stands still moves in the image as calibration, depth and poses say."""
    dataset = Dataset(folder)
    assert check_dataset(folder).ok
    poses = dict(zip(dataset.groundtruth.t_us.tolist(), zip(*dataset.groundtruth[1:], strict=True), strict=True))
    floor = dataset.shape_names.index("floor") + 1
    assert [m.t_us for m in dataset.flow_maps] == [0, 50_000, 100_000, 150_000, 200_000]
    assert [m.t_us for m in dataset.displacements] == [0, 50_000, 100_000, 150_000]  # the path ends at 0.2 s
    rays = np.concatenate([dataset.camera.rays(PIXELS.reshape(-1, 2)), np.ones((1200, 1))], 1).reshape(30, 40, 3)
    for index in range(4):
        t_us = dataset.displacements[index].t_us
        depth, mask = dataset.read_depth(index), dataset.read_mask(index)
        still = mask == floor
        (place, turn), (later, later_turn) = (poses[t_us], poses[t_us + 50_000])
        points = Rotation.from_quat(turn).apply((rays * depth[..., None])[still]) + place
        ends = dataset.camera.project(Rotation.from_quat(later_turn).inv().apply(points - later))
        found = dataset.read_displacement(index)
        np.testing.assert_allclose(found.pixels[still], ends - PIXELS[still], atol=1e-3)
        assert np.isnan(found.pixels[mask == 0]).all()
        np.testing.assert_allclose(dataset.read_flow(index)[still] * 0.05, found.pixels[still], atol=0.3)
        assert np.isfinite(dataset.read_normals(index)[still]).all()


def test_displacement_as_png_is_what_others_decode(folder: Path) -> None:
    """OpenCV reads three channels of 16 bits; by DSEC's rule they are the displacement to half a step."""
    cv2 = pytest.importorskip("cv2")
    dataset = Dataset(folder)
    names = [line.split()[1] for line in (folder / "displacement_png.txt").read_text().splitlines()]
    assert len(names) == 4
    for index, name in enumerate(names):
        image = cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(np.float64)
        pixels = dataset.read_displacement(index).pixels
        valid = image[..., 2] == 1
        assert np.array_equal(valid, np.isfinite(pixels).all(-1))
        np.testing.assert_allclose((image[..., :2][valid] - 2**15) / 128, pixels[valid], atol=0.5 / 128 + 1e-6)


def test_velocities_are_the_derivatives_of_the_poses(folder: Path) -> None:
    """Of position and rotation in camera axes, and of these once more."""
    path = moving_scene().path
    found = Dataset(folder).velocities
    assert isinstance(found, Velocities)
    assert found.t_us.tolist() == list(range(0, 200_001, 5000))
    t, h = found.t_us[1:] * 1e-6, 1e-5
    own = Rotation.from_matrix(path.rotations(t))
    before, after = (Rotation.from_matrix(path.rotations(t + step)) for step in (-h, h))
    linear = own.inv().apply((path.positions(t + h) - path.positions(t - h)) / (2 * h))
    np.testing.assert_allclose(found.linear[1:], linear, atol=1e-6)
    np.testing.assert_allclose(found.angular[1:], (before.inv() * after).as_rotvec() / (2 * h), atol=1e-6)
    wobbling = load_scene("three_walls").path
    t_us = np.arange(100_000, 1_900_000, 50_000)
    all_of_it = camera_velocities(wobbling, t_us)
    t = t_us * 1e-6
    for rate, change, back in (
        (wobbling.velocities, all_of_it.linear_acceleration, True),
        (wobbling.angular_rates, all_of_it.angular_acceleration, False),
    ):
        slope = (rate(t + 1e-5) - rate(t - 1e-5)) / 2e-5
        expected = np.einsum("nji,nj->ni", wobbling.rotations(t), slope) if back else slope
        np.testing.assert_allclose(change, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["h5", "npz"])
def test_truth_next_to_events_is_that_of_the_events(folder: Path, tmp_path: Path, kind: str) -> None:
    """Columns of one length, the folder's events among them, in both formats; only the archive is left of its parts."""
    path = folder
    if kind == "h5":
        h5py = pytest.importorskip("h5py")
        path = tmp_path / "out"
        davis_rs.simulate_to_folder(moving_scene().crop(0.0, 0.2), path, event_truth="h5", frame_rate_hz=20, quiet=True)
        with h5py.File(path / EVENT_TRUTH["h5"]) as file:
            columns = {name: file[name][:] for name in file}
            names = json.loads(file.attrs["shape_names"])
    else:
        with np.load(path / EVENT_TRUTH["npz"]) as file:
            columns = dict(file)
            names = columns.pop("shape_names").tolist()
        assert not list(path.glob("*.part*"))
    events = Dataset(path).events
    for name in ("t", "x", "y", "p"):
        assert np.array_equal(columns[name], events[name])
    truth = EventTruth(moving_scene().crop(0.0, 0.2))
    expected = truth(events)
    assert names == list(truth.shape_names)
    assert np.array_equal(columns["depth"], expected["depth"])
    assert np.array_equal(columns["shape"], expected["shape"])
    flow = np.stack([columns["flow_x"], columns["flow_y"]], 1)
    np.testing.assert_array_equal(flow, expected["flow"])


def test_truth_of_a_run_that_was_killed_is_there_up_to_its_last_packet(tmp_path: Path) -> None:
    """HDF5 can be opened as it is after each packet, unclosed; what is left of an archive goes with an overwrite."""
    h5py = pytest.importorskip("h5py")
    events = np.zeros(3, davis_rs.EVENT_DTYPE)
    events["t"] = 1, 5, 9
    truth = np.zeros(3, EVENT_TRUTH_DTYPE)
    truth["depth"], truth["shape"] = (1.0, 2.0, np.inf), (1, 2, 0)
    file = open_event_truth(tmp_path, "h5", ["a", "b"])
    file.write(events, truth)
    shutil.copy(tmp_path / "event_truth.h5", tmp_path / "copy.h5")
    with h5py.File(tmp_path / "copy.h5") as copy:
        assert copy["t"][:].tolist() == [1, 5, 9]
        assert copy["depth"][:].tolist() == [1.0, 2.0, np.inf]
    file.close()
    path = tmp_path / "out"
    davis_rs.simulate_to_folder(moving_scene().crop(0.0, 0.05), path, quiet=True)
    killed = open_event_truth(path, "npz", ["a"])
    killed.write(events, truth)
    killed._open.close()  # type: ignore[attr-defined]  # as the end of a process does
    assert np.fromfile(path / "event_truth.npz.part.depth", "<f4").tolist() == [1.0, 2.0, np.inf]
    davis_rs.simulate_to_folder(moving_scene().crop(0.0, 0.05), path, overwrite=True, quiet=True)
    assert not list(path.glob("event_truth*"))


def test_a_folder_that_is_overwritten_keeps_nothing_of_the_truth(folder: Path, tmp_path: Path) -> None:
    """Maps, velocities and truth of the run before would be taken for those of the new one."""
    path = tmp_path / "out"
    settings = {"flow_rate_hz": 20, "mask_rate_hz": 20, "velocity_rate_hz": 100, "event_truth": "npz", "quiet": True}
    davis_rs.simulate_to_folder(moving_scene().crop(0.0, 0.05), path, **settings)  # type: ignore[arg-type]
    davis_rs.simulate_to_folder(moving_scene().crop(0.0, 0.05), path, overwrite=True, quiet=True)
    left = {entry.name for entry in path.iterdir()}
    assert left.isdisjoint({"flow", "flow.txt", "masks", "masks.txt", "shapes.json", "velocity.txt", "event_truth.npz"})


def test_what_cannot_be_told_is_refused(tmp_path: Path) -> None:
    """A field of distances has no triangles, an interval needs flow, and steps do not know where the camera will be."""
    field = {"type": "sdfgrid", "grid": np.mgrid[:2, :2, :2][0, ..., None] - 0.5}
    source = {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "field": field}
    scene = Scene("field", partial(dict, source), camera=CAMERA, trajectory=FLIGHT)
    with pytest.raises(ValueError, match="shape 'field' of scene 'field' is a SDFGrid"):
        SceneSurfaces(scene, CAMERA)
    with pytest.raises(ValueError, match="give flow_rate_hz"):
        Simulator(moving_scene(), flow_interval_s=0.1)
    with pytest.raises(ValueError, match="it is for run, not for step"):
        Simulator(moving_scene(), flow_rate_hz=10, flow_interval_s=0.1).step(0, LOOK)
    with pytest.raises(ValueError, match="flow_png is that of displacements: give flow_interval_s"):
        davis_rs.simulate_to_folder(moving_scene(), tmp_path / "out", flow_rate_hz=10, flow_png="kitti", quiet=True)
    (tmp_path / "meta.json").write_text("{}")
    (tmp_path / "shapes.json").write_text('{"2": "box"}')
    with pytest.raises(DecodeError, match="names by the numbers 1, 2"):
        _ = Dataset(tmp_path).shape_names


def test_flow_is_drawn_by_the_usual_wheel(folder: Path) -> None:
    """Right is red, no motion white, nothing grey; the figure has a panel more for each map."""
    flow = np.array([[[1, 0], [0, 0], [np.nan, np.nan], [-1, 0]]], np.float32)
    red, white, grey, blue = flow_picture(flow, 1.0)[0].tolist()
    assert (red, white, grey) == ([255, 0, 0], [255, 255, 255], [209, 209, 209])
    assert blue[0] == 0
    assert min(blue[1:]) > 100
    figure = davis_rs.view(folder)
    titles = [ax.get_title() for ax in figure.axes]
    for start in ("(d) optical flow", "(e) ", "(f) normals"):
        assert any(title.startswith(start) for title in titles), titles
