"""Disparity, occlusion and rectification against closed forms, and against OpenCV's semi-global matching."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from davis_rs import (
    Camera,
    Pose,
    Rig,
    RigCamera,
    RigDataset,
    load_scene,
    rectify,
    simulate_rig_to_folder,
    stereo_truth,
)

B, F = 0.1, 100.0
CAMERA = Camera(120, 30, F, F, 59.5, 14.5)
NEAR, FAR, HALF = 1.0, 4.0, 0.15


def pair(mount: Pose | None = None, camera: Camera = CAMERA) -> Rig:
    mount = mount or Pose((B, 0, 0), (0, 0, 0, 1))
    return Rig(name="pair", cameras=(RigCamera(camera=CAMERA), RigCamera(camera=camera, mount=mount)))


def strip_depth(x_m: float) -> np.ndarray:
    """Depth of a wall with a strip before it, from a camera at x."""
    ray = (np.arange(120) - 59.5) / F
    row = np.where(np.abs(x_m + NEAR * ray) <= HALF, NEAR, FAR)
    return np.tile(row, (30, 1)).astype(np.float32)


def test_disparity_and_occlusion_of_a_strip_before_a_wall() -> None:
    """The line from the right camera to a point of the wall passes the strip, or leaves the image."""
    depth = strip_depth(0.0)
    truth = stereo_truth(pair(), depth, strip_depth(B))
    assert np.allclose(truth.disparity, F * B / depth, rtol=1e-6)
    x = np.arange(120) - F * B / depth[0]
    assert np.allclose(truth.match[..., 0], x, atol=1e-4)
    point_m = FAR * (np.arange(120) - 59.5) / F
    crossing_m = B + (point_m - B) * NEAR / FAR
    hidden = (depth[0] == FAR) & (np.abs(crossing_m) < HALF)
    outside = (x < -1) | (x >= 120)
    sure = np.abs(np.abs(crossing_m) - HALF) > 1.5 * NEAR / F  # but for the pixels of the strip's edges
    assert hidden.sum() > 5
    assert np.array_equal(truth.occluded[3][sure], (hidden | outside)[sure])
    assert not truth.consistent[3][hidden & sure].any()
    seen = ~hidden & ~outside & sure & (x >= 0)
    assert truth.consistent[3][seen].all()


def test_nothing_hit_has_no_disparity() -> None:
    depth = strip_depth(0.0)
    depth[2, 5] = np.inf
    truth = stereo_truth(pair(), depth, strip_depth(B))
    assert np.isnan(truth.disparity[2, 5])
    assert not truth.occluded[2, 5]
    with pytest.raises(ValueError, match=r"depth map of cam1 must have shape \(30, 120\)"):
        stereo_truth(pair(), depth, depth[:, :5])


def test_rectified_cameras_have_one_row_for_one_point() -> None:
    """Points of space, seen through the maps of a turned pair with a distorted lens: one row, and f B / z apart."""
    turned = Pose((0.2, 0.03, -0.02), np.array([0.02, -0.04, 0.03, 1.0]) / np.linalg.norm([0.02, -0.04, 0.03, 1.0]))
    rig = pair(turned, Camera(100, 40, 80.0, 82.0, 50.0, 20.0, k1=-0.1))
    maps = rectify(rig)
    points = np.random.default_rng(1).uniform((-0.3, -0.1, 2.0), (0.3, 0.1, 5.0), (50, 3))
    seen = []
    for each, rotation in zip(rig.cameras, (maps.left_rotation, maps.right_rotation), strict=True):
        in_camera = (points - each.mount.position) @ each.mount.rotation
        virtual = in_camera @ rotation.T
        seen.append(np.c_[maps.camera.project(virtual), virtual[:, 2]])
    left, right = seen
    assert np.allclose(left[:, 1], right[:, 1], atol=1e-9)
    assert np.allclose(left[:, 0] - right[:, 0], maps.camera.fx * maps.baseline_m / left[:, 2], atol=1e-9)
    # The map leads from a virtual pixel to the camera's own.
    ray = np.append(maps.camera.rays([60.0, 15.0]), 1.0)
    assert np.allclose(maps.right_map[15, 60], rig.cameras[1].camera.project(maps.right_rotation.T @ ray), atol=1e-4)


def test_pairs_without_disparity_are_refused() -> None:
    with pytest.raises(ValueError, match="at one place"):
        rectify(pair(Pose((0, 0, 0), (0, 0, 0, 1))))
    with pytest.raises(ValueError, match="behind each other"):
        rectify(pair(Pose((0, 0, 0.1), (0, 0, 0, 1))))
    with pytest.raises(ValueError, match=r"one of 0\.\.1"):
        rectify(pair(), 0, 2)


def test_semi_global_matching_finds_the_disparity(tmp_path: Path) -> None:
    """On rendered frames OpenCV's matcher is within a pixel of the truth, where the right camera sees the point."""
    cv2 = pytest.importorskip("cv2")
    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    rig = Rig(
        name="p", cameras=(RigCamera(camera=camera), RigCamera(camera=camera, mount=Pose((B, 0, 0), (0, 0, 0, 1))))
    )
    simulate_rig_to_folder(
        load_scene("three_planes"),
        tmp_path / "rig",
        rig=rig,
        duration_s=0.002,
        accuracy="fast",
        image_gain=1,
        quiet=True,
    )
    dataset = RigDataset(tmp_path / "rig")
    truth = dataset.stereo_truth(0)
    left, right = (each.read_image(0) for each in dataset.cameras.values())
    found = cv2.StereoSGBM.create(0, 64, 5, P1=200, P2=800).compute(left, right) / 16
    known = (found > 0) & np.isfinite(truth.disparity) & ~truth.occluded
    assert known.mean() > 0.5
    off = np.abs(found - truth.disparity)[known]
    assert np.median(off) < 0.5
    assert (off < 1).mean() > 0.85
    assert np.abs(found - truth.disparity * 1.1)[known].mean() > 2 * off.mean()
