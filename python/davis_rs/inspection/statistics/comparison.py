"""Compares the statistics of two streams side by side."""

from __future__ import annotations

import os
from dataclasses import dataclass

from ..._util.close_names import names_checked
from ...events.arrays import EventArray
from .event_stream import EventStream
from .stream_meter import measure_stream
from .stream_statistics import Measured, Region, StreamStatistics


@dataclass(frozen=True, eq=False)
class StreamComparison:
    """Holds the statistics of two streams; ``str()`` of it is a table.

    Attributes:
        real, simulated: of each stream.
    """

    real: StreamStatistics
    simulated: StreamStatistics

    def __str__(self) -> str:
        real, simulated = _cells(self.real), _cells(self.simulated)
        rows = [("", "real", "simulated")]
        rows += [(name, real.get(name, "-"), simulated.get(name, "-")) for name in real | simulated]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
        return "\n".join(line.rstrip() for line in lines)


@names_checked
def compare_streams(
    real: str | os.PathLike[str] | EventStream | EventArray,
    simulated: str | os.PathLike[str] | EventStream | EventArray,
    *,
    size: tuple[int, int] | None = None,
    quiet: Region | None = None,
) -> StreamComparison:
    """Measure two streams, such as a recording and a simulation of it.

    Args:
        real, simulated, size, quiet: as of :func:`measure_stream`; size and region are those of both. Where only
            ``simulated`` does not say its size, it is taken to be that of ``real``.

    Raises:
        OSError, DecodeError, ValueError: as :func:`measure_stream`.
    """
    first = measure_stream(real, size=size, quiet=quiet)
    return StreamComparison(first, measure_stream(simulated, size=size, fallback_size=first.size, quiet=quiet))


def _cells(stream: StreamStatistics) -> dict[str, str]:
    """Return a column of the table, by the names of its rows."""
    described = stream.describe()
    hot, order = described["hot_pixels"], described["column_order"]
    cells = {
        "stream": stream.name,
        "kind": stream.kind,
        "sensor": f"{stream.size[0]} x {stream.size[1]}",
        "duration": f"{stream.duration_s:.3f} s",
        "events": f"{stream.events:,}",
        "ON share of all events": _percent(described["on_share"]),
        "ON events of a pixel": _with_unit(described["rate_per_pixel_hz"]["on"], "Hz"),
        "OFF events of a pixel": _with_unit(described["rate_per_pixel_hz"]["off"], "Hz"),
    }
    for kind, words in (("same", "of the same polarity"), ("any", "of any polarity")):
        intervals = described["interval_us"][kind]
        cells[f"shortest interval {words}"] = _with_unit(intervals["least"], "us")
        for percents in ((1, 10, 50), (90, 99)):
            listed = [_number(_in_ms(intervals[f"p{percent}"])) for percent in percents]
            cells[f"  {kind}: {', '.join(map(str, percents))} % are below"] = " / ".join(listed) + " ms"
    cells["rows of the bus"] = f"{described['rows_of_bus']} of the image"
    for key, words in (
        ("rows_per_us", "row bursts in a us"),
        ("rows_per_10_us", "row bursts in 10 us"),
        ("events_per_10_us", "events in 10 us"),
        ("events_per_row", "events in a row burst"),
    ):
        cells[f"{words}: mean / 99 % / most"] = _three(described[key])
    cells |= {
        "columns in a burst: ascending / descending": (
            f"{_percent(order['ascending'])} / {_percent(order['descending'])}"
        ),
        "rows of one stamp: the next one is higher": _percent(described["rows_up_share"]),
        "events that share their stamp": _percent(described["shared_stamp_share"]),
        "hot pixels": f"{hot['count']} ({100 * hot['share']:.3f} %)",
        "  their rate: least / median / most": _three(hot["rate_hz"], ("least", "median", "most"), " Hz"),
        "  their ON share: least / median / most": _three(hot["on_share"], ("least", "median", "most")),
        "  variation of intervals: least / median / most": _three(hot["variation"], ("least", "median", "most")),
        "quiet pixels": f"{described['quiet']['pixels']:,}",
        "  their rate": f"{stream.quiet_rate_hz} Hz",
        "  their ON share": str(stream.quiet_on_share),
        "even / odd columns: ON": _parity(stream.column_parity[1]),
        "even / odd columns: OFF": _parity(stream.column_parity[0]),
        "even / odd rows: ON": _parity(stream.row_parity[1]),
        "even / odd rows: OFF": _parity(stream.row_parity[0]),
    }
    if stream.backward or stream.outside:
        cells["left out: earlier than stream before / outside"] = f"{stream.backward:,} / {stream.outside:,}"
    return cells


def _parity(ratio: Measured) -> str:
    return "-" if ratio.value != ratio.value else f"{ratio.value:.3f} +- {ratio.sigma:.3f}"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def _in_ms(us: float | None) -> float | None:
    return None if us is None else us / 1e3


def _with_unit(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{_number(value)} {unit}"


def _percent(fraction: float | None) -> str:
    return "-" if fraction is None else f"{100 * fraction:.1f} %"


def _three(
    values: dict[str, float | None] | None, keys: tuple[str, ...] = ("mean", "p99", "most"), unit: str = ""
) -> str:
    return "-" if values is None else " / ".join(_number(values[key]) for key in keys) + unit
