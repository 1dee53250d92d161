"""Serve a virtual DAVIS over USB/IP: a kernel with vhci_hcd attaches it as if it were plugged in.

    python usbip_server.py --stream FILE [--chip DAVIS346B] [--unplug-after BYTES] [--report FILE]

One connection, then it ends; the report, JSON, tells what the host did to the camera and what it took.

Source: the kernel's Documentation/usb/usbip_protocol.rst.
"""

from __future__ import annotations

import argparse
import errno
import hashlib
import json
import queue
import socket
import struct
import threading
from pathlib import Path

from davis_rs.usb.protocol import CONFIGURATION, DATA_ENDPOINT, FIRMWARE_MIN, VENDOR
from davis_rs.usb.virtual_davis import Stalled, Unplugged, VirtualDavis, paced

VERSION, IMPORT_REQUEST, IMPORT_REPLY = 0x0111, 0x8003, 0x0003
SUBMIT, UNLINK, SUBMIT_REPLY, UNLINK_REPLY = 1, 2, 3, 4
HIGH_SPEED = 3
BUS_ID = "1-1"
DEVICE_ID = 1 << 16 | 1
"""Bus 1, device 1."""


class UsbIpServer:
    """One camera on one connection."""

    def __init__(self, camera: VirtualDavis, connection: socket.socket) -> None:
        self._camera = camera
        self._connection = connection
        self._reads: queue.Queue[tuple[int, int] | None] = queue.Queue()
        # Under the lock, so that the host never sees the end of a transfer after its cancellation.
        self._lock = threading.RLock()
        self._waiting: set[int] = set()
        self._current: int | None = None
        self._cancellations: dict[int, int] = {}

    def serve(self) -> None:
        """Until the host detaches the camera or the camera unplugs itself."""
        version, command, _ = struct.unpack(">HHI", self._receive(8))
        bus_id = self._receive(32).rstrip(b"\0").decode()
        if (version, command, bus_id) != (VERSION, IMPORT_REQUEST, BUS_ID):
            raise ValueError(
                f"expected the import of {BUS_ID}, got {command:#06x} of {bus_id!r}, version {version:#06x}"
            )
        self._send(struct.pack(">HHI", VERSION, IMPORT_REPLY, 0) + self._device())
        bulk = threading.Thread(target=self._serve_reads)
        bulk.start()
        try:
            while True:
                self._serve_request()
        except (ConnectionError, Unplugged, OSError):
            pass
        finally:
            self._reads.put(None)
            self._connection.close()
            bulk.join()

    def _device(self) -> bytes:
        numbers = struct.pack(
            ">IIIHHHBBBBBB",
            *(1, 1, HIGH_SPEED, VENDOR, self._camera.product, FIRMWARE_MIN[self._camera.product]),
            *(0xFF, 0, 0, CONFIGURATION, 1, 1),
        )
        return struct.pack("256s32s", b"/virtual/davis", BUS_ID.encode()) + numbers

    def _serve_request(self) -> None:
        command, sequence, _, inward, endpoint = struct.unpack(">5I", self._receive(20))
        if command == UNLINK:
            (target,) = struct.unpack(">I", self._receive(28)[:4])
            self._unlink(sequence, target)
            return
        _, length, _, _, _, setup = struct.unpack(">IiIII8s", self._receive(28))
        payload = b"" if inward else self._receive(length)
        if endpoint == 0:
            self._control(sequence, setup, payload)
            return
        with self._lock:
            self._waiting.add(sequence)
        # The debug endpoint never has anything to say: its transfers wait until they are cancelled.
        if endpoint == DATA_ENDPOINT & 0x0F and inward:
            self._reads.put((sequence, length))

    def _control(self, sequence: int, setup: bytes, payload: bytes) -> None:
        request_type, request, value, index, length = struct.unpack("<BBHHH", setup)
        inward = bool(request_type & 0x80)
        try:
            answer = self._camera.control(request_type, request, value, index, length if inward else payload)
        except Stalled:
            self._reply(sequence, -errno.EPIPE, b"")
            return
        self._reply(sequence, 0, answer, length=len(answer) if inward else len(payload))

    def _unlink(self, sequence: int, target: int) -> None:
        with self._lock:
            if target == self._current:
                self._cancellations[target] = sequence  # the reading thread answers, for it may have data just now
            else:
                self._reply_to_unlink(sequence, -errno.ECONNRESET if target in self._waiting else 0)
                self._waiting.discard(target)

    def _serve_reads(self) -> None:
        try:
            while (read := self._reads.get()) is not None:
                self._serve_read(*read)
        except Unplugged:
            self._connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # the host went away

    def _serve_read(self, sequence: int, size: int) -> None:
        with self._lock:
            if sequence not in self._waiting:
                return
            self._waiting.discard(sequence)
            self._current = sequence
        data = b""
        while not data and sequence not in self._cancellations:
            data = self._camera.read(size, 0.01)
        with self._lock:
            self._current = None
            if data:
                self._reply(sequence, 0, data)
            cancelled_by = self._cancellations.pop(sequence, None)
            if cancelled_by is not None:
                self._reply_to_unlink(cancelled_by, 0 if data else -errno.ECONNRESET)

    def _reply(self, sequence: int, status: int, data: bytes, *, length: int | None = None) -> None:
        length = len(data) if length is None else length
        head = struct.pack(">5Iii12x8x", SUBMIT_REPLY, sequence, 0, 0, 0, status, length)
        self._send(head + data)

    def _reply_to_unlink(self, sequence: int, status: int) -> None:
        self._send(struct.pack(">5Ii24x", UNLINK_REPLY, sequence, 0, 0, 0, status))

    def _send(self, data: bytes) -> None:
        with self._lock:
            self._connection.sendall(data)

    def _receive(self, size: int) -> bytes:
        received = bytearray()
        while len(received) < size:
            part = self._connection.recv(size - len(received))
            if not part:
                raise ConnectionError("the host detached the camera")
            received += part
        return bytes(received)


def main() -> None:
    """Serve one connection."""
    parser = argparse.ArgumentParser(description="Serve a virtual DAVIS over USB/IP.")
    parser.add_argument("--stream", type=Path, required=True, help="the words it sends")
    parser.add_argument("--chip", default="DAVIS240C")
    parser.add_argument("--rate", type=float, default=1e6, help="bytes a second")
    parser.add_argument("--unplug-after", type=int, metavar="BYTES")
    parser.add_argument("--port", type=int, default=3240)
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    source = paced(options.stream.read_bytes(), bytes_per_s=options.rate)
    camera = VirtualDavis(source, chip=options.chip, unplug_after=options.unplug_after)
    with socket.create_server(("127.0.0.1", options.port)) as listening:
        print("listening", flush=True)
        connection, _ = listening.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    UsbIpServer(camera, connection).serve()
    if options.report is not None:
        sent = {"bytes": len(camera.sent), "sha256": hashlib.sha256(camera.sent).hexdigest()}
        options.report.write_text(json.dumps({"log": camera.log, "sent": sent}))


if __name__ == "__main__":
    main()
