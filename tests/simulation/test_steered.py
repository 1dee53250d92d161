"""Objects and lights that a caller moves between steps: the same events as where a scene moves them by itself."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import Camera, Effects, FixedRate, MaxDisplacement, Pose, SampledProfile, Scene, Simulator, Tolerance
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.packet import Packet
from davis_rs.geometry.trajectory.steered import SteeredPath
from davis_rs.render.choice import why_not_noise_free
from davis_rs.sampling.rules import TimeSampling
from davis_rs.scene.steered_profile import SteeredProfile
from davis_rs.sensor.effects import Aps
from moving_scene import BOX, DIRECT, FLOOR, LAMP, PATH

pytestmark = pytest.mark.without_llvm

CAMERA = Camera(40, 30, 33.0, 33.0, 19.5, 14.5)
LOOK = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
STILL = Scene("boxes", partial(dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}))
STEPS_US = (20_000, 35_000, 60_000)


def stepped(scene: Scene, moves: bool, dims: bool = False, **settings: Any) -> list[Packet]:
    """Step a simulator; the box goes along PATH, the lamp gets weaker."""
    simulator = Simulator(scene, camera=CAMERA, rays_per_pixel=2, **settings)
    packets = []
    for t_us in (0, *STEPS_US):
        objects = {"box": PATH.pose(t_us * 1e-6)} if moves else {}
        packets += simulator.step(t_us, LOOK, objects=objects, lights={"lamp": 1 - 5e-6 * t_us} if dims else {})
    return [*packets, *simulator.flush()]


def events_of(packets: list[Packet]) -> EventArray:
    return concatenate_events([packet.events for packet in packets])


@pytest.mark.parametrize(
    "sampling", [FixedRate(500), FixedRate(500, hermite=True), MaxDisplacement(0.3), Tolerance(0.5)]
)
def test_a_moved_object_makes_the_events_of_one_that_moves(sampling: TimeSampling) -> None:
    """The same path, given by the scene and pose after pose; frames, masks and flow too."""
    settings: dict[str, Any] = {"sampling": sampling, "frame_rate_hz": 50, "mask_rate_hz": 50, "flow_rate_hz": 50}
    by_scene = stepped(replace(STILL, objects={"box": PATH}), moves=False, **settings)
    by_hand = stepped(STILL.with_movable("box"), moves=True, **settings)
    expected, seen = events_of(by_scene), events_of(by_hand)
    assert len(expected) > 300
    # Poses differ in the last bit, so a stamp may be a microsecond off.
    comparison = davis_rs.compare_events(seen, expected, size=(40, 30), window_us=2)
    assert comparison.missing + comparison.spurious <= 0.01 * len(expected)
    assert len(by_scene) == len(by_hand)
    for packet, other in zip(by_scene, by_hand, strict=True):
        assert (packet.luma is None) == (other.luma is None)
        if packet.luma is not None and other.luma is not None:
            assert np.allclose(packet.luma, other.luma, rtol=1e-4)
            assert packet.shapes is not None
            assert other.shapes is not None
            assert (packet.shapes == other.shapes).mean() > 0.995
            assert packet.flow is not None
            assert other.flow is not None
            if packet.end_us > 0:  # at the first step nobody knows yet what will move
                assert np.isclose(packet.flow, other.flow, atol=1e-3, equal_nan=True).mean() > 0.99


def test_what_rests_makes_no_events_and_what_was_moved_stays() -> None:
    """An object that a step does not name stays where it was put, for ever."""
    simulator = Simulator(STILL.with_movable("box"), camera=CAMERA, rays_per_pixel=2, sampling=FixedRate(1000))
    pose = PATH.pose(0.0)
    [first] = simulator.step(0, LOOK, objects={"box": pose})
    assert first.luma is not None
    assert not len(events_of(simulator.step(10_000, LOOK)))
    assert len(events_of(simulator.step(20_000, LOOK, objects={"box": PATH.pose(0.2)})))
    assert not len(events_of(simulator.step(30_000, LOOK)))
    assert len(events_of(simulator.step(40_000, LOOK, objects={"box": pose})))
    assert not len(events_of(simulator.step(50_000, LOOK)))


def test_each_simulator_of_a_scene_has_objects_of_its_own() -> None:
    """What one moves does not move in another."""
    scene = STILL.with_movable("box")
    one, other = (Simulator(scene, camera=CAMERA, rays_per_pixel=2) for _ in range(2))
    lumas = []
    for simulator, t_s in ((one, 0.0), (other, 0.9)):
        [packet] = simulator.step(0, LOOK, objects={"box": PATH.pose(t_s)})
        assert packet.luma is not None
        lumas.append(packet.luma)
    [packet] = Simulator(scene, camera=CAMERA, rays_per_pixel=2).step(0, LOOK, objects={"box": PATH.pose(0.0)})
    assert packet.luma is not None
    assert np.array_equal(packet.luma, lumas[0])
    assert not np.array_equal(lumas[0], lumas[1])


@pytest.mark.parametrize("sampling", [FixedRate(500, hermite=True), MaxDisplacement(0.3)])
def test_a_light_is_dimmed_as_by_a_profile(sampling: TimeSampling) -> None:
    """Factors are linear between two steps."""
    profile = SampledProfile([0.0, 0.06], [1.0, 0.7])
    expected = events_of(stepped(replace(STILL, lights={"lamp": profile}), moves=False, sampling=sampling))
    seen = events_of(stepped(STILL.with_movable(lights="lamp"), moves=False, dims=True, sampling=sampling))
    assert len(expected) > 300
    assert not expected["p"].any()
    comparison = davis_rs.compare_events(seen, expected, size=(40, 30), window_us=2)
    assert comparison.missing + comparison.spurious <= 0.01 * len(expected)


def test_an_open_shutter_sees_earlier_steps() -> None:
    """A frame whose exposure began some steps ago is that of a scene which moves by itself."""
    effects = Effects(aps=Aps(exposure_us=30_000, row_readout_us=100.0))
    settings: dict[str, Any] = {"effects": effects, "frame_rate_hz": 20, "sampling": FixedRate(1000)}
    by_scene = stepped(replace(STILL, objects={"box": PATH}), moves=False, **settings)
    by_hand = stepped(STILL.with_movable("box"), moves=True, **settings)
    frames = [[p.frame for p in packets if p.frame is not None] for packets in (by_scene, by_hand)]
    assert len(frames[0]) == len(frames[1]) == 2
    for expected, seen in zip(*frames, strict=True):
        assert np.allclose(expected, seen, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"objects": {"bin": LOOK}},
            r"of objects, 'bin' is not the caller's \(the caller's: 'box'\); scene.with_movable names them before",
        ),
        ({"objects": {"floor": LOOK}}, "of objects, 'floor' is not the caller's"),
        (
            {"lights": {"sun": 1.0}},
            r"of lights, 'sun' is not the caller's \(the caller's: 'lamp'\); scene.with_movable",
        ),
        ({"objects": {"box": np.zeros((4, 4))}}, r"objects\['box'\] must be a Pose"),
        ({"lights": {"lamp": -0.5}}, r"lights\['lamp'\] must be .*>= 0.* -0.5"),
        ({"lights": {"lamp": float("nan")}}, r"lights\['lamp'\] must be"),
    ],
)
def test_what_cannot_be_moved_is_refused_and_changes_nothing(arguments: dict[str, Any], message: str) -> None:
    """The step can be given again."""
    simulator = Simulator(STILL.with_movable("box", lights=["lamp"]), camera=CAMERA, rays_per_pixel=2)
    simulator.step(0, LOOK)
    with pytest.raises(ValueError, match=message):
        simulator.step(10_000, LOOK, **arguments)
    assert not len(events_of(simulator.step(10_000, LOOK)))


def test_names_that_a_scene_does_not_have_are_refused_with_those_that_it_has() -> None:
    with pytest.raises(ValueError, match=r"has no object 'ball'; it has .*box"):
        Simulator(STILL.with_movable("ball"), camera=CAMERA)
    with pytest.raises(ValueError, match="has no light 'sun'; it has lamp"):
        Simulator(STILL.with_movable(lights=["sun"]), camera=CAMERA)


def test_baked_light_is_not_for_objects_that_a_caller_moves() -> None:
    """Their shadows cannot be computed in advance."""
    with pytest.raises(ValueError, match="object 'box' moves as a caller decides"):
        Simulator(STILL.with_movable("box"), camera=CAMERA, renderer="baked")
    assert not why_not_noise_free(STILL.with_movable("box"))


def test_a_path_keeps_what_a_shutter_sees() -> None:
    """Moves that nobody can see any more are forgotten; where they led is not."""
    path = SteeredPath()
    poses = [PATH.pose(t) for t in (0.0, 0.3, 0.5, 0.9)]
    path.put(poses[0])
    path.move(0, 1000, poses[1], seen_from_us=0)
    path.move(2000, 3000, poses[2], seen_from_us=500.0)
    t_s = [0.0, 0.5e-3, 1e-3, 1.5e-3, 2e-3, 2.5e-3, 3e-3, 9.0]
    halves = [(poses[i].position + poses[i + 1].position) / 2 for i in range(2)]
    expected = [poses[0].position, halves[0], *[poses[1].position] * 3, halves[1], *[poses[2].position] * 2]
    assert np.allclose(path.positions(t_s), expected, atol=1e-12)
    speeds = [(poses[i + 1].position - poses[i].position) / 1e-3 for i in range(2)]
    rest = np.zeros(3)
    expected = [speeds[0], speeds[0], speeds[0], rest, speeds[1], speeds[1], speeds[1], rest]
    assert np.allclose(path.velocities(t_s), expected, atol=1e-9)
    assert np.allclose(path.breaks_s(), [0.0, 1e-3, 2e-3])
    path.move(3000, 4000, poses[3], seen_from_us=2000.0)
    assert np.allclose(path.positions([0.0, 2e-3]), [poses[1].position] * 2)
    assert np.allclose(path.breaks_s(), [2e-3, 3e-3])


def test_a_profile_keeps_what_a_shutter_sees() -> None:
    profile = SteeredProfile()
    profile.put(0.5)
    profile.change(1000, 2000, 1.5, seen_from_us=0)
    profile.change(2000, 3000, 1.0, seen_from_us=1000.0)
    t_s = [0.5e-3, 1.5e-3, 2e-3, 2.5e-3, 3e-3, 5.0]
    assert np.allclose(profile.factor(t_s), [0.5, 1.0, 1.5, 1.25, 1.0, 1.0])
    assert np.allclose(profile.rate(t_s), [0.0, 1000.0, -500.0, -500.0, -500.0, 0.0])
    assert np.allclose(profile.breaks_s(0.0, 1.0), [0.0, 1e-3, 2e-3])
    profile.change(3000, 4000, 1.0, seen_from_us=2500.0)
    assert np.allclose(profile.factor([0.0, 2.5e-3]), [1.5, 1.25])


def test_a_simulator_that_restarts_is_as_new() -> None:
    """Pixels, objects, lights and time; noise by its own seed."""
    effects = Effects(shot_noise_rms=0.02, threshold_mismatch=0.03)
    simulator = Simulator(
        STILL.with_movable("box", lights=["lamp"]), camera=CAMERA, rays_per_pixel=2, effects=effects, mask_rate_hz=100
    )

    def events() -> bytes:
        packets = simulator.step(0, LOOK)
        packets += simulator.step(10_000, LOOK, objects={"box": PATH.pose(0.1)}, lights={"lamp": 0.8})
        return events_of(packets).tobytes()

    first = events()
    simulator.restart()
    assert events() == first
    simulator.restart(seed=5)
    other = events()
    assert other != first
    assert simulator.settings.seed == 5
    simulator.restart(seed=0)
    assert events() == first
    with pytest.raises(ValueError, match="seed"):
        simulator.restart(seed=-1)
    assert simulator.step(20_000, LOOK)
