"""Writes how well a recording is reproduced: as a table for people, and as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from ..inspection.statistics.stream_statistics import Measured
from .reproduced import ReproducedHalf, Row


def text_of(half: ReproducedHalf) -> str:
    """Return the tables of a half."""
    heading = f"\n{heading_of(half)}; log_eps {half.log_eps}"
    return "\n".join([heading, _statistics(half), _agreement(half)])


def heading_of(half: ReproducedHalf) -> str:
    """Say in one line which half was fitted, and which one compared."""
    other = "second" if half.half.name == "first" else "first"
    seconds = (half.half.stop_us - half.half.start_us) * 1e-6
    return (
        f"fitted to the {other} half, compared with the {half.half.name} half: frames {half.half.frames[0]} to "
        f"{half.half.frames[-1]}, {seconds:.4g} s, {len(half.streams['real']):,} events"
    )


def csv_of(halves: Sequence[ReproducedHalf]) -> str:
    """Return all numbers as CSV: a line for each half, statistic and stream."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["half", "statistic", "unit", "stream", "value", "sigma", "z", "judged"])
    for half in halves:
        for row in (*half.rows, *half.agreement):
            streams = [("real", row.real, math.nan), *((name, *told) for name, told in row.others.items())]
            for name, value, z in streams:
                numbers = ("" if not math.isfinite(one) else repr(one) for one in (*value, z))
                writer.writerow([half.half.name, row.name, row.unit, name, *numbers, "yes" if row.judged else "no"])
    return out.getvalue()


def _statistics(half: ReproducedHalf) -> str:
    streams = [name for name in half.streams if name != "real"]
    rows = [["", "real", *(cell for name in streams for cell in (name, "z"))]]
    for row in half.rows:
        cells = [_name(row), str(row.real)]
        for name in streams:
            value, z = row.others[name]
            score = f"{z:+.1f}" if math.isfinite(z) else "-"
            cells += [str(value), score if row.judged else "not judged"]
        rows.append(cells)
    counted = ["within 3 sigma", ""]
    for name in streams:
        counted += ["{} of {}".format(*half.within(name)), ""]
    return _aligned([*rows, counted])


def _agreement(half: ReproducedHalf) -> str:
    streams = [name for name in half.streams if name != "real"]
    rows = [["", "real: half/half", "half/all", *streams]]
    for row, whole in zip(half.agreement, half.whole_ceiling, strict=True):
        cells = [Measured(*row.others[name][0]) for name in streams]
        rows.append([row.name, str(row.real), f"{whole:.3g}", *map(str, cells)])
    return "\n" + _aligned(rows)


def _name(row: Row) -> str:
    return f"{row.name}{f' [{row.unit}]' if row.unit else ''}"


def _aligned(rows: list[list[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows)
