"""Writes poses: the public dataset's ``groundtruth.txt``, and TUM's format."""

from __future__ import annotations

from pathlib import Path

from ..._util.argument_checks import check_type
from ..._util.close_names import names_checked
from ...geometry.pose import GroundTruth, Pose
from ...geometry.trajectory.trajectory import Trajectory
from ...sensor.motion_capture import MotionCapture
from .files import pose_line, write_file

_TUM_HEADER = "# timestamp tx ty tz qx qy qz qw\n"


@names_checked
def write_trajectory(
    trajectory: Trajectory | GroundTruth, path: str | Path, *, rate_hz: float = 200.0, tum: bool = False
) -> int:
    """Write a trajectory, or poses as they are stamped, as text; returns how many poses were written.

    Both formats have ``timestamp px py pz qx qy qz qw`` a line, seconds with nine decimals; TUM's begins with a comment
    that names them. Numbers are written exactly, so that :func:`~davis_rs.read_trajectory` gets them back bit by bit.

    Args:
        trajectory: is sampled at round(k 1e6 / ``rate_hz``) us, from 0 to its end; poses are not.
        path: the file, replaced if it exists.
        rate_hz: above 0, up to 1e6 Hz.
        tum: TUM's format, for evo and others.

    Raises:
        ValueError: for a rate out of range, or no poses.
        OSError: if the file cannot be written, naming it; none is left behind then.
    """
    check_type("trajectory", trajectory, (Trajectory, GroundTruth), "a scene's is scene.path")
    poses = MotionCapture(rate_hz).poses(trajectory) if isinstance(trajectory, Trajectory) else trajectory
    if not len(poses.t_us):
        raise ValueError("there are no poses to write")
    lines = [pose_line(int(t), Pose(p, q)) for t, p, q in zip(*poses, strict=True)]
    write_file(Path(path), ((_TUM_HEADER if tum else "") + "".join(lines)).encode())
    return len(lines)
