"""Makes one sequence, in whatever process."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from .._mitsuba.variants import default_variant, variant
from .._util.array_types import JsonObject
from .._util.folder_report import FolderReport
from ..render.scene_cache import enable_scene_cache
from ..render.truth import lost_look_fractions
from ..render.truth.lost_look_fractions import warn_of_lost_looks
from ..scene.lost_looks import LostLookWarning
from ..scene.scene import Scene
from ..simulation.folder import simulate_to_folder
from ..simulation.monte_carlo_noise import noise_before_run, refuse_noise
from ..simulation.no_events import NoEventsWarning
from ..simulation.noise_estimate import NoiseError, NoiseEstimate, NoiseWarning
from ..simulation.rig import simulate_rig_to_folder
from ..simulation.rig.rig_cameras import scene_of_camera, settings_of_camera
from ..simulation.settings import FolderSettings, complete, view_scene
from .folder import ManifestLine, discard, publish, working_folder
from .manifest import describe_folder
from .sequence import DrawnSequence, SceneKey


def make_sequence(sequence: DrawnSequence, root: Path, threads: int) -> ManifestLine:
    """Simulate a sequence into its folder in ``root``, whole or not at all, unless it is there already.

    The folder is the same, byte by byte, whoever makes it: what is in it is a function of the plan and of the versions
    that ``meta.json`` names.

    Returns:
        Its line of the manifest: who made the folder sees it, which on a shared file system others may not at once.

    Raises:
        ValueError, OSError: as :func:`~davis_rs.simulate_to_folder`.
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
    """Prepare a worker process. Results do not depend on it.

    Dr.Jit gets ``threads`` threads, and what is made of a scene is kept for the next sequence that has the same one.
    """
    enable_scene_cache()
    with variant(default_variant()[0]) as (_, dr):
        dr.set_thread_count(threads)


def origin(sequence: DrawnSequence) -> dict[str, object]:
    """Say for ``meta.json`` where a sequence comes from."""
    return {
        "plan_sha256": sequence.plan_sha256,
        "index": sequence.index,
        "parameters": dict(sequence.parameters),
    }


def noise_of(sequence: DrawnSequence) -> NoiseEstimate | None:
    """Estimate how many of a sequence's events will be Monte Carlo noise; None where nothing is drawn at random.

    Raises:
        NoiseError: if there will be more than the plan accepts, in the words of a plan.
    """
    settings = complete(FolderSettings, _settings(sequence), taker=str(sequence))
    scene = sequence.on_path(sequence.scene())
    if sequence.rig is not None:  # its cameras see the same light
        settings = settings_of_camera(settings, sequence.rig, 0)
        scene = scene_of_camera(scene, sequence.rig, 0)
    noise = noise_before_run(scene, settings)
    if not sequence.accept_noise:
        with _in_words_of_a_plan():
            refuse_noise(noise, scene, settings)
    return noise


@contextmanager
def _in_words_of_a_plan() -> Iterator[None]:
    try:
        yield
    except NoiseError as refused:
        raise NoiseError(refused.in_plan) from None


def _settings(sequence: DrawnSequence) -> JsonObject:
    return {**sequence.settings, "seed": sequence.parameters["seed"], "accept_noise": sequence.accept_noise}


def warn_of_looks(sequence: DrawnSequence) -> None:
    """Tell which looks are lost of a sequence's scene.

    Warns:
        LostLookWarning: as :class:`~davis_rs.Simulator`.
    """
    scene = sequence.on_path(sequence.scene())
    if scene.lost_looks:
        settings = complete(FolderSettings, sequence.settings, taker="generate")
        if sequence.rig is not None:
            settings = settings_of_camera(settings, sequence.rig, 0)
            scene = scene_of_camera(scene, sequence.rig, 0)
        viewed = view_scene(scene, settings)
        warn_of_lost_looks(viewed.scene, lost_look_fractions(viewed.scene, viewed.camera), stacklevel=2)


@lru_cache(maxsize=4)
def _scene_at(key: SceneKey) -> Scene:
    """Load a scene that sequences share: the same object each time, by which what is made of it is known again."""
    return key.load()


def _simulate(sequence: DrawnSequence, folder: Path, threads: int) -> None:
    key = sequence.scene_key
    meta: dict[str, object] = {"generated": origin(sequence)}
    with warnings.catch_warnings(), _in_words_of_a_plan():
        # Of the first sequence the run says it before it begins, and of each one its meta.json does.
        warnings.simplefilter("ignore", NoiseWarning)
        warnings.simplefilter("ignore", LostLookWarning)
        warnings.simplefilter("ignore", NoEventsWarning)  # the run says at its end which sequences have none
        scene = sequence.on_path(sequence.scene() if key is None else _scene_at(key))
        if scene.file is not None:  # by its name in the plan: where it lies differs from machine to machine
            scene = replace(scene, file_name=sequence.parameters["scene"])
        more: JsonObject = {"meta": meta, "quiet": True, "threads": threads, **_settings(sequence)}
        rig = sequence.rig
        report: FolderReport = (
            simulate_to_folder(scene, folder, **more)
            if rig is None
            else simulate_rig_to_folder(scene, folder, rig=rig, **more)
        )
    if report.interrupted:
        raise SystemExit(130)
