"""Calibrates hand-eye: where the camera sits on a body that is tracked from outside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera
from ...scene.builtin.checkerboard import Checkerboard
from .board_pose import BoardPose
from .levenberg_marquardt import levenberg_marquardt
from .opencv import load_opencv
from .reprojection import cross_matrix, inverse, moved, projection_jacobian, rotation_of, transform, vector_of

FloatArray = npt.NDArray[np.float64]

_LEAST_TURN_RAD = np.radians(2.0)
"""Root mean square of the turns about the second axis that a motion must have."""

_MOST_DISAGREEMENT_DEG = 3.0

_MOST_LINEAR_VIEWS = 40
"""The linear solution takes all pairs of at most this many views."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """What a hand-eye calibration found.

    Attributes:
        hand_camera: X = T_hand_camera, (4, 4), metres: where the camera is on the tracked body.
        world_board: Z = T_world_board, (4, 4): where the board is in the tracker's world.
        covariance: (12, 12) of small motions of X and of Z in their own axes, each a rotation vector (rad) and a
            translation (m). It is made of how the views scatter as wholes, because what is wrong with one pose of the
            tracker moves all the corners of its view; and of how neighbouring views err alike, because smoothed poses
            do.
        rms_px: root mean square distance of corners from where X and Z have them.
        views: number of views.
        linear: X of the linear solution alone.
        linear_rms_px: likewise, with Z from the first view.
    """

    hand_camera: FloatArray
    world_board: FloatArray
    covariance: FloatArray
    rms_px: float
    views: int
    linear: FloatArray
    linear_rms_px: float

    @property
    def rotation_deviations_rad(self) -> FloatArray:
        """Standard deviations of X's rotation about the camera's axes, (3,)."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def translation_deviations_m(self) -> FloatArray:
        """Standard deviations of X's translation along the camera's axes, (3,)."""
        return np.sqrt(np.diag(self.covariance)[3:6])


class HandEyePoses(NamedTuple):
    """The two unknowns, X = T_hand_camera and Z = T_world_board, (4, 4) each."""

    x: FloatArray
    z: FloatArray

    def moved(self, step: FloatArray) -> HandEyePoses:
        """Return the poses after small motions (12,): rotation vector and translation of X, then of Z, in their own
        axes."""
        return HandEyePoses(moved(self.x, step[:6]), moved(self.z, step[6:]))


def calibrate_hand_eye(
    hand_poses: FloatArray, camera_poses: Sequence[BoardPose], board: Checkerboard, camera: Camera
) -> HandEye:
    """Find X and Z of A' X = Z B', where A' = T_world_hand and B' = T_board_camera at the same instants.

    First Tsai's linear solution of A X = X B from relative poses A and B; then Z = A'_1 X B'_1^-1; then both together,
    so that the corners' reprojection error is least (Levenberg-Marquardt with analytic derivatives).

    Args:
        hand_poses: A', (n, 4, 4), one for each of ``camera_poses``.

    Raises:
        ValueError: for fewer than three views, motion that leaves X open (pure translation, or rotation about one axis
            alone), or hand and camera that do not turn alike.
        ImportError: without OpenCV 4.

    Source: Tsai and Lenz, IEEE Trans. Robotics and Automation 1989; Mueggler et al., IJRR 2017, section 5.
    """
    if len(hand_poses) != len(camera_poses):
        raise ValueError(f"each view needs one pose of the hand, got {len(hand_poses)} for {len(camera_poses)} views")
    b = np.stack([pose.matrix for pose in camera_poses]) if camera_poses else np.empty((0, 4, 4))
    check_motion(hand_poses)
    in_time = np.argsort([pose.view.t_us for pose in camera_poses], kind="stable")
    hand_poses, camera_poses = hand_poses[in_time], [camera_poses[k] for k in in_time]
    b = b[in_time]
    _check_agreement(hand_poses, b)
    x = linear_hand_eye(hand_poses, b)
    start = HandEyePoses(x, hand_poses[0] @ x @ inverse(b[0]))
    corners = np.stack([pose.view.corners for pose in camera_poses])
    problem = Reprojection(hand_poses, corners, board, camera)
    if not np.isfinite(problem.residuals(start)).all():
        raise ValueError(
            "the linear solution puts the board behind the camera: are these poses of the body that carries it, at the "
            "same times?"
        )
    refined = levenberg_marquardt(start, problem.residuals, problem.jacobian, HandEyePoses.moved)
    return HandEye(
        hand_camera=refined.x,
        world_board=refined.z,
        covariance=problem.covariance(refined),
        rms_px=problem.rms_px(refined),
        views=len(camera_poses),
        linear=x,
        linear_rms_px=problem.rms_px(start),
    )


def check_motion(poses: FloatArray) -> None:
    """Refuse motion (n, 4, 4) from which no hand-eye transform follows.

    Turns about two axes are needed: translation along a single rotation axis, or of a body that does not turn at all,
    looks the same wherever the camera sits.

    Raises:
        ValueError: saying what is missing.
    """
    if len(poses) < 3:
        raise ValueError(f"hand-eye calibration needs at least 3 views of the board with a pose, got {len(poses)}")
    # About the mean orientation, so that it does not matter which pose is the first.
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(poses[:, :3, :3])
    vectors = (turns.mean().inv() * turns).as_rotvec()
    first, second, _ = np.linalg.svd(vectors - vectors.mean(0), compute_uv=False) / np.sqrt(len(poses))
    least = np.degrees(_LEAST_TURN_RAD)
    if first < _LEAST_TURN_RAD:
        raise ValueError(
            f"the motion is degenerate: pure translation (the body turns by {np.degrees(first):.2g} degrees rms about "
            f"any axis, at least {least:g} about two are needed), so that the camera could sit anywhere on it"
        )
    if second < _LEAST_TURN_RAD:
        raise ValueError(
            f"the motion is degenerate: rotation about one axis alone ({np.degrees(first):.2g} degrees rms, but "
            f"{np.degrees(second):.2g} about a second one, where at least {least:g} are needed), so that the camera "
            "could sit anywhere along it"
        )


def _check_agreement(hand_poses: FloatArray, camera_poses: FloatArray) -> None:
    """Hand and camera turn by the same angle from one view to another, however they sit on each other."""
    later = len(hand_poses) // 2
    hand, camera = (
        np.linalg.norm(vector_of(np.swapaxes(poses[:-later, :3, :3], 1, 2) @ poses[later:, :3, :3]), axis=1)
        for poses in (hand_poses, camera_poses)
    )
    off = np.degrees(np.sqrt(np.mean((hand - camera) ** 2)))
    if off > _MOST_DISAGREEMENT_DEG:
        raise ValueError(
            f"the body and the camera do not turn alike (by angles that differ by {off:.2g} degrees rms, more than "
            f"{_MOST_DISAGREEMENT_DEG:g}): are these poses of the body that carries the camera, on its clock?"
        )


def linear_hand_eye(hand_poses: FloatArray, camera_poses: FloatArray) -> FloatArray:
    """Return Tsai's solution X, (4, 4), of A X = X B for all pairs of poses A' and B', (n, 4, 4) each.

    It breaks down where X is half a turn; so it is solved for four orientations of the camera's axes, of which at least
    one is far from that, and the one that fits best is taken.

    Raises:
        ImportError: without OpenCV 4.
    """
    cv2 = load_opencv()
    chosen = np.unique(np.linspace(0, len(hand_poses) - 1, _MOST_LINEAR_VIEWS).round().astype(int))
    a, b = hand_poses[chosen], inverse(camera_poses[chosen])
    candidates = []
    for half_turn in np.concatenate([np.zeros((1, 3)), np.pi * np.eye(3)]):
        turned = transform(rotation_of(half_turn), np.zeros(3))
        from_board = turned @ b
        rotation, translation = cv2.calibrateHandEye(
            list(a[:, :3, :3]),
            list(a[:, :3, 3]),
            list(from_board[:, :3, :3]),
            list(from_board[:, :3, 3]),
            method=cv2.CALIB_HAND_EYE_TSAI,
        )
        if np.isfinite(rotation).all() and np.isfinite(translation).all():
            candidates.append(transform(rotation, translation.ravel()) @ turned)
    if not candidates:
        raise ValueError("Tsai's equations have no solution for this motion")
    return min(candidates, key=lambda x: _disagreement(a, x, inverse(b)))


def _disagreement(a: FloatArray, x: FloatArray, b: FloatArray) -> float:
    """Return how far A' X B'^-1 = Z is from being one rotation."""
    z = (a @ x @ inverse(b))[:, :3, :3]
    return float(np.linalg.norm(vector_of(z[0].T @ z), axis=1).sum())


def covariance_of_sum(terms: FloatArray) -> FloatArray:
    """Return the covariance (p, p) of the sum of a series of p-vectors (n, p) of mean 0 that may depend on their
    neighbours.

    Products of terms up to some distance in the series are added, with weights that fall to 0 there (Bartlett's). The
    distance follows from how much a term resembles the next one; it is 0 where that is no more than chance would give.

    Source: Newey and West, Econometrica 1987; the distance by Andrews, Econometrica 1991, equations 6.2 and 6.4.
    """
    n = len(terms)
    squares = (terms**2).sum(0)
    likeness = np.clip((terms[1:] * terms[:-1]).sum(0) / squares, -0.97, 0.97)
    likeness[np.abs(likeness) < 2 / np.sqrt(n)] = 0.0
    spread = (4 * likeness**2 / ((1 - likeness) ** 6 * (1 + likeness) ** 2)).sum() / ((1 - likeness) ** -4.0).sum()
    reach = 1.1447 * np.cbrt(spread * n)
    total = terms.T @ terms
    for distance in range(1, min(math.ceil(reach), n)):
        products = terms[distance:].T @ terms[:-distance]
        total += (1 - distance / reach) * (products + products.T)
    return np.asarray(total)


class Reprojection:
    """The reprojection errors of the board's corners as a function of X and Z.

    Args:
        hand_poses: A', (n, 4, 4), in the order of time.
        corners: (n, m, 2) pixels.
    """

    def __init__(self, hand_poses: FloatArray, corners: FloatArray, board: Checkerboard, camera: Camera) -> None:
        self._hand_world, self._corners = inverse(hand_poses), corners
        self._board, self._camera = board, camera

    def residuals(self, poses: HandEyePoses) -> FloatArray:
        """Return the residuals (n * m * 2,) in pixels; NaN for a corner behind the camera."""
        return (self._camera.project(self._points(poses)) - self._corners).ravel()

    def jacobian(self, poses: HandEyePoses) -> FloatArray:
        """Return d(residuals)/d(step), (n * m * 2, 12), for :meth:`HandEyePoses.moved`."""
        points = self._points(poses)
        by_point = projection_jacobian(self._camera, points)
        # A motion of X moves the points against it, one of Z carries the board along.
        board = self._board.corners
        turn = self._from_board(poses)[:, None, :3, :3]
        by_z = np.concatenate([-turn @ cross_matrix(board), np.broadcast_to(turn, (*points.shape, 3))], -1)
        by_x = np.concatenate([cross_matrix(points), np.broadcast_to(-np.eye(3), (*points.shape, 3))], -1)
        return np.asarray(by_point @ np.concatenate([by_x, by_z], -1)).reshape(-1, 12)

    def rms_px(self, poses: HandEyePoses) -> float:
        """Return root mean square distance of the corners, pixels."""
        return float(np.sqrt(np.square(self.residuals(poses)).reshape(-1, 2).sum(1).mean()))

    def covariance(self, poses: HandEyePoses) -> FloatArray:
        """Return it (12, 12), from how the views' gradients scatter, each view with its neighbours in time.

        Source: Newey and West, Econometrica 1987, with the bandwidth of Andrews, Econometrica 1991.
        """
        derivative, residuals = self.jacobian(poses), self.residuals(poses)
        n = len(self._corners)
        inverse_normal = np.linalg.inv(derivative.T @ derivative)
        gradients = np.einsum("nij,ni->nj", derivative.reshape(n, -1, 12), residuals.reshape(n, -1))
        # Each view's gradient has as many degrees of freedom as a pose; X and Z use up two poses of n.
        correction = n / max(n - 2, 1)
        return correction * covariance_of_sum(gradients @ inverse_normal)

    def _from_board(self, poses: HandEyePoses) -> FloatArray:
        return np.asarray(inverse(poses.x) @ self._hand_world @ poses.z)

    def _points(self, poses: HandEyePoses) -> FloatArray:
        """Return the corners in camera axes, (n, m, 3)."""
        to_camera = self._from_board(poses)
        return np.asarray(self._board.corners @ np.swapaxes(to_camera[:, :3, :3], 1, 2) + to_camera[:, None, :3, 3])
