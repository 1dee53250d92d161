"""Rigs: each camera is what it is alone, byte for byte; clocks, IMUs, folders and their checks."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import (
    ArgumentError,
    Camera,
    CameraClock,
    Dataset,
    FixedRate,
    Flicker,
    Imu,
    Pose,
    Rig,
    RigCamera,
    RigDataset,
    RigImu,
    RigSimulator,
    SampledProfile,
    Scene,
    Simulator,
    compare_events,
    load_scene,
    simulate,
    simulate_rig,
    simulate_rig_to_folder,
    simulate_to_folder,
)
from davis_rs.cli.main import main
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import IDENTITY
from davis_rs.geometry.trajectory.derived import MountedTrajectory, PacedTrajectory
from davis_rs.render import choice
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.sensor.rig.rig import member_seed
from davis_rs.simulation.rig.rig_cameras import scene_of_camera
from moving_scene import BOX, DIRECT, FLOOR, LAMP, PATH

LEFT, RIGHT = Camera(48, 36, 40.0, 40.0, 23.5, 17.5), Camera(40, 30, 34.0, 35.0, 19.0, 15.0, k1=-0.1)
MOUNT = Pose((0.12, 0.01, -0.02), (0.0, 0.05, 0.0, 0.99874921777190884))
NOISY: dict[str, Any] = {"effects": {"shot_noise_rms": 0.1}, "accuracy": "fast"}
LONG_S = 0.06


def pair(*, offset_s: float = 0.0, drift: float = 0.0, imus: int = 1) -> Rig:
    """Two cameras of different lenses and sizes; the second one has a clock and a place of its own."""
    right = RigCamera(camera=RIGHT, mount=MOUNT, clock=CameraClock(offset_s, drift))
    inertial = tuple(RigImu(imu=Imu.mpu6150()) for _ in range(imus))
    return Rig(name="pair", cameras=(RigCamera(camera=LEFT), right), imus=inertial)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("three_planes").crop(0.3, LONG_S)


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.few(1)
@pytest.mark.parametrize("clock", [(0.0, 0.0), (0.004, 0.0), (-0.003, 2e-3)], ids=["one", "ahead", "behind"])
def test_two_cameras_are_two_runs_of_one(clock: tuple[float, float], scene: Scene, tmp_path: Path) -> None:
    """Byte for byte, clocks included; and the body is the same in all three folders."""
    rig = pair(offset_s=clock[0], drift=clock[1])
    report = simulate_rig_to_folder(scene, tmp_path / "both", rig=rig, seed=7, quiet=True, **NOISY)
    assert report.camera_events[0] > 500 < report.camera_events[1]
    for index in (0, 1):
        simulate_rig_to_folder(
            scene, tmp_path / "one", rig=rig, seed=7, camera_index=index, overwrite=True, quiet=True, **NOISY
        )
        together, alone = files(tmp_path / "both" / f"cam{index}"), files(tmp_path / "one" / f"cam{index}")
        assert together == alone
        assert [path.name for path in (tmp_path / "one").glob("cam?")] == [f"cam{index}"]
    for name in ("groundtruth.txt", "imu0.txt", "rig.yaml", "camchain.yaml"):
        assert (tmp_path / "both" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    assert main(["check", str(tmp_path / "both")]) == 0


def test_a_camera_at_the_body_is_a_plain_simulation(scene: Scene, tmp_path: Path) -> None:
    """The first camera of a rig is today's dataset but for what meta.json says of the rig."""
    simulate_rig_to_folder(scene, tmp_path / "rig", rig=pair(), seed=3, quiet=True, **NOISY)
    simulate_to_folder(
        scene, tmp_path / "plain", camera=LEFT, seed=3, quiet=True, imu=replace(Imu.mpu6150(), mounting=None), **NOISY
    )
    plain, camera = files(tmp_path / "plain"), files(tmp_path / "rig" / "cam0")
    metas = [json.loads(one.pop("meta.json")) for one in (plain, camera)]
    assert metas[1].pop("rig")["camera"] == 0
    assert metas[0] | {"imu": None} == metas[1] | {"imu": None}
    for one in (plain, camera):  # of the IMU's mounting alone
        one.pop("camchain.yaml"), one.pop("imu.txt")
    assert plain == camera


def test_noise_is_independent_by_seed_and_camera(scene: Scene) -> None:
    """Two cameras at one place see the same, with noise of their own."""
    rig = Rig(name="twins", cameras=(RigCamera(camera=LEFT), RigCamera(camera=LEFT)))

    def events(**settings: Any) -> list[bytes]:
        streams: list[list[bytes]] = [[], []]
        for camera, packet in simulate_rig(scene, rig, duration_s=0.02, accuracy="fast", **settings):
            streams[camera].append(packet.events.tobytes())
        return [b"".join(stream) for stream in streams]

    ideal = events()
    assert ideal[0] == ideal[1]
    noisy = events(effects={"shot_noise_rms": 0.1}, seed=1)
    assert noisy[0] != noisy[1]
    assert member_seed(5, 0) == 5
    assert len({member_seed(seed, index) for seed in (0, 1) for index in range(4)}) == 8


def test_a_camera_records_by_its_own_clock(scene: Scene) -> None:
    """At the camera's time t the rig's is (t - offset) / (1 + drift), and the path's start_s later."""
    moving = replace(scene, objects={"x": scene.path}, lights={"lamp": Flicker(100.0, modulation=0.3)})
    rig = pair(offset_s=0.004, drift=0.05)
    assert rig.start_s == pytest.approx(0.004 / 1.05)
    assert rig.begins_s(0) == rig.start_s
    assert rig.begins_s(1) == 0
    recorded = scene_of_camera(moving, rig, 1)
    assert recorded.path.duration_s == pytest.approx(1.05 * LONG_S)
    t_s = 0.021
    path_s = (t_s - 0.004) / 1.05 + rig.start_s
    assert np.allclose(recorded.path.pose(t_s).matrix, scene.path.pose(path_s).matrix @ MOUNT.matrix)
    assert np.allclose(recorded.objects["x"].pose(t_s).matrix, scene.path.pose(path_s).matrix)
    assert recorded.lights["lamp"].factor([t_s]) == pytest.approx(Flicker(100.0, modulation=0.3).factor([path_s]))
    late = pair(offset_s=-0.01)
    assert (late.start_s, late.begins_s(0), late.begins_s(1)) == (0, 0, 0.01)
    first = scene_of_camera(moving, late, 0)
    assert first.path is moving.path


def test_the_imu_is_stamped_by_each_clock(scene: Scene, tmp_path: Path) -> None:
    """A sample in a camera's folder is the rig's, with the stamp of that camera's clock."""
    rig = pair(offset_s=0.004, drift=1e-3, imus=2)
    simulate_rig_to_folder(scene, tmp_path / "rig", rig=rig, quiet=True, accuracy="fast")
    dataset = RigDataset(tmp_path / "rig")
    assert dataset.rig.name == "pair"
    own, shared = dataset.cameras[1].imu, dataset.imus[0]
    assert own["t"][:3].tolist() == [4000, 5001, 6002]
    assert np.array_equal(own["accel"], shared["accel"][: len(own)])
    assert np.array_equal(dataset.cameras[0].imu["gyro"], shared["gyro"])
    assert not np.array_equal(shared["accel"], dataset.imus[1]["accel"])
    assert len(dataset.groundtruth.t_us) == 12
    t_s = dataset.groundtruth.t_us[3] * 1e-6 + rig.start_s
    assert np.allclose(dataset.groundtruth.positions[3], scene.path.pose(t_s).position)


def test_the_scene_is_loaded_and_built_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables and BVH are made for the first camera; nothing is kept after the cameras are made."""
    made: list[object] = []
    whole = SceneTable

    def counted(*given: Any, **more: Any) -> object:
        made.append(given)
        return whole(*given, **more)

    monkeypatch.setattr(choice, "SceneTable", counted)
    rig = replace(pair(), cameras=pair().cameras * 2)
    simulator = RigSimulator(scene, rig, accuracy="fast")
    cores = {id(each.renderer._core) for each in simulator.simulators}  # type: ignore[attr-defined]
    assert (len(made), len(cores)) == (1, 1)
    Simulator(scene, camera=LEFT, accuracy="fast")
    assert len(made) == 2


def test_packets_come_in_step(scene: Scene) -> None:
    rig = pair(offset_s=-0.01)
    ends_us = {0: 0, 1: 10_000}
    for camera, packet in simulate_rig(scene, rig, accuracy="fast", frame_rate_hz=100):
        assert ends_us[camera] <= min(ends_us.values())
        ends_us[camera] = packet.end_us + (10_000 if camera else 0)
    assert set(ends_us.values()) == {round(LONG_S * 1e6)}


@pytest.mark.parametrize(("offset_s", "drift"), [(0.0, 0.0), (0.004, 0.0), (-0.0035, 0.01)])
def test_steps_are_those_of_single_simulators(offset_s: float, drift: float, scene: Scene) -> None:
    """A camera whose clock starts later begins between two steps, where the body is then."""
    rig = pair(offset_s=offset_s, drift=drift)
    together = RigSimulator(scene, rig, accuracy="fast")
    alone = Simulator(scene_of_camera(scene, rig, 1), camera=RIGHT, seed=member_seed(0, 1), accuracy="fast")
    begins_us = rig.begins_s(1) * 1e6
    poses = {t_us: scene.path.pose(t_us * 1e-6) for t_us in range(0, 10_001, 2000)}
    begun = False
    for t_us, pose in poses.items():
        left, right = together.step(t_us, pose)
        assert left if t_us >= rig.begins_s(0) * 1e6 else not left
        expected = []
        if t_us >= begins_us:
            if not begun:
                at = poses[0] if begins_us == 0 else scene.path.pose(begins_us * 1e-6)
                expected += alone.step(0, at @ MOUNT)
                begun = True
            own_us = round((t_us - begins_us) * (1 + drift))
            expected += alone.step(own_us, pose @ MOUNT) if own_us else []
        assert [packet.end_us for packet in right] == [packet.end_us for packet in expected]
        if begins_us == 0:
            assert all(np.array_equal(a.events, b.events) for a, b in zip(right, expected, strict=True))
    assert begun
    with pytest.raises(ValueError, match="must be after the last one"):
        together.step(10_000, poses[0])


BOXES = Scene("boxes", partial(dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}))
ABOVE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])


@pytest.mark.without_llvm
@pytest.mark.parametrize(("offset_s", "drift"), [(0.0, 0.0), (0.004, 0.0), (-0.0075, 0.05)])
def test_all_cameras_see_what_a_caller_moves(offset_s: float, drift: float) -> None:
    """The events of a box that moves by itself, and of a lamp that fades; a camera may begin between two steps."""
    rig = pair(offset_s=offset_s, drift=drift)
    fading = SampledProfile([0.0, 0.02], [1.0, 0.5])
    by_scene = replace(BOXES, objects={"box": PATH}, lights={"lamp": fading})
    by_hand = BOXES.with_movable("box", lights=["lamp"])
    settings: dict[str, Any] = {"rays_per_pixel": 2, "sampling": FixedRate(1000)}
    expected, seen = (RigSimulator(each, rig, **settings) for each in (by_scene, by_hand))
    events: tuple[tuple[list[EventArray], ...], ...] = (([], []), ([], []))
    for t_us in range(0, 20_001, 5000):
        t_s = t_us * 1e-6
        lamp = {"lamp": 1 - 25 * t_s}
        for camera, packets in enumerate(expected.step(t_us, ABOVE)):
            events[0][camera].extend(packet.events for packet in packets)
        for camera, packets in enumerate(seen.step(t_us, ABOVE, objects={"box": PATH.pose(t_s)}, lights=lamp)):
            events[1][camera].extend(packet.events for packet in packets)
    for camera, size in enumerate([(48, 36), (40, 30)]):
        truth = concatenate_events(events[0][camera])
        assert len(truth) > 300
        # Poses differ in the last bit, so a stamp may be a microsecond off.
        found = compare_events(concatenate_events(events[1][camera]), truth, size=size, window_us=2)
        assert found.missing + found.spurious <= 0.01 * len(truth)


def test_a_rig_refuses_to_move_what_follows_the_scene() -> None:
    """One line says which; nothing has moved then."""
    rig = RigSimulator(BOXES.with_movable("box"), pair(), rays_per_pixel=2, sampling=FixedRate(1000))
    with pytest.raises(ArgumentError, match="of objects, 'floor' is not the caller's"):
        rig.step(0, ABOVE, objects={"floor": ABOVE})
    assert rig.step(0, ABOVE)


def test_what_contradicts_the_rig_is_refused(scene: Scene, tmp_path: Path) -> None:
    rig = pair()
    refused: dict[str, dict[str, Any]] = {
        "camera and size": {"camera": LEFT},
        "size are those": {"size": "20x20"},
        "imu, imu_rate_hz": {"imu": "ideal"},
        "must be one of 0..1": {"camera_index": 2},
        "may remember": {"custom_effects": ["a:b"]},
    }
    for said, settings in refused.items():
        with pytest.raises(ArgumentError, match=said):
            simulate_rig_to_folder(scene, tmp_path / "no", rig=rig, quiet=True, **settings)
    own = replace(rig, cameras=tuple(replace(each, sensor="ideal") for each in rig.cameras))
    with pytest.raises(ArgumentError, match="would be ignored"):
        simulate_rig(scene, own, sensor="davis240c")
    late = pair(offset_s=-9.0)
    with pytest.raises(ArgumentError, match=r"the clock of cam1 shows 0 after 9 s of the path, which ends at 0\.06 s"):
        simulate_rig(scene, late)
    assert not (tmp_path / "no").exists()


def test_a_rigs_folder_is_replaced_whole(scene: Scene, tmp_path: Path) -> None:
    """Of a rig with more cameras none stays; files of others do."""
    folder = tmp_path / "rig"
    three = replace(pair(imus=2), cameras=(*pair().cameras, RigCamera(camera=LEFT)))
    simulate_rig_to_folder(scene, folder, rig=three, duration_s=0.01, quiet=True, accuracy="fast")
    (folder / "mine.txt").write_text("keep")
    (folder / "cam2" / "mine.txt").write_text("keep")
    with pytest.raises(FileExistsError):
        simulate_rig_to_folder(scene, folder, rig=pair(), duration_s=0.01, quiet=True, accuracy="fast")
    simulate_rig_to_folder(scene, folder, rig=pair(), duration_s=0.01, overwrite=True, quiet=True, accuracy="fast")
    assert sorted(path.name for path in (folder / "cam2").iterdir()) == ["mine.txt"]
    assert (folder / "mine.txt").read_text() == "keep"
    assert not (folder / "imu1.txt").exists()
    assert len(RigDataset(folder).cameras) == 2
    with pytest.raises(FileNotFoundError, match="is the folder of a rig, each of whose cameras is a dataset"):
        Dataset(folder)
    with pytest.raises(FileNotFoundError, match="is not the folder of a rig"):
        RigDataset(folder / "cam0")


def test_info_check_and_view_take_a_rigs_folder(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "rig"
    simulate_rig_to_folder(scene, folder, rig=pair(offset_s=0.004), quiet=True, accuracy="fast")
    capsys.readouterr()
    assert main(["info", str(folder), "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "rig 'pair', 2 cameras, 1 IMUs" in said
    assert "clock +4 ms" in said
    assert said.count("dataset folder") == 2
    assert main(["check", str(folder)]) == 0
    assert "the check of the rig holds" in capsys.readouterr().out
    assert main(["view", str(folder)]) == 0
    assert sorted(path.name for path in folder.glob("*.png")) == ["view_cam0.png", "view_cam1.png"]


def test_check_sees_a_camera_that_is_elsewhere(scene: Scene, tmp_path: Path) -> None:
    """A pose that is moved, and one that is turned, are not where the body and the mount put them."""
    folder = tmp_path / "rig"
    simulate_rig_to_folder(scene, folder, rig=pair(), duration_s=0.03, quiet=True, accuracy="fast")
    truth = folder / "cam1" / "groundtruth.txt"
    lines = truth.read_text().splitlines()
    words = lines[2].split()
    pose = Pose([float(word) for word in words[1:4]], [float(word) for word in words[4:]])
    turned = (pose @ Pose((0, 0, 0), (0.01, 0, 0, 0.99995))).quaternion
    for change in ([words[0], str(float(words[1]) + 0.01), *words[2:]], [*words[:4], *map(repr, turned.tolist())]):
        truth.write_text("\n".join([*lines[:2], " ".join(map(str, change)), *lines[3:]]) + "\n")
        assert main(["check", str(folder)]) == 1
    truth.write_text("\n".join(lines) + "\n")
    assert main(["check", str(folder)]) == 0
    shutil.rmtree(folder / "cam1")
    assert main(["check", str(folder)]) == 1


def test_the_command_line_takes_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "out")
    command = ["simulate", "three_planes", "--rig", "stereo-davis346", "-o", out, "--duration", "0.005"]
    assert main([*command, "--rays-per-pixel", "1", "--quiet", "--camera-index", "1"]) == 0
    assert [path.name for path in (tmp_path / "out").glob("cam?")] == ["cam1"]
    assert main(["simulate", "three_planes", "--camera-index", "0", "-o", str(tmp_path / "no")]) == 1
    assert "--camera-index is that of a camera of a rig: give --rig" in capsys.readouterr().err


@pytest.mark.long
def test_generate_makes_rigs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("scene: three_planes\nduration: 0.005\nrig: stereo-davis346\naccuracy: fast\nrays_per_pixel: 1\n")
    assert main(["generate", str(plan), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    assert main(["verify", str(tmp_path / "out")]) == 0
    assert len(RigDataset(tmp_path / "out" / "sequence_00000").cameras) == 2
    plan.write_text(plan.read_text() + "camera: ideal\n")
    assert main(["generate", str(plan), "--dry-run"]) == 1
    assert "rig = 'stereo-davis346': camera and size are those" in capsys.readouterr().err


def test_paths_of_neutral_cameras_are_the_bodys_own(scene: Scene) -> None:
    """So that nothing is rounded where nothing is mounted elsewhere."""
    rig = Rig(name="r", cameras=(RigCamera(camera=LEFT), RigCamera(camera=LEFT, mount=MOUNT)))
    assert scene_of_camera(scene, rig, 0).path is scene.path
    assert isinstance(scene_of_camera(scene, rig, 1).path, MountedTrajectory)
    drifting = replace(rig, cameras=(RigCamera(camera=LEFT, clock=CameraClock(0, 0.01)),))
    assert isinstance(scene_of_camera(scene, drifting, 0).path, PacedTrajectory)
    assert IDENTITY.matrix.tolist() == np.eye(4).tolist()
    assert next(iter(simulate(scene, camera=LEFT))).end_us == 0
