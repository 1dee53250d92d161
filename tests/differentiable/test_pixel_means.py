"""The mean of a pixel at edges: its derivatives against those of a straight edge, which are known in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Flicker, Pose, Scene, SegmentTrajectory, simulate
from davis_rs.differentiable import event_time_jacobian
from davis_rs.differentiable.edge_passes import ChangedRays, EdgePasses, Passes
from davis_rs.differentiable.log_luma import LogLumaField
from davis_rs.differentiable.pixel_means import MeanLogLumaField
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer

CAMERA = Camera(16, 12, 40.0, 36.0, 7.5, 5.5)
NEAR_M, SPEED_M_S, DURATION_S, LOG_EPS = 2.0, 4.0, 0.02, 1e-3
ANGLE = 0.3
"""Of the edge's normal with the x axis: within a pixel the edge runs from its top to its bottom."""


def grey(reflectance: float) -> dict[str, Any]:
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [reflectance] * 3}}
    return {"type": "twosided", "inner": bsdf}


def half_plane(**fields: Any) -> Scene:
    """A bright half-plane over a dark wall, in even light. Half-way its edge is in the middle of pixel (8, 6)."""
    x, y = ((np.array([8.0, 6.0]) - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy] * NEAR_M).tolist()
    x += SPEED_M_S * DURATION_S / 2
    turned = np.eye(4)
    turned[:2, :2] = [[math.cos(ANGLE), -math.sin(ANGLE)], [math.sin(ANGLE), math.cos(ANGLE)]]
    left, there = np.diag([5.0, 5.0, 1.0, 1.0]), np.eye(4)
    left[0, 3] = -5.0
    there[:3, 3] = [x, y, NEAR_M]
    wall = np.diag([50.0, 50.0, 1.0, 1.0])
    wall[2, 3] = 4.0
    source = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "sky": {"type": "constant", "radiance": 1.0},
        "near": {"type": "rectangle", "to_world": there @ turned @ left, "bsdf": grey(0.8)},
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": grey(0.2)},
    }
    still = [0.0, 0.0, 0.0, 1.0]
    path = SegmentTrajectory(Pose([0, 0, 0], still), Pose([SPEED_M_S * DURATION_S, 0, 0], still), DURATION_S)
    return Scene(source=lambda: source, camera=CAMERA, name="half-plane", trajectory=path, shadows=False, **fields)


def fields_of(scene: Scene, rays_per_pixel: int) -> tuple[MeanLogLumaField, LogLumaField]:
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=rays_per_pixel, blur=False)
    assert isinstance(renderer, NativeRenderer)
    return MeanLogLumaField(renderer, scene.path, LOG_EPS), LogLumaField(renderer, scene.path, LOG_EPS)


def by_pose(luma: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """dL by an increment of the pose in the middle of the path, of pixel (8, 6), whose centre the edge goes through.

    A shift of the edge by (u, v) pixels moves it by u + v tan(angle) along x, over the whole height of the pixel.
    """
    bright, dark, here = luma
    x, y = (8 - CAMERA.cx) / CAMERA.fx, (6 - CAMERA.cy) / CAMERA.fy
    # Where a place (x, y) z is seen, by a shift of the camera and by a turn about its axes.
    shift = np.array([[-1, 0, x], [0, -1, y]]) / NEAR_M
    turn = np.array([[x * y, -(1 + x * x), y], [1 + y * y, -x * y, -x]])
    columns = np.concatenate([shift, turn], 1)
    # The edge's normal, on the plane at depth 1, is (cos, sin) of the angle.
    along_x_px = CAMERA.fx * (columns[0] + columns[1] * math.tan(ANGLE))
    return np.asarray((bright - dark) * along_x_px / (here + LOG_EPS))


def test_edges_add_what_a_straight_edge_adds() -> None:
    """By all six unknowns of the pose, and over time; without them the derivative is 0."""
    scene = half_plane()
    mean, surfaces = fields_of(scene, 987)
    middle_us = np.full(3, DURATION_S / 2 * 1e6)
    pixel = np.array([6 * 16 + 2, 6 * 16 + 14, 6 * 16 + 8])
    seen, alone = mean.at(middle_us, pixel), surfaces.at(middle_us, pixel)
    luma = np.exp(seen.value) - LOG_EPS
    expected = by_pose(luma)
    assert np.abs(seen.pose[2] - expected).max() < 0.01 * np.abs(expected).max()
    assert seen.rate[2] == pytest.approx(expected[0] * SPEED_M_S, rel=0.01)
    assert np.abs(seen.pose[:2]).max() < 1e-9 * np.abs(expected).max()  # no edge there
    assert np.abs(alone.pose).max() < 1e-9 * np.abs(expected).max()
    few = fields_of(scene, 64)[0].at(middle_us, pixel)
    assert np.abs(few.pose[2] - expected).max() < 0.15 * np.abs(expected).max()


def test_edges_are_of_the_pixels_that_they_are_in() -> None:
    """The height of the edge in each pixel counts there, also where the rays next to it are those of other pixels."""
    mean, alone = fields_of(half_plane(), 64)
    pixel = np.array([6, 7, 8, 9]) + CAMERA.width * 6
    shares, sums = [], []
    for at_px in np.linspace(6.9, 8.1, 25):
        middle = DURATION_S / 2 + (8 - at_px) * NEAR_M / CAMERA.fx / SPEED_M_S
        of_mean, surfaces = (field.at(np.full(4, 1e6 * middle), pixel) for field in (mean, alone))
        found = (of_mean.pose - surfaces.pose)[:, 0] * np.exp(of_mean.value)
        half = math.tan(ANGLE) * CAMERA.fx / CAMERA.fy / 2  # the edge runs from at_px - half to at_px + half
        borders = np.clip((np.arange(5.5, 10) - at_px) / (2 * half) + 0.5, 0, 1)
        shares.append(found / found.sum() - np.diff(borders))
        sums.append(found.sum())
    assert np.abs(shares).max() < 0.08
    assert np.mean(sums) == pytest.approx(-0.6 * CAMERA.fx / NEAR_M, rel=0.02)


def test_a_change_without_an_edge_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = EdgePasses.passes

    def lost(self: EdgePasses, ends: tuple[Views, Views], rays: ChangedRays) -> Passes:
        passes = whole(self, ends, rays)
        passes.fraction[::20] = np.nan
        return passes

    monkeypatch.setattr(EdgePasses, "passes", lost)
    mean, _ = fields_of(half_plane(), 64)
    here = mean.at(np.full(2, 1e6 * DURATION_S / 2), 6 * CAMERA.width + np.array([8, 2]))
    assert np.isnan(here.pose[0]).all()
    assert not here.pose[1].any()  # no edge there


def test_event_times_are_those_of_the_edge() -> None:
    """The camera's shift moves each event of the edge by 1 / speed, and a threshold by how fast the mean changes."""
    scene = half_plane()
    settings: dict[str, Any] = {"rays_per_pixel": 1024, "blur": False, "contrast_threshold": 0.1, "log_eps": LOG_EPS}
    run = {"accuracy": "exact", **settings}
    events = concatenate_events([packet.events for packet in simulate(scene, frame_rate_hz=0, depth_rate_hz=0, **run)])
    events = events[(events["x"] == 8) & (events["y"] == 6)]
    assert len(events) >= 5
    jacobian, ok = event_time_jacobian(scene, events, edges="mean", **run)
    assert ok.all()
    assert jacobian[:, 0] == pytest.approx(-1e6 / SPEED_M_S, rel=0.03)
    mean, _ = fields_of(scene, 1024)
    luma = np.exp(mean.at(np.array([0.0, 0.0]), np.array([6 * 16 + 2, 6 * 16 + 14])).value) - LOG_EPS
    level = mean.at_start(np.array([6 * 16 + 8])).value[0]
    sign = np.where(events["p"], 1, -1)
    reached = np.exp(level + sign * 0.1 * np.arange(1, len(events) + 1))
    # Near its first and its last corner the edge does not run over the whole height of the pixel.
    inside = np.abs((reached - LOG_EPS - luma.min()) / np.ptp(luma) - 0.5) < 0.3
    assert inside.sum() >= 4
    rate = (luma[0] - luma[1]) * CAMERA.fx / NEAR_M * SPEED_M_S / reached
    by_threshold = np.where(events["p"], jacobian[:, 6], jacobian[:, 7])
    expected = 1e6 * np.arange(1, len(events) + 1) / rate
    assert np.abs(by_threshold)[inside] == pytest.approx(np.abs(expected)[inside], rel=0.05)
    assert (np.sign(by_threshold) == sign * np.sign(expected) * sign).all()
    few, known = event_time_jacobian(scene, events, **run)
    assert (few[known, 0] != 0).all()  # single rays' jumps have their own times
    assert (few[known][:, 6:] == 0).all()


def test_what_has_no_mean_is_refused() -> None:
    """Something that moves, and a kind of edges that does not exist. Lights may change."""
    moving = half_plane(
        objects={"near": SegmentTrajectory(Pose([0, 0, 0], [0, 0, 0, 1]), Pose([0.1, 0, 0], [0, 0, 0, 1]), 0.02)}
    )
    events = np.zeros(0, concatenate_events([]).dtype)
    with pytest.raises(ValueError, match="the mean of a pixel at edges has derivatives in a scene at rest"):
        event_time_jacobian(moving, events, edges="mean")
    with pytest.raises(ValueError, match="edges must be 'rays' or 'mean', got 'pixels'"):
        event_time_jacobian(half_plane(), events, edges="pixels")
    flickering = half_plane(lights={"sky": Flicker(100.0, modulation=0.5)})
    jacobian, ok = event_time_jacobian(flickering, events, edges="mean", rays_per_pixel=16)
    assert jacobian.shape == (0, 8)
    assert len(ok) == 0
