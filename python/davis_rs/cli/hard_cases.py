"""Runs davis-rs hard-cases."""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import sys
from pathlib import Path

from .._core import __version__
from .._util.progress import each, say
from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from ..accuracy.hard_case_scenes import hard_cases
from ..accuracy.hard_cases import HardCaseResult, hard_cases_page, measure_hard_cases
from ..accuracy.report import processor
from ..sampling.presets import ACCURACY
from .ctrl_c import LINE


def add_hard_cases(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.description = (
        "Measure the presets of accuracy on small scenes in which sampling is easily wrong (sudden motion and light, "
        "thin wires, long lenses), against brute force. Writes hard_cases.md; Ctrl-C keeps what was measured."
    )
    command.set_defaults(run=_hard_cases)
    command.add_argument("-o", "--output", required=True, type=Path, metavar="DIR", help="the folder to write")
    command.add_argument("--only", metavar="TEXT", help="only cases whose name has this in it")
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def _hard_cases(options: argparse.Namespace) -> int:
    cases = [case for case in hard_cases() if options.only is None or options.only in case.name]
    if not cases:
        names = ", ".join(case.name for case in hard_cases())
        raise ValueError(f"no hard case has {options.only!r} in its name; there are {names}")
    options.output.mkdir(parents=True, exist_ok=True)
    page: Path = options.output / "hard_cases.md"
    facts = {
        "machine": f"{processor()}, {os.cpu_count()} logical CPUs; Python {platform.python_version()}; "
        f"davis_rs {__version__}",
        "command": f"`davis-rs {shlex.join(sys.argv[1:])}`",
    }
    results: list[HardCaseResult] = []
    interrupted = False
    try:
        runs = measure_hard_cases(cases)
        for result in each(runs, "hard cases", len(cases) * len(ACCURACY), unit="runs", show=not options.quiet):
            results.append(result)
    except KeyboardInterrupt:
        say(LINE)
        interrupted = True
        facts["interrupted"] = "these are the cases measured until then"
    if results:
        write_whole(page, hard_cases_page(results, facts))
        tell(page)
    return 130 if interrupted else 0
