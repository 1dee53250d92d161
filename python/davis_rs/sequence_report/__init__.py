"""The sequences of :mod:`davis_rs.scene.sequences` compared with the paper's table: listed, counted and drawn."""

from .count import MEASURED, MEASURED_RECORDED, EventCount, count_events, mean_luma, read_counts, write_counts
from .listing import as_markdown, as_text, table
from .sheet import draw_sheet

__all__ = [
    "MEASURED",
    "MEASURED_RECORDED",
    "EventCount",
    "as_markdown",
    "as_text",
    "count_events",
    "draw_sheet",
    "mean_luma",
    "read_counts",
    "table",
    "write_counts",
]
