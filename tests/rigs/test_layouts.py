"""A rig's folder in the layouts of published stereo data sets: what their own loaders ask for is there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import davis_rs
from davis_rs import Camera, Pose, Rig, RigCamera, RigDataset, convert_rig, load_scene, rectify
from davis_rs.cli.main import main
from davis_rs.inspection.figure import view
from davis_rs.inspection.page_layers import layers_of
from davis_rs.inspection.truth_pictures import HIDDEN
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.io.dataset.disparity_png import decode_disparity, encode_disparity
from davis_rs.io.files.conversion import LeftOutWarning
from davis_rs.sensor.rig import CameraClock

h5py = pytest.importorskip("h5py")
pytest.importorskip("hdf5plugin")

LEFT = Camera(64, 48, 60.0, 61.0, 31.0, 24.5, k1=-0.1, k2=0.02, p1=1e-3)
RIGHT = Camera(60, 50, 58.0, 58.0, 30.0, 25.0, k1=-0.08)
MOUNT = Pose((0.1, 0.003, -0.002), (0.005, -0.01, 0.004, 0.99992))
PAIR = Rig(name="pair", cameras=(RigCamera(camera=LEFT), RigCamera(camera=RIGHT, mount=MOUNT)))
MS = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A turned, distorted pair; 60 ms, 3 depth maps."""
    path = tmp_path_factory.mktemp("rig") / "pair"
    davis_rs.simulate_rig_to_folder(
        load_scene("three_planes"), path, rig=PAIR, duration_s=MS / 1000, accuracy="fast", depth_rate_hz=50, quiet=True
    )
    return path


def test_the_folder_has_disparity_and_occlusion(folder: Path) -> None:
    """Those of stereo_truth, to 1/256 px, at each depth map."""
    dataset = RigDataset(folder)
    assert [each.t_us for each in dataset.disparities] == [0, 20_000, 40_000, 60_000]
    assert [each.t_us for each in dataset.occlusions] == [each.t_us for each in dataset.disparities]
    for index in range(4):
        truth = dataset.stereo_truth(index)
        assert np.nanmax(np.abs(dataset.read_disparity(index) - truth.disparity)) <= 0.5 / 256 + 1e-6
        assert np.array_equal(np.isnan(dataset.read_disparity(index)), np.isnan(truth.disparity))
        assert np.array_equal(dataset.read_occlusion(index), truth.occluded)
        assert 0 < truth.occluded.mean() < 0.5
    assert json.loads((folder / "meta.json").read_text())["counts"]["disparities"] == 4


def test_view_draws_the_disparity_of_the_first_camera(folder: Path, tmp_path: Path) -> None:
    """In the figure with its range and what is hidden, in the page as one more layer; not of the other camera."""
    figure: Any = view(folder / "cam0")
    (axes,) = (axes for axes in figure.axes if "disparity, t = " in axes.get_title())
    disparity, occluded = RigDataset(folder).read_disparity(1), RigDataset(folder).read_occlusion(1)
    shown, hidden = axes.images
    np.testing.assert_array_equal(shown.get_array().filled(np.nan), disparity)
    np.testing.assert_array_equal(hidden.get_array()[..., 3] > 0, occluded & np.isfinite(disparity))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["not seen by cam1"]
    assert not any("disparity" in axes.get_title() for axes in view(folder / "cam1").axes)
    layers = {layer.name: layer for layer in layers_of(open_visual_sequence(folder / "cam0"))}
    assert list(layers) == ["frame", "depth", "disparity"]
    picture = layers["disparity"].picture(1)
    np.testing.assert_array_equal((picture == HIDDEN).all(-1), occluded & np.isfinite(disparity))
    seen = np.where(occluded, np.nan, disparity)
    near, far = (picture.reshape(-1, 3)[number(seen)] for number in (np.nanargmax, np.nanargmin))
    assert near[0] > 0.9 > 0.5 > far[0]


def test_disparity_in_16_bits() -> None:
    values = np.array([[np.nan, 0.0, 0.5 / 256 - 1e-4, 0.6 / 256, 1.0, 255.998, 256.0, 1e9, -1.0]], np.float32)
    from io import BytesIO

    from PIL import Image

    with Image.open(BytesIO(encode_disparity(values))) as image:
        steps = np.array(image).astype(np.uint16)
    assert steps.tolist() == [[0, 0, 0, 1, 256, 65535, 0, 0, 0]]
    assert np.allclose(decode_disparity(steps)[0, 3:6], [1 / 256, 1.0, 65535 / 256])
    assert np.isnan(decode_disparity(steps)[0, [0, 1, 2, 6, 7, 8]]).all()


def test_dsec_is_what_its_own_loader_reads(folder: Path, tmp_path: Path) -> None:
    """Events by ms_to_idx, rectified coordinates, disparity in the rectified left camera, and depth from it."""
    target = tmp_path / "dsec"
    with pytest.warns(LeftOutWarning, match=r"dsec\) cannot hold, and leaves out: left 3 frames, .*; right 3 frames"):
        report = convert_rig(folder, target)
    dataset = RigDataset(folder)
    assert report.disparities == 4
    rectified = rectify(PAIR)
    for side, number, rotation in (("left", 0, rectified.left_rotation), ("right", 1, rectified.right_rotation)):
        events = dataset.cameras[number].events
        with h5py.File(target / "events" / side / "events.h5") as file:
            t, index = file["events/t"][()].astype(np.int64), file["ms_to_idx"][()].astype(np.int64)
            assert np.array_equal(t + int(file["t_offset"][()]), events["t"])
            for name in "xyp":
                assert np.array_equal(file[f"events/{name}"], events[name])
            # Both rules of the format; an entry for each millisecond up to the end of the sequence, and one more.
            assert len(index) == MS + 2
            for ms, at in enumerate(index.tolist()):
                assert at == len(t) or t[at] >= 1000 * ms
                assert at == 0 or t[at - 1] < 1000 * ms
        with h5py.File(target / "events" / side / "rectify_map.h5") as file:
            lookup = file["rectify_map"][()]
        lens = PAIR.cameras[number].camera
        assert lookup.shape == (lens.height, lens.width, 2)
        ray = rotation @ np.array([*lens.rays([[7.0, 40.0]])[0], 1.0])
        assert np.allclose(lookup[40, 7], rectified.camera.project(ray), atol=1e-3)
    stamps = np.loadtxt(target / "disparity" / "timestamps.txt", dtype="int64")
    assert stamps.tolist() == [0, 20_000, 40_000, 60_000]
    cv2 = pytest.importorskip("cv2")
    files = sorted((target / "disparity" / "event").iterdir())
    assert [each.stem for each in files] == ["000000", "000001", "000002", "000003"]
    disparity = cv2.imread(str(files[1]), cv2.IMREAD_ANYDEPTH).astype("float32") / 256
    # Each pixel of the rectified camera has the disparity of the nearest pixel of the left one.
    own = dataset.stereo_truth(1).disparity
    at = np.rint(rectified.left_map).astype(int)
    inside = (at >= 0).all(-1) & (at[..., 0] < LEFT.width) & (at[..., 1] < LEFT.height)
    warped = np.where(inside, own[at[..., 1].clip(0, 47), at[..., 0].clip(0, 63)], np.nan)
    assert np.abs(np.nan_to_num(warped) - disparity).max() <= 0.5 / 256 + 1e-6
    assert np.abs(np.nan_to_num(own) - disparity).max() > 0.1
    calibration = yaml.safe_load((target / "calibration" / "cam_to_cam.yaml").read_text())
    to_depth = np.array(calibration["disparity_to_depth"]["cams_03"])
    depth = dataset.cameras[0].read_depth(1)
    count = 0
    for y, x in ((10, 20), (24, 31), (30, 50), (40, 12)):
        u, v = rectified.left_map[y, x]
        column, row = round(float(u)), round(float(v))
        if disparity[y, x] == 0 or not np.isfinite(depth[row, column]):
            continue
        count += 1
        point = to_depth @ [x, y, disparity[y, x], 1.0]
        seen = np.append(LEFT.rays([[column, row]])[0], 1.0) * depth[row, column]
        assert np.isclose(point[2] / point[3], (rectified.left_rotation @ seen)[2], rtol=0.003)
    assert count >= 3
    assert calibration["intrinsics"]["cam0"]["distortion_coeffs"] == [-0.1, 0.02, 1e-3, 0.0]
    assert np.allclose(calibration["extrinsics"]["T_30"], PAIR.relative_pose(1, 0).matrix)
    assert np.allclose(calibration["extrinsics"]["R_rect3"], rectified.right_rotation)


def test_a_disparity_leads_to_the_same_point_in_the_right_camera(folder: Path, tmp_path: Path) -> None:
    """By both rectify_maps alone: a pixel of the left camera and its match lie in one row, the disparity apart."""
    with pytest.warns(LeftOutWarning):
        convert_rig(folder, tmp_path / "dsec")
    maps = []
    for side in ("left", "right"):
        with h5py.File(tmp_path / "dsec" / "events" / side / "rectify_map.h5") as file:
            maps.append(file["rectify_map"][()])
    truth = RigDataset(folder).stereo_truth(2)
    known = ~truth.occluded & np.isfinite(truth.disparity)
    x, y = np.rint(truth.match[known]).astype(np.int64).T
    inside = (x >= 0) & (x < RIGHT.width) & (y >= 0) & (y < RIGHT.height)
    left, right = maps[0][known][inside], maps[1][y[inside], x[inside]]
    assert np.median(np.abs(left[:, 1] - right[:, 1])) < 0.5
    assert np.median(np.abs(left[:, 0] - truth.disparity[known][inside] - right[:, 0])) < 0.5
    assert np.abs(left - right)[:, 0].mean() > 1


def test_a_notebook_shows_what_the_folder_of_a_rig_has(folder: Path) -> None:
    dataset = RigDataset(folder)
    shown = dataset._repr_html_()
    for number, camera in dataset.cameras.items():
        width, height = camera.size or (0, 0)
        assert (
            f"cam{number}</th><td style='text-align:left'>{width} x {height} px, {len(camera.events):,} events" in shown
        )
    assert f"{len(dataset.disparities)} maps of cam0 with cam1" in shown


def test_mvsec_has_both_cameras_in_one_file(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "pair.hdf5"
    with pytest.warns(LeftOutWarning, match="pair.hdf5"):
        report = convert_rig(folder, target)
    dataset = RigDataset(folder)
    with h5py.File(target) as file:
        for number, side in enumerate(("left", "right")):
            camera, group = dataset.cameras[number], file[f"davis/{side}"]
            rows = group["events"][()]
            assert len(rows) == len(camera.events) == report.events[number]
            assert np.array_equal(np.rint(1e6 * rows[:, 2]), camera.events["t"])
            assert np.array_equal(rows[:, 0], camera.events["x"])
            assert np.array_equal(rows[:, 3], 2.0 * camera.events["p"] - 1)
            assert np.array_equal(group["image_raw"][1], camera.read_image(1))
            assert np.array_equal(np.isnan(group["depth_image_raw"][1]), np.isinf(camera.read_depth(1)))
            assert np.allclose(group["pose"][0][:3, 3], camera.groundtruth.positions[0])
    assert len(davis_rs.read_events(target)) == report.events[0]
    assert not list(tmp_path.glob(".*"))


def test_one_bag_has_mvsecs_topics(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Reader

    from davis_rs.io.formats.ros_messages import typestore

    target = tmp_path / "pair.bag"
    with pytest.warns(LeftOutWarning, match="pair.bag"):
        report = convert_rig(folder, target)
    store: Any = typestore()
    events = {"left": 0, "right": 0}
    with Reader(target) as reader:
        names = {each.topic.removeprefix("/davis/") for each in reader.connections}
        of_each = ("events", "image_raw", "camera_info", "pose", "depth_image_raw")
        assert names == {f"{side}/{name}" for side in events for name in of_each}
        last = 0
        for connection, t_ns, data in reader.messages():
            assert t_ns >= last
            last = t_ns
            side = connection.topic.split("/")[2]
            message = store.deserialize_ros1(data, connection.msgtype)
            if connection.topic.endswith("/events"):
                assert (message.width, message.height) == ((64, 48) if side == "left" else (60, 50))
                events[side] += len(message.events)
            if not connection.topic.endswith("pose"):
                assert message.header.frame_id == f"davis_{side}"
    assert (events["left"], events["right"]) == report.events
    assert min(report.events) > 1000
    assert not list(tmp_path.glob(".*"))


def test_what_cannot_be_laid_out_is_refused(folder: Path, tmp_path: Path) -> None:
    """Nothing is left behind, and nothing is replaced that was not asked for."""
    with pytest.raises(ValueError, match=r"no layout of a rig ends in '.xyz': give one of dsec, mvsec, bag"):
        convert_rig(folder, tmp_path / "pair.xyz")
    with pytest.raises(ValueError, match="layout of a rig must be one of"):
        convert_rig(folder, tmp_path / "pair", layout="kitti")
    with pytest.raises(ValueError, match="two cameras, got 0 twice"):
        convert_rig(folder, tmp_path / "pair", right=0)
    with pytest.raises(ValueError, match="camera"):
        convert_rig(folder, tmp_path / "pair", right=2)
    with pytest.raises(FileNotFoundError, match=r"no rig\.yaml"):
        convert_rig(folder / "cam0", tmp_path / "pair")
    assert not list(tmp_path.iterdir())
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with pytest.raises(FileExistsError, match="overwrite"):
        convert_rig(folder, tmp_path / "mine")
    for layout in ("dsec", "bag"):
        with pytest.raises(FileExistsError, match="not in DSEC's layout"):
            convert_rig(folder, tmp_path / "mine", layout=layout, overwrite=True)
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileExistsError, match="in the way"):
        convert_rig(folder, tmp_path / "file", overwrite=True)
    with pytest.warns(LeftOutWarning):
        convert_rig(folder, tmp_path / "out")
    with pytest.warns(LeftOutWarning):
        convert_rig(folder, tmp_path / "out", overwrite=True)
    assert (tmp_path / "mine" / "thesis.tex").read_text() == "x"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "mine", "out"]


def test_dsec_has_one_clock(tmp_path: Path) -> None:
    late = Rig(name="late", cameras=(PAIR.cameras[0], RigCamera(camera=RIGHT, mount=MOUNT, clock=CameraClock(0.001))))
    scene = load_scene("three_planes")
    davis_rs.simulate_rig_to_folder(scene, tmp_path / "late", rig=late, duration_s=0.02, accuracy="fast", quiet=True)
    with pytest.raises(ValueError, match="DSEC's layout has one clock for both cameras"):
        convert_rig(tmp_path / "late", tmp_path / "out")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["late"]


def test_the_command_line_converts_rigs(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "out"
    assert main(["convert", str(folder), str(target), "--quiet"]) == 0
    told = capsys.readouterr()
    assert f"{target}: dsec, " in told.out
    assert "4 disparity maps" in told.out
    assert told.err.count("leaves out") == 1
    assert main(["convert", str(folder), str(target), "--start", "0.1", "--quiet"]) != 0
    assert "--start is not for rigs" in capsys.readouterr().err


def test_a_pair_that_cannot_be_rectified_has_no_disparity(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two cameras at one place: the rest is written, and a line says why there is none."""
    same = Rig(name="same", cameras=(RigCamera(camera=LEFT), RigCamera(camera=RIGHT)))
    scene = load_scene("three_planes")
    davis_rs.simulate_rig_to_folder(scene, tmp_path / "same", rig=same, duration_s=0.01, accuracy="fast")
    assert not RigDataset(tmp_path / "same").disparities
    assert "no disparity is written" in capsys.readouterr().err
