"""What each effect does to the same two seconds of three_planes, and what it costs: a table and a picture.

python benches/effects.py [-o docs/effects.png] [--picture-only]
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import SENSORS, Effects, Simulator, compare_events, load_scene
from davis_rs._util.srgb import to_srgb
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.inspection.figure import OFF_RGB, ON_RGB
from davis_rs.sensor.effects import Aps, HotPixels, PhotoreceptorBandwidth, Readout

SCENE = load_scene("three_planes")
SECONDS = 2.0
ROUNDS = 3
SHOWN_S = 1.0, 1.01
PICTURE_FROM_S = 0.8  # long enough before for held pixels, low-passes and the bus to be as they are later
CROP = slice(50, 140), slice(60, 180)  # rows, columns
LOST_RGB, SAME = (0, 0, 0), 0.3

# Strong enough to be seen; a DAVIS240C's own are the last row.
CASES: dict[str, dict[str, Any]] = {
    "none": {},
    "vignetting": {"effects": Effects(vignetting=4)},
    "lens_blur_px=1": {"effects": Effects(lens_blur_px=1)},
    "photoreceptor_bandwidth_hz=100": {"effects": Effects(photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(100))},
    "threshold_mismatch=0.3": {"effects": Effects(threshold_mismatch=0.3)},
    "refractory_period_us=5000": {"effects": Effects(refractory_period_us=5000)},
    "leak_rate_hz=1": {"effects": Effects(leak_rate_hz=1)},
    "shot_noise_rms=0.05": {"effects": Effects(shot_noise_rms=0.05)},
    "hot_pixels=0.005,rate_hz=500": {"effects": Effects(hot_pixels=HotPixels(0.005, 500))},
    "readout=1e6,drop_after_us=1000": {"effects": Effects(readout=Readout(1e6, drop_after_us=1000))},
    "aps=25000": {"effects": Effects(aps=Aps(25_000))},
    "--sensor davis240c, C 0.15": {"sensor": "davis240c", "contrast_threshold": 0.15, "contrast_threshold_off": 0.15},
}


DRAWN = (
    "none",
    "lens_blur_px=1",
    "photoreceptor_bandwidth_hz=100",
    "threshold_mismatch=0.3",
    "refractory_period_us=5000",
    "shot_noise_rms=0.05",
    "hot_pixels=0.005,rate_hz=500",
    "readout=1e6,drop_after_us=1000",
    "aps=25000",
)
"""The effects whose difference shows in 10 ms."""


def run(settings: dict[str, Any], start_s: float, stop_s: float) -> tuple[float, EventArray, Any]:
    """Seconds of processor time, events by the scene's clock, and the frame at the shown time's start."""
    simulator = Simulator(SCENE.crop(start_s, stop_s - start_s), depth_rate_hz=0, **settings)
    events, frame = [], None
    start = time.process_time()
    for packet in simulator.run():
        events.append(packet.events)
        if packet.end_us == round((SHOWN_S[0] - start_s) * 1e6):
            frame = packet.luma if packet.frame is None else packet.frame
    took = time.process_time() - start
    all_events = concatenate_events(events)
    all_events["t"] += round(start_s * 1e6)
    return took, all_events, frame


def main() -> None:
    """Run all cases in turn, print the table, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", help="the picture")
    parser.add_argument("--picture-only", action="store_true", help="no table: a tenth of the time")
    options = parser.parse_args()
    if options.output:
        draw({name: run(CASES[name], PICTURE_FROM_S, SHOWN_S[1])[1:] for name in DRAWN}, options.output)
    if not options.picture_only:
        print_table()


def print_table() -> None:
    """Run all cases in turn."""
    seconds: dict[str, list[float]] = {name: [] for name in CASES}
    found: dict[str, tuple[EventArray, Any]] = {}
    for _ in range(ROUNDS):
        for name, settings in CASES.items():
            took, *rest = run(settings, 0.0, SECONDS)
            seconds[name].append(took)
            found[name] = (rest[0], rest[1])
    base = statistics.median(seconds["none"])
    # A sensor's references begin elsewhere than ideal ones.
    stationary = run({"start_phase": "stationary"}, 0.0, SECONDS)[1]
    size = SCENE.own_camera.width, SCENE.own_camera.height
    print(f"{base:.2f} s of processor time without effects, {ROUNDS} rounds, medians")
    print(f"davis240c: {SENSORS['davis240c']}\n")
    print(
        "| effect | events | ON | missing | spurious | median shift | processor time |\n|---|---|---|---|---|---|---|"
    )
    for name, (events, _) in found.items():
        # Against the stream with the effect: what leaving it out gets wrong.
        ideal = stationary if name.startswith("--sensor") else found["none"][0]
        error = compare_events(ideal, events, size=size)
        on, times = 100 * np.mean(events["p"] != 0), statistics.median(seconds[name]) / base
        print(
            f"| {name} | {len(events):,} | {on:.1f} % | {error.missing_percent:.1f} % | "
            f"{error.spurious_percent:.1f} % | {error.median_us:.0f} us | {times:.2f} x |"
        )


def counts(events: EventArray) -> npt.NDArray[np.int64]:
    """Events of the shown time in the crop, by polarity and pixel: (2, H, W)."""
    camera = SCENE.own_camera
    shown = events[(events["t"] > SHOWN_S[0] * 1e6) & (events["t"] <= SHOWN_S[1] * 1e6)]
    found = np.zeros((2, camera.height, camera.width), np.int64)
    np.add.at(found, (shown["p"], shown["y"], shown["x"]), 1)
    return found[:, CROP[0], CROP[1]]


def draw(found: dict[str, tuple[EventArray, Any]], path: str) -> None:
    """Events in the middle of the sensor: what differs from ideal pixels in full colour, the rest pale."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 3, figsize=(7.2, 6.6), layout="constrained")
    ideal, ideal_frame = found["none"]
    without = counts(ideal)
    for axis, (name, (events, frame)) in zip(axes.flat, found.items(), strict=True):
        axis.set_xticks([])
        axis.set_yticks([])
        if name.startswith("aps"):
            image = np.array(frame[CROP])
            half = image.shape[1] // 2
            image[:, :half] = ideal_frame[CROP][:, :half]
            gain = 1 / np.quantile(ideal_frame, 0.999)
            axis.imshow(to_srgb(np.clip(gain * image, 0, 1)), cmap="gray", vmin=0, vmax=1)
            axis.axvline(half - 0.5, color="white", linewidth=1)
            axis.set_title(f"{name}\nframe: left without it, right with", fontsize=8)
            continue
        with_it = counts(events)
        off, on = with_it > 0
        image = np.full((*on.shape, 3), 255.0)
        image[off] = OFF_RGB
        image[on] = ON_RGB
        if name == "none":
            said = f"{with_it.sum():,} events in 10 ms"
        else:
            more, fewer = np.maximum(with_it - without, 0), np.maximum(without - with_it, 0)
            same = ~more.any(0)
            image[same] = 255 - SAME * (255 - image[same])
            image[fewer.any(0) & same] = LOST_RGB
            said = f"{more.sum():,} more, {fewer.sum():,} fewer"
        axis.imshow(image.astype(np.uint8), interpolation="nearest")
        axis.set_title(f"{name}\n{said}", fontsize=8)
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
