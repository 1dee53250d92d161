"""The built-in scenes as the dataset describes them, scenes from files, and where a camera starts."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Scene, Trajectory, load_scene, start_pose
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.textures import patchwork

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(32, 24, 28.0, 28.0, 15.5, 11.5)
PINNED_TEXTURE = "5544f872ba9eda564b8a02f5d6fcbcaf9d53f951bd6d3f0c735089009fd8b844"


def path_of(scene: Scene) -> Trajectory:
    assert scene.trajectory is not None
    assert scene.trajectory.duration_s == 2.0
    return scene.trajectory


def test_three_planes_flies_the_datasets_circle() -> None:
    """At k ms: x = -0.5 + 0.2 sin(theta), y = 1 + 0.2 cos(theta), z = 1.8, theta = 2 pi k / 1999, q = (1, 0, 0, 0)."""
    path = path_of(load_scene("three_planes"))
    k = np.arange(2001)
    theta = 2 * np.pi * k / 1999
    circle = np.stack([-0.5 + 0.2 * np.sin(theta), 1 + 0.2 * np.cos(theta), np.full(2001, 1.8)], 1)
    np.testing.assert_allclose(path.positions(k * 1e-3), circle, rtol=0, atol=1e-12)
    assert (path.quaternions(k * 1e-3) == (1.0, 0.0, 0.0, 0.0)).all()
    assert (path.angular_rates(k * 1e-3) == 0).all()


def test_scenes_carry_the_datasets_settings() -> None:
    """C = 0.15 and 0.2, the blur of the dataset's simulator, a distortion-free 240 x 180 sensor of 200 px."""
    planes, walls = load_scene("three_planes"), load_scene("three_walls")
    assert (planes.contrast_threshold, walls.contrast_threshold) == (0.15, 0.2)
    for scene in (planes, walls):
        assert scene.blur
        assert scene.own_camera == Camera(240, 180, 200.0, 200.0, 119.5, 89.5)


@pytest.mark.parametrize("name", ["three_planes", "three_walls"])
def test_velocities_are_those_of_the_path(name: str) -> None:
    """Velocity and body rate agree with central differences of positions and rotations over 2 us."""
    path, step = path_of(load_scene(name)), 1e-6
    t = np.linspace(0.001, 1.999, 101)
    slope = (path.positions(t + step) - path.positions(t - step)) / (2 * step)
    np.testing.assert_allclose(path.velocities(t), slope, atol=1e-6)
    before, after = (Rotation.from_quat(path.quaternions(t + sign * step)) for sign in (-1, 1))
    rates = (before.inv() * after).as_rotvec() / (2 * step)
    np.testing.assert_allclose(path.angular_rates(t), rates, atol=1e-6)


def test_three_walls_is_as_fast_as_the_datasets() -> None:
    """Top speed 5.31 m/s and top rate 109 deg/s, measured on the poses themselves, within 0.1 %."""
    path = path_of(load_scene("three_walls"))
    t = np.linspace(0.0, 2.0, 20_001)
    speed = np.linalg.norm(np.diff(path.positions(t), axis=0), axis=1) / 1e-4
    assert speed.max() == pytest.approx(5.31, rel=1e-3)
    turns = Rotation.from_quat(path.quaternions(t))
    rate = np.degrees((turns[:-1].inv() * turns[1:]).magnitude()) / 1e-4
    assert rate.max() == pytest.approx(109.0, rel=1e-3)


@pytest.mark.parametrize("name", ["three_planes", "three_walls"])
@pytest.mark.usefixtures("llvm")
def test_every_pixel_sees_a_surface_all_along(name: str) -> None:
    """Every 50 ms of the path every pixel hits something in front of it, and none is dark or saturated altogether."""
    scene = load_scene(name)
    renderer = make_renderer(scene, scene.own_camera, rays_per_pixel=1)
    assert renderer.name == "native renderer"
    poses = [path_of(scene).pose(0.05 * k) for k in range(41)]
    depth = renderer.depth(Views.at_rest(poses))
    assert np.isfinite(depth).all()
    assert depth.min() > 0.1
    luma = renderer.luma(Views.at_rest(poses[::10]))
    assert luma.min() > 0.01
    assert luma.max() < 10


@pytest.mark.parametrize("name", ["three_planes", "three_walls"])
@pytest.mark.usefixtures("llvm")
def test_no_shadow_can_be_seen_where_none_is_traced(name: str) -> None:
    """The built-in scenes leave shadows out because none can be seen: tracing them changes no pixel of the path."""
    scene = load_scene(name)
    assert not scene.shadows
    poses = [path_of(scene).pose(0.1 * k) for k in range(21)]
    without = make_renderer(scene, scene.own_camera, rays_per_pixel=1).luma(Views.at_rest(poses))
    traced = make_renderer(
        Scene("traced", scene.source, camera=scene.camera, blur=scene.blur), scene.own_camera, rays_per_pixel=1
    ).luma(Views.at_rest(poses))
    assert np.array_equal(without, traced)


def texture(seed: int = 5, size: int = 64) -> npt.NDArray[np.float32]:
    return patchwork(size, seed, low=0.02, high=0.98, grain=0.5, shapes=40, tint=(1.0, 0.97, 0.92))


def test_textures_are_the_same_on_every_machine() -> None:
    """One seed's texture is pinned byte for byte: a change here changes every event of the built-in scenes."""
    assert texture().dtype == np.float32
    assert texture().shape == (64, 64, 3)
    levels = np.round(texture() * 255).astype(np.uint8)
    assert np.array_equal(levels.astype(np.float32) / np.float32(255), texture())
    assert hashlib.sha256(levels.tobytes()).hexdigest() == PINNED_TEXTURE
    assert not np.array_equal(texture(6), texture())


def test_textures_have_no_seam() -> None:
    """Tiled, a texture goes on across its borders: no greater steps there than inside, and shapes wrap around."""
    plain = patchwork(64, 5, low=0.02, high=0.98, grain=1.0, shapes=0, tint=(1.0, 1.0, 1.0))[..., 0]
    for image in (plain, plain.T):
        inside = np.abs(np.diff(np.log(image), axis=0))
        seam = np.abs(np.log(image[0]) - np.log(image[-1]))
        assert seam.max() <= inside.max()
        assert seam.mean() < 1.5 * inside.mean()
    # A shape cut off at the border would leave an edge there: over many textures the seam has no more than elsewhere.
    levels = [np.log(texture(seed, 128)[..., 0]) for seed in range(20)]
    images = levels + [level.T for level in levels]
    edges = sum((np.abs(np.diff(image, axis=0, append=image[:1])) > 0.5).sum(1) for image in images)
    assert edges[-1] < 1.5 * edges[:-1].mean()


def test_texture_stays_between_its_limits() -> None:
    """Reflectance spans low to high times the tint of each channel, in steps of 1/255, and uses most of that range."""
    image = texture(5, 256)
    for channel, tint in enumerate((1.0, 0.97, 0.92)):
        values = image[..., channel]
        assert values.min() >= 0.02 * tint - 0.5 / 255
        assert values.max() <= 0.98 * tint + 0.5 / 255
        assert values.max() > 0.7 * tint
        assert values.min() < 0.05


XML = """
<scene version="3.0.0">
    <integrator type="direct"/>
    {sensor}
    <emitter type="point"><point name="position" x="0" y="-3" z="3"/><rgb name="intensity" value="50"/></emitter>
    <shape type="obj">
        <string name="filename" value="square.obj"/>
        <transform name="to_world"><scale value="0.3"/><translate x="0.7" y="0" z="0.6"/></transform>
        <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></bsdf>
    </shape>
</scene>
"""
SENSOR = """<sensor type="perspective"><float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -3, 0" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>"""
SQUARE = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 2 3\nf 1 3 4\n"


def write_scene(folder: Path, sensor: str = SENSOR) -> Path:
    path = folder / "corner.xml"
    path.write_text(XML.format(sensor=sensor))
    (folder / "square.obj").write_text(SQUARE)
    return path


def test_a_scene_file_and_its_own_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From an XML scene's sensor the camera starts upright: an object up and to the right appears up and to the right.

    The scene's mesh is found next to the XML file, from any working directory.
    """
    path = write_scene(tmp_path)
    monkeypatch.chdir("/")
    scene = load_scene(path)
    assert scene.name == "corner"
    assert scene.trajectory is None
    pose = start_pose(scene)
    np.testing.assert_allclose(pose.position, [0, -3, 0], atol=1e-6)
    # x right is the world's x, y down the world's -z, z forward the world's y.
    np.testing.assert_allclose(pose.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-6)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=4)
    rows, columns = np.nonzero(renderer.luma(Views.at_rest([pose]))[0])
    # The square spans x 0.4..1.0 and z 0.3..0.9, three metres ahead.
    assert (columns.min(), columns.max()) == (round(15.5 + 28 * 0.4 / 3), round(15.5 + 28 * 1.0 / 3))
    assert (rows.min(), rows.max()) == (round(11.5 - 28 * 0.9 / 3), round(11.5 - 28 * 0.3 / 3))
    depth = renderer.depth(Views.at_rest([pose]))[0]
    np.testing.assert_allclose(depth[np.isfinite(depth)], 3.0, rtol=1e-5)


def test_a_trajectory_goes_before_the_sensor() -> None:
    """A scene with a trajectory starts at the trajectory's first pose."""
    scene = load_scene("three_walls")
    pose, first = start_pose(scene), path_of(scene).pose(0.0)
    assert np.array_equal(pose.matrix, first.matrix)


@pytest.mark.parametrize("turn", range(20))
def test_sensors_turned_any_way_give_a_rigid_pose(tmp_path: Path, turn: int) -> None:
    """Mitsuba keeps a sensor's matrix in float32; it still passes for a rotation, within 1e-6 of the one written."""
    rotation = Rotation.random(random_state=turn).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, (100.0, -200.0, 50.0)
    text = " ".join(repr(float(value)) for value in matrix.ravel())
    sensor = f'<sensor type="perspective"><transform name="to_world"><matrix value="{text}"/></transform></sensor>'
    pose = start_pose(load_scene(write_scene(tmp_path, sensor)))
    np.testing.assert_allclose(pose.rotation, rotation @ np.diag([-1.0, -1.0, 1.0]), atol=1e-6)
    np.testing.assert_allclose(pose.position, (100.0, -200.0, 50.0), atol=1e-4)


def test_a_scene_without_sensor_has_no_start(tmp_path: Path) -> None:
    """With neither trajectory nor sensor start_pose() says that both are missing."""
    with pytest.raises(ValueError, match="'corner' has neither a trajectory nor a sensor"):
        start_pose(load_scene(write_scene(tmp_path, "")))


def test_names_and_files_that_are_no_scene(tmp_path: Path) -> None:
    """A name that is neither built in nor a file is refused at once, with the names that there are."""
    for name in ("four_planes", tmp_path):
        with pytest.raises(
            ValueError,
            match="is neither one of three_planes, three_walls, fence, checkerboard, a sequence of the",
        ):
            load_scene(name)
    with pytest.raises(ValueError, match=r"none.xml: there is no such scene file"):
        load_scene(tmp_path / "none.xml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<scene version='3.0.0'><shape", "cannot load .*corner.xml: .*line 1"),
        ("<scene version='3.0.0'><shape type='nosuch'/></scene>", "cannot load .*corner.xml: .*nosuch"),
        ("<bsdf version='3.0.0' type='diffuse'/>", "corner.xml must describe a scene, got a BSDF"),
        ("<scene version='3.0.0'></scene>", "corner.xml has no shapes: there is nothing that a camera could see"),
    ],
)
def test_files_that_mitsuba_refuses(tmp_path: Path, text: str, message: str) -> None:
    """A broken or empty scene file is a ValueError that names the file and gives Mitsuba's own reason."""
    path = tmp_path / "corner.xml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        make_renderer(load_scene(path), CAMERA)


def test_a_scene_file_that_vanished(tmp_path: Path) -> None:
    """A file that is gone when the scene is loaded stays an OSError."""
    scene = load_scene(write_scene(tmp_path))
    (tmp_path / "corner.xml").unlink()
    with pytest.raises(FileNotFoundError):
        make_renderer(scene, CAMERA)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({"type": "scene"}, "the scene dictionary has no shapes"),
        ({"type": "diffuse"}, "the scene dictionary must describe a scene, got a BSDF"),
        ({"type": "scene", "thing": {"type": "nosuch"}}, "cannot load the scene dictionary: .*nosuch"),
    ],
)
def test_dictionaries_that_are_no_scene(source: dict[str, object], message: str) -> None:
    """The same for a scene given as a dictionary."""
    with pytest.raises(ValueError, match=message):
        make_renderer(Scene("test", lambda: source), CAMERA)
