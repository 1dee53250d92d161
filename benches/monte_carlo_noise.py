"""The estimate of Monte Carlo noise next to whole runs: python benches/monte_carlo_noise.py > table.md

A box with a lamp in its ceiling (tests/helpers/lamp_box.py), 96 x 72 pixels, 0.2 s: whole runs at several numbers of
samples matched with one of 1,024 samples of another seed, and what the estimate before each run says of it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from davis_rs import Simulator, compare_events
from davis_rs._mitsuba.variants import FAST, variant
from davis_rs._util.progress import say
from davis_rs.events.arrays import EventArray
from davis_rs.simulation.monte_carlo_noise import estimate_noise_of
from davis_rs.simulation.noise_estimate import NoiseEstimate
from lamp_box import lamp_box

SAMPLES, TRUTH, TRUTH_SEED = (8, 16, 64), 1024, 99


def run(rays_per_pixel: int, seed: int) -> tuple[EventArray, float]:
    """(events, processor seconds) of a whole run."""
    simulator = Simulator(
        lamp_box(), renderer="integrator", rays_per_pixel=rays_per_pixel, seed=seed, frame_rate_hz=0, depth_rate_hz=0
    )
    began = time.process_time()
    events = np.concatenate([packet.events for packet in simulator.run()])
    return events, time.process_time() - began


def estimate(rays_per_pixel: int) -> tuple[NoiseEstimate, float]:
    """(what is estimated, processor seconds)."""
    simulator = Simulator(lamp_box(), renderer="integrator", rays_per_pixel=rays_per_pixel)
    began = time.process_time()
    found = estimate_noise_of(
        simulator.renderer,
        simulator.scene.path,
        contrast_threshold=simulator.contrast_threshold,
        contrast_threshold_off=simulator.contrast_threshold_off,
        log_eps=1e-3,
        sampling=simulator.sampling,
    )
    assert found is not None
    return found, time.process_time() - began


def main() -> None:
    with variant(FAST):
        say("the reference")
        truth, _ = run(TRUTH, TRUTH_SEED)
        print("| samples | events | missing | spurious | both | estimated | median error | rays of the estimate |")
        print("|---:|---:|---:|---:|---:|---:|---:|---:|")
        for rays_per_pixel in SAMPLES:
            say(f"{rays_per_pixel} samples")
            events, _ = run(rays_per_pixel, 0)
            found = compare_events(events, truth, size=(96, 72))
            told, _ = estimate(rays_per_pixel)
            both = found.missing_percent + found.spurious_percent
            print(
                f"| {rays_per_pixel} | {len(events):,} | {found.missing_percent:.0f} % | "
                f"{found.spurious_percent:.0f} % | "
                f"{both:.0f} % | {100 * told.share_at(rays_per_pixel):.0f} % | {found.median_us / 1e3:.1f} ms | "
                f"{told.rays / 1e6:.2f} M, {told.rays / told.run_rays:.2g} of the run's |"
            )
        print(f"\n{TRUTH} samples: {len(truth):,} events.")


if __name__ == "__main__":
    main()
