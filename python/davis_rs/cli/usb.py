"""Runs davis-rs devices, record, decode."""

from __future__ import annotations

import argparse
import errno
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .._util.argument_error import ArgumentError
from .._util.progress import say
from .._util.terminal_text import tell
from ..events.decoded import IMU_DTYPE, Decoded, Frame
from ..io.files.backward import POLICIES, Policy
from ..io.files.decoded_output import DecodedOutput, decoded_output, is_decoded
from ..io.files.read import open_reader
from ..io.files.sensor_size import sensor_size
from ..io.formats.interface import EventReader
from ..io.formats.parts import FRAMES, IMU
from ..io.formats.recorded import RecordedParts
from ..io.recordings import Recording, read_recording
from ..io.recordings.camera_bytes import CameraBytesFile
from ..io.recordings.recording_file import EMPTY
from ..sensor.biases import BIAS_SETS
from ..usb.davis import Davis
from ..usb.description import describe
from ..usb.link import UsbLink, find_devices
from ..usb.protocol import FX3
from ..usb.raw_file import RawRecording, RawWriter
from ..usb.settings import ACCELEROMETER_RANGES_G, GYROSCOPE_RANGES_DEG_S, DavisSettings
from ..usb.virtual_davis import VirtualDavis
from .common import EVENTS_HELP, SCENE_HELP
from .common import sensor_size as sensor_size_of
from .ctrl_c import LINE
from .files import add_max_packet_bytes
from .show import ShownEvents, add_show


def add_devices(devices: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    devices.set_defaults(run=_devices)


def add_record(record: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    record.description = "Record a camera until Ctrl-C, for a given time, or until it is unplugged."
    record.set_defaults(run=_record)
    record.add_argument(
        "-o", "--output", required=True, type=Path, metavar="FILE",
        help="the file to write: .npz (all) or an event file (.txt, .aedat4, ...) decoded, else the camera's bytes",
    )  # fmt: skip
    record.add_argument("--duration", dest="duration_s", type=float, metavar="S", help="seconds to record")
    record.add_argument("--serial", metavar="NUMBER", help="serial number of the camera, if there are several")
    record.add_argument("--virtual", metavar="SCENE", help=f"no camera: one in software that sees {SCENE_HELP}")
    record.add_argument(
        "--biases", choices=tuple(BIAS_SETS), help="biases of the dataset paper; the chip's defaults if not given"
    )
    record.add_argument(
        "--exposure-us", type=int, default=DavisSettings.exposure_us, metavar="US", help="exposure time of frames"
    )
    record.add_argument(
        "--frame-interval-us",
        type=int,
        default=DavisSettings.frame_interval_us,
        metavar="US",
        help="time between frames",
    )
    record.add_argument(
        "--accelerometer-range",
        dest="accelerometer_range_g",
        type=int,
        default=4,
        choices=ACCELEROMETER_RANGES_G,
        help="range in +- g",
    )
    record.add_argument(
        "--gyroscope-range",
        dest="gyroscope_range_deg_s",
        type=int,
        default=500,
        choices=GYROSCOPE_RANGES_DEG_S,
        help="range in +- deg/s",
    )
    add_show(record)
    _add_backward(record)


def add_decode(decode: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    decode.set_defaults(run=_decode)
    decode.add_argument("recording", type=Path, metavar="FILE", help=EVENTS_HELP)
    decode.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT",
        help=".npz (all) or an event file; if not given, count",
    )
    decode.add_argument("--size", type=sensor_size_of, metavar="WxH", help="sensor size, where FILE does not say")
    _add_backward(decode)
    add_max_packet_bytes(decode)


def _add_backward(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--backward",
        choices=POLICIES,
        default="refuse",
        help="what to do if times go back and the format cannot hold that: stop with an error (the default), drop the "
        "older events, or continue in another file",
    )


def _devices(_: argparse.Namespace) -> int:
    devices = find_devices()
    for device in devices:
        kind = "FX3" if device.product == FX3 else "FX2"
        line = f"bus {device.bus} address {device.address}  {kind} firmware {device.firmware}"
        if device.problem is not None:
            tell(f"{line}\n{device.problem}")
            continue
        try:
            link = UsbLink(device)
            try:
                camera = describe(
                    link.read, serial=device.serial or "", product=device.product, firmware=device.firmware
                )
            finally:
                link.close()
            size = f"{camera.device.width} x {camera.device.height}"
            tell(f"{line}  {camera.chip}  serial {camera.serial}  {size}  logic {camera.logic_version}")
        except OSError as error:
            tell(f"{line}  serial {device.serial}\n{error.strerror or error}")
    if not devices:
        tell("no DAVIS camera on the USB", file=sys.stderr)
    return 0 if devices else 1


def _record(options: argparse.Namespace) -> int:
    if options.duration_s is not None and not options.duration_s > 0:
        raise ArgumentError("{duration_s} must be positive, got {}", options.duration_s)
    if options.output.exists():
        raise FileExistsError(f"{options.output} exists: choose another file")
    settings = DavisSettings(
        biases=options.biases or {},
        exposure_us=options.exposure_us,
        frame_interval_us=options.frame_interval_us,
        accelerometer_range_g=options.accelerometer_range_g,
        gyroscope_range_deg_s=options.gyroscope_range_deg_s,
    )
    if options.virtual is None:
        try:
            opened = Davis.open(options.serial, settings=settings)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; --virtual SCENE records a simulated one") from None
        with opened as camera:
            return _record_camera(camera, options, None)

    from ..scene.load import load_scene
    from ..simulation.virtual_scene import virtual_davis_of_scene
    from ..usb.virtual_backend import VirtualBackend

    virtual = virtual_davis_of_scene(load_scene(options.virtual), duration_s=options.duration_s, show_progress=True)
    with Davis.open(options.serial, settings=settings, backend=VirtualBackend(virtual)) as camera:
        return _record_camera(camera, options, virtual)


def _record_camera(camera: Davis, options: argparse.Namespace, virtual: VirtualDavis | None) -> int:
    """Record until the end, however it comes, and complete the file; returns the exit status."""
    raw = not is_decoded(options.output)
    output = RawOutput(options.output, camera) if raw else LiveOutput(options.output, camera, options.backward)
    tell(f"recording {camera.description}; Ctrl-C ends it", file=sys.stderr)
    status = 0
    started = time.monotonic()
    device = camera.description.device
    with ShownEvents(f"{camera.description}: events", wanted=options.show) as shown:
        try:
            for chunk in camera.chunks():
                decoded = output.write(chunk)
                if options.show:
                    events = (camera.decode(chunk) if decoded is None else decoded).events
                    shown.add(events, int(events["t"][-1]) if len(events) else 0, (device.width, device.height))
                if virtual is not None:
                    over = virtual.over.is_set() and not chunk
                else:
                    over = options.duration_s is not None and time.monotonic() - started >= options.duration_s
                if over:
                    camera.stop()
        except KeyboardInterrupt:
            say(LINE)
            status = 130
        except OSError as error:
            if error.errno != errno.ENODEV:
                raise
            tell(f"davis-rs: error: {error.strerror}: the recording ends there", file=sys.stderr)
            status = 1
        finally:
            said = output.finish()
    tell("\n".join(said))
    if camera.lost_bytes:
        tell(f"{camera.lost_bytes} of {camera.received_bytes} bytes were lost", file=sys.stderr)
    return status


class RawOutput:
    """Writes the camera's bytes, as they come."""

    def __init__(self, path: Path, camera: Davis) -> None:
        self._camera = camera
        self._writer = RawWriter(path, camera.description)

    def write(self, chunk: bytes) -> None:
        """Append; nothing is decoded."""
        self._writer.write(chunk)

    def finish(self) -> list[str]:
        """Complete the file; tells how much it is."""
        size = self._writer.finish(lost_bytes=self._camera.lost_bytes)
        return [f"{self._writer.path}: {size} bytes of {self._camera.description}"]


class LiveOutput:
    """Writes the camera's stream, decoded."""

    def __init__(self, path: Path, camera: Davis, backward: Policy) -> None:
        self._camera = camera
        device = camera.description.device
        self._output = decoded_output(path, (device.width, device.height), backward=backward)

    def write(self, chunk: bytes) -> Decoded:
        """Append, and return what the bytes hold."""
        decoded = self._camera.decode(chunk)
        self._output.write(decoded)
        return decoded

    def finish(self) -> list[str]:
        """Complete the file; tells what it holds."""
        return [*self._output.finish(), *_oddities(self._camera.stats)]


def _decode(options: argparse.Namespace) -> int:
    with open_reader(
        options.recording, backward="keep", outside="drop", max_packet_bytes=options.max_packet_bytes
    ) as reader:
        source = _stream(reader, options)
        output: DecodedOutput | None = None
        if options.output is not None:
            size = sensor_size(reader, options.size)
            output = decoded_output(options.output, size, backward=options.backward, whole=True)
        counts = {"events": 0, "IMU samples": 0, "frames": 0, "triggers": 0}
        try:
            for decoded in source.pieces():
                lengths = (len(decoded.events), len(decoded.imu), len(decoded.frames), len(decoded.triggers))
                counts = {kind: count + more for (kind, count), more in zip(counts.items(), lengths, strict=True)}
                if output is not None:
                    output.write(decoded)
            said = [] if output is None else output.finish()
        except BaseException:
            if output is not None:
                output.abandon()
            raise
    totals = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    tell(f"{source.title}: {totals}")
    for line in [*said, *source.remarks()]:
        tell(line)
    for line in source.losses():
        tell(line, file=sys.stderr)
    return 0


def _stream(reader: EventReader, options: argparse.Namespace) -> BytesOfCamera | FileOfSoftware | EventFile:
    if not isinstance(reader, RecordedParts):
        return EventFile(reader)
    if isinstance(reader.recording, CameraBytesFile):
        return BytesOfCamera(reader.recording.raw)
    return FileOfSoftware(read_recording(reader.path, max_packet_bytes=options.max_packet_bytes))


class BytesOfCamera:
    """Reads a recording of a camera's bytes, decoded."""

    def __init__(self, recording: RawRecording) -> None:
        self._recording, self._decoder = recording, recording.decoder()
        self.title = f"{self._recording.camera}, {self._recording.started:%Y-%m-%d %H:%M:%S} UTC"

    def pieces(self) -> Iterator[Decoded]:
        """Yield what it holds, piece by piece."""
        return (self._decoder.push(chunk) for chunk in self._recording.chunks())

    def remarks(self) -> list[str]:
        """Say what was odd."""
        return _oddities(self._decoder.stats)

    def losses(self) -> list[str]:
        """Say what is not there."""
        lost = self._recording.lost_bytes
        said = [f"{lost} bytes had been lost while it was recorded"] if lost else []
        if not self._recording.complete:
            said.append("the recording was not finished: what is there was decoded")
        return said


class FileOfSoftware:
    """Reads an AEDAT file; its times count from its first."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording.from_start()
        started = "" if recording.started is None else f", {recording.started:%Y-%m-%d %H:%M:%S}"
        self.title = f"{recording.format}, {recording.chip or 'unknown chip'}{started}, from {recording.start_us} us on"

    def pieces(self) -> Iterator[Decoded]:
        """Yield all of it."""
        yield self._recording.decoded

    def remarks(self) -> list[str]:
        """Say what was assumed."""
        return list(self._recording.notes)

    def losses(self) -> list[str]:
        """Return nothing: what is cut off was said when it was read."""
        return []


class EventFile:
    """Reads an event file of another format, or a dataset folder: its events, frames and inertial samples."""

    def __init__(self, reader: EventReader) -> None:
        self._reader = reader
        size = "" if reader.size is None else f", {reader.size[0]} x {reader.size[1]} px"
        self.title = f"{reader.format}{size}"

    def pieces(self) -> Iterator[Decoded]:
        """Yield what it holds, kind by kind."""
        for events in self._reader.iter():
            yield EMPTY._replace(events=events)
        if (imu := getattr(self._reader, IMU.read, None)) is not None:
            samples = [(one.t_us, one.acceleration, one.angular_velocity, 0.0) for one in imu()]
            yield EMPTY._replace(imu=np.array(samples, IMU_DTYPE))
        if (images := getattr(self._reader, FRAMES.read, None)) is not None:
            for t_us, grey in images():
                frame = Frame(t_us, t_us, t_us, t_us, 0, 0, grey.astype(np.uint16) << 8)
                yield EMPTY._replace(frames=[frame])

    def remarks(self) -> list[str]:
        """Say what was left out."""
        outside = self._reader.check.dropped_outside
        return [f"{outside} events outside of the sensor left out"] if outside else []

    def losses(self) -> list[str]:
        """Return nothing: what is cut off was said when it was read."""
        return []


def _oddities(stats: dict[str, int]) -> list[str]:
    odd = ", ".join(f"{count} {kind}" for kind, count in stats.items() if count)
    return [f"oddities of the stream: {odd}"] if odd else []
