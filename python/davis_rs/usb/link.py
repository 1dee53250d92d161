"""Talks to a camera on the USB, through pyusb: finds it, reads and writes its registers, receives its data.

Every refusal of the system becomes an OSError that says what to do about it.
"""

from __future__ import annotations

import errno
import time
from array import array
from collections.abc import Iterable
from typing import Any, NamedTuple

from . import protocol
from .protocol import Register, Write

UDEV_RULE = 'SUBSYSTEM=="usb", ATTR{idVendor}=="152a", ATTR{idProduct}=="841[ab]", MODE="0666", TAG+="uaccess"'
"""What lets users open the camera, in a file such as /etc/udev/rules.d/65-davis.rules."""

_NONSENSE = (ValueError, LookupError, TypeError, AttributeError)
"""What pyusb raises, besides the system's errors, where descriptors or replies are not what USB says."""

_NO_PERMISSION = (
    "no permission to open the camera at {location}. A udev rule is missing; put this line into "
    "/etc/udev/rules.d/65-davis.rules:\n    {rule}\n"
    "then run: sudo udevadm control --reload && sudo udevadm trigger, and plug the camera in again"
)


class FoundDevice(NamedTuple):
    """Holds a device that has a DAVIS's vendor and product.

    Where it could not be opened, ``serial`` is None and ``problem`` says why.
    """

    bus: int
    address: int
    product: int
    firmware: int
    serial: str | None
    problem: OSError | None
    device: Any


def find_devices(backend: Any = None) -> list[FoundDevice]:
    """Return all cameras that are plugged in, in the order of bus and address; ``backend`` is pyusb's, libusb by
    default.

    Raises:
        OSError: if libusb itself is not installed.
    """
    import usb.control
    import usb.core
    import usb.util

    try:
        devices = list(usb.core.find(find_all=True, backend=backend, idVendor=protocol.VENDOR))
    except usb.core.NoBackendError:
        raise OSError("libusb 1.0 was not found; on Debian: apt-get install libusb-1.0-0") from None
    except OSError as error:
        raise OSError(error.errno or errno.EIO, f"the devices on the USB cannot be listed: {error}") from error
    cameras = []
    for device in sorted(devices, key=lambda device: (device.bus, device.address)):
        if device.idProduct not in protocol.FIRMWARE_MIN:
            continue
        serial, problem = None, None
        try:
            # Without permission pyusb says of a serial number that there is none; of a status it says the truth.
            usb.control.get_status(device)
            serial = _printable(device.serial_number or "")
        except (OSError, *_NONSENSE) as error:
            problem = explained(error, f"bus {device.bus} address {device.address}")
        finally:
            usb.util.dispose_resources(device)
        location = (device.bus, device.address, device.idProduct, device.bcdDevice & 0xFF)
        cameras.append(FoundDevice(*location, serial, problem, device))
    return cameras


def _printable(text: str) -> str:
    """Return a device's text without what a terminal would obey."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def explained(error: Exception, location: str) -> OSError:
    """Return the system's error, or pyusb's, as one that says what it means for a camera."""
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EACCES:
        return PermissionError(_NO_PERMISSION.format(location=location, rule=UDEV_RULE))
    if number == errno.EBUSY:
        return OSError(errno.EBUSY, f"the camera at {location} is in use by another program")
    if number == errno.ENODEV:
        return OSError(errno.ENODEV, f"the camera at {location} was unplugged")
    return OSError(number or errno.EIO, f"the camera at {location} does not answer: {error}")


class UsbLink:
    """Holds an open camera: interface claimed, nothing written yet.

    Raises:
        OSError: from every method, with what to do about it; errno ENODEV once the camera is unplugged.
    """

    def __init__(self, camera: FoundDevice) -> None:
        self._device = camera.device
        self.location = f"bus {camera.bus} address {camera.address}"
        self._torn: OSError | None = None
        try:
            # Setting the configuration again would reset a camera that is configured.
            if self._configuration() != protocol.CONFIGURATION:
                self._device.set_configuration(protocol.CONFIGURATION)
            self._claim()
            self._check_endpoint()
        except (OSError, *_NONSENSE) as error:
            self.close()
            raise explained(error, self.location) from error

    def _configuration(self) -> int:
        from usb.core import USBError

        try:
            return int(self._device.get_active_configuration().bConfigurationValue)
        except USBError as error:
            if error.errno is None:  # "Configuration not set": pyusb's own, not the system's
                return 0
            raise

    def _claim(self) -> None:
        import usb.util

        usb.util.claim_interface(self._device, protocol.INTERFACE)

    def _check_endpoint(self) -> None:
        from usb.util import ENDPOINT_TYPE_BULK, endpoint_type, find_descriptor

        interface = self._device.get_active_configuration()[protocol.INTERFACE, 0]
        endpoint = find_descriptor(interface, bEndpointAddress=protocol.DATA_ENDPOINT)
        if endpoint is None or endpoint_type(endpoint.bmAttributes) != ENDPOINT_TYPE_BULK:
            raise ValueError(f"its interface has no bulk endpoint {protocol.DATA_ENDPOINT:#04x}")

    def read(self, register: Register) -> int:
        """Return a register's value."""
        request = (protocol.REQUEST_IN, protocol.REQUEST_REGISTER, register.module, register.parameter)
        try:
            answer = self._device.ctrl_transfer(*request, 4)
        except OSError as error:
            raise self._explained(error) from error
        if len(answer) != 4:
            raise OSError(
                errno.EIO, f"the camera at {self.location} gave {len(answer)} bytes of register {register}, not 4"
            )
        return int.from_bytes(answer, "big")

    def write(self, writes: Iterable[Write]) -> None:
        """Set registers one after the other."""
        for module, parameter, value in writes:
            self._send(protocol.REQUEST_REGISTER, module, parameter, protocol.encode_value(value))

    def write_at_once(self, writes: Iterable[Write]) -> None:
        """Set registers in one request."""
        payload = protocol.encode_writes(writes)
        self._send(protocol.REQUEST_REGISTERS, len(payload) // 6, 0, payload)

    def _send(self, request: int, value: int, index: int, payload: bytes) -> None:
        try:
            taken = self._device.ctrl_transfer(protocol.REQUEST_OUT, request, value, index, payload)
        except OSError as error:
            raise self._explained(error) from error
        if taken != len(payload):
            raise OSError(
                errno.EIO, f"the camera at {self.location} took {taken} bytes of a request, not all {len(payload)}"
            )

    def clear_halt(self) -> None:
        """Make the data endpoint usable, whatever happened to it before."""
        try:
            self._device.clear_halt(protocol.DATA_ENDPOINT)
        except OSError as error:
            raise self._explained(error) from error

    def receive(self, buffer: array[int], timeout_s: float) -> bytes:
        """Make one transfer into ``buffer`` (of type "B"), and return its bytes, none if there were none within the
        timeout.

        A transfer that the camera's end tears apart gives what arrived of it; the call after it raises the error.
        """
        from usb.core import USBTimeoutError

        if self._torn is not None:
            raise self._torn
        size = len(buffer)
        view = memoryview(buffer)
        view[:] = bytes(size)
        try:
            return bytes(view[: self._device.read(protocol.DATA_ENDPOINT, buffer, max(1, round(timeout_s * 1000)))])
        except USBTimeoutError:
            return b""
        except OSError as error:
            self._torn = self._explained(error)
            # pyusb does not say how far the transfer got. No camera sends the word 0, so the first of the zeros
            # put there at the end is where it stopped.
            arrived = bytes(view).rstrip(b"\0")
            return arrived + b"\0" * (len(arrived) % 2)

    def _explained(self, error: OSError) -> OSError:
        """Ask again, a little later: a cable that comes out shows at first as any error of a transfer."""
        import usb.control

        if error.errno not in (errno.EACCES, errno.EBUSY, errno.ENODEV):
            time.sleep(0.1)
            try:
                usb.control.get_status(self._device)
            except OSError as later:
                error = later
            except _NONSENSE:
                pass  # it is still there, and answers nonsense: the first error says more
        return explained(error, self.location)

    def close(self) -> None:
        """Let go of the camera."""
        import usb.util

        usb.util.dispose_resources(self._device)
