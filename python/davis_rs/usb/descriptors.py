"""Holds the USB descriptors of a DAVIS: what any host reads before it can talk to the camera.

Source: Universal Serial Bus Specification 2.0, section 9.6.
"""

from __future__ import annotations

import struct

from .protocol import CONFIGURATION, DATA_ENDPOINT, DEBUG_ENDPOINT, FX3, INTERFACE, VENDOR

DEVICE, CONFIGURATION_TYPE, STRING, INTERFACE_TYPE, ENDPOINT = 1, 2, 3, 4, 5
BULK, INTERRUPT = 2, 3
PACKET = 512
"""Largest packet of a bulk endpoint at high speed."""

DEVICE_LAYOUT = "<BBHBBBBHHHBBBB"
CONFIGURATION_LAYOUT = "<BBHBBBBB"
INTERFACE_LAYOUT = "<BBBBBBBBB"
ENDPOINT_LAYOUT = "<BBBBHB"


def device_descriptor(product: int, firmware: int) -> bytes:
    """Return the 18 bytes: vendor-specific class, strings 1 (manufacturer), 2 (product) and 3 (serial number)."""
    return struct.pack(DEVICE_LAYOUT, 18, DEVICE, 0x0200, 0xFF, 0, 0, 64, VENDOR, product, firmware, 1, 2, 3, 1)


def endpoint_descriptors(product: int) -> tuple[bytes, ...]:
    """Return endpoints in the order of the interface: the FX3's debug endpoint, the data endpoint."""
    data = struct.pack(ENDPOINT_LAYOUT, 7, ENDPOINT, DATA_ENDPOINT, BULK, PACKET, 0)
    debug = struct.pack(ENDPOINT_LAYOUT, 7, ENDPOINT, DEBUG_ENDPOINT, INTERRUPT, 64, 4)
    return (debug, data) if product == FX3 else (data,)


def interface_descriptor(product: int) -> bytes:
    """Return the one interface, vendor-specific."""
    endpoints = len(endpoint_descriptors(product))
    return struct.pack(INTERFACE_LAYOUT, 9, INTERFACE_TYPE, INTERFACE, 0, endpoints, 0xFF, 0, 0, 0)


def configuration_descriptor(product: int) -> bytes:
    """Return the one configuration with all that follows it: bus powered, 100 mA, which every port grants."""
    descriptors = interface_descriptor(product) + b"".join(endpoint_descriptors(product))
    head = (9, CONFIGURATION_TYPE, 9 + len(descriptors), 1, CONFIGURATION, 0, 0x80, 50)
    return struct.pack(CONFIGURATION_LAYOUT, *head) + descriptors


def string_descriptor(text: str | None) -> bytes:
    """Return a string, or for None the list of languages: English (United States)."""
    body = struct.pack("<H", 0x0409) if text is None else text.encode("utf-16-le")
    return bytes((2 + len(body), STRING)) + body
