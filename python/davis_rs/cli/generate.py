"""Runs davis-rs generate."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from .._util.terminal_text import tell
from ..generate import generate_sequences, load_sequence_plan, verify_sequences

SHOWN = 1000
"""Sequences that --dry-run checks and shows."""


def add_generate(generate: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    generate.description = (
        "Simulate the sequences of a plan (docs/generate.md), each into a folder of its own. Run the same command "
        "again to resume a run that was ended or killed."
    )
    generate.set_defaults(run=_generate)
    generate.add_argument("plan", metavar="PLAN.yaml", help="what is drawn, and from which distributions")
    generate.add_argument("-o", "--output", metavar="ROOT", help="the folder of the sequences")
    generate.add_argument("--dry-run", action="store_true", help="check the plan and print what would be drawn")
    where = generate.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes; one a core if not given")
    where.add_argument(
        "--cluster", metavar="ADDRESS", help="a Dask scheduler, or its scheduler file; ROOT must be shared"
    )
    generate.add_argument("--quiet", action="store_true", help="no progress bar, only the last lines")


def add_verify(verify: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    verify.description = "Read all sequences in ROOT and compare them with its manifest."
    verify.set_defaults(run=_verify)
    verify.add_argument("root", type=Path, metavar="ROOT", help="the folder of the sequences")


def _generate(options: argparse.Namespace) -> int:
    plan = load_sequence_plan(options.plan)
    if options.dry_run:
        from ..generate.generate import check_sequences, draw_sequences

        drawn = draw_sequences(plan)[:SHOWN]
        check_sequences(plan, drawn, quiet=options.quiet)
        tell("\n".join(_table({one.name: dict(_flat(one.parameters)) for one in drawn})))
        if plan.sequences > SHOWN:
            tell(f"... these are the first {SHOWN} of {plan.sequences} sequences; the others were not looked at")
        return 0
    if options.output is None:
        raise ValueError("-o ROOT must be given: the folder of the sequences")
    generated = generate_sequences(
        plan, options.output, workers=options.workers, cluster=options.cluster, quiet=options.quiet
    )
    for name, error in generated.failed.items():
        tell(f"davis-rs: error: {name}: {error}", file=sys.stderr)
    tell(generated)
    return 1 if generated.failed else 0


def _verify(options: argparse.Namespace) -> int:
    from ..generate.verify import added_files

    root: Path = options.root
    wrong = verify_sequences(root)
    for name, added in added_files(root).items():
        tell(f"{root / name}: there are other files than those that it was made with: {', '.join(added)}")
    for name, fault in wrong.items():
        tell(f"{root / name}: {fault}")
    tell(f"{root}: {len(wrong)} sequences have changed" if wrong else f"{root}: all files are unchanged")
    return 1 if wrong else 0


def _flat(parameters: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, _short(value)


def _short(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)


def _table(rows: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Write what all sequences have in common once, and then a row for each."""
    keys = list(dict.fromkeys(key for row in rows.values() for key in row))
    values = {key: [row.get(key, "-") for row in rows.values()] for key in keys}
    common = [key for key in keys if len(set(values[key])) == 1]
    columns: list[Sequence[str]] = [["", *rows]]
    columns += [[key, *values[key]] for key in keys if key not in common]
    widths = [max(map(len, column)) for column in columns]
    lines = [f"{key}: {values[key][0]}" for key in common]
    for row in zip(*columns, strict=True):
        lines.append("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    return lines
