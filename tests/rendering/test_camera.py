"""The camera model, calib.txt, and that the renderers' rays obey both."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs import Camera, DecodeError, Pose, Scene, load_camera
from davis_rs.geometry.camera import PRESETS
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer

FloatArray = npt.NDArray[np.float64]

DAVIS = PRESETS["davis240c"]
UNEQUAL = Camera(240, 180, 180.0, 230.0, 101.5, 97.25)
ALL_TERMS = Camera(240, 180, 190.0, 205.0, 118.0, 91.0, k1=-0.3, k2=0.12, p1=0.004, p2=-0.006, k3=-0.02)
CAMERAS = [DAVIS, UNEQUAL, ALL_TERMS]
# A rotation by 2 rad about a skew axis: its transpose differs, and it commutes with none of the axes.
SKEW = Rotation.from_rotvec(2.0 * np.array([1.0, -2.0, 2.0]) / 3.0).as_quat()
DIFFUSE = {"type": "diffuse", "reflectance": 0.5}


def opencv(camera: Camera, point: npt.ArrayLike) -> FloatArray:
    """OpenCV's projectPoints for one point in camera axes, term by term as its documentation prints it."""
    x, y, z = np.asarray(point, np.float64)
    k1, k2, p1, p2, k3 = camera.k1, camera.k2, camera.p1, camera.p2, camera.k3
    a, b = x / z, y / z
    r = np.hypot(a, b)
    radial = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
    a2 = a * radial + 2 * p1 * a * b + p2 * (r**2 + 2 * a**2)
    b2 = b * radial + p1 * (r**2 + 2 * b**2) + 2 * p2 * a * b
    return np.array([camera.fx * a2 + camera.cx, camera.fy * b2 + camera.cy])


@pytest.mark.parametrize("camera", CAMERAS)
@given(x=st.floats(-0.5, 239.5), y=st.floats(-0.5, 179.5), z=st.floats(0.05, 50.0))
def test_a_pixels_ray_projects_back_to_it(camera: Camera, x: float, y: float, z: float) -> None:
    """project(rays(pixel)) is the pixel within 1e-6 px, at any depth, with distortion and unequal focal lengths."""
    direction = np.append(camera.rays([x, y]), 1.0)
    assert np.abs(camera.project(z * direction) - (x, y)).max() < 1e-6
    assert np.abs(opencv(camera, z * direction) - (x, y)).max() < 1e-6


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_land_where_opencv_puts_them(camera: Camera) -> None:
    """project() is OpenCV's formula, for arrays of points of any shape."""
    points = np.random.RandomState(0).uniform((-1.0, -0.8, 1.5), (1.0, 0.8, 4.0), (5, 7, 3))
    expected = [[opencv(camera, point) for point in row] for row in points]
    np.testing.assert_allclose(camera.project(points), expected, rtol=0, atol=1e-9)


def test_x_is_right_and_y_is_down() -> None:
    """A point to the right and below of the axis has the larger column and the larger row, by f X / Z."""
    ideal = PRESETS["ideal"]
    assert ideal.project([0.0, 0.0, 2.0]).tolist() == [119.5, 89.5]
    assert ideal.project([0.2, 0.1, 2.0]).tolist() == pytest.approx([139.5, 99.5])


def test_points_behind_the_camera_have_no_pixel() -> None:
    """Points with z <= 0 give NaN, and leave the others alone."""
    pixels = UNEQUAL.project([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [0.0, 0.0, 1.0]])
    assert np.isnan(pixels[:2]).all()
    assert pixels[2].tolist() == [UNEQUAL.cx, UNEQUAL.cy]


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_jacobian_is_the_slope_of_the_projection(camera: Camera) -> None:
    """distortion_jacobian() agrees with central differences of OpenCV's formula to 1e-5 px per unit."""
    step = 1e-6
    for xy in ([0.0, 0.0], [0.35, -0.2], [-0.4, 0.3]):
        columns = []
        for offset in ([step, 0.0, 0.0], [0.0, step, 0.0]):
            ahead, behind = (opencv(camera, [*xy, 1.0] + sign * np.array(offset)) for sign in (1, -1))
            columns.append((ahead - behind) / (2 * step))
        np.testing.assert_allclose(camera.distortion_jacobian(xy), np.stack(columns, 1), rtol=0, atol=1e-5)


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", ["table", "integrator"])
@pytest.mark.parametrize("distorted", [False, True])
@pytest.mark.usefixtures("llvm")
def test_a_small_object_appears_where_its_point_projects(kind: str, distorted: bool) -> None:
    """End to end: the centroid of a small rendered quad is its centre's pixel within 0.03 px, for a skew pose."""
    camera = Camera(48, 36, 40.0, 44.0, 25.2, 15.6)
    if distorted:
        camera = replace(camera, k1=DAVIS.k1, k2=DAVIS.k2, p1=0.01, p2=-0.02)
    pose = Pose([0.3, -1.2, 0.7], SKEW)
    for seen in ([0.0, 0.0, 2.0], [-0.75, -0.45, 2.0], [0.6, 0.55, 2.2]):
        # A quad of about 2 px, parallel to the image plane and turned in it, so that no edge runs along a row of rays.
        to_world = pose.matrix.copy()
        to_world[:3, :3] @= Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix() * (0.05, 0.05, 1.0)
        to_world[:3, 3] = pose.matrix[:3] @ [*seen, 1.0]
        towards = pose.rotation @ [0.1, 0.0, 1.0]
        source: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
            "light": {"type": "directional", "direction": towards.tolist(), "irradiance": 1.0},
            "quad": {"type": "rectangle", "to_world": to_world, "bsdf": {"type": "twosided", "inner": DIFFUSE}},
        }
        renderer = make_renderer(Scene("quad", partial(dict, source)), camera, rays_per_pixel=256, kind=kind)
        luma = renderer.luma(Views.at_rest([pose]))[0].astype(np.float64)
        rows, columns = np.indices(luma.shape)
        centroid = [(columns * luma).sum() / luma.sum(), (rows * luma).sum() / luma.sum()]
        np.testing.assert_allclose(centroid, opencv(camera, seen), rtol=0, atol=0.03)


@pytest.mark.parametrize(
    ("coefficients", "pixel"),
    [
        ({"k1": -1.0}, (63.0, 23.5)),
        # Beyond the fold this one rises again, so that rays exist that project there, none of them the pixel's own.
        ({"k1": -1.0, "k2": 0.3}, (51.5, 23.5)),
        ({"p1": 0.9}, (31.5, 0.0)),
    ],
)
def test_a_distortion_that_folds_is_refused(coefficients: dict[str, float], pixel: tuple[float, float]) -> None:
    """Where the distortion folds over inside the image, rays() names the pixel and says what to check."""
    camera = Camera(64, 48, 40.0, 40.0, 31.5, 23.5, **coefficients)
    assert np.isfinite(camera.rays([31.5, 23.5])).all()
    with pytest.raises(ValueError, match=rf"folds over.*pixel \({pixel[0]:.2f}, {pixel[1]:.2f}\).*calib.txt's order"):
        camera.rays([[31.5, 23.5], pixel])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "width must be an integer in 1..65535, got 0"),
        ({"height": 65536}, "height must be an integer in 1..65535, got 65536"),
        ({"fx": 0.0}, "fx must be finite and > 0, got 0.0"),
        ({"fy": -3.0}, "fy must be finite and > 0, got -3.0"),
        ({"cx": float("nan")}, "cx must be finite, got nan"),
        ({"k3": float("inf")}, "k3 must be finite, got inf"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, float], message: str) -> None:
    """Sizes, focal lengths and coefficients out of range raise ValueError with the rule and the value."""
    with pytest.raises(ValueError, match=message):
        replace(DAVIS, **change)  # type: ignore[arg-type]


finite = st.floats(-1e3, 1e3)


@given(numbers=st.lists(finite, min_size=7, max_size=7), fx=st.floats(1e-3, 1e4), fy=st.floats(1e-3, 1e4))
def test_calib_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], fx: float, fy: float
) -> None:
    """to_calib() and from_calib() give back the very same nine numbers, in the order of the dataset."""
    camera = Camera(346, 260, fx, fy, *numbers)
    path = tmp_path_factory.mktemp("calib") / "calib.txt"
    path.write_text(camera.to_calib())
    assert Camera.from_calib(path, width=346, height=260) == camera
    assert [float(word) for word in camera.to_calib().split()] == [fx, fy, *numbers]


def test_calib_of_the_public_dataset(tmp_path: Path) -> None:
    """The dataset's own line, eight or nine numbers, reads as fx fy cx cy k1 k2 p1 p2 [k3] of 240 x 180 pixels."""
    path = tmp_path / "calib.txt"
    line = "199.371 199.708 133.754 113.992 -0.38290 0.18934 -0.0010025 -0.00056378"
    path.write_text(line + "\n")
    assert load_camera(path) == DAVIS
    path.write_text("\n" + line + " 0.25\n\n")
    assert load_camera(str(path)) == replace(DAVIS, k3=0.25)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found 0 lines"),
        ("1 2 3 4 5 6 7 8\n1 2 3 4 5 6 7 8\n", "found 2 lines"),
        ("\n1 2 3 4 5 6 7\n", "line 2: expected 8 or 9 numbers, found 7"),
        ("1 2 3 4 5 6 7 8 9 10", "line 1: expected 8 or 9 numbers, found 10"),
        ("1 2 3 four 5 6 7 8 9", "line 1: .*'four'"),
        ("0 2 3 4 5 6 7 8 9", "line 1: .*fx must be finite and > 0"),
        ("1 2 nan 4 5 6 7 8 9", "line 1: .*cx must be finite"),
    ],
)
def test_malformed_calib_names_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    """A calib.txt that holds no camera raises DecodeError with the file, the line and what is wrong."""
    path = tmp_path / "calib.txt"
    path.write_text(text)
    with pytest.raises(DecodeError, match=message) as caught:
        Camera.from_calib(path)
    assert str(caught.value).startswith(str(path))


def test_binary_and_missing_calib(tmp_path: Path) -> None:
    """Bytes that are no text are a DecodeError; a file that is not there stays an OSError, a bad name a ValueError."""
    path = tmp_path / "calib.txt"
    path.write_bytes(b"\xff\xfe1 2 3")
    with pytest.raises(DecodeError, match="not a text file, byte 0"):
        Camera.from_calib(path)
    with pytest.raises(FileNotFoundError):
        Camera.from_calib(tmp_path / "none.txt")
    with pytest.raises(ValueError, match=r"'davis9000' is neither a preset \(ideal, davis240c\) nor a calib.txt file"):
        load_camera("davis9000")
    assert load_camera("davis240c") is DAVIS
