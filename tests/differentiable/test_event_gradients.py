"""How event times move: luma's derivatives against differences, event times against crossings that are found again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Effects, Flicker, Pose, Scene, SegmentTrajectory, load_scene, simulate
from davis_rs.differentiable import event_time_jacobian
from davis_rs.differentiable.event_jacobian import EventTimeModel
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer

FloatArray = npt.NDArray[np.float64]
Parts = dict[str, dict[str, Any]]

CAMERA = Camera(24, 18, 28.0, 30.0, 11.2, 8.9, k1=-0.1)
TURNED = np.array([0.965061, 0.0517277, -0.1125492, -0.2308985])
LATER = (Rotation.from_quat(TURNED) * Rotation.from_rotvec([0.03, -0.02, 0.01])).as_quat()
PATH = SegmentTrajectory(Pose([0.5, -0.9, 1.8], TURNED), Pose([0.6, -0.85, 1.78], LATER), 0.05)
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SUN = {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": 3.0}
SKY = {"type": "constant", "radiance": 0.7}
EXACT: dict[str, Any] = {"accuracy": "exact", "rays_per_pixel": 2}


def textured(wrap: str) -> dict[str, Any]:
    y, x = np.mgrid[:32, :32] * (2 * np.pi / 32)
    data = np.stack([0.5 + 0.4 * np.sin(x + k) * np.cos(2 * y) for k in range(3)], -1).astype(np.float32)
    bitmap = {"type": "bitmap", "raw": True, "data": data, "wrap_mode": wrap, "to_uv": np.diag([2.5, 2.5, 1.0])}
    return {"type": "twosided", "inner": {"type": "diffuse", "reflectance": bitmap}}


def placed(kind: str, centre: npt.ArrayLike, half: npt.ArrayLike, bsdf: dict[str, Any]) -> dict[str, Any]:
    to_world = np.diag([*np.broadcast_to(np.asarray(half, np.float64), 3), 1.0])
    to_world[:3, 3] = centre
    return {"type": kind, "to_world": to_world, "bsdf": bsdf}


def scene_of(parts: Parts, **fields: Any) -> Scene:
    source = {"type": "scene", "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}, **parts}
    return Scene(source=lambda: source, camera=CAMERA, name="test", trajectory=PATH, **{"shadows": False, **fields})


FLOOR = placed("rectangle", [0, 0, 0], [4, 4, 1], textured("repeat"))
BOX = placed("cube", [0.05, 0.02, 0.3], 0.2, textured("mirror"))
SPOT = {
    "type": "spot",
    "intensity": 30.0,
    "cutoff_angle": 40.0,
    "beam_width": 5.0,
    "to_world": np.array([[1, 0, 0, 0.4], [0, -1, 0, -0.3], [0, 0, -1, 2.0], [0, 0, 0, 1.0]]),
}
SCENES = {
    "shadows": scene_of({"lamp": LAMP, "sun": SUN, "sky": SKY, "floor": FLOOR, "box": BOX}, shadows=True),
    "spot": scene_of({"spot": SPOT, "floor": FLOOR}),
    "moving": scene_of(
        {"lamp": LAMP, "sun": SUN, "floor": FLOOR, "box": BOX},
        shadows=True,
        objects={
            "box": SegmentTrajectory(
                Pose([0, 0, 0.1], [0, 0, 0, 1]), Pose([0.02, 0.01, 0.1], [0.03, 0, 0.04, 0.99875]), 0.05
            )
        },
        lights={"lamp": Flicker(100.0, modulation=0.5)},
    ),
}


def gradients(renderer: NativeRenderer, views: Views) -> FloatArray:
    """Of each pixel of one view."""
    count = CAMERA.width * CAMERA.height
    return renderer.gradients(views, np.zeros(count, np.uint32), np.arange(count, dtype=np.uint32), np.ones(1))


def moved(views: Views, pose: FloatArray) -> Views:
    rotations = views.rotations @ Rotation.from_rotvec(pose[3:]).as_matrix()
    return Views(views.t_s, views.positions + pose[:3], rotations, views.velocities, views.angular_rates)


@pytest.mark.parametrize("name", SCENES)
def test_luma_and_its_derivatives(name: str) -> None:
    """Luma is the frames'; its derivatives by pose and time are those of float64 differences; lights add up."""
    scene = SCENES[name]
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=2, blur=False, kind="native")
    assert isinstance(renderer, NativeRenderer)
    views = Views.along(scene.path, [0.0213])
    found = gradients(renderer, views)
    luma = renderer.luma(views).ravel()
    assert np.ptp(luma) > 0.1
    assert np.quantile(np.abs(found[:, 0] - luma), 0.98) < 1e-5
    np.testing.assert_allclose(found[:, 8:].sum(1), found[:, 0], rtol=1e-9, atol=1e-12)
    step = 1e-7
    around = {
        column: [gradients(renderer, moved(views, sign * step * np.eye(6)[column]))[:, 0] for sign in (1, -1)]
        for column in range(6)
    }
    later = [Views.along(scene.path, [0.0213 + sign * step]) for sign in (1, -1)]
    around[-1] = [gradients(renderer, at)[:, 0] for at in later]
    for column, (ahead, behind) in around.items():
        own = found[:, 2 + column] if column >= 0 else found[:, 1]
        off = np.abs((ahead - behind) / (2 * step) - own)
        assert np.abs(own).max() > 0.05
        # A ray at an edge jumps within the step.
        assert np.count_nonzero(off > 1e-5 * np.abs(own).max()) <= 6, column


def events_of(scene: Scene, **settings: Any) -> EventArray:
    run = simulate(scene, frame_rate_hz=0, depth_rate_hz=0, **{**EXACT, **settings})
    return concatenate_events([packet.events for packet in run])


def shifted(scene: Scene, pose: FloatArray) -> Scene:
    """The whole path moved by a constant increment: a segment, since both ends are."""
    ends = []
    for t_s in (0.0, scene.path.duration_s):
        at = scene.path.pose(t_s)
        turn = Rotation.from_quat(at.quaternion) * Rotation.from_rotvec(pose[3:])
        ends.append(Pose(at.position + pose[:3], turn.as_quat()))
    return replace(scene, trajectory=SegmentTrajectory(ends[0], ends[1], scene.path.duration_s))


def crossings(scene: Scene, events: EventArray, settings: dict[str, Any]) -> FloatArray:
    """Times of the events' levels, by bisection of log luma in float64 about their stamps; NaN where there is none."""
    model = EventTimeModel(scene, **settings)
    levels = model.levels(events)
    simulator = model.simulator
    level = model.field.at(np.zeros(len(events)), levels.pixel).value
    level += levels.on * simulator.contrast_threshold - levels.off * simulator.contrast_threshold_off

    def above(t_us: FloatArray) -> npt.NDArray[np.bool_]:
        return levels.sign * (model.field.at(t_us, levels.pixel).value - level) >= 0

    low, high = levels.t_us - 5, np.minimum(levels.t_us + 4, scene.path.duration_s * 1e6)
    enclosed = ~above(low) & above(high)
    for _ in range(30):
        middle = (low + high) / 2
        reached = above(middle)
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return np.where(enclosed, (low + high) / 2, np.nan)


@pytest.mark.long
def test_event_times_move_as_the_jacobian_says() -> None:
    """For shifts of a fraction of a microsecond, of the pose, the thresholds and the dark level."""
    scene = replace(SCENES["shadows"], blur=True)
    settings: dict[str, Any] = {**EXACT, "contrast_threshold": 0.04, "contrast_threshold_off": 0.05, "log_eps": 2e-3}
    events = events_of(scene, **settings)
    events = events[(7 * events["y"] + events["x"]) % 11 == 0][:250]
    jacobian, ok = event_time_jacobian(scene, events, ("pose", "contrast_threshold", "log_eps"), **settings)
    assert jacobian.shape == (len(events), 9)
    assert len(events) > 150
    assert jacobian.dtype == np.float64
    assert ok.mean() > 0.9
    assert np.isfinite(jacobian[ok]).all()
    assert np.isnan(jacobian[~ok]).all()
    names = [None] * 6 + ["contrast_threshold", "contrast_threshold_off", "log_eps"]
    for column, name in enumerate(names):
        step = 0.1 / np.median(np.abs(jacobian[ok][:, column][jacobian[ok][:, column] != 0]))
        times = []
        for sign in (1, -1):
            if name is None:
                times.append(crossings(shifted(scene, sign * step * np.eye(6)[column]), events, settings))
            else:
                times.append(crossings(scene, events, {**settings, name: settings[name] + sign * step}))
        truth = (times[0] - times[1]) / (2 * step)
        known = ok & np.isfinite(truth)
        assert known.sum() > 0.9 * ok.sum()
        off = np.abs(jacobian[known, column] - truth[known]) / np.median(np.abs(truth[known][truth[known] != 0]))
        good = off <= 0.01 * (1 + np.abs(truth[known]) / np.median(np.abs(truth[known][truth[known] != 0])))
        assert good.mean() > 0.97, f"{column}: {good.mean()}"


@pytest.mark.parametrize("shadow", [False, True])
def test_a_jump_is_its_edges(shadow: bool) -> None:
    """A bright tile, or the shadow of a dark one: the edge passes each ray when the camera is at its place, whatever
    the threshold. An edge along y does not care where along it the camera is."""
    white = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.8}}
    black = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.1}}
    path = SegmentTrajectory(Pose([0.0, 0, 2], [1, 0, 0, 0]), Pose([0.1, 0, 2], [1, 0, 0, 0]), 0.05)
    tile = placed("rectangle", [4.03, 0, 0.4], [4, 4, 1], white)
    parts: Parts = {"sky": SKY, "floor": placed("rectangle", [0, 0, 0], [9, 9, 1], black), "tile": tile}
    if shadow:
        # The camera flies below the tile, and sees its shadow alone.
        path = SegmentTrajectory(Pose([0.0, 0, 2], [1, 0, 0, 0]), Pose([0.1, 0, 2], [1, 0, 0, 0]), 0.05)
        parts = {"sky": SKY, "sun": {"type": "directional", "direction": [0.3, 0.1, -1.0], "irradiance": 8.0}, **parts}
        parts["tile"] = placed("rectangle", [4.03 - 0.9, 0, 3.0], [4, 4, 1], white)
    scene = replace(scene_of(parts, shadows=shadow), trajectory=path)
    events = events_of(scene)
    assert len(events) > 50
    jacobian, ok = event_time_jacobian(scene, events, ("pose", "contrast_threshold", "clock_offset"), **EXACT)
    assert ok.mean() > 0.99
    np.testing.assert_allclose(jacobian[ok, 0], -1e6 * 0.05 / 0.1, rtol=1e-6)
    np.testing.assert_allclose(jacobian[ok, 1], 0.0, atol=1e-3)
    assert np.abs(jacobian[ok, 3:6]).max() > 1e5
    assert not jacobian[ok, 6:8].any()
    np.testing.assert_allclose(jacobian[ok, 8], 1e6)


def test_a_stream_of_another_run_is_masked() -> None:
    """Where levels do not follow, nothing is told, with a warning; a jump may reach either level: here is none."""
    scene = SCENES["spot"]
    events = events_of(scene, contrast_threshold=0.05)[:300]
    _, ok = event_time_jacobian(scene, events, contrast_threshold=0.05, **EXACT)
    assert ok.mean() > 0.9
    with pytest.warns(UserWarning, match=r"known of \d+ of 300 events: are the settings those of the run\?") as warned:
        _, ok = event_time_jacobian(scene, events, contrast_threshold=0.0527, **EXACT)
    assert ok.mean() < 0.1
    assert warned[0].filename == __file__
    assert f"known of {ok.sum()} of" in str(warned[0].message)


def test_events_that_were_not_refined() -> None:
    """Their crossings are looked for near the stamps: the Jacobian is that of the refined ones."""
    scene = SCENES["spot"]
    events = events_of(scene, contrast_threshold=0.05)[:300]
    exact, ok = event_time_jacobian(scene, events, contrast_threshold=0.05, **EXACT)
    found, near = event_time_jacobian(scene, events, contrast_threshold=0.05, rays_per_pixel=2, refine=False)
    assert (near & ok).sum() > 200
    np.testing.assert_allclose(found[near & ok], exact[near & ok], rtol=0.02, atol=0.01 * np.abs(exact[ok]).max())


def test_what_is_refused() -> None:
    scene = SCENES["shadows"]
    good = np.array([(100, 1, 2, 1), (200, 3, 4, 0)], [("t", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1")])
    for change, message in (
        ({"t": [200, 100]}, r"sorted by time; event 1 is"),
        ({"x": [24, 0]}, r"24 x 18 pixels of the sensor; event 0 is .*24"),
        ({"p": [0, 2]}, r"polarity of 0 or 1; event 1"),
        ({"t": [0, 100]}, r"within the run, after 0 and up to 50000 us; event 0"),
        ({"t": [100, 50001]}, r"up to 50000 us; event 1"),
    ):
        events = good.copy()
        for name, values in change.items():
            events[name] = values
        with pytest.raises(ValueError, match=message):
            event_time_jacobian(scene, events, **EXACT)
    with pytest.raises(ValueError, match=r"of must name pose, .*; got 'poses'; did you mean pose\?"):
        event_time_jacobian(scene, good, of=("poses",))
    with pytest.raises(TypeError, match="no argument 'sample'"):
        event_time_jacobian(scene, good, sample=3)
    with pytest.raises(ValueError, match=r"need the native renderer, .* this is the"):
        event_time_jacobian(scene, good, renderer="integrator")
    with pytest.raises(ValueError, match="ideal pixels, without"):
        event_time_jacobian(scene, good, effects=Effects(refractory_period_us=100), accuracy="fast")
    with pytest.raises(ValueError, match="ideal pixels, without start phases"):
        event_time_jacobian(scene, good, start_phase="stationary", **EXACT)
    jacobian, ok = event_time_jacobian(scene, good[:0], **EXACT)
    assert jacobian.shape == (0, 8)
    assert ok.shape == (0,)


def test_a_part_of_the_path() -> None:
    """``start_s`` is that of the run, and light has a column for each name."""
    scene = replace(load_scene("three_planes"), camera=replace(CAMERA, k1=0.0))
    part = scene.crop(0.1003, 0.02)
    events = events_of(part)
    one, ok = event_time_jacobian(part, events, ("light",), **EXACT)
    other, also = event_time_jacobian(scene, events, ("light",), start_s=0.1003, **EXACT)
    assert one.shape == (len(events), 1)
    # The upright edges between the planes pass several rays at one instant: a kink, which is not told.
    assert 0.8 < ok.mean() < 0.9
    np.testing.assert_array_equal(ok, also)
    np.testing.assert_allclose(one[ok], other[ok], rtol=1e-6)
