"""What long-lived programs keep: python benches/lifetimes.py objects [COUNT] | hours [SECONDS]

`objects` makes simulators one after the other, each of which runs for 0.05 s and is dropped. `hours` runs one of them
for an hour of simulated time, at a small size and rate. Both print resident memory, threads and open files on the way.
"""

import os
import sys
import time

from memory import laps, resident_mb

import davis_rs

SMALL = {"size": (24, 18), "rays_per_pixel": 1, "depth_rate_hz": 0.0, "frame_rate_hz": 1.0}


def told(what: str) -> None:
    """One line of what this process holds."""
    threads, files = len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))
    print(f"{what}: {resident_mb():6.0f} MB resident, {threads} threads, {files} open files", flush=True)


def objects(count: int) -> None:
    """The number of simulators in one process."""
    scene = davis_rs.load_scene("three_planes")
    for number in range(1, count + 1):
        simulator = davis_rs.Simulator(scene.crop(0.0, 0.05), **SMALL)
        events = sum(len(packet.events) for packet in simulator.run())
        del simulator
        if number in (1, 2, 5) or number % 20 == 0:
            told(f"{number:4} simulators, {events} events each")


def hours(duration_s: float) -> None:
    """One simulator, for so long."""
    scene = davis_rs.load_scene("three_planes")
    moving = scene.with_trajectory(laps(scene, duration_s))
    simulator = davis_rs.Simulator(moving, render_rate_hz=1.0, **SMALL)
    events, next_s, started = 0, 1.0, time.perf_counter()
    for packet in simulator.run():
        events += len(packet.events)
        if packet.end_us * 1e-6 >= next_s:
            told(f"{next_s:6.0f} s simulated in {time.perf_counter() - started:.0f} s, {events:,} events")
            next_s = 10.0 if next_s < 10.0 else next_s + duration_s / 12


if __name__ == "__main__":
    kind, *rest = sys.argv[1:] or ["objects"]
    {"objects": lambda: objects(int(rest[0]) if rest else 200), "hours": lambda: hours(float((rest or ["3600"])[0]))}[
        kind
    ]()
