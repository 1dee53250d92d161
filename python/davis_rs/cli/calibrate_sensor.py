"""The command line: davis-rs calibrate sensor."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..progress import progress
from ..sensors import SENSORS
from .common import add_part, sensor_size


def add_sensor(parser: argparse.ArgumentParser) -> None:
    """Add the kind's arguments."""
    parser.set_defaults(run=_sensor)
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help="of one sensor: a dataset folder, an event file of any format, a camera's bytes, or an AEDAT recording",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.yaml", help="write the sensor, as --sensor takes it")
    parser.add_argument(
        "--base", metavar="SENSOR", help=f"where all else comes from: {', '.join(SENSORS)}, or a sensor file"
    )
    parser.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size, where a file does not say")
    parser.add_argument(
        "--quiet-region",
        type=int,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="pixels X0 <= x < X1, Y0 <= y < Y1 that see no signal; the quietest tiles if not given",
    )
    add_part(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def _sensor(options: argparse.Namespace) -> int:
    from ..sensors import load_sensor_file, sensor_yaml
    from ..sensors.sensor_fit import fit_sensor
    from ..stream_statistics import StreamStatistics, measure_stream

    base = None if options.base is None else load_sensor_file(options.base)
    region = None if options.quiet_region is None else tuple(options.quiet_region)

    def measured(path: str) -> StreamStatistics:
        with progress(f"reading {path}", 100.0, unit="%", show=not options.quiet) as bar:
            return measure_stream(
                path,
                size=options.size,
                quiet=region,
                start_s=options.start,
                stop_s=options.stop,
                progress=lambda share: bar.to(100.0 * share),
            )

    fit = fit_sensor([measured(path) for path in options.recordings])
    text = sensor_yaml(fit.file(base))
    print(fit)
    if options.output is not None:
        options.output.write_text(text, encoding="utf-8")
        print(f"{options.output}: --sensor {options.output} simulates it")
    return 0
