"""Holds poses and motion of the camera at several instants, for which a renderer is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..._util.few_numbers import all_finite
from ..pose import FloatArray, PoseLike, as_pose, rotation_matrices
from .trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Views:
    """Holds a camera's pose and motion at n instants, each array float64.

    Attributes:
        t_s: (n,) seconds of the sequence, by which objects and lights of a scene change.
        positions: (n, 3) camera centres in the world, metres.
        rotations: (n, 3, 3) R_world_camera.
        velocities: (n, 3) world axes, m/s.
        angular_rates: (n, 3) body (camera) axes, rad/s.

    Raises:
        ValueError: for an array of another shape, or a value that is not finite.
    """

    t_s: FloatArray
    positions: FloatArray
    rotations: FloatArray
    velocities: FloatArray
    angular_rates: FloatArray

    def __post_init__(self) -> None:
        n = np.size(self.t_s)
        shapes = {"t_s": (n,), "rotations": (n, 3, 3)}
        for name in ("t_s", "positions", "rotations", "velocities", "angular_rates"):
            array, shape = np.asarray(getattr(self, name), np.float64), shapes.get(name, (n, 3))
            if array.shape != shape:
                raise ValueError(f"{name} of {n} views must have shape {shape}, got {array.shape}")
            if not all_finite(array):
                raise ValueError(f"{name} of views must be finite, got {array[~np.isfinite(array)][0]}")
            object.__setattr__(self, name, array)

    @classmethod
    def along(cls, trajectory: Trajectory, t_s: npt.ArrayLike, *, start_s: float = 0.0) -> Views:
        """Make the views along a trajectory at its times ``t_s`` (n,); its time 0 is at ``start_s`` of the sequence.

        Raises:
            ValueError: as :meth:`Trajectory.times`.
        """
        t = trajectory.times(t_s)
        return cls(
            start_s + t,
            trajectory.positions(t),
            trajectory.rotations(t),
            trajectory.velocities(t),
            trajectory.angular_rates(t),
        )

    @classmethod
    def at_rest(cls, poses: Sequence[PoseLike], t_s: npt.ArrayLike = 0.0) -> Views:
        """Make views of cameras that do not move, all at time ``t_s``, or each at its own, (n,)."""
        checked = [as_pose(pose, "poses") for pose in poses]
        positions = np.array([pose.position for pose in checked]).reshape(-1, 3)
        quaternions = np.array([pose.quaternion for pose in checked]).reshape(-1, 4)
        still = np.zeros_like(positions)
        times = np.broadcast_to(np.asarray(t_s, np.float64), (len(poses),))
        return cls(times, positions, rotation_matrices(quaternions), still, still)

    def moved(self, t_s: npt.ArrayLike) -> Views:
        """Return the views, each its own time (n,) in seconds later, at constant velocity and body rate."""
        from scipy.spatial.transform import Rotation

        t = np.asarray(t_s, np.float64)
        turns = Rotation.from_rotvec(self.angular_rates * t[:, None]).as_matrix()
        positions = self.positions + self.velocities * t[:, None]
        return Views(self.t_s + t, positions, self.rotations @ turns, self.velocities, self.angular_rates)

    def scaled(self, factor: float) -> Views:
        """Return the same views in a world that is ``factor`` times as large, scaled about its origin."""
        return Views(self.t_s, factor * self.positions, self.rotations, factor * self.velocities, self.angular_rates)

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, index: slice | npt.NDArray[np.integer]) -> Views:
        """Return the views of a slice, or of an array of indices, in its order."""
        return Views(
            self.t_s[index],
            self.positions[index],
            self.rotations[index],
            self.velocities[index],
            self.angular_rates[index],
        )
