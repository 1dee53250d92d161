"""The command line: davis-rs calibrate sensor."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..sensors import SENSORS
from .measured import RECORDING, add_measured, measured_with_frames


def add_sensor(parser: argparse.ArgumentParser) -> None:
    """Add the kind's arguments."""
    parser.set_defaults(run=_sensor)
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help=f"of one sensor: {RECORDING}",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.yaml", help="write the sensor, as --sensor takes it")
    parser.add_argument(
        "--base", metavar="SENSOR", help=f"where all else comes from: {', '.join(SENSORS)}, or a sensor file"
    )
    add_measured(parser)


def _sensor(options: argparse.Namespace) -> int:
    from ..sensor_fit import fit_sensor
    from ..sensors import load_sensor_file, sensor_yaml

    base = None if options.base is None else load_sensor_file(options.base)
    fit = fit_sensor([measured_with_frames(path, options) for path in options.recordings])
    text = sensor_yaml(fit.file(base))
    print(fit)
    if options.output is not None:
        options.output.write_text(text, encoding="utf-8")
        print(f"{options.output}: --sensor {options.output} simulates it")
    return 0
