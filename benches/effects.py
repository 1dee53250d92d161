"""What each effect does to the same two seconds of three_planes, and what it costs: a table and a picture.

python benches/effects.py [-o docs/effects.png]
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import numpy as np

from davis_rs import SENSORS, Effects, Simulator, compare_events, load_scene
from davis_rs.effects import Aps, HotPixels, PhotoreceptorBandwidth, Readout, ShotNoise
from davis_rs.events import EventArray, concatenate_events

SCENE = load_scene("three_planes")
SECONDS = 2.0
ROUNDS = 3
SHOWN_S = 1.0, 1.01

# Strong enough to be seen; a DAVIS240C's own are the last row.
CASES: dict[str, dict[str, Any]] = {
    "none": {},
    "vignetting": {"effects": Effects(vignetting=4)},
    "lens_blur_px=1": {"effects": Effects(lens_blur_px=1)},
    "photoreceptor_bandwidth_hz=100": {"effects": Effects(photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(100))},
    "threshold_mismatch=0.3": {"effects": Effects(threshold_mismatch=0.3)},
    "refractory_period_us=5000": {"effects": Effects(refractory_period_us=5000)},
    "leak_rate_hz=1": {"effects": Effects(leak_rate_hz=1)},
    "shot_noise_rate_hz=5": {"effects": Effects(shot_noise_rate_hz=ShotNoise(5))},
    "hot_pixels=0.005,rate_hz=500": {"effects": Effects(hot_pixels=HotPixels(0.005, 500))},
    "readout=1e6,drop_after_us=1000": {"effects": Effects(readout=Readout(1e6, drop_after_us=1000))},
    "aps=25000": {"effects": Effects(aps=Aps(25_000))},
    "--sensor davis240c, C 0.15": {"sensor": "davis240c", "contrast_threshold": 0.15, "contrast_threshold_off": 0.15},
}


def run(settings: dict[str, Any]) -> tuple[float, EventArray, Any]:
    """Seconds of processor time, events, and the frame at the shown time's start."""
    simulator = Simulator(SCENE.crop(0.0, SECONDS), depth_rate_hz=0, **settings)
    events, frame = [], None
    start = time.process_time()
    for packet in simulator.run():
        events.append(packet.events)
        if packet.end_us == round(SHOWN_S[0] * 1e6):
            frame = packet.luma if packet.frame is None else packet.frame
    return time.process_time() - start, concatenate_events(events), frame


def main() -> None:
    """Run all cases in turn, print the table, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", help="the picture")
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {name: [] for name in CASES}
    found: dict[str, tuple[EventArray, Any]] = {}
    for _ in range(ROUNDS):
        for name, settings in CASES.items():
            took, *rest = run(settings)
            seconds[name].append(took)
            found[name] = (rest[0], rest[1])
    base = statistics.median(seconds["none"])
    # What a reference was at the start is as arbitrary without a leak: the same phases, and no drift.
    phases = run({"effects": Effects(leak_rate_hz=1e-9)})[1]
    size = SCENE.own_camera.width, SCENE.own_camera.height
    print(f"{base:.2f} s of processor time without effects, {ROUNDS} rounds, medians")
    print(f"davis240c: {SENSORS['davis240c']}\n")
    print(
        "| effect | events | ON | missing | spurious | median shift | processor time |\n|---|---|---|---|---|---|---|"
    )
    for name, (events, _) in found.items():
        # Against the stream with the effect: what leaving it out gets wrong.
        ideal = phases if name.startswith("leak") else found["none"][0]
        error = compare_events(ideal, events, size=size)
        on, times = 100 * np.mean(events["p"] != 0), statistics.median(seconds[name]) / base
        print(
            f"| {name} | {len(events):,} | {on:.1f} % | {error.missing_percent:.1f} % | "
            f"{error.spurious_percent:.1f} % | {error.median_us:.0f} us | {times:.2f} x |"
        )
    if options.output:
        draw(found, options.output)


def draw(found: dict[str, tuple[EventArray, Any]], path: str) -> None:
    """Events of the shown time, ON blue and OFF red, and the frame where the effect is on frames."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 4, figsize=(16, 9.6), layout="constrained")
    for axis, (name, (events, frame)) in zip(axes.flat, found.items(), strict=True):
        t_us = events["t"]
        shown = events[(t_us > SHOWN_S[0] * 1e6) & (t_us <= SHOWN_S[1] * 1e6)]
        axis.set_title(f"{name}\n{len(shown):,} events in {1e3 * (SHOWN_S[1] - SHOWN_S[0]):.0f} ms", fontsize=10)
        axis.set_axis_off()
        if name.startswith("aps"):
            axis.imshow(frame, cmap="gray", vmin=0, vmax=1)
            axis.set_title(f"{name}\nthe frame at {SHOWN_S[0]:g} s", fontsize=10)
            continue
        image = np.ones((SCENE.own_camera.height, SCENE.own_camera.width, 3))
        for polarity, colour in ((1, (0.1, 0.3, 0.9)), (0, (0.85, 0.15, 0.1))):
            one = shown[shown["p"] == polarity]
            image[one["y"], one["x"]] = colour
        axis.imshow(image)
    figure.savefig(path, dpi=75)


if __name__ == "__main__":
    main()
