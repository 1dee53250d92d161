"""The environment of Gymnasium: its rules, what is seen, what moves, and a controller that tracks by events alone."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from davis_rs import Pose, Simulator
from davis_rs.gym import (
    OBSERVATIONS,
    BodyState,
    EventCameraEnv,
    KeepCentred,
    Moment,
    PointMassBody,
    PoseBody,
    QuadrotorBody,
    Task,
    VelocityBody,
    Verdict,
    marker_env,
    marker_scene,
)
from davis_rs.sensor.imu import ImuNoise
from places import ROOT

pytestmark = pytest.mark.without_llvm

IDS = ["davis_rs/Marker-v0", "davis_rs/MarkerPose-v0", "davis_rs/MarkerPointMass-v0", "davis_rs/MarkerQuadrotor-v0"]
START = Pose([0.0, 0.0, 1.2], [-(0.5**0.5), 0.0, 0.0, 0.5**0.5])  # looks along the world's y
LEVEL = np.array([0.0, -9.81, 0.0])
"""What an accelerometer in camera axes reads at rest there."""


def small(**arguments: Any) -> EventCameraEnv:
    return marker_env(**{"size": 32, "duration_s": 0.3, **arguments})


@pytest.mark.parametrize("name", IDS)
def test_environments_follow_gymnasiums_rules(name: str) -> None:
    """All of them, with all observations, and noise: spaces, seeds, determinism, pictures."""
    env = gymnasium.make(
        name, size=24, observe=list(OBSERVATIONS), poses_per_step=2, imu_noise=ImuNoise(), render_mode="rgb_array",
        effects={"threshold_mismatch": 0.03},
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"[\s\S]*(infinity|symmetric and normalized)")
        check_env(env.unwrapped)
    env.close()


def same(seen: Any, expected: Any) -> bool:
    return expected is not None and np.array_equal(seen, expected)


def test_what_is_seen_is_what_a_simulator_gives() -> None:
    """Events in all their forms, frame and depth of two steps of two parts each."""
    env = small(body="pose", observe=list(OBSERVATIONS), poses_per_step=2, bins=3)
    task, camera = KeepCentred(), env.simulator.camera
    first, _ = env.reset(seed=4)
    generator, _ = gymnasium.utils.seeding.np_random(4)
    seed = int(generator.integers(1 << 63))
    generator.integers(1 << 63)
    start = task.start(generator)
    settings: dict[str, Any] = {"frame_rate_hz": 100.0, "depth_rate_hz": 100.0}
    simulator = Simulator(marker_scene(), camera=camera, accuracy="fast", seed=seed, **settings)
    [packet] = simulator.step(0, start, objects=task.objects(0.0))
    assert not len(first["events"])
    assert same(first["frame"], packet.luma)
    offset = np.array([0.1, -0.05, 0.2, 0.02, 0.01, -0.03], np.float32)
    count = 0
    for step in (1, 2):
        seen, _, _, _, info = env.step(offset * step)
        target = start @ Pose(*pose_of_action(offset * step))
        packets = []
        for part in (1, 2):
            t_us = 10_000 * (step - 1) + 5_000 * part
            packets += simulator.step(t_us, target, objects=task.objects(t_us * 1e-6))
        events = np.concatenate([packet.events for packet in packets])
        count += len(events)
        assert np.array_equal(seen["events"][:, 0], events["t"] - 10_000 * (step - 1))
        assert np.array_equal(seen["events"][:, 1:], np.stack([events[name] for name in "xyp"], 1))
        assert ((seen["events"][:, 0] > 0) & (seen["events"][:, 0] <= 10_000)).all()
        assert info["events"] == len(events) == seen["counts"].sum()
        assert np.array_equal(seen["counts"][1].sum(), (events["p"] == 1).sum())
        # Planes lie at the start, in the middle and at the end; an event's sign is shared by the two around it.
        assert seen["voxel_grid"].sum() == pytest.approx((2.0 * events["p"] - 1).sum(), abs=1e-3)
        assert same(seen["frame"], packets[-1].luma)
        assert same(seen["depth"], packets[-1].depth)
        assert np.allclose(info["pose"], target.matrix)
        assert info["t_s"] == pytest.approx(0.01 * step)
    assert count > 50


def pose_of_action(action: Any) -> tuple[Any, Any]:
    """Position and quaternion of an action of PoseBody, in float64 as the body has them."""
    from scipy.spatial.transform import Rotation

    exact = np.asarray(action, np.float64)
    return exact[:3], Rotation.from_rotvec(exact[3:]).as_quat()


def test_the_picture_shows_the_events_of_the_step() -> None:
    """ON red, OFF blue, on white."""
    env = small(observe=["counts"], render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    env.reset(seed=1)
    picture = env.render()
    assert picture is not None
    assert (picture == 255).all()
    seen, *_ = env.step(np.array([1, 0, 0, 0, 0, 0.5], np.float32))
    picture = env.render()
    assert picture is not None
    assert picture.shape == (32, 32, 3)
    assert np.array_equal((picture != 255).any(2), seen["counts"].any(0))
    assert small().render() is None


def test_a_seed_decides_an_episode_and_its_noise() -> None:
    """Another one gives another; without one the next episode differs."""
    env = small(observe=["events", "imu"], imu_noise=ImuNoise(), effects={"shot_noise_rms": 0.05})

    def episode(seed: int | None) -> tuple[bytes, bytes]:
        seen, _ = env.reset(seed=seed)
        rows = [seen]
        for _ in range(5):
            rows.append(env.step(np.zeros(6, np.float32))[0])
        return b"".join(row["events"].tobytes() for row in rows), b"".join(row["imu"].tobytes() for row in rows)

    first, again, other = episode(1), episode(1), episode(2)
    following = episode(None)
    assert first == again
    assert all(len({stream, *rest}) == 3 for stream, *rest in zip(first, other, following, strict=True))


def test_noise_of_the_imu_does_not_depend_on_when_it_is_drawn() -> None:
    """It has its density, and goes on where more is drawn."""
    env = small(observe=["imu"], imu_noise=ImuNoise(), body="point_mass", step_s=0.001, duration_s=None, size=8)
    env.reset(seed=0)
    env._noise = env._noise[:0]
    drawn = np.concatenate([env._drawn_noise(1) for _ in range(1500)])
    expected = ImuNoise().draw(1501, 1000.0, env._noise_seed)
    assert np.array_equal(drawn, expected[1:])


class Nothing(Task):
    """Ends after some steps."""

    def __init__(self, ends_s: float = np.inf) -> None:
        self.ends_s = ends_s

    def start(self, random: np.random.Generator) -> Pose:
        return START

    def judge(self, moment: Moment) -> Verdict:
        return Verdict(moment.state.velocity[0], moment.t_s >= self.ends_s - 1e-9, {"action": moment.action})


def bare(body: Any, **arguments: Any) -> EventCameraEnv:
    camera = marker_scene().own_camera
    return EventCameraEnv(marker_scene(), body, Nothing(), camera=camera, observe=["imu"], size=(8, 8), **arguments)


def test_an_imu_reads_mean_force_and_rate() -> None:
    """At rest, pushed to the right by 3 m/s^2, and turning about the camera's axis."""
    env = marker_env(body=PointMassBody(), size=8, observe=["imu"], poses_per_step=4, step_s=0.02)
    seen, _ = env.reset(seed=0)
    assert np.allclose(seen["imu"], np.tile([*LEVEL, 0, 0, 0], (4, 1)), atol=1e-6)
    seen, *_ = env.step(np.array([3.0, 0.0, 0.0], np.float32))
    assert np.allclose(seen["imu"], np.tile([3.0, *LEVEL[1:], 0, 0, 0], (4, 1)), atol=1e-5)
    env = marker_env(body=VelocityBody(), size=8, observe=["imu"], step_s=0.1)
    env.reset(seed=0)
    seen, *_ = env.step(np.array([0, 0, 0, 0, 0, 2.0], np.float32))
    half_way = 0.1  # rad: the camera's right has turned down by this in the middle of the step
    expected = [-9.81 * np.sin(half_way), -9.81 * np.cos(half_way), 0, 0, 0, 2.0]
    assert np.allclose(seen["imu"], [expected], atol=1e-5)


def states(body: Any, action: list[float], parts: int, duration_s: float) -> list[BodyState]:
    body.reset(START)
    return [body.move(np.array(action), duration_s) for _ in range(parts)]


def test_a_point_mass_follows_newton() -> None:
    """Without and with drag; in how many steps does not matter."""
    acceleration = np.array([2.0, -1.0, 0.5])
    for drag in (0.0, 0.7):
        body = PointMassBody(drag_per_s=drag)
        many, one = states(body, acceleration.tolist(), 10, 0.05)[-1], states(body, acceleration.tolist(), 1, 0.5)[-1]
        assert np.allclose(many.pose.position, one.pose.position)
        assert np.allclose(many.velocity, one.velocity)
        if drag == 0:
            assert np.allclose(one.pose.position - START.position, acceleration / 8)
            assert np.allclose(one.velocity, acceleration / 2)
        else:
            assert np.allclose(one.velocity, acceleration / drag * (1 - np.exp(-drag / 2)))
            # The velocity is the derivative of the position.
            later = body.move(acceleration, 1e-6)
            assert np.allclose((later.pose.position - one.pose.position) / 1e-6, one.velocity, atol=1e-4)
        assert np.allclose(one.pose.quaternion, START.quaternion)


def test_a_velocity_is_in_the_cameras_axes() -> None:
    """Ahead is along the world's y, a turn about the camera's y turns ahead to the right."""
    state = states(VelocityBody(), [0.1, 0.2, 0.3, 0, 0.5, 0], 1, 1.0)[-1]
    assert np.allclose(state.pose.position - START.position, [0.1, 0.3, -0.2])
    assert np.allclose(state.pose.rotation[:, 2], [np.sin(0.5), np.cos(0.5), 0])
    assert np.allclose(state.velocity, [0.1, 0.3, -0.2])
    assert np.allclose(state.angular_rate, [0, 0.5, 0])


def test_a_pose_is_relative_to_the_start() -> None:
    body = PoseBody()
    first, second = states(body, [0.1, 0.0, 0.2, 0.0, 0.1, 0.0], 2, 0.1)
    assert np.allclose(first.pose.position - START.position, [0.1, 0.2, 0.0])
    assert np.allclose(first.velocity, [1.0, 2.0, 0.0])
    assert np.allclose(first.angular_rate, [0, 1.0, 0])
    assert np.allclose(second.pose.position, first.pose.position)
    assert np.allclose(second.velocity, 0)
    assert np.allclose(second.angular_rate, 0, atol=1e-9)


def test_a_quadrotor_hovers_falls_and_tilts() -> None:
    """Level thrust of 1 g hovers; none falls; a pitch forward speeds up ahead; rates follow with a time constant."""
    hover = states(QuadrotorBody(drag_per_s=0), [9.81, 0, 0, 0], 10, 0.05)[-1]
    assert np.allclose(hover.pose.position, START.position, atol=1e-9)
    assert np.allclose(hover.pose.rotation, START.rotation, atol=1e-9)
    fall = states(QuadrotorBody(drag_per_s=0), [0, 0, 0, 0], 4, 0.25)[-1]
    assert np.allclose(fall.velocity, [0, 0, -9.81])
    assert np.allclose(fall.pose.position - START.position, [0, 0, -9.81 / 2])
    body = QuadrotorBody(drag_per_s=0, rate_time_constant_s=0.05)
    body.reset(START)
    # About the body's y, which points left: nose down.
    state = body.move(np.array([9.81, 0.0, 1.0, 0.0]), 0.05)
    assert np.allclose(state.angular_rate, [-(1 - np.exp(-1)), 0, 0], atol=1e-6)  # the camera's x points right
    assert state.pose.rotation[2, 2] < -0.005
    assert state.velocity[1] > 0
    assert abs(state.velocity[0]) < 1e-12
    # The pitch is the integral of the rate, and thrust along the tilted axis speeds up.
    state = body.move(np.array([9.81, 0.0, 1.0, 0.0]), 0.05)
    pitch = 0.1 - 0.05 * (1 - np.exp(-2))
    assert np.allclose(state.pose.rotation[:, 2], [0, np.cos(pitch), -np.sin(pitch)], atol=1e-5)
    t = np.linspace(0, 0.1, 20001)
    speed = np.trapezoid(9.81 * np.sin(t - 0.05 * (1 - np.exp(-t / 0.05))), t)
    assert state.velocity[1] == pytest.approx(speed, rel=1e-3)
    tilted = QuadrotorBody(camera_tilt_rad=0.3)
    tilted.reset(START)
    # The camera keeps its pose; the body below it is what is tilted.
    assert np.allclose(tilted.state.pose.matrix, START.matrix)
    assert np.allclose(tilted._body.rotation[:, 2] @ START.rotation[:, 2], np.sin(0.3))  # nose down
    assert np.allclose(tilted._body.rotation[:, 0] @ START.rotation[:, 0], 0)
    assert np.allclose(tilted._body.rotation[:, 1], -START.rotation[:, 0])


def test_episodes_end() -> None:
    """By the task, by the time; then the environment asks for a reset."""
    camera = marker_scene().own_camera
    env = EventCameraEnv(marker_scene(), VelocityBody(), Nothing(0.02), camera=camera, duration_s=0.03)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(6, np.float32))
    for ends_s, expected in ((0.02, [(False, False), (True, False)]), (9.0, [(False, False)] * 2 + [(False, True)])):
        env._task = Nothing(ends_s)
        env.reset()
        action = np.array([0.5, 0, 0, 0, 0, 0], np.float32)
        ends = []
        for _ in expected:
            _, reward, terminated, truncated, info = env.step(action)
            ends.append((terminated, truncated))
            assert reward == pytest.approx(0.5)
            assert np.array_equal(info["action"], action)
        assert ends == expected
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(action)


def test_an_episode_may_begin_elsewhere() -> None:
    env = small()
    _, info = env.reset(options={"pose": START @ Pose([0.3, 0, 0], [0, 0, 0, 1])})
    assert np.allclose(info["pose"][:3, 3], [0.3, 0, 1.2])
    with pytest.raises(ValueError, match="options may have pose alone, got place"):
        env.reset(options={"place": START})
    with pytest.raises(ValueError, match=r"options\['pose'\] must be a Pose"):
        env.reset(options={"pose": 3})


def test_the_marker_begins_in_the_middle() -> None:
    """Whatever the phases of its swings; it never goes farther than it may."""
    task = KeepCentred(reach_m=0.5)
    for seed in range(5):
        task.start(np.random.default_rng(seed))
        assert np.array_equal(task.shift(0.0), np.zeros(3))
        shifts = np.array([task.shift(t_s) for t_s in np.linspace(0, 60, 2000)])
        assert 0.1 < np.abs(shifts).max() <= 0.5


def test_the_marker_is_where_the_task_says() -> None:
    """The offset that it tells is that of what the depth map shows before the wall; it is lost out of the image."""
    env = small(body="velocity", observe=["depth"], size=64)
    env.reset(seed=2)
    for _ in range(20):
        seen, reward, terminated, _, info = env.step(np.array([-1.0, 0, 0, 0, 0, 0], np.float32))
        y, x = np.nonzero(seen["depth"] < 2.2)
        assert np.allclose([x.mean() - 31.5, y.mean() - 31.5], info["offset_px"], atol=0.5)
        assert reward == pytest.approx(1 - np.linalg.norm(info["offset_px"]) / 32)
        assert not terminated
    env.reset(seed=2)
    for _ in range(30):
        _, reward, terminated, _, info = env.step(np.array([-2.0, 2.0, 0, 0, 3.0, 0], np.float32))
        if terminated:
            break
        assert reward >= 0
    assert terminated
    assert reward == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"observe": ["voxels"]}, "observe may have events, .*got 'voxels'"),
        ({"observe": []}, "observe must name at least one"),
        ({"observe": ["imu", "imu"]}, "none twice"),
        ({"step_s": 0}, "step_s must"),
        ({"step_s": 1.5e-6}, "whole microseconds"),
        ({"step_s": 3e-6, "poses_per_step": 4}, "at least one for each of the 4 poses"),
        ({"duration_s": 0.001}, "duration_s must"),
        ({"bins": 0}, "bins must"),
        ({"render_mode": "human"}, "render_mode must be rgb_array or None, got 'human'"),
        ({"seed": 3}, "seed is not a setting of an environment"),
        ({"frame_rate_hz": 3}, "frame_rate_hz is not a setting"),
        ({"size": 4}, "size must"),
        ({"contrast_threshold": -1}, "contrast_threshold must"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        small(**arguments)


def test_what_is_no_body_task_or_action_is_refused() -> None:
    with pytest.raises(TypeError, match="body must be Body, got str"):
        marker_env(body="rocket", size=8)
    with pytest.raises(TypeError, match="task must be Task, got str"):
        EventCameraEnv(marker_scene(), VelocityBody(), "track")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="accurracy"):
        small(accurracy="fast")
    env = small()
    env.reset(seed=0)
    for action in ([9.0, 0, 0, 0, 0, 0], [0.0] * 5, [np.nan] * 6):
        with pytest.raises(ValueError, match=r"action must lie in Box.*ClipAction"):
            env.step(np.array(action, np.float32))
    with pytest.raises(ValueError, match="rate_time_constant_s"):
        QuadrotorBody(rate_time_constant_s=-1)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_environments_run_in_processes() -> None:
    """Several at once give what each gives alone."""
    arguments: dict[str, Any] = {"size": 16, "observe": ["voxel_grid"], "duration_s": 0.1}
    action = np.array([0.5, 0, 0, 0, 0, 0], np.float32)
    vector = gymnasium.make_vec(IDS[0], num_envs=2, vectorization_mode="async", **arguments)
    try:
        vector.reset(seed=[5, 6])  # type: ignore[arg-type]
        together = [vector.step(np.stack([action, action]))[0]["voxel_grid"] for _ in range(3)]
    finally:
        vector.close()
    for number, seed in enumerate((5, 6)):
        env = gymnasium.make(IDS[0], **arguments)
        env.reset(seed=seed)
        for seen in together:
            alone = env.step(action)[0]["voxel_grid"]
            assert np.array_equal(alone, seen[number])
        assert alone.any()


@pytest.mark.long
def test_a_controller_tracks_by_events_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example's controller keeps the marker near the middle; without events it does not move."""
    monkeypatch.syspath_prepend(ROOT / "examples")
    example = importlib.import_module("keep_centred")
    seeing, at_rest = example.main(["--size", "48", "--duration", "1.5", "--seed", "2"])
    assert at_rest > 3
    assert seeing < at_rest / 2
