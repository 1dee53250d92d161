"""Writes a sequence for the viewer of Rerun (https://rerun.io): all that it has, on one timeline."""

from __future__ import annotations

import io
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.array_types import AnyArray
from .._util.close_names import names_checked
from .._util.extras import from_extra
from .._util.progress import each
from .._util.srgb import to_srgb
from .._util.whole_file import whole_file
from .figure import OFF_RGB, ON_RGB, event_picture
from .flow_picture import flow_picture
from .sampling_for_display import evenly_spaced, event_counts, sample_events
from .visual_sequence import VisualSequence, open_visual_sequence

MAX_EVENTS = 2_000_000
"""Events that the space-time cloud keeps by default: 16 bytes each."""

_TIMELINE = "time"
_INTERVALS_WITHOUT_FRAMES, _RATE_BINS = 200, 500
_CLOUD_INTERVALS = 4
"""The cloud shows the events of this number of intervals between frames. It is about as long as the sensor is wide."""


@dataclass(frozen=True)
class RerunRecording:
    """Reports what was handed to Rerun; ``str()`` of it is a few lines.

    Attributes:
        path: the file, None where it went to a viewer.
        kept: how many of the source's ``events`` are in the cloud and how many there are; likewise ``frames``,
            ``depth maps``, ``flow maps``, ``IMU samples`` and ``poses``. What the source does not have is not listed.
        notes: what is shown otherwise than it is.
    """

    path: Path | None
    kept: dict[str, tuple[int, int]]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        kept = ", ".join(f"{some:,} of {total:,} {name}" for name, (some, total) in self.kept.items())
        return "\n".join([f"{self.path or 'Rerun viewer'}: {kept}", *self.notes])


@names_checked
def view_rerun(
    source: str | Path,
    output: str | Path | None = None,
    *,
    size: tuple[int, int] | None = None,
    max_events: int = MAX_EVENTS,
    max_frames: int | None = None,
    show_progress: bool = False,
) -> RerunRecording:
    """Show a sequence in Rerun's viewer, or write it as a ``.rrd`` file.

    On one timeline, ``time``, in the source's own times: frames, events accumulated from frame to frame (all of them)
    and as a cloud of (x, y, t), depth, optical flow (as the usual colour wheel), the camera's pose and pinhole, its
    path, IMU samples and event rates. Frames hold linear light and are shown with sRGB's transfer curve.

    Args:
        source: a dataset folder, an event file of any format, or a recording (AEDAT, or a camera's bytes).
        output: the file to write, ``.rrd``; if None, a viewer is started and shows it.
        size: (width, height) of the sensor in pixels, where the source does not say.
        max_events: events that the cloud keeps, at least 1.
        max_frames: frames, depth maps and flow maps that are kept, of each at least 1; all if None.
        show_progress: how far it is, on standard error.

    Returns:
        What was handed on.

    Raises:
        ImportError: without Rerun's SDK, saying how to get it.
        ValueError: for another suffix, a number that is not at least 1, a size that nobody knows, or a sequence in
            which nothing has a time.
        DecodeError, OSError: if the source cannot be read or the file cannot be written.
    """
    output = None if output is None else Path(output)
    if output is not None and output.suffix.lower() != ".rrd":
        raise ValueError(f"the name of a recording for Rerun must end in .rrd, got {output}")
    for name, number in (("max_events", max_events), ("max_frames", max_frames)):
        if number is not None:
            check_number(name, number, 1, whole=True)
    rr = _rerun()
    sequence = open_visual_sequence(source, size=size)
    if not len(sequence.events) and not sequence.frame_times:
        raise ValueError(f"{source} has neither events nor frames: there is nothing to show in Rerun")
    stream = rr.RecordingStream("davis_rs")
    writer = _RerunWriter(rr, stream, sequence, max_frames, show_progress)
    with nullcontext() if output is None else whole_file(output) as working_path:
        if working_path is None:
            stream.spawn(default_blueprint=writer.blueprint())
        else:
            working_path.open("ab").close()  # the SDK would only log that it cannot write
            stream.save(working_path, default_blueprint=writer.blueprint())
        stream.send_recording_name(sequence.label)
        writer.frames()
        writer.accumulated_events()
        writer.event_cloud(max_events)
        writer.event_rates()
        writer.depth_and_flow()
        writer.camera()
        writer.imu()
        stream.flush()
        stream.disconnect()
    return RerunRecording(output, writer.kept, tuple(writer.notes))


def _rerun() -> Any:
    with from_extra("rerun"):
        import rerun
    return rerun


class _RerunWriter:
    """Logs the parts of a sequence one after the other, and notes what it kept of them."""

    def __init__(self, rr: Any, stream: Any, sequence: VisualSequence, max_frames: int | None, show: bool) -> None:
        self.kept: dict[str, tuple[int, int]] = {}
        self.notes: list[str] = []
        self._rr, self._stream, self._sequence, self._show = rr, stream, sequence, show
        self._most = max_frames
        numbers = self._chosen(len(sequence.frame_times))
        instants = [sequence.frame_times[number] for number in numbers]
        if len(instants) < 2:
            span = np.linspace(sequence.start_us, sequence.end_us, _INTERVALS_WITHOUT_FRAMES + 1)
            instants = sorted({*span.round().astype(np.int64).tolist(), *instants})
        elif instants[-1] < sequence.end_us:
            instants.append(sequence.end_us)
        self._frame_numbers, self._instants = numbers, instants
        self._interval_us = max(1.0, (instants[-1] - instants[0]) / max(1, len(instants) - 1))

    def blueprint(self) -> Any:
        """Return how the viewer arranges it."""
        import rerun.blueprint as rrb

        sequence = self._sequence
        recent = rrb.VisibleTimeRange(
            _TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_CLOUD_INTERVALS * self._interval_us / 1e6),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        pictures = [rrb.Spatial2DView(origin="events/accumulated", name="events")]
        if sequence.frame_times:
            pictures.insert(0, rrb.Spatial2DView(origin="camera/image", contents="camera/image/frame", name="frame"))
        if sequence.depth_times:
            pictures.append(rrb.Spatial2DView(origin="camera/image", contents="camera/image/depth", name="depth"))
        if sequence.flow_times:
            pictures.append(rrb.Spatial2DView(origin="flow", name="optical flow"))
        spaces = [rrb.Spatial3DView(origin="events/cloud", name="events in space and time", time_ranges=[recent])]
        if len(sequence.read_poses().t_us):
            spaces.append(rrb.Spatial3DView(origin="/", contents=["camera/**", "path"], name="camera"))
        plots = [rrb.TimeSeriesView(origin="events/rate", name="event rate (events/s)")]
        if len(sequence.read_imu()):
            plots.append(rrb.TimeSeriesView(origin="imu/acceleration", name="acceleration (m/s²)"))
            plots.append(rrb.TimeSeriesView(origin="imu/angular_rate", name="angular rate (rad/s)"))
        rows = rrb.Vertical(
            rrb.Grid(*pictures), rrb.Horizontal(*spaces), rrb.Horizontal(*plots), row_shares=[3, 3, 1.5]
        )
        return rrb.Blueprint(rows, rrb.TimePanel(timeline=_TIMELINE), collapse_panels=True)

    def frames(self) -> None:
        """Log intensity frames, as PNG."""
        sequence, numbers = self._sequence, self._frame_numbers
        if not sequence.frame_times:
            return
        for number in each(numbers, "frames", len(numbers), unit="frames", show=self._show):
            self._at(sequence.frame_times[number])
            grey = np.rint(255 * np.clip(to_srgb(sequence.read_frame(number)), 0, 1)).astype(np.uint8)
            self._log_picture("camera/image/frame", grey)
        self.kept["frames"] = len(numbers), len(sequence.frame_times)

    def accumulated_events(self) -> None:
        """Log all events since the instant before, ON red and OFF blue."""
        events, (width, height) = self._sequence.events, self._sequence.size
        white, done = np.ones((height, width)), 0
        for t_us in each(self._instants, "event pictures", len(self._instants), unit="pictures", show=self._show):
            until = int(np.searchsorted(events["t"], t_us, side="right"))
            self._at(t_us)
            self._log_picture("events/accumulated", event_picture(white, events[done:until]))
            done = until

    def event_cloud(self, most: int) -> None:
        """Log events as points (x, y, t), with y upwards in the picture."""
        rr, sequence = self._rr, self._sequence
        kept = sample_events(sequence.events, most)
        self.kept["events"] = len(kept), len(sequence.events)
        per_us = sequence.size[0] / (_CLOUD_INTERVALS * self._interval_us)
        self._stream.log("events/cloud", rr.ViewCoordinates.RDF, static=True)
        ends = np.searchsorted(kept["t"], self._instants, side="right")
        for t_us, first, last in zip(self._instants, [0, *ends[:-1]], ends, strict=True):
            points = kept[first:last]
            away = (points["t"] - sequence.start_us) * per_us
            positions = np.stack([points["x"], points["y"], away], -1).astype(np.float32)
            colours = np.where(points["p"][:, None] == 1, ON_RGB, OFF_RGB).astype(np.uint8)
            self._at(t_us)
            self._stream.log("events/cloud", rr.Points3D(positions, colors=colours, radii=rr.Radius.ui_points(1.0)))

    def event_rates(self) -> None:
        """Log ON and OFF events per second, of all events."""
        rr, sequence = self._rr, self._sequence
        bin_us, on, off = event_counts(sequence.events, sequence.start_us, sequence.end_us, _RATE_BINS)
        middles = sequence.start_us + (np.arange(len(on)) + 0.5) * bin_us
        rates = np.stack([on, off], -1) * (1e6 / bin_us)
        colours = [ON_RGB, OFF_RGB]
        self._stream.log("events/rate", rr.SeriesLines(names=["ON", "OFF"], colors=colours), static=True)
        self._send("events/rate", middles, rr.Scalars.columns(scalars=rates))

    def depth_and_flow(self) -> None:
        """Log depth in metres (0 where nothing is hit), and flow as colours."""
        rr, sequence = self._rr, self._sequence
        depth, flow = sequence.depth_times, sequence.flow_times
        for number in (numbers := self._chosen(len(depth))):
            self._at(depth[number])
            metres = sequence.read_depth(number)
            self._stream.log(
                "camera/image/depth", rr.DepthImage(np.where(np.isfinite(metres), metres, np.float32(0)), meter=1.0)
            )
            self.kept["depth maps"] = len(numbers), len(depth)
        if not flow:
            return
        numbers = self._chosen(len(flow))
        fastest = max(_fastest(sequence.read_flow(number)) for number in numbers)
        for number in numbers:
            self._at(flow[number])
            self._log_picture("flow", flow_picture(sequence.read_flow(number), fastest))
        self.kept["flow maps"] = len(numbers), len(flow)
        self.notes.append(f"optical flow: full colour is {fastest:,.0f} px/s in all its pictures")

    def camera(self) -> None:
        """Log poses, path and pinhole. Rerun has pixel centres at halves."""
        rr, sequence, poses = self._rr, self._sequence, self._sequence.read_poses()
        if len(poses.t_us):
            columns = rr.Transform3D.columns(translation=poses.positions, quaternion=poses.quaternions)
            self._send("camera", poses.t_us, columns)
            self._stream.log("path", rr.LineStrips3D([poses.positions]), static=True)
            self.kept["poses"] = len(poses.t_us), len(poses.t_us)
        camera = sequence.read_camera()
        if camera is None:
            return
        matrix = [[camera.fx, 0, camera.cx + 0.5], [0, camera.fy, camera.cy + 0.5], [0, 0, 1]]
        pinhole = rr.Pinhole(image_from_camera=matrix, resolution=sequence.size, camera_xyz=rr.ViewCoordinates.RDF)
        self._stream.log("camera/image", pinhole, static=True)
        if any((camera.k1, camera.k2, camera.p1, camera.p2, camera.k3)):
            self.notes.append("the lens's distortion is left out in 3D, because Rerun's camera is a pinhole")

    def imu(self) -> None:
        """Log acceleration and angular rate along x, y and z."""
        rr, imu = self._rr, self._sequence.read_imu()
        if not len(imu):
            return
        for entity, name in (("imu/acceleration", "accel"), ("imu/angular_rate", "gyro")):
            self._stream.log(entity, rr.SeriesLines(names=["x", "y", "z"]), static=True)
            self._send(entity, imu["t"], rr.Scalars.columns(scalars=imu[name]))
        self.kept["IMU samples"] = len(imu), len(imu)

    def _chosen(self, count: int) -> list[int]:
        return evenly_spaced(count, self._most or count).tolist()

    def _at(self, t_us: int) -> None:
        self._stream.set_time(_TIMELINE, duration=np.timedelta64(int(t_us), "us"))

    def _send(self, entity: str, t_us: AnyArray, columns: Any) -> None:
        times = np.rint(1000 * np.asarray(t_us)).astype("timedelta64[ns]")
        self._stream.send_columns(entity, [self._rr.TimeColumn(_TIMELINE, duration=times)], columns)

    def _log_picture(self, entity: str, pixels: npt.NDArray[np.uint8]) -> None:
        from PIL import Image

        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, "PNG")
        self._stream.log(entity, self._rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"))


def _fastest(flow: npt.NDArray[np.float32]) -> float:
    """Return the speed that 99 % of the pixels do not exceed."""
    speed = np.hypot(flow[..., 0], flow[..., 1])
    return float(np.nanpercentile(speed, 99)) if np.isfinite(speed).any() else 1.0
