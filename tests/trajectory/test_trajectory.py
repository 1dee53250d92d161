"""Poses, and trajectories from functions, segments and samples."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from davis_rs import ArgumentError, Scene, as_pose, start_pose
from davis_rs.geometry.pose import Pose, rotation_matrices
from davis_rs.geometry.trajectory.motions import hand_held, running, slider, spiral, walking, zigzag
from davis_rs.geometry.trajectory.sampled_trajectory import SampledTrajectory
from davis_rs.geometry.trajectory.trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align
from davis_rs.geometry.trajectory.views import Views

FloatArray = npt.NDArray[np.float64]

# A rotation by 2 rad about a skew axis: its transpose differs, and it commutes with none of the axes.
SKEW = Rotation.from_rotvec(2.0 * np.array([1.0, -2.0, 2.0]) / 3.0).as_quat()


def tumbling(t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A hand-held-like path: positions (n, 3) and quaternions (n, 4) turning about changing axes, from a skew start."""
    position = np.stack([0.5 * np.sin(3 * t), 1 + 0.3 * np.cos(5 * t), 1.8 + 0.1 * np.sin(7 * t)], -1)
    turn = Rotation.from_rotvec(np.stack([np.sin(2 * t), 0.5 * np.cos(3 * t), 1.5 * np.sin(t)], -1))
    return position, (Rotation.from_quat(SKEW) * turn).as_quat()


def sampled(rate_hz: float = 200.0, duration_s: float = 3.0) -> SampledTrajectory:
    t = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    return SampledTrajectory(t, *tumbling(t))


def circle() -> CallableTrajectory:
    """A camera on a circle of 0.2 m at 2 rad/s, yawing at 0.5 rad/s about its own y axis."""
    skew = Rotation.from_quat(SKEW)

    def turned(t: FloatArray) -> FloatArray:
        half = 0.25 * t
        yaw = np.stack([0 * t, np.sin(half), 0 * t, np.cos(half)], -1)
        q: FloatArray = (skew * Rotation.from_quat(yaw)).as_quat()
        return q

    return CallableTrajectory(
        2.0,
        position=lambda t: np.stack([0.2 * np.sin(2 * t), 0.2 * np.cos(2 * t), 0 * t + 1.8], -1),
        quaternion=turned,
        velocity=lambda t: np.stack([0.4 * np.cos(2 * t), -0.4 * np.sin(2 * t), 0 * t], -1),
        angular_rate=lambda t: np.tile([0.0, 0.5, 0.0], (len(t), 1)),
        description={"scene": "circle"},
    )


def segment() -> SegmentTrajectory:
    end = Rotation.from_quat(SKEW) * Rotation.from_rotvec([0.3, 0.8, -1.1])
    return SegmentTrajectory(Pose([1.0, 2.0, 3.0], SKEW), Pose([0.0, 2.5, 3.0], end.as_quat()), 0.4)


ALL = {
    "sampled": sampled(),
    "smoothed": SampledTrajectory(
        np.arange(601) / 200.0, *tumbling(np.arange(601) / 200.0), position_sigma_m=1e-3, rotation_sigma_rad=1e-3
    ),
    "callable": circle(),
    "segment": segment(),
    "aligned": align(sampled(), Pose([3.0, -1.0, 0.5], Rotation.from_euler("xyz", [0.4, 1.2, -2.0]).as_quat()), 1.3),
    "interval": sampled().crop(0.7, 1.5),
}
EVERY = pytest.mark.parametrize("trajectory", ALL.values(), ids=ALL.keys())

coordinates = st.lists(st.floats(-10, 10), min_size=3, max_size=3)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    rotation = Rotation.from_rotvec(draw(st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3)))
    sign = draw(st.sampled_from([-1.0, 1.0]))
    return Pose(np.array(draw(coordinates)), sign * rotation.as_quat())


def test_rotations_have_the_bits_of_scipy() -> None:
    """Of few and many quaternions, and of exact, rounded and nearly orthonormal matrices."""
    random = np.random.RandomState(5)
    quaternions = np.concatenate([np.eye(4), random.randn(500, 4)])
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    matrices = Rotation.from_quat(quaternions).as_matrix()
    assert np.array_equal(rotation_matrices(quaternions), matrices)
    assert np.array_equal(rotation_matrices(quaternions[7:9]), matrices[7:9])
    assert np.array_equal(rotation_matrices(quaternions[7]), matrices[7])
    assert rotation_matrices(quaternions[:0]).shape == (0, 3, 3)
    for matrix in matrices:
        for near in (matrix, matrix.astype(np.float32).astype(float), matrix + 1e-9 * random.randn(3, 3)):
            pose = Pose(np.zeros(3), Rotation.from_matrix(near).as_quat())
            made = Pose.from_matrix(np.block([[near, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
            assert np.array_equal(made.quaternion, pose.quaternion)


class TestPose:
    def test_quaternion_is_hamilton_xyzw_from_camera_to_world(self) -> None:
        """A quarter turn about z, as (x, y, z, w), carries the camera's x axis to the world's y axis, not to -y."""
        pose = Pose([1.0, 2.0, 3.0], [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
        assert np.allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-15)
        assert np.allclose(pose.matrix @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-15)

    def test_normalises_and_freezes_a_copy(self) -> None:
        """A norm within 1e-3 is made 1, and neither the caller's array nor the pose can change through the other."""
        given_quaternion = np.array([0.0, 0.0, 0.0, 1.0009])
        pose = Pose(np.zeros(3), given_quaternion)
        assert np.linalg.norm(pose.quaternion) == 1.0
        assert given_quaternion[3] == 1.0009
        with pytest.raises(ValueError, match="read-only"):
            pose.position[0] = 1.0

    @pytest.mark.parametrize(
        ("position", "quaternion", "message"),
        [
            ([0, 0], [0, 0, 0, 1], r"position must have shape \(3,\), got \(2,\)"),
            ([0, 0, 0], [0, 0, 1], r"quaternion must have shape \(4,\), got \(3,\)"),
            ([0, np.inf, 0], [0, 0, 0, 1], "position must be finite"),
            ([0, 0, 0], [0, 0, 0, np.nan], "quaternion must be finite"),
            ([0, 0, 0], [0, 0, 0, 1.0011], r"norm 1 within 0.001, got norm 1\.0011"),
        ],
    )
    def test_refuses_what_is_no_pose(self, position: list[float], quaternion: list[float], message: str) -> None:
        """Each rule is an error that states it with the value."""
        with pytest.raises(ValueError, match=message):
            Pose(np.array(position, float), np.array(quaternion, float))

    @given(poses())
    def test_matrix_round_trip(self, pose: Pose) -> None:
        """from_matrix inverts matrix, up to the quaternion's sign."""
        again = Pose.from_matrix(pose.matrix)
        assert np.array_equal(again.position, pose.position)
        assert abs(again.quaternion @ pose.quaternion) == pytest.approx(1.0, abs=1e-12)

    @pytest.mark.parametrize("scale", [(1, 1, -1, 1), (1, 1, 1.001, 1), (1, 1, 1, 2)])
    def test_from_matrix_refuses_what_is_not_rigid(self, scale: tuple[float, ...]) -> None:
        """A mirror image (the usual slip with y-up cameras), a scale and a projective row are refused."""
        with pytest.raises(ValueError, match="a pose matrix must"):
            Pose.from_matrix(np.diag(scale))

    def test_what_stands_for_a_pose_is_taken_wherever_one_is(self) -> None:
        """A matrix, or position and quaternion, by all that take poses."""
        pose = Pose((1, -2, 0.5), SKEW)
        forms: list[Any] = [
            pose,
            pose.matrix,
            pose.matrix.tolist(),
            (pose.position, pose.quaternion),
            [[1, -2, 0.5], SKEW],
        ]
        for form in forms:
            assert np.allclose(as_pose(form).matrix, pose.matrix, atol=1e-15)
            segment = SegmentTrajectory(form, form, 1.0)
            paths = [segment, align(segment, form), slider(form, 1.0, 1.0), zigzag(form, 1, 1.0, 1.0)]
            paths += [spiral(form, 1, 1.0, 1.0), walking(form, 1.0), running(form, 1.0)]
            paths += [hand_held(form, 1.0, "rotation", top_speed_m_s=0, top_rate_rad_s=0.1)]
            for path in paths:
                assert np.allclose(path.pose(0.0).matrix, pose.matrix, atol=1e-9)
            assert np.allclose(Views.at_rest([form]).rotations[0], pose.rotation, atol=1e-15)
            scene = Scene("empty", dict, start=form)
            assert np.allclose(start_pose(scene).matrix, pose.matrix, atol=1e-15)

    @pytest.mark.parametrize(
        ("form", "message"),
        [
            (np.eye(3), "a pose matrix must be finite, of shape (4, 4), with last row 0 0 0 1, got [[1.0, 0.0"),
            (np.diag([1, 1, -1, 1.0]), "got [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], which is mirrored"),
            (
                np.diag([2, 1, 1, 1.0]),
                "(orthonormal within 1e-06, right-handed), got [[2.0, 0.0, 0.0], [",
            ),
            (np.diag([2, 1, 1, 1.0]), "which is off by 3"),
            (np.full((4, 4), np.nan), "must be finite"),
            (np.eye(4)[:, [0, 1, 3, 2]], "last row 0 0 0 1"),
            (((0, 0, 0), (1, 0, 0)), "pose quaternion must have shape (4,), got (3,)"),
            (((1, 0, 0, 0), (0, 0, 0)), "pose position must have shape (3,), got (4,)"),
            (((0, 0, 0), (1, 1, 0, 0)), "pose quaternion must have norm 1 within 0.001, got norm 1.41421356"),
            (np.zeros(7), "of shape (4, 4)"),
            ("origin", "a pose matrix must be numbers, got 'origin'"),
            (None, "a pose matrix must be"),
        ],
    )
    def test_what_is_no_pose_is_refused_with_rule_and_value(self, form: Any, message: str) -> None:
        """By the argument that it was given as, and with what may be given."""
        with pytest.raises(ArgumentError, match=re.escape(message)) as refused:
            align(circle(), form)
        assert str(refused.value).startswith("pose must be a Pose, a 4 x 4 matrix T_world_camera, or (position, quat")
        with pytest.raises(ArgumentError, match=r"^end must be a Pose"):
            SegmentTrajectory(np.eye(4), form, 1.0)


class TestEveryTrajectory:
    """What holds for each kind, so that a sign, a frame or a time base gone wrong shows in all of them."""

    @EVERY
    def test_velocity_is_the_derivative_of_position(self, trajectory: Trajectory) -> None:
        """Central differences over 20 us."""
        h = 1e-5
        t = np.linspace(h, trajectory.duration_s - h, 301)
        differences = (trajectory.positions(t + h) - trajectory.positions(t - h)) / (2 * h)
        assert np.abs(differences - trajectory.velocities(t)).max() < 1e-6

    @EVERY
    def test_angular_rate_is_the_body_rate_of_the_rotation(self, trajectory: Trajectory) -> None:
        """log(R(t-h)^T R(t+h)) / 2h, R^T on the left for camera axes: world axes or a sign would miss by 1 rad/s."""
        h = 1e-5
        t = np.linspace(h, trajectory.duration_s - h, 301)
        before, after = (Rotation.from_matrix(trajectory.rotations(t + s)) for s in (-h, h))
        differences = (before.inv() * after).as_rotvec() / (2 * h)
        assert np.abs(differences - trajectory.angular_rates(t)).max() < 1e-5

    @EVERY
    def test_quaternions_are_unit_and_continuous(self, trajectory: Trajectory) -> None:
        """No sign flips between neighbouring times."""
        q = trajectory.quaternions(np.linspace(0, trajectory.duration_s, 1000))
        assert np.abs(np.linalg.norm(q, axis=1) - 1).max() < 1e-12
        assert (q[1:] * q[:-1]).sum(1).min() > 0.99

    @EVERY
    def test_pose_is_the_row_of_the_arrays(self, trajectory: Trajectory) -> None:
        """pose() and the array methods are one path."""
        t = 0.37 * trajectory.duration_s
        pose = trajectory.pose(t)
        assert np.array_equal(pose.position, trajectory.positions([t])[0])
        assert np.allclose(pose.rotation, trajectory.rotations([t])[0], atol=1e-15)

    @EVERY
    def test_times_end_a_microsecond_beyond_the_ends(self, trajectory: Trajectory) -> None:
        """Rounding at the ends is forgiven and moved onto the end; what is further, or NaN, is an error."""
        end = trajectory.duration_s
        at_ends, beyond = trajectory.positions([0.0, end]), trajectory.positions([-0.9e-6, end + 0.9e-6])
        assert np.array_equal(at_ends, beyond)
        methods = (trajectory.positions, trajectory.quaternions, trajectory.velocities, trajectory.angular_rates)
        for method in methods:
            for bad in (-2e-6, end + 2e-6, np.nan):
                with pytest.raises(ValueError, match="outside the trajectory, which runs from 0 to"):
                    method([0.0, bad])
            with pytest.raises(ValueError, match=r"times must have shape \(n,\), got \(\)"):
                method(0.0)


class TestCallableTrajectory:
    def test_returns_what_the_functions_give(self) -> None:
        """Nothing is added to or differentiated from the exact functions."""
        t = np.array([0.0, 0.3, 2.0])
        assert np.array_equal(circle().positions(t)[:, 0], 0.2 * np.sin(2 * t))
        assert circle().describe() == {"kind": "analytic", "duration_s": 2.0, "scene": "circle"}

    def test_checks_what_the_functions_give(self) -> None:
        """A transposed result and a NaN are errors that name the function and the time."""
        bad = CallableTrajectory(
            1.0,
            position=lambda t: np.zeros((3, len(t))),
            quaternion=lambda t: np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)),
            velocity=lambda t: np.where(t[:, None] > 0.5, np.nan, np.zeros((len(t), 3))),
            angular_rate=lambda t: np.zeros((len(t), 3)),
            description={},
        )
        with pytest.raises(ValueError, match=r"position\(t_s\) must return shape \(2, 3\), got \(3, 2\)"):
            bad.positions([0.0, 1.0])
        with pytest.raises(ValueError, match=r"velocity\(t_s\) must be finite.* at 0.75 s"):
            bad.velocities([0.0, 0.75])


class TestSegmentTrajectory:
    @given(poses(), poses(), st.floats(1e-3, 100))
    def test_starts_and_ends_at_the_poses_at_constant_rates(self, start: Pose, end: Pose, duration_s: float) -> None:
        """Both ends are met whatever the quaternions' signs, at a constant rate of at most half a turn in all."""
        trajectory = SegmentTrajectory(start, end, duration_s)
        for pose, t in ((start, 0.0), (end, duration_s)):
            assert np.allclose(trajectory.pose(t).matrix, pose.matrix, atol=1e-12)
        rates = trajectory.angular_rates(np.linspace(0, duration_s, 5))
        assert np.ptp(rates, axis=0).max() == 0.0
        assert np.linalg.norm(rates[0]) * duration_s <= np.pi + 1e-12

    def test_takes_the_shorter_way(self) -> None:
        """Of two quaternions with opposite signs the angle between them counts: 0.2 rad here, not 2 pi - 0.2."""
        end = -Rotation.from_rotvec([0.0, 0.2, 0.0]).as_quat()
        trajectory = SegmentTrajectory(Pose(np.zeros(3), [0.0, 0, 0, 1]), Pose(np.zeros(3), end), 0.1)
        assert np.allclose(trajectory.angular_rates([0.05]), [[0.0, 2.0, 0.0]], atol=1e-12)

    def test_standing_still(self) -> None:
        """Equal poses give zero rates, not 0 / 0."""
        pose = Pose([1.0, 2.0, 3.0], SKEW)
        trajectory = SegmentTrajectory(pose, pose, 1.0)
        assert np.array_equal(trajectory.velocities([0.5]), np.zeros((1, 3)))
        assert np.allclose(trajectory.angular_rates([0.5]), 0.0, atol=1e-15)
        assert np.allclose(trajectory.quaternions([0.5])[0], pose.quaternion, atol=1e-15)

    @pytest.mark.parametrize("duration_s", [0.0, -1.0, np.nan, np.inf])
    def test_refuses_a_duration_that_is_not_positive(self, duration_s: float) -> None:
        """A zero duration would be an infinite speed."""
        pose = Pose(np.zeros(3), SKEW)
        with pytest.raises(ValueError, match="duration_s must be finite and > 0"):
            SegmentTrajectory(pose, pose, duration_s)


class TestSampledTrajectory:
    def test_interpolation_meets_the_samples_and_the_path_between(self) -> None:
        """Sigma 0 goes through every sample, and between them is quintic: 1 nm, 1 urad and 0.1 mm/s^2 off at 200 Hz."""
        trajectory = sampled()
        t = np.arange(601) / 200.0
        assert np.abs(trajectory.positions(t) - tumbling(t)[0]).max() < 1e-12
        between = t[20:-20] + 0.0025
        position, q = tumbling(between)
        assert np.abs(trajectory.positions(between) - position).max() < 1e-9
        acceleration = -9 * 0.5 * np.sin(3 * between)
        assert np.abs(trajectory.accelerations(between)[:, 0] - acceleration).max() < 1e-5
        turned = Rotation.from_matrix(trajectory.rotations(between)).inv() * Rotation.from_quat(q)
        assert turned.magnitude().max() < 1e-6

    def test_rms_residual_is_sigma(self) -> None:
        """The discrepancy principle, per coordinate and per axis, with jittered stamps and more noise than sigma."""
        rng = np.random.default_rng(1)
        t = np.arange(2000) / 200.0 + rng.uniform(-5e-4, 5e-4, 2000)
        position, q = tumbling(t)
        position = position + rng.normal(0, 1e-3, position.shape)
        q = (Rotation.from_quat(q) * Rotation.from_rotvec(rng.normal(0, 4e-3, (2000, 3)))).as_quat()
        trajectory = SampledTrajectory(t, position, q, position_sigma_m=8e-4, rotation_sigma_rad=3e-3)
        at = t - t[0]
        residual = trajectory.positions(at) - position
        assert np.sqrt((residual**2).mean()) == pytest.approx(8e-4, rel=1e-3)
        turned = (Rotation.from_matrix(trajectory.rotations(at)).inv() * Rotation.from_quat(q)).as_rotvec()
        assert np.sqrt((turned**2).mean()) == pytest.approx(3e-3, rel=1e-2)

    def test_smoothing_recovers_a_noisy_path(self) -> None:
        """With the noise's sigma, poses are 2, velocities 20, accelerations 200 times closer than interpolated."""
        rng = np.random.default_rng(2)
        t = np.arange(1001) / 200.0
        position, q = tumbling(t)
        noisy_q = (Rotation.from_quat(q) * Rotation.from_rotvec(rng.normal(0, 4e-3, (1001, 3)))).as_quat()
        samples = (t, position + rng.normal(0, 1e-3, position.shape), noisy_q)
        smooth = SampledTrajectory(*samples, position_sigma_m=1e-3, rotation_sigma_rad=4e-3)
        rough, exact = SampledTrajectory(*samples), SampledTrajectory(t, position, q)
        at = np.linspace(0.1, 4.9, 5000)

        def gain(method: str) -> float:
            truth = getattr(exact, method)(at)
            errors = [np.sqrt(((getattr(x, method)(at) - truth) ** 2).mean()) for x in (rough, smooth)]
            return float(errors[0] / errors[1])

        assert gain("positions") > 2
        assert gain("rotations") > 2
        assert gain("velocities") > 20
        assert gain("angular_rates") > 20
        assert gain("accelerations") > 200

    def test_samples_smoother_than_sigma_keep_the_smoothest_fit(self) -> None:
        """A parabola at a constant attitude stays what it is at any sigma, though no weight can reach the sigma."""
        t = np.arange(400) / 200.0
        parabola = 7.0 + t[:, None] * [1.0, -2.0, 0.5] - t[:, None] ** 2 * [0.0, 0.0, 4.905]
        still = np.tile(SKEW, (400, 1))
        trajectory = SampledTrajectory(t, parabola, still, position_sigma_m=0.01, rotation_sigma_rad=0.1)
        assert np.abs(trajectory.positions(t) - parabola).max() < 1e-5
        assert np.abs(trajectory.accelerations(t) - [0.0, 0.0, -9.81]).max() < 1e-3
        assert np.abs(trajectory.angular_rates(t)).max() < 1e-6

    @pytest.mark.parametrize("kind", ["sampled", "smoothed"])
    def test_accelerations_are_continuous(self, kind: str) -> None:
        """Velocity and angular rate have no kink at the knots: second differences shrink with their step there too."""
        trajectory = ALL[kind]
        assert isinstance(trajectory, SampledTrajectory)
        knots = np.arange(4, 597) / 200.0
        h = 1e-6
        for method in (trajectory.velocities, trajectory.angular_rates):
            left = (method(knots) - method(knots - h)) / h
            right = (method(knots + h) - method(knots)) / h
            assert np.abs(left - right).max() < 1e-2  # a kink would show as a jump of the order of 1
            if method == trajectory.velocities:
                assert np.abs((left + right) / 2 - trajectory.accelerations(knots)).max() < 1e-6

    @given(st.integers(0, 2**32 - 1))
    def test_the_sign_of_a_sample_does_not_matter(self, seed: int) -> None:
        """q and -q are one rotation: flipping any samples leaves the trajectory, up to its overall sign."""
        t = np.arange(40) / 200.0
        position, q = tumbling(t)
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], (40, 1))
        flipped = SampledTrajectory(t, position, q * signs)
        at = np.linspace(0, t[-1], 100)
        plain = SampledTrajectory(t, position, q)
        assert np.allclose(flipped.rotations(at), plain.rotations(at), atol=1e-12)
        assert np.allclose(flipped.angular_rates(at), plain.angular_rates(at), atol=1e-9)

    @pytest.mark.parametrize("n", [2, 3, 4, 5, 6, 7])
    def test_few_samples(self, n: int) -> None:
        """From two samples on every number of them is met, with or without a sigma; two give a constant velocity."""
        t = np.linspace(0, 0.1 * (n - 1), n)
        position, q = tumbling(t)
        trajectory = SampledTrajectory(t, position, q)
        assert np.abs(trajectory.positions(t) - position).max() < 1e-12
        assert np.abs(np.abs((trajectory.quaternions(t) * q).sum(1)) - 1).max() < 1e-12
        smooth = SampledTrajectory(t, position, q, position_sigma_m=1e-4, rotation_sigma_rad=1e-4)
        assert np.sqrt(((smooth.positions(t) - position) ** 2).mean()) < 1.01e-4
        if n == 2:
            assert np.allclose(trajectory.velocities([0.02, 0.07]), (position[1] - position[0]) / 0.1)
            assert np.abs(trajectory.accelerations([0.02])).max() == 0

    def test_any_start_becomes_zero(self) -> None:
        """The first sample is t = 0, wherever the stamps begin."""
        t = np.arange(20) / 100.0
        late = SampledTrajectory(t + 1000.0, *tumbling(t))
        assert late.duration_s == pytest.approx(0.19, abs=1e-12)
        assert np.array_equal(late.positions([0.0])[0], tumbling(t)[0][0])

    def test_gap_rules(self) -> None:
        """Two normal spacings are no gap, four are bridged with one warning, more than max_gap_s is refused."""
        t = np.arange(300) / 200.0

        def without(*missing: slice, max_gap_s: float = 0.1) -> SampledTrajectory:
            keep = np.ones(len(t), bool)
            for part in missing:
                keep[part] = False
            return SampledTrajectory(t[keep], *tumbling(t[keep]), max_gap_s=max_gap_s)

        with warnings.catch_warnings():
            warnings.simplefilter("error")
            without(slice(50, 51))
        with pytest.warns(UserWarning, match=r"bridged 2 gap.* at sample 197 at 1\.09\d* s: 0\.095 s after") as caught:
            bridged = without(slice(100, 103), slice(200, 218))
        assert len(caught) == 1
        assert np.abs(bridged.positions(t) - tumbling(t)[0]).max() < 1e-3
        with pytest.raises(
            ValueError, match=r"sample 200 at 1\.1\d* s: 0\.105 s after .* longer than max_gap_s = 0\.1 s"
        ):
            without(slice(200, 220))
        with pytest.warns(UserWarning, match="bridged 1 gap"):
            without(slice(200, 220), max_gap_s=0.2)

    def test_a_slow_rate_is_no_gap(self) -> None:
        """The normal spacing is the file's own: key poses a second apart are accepted."""
        t = np.linspace(0, 9, 10)
        assert SampledTrajectory(t, *tumbling(t / 10)).duration_s == 9.0

    @pytest.mark.parametrize(
        ("index", "column", "value", "message"),
        [
            (5, 0, 0.04, r"sample 5 at 0\.04 s: times must strictly increase.*sample 4 at 0\.04"),
            (5, 0, np.nan, "sample 5 at nan s: every number must be finite"),
            (7, 2, np.inf, r"sample 7 at 0\.07\d* s: every number must be finite"),
            (9, 7, 2.0, r"sample 9 at 0\.09 s: the quaternion must have norm 1 within 0\.001, got .* of norm 2\.\d+"),
        ],
    )
    def test_a_bad_sample_is_named(self, index: int, column: int, value: float, message: str) -> None:
        """Each rule of a sample names its index and time, and the value."""
        t = np.arange(20) / 100.0
        table = np.column_stack([t, *tumbling(t)])
        table[index, column] = value
        with pytest.raises(ValueError, match=message):
            SampledTrajectory(table[:, 0], table[:, 1:4], table[:, 4:])

    def test_refuses_rotations_too_large_to_follow(self) -> None:
        """Between samples more than 90 degrees apart the path is refused, not guessed; a quaternion's sign is free."""
        t, origin = np.arange(12) * 0.1, np.zeros((12, 3))

        def steps_of(degrees: float) -> FloatArray:
            half = np.radians(np.array([0.0] * 8 + [degrees] * 4)) / 2
            return np.stack([0 * half, 0 * half, -np.sin(half), -np.cos(half)], -1) * ([[1.0], [-1.0]] * 6)

        assert SampledTrajectory(t, origin, steps_of(89.9)).duration_s == pytest.approx(1.1)
        with pytest.raises(
            ValueError, match=r"sample 8 at 0\.8\d* s: .* at most 90 degrees .* got 91\.0 since sample 7"
        ):
            SampledTrajectory(t, origin, steps_of(91.0))

    def test_refuses_bad_arguments(self) -> None:
        """Shapes, the least number of samples, sigmas and max_gap_s are checked."""
        t = np.arange(20) / 100.0
        position, q = tumbling(t)
        with pytest.raises(ValueError, match=r"shapes \(n,\), \(n, 3\) and \(n, 4\), got \(20,\), \(20, 4\)"):
            SampledTrajectory(t, q, q)
        with pytest.raises(ValueError, match="at least 2 samples, got 1"):
            SampledTrajectory(t[:1], position[:1], q[:1])
        with pytest.raises(ValueError, match="position_sigma_m must be finite and >= 0, got -1"):
            SampledTrajectory(t, position, q, position_sigma_m=-1)
        with pytest.raises(ValueError, match="rotation_sigma_rad must be finite and >= 0, got nan"):
            SampledTrajectory(t, position, q, rotation_sigma_rad=np.nan)
        with pytest.raises(ValueError, match="max_gap_s must be finite and > 0, got 0"):
            SampledTrajectory(t, position, q, max_gap_s=0)


class TestAlign:
    @given(poses(), st.floats(0, 3.0))
    def test_has_the_pose_and_keeps_the_relative_motion(self, pose: Pose, at_s: float) -> None:
        """T_new(at) is the pose, and T_new(at)^-1 T_new(t) is what it was: a transposed rotation would break either."""
        before = ALL["sampled"]
        after = align(before, pose, at_s)
        assert np.allclose(after.pose(at_s).matrix, pose.matrix, atol=1e-9)
        for t in (0.0, 1.1, 3.0):
            was = np.linalg.inv(before.pose(at_s).matrix) @ before.pose(t).matrix
            assert np.allclose(np.linalg.inv(after.pose(at_s).matrix) @ after.pose(t).matrix, was, atol=1e-9)

    @given(poses())
    def test_aligning_back_is_the_identity(self, pose: Pose) -> None:
        """Moved away and back, every pose is where it was."""
        before = ALL["callable"]
        back = align(align(before, pose, 0.5), before.pose(0.0))
        t = np.linspace(0, 2.0, 7)
        assert np.allclose(back.positions(t), before.positions(t), atol=1e-9)
        assert np.allclose(back.rotations(t), before.rotations(t), atol=1e-9)

    def test_refuses_a_time_outside(self) -> None:
        """The error gives the range."""
        with pytest.raises(ValueError, match=r"time 3\.1 s is outside the trajectory, which runs from 0 to 3\.0 s"):
            align(sampled(), Pose(np.zeros(3), SKEW), 3.1)


class TestInterval:
    def test_an_end_rounded_up_is_the_end(self) -> None:
        """A duration that overshoots by less than a microsecond is cut, and can be evaluated to its end."""
        part = sampled().crop(0.7, 2.3 + 0.9e-6)
        assert part.duration_s == pytest.approx(2.3, abs=1e-12)
        assert np.allclose(part.positions([2.3 + 0.9e-6]), sampled().positions([3.0]), atol=1e-12)

    def test_is_the_same_path_from_zero(self) -> None:
        """Pose, velocity and body rate at t are those of the whole at start + t; the default runs to the end."""
        whole = sampled()
        part = whole.crop(0.7)
        assert part.duration_s == pytest.approx(2.3)
        t = np.linspace(0, part.duration_s, 9)
        for method in ("positions", "quaternions", "velocities", "angular_rates"):
            assert np.allclose(getattr(part, method)(t), getattr(whole, method)(np.minimum(t + 0.7, 3.0)), atol=1e-12)

    def test_zero_is_told_on_the_clock_of_the_samples(self) -> None:
        t = np.arange(40) / 200
        late = SampledTrajectory(t + 1000.25, *tumbling(t))
        assert late.duration_s == pytest.approx(0.195)
        assert late.start_time_ns == 1_000_250_000_000
        assert late.crop(0.1).crop(0.05).start_time_ns == 1_000_400_000_000
        assert sampled().start_time_ns == segment().start_time_ns == 0

    @pytest.mark.parametrize(
        ("start_s", "duration_s", "message"),
        [
            (-0.1, 1.0, "start_s must be finite and >= 0, got -0.1"),
            (2.0, 1.1, "duration_s must be at most 1 s from start_s 2 s on, .* runs from 0 to 3 s; got 1.1"),
            (3.0, None, "start_s must lie within the trajectory, which runs from 0 to 3 s, got 3.0"),
            (1.0, 0.0, "duration_s must be finite and > 0, got 0.0"),
            (1.0, np.nan, "duration_s must be finite and > 0, got nan"),
            (1.0, "1", "duration_s must be a number, got '1'"),
        ],
    )
    def test_refuses_what_is_not_inside(self, start_s: float, duration_s: Any, message: str) -> None:
        """The message holds what is available."""
        with pytest.raises(ValueError, match=message):
            sampled().crop(start_s, duration_s)

    def test_description_tells_the_whole_chain(self) -> None:
        """meta.json can say which part of which file was moved where."""
        pose = Pose(np.zeros(3), [0.0, 0.0, 0.0, 1.0])
        described = align(circle(), pose, 0.25).crop(0.5, 1.0).describe()
        assert described == {
            "kind": "crop",
            "start_s": 0.5,
            "duration_s": 1.0,
            "trajectory": {
                "kind": "aligned",
                "duration_s": 2.0,
                "at_s": 0.25,
                "pose": {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
                "trajectory": {"kind": "analytic", "duration_s": 2.0, "scene": "circle"},
            },
        }


@EVERY
def test_second_derivatives_are_those_of_the_first(trajectory: Trajectory) -> None:
    """Accelerations in world axes and angular accelerations in body axes agree with differences, also at the ends."""
    h = 1e-5
    t = np.linspace(h, trajectory.duration_s - h, 40)
    for second, first in (
        (trajectory.accelerations, trajectory.velocities),
        (trajectory.angular_accelerations, trajectory.angular_rates),
    ):
        differences = (first(t + h) - first(t - h)) / (2 * h)
        assert np.allclose(second(t), differences, atol=1e-5 * max(1.0, np.abs(differences).max()))


def test_functions_may_bring_their_second_derivatives() -> None:
    """Given, they are taken as they are; else differences of the first are good to 1e-6, at the ends too."""

    def build(**second: object) -> CallableTrajectory:
        return CallableTrajectory(
            2.0,
            position=lambda t: np.outer(np.sin(3 * t), [1, 0, 0]),
            velocity=lambda t: np.outer(3 * np.cos(3 * t), [1, 0, 0]),
            quaternion=lambda t: np.tile([0, 0, 0, 1.0], (len(t), 1)),
            angular_rate=lambda t: np.zeros((len(t), 3)),
            description={},
            **second,  # type: ignore[arg-type]
        )

    t = np.linspace(0, 2, 21)
    exact = np.outer(-9 * np.sin(3 * t), [1, 0, 0])
    assert np.allclose(build().accelerations(t), exact, atol=1e-6)
    given_ones = build(
        acceleration=lambda t: np.full((len(t), 3), 7.0), angular_acceleration=lambda t: np.ones((len(t), 3))
    )
    assert (given_ones.accelerations(t) == 7).all()
    assert (given_ones.angular_accelerations(t) == 1).all()


def test_top_speeds_are_means_over_a_window() -> None:
    """On a circle the mean over w is the chord's, (2 r / w) sin(omega w / 2); a window of 0 is the momentary speed."""
    path = circle()
    assert path.top_speeds(0).speed_m_s == pytest.approx(0.4, rel=1e-12)
    assert path.top_speeds(0.1).speed_m_s == pytest.approx(2 * 0.2 / 0.1 * np.sin(0.1), rel=1e-9)
    assert path.top_speeds(0.1).rate_rad_s == pytest.approx(0.5, rel=1e-9)
    assert path.top_speeds(100.0).rate_rad_s == pytest.approx(0.5, rel=1e-9)
    moment = sampled().top_speeds(0)
    assert np.linalg.norm(sampled().velocities([moment.speed_at_s])) == pytest.approx(moment.speed_m_s, rel=1e-9)
    with pytest.raises(ValueError, match="window_s must be finite and >= 0, got -1"):
        path.top_speeds(-1)


def test_check_names_what_is_too_fast() -> None:
    """Within the limits the tops come back; above, the error has the value, the limit and the time."""
    path = circle()
    assert path.check(0.41, 0.51) == path.top_speeds()
    with pytest.raises(ValueError, match=r"speed must be at most 0\.3 m/s, got 0\.39\d+ m/s over 100 ms at"):
        path.check(max_speed_m_s=0.3)
    with pytest.raises(ValueError, match=r"angular rate must be at most 0\.4 rad/s, got 0\.5 rad/s momentarily at"):
        path.check(max_rate_rad_s=0.4, window_s=0)
