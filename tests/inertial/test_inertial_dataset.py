"""IMU and motion capture in the dataset folder, from Python and from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from davis_rs import (
    Camera,
    Dataset,
    DatasetWriter,
    FixedRate,
    Imu,
    MocapClock,
    MocapNoise,
    MotionCapture,
    load_camera,
    load_scene,
    simulate_imu,
    simulate_to_folder,
)
from davis_rs.cli.main import main
from davis_rs.events.arrays import EVENT_DTYPE
from davis_rs.events.packet import Packet
from davis_rs.geometry.pose import Pose
from davis_rs.sensor.imu import IMU_DTYPE, kalibr_camera_chain, kalibr_imu

CAMERA = load_camera("davis240c")


def samples(*t_us: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    array = np.zeros(len(t_us), IMU_DTYPE)
    array["t"] = t_us
    array["accel"] = np.outer(t_us, [1 / 3, -1e-9, 9.81])
    array["gyro"] = np.outer(t_us, [-1 / 7, 1e9, 0.0])
    return array


def packet(start_us: int, end_us: int) -> Packet:
    return Packet(start_us, end_us, np.zeros(0, EVENT_DTYPE), Pose([0, 0, 0], [0, 0, 0, 1]))


def test_samples_are_read_back_bit_by_bit(tmp_path: Path) -> None:
    """imu.txt holds `timestamp ax ay az gx gy gz` with exact numbers; the files of Kalibr are next to it."""
    with DatasetWriter(tmp_path / "out", CAMERA, imu=Imu.mpu6150()) as writer:
        writer.write(packet(0, 0), imu=samples(0))
        writer.write(packet(0, 2500), imu=samples(1000, 2000))
        writer.write(packet(2500, 2700))
    dataset = Dataset(tmp_path / "out")
    assert dataset.imu.tobytes() == samples(0, 1000, 2000).tobytes()
    lines = (tmp_path / "out" / "imu.txt").read_text().splitlines()
    assert lines[1].split()[0] == "0.001000000"
    assert [len(line.split()) for line in lines] == [7, 7, 7]
    assert dataset.meta["counts"]["imu_samples"] == 3
    assert (tmp_path / "out" / "imu.yaml").read_text() == kalibr_imu(Imu.mpu6150())
    assert (tmp_path / "out" / "camchain.yaml").read_text() == kalibr_camera_chain(CAMERA, Imu.mpu6150())
    with DatasetWriter(tmp_path / "out", CAMERA, overwrite=True):
        pass
    assert not {"imu.txt", "imu.yaml", "camchain.yaml"} & {path.name for path in (tmp_path / "out").iterdir()}
    assert len(Dataset(tmp_path / "out").imu) == 0


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    """Times that go back leave the writer as it was; k3 has no place in Kalibr's file, and no folder is made."""
    with DatasetWriter(tmp_path / "out", CAMERA) as writer:
        writer.write(packet(0, 0), imu=samples(0, 1000))
        with pytest.raises(ValueError, match="got 1000 us after 1000 us"):
            writer.write(packet(0, 1500), imu=samples(1000))
        writer.write(packet(0, 1500), imu=samples(2000))
    assert Dataset(tmp_path / "out").imu["t"].tolist() == [0, 1000, 2000]
    with pytest.raises(ValueError, match=r"has no k3, which must be 0, got 0\.1"):
        DatasetWriter(tmp_path / "no", Camera(240, 180, 200.0, 200.0, 120.0, 90.0, k3=0.1), imu=Imu())
    assert not (tmp_path / "no").exists()


@pytest.mark.usefixtures("llvm")
def test_a_recording_has_the_imu_and_the_ground_truth_that_were_asked_for(tmp_path: Path) -> None:
    """imu.txt is simulate_imu, groundtruth.txt the motion capture's, and meta.json tells both."""
    scene = load_scene("three_walls")
    trajectory = scene.path.crop(0.2, 0.12)
    capture = MotionCapture(100.0, MocapNoise(), MocapClock(0.031, 1e-3))
    simulate_to_folder(
        scene,
        tmp_path / "out",
        start_s=0.2,
        duration_s=0.12,
        camera=Camera(24, 18, 20.0, 20.0, 11.5, 8.5),
        sampling=FixedRate(200),
        seed=9,
        motion_capture=capture,
        imu=Imu.mpu6150(),
        quiet=True,
    )
    dataset = Dataset(tmp_path / "out")
    assert dataset.imu.tobytes() == simulate_imu(trajectory, Imu.mpu6150(), seed=9).tobytes()
    expected = capture.poses(trajectory, seed=9)
    assert dataset.groundtruth.t_us.tolist() == expected.t_us.tolist() == list(range(40_000, 151_000, 10_000))
    assert np.array_equal(dataset.groundtruth.positions, expected.positions)
    assert np.allclose(dataset.groundtruth.quaternions, expected.quaternions, atol=1e-15)
    assert dataset.meta["imu"]["lag_s"] == 0.0024
    assert dataset.meta["motion_capture"]["clock"] == {"offset_s": 0.031, "drift": 1e-3}


@pytest.mark.usefixtures("llvm")
def test_the_command_line_asks_for_them_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--imu with effects of its own, and a clock and noise of the ground truth."""
    out = tmp_path / "out"
    scene = ["simulate", "three_planes", "-o", str(out), "--duration", "0.02", "--render-rate", "200", "--quiet"]
    imu = ["--imu", "davis", "--imu-rate", "500", "--imu-effect", "lag=0.001", "--imu-effect", "quantisation=12"]
    truth = ["--pose-noise", "0.001", "--clock-offset", "0.005", "--clock-drift", "2"]
    assert main([*scene, *imu, *truth]) == 0
    meta = json.loads((out / "meta.json").read_text())
    assert meta["imu"]["rate_hz"] == 500
    assert meta["imu"]["lag_s"] == 0.001
    assert meta["imu"]["quantisation"]["bits"] == 12
    assert "noise" not in meta["imu"]
    assert meta["motion_capture"]["clock"]["drift"] == pytest.approx(2e-3 / 60)
    assert Dataset(out).imu["t"].tolist() == list(range(0, 20_001, 2000))
    capsys.readouterr()
    assert main([*scene, "--overwrite", "--imu-effect", "lag"]) == 1
    assert "--imu-rate and --imu-effect are those of an IMU, but --imu is none" in capsys.readouterr().err
    assert main([*scene, "--overwrite", "--imu", "mpu6150", "--imu-effect", "lag=0.001"]) == 1
    assert "must be at least 0.002 s, got 0.001 s" in capsys.readouterr().err
