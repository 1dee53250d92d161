"""Sends Ctrl-C to every command at random instants, and judges how each ends.

    python tests/cli/signals.py --runs 500 --seed 1 [--only COMMAND ...]

A run has to end with status 130 and at most one line about the interruption, or as it does without Ctrl-C. It may
print no traceback, leave no process behind, and what has its final name has to be readable. Before the command line's
first line is reached, Python alone decides how to end. These runs are counted apart; their traceback names no file of
the package, or its ``__init__.py`` alone, which imports nothing before that line. A command's instants are drawn
evenly from the time that it takes. They are a function of the seed.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from davis_rs import Dataset, read_events

LONGEST_S = 120.0
"""Of what is left of a run after Ctrl-C."""

SMALL = ("--size", "40x30", "--rays-per-pixel", "1", "--quiet")
NOISE = re.compile(r"Traceback|Exception ignored|panicked|PanicException|Fatal Python error|Segmentation|core dumped")
BEFORE_THE_FIRST_LINE = f"davis_rs{os.sep}__init__.py"
INTERRUPTION = re.compile(r"Ctrl-C|KeyboardInterrupt|interrupted", re.IGNORECASE)


@dataclass
class Command:
    """A command: its words, where ``OUT`` stands for a place of each run's own, and what its result has to be."""

    words: Sequence[object]
    whole: Callable[[Path], None] = lambda _: None
    environment: dict[str, str] = field(default_factory=dict)
    takes_s: float = 0.0
    status: int = 0
    lines: frozenset[str] = frozenset()


@dataclass
class Run:
    """How a run ended."""

    status: int
    told: str
    left: list[str]


def dataset_is_whole(path: Path) -> None:
    """Raise, unless a dataset that has its description can be read."""
    if (path / "meta.json").exists():
        _ = Dataset(path).events


def events_are_whole(path: Path) -> None:
    """Raise, unless an event file that has its name can be read."""
    if path.exists():
        read_events(path)


def sequences_are_whole(path: Path) -> None:
    """Raise, unless every sequence that has its name can be read."""
    for sequence in path.glob("sequence_*"):
        dataset_is_whole(sequence)
        assert (sequence / "sha256sums.txt").exists(), f"{sequence} has its name, but no sums"


def commands(folder: Path, only: Sequence[str] | None) -> dict[str, Command]:
    """All commands, or some of them, with the inputs that these need, made in a folder."""
    data, board, plan = folder / "data", folder / "board", folder / "plan.yaml"
    camera, made = folder / "camera.raw", folder / "made"
    simulate: list[object] = ["simulate", "three_planes", "--duration", "0.05", *SMALL]
    quick = ["--rounds", 1, "--only", "fast", "--quiet"]
    complete = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": os.devnull,
        "COMP_LINE": "davis-rs simulate three_planes --contrast-threshold-",
        "COMP_POINT": "52",
        "COMP_TYPE": "9",
    }
    events = data / "events.txt"
    found = {
        "help": Command(["--help"]),
        "info": Command(["info", data]),
        "check": Command(["check", data]),
        "view": Command(["view", data, "-o", "OUT.png"]),
        "view-html": Command(["view", data, "--html", "OUT.html"]),
        "view-video": Command(["view", data, "--video", "OUT.gif"]),
        "convert": Command(["convert", data, "OUT.aedat4"], events_are_whole),
        "compare": Command(["compare", data, data]),
        "frames": Command(["frames", folder / "frames.npy", "--fps", 100, "--quiet", "-o", "OUT"], dataset_is_whole),
        "simulate": Command([*simulate, "-o", "OUT"], dataset_is_whole),
        "simulate-text": Command([*simulate, "--events-format", "text", "-o", "OUT"], dataset_is_whole),
        "generate": Command(["generate", plan, "-o", "OUT", "--workers", 2, "--quiet"], sequences_are_whole),
        "verify": Command(["verify", made]),
        "plan": Command(["plan", "three_planes", "--duration", "0.05", "--size", "40x30", "--rays-per-pixel", "1"]),
        "accuracy": Command(["accuracy", "three_planes", "-o", "OUT", "--duration", "0.03", "--size", "40x30", *quick]),
        "calibrate-sensor": Command(["calibrate", "sensor", events, "--size", "40x30", "-o", "OUT.yaml", "--quiet"]),
        "calibrate-intrinsics": Command(["calibrate", "intrinsics", board]),
        "calibrate-hand-eye": Command(["calibrate", "hand-eye", board]),
        "calibrate-camera-imu": Command(["calibrate", "camera-imu", board]),
        "record": Command(["record", "--virtual", "three_planes", "--duration", "0.05", "-o", "OUT.raw"]),
        "decode": Command(["decode", camera, "-o", "OUT.aedat4"], events_are_whole),
        "sensors": Command(["sensors"]),
        "completion": Command([], environment=complete),
    }
    found = {name: found[name] for name in only or found}
    np.save(folder / "frames.npy", np.random.default_rng(1).integers(0, 255, (6, 30, 40), np.uint8))
    plan.write_text("sequences: 3\nseed: 1\nscene: three_planes\nduration: 0.02\nrays_per_pixel: 1\nsize: 40x30\n")
    seldom = ["--frame-rate", 4, "--contrast-threshold", 2, "--accuracy", "fast", "--rays-per-pixel", 4, "--quiet"]
    inputs: dict[Path, list[object]] = {
        data: [*simulate, "--imu", "mpu6150", "-o", data],
        board: ["simulate", "checkerboard", "--duration", 4, "--imu", "ideal", *seldom, "-o", board],
        camera: ["record", "--virtual", "three_planes", "--duration", "0.05", "-o", camera],
        made: ["generate", plan, "-o", made, "--quiet"],
    }
    for path, words in inputs.items():
        if any(str(word).startswith(str(path)) for command in found.values() for word in command.words):
            prepare(words)
    return found


def prepare(words: Sequence[object]) -> None:
    """Run a command that makes an input."""
    done = subprocess.run(command_line(words, module=True), capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{words} ended with status {done.returncode}\n{done.stdout}{done.stderr}")


def command_line(words: Sequence[object], *, module: bool) -> list[str]:
    """How davis-rs is started: by its script, or by Python's -m."""
    script = Path(sys.executable).with_name("davis-rs")
    start = [sys.executable, "-m", "davis_rs.cli"] if module or not script.exists() else [str(script)]
    return [*start, *map(str, words)]


def run(command: Command, out: Path, *, module: bool, after_s: float | None, group: bool) -> Run:
    """Run a command in a session of its own; Ctrl-C comes after some seconds, to it alone or to all its processes."""
    line = command_line([str(word).replace("OUT", str(out)) for word in command.words], module=module)
    process = subprocess.Popen(
        line,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
        env={**os.environ, **command.environment},
    )
    if after_s is not None:
        time.sleep(after_s)
        if process.poll() is None:
            (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    try:
        told, _ = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        told, _ = process.communicate()
        told += f"\nit went on for more than {LONGEST_S:g} s"
    return Run(process.returncode, told, left_behind(process.pid))


def left_behind(session: int) -> list[str]:
    """Processes of a session that are still there after some seconds; they are ended."""
    for _ in range(50):
        left = [int(name) for name in os.listdir("/proc") if name.isdigit() and session_of(int(name)) == session]
        if not left:
            return []
        time.sleep(0.1)
    found = [f"{number}: {Path(f'/proc/{number}/cmdline').read_bytes()!r}" for number in left]
    for number in left:
        os.kill(number, signal.SIGKILL)
    return found


def session_of(number: int) -> int:
    """A process's session; 0 if it is gone, or only waits to be asked for its status."""
    try:
        words = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0
    return 0 if words[0] == "Z" else int(words[3])


def judge(command: Command, ended: Run, out: Path) -> tuple[str, str]:
    """How a run ended: one of a few kinds, and for a finding what was wrong."""
    noise = NOISE.search(ended.told)
    within = set(re.findall(rf"davis_rs{re.escape(os.sep)}[^\"]+", ended.told)) - {BEFORE_THE_FIRST_LINE}
    if noise and not within and (ended.status in (-signal.SIGINT, 130, 1)):
        return "before the first line", ""
    if ended.status == -signal.SIGINT and not ended.told:
        return "before the first line", ""
    if noise:
        return "finding", noise.group()
    if ended.left:
        return "finding", f"left behind: {ended.left}"
    if ended.status not in (130, command.status):
        return "finding", f"status {ended.status}"
    lines = [line for line in ended.told.splitlines() if INTERRUPTION.search(line) and line not in command.lines]
    if len(lines) > 1:
        return "finding", f"{len(lines)} lines about the interruption"
    if ended.status == 130 and not lines:
        return "finding", "no line about the interruption"
    try:
        for result in out.parent.glob(f"{out.name}*"):
            if not result.name.endswith(".part"):
                command.whole(result)
    except Exception as error:
        return "finding", f"its result cannot be read: {error}"
    return ("130" if ended.status == 130 else "to its end"), ""


def main() -> int:
    """Run, and print how the commands ended; 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", metavar="COMMAND", help="may be given several times")
    options = parser.parse_args()
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a program in the background ignores it, as its children do
    counts: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory(prefix="signals") as place:
        folder = Path(place)
        os.environ["DAVIS_RS_CACHE_DIR"] = str(folder / "cache")
        all_commands = commands(folder, options.only)
        names = list(all_commands)
        for name in names:
            command, began = all_commands[name], time.monotonic()
            whole = run(command, folder / f"whole_{name}", module=True, after_s=None, group=True)
            command.takes_s = time.monotonic() - began
            command.status, command.lines = whole.status, frozenset(whole.told.splitlines())
            if NOISE.search(whole.told):
                raise SystemExit(f"{name} does not run\n{whole.told}")
            print(f"{name}: {command.takes_s:.2f} s, status {command.status}", flush=True)
        draw = random.Random(options.seed)
        for number in range(options.runs):
            name = names[number % len(names)]
            command, counted = all_commands[name], counts.setdefault(name, Counter())
            after_s, module, group = draw.uniform(0, command.takes_s), draw.random() < 0.3, draw.random() < 0.7
            out = folder / f"out_{number}"
            ended = run(command, out, module=module, after_s=after_s, group=group)
            kind, wrong = judge(command, ended, out)
            counted[kind] += 1
            if wrong:
                way = f"{'-m' if module else 'script'}, {'all' if group else 'one'}"
                print(
                    f"run {number}: {name} after {after_s:.3f} s ({way}): {wrong}, status {ended.status}\n{ended.told}"
                )
                sys.stdout.flush()
    total = sum(counts.values(), Counter())
    for name, counted in [*counts.items(), ("all", total)]:
        print(
            f"{name}: {sum(counted.values())} runs, " + ", ".join(f"{n} {kind}" for kind, n in sorted(counted.items()))
        )
    return 1 if total["finding"] else 0


if __name__ == "__main__":
    sys.exit(main())
