"""Gives pyusb a backend whose devices are virtual cameras: everything above libusb runs as with a real one."""

from __future__ import annotations

import errno
import struct
from array import array
from collections.abc import Iterator, Sequence
from types import SimpleNamespace

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from . import descriptors
from .protocol import DATA_ENDPOINT
from .virtual_davis import Stalled, Unplugged, VirtualDavis

_DEVICE_FIELDS = (
    "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 idVendor idProduct "
    "bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations"
)
_CONFIGURATION_FIELDS = (
    "bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes bMaxPower"
)
_INTERFACE_FIELDS = (
    "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass bInterfaceSubClass "
    "bInterfaceProtocol iInterface"
)
_ENDPOINT_FIELDS = "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval"


class VirtualBackend(IBackend):  # type: ignore[misc]  # pyusb has no types
    """pyusb's interface to devices, as far as a camera needs it.

    Give it to :meth:`davis_rs.Davis.open` or to ``usb.core.find``; the cameras are on bus 1, at addresses from 1.
    """

    def __init__(self, *cameras: VirtualDavis) -> None:
        super().__init__()
        self._cameras = cameras

    def enumerate_devices(self) -> Iterator[VirtualDavis]:
        """Yield the cameras that are plugged in."""
        return (camera for camera in self._cameras if camera.plugged)

    def get_parent(self, device: VirtualDavis) -> None:
        """No hub is above."""

    def get_device_descriptor(self, device: VirtualDavis) -> SimpleNamespace:
        """Return the descriptor of a camera, with its bus and address."""
        number = self._cameras.index(device) + 1
        location = {"bus": 1, "address": number, "port_number": number, "port_numbers": (number,), "speed": 3}
        content = _control(device, 0x80, 6, descriptors.DEVICE << 8, 0, 18)
        return _parse(content, descriptors.DEVICE_LAYOUT, _DEVICE_FIELDS, **location)

    def get_configuration_descriptor(self, device: VirtualDavis, configuration: int) -> SimpleNamespace:
        """Return the one configuration."""
        if configuration:
            raise IndexError(f"a camera has one configuration, not {configuration + 1}")
        content = _control(device, 0x80, 6, descriptors.CONFIGURATION_TYPE << 8, 0, 9)
        return _parse(content, descriptors.CONFIGURATION_LAYOUT, _CONFIGURATION_FIELDS, extra_descriptors=[])

    def get_interface_descriptor(self, device: VirtualDavis, interface: int, setting: int, _: int) -> SimpleNamespace:
        """Return the one interface."""
        if interface or setting:
            raise IndexError(f"a camera has one interface and setting, not {interface + 1} and {setting + 1}")
        content = descriptors.interface_descriptor(device.product)
        return _parse(content, descriptors.INTERFACE_LAYOUT, _INTERFACE_FIELDS, extra_descriptors=[])

    def get_endpoint_descriptor(
        self, device: VirtualDavis, endpoint: int, _interface: int, _setting: int, _configuration: int
    ) -> SimpleNamespace:
        """Return an endpoint by its place in the interface."""
        content = descriptors.endpoint_descriptors(device.product)[endpoint]
        audio = {"bRefresh": 0, "bSynchAddress": 0}
        return _parse(content, descriptors.ENDPOINT_LAYOUT, _ENDPOINT_FIELDS, **audio, extra_descriptors=[])

    def open_device(self, device: VirtualDavis) -> VirtualDavis:
        """Open the camera, which is its own handle."""
        return device

    def close_device(self, handle: VirtualDavis) -> None:
        """Do nothing: there is nothing to give back."""

    def set_configuration(self, handle: VirtualDavis, value: int) -> None:
        """Do as the host does it."""
        _control(handle, 0x00, 9, value, 0, b"")

    def get_configuration(self, handle: VirtualDavis) -> int:
        """Do as the host does it."""
        return _control(handle, 0x80, 8, 0, 0, 1)[0]

    def claim_interface(self, handle: VirtualDavis, interface: int) -> None:
        """Do nothing: nobody else can have the interface."""

    def release_interface(self, handle: VirtualDavis, interface: int) -> None:
        """Do nothing: nobody else wants the interface."""

    def clear_halt(self, handle: VirtualDavis, endpoint: int) -> None:
        """Do as the host does it."""
        _control(handle, 0x02, 1, 0, endpoint, b"")

    def ctrl_transfer(
        self, handle: VirtualDavis, request_type: int, request: int, value: int, index: int, data: array[int], _: int
    ) -> int:
        """Make a control transfer, and return how many bytes were transferred."""
        if not request_type & 0x80:
            _control(handle, request_type, request, value, index, data.tobytes())
            return len(data)
        return _fill(data, _control(handle, request_type, request, value, index, len(data)))

    def bulk_read(self, handle: VirtualDavis, endpoint: int, interface: int, buffer: array[int], timeout: int) -> int:
        """Make a bulk transfer, timeout in milliseconds, and return how many bytes were transferred."""
        if endpoint != DATA_ENDPOINT:
            raise _error("endpoint has no data", errno.EINVAL)
        try:
            data = handle.read(len(buffer), timeout / 1000)
        except Unplugged:
            raise _error("no such device", errno.ENODEV) from None
        if not data:
            raise USBTimeoutError("operation timed out", None, errno.ETIMEDOUT)
        return _fill(buffer, data)


def _parse(content: bytes, layout: str, fields: str, **more: object) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip(fields.split(), struct.unpack(layout, content), strict=True)), **more)


def _fill(buffer: array[int], data: Sequence[int]) -> int:
    buffer[: len(data)] = array("B", data)
    return len(data)


def _error(text: str, number: int) -> USBError:
    return USBError(text, None, number)


def _control(camera: VirtualDavis, request_type: int, request: int, value: int, index: int, data: bytes | int) -> bytes:
    try:
        return camera.control(request_type, request, value, index, data)
    except Stalled as stall:
        raise _error(f"pipe error: {stall}", errno.EPIPE) from None
    except Unplugged:
        raise _error("no such device", errno.ENODEV) from None
