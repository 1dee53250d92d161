"""Runs davis-rs reproduce."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from .._util.argument_error import ArgumentError, OverwriteError
from .._util.progress import stage
from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from ..sensor.presets import SENSORS
from .common import EVENTS_HELP, sensor_size

if TYPE_CHECKING:
    from ..events.arrays import EventArray


def add_reproduce(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = (
        "Fit a sensor to one half of a recording with frames, simulate the other half from its frames, and compare it "
        "with the recording: rates, intervals, bursts and parity with their errors, and correlations in time and "
        "space. docs/real_recordings.md says what each row means."
    )
    parser.set_defaults(run=_reproduce)
    parser.add_argument("recording", metavar="RECORDING", help=f"with frames: {EVENTS_HELP}")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR",
        help="folder for table.csv, table.json, the fitted sensor files, events of both, and reproduction.png",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace what the folder holds")
    parser.add_argument(
        "--fit", choices=("first", "second", "both"), default="first",
        help="the half that is fitted; the other one is compared (default: first)",
    )  # fmt: skip
    parser.add_argument(
        "--base", metavar="SENSOR",
        help=f"where all that the fit does not find comes from: {', '.join(SENSORS)}, or a sensor file; if not given, "
        "the preset of a DAVIS240C or a DAVIS346 by the sensor's size",
    )  # fmt: skip
    parser.add_argument(
        "--against", action="append", default=[], metavar="FILE",
        help="events of another simulator for the same frames, in microseconds after the recording's first event: one "
        "more column; may be given several times",
    )  # fmt: skip
    parser.add_argument(
        "--lux-per-luma", type=float, metavar="LUX",
        help="illuminance that is taken for the brightest value of the frames (default: 1000)",
    )  # fmt: skip
    parser.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size, where a file does not say")
    parser.add_argument(
        "--start", dest="start_s", type=float, default=0.0, metavar="S", help="only from here on, after the first event"
    )
    parser.add_argument(
        "--stop", dest="stop_s", type=float, metavar="S", help="only before this time after the first event"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all that is drawn (default: 0)")
    parser.add_argument("--no-figure", dest="figure", action="store_false", help="without reproduction.png")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def _reproduce(options: argparse.Namespace) -> int:
    from .._util.extras import require
    from ..events.arrays import as_events
    from ..io.files.read import read_events
    from ..io.files.write import open_writer
    from ..reproduction import open_clip, reproduce
    from ..reproduction.figure import draw_reproduction
    from ..sensor.presets.sensor_file import sensor_yaml

    if options.figure:
        require("view", "matplotlib")
    if not options.overwrite and options.output.exists() and any(options.output.iterdir()):
        raise OverwriteError(options.output, "the folder is not empty; {overwrite:True} replaces what it holds")
    with stage(f"reading {options.recording}", show=not options.quiet):
        clip = open_clip(options.recording, size=options.size, start_s=options.start_s, stop_s=options.stop_s)
    against: dict[str, EventArray] = {}
    for file in options.against:
        name = Path(file).stem
        if name in against:
            raise ArgumentError("{against}: two files are called {!r}", name)
        against[name] = as_events(read_events(file))
    lux = {} if options.lux_per_luma is None else {"lux_per_luma": options.lux_per_luma}
    with stage("reproducing it", show=not options.quiet):
        result = reproduce(clip, fit=options.fit, base=options.base, against=against, seed=options.seed, **lux)
    folder: Path = options.output
    folder.mkdir(parents=True, exist_ok=True)
    for half in result.halves:
        write_whole(folder / f"sensor-{half.half.name}.yaml", sensor_yaml(half.sensor))
        for name in ("real", "fitted"):
            with open_writer(folder / f"{name}-{half.half.name}.npy", clip.size, overwrite=True) as writer:
                writer.write(half.streams[name])
    write_whole(folder / "table.json", json.dumps(result.describe(), indent=1) + "\n")
    write_whole(folder / "table.csv", result.csv())
    tell(result)
    if options.figure:
        tell(draw_reproduction(result, folder / "reproduction.png"))
    return 0
