"""The IMU: closed forms of what it reads, each imperfection's law, and what an estimator makes of it."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import IMU_DTYPE, CallableTrajectory, Imu, SegmentTrajectory, Trajectory, simulate_imu
from davis_rs.geometry.camera import load_camera
from davis_rs.geometry.pose import Pose
from davis_rs.geometry.trajectory.trajectory_file import read_trajectory
from davis_rs.sensor.imu import (
    DAVIS_T_IMU_CAMERA,
    ImuLag,
    ImuLowPass,
    ImuNoise,
    ImuQuantisation,
    ImuSaturation,
    Mounting,
    as_imu,
    kalibr_camera_chain,
    kalibr_imu,
)
from places import SHARED

FloatArray = npt.NDArray[np.float64]
POSTER = SHARED / "data" / "poster_6dof.csv"

# x right, y down, z forward, looking along the world's y axis.
UPRIGHT = np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
# T_IMU,E of the dataset's authors, with all digits (DAVIS-IJRR17.yaml of Ultimate SLAM).
TWELVE_DIGITS = np.array(
    [
        [0.999905117246, -0.0122374970355, 0.00632456886338, 0.00674696422488],
        [0.0121780171243, 0.999882045134, 0.00935904469797, 0.0007279224709],
        [-0.00643835413146, -0.00928113597812, 0.99993620202, 0.0342573613538],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def at_rest(duration_s: float = 0.1) -> SegmentTrajectory:
    pose = Pose([1.0, 2.0, 3.0], UPRIGHT)
    return SegmentTrajectory(pose, pose, duration_s)


def falling() -> CallableTrajectory:
    return CallableTrajectory(
        0.5,
        position=lambda t: np.outer(t**2, [0, 0, -9.81 / 2]),
        velocity=lambda t: np.outer(t, [0, 0, -9.81]),
        acceleration=lambda t: np.tile([0, 0, -9.81], (len(t), 1)),
        quaternion=lambda t: np.tile(UPRIGHT, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={},
    )


def spinning(axis: FloatArray, rate: float, growth: float, duration_s: float = 1.0) -> CallableTrajectory:
    """About a body axis through the camera's centre, at rate + growth t."""

    def angle(t: FloatArray) -> FloatArray:
        return rate * t + growth * t**2 / 2

    return CallableTrajectory(
        duration_s,
        position=lambda t: np.zeros((len(t), 3)),
        velocity=lambda t: np.zeros((len(t), 3)),
        quaternion=lambda t: np.column_stack([np.outer(np.sin(angle(t) / 2), axis), np.cos(angle(t) / 2)]),
        angular_rate=lambda t: np.outer(rate + growth * t, axis),
        description={},
    )


def wave(hz: float, duration_s: float = 0.5) -> CallableTrajectory:
    """To and fro along x with an acceleration of cos(2 pi hz t), and a rate about z of the same."""
    w = 2 * np.pi * hz
    return CallableTrajectory(
        duration_s,
        position=lambda t: np.outer((1 - np.cos(w * t)) / w**2, [1, 0, 0]),
        velocity=lambda t: np.outer(np.sin(w * t) / w, [1, 0, 0]),
        acceleration=lambda t: np.outer(np.cos(w * t), [1, 0, 0]),
        quaternion=lambda t: np.tile([0, 0, 0, 1.0], (len(t), 1)),
        angular_rate=lambda t: np.outer(np.cos(w * t), [0, 0, 1]),
        angular_acceleration=lambda t: np.zeros((len(t), 3)),
        description={},
    )


class TestIdeal:
    def test_at_rest_and_upright_it_reads_minus_gravity(self) -> None:
        """accel = R_IW (a - g_W): y points down, so that rest reads (0, -9.81, 0), and no turn."""
        samples = simulate_imu(at_rest())
        assert samples.dtype == IMU_DTYPE
        assert samples["t"].tolist() == list(range(0, 100_001, 1000))
        assert np.allclose(samples["accel"], [0.0, -9.81, 0.0], atol=1e-12)
        assert np.array_equal(samples["gyro"], np.zeros((101, 3)))

    def test_in_free_fall_it_reads_nothing(self) -> None:
        """a = g, wherever the IMU is."""
        for imu in (Imu(), Imu(mounting=Mounting())):
            assert np.allclose(simulate_imu(falling(), imu)["accel"], 0.0, atol=1e-12)

    @pytest.mark.parametrize("growth", [0.0, 7.0])
    def test_rotation_about_an_offset_axis(self, growth: float) -> None:
        """On a lever arm c the closed form is w x (w x c) + dw/dt x c: centripetal and tangential."""
        axis, rate = np.array([1.0, -2.0, 2.0]) / 3, 3.0
        mounting = Mounting()
        imu = Imu(mounting=mounting, gravity=(0.0, 0.0, 0.0))
        samples = simulate_imu(spinning(axis, rate, growth), imu)
        t = samples["t"] * 1e-6
        arm = -mounting.rotation.T @ mounting.matrix[:3, 3]
        across = arm - (arm @ axis) * axis
        w = rate + growth * t
        expected = -np.outer(w**2, across) + growth * np.cross(axis, arm)
        assert np.linalg.norm(across) > 0.02
        assert np.allclose(samples["accel"], expected @ mounting.rotation.T, atol=1e-9)
        assert np.allclose(samples["gyro"], np.outer(w, mounting.rotation @ axis), atol=1e-12)

    def test_lever_arm_moves_the_acceleration_to_where_the_imu_is(self) -> None:
        """The readings are those of an IMU at the centre of a camera that follows the IMU's own path, numerically."""
        t = np.arange(0, 2.0005, 0.001)
        turn = Rotation.from_rotvec(np.stack([np.sin(2 * t), 0.5 * np.cos(3 * t), 1.5 * np.sin(t)], -1))
        from davis_rs import SampledTrajectory

        p = np.stack([0.5 * np.sin(3 * t), 0.3 * np.cos(5 * t), 0.1 * np.sin(7 * t)], -1)
        mounting = Mounting()
        camera = SampledTrajectory(t, p, turn.as_quat())
        imu_path = SampledTrajectory(
            t, p + turn.apply(mounting.lever_arm), (turn * Rotation.from_matrix(mounting.rotation).inv()).as_quat()
        )
        mounted, own = simulate_imu(camera, Imu(mounting=mounting)), simulate_imu(imu_path)
        middle = slice(50, -50)  # the ends of a quintic spline are its weak part
        assert np.allclose(mounted["accel"][middle], own["accel"][middle], atol=1e-5)
        assert np.allclose(mounted["gyro"][middle], own["gyro"][middle], atol=1e-7)


class TestMounting:
    def test_the_printed_matrix_is_projected(self) -> None:
        """Four decimals are 1.7e-4 off orthonormal; projected, they are the calibration with twelve within 0.01 deg."""
        printed = np.array(DAVIS_T_IMU_CAMERA)[:3, :3]
        assert np.abs(printed @ printed.T - np.eye(3)).max() == pytest.approx(1.7e-4, abs=0.05e-4)
        mounting = Mounting()
        assert np.abs(mounting.rotation @ mounting.rotation.T - np.eye(3)).max() < 1e-14
        apart = Rotation.from_matrix(mounting.rotation.T @ TWELVE_DIGITS[:3, :3]).magnitude()
        assert np.degrees(apart) < 0.01
        assert np.abs(mounting.matrix[:3, 3] - TWELVE_DIGITS[:3, 3]).max() < 1e-4

    @pytest.mark.parametrize(
        "matrix", [np.eye(3), np.diag([1.0, 1, -1, 1]), np.diag([1.01, 1, 1, 1]), np.full((4, 4), np.nan)]
    )
    def test_refuses_what_is_not_rigid(self, matrix: FloatArray) -> None:
        """Another shape, a reflection, a scale, not a number."""
        with pytest.raises(ValueError, match="a mounting must"):
            Mounting(matrix)


class TestLagAndLowPass:
    def test_a_sample_shows_the_motion_of_a_lag_ago(self) -> None:
        """With and without the low-pass the total is 2.4 ms; before it has passed, a sample shows t = 0."""
        trajectory = wave(20.0)
        t = np.arange(501) * 1e-3
        late = simulate_imu(trajectory, Imu(lag=ImuLag(0.0024)))
        assert np.allclose(late["gyro"][:, 2], np.cos(2 * np.pi * 20 * np.maximum(t - 0.0024, 0)), atol=1e-12)
        for imu, lag in ((Imu(lag=ImuLag(0.0024), low_pass=ImuLowPass()), 0.0024), (Imu(low_pass=ImuLowPass()), 0.002)):
            both = simulate_imu(trajectory, imu)["gyro"][10:, 2]
            shape = np.stack([np.cos(2 * np.pi * 20 * t[10:]), np.sin(2 * np.pi * 20 * t[10:])], 1)
            c, s = np.linalg.lstsq(shape, both, rcond=None)[0]
            assert np.arctan2(s, c) / (2 * np.pi * 20) == pytest.approx(lag, abs=1e-9)
            assert imu.lag_s == lag

    @pytest.mark.parametrize(("bandwidth", "delay"), [(184.0, 0.002), (94.0, 0.003), (400.0, 0.002)])
    def test_the_low_pass_leaves_minus_3_db_at_its_bandwidth(self, bandwidth: float, delay: float) -> None:
        """Of a sine at the bandwidth 1 / sqrt(2) is left, of rest all, and far beyond it next to nothing."""
        imu = Imu(rate_hz=10_000.0, low_pass=ImuLowPass(bandwidth, delay), gravity=(0.0, 0.0, 0.0))
        left = [
            np.sqrt(2) * simulate_imu(wave(hz), imu)["accel"][1000:4000, 0].std() for hz in (bandwidth, 5 * bandwidth)
        ]
        assert left[0] == pytest.approx(np.sqrt(0.5), rel=3e-3)
        assert left[1] < 0.05
        still = simulate_imu(at_rest(), Imu(low_pass=ImuLowPass(bandwidth, delay)))
        assert np.allclose(still["accel"], [0, -9.81, 0], atol=1e-12)

    def test_rules(self) -> None:
        """A lag below the filter's delay, or a filter longer than its delay allows, cannot be."""
        with pytest.raises(ValueError, match=r"at least 0\.002 s, got 0\.001 s"):
            Imu(lag=ImuLag(0.001), low_pass=ImuLowPass())
        with pytest.raises(ValueError, match=r">= 110\.735 Hz"):
            ImuLowPass(100.0, 0.002)


class TestNoise:
    def test_allan_deviation_is_that_of_the_model(self) -> None:
        """White noise at 1 s and the random walk at long times lie in the deviation's 99.9 % band."""
        allantools = pytest.importorskip("allantools")
        white = ImuNoise(2e-3, 3e-4, 0.0, 0.0)
        walk = ImuNoise(0.0, 0.0, 5e-3, 7e-4)
        rate, count = 200.0, 400_000
        for noise in (white, walk):
            values = noise.draw(count, rate, seed=3)
            accelerometer, gyroscope = (v for v in noise.settings().values() if v)
            for axis in range(6):
                taus, deviations, _, n = allantools.oadev(
                    values[:, axis], rate=rate, data_type="freq", taus=[1.0, 10.0, 50.0]
                )
                density = accelerometer if axis < 3 else gyroscope
                expected = density / np.sqrt(taus) if noise is white else density * np.sqrt(taus / 3)
                alpha = 0 if noise is white else -2
                for tau, deviation, true in zip(taus, deviations, expected, strict=True):
                    freedom = allantools.edf_greenhall(
                        alpha, 2, round(tau * rate), count, overlapping=True, modified=False
                    )
                    low, high = allantools.confidence_interval(deviation, freedom, ci=0.999)
                    assert low < true < high, (axis, tau, deviation, true)
                assert n.min() > 100

    def test_axes_are_independent_and_unbiased(self) -> None:
        """Axes are uncorrelated, and the mean is as near to 0 as the number of draws lets expect."""
        values = ImuNoise(1.0, 1.0, 0.0, 0.0).draw(100_000, 1.0, seed=0)
        assert np.abs(np.corrcoef(values.T) - np.eye(6)).max() < 5 / np.sqrt(100_000)
        assert np.abs(values.mean(0)).max() < 5 / np.sqrt(100_000)

    def test_is_a_function_of_the_seed_and_not_of_the_length(self) -> None:
        """The same seed gives the same bytes, a longer run begins with a shorter one, another seed is another noise."""
        imu = Imu(noise=ImuNoise())
        short, long = (simulate_imu(at_rest(d), imu, seed=5) for d in (0.1, 0.2))
        assert short.tobytes() == long[: len(short)].tobytes() == simulate_imu(at_rest(0.1), imu, seed=5).tobytes()
        assert not np.isin(simulate_imu(at_rest(), imu, seed=6)["accel"], short["accel"]).any()

    def test_none_is_none(self) -> None:
        """Densities of zero leave the ideal bytes."""
        off = Imu(noise=ImuNoise(0.0, 0.0, 0.0, 0.0))
        assert simulate_imu(wave(3), off).tobytes() == simulate_imu(wave(3)).tobytes()


class TestFullScaleAndConverter:
    def test_saturation_holds_each_axis(self) -> None:
        """Within +-16 g and +-2000 deg/s nothing changes, beyond them the full scale is read."""
        g, rate = 16 * 9.80665, np.radians(2000.0)
        values = np.array([[g * 0.99, -g * 1.5, 0, rate * 1.01, -rate * 3, 1.0]])
        assert np.array_equal(ImuSaturation().apply(values), [[g * 0.99, -g, 0, rate, -rate, 1.0]])
        fast = simulate_imu(spinning(np.array([0.0, 0, 1]), 40.0, 0.0), Imu(saturation=ImuSaturation()))
        assert np.allclose(fast["gyro"], [0, 0, rate], atol=1e-12)

    def test_quantisation_rounds_to_codes(self) -> None:
        """Every value is a whole number of 1 / 2048 g or 1 / 16.384 deg/s, at most half a code away, within 16 bits."""
        step = np.repeat([9.80665 / 2048, np.radians(1 / 16.384)], 3)
        values = np.random.default_rng(0).uniform(-0.99, 0.99, (1000, 6)) * 32768 * step
        codes = ImuQuantisation().apply(values) / step
        assert np.allclose(codes, np.rint(codes), atol=1e-9)
        assert np.abs(codes - values / step).max() <= 0.5 + 1e-9
        highest, lowest = (ImuQuantisation().apply(sign * np.full((1, 6), 1e3)) / step for sign in (1, -1))
        assert np.allclose(highest, 32767)
        assert np.allclose(lowest, -32768)

    def test_quantisation_noise_is_uniform(self) -> None:
        """Of a signal over many codes the error has the standard deviation of a code / sqrt(12)."""
        values = np.random.default_rng(1).normal(0, 1.0, (20_000, 6))
        error = ImuQuantisation().apply(values) - values
        step = np.repeat([9.80665 / 2048, np.radians(1 / 16.384)], 3)
        assert np.allclose(error.std(0), step / np.sqrt(12), rtol=0.02)


def test_bad_settings_are_refused() -> None:
    """Each rule names the value."""
    with pytest.raises(ValueError, match=r"rate_hz must be > 0 .* got 0"):
        Imu(rate_hz=0)
    with pytest.raises(ValueError, match="gravity must be three finite numbers"):
        Imu(gravity=(0.0, 0.0, np.nan))
    with pytest.raises(ValueError, match=r"imu_noise gyroscope_random_walk must be finite and >= 0, got -1"):
        ImuNoise(gyroscope_random_walk=-1)
    with pytest.raises(ValueError, match=r"bits must be a whole number in 2\.\.32, or 0, got 1"):
        ImuQuantisation(1)
    samples = simulate_imu(at_rest())
    with pytest.raises(ValueError, match="IMU times must increase, got 1000 us after 2000 us"):
        as_imu(samples[[0, 2, 1]])


@pytest.mark.long
@pytest.mark.skipif(not POSTER.exists(), reason="needs ../shared/data")
@pytest.mark.parametrize(("start_s", "rate_hz"), [(0.0, 1000.0), (20.0, 1000.0), (40.0, 1000.0), (30.0, 4000.0)])
def test_preintegration_returns_the_pose(start_s: float, rate_hz: float) -> None:
    """GTSAM's preintegration over 10 s of a hand-held recording ends within 1 cm and 0.1 deg of the camera's pose.

    It holds readings still over a step, in the axes at the step's beginning: they are given as the mean of both ends,
    turned there. The fastest part (16 rad/s, 30 m/s^2) needs 4 kHz for what is left of that to stay below 1 cm.
    """
    gtsam = pytest.importorskip("gtsam")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # gaps that the recording has
        trajectory: Trajectory = read_trajectory(POSTER).crop(start_s, 10.0)
    mounting = Mounting()
    samples = simulate_imu(trajectory, Imu(rate_hz=rate_hz, mounting=mounting))
    dt = 1 / rate_hz
    gyro = (samples["gyro"][1:] + samples["gyro"][:-1]) / 2
    accel = (samples["accel"][:-1] + Rotation.from_rotvec(gyro * dt).apply(samples["accel"][1:])) / 2

    first, last = trajectory.pose(0.0), trajectory.pose(10.0)
    to_camera = np.linalg.inv(mounting.matrix)
    velocity = trajectory.velocities([0.0])[0] + first.rotation @ np.cross(
        trajectory.angular_rates([0.0])[0], mounting.lever_arm
    )
    state = gtsam.NavState(gtsam.Pose3(first.matrix @ to_camera), velocity)
    bias = gtsam.imuBias.ConstantBias()
    preintegrated = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81), bias)
    every = round(0.01 * rate_hz)  # its tangent space is good for short times
    for i, (force, rate) in enumerate(zip(accel, gyro, strict=True), 1):
        preintegrated.integrateMeasurement(force, rate, dt)
        if i % every == 0:
            state = preintegrated.predict(state, bias)
            preintegrated.resetIntegration()
    found = state.pose().matrix() @ mounting.matrix
    turned = Rotation.from_matrix(found[:3, :3].T @ last.rotation).magnitude()
    assert np.linalg.norm(found[:3, 3] - last.position) < 0.01
    assert np.degrees(turned) < 0.1


def test_kalibr_files_hold_what_was_simulated() -> None:
    """imu.yaml and camchain.yaml parse as YAML, with Kalibr's keys, T_cam_imu the inverse of T_imu_camera."""
    yaml = pytest.importorskip("yaml")
    imu, camera = Imu.mpu6150(), load_camera("davis240c")
    parameters = yaml.safe_load(kalibr_imu(imu))
    assert parameters == {
        "rostopic": "/dvs/imu",
        "update_rate": 1000.0,
        "accelerometer_noise_density": 1.86e-3,
        "accelerometer_random_walk": 4.33e-4,
        "gyroscope_noise_density": 1.86e-4,
        "gyroscope_random_walk": 2.66e-5,
    }
    chain = yaml.safe_load(kalibr_camera_chain(camera, imu))["cam0"]
    assert np.allclose(np.array(chain["T_cam_imu"]) @ imu.effective_mounting.matrix, np.eye(4), atol=1e-15)
    assert chain["intrinsics"] == [camera.fx, camera.fy, camera.cx, camera.cy]
    assert chain["distortion_coeffs"] == [camera.k1, camera.k2, camera.p1, camera.p2]
    assert chain["resolution"] == [240, 180]
    assert chain["timeshift_cam_imu"] == 0.0024
    assert yaml.safe_load(kalibr_imu(Imu()))["gyroscope_random_walk"] == 0.0
