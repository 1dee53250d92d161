"""Measures event streams: rates, intervals, bursts, hot and quiet pixels, of any length in bounded memory."""

from .comparison import StreamComparison, compare_streams
from .event_stream import EventStream, open_event_stream
from .stream_meter import StreamMeter, measure_stream
from .stream_statistics import StreamStatistics

__all__ = [
    "EventStream",
    "StreamComparison",
    "StreamMeter",
    "StreamStatistics",
    "compare_streams",
    "measure_stream",
    "open_event_stream",
]
