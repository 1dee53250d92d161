"""Runs davis-rs calibrate sensor."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._util.progress import stage
from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from ..sensor.presets import SENSORS
from .common import EVENTS_HELP, figure_file
from .measured import add_measured, measured_with_frames

_LONGEST_S = 60.0
"""Of the static scene that is drawn."""


def add_sensor(parser: argparse.ArgumentParser) -> None:
    """Add the kind's arguments."""
    parser.set_defaults(run=_sensor)
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help=f"of one sensor: {EVENTS_HELP}",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.yaml", help="write the sensor, as --sensor takes it")
    parser.add_argument(
        "--base", metavar="SENSOR", help=f"where all else comes from: {', '.join(SENSORS)}, or a sensor file"
    )
    parser.add_argument(
        "--lux",
        type=float,
        nargs="+",
        metavar="LUX",
        help="illuminance that the quiet pixels of each recording see, in the order of the recordings: fits shot "
        "noise, and the photoreceptor's bandwidth",
    )
    parser.add_argument(
        "--figure",
        type=figure_file,
        metavar="FILE",
        help="draw the first recording next to a static scene that the fitted sensor sees: .png, .pdf, .svg ...",
    )
    add_measured(parser)


def _sensor(options: argparse.Namespace) -> int:
    from ..calibrate.sensor import fit_sensor
    from ..calibrate.sensor.static_scene import SETTLED_S, static_events
    from ..inspection.statistics import EventStream, StreamComparison, measure_stream
    from ..inspection.statistics.comparison_figure import draw_comparison
    from ..inspection.statistics.event_stream import cut
    from ..sensor.presets import load_sensor_file, sensor_yaml

    base = None if options.base is None else load_sensor_file(options.base)
    lux = options.lux or [None] * len(options.recordings)
    if len(lux) != len(options.recordings):
        raise ValueError(f"--lux must have a value for each of {len(options.recordings)} recordings, got {len(lux)}")
    recordings = [
        measured_with_frames(path, options, light) for path, light in zip(options.recordings, lux, strict=True)
    ]
    with stage("fitting the sensor", show=not options.quiet):
        fit = fit_sensor(recordings, base)
    fitted = fit.file(base)
    text = sensor_yaml(fitted)
    tell(fit)
    if options.output is not None:
        write_whole(options.output, text)
        tell(f"{options.output}: --sensor {options.output} simulates it")
    if options.figure is not None:
        real = recordings[0].statistics
        with stage("simulating a static scene", show=not options.quiet):
            duration_s = min(real.duration_s, _LONGEST_S)
            # What takes longer to settle than ten recordings, a recording cannot tell.
            settled_s = min(SETTLED_S, 10 * duration_s)
            events = static_events(fitted.parameters, real.size, duration_s, settled_s=settled_s)
            simulated = measure_stream(
                EventStream("static scene, fitted sensor", "simulated", real.size, lambda told: cut(events, told))
            )
        tell(draw_comparison(StreamComparison(real, simulated), options.figure))
    return 0
