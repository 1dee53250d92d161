"""Runs a DAVIS in software: its descriptors, its registers, and a stream that runs as the registers say.

It knows nothing of pyusb, sockets or threads of its own: :mod:`davis_rs.usb.virtual_backend` gives it to pyusb, and a
USB/IP server can give it to a kernel. It stands for the camera's logic and USB controller; what its pixels see is the
source's matter.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from . import descriptors, protocol
from .protocol import Register, Write

Source = Callable[[], Iterable[tuple[int, bytes]]]
"""Gives the stream from time 0: pairs of a time in microseconds, never falling, and whole words that are ready then.

Called anew whenever the camera's clock starts at zero: at a start and at a timestamp reset.
"""


class VirtualChip(NamedTuple):
    """What a chip's registers tell: sizes and orientations on the wire, clocks in MHz."""

    identifier: int
    product: int
    columns: int
    rows: int
    dvs_orientation: int
    aps_orientation: int
    imu_type: int
    imu_flips: int
    clocks_mhz: tuple[int, int, int]


VIRTUAL_CHIPS = {
    "DAVIS240C": VirtualChip(2, protocol.FX2, 240, 180, 0, 0, 1, 0, (90, 30, 30)),
    "DAVIS346B": VirtualChip(5, protocol.FX3, 260, 346, 4, 4, 1, 0, (120, 30, 80)),
}


class Stalled(Exception):
    """The device refuses a request, as USB says it: by a stall."""


class Unplugged(Exception):
    """The device is gone."""


class VirtualDavis:
    """A camera at high speed on a USB port.

    Args:
        source: what it sends while it runs.
        chip: DAVIS240C or DAVIS346B.
        serial: at most 8 characters.
        unplug_after: the number of bytes of data after which it is unplugged.
        speed: seconds of the stream in a second; more than 1 sends faster than a camera would.

    Attributes:
        registers: contents by address; what was never written is 0.
        log: what the host did to it, in order: every :class:`~davis_rs.usb.protocol.Write` and the words
            "configuration", "clear halt" and "reading" (the first read after that).
        sent: all data that the host took.
        over: set when the source has ended and the host has taken everything.

    Raises:
        ValueError: for an unknown chip or a serial number that is too long.
    """

    def __init__(
        self,
        source: Source,
        *,
        chip: str = "DAVIS240C",
        serial: str = "VIRTUAL",
        unplug_after: int | None = None,
        speed: float = 1.0,
    ) -> None:
        if chip not in VIRTUAL_CHIPS:
            raise ValueError(f"a virtual camera is one of {', '.join(VIRTUAL_CHIPS)}, got {chip!r}")
        if not 0 < len(serial) <= 8:
            raise ValueError(f"a serial number has 1 to 8 characters, got {serial!r}")
        self.chip, self.serial, self.product = chip, serial, VIRTUAL_CHIPS[chip].product
        self.registers = _read_only_registers(VIRTUAL_CHIPS[chip])
        self.log: list[Write | str] = []
        self.sent = bytearray()
        self.over = threading.Event()
        self._source, self._speed, self._unplug_after = source, speed, unplug_after
        self._configuration = 0
        self._plugged = True
        self._changed = threading.Condition()
        self._stream: Iterator[tuple[int, bytes]] | None = None
        self._started = 0.0
        self._next: tuple[int, bytes] | None = None
        self._ready = bytearray()
        self._reading = False

    def unplug(self) -> None:
        """Pull it out: from now on everything raises :class:`Unplugged`."""
        with self._changed:
            self._plugged = False
            self._changed.notify_all()

    @property
    def plugged(self) -> bool:
        """Whether it is still there."""
        return self._plugged

    @property
    def streaming(self) -> bool:
        """Whether the registers let data through."""
        path = (protocol.CHIP_RUN, protocol.USB_RUN, protocol.TIMESTAMP_RUN, protocol.MULTIPLEXER_RUN)
        on = self.registers.get
        return all(on(register) for register in path) and any(on(sensor) for sensor in protocol.SENSORS_RUN)

    def control(self, request_type: int, request: int, value: int, index: int, data: bytes | int) -> bytes:
        """Make a control transfer; ``data`` is what the host sends, or the length it asks for.

        Raises:
            Stalled: for a request that no DAVIS knows.
            Unplugged: once it is.
        """
        with self._changed:
            if not self._plugged:
                raise Unplugged
            if isinstance(data, int):
                return self._answer(request_type, request, value, index)[:data]
            self._obey(request_type, request, value, index, data)
            return b""

    def _answer(self, request_type: int, request: int, value: int, index: int) -> bytes:
        if (request_type, request) == (protocol.REQUEST_IN, protocol.REQUEST_REGISTER):
            return protocol.encode_value(self.registers.get(Register(value, index), 0))
        match request_type, request, value >> 8:
            case 0x80, 6, descriptors.DEVICE:
                return descriptors.device_descriptor(self.product, protocol.FIRMWARE_MIN[self.product])
            case 0x80, 6, descriptors.CONFIGURATION_TYPE:
                return descriptors.configuration_descriptor(self.product)
            case 0x80, 6, descriptors.STRING if value & 0xFF < 4:
                strings = (None, "iniVation", f"{self.chip} (virtual)", self.serial)
                return descriptors.string_descriptor(strings[value & 0xFF])
            case 0x80, 8, _:
                return bytes((self._configuration,))
            case ((0x80 | 0x81 | 0x82), 0, _):
                return b"\0\0"
        raise Stalled(f"request {request_type:#04x} {request:#04x}, value {value:#06x}, index {index:#06x}")

    def _obey(self, request_type: int, request: int, value: int, index: int, data: bytes) -> None:
        match request_type, request:
            case protocol.REQUEST_OUT, protocol.REQUEST_REGISTER if len(data) == 4:
                self._write(Write(value, index, int.from_bytes(data, "big")))
            case protocol.REQUEST_OUT, protocol.REQUEST_REGISTERS if len(data) == 6 * value:
                for write in protocol.decode_writes(data):
                    self._write(write)
            case 0x00, 9 if value in (0, protocol.CONFIGURATION):
                self._configuration = value
                self.log.append("configuration")
            case 0x01, 11 if value == 0:
                pass  # the one alternate setting of the one interface
            case 0x02, 1 if index == protocol.DATA_ENDPOINT:
                self._reading = False
                self.log.append("clear halt")
            case _:
                raise Stalled(f"request {request_type:#04x} {request:#04x}, value {value:#06x}, index {index:#06x}")

    def _write(self, write: Write) -> None:
        was_streaming = self.streaming
        if write.module != protocol.Module.SYSTEM:
            self.registers[write.register] = write.value
        self.log.append(write)
        if write == protocol.RESET_TIMESTAMPS[0]:
            # What the sensor saw before is in the way to the host already; the clock is what starts again.
            self._collect()
            self._restart()
            self._ready += protocol.RESET_WORD.to_bytes(2, "little")
        elif self.streaming and not was_streaming:
            self._ready.clear()
            self._restart()
        elif was_streaming and not self.streaming:
            self._stream, self._next = None, None
        self._changed.notify_all()

    def _restart(self) -> None:
        self._stream = iter(self._source()) if self.streaming else None
        self._next = None
        self._started = time.monotonic()
        self.over.clear()

    def _collect(self) -> float | None:
        """Move what is due into the way to the host; returns how long until more is due, None if nothing is to come."""
        while self._stream is not None:
            self._next = self._next or next(self._stream, None)
            if self._next is None:
                self._stream = None
                break
            wait = self._started + self._next[0] * 1e-6 / self._speed - time.monotonic()
            if wait > 0:
                return wait
            self._ready += self._next[1]
            self._next = None
        return None

    def read(self, size: int, timeout_s: float) -> bytes:
        """Make a bulk transfer from the data endpoint: return at most ``size`` bytes of what is there.

        Raises:
            Unplugged: once it is; what was taken before stays taken.
        """
        deadline = time.monotonic() + timeout_s
        with self._changed:
            if not self._reading:
                self._reading = True
                self.log.append("reading")
            while True:
                if not self._plugged:
                    raise Unplugged
                due = self._collect()
                if self._ready:
                    return self._take(size)
                if self.streaming and due is None:
                    self.over.set()
                left = deadline - time.monotonic()
                if left <= 0:
                    return b""
                self._changed.wait(left if due is None else min(left, due))

    def _take(self, size: int) -> bytes:
        if self._unplug_after is not None:
            size = min(size, self._unplug_after - len(self.sent))
        data = bytes(self._ready[:size])
        del self._ready[:size]
        self.sent += data
        if len(self.sent) == self._unplug_after:
            self._plugged = False
        return data


def paced(stream: bytes, *, bytes_per_s: float = 2e6, chunk: int = 4096) -> Source:
    """Return a source that sends the given words at a steady rate, ``chunk`` bytes at a time.

    Raises:
        ValueError: if the stream or the chunks are not whole words.
    """
    if len(stream) % 2 or chunk % 2:
        raise ValueError(f"words have two bytes: got a stream of {len(stream)} bytes, sent {chunk} at a time")

    def source() -> Iterator[tuple[int, bytes]]:
        for at in range(0, len(stream), chunk):
            yield round(at / bytes_per_s * 1e6), stream[at : at + chunk]

    return source


def _read_only_registers(chip: VirtualChip) -> dict[Register, int]:
    logic_mhz, adc_mhz, usb_mhz = chip.clocks_mhz
    return {
        protocol.DVS_COLUMNS: chip.columns,
        protocol.DVS_ROWS: chip.rows,
        protocol.DVS_ORIENTATION: chip.dvs_orientation,
        protocol.APS_COLUMNS: chip.columns,
        protocol.APS_ROWS: chip.rows,
        protocol.APS_ORIENTATION: chip.aps_orientation,
        protocol.APS_HAS_GLOBAL_SHUTTER: 1,
        protocol.IMU_TYPE: chip.imu_type,
        protocol.IMU_FLIPS: chip.imu_flips,
        protocol.SYSTEM_LOGIC_VERSION: protocol.LOGIC_VERSION,
        protocol.SYSTEM_CHIP: chip.identifier,
        protocol.SYSTEM_MASTER: 1,
        protocol.SYSTEM_LOGIC_MHZ: logic_mhz,
        protocol.SYSTEM_ADC_MHZ: adc_mhz,
        protocol.SYSTEM_USB_MHZ: usb_mhz,
        protocol.SYSTEM_DEVIATION: 1000,
        protocol.SYSTEM_LOGIC_PATCH: protocol.LOGIC_PATCH_MIN,
    }
