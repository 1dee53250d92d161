"""What each effect of a fitted sensor does to the agreement of a reproduced recording.

python benches/reproduce_effects.py RECORDING

Fits each half, as ``davis-rs reproduce --fit both`` does, and simulates the other half without one effect at a time.
Rows of 8 seeds have the events of eight simulations together, whose references begin in other places: what is left
there is not due to what is drawn by chance.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from davis_rs import SensorParameters, reproduce
from davis_rs.events.arrays import concatenate_events
from davis_rs.reproduction.agreement import correlations
from davis_rs.reproduction.clip import RecordedClip, open_clip
from davis_rs.reproduction.clip_light import ClipLight
from davis_rs.reproduction.clip_statistics import Span
from davis_rs.reproduction.reproduced import ReproducedHalf
from davis_rs.reproduction.resampling import Resampling
from davis_rs.reproduction.simulated import ideal, simulated, without_noise

BANDWIDTH = "photoreceptor_bandwidth_hz", "photoreceptor_bandwidth_lux", "source_follower_bandwidth_hz"
READOUT = "readout_events_per_s", "readout_row_us"
SEEDS = range(8)


def sensors(fitted: SensorParameters) -> dict[str, tuple[SensorParameters, Iterable[int], str]]:
    """Sensors that are compared: each with seeds, and where references begin."""

    def without(*names: str) -> SensorParameters:
        return replace(fitted, **dict.fromkeys(names))

    one = SEEDS[:1]
    return {
        "fitted": (fitted, one, "zero"),
        "without mismatch": (without("threshold_mismatch"), one, "zero"),
        "without bandwidth": (without(*BANDWIDTH), one, "zero"),
        "without a refractory period": (without("refractory_period_us"), one, "zero"),
        "without readout": (without(*READOUT), one, "zero"),
        "without noise and leak": (without_noise(fitted), one, "zero"),
        "references anywhere": (fitted, one, "stationary"),
        "references anywhere, 8 seeds": (fitted, SEEDS, "stationary"),
        "ideal pixel": (ideal(fitted), one, "zero"),
        "ideal pixel, references anywhere, 8 seeds": (ideal(fitted), SEEDS, "stationary"),
    }


def agreement(clip: RecordedClip, half: ReproducedHalf) -> dict[str, list[float]]:
    """Events over the recording's, then correlations of pixel counts, vox20 and vox5, of each sensor."""
    light = ClipLight.of(clip, half.fit.black)
    nothing = np.zeros((clip.size[1], clip.size[0]), np.bool_)
    span = Span(half.half.start_us, half.half.stop_us, clip.size, nothing, Resampling.of(light.compared()))
    numbers = range(half.half.frames.stop) if half.half.name == "second" else half.half.frames
    real, rows = half.streams["real"], {}
    for name, (sensor, seeds, start) in sensors(half.sensor.parameters).items():
        parts = [
            simulated(
                light,
                numbers,
                sensor,
                log_eps=half.log_eps.value,
                lux_per_luma=half.lux_per_luma,
                start_phase=start,
                seed=seed,
            )
            for seed in seeds
        ]
        events = concatenate_events(parts)
        events = span.cut(events[np.argsort(events["t"], kind="stable")])
        told = [float(one.draws[0]) for one in correlations(real, events, span)]
        rows[name] = [len(events) / len(parts) / len(real), *told]
    return rows


def main() -> None:
    """Fit, simulate, print."""
    clip = open_clip(sys.argv[1])
    for half in reproduce(clip, fit="both").halves:
        print(f"\nthe {half.half.name} half | simulated / real | pixel counts | vox20 | vox5")
        for name, row in agreement(clip, half).items():
            print(f"{name} | {row[0]:.2f} | {' | '.join(f'{value:.3f}' for value in row[1:])}", flush=True)


if __name__ == "__main__":
    main()
