"""Runs davis-rs simulate and davis-rs sequence."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from .._util.argument_error import ArgumentError
from .._util.terminal_text import tell
from ..io.dataset.files import require_folder_room
from ..scene.scene import Scene
from ..scene.sequences import SEQUENCES, sequence_named
from ..sensor.rig import RIGS
from ..simulation.settings import FolderSettings
from .common import add_path, add_scene, on_path, scene_of
from .settings_options import add_settings, given_settings
from .show import ShownEvents, add_output


def add_simulate(simulate: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    simulate.set_defaults(run=_simulate)
    add_scene(simulate)
    add_path(simulate.add_argument_group("camera path"))
    rig = simulate.add_argument_group("rig (docs/rigs.md)")
    rig.add_argument(
        "--rig",
        metavar="RIG",
        help=f"several cameras and IMUs on one body: {', '.join(RIGS)}, or a rig.yaml; the camera path is the body's",
    )
    rig.add_argument(
        "--camera-index", type=int, metavar="N", help="simulate this camera of the rig alone; 0 is the first"
    )
    add_output(simulate)
    add_settings(simulate, FolderSettings)


def add_sequence(sequence: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    sequence.description = (
        "Simulate a synthetic counterpart of one of the public dataset's sequences into a dataset folder, with the IMU "
        "and the frames that the recording has: the same as davis-rs simulate NAME. davis-rs sequences lists them."
    )
    sequence.set_defaults(run=_sequence)
    sequence.add_argument("name", metavar="NAME", help="a sequence, such as poster_6dof or slider_depth")
    path = sequence.add_argument_group("camera path")
    path.add_argument(
        "--start",
        dest="start_s",
        type=float,
        default=0.0,
        metavar="S",
        help="start at this time of the sequence, in seconds (default: 0)",
    )
    path.add_argument(
        "--duration", dest="duration_s", type=float, metavar="S", help="seconds to simulate; to the end if not given"
    )
    add_output(sequence)
    add_settings(sequence, FolderSettings)


def _simulate(options: argparse.Namespace) -> int:
    require_folder_room(Path(options.output), overwrite=options.overwrite)
    scene = on_path(options, scene_of(options, options.quiet), options.quiet)
    if options.rig is not None:
        return _simulate_rig(options, scene)
    if options.camera_index is not None:
        raise ArgumentError("{camera_index} is that of a camera of a rig: give {rig}")
    if options.scene in SEQUENCES:
        return _simulate_sequence(options, options.scene, scene)
    return simulate_into(options, scene, {})


def _simulate_rig(options: argparse.Namespace, scene: Scene) -> int:
    from ..simulation.rig import simulate_rig_to_folder

    if options.show:
        raise ArgumentError("{show} shows one camera, not those of a {rig}; davis-rs view --html shows each afterwards")
    report = simulate_rig_to_folder(
        scene,
        options.output,
        rig=options.rig,
        camera_index=options.camera_index,
        overwrite=options.overwrite,
        meta={"command": ["davis-rs", *sys.argv[1:]]},
        quiet=options.quiet,
        **({"accept_noise": False} | given_settings(options, FolderSettings)),
    )
    tell(report)
    return 130 if report.interrupted else 0


def _sequence(options: argparse.Namespace) -> int:
    require_folder_room(Path(options.output), overwrite=options.overwrite)
    scene = sequence_named(options.name).scene()
    return _simulate_sequence(options, options.name, scene.crop(options.start_s, options.duration_s))


def _simulate_sequence(options: argparse.Namespace, name: str, scene: Scene) -> int:
    sequence = sequence_named(name)
    meta = {"sequence": {"biases": sequence.biases, "differs": sequence.differs}}
    return simulate_into(options, scene, dict(sequence.settings), **meta)


def simulate_into(options: argparse.Namespace, scene: Scene, defaults: dict[str, Any], **meta: object) -> int:
    """Simulate a scene into the folder ``options.output``.

    Args:
        defaults: settings of the scene's own, which the options override.
        meta: more for meta.json.
    """
    from ..inspection.path_returns import return_note
    from ..io.dataset.reader import Dataset
    from ..simulation.folder import simulate_to_folder

    with ShownEvents(f"{scene.name}: events", wanted=options.show) as shown:
        report = simulate_to_folder(
            scene,
            options.output,
            overwrite=options.overwrite,
            meta={"command": ["davis-rs", *sys.argv[1:]], **meta},
            quiet=options.quiet,
            on_packet=shown.packet,
            **({"accept_noise": False} | defaults | given_settings(options, FolderSettings)),
        )
    if report.plan is not None and not options.quiet:
        tell(report.plan, file=sys.stderr)
    tell(report)
    if not options.quiet and (note := return_note(Dataset(options.output))) is not None:
        tell(f"note: {note}", file=sys.stderr)
    return 130 if report.interrupted else 0
