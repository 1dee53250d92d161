"""Prints how a folder of foreign worlds fares: which files load, who renders them, and what keeps others from it.

    python benches/worlds.py FOLDER [--suffix .glb --suffix .xml] [--seconds 60] [--rows]

Each file is loaded in a process of its own, which may take a limited time. Nothing is rendered and no light is baked.
With --rows there is a row for each file: whether it loads, the renderer that ``auto`` takes, the first obstacle or
error, seconds, and the most memory. Then follow counts of each outcome, and of each obstacle.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

SUFFIXES = (".gltf", ".glb", ".obj", ".ply", ".xml")


class Row(NamedTuple):
    """What became of a file.

    Attributes:
        outcome: the renderer, or ``refused``, ``missing files``, ``too slow`` or ``crashed``.
        reason: the obstacles to rendering without noise, or the error; empty where there is neither.
        lost: kinds of looks that are not shown.
        seconds: to load it and to make the tables.
        megabytes: the most memory of its process.
    """

    outcome: str
    reason: list[str]
    lost: list[str]
    seconds: float
    megabytes: float


def examine(path: Path) -> Row:
    """Load one file in this process, and find who would render it."""
    from davis_rs import load_scene
    from davis_rs.render.choice import RENDERER_KINDS, NoiseFreeKind, why_not_noise_free
    from davis_rs.scene.lost_looks import BACKS

    start = time.perf_counter()
    lost: list[str] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = load_scene(path)
            free = (
                kind.name
                for kind in RENDERER_KINDS.values()
                if isinstance(kind, NoiseFreeKind) and kind.name != "table"
            )
            outcome = next((name for name in free if not RENDERER_KINDS[name].why_not(scene)), "integrator")  # type: ignore[attr-defined]
            shown = () if outcome == "integrator" else (BACKS,)  # the native renderer culls them
            lost = sorted({look.what for look in scene.lost_looks} - set(shown))
            reason = [] if outcome != "integrator" else [str(obstacle.rule) for obstacle in why_not_noise_free(scene)]
    except FileNotFoundError as error:
        outcome, reason = "missing files", [str(error)]
    except (ValueError, OSError, ImportError) as error:
        outcome, reason = "refused", [str(error)]
        no_file = re.search(r"does not exist|not found|is not there|No such file", reason[0])
        if no_file and "[PluginManager]" not in reason[0]:
            outcome = "missing files"
    reason = [text.replace(str(path), path.name) for text in reason]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Row(outcome, reason, lost, time.perf_counter() - start, memory)


def examined(path: Path, limit_s: float) -> Row:
    """Examine one file in a process of its own."""
    try:
        done = subprocess.run(
            [sys.executable, __file__, "--only", str(path)],
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Row("too slow", [f"more than {limit_s:g} s"], [], limit_s, 0.0)
    if done.returncode:
        return Row("crashed", [done.stderr.strip().rpartition("\n")[2]], [], 0.0, 0.0)
    # Mitsuba's plug-ins print lines of their own, in colour.
    printed = re.sub(r"\x1b\[\d*m", "", done.stdout)
    last = next((line for line in reversed(printed.splitlines()) if line.startswith('["')), None)
    return Row("crashed", ["no result"], [], 0.0, 0.0) if last is None else Row(*json.loads(last))


def is_world(path: Path, suffixes: tuple[str, ...]) -> bool:
    """Return whether a file is of a kind that is read; an XML file is one if it has a scene."""
    if path.suffix.lower() not in suffixes or not path.is_file():
        return False
    return path.suffix.lower() != ".xml" or "<scene" in path.read_text("utf-8", "replace")


def table(counts: Counter[str]) -> None:
    """Print counts, the largest first."""
    for what, count in counts.most_common():
        print(f"{count:5d}  {what}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--suffix", action="append", help=f"of files to take (if not given: {', '.join(SUFFIXES)})")
    parser.add_argument("--seconds", type=float, default=60.0, help="a file may take (if not given: 60)")
    parser.add_argument("--rows", action="store_true", help="print a row for each file")
    parser.add_argument("--only", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.only:
        print(json.dumps(examine(given.folder)))
        return
    suffixes = tuple(given.suffix or SUFFIXES)
    outcomes, obstacles, looks = Counter[str](), Counter[str](), Counter[str]()
    for path in sorted(path for path in given.folder.rglob("*") if is_world(path, suffixes)):
        row = examined(path, given.seconds)
        kind = "glTF" if path.suffix in (".gltf", ".glb") else "XML" if path.suffix == ".xml" else "mesh"
        outcomes[f"{kind}: {row.outcome}"] += 1
        looks.update(row.lost)
        obstacles.update({re.sub(r"\d[\d,.]*|'[^']*'|/\S+|\[\d+\]", "_", reason)[:110] for reason in row.reason})
        if given.rows:
            name = str(path.relative_to(given.folder))
            print(
                f"{name[-60:]:60s} {row.outcome:13s} {row.seconds:6.1f} s {row.megabytes:6.0f} MB  "
                f"{'; '.join(row.reason)[:300]}",
                flush=True,
            )
    for title, counts in (("outcome", outcomes), ("obstacle or error, files", obstacles), ("lost look, files", looks)):
        print(f"\n{title}")
        table(counts)


if __name__ == "__main__":
    main()
