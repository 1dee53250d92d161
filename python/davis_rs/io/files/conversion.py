"""Converts from one container to another, with all parts of a recording that both can hold, in constant memory."""

from __future__ import annotations

import heapq
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean
from ..._util.untrusted import MAX_PACKET_BYTES, guarded
from ...events.arrays import EventArray
from ...events.filters import EventFilters, Filter, FilterScore
from ..dataset.files import LATEST_START_US
from ..dataset.folder_format import FolderFormat, FolderReader, FolderWriter, part_counts
from ..formats.destination import Target
from ..formats.interface import EventReader, EventWriter, Roi, WriteReport, check_slice
from ..formats.parts import ALL_PARTS, PARTS, Part
from ..formats.reading import Breach
from ..formats.recorded import RecordedParts
from ..formats.registry import FORMATS
from ..recordings import RecordingWarning
from .read import open_reader
from .sensor_size import find_sensor_size, sensor_size
from .write import format_for, open_writer


class LeftOutWarning(UserWarning):
    """Says that the target of a conversion cannot hold all that its source has; the message names it."""


@dataclass(frozen=True)
class ConversionReport(WriteReport):
    """Holds what a conversion has written.

    Attributes:
        parts: how many frames, samples and so on were written, by the names of the parts.
        left_out: what the source has and the target does not hold, empty where nothing is lost.
        filtered_out: how many events did not pass the filters.
        filter_score: what the filters did to signal and to noise, where the source is a folder whose events are
            labelled, and all of them were taken; else None.
    """

    parts: dict[str, int]
    left_out: str
    filtered_out: int = 0
    filter_score: FilterScore | None = None


def convert(
    source: str | os.PathLike[str],
    target: Target,
    *,
    size: tuple[int, int] | None = None,
    format: str | None = None,
    start_us: int | None = None,
    stop_us: int | None = None,
    roi: Roi | None = None,
    parts: Sequence[str] | None = None,
    filters: Sequence[Filter] = (),
    from_zero: bool | None = None,
    backward: Breach = "refuse",
    outside: Breach = "refuse",
    max_packet_bytes: int = MAX_PACKET_BYTES,
    overwrite: bool = False,
    progress: Callable[[float], object] | None = None,
    **options: Any,
) -> ConversionReport:
    """Convert from any container to any container: events, and all other parts that both hold, in order of time.

    Values, times, coordinates and the order of events stay as they are. What the source has and the target cannot hold
    is a :class:`LeftOutWarning` in one line, and stands in the report. The target gets its name when it is whole: after
    an error or Ctrl-C there is none, and what was there before is as it was.

    >>> convert("planes", "planes.bag")
    >>> convert("shapes_6dof.bag", "shapes_6dof")

    Args:
        source: a file of any format, recognised by its content, a recording of a camera (AEDAT 2.0, 3.1, 4, or a
            camera's bytes), a dataset folder, or a rosbag2.
        target: a path (without a suffix: a dataset folder), or an open binary stream.
        size: (width, height) of the sensor, where the source does not say; an event outside is refused. Without it,
            that of a ``meta.json`` or of frames next to the source is taken, and a
            :class:`~davis_rs.io.files.sensor_size.SensorSizeWarning` says so. A target that cannot hold it needs none.
        format: of the target; by its suffix if not given.
        start_us, stop_us: only what has start_us <= t < stop_us, by the source's times.
        roi: only events with x0 <= x < x1 and y0 <= y < y1, as (x0, y0, x1, y1). Other parts stay whole.
        parts: which parts to convert next to the events, by the names camera, frames, depth, flow, imu and poses; all
            if not given, and () for events alone.
        filters: only events that pass these, of :mod:`davis_rs.filters`, one after the other.
        from_zero: take the time of the first event, frame or sample off all times. If not given, this is done for a
            dataset folder, which begins at 0, where the first time is more than an hour: the clock's own, such as Unix
            time. A ``UserWarning`` then says so, and ``meta.json`` has it as ``first_time_us``.
        backward, outside, max_packet_bytes: see :func:`davis_rs.open_reader`; how many events were dropped is a
            ``UserWarning``.
        overwrite: whether an existing target may be replaced.
        progress: is told the fraction of the source that is done, 0..1.
        options: those of the target's format.

    Raises:
        ValueError: if the size contradicts the source, or is not known and the target states it or filters need it;
            if both are one file, a part does not exist, or the target cannot hold a value.
        ImportError: if a library is missing, with the extra that brings it.
        OSError, DecodeError: if the source cannot be read, or the target not be written.
    """
    if isinstance(target, str | os.PathLike) and os.path.exists(target) and os.path.samefile(source, target):
        raise ValueError(f"{os.fspath(source)} cannot be converted onto itself")
    if format is None and isinstance(target, str | os.PathLike) and not Path(target).suffix:
        format = FolderFormat.name
    check_slice(start_us, stop_us, roi)
    for name in ALL_PARTS if parts is None else parts:
        if name not in ALL_PARTS:
            raise ArgumentError("{parts} are {}: got {!r}{}", ", ".join(ALL_PARTS), name, did_you_mean(name, ALL_PARTS))
    with open_reader(source, backward=backward, outside=outside, max_packet_bytes=max_packet_bytes) as reader:
        chosen = format_for(target, format, options)
        states_size = chosen.states_size or options.get("size_line", False)
        known = (sensor_size if states_size or filters else find_sensor_size)(reader, size)
        reader.sensor, sensor = known, known or (chosen.limits.width, chosen.limits.height)
        with open_writer(target, sensor, format, overwrite=overwrite, whole=True, **options) as writer:
            if isinstance(writer, FolderWriter):
                writer.source = Path(source).name
            wanted = [part for part in PARTS if (parts is None or part.name in parts) and hasattr(reader, part.read)]
            held = [part for part in wanted if part.name in FORMATS[writer.format].holds]
            items = heapq.merge(*(_items(reader, part, start_us, stop_us) for part in held), key=lambda item: item.t_us)
            whole = start_us is None and stop_us is None and roi is None and "drop" not in (backward, outside)
            labels = reader.dataset.signal if whole and filters and isinstance(reader, FolderReader) else None
            passing = _Filtering(filters, sensor, labels)
            packets = map(passing.take, reader.iter(start_us=start_us, stop_us=stop_us, roi=roi))
            if from_zero is None:
                latest_us = LATEST_START_US if isinstance(writer, FolderWriter) else None
            else:
                latest_us = 0 if from_zero else None
            written, shift_us = _write_all(writer, filter(len, packets), items, reader, latest_us, progress)
            if isinstance(writer, FolderWriter):
                writer.first_time_us = shift_us
        report = writer.finish()
        if shift_us and from_zero is None:
            warnings.warn(
                f"{report.path}: times are counted from the first one, {shift_us / 1e6:.6f} s, because a dataset "
                "folder begins at 0 (from_zero=False, --no-from-zero keep them)",
                stacklevel=2,
            )
        if not passing.taken and written.keys() <= {"camera"} and (start_us, stop_us) != (None, None):
            warnings.warn(
                f"{reader.path} has nothing in the part that was asked for, {_seconds(start_us, '0')} to "
                f"{_seconds(stop_us, 'its end')}",
                stacklevel=2,
            )
        dropped = reader.check
        if dropped.dropped_backward or dropped.dropped_outside:
            warnings.warn(
                f"{reader.path}: left out are {dropped.dropped_backward} events earlier than one before them, "
                f"{dropped.dropped_outside} outside of the sensor",
                stacklevel=2,
            )
        for note in reader.notes if isinstance(reader, RecordedParts) else ():
            warnings.warn(f"{reader.path}: {note}", RecordingWarning, 2)
        left_out = "" if parts is not None else _left_out(reader, held)
        if parts is None and not states_size and (reader.size is not None or isinstance(reader, FolderReader)):
            left_out = ", ".join(filter(None, [left_out, f"the sensor's size, {sensor[0]} x {sensor[1]}"]))
        if left_out:
            warnings.warn(left_out_line(report.path, report.format, left_out), LeftOutWarning, 2)
        values = {field.name: getattr(report, field.name) for field in fields(WriteReport)}
        return ConversionReport(
            **values,
            parts=written,
            left_out=left_out,
            filtered_out=passing.taken - passing.passed,
            filter_score=passing.score,
        )


class _Filtering(EventFilters):
    """Filters packets, and counts what that does to labelled events.

    Attributes:
        score: the counts; None without labels.
    """

    def __init__(self, filters: Sequence[Filter], size: tuple[int, int], labels: npt.NDArray[np.bool_] | None) -> None:
        super().__init__(filters, size)
        self._labels = np.zeros(0, np.bool_) if labels is None else labels
        self.score = FilterScore(0, 0, 0, 0) if len(self._labels) else None

    def passing(self, events: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        before = self.taken
        passing = super().passing(events)
        if self.score is not None:
            labels = self._labels[before : self.taken]
            self.score += FilterScore.of(labels, passing[: len(labels)])  # a killed writer's last events have none
        return passing


def _seconds(t_us: int | None, otherwise: str) -> str:
    return otherwise if t_us is None else f"{t_us / 1e6:g} s"


def left_out_line(path: object, format: str, left_out: str) -> str:
    """Return the line that says what a file of a format does not hold of its source."""
    return f"{path} ({format}) cannot hold, and leaves out: {left_out}"


class _Item(NamedTuple):
    """Holds one frame, sample or the like, as its writer takes it."""

    t_us: int
    part: Part
    values: tuple[Any, ...]


def _items(reader: EventReader, part: Part, start_us: int | None, stop_us: int | None) -> Iterator[_Item]:
    """Yield what a reader has of a part; a calibration holds for all times."""
    for t_us, *values in guarded(reader.path, iter(getattr(reader, part.read)())):
        if part.name == "camera" or ((start_us is None or t_us >= start_us) and (stop_us is None or t_us < stop_us)):
            yield _Item(int(t_us), part, tuple(values))


def _write_all(
    writer: EventWriter,
    packets: Iterator[EventArray],
    items: Iterator[_Item],
    reader: EventReader,
    latest_us: int | None,
    progress: Callable[[float], object] | None,
) -> tuple[dict[str, int], int]:
    """Write events and the rest in one order of time, events of one time first.

    Args:
        latest_us: a first time above it is taken off all times; None: never.

    Returns:
        How many of each part there were, and what was taken off.
    """
    written = dict.fromkeys(ALL_PARTS, 0)
    shift: int | None = 0 if latest_us is None else None

    def shift_from(first_us: int) -> int:
        return 0 if latest_us is None or first_us <= latest_us else first_us

    def write(item: _Item) -> None:
        t_us = max(0, item.t_us - (shift or 0)) if item.part.name == "camera" else item.t_us - (shift or 0)
        getattr(writer, item.part.write)(t_us, *item.values)
        written[item.part.name] += 1

    item = next(items, None)
    held_back: list[_Item] = []  # a calibration has a time of no meaning: it does not decide where time begins
    while shift is None and item is not None and item.part.name == "camera":
        held_back.append(item)
        item = next(items, None)
    for events in packets:
        if shift is None:
            shift = shift_from(min(int(events["t"][0]), int(events["t"][0]) if item is None else item.t_us))
        for early in held_back:
            write(early)
        held_back.clear()
        done, t_us = 0, events["t"]
        while item is not None and item.t_us < t_us[-1]:
            due = int(np.searchsorted(t_us, item.t_us, "right"))
            if due > done:
                writer.write(_moved(events[done:due], shift))
                done = due
            write(item)
            item = next(items, None)
        writer.write(_moved(events[done:], shift))
        if progress is not None:
            progress(reader.progress)
    if shift is None:
        shift = 0 if item is None else shift_from(item.t_us)
    for late in [*held_back, *([] if item is None else [item])]:
        write(late)
    for late in items:
        write(late)
    if progress is not None:
        progress(1.0)
    return {name: count for name, count in written.items() if count}, shift


def _moved(events: EventArray, shift: int) -> EventArray:
    if not shift:
        return events
    moved = events.copy()
    moved["t"] -= shift
    return moved


def _left_out(reader: EventReader, held: list[Part]) -> str:
    """Return what a source has next to its events and the parts that are held, with counts where they are known."""
    kept = {part.counted for part in held}
    if isinstance(reader, FolderReader):
        return ", ".join(f"{count:,} {what}" for what, count in part_counts(reader.dataset).items() if what not in kept)
    others = [part for part in PARTS if part.counted not in kept and hasattr(reader, part.read)]
    if isinstance(reader, RecordedParts):
        there = [part.counted for part in others if reader.recording.has(part.name)]
        return ", ".join([*there, "triggers"] if reader.recording.has("triggers") else there)
    return ", ".join(part.counted for part in others if next(iter(getattr(reader, part.read)()), None) is not None)
