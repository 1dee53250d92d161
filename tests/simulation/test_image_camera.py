"""Lens and size of the image: a scene's, a sensor's, a calibration's, an XML file's; and what contradicts itself."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from davis_rs import (
    EVENT_DTYPE,
    Camera,
    Dataset,
    Scene,
    SceneFileWarning,
    SegmentTrajectory,
    SensorParameters,
    Simulator,
    event_truth,
    load_camera,
    load_scene,
    plan_effects,
    simulate,
    simulate_to_folder,
    start_pose,
)
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs.cli.main import main
from davis_rs.differentiable import DifferentiableRenderer, event_time_jacobian, event_time_residuals
from davis_rs.sensor.presets import SENSORS

PLANES = load_scene("three_planes")
CALIBRATION_346 = "250 251 172 129 -0.3 0.1 0.001 -0.0005 0\n"


def camera_of(scene: Scene = PLANES, **settings: Any) -> Camera:
    return Simulator(scene, **settings).camera


def field_of_view(camera: Camera) -> float:
    """Horizontal, from the left edge of the left pixels to the right edge of the right ones, degrees."""
    left, right = (camera.cx + 0.5) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx
    return math.degrees(math.atan(left) + math.atan(right))


def test_a_calibration_is_given_by_its_path_or_its_name(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text("210 211 120 90 -0.3 0.1 0.001 -0.0005 0\n")
    assert camera_of(camera=path) == camera_of(camera=str(path)) == Camera.from_calib(path)
    assert camera_of(camera="davis240c") == load_camera("davis240c")


@pytest.mark.parametrize("given", ["three_planes", Path("three_planes"), None])
def test_what_is_no_scene_is_refused_with_the_call_that_makes_one(given: Any, tmp_path: Path) -> None:
    events = np.zeros(0, EVENT_DTYPE)
    for made in (
        lambda: next(simulate(given)),
        lambda: simulate_to_folder(given, tmp_path / "out"),
        lambda: Simulator(given),
        lambda: plan_effects(given),
        lambda: event_truth(given, events),
        lambda: event_time_jacobian(given, events),
        lambda: next(event_time_residuals(given, events)),
        lambda: DifferentiableRenderer(given),
    ):
        with pytest.raises(TypeError, match=r"scene must be a Scene, got .*load_scene\(.*\) makes one"):
            made()
    assert not (tmp_path / "out").exists()


# ---- sizes ----


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_a_sensor_brings_its_size_and_the_lens_keeps_its_view(tmp_path: Path) -> None:
    """346 x 260 for a DAVIS346, into the folder; the scene's principal point stays at its share of the image."""
    out = tmp_path / "out"
    options = ["--duration", "0.01", "--rays-per-pixel", "1", "--depth-rate", "0", "--quiet"]
    assert main(["simulate", "three_planes", "-o", str(out), "--sensor", "davis346", *options]) == 0
    dataset = Dataset(out)
    with Image.open(dataset.frames[0].path) as frame:
        assert frame.size == (346, 260)
    assert (dataset.camera.width, dataset.camera.height) == (346, 260)
    own, camera = PLANES.own_camera, camera_of(sensor="davis346")
    assert (camera.width, camera.height) == (346, 260)
    assert field_of_view(camera) == pytest.approx(field_of_view(own), abs=1e-9)
    assert camera.fx / camera.fy == pytest.approx(own.fx / own.fy)
    assert (camera.cx + 0.5) / 346 == pytest.approx((own.cx + 0.5) / own.width)
    assert (camera.cy + 0.5) / 260 == pytest.approx((own.cy + 0.5) / own.height)
    np.testing.assert_allclose(dataset.camera.fx, camera.fx, rtol=1e-6)
    assert camera == camera_of(size="346x260") == camera_of(size=(346, 260))


def test_a_sensor_of_the_scenes_own_size_leaves_the_camera_alone() -> None:
    """To the last bit of calib.txt; so does one whose size is not known."""
    before = PLANES.own_camera.to_calib()
    assert camera_of(sensor="davis240c").to_calib() == before
    assert camera_of(sensor=SensorParameters(contrast_threshold=0.2)).to_calib() == before
    assert camera_of(size="240x180").to_calib() == before


def test_another_lens_keeps_its_distortion() -> None:
    """It acts on directions, which no number of pixels changes."""
    scene = replace(PLANES, camera=Camera(240, 180, 200.0, 201.0, 118.0, 91.0, k1=-0.3, k2=0.1, p1=1e-3, p2=-5e-4))
    camera = camera_of(scene, size="480x360")
    assert camera.distortion == scene.own_camera.distortion
    point = np.array([[0.3, -0.2, 1.0]])
    np.testing.assert_allclose(camera.project(point) + 0.5, 2 * (scene.own_camera.project(point) + 0.5), rtol=1e-12)


def test_a_calibration_of_another_size_asks_for_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A calib.txt does not hold its size: nothing is assumed where the principal point contradicts 240 x 180."""
    path = tmp_path / "calib.txt"
    path.write_text(CALIBRATION_346)
    with pytest.raises(ValueError, match=r"calib.txt has its principal point at \(172, 129\).* 240 x 180 .*give size"):
        camera_of(camera=str(path))
    assert main(["simulate", "three_planes", "-o", str(tmp_path / "out"), "--camera", str(path)]) == 1
    assert "does not hold its size: give --size WxH or a --sensor" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    by_size, by_sensor = camera_of(camera=str(path), size="346x260"), camera_of(camera=str(path), sensor="davis346")
    assert by_size == by_sensor
    assert (by_size.width, by_size.height, by_size.fx, by_size.cx) == (346, 260, 250, 172)
    with pytest.warns(UserWarning, match=r"\(172, 129\), far from the middle of an image of 640 x 480 pixels"):
        camera_of(camera=str(path), size="640x480")
    path.write_text("200 201 118 91 -0.3 0.1 0.001 -0.0005 0\n")
    assert (camera_of(camera=str(path)).width, camera_of(camera=str(path)).fx) == (240, 200)
    with pytest.raises(ValueError, match=r"principal point at \(118, 91\), outside of an image of 64 x 48 pixels"):
        camera_of(camera=str(path), size="64x48")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"size": "346x260", "sensor": "davis240c"}, "size 346 x 260 contradicts the sensor's 240 x 180 pixels"),
        (
            {"camera": "davis240c", "sensor": "davis346"},
            "the camera has 240 x 180 pixels, but the sensor asks for 346 x 260",
        ),
        (
            {"camera": "davis240c", "size": "346x260"},
            "the camera has 240 x 180 pixels, but size asks for 346 x 260",
        ),
        (
            {"camera": Camera(64, 48, 50.0, 50.0, 31.5, 23.5), "sensor": "davis240c"},
            "the camera has 64 x 48 pixels, but the sensor asks for 240 x 180",
        ),
    ],
)
def test_sizes_that_contradict_each_other_are_named_both(settings: dict[str, Any], message: str) -> None:
    """Neither is taken for the right one."""
    with pytest.raises(ValueError, match=f"^{message}$"):
        camera_of(**settings)


def test_the_sensors_have_the_sizes_of_their_data_sheets() -> None:
    sizes = {name: (sensor.width, sensor.height) for name, sensor in SENSORS.items()}
    assert (sizes["davis240c"], sizes["davis346"]) == ((240, 180), (346, 260))


# ---- cameras of XML files ----

XML = """
<scene version="3.0.0">
    <integrator type="direct"/>
    {sensor}
    <emitter type="point"><point name="position" x="0" y="-3" z="3"/><rgb name="intensity" value="50"/></emitter>
    <shape type="sphere"><point name="center" x="{x}" y="{y}" z="{z}"/><float name="radius" value="0.04"/></shape>
</scene>
"""
SENSOR = """<sensor type="perspective">{lens}
    <transform name="to_world"><lookat origin="0.3, -3, 0.1" target="0.2, 0, 0.3" up="0.1, 0, 1"/></transform>
    <film type="hdrfilm"><rfilter type="box"/>{film}</film></sensor>"""
FOV = '<float name="fov" value="50"/>'
FILM = '<integer name="width" value="120"/><integer name="height" value="80"/>'
CROP = """<integer name="crop_width" value="70"/><integer name="crop_height" value="50"/>
    <integer name="crop_offset_x" value="30"/><integer name="crop_offset_y" value="20"/>"""
OFFSETS = """<float name="principal_point_offset_x" value="0.06"/>
    <float name="principal_point_offset_y" value="-0.09"/>"""
POINTS = [(0.25, 0.1, 0.2), (0.6, -0.2, 0.35), (0.1, 0.3, -0.05)]


def write_scene(folder: Path, sensor: str, point: tuple[float, float, float] = POINTS[0]) -> Path:
    path = folder / "spot.xml"
    path.write_text(XML.format(sensor=sensor, x=point[0], y=point[1], z=point[2]))
    return path


def seen_by_mitsuba(path: Path) -> tuple[tuple[int, int], np.ndarray[Any, Any]]:
    """Size of Mitsuba's own picture, and the centroid (x, y) of the sphere in it; integers are the pixels' centres."""
    with variant(SCALAR) as (mi, _):
        scene = mi.load_file(str(path))
        integrator = mi.load_dict({"type": "aov", "aovs": "dd:depth"})
        depth = np.array(mi.render(scene, integrator=integrator, spp=64))[..., -1]
    rows, columns = np.indices(depth.shape)
    assert (depth > 0).sum() > 4
    found = [(depth * columns).sum() / depth.sum(), (depth * rows).sum() / depth.sum()]
    return (depth.shape[1], depth.shape[0]), np.array(found)


@pytest.mark.few(8)
@pytest.mark.parametrize("point", POINTS, ids=["middle", "right", "left"])
@pytest.mark.parametrize(
    ("lens", "film"),
    [
        (FOV, FILM),
        (FOV, FILM + CROP),
        (FOV + OFFSETS, FILM),
        (FOV + OFFSETS, FILM + CROP),
        (FOV + '<string name="fov_axis" value="y"/>', FILM),
        (FOV + '<string name="fov_axis" value="diagonal"/>', FILM),
        (FOV + '<string name="fov_axis" value="larger"/>', FILM.replace("120", "60")),
        (FOV + '<string name="fov_axis" value="y"/>' + OFFSETS, FILM + CROP),
        ('<string name="focal_length" value="40mm"/>', FILM),
    ],
    ids=["fov", "crop", "offset", "offset-crop", "fov-y", "diagonal", "larger", "y-offset-crop", "focal-length"],
)
def test_a_point_lies_where_mitsuba_shows_it(
    tmp_path: Path, lens: str, film: str, point: tuple[float, float, float]
) -> None:
    """Camera and start project a sphere to its centroid in Mitsuba's own picture, which has the same size."""
    path = write_scene(tmp_path, SENSOR.format(lens=lens, film=film), point)
    scene = load_scene(path)
    camera, pose = scene.own_camera, start_pose(scene)
    size, found = seen_by_mitsuba(path)
    assert (camera.width, camera.height) == size
    expected = camera.project(((np.array(point) - pose.position) @ pose.rotation)[None])[0]
    np.testing.assert_allclose(found, expected, atol=0.3)


@pytest.mark.filterwarnings("default:.*its first sensor is not perspective")
def test_an_xml_scene_without_a_camera_asks_for_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a sensor, or with one that is no pinhole, nothing is assumed; a camera that is given is enough."""
    orthographic = '<sensor type="orthographic"><film type="hdrfilm"/></sensor>'
    told = r"not perspective, so it says no more than where a camera starts$"
    for sensor, telling in (("", nullcontext()), (orthographic, pytest.warns(SceneFileWarning, match=told))):
        with telling:
            scene = load_scene(write_scene(tmp_path, sensor))
        assert scene.camera is None
        with pytest.raises(ValueError, match=r"scene 'spot' has no perspective sensor.*give camera$"):
            Simulator(scene)
        assert camera_of(scene, camera="davis240c").width == 240
    path = tmp_path / "path.txt"
    path.write_text("".join(f"{k * 0.005:.3f} {0.3 + 0.001 * k} -3 0.1 -0.7071 0 0 0.7071\n" for k in range(40)))
    command = ["simulate", str(tmp_path / "spot.xml"), "-o", str(tmp_path / "out"), "--trajectory", str(path)]
    assert main([*command, "--position-sigma", "0", "--rotation-sigma", "0"]) == 1
    assert "give --camera" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_xml_scene_is_simulated_through_its_own_camera(tmp_path: Path) -> None:
    """The default lens and size are those of the file; a size that is given keeps the file's field of view."""
    scene = load_scene(write_scene(tmp_path, SENSOR.format(lens=FOV, film=FILM)))
    pose = start_pose(scene)
    np.testing.assert_allclose(pose.position, [0.3, -3, 0.1], atol=1e-6)
    towards = np.array([0.2, 0, 0.3]) - [0.3, -3, 0.1]
    np.testing.assert_allclose(pose.rotation[:, 2], towards / np.linalg.norm(towards), atol=1e-6)
    assert pose.rotation[2, 1] < -0.9  # its y points down
    scene = scene.with_trajectory(SegmentTrajectory(pose, pose, 0.1))
    camera = camera_of(scene)
    assert (camera.width, camera.height) == (120, 80)
    assert field_of_view(camera) == pytest.approx(50, abs=1e-4)
    larger = camera_of(scene, sensor="davis346")
    assert (larger.width, larger.height) == (346, 260)
    assert field_of_view(larger) == pytest.approx(50, abs=1e-4)


def test_a_thin_lens_is_told_to_be_a_pinhole(tmp_path: Path) -> None:
    """Its aperture is not simulated, and that is said."""
    path = tmp_path / "thin.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="thinlens"><float name="fov" value="40"/>'
        '<float name="aperture_radius" value="0.1"/><film type="hdrfilm"><integer name="width" value="64"/>'
        '<integer name="height" value="48"/></film></sensor><shape type="sphere"/><emitter type="constant"/></scene>'
    )
    with pytest.warns(UserWarning, match="taken as a pinhole"):
        scene = load_scene(path)
    assert scene.camera is not None
    assert (scene.camera.width, scene.camera.height) == (64, 48)
