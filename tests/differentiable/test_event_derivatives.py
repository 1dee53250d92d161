"""Blocks of derivatives of event times, and residuals of measured events, against crossings that are found again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

# isort: split
from test_event_gradients import CAMERA, EXACT, PATH, SCENES, events_of

from davis_rs import Scene, SegmentTrajectory
from davis_rs.differentiable import (
    EventTimeDerivatives,
    EventTimes,
    event_log_luma_residuals,
    event_time_derivatives,
    event_time_jacobian,
    event_time_residuals,
    moved,
    spline_weights,
)
from davis_rs.differentiable.event_jacobian import EventTimeModel
from davis_rs.differentiable.moved_path import MovedPath, right_jacobians
from davis_rs.events.arrays import EventArray

FloatArray = npt.NDArray[np.float64]

SCENE = replace(SCENES["shadows"], blur=True)
SETTINGS: dict[str, Any] = {**EXACT, "contrast_threshold": 0.04, "contrast_threshold_off": 0.05}
PIXELS = CAMERA.width * CAMERA.height


@pytest.fixture(scope="module")
def events() -> EventArray:
    found = events_of(SCENE, **SETTINGS)
    return found[(7 * found["y"].astype(int) + found["x"]) % 11 == 0]


@pytest.fixture(scope="module")
def derivatives(events: EventArray) -> EventTimeDerivatives:
    return event_time_derivatives(SCENE, events, **SETTINGS)


def predicted(scene: Scene, events: EventArray, **settings: Any) -> FloatArray:
    """Times of all events, searched without derivatives of unknowns; NaN where there is none."""
    t_us = np.full(len(events), np.nan)
    for block in event_time_residuals(scene, events, within_us=50.0, **{**SETTINGS, **settings}):
        t_us[block.index] = events["t"][block.index] - 0.5 + block.residual_us
    return t_us


def check(by_unit: FloatArray, times: list[FloatArray], step: float, ok: npt.NDArray[np.bool_]) -> None:
    """The derivative along a direction is that of the times, but for events at the corners of things.

    ``times`` are those a step ahead and a step behind.
    """
    ahead, behind = times
    truth = (ahead - behind) / (2 * step)
    known = ok & np.isfinite(truth)
    assert known.sum() > 0.95 * ok.sum() > 100
    typical = np.median(np.abs(truth[known]))
    assert typical * step > 0.01
    off = np.abs(by_unit - truth)[known]
    assert (off <= 0.02 * (typical + np.abs(truth[known]))).mean() > 0.96


def test_control_points(events: EventArray, derivatives: EventTimeDerivatives) -> None:
    """Points that are all the same move the path as a whole; others as the spline moves it, at event and start."""
    same = np.arange(1.0, 7.0)
    block = derivatives.control_points(5)
    pose = derivatives.jacobian(("pose",))
    ok = derivatives.ok
    np.testing.assert_allclose((block @ np.tile(same, 5))[ok], (pose @ same)[ok], rtol=1e-9, atol=1e-4)
    assert not block[~ok].nnz
    points = np.random.RandomState(0).normal(size=(5, 6)) * [1, 1, 1, 0.5, 0.5, 0.5]
    step = 2e-7
    times = [predicted(moved(SCENE, sign * step * points), events) for sign in (1, -1)]
    check(block @ points.ravel(), times, step, ok)
    parts = derivatives.pose_parts()
    np.testing.assert_allclose((parts[0] + parts[1])[ok], pose[ok])
    weights = spline_weights(derivatives.t_us * 1e-6, 5, duration_s=0.05) @ points
    start = spline_weights([0.0], 5, duration_s=0.05) @ points
    np.testing.assert_allclose(
        (block @ points.ravel())[ok], (parts[0] * weights + parts[1] * start).sum(1)[ok], rtol=1e-9, atol=1e-3
    )


@pytest.mark.long
def test_increments_of_a_path_that_is_moved_already(events: EventArray) -> None:
    """A rotation vector that is added to another is not a rotation after it."""
    points = np.random.RandomState(1).normal(size=(4, 6)) * [0.02, 0.02, 0.02, 0.3, 0.3, 0.3]
    direction = np.random.RandomState(2).normal(size=(4, 6))
    scene = moved(SCENE, points)
    events = events_of(scene, **SETTINGS)
    events = events[(7 * events["y"].astype(int) + events["x"]) % 11 == 0]
    found = event_time_derivatives(scene, events, **SETTINGS)
    times = [predicted(moved(SCENE, points + sign * 1e-5 * direction), events) for sign in (1, -1)]
    check(found.control_points(4) @ direction.ravel(), times, 1e-5, found.ok)


def test_thresholds_of_each_pixel(events: EventArray, derivatives: EventTimeDerivatives) -> None:
    block = derivatives.contrast_threshold_map()
    assert block.shape == (len(events), 2 * PIXELS)
    both = derivatives.jacobian(("contrast_threshold",))
    ok = derivatives.ok
    uniform = np.stack([block[:, :PIXELS].sum(1), block[:, PIXELS:].sum(1)], 1)
    np.testing.assert_allclose(uniform[ok], both[ok])
    direction, step = np.random.RandomState(0).normal(size=(2, CAMERA.height, CAMERA.width)), 2e-6
    base = np.array([0.04, 0.05])[:, None, None]
    times = [predicted(SCENE, events, thresholds=base + sign * step * direction) for sign in (1, -1)]
    check(block @ direction.ravel(), times, step, ok)


def test_a_clock_that_drifts(events: EventArray, derivatives: EventTimeDerivatives) -> None:
    """The same way in a longer time: every event is later by as much."""
    jacobian = derivatives.jacobian(("clock_drift",))[:, 0]
    times = []
    for sign in (1, -1):
        path = SegmentTrajectory(PATH.start, PATH.end, PATH.duration_s * (1 + sign * 1e-5))
        times.append(predicted(replace(SCENE, trajectory=path), events))
    check(jacobian, times, 1e-5, derivatives.ok)


def texels_changed(scene: Scene, shape: str, change: FloatArray) -> Scene:
    source: Any = scene.source()
    parts = dict(source[shape])
    bsdf = dict(parts["bsdf"])
    inner = dict(bsdf["inner"])
    bitmap = dict(inner["reflectance"])
    bitmap["data"] = (bitmap["data"].astype(np.float64) + change[..., None]).astype(np.float32)
    inner["reflectance"] = bitmap
    bsdf["inner"] = inner
    parts["bsdf"] = bsdf
    return replace(scene, source=lambda: {**source, shape: parts})


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["shadows", "moving"])
def test_luma_by_texels(name: str) -> None:
    """Luma is linear in reflectance: of the floor under lights of two colours, and of the box's mirrored texture."""
    scene = replace(SCENES[name], blur=True)
    for shape in ("floor", "box"):
        change = np.random.RandomState(0).uniform(0, 0.05, (32, 32))
        fields = [EventTimeModel(one, **EXACT).field for one in (scene, texels_changed(scene, shape, change))]
        pixel = np.arange(PIXELS)
        t_us = np.linspace(0, 5e4, PIXELS)
        before, after = (np.exp(field.at(t_us, pixel).value) - field.log_eps for field in fields)
        derivatives = event_time_derivatives(scene, events_of(scene, **EXACT)[:1], **EXACT)
        columns = derivatives.texture_columns()[f"{shape}.reflectance"]
        assert columns.shape == (32, 32)
        by_texel = fields[0].by_texel(t_us, pixel)
        found = (by_texel[:, columns.ravel()] @ change.ravel()) * (before + fields[0].log_eps)
        assert np.ptp(found) > 0.01
        np.testing.assert_allclose(found, after - before, atol=2e-6)


def test_event_times_by_texels(events: EventArray, derivatives: EventTimeDerivatives) -> None:
    change, step = np.random.RandomState(0).uniform(-1, 1, (32, 32)), 2e-5
    columns = derivatives.texture_columns()["floor.reflectance"].ravel()
    block = derivatives.reflectance()
    times = [predicted(texels_changed(SCENE, "floor", sign * step * change), events) for sign in (1, -1)]
    check(block[:, columns] @ change.ravel(), times, step, derivatives.ok)


def test_residuals_at_the_truth(events: EventArray) -> None:
    blocks = list(event_time_residuals(SCENE, events, block=30, **SETTINGS))
    assert len(blocks) > 5
    index = np.concatenate([block.index for block in blocks])
    np.testing.assert_array_equal(np.sort(index), np.arange(len(events)))
    pixel = events["y"].astype(int) * CAMERA.width + events["x"]
    own = [set(pixel[block.index].tolist()) for block in blocks]
    assert sum(map(len, own)) == len(set().union(*own))
    ok = np.concatenate([block.ok for block in blocks])
    residual = np.concatenate([block.residual_us for block in blocks])
    assert ok.mean() > 0.97
    assert np.quantile(np.abs(residual[ok]), 0.97) < 0.6
    assert not np.concatenate([block.count_differs for block in blocks])[ok].mean() > 0.03


@pytest.mark.long
def test_residuals_far_from_the_truth(events: EventArray) -> None:
    """Gauss-Newton finds the pose again from 5 mm and a quarter of a degree off."""
    estimate = np.array([4e-3, -2e-3, 2e-3, 3e-3, -2e-3, 2e-3])
    known = differs = 0.0
    for turn in range(12):
        normal, gradient, residuals = np.zeros((6, 6)), np.zeros(6), []
        blocks = list(event_time_residuals(moved(SCENE, estimate), events, **SETTINGS))
        size = np.median(np.abs(np.concatenate([block.residual_us[block.ok] for block in blocks])))
        for block in blocks:
            jacobian, residual = block.derivatives.jacobian(("pose",))[block.ok], block.residual_us[block.ok]
            weighted = jacobian / np.maximum(1, np.abs(residual) / (2 * size + 0.3))[:, None]
            normal += weighted.T @ jacobian
            gradient += weighted.T @ residual
            residuals.append(residual)
        if turn == 0:
            known = sum(block.ok.sum() for block in blocks) / len(events)
            differs = np.concatenate([block.count_differs for block in blocks]).mean()
            assert size > 200
        estimate -= np.linalg.solve(normal, gradient)
    assert 0.5 < known < 1.0
    assert differs > 0.1
    assert np.abs(estimate[:3]).max() < 2e-6
    assert np.abs(estimate[3:]).max() < 2e-6


def test_what_has_no_crossing_is_not_known(events: EventArray) -> None:
    """Within 20 us nothing is found for a path that is a millimetre off, and its pixels have other events."""
    (block,) = event_time_residuals(moved(SCENE, [1e-3, 0, 0, 0, 0, 0]), events, within_us=20.0, **SETTINGS)
    nothing = np.isnan(block.residual_us)
    assert nothing.mean() > 0.5
    assert not block.ok[nothing].any()
    assert block.count_differs[nothing].all()
    assert np.nanmax(np.abs(block.residual_us)) <= 20.5
    missing = events[: len(events) // 2]
    (block,) = event_time_residuals(SCENE, missing, **SETTINGS)
    assert block.count_differs.mean() > 0.5
    assert block.ok.mean() > 0.97


def test_a_moved_path() -> None:
    """Velocity and body rate are derivatives of the poses; constant increments are those of the pose."""
    points = np.random.RandomState(0).normal(size=(6, 6)) * 0.3
    t, h = np.linspace(0.003, 0.047, 7), 1e-7
    for path in (MovedPath(PATH, points), MovedPath(PATH, points[0]), MovedPath(PATH, points, degree=1)):
        before, after = (Rotation.from_quat(path.quaternions(t + sign * h)) for sign in (-1, 1))
        velocity = (path.positions(t + h) - path.positions(t - h)) / (2 * h)
        np.testing.assert_allclose(path.velocities(t), velocity, atol=1e-6)
        np.testing.assert_allclose(path.angular_rates(t), (before.inv() * after).as_rotvec() / (2 * h), atol=1e-6)
    vector = np.array([[0.4, -0.8, 0.3], [0.0, 0.0, 0.0], [2e-5, 1e-5, -3e-5]])
    for axis in range(3):
        step = 1e-7 * np.eye(3)[axis]
        turned = Rotation.from_rotvec(vector - step).inv() * Rotation.from_rotvec(vector + step)
        np.testing.assert_allclose(right_jacobians(vector)[:, :, axis], turned.as_rotvec() / 2e-7, atol=1e-7)
    still = moved(SCENE, np.zeros(6)).path
    np.testing.assert_array_equal(still.positions(t), SCENE.path.positions(t))
    assert still.describe()["kind"] == "moved"


def test_event_times_in_pytorch(events: EventArray) -> None:
    """Forward times are the crossings, backward the transposed Jacobian: by increments and by thresholds."""
    torch = pytest.importorskip("torch")
    times = EventTimes(SCENE, events, within_us=50.0, **SETTINGS)
    random = np.random.RandomState(0)
    for shape in ((6,), (5, 6)):
        for by in ((2,), (2, CAMERA.height, CAMERA.width)):
            increments = torch.zeros(shape, dtype=torch.float64, requires_grad=True)
            base = np.array([0.04, 0.05]).reshape(2, *[1] * (len(by) - 1)) * np.ones(by)
            thresholds = torch.tensor(base, requires_grad=True)
            t_us, ok = times(increments, thresholds)
            assert t_us.dtype == torch.float64
            assert ok.double().mean() > 0.95
            np.testing.assert_allclose(t_us[ok].detach(), events["t"][ok.numpy()] - 0.5, atol=0.6)
            weight = torch.tensor(random.normal(size=len(events)))
            (weight * t_us)[ok].sum().backward()
            jacobian, _ = event_time_jacobian(SCENE, events, **SETTINGS)
            expected = jacobian[ok.numpy()].T @ weight[ok].numpy()
            found = increments.grad.numpy().reshape(-1, 6).sum(0)
            np.testing.assert_allclose(found, expected[:6], rtol=2e-2, atol=2e-2 * np.abs(expected[:6]).max())
            found = thresholds.grad.numpy().reshape(2, -1).sum(1)
            np.testing.assert_allclose(found, expected[6:], rtol=2e-2, atol=2e-2 * np.abs(expected[6:]).max())
    only, _ = times(torch.zeros(6, requires_grad=True))
    only.sum().backward()


def test_bad_arguments_of_residuals(events: EventArray) -> None:
    for bad, message in (
        ({"within_us": 0}, "within_us must be > 0 and finite, got 0"),
        ({"block": 0}, "block must be > 0"),
        ({"thresholds": np.ones((2, 3))}, r"thresholds must have shape \(2,\) or \(2, 18, 24\), got \(2, 3\)"),
        ({"thresholds": [0.2, -0.1]}, "thresholds must be > 0 and finite, got -0.1"),
    ):
        with pytest.raises(ValueError, match=message):
            event_time_residuals(SCENE, events, **bad, **SETTINGS)
    with pytest.raises(ValueError, match=r"increments must have shape \(6,\), or \(m, 6\) of m >= 4, got \(3, 6\)"):
        moved(SCENE, np.zeros((3, 6)))
    with pytest.raises(ValueError, match="increments must be finite, got nan"):
        moved(SCENE, np.full(6, np.nan))
    with pytest.raises(ValueError, match="needs at least 4 control points, got 3"):
        event_time_derivatives(SCENE, events[:1], **SETTINGS).control_points(3)


def log_luma_residuals(scene: Scene, events: EventArray, **settings: Any) -> FloatArray:
    residual = np.full(len(events), np.nan)
    for block in event_log_luma_residuals(scene, events, block=30, **{**SETTINGS, **settings}):
        residual[block.index] = block.residual
    return residual


def test_residuals_of_log_luma(events: EventArray) -> None:
    """They are log luma at the stamps, less that at the start and less what the polarities say."""
    scene = moved(SCENE, [1e-3, 0, 0, 0, 0, 0])
    field = EventTimeModel(scene, **SETTINGS).field
    change: dict[int, float] = {}
    expected = []
    for t, x, y, p in zip(*(events[name].tolist() for name in "txyp"), strict=True):
        pixel = y * CAMERA.width + x
        change[pixel] = change.get(pixel, 0.0) + (0.04 if p else -0.05)
        here, start = (field.at(np.array([at]), np.array([pixel])).value[0] for at in (t - 0.5, 0.0))
        expected.append(here - start - change[pixel])
    assert np.std(expected) > 1e-3
    np.testing.assert_allclose(log_luma_residuals(scene, events), expected, rtol=1e-9, atol=1e-11)
    with pytest.raises(ValueError, match="block must be > 0 and finite, got 0"):
        event_log_luma_residuals(SCENE, events, block=0, **SETTINGS)


def test_derivatives_of_residuals_of_log_luma(events: EventArray) -> None:
    """Of every kind of unknown, against differences; but for rays that jump within the step."""
    (block,) = event_log_luma_residuals(SCENE, events, block=len(events), **SETTINGS)
    assert block.derivatives.ok.all()
    random = np.random.RandomState(0)
    points, texels = random.normal(size=(5, 6)), random.uniform(-1, 1, (32, 32))
    maps, base = random.normal(size=(2, CAMERA.height, CAMERA.width)), np.array([0.04, 0.05])[:, None, None]
    columns = block.derivatives.texture_columns()["floor.reflectance"].ravel()
    by_texel = block.derivatives.reflectance()[:, columns] @ texels.ravel()

    def late(step: float) -> Scene:
        return replace(SCENE, trajectory=SegmentTrajectory(PATH.start, PATH.end, PATH.duration_s * (1 + step)))

    cases: list[tuple[str, FloatArray, float, Callable[[float], tuple[Scene, dict[str, Any]]]]] = [
        (
            "points",
            block.derivatives.control_points(5) @ points.ravel(),
            1e-9,
            lambda d: (moved(SCENE, d * points), {}),
        ),
        ("texels", by_texel, 1e-4, lambda d: (texels_changed(SCENE, "floor", d * texels), {})),
        (
            "thresholds",
            block.derivatives.contrast_threshold_map() @ maps.ravel(),
            1e-4,
            lambda d: (SCENE, {"thresholds": base + d * maps}),
        ),
        ("log_eps", block.derivatives.jacobian(("log_eps",))[:, 0], 1e-6, lambda d: (SCENE, {"log_eps": 1e-3 + d})),
        ("drift", block.derivatives.jacobian(("clock_drift",))[:, 0], 1e-8, lambda d: (late(d), {})),
    ]
    for name, derivative, step, run in cases:
        (ahead, more), (behind, less) = run(step), run(-step)
        truth = log_luma_residuals(ahead, events, **more) - log_luma_residuals(behind, events, **less)
        truth = truth[block.index] / (2 * step)
        typical = np.median(np.abs(truth))
        assert typical > 0, name
        assert (np.abs(derivative - truth) <= 2e-3 * (typical + np.abs(truth))).mean() > 0.97, name


def test_events_out_of_order_within_a_pixel(events: EventArray) -> None:
    """Crossings that an estimate predicts before an earlier event's of the same pixel are not taken as known."""
    (block,) = event_time_residuals(
        moved(SCENE, [6e-3, -4e-3, 3e-3, 5e-3, 0, 0]), events, block=len(events), **SETTINGS
    )
    t_us = events["t"][block.index] - 0.5 + block.residual_us
    latest: dict[int, float] = {}
    early = np.zeros(len(t_us), np.bool_)
    for number, (pixel, at) in enumerate(zip(block.derivatives.levels.pixel.tolist(), t_us.tolist(), strict=True)):
        if np.isfinite(at):
            early[number] = at < latest.get(pixel, 0.0) - 0.2
            latest[pixel] = max(at, latest.get(pixel, 0.0))
    assert (early & block.derivatives.ok).sum() > 5
    assert not block.ok[early].any()
    with pytest.raises(ValueError, match="events must be sorted by time; event 1 is"):
        event_time_residuals(SCENE, events[::-1], **SETTINGS)
