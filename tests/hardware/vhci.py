"""Plug a USB/IP device into this machine's own kernel, through vhci_hcd: root only."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable
from pathlib import Path

from usbip_server import BUS_ID, HIGH_SPEED, IMPORT_REPLY, IMPORT_REQUEST, VERSION

from davis_rs.usb.protocol import CONFIGURATION, VENDOR

VHCI = Path("/sys/devices/platform/vhci_hcd.0")
PORT = 0
"""Of the virtual hub."""


def attach(port: int = 3240) -> None:
    """Import the device from a server on this machine, give the connection to the kernel, and wait until it is there.

    Raises:
        OSError: if there is no vhci_hcd, no server, the server refuses, or the kernel does not configure the device.
    """
    connection = socket.create_connection(("127.0.0.1", port))
    connection.sendall(struct.pack(">HHI32s", VERSION, IMPORT_REQUEST, 0, BUS_ID.encode()))
    reply = connection.recv(8 + 312, socket.MSG_WAITALL)
    version, command, status = struct.unpack(">HHI", reply[:8])
    if (version, command, status) != (VERSION, IMPORT_REPLY, 0):
        raise OSError(f"the server refused the import of {BUS_ID}: {version:#06x} {command:#06x} {status}")
    bus, device = struct.unpack(">II", reply[8 + 288 : 8 + 296])
    (VHCI / "attach").write_text(f"{PORT} {connection.fileno()} {bus << 16 | device} {HIGH_SPEED}")
    # The kernel holds the socket by itself from here on.
    connection.close()
    _wait(_is_configured, "the kernel did not configure the device")


def detach() -> None:
    """Pull the device out of the port."""
    (VHCI / "detach").write_text(str(PORT))


def wait_until_gone() -> None:
    """Until the kernel has given the port free.

    Raises:
        TimeoutError: if it does not.
    """
    _wait(is_free, "the port is still in use")


def _wait(condition: Callable[[], bool], complaint: str, timeout_s: float = 30.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"vhci_hcd: {complaint}:\n{(VHCI / 'status').read_text()}")
        time.sleep(0.05)


def _is_configured() -> bool:
    return any(
        (device / "idVendor").read_text().strip() == f"{VENDOR:04x}"
        and (device / "bConfigurationValue").read_text().strip() == f"{CONFIGURATION}"
        for device in Path("/sys/bus/usb/devices").iterdir()
        if (device / "idVendor").exists()
    )


def is_free() -> bool:
    """Whether nothing is plugged in."""
    for line in (VHCI / "status").read_text().splitlines():
        fields = line.split()
        if fields[:2] == ["hs", f"{PORT:04}"]:
            return int(fields[2]) == 4  # VDEV_ST_NULL
    return False
