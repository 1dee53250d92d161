"""The crossing engine next to other simulators' event generators, on the same log intensity: a markdown table.

python benches/peers_engine.py [--rounds 5]

A pattern of three moving sines, its log intensity known at every instant, is given to each program that can be
imported; nothing is installed. All run in turn, on one core, in each round; the time is the processor's, the best of
all rounds. Their events are matched with ours of the same frames. Peers: the rule in NumPy and in numba, v2e's
``v2ecore``, EventCV, OpenEB's ``make_events_cpu`` (with its ``EventCD``), and esim_py, which reads images of 8 bits
from files: it has a table of its own, on frames of 8 bits, which both read from the files.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import logging
import math
import os
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from davis_rs import EVENT_DTYPE, CrossingEngine, compare_events
from davis_rs.events.arrays import EventArray, concatenate_events

C, GAP_US = 0.15, 1000
Frames = npt.NDArray[np.float64]
"""Log intensity, shape (n, height, width), -2.25..-0.05."""


class Input(NamedTuple):
    width: int
    height: int
    frames: int
    step_px: float


class Peer(NamedTuple):
    """``prepare`` is not timed, ``run`` is, and ``events`` makes our events of what it returned."""

    prepare: Callable[[Frames], Any]
    run: Callable[[Any], Any]
    events: Callable[[Any], EventArray]


INPUTS = {
    "dense": Input(240, 180, 100, 1 / 3),
    "quiet": Input(240, 180, 100, 0.02),
    "1280x720": Input(1280, 720, 16, 1 / 3),
}


def pattern(size: Input) -> Frames:
    """Three plane waves of 9 to 31 pixels that move by ``step_px`` a frame."""
    y, x = np.mgrid[: size.height, : size.width].astype(np.float64)
    waves = ((9.3, 0.4), (17.1, 1.9), (31.7, -0.8))
    frames = []
    for k in range(size.frames):
        phases = [
            2 * math.pi / length * (x * math.cos(angle) + y * math.sin(angle) - k * size.step_px)
            for length, angle in waves
        ]
        frames.append(-1.15 + 1.1 * np.mean(np.sin(phases), axis=0))
    return np.stack(frames)


def from_columns(t: Any, x: Any, y: Any, p: Any) -> EventArray:
    """Events sorted by time, of columns of numbers."""
    events = np.zeros(len(t), EVENT_DTYPE)
    for name, column in (("t", t), ("x", x), ("y", y), ("p", p)):
        events[name] = column
    return events[np.lexsort((events["x"], events["y"], events["t"]))]


def ours(frames: Frames) -> list[EventArray]:
    engine = CrossingEngine(frames.shape[2], frames.shape[1], contrast_threshold=C, threads=1)
    return [engine.push_log(GAP_US * k, frame) for k, frame in enumerate(frames)]


def by_hand(frames: Frames) -> list[EventArray]:
    """The rule in NumPy: float64 references that are added up, linear interpolation, sorted in each frame."""
    reference, before, packets = frames[0].copy(), frames[0], []
    for k, log in enumerate(frames[1:]):
        steps = np.trunc((log - reference) / C).astype(np.int64)
        y, x = np.nonzero(steps)
        count, sign = np.abs(steps[y, x]), np.sign(steps[y, x])
        of = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 1
        a, b = before[y, x][of], log[y, x][of]
        fraction = (reference[y, x][of] + sign[of] * step * C - a) / (b - a)
        t = GAP_US * k + np.ceil(fraction * GAP_US).astype(np.int64)
        order = np.lexsort((x[of], y[of], t))
        events = np.zeros(len(of), EVENT_DTYPE)
        for name, column in (("t", t), ("x", x[of]), ("y", y[of]), ("p", sign[of] > 0)):
            events[name] = column[order]
        packets.append(events)
        reference += steps * C
        before = log
    return packets


def numba_loop() -> Peer:
    """The loop over pixels that one writes in numba: float64 references that are added up, one sort a frame."""
    import numba

    @numba.njit  # type: ignore[misc]
    def levels_reached(room: Any, reference: Any, before: Any, log: Any, begin_us: int) -> int:
        n = 0
        for y in range(log.shape[0]):
            for x in range(log.shape[1]):
                a, b, level = before[y, x], log[y, x], reference[y, x]
                while b >= level + C or b <= level - C:
                    on = b > level
                    level += C if on else -C
                    event = room[n]
                    event["t"] = begin_us + math.ceil(GAP_US * (level - a) / (b - a))
                    event["x"], event["y"], event["p"] = x, y, on
                    n += 1
                reference[y, x] = level
        return n

    def run(frames: Frames) -> list[EventArray]:
        room = np.zeros(4 * frames[0].size, EVENT_DTYPE)
        reference, before, found = frames[0].copy(), frames[0], []
        for k, log in enumerate(frames[1:]):
            events = room[: levels_reached(room, reference, before, log, GAP_US * k)]
            found.append(events[np.argsort(events["t"])])
            before = log
        return found

    return Peer(lambda frames: frames, run, concatenate_events)


def v2e() -> Peer:
    """All noise off; log intensity as float32, which its option ``hdr`` takes."""
    import torch
    from v2ecore.emulator import EventEmulator

    torch.set_num_threads(1)
    logging.disable(logging.WARNING)

    def run(frames: npt.NDArray[np.float32]) -> list[Any]:
        emulator = EventEmulator(C, C, 0.0, 0.0, 0.0, 0.0, 0.0, device="cpu", hdr=True)
        found = [emulator.generate_events(frame, GAP_US * k / 1e6) for k, frame in enumerate(frames)]
        return [part for part in found if part is not None and len(part)]

    def events(found: list[Any]) -> EventArray:
        t, x, y, p = np.concatenate(found).astype(np.float64).T
        return from_columns(np.rint(t * 1e6), x, y, p > 0)

    return Peer(lambda frames: frames.astype(np.float32), run, events)


def eventcv(upsample: str) -> Peer:
    """All noise off; it takes sRGB and is given that of exp(L), which lies where its lin-log curve is a logarithm."""
    import eventcv as module

    def prepare(frames: Frames) -> npt.NDArray[np.float32]:
        return np.asarray(1.055 * np.exp(frames) ** (1 / 2.4) - 0.055, np.float32)

    def run(srgb: npt.NDArray[np.float32]) -> Any:
        options: dict[str, Any] = {"sigma_thres": 0.0, "refractory_us": 0, "cutoff_hz": 0.0}
        options |= {"leak_rate_hz": 0.0, "shot_noise_rate_hz": 0.0, "upsample": upsample}
        return module.simulate(srgb, fps=1e6 / GAP_US, pos_thres=C, neg_thres=C, **options)

    def events(stream: Any) -> EventArray:
        x, y, t, p = np.asarray(stream.numpy()).astype(np.int64).T
        return from_columns(t, x, y, p > 0)

    return Peer(prepare, run, events)


def openeb() -> Peer:
    """Its loop over pixels, compiled by numba before the first round."""
    from metavision_core_ml.video_to_event.single_image_make_events_cpu import make_events_cpu
    from metavision_sdk_base import EventCD

    def prepare(frames: Frames) -> tuple[Frames, npt.NDArray[Any]]:
        return frames, np.zeros(2 * frames[0].size, EventCD)

    def run(prepared: tuple[Frames, npt.NDArray[Any]]) -> list[Any]:
        frames, room = prepared
        reference, before = frames[0].copy(), frames[0]
        last, c = np.zeros(before.shape, np.int32), np.full(before.shape, C)
        found = []
        for k, log in enumerate(frames[1:]):
            count, _ = make_events_cpu(room, reference, before, last, log, GAP_US * k, GAP_US, c, c, 0)
            assert count < len(room) - 1, "more events than there is room for"
            found.append(room[:count][np.argsort(room["t"][:count])].copy())
            before = log
        return found

    return Peer(prepare, run, lambda found: from_columns(*(np.concatenate(found)[name] for name in "txyp")))


PEERS: dict[str, Callable[[], Peer]] = {
    "NumPy by hand": lambda: Peer(lambda frames: frames, by_hand, concatenate_events),
    "numba by hand": numba_loop,
    "OpenEB": openeb,
    "v2e": v2e,
    "EventCV, upsample off": lambda: eventcv("off"),
    "EventCV, upsample adaptive": lambda: eventcv("adaptive"),
}


def esim_py() -> Peer:
    """Its simulator, on PGM files whose grey, over 255, it takes as log intensity."""
    from esim_py import EventSimulator

    def run(paths: list[str]) -> Any:
        simulator = EventSimulator(C / 2.3, C / 2.3, 0.0, 1e-3, False)
        return simulator.generateFromStampedImageSequence(paths, [GAP_US * k / 1e6 for k in range(len(paths))])

    return Peer(
        lambda paths: paths, run, lambda e: from_columns(np.ceil(e[:, 2] * 1e6 - 1e-6), e[:, 0], e[:, 1], e[:, 3] > 0)
    )


def ours_of_files(size: Input) -> Callable[[list[str]], list[EventArray]]:
    def run(paths: list[str]) -> list[EventArray]:
        engine = CrossingEngine(size.width, size.height, contrast_threshold=C / 2.3, threads=1)
        count = size.width * size.height
        return [
            engine.push_log(
                GAP_US * k,
                np.fromfile(path, np.uint8)[-count:].reshape(size.height, size.width).astype(np.float32)
                / np.float32(255),
            )
            for k, path in enumerate(paths)
        ]

    return run


def write_pgm(folder: Path, frames: Frames) -> list[str]:
    """Files of 8 bits: 0 is a log intensity of -2.3, 255 one of 0."""
    paths = []
    for k, frame in enumerate(frames):
        grey = np.rint((frame + 2.3) / 2.3 * 255).astype(np.uint8)
        path = folder / f"{k:04}.pgm"
        path.write_bytes(b"P5\n%d %d\n255\n" % (grey.shape[1], grey.shape[0]) + grey.tobytes())
        paths.append(str(path))
    return paths


def compared(name: str, size: Input, source: Any, mine: Callable[[Any], Any], peers: dict[str, Peer], n: int) -> None:
    """Print our row and the peers'."""
    runs: dict[str, Callable[[], Any]] = {"davis_rs": lambda: mine(source)}
    for peer, what in peers.items():
        prepared = what.prepare(source)
        runs[peer] = lambda what=what, prepared=prepared: what.run(prepared)  # type: ignore[misc]
    seconds, found = dict.fromkeys(runs, math.inf), {}
    for peer, run in runs.items():  # compilers and caches warm up, and the events are the same every time
        found[peer] = run()
    for _ in range(n):
        for peer, run in runs.items():
            begin = time.process_time()
            run()
            seconds[peer] = min(seconds[peer], time.process_time() - begin)
    reference = concatenate_events(found["davis_rs"])
    pixels = size.width * size.height * (size.frames - 1)
    for peer, taken in seconds.items():
        events = reference if peer == "davis_rs" else peers[peer].events(found[peer])
        on = int((events["p"] != 0).sum())
        cells = [name, peer, f"{on:,}", f"{len(events) - on:,}"]
        if peer == "davis_rs":
            cells += ["", "", "", ""]
        else:
            match = compare_events(events, reference, size=(size.width, size.height), window_us=2 * GAP_US)
            cells += [f"{match.missing_percent:.3f}", f"{match.spurious_percent:.3f}"]
            cells += [f"{match.median_us:.0f}", f"{match.p99_us:.0f}"]
        cells += [f"{pixels / taken / 1e6:.0f}", f"{taken / seconds['davis_rs']:.1f}"]
        print(f"| {' | '.join(cells)} |", flush=True)


def head() -> None:
    print(
        "| input | program | ON | OFF | missing, % | spurious, % | stamps, median us | p99 us | Mpixel/s | times ours |"
    )
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|---:|")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    os.environ["RAYON_NUM_THREADS"] = "1"
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    peers = {}
    for name, load in PEERS.items():
        try:
            peers[name] = load()
        except ImportError as error:
            print(f"{name} is left out: {error}")
    head()
    for name, size in INPUTS.items():
        compared(name, size, pattern(size), ours, peers, options.rounds)
    try:
        esim = {"esim_py": esim_py()}
    except ImportError as error:
        print(f"\nesim_py is left out: {error}")
    else:
        print()
        head()
        for name, size in INPUTS.items():
            with tempfile.TemporaryDirectory() as folder:
                paths = write_pgm(Path(folder), pattern(size))
                compared(f"{name}, 8 bits", size, paths, ours_of_files(size), esim, options.rounds)
    versions = [f"Python {platform.python_version()}"]
    for name in ("davis_rs", "numpy", "eventcv", "numba", "torch"):
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    print(f"\n{', '.join(versions)}")


if __name__ == "__main__":
    main()
