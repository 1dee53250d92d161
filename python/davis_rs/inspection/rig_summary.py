"""Sums up and checks the folder of a rig: each camera as a dataset, and that all agree with the body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._core import DecodeError
from .._util.terminal_text import printable
from ..geometry.pose import GroundTruth, rotation_matrices
from ..geometry.trajectory.sampled_trajectory import SampledTrajectory
from ..io.dataset.files import GROUND_TRUTH, META
from ..io.dataset.rig_folder import RigDataset
from ..sensor.rig import RigCamera
from .check import CheckReport, check_dataset

_EXACT = 1e-6
"""How far an exact pose of a camera may be from where the body's pose puts it, in metres and radians."""

_SPREAD = 6.0
"""Of poses with noise, so many standard deviations."""


def rig_contents(dataset: RigDataset) -> str:
    """Return a few lines on a rig: its cameras, their places, baselines and clocks, and its IMUs.

    Raises:
        OSError, DecodeError: if its files cannot be read.
    """
    rig = dataset.rig
    lines = [f"{dataset.path}: rig {rig.name!r}, {len(rig.cameras)} cameras, {len(rig.imus)} IMUs"]
    for number, each in enumerate(rig.cameras):
        x, y, z = each.mount.position
        size = f"{each.camera.width} x {each.camera.height} px"
        baseline = np.linalg.norm(rig.relative_pose(0, number).position)
        apart = f", {baseline:.4g} m from cam0" if number else ""
        clock = each.clock
        told = (
            f", clock {1e3 * clock.offset_s:+.6g} ms {1e6 * clock.drift:+.6g} ppm"
            if clock.offset_s or clock.drift
            else ""
        )
        missing = "" if number in dataset.cameras else " (not simulated)"
        lines.append(f"cam{number}        {size} at ({x:.4g}, {y:.4g}, {z:.4g}) m{apart}{told}{missing}")
    for number, inertial in enumerate(rig.imus):
        lines.append(f"imu{number}        {inertial.imu.rate_hz:g} Hz, {len(dataset.imus[number]):,} samples")
    lines.append(f"body        {len(dataset.groundtruth.t_us):,} poses")
    return "\n".join(map(printable, lines))


@dataclass
class RigCheckReport:
    """Says what :func:`check_rig` found.

    Attributes:
        path: of the rig's folder.
        cameras: what was found in each camera's dataset, by its number.
        problems: of the rig as a whole.
    """

    path: Path
    cameras: dict[int, CheckReport] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Return whether no problem was found."""
        return not self.problems and all(report.ok for report in self.cameras.values())

    def __str__(self) -> str:
        problems = [f"problem: {problem}" for problem in self.problems]
        verdict = "the check of the rig holds" if self.ok else "the check of the rig fails"
        return "\n".join([*map(str, self.cameras.values()), *map(printable, problems), f"{self.path}: {verdict}"])


def check_rig(path: str | Path) -> RigCheckReport:
    """Check the folder of a rig: each camera as :func:`check_dataset`, and the cameras against the body.

    Each pose of a camera must lie where the body's path, interpolated between its poses, and the camera's mount put it,
    by both clocks.

    Raises:
        OSError: if there is no rig at ``path``.
    """
    dataset = RigDataset(path)
    report = RigCheckReport(dataset.path)
    try:
        cameras, rig, truth, meta = dataset.cameras, dataset.rig, dataset.groundtruth, dataset.meta
        if not meta.get("complete") and not meta.get("interrupted"):
            report.problems.append(f"The rig was never finished ({META} says so): its writer was killed or failed.")
        recorded = (meta.get("rig") or {}).get("cameras")
        missing = [number for number in recorded or [] if number not in cameras]
        if missing:
            report.problems.append(f"cam{missing[0]} is missing: {META} says that it was simulated.")
        _ = dataset.imus
    except (DecodeError, OSError) as error:
        report.problems.append(f"{error}.")
        return report
    for number, each in cameras.items():
        report.cameras[number] = check_dataset(each.path)
        try:
            poses = each.groundtruth
        except DecodeError:  # its own report says so
            continue
        capture = each.meta.get("motion_capture") or {}
        if "clock" not in capture:
            problems = _pose_problems(number, rig.cameras[number], truth, poses, capture.get("noise") or {})
            report.problems += problems
    return report


def _pose_problems(
    number: int, camera: RigCamera, truth: GroundTruth, poses: GroundTruth, noise: dict[str, float]
) -> Iterator[str]:
    """Compare a camera's poses with those that the body's give."""
    if len(truth.t_us) < 2 or not len(poses.t_us):
        return
    start_us = int(truth.t_us[0])
    path = SampledTrajectory(
        (truth.t_us - start_us) * 1e-6, truth.positions, truth.quaternions, position_sigma_m=0, rotation_sigma_rad=0
    )
    t_s = (poses.t_us * 1e-6 - camera.clock.offset_s) / camera.clock.pace - start_us * 1e-6
    inside = (t_s >= 0) & (t_s <= path.duration_s)
    if not inside.any():
        return
    t_s, t_us = t_s[inside], poses.t_us[inside]
    rotations = path.rotations(t_s)
    off_m = np.linalg.norm(poses.positions[inside] - path.positions(t_s) - rotations @ camera.mount.position, axis=1)
    turned = np.swapaxes(rotations @ camera.mount.rotation, 1, 2) @ rotation_matrices(poses.quaternions[inside])
    # The norm of the antisymmetric part is sqrt(2) times the sine of the angle.
    off_rad = np.linalg.norm(turned - np.swapaxes(turned, 1, 2), axis=(1, 2)) / np.sqrt(8)
    # Interpolation errs by the change of the rates over a period of the poses.
    period_s = float(np.diff(truth.t_us).max()) * 1e-6
    bends = (path.accelerations(t_s), path.angular_accelerations(t_s))
    bend_m, bend_rad = (float(np.linalg.norm(bend, axis=1).max()) * period_s**2 for bend in bends)
    sigma_rad = 2 * _SPREAD * float(noise.get("rotation_rad", 0.0))
    arm_m = float(np.linalg.norm(camera.mount.position))
    allowed_m = _EXACT + bend_m + 2 * _SPREAD * float(noise.get("position_m", 0.0)) + arm_m * (sigma_rad + bend_rad)
    for off, allowed, unit in ((off_m, allowed_m, "m"), (off_rad, _EXACT + bend_rad + sigma_rad, "rad")):
        if off.max() > allowed:
            at = int(off.argmax())
            yield (
                f"The pose of cam{number} at {t_us[at] / 1e6:.6f} s is {off[at]:.3g} {unit} off where the body's "
                f"{GROUND_TRUTH} and the mount put it."
            )
