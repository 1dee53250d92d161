"""rig.yaml: Kalibr's camchain with sensors, IMUs and mounts; each fault is told in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from davis_rs import RIGS, DecodeError, Rig, SensorParameters, load_rig
from davis_rs.geometry.pose import Pose
from davis_rs.sensor.imu import ImuNoise
from davis_rs.sensor.rig import kalibr_rig_chain, rig_yaml

IDENTITY = np.eye(4).tolist()


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> list[list[float]]:
    """A transform without a turn."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return [list(map(float, row)) for row in matrix]


def camera(**more: object) -> dict[str, object]:
    """A camera of 32 x 24 pixels."""
    return {"resolution": [32, 24], "intrinsics": [20.0, 21.0, 15.5, 11.5], **more}


def load(tmp_path: Path, content: object) -> Rig:
    path = tmp_path / "rig.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return load_rig(path)


def test_a_chain_places_each_camera_by_the_one_before(tmp_path: Path) -> None:
    """T_cn_cnm1 maps points of the camera before to this camera's axes; a turn tells it from its transpose."""
    turn = Pose((0.3, -0.1, 0.2), (0.5, 0.5, 0.5, 0.5)).matrix
    rig = load(tmp_path, {"cam0": camera(), "cam1": camera(T_cn_cnm1=turn.tolist()), "cam2": camera(
        T_cn_cnm1=shifted(x=-0.2))})  # fmt: skip
    assert np.allclose(rig.cameras[0].mount.matrix, np.eye(4))
    assert np.allclose(rig.cameras[1].mount.matrix, np.linalg.inv(turn))
    assert np.allclose(rig.cameras[2].mount.matrix, np.linalg.inv(np.array(shifted(x=-0.2)) @ turn))
    assert np.allclose(rig.relative_pose(1, 0).matrix, turn)


def test_kalibr_states_each_place_twice_and_both_must_agree(tmp_path: Path) -> None:
    content = {
        "cam0": camera(T_cam_imu=shifted(z=0.05)),
        "cam1": camera(T_cam_imu=shifted(x=-0.1, z=0.05), T_cn_cnm1=shifted(x=-0.1)),
        "imu0": {"update_rate": 200.0, "gyroscope_noise_density": 1e-4},
    }
    rig = load(tmp_path, content)
    assert np.allclose(rig.cameras[1].mount.position, (0.1, 0, 0))
    assert np.allclose(rig.imus[0].imu.effective_mounting.lever_arm, (0, 0, 0.05))
    assert rig.imus[0].imu.rate_hz == 200
    assert rig.imus[0].imu.noise == ImuNoise(0.0, 1e-4, 0.0, 0.0)
    content["cam1"] = camera(T_cam_imu=shifted(x=-0.1, z=0.05), T_cn_cnm1=shifted(x=-0.2))
    with pytest.raises(DecodeError, match=r"up to 0\.1 m off .*: they must agree"):
        load(tmp_path, content)


def test_timeshift_is_the_negative_of_the_clock_offset(tmp_path: Path) -> None:
    """t_imu = t_cam + timeshift_cam_imu."""
    told = {"cam0": camera(timeshift_cam_imu=-0.002, clock_drift=1e-4, T_cam_imu=IDENTITY), "imu0": {}}
    clock = load(tmp_path, told).cameras[0].clock
    assert (clock.offset_s, clock.drift) == (0.002, 1e-4)
    assert clock.stamps_us([0, 10_000_000]).tolist() == [2_000, 10_003_000]


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_that_is_written_reads_back(name: str, tmp_path: Path) -> None:
    rig = load_rig(name)
    (tmp_path / "again.yaml").write_text(rig_yaml(rig))
    again = load_rig(tmp_path / "again.yaml")
    assert rig_yaml(again) == rig_yaml(rig)
    for one, other in zip(rig.cameras, again.cameras, strict=True):
        assert (one.camera, one.sensor, one.clock, one.topic) == (other.camera, other.sensor, other.clock, other.topic)
        assert np.array_equal(one.mount.matrix, other.mount.matrix)
    assert [each.imu.describe() for each in rig.imus] == [each.imu.describe() for each in again.imus]


def test_a_rig_with_everything_reads_back(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("contrast_threshold: 0.3\n")
    content = {
        "cam0": camera(distortion_coeffs=[-0.1, 0.01, 1e-3, 0, 1e-3], sensor="mine.yaml", clock_drift=-1e-3,
                       timeshift_cam_imu=0.5, rostopic="/left"),
        "imu0": {"model": "mpu6150", "gravity": [0, 0, -9.8], "effects": {"lag": 0.003}},
    }  # fmt: skip
    rig = load(tmp_path, content)
    assert rig.cameras[0].sensor == SensorParameters(contrast_threshold=0.3)
    assert rig.imus[0].imu.lag_s == 0.003
    (tmp_path / "mine.yaml").unlink()  # what is written no longer needs it
    (tmp_path / "again.yaml").write_text(rig_yaml(rig))
    again = load_rig(tmp_path / "again.yaml")
    assert again.cameras[0].sensor == rig.cameras[0].sensor
    assert (again.cameras[0].camera, again.cameras[0].clock) == (rig.cameras[0].camera, rig.cameras[0].clock)
    mounting, once_more = (each.imus[0].imu.effective_mounting.matrix for each in (rig, again))
    assert np.allclose(mounting, once_more, rtol=0, atol=1e-15)
    assert again.imus[0].imu.describe().keys() == rig.imus[0].imu.describe().keys()
    assert again.imus[0].imu.gravity == (0, 0, -9.8)


def test_the_chain_for_estimators_has_lag_and_clock(tmp_path: Path) -> None:
    content = {
        "cam0": camera(T_cam_imu=IDENTITY),
        "cam1": camera(T_cn_cnm1=shifted(x=-0.1), timeshift_cam_imu=-0.004),
        "imu0": {"model": "mpu6150"},
    }
    chain = yaml.safe_load(kalibr_rig_chain(load(tmp_path, content)))
    assert chain["cam0"]["timeshift_cam_imu"] == pytest.approx(0.0024)
    assert chain["cam1"]["timeshift_cam_imu"] == pytest.approx(0.0024 - 0.004)
    assert np.allclose(chain["cam1"]["T_cn_cnm1"], shifted(x=-0.1))
    assert np.allclose(chain["cam1"]["T_cam_imu"], shifted(x=-0.1))
    assert chain["cam1"]["resolution"] == [32, 24]


FAULTS = {
    "circle": (
        {"cam0": camera(), "cam1": camera(parent="cam2", T_cam_parent=IDENTITY),
         "cam2": camera(parent="cam1", T_cam_parent=IDENTITY)},
        "cam1 -> cam2 -> cam1 is a circle of parents",
    ),
    "own parent": ({"cam0": camera(parent="cam0", T_cam_parent=IDENTITY)}, "cam0 -> cam0 is a circle"),
    "no place": ({"cam0": camera(), "cam1": camera()}, "cam1: nothing says where it is on the body"),
    "no place for the IMU": ({"cam0": camera(), "imu0": {}}, "imu0: nothing says where it is on the body"),
    "size of the sensor": (
        {"cam0": camera(sensor="davis346")}, "cam0: the camera has 32 x 24 pixels, but its sensor has 346 x 260"
    ),
    "missing IMU": ({"cam0": camera(T_cam_imu=IDENTITY)}, "T_cam_imu is relative to imu0, which the rig lacks"),
    "shift without IMU": ({"cam0": camera(timeshift_cam_imu=0.0)}, "relative to imu0, which the rig lacks"),
    "offset of hours": (
        {"cam0": camera(timeshift_cam_imu=3600, T_cam_imu=IDENTITY), "imu0": {}},
        r"cam0: the clock's offset_s must lie in -10\.\.10 s, got -3600",
    ),
    "drift": ({"cam0": camera(clock_drift=1.0)}, "cam0: the clock's drift must lie in -0.1..0.1, got 1"),
    "two offsets": (
        {"cam0": camera(clock_offset=0, timeshift_cam_imu=0, T_cam_imu=IDENTITY), "imu0": {}}, "give one of them"
    ),
    "gap": ({"cam0": camera(), "cam2": camera()}, "cam1 is missing"),
    "no camera": ({"imu0": {}}, "at least one camera"),
    "no mapping": ("[1, 2]", "a rig must be a mapping"),
    "key": ({"cam0": camera(), "baseline": 0.1}, "not 'baseline'"),
    "key of a camera": ({"cam0": camera(intrinsic=1)}, "cam0 has no key 'intrinsic'; did you mean intrinsics"),
    "no lens": ({"cam0": {"resolution": [3, 3]}}, "cam0: intrinsics is missing"),
    "lens": ({"cam0": camera(intrinsics=[1, 2, 3])}, "cam0: intrinsics must be 4 finite numbers"),
    "huge": ({"cam0": camera(intrinsics=[10**400, 1, 1, 1])}, "cam0: intrinsics must be 4 finite numbers"),
    "truth value": ({"cam0": camera(resolution=[True, 2])}, "cam0: resolution must be 2 finite numbers"),
    "half a pixel": ({"cam0": camera(resolution=[32.5, 24])}, "cam0: resolution must be two integers"),
    "model": ({"cam0": camera(camera_model="omni")}, "cam0: camera_model must be pinhole"),
    "first camera": ({"cam0": camera(T_cn_cnm1=IDENTITY)}, "cam0: T_cn_cnm1 is relative to the camera before"),
    "no rotation": (
        {"cam0": camera(), "cam1": camera(T_cn_cnm1=np.diag([2.0, 1, 1, 1]).tolist())}, "cam1: T_cn_cnm1: .*orthonormal"
    ),
    "rows": ({"cam0": camera(), "cam1": camera(T_cn_cnm1=[[1, 0]])}, "4 rows of 4 numbers"),
    "half a parent": ({"cam0": camera(parent="body")}, "parent and T_cam_parent belong together"),
    "unknown parent": ({"cam0": camera(parent="cam9", T_cam_parent=IDENTITY)},
    "relative to cam9, which the rig lacks"),
    "IMU's model": (
        {"cam0": camera(T_cam_imu=IDENTITY), "imu0": {"model": "mpu"}},
        "imu0: model must be one of ideal, davis"),
    "IMU's rate": ({"cam0": camera(T_cam_imu=IDENTITY), "imu0": {"update_rate": 0}}, "imu0: .*rate_hz must be > 0"),
    "body": ({"cam0": camera(), "body": "cam7"}, "body must name a sensor of the rig"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_hostile_rigs_get_one_line(fault: str, tmp_path: Path) -> None:
    """The line names the file, the sensor and the rule."""
    content, said = FAULTS[fault]
    with pytest.raises(DecodeError, match=said) as caught:
        load(tmp_path, content)
    assert str(caught.value).startswith(str(tmp_path / "rig.yaml"))
    assert "\n" not in str(caught.value)


def test_a_name_that_is_no_rig(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="did you mean stereo-davis346"):
        load_rig("stereo-davis34")
    with pytest.raises(FileNotFoundError):
        load_rig(tmp_path / "none.yaml")
