"""Mutates files of every kind that the package reads, and reads the mutants.

    python tests/fuzz/readers.py --mutants 100000 --seed 1 [--target NAME ...]

A finding is a mutant upon which a reader dies, goes on for more than 2 s of processor time, takes more than 200 MB
beyond the file's own size, raises something else than its documented error, warns of something that is not its own, or
gives events that break the rules. Mutants are a function of (seed, target, number), so that a finding can be had again
by ``--target NAME --first NUMBER --mutants 1``; its file is kept in the folder of ``--keep``.

Mutants are read in child processes, each of which goes from one to the next until it dies.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import random
import resource
import shutil
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1] / "helpers"), str(Path(__file__).parent)]

MOST_SECONDS = 2.0
MOST_BYTES = 200 << 20
MOST_SILENT_SECONDS = 20.0
"""Of a child's processor time, without a word of it."""
MOST_BLOCKED_SECONDS = 600.0
"""By the wall clock, for a child that waits rather than works; the machine may be busy with other things."""
ADDRESS_SPACE = 3 << 30
"""Of a child: above what libraries reserve, below the 4 GiB that a length of 32 bits can ask for."""


@dataclass
class Result:
    """Of a target: how many mutants were read, how many of them were still whole, and what was found."""

    target: str
    mutants: int = 0
    accepted: int = 0
    findings: list[str] = field(default_factory=list)
    slowest_s: float = 0.0
    largest_bytes: int = 0


def child(say: Connection, target_name: str, seed: int, numbers: range, folder: Path, keep: Path | None) -> None:
    """Read mutants, and tell of each before it is read and after."""
    import davis_rs
    from mutate import mutant
    from targets import TARGETS

    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(5)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries talk
    own = {davis_rs.TruncatedFileWarning, davis_rs.RecordingWarning}
    target = TARGETS[target_name]
    seeds = target.make(folder)
    contents = [path.read_bytes() for path in seeds]
    for path in seeds:  # whatever is imported late, is imported now; and what is whole must be read
        whole = folder / ("whole" + path.suffix)
        shutil.copy(path, whole)
        target.read(whole, random.Random(0))
    for path in target.harmful(folder):
        contents.append(path.read_bytes())
        try:
            target.read(path, random.Random(0))
        except target.allowed:
            continue
        raise AssertionError(f"{path.name} was read, and must be refused")
    gc.collect()
    gc.freeze()
    for number in numbers:
        rng = random.Random(f"{seed}/{target_name}/{number}")
        data = mutant(contents, rng)
        path = folder / f"mutant{seeds[0].suffix}"
        path.write_bytes(data)
        say.send({"begin": number})
        before, found, accepted = _reset_peak(), None, False
        started = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                target.read(path, rng)
                accepted = True
            except AssertionError as error:
                found = f"nonsense: {str(error)[:200]}"
            except target.allowed:
                pass
            except BaseException as error:
                found = f"{type(error).__module__}.{type(error).__name__}: {str(error)[:200]}"
            gc.collect()  # a file that was left open is warned of when it is found
        seconds = time.process_time() - started
        grown = max(0, _peak() - before) - len(data)
        others = {
            str(one.category.__name__): str(one.message)[:100]
            for one in caught
            if one.category not in own and not str(one.message).startswith(target.warns)
        }
        if found is None and others:
            found = f"warnings: {others}"
        if found is None and seconds > MOST_SECONDS:
            found = f"took {seconds:.1f} s"
        if found is None and grown > MOST_BYTES:
            found = f"took {grown >> 20} MB"
        if found is not None:
            _keep(folder, keep, f"{target_name}-{seed}-{number}")
        say.send({"accepted": accepted, "found": found, "seconds": seconds, "grown": grown})


def _processor_seconds(pid: int | None) -> float:
    """What a process has used; 0 once it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _reset_peak() -> int:
    """Have the peak of memory begin anew; returns what is held now."""
    Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def _peak() -> int:
    return _status("VmHWM")


def _status(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) << 10
    return 0


def fuzz(target: str, seed: int, mutants: int, *, first: int = 0, keep: Path | None = None) -> Result:
    """Read ``mutants`` mutants of a target's files."""
    import targets  # noqa: F401 - what is imported here, children need not import

    result = Result(target)
    number, end = first, first + mutants
    context = multiprocessing.get_context("fork")
    while number < end:
        with tempfile.TemporaryDirectory() as folder:
            hear, say = context.Pipe(duplex=False)
            process = context.Process(target=child, args=(say, target, seed, range(number, end), Path(folder), keep))
            process.start()
            say.close()
            death, number, begun = _follow(process, hear, result, number)
            if not begun and death is not None:
                raise RuntimeError(f"{target}: the reader cannot begin: {death}")
            if death is not None:
                result.findings.append(f"{target} {number}: {death}")
                result.mutants += 1
                _keep(Path(folder), keep, f"{target}-{seed}-{number}")
            number += 1
    return result


def _keep(folder: Path, keep: Path | None, name: str) -> None:
    """Copy the mutant that is read now."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        for path in folder.glob("mutant*"):
            shutil.copy(path, keep / f"{name}{path.suffix}")


def _follow(process: BaseProcess, hear: Connection, result: Result, number: int) -> tuple[str | None, int, bool]:
    """Listen to a child until it ends: how it died, if it did, at which mutant, and whether it read one at all."""
    begun = False
    with hear:
        while True:
            used = _processor_seconds(process.pid)
            waited = time.monotonic()
            while not hear.poll(1.0):
                if not process.is_alive():
                    break
                silent = time.monotonic() - waited
                if _processor_seconds(process.pid) - used > MOST_SILENT_SECONDS or silent > MOST_BLOCKED_SECONDS:
                    process.kill()
                    process.join()
                    return f"hangs for {silent:.0f} s", number, begun
            try:
                said = hear.recv()
            except EOFError:
                break
            if "begin" in said:
                begun, number = True, said["begin"]
                continue
            result.mutants += 1
            result.accepted += said["accepted"]
            result.slowest_s = max(result.slowest_s, said["seconds"])
            result.largest_bytes = max(result.largest_bytes, said["grown"])
            if said["found"] is not None:
                result.findings.append(f"{result.target} {number}: {said['found']}")
    process.join()
    return None if process.exitcode == 0 else f"died with status {process.exitcode}", number, begun


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--mutants", type=int, default=1000, help="of all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target", action="append", help="only this one; may be given again")
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    parser.add_argument("--keep", type=Path, help="a folder for the mutants that are findings")
    options = parser.parse_args()
    from targets import TARGETS

    names = options.target or list(TARGETS)
    each = -(-options.mutants // len(names))
    findings = 0
    for name in names:
        result = fuzz(name, options.seed, each, first=options.first, keep=options.keep)
        print(
            f"{name}: {result.mutants} mutants, {result.accepted} read, {len(result.findings)} findings; at most "
            f"{result.slowest_s:.2f} s and {result.largest_bytes / 1e6:.0f} MB",
            flush=True,
        )
        for found in result.findings:
            print(f"  {found}", flush=True)
        findings += len(result.findings)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
