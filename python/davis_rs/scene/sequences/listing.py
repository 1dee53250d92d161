"""Lists the paper's table next to that of the simulated sequences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Rows

import numpy as np

from .event_counts import EventCount
from .sequence import Sequence

HEAD = (
    *("sequence", "motion", "lens", "biases"),
    *("T [s]", "ours", "TS [m/s]", "ours", "RS [deg/s]", "ours"),
    *("NE", "ours"),
)
"""The heads of the columns of :func:`table`."""

WORDS = 4
"""The number of columns from the left that hold words; the others hold numbers."""


def table(sequences: Iterable[Sequence], counts: Mapping[str, EventCount]) -> list[tuple[str, ...]]:
    """Return a row of cells for each sequence; a ``-`` is not counted.

    Args:
        counts: of ideal pixels, by name.

    Our top speeds are those of :meth:`~davis_rs.Trajectory.top_speeds`.
    """
    return [_row(sequence, counts.get(sequence.name)) for sequence in sequences]


def _row(sequence: Sequence, count: EventCount | None) -> tuple[str, ...]:
    paper, path = sequence.paper, sequence.scene().path
    top = path.top_speeds()
    return (
        sequence.name,
        sequence.motion,
        sequence.camera,
        sequence.biases or "-",
        f"{paper.duration_s:.1f}",
        f"{path.duration_s:.1f}",
        _cell(paper.speed_m_s, 2),
        _cell(top.speed_m_s, 2),
        _cell(paper.rate_deg_s, 0),
        _cell(float(np.degrees(top.rate_rad_s)), 0),
        f"{paper.events:,}",
        "-" if count is None else f"{count.events:,}",
    )


def as_text(rows: Rows[Rows[str]]) -> str:
    """Format columns of equal width under :data:`HEAD`, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(HEAD, *rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < WORDS else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in (HEAD, *rows)
    )


def _cell(value: float | None, digits: int) -> str:
    return "n/a" if value is None else f"{value:.{digits}f}"
