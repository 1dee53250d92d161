"""How well a sensor that is fitted to one half of a recording tells the other half, next to its preset.

python benches/sensor_fit_recording.py RECORDING [PRESET]

Fits the first half (all that it does not tell comes from the preset), then simulates the preset and the fitted
sensor: a static scene for what pixels do that see no signal, and the sequence slider_close for bursts and parity. The
scenes are not the recording's, so bursts and parity compare only roughly. Hot pixels count from the rate on at which
half of the recording shows them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from davis_rs import (
    SensorParameters,
    StreamStatistics,
    fit_sensor,
    load_scene,
    measure_recording,
    measure_stream,
    simulate,
)
from davis_rs.calibrate.sensor.static_scene import static_events
from davis_rs.events.arrays import concatenate_events
from davis_rs.inspection.statistics.hot_pixels import LEAST_EVENTS
from davis_rs.sensor.presets import load_sensor_file

STATIC_S, MOVING_S = 20.0, 0.5


def static(sensor: SensorParameters, size: tuple[int, int]) -> StreamStatistics:
    """Of a scene in which nothing moves."""
    return measure_stream(static_events(sensor, size, STATIC_S), size=size, quiet=(0, 0, *size))


def moving(sensor: SensorParameters, size: tuple[int, int]) -> StreamStatistics:
    """Of a textured plane that passes."""
    packets = simulate(load_scene("slider_close"), duration_s=MOVING_S, sensor=sensor)
    return measure_stream(concatenate_events([packet.events for packet in packets]), size=size)


def rows(quiet: StreamStatistics, busy: StreamStatistics, least_hz: float) -> dict[str, str]:
    """What is compared: of pixels without signal in one stream, of the others in the other."""
    hot, pixels = quiet.hot_pixels, quiet.counts[0].size
    periodic = int(np.count_nonzero((hot.variation < 0.7) & (hot.on_share > 0.8) & (hot.rate_hz >= least_hz)))
    windows, columns = busy.bursts.rows_per_window, busy.column_parity
    return {
        "events of a quiet pixel [Hz]": str(quiet.quiet_rate_hz),
        "their ON share": str(quiet.quiet_on_share),
        f"hot pixels of at least {least_hz:.2g} Hz": f"{periodic} +- {max(periodic, 1) ** 0.5:.1f} of {pixels:,}",
        "row bursts in 10 us: mean / most": f"{windows.mean or 0:.2f} / {windows.most}",
        "even / odd columns, ON": str(columns[1]),
        "even / odd columns, OFF": str(columns[0]),
    }


def main() -> None:
    """Fit, simulate, print."""
    path, preset = sys.argv[1], ([*sys.argv[2:], "davis240c"])[0]
    whole = measure_stream(path)
    half_s = whole.duration_s / 2
    fit = fit_sensor([measure_recording(path, stop_s=half_s)])
    print(fit)
    second = measure_stream(path, start_s=half_s)
    least_hz = LEAST_EVENTS / half_s
    base = load_sensor_file(preset)
    columns = {f"{Path(path).name}, second half": rows(second, second, least_hz)}
    for name, sensor in ((preset, base.parameters), ("fitted to the first half", fit.file(base).parameters)):
        columns[name] = rows(static(sensor, whole.size), moving(sensor, whole.size), least_hz)
    print(f"| | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for row in next(iter(columns.values())):
        print(f"| {row} | {' | '.join(column[row] for column in columns.values())} |")


if __name__ == "__main__":
    main()
