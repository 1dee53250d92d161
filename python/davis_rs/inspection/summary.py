"""Summarises an event file or a dataset folder: counts, rates, gaps, and how fast the camera moved."""

from __future__ import annotations

import heapq
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.extras import from_extra
from .._util.folder_report import start_line
from .._util.terminal_text import printable
from .._util.untrusted import MAX_PACKET_BYTES
from .._util.whole_file import whole_file
from ..geometry.pose import GroundTruth
from ..geometry.trajectory.trajectory import SPEED_WINDOW_S
from ..io.dataset.folder_format import FolderReader, part_counts
from ..io.dataset.reader import Dataset
from ..io.files.read import open_reader
from ..io.files.sensor_size import find_sensor_size
from ..io.formats.interface import EventReader
from ..io.formats.parts import FRAMES, IMU
from ..io.formats.recorded import RecordedParts
from ..simulation.noise_estimate import share_text
from .dataset_description import describe_dataset
from .path_returns import return_note
from .pixel_counts import PixelCounts

PEAK_WINDOW_US = 10_000
"""The peak rate is that of the fullest of the intervals of this length that follow each other from t = 0."""

DATASET_FOLDER = "dataset folder"
"""The format's name of a folder in the layout of the public dataset."""

_GAPS = 3


class Gap(NamedTuple):
    """A time without events: from ``start_us``, ``length_us`` long."""

    length_us: int
    start_us: int

    def __str__(self) -> str:
        return f"{self.length_us / 1e3:.3f} ms from {_seconds(self.start_us)}"


@dataclass
class EventSummary:
    """What :func:`summarize_events` found; ``str()`` of it is a few lines for people.

    Attributes:
        path, format: the file, and the name of its format.
        size: (width, height) of the sensor; where the file does not say, what the events span.
        size_known: whether the file says it.
        events, on: how many there are, and how many of them are ON.
        first_us, last_us: times of the first and the last, None without events.
        peak_events: most events in one of the intervals of :data:`PEAK_WINDOW_US`; ``peak_us`` is its start.
        backward: how many events are earlier than the one before them.
        gaps: the longest, longest first.
        outside: how many events lie outside of the size that the file states; they count for nothing else.
        pixels: events in each pixel.
        also: how many frames and IMU samples a camera's recording has next to its events, by name; None for the frames
            of AEDAT 2.0, where nothing marks where one begins.
    """

    path: Path
    format: str
    size: tuple[int, int]
    size_known: bool
    events: int = 0
    on: int = 0
    first_us: int | None = None
    last_us: int | None = None
    peak_events: int = 0
    peak_us: int = 0
    backward: int = 0
    gaps: list[Gap] = field(default_factory=list)
    outside: int = 0
    pixels: PixelCounts = field(default_factory=lambda: PixelCounts(None))
    also: dict[str, int | None] = field(default_factory=dict)

    @property
    def counts(self) -> npt.NDArray[np.uint64]:
        """Events in each pixel, uint64 (height, width).

        Raises:
            ValueError: for a sensor of more than 4,194,304 pixels.
        """
        return self.pixels.image()

    @property
    def duration_s(self) -> float:
        """The time from the first event to the last."""
        return 0.0 if self.first_us is None or self.last_us is None else (self.last_us - self.first_us) / 1e6

    @property
    def mean_rate_hz(self) -> float:
        """Events a second over the duration; 0 where that is 0."""
        return self.events / self.duration_s if self.duration_s > 0 else 0.0

    @property
    def peak_rate_hz(self) -> float:
        """Events a second in the fullest interval; the mean rate, where the file is shorter than one."""
        return max(self.peak_events * 1e6 / PEAK_WINDOW_US, self.mean_rate_hz)

    def __str__(self) -> str:
        width, height = self.size
        known = "" if self.size_known else " (spanned by the events; the file does not say)"
        lines = [f"{self.path}: {self.format}", f"sensor      {width} x {height}{known}"]
        if not self.events:
            return "\n".join(map(printable, [*lines, "events      0"]))
        x, y, most = self.pixels.busiest
        silent = width * height - self.pixels.with_events
        lines += [
            f"time        {_seconds(self.first_us)} to {_seconds(self.last_us)}, {self.duration_s:.6f} s",
            f"events      {self.events:,}, {self.on / self.events:.1%} ON",
            f"mean rate   {_rate(self.mean_rate_hz)}",
            f"peak rate   {_rate(self.peak_rate_hz)} in the {PEAK_WINDOW_US // 1000} ms from {_seconds(self.peak_us)}",
            f"pixels      {_rate(self.mean_rate_hz / (width * height))} on average; busiest ({x}, {y}) with "
            f"{most:,} events; {silent:,} without any",
            "gaps        " + (", ".join(map(str, self.gaps)) or "none"),
        ]
        if also := _counted(self.also):
            lines.append(f"also        {also}")
        if self.outside:
            lines.append(f"warning: {self.outside:,} events lie outside of the sensor, and are left out")
        if self.backward:
            lines.append(f"warning: {self.backward:,} events are earlier than the one before them")
        return "\n".join(map(printable, lines))


class DatasetRow(NamedTuple):
    """The columns of the paper's tables for one sequence.

    ``duration_s`` T: the duration; ``translation_m_s`` TS and ``rotation_deg_s`` RS: top speeds of the camera, NaN
    without ground truth; ``events`` NE: the number of events.

    Source: Mueggler et al., IJRR 2017, tables 1 to 3.
    """

    duration_s: float
    translation_m_s: float
    rotation_deg_s: float
    events: int

    def __str__(self) -> str:
        speeds = f"TS = {self.translation_m_s:.3f} m/s, RS = {self.rotation_deg_s:.1f} deg/s, "
        known = not math.isnan(self.translation_m_s)
        return f"T = {self.duration_s:.3f} s, {speeds if known else ''}NE = {self.events:,}"


def summarize_events(
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] | None = None,
    max_packet_bytes: int = MAX_PACKET_BYTES,
    progress: Callable[[float], object] | None = None,
) -> EventSummary:
    """Read an event file once, in constant memory, and sum it up.

    Args:
        path: a file of any format, or a dataset folder.
        size: (width, height) of the sensor, where the file does not say.
        max_packet_bytes: what a packet, chunk, page or message of a compressed file may unpack to.
        progress: is told the share that is done, 0..1.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: for events outside of a sensor of ``size``, or one that contradicts the file.
    """
    with open_reader(path, backward="keep", outside="drop", max_packet_bytes=max_packet_bytes) as reader:
        known = find_sensor_size(reader, size)
        format = DATASET_FOLDER if isinstance(reader, FolderReader) else reader.format
        summary = EventSummary(Path(path), format, known or (0, 0), known is not None)
        _sum_up(reader, summary, progress)
        if isinstance(reader, RecordedParts):
            counts = reader.recording.counts((FRAMES.name, IMU.name))
            summary.also = {part.counted: counts[part.name] for part in (FRAMES, IMU)}
    return summary


def _sum_up(reader: EventReader, summary: EventSummary, progress: Callable[[float], object] | None) -> None:
    summary.pixels = PixelCounts(summary.size if summary.size_known else None)
    window, in_window = 0, 0
    for events in reader.iter():
        summary.pixels.add(events)
        t_us = np.ascontiguousarray(events["t"])
        _add_gaps(summary, t_us)
        windows, sizes = np.unique(t_us // PEAK_WINDOW_US, return_counts=True)
        if windows[0] == window:  # the interval that the events before ended in
            sizes[0] += in_window
        fullest = int(sizes.argmax())
        if sizes[fullest] > summary.peak_events:
            summary.peak_events, summary.peak_us = int(sizes[fullest]), int(windows[fullest]) * PEAK_WINDOW_US
        window, in_window = int(windows[-1]), int(sizes[-1])
        summary.on += int(np.count_nonzero(events["p"]))
        summary.events += len(events)
        if summary.first_us is None:
            summary.first_us = int(t_us[0])
        summary.last_us = int(t_us[-1])
        if progress is not None:
            progress(reader.progress)
    summary.size, summary.outside = summary.pixels.size, reader.check.dropped_outside


def _add_gaps(summary: EventSummary, t_us: npt.NDArray[np.int64]) -> None:
    """Note the longest gaps up to the last of these times, and steps back."""
    if summary.last_us is not None:
        t_us = np.concatenate([[np.int64(summary.last_us)], t_us])
    steps = np.diff(t_us)
    summary.backward += int(np.count_nonzero(steps < 0))
    longest = np.argpartition(steps, -_GAPS)[-_GAPS:] if len(steps) > _GAPS else np.arange(len(steps))
    longer = [Gap(int(steps[at]), int(t_us[at])) for at in longest if steps[at] > 0]
    summary.gaps = heapq.nlargest(_GAPS, [*summary.gaps, *longer])


def dataset_contents(dataset: Dataset) -> str:
    """Return a few lines on what a dataset folder holds in addition to its events: scene, settings, noise, model, and
    parts.

    Raises:
        OSError, DecodeError: if a list of images, the ground truth or the IMU's samples cannot be read.
    """
    said = describe_dataset(dataset)
    lines = []
    if said.scene is not None:
        lines.append(f"scene       {said.scene}")
    if said.threshold is not None:
        lines.append(f"threshold   {said.threshold}")
    if said.effects is not None:
        lines.append(f"effects     {', '.join(said.effects) or 'none: ideal pixels'}")
    start_time_ns = dataset.meta.get("start_time_ns")
    if isinstance(start_time_ns, int) and start_time_ns:
        lines.append(f"clock       {start_line(start_time_ns, 'the input')}")
    if said.noise:
        lines.append(f"noise       {share_text(said.noise, 'the events are')}")
    if len(signal := dataset.signal):
        lines.append(f"signal      {signal.mean():.1%} of the events, the others are noise")
    if said.made_by is not None:
        lines.append(f"made by     {said.made_by}")
    lines.append(f"also        {_counted(part_counts(dataset)) or 'nothing'}")
    if (note := return_note(dataset)) is not None:
        lines.append(f"note        {note}")
    if dataset.meta.get("interrupted"):
        lines.append(
            "note        cut short: its writer was stopped, by Ctrl-C, SIGTERM or an error, and finished the folder"
        )
    elif dataset.meta.get("complete") is False:
        lines.append("warning: the folder was never finished: its writer was killed or failed")
    return "\n".join(map(printable, lines))


def _counted(parts: Mapping[str, int | None]) -> str:
    return ", ".join(what if count is None else f"{count:,} {what}" for what, count in parts.items() if count != 0)


def dataset_row(path: str | Path, summary: EventSummary) -> DatasetRow:
    """Return the paper's columns for a dataset folder whose events were summed up.

    The duration is that of ``meta.json`` where there is one, else that of the events. In a folder that was never
    finished ``meta.json`` may be older than the events: there it is the longer one.

    Raises:
        OSError, DecodeError: if the ground truth cannot be read.
    """
    dataset = Dataset(path)
    stated_us = dataset.meta.get("duration_us")
    duration_s = stated_us / 1e6 if isinstance(stated_us, int) else summary.duration_s
    if dataset.meta.get("complete") is False:
        duration_s = max(duration_s, summary.duration_s)
    return DatasetRow(duration_s, *top_speeds(dataset.groundtruth), summary.events)


def top_speeds(ground_truth: GroundTruth) -> tuple[float, float]:
    """Return the largest translation speed in m/s and rotation speed in degrees a second, NaN for less than two poses.

    A speed is that between a pose and the first one at least 100 ms later, in a shorter sequence between its ends: what
    :meth:`~davis_rs.Trajectory.top_speeds` is of a trajectory, and far above a motion capture's noise.
    """
    span_us = round(SPEED_WINDOW_S * 1e6)
    t_us = ground_truth.t_us
    if len(t_us) < 2:
        return float("nan"), float("nan")
    later = np.minimum(np.searchsorted(t_us, t_us + span_us), len(t_us) - 1)
    from_ = np.flatnonzero(t_us[later] - t_us >= min(span_us, int(t_us[-1] - t_us[0])))
    to = later[from_]
    seconds = (t_us[to] - t_us[from_]) / 1e6
    q = ground_truth.quaternions / np.linalg.norm(ground_truth.quaternions, axis=1, keepdims=True)
    metres = np.linalg.norm(ground_truth.positions[to] - ground_truth.positions[from_], axis=1)
    # Of q and -q, which are one rotation, the nearer; the chord keeps its digits where the cosine has none.
    chord = np.minimum(np.linalg.norm(q[to] - q[from_], axis=1), np.linalg.norm(q[to] + q[from_], axis=1))
    degrees = np.degrees(4 * np.arcsin(np.minimum(chord / 2, 1)))
    return float((metres / seconds).max()), float((degrees / seconds).max())


def draw_rates(summary: EventSummary, output: str | Path) -> Path:
    """Draw the rate of each pixel, in events a second, on a logarithmic scale; returns the picture's path.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        ValueError: if there are no events, or all are at one time.
        OSError: if it cannot be written.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.colors import LogNorm
        from matplotlib.figure import Figure
    if summary.duration_s <= 0:
        raise ValueError(f"{summary.path} has no two events at different times, so no rates to draw")
    rates = summary.counts / summary.duration_s
    width, height = summary.size
    figure = Figure(figsize=(7.2, 1.2 + 6.0 * height / width), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    least = float(rates[rates > 0].min())
    shown = np.ma.masked_equal(rates, 0)
    image = axes.imshow(shown, cmap="viridis", norm=LogNorm(least, max(float(rates.max()), least * 1.001)))
    axes.set_facecolor("0.82")
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")
    axes.set_title(
        f"{summary.path.name}: {summary.events:,} events in {summary.duration_s:.3f} s; grey: no events", fontsize=9
    )
    figure.colorbar(image, ax=axes, label="events a second", shrink=0.9)
    with whole_file(output) as working_path:
        figure.savefig(working_path, dpi=150)
    return Path(output)


def _rate(hertz: float) -> str:
    for factor, unit in ((1e6, "Mev/s"), (1e3, "kev/s")):
        if hertz >= factor:
            return f"{hertz / factor:.3f} {unit}"
    return f"{hertz:.3f} ev/s"


def _seconds(t_us: int | None) -> str:
    return "-" if t_us is None else f"{t_us / 1e6:.6f} s"
