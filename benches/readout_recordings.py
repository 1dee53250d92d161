"""What recordings say of the readout, next to a simulation of as many events a second.

python benches/readout_recordings.py RECORDING [RECORDING ...]

Of each recording of a DAVIS240C or a DAVIS346: its statistics next to those of the preset, which sees a texture that
moves so fast that it makes as many events a second; quiet pixels are those of a scene that stands still. Then how long
a burst of so many events keeps the bus.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from davis_rs import SENSORS, CrossingEngine, Effects, SensorParameters, StreamStatistics, measure_stream, read_events
from davis_rs.calibrate.sensor.static_scene import static_events
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects.effect import EngineEffect

STEP_US = 1000
MOVING_S, SETTLED_S, STILL_S = 0.5, 0.2, 5.0
LUX = 200.0
"""Of the texture's mean; the presets' noise is that of a recording which is taken to have had it."""


def texture(width: int, height: int) -> FloatArray:
    """Log intensity (height, 4 width) of soft blobs of 3 to 12 px, which repeats in x; standard deviation 0.5."""
    fy, fx = np.meshgrid(np.fft.fftfreq(height), np.fft.rfftfreq(4 * width), indexing="ij")
    frequency = np.hypot(fy, fx)
    kept = (frequency > 1 / 24) & (frequency < 1 / 6)
    spectrum = np.fft.rfft2(np.random.default_rng(0).standard_normal((height, 4 * width)))
    blobs = np.fft.irfft2(np.where(kept, spectrum, 0), s=(height, 4 * width))
    return np.asarray(0.5 * blobs / blobs.std())


def simulate(sensor: SensorParameters, rate_hz: float) -> EventArray:
    """What a sensor makes of the texture, of as many events a second."""
    width, height = int(sensor.width or 0), int(sensor.height or 0)
    image, column = texture(width, height), np.arange(width)
    effects = Effects.of(effect for effect in sensor.effects(LUX) if isinstance(effect, EngineEffect))

    def events(speed_px_per_s: float) -> EventArray:
        engine = CrossingEngine(
            width,
            height,
            contrast_threshold=sensor.contrast_threshold,
            contrast_threshold_off=sensor.contrast_threshold_off,
            effects=effects,
            start_phase=sensor.start_phase,
        )
        packets = []
        for t_us in range(0, int((SETTLED_S + MOVING_S) * 1e6) + 1, STEP_US):
            at = speed_px_per_s * t_us * 1e-6
            left = int(at)
            seen = [image[:, (column + left + k) % image.shape[1]] for k in (0, 1)]
            packets.append(engine.push_log(t_us, seen[0] + (at - left) * (seen[1] - seen[0])))
        whole = concatenate_events(packets)
        return whole[whole["t"] > SETTLED_S * 1e6]

    speed = 20.0
    for _ in range(4):
        speed *= rate_hz * MOVING_S / len(made := events(speed))
    return made


def volleys(events: EventArray) -> tuple[float, float]:
    """How much more often events follow each other at once than later, wherever they are, and how often they have one
    polarity: 1 and a half where they know nothing of each other."""

    def pairs(t: FloatArray, first_us: int, last_us: int) -> float:
        upto, before = np.searchsorted(t, t + last_us, side="right"), np.searchsorted(t, t + first_us)
        return float((upto - before).sum()) / (last_us - first_us + 1)

    t = events["t"].astype(np.float64)
    near = pairs(t, 1, 2)
    alike = sum(pairs(t[events["p"] == p], 1, 2) for p in (0, 1))
    return near / pairs(t, 200, 240), alike / near


def table(name: str, *streams: EventArray, still: StreamStatistics, size: tuple[int, int]) -> str:
    """A recording and a simulation as rows of Markdown; ``still`` is one of a scene that stands still."""
    rows: list[tuple[str, ...]] = [("", name, "simulated")]
    real, simulated = (measure_stream(events, size=size) for events in streams)
    one, two = real.describe(), simulated.describe()
    rows.append(("events a second", *(f"{s.events / s.duration_s:,.0f}" for s in (real, simulated))))
    rows.append(("rows of the bus", *(f"{d['rows_of_bus']} of the image" for d in (one, two))))
    for key, words in (
        ("rows_per_us", "row bursts of one stamp: mean, most"),
        ("rows_per_10_us", "row bursts in 10 us: mean, most"),
        ("events_per_row", "events in a burst: mean, most"),
        ("events_per_10_us", "events in 10 us: mean, most"),
    ):
        rows.append((words, *(f"{d[key]['mean']:.4g}, {d[key]['most']}" for d in (one, two))))
    bursts = [
        f"{s.bursts.ascending:,} of {s.bursts.ascending + s.bursts.descending + s.bursts.unordered:,}"
        for s in (real, simulated)
    ]
    rows.append(("bursts of several events whose addresses ascend", *bursts))
    for key, words in (
        ("rows_up_share", "rows of one stamp: the next one is higher"),
        ("shared_stamp_share", "events that share their stamp"),
    ):
        rows.append((words, *(f"{100 * d[key]:.1f} %" for d in (one, two))))
    for words, place in (("columns", "column_parity"), ("rows", "row_parity")):
        for p, polarity in ((1, "ON"), (0, "OFF")):
            pair = (getattr(s, place)[p] for s in (real, simulated))
            rows.append((f"even / odd {words} of the image, {polarity}", *(f"{v:.3f} +- {e:.3f}" for v, e in pair)))
    near, of_one = zip(*(volleys(events) for events in streams), strict=True)
    rows.append(("pairs of events 1 or 2 us apart, over those 200 to 240 us apart", *(f"{one:.2f}" for one in near)))
    rows.append(("of the former, of one polarity", *(f"{100 * one:.0f} %" for one in of_one)))
    rows.append(("quiet pixels", *(f"{s.quiet_rate_hz} Hz" for s in (real, still))))
    rows.append(("of which ON", *(str(s.quiet_on_share) for s in (real, still))))
    return "\n".join(f"| {' | '.join(row)} |" + ("\n|---|---|---|" if not row[0] else "") for row in rows)


def pace(events: EventArray, *, by_columns: bool) -> list[tuple[int, int, float, float]]:
    """How long the bus takes for a burst: events of the burst, bursts, microseconds, their standard deviation.

    Where the next burst waits already, it follows after that time, rounded to one of two microseconds. Those are the
    shortest of which there is at least a percent, and their mean is the time; it is too long by the share of
    those that did not wait.
    """
    row, column = (events["x"], events["y"]) if by_columns else (events["y"], events["x"])
    t = events["t"].astype(np.int64)
    follows = (np.diff(t) == 0) & (np.diff(row.astype(int)) == 0) & (np.diff(column.astype(int)) > 0)
    starts = np.append(0, np.flatnonzero(~follows) + 1)
    size, gap = np.diff(starts), np.diff(t[starts])
    found = []
    for events_of_burst in range(1, 21):
        after = np.bincount(gap[(size == events_of_burst) & (gap < 100)], minlength=101)
        least = int(np.argmax(after > 0.01 * np.count_nonzero(size == events_of_burst)))
        early, late = int(after[least]), int(after[least + 1])
        if early + late >= 20:
            share = late / (early + late)
            sigma = math.sqrt(max(share * (1 - share), 0.01) / (early + late))
            found.append((events_of_burst, early + late, least + share, sigma))
    return found


def main() -> None:
    """Measure, simulate, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING")
    presets = {(one.width, one.height): one for one in SENSORS.values()}
    for path in parser.parse_args().recordings:
        real = measure_stream(path)
        if real.size not in presets:
            parser.error(f"{path}: no preset has {real.size[0]} x {real.size[1]} pixels")
        events = read_events(path)
        sensor, size = presets[real.size], real.size
        made = simulate(sensor, real.events / real.duration_s)
        still = measure_stream(static_events(sensor, size, STILL_S), size=size, quiet=(0, 0, *size))
        print(f"\n{table(path.name, events, made, still=still, size=size)}\n")
        told = pace(events, by_columns=real.bursts.by_columns)
        for of_burst, bursts, us, sigma in told:
            print(f"a burst of {of_burst:2} keeps the bus for at most {us:.2f} +- {sigma:.2f} us, by {bursts:,}")
        if len(told) > 2:
            n, _, mean_us, sigma_us = np.array(told).T
            slope, start = np.polyfit(n, mean_us, 1, w=1 / np.maximum(sigma_us, 0.01))
            print(f"a line through these: {start:.2f} us and {slope:.3f} us an event, {1 / slope:.3g} events a us")


if __name__ == "__main__":
    main()
