"""How well a sensor that is fitted to one half of a recording tells the other half, next to its preset.

python benches/sensor_fit_recording.py RECORDING [PRESET]

Fits the first half (all that it does not tell from the preset), then simulates the preset and the fitted sensor: a static
scene for what pixels do that see no signal, and the sequence slider_close for bursts and parity. The scenes are not the
recording's, so bursts and rates compare only roughly.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from davis_rs import (
    CrossingEngine,
    SensorParameters,
    StreamStatistics,
    fit_sensor,
    load_scene,
    measure_recording,
    measure_stream,
    simulate,
)
from davis_rs.events import concatenate_events
from davis_rs.sensors import load_sensor_file

LIGHT, LUX, SETTLED_S, STATIC_S, MOVING_S = 0.2, 1000.0, 60, 20, 0.5


def static(sensor: SensorParameters, size: tuple[int, int]) -> StreamStatistics:
    """Of a scene in which nothing moves, after a minute."""
    width, height = size
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=sensor.contrast_threshold or 0.15,
        contrast_threshold_off=sensor.contrast_threshold_off,
        effects=sensor.effects(LUX).engine_settings(),
    )
    frame = np.full((height, width), LIGHT, np.float32)
    end_s = SETTLED_S + STATIC_S
    events = concatenate_events([engine.push(t_s * 1_000_000, frame) for t_s in (*range(0, end_s, 5), end_s)])
    events = events[events["t"] > SETTLED_S * 1e6]
    return measure_stream(events, size=size, quiet=(0, 0, width, height))


def moving(sensor: SensorParameters, size: tuple[int, int]) -> StreamStatistics:
    """Of a textured plane that passes."""
    packets = simulate(load_scene("slider_close"), duration_s=MOVING_S, sensor=sensor)
    return measure_stream(concatenate_events([packet.events for packet in packets]), size=size)


def rows(quiet: StreamStatistics, busy: StreamStatistics) -> dict[str, str]:
    """What is compared: of pixels without signal in one stream, of the others in the other."""
    hot, pixels = quiet.hot_pixels, quiet.counts[0].size
    periodic = int(np.count_nonzero((hot.variation < 0.7) & (hot.on_share > 0.8)))
    windows, columns = busy.bursts.rows_per_window, busy.column_parity
    return {
        "events of a quiet pixel [Hz]": str(quiet.quiet_rate_hz),
        "their ON share": str(quiet.quiet_on_share),
        "hot pixels, periodic and ON": f"{periodic} +- {max(periodic, 1) ** 0.5:.1f} of {pixels:,}",
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
    base = load_sensor_file(preset)
    columns = {f"{Path(path).name}, second half": rows(second, second)}
    for name, sensor in ((preset, base.parameters), ("fitted to the first half", fit.file(base).parameters)):
        columns[name] = rows(static(sensor, whole.size), moving(sensor, whole.size))
    print(f"| | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for row in next(iter(columns.values())):
        print(f"| {row} | {' | '.join(column[row] for column in columns.values())} |")


if __name__ == "__main__":
    main()
