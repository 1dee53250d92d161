"""Runs a live camera: ``with Davis.open() as camera: for packet in camera: ...``"""

from __future__ import annotations

import dataclasses
import errno
import time
import warnings
from collections.abc import Iterator
from types import TracebackType
from typing import Any

from .._core import Decoder
from ..events.decoded import Decoded
from ..sensor.biases import as_biases
from . import protocol
from .description import DavisDescription, describe
from .link import FoundDevice, UsbLink, find_devices
from .settings import DavisSettings
from .stream_reader import QUEUE_BYTES, StreamReader

SILENCE_S = 0.1
READS_QUEUED_S = 0.02
"""Waits until the reader's thread is in its first transfer, which should be there before data come."""


class Davis:
    """Controls a camera on the USB; made by :meth:`open`.

    Iterating starts it, unless it runs already, and gives packets as they arrive: arrays of events, IMU samples, frames
    and triggers, times in microseconds since the start or the last timestamp reset. After 0.1 s of silence an empty
    packet comes, so that a loop can look at the clock. The iteration ends after :meth:`stop` when all that had arrived
    was given.

    Data are received by a thread of its own. A program that takes longer for them than the camera to send more loses
    data once ``queue_bytes`` are waiting: a RuntimeWarning says how much, :attr:`lost_bytes` counts, and the events
    after the gap keep their right times. What the camera itself drops while the USB is busy cannot be seen here.

    Attributes:
        description: what it is: chip, sizes, versions.
        settings: how it is set.

    Raises:
        OSError: from everything that talks to it; with errno ENODEV when it was unplugged. Iterating raises that only
            after everything that arrived was given.
    """

    def __init__(
        self, link: UsbLink, description: DavisDescription, settings: DavisSettings, *, queue_bytes: int
    ) -> None:
        self._link = link
        self._queue_bytes = queue_bytes
        self._reader: StreamReader | None = None
        self._decoder: Decoder | None = None
        self._running = False
        self._written = settings.writes(description)
        link.write(self._written)
        self.description = description
        self.settings = settings

    @classmethod
    def open(
        cls,
        serial: str | None = None,
        *,
        settings: DavisSettings | None = None,
        backend: Any = None,
        queue_bytes: int = QUEUE_BYTES,
    ) -> Davis:
        """Find a camera, check that it speaks this protocol, and configure it; it does not run yet.

        Args:
            serial: of the camera; may be left out when there is one.
            settings: how to set it; the vendor's defaults if not given.
            backend: pyusb's, for cameras that are not behind libusb.
            queue_bytes: how much data may wait for the program.

        Raises:
            PermissionError: when the system does not let this user open it; tells the udev rule that is missing.
            OSError: if there is no such camera, several to choose from, one of another version, or one in use.
            ValueError: for settings that the camera cannot have.
        """
        chosen = _choose(find_devices(backend), serial)
        link = UsbLink(chosen)
        try:
            description = describe(
                link.read, serial=chosen.serial or "", product=chosen.product, firmware=chosen.firmware
            )
            return cls(link, description, settings or DavisSettings(), queue_bytes=queue_bytes)
        except BaseException:
            link.close()
            raise

    @property
    def running(self) -> bool:
        """Return whether it was started and not stopped since."""
        return self._running

    @property
    def lost_bytes(self) -> int:
        """Return the number of bytes lost since the start because the program was too slow."""
        return 0 if self._reader is None else self._reader.lost_bytes

    @property
    def received_bytes(self) -> int:
        """Return the number of bytes of the stream that have arrived since the start."""
        return 0 if self._reader is None else self._reader.received_bytes

    @property
    def stats(self) -> dict[str, int]:
        """Counts of faults in the stream since the start, see :attr:`davis_rs.Decoder.stats`."""
        return {} if self._decoder is None else self._decoder.stats

    def start(self) -> None:
        """Let it run; its clock starts at zero. Nothing happens when it runs already."""
        if self._running:
            return
        self._phase(protocol.CLEAN_SLATE)
        self._link.clear_halt()
        self._decoder = Decoder(self.description.device)
        self._reader = StreamReader(self._link, queue_bytes=self._queue_bytes)
        self._running = True
        self._reader.start()
        time.sleep(READS_QUEUED_S)
        for phase in protocol.START:
            self._phase(phase)

    def stop(self) -> None:
        """Stop it; what has arrived can still be taken. Nothing happens when it does not run."""
        if self._reader is None or not self._running:
            return
        self._running = False
        try:
            self._link.write(protocol.STOP)
        except OSError as error:
            if error.errno != errno.ENODEV:
                raise
        finally:
            self._reader.stop()

    def close(self) -> None:
        """Stop it and let go of it."""
        try:
            self.stop()
        finally:
            self._link.close()

    def reset_timestamps(self) -> None:
        """Set its clock to zero; a trigger in the stream says where."""
        self._link.write_at_once(protocol.RESET_TIMESTAMPS)

    def configure(self, **changes: Any) -> None:
        """Change fields of :class:`DavisSettings`, also while it runs; only what differs is written.

        Raises:
            ValueError: for a value that does not exist or that the camera cannot have; nothing is changed.
            TypeError: for a field that does not exist.
        """
        settings = dataclasses.replace(self.settings, **changes)
        writes = settings.writes(self.description)
        self._link.write(after for before, after in zip(self._written, writes, strict=True) if before != after)
        self._written, self.settings = writes, settings

    def set_bias(self, name: str, coarse: int, fine: int) -> None:
        """Set one bias, the others as they are; see :class:`davis_rs.sensor.biases.CoarseFineBias`.

        Raises:
            ValueError: for a bias that the camera does not have or a value out of range.
        """
        self.configure(biases={**as_biases(self.settings.biases), **as_biases({name: (coarse, fine)})})

    def chunks(self) -> Iterator[bytes]:
        """Yield the stream as it comes, in whole words, for recordings; an empty chunk after 0.1 s of silence.

        What one of the two iterators has taken, the other does not see.
        """
        self.start()
        reader = self._reader
        assert reader is not None
        while (chunk := reader.take(SILENCE_S)) is not None:
            if chunk.lost_bytes:
                warnings.warn(
                    f"{chunk.lost_bytes} bytes of the stream of camera {self.description} were lost: the program took "
                    f"them too slowly ({reader.lost_bytes} lost of {reader.received_bytes} since the start)",
                    RuntimeWarning,
                    stacklevel=2,
                )
            yield chunk.data

    def decode(self, chunk: bytes) -> Decoded:
        """Decode a chunk and return what is now complete; pass each of :meth:`chunks` once, in order.

        Raises:
            ValueError: if it was never started.
        """
        if self._decoder is None:
            raise ValueError(f"camera {self.description} was never started: there is nothing of it to decode")
        return self._decoder.push(chunk)

    def __iter__(self) -> Iterator[Decoded]:
        for chunk in self.chunks():
            yield self.decode(chunk)

    def __enter__(self) -> Davis:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Davis {self.description}, {'running' if self._running else 'stopped'}>"

    def _phase(self, phase: protocol.Phase) -> None:
        self._link.write(phase.writes)
        time.sleep(phase.wait_s)


def _choose(devices: list[FoundDevice], serial: str | None) -> FoundDevice:
    openable = [device for device in devices if device.problem is None]
    chosen = [device for device in openable if serial in (None, device.serial)]
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        serials = ", ".join(device.serial or "without a serial number" for device in chosen)
        raise OSError(f"several cameras fit, say which: {serials}")
    for device in devices:
        # Any that could not be asked for its serial number may be the one that is meant.
        if device.problem is not None:
            raise device.problem
    wanted = "DAVIS camera" if serial is None else f"DAVIS camera with the serial number {serial}"
    there = ", ".join(device.serial or "one without a serial number" for device in openable)
    raise FileNotFoundError(f"no {wanted} on the USB" + (f"; there is {there}" if there else ""))
