"""Defines what every event format offers: one writer, one reader, and the format itself, which opens them."""

from __future__ import annotations

import os
import threading
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Protocol, TypeVar, final

import numpy as np

from ..._core import check_events
from ..._util.argument_checks import check_number, is_number
from ..._util.argument_error import ArgumentError
from ..._util.untrusted import decoding, guarded
from ..._util.whole_file import Workplace, require_no_file
from ...events.arrays import EVENT_DTYPE, EventArray, as_events, concatenate_events
from .blocks import BlockPosition, Blocks, refuse
from .destination import Destination, Limits, Target
from .reading import ANY_SIZE, EventCheck, ReadRules

CHUNK = 1 << 20
"""Events that an iteration hands out at a time, unless told otherwise: 16 MiB."""

Roi = tuple[int, int, int, int]
"""A region of the sensor, (x0, y0, x1, y1): x0 <= x < x1 and y0 <= y < y1. Coordinates stay the sensor's."""

_Writer = TypeVar("_Writer", bound="EventWriter")
_Reader = TypeVar("_Reader", bound="EventReader")


class TruncatedFileWarning(UserWarning):
    """Says that a file ends in the middle of a record, or was never finished; its complete records were read."""


@dataclass(frozen=True)
class WriteReport:
    """Holds what a finished writer has written; ``first_us`` and ``last_us`` are None without events."""

    path: str
    format: str
    events: int
    bytes: int
    first_us: int | None
    last_us: int | None


class Releasable(Protocol):
    """Describes a lock."""

    def release(self) -> None:
        """Let others have what is locked."""


class EventWriter(ABC):
    """Writes events packet by packet, in constant memory; a context manager.

    A packet is checked as a whole before anything of it is written: times that go back, or lie outside of what the
    format can hold, pixels outside of the sensor, and a polarity above 1 are a ValueError with index, value and rule,
    and leave the file as it was. Ties keep their order. The caller's arrays are only read.

    An OSError of the system (disk full, folder gone, pipe closed) comes from the call that meets it. What was written
    before stays; the writer takes nothing more.

    Threads may share a writer: each call waits until the one before it is done, so that packets stay whole. Their order
    is that of the calls, and a packet that comes too late is refused because its times go back.

    A format implements ``_encode``, ``_flush`` and ``_close``, which are called one at a time; what else it
    offers for writing holds ``_turn`` meanwhile.

    Args:
        destination: where it writes, in which format, and of which sensor.

    Raises:
        ValueError: for a sensor that the format cannot hold.
    """

    def __init__(self, destination: Destination) -> None:
        self.path = destination.name
        self.format = destination.format
        self.size = destination.checked_size()
        self._limits = destination.limits
        self._events = 0
        self._first_us: int | None = None
        self._last_us: int | None = None
        self._report: WriteReport | None = None
        self._failed = False
        self._turn = threading.RLock()
        self.hold: Releasable | None = None
        """What keeps other writers from the file until this one is finished."""
        self.workplace: Workplace | None = None
        """Where the file is made, if it gets its name when it is finished."""

    def __repr__(self) -> str:
        return f"<{self.format} writer of {self.path}, {self.size[0]} x {self.size[1]} px, {self._events:,} events>"

    @final
    def write(self, events: EventArray) -> None:
        """Append a packet of any size: :data:`davis_rs.EVENT_DTYPE`, or any structured array with t, x, y and p.

        Raises:
            ValueError: for the first event that breaks a rule; nothing of the packet is written.
            OSError: if the system refuses.
        """
        with self._turn:
            self._refuse_if_over()
            packet = as_events(events)
            if not len(packet):
                return
            self._take(packet)
            if self._first_us is None:
                self._first_us = int(packet["t"][0])
            self._last_us = int(packet["t"][-1])
            self._events += len(packet)

    @final
    def flush(self) -> None:
        """Hand everything written so far to the operating system, such that it can be read.

        Raises:
            OSError: if the system refuses.
        """
        with self._turn:
            self._refuse_if_over()
            with Failing(self):
                self._flush()

    @final
    def abandon(self) -> None:
        """Let go of the file as it is; nothing more is taken."""
        with self._turn:
            if self._report is None and not self._failed:
                self._failed = True
                self._abandon()
                self._let_go()

    @final
    def finish(self) -> WriteReport:
        """Write what is left, close the file and report; finishing again only reports.

        Raises:
            OSError: if the system refuses now, or did before.
        """
        with self._turn:
            if self._report is None:
                if self._failed:
                    self._refuse_if_over()
                with Failing(self):
                    size = self._close()
                self._give_name()
                self._report = WriteReport(self.path, self.format, self._events, size, self._first_us, self._last_us)
                self._let_go()
            return self._report

    def __enter__(self: _Writer) -> _Writer:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None = None,
        exc_value: BaseException | None = None,
        traceback: TracebackType | None = None,
    ) -> None:
        """Finish; after a failed write, which has been told already, only let go of the file, and after any error if
        the file gets its name when it is whole."""
        if exc_value is not None and self.workplace is not None:
            self.abandon()
        elif not self._failed:
            self.finish()

    def _take(self, packet: EventArray) -> None:
        """Refuse a packet that breaks a rule, or write it."""
        self._check(packet)
        with Failing(self):
            self._encode(packet)

    def _check(self, packet: EventArray) -> None:
        """Refuse a packet that breaks a rule."""
        last_us = -1 if self._last_us is None else self._last_us
        check_events(packet, last_us=last_us, latest_us=self._limits.latest_us, size=self.size)

    @abstractmethod
    def _encode(self, packet: EventArray) -> None:
        """Write a checked, contiguous packet of at least one event."""

    @abstractmethod
    def _flush(self) -> None:
        """Hand over what waits, such that it can be read."""

    @abstractmethod
    def _close(self) -> int:
        """Write what is left, close the file and return its size in bytes."""

    def _abandon(self) -> None:  # noqa: B027 - not every format holds something
        """Let go of the file after a failure, leaving what is there."""

    def _give_name(self) -> None:
        """Give the file its name, if it is not written where it stays."""
        if self.workplace is None:
            return
        try:
            self.workplace.put()
        except BaseException as error:
            self._failed = True
            self._let_go(error)
            raise
        self.path = os.fspath(self.workplace.path)

    def _let_go(self, error: BaseException | None = None) -> None:
        if self.hold is not None:
            self.hold.release()
        if self.workplace is not None:
            self.workplace.discard(error)

    def _refuse_if_over(self) -> None:
        if self._failed:
            raise OSError(f"an earlier write to {self.path} failed: nothing more is taken")
        if self._report is not None:
            raise ValueError(f"{self.path} is finished: nothing can be written to it any more")


class Failing:
    """Marks a writer as failed when an error passes, but for those of class ``but``, and lets it go of its file."""

    def __init__(self, writer: EventWriter, but: tuple[type[BaseException], ...] = ()) -> None:
        self._writer = writer
        self._but = but

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if exc_type is not None and not issubclass(exc_type, self._but):
            self._writer._failed = True
            self._writer._abandon()
            self._writer._let_go(exc_value)


class EventReader(ABC):
    """Reads the events of one file, in constant memory and as often as asked; a context manager.

    Events come as :data:`davis_rs.EVENT_DTYPE`, in the file's order. A file that ends in the middle of a record gives
    what is whole and a :class:`TruncatedFileWarning`.

    A format implements ``_packets``, and ``_read`` where it can do better than join them. What a library of its
    raises about the file's bytes becomes a DecodeError here.

    Args:
        rules: what is done with times that go back and with pixels outside, and how much a packet may unpack to.
        extent: width and height that the format can hold, where the file does not state a size.

    Attributes:
        check: what the iteration that goes on, or the last one, has left out.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        format: str,
        size: tuple[int, int] | None = None,
        rules: ReadRules = ReadRules(),  # noqa: B008 - it is frozen
        extent: tuple[int, int] = ANY_SIZE,
    ) -> None:
        self.path = Path(path)
        self.format = format
        self.size = size
        """(width, height) of the sensor in pixels, None where the file does not say."""
        self.sensor: tuple[int, int] | None = None
        """The sensor's size as the caller gives it, for frames and a calibration of a file that does not say it."""
        self.rules = rules
        self.extent = extent
        """Width and height that the format can hold, where the file does not state a size."""
        self.check = self._new_check()

    def __repr__(self) -> str:
        size = "size unknown" if self.size is None else f"{self.size[0]} x {self.size[1]} px"
        return f"<{self.format} reader of {self.path}, {size}>"

    @property
    def events(self) -> int | None:
        """Return the number of events, None where the file does not say."""
        return None

    @property
    def progress(self) -> float:
        """Return the fraction of the file that the current iteration has read, 0 .. 1."""
        return 0.0

    @final
    def iter(
        self, chunk: int = CHUNK, *, start_us: int | None = None, stop_us: int | None = None, roi: Roi | None = None
    ) -> Iterator[EventArray]:
        """Yield the events in arrays of ``chunk``, the last one shorter.

        Args:
            chunk: events an array, > 0.
            start_us, stop_us: only events with start_us <= t < stop_us; what lies outside is not read where the
                format allows it.
            roi: only events in (x0, y0, x1, y1), half-open.

        Raises:
            ArgumentError: for a slice that ends before it starts, or a roi that holds no pixel.
            OSError: if the file cannot be read.
            DecodeError: for the first malformed record, with its place.
        """
        check_number("chunk", chunk, 1, whole=True)
        check_slice(start_us, stop_us, roi)
        waiting: list[EventArray] = []
        count = 0
        for packet in self._checked(chunk, start_us, stop_us):
            selected = select(packet, start_us, stop_us, roi)
            while count + len(selected) >= chunk:
                cut = chunk - count
                yield selected[:cut] if not waiting else concatenate_events([*waiting, selected[:cut]])
                waiting, count, selected = [], 0, selected[cut:]
            if len(selected):
                waiting.append(selected)
                count += len(selected)
        if waiting:
            yield waiting[0] if len(waiting) == 1 else concatenate_events(waiting)

    @final
    def read(self, *, start_us: int | None = None, stop_us: int | None = None, roi: Roi | None = None) -> EventArray:
        """Return all events of the slice as one array; see :meth:`iter`."""
        check_slice(start_us, stop_us, roi)
        if roi is not None or not self.rules.in_order:
            return concatenate_events(list(self.iter(start_us=start_us, stop_us=stop_us, roi=roi)))
        self.check = self._new_check()
        with decoding(self.path):
            events = self._read(start_us, stop_us)
        return self.check.take(select(events, start_us, stop_us, None))

    def _checked(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        """Yield the packets, once they have passed the check; all of them, where times may go back."""
        check = self.check = self._new_check()
        packets = self._packets(chunk, start_us, stop_us) if self.rules.in_order else self._packets(chunk, None, None)
        for packet in guarded(self.path, packets):
            yield check.take(packet)

    def _new_check(self) -> EventCheck:
        return EventCheck(self.path, self.rules, self.size or self.extent)

    @abstractmethod
    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        """Yield arrays of about ``chunk`` events at most, in order from the beginning; all of those with
        start_us <= t < stop_us, and perhaps others. What is handed out belongs to the caller."""

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        """Return all events with start_us <= t < stop_us, and perhaps others, as one array of the caller's."""
        selected = (select(packet, start_us, stop_us, None) for packet in self._packets(CHUNK, start_us, stop_us))
        return concatenate_events(list(selected))

    def blocks(self) -> Blocks:
        """Return where the file's events are, so that :meth:`read_block` can read parts of it; reads the whole file
        once where it does not say that itself.

        Raises:
            OSError, DecodeError: if it cannot be read, is malformed, or can only be read from its beginning.
        """
        refuse(self.path, f"{self.format} holds nothing to find a place by")

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        """Return the events of a block that :meth:`blocks` has given, unchecked.

        Raises:
            OSError, DecodeError: if it cannot be read, or is malformed.
        """
        raise NotImplementedError

    def close(self) -> None:  # noqa: B027 - most formats open the file for an iteration only
        """Let go of the file."""

    def __enter__(self: _Reader) -> _Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Format(ABC):
    """Describes one event format: how it is recognised, and who writes and reads it."""

    name: str
    """Its name, as ``format=`` takes it."""
    suffixes: tuple[str, ...]
    """The file suffixes that stand for it, lower case with the dot."""
    limits: Limits = Limits()
    """What it can hold."""
    options: tuple[str, ...] = ()
    """The names of its writer's own options."""
    holds: tuple[str, ...] = ()
    """What is written next to events, by the names of ``davis_rs.io.formats.parts.PARTS``: its writers have the
    methods of these parts, and its readers have those, and perhaps others'."""
    writable: bool = True
    """Whether there is a writer."""
    states_size: bool = True
    """Whether its files state the sensor's size, if their writer has no options."""

    @abstractmethod
    def sniff(self, head: bytes, path: Path) -> bool:
        """Return whether a file with these first bytes (4 KiB, or all of it) is one of this format."""

    def sniff_folder(self, path: Path) -> bool:
        """Return whether a folder is one of this format."""
        return False

    def require_libraries(self, **options: Any) -> None:  # noqa: B027 - most formats need none
        """Check that the libraries are there that a writer with these options needs.

        Raises:
            ImportError: with the extra of davis_rs that brings what is missing.
        """

    def require_room(self, path: Path, *, overwrite: bool) -> None:
        """Check that a writer may make ``path``.

        Raises:
            OSError: naming the path: FileExistsError if something is there that may not be replaced.
        """
        require_no_file(path, overwrite=overwrite)

    def make_room(self, path: Path) -> None:  # noqa: B027 - a file is replaced as it is renamed
        """Remove what is there and may be replaced."""

    writer: ClassVar[type[EventWriter]]
    """What writes it, where it can be written: made of a :class:`Destination`, and of the format's own options."""

    def open_writer(self, target: Target, size: tuple[int, int], *, overwrite: bool, **options: Any) -> EventWriter:
        """Open a writer into a new file, with the format's own options; see :func:`davis_rs.open_writer`."""
        return self.writer(Destination(target, self.name, size, self.limits, overwrite), **options)

    @abstractmethod
    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        """Open a reader; see :func:`davis_rs.read_events`."""


def check_slice(start_us: int | None, stop_us: int | None, roi: Roi | None) -> None:
    """Refuse a slice that nothing can lie in.

    Raises:
        ArgumentError: for times that are no integers, a stop before the start, or a roi that holds no pixel.
    """
    for name, t_us in (("start_us", start_us), ("stop_us", stop_us)):
        if t_us is not None:
            check_number(name, t_us, whole=True)
    if start_us is not None and stop_us is not None and stop_us < start_us:
        raise ArgumentError("{stop_us} must not lie before {start_us}, got {} us and {} us", stop_us, start_us)
    if roi is not None:
        corners = tuple(roi) if hasattr(roi, "__len__") and not isinstance(roi, str) else ()
        whole = len(corners) == 4 and all(is_number(corner, whole=True) for corner in corners)
        if not (whole and 0 <= corners[0] < corners[2] and 0 <= corners[1] < corners[3]):
            raise ArgumentError(
                "{roi} must be (x0, y0, x1, y1), four integers with 0 <= x0 < x1 and 0 <= y0 < y1, got {!r}", roi
            )


def select(events: EventArray, start_us: int | None, stop_us: int | None, roi: Roi | None) -> EventArray:
    """Return the events of a slice, as :meth:`EventReader.iter` defines it; without a copy where all of them are."""
    keep = np.ones(len(events), np.bool_)
    if start_us is not None:
        keep &= events["t"] >= start_us
    if stop_us is not None:
        keep &= events["t"] < stop_us
    if roi is not None:
        x0, y0, x1, y1 = roi
        keep &= (events["x"] >= x0) & (events["x"] < x1) & (events["y"] >= y0) & (events["y"] < y1)
    return events if keep.all() else np.ascontiguousarray(events.view("V16")[keep]).view(EVENT_DTYPE)


def warn_truncated(path: str | os.PathLike[str], why: str) -> None:
    """Say that a file is not whole, and what is left out."""
    warnings.warn(f"{os.fspath(path)}: {why}", TruncatedFileWarning, stacklevel=3)
