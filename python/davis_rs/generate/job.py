"""Making one sequence, in whatever process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .._mitsuba import default_variant, variant
from ..record import record
from .folder import discard, publish, working_folder
from .manifest import describe_folder
from .sequence import DrawnSequence


def make_sequence(sequence: DrawnSequence, root: Path, threads: int) -> dict[str, Any]:
    """Simulate a sequence into its folder in ``root``, whole or not at all, unless it is there already.

    The folder is the same, byte by byte, whoever makes it: what is in it is a function of the plan and of the versions
    that ``meta.json`` names.

    Returns:
        Its line of the manifest: who made the folder sees it, which on a shared file system others may not at once.

    Raises:
        ValueError, OSError: as :func:`~davis_rs.record`.
        SystemExit: if a signal (SIGINT, SIGTERM) ended the simulation: it was meant for the process.
    """
    final = root / sequence.name
    if final.is_dir():
        return describe_folder(final)
    working = working_folder(root, sequence.name)
    try:
        _simulate(sequence, working, threads)
        publish(working, final)
    except BaseException:
        discard(working)
        raise
    return describe_folder(final)


def begin_worker(threads: int) -> None:
    """What a process does before its first sequence: Dr.Jit gets so many threads; results do not depend on it."""
    with variant(default_variant()[0]) as (_, dr):
        dr.set_thread_count(threads)


def origin(sequence: DrawnSequence) -> dict[str, Any]:
    """What ``meta.json`` says of where a sequence comes from."""
    return {
        "plan_sha256": sequence.plan_sha256,
        "index": sequence.index,
        "parameters": dict(sequence.parameters),
    }


def _simulate(sequence: DrawnSequence, folder: Path, threads: int) -> None:
    settings, scene = sequence.settings, sequence.on_path(sequence.scene())
    assert scene.trajectory is not None
    simulator = settings.make_simulator(scene, seed=sequence.parameters["seed"], threads=threads)
    described = simulator.describe()["scene"]
    if "file" in described:  # by its name in the plan: where it lies differs from machine to machine
        described["file"] = sequence.parameters["scene"]
    recording = record(
        simulator,
        scene.trajectory,
        folder,
        motion_capture=settings.make_motion_capture(),
        imu=settings.make_imu(),
        exposure=settings.exposure,
        meta={"generated": origin(sequence), "scene": described},
        quiet=True,
    )
    if recording.interrupted:
        raise SystemExit(130)
