"""The paper's table beside our own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Rows

import numpy as np

from ..sequences import PaperRow, Sequence
from .count import EventCount

HEAD = ("sequence", "motion", "lens", "biases", "T [s]", "ours", "TS [m/s]", "ours", "RS [deg/s]", "ours", "NE", "ours")


def measured_row(sequence: Sequence, count: EventCount | None) -> PaperRow:
    """The paper's columns for the simulated twin; 0 events where they were not counted.

    Top speeds are those of :meth:`~davis_rs.Trajectory.top_speeds`.
    """
    trajectory = sequence.scene().trajectory
    assert trajectory is not None
    top = trajectory.top_speeds()
    events = 0 if count is None else count.events
    return PaperRow(trajectory.duration_s, top.speed_m_s, float(np.degrees(top.rate_rad_s)), events)


def table(sequences: Iterable[Sequence], counts: Mapping[str, EventCount]) -> list[tuple[str, ...]]:
    """A row of cells for each sequence, in the order of :data:`HEAD`; a ``-`` is not counted."""
    rows: list[tuple[str, ...]] = []
    for sequence in sequences:
        paper, ours = sequence.paper, measured_row(sequence, counts.get(sequence.name))
        rows.append(
            (
                sequence.name,
                sequence.motion,
                sequence.camera,
                sequence.biases or "-",
                f"{paper.duration_s:.1f}",
                f"{ours.duration_s:.1f}",
                _cell(paper.speed_m_s, 2),
                _cell(ours.speed_m_s, 2),
                _cell(paper.rate_deg_s, 0),
                _cell(ours.rate_deg_s, 0),
                f"{paper.events:,}",
                f"{ours.events:,}" if ours.events else "-",
            )
        )
    return rows


def as_text(rows: Rows[Rows[str]]) -> str:
    """Columns of equal width under :data:`HEAD`, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(HEAD, *rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if place < 4 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in (HEAD, *rows)
    )


def as_markdown(rows: Rows[Rows[str]]) -> str:
    """The same as a table of Markdown."""
    lines = [HEAD, ["---"] * 4 + ["--:"] * (len(HEAD) - 4), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: float | None, digits: int) -> str:
    return "n/a" if value is None else f"{value:.{digits}f}"
