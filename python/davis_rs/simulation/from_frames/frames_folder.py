"""Turns frames into a dataset folder of events, which is whole even when that is interrupted or fails."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from ..._util.argument_checks import check_type
from ..._util.argument_error import ArgumentError
from ..._util.folder_report import FolderReport
from ..._util.progress import Progress, doing, progress, say
from ..._util.stop_requests import stop_requests
from ...events.packet import Packet
from ...io.dataset.writer import DatasetWriter
from ...io.formats import FORMATS
from ..settings import FrameFolderSettings, FrameSettings, complete, only, takes_settings
from .frame_run import FrameRun
from .frame_source import FrameSource
from .open_frames import open_frames

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..settings.keywords import FrameFolderKeywords


@dataclass(frozen=True, kw_only=True)
class FramesReport(FolderReport):
    """Says what :func:`frames_to_folder` wrote.

    Attributes:
        frames: how many were taken.
    """

    frames: int

    def __str__(self) -> str:
        return self._line(f"{self.events:,} events of {self.frames:,} frames")


@takes_settings(FrameFolderSettings)
def frames_to_folder(
    frames: FrameSource | str | Path,
    path: str | Path,
    *,
    overwrite: bool = False,
    meta: Mapping[str, object] | None = None,
    quiet: bool = False,
    on_packet: Callable[[Packet, tuple[int, int]], object] | None = None,
    **settings: Unpack[FrameFolderKeywords],
) -> FramesReport:
    """Turn a video, a folder of images or an array of frames into a dataset folder of events.

    >>> frames_to_folder("clip.mp4", "clip", sensor="davis346", crop="1436x1080", size="346x260")

    The folder has the events, the frames as intensity frames, and ``meta.json``; t = 0 is at the first frame that is
    taken. It has a ``calib.txt`` where ``camera`` is given, and no poses.

    Ctrl-C (SIGINT) or SIGTERM ends it after the packet at hand, with a valid, shorter dataset; so does a frame that
    cannot be read, whose error is then raised.

    Args:
        frames: a path that :func:`~davis_rs.open_frames` can open without more to be said, or what it opened.
        path, overwrite: see :class:`~davis_rs.DatasetWriter`.
        meta: more for meta.json.
        quiet: no progress bar, and nothing said of how the frames are taken.
        on_packet: is called with each packet that was written and the (width, height) of the sensor: for showing it.
        {settings}

    Raises:
        TypeError: for a setting that does not exist.
        OSError: if the folder exists or cannot be written, or the frames cannot be read.
        ValueError, DecodeError, ImportError: as :func:`~davis_rs.open_frames` and :func:`~davis_rs.events_from_frames`.
    """
    started = time.perf_counter()
    given = complete(FrameFolderSettings, settings, taker=frames_to_folder)
    made_by = "davis_rs.events_from_frames takes arrays"
    check_type("frames", frames, (FrameSource, str, os.PathLike), made_by)
    FORMATS[given.events_format].require_libraries()  # before frames are read
    source = frames if isinstance(frames, FrameSource) else open_frames(frames)
    with progress("frames", source.count or 0, unit="frames", show=not quiet, forecast="") as bar:
        if given.image_rate_hz is not None and given.images_every != 1:
            raise ArgumentError("only one of {image_rate_hz} and {images_every} may be given")
        run = FrameRun(source, only(FrameSettings, given), from_zero=True)
        packets = run.packets()
        bar.begin()
        doing("reading the first frames")
        # Whatever is wrong with the first two frames shows before the folder is touched.
        first = [next(packets), next(packets)]
        if not quiet:
            for line in run.notes():
                say(line)
        counted = _WrittenCounts()
        with (
            stop_requests() as stop_requested,  # before the folder is made: a signal must not leave an empty one
            DatasetWriter(
                path,
                run.camera or run.size,
                image_gain=given.image_gain,
                events_format=given.events_format,
                signal_window_us=given.signal_window_us,
                overwrite=overwrite,
                meta={**run.describe(), "images_every": given.images_every, **(meta or {})},
            ) as writer,
        ):
            try:
                _write_all(
                    writer, _told(chain(first, packets), on_packet, run.size), run, given.images_every, bar,
                    stop_requested, counted,
                )  # fmt: skip
            except Exception as error:
                # What came before is a dataset of its own: it is closed as one that was cut short.
                with suppress(OSError, ValueError):  # a writer that failed is closed already
                    writer.finish(_found(run) | {"ended_by": str(error)}, interrupted=True)
                raise
            writer.finish(_found(run), interrupted=counted.interrupted)
    if not quiet:
        for line in run.findings():
            say(line)
    wall_s = time.perf_counter() - started
    return FramesReport(
        path=Path(path),
        frames=counted.frames,
        events=counted.events,
        duration_s=counted.end_us * 1e-6,
        wall_s=wall_s,
        interrupted=counted.interrupted,
        stopped_by=stop_requested(),
        dropped_events=run.dropped_events,
        missed_events=run.missed_events,
    )


def _told(
    packets: Iterator[Packet], on_packet: Callable[[Packet, tuple[int, int]], object] | None, size: tuple[int, int]
) -> Iterator[Packet]:
    """Yield packets, and tell of each once it has been written."""
    for packet in packets:
        yield packet
        if on_packet is not None:
            on_packet(packet, size)


@dataclass
class _WrittenCounts:
    """Says how much of a run was written."""

    frames: int = 0
    images: int = 0
    events: int = 0
    end_us: int = 0
    interrupted: bool = False


def _write_all(
    writer: DatasetWriter,
    packets: Iterator[Packet],
    run: FrameRun,
    images_every: int,
    bar: Progress,
    stop_requested: Callable[[], str],
    counted: _WrittenCounts,
) -> None:
    """Write packets until they or the user end it."""
    for packet in packets:
        # The last may bring late events alone.
        kept = packet.luma is not None and images_every > 0 and counted.images % images_every == 0
        writer.write(packet if kept else replace(packet, luma=None))
        counted.images += packet.luma is not None
        # Packets are made ahead of their writing, so only those that end at frames tell how many were written.
        counted.frames = counted.images if run.settings.image_rate_hz is None else run.frames
        counted.events += len(packet.events)
        counted.end_us = packet.end_us
        bar.total = max(bar.total, counted.frames)
        bar.to(counted.frames, f"{counted.events:,} events")
        if stop_requested() and counted.images > 1:  # with the first frame alone the dataset could not be checked
            for late in run.flush():
                writer.write(late)
                counted.events += len(late.events)
            counted.interrupted = True
            break


def _found(run: FrameRun) -> dict[str, object]:
    """Return what a run found on its way, for meta.json."""
    count = run.quantisation
    return {
        "frames": run.describe_frames(),
        "interpolation": run.interpolation.describe(),
        "dropped_events": run.dropped_events,
        "missed_events": run.missed_events,
        "one_grey_level_events": {"events": count.suspect, "of": count.total} if count.counts else None,
    }
